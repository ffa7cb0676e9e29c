// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "heightmap/field_io.hpp"
#include "meshing/mesh_io.hpp"
#include "meshing/stones.hpp"
#include "tools/jobs.hpp"

namespace maquette::tools {
using nlohmann::json;

Result<JobResult> scan_job(const ScanJob& job, const fs::path& out, const RunContext& run) {
  std::vector<TriMesh> stones;
  if (job.stones) {
    MAQUETTE_TRY(const auto plan, meshing::read_stone_plan(*job.stones));
    for (const auto& s : plan) stones.push_back(meshing::stone_mesh(s));
  }
  // A mesh is scanned like a stone, over ground that is all void.
  heightmap::ModelField surface{Grid<float>(2, 2, NAN), {}, {}, {}};
  if (is_field(job.surface)) {
    MAQUETTE_TRY(surface, heightmap::read_model_field(job.surface));
  } else {
    MAQUETTE_TRY(TriMesh mesh, meshing::read_mesh(job.surface, run));
    stones.push_back(std::move(mesh));
  }
  std::optional<diagnosis::ExtendedModel> model;
  if (job.extended) {
    if (!is_field(job.surface))
      return fail(kUnknownFormat, fmt::format("{}: a surface is extended by causes node by node; "
                                              "give the model field (.tif) that was cut",
                                              job.surface.string()));
    MAQUETTE_TRY(auto made, extended_model(*job.extended, run));
    model.emplace(std::move(made));
    if (!job.as_built) model->build(surface);
  }
  heightmap::ModelField reflectance;
  scan::SurfacePaint paint;
  if (job.reflectance) {
    MAQUETTE_TRY(reflectance, heightmap::read_model_field(*job.reflectance));
    paint = [&reflectance](Vec3 p, bool) {
      const double value = heightmap::height_at(reflectance, p.x, p.y);
      const double known = std::isfinite(value) ? std::clamp(value, 0.0, 1.0) : 0.5;
      const auto grey = static_cast<std::uint16_t>(std::lround(known * 255.0) * 257);
      return scan::SurfaceLook{known, {grey, grey, grey}};
    };
  }
  MAQUETTE_TRY(const auto file, scan::create_cloud(out));
  const auto moved = model && model->moves_points()
                         ? as_seen(*model, *file, job.stations_mm, job.first_scan)
                         : nullptr;
  scan::CloudWriter* const writer = moved ? moved.get() : file.get();
  std::uint64_t points = 0, lost = 0;
  json stations = json::array();
  for (std::size_t i = 0; i < job.stations_mm.size(); ++i) {
    const Vec3 place = job.stations_mm[i];
    const auto set_up = [&](auto& o) {
      o.paint = paint;
      o.colour = job.reflectance.has_value();
      o.name = fmt::format("station {}", i + 1);
      o.max_points = job.max_points;
      o.seed = job.seed + i;
    };
    scan::ScanFigures figures;
    if (const auto* scanner = std::get_if<PhaseShiftScanner>(&job.scanner)) {
      scan::ScanOptions o;
      set_up(o);
      o.scanner = scanner->preset;
      o.angular = scanner->angular;
      o.range = scanner->range;
      o.footprint_rays = scanner->footprint_rays;
      o.station_mm = place;
      MAQUETTE_TRY(figures, scan::simulate_scan(surface, stones, o, *writer, run));
    } else {
      scan::StructuredLightOptions o;
      set_up(o);
      o.scanner = std::get<assets::StructuredLightPreset>(job.scanner);
      Vec3 target;
      if (job.target_mm) {
        target = *job.target_mm;
      } else {
        MAQUETTE_TRY(const Box3 box, surface_bounds(job.surface));
        target = 0.5 * (box.min + box.max);
      }
      o.model_from_station = scan::look_at(place, target);
      MAQUETTE_TRY(figures, scan::simulate_structured_light(surface, stones, o, *writer, run));
    }
    points += figures.points;
    lost += figures.lost;
    stations.push_back({{"position_mm", {place.x, place.y, place.z}},
                        {"points", figures.points},
                        {"lost", figures.lost},
                        {"directions", figures.directions},
                        {"step_widened", figures.widened}});
  }
  MAQUETTE_TRY_VOID(writer->finish());
  JobResult result;
  result.outputs = {out};
  json all{{"points", points},
           {"lost", lost},
           {"scanner", scanner_name(job.scanner)},
           {"stations", stations}};
  if (job.stations_mm.size() == 1) all["station_mm"] = stations[0]["position_mm"];
  result.figures_json = all.dump();
  result.note = fmt::format("{} points", points);
  return result;
}

}  // namespace maquette::tools

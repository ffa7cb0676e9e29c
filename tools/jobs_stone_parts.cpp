// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/jobs_stone_parts.hpp"

#include <atomic>
#include <cmath>
#include <numbers>
#include <optional>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <oneapi/tbb/parallel_for.h>
#include <nlohmann/json.hpp>

#include "cnc/engrave.hpp"
#include "core/files.hpp"
#include "export/cad.hpp"
#include "export/placing_template.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/bands.hpp"
#include "meshing/mesh_checks.hpp"
#include "meshing/stone_parts.hpp"
#include "tools/jobs.hpp"

namespace maquette::tools {
namespace {

using meshing::CatalogueStone;
using nlohmann::json;

/// The heading's tick goes on so far beyond a stone's mean radius.
constexpr double kTick_mm = 1.5;

struct Part {
  CatalogueStone stone;
  std::vector<int> numbers;  ///< of the plan's stones that are made so
  TriMesh mesh;  ///< lower corner of its box at the origin, coordinates as a file has them
  Vec3 size_mm;
  meshing::ClearanceRange clearance;
  double thin_mm = 0.0;
  meshing::MeshCertificate certificate;
};

/// Both file formats keep 32 bits of a coordinate: what is proven is what they hold.
void to_file_coordinates(TriMesh& mesh, Vec3 corner) {
  for (Vec3& v : mesh.vertices_mm) {
    const Vec3 p = v - corner;
    v = {static_cast<double>(static_cast<float>(p.x)), static_cast<double>(static_cast<float>(p.y)),
         static_cast<double>(static_cast<float>(p.z))};
  }
}

Result<Part> make_part(const CatalogueStone& stone, const std::vector<meshing::PlacedStone>& plan,
                       const StonePartsJob& job) {
  Part part;
  part.stone = stone;
  for (const std::size_t place : stone.places) part.numbers.push_back(plan[place].number);
  TriMesh designed = meshing::unit_stone(stone.shape, stone.body);
  for (Vec3& v : designed.vertices_mm) v = stone.scale_mm * v;
  auto shrunk = meshing::shrink_stone(designed, job.clearance);
  if (!shrunk)
    return tl::unexpected(std::move(shrunk.error())
                              .within(fmt::format("part {} (stones {})", stone.part_number,
                                                  fmt::join(part.numbers, ", "))));
  part.mesh = std::move(*shrunk);
  part.clearance = meshing::clearance_of(part.mesh, designed);
  part.thin_mm = meshing::thinner_than_wall_mm(part.mesh, job.wall);
  const Box3 box = part.mesh.bounds();
  part.size_mm = box.max - box.min;
  to_file_coordinates(part.mesh, box.min);
  MAQUETTE_TRY(part.certificate, meshing::check_mesh(part.mesh));
  if (!part.certificate.passed())
    return fail(kMeshFailed,
                fmt::format("part {}: {}", stone.part_number, meshing::to_json(part.certificate)));
  return part;
}

Result<std::vector<Part>> make_parts(const std::vector<meshing::PlacedStone>& plan,
                                     const StonePartsJob& job, const RunContext& run) {
  const auto catalogue = meshing::stone_catalogue(plan);
  std::vector<std::optional<Result<Part>>> made(catalogue.size());
  std::atomic<std::size_t> done{0};
  tbb::parallel_for(std::size_t{0}, catalogue.size(), [&](std::size_t i) {
    if (run.stopped()) return;
    made[i] = make_part(catalogue[i], plan, job);
    run.progress(0.8 * static_cast<double>(++done) / static_cast<double>(catalogue.size()));
  });
  if (run.stopped()) return fail(kCancelled, "making the stones' parts was stopped");
  std::vector<Part> parts;
  for (auto& p : made) {
    if (!*p) return tl::unexpected(std::move(p->error()));
    parts.push_back(std::move(**p));
  }
  return parts;
}

bool too_thin(const Part& part, const StonePartsJob& job) {
  return part.thin_mm > 0.5 * job.wall.value();
}

/// Which part a stone of the plan is.
std::vector<std::size_t> part_of(std::size_t stones, const std::vector<Part>& parts) {
  std::vector<std::size_t> all(stones);
  for (std::size_t i = 0; i < parts.size(); ++i)
    for (const std::size_t place : parts[i].stone.places) all[place] = i;
  return all;
}

class Writer {
 public:
  Writer(const StonePartsJob& job, fs::path folder, const RunContext& run)
      : job_(job), folder_(std::move(folder)), run_(run) {}

  Result<void> parts(const std::vector<Part>& parts) {
    MAQUETTE_TRY_VOID(make_folder(folder_ / "parts"));
    for (const Part& p : parts) {
      if (run_.stopped()) return fail(kCancelled, "writing the stones' parts was stopped");
      const std::string& number = p.stone.part_number;
      const std::string name = fmt::format("stone {}, shape {}, {:.2f} mm", number,
                                           p.stone.shape_number, p.stone.scale_mm);
      MAQUETTE_TRY_VOID(
          exporting::write_3mf({{name, number, &p.mesh}}, add("parts/" + number + ".3mf")));
      MAQUETTE_TRY_VOID(exporting::write_stl(p.mesh, add("parts/" + number + ".stl")));
      MAQUETTE_TRY_VOID(write_file(add("parts/" + number + ".certificate.json"),
                                   meshing::to_json(p.certificate)));
    }
    return {};
  }

  /// @return how many volumes
  Result<std::size_t> builds(const std::vector<meshing::PlacedStone>& stones,
                             const std::vector<Part>& parts,
                             const std::vector<std::size_t>& part_of) {
    std::vector<Vec3> sizes;
    for (const std::size_t p : part_of) sizes.push_back(parts[p].size_mm);
    auto packed = exporting::pack_builds(sizes, job_.volume);
    if (!packed) return tl::unexpected(std::move(packed.error()).within(job_.stones.string()));
    std::size_t volumes = 0;
    std::string list = "build,stone,part,x_mm,y_mm,z_mm,width_mm,depth_mm,height_mm\n";
    for (const auto& box : *packed) volumes = std::max(volumes, box.volume + 1);
    for (std::size_t v = 0; v < volumes; ++v) {
      std::vector<exporting::NamedMesh> meshes;
      std::vector<exporting::BuildItem> items;
      std::vector<std::size_t> mesh_of(parts.size(), SIZE_MAX);
      for (std::size_t i = 0; i < stones.size(); ++i) {
        const auto& box = (*packed)[i];
        if (box.volume != v) continue;
        const Part& part = parts[part_of[i]];
        if (mesh_of[part_of[i]] == SIZE_MAX) {
          mesh_of[part_of[i]] = meshes.size();
          meshes.push_back({"stone " + part.stone.part_number, part.stone.part_number, &part.mesh});
        }
        items.push_back({mesh_of[part_of[i]], box.at_mm,
                         fmt::format("{}/{}", part.stone.part_number, stones[i].number)});
        list += fmt::format("{},{},{},{:.3f},{:.3f},{:.3f},{:.3f},{:.3f},{:.3f}\n", v + 1,
                            stones[i].number, part.stone.part_number, box.at_mm.x, box.at_mm.y,
                            box.at_mm.z, part.size_mm.x, part.size_mm.y, part.size_mm.z);
      }
      MAQUETTE_TRY_VOID(
          exporting::write_3mf(meshes, items, add(fmt::format("build_{:02}.3mf", v + 1))));
    }
    MAQUETTE_TRY_VOID(write_file(add("builds.csv"), list));
    return volumes;
  }

  Result<void> placing(const std::vector<meshing::PlacedStone>& stones,
                       const std::vector<Part>& parts, const std::vector<std::size_t>& part_of,
                       const heightmap::ModelField& design) {
    exporting::PlacingTemplate plan;
    plan.name = job_.name;
    plan.min_mm = {design.x_mm(0), design.y_mm(0)};
    plan.max_mm = {design.x_mm(design.z_mm.cols() - 1), design.y_mm(design.z_mm.rows() - 1)};
    if (job_.bands) {
      MAQUETTE_TRY(const auto bands, meshing::split_into_bands(design, *job_.bands));
      for (std::size_t b = 1; b < bands.size(); ++b) {
        const double x = design.x_mm(bands[b].first), y = design.y_mm(bands[b].first);
        if (bands[b].axis == meshing::BandAxis::x)
          plan.joints.push_back({x, plan.min_mm[1], x, plan.max_mm[1]});
        else
          plan.joints.push_back({plan.min_mm[0], y, plan.max_mm[0], y});
      }
    }
    const auto seats = cnc::stone_seats(design, stones, 0.0, 0.0);
    std::string table =
        "stone,part,shape,diameter_mm,x_mm,y_mm,seat_z_mm,heading_deg,tilt_deg,"
        "tilt_direction_deg,embedded_depth_mm\n";
    for (std::size_t i = 0; i < stones.size(); ++i) {
      const auto& s = stones[i];
      const Part& part = parts[part_of[i]];
      const StoneLie lie = lie_of(s.model_from_stone.rotation);
      const Vec3 at = s.model_from_stone.translation_mm;
      exporting::TemplateStone drawn{s.number,        part.stone.part_number,     {}, {at.x, at.y},
                                     lie.heading_deg, 0.5 * s.scale_mm + kTick_mm};
      double floor_mm = meshing::stone_mesh(s).bounds().min.z;
      for (const cnc::Seat& seat : seats)
        if (seat.stone == s.number) drawn.outline_mm = seat.border_mm, floor_mm = seat.floor_mm;
      table += fmt::format("{},{},{},{:.3f},{:.3f},{:.3f},{:.3f},{:.2f},{:.2f},{:.2f},{:.3f}\n",
                           s.number, part.stone.part_number, part.stone.shape_number, s.scale_mm,
                           at.x, at.y, floor_mm, lie.heading_deg, lie.tilt_deg,
                           lie.tilt_direction_deg, s.embedded_depth_mm);
      plan.stones.push_back(std::move(drawn));
    }
    const auto sheet = job_.paper == "a3" ? exporting::a3_sheet() : exporting::a4_sheet();
    MAQUETTE_TRY_VOID(write_file(add("placing.csv"), table));
    MAQUETTE_TRY_VOID(exporting::write_template_pdf(plan, sheet, add("placing.pdf")));
    return exporting::write_template_dxf(plan, add("placing.dxf"));
  }

  Result<JobResult> finish(const std::vector<Part>& parts, std::size_t stones,
                           std::size_t volumes) {
    JobResult result;
    json part_list = json::array(), file_list = json::array();
    std::vector<std::string> thin;
    double volume = 0.0;
    for (const Part& p : parts) {
      if (too_thin(p, job_)) thin.push_back(p.stone.part_number);
      volume += p.certificate.volume_mm3 * static_cast<double>(p.stone.places.size());
      part_list.push_back(
          {{"part", p.stone.part_number},
           {"shape", p.stone.shape_number},
           {"diameter_mm", p.stone.scale_mm},
           {"stones", p.numbers},
           {"size_mm", {p.size_mm.x, p.size_mm.y, p.size_mm.z}},
           {"volume_mm3", p.certificate.volume_mm3},
           {"clearance_mm", {p.clearance.least_mm, p.clearance.most_mm}},
           // JSON has no infinity: nothing of it is as thick as the wall.
           {"thinner_than_wall_mm", std::isfinite(p.thin_mm) ? json(p.thin_mm) : json(nullptr)},
           {"wall_kept", std::isnan(p.thin_mm) ? json(nullptr) : json(!too_thin(p, job_))}});
    }
    for (const std::string& name : names_) {
      std::error_code ec;
      MAQUETTE_TRY(const std::string hash, sha256_file(folder_ / name));
      file_list.push_back(
          {{"file", name}, {"bytes", fs::file_size(folder_ / name, ec)}, {"sha256", hash}});
    }
    const json figures{{"schema", "maquette.stone_parts/1"},
                       {"unit", "mm"},
                       {"stones", stones},
                       {"distinct_parts", parts.size()},
                       {"builds", volumes},
                       {"clearance_mm", job_.clearance.value()},
                       {"wall_mm", job_.wall.value()},
                       {"material_mm3", volume},
                       {"parts", part_list},
                       {"files", file_list}};
    MAQUETTE_TRY_VOID(write_file(add("stone_parts.json"), figures.dump(1) + "\n"));
    for (const std::string& name : names_) result.outputs.push_back(folder_ / name);
    result.figures_json = json{
        {"stones", stones},
        {"distinct_parts", parts.size()},
        {"builds", volumes},
        {"material_mm3", volume},
        {"thin_parts", thin}}.dump();
    result.note =
        fmt::format("{} stones of {} parts in {} build volumes", stones, parts.size(), volumes);
    if (!thin.empty()) {
      const std::string lacking = fmt::format(
          "{} of {} parts stand out of what walls of {:g} mm can make by more than half of that "
          "({}{}); see thinner_than_wall_mm in stone_parts.json",
          thin.size(), parts.size(), job_.wall.value(),
          fmt::join(
              thin.begin(),
              thin.begin() + static_cast<std::ptrdiff_t>(std::min<std::size_t>(thin.size(), 8)),
              ", "),
          thin.size() > 8 ? ", ..." : "");
      if (job_.thin_is_unmet)
        result.unmet = lacking;
      else
        run_.warn(lacking);
    }
    return result;
  }

  static Result<void> make_folder(const fs::path& path) {
    std::error_code ec;
    fs::create_directories(path, ec);
    if (ec) return tl::unexpected(write_error(path, ec.value()));
    return {};
  }

 private:
  fs::path add(const std::string& name) {
    names_.push_back(name);
    return folder_ / name;
  }

  const StonePartsJob& job_;
  fs::path folder_;
  const RunContext& run_;
  std::vector<std::string> names_;
};

}  // namespace

StoneLie lie_of(const Quaternion& model_from_stone) {
  constexpr double kDegrees = 180.0 / std::numbers::pi;
  const Vec3 along = rotate(model_from_stone, {1, 0, 0}), up = rotate(model_from_stone, {0, 0, 1});
  const double off = std::hypot(up.x, up.y);
  return {std::atan2(along.y, along.x) * kDegrees, std::atan2(off, up.z) * kDegrees,
          off > 0.0 ? std::atan2(up.y, up.x) * kDegrees : 0.0};
}

Result<JobResult> stone_parts_job(const StonePartsJob& job, const fs::path& folder,
                                  const RunContext& run) {
  MAQUETTE_TRY(const auto stones, meshing::read_stone_plan(job.stones));
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(job.design));
  MAQUETTE_TRY(const auto parts, make_parts(stones, job, run));
  const auto which = part_of(stones.size(), parts);
  Writer writer(job, folder, run);
  MAQUETTE_TRY_VOID(Writer::make_folder(folder));
  std::size_t volumes = 0;
  if (!stones.empty()) {
    MAQUETTE_TRY(volumes, writer.builds(stones, parts, which));
  }
  MAQUETTE_TRY_VOID(writer.parts(parts));
  MAQUETTE_TRY_VOID(writer.placing(stones, parts, which, design));
  run.progress(1.0);
  return writer.finish(parts, stones.size(), volumes);
}

}  // namespace maquette::tools

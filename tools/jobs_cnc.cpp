// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <optional>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "camera/image_io.hpp"
#include "cnc/verify.hpp"
#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/mesh_io.hpp"
#include "meshing/stones.hpp"
#include "tools/jobs.hpp"
#include "tools/pictures.hpp"
#include "tools/program_pictures.hpp"
#include "tools/tool_table.hpp"

namespace maquette::tools {
using nlohmann::json;
namespace {

/// Deepest place where the simulated cut lies below the mesh that is shown, exported
/// and rendered; under the stones and in their seats the mesh is not milled and does not count.
Result<double> gouge_against_mesh(const TriMesh& mesh, const fs::path& as_milled,
                                  const heightmap::ModelField& design,
                                  const heightmap::ModelField& machined,
                                  const heightmap::ModelField& with_stones) {
  MAQUETTE_TRY(const auto cut, heightmap::heights_at(as_milled, mesh.vertices_mm));
  double deepest = 0.0;
  for (std::size_t i = 0; i < cut.size(); ++i) {
    const Vec3& v = mesh.vertices_mm[i];
    const double terrain = heightmap::height_at(design, v.x, v.y);
    // Walls and base are below the surface, stones above it.
    constexpr double kOnSurface = 1e-3;
    if (!(std::fabs(v.z - terrain) < kOnSurface)) continue;
    if (heightmap::height_at(with_stones, v.x, v.y) > terrain + kOnSurface) continue;
    if (heightmap::height_at(machined, v.x, v.y) < terrain - kOnSurface) continue;
    if (!std::isnan(cut[i])) deepest = std::max(deepest, v.z - cut[i]);
  }
  return deepest;
}

/// Whether each tool that cuts clears the work with the machine's z at its top.
Result<void> check_tools(const VerifyJob& job, const heightmap::ModelField& design,
                         const cnc::Certificate& certificate) {
  if (!job.options.machine) return {};
  const double table =
      static_cast<double>(heightmap::height_range(design.z_mm).min) - job.base_thickness.value();
  for (const cnc::Tool& tool : job.options.tools)
    if (std::any_of(certificate.tools.begin(), certificate.tools.end(),
                    [&](const cnc::ToolUse& use) { return use.number == tool.number; }))
      MAQUETTE_TRY_VOID(cnc::check_tool_length(*job.options.machine, tool, gauge_length_mm(tool),
                                               certificate.travel.max.z - table));
  return {};
}

/// The programs as they were meant, where all of them lie beside those that are called: against the
/// design, by their paths. Cells are as coarse as the cutters allow, for the paths decide.
Result<json> certify_meant(const VerifyJob& job, const cnc::VerifyOptions& options,
                           const heightmap::ModelField& machined, const RunContext& run) {
  std::vector<fs::path> meant;
  for (const fs::path& program : job.programs)
    if (fs::path beside = meant_of_part(program); fs::exists(beside))
      meant.push_back(std::move(beside));
  if (meant.empty() || meant.size() != job.programs.size()) return json(nullptr);
  cnc::VerifyOptions plain = options;
  plain.errors.reset();
  plain.visit = {};
  double least = plain.tools.empty() ? plain.ball_diameter.value() : INFINITY;
  for (const cnc::Tool& tool : plain.tools) least = std::min(least, 2.0 * tool.cutter.radius_mm);
  plain.cell =
      Millimetres{std::max(plain.cell.value(), std::min(0.25 * least, machined.spacing.value()))};
  const cnc::RowSink none = [](const cnc::MilledShape&, std::ptrdiff_t,
                               std::span<const float>) -> Result<void> { return {}; };
  MAQUETTE_TRY(const auto c, cnc::verify(meant, machined, plain, none, run));
  json names = json::array();
  for (const fs::path& program : meant) names.push_back(program.filename().string());
  return json{{"programs", names},
              {"program_sha256", c.program_sha256},
              {"max_gouge_mm", c.max_gouge_mm},
              {"bound_mm", c.bound_mm}};
}

}  // namespace

Result<JobResult> verify_job(const VerifyJob& job, const fs::path& folder, const RunContext& run) {
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(job.design));
  heightmap::ModelField cut_into;
  if (job.machined) {
    MAQUETTE_TRY(cut_into, heightmap::read_model_field(*job.machined));
  }
  const heightmap::ModelField& machined = job.machined ? cut_into : design;
  cnc::VerifyOptions options = job.options;
  heightmap::ModelField stock;
  if (job.stock) {
    MAQUETTE_TRY(stock, heightmap::read_model_field(*job.stock));
    options.stock = &stock;
  }
  if (std::isnan(options.stock_top.value()))
    options.stock_top = Millimetres{static_cast<double>(heightmap::height_range(design.z_mm).max)} +
                        job.stock_margin;
  // A tighter bound than usual wants its offenders named; below 1 um that would be every move.
  if (job.max_gouge)
    options.gouge_limit =
        Millimetres{std::clamp(job.max_gouge->value(), 0.001, options.gouge_limit.value())};
  ProgramPicturesOptions drawn;
  drawn.design = &design;
  drawn.engagement = true;
  drawn.colours = {cnc::BackplotColour::feed, cnc::BackplotColour::engagement};
  std::vector<fs::path> pictures;
  MAQUETTE_TRY(auto drawing, ProgramPictures::plan(job.programs, drawn,
                                                   picture_files(folder / "backplot", pictures)));
  options.visit = [&](const cnc::Motion& motion, std::size_t program, double removed_mm3) {
    drawing.add(motion, program, removed_mm3);
  };

  heightmap::ModelField stones;
  if (job.stones && job.stones_stand) {
    MAQUETTE_TRY(const auto plan, meshing::read_stone_plan(*job.stones));
    stones = meshing::with_stones(design, plan);
    options.with_stones = &stones;
  }
  JobResult result;
  result.outputs = {folder / "certificate.json", folder / "as_milled.tif", folder / "excess.png"};
  // Excess (red) and gouge (blue) on the design's own nodes.
  Grid<float> excess(machined.z_mm.rows(), machined.z_mm.cols());
  std::optional<heightmap::ModelFieldWriter> writer;
  const cnc::RowSink rows = [&](const cnc::MilledShape& shape, std::ptrdiff_t row,
                                std::span<const float> heights) -> Result<void> {
    if (!writer) {
      std::error_code ec;
      fs::create_directories(folder, ec);
      if (ec) return tl::unexpected(write_error(folder, ec.value()));
      MAQUETTE_TRY(
          writer, heightmap::ModelFieldWriter::create(
                      result.outputs[1], {shape.rows, shape.cols, shape.cell, shape.x0, shape.y0}));
    }
    const std::ptrdiff_t k = (shape.cols - 1) / (excess.cols() - 1);
    if (row % k == 0)
      for (std::ptrdiff_t c = 0; c < excess.cols(); ++c)
        excess(row / k, c) = heights[static_cast<std::size_t>(c * k)] - machined.z_mm(row / k, c);
    return writer->write_row(heights);
  };
  if (job.adjust) options.errors = job.adjust->errors;
  MAQUETTE_TRY(const auto certificate, cnc::verify(job.programs, machined, options, rows, run));
  MAQUETTE_TRY_VOID(check_tools(job, design, certificate));
  MAQUETTE_TRY_VOID(writer->commit());
  json figures = json::parse(cnc::to_json(certificate));
  double meant_mm = 0.0;
  if (job.adjust) {
    json& adjusted = figures["adjusted"] = json_of(*job.adjust);
    adjusted["largest_change_mm"] = certificate.displaced_mm;
    MAQUETTE_TRY(adjusted["meant"], certify_meant(job, options, machined, run));
    if (!adjusted["meant"].is_null())
      meant_mm = adjusted["meant"]["max_gouge_mm"].get<double>() +
                 adjusted["meant"]["bound_mm"].get<double>();
  }
  double as_built_gouge = 0.0;
  if (job.extended) {
    MAQUETTE_TRY(const auto model, extended_model(*job.extended, run));
    heightmap::ModelField built = machined;
    for (std::size_t i = 0; i < excess.cells().size(); ++i)
      built.z_mm.cells()[i] += excess.cells()[i];
    model.build(built);
    result.outputs.push_back(folder / "as_built.tif");
    MAQUETTE_TRY_VOID(heightmap::write_model_field(built, result.outputs.back()));
    double squares = 0.0, nodes = 0.0, above = 0.0;
    for (std::size_t i = 0; i < excess.cells().size(); ++i) {
      const double off = static_cast<double>(built.z_mm.cells()[i] - machined.z_mm.cells()[i]);
      if (std::isnan(off)) continue;
      squares += off * off;
      nodes += 1.0;
      above = std::max(above, off);
      as_built_gouge = std::max(as_built_gouge, -off);
    }
    figures["as_built"] = {{"causes", model.names()},
                           {"max_below_mm", as_built_gouge},
                           {"max_above_mm", above},
                           {"rms_mm", std::sqrt(squares / std::max(1.0, nodes))}};
  }
  for (json& row : figures["machining_time"]) {
    const auto i = row["program"].get<std::size_t>();
    row["program"] = job.programs[i].filename().string();
    row["band"] = i < job.bands.size() ? job.bands[i] : "";
  }
  if (job.mesh && job.stones) {
    MAQUETTE_TRY(const auto plan, meshing::read_stone_plan(*job.stones));
    MAQUETTE_TRY(const auto mesh, meshing::read_mesh(*job.mesh));
    MAQUETTE_TRY(figures["max_gouge_against_mesh_mm"],
                 gouge_against_mesh(mesh, result.outputs[1], design, machined,
                                    meshing::with_stones(design, plan)));
  }
  MAQUETTE_TRY_VOID(write_file(result.outputs[0], figures.dump(1)));
  MAQUETTE_TRY_VOID(drawing.finish());
  pictures.push_back(folder / "backplot" / "paths.json");
  MAQUETTE_TRY_VOID(write_file(pictures.back(), drawing.scene_json()));
  result.outputs.insert(result.outputs.end(), pictures.begin(), pictures.end());
  MAQUETTE_TRY_VOID(
      camera::write_png(signed_picture(excess, colour_limit(excess, 0.01)), result.outputs[2]));

  const double gouge =
      std::max(certificate.max_gouge_mm, figures.value("max_gouge_against_mesh_mm", 0.0));
  if (job.max_gouge && gouge + certificate.bound_mm > job.max_gouge->value())
    result.unmet = fmt::format(
        "gouge of up to {:.4f} mm ({:.4f} found, {:.4f} may be unseen) is "
        "above the limit of {:.4f} mm",
        gouge + certificate.bound_mm, gouge, certificate.bound_mm, job.max_gouge->value());
  if (job.max_gouge && as_built_gouge > job.max_gouge->value())
    result.unmet += fmt::format(
        "{}as built, with the causes of {}, the part is up to {:.4f} mm below the "
        "design, above the limit of {:.4f} mm",
        result.unmet.empty() ? "" : "; ", job.extended->file.string(), as_built_gouge,
        job.max_gouge->value());
  else if (!result.unmet.empty() && certificate.path && !certificate.path->places.empty()) {
    const cnc::PathGouge& worst = certificate.path->places.front();
    result.unmet +=
        fmt::format("; the deepest, {:.4f} mm at x {:.3f} y {:.3f}, by {}:{}", worst.depth_mm,
                    worst.x_mm, worst.y_mm, job.programs[worst.program].string(), worst.line);
  }
  const auto unmet = [&](bool is, const std::string& what) {
    if (is) result.unmet += (result.unmet.empty() ? "" : "; ") + what;
  };
  const auto first = [&](const std::vector<cnc::MotionPlace>& places) {
    if (places.empty()) return std::string();
    const cnc::MotionPlace& p = places.front();
    return fmt::format(", first at x {:.3f} y {:.3f} z {:.3f} by {}:{}", p.at_mm.x, p.at_mm.y,
                       p.at_mm.z, job.programs[p.program].string(), p.line);
  };
  unmet(job.max_gouge && meant_mm > job.max_gouge->value(),
        fmt::format("the programs as meant gouge up to {:.4f} mm", meant_mm));
  unmet(certificate.rapid_collisions > 0,
        fmt::format("{} rapid moves touch material{}", certificate.rapid_collisions,
                    first(certificate.first_rapid_collisions)));
  unmet(certificate.holder_collisions > 0,
        fmt::format("holder or shank meets material in {} moves{}", certificate.holder_collisions,
                    first(certificate.first_holder_collisions)));
  unmet(certificate.stone_collisions > 0,
        fmt::format("the cutter meets stones in {} moves{}", certificate.stone_collisions,
                    first(certificate.first_stone_collisions)));
  unmet(
      certificate.stone_holder_collisions > 0,
      fmt::format("holder or shank meets stones in {} moves{}", certificate.stone_holder_collisions,
                  first(certificate.first_stone_holder_collisions)));
  unmet(!certificate.beyond_travel.empty(),
        fmt::format("the machine cannot travel as far along {}", certificate.beyond_travel));
  result.figures_json = figures.dump();
  double most_blocks_per_s = 0.0;
  for (const cnc::ToolUse& use : certificate.tools)
    most_blocks_per_s = std::max(most_blocks_per_s, use.time.highest_blocks_per_s);
  if (options.machine && most_blocks_per_s > options.machine->blocks_per_s)
    run.warn(fmt::format("{:.0f} blocks a second at their densest, {} reads {:.0f}: it will wait",
                         most_blocks_per_s, options.machine->name, options.machine->blocks_per_s));
  result.note =
      fmt::format("gouge {:.1f} um (+{:.1f} bound), excess {:.1f} um where reachable", 1e3 * gouge,
                  1e3 * certificate.bound_mm, 1e3 * certificate.max_excess_mm);
  if (const double blending = certificate.blending_mm.value_or(0.0);
      blending > 0.0 && std::isfinite(blending))
    result.note += fmt::format(", of the path; blending {:.1f} um more", 1e3 * blending);
  if (job.adjust)
    result.note += fmt::format(", as the machine makes programs called {:.4f} mm beside",
                               certificate.displaced_mm);
  return result;
}

}  // namespace maquette::tools

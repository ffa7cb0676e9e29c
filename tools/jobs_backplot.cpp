// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "camera/image_io.hpp"
#include "cnc/gcode_reader.hpp"
#include "cnc/verify.hpp"
#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "tools/commands/commands.hpp"
#include "tools/jobs.hpp"
#include "tools/path_view.hpp"
#include "tools/program_pictures.hpp"

namespace maquette::tools {
namespace {

/// Each motion with what it removes from the stock.
Result<void> cut_all(const BackplotJob& job, const heightmap::ModelField& design,
                     ProgramPictures& pictures, const RunContext& run) {
  cnc::VerifyOptions options;
  options.ball_diameter = job.ball_diameter;
  options.tools = job.tools;
  double least = job.tools.empty() ? job.ball_diameter.value() : INFINITY;
  for (const cnc::Tool& tool : job.tools) least = std::fmin(least, 2.0 * tool.cutter.radius_mm);
  // Engagement is a sum over cells: half a millimetre of a ball of 6 is fine enough to colour by.
  options.cell = Millimetres{std::fmin(0.25, least / 12.0)};
  heightmap::ModelField stock;
  if (job.stock) {
    MAQUETTE_TRY(stock, heightmap::read_model_field(*job.stock));
    options.stock = &stock;
  }
  options.visit = [&](const cnc::Motion& motion, std::size_t program, double removed_mm3) {
    pictures.add(motion, program, removed_mm3);
  };
  const cnc::RowSink none = [](const cnc::MilledShape&, std::ptrdiff_t,
                               std::span<const float>) -> Result<void> { return {}; };
  MAQUETTE_TRY_VOID(cnc::verify(job.programs, design, options, none, run));
  return {};
}

Result<void> read_all(const BackplotJob& job, ProgramPictures& pictures, const RunContext& run) {
  for (std::size_t i = 0; i < job.programs.size(); ++i) {
    const cnc::MotionSink sink = [&](std::span<const cnc::Motion> motions) -> Result<void> {
      for (const cnc::Motion& m : motions) pictures.add(m, i);
      return {};
    };
    MAQUETTE_TRY_VOID(cnc::read_gcode(job.programs[i], sink, run));
    run.progress(static_cast<double>(i + 1) / static_cast<double>(job.programs.size()));
  }
  return {};
}

}  // namespace

PictureSink picture_files(const fs::path& folder, std::vector<fs::path>& files) {
  return [folder, &files](const std::string& program, cnc::BackplotColour colour,
                          const Drawing& drawing) -> Result<void> {
    std::error_code ec;
    fs::create_directories(folder, ec);
    if (ec) return tl::unexpected(write_error(folder, ec.value()));
    const std::string stem = fmt::format("{}.{}", program, name(colour));
    files.push_back(folder / (stem + ".svg"));
    MAQUETTE_TRY_VOID(write_file(files.back(), to_svg(drawing, stem)));
    files.push_back(folder / (stem + ".png"));
    return camera::write_png(to_pixels(drawing), files.back());
  };
}

Result<JobResult> backplot_job(const BackplotJob& job, const fs::path& out, const RunContext& run) {
  const std::string ending = out.extension().string();
  if (ending != ".svg" && ending != ".png" && ending != ".html")
    return fail(kUsage,
                fmt::format("--out {}: the name must end in .svg, .png or .html", out.string()));
  if (job.colour == cnc::BackplotColour::engagement && !job.design)
    return fail(kUsage, "--colour engagement: give the --design, to cut the program in simulation");
  heightmap::ModelField design;
  ProgramPicturesOptions options;
  options.together = true;
  options.colours.clear();
  if (ending != ".html") options.colours = {job.colour};
  options.engagement = job.design.has_value();
  if (job.design) {
    MAQUETTE_TRY(design, heightmap::read_model_field(*job.design));
    options.design = &design;
  }
  const PictureSink sink = [&](const std::string& program, cnc::BackplotColour,
                               const Drawing& drawing) -> Result<void> {
    if (ending == ".svg") return write_file(out, to_svg(drawing, program));
    return camera::write_png(to_pixels(drawing), out);
  };
  MAQUETTE_TRY(auto pictures, ProgramPictures::plan(job.programs, options, sink));
  // Heights and feeds need no simulation.
  const bool cut =
      job.design && (ending == ".html" || job.colour == cnc::BackplotColour::engagement);
  MAQUETTE_TRY_VOID(cut ? cut_all(job, design, pictures, run) : read_all(job, pictures, run));
  MAQUETTE_TRY_VOID(pictures.finish());
  if (ending == ".html")
    MAQUETTE_TRY_VOID(
        write_path_page(job.programs.front().stem().string(), pictures.scene_json(), out));
  JobResult result;
  result.outputs = {out};
  const ProgramFigures figures = pictures.figures();
  result.figures_json = nlohmann::json{
      {"moves", figures.moves},
      {"cut_mm", figures.cut_mm},
      {"rapid_mm", figures.rapid_mm},
      {"time_min",
       figures.time_min}}.dump();
  result.note = fmt::format("{} moves, {:.1f} m of cuts", figures.moves, 1e-3 * figures.cut_mm);
  return result;
}

}  // namespace maquette::tools

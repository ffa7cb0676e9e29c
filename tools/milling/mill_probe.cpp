// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "cnc/probing.hpp"
#include "tools/milling/mill_program.hpp"

namespace maquette::tools {

Result<JobResult> probe_job(const MillJob& job, const std::filesystem::path& out,
                            const RunContext&) {
  MAQUETTE_TRY(const Piece piece, piece_of(job, 0.0));
  const double top = std::isnan(job.stock_top.value()) ? piece.top_mm + job.stock_margin.value()
                                                       : job.stock_top.value();
  cnc::BlockCorner corner;
  corner.x_mm = piece.design.x0.value();
  corner.y_mm = std::isnan(piece.first_y_mm) ? piece.design.y0.value() : piece.first_y_mm;
  corner.top_mm = top;
  cnc::ProbingOptions options;
  options.post = job.program.post;
  options.work_offset = job.program.work_offset;
  options.ball_radius_mm = job.tool.cutter.radius_mm;
  MAQUETTE_TRY(const std::string touches, cnc::probe_block_corner(corner, options));
  const double away = options.ball_radius_mm + options.search_mm;
  MAQUETTE_TRY_VOID(cnc::check_travel(
      job.machine,
      {{corner.x_mm - away, corner.y_mm - away, top - corner.depth_mm},
       {corner.x_mm + corner.inset_mm, corner.y_mm + corner.inset_mm, top + options.search_mm}}));
  MillJob still = job;
  still.spindle_rpm = 0.0;
  still.material.reset();
  still.clearance = Millimetres{std::max(job.clearance.value(), options.search_mm)};
  MAQUETTE_TRY(auto program,
               MillProgram::begin(still, piece, out, top, Millimetres{0.0},
                                  {"sets the work offset on the corner of the block",
                                   fmt::format("corner x {} y {}, top z {} mm, right to within {} "
                                               "mm before",
                                               corner.x_mm, corner.y_mm, top, options.search_mm)}));
  program.writer().lines(touches);
  return program.finish_unread(
      {{"passes", 0}, {"corner_x_mm", corner.x_mm}, {"corner_y_mm", corner.y_mm}, {"top_mm", top}});
}

}  // namespace maquette::tools

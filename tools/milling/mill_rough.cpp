// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "cnc/roughing.hpp"
#include "cnc/stock_grid.hpp"
#include "heightmap/field_io.hpp"
#include "tools/milling/mill_program.hpp"

namespace maquette::tools {
using nlohmann::json;

Result<JobResult> rough_job(const MillJob& job, const std::filesystem::path& out,
                            const RunContext& run) {
  MillJob whole = job;
  whole.bands.reset();  // a band's neighbour would stand in the way of its entries
  MAQUETTE_TRY(Piece piece, piece_of(whole, 0.0));
  piece.depth.reset();
  piece.deepest_mm = job.step_down_mm;
  const heightmap::ModelField& design = piece.design;
  cnc::StockBox box;
  box.x0_mm = design.x0.value();
  box.x1_mm = design.x_mm(design.z_mm.cols() - 1);
  box.y0_mm = design.y0.value();
  box.y1_mm = design.y_mm(design.z_mm.rows() - 1);
  const double highest = static_cast<double>(heightmap::height_range(design.z_mm).max);
  box.top_mm = std::isnan(job.stock_top.value()) ? highest + job.stock_margin.value()
                                                 : job.stock_top.value();
  if (piece.stock) box.top_mm = static_cast<double>(heightmap::height_range(piece.stock->z_mm).max);
  cnc::RoughingOptions options;
  options.cutter = job.tool.cutter;
  options.allowance_mm = job.allowance_mm;
  options.step_down_mm = job.step_down_mm;
  options.stepover_mm = job.stepover_mm;
  options.cell_mm = job.cell_mm;
  options.ramp_angle_deg = job.ramp_deg;
  options.feed_mm_min = job.feed.value();
  options.plunge_feed_mm_min = job.plunge_feed.value();
  MAQUETTE_TRY(const cnc::Roughing roughing, piece.stock
                                                 ? cnc::rough(design, *piece.stock, options, run)
                                                 : cnc::rough(design, box, options, run));
  const cnc::RoughingReport& report = roughing.report;
  if (report.lacking_mm > 0.0)
    run.warn(fmt::format("the block's top, z = {} mm, is up to {:.2f} mm below the design",
                         box.top_mm, report.lacking_mm));
  constexpr Millimetres kBlending{0.02};  // against an allowance of tenths
  MAQUETTE_TRY(auto program,
               MillProgram::begin(job, piece, out, box.top_mm, kBlending,
                                  {"frame of the model, x east, y north, z up",
                                   fmt::format("roughing, leaves {} mm", options.allowance_mm),
                                   fmt::format("block x {} .. {} y {} .. {} top z {} mm", box.x0_mm,
                                               box.x1_mm, box.y0_mm, box.y1_mm, box.top_mm)}));
  MAQUETTE_TRY_VOID(program.add(roughing.path));
  MAQUETTE_TRY(auto result, program.finish({},
                                           {{"levels", report.levels},
                                            {"pieces", report.pieces},
                                            {"side_entries", report.side_entries},
                                            {"ramps", report.ramps},
                                            {"removed_cm3", 1e-3 * report.removed_mm3},
                                            {"stock_top_mm", box.top_mm}},
                                           run));
  result.outputs.push_back(beside(out, "stock"));
  MAQUETTE_TRY_VOID(
      heightmap::write_model_field(cnc::surface_over(roughing.stock), result.outputs.back()));
  result.note +=
      fmt::format(", {} levels, {:.0f} cm3 removed", report.levels, 1e-3 * report.removed_mm3);
  return result;
}

}  // namespace maquette::tools

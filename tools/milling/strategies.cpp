// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>

#include <fmt/format.h>

#include "cnc/stock_after.hpp"
#include "core/check.hpp"
#include "heightmap/field_io.hpp"
#include "tools/milling/mill_program.hpp"

namespace maquette::tools {
namespace {

const double kNone = NAN;

/// What is left of the block is known from it alone; of the others with the stock before.
bool covers(std::string_view strategy) {
  return strategy == "raster" || strategy == "semi-finish" || strategy == "geodesic";
}

const Strategy kStrategies[] = {
    {"raster", "parallel finishing passes of a ball", true, true, 1, cnc::Cutter::ball(3.0), 0.5,
     kNone, kNone, raster_job},
    {"rough", "level by level with a flat or bull-nose cutter, where stock remains", false, true, 2,
     cnc::Cutter::bull(6.0, 1.0), 6.0, 5.0, 0.5, rough_job},
    {"semi-finish", "parallel passes of a ball that take the steps of roughing off", true, true, 1,
     cnc::Cutter::ball(3.0), 1.0, kNone, 0.2, semi_finish_job},
    {"rest", "a smaller ball, only where the one before did not fit", true, true, 3,
     cnc::Cutter::ball(1.5), 0.2, 2.0, kNone, rest_job},
    {"waterline", "passes at constant height where it is steep", false, true, 1,
     cnc::Cutter::ball(3.0), kNone, 0.5, kNone, waterline_job},
    {"geodesic", "passes at equal distance on the surface, whatever the slope", false, true, 1,
     cnc::Cutter::ball(3.0), 0.5, kNone, kNone, geodesic_job},
    {"seats", "pockets with level floors for the stones of --stones", true, true, 3,
     cnc::Cutter::ball(1.5), 0.2, 2.0, kNone, seats_job},
    {"outlines", "marks along the borders of the stones' seats", true, true, 4,
     cnc::Cutter::ball(0.5), kNone, kNone, kNone, outlines_job},
    {"probe", "touches the block's corner and sets the work offset there (G38.2)", true, false, 10,
     cnc::Cutter::ball(1.0), kNone, kNone, kNone, probe_job},
    {"sphere-seats", "bores that the reference spheres of --spheres rest in", false, true, 5,
     cnc::Cutter::flat(3.0), kNone, kNone, kNone, sphere_seats_job},
    {"probe-spheres", "touches the reference spheres of --spheres (G38.2), for the scan", false,
     false, 10, cnc::Cutter::ball(1.0), kNone, kNone, kNone, probe_spheres_job},
};

}  // namespace

std::span<const Strategy> strategies() {
  return kStrategies;
}

const Strategy& strategy_of(std::string_view name) {
  const auto* found = std::find_if(std::begin(kStrategies), std::end(kStrategies),
                                   [&](const Strategy& s) { return s.name == name; });
  MAQUETTE_CHECK(found != std::end(kStrategies), "strategy {}", name);
  return *found;
}

MillJob default_job(std::string_view strategy) {
  const Strategy& s = strategy_of(strategy);
  MillJob job;
  job.strategy = job.name = s.name;
  job.tool.number = s.tool;
  job.tool.name = "";  // as its shape says
  job.tool.cutter = s.cutter;
  job.stepover_mm = s.stepover_mm;
  job.step_down_mm = s.step_down_mm;
  job.allowance_mm = s.allowance_mm;
  return job;
}

Result<JobResult> mill_job(const MillJob& job, const std::filesystem::path& out,
                           const RunContext& run) {
  MAQUETTE_TRY(const MillJob whole, with_feeds(job));
  const Strategy& strategy = strategy_of(job.strategy);
  MAQUETTE_TRY(auto result, strategy.make(whole, out, run));
  // Roughing knows what it leaves from its plan.
  const auto stock = beside(out, "stock");
  if (!strategy.cuts || !job.leave_stock || !result.unmet.empty() ||
      !(job.stock || covers(job.strategy)) ||
      std::find(result.outputs.begin(), result.outputs.end(), stock) != result.outputs.end())
    return result;
  // Of those that are meant: what the machine makes of the others is the same.
  const auto& files = result.meant.empty() ? result.outputs : result.meant;
  std::vector<std::filesystem::path> programs;
  for (const std::filesystem::path& file : files)
    if (file.extension() != ".tif") programs.push_back(file);
  // Also beside a band: the next operation flies over it.
  MAQUETTE_TRY(const auto left, stock_job(programs, {&whole.tool, 1}, job.design, job.stock,
                                          job.stock_margin, stock, run));
  result.outputs.push_back(left.outputs.front());
  return result;
}

Result<JobResult> stock_job(std::span<const std::filesystem::path> programs,
                            std::span<const cnc::Tool> tools, const std::filesystem::path& design,
                            const std::optional<std::filesystem::path>& stock, Millimetres margin,
                            const std::filesystem::path& out, const RunContext& run) {
  MAQUETTE_TRY(const auto field, heightmap::read_model_field(design));
  cnc::Block block;
  block.top = Millimetres{static_cast<double>(heightmap::height_range(field.z_mm).max)} + margin;
  std::optional<heightmap::ModelField> before;
  if (stock) {
    MAQUETTE_TRY(before, heightmap::read_model_field(*stock));
    block.stock = &*before;
  }
  MAQUETTE_TRY(const auto left, cnc::stock_after(programs, tools, field, block, run));
  JobResult result;
  result.outputs = {out};
  result.note = fmt::format("what {} programs leave", programs.size());
  MAQUETTE_TRY_VOID(heightmap::write_model_field(left, out));
  return result;
}

}  // namespace maquette::tools

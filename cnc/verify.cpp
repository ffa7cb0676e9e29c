// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/verify.hpp"

#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "cnc/certificate.hpp"
#include "cnc/gcode_reader.hpp"
#include "cnc/mill.hpp"
#include "cnc/milling_sim.hpp"
#include "core/files.hpp"

namespace maquette::cnc {
namespace {

// Enough to keep all threads busy, few enough that a stop is heard within a second.
constexpr std::size_t kMovesPerCut = std::size_t{1} << 18;
constexpr double kChordDeviation_mm = 0.0005;
constexpr double kMostNodes = 3e9;  // 12 GB of heights

struct GridPlan {
  std::ptrdiff_t per_spacing = 1, rows = 0, cols = 0;
  double cell_mm = 0.0;
};

Result<GridPlan> plan_grid(const heightmap::ModelField& design, const VerifyOptions& options) {
  const double diameter = options.ball_diameter.value(), cell = options.cell.value();
  if (!(diameter > 0.0) || !std::isfinite(diameter))
    return fail(kToolNotPositive,
                fmt::format("ball_diameter is {} mm, expected a length above 0", diameter));
  if (!(cell > 0.0) || !(cell <= 0.25 * diameter))
    return fail(kCellOutOfRange,
                fmt::format("cell is {} mm, expected more than 0 and at most half the ball's "
                            "radius, {} mm",
                            cell, 0.25 * diameter));
  const double spacing = design.spacing.value();
  if (design.z_mm.rows() < 2 || design.z_mm.cols() < 2 || !(spacing > 0.0))
    return fail(kCellOutOfRange,
                fmt::format("the design has {} x {} nodes {} mm apart, expected at least 2 x 2",
                            design.z_mm.rows(), design.z_mm.cols(), spacing));
  const heightmap::HeightRange range = heightmap::height_range(design.z_mm);
  if (range.voids > 0 || !std::isfinite(range.min) || !std::isfinite(range.max))
    return fail(kHeightNotFinite,
                fmt::format("the design has {} voids or infinite heights, expected none; fill "
                            "them first",
                            range.voids));
  // The largest fraction of the spacing that is not above the cell asked for; a hair's
  // breadth of rounding must not make 5 into 6.
  const double parts = std::fmax(1.0, std::ceil(spacing / cell * (1.0 - 1e-9)));
  const double rows = static_cast<double>(design.z_mm.rows() - 1) * parts + 1.0;
  const double cols = static_cast<double>(design.z_mm.cols() - 1) * parts + 1.0;
  if (!(rows * cols <= kMostNodes))
    return fail(kCellOutOfRange,
                fmt::format("cell {} mm asks for {:.0f} x {:.0f} nodes, {:.1f} GB; expected at "
                            "most {:.0f} nodes in all, take a larger cell or verify in bands",
                            cell, rows, cols, rows * cols * 4e-9, kMostNodes));
  GridPlan plan;
  plan.per_spacing = static_cast<std::ptrdiff_t>(parts);
  plan.rows = static_cast<std::ptrdiff_t>(rows);
  plan.cols = static_cast<std::ptrdiff_t>(cols);
  plan.cell_mm = spacing / parts;
  return plan;
}

/// One program's own hash, or that of the list of hashes.
Result<std::string> fingerprint(std::span<const std::filesystem::path> programs) {
  std::string list;
  for (const auto& program : programs) {
    MAQUETTE_TRY(const std::string one, sha256_file(program));
    if (programs.size() == 1) return one;
    list += one + "\n";
  }
  return sha256(list);
}

nlohmann::ordered_json to_array(Vec3 v) {
  return nlohmann::ordered_json::array({v.x, v.y, v.z});
}

}  // namespace

Result<Verification> verify(std::span<const std::filesystem::path> programs,
                            const heightmap::ModelField& design, const VerifyOptions& options,
                            const RunContext& run) {
  MAQUETTE_TRY(const GridPlan plan, plan_grid(design, options));
  const double radius = 0.5 * options.ball_diameter.value();
  const heightmap::HeightRange range = heightmap::height_range(design.z_mm);
  const double highest = static_cast<double>(range.max);
  const double top =
      std::isnan(options.stock_top.value()) ? highest + 1.0 : options.stock_top.value();
  if (!std::isfinite(top))
    return fail(kCellOutOfRange, fmt::format("stock_top is {} mm, expected a height", top));

  Verification result;
  Certificate& c = result.certificate;
  c.ball_diameter_mm = options.ball_diameter.value();
  c.cell_mm = plan.cell_mm;
  std::uintmax_t all_bytes = 0;
  for (const auto& program : programs) {
    std::error_code ec;
    const std::uintmax_t bytes = std::filesystem::file_size(program, ec);
    if (!ec) all_bytes += bytes;
  }
  MillingSim sim(plan.rows, plan.cols, design.x0.value(), design.y0.value(), plan.cell_mm, radius,
                 top);
  std::vector<ToolMove> moves;
  moves.reserve(kMovesPerCut + 1);
  bool any_arc = false;
  double lines_done = 0.0, bytes_done = 0.0;
  const auto cut = [&] {
    sim.cut(moves);
    moves.clear();
  };
  for (const auto& program : programs) {
    const MotionSink sink = [&](std::span<const Motion> motions) -> Result<void> {
      for (const Motion& motion : motions) {
        const bool rapid = motion.kind == Motion::Kind::rapid;
        const double length = length_mm(motion);
        (rapid ? c.rapid_length_mm : c.cutting_length_mm) += length;
        if (!rapid) c.time_min += length / motion.feed_mm_min;
        any_arc = any_arc || motion.kind == Motion::Kind::arc;
        c.travel.add(motion.from_mm);
        for_each_chord(motion, kChordDeviation_mm, [&](Vec3 from, Vec3 to) {
          c.travel.add(to);
          moves.push_back({from, to, rapid});
          if (moves.size() >= kMovesPerCut) cut();
        });
      }
      // About 20 bytes a block: only for the progress bar.
      lines_done += static_cast<double>(motions.size());
      if (all_bytes > 0)
        run.progress(std::fmin(
            0.9, 0.9 * (bytes_done + 20.0 * lines_done) / static_cast<double>(all_bytes)));
      if (run.stopped()) return fail(kCancelled, "verifying was stopped");
      return {};
    };
    MAQUETTE_TRY(const ProgramSummary summary, read_gcode(program, sink, run));
    cut();
    bytes_done += static_cast<double>(summary.bytes);
    lines_done = 0.0;
    c.blocks += summary.blocks;
    c.moves += summary.motions;
    c.time_min += summary.dwell_s / 60.0;
    if (!summary.ended) run.warn(fmt::format("{}: ends without M2, M30 or '%'", program.string()));
    if (summary.tool_changes > 1)
      run.warn(fmt::format("{}: changes the tool {} times; all is cut with one ball of {} mm",
                           program.string(), summary.tool_changes, c.ball_diameter_mm));
    if (summary.skipped_blocks > 0)
      run.warn(fmt::format("{}: {} blocks begin with '/' and were skipped", program.string(),
                           summary.skipped_blocks));
  }
  c.rapid_collisions = sim.rapid_collisions();
  result.as_milled = {sim.take_stock(), Millimetres{plan.cell_mm}, design.x0, design.y0};

  const auto cells = result.as_milled.z_mm.cells();
  const auto untouched = static_cast<float>(top);
  if (std::none_of(cells.begin(), cells.end(), [&](float h) { return h < untouched; })) {
    const std::string where =
        c.travel.empty()
            ? "there are no moves at all"
            : fmt::format("the tip goes from ({:.3f}, {:.3f}, {:.3f}) to ({:.3f}, {:.3f}, {:.3f})",
                          c.travel.min.x, c.travel.min.y, c.travel.min.z, c.travel.max.x,
                          c.travel.max.y, c.travel.max.z);
    return fail(kGcodeNoCut,
                fmt::format("{}: nothing is cut: {} mm, expected it to enter the stock, x {:.3f} "
                            "to {:.3f}, y {:.3f} to {:.3f}, top {:.3f} mm; do program and design "
                            "share one frame?",
                            programs.empty() ? std::string("no program") : programs[0].string(),
                            where, design.x_mm(0), design.x_mm(design.z_mm.cols() - 1),
                            design.y_mm(0), design.y_mm(design.z_mm.rows() - 1), top));
  }

  const double largest =
      std::fmax(std::fmax(std::abs(top), std::abs(c.travel.min.z)),
                std::fmax(std::abs(static_cast<double>(range.min)), std::abs(highest)));
  const MillingSim::Precision precision = sim.precision(largest);
  const CutterError error{precision.horizontal_mm + (any_arc ? kChordDeviation_mm : 0.0),
                          precision.vertical_mm};
  MAQUETTE_TRY_VOID(compare(design, result.as_milled, plan.per_spacing, radius, error, c, run));
  MAQUETTE_TRY(c.program_sha256, fingerprint(programs));
  run.progress(1.0);
  return result;
}

std::string to_json(const Certificate& c) {
  nlohmann::ordered_json worst = nlohmann::ordered_json::array();
  for (const Place& place : c.worst_gouges)
    worst.push_back({{"x_mm", place.x_mm}, {"y_mm", place.y_mm}, {"depth_mm", place.depth_mm}});
  nlohmann::ordered_json travel = nullptr;
  if (!c.travel.empty())
    travel = {{"min_mm", to_array(c.travel.min)}, {"max_mm", to_array(c.travel.max)}};
  const nlohmann::ordered_json json = {{"schema", "maquette.certificate/1"},
                                       {"max_gouge_mm", c.max_gouge_mm},
                                       {"max_excess_mm", c.max_excess_mm},
                                       {"max_excess_anywhere_mm", c.max_excess_anywhere_mm},
                                       {"bound_mm", c.bound_mm},
                                       {"mean_excess_mm", c.mean_excess_mm},
                                       {"rms_excess_mm", c.rms_excess_mm},
                                       {"gouged_area_mm2", c.gouged_area_mm2},
                                       {"worst_gouges", worst},
                                       {"rapid_collisions", c.rapid_collisions},
                                       {"blocks", c.blocks},
                                       {"moves", c.moves},
                                       {"cutting_length_mm", c.cutting_length_mm},
                                       {"rapid_length_mm", c.rapid_length_mm},
                                       {"time_min", c.time_min},
                                       {"travel", travel},
                                       {"ball_diameter_mm", c.ball_diameter_mm},
                                       {"cell_mm", c.cell_mm},
                                       {"program_sha256", c.program_sha256}};
  return json.dump(2) + "\n";
}

}  // namespace maquette::cnc

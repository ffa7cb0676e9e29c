// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file roughing.hpp
/// Block, or what an earlier operation left of it, -> level by level down to an allowance over
/// the design, with a flat, bull-nose or ball cutter.
///
/// Takes   design (ModelField, mm, no voids); stock: a box, or a ModelField whose nodes stand for
///         squares: within half a spacing of a node nothing is higher than it (NaN: no stock)
/// Gives   Toolpath from above the stock to above the stock; what is left, in the same form, for
///         the next operation to take as its stock
///
/// Method. On cells (cell_grid.hpp): the tip's lowest height at which the cutter keeps the
/// allowance, in space, from the design at every point of the cell (level_region.hpp). Levels
/// stand `step_down` apart upwards from where the tip may go lowest, and are cut from the top:
/// rows along x, `stepover` apart, over the free cells where the cutter would take something from
/// the stock as it is then; after them the rim of the region wherever it still would. Cuts that
/// would lower no cell by 0.1 mm are left out. Pieces follow each other by the nearest end. Entry.
/// From the side, or plunging beside the stock, where a piece has an end that stands free; else
/// down a ramp along the piece's own first stretch, to and fro, so that nothing is cut downwards
/// steeper than `ramp_angle`. Links fly at the lowest safe height over the stock of that moment
/// (linking.hpp).
///
/// What holds
/// - Every point of every cut keeps the allowance from the design, in space: a path is a chain of
///   free cells, so there is nothing between samples. (Vertically the allowance is kept too.)
/// - Stock anywhere under the cutter at a free place, d from it, is lowered to the lowest level at
///   which that place is free, plus the cutter's underside at max(d, stepover / 2) + 2 cells,
///   plus 0.1 mm. On flat ground one level lies within step_down of the ground, at its lowest
///   part exactly on it.
/// - The returned stock is nowhere below the true one. Milled again, next to nothing is cut.
/// What does not: it is rounded to cells. Beside a slope up to half a diagonal of a cell, sideways,
/// stays on in addition; a slot less than a cell wider than the cutter is not entered.
///
/// Cost. A cutter location a cell; each level: a few operations a cell. 2 m x 2 m, cells of 1 mm,
/// 20 levels: 40 s of one core's time, 160 MiB. Same bytes for any number of threads.

#include <cmath>

#include "cnc/stock_grid.hpp"
#include "cnc/tool.hpp"
#include "cnc/toolpath.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/units.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::cnc {

inline constexpr ErrorCode kRoughingOptionOutOfRange{"CNC_ROUGHING_OPTION_OUT_OF_RANGE"};

/// A cut that lowers nothing by this much is left out.
inline constexpr double kLeastCut_mm = 0.1;

struct RoughingOptions {
  Cutter cutter = Cutter::bull(6.0, 1.0);
  double allowance_mm = 0.5;  ///< 0 .. 50
  double step_down_mm = 5.0;  ///< between levels
  double stepover_mm = 6.0;   ///< between rows; at most 1.8 radii
  double cell_mm = 1.0;       ///< at most a quarter of the radius
  /// How far beyond the stock's outline the axis may go; NaN: as far as entering from
  /// the side needs. 0 where something stands beside the stock.
  double overhang_mm = NAN;
  double ramp_angle_deg = 3.0;  ///< 0.5 .. 45
  double feed_mm_min = 3000.0, plunge_feed_mm_min = 600.0;
  double clearance_mm = 2.0;  ///< of rapids over the stock
};

struct RoughingReport {
  int levels = 0;                                         ///< on which something was cut
  std::uint64_t pieces = 0, side_entries = 0, ramps = 0;  ///< other pieces follow on at depth
  double cutting_length_mm = 0.0, rapid_length_mm = 0.0;
  double removed_mm3 = 0.0;  ///< of the stock's bound
  double lowest_tip_mm = NAN;
  /// The design stands at most this much above the stock, somewhere; > 0: the block is too low.
  double lacking_mm = 0.0;
};

struct Roughing {
  Toolpath path;
  heightmap::ModelField stock;  ///< left; nodes a cell apart, as squares
  RoughingReport report;
};

/// @pre design has at least 2 x 2 nodes
/// @return CNC_ROUGHING_OPTION_OUT_OF_RANGE with option, value and range (also for an empty box
///         or more than 2^28 cells); CNC_HEIGHT_NOT_FINITE; CORE_CANCELLED.
///         A block that is too low is milled as far as it goes, and warned about.
[[nodiscard]] Result<Roughing> rough(const heightmap::ModelField& design, const StockBox& stock,
                                     const RoughingOptions& options, const RunContext& run = {});
[[nodiscard]] Result<Roughing> rough(const heightmap::ModelField& design,
                                     const heightmap::ModelField& stock,
                                     const RoughingOptions& options, const RunContext& run = {});

}  // namespace maquette::cnc

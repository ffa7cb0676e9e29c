// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file milling_sim.hpp
/// Stock as a height per cell centre; cutters swept along lines and arcs take the minimum
/// of stock and their own underside.
///
/// Method  the underside of a cutter on its way has a closed form (swept_cutter.hpp), so
///         nothing is sampled along the move. Tiles of 128 x 128 cells, each cut by one
///         task in program order; blocks of 8 x 8 cells whose stock lies below a bound of
///         the underside are skipped, which changes no result.
/// Result  bit-identical for any number of threads, and for any window of a larger grid, since
///         all arithmetic belongs to a block and blocks stand on the whole grid. The order
///         of moves matters only for what counts as a collision and for who removed what.
/// Cost    grid: 4 bytes a cell; batch: about 150 bytes a move. See
/// docs/derivations/verify_bound.md

#include <cstdint>
#include <limits>
#include <span>
#include <vector>

#include "cnc/path_pieces.hpp"
#include "cnc/tool.hpp"
#include "core/grid.hpp"
#include "core/vec.hpp"

namespace maquette::cnc {

/// A rapid counts as a collision if it lowers a cell by more than this, a holder if it stands
/// deeper in a cell. Above the rounding of a height (0.03 um below 256 mm), below anything a
/// person would mill. By as much a rapid's cutter is thinner than its own: a cell that stands
/// exactly on the wall of the last cut is inside or outside by rounding alone, and its whole height
/// would count.
inline constexpr double kCollisionDepth_mm = 0.001;

/// What one motion does to the stock. Holders count as cylinders and cones at the lower end of
/// steps of kHolderStep_mm of the tip's height, so they may be found touching that much too early.
inline constexpr double kHolderStep_mm = 0.1;
struct MoveEffects {
  explicit MoveEffects(std::size_t motions) : removed(motions, 0), touched(motions, 0) {}
  static constexpr std::uint8_t kRapid = 1, kHolder = 2;  ///< bits of touched
  /// Removed height, summed over cells; times the area of a cell it is a volume.
  static constexpr double kUnit_mm = 0x1p-20;
  std::vector<std::int64_t> removed;  ///< in kUnit_mm
  std::vector<std::uint8_t> touched;
};

/// Balls may go along any piece; other cutters along lines and level arcs.
struct ToolMove {
  PathPiece piece{};
  bool rapid = false;
  std::uint16_t cutter = 0;
  std::uint32_t motion = 0;  ///< index into MoveEffects; a motion may have many moves
};

/// Cell centres of the whole grid at x0 + c cell, y0 + r cell. The stock is the window of
/// `rows` x `cols` cells from (first_row, first_col), which are multiples of 8.
struct SimGrid {
  double x0_mm = 0.0, y0_mm = 0.0, cell_mm = 0.1;
  std::ptrdiff_t first_row = 0, first_col = 0;
  /// Where windows overlap, one of them counts what was removed: blocks of 8 rows that begin in
  /// [counted_from_row, counted_to_row) of the whole grid.
  std::ptrdiff_t counted_from_row = 0, counted_to_row = std::numeric_limits<std::ptrdiff_t>::max();
};

class MillingSim {
 public:
  /// @pre stock is not empty, its heights finite; cell and radii > 0; at least one cutter
  MillingSim(const SimGrid& grid, std::vector<Cutter> cutters, Grid<float> stock_mm);

  /// Cuts in order. Any number of moves; some hundred thousand at a time is best.
  void cut(std::span<const ToolMove> moves, MoveEffects& effects);

  [[nodiscard]] const Grid<float>& stock_mm() const { return stock_; }
  [[nodiscard]] Grid<float> take_stock() { return std::move(stock_); }

  /// What single precision may have done to a height: it is exact for a cutter displaced by
  /// at most `horizontal` sideways, give or take `vertical`.
  struct Precision {
    double horizontal_mm, vertical_mm;
  };
  [[nodiscard]] static Precision precision(double largest_height_mm, double cutter_radius_mm,
                                           double cell_mm);

 private:
  void bin(std::span<const ToolMove> moves);
  template <class Visit>
  void for_each_tile(const ToolMove& move, Visit&& visit) const;

  SimGrid grid_;
  std::vector<Cutter> cutters_, thinner_;  ///< the latter for rapids
  Grid<float> stock_;
  double top_mm_;
  std::ptrdiff_t tile_rows_, tile_cols_;
  std::vector<std::uint64_t> start_;  ///< per tile: first of its moves in order_
  std::vector<std::uint32_t> order_;  ///< moves of all tiles, in program order per tile
};

}  // namespace maquette::cnc

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file milling_sim.hpp
/// Stock as a height per cell centre; a ball-nose cutter swept along lines takes the
/// minimum of stock and its own underside.
///
/// Method  a ball swept along a line is a capsule; its underside at lateral distance d
///         and along-distance s has a closed form (below), so nothing is sampled
///         along the move. Tiles of 128 x 128 cells, each cut by one task in program
///         order; blocks of 8 x 8 cells whose stock lies below a supporting plane of the
///         capsule are skipped, which changes no result.
/// Result  bit-identical for any number of threads; the order of moves matters only for
///         what counts as a collision
/// Cost    grid: 4 bytes a cell; batch: about 70 bytes a move. See docs/derivations/verify_bound.md
///
/// Underside: tip from A over horizontal length L with rise m per mm, k = m / sqrt(1 + m^2),
/// rho^2 = R^2 - d^2, t = clamp(s - k rho, 0, L):
///     z(s, d) = A.z + m t + R - sqrt(rho^2 - (s - t)^2)      where the root is real
/// The clamped t is the exact minimum because the sum is convex in t.

#include <cstdint>
#include <span>
#include <vector>

#include "core/grid.hpp"
#include "core/vec.hpp"

namespace maquette::cnc {

/// A rapid counts as a collision if it lowers a cell by more than this. Above the
/// rounding of a height (0.03 um below 256 mm), below anything a person would mill.
inline constexpr double kCollisionDepth_mm = 0.001;

struct ToolMove {
  Vec3 from_mm, to_mm;  ///< of the tip
  bool rapid = false;
};

class MillingSim {
 public:
  /// Cell centres at x0 + c cell, y0 + r cell; the stock's top is flat.
  /// @pre rows, cols >= 1; cell, radius > 0
  MillingSim(std::ptrdiff_t rows, std::ptrdiff_t cols, double x0_mm, double y0_mm, double cell_mm,
             double ball_radius_mm, double stock_top_mm);

  /// Cuts in order. Any number of moves; some hundred thousand at a time is best.
  void cut(std::span<const ToolMove> moves);

  /// Rapids so far that touched material at a cell centre.
  [[nodiscard]] std::uint64_t rapid_collisions() const { return rapid_collisions_; }
  [[nodiscard]] const Grid<float>& stock_mm() const { return stock_; }
  [[nodiscard]] Grid<float> take_stock() { return std::move(stock_); }

  /// What single precision may have done to a height: it is exact for a ball displaced by
  /// at most `horizontal` sideways, give or take `vertical`.
  struct Precision {
    double horizontal_mm, vertical_mm;
  };
  [[nodiscard]] Precision precision(double largest_height_mm) const;

 private:
  void bin(std::span<const ToolMove> moves);
  template <class Visit>
  void for_each_tile(const ToolMove& move, Visit&& visit) const;

  Grid<float> stock_;
  double x0_mm_, y0_mm_, cell_mm_, radius_mm_, top_mm_;
  std::ptrdiff_t tile_rows_, tile_cols_;
  std::uint64_t rapid_collisions_ = 0;
  std::vector<std::uint64_t> start_;    ///< per tile: first of its moves in order_
  std::vector<std::uint32_t> order_;    ///< moves of all tiles, in program order per tile
  std::vector<std::uint8_t> collided_;  ///< per move of the batch
};

}  // namespace maquette::cnc

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file path_figures.hpp
/// What a path amounts to: lengths, moves, extent, and how fast its moves follow each other.

#include <cmath>
#include <cstdint>
#include <limits>

#include "cnc/toolpath.hpp"

namespace maquette::cnc {

struct PathFigures {
  std::uint64_t lines = 0, arcs = 0, rapids = 0;
  double cutting_length_mm = 0.0, rapid_length_mm = 0.0;
  double cutting_time_min = 0.0;  ///< length over feed
  double shortest_cut_mm = INFINITY;
  /// Cutting moves a second at the programmed feed, over the worst 32 in a row of one piece
  /// (fewer if the piece has fewer).
  double highest_rate_per_s = 0.0;
  /// Of the tip on all moves, arcs' bulges included; z of the cuts alone besides.
  ToolPosition low{kMost, kMost, kMost}, high{-kMost, -kMost, -kMost};
  std::int64_t lowest_cut = kMost, highest_cut = -kMost;

  void add(const PathFigures& piece);

  static constexpr std::int64_t kMost = std::numeric_limits<std::int64_t>::max();
};

/// @pre start and all ends known
[[nodiscard]] PathFigures figures_of(const Toolpath& path);

}  // namespace maquette::cnc

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file path_figures.hpp
/// What a path amounts to: lengths, moves, extent, and how fast its moves follow each other; and
/// whether a machine can travel as far.

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>

#include "cnc/toolpath.hpp"
#include "core/vec.hpp"

namespace maquette::cnc {

struct PathFigures {
  std::uint64_t lines = 0, arcs = 0, rapids = 0;
  double cutting_length_mm = 0.0, rapid_length_mm = 0.0;
  double cutting_time_min = 0.0;  ///< length over feed
  double shortest_cut_mm = INFINITY;
  /// Cutting moves a second at the programmed feed, over the worst kWindow in a row; 0 for fewer.
  double highest_rate_per_s = 0.0;
  /// Of the tip on all moves, arcs' bulges included; z of the cuts alone besides.
  ToolPosition low{kMost, kMost, kMost}, high{-kMost, -kMost, -kMost};
  std::int64_t lowest_cut = kMost, highest_cut = -kMost;

  /// The next piece of the path. @pre start and all ends known
  void add(const Toolpath& piece);
  /// Of the tip on all moves; empty if nothing moves.
  [[nodiscard]] Box3 extent_mm() const;

  static constexpr std::int64_t kMost = std::numeric_limits<std::int64_t>::max();
  static constexpr std::size_t kWindow = 32;

 private:
  std::array<double, kWindow> seconds_{};  // of the last cuts
  double in_window_ = 0.0;
};

}  // namespace maquette::cnc

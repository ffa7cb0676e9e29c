// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file pocket_ceilings.hpp
/// Ceilings of a hollow solid's pockets (hollow.hpp): as high as the wall above them allows.

#include <optional>
#include <vector>

#include "core/grid.hpp"
#include "core/run_context.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::meshing::detail {

/// Lines of the ceilings' grid along one axis: pockets one after the other, ribs between.
struct Lines {
  std::vector<double> mm{};
  int pockets = 0;
  /// Of each pocket: lines k (steps + 1) to k (steps + 1) + steps are pocket k's.
  std::ptrdiff_t steps = 0;
  double pocket_mm = 0.0;
  [[nodiscard]] std::ptrdiff_t count() const { return static_cast<std::ptrdiff_t>(mm.size()); }
  /// Between line i and the next one: a pocket, or a rib.
  [[nodiscard]] bool in_pocket(std::ptrdiff_t i) const { return i % (steps + 1) != steps; }
  [[nodiscard]] bool first_of_pocket(std::ptrdiff_t i) const { return i % (steps + 1) == 0; }
  [[nodiscard]] bool border(std::ptrdiff_t i) const { return first_of_pocket(i) || !in_pocket(i); }
};

struct PocketLines {
  Lines x, y;
  /// Whether the cell that starts at line j of y and line i of x is a pocket's.
  [[nodiscard]] bool is_pocket(std::ptrdiff_t j, std::ptrdiff_t i) const {
    return i + 1 < x.count() && j + 1 < y.count() && x.in_pocket(i) && y.in_pocket(j);
  }
};

struct Ceilings {
  Grid<double> z_mm;  ///< at line j of y, line i of x
  double lowest_mm = 0.0, highest_mm = 0.0;
  double least_height_mm = 0.0;  ///< of the surface above them, upright
  double mean_excess_mm = 0.0, most_excess_mm = 0.0;
  double volume_mm3 = 0.0;  ///< of the pockets down to the base
};

/// Method and accuracy: hollow.hpp. Empty where it was stopped.
[[nodiscard]] std::optional<Ceilings> fit_ceilings(const heightmap::ModelField& surface,
                                                   const heightmap::ModelField& roof,
                                                   const PocketLines& lines, double wall_mm,
                                                   double base_mm, const RunContext& run);

}  // namespace maquette::meshing::detail

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file craters.hpp
/// Small craters, made up: nobody saw them. Sizes follow crater_production.hpp, places and states
/// are drawn.
///
/// Drawing. Diameters are divided into classes of half an octave, the plane of the site into square
/// cells 16 diameters wide for each class. A cell of a class has a Poisson number of craters; all
/// that is drawn in it depends on seed, class and cell alone. So a crater is the same on any grid,
/// in any part of the site, for any number of threads.
///
/// Shape. A bowl, z = h - d (1 - x^2) for x = r / R below 1; beyond the rim h x^-3 (McGetchin et
/// al. 1973, doi:10.1016/0012-821X(73)90162-3), brought to zero at x = 3. Fresh: d = 0.2 D (Pike
/// 1977, Impact and Explosion Cratering, p. 489). h = 0.241 d, 0.048 D, is what lets ejecta and rim
/// hold just what is dug out (Pike has 0.036 D): so a crater has no mean, and hardly any of the
/// waves that a source with pixels as wide as it shows. Craters fade as the ground creeps (Fassett
/// and Thomson 2014, doi:10.1002/2014JE004698): d falls to 0.03 D, evenly in its logarithm over the
/// life of a crater; on ground too young for equilibrium they have only begun to. Where they
/// overlap they add.
///
/// A node has the mean over its cell.

#include <cstdint>
#include <vector>

#include "core/grid.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "heightmap/body.hpp"
#include "heightmap/detail/node_map.hpp"

namespace maquette::heightmap::detail {

struct Crater {
  double x_m = 0.0, y_m = 0.0;  ///< in the site frame
  double diameter_m = 0.0;
  double depth_m = 0.0;  ///< from the rim
};

struct CraterField {
  Body body;
  double age_gyr = 0.0;
  double smallest_m = 0.0, largest_m = 0.0;  ///< diameters
  std::uint64_t seed = 1;
};

/// Craters that reach into a rectangle of the site, largest classes first, always in one order.
[[nodiscard]] std::vector<Crater> draw_craters(const CraterField& field, double x0_m, double y0_m,
                                               double x1_m, double y1_m);

/// Height of a crater above the ground as it was, at a distance from its middle.
[[nodiscard]] double crater_height_m(const Crater& crater, double distance_m);

/// Expected variance of the heights of a field without those too small for a node, m^2.
[[nodiscard]] double crater_variance_m2(const CraterField& field);

/// Adds all craters of a field to heights. Same bytes for any number of threads, and for any part
/// of the nodes.
/// @return how many reach into the grid, or CORE_CANCELLED
[[nodiscard]] Result<std::size_t> add_craters(Grid<float>& z, const NodeGrid& nodes,
                                              const CraterField& field, const RunContext& run);

}  // namespace maquette::heightmap::detail

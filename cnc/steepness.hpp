// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file steepness.hpp
/// How steep a contact the ball can have while it moves along a short line: the fact
/// from which the path between two samples is bounded (pass_sampler.hpp).
///
/// Method. The field in tiles, each with its greatest height and its steepest facet. A
/// contact in a tile happens at depth w below the ball's centre, and
///   w >= R / sqrt(1 + T^2)        T: steepest facet, since a contact normal lies in the
///                                 convex hull of the normals of the facets that meet there
///   w >= R - (highest - tip)      the ball does not reach up to the tile otherwise
/// A tile that cannot be touched at all (w^2 + distance^2 > R^2) does not count.
/// Derivation: docs/derivations/path_between_samples.md

#include <cstddef>
#include <vector>

#include "cnc/tool.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::cnc {

struct ContactBound {
  double least_depth_mm = 0.0;  ///< every contact is at least this far below the centre; > 0
  double highest_mm = 0.0;      ///< of all surface within reach
};

/// Immutable, shared between threads. 8 bytes a tile; tiles are about R / 2 wide.
class SteepnessTiles {
 public:
  /// @pre as for DropCutter
  SteepnessTiles(const heightmap::ModelField& field, BallNose tool);

  /// For the axis anywhere in the rectangle. Outside the outline by o the ball may touch the edge
  /// across its direction: no contact is less deep than sqrt(1 - (o / R)^2) of what facets say.
  /// @param lowest_tip_mm  the tip is nowhere lower on the true cutter location; may be -inf
  [[nodiscard]] ContactBound bound(double x_min, double x_max, double y_min, double y_max,
                                   double lowest_tip_mm) const;

 private:
  struct Tile {
    float highest, least_depth;
  };
  double R_, side_mm_, x0_, y0_, x1_, y1_;
  std::ptrdiff_t rows_, cols_;
  std::vector<Tile> tiles_;
};

}  // namespace maquette::cnc

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file photo_relief.hpp
/// The design as light meets it: a square field of heights over [0, side] x [0, side], mm, of which
/// every cell is a bilinear patch, two planes, or a bilinear patch with normals that turn smoothly.
/// A ray's height over a patch is a polynomial of second degree along the ray: its first root is
/// the place, nothing is stepped over. Tiles of 4 x 4 cells that the ray passes above are left out.
/// The block's sides take all light: what comes in through them below the surface is black.

#include <vector>

#include "challenge/challenge_world.hpp"

namespace challenge {

class Relief {
 public:
  enum class Between {
    bilinear,   ///< height u v-wise linear, normals of that patch
    triangles,  ///< two planes, cut from the lower left to the upper right node
    smooth      ///< heights as bilinear; slopes by central differences at nodes, linear between
  };
  Relief(Field nodes, Between between);

  /// Where a ray meets the surface: from + t along, t in the unit of `along`; -1 if it does not
  /// within (0, longest].
  [[nodiscard]] double meet(Vec3 from, Vec3 along, double longest = 1e12) const;
  /// Nothing lies between a place just above the surface and a lamp.
  [[nodiscard]] bool sees(Vec3 place, Vec3 lamp) const {
    return meet(place, lamp - place, 1.0) < 0;
  }

  [[nodiscard]] double height(double x, double y) const;
  [[nodiscard]] Vec3 normal(double x, double y) const;  ///< upwards, unit
  [[nodiscard]] double side() const { return nodes_.step * (nodes_.n - 1); }
  [[nodiscard]] const Field& nodes() const { return nodes_; }

 private:
  struct Ray;
  double in_tile(const Ray& ray, int tile_c, int tile_r, double ta, double tb) const;
  double in_cell(const Ray& ray, int c, int r, double ta, double tb) const;

  Field nodes_, slope_x_, slope_y_;
  Between between_;
  int tiles_ = 0;
  double top_ = 0;
  std::vector<double> tile_top_;
};

}  // namespace challenge

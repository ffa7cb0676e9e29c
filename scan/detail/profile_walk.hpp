// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file profile_walk.hpp
/// Where rays of one vertical plane from one place meet the terrain.
///
/// Method    Of two such rays the steeper is below the other all the way, so the other cannot meet
///           the terrain before it does: rays in order of rising height go on where the one before
///           has ended, and all of them together walk along the plane's profile once. That is
///           a broken line with corners on the grid's lines and on the diagonals of its cells.
/// Accuracy  That of FieldTracer, to rounding: 1e-12 of the largest coordinate, divided by the sine
///           of the angle between ray and profile.
/// Cost      Some 10 ns a cell of the profile and 10 ns a ray.

#include <cstddef>
#include <optional>

#include "heightmap/field_tracer.hpp"

namespace maquette::scan::detail {

/// Keeps a reference to the field, which has no voids.
class ProfileWalk {
 public:
  /// @param horizontal  unit, z = 0
  /// @pre the origin is not under the terrain
  ProfileWalk(const heightmap::ModelField& field, Vec3 origin_mm, Vec3 horizontal);
  /// Where a ray meets the terrain from above; nothing beyond a wall of the part.
  /// @param across, up  of the ray's unit direction: along `horizontal` and z; across > 0
  /// @pre no ray before was higher
  [[nodiscard]] std::optional<heightmap::FieldHit> hit(double across, double up);

 private:
  void enter_cell();
  bool advance();

  const heightmap::ModelField& field_;
  Vec3 origin_, horizontal_;
  double u_ = 0.0, v_ = 0.0;        // of the origin, cells
  double du_ = 0.0, dv_ = 0.0;      // cells a mm
  double to_u_ = 0.0, to_v_ = 0.0;  // mm a cell
  std::ptrdiff_t row_ = 0, col_ = 0;
  bool over_ = true;   // beyond the terrain, or beside it all the way
  bool first_ = true;  // in the first piece of the profile
  /// A piece of the profile: horizontal distances and heights of its ends, and its triangle.
  struct Piece {
    double from = 0.0, from_z = 0.0, to = 0.0, to_z = 0.0;
    bool lower_right = false;
  };
  Piece piece_, second_;
  bool has_second_ = false;
  double leave_ = 0.0;            // the terrain, mm
  bool leave_by_column_ = false;  // the present cell
};

}  // namespace maquette::scan::detail

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file coordinate_rounding.hpp
/// What file formats do to coordinates.

namespace maquette::meshing {

enum class CoordinateRounding {
  none,     ///< float64: PLY as write_ply writes it
  float32,  ///< STL
  micro,    ///< decimal, to 1e-6 mm: OBJ
  /// 3MF as lib3mf 1.8 writes it: float32, times 1e6 in float32 again, cut to a whole number of
  /// 1e-6 mm. At 2 m that is up to 1.25e-4 mm, near the origin up to 1e-6.
  lib3mf,
};
/// Never falls where the coordinate rises.
[[nodiscard]] double rounded(double coordinate_mm, CoordinateRounding rounding);

}  // namespace maquette::meshing

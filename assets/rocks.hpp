// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file rocks.hpp
/// Rock shapes and sizes.

#include <cstdint>
#include <span>
#include <vector>

#include "core/tri_mesh.hpp"
#include "core/units.hpp"

namespace maquette::assets {

/// Extents are those of the finished mesh along its own axes: x long, y short, z up.
struct RockShape {
  double angularity = 0.6;   ///< 0 ellipsoid .. 1 convex body of plane facets with sharp edges
  double flatness = 0.75;    ///< z extent over equivalent horizontal diameter, 0.3 .. 1
  double elongation = 0.85;  ///< y extent over x extent, 0.4 .. 1
  double roughness = 0.03;   ///< largest radial displacement over mean diameter, 0 .. 0.1
  std::uint64_t seed = 1;
  int subdivisions = 4;  ///< 20 * 4^n triangles, 0 .. 7

  friend bool operator==(const RockShape&, const RockShape&) = default;
};

/// A closed, outward oriented mesh, star-shaped around the origin, of equivalent
/// horizontal diameter 1 (scale it to millimetres): the convex hull of its vertices
/// seen from above has the area pi/4. Same shape, same bytes.
///
/// Method. The directions are those of a subdivided icosahedron. The radius is that of
/// a convex polyhedron of random half-spaces, blended with a sphere by 1 - angularity
/// and displaced by five octaves of gradient noise (Perlin 2002,
/// doi:10.1145/566654.566636); then the axes are stretched so that flatness, elongation
/// and diameter hold to rounding. One half-space is horizontal: an angular rock has a
/// flat base. Edges of the polyhedron are cut off by the triangles' size.
/// @pre all members within their ranges
[[nodiscard]] TriMesh make_rock(const RockShape& shape);

/// Of the circle that has the area of the convex hull seen from above (along z); 0 for fewer than
/// three points. The unit is that of the vertices.
[[nodiscard]] double equivalent_diameter(std::span<const Vec3> vertices);

/// `count` diameters, descending, drawn from the exponential size-frequency law of
/// Golombek and Rapp 1997 (doi:10.1029/96JE03319):
/// cumulative area fraction F(D) = k exp(-q(k) D), q(k) = 1.79 + 0.152 / k,
/// conditioned on min <= D <= max. F counts area, so the density of the number of
/// rocks is n(D) = k q exp(-q D) / (pi D^2 / 4); its distribution function is
/// tabulated by Gauss-Legendre quadrature and inverted to about 1e-12 of D.
/// @param k  total area fraction covered by rocks, 0.005 .. 0.5
/// @pre 0 < min < max, count >= 0
[[nodiscard]] std::vector<Metres> draw_rock_diameters(int count, double k, Metres min, Metres max,
                                                      std::uint64_t seed);

/// How many rocks of min <= D <= max lie on a square metre by the same law: the integral of n(D).
/// @pre as draw_rock_diameters
[[nodiscard]] double rocks_per_square_metre(double k, Metres min, Metres max);

}  // namespace maquette::assets

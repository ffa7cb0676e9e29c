// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file solid_mass.hpp
/// Volume and centre of mass of a closed mesh, of one density.

#include "core/tri_mesh.hpp"

namespace maquette::meshing::detail {

struct SolidMass {
  double volume = 0.0;
  Vec3 centre{};
};

/// Of the solid: tetrahedra between its triangles and the middle of its box, so that a body far
/// from the origin loses no digits.
/// @pre closed, outward oriented
[[nodiscard]] inline SolidMass solid_mass(const TriMesh& mesh) {
  const Box3 box = mesh.bounds();
  const Vec3 middle = 0.5 * (box.min + box.max);
  SolidMass mass;
  Vec3 moment{};
  for (const auto& [i, j, k] : mesh.triangles) {
    const Vec3 a = mesh.vertices_mm[i] - middle, b = mesh.vertices_mm[j] - middle,
               c = mesh.vertices_mm[k] - middle;
    const double six = dot(a, cross(b, c));
    mass.volume += six / 6.0;
    moment += six / 24.0 * (a + b + c);
  }
  mass.centre = middle + (1.0 / mass.volume) * moment;
  return mass;
}

}  // namespace maquette::meshing::detail

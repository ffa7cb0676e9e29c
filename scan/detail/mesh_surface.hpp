// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file mesh_surface.hpp
/// A triangle mesh as what registration brings points to.

#include <vector>

#include "scan/detail/normal_equations.hpp"
#include "scan/mesh_distance.hpp"

namespace maquette::scan::detail {

/// The plane of the triangle whose point is nearest. Beyond an edge, where the plane says less than
/// the edge, the direction to the edge; beyond the mesh's border nothing.
class MeshSurface : public Surface {
 public:
  MeshSurface(const MeshDistance& mesh, double reach_mm) : mesh_(&mesh), reach_(reach_mm) {}
  void feet(std::span<const Vec3> points_mm, std::span<Foot> feet) const override;

 private:
  const MeshDistance* mesh_;
  double reach_;
};

/// The same distances with normals that go evenly over from vertex to vertex: the facets of a
/// cylinder would tell where it is turned to, the shape does not.
class SmoothMeshSurface : public Surface {
 public:
  SmoothMeshSurface(const MeshDistance& mesh, double reach_mm);
  void feet(std::span<const Vec3> points_mm, std::span<Foot> feet) const override;
  /// Angle between a triangle and the smooth surface at its corners, the median: the smooth
  /// normals themselves are true to some square of it.
  [[nodiscard]] double facet_angle_rad() const;

 private:
  const MeshDistance* mesh_;
  double reach_;
  std::vector<Vec3> normals_;  // of the vertices, weighted by area
};

}  // namespace maquette::scan::detail

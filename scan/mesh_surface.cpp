// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/mesh_surface.hpp"

#include <cmath>

#include "core/median.hpp"

namespace maquette::scan::detail {
namespace {

Foot foot_of(const MeshDistance::Nearest& n, Vec3 p) {
  const Vec3 off = p - n.foot_mm;
  const Foot foot{dot(off, n.normal), n.normal, 1.0};
  if (std::abs(n.distance_mm) > std::abs(foot.e_mm) + 1e-9)
    return {n.distance_mm, (1.0 / n.distance_mm) * off, 1.0};
  return foot;
}

}  // namespace

void MeshSurface::feet(std::span<const Vec3> points, std::span<Foot> feet) const {
  std::uint32_t hint = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    feet[i] = {};
    const auto n = mesh_->nearest(points[i], reach_, hint);
    if (!n) continue;
    hint = n->triangle;
    if (!n->border) feet[i] = foot_of(*n, points[i]);
  }
}

SmoothMeshSurface::SmoothMeshSurface(const MeshDistance& mesh, double reach_mm)
    : mesh_(&mesh), reach_(reach_mm), normals_(mesh.mesh().vertices_mm.size()) {
  const auto& v = mesh.mesh().vertices_mm;
  for (const auto& t : mesh.mesh().triangles) {
    const Vec3 twice_area = cross(v[t[1]] - v[t[0]], v[t[2]] - v[t[0]]);
    for (const std::uint32_t corner : t) normals_[corner] += twice_area;
  }
}

double SmoothMeshSurface::facet_angle_rad() const {
  const auto& v = mesh_->mesh().vertices_mm;
  const auto& triangles = mesh_->mesh().triangles;
  std::vector<double> angles;
  for (std::size_t i = 0; i < triangles.size(); i += 1 + triangles.size() / 20'000) {
    const auto& t = triangles[i];
    const Vec3 n = cross(v[t[1]] - v[t[0]], v[t[2]] - v[t[0]]);
    for (const std::uint32_t corner : t)
      angles.push_back(std::atan2(norm(cross(n, normals_[corner])), dot(n, normals_[corner])));
  }
  return median(std::move(angles), 0.0);
}

void SmoothMeshSurface::feet(std::span<const Vec3> points, std::span<Foot> feet) const {
  const auto& v = mesh_->mesh().vertices_mm;
  std::uint32_t hint = 0;
  for (std::size_t i = 0; i < points.size(); ++i) {
    feet[i] = {};
    const auto n = mesh_->nearest(points[i], reach_, hint);
    if (!n) continue;
    hint = n->triangle;
    if (n->border) continue;
    feet[i] = foot_of(*n, points[i]);
    const auto& t = mesh_->mesh().triangles[n->triangle];
    // Each corner by the area opposite to it.
    Vec3 sum;
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3 a = v[t[(k + 1) % 3]], b = v[t[(k + 2) % 3]];
      const double length = norm(normals_[t[k]]);
      if (length > 0.0)
        sum += (norm(cross(a - n->foot_mm, b - n->foot_mm)) / length) * normals_[t[k]];
    }
    if (norm(sum) > 0.0) feet[i].normal = normalized(sum);
  }
}

}  // namespace maquette::scan::detail

// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/overhangs.hpp"

#include <algorithm>
#include <cmath>

#include <oneapi/tbb/parallel_for.h>

#include "scan/mesh_distance.hpp"
#include "scan/surface_distance.hpp"

namespace maquette::scan {
namespace {

constexpr double kOnPart = 3.0, kWrong = 0.25;  // standard deviations

/// A stone with its tree, and where it can matter.
struct Stone {
  MeshDistance to;
  Box3 box;
  double reach_mm;
  Stone(const TriMesh& mesh, double margin_mm) : to(mesh), box(mesh.bounds()) {
    const Vec3 margin{margin_mm, margin_mm, margin_mm};
    box.min = box.min - margin;
    box.max = box.max + margin;
    reach_mm = norm(box.max - box.min);  // whatever is in the box has its nearest triangle
  }
  [[nodiscard]] bool near(Vec3 p) const {
    return p.x > box.min.x && p.x < box.max.x && p.y > box.min.y && p.y < box.max.y &&
           p.z < box.max.z;
  }
};

}  // namespace

std::vector<std::uint8_t> beyond_heights(std::span<const Vec3> points,
                                         const heightmap::ModelField& envelope,
                                         const heightmap::ModelField& ground,
                                         std::span<const TriMesh> meshes, double coat_mm,
                                         double noise_mm) {
  std::vector<std::uint8_t> beyond(points.size(), 0);
  const double on_part = kOnPart * noise_mm;
  std::vector<Stone> stones;
  stones.reserve(meshes.size());
  for (const TriMesh& mesh : meshes)
    if (!mesh.triangles.empty()) stones.emplace_back(mesh, on_part + coat_mm);
  oneapi::tbb::parallel_for(std::size_t{0}, points.size(), [&](std::size_t i) {
    const Vec3 p = points[i];
    // Distance to what is joined: the least, exact outside.
    double to_part = INFINITY;
    for (const Stone& stone : stones)
      if (stone.near(p))
        if (const auto nearest =
                stone.to.nearest(p, stone.reach_mm + std::abs(p.z - stone.box.min.z)))
          to_part = std::fmin(to_part, nearest->distance_mm - coat_mm);
    if (to_part == INFINITY) return;
    const double to_ground = signed_distance_mm(ground, p, on_part);
    if (!std::isnan(to_ground))
      to_part = std::fmin(to_part, to_ground);
    else if (!(p.z > heightmap::height_at(ground, p.x, p.y)))
      return;  // deep in the ground
    if (!(std::abs(to_part) < on_part)) return;
    const double reach =
        on_part + norm(p - Vec3{p.x, p.y, heightmap::height_at(envelope, p.x, p.y)});
    const double to_envelope = signed_distance_mm(envelope, p, reach);
    if (std::abs(to_envelope - to_part) > kWrong * noise_mm) beyond[i] = 1;
  });
  return beyond;
}

}  // namespace maquette::scan

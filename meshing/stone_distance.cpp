// SPDX-License-Identifier: GPL-3.0-or-later
#include <CGAL/AABB_traits.h>
#include <CGAL/AABB_tree.h>
#include <CGAL/AABB_triangle_primitive.h>
#include <CGAL/Simple_cartesian.h>

#include "meshing/detail/stone_cap.hpp"

namespace maquette::meshing::detail {
namespace {

using Kernel = CGAL::Simple_cartesian<double>;
using Triangles = std::vector<Kernel::Triangle_3>;
using Primitive = CGAL::AABB_triangle_primitive<Kernel, Triangles::const_iterator>;
using Tree = CGAL::AABB_tree<CGAL::AABB_traits<Kernel, Primitive>>;

}  // namespace

struct StoneDistance::Trees {
  std::vector<Triangles> triangles;
  std::vector<std::unique_ptr<Tree>> trees;
};

StoneDistance::StoneDistance(std::span<const TriMesh* const> stones)
    : trees_(std::make_unique<Trees>()) {
  trees_->triangles.resize(stones.size());
  for (std::size_t i = 0; i < stones.size(); ++i) {
    const auto corner = [&](std::uint32_t v) {
      const Vec3 p = stones[i]->vertices_mm[v];
      return Kernel::Point_3(p.x, p.y, p.z);
    };
    for (const auto& t : stones[i]->triangles) {
      const Kernel::Triangle_3 triangle(corner(t[0]), corner(t[1]), corner(t[2]));
      if (!triangle.is_degenerate()) trees_->triangles[i].push_back(triangle);
    }
    trees_->trees.push_back(
        std::make_unique<Tree>(trees_->triangles[i].begin(), trees_->triangles[i].end()));
    trees_->trees.back()->accelerate_distance_queries();
  }
}

StoneDistance::~StoneDistance() = default;

StoneDistance::Nearest StoneDistance::nearest(Vec3 p_mm) const {
  const Kernel::Point_3 p(p_mm.x, p_mm.y, p_mm.z);
  Nearest best;
  for (const auto& tree : trees_->trees) {
    if (tree->empty()) continue;
    const Kernel::Point_3 q = tree->closest_point(p);
    const double d = std::sqrt(CGAL::squared_distance(p, q));
    if (d < best.distance_mm) {
      best.second_distance_mm = best.distance_mm;
      best.distance_mm = d;
      best.point_mm = {q.x(), q.y(), q.z()};
    } else {
      best.second_distance_mm = std::fmin(best.second_distance_mm, d);
    }
  }
  return best;
}

}  // namespace maquette::meshing::detail

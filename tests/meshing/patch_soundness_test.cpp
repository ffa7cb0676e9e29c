// SPDX-License-Identifier: GPL-3.0-or-later
// What meshing/detail/patch_soundness.hpp claims, and how each claim is attacked:
//
//   sound goals are reached ........ a lifted sheet, compared with ==
//   nothing cuts, turns, collapses . a lower sheet pushed through an upper one; a vertex
//                                    pushed across its triangles; two made one
//   what cannot be mended is told .. sheets that cut each other before any move
//   pockets go, the sheet stays .... a ball under the sheet; a hole; a third triangle
//                                    at an edge; two cones that share their tip

#include "meshing/detail/patch_soundness.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "meshing/mesh_checks.hpp"
#include "support/shapes.hpp"

namespace maquette::meshing::detail {
namespace {

using heightmap::ModelField;
using testing_support::unit_sphere;

ModelField level(std::ptrdiff_t n) {
  return {Grid<float>(n, n, 0.0F), Millimetres{1}, Millimetres{0}, Millimetres{0}};
}

/// The whole field as a patch, n x n nodes.
Patch sheet(std::uint32_t n, double z = 0.0) {
  Patch p;
  p.block = {0, n - 1, 0, n - 1};
  for (std::uint32_t r = 0; r < n; ++r)
    for (std::uint32_t c = 0; c < n; ++c) {
      p.node.push_back(r * n + c);
      p.mesh.vertices_mm.push_back({static_cast<double>(c), static_cast<double>(r), z});
      if (r + 1 == n || c + 1 == n) continue;
      const std::uint32_t v = r * n + c;
      p.mesh.triangles.push_back({v, v + 1, v + n + 1});
      p.mesh.triangles.push_back({v, v + n + 1, v + n});
    }
  return p;
}

void add(Patch& patch, const TriMesh& part) {
  append(patch.mesh, part);
  patch.node.resize(patch.mesh.vertices_mm.size(), Patch::kNotANode);
}

bool cuts_itself(const TriMesh& mesh) {
  return check_mesh(mesh)->self_intersecting;
}

TEST(Settle, ReachesSoundGoals) {
  TriMesh mesh = sheet(6).mesh;
  std::vector<Vec3> goal = mesh.vertices_mm;
  for (Vec3& v : goal) v.z = 0.2 * std::sin(v.x + 2 * v.y);
  EXPECT_EQ(settle(mesh, goal), "");
  EXPECT_TRUE(mesh.vertices_mm == goal);
}

TEST(Settle, DrawsBackWhatCuts) {
  TriMesh mesh = sheet(6).mesh;
  append(mesh, sheet(6, 1.0).mesh);
  std::vector<Vec3> goal = mesh.vertices_mm;
  goal[14].z = 1.8;  // row 2, column 2 of the lower sheet, through the upper one
  goal[5].z = 0.5;   // a corner, harmless
  TriMesh through = mesh;
  through.vertices_mm = goal;
  ASSERT_TRUE(cuts_itself(through));
  EXPECT_EQ(settle(mesh, goal), "");
  EXPECT_FALSE(cuts_itself(mesh));
  EXPECT_LT(mesh.vertices_mm[14].z, 1.0);
  EXPECT_EQ(mesh.vertices_mm[5].z, 0.5);
}

TEST(Settle, DrawsBackWhatTurnsOverOrCollapses) {
  for (const double x : {3.5, 3.0}) {  // across its neighbour, onto it
    TriMesh mesh = sheet(6).mesh;
    std::vector<Vec3> goal = mesh.vertices_mm;
    goal[14] = {x, 2, 0};
    EXPECT_EQ(settle(mesh, goal), "");
    for (const auto& [a, b, c] : mesh.triangles)
      EXPECT_GT(cross(mesh.vertices_mm[b] - mesh.vertices_mm[a],
                      mesh.vertices_mm[c] - mesh.vertices_mm[a])
                    .z,
                0.0);
  }
}

TEST(Settle, SaysWhenItCannotHelp) {
  TriMesh mesh = sheet(6).mesh;
  TriMesh other = sheet(6).mesh;
  for (Vec3& v : other.vertices_mm) v = {v.x + 0.1, 2.3 + 0.1 * v.y, v.y - 2.2};
  append(mesh, other);
  const std::vector<Vec3> goal = mesh.vertices_mm;
  EXPECT_NE(settle(mesh, goal), "");
}

TEST(KeepManifoldSheet, DropsPocketsAndTheirVertices) {
  Patch patch = sheet(6);
  TriMesh pocket = unit_sphere(1);
  for (Vec3& v : pocket.vertices_mm) v = v + Vec3{2, 2, -5};
  add(patch, pocket);
  std::vector<Vec3> goal = patch.mesh.vertices_mm;
  EXPECT_EQ(keep_manifold_sheet(level(6), patch, goal), "");
  EXPECT_TRUE(patch.mesh.triangles == sheet(6).mesh.triangles);
  EXPECT_TRUE(patch.mesh.vertices_mm == sheet(6).mesh.vertices_mm);
  EXPECT_EQ(goal.size(), 36U);
  EXPECT_EQ(patch.node.size(), 36U);
}

TEST(KeepManifoldSheet, SeesWhatIsWrong) {
  const auto verdict = [](Patch patch) {
    std::vector<Vec3> goal = patch.mesh.vertices_mm;
    return keep_manifold_sheet(level(6), patch, goal);
  };
  EXPECT_EQ(verdict(sheet(6)), "");
  Patch hole = sheet(6);
  hole.mesh.triangles.erase(hole.mesh.triangles.begin() + 24);
  EXPECT_NE(verdict(hole), "");
  Patch bite = sheet(6);
  bite.mesh.triangles.erase(bite.mesh.triangles.begin());
  EXPECT_NE(verdict(bite), "");
  Patch fin = sheet(6);
  fin.mesh.vertices_mm.push_back({2, 2, 3});
  fin.node.push_back(Patch::kNotANode);
  fin.mesh.triangles.push_back({14, 15, 36});
  EXPECT_NE(verdict(fin), "");
  // Two inner nodes made one: every edge still has two triangles.
  Patch pinch = sheet(6);
  for (auto& t : pinch.mesh.triangles)
    for (auto& v : t) v = v == 27 ? 8 : v;
  EXPECT_EQ(verdict(pinch), "two parts touch in a vertex only");
}

}  // namespace
}  // namespace maquette::meshing::detail

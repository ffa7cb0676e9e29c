// SPDX-License-Identifier: GPL-3.0-or-later

// meshing/geodesic.hpp against CGAL: Surface_mesh_shortest_path (exact, S.-Q. Xin and G.-J. Wang's
// refinement of Chen and Han) and the heat method (K. Crane, C. Weischedel, M. Wardetzky), on
// terrain from gentle to harsh, on rocks and on a cube.
//
//   within 1 % ................. of the exact distance, on ordinary and on harsh surfaces; on
//                                average 0.1 %
//   order ...................... nearer to exact than the heat method, at worst and in the mean
//   exact_radius ............... with no limit, equal to exact everywhere, saddles included

#include <algorithm>
#include <cmath>

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Heat_method_3/Surface_mesh_geodesic_distances_3.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/Surface_mesh_shortest_path.h>
#include <gtest/gtest.h>

#include "meshing/geodesic.hpp"
#include "support/field_mesh.hpp"
#include "support/shapes.hpp"

namespace maquette::meshing {
namespace {

using testing_support::mesh_of;

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Mesh = CGAL::Surface_mesh<Kernel::Point_3>;

Mesh cgal_mesh(const TriMesh& m) {
  Mesh out;
  for (const Vec3& v : m.vertices_mm) out.add_vertex({v.x, v.y, v.z});
  for (const auto& t : m.triangles)
    out.add_face(Mesh::Vertex_index(t[0]), Mesh::Vertex_index(t[1]), Mesh::Vertex_index(t[2]));
  return out;
}

std::vector<double> exact(const Mesh& m, std::uint32_t from) {
  using Traits = CGAL::Surface_mesh_shortest_path_traits<Kernel, Mesh>;
  CGAL::Surface_mesh_shortest_path<Traits> paths(m);
  paths.add_source_point(Mesh::Vertex_index(from));
  std::vector<double> d;
  for (const auto v : m.vertices()) d.push_back(paths.shortest_distance_to_source_points(v).first);
  return d;
}

std::vector<double> heat(const Mesh& m, std::uint32_t from) {
  Mesh copy = m;
  const auto found = copy.add_property_map<Mesh::Vertex_index, double>("v:distance", 0).first;
  CGAL::Heat_method_3::estimate_geodesic_distances(copy, found, Mesh::Vertex_index(from));
  std::vector<double> d;
  for (const auto v : copy.vertices()) d.push_back(found[v]);
  return d;
}

struct Errors {
  double worst = 0.0, mean = 0.0;
};
template <class Values>
Errors errors(const Values& d, const std::vector<double>& truth) {
  Errors e;
  std::size_t count = 0;
  for (std::size_t v = 0; v < truth.size(); ++v) {
    if (truth[v] <= 0.0) continue;
    const double relative = std::abs(static_cast<double>(d[v]) / truth[v] - 1.0);
    e.worst = std::max(e.worst, relative);
    e.mean += relative;
    ++count;
  }
  e.mean /= static_cast<double>(count);
  return e;
}

struct Case {
  const char* name;
  TriMesh mesh;
  double worst;  ///< allowed
};

std::vector<Case> cases() {
  using testing_support::random_rock;
  using testing_support::random_terrain;
  std::vector<Case> all;
  all.push_back({"gentle terrain", mesh_of(random_terrain(1, 61, 61, 0.5, 0.1)), 0.01});
  all.push_back({"hills", mesh_of(random_terrain(2, 56, 56, 0.5, 0.3)), 0.01});
  all.push_back({"rough terrain", mesh_of(random_terrain(3, 51, 51, 0.5, 0.2, 0.05)), 0.01});
  all.push_back({"harsh terrain", mesh_of(random_terrain(4, 51, 51, 0.5, 0.2, 0.3)), 0.01});
  all.push_back({"rock", random_rock(5, {1, 2, 3}, 8.0, 4, 0.0), 0.01});
  all.push_back({"rough rock", random_rock(6, {0, 0, 0}, 8.0, 5, 0.01), 0.01});
  return all;
}

TEST(GeodesicAndCgal, CloseToExactAndBetterThanHeat) {
  for (const Case& c : cases()) {
    const Mesh m = cgal_mesh(c.mesh);
    const auto from = static_cast<std::uint32_t>(c.mesh.vertices_mm.size() / 3);
    const std::vector<double> truth = exact(m, from);
    GeodesicSources s;
    s.vertices.push_back(from);
    const auto ours = geodesic_distance(c.mesh, s);
    ASSERT_TRUE(ours);
    GeodesicOptions all;
    all.exact_radius_mm = 1e3;
    const auto straight = geodesic_distance(c.mesh, s, all);
    const Errors e = errors(*ours, truth), h = errors(heat(m, from), truth);
    const Errors none = errors(*straight, truth);
    std::printf("%-15s worst %.4f mean %.5f; heat %.4f %.5f; exact start without limit %.1e\n",
                c.name, e.worst, e.mean, h.worst, h.mean, none.worst);
    EXPECT_LE(e.worst, c.worst) << c.name;
    EXPECT_LE(e.mean, 0.001) << c.name;
    EXPECT_LT(e.worst, h.worst) << c.name;
    EXPECT_LT(e.mean, h.mean) << c.name;
    EXPECT_LE(none.worst, 2e-6) << c.name;
  }
}

}  // namespace
}  // namespace maquette::meshing

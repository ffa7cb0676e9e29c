// SPDX-License-Identifier: GPL-3.0-or-later

// Geodesic distance from one vertex, vertices a second of one core, beside CGAL's heat method
// (estimate_geodesic_distances, its factorisation included as in any first call) and its exact
// Surface_mesh_shortest_path on the same terrain; their errors against the exact method where it
// can run.
//
//   geodesic_bench [nodes a side of the largest grid, default 1000; 4000 is the full scale]
//   geodesic_bench exact     errors on 1 M harsh triangles against CGAL's exact method: minutes

#include <chrono>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <ctime>
#include <string_view>

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Heat_method_3/Surface_mesh_geodesic_distances_3.h>
#include <CGAL/Surface_mesh.h>
#include <CGAL/Surface_mesh_shortest_path.h>

#include "meshing/geodesic.hpp"
#include "support/bench_times.hpp"
#include "support/field_mesh.hpp"
#include "support/shapes.hpp"

namespace maquette::meshing {
namespace {

using testing_support::mesh_of;
using testing_support::peak_mib;

using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Mesh = CGAL::Surface_mesh<Kernel::Point_3>;

/// Of the thread that is timed.
double thread_seconds() {
  timespec t{};
  clock_gettime(CLOCK_THREAD_CPUTIME_ID, &t);
  return static_cast<double>(t.tv_sec) + 1e-9 * static_cast<double>(t.tv_nsec);
}
Mesh cgal_mesh(const TriMesh& m) {
  Mesh out;
  for (const Vec3& v : m.vertices_mm) out.add_vertex({v.x, v.y, v.z});
  for (const auto& t : m.triangles)
    out.add_face(Mesh::Vertex_index(t[0]), Mesh::Vertex_index(t[1]), Mesh::Vertex_index(t[2]));
  return out;
}

struct Timed {
  std::vector<double> distance;
  double seconds = 0.0;
};

template <class Surface>
Timed ours(const Surface& surface, std::uint32_t from, std::size_t vertices, const char* name) {
  GeodesicSources s;
  s.vertices.push_back(from);
  const double start = thread_seconds();
  const auto d = geodesic_distance(surface, s);
  const double seconds = thread_seconds() - start;
  std::printf("%-34s %9zu vertices %8.3f s %12.0f vertices/s, peak %.0f MiB\n", name, vertices,
              seconds, static_cast<double>(vertices) / seconds, peak_mib());
  Timed timed{{}, seconds};
  if constexpr (std::is_same_v<Surface, TriMesh>)
    timed.distance.assign(d->begin(), d->end());
  else
    timed.distance.assign(d->cells().begin(), d->cells().end());
  return timed;
}

Timed heat(const Mesh& m, std::uint32_t from) {
  Mesh copy = m;
  const auto found = copy.add_property_map<Mesh::Vertex_index, double>("v:distance", 0).first;
  const double start = thread_seconds();
  CGAL::Heat_method_3::estimate_geodesic_distances(copy, found, Mesh::Vertex_index(from));
  Timed timed{{}, thread_seconds() - start};
  for (const auto v : copy.vertices()) timed.distance.push_back(found[v]);
  std::printf("%-34s %9zu vertices %8.3f s %12.0f vertices/s, peak %.0f MiB\n", "CGAL heat method",
              timed.distance.size(), timed.seconds,
              static_cast<double>(timed.distance.size()) / timed.seconds, peak_mib());
  return timed;
}

Timed exact(const Mesh& m, std::uint32_t from) {
  using Traits = CGAL::Surface_mesh_shortest_path_traits<Kernel, Mesh>;
  const double start = thread_seconds();
  CGAL::Surface_mesh_shortest_path<Traits> paths(m);
  paths.add_source_point(Mesh::Vertex_index(from));
  Timed timed;
  for (const auto v : m.vertices())
    timed.distance.push_back(paths.shortest_distance_to_source_points(v).first);
  timed.seconds = thread_seconds() - start;
  std::printf("%-34s %9zu vertices %8.3f s %12.0f vertices/s, peak %.0f MiB\n", "CGAL exact",
              timed.distance.size(), timed.seconds,
              static_cast<double>(timed.distance.size()) / timed.seconds, peak_mib());
  return timed;
}

void print_errors(const char* name, const Timed& t, const Timed& truth) {
  double worst = 0.0, mean = 0.0;
  for (std::size_t v = 0; v < truth.distance.size(); ++v) {
    if (truth.distance[v] <= 0.0) continue;
    const double relative = std::abs(t.distance[v] / truth.distance[v] - 1.0);
    worst = std::max(worst, relative);
    mean += relative / static_cast<double>(truth.distance.size());
  }
  std::printf("  %-32s against exact: worst %.4f, mean %.5f of the distance\n", name, worst, mean);
}

heightmap::ModelField terrain(std::ptrdiff_t n) {
  return testing_support::random_terrain(1, n, n, 0.5, 0.2, 0.02);
}
/// Neighbouring facets turn by 21 degrees on average.
heightmap::ModelField harsh_terrain(std::ptrdiff_t n) {
  return testing_support::random_terrain(1, n, n, 0.5, 0.3, 0.1);
}

/// Neighbouring facets turn by 38 degrees on average.
int against_exact_on_a_million() {
  const heightmap::ModelField field = testing_support::random_terrain(1, 708, 708, 0.5, 0.1, 0.2);
  const auto from = static_cast<std::uint32_t>(300 * 708 + 222);
  const Timed a = ours(field, from, field.z_mm.cells().size(), "ours, ModelField, 1 M harsh");
  const Mesh m = cgal_mesh(mesh_of(field));
  const Timed h = heat(m, from), e = exact(m, from);
  print_errors("ours", a, e);
  print_errors("CGAL heat method", h, e);
  return 0;
}

int run(std::ptrdiff_t largest) {
  {
    const heightmap::ModelField field = terrain(largest);
    const double before = peak_mib();
    ours(field, static_cast<std::uint32_t>(largest * (largest / 2) + largest / 3),
         field.z_mm.cells().size(), "ours, ModelField");
    std::printf("  peak before: %.0f MiB\n\n", before);
  }
  for (const bool harsh : {false, true}) {
    const TriMesh small = mesh_of(harsh ? harsh_terrain(110) : terrain(110));
    const Mesh m = cgal_mesh(small);
    const std::uint32_t from = 4000;
    const Timed a = ours(small, from, small.vertices_mm.size(),
                         harsh ? "ours, TriMesh, harsh" : "ours, TriMesh"),
                h = heat(m, from), e = exact(m, from);
    print_errors("ours", a, e);
    print_errors("CGAL heat method", h, e);
    std::printf("  ours is %.0f times as fast as exact, %.1f times as fast as heat\n\n",
                e.seconds / a.seconds, h.seconds / a.seconds);
  }
  {
    const heightmap::ModelField field = terrain(708);
    const TriMesh mesh = mesh_of(field);
    const auto from = static_cast<std::uint32_t>(300 * 708 + 222);
    const Timed grid =
        ours(field, from, mesh.vertices_mm.size(), "ours, ModelField, 1 M triangles");
    const Timed tri = ours(mesh, from, mesh.vertices_mm.size(), "ours, TriMesh, 1 M triangles");
    const Timed h = heat(cgal_mesh(mesh), from);
    std::printf("  ours is %.1f (ModelField) and %.1f (TriMesh) times as fast as heat\n\n",
                h.seconds / grid.seconds, h.seconds / tri.seconds);
  }
  return 0;
}

}  // namespace
}  // namespace maquette::meshing

int main(int argc, char** argv) {
  if (argc > 1 && std::string_view(argv[1]) == "exact")
    return maquette::meshing::against_exact_on_a_million();
  return maquette::meshing::run(argc > 1 ? std::atol(argv[1]) : 1000);
}

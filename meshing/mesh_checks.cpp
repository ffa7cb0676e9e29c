// SPDX-License-Identifier: GPL-3.0-or-later
#define CGAL_LINKED_WITH_TBB 1
#include "meshing/mesh_checks.hpp"

#include <atomic>

#include <CGAL/Exact_predicates_inexact_constructions_kernel.h>
#include <CGAL/Polygon_mesh_processing/connected_components.h>
#include <CGAL/Polygon_mesh_processing/manifoldness.h>
#include <CGAL/Polygon_mesh_processing/measure.h>
#include <CGAL/Polygon_mesh_processing/orientation.h>
#include <CGAL/Polygon_mesh_processing/self_intersections.h>
#include <CGAL/Surface_mesh.h>
#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>
#include <nlohmann/json.hpp>

#include "meshing/detail/intersection_pieces.hpp"
#include "meshing/detail/union_error.hpp"

namespace maquette::meshing {
namespace {

namespace pmp = CGAL::Polygon_mesh_processing;
using Kernel = CGAL::Exact_predicates_inexact_constructions_kernel;
using Mesh = CGAL::Surface_mesh<Kernel::Point_3>;
using Triangle = std::array<std::uint32_t, 3>;

constexpr std::size_t kTrianglesPerLook = std::size_t{1} << 20;  // at the stop token

Kernel::Point_3 point(const Vec3& v) {
  return {v.x, v.y, v.z};
}

bool is_degenerate(const TriMesh& mesh, const Triangle& t) {
  if (t[0] == t[1] || t[1] == t[2] || t[2] == t[0]) return true;
  return CGAL::collinear(point(mesh.vertices_mm[t[0]]), point(mesh.vertices_mm[t[1]]),
                         point(mesh.vertices_mm[t[2]]));
}

std::uint64_t count_degenerate(const TriMesh& mesh) {
  std::atomic<std::uint64_t> count{0};
  tbb::parallel_for(std::size_t{0}, (mesh.triangles.size() >> 16) + 1, [&](std::size_t chunk) {
    std::uint64_t here = 0;
    const std::size_t end = std::min((chunk + 1) << 16, mesh.triangles.size());
    for (std::size_t t = chunk << 16; t < end; ++t) here += is_degenerate(mesh, mesh.triangles[t]);
    count += here;
  });
  return count;
}

/// @return false if some triangle could not be added: an edge of three triangles, two
///         neighbours turned against each other, or two sheets that share a vertex
bool build(const TriMesh& source, Mesh& mesh, const RunContext& run) {
  bool all = true;
  mesh.reserve(static_cast<Mesh::size_type>(source.vertices_mm.size()),
               static_cast<Mesh::size_type>(source.triangles.size() * 3 / 2 + 8),
               static_cast<Mesh::size_type>(source.triangles.size()));
  for (const Vec3& v : source.vertices_mm) mesh.add_vertex(point(v));
  for (std::size_t i = 0; i < source.triangles.size(); ++i) {
    if (i % kTrianglesPerLook == 0) {
      if (run.stopped()) return all;
      run.progress(0.5 * static_cast<double>(i) / static_cast<double>(source.triangles.size()));
    }
    const Triangle& t = source.triangles[i];
    const bool distinct = t[0] != t[1] && t[1] != t[2] && t[2] != t[0];
    if (!distinct || mesh.add_face(Mesh::Vertex_index(t[0]), Mesh::Vertex_index(t[1]),
                                   Mesh::Vertex_index(t[2])) == Mesh::null_face())
      all = false;
  }
  return all;
}

/// Each shell by itself, since a stone's shell inside out is not seen from the outermost
/// vertex of all. @pre closed, manifold
bool every_shell_outward(const Mesh& mesh,
                         const Mesh::Property_map<Mesh::Face_index, std::uint32_t>& shell_of,
                         std::uint32_t shells) {
  if (shells == 1) return pmp::is_outward_oriented(mesh);
  std::vector<std::vector<Mesh::Face_index>> faces_of(shells);
  for (const Mesh::Face_index f : mesh.faces()) faces_of[shell_of[f]].push_back(f);
  std::vector<std::uint32_t> name(mesh.number_of_vertices());
  for (const auto& faces : faces_of) {
    Mesh shell;
    std::fill(name.begin(), name.end(), UINT32_MAX);
    for (const Mesh::Face_index f : faces) {
      std::array<Mesh::Vertex_index, 3> corner;
      std::size_t i = 0;
      for (const Mesh::Vertex_index v : mesh.vertices_around_face(mesh.halfedge(f))) {
        std::uint32_t& n = name[static_cast<std::size_t>(v)];
        if (n == UINT32_MAX) n = shell.add_vertex(mesh.point(v));
        corner[i++] = Mesh::Vertex_index(n);
      }
      shell.add_face(corner[0], corner[1], corner[2]);
    }
    if (!pmp::is_outward_oriented(shell)) return false;
  }
  return true;
}

/// Faces have their triangles' numbers. Ends early, and says nothing, where it is stopped.
bool cuts_itself(const TriMesh& source, const Mesh& mesh, const heightmap::ModelField* surface,
                 CoordinateRounding rounding, const RunContext& run) {
  const detail::IntersectionPieces pieces = detail::intersection_pieces(source, surface, rounding);
  std::atomic<bool> found{false};
  std::atomic<std::size_t> done{0};
  tbb::parallel_for(std::size_t{0}, pieces.count(), [&](std::size_t p) {
    if (found || run.stopped()) return;
    std::vector<Mesh::Face_index> faces;
    faces.reserve(pieces.first[p + 1] - pieces.first[p]);
    for (std::size_t i = pieces.first[p]; i < pieces.first[p + 1]; ++i)
      faces.emplace_back(pieces.faces[i]);
    if (faces.size() > 1 && pmp::does_self_intersect<CGAL::Sequential_tag>(faces, mesh))
      found = true;
    run.progress(0.9 + 0.1 * static_cast<double>(++done) / static_cast<double>(pieces.count()));
  });
  return found;
}

/// The mesh's first triangles and the vertices that they have. @pre indices in range
detail::PartOfMesh top_of(const TriMesh& mesh, std::uint64_t triangles) {
  detail::PartOfMesh top{mesh.vertices_mm, mesh.triangles};
  if (triangles >= mesh.triangles.size()) return top;
  top.triangles = top.triangles.first(triangles);
  std::size_t vertices = 0;
  for (const Triangle& t : top.triangles)
    vertices = std::max<std::size_t>(vertices, std::size_t{std::max({t[0], t[1], t[2]})} + 1);
  top.vertices_mm = top.vertices_mm.first(vertices);
  return top;
}

void measure_height_error(std::span<const Vec3> vertices_mm, double base_z,
                          const heightmap::ModelField& field, MeshCertificate& certificate) {
  constexpr double kNearWall_mm = 1e-6;
  constexpr double kStoneAbove_mm = 0.05;
  const double x_last = field.x_mm(field.z_mm.cols() - 1);
  const double y_last = field.y_mm(field.z_mm.rows() - 1);
  double sum = 0.0;
  for (const Vec3& v : vertices_mm) {
    const bool inside = v.x > field.x_mm(0) + kNearWall_mm && v.x < x_last - kNearWall_mm &&
                        v.y > field.y_mm(0) + kNearWall_mm && v.y < y_last - kNearWall_mm;
    if (!inside || v.z <= base_z) continue;
    const double error = v.z - heightmap::height_at(field, v.x, v.y);
    if (std::isnan(error)) continue;  // over a void
    if (error > kStoneAbove_mm) {
      ++certificate.vertices_above_surface;
      continue;
    }
    ++certificate.vertices_compared;
    sum += error * error;
    certificate.max_vertical_error_mm =
        std::fmax(certificate.max_vertical_error_mm, std::abs(error));
  }
  if (certificate.vertices_compared > 0)
    certificate.rms_vertical_error_mm =
        std::sqrt(sum / static_cast<double>(certificate.vertices_compared));
}

}  // namespace

Result<MeshCertificate> check_mesh(const TriMesh& mesh, const heightmap::ModelField* surface,
                                   const MeshCheckOptions& options, const RunContext& run) {
  constexpr std::string_view kStopped = "checking the mesh was stopped";
  MeshCertificate certificate;
  certificate.vertices = mesh.vertices_mm.size();
  certificate.triangles = mesh.triangles.size();
  // Broken indices or coordinates make the rest meaningless: nothing is certified.
  for (const Vec3& v : mesh.vertices_mm)
    if (!std::isfinite(v.x) || !std::isfinite(v.y) || !std::isfinite(v.z)) return certificate;
  for (const Triangle& t : mesh.triangles)
    for (const std::uint32_t v : t)
      if (v >= mesh.vertices_mm.size()) return certificate;
  if (mesh.triangles.empty()) return certificate;
  const detail::PartOfMesh top = top_of(mesh, options.top_triangles);
  const double base_z = mesh.bounds().min.z;
  if (surface != nullptr && !options.stones.empty()) {
    const detail::UnionError error =
        detail::union_error(top, base_z, *surface, options.stones, run);
    certificate.vertices_compared = error.on_terrain;
    certificate.vertices_above_surface = error.on_stones;
    certificate.max_vertical_error_mm = error.max_vertical_mm;
    certificate.rms_vertical_error_mm = error.rms_vertical_mm;
    certificate.max_union_error_mm = error.max_mm;
  } else if (surface != nullptr) {
    measure_height_error(top.vertices_mm, base_z, *surface, certificate);
  }
  certificate.degenerate_triangles = count_degenerate(mesh);
  try {
    Mesh cgal;
    const bool all_added = build(mesh, cgal, run);
    if (run.stopped()) return fail(kCancelled, std::string(kStopped));
    const bool valid = CGAL::is_valid_polygon_mesh(cgal);
    run.progress(0.6);
    std::vector<Mesh::Halfedge_index> pinched_at;
    pmp::non_manifold_vertices(cgal, std::back_inserter(pinched_at));
    certificate.manifold = all_added && valid && pinched_at.empty();
    certificate.closed = all_added && CGAL::is_closed(cgal);
    if (run.stopped()) return fail(kCancelled, std::string(kStopped));
    run.progress(0.7);
    std::uint64_t used = 0;
    for (const Mesh::Vertex_index v : cgal.vertices()) used += !cgal.is_isolated(v);
    certificate.euler_number = static_cast<std::int64_t>(used) -
                               static_cast<std::int64_t>(cgal.number_of_edges()) +
                               static_cast<std::int64_t>(cgal.number_of_faces());
    auto shell_of = cgal.add_property_map<Mesh::Face_index, std::uint32_t>("f:shell", 0).first;
    const auto shells = static_cast<std::uint32_t>(pmp::connected_components(cgal, shell_of));
    certificate.shells = shells;
    certificate.area_mm2 = pmp::area(cgal);
    if (run.stopped()) return fail(kCancelled, std::string(kStopped));
    run.progress(0.8);
    if (certificate.closed && certificate.manifold) {
      certificate.volume_mm3 = pmp::volume(cgal);
      certificate.oriented_outward = every_shell_outward(cgal, shell_of, shells);
    }
    cgal.remove_property_map(shell_of);
    run.progress(0.9);
    if (options.self_intersections && all_added && certificate.degenerate_triangles == 0 &&
        certificate.triangles <= options.self_intersection_limit) {
      if (run.stopped()) return fail(kCancelled, std::string(kStopped));
      certificate.self_intersecting = cuts_itself(mesh, cgal, surface, options.rounding, run);
      if (run.stopped()) return fail(kCancelled, std::string(kStopped));
      certificate.self_intersection_checked = true;
    }
  } catch (const std::exception& e) {
    // CGAL's own preconditions: the mesh is not what they ask for.
    run.warn(fmt::format("checks were cut short: {}", e.what()));
    certificate.manifold = false;
  }
  run.progress(1.0);
  return certificate;
}

std::string shortcomings(const MeshCertificate& c) {
  std::vector<std::string> all;
  if (!c.manifold) all.emplace_back("it is no 2-manifold");
  if (!c.closed) all.emplace_back("it is open");
  if (!c.oriented_outward) all.emplace_back("a shell is not turned outwards");
  if (c.degenerate_triangles > 0)
    all.push_back(fmt::format("{} triangles have no area", c.degenerate_triangles));
  if (c.self_intersecting) all.emplace_back("it cuts itself");
  if (!c.self_intersection_checked) all.emplace_back("whether it cuts itself was not found out");
  if (c.max_union_error_mm > kMostUnionError_mm)
    all.push_back(fmt::format("it is up to {:.3g} mm from terrain and stones, {} mm are allowed",
                              c.max_union_error_mm, kMostUnionError_mm));
  return fmt::format("{}", fmt::join(all, "; "));
}

std::string to_json(const MeshCertificate& c) {
  const auto known = [](double value) {
    return std::isnan(value) ? nlohmann::ordered_json() : nlohmann::ordered_json(value);
  };
  const nlohmann::ordered_json json = {{"proof", c.proof},
                                       {"vertices", c.vertices},
                                       {"triangles", c.triangles},
                                       {"manifold", c.manifold},
                                       {"closed", c.closed},
                                       {"oriented_outward", c.oriented_outward},
                                       {"degenerate_triangles", c.degenerate_triangles},
                                       {"self_intersection_checked", c.self_intersection_checked},
                                       {"self_intersecting", c.self_intersecting},
                                       {"shells", c.shells},
                                       {"euler_number", c.euler_number},
                                       {"volume_mm3", c.volume_mm3},
                                       {"area_mm2", c.area_mm2},
                                       {"max_vertical_error_mm", c.max_vertical_error_mm},
                                       {"rms_vertical_error_mm", c.rms_vertical_error_mm},
                                       {"vertices_compared", c.vertices_compared},
                                       {"vertices_above_surface", c.vertices_above_surface},
                                       {"max_union_error_mm", known(c.max_union_error_mm)},
                                       {"rounding_mm", known(c.rounding_mm)},
                                       {"hausdorff_bound_mm", known(c.hausdorff_bound_mm)},
                                       {"passed", c.passed()}};
  return json.dump(2) + "\n";
}

}  // namespace maquette::meshing

// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/decimate.hpp"

#include <fmt/format.h>

#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#include <OpenMesh/Tools/Decimater/DecimaterT.hh>
#include <OpenMesh/Tools/Decimater/ModNormalFlippingT.hh>
#include <OpenMesh/Tools/Decimater/ModQuadricT.hh>

#include "core/check.hpp"
#include "meshing/solid.hpp"

namespace maquette::meshing {
namespace {

using heightmap::ModelField;

struct DoublePoints : OpenMesh::DefaultTraits {
  using Point = OpenMesh::Vec3d;
  using Normal = OpenMesh::Vec3d;
};
using Mesh = OpenMesh::TriMesh_ArrayKernelT<DoublePoints>;
using Node = std::array<std::ptrdiff_t, 2>;  // row, column

/// OpenMesh takes about 50 us a node, so a coarse level starts from fewer of them.
std::ptrdiff_t most_nodes(std::uint64_t target_triangles) {
  constexpr std::uint64_t kLeast = 1024 * 1024;
  constexpr std::uint64_t kMost = 2048 * 2048;
  return static_cast<std::ptrdiff_t>(
      std::clamp(8 * std::min(target_triangles, kMost), kLeast, kMost));
}

/// 0, step, 2 step, ... and the last one.
std::vector<std::ptrdiff_t> sampled(std::ptrdiff_t count, std::ptrdiff_t step) {
  std::vector<std::ptrdiff_t> at;
  for (std::ptrdiff_t i = 0; i < count - 1; i += step) at.push_back(i);
  at.push_back(count - 1);
  return at;
}

/// Forbids collapses after which a triangle, seen from above, would be turned over or a
/// line, so that the mesh stays the graph of a height function.
template <class M>
class KeepsGraph : public OpenMesh::Decimater::ModBaseT<M> {
 public:
  DECIMATING_MODULE(KeepsGraph, M, KeepsGraph);
  explicit KeepsGraph(M& mesh) : Base(mesh, /*is_binary=*/true) {}
  float collapse_priority(const CollapseInfo& ci) override {
    const auto& mesh = Base::mesh();
    for (auto h = mesh.cvoh_ccwbegin(ci.v0); h.is_valid(); ++h) {
      if (mesh.is_boundary(*h)) continue;
      const auto a = mesh.to_vertex_handle(*h);
      const auto b = mesh.to_vertex_handle(mesh.next_halfedge_handle(*h));
      if (a == ci.v1 || b == ci.v1) continue;  // vanishes
      const auto u = mesh.point(a) - ci.p1;
      const auto v = mesh.point(b) - ci.p1;
      if (!(u[0] * v[1] - u[1] * v[0] > kLeastShare_ * (u.norm() * v.norm())))
        return Base::ILLEGAL_COLLAPSE;
    }
    return Base::LEGAL_COLLAPSE;
  }

 private:
  static constexpr double kLeastShare_ = 1e-9;  ///< sine seen from above: far above rounding
};

/// Quadric error with a hint of how long the new edges get. Where many collapses cost
/// nothing (level ground) a vertex would otherwise be pushed along a row, each time with
/// all its neighbours, until it has thousands of them.
template <class M>
class QuadricThenLength : public OpenMesh::Decimater::ModQuadricT<M> {
 public:
  using Base = OpenMesh::Decimater::ModQuadricT<M>;
  using Self = QuadricThenLength;
  using Handle = OpenMesh::Decimater::ModHandleT<QuadricThenLength>;
  using CollapseInfo = typename Base::CollapseInfo;
  using Base::Base;
  float collapse_priority(const CollapseInfo& ci) override {
    constexpr double kShare = 1e-9;  // an edge of 1 mm counts as an error of 0.03 um
    double longest = 0.0;
    for (const auto v : Base::mesh().vv_range(ci.v0))
      longest = std::fmax(longest, (Base::mesh().point(v) - ci.p1).sqrnorm());
    return Base::collapse_priority(ci) + static_cast<float>(kShare * longest);
  }
};

class Watch : public OpenMesh::Decimater::Observer {
 public:
  Watch(const RunContext& run, std::size_t collapses)
      : Observer(4096), run_(run), all_(collapses) {}
  void notify(std::size_t done) override {
    run_.progress(0.9 * static_cast<double>(done) / static_cast<double>(all_ + 1));
  }
  [[nodiscard]] bool abort() const override { return run_.stopped(); }

 private:
  const RunContext& run_;
  std::size_t all_;
};

/// Vertical errors at all nodes: triangles are rasterised with their corners' row and
/// column numbers, in integers, so that every node is inside or on an edge, exactly.
void measure_error(const ModelField& field, const std::vector<Node>& node_of,
                   DecimatedMesh& result) {
  const Grid<float>& z = field.z_mm;
  Grid<char> seen(z.rows(), z.cols(), 0);
  double sum = 0.0;
  for (const auto& t : result.mesh.triangles) {
    const Node a = node_of[t[0]];
    const Node b = node_of[t[1]];
    const Node c = node_of[t[2]];
    const auto doubled = [](Node p, Node q, Node r) {
      return (q[1] - p[1]) * (r[0] - p[0]) - (q[0] - p[0]) * (r[1] - p[1]);
    };
    const std::ptrdiff_t area = doubled(a, b, c);
    MAQUETTE_CHECK(area > 0, "a triangle was turned over: {}", area);
    const double za = z(a[0], a[1]);
    const double zb = z(b[0], b[1]);
    const double zc = z(c[0], c[1]);
    const auto [r0, r1] = std::minmax({a[0], b[0], c[0]});
    const auto [c0, c1] = std::minmax({a[1], b[1], c[1]});
    for (std::ptrdiff_t r = r0; r <= r1; ++r)
      for (std::ptrdiff_t col = c0; col <= c1; ++col) {
        const Node p{r, col};
        const std::ptrdiff_t wa = doubled(p, b, c);
        const std::ptrdiff_t wb = doubled(a, p, c);
        const std::ptrdiff_t wc = doubled(a, b, p);
        if (wa < 0 || wb < 0 || wc < 0 || seen(r, col)) continue;
        seen(r, col) = 1;
        // From za on, so that level triangles have level points to the bit.
        const double height =
            za + (static_cast<double>(wb) * (zb - za) + static_cast<double>(wc) * (zc - za)) /
                     static_cast<double>(area);
        const double error = std::abs(height - static_cast<double>(z(r, col)));
        result.max_vertical_error_mm = std::fmax(result.max_vertical_error_mm, error);
        sum += error * error;
      }
  }
  result.rms_vertical_error_mm = std::sqrt(sum / static_cast<double>(z.rows() * z.cols()));
}

}  // namespace

Result<DecimatedMesh> decimate_surface(const ModelField& surface, std::uint64_t target_triangles,
                                       const RunContext& run) {
  const Grid<float>& z = surface.z_mm;
  MAQUETTE_CHECK(z.rows() >= 2 && z.cols() >= 2, "a field of {} x {} nodes has no cell", z.rows(),
                 z.cols());
  for (std::ptrdiff_t r = 0; r < z.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < z.cols(); ++c)
      if (!std::isfinite(z(r, c)))
        return fail(kSurfaceHasVoids,
                    fmt::format("the surface has a void at row {}, column {} (row 0 is the "
                                "southernmost); fill voids before decimating",
                                r, c));
  std::ptrdiff_t step = 1;
  while (((z.rows() - 2) / step + 2) * ((z.cols() - 2) / step + 2) > most_nodes(target_triangles))
    ++step;
  const std::vector<std::ptrdiff_t> row = sampled(z.rows(), step);
  const std::vector<std::ptrdiff_t> col = sampled(z.cols(), step);

  DecimatedMesh result;
  std::vector<Node> node_of;
  {
    Mesh mesh;
    const std::size_t nodes = row.size() * col.size();
    mesh.reserve(nodes, 3 * nodes, 2 * nodes);
    for (const std::ptrdiff_t r : row)
      for (const std::ptrdiff_t c : col)
        mesh.add_vertex({surface.x_mm(c), surface.y_mm(r), static_cast<double>(z(r, c))});
    const auto vertex = [&](std::size_t i, std::size_t j) {
      return Mesh::VertexHandle(static_cast<int>(i * col.size() + j));
    };
    for (std::size_t i = 0; i + 1 < row.size(); ++i)
      for (std::size_t j = 0; j + 1 < col.size(); ++j) {
        mesh.add_face(vertex(i, j), vertex(i, j + 1), vertex(i + 1, j + 1));
        mesh.add_face(vertex(i, j), vertex(i + 1, j + 1), vertex(i + 1, j));
      }
    if (run.stopped()) return fail(kCancelled, "decimation was stopped");

    mesh.request_vertex_status();
    mesh.request_edge_status();
    mesh.request_face_status();
    mesh.request_halfedge_status();
    mesh.request_face_normals();
    mesh.update_face_normals();
    // Along a straight side a vertex may slide; a corner is the end of two sides.
    for (const std::size_t i : {std::size_t{0}, row.size() - 1})
      for (const std::size_t j : {std::size_t{0}, col.size() - 1})
        mesh.status(vertex(i, j)).set_locked(true);

    const std::size_t faces = mesh.n_faces();
    if (faces > target_triangles) {
      OpenMesh::Decimater::DecimaterT<Mesh> decimater(mesh);
      QuadricThenLength<Mesh>::Handle quadric;
      OpenMesh::Decimater::ModNormalFlippingT<Mesh>::Handle flipping;
      KeepsGraph<Mesh>::Handle graph;
      decimater.add(quadric);
      decimater.add(flipping);
      decimater.add(graph);
      decimater.module(quadric).unset_max_err();
      Watch watch(run, (faces - target_triangles) / 2);
      decimater.set_observer(&watch);
      MAQUETTE_CHECK(decimater.initialize(), "{} faces", faces);
      decimater.decimate_to_faces(0, target_triangles);
      if (run.stopped()) return fail(kCancelled, "decimation was stopped");
    }
    std::vector<std::uint32_t> name(nodes, 0);
    for (std::size_t n = 0; n < nodes; ++n) {
      const Mesh::VertexHandle v(static_cast<int>(n));
      if (mesh.status(v).deleted()) continue;
      const Node node{row[n / col.size()], col[n % col.size()]};
      name[n] = static_cast<std::uint32_t>(node_of.size());
      node_of.push_back(node);
      result.mesh.vertices_mm.push_back(
          {surface.x_mm(node[1]), surface.y_mm(node[0]), static_cast<double>(z(node[0], node[1]))});
    }
    for (const auto f : mesh.faces()) {  // skips deleted ones
      std::array<std::uint32_t, 3> t{};
      std::size_t i = 0;
      for (const auto v : mesh.fv_range(f)) t[i++] = name[static_cast<std::size_t>(v.idx())];
      result.mesh.triangles.push_back(t);
    }
  }  // the half-edge mesh is as large as all else together
  measure_error(surface, node_of, result);
  run.progress(1.0);
  return result;
}

}  // namespace maquette::meshing

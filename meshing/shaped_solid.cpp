// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/shaped_solid.hpp"

#include <algorithm>

#include "core/check.hpp"

namespace maquette::meshing {
namespace {

/// Of the plain solid's three triangles at each edge of the outline the third is the base's.
constexpr std::uint64_t kPerEdge = 3;

std::uint64_t rim_of(const NodeWindow& nodes) {
  return 2 * static_cast<std::uint64_t>(nodes.rows() + nodes.cols() - 2);
}

struct Below {
  std::vector<Vec3> vertices;  ///< after the rim's lower vertices
  std::vector<MeshStream::Triangle> triangles;
};

/// Walls, then the underside, whose own vertices follow the rim's, then engraved walls.
Below close_below(std::span<const MeshStream::Triangle> walls_and_base, std::uint64_t first_of_rim,
                  const Shaping& shaping) {
  const std::uint64_t rim = walls_and_base.size() / kPerEdge;
  const Underside& under = shaping.underside;
  MAQUETTE_CHECK(under.rim_vertices == rim, "{} of {} vertices of the rim", under.rim_vertices,
                 rim);
  std::vector<char> engraved(rim, 0);
  for (const EngravedWall& w : shaping.walls)
    for (std::uint64_t k = w.first_edge; k < w.first_edge + w.edges; ++k) {
      MAQUETTE_CHECK(k < rim && engraved[k] == 0, "edge {} of {} is engraved twice", k, rim);
      engraved[k] = 1;
    }
  Below below;
  for (std::uint64_t i = 0; i < walls_and_base.size(); ++i)
    if (i % kPerEdge != kPerEdge - 1 && engraved[i / kPerEdge] == 0)
      below.triangles.push_back(walls_and_base[i]);
  const auto shift = static_cast<std::uint32_t>(first_of_rim);
  for (const auto& t : under.mesh.triangles)
    below.triangles.push_back({t[0] + shift, t[1] + shift, t[2] + shift});
  below.vertices.assign(under.mesh.vertices_mm.begin() + static_cast<std::ptrdiff_t>(rim),
                        under.mesh.vertices_mm.end());
  for (const EngravedWall& w : shaping.walls) {
    const std::uint64_t nodes = w.edges + 1;
    const auto own = static_cast<std::uint32_t>(first_of_rim + rim + below.vertices.size());
    const auto vertex = [&](std::uint32_t i) {
      if (i >= 2 * nodes) return own + static_cast<std::uint32_t>(i - 2 * nodes);
      const std::uint64_t k = w.first_edge + i % nodes;  // of the rim
      if (i < nodes) return static_cast<std::uint32_t>(first_of_rim + k % rim);
      // The upper end of the edge before, or of the edge's own: the plain wall knows it.
      const bool later = i == nodes + w.edges;
      const auto edge = walls_and_base.subspan(kPerEdge * (later ? k - 1 : k), 2);
      return later ? edge[k - 1 < rim / 2 ? 0 : 1][k - 1 < rim / 2 ? 2 : 1] : edge[1][2];
    };
    for (const auto& t : w.triangles)
      below.triangles.push_back({vertex(t[0]), vertex(t[1]), vertex(t[2])});
    below.vertices.insert(below.vertices.end(), w.vertices_mm.begin(), w.vertices_mm.end());
  }
  return below;
}

double removed_mm3(const Shaping& shaping) {
  double volume = shaping.underside.volume_mm3;
  for (const EngravedWall& w : shaping.walls) volume += w.volume_mm3;
  return volume;
}

}  // namespace

Result<ShapedSolid> ShapedSolid::create(const heightmap::ModelField& surface,
                                        const SolidOptions& options, const Shaping& shaping) {
  return create(surface, all_nodes(surface), options, shaping);
}

Result<ShapedSolid> ShapedSolid::create(const heightmap::ModelField& surface,
                                        const NodeWindow& window, const SolidOptions& options,
                                        const Shaping& shaping) {
  MAQUETTE_TRY(const GridSolidStream grid, GridSolidStream::create(surface, window, options));
  const std::uint64_t rim = rim_of(window), plain = grid.triangle_count();
  ShapedSolid solid(grid, plain - kPerEdge * rim, grid.vertex_count() - 1);
  std::vector<Triangle> walls(kPerEdge * rim);
  grid.triangles(solid.top_triangles_, walls);
  Below below = close_below(walls, solid.shared_vertices_ - rim, shaping);
  MAQUETTE_CHECK(solid.shared_vertices_ + below.vertices.size() < 0xF0000000U,
                 "{} vertices: more than 32 bit indices reach", below.vertices.size());
  solid.own_vertices_ = std::move(below.vertices);
  solid.own_triangles_ = std::move(below.triangles);
  solid.removed_mm3_ = removed_mm3(shaping);
  return solid;
}

std::uint64_t ShapedSolid::vertex_count() const {
  return shared_vertices_ + own_vertices_.size();
}
std::uint64_t ShapedSolid::triangle_count() const {
  return top_triangles_ + own_triangles_.size();
}

Vec3 ShapedSolid::vertex(std::uint64_t i) const {
  if (i >= shared_vertices_) return own_vertices_[i - shared_vertices_];
  Vec3 v;
  grid_.vertices(i, {&v, 1});
  return v;
}

void ShapedSolid::vertices(std::uint64_t first, std::span<Vec3> out) const {
  const std::uint64_t shared =
      first < shared_vertices_ ? std::min<std::uint64_t>(out.size(), shared_vertices_ - first) : 0;
  grid_.vertices(first, out.first(shared));
  for (std::size_t i = shared; i < out.size(); ++i)
    out[i] = own_vertices_[first + i - shared_vertices_];
}

void ShapedSolid::triangles(std::uint64_t first, std::span<Triangle> out) const {
  const std::uint64_t top =
      first < top_triangles_ ? std::min<std::uint64_t>(out.size(), top_triangles_ - first) : 0;
  grid_.triangles(first, out.first(top));
  for (std::size_t i = top; i < out.size(); ++i)
    out[i] = own_triangles_[first + i - top_triangles_];
}

void ShapedSolid::corners(std::uint64_t first, std::span<Corners> out) const {
  const std::uint64_t top =
      first < top_triangles_ ? std::min<std::uint64_t>(out.size(), top_triangles_ - first) : 0;
  if (top > 0) grid_.corners(first, out.first(top));
  for (std::size_t i = top; i < out.size(); ++i) {
    const Triangle& t = own_triangles_[first + i - top_triangles_];
    out[i] = {vertex(t[0]), vertex(t[1]), vertex(t[2])};
  }
}

Result<MeshCertificate> ShapedSolid::certify(const RunContext& run) const {
  MAQUETTE_TRY(MeshCertificate c, grid_.certify(CoordinateRounding::none, run));
  c.proof = "graph of a height above one below";
  c.vertices = vertex_count();
  c.triangles = triangle_count();
  c.volume_mm3 -= removed_mm3_;
  const auto area = [](const Corners& t) { return 0.5 * norm(cross(t[1] - t[0], t[2] - t[0])); };
  // Walls are the plain solid's, the base is not.
  std::vector<Corners> plain(grid_.triangle_count() - top_triangles_);
  grid_.corners(top_triangles_, plain);
  for (const Corners& t : plain) c.area_mm2 -= area(t);
  for (const Triangle& t : own_triangles_)
    c.area_mm2 += area({vertex(t[0]), vertex(t[1]), vertex(t[2])});
  return c;
}

std::uint64_t top_triangles(const TriMesh& solid, const heightmap::ModelField& surface) {
  const std::uint64_t rim = rim_of(all_nodes(surface));
  MAQUETTE_CHECK(solid.vertices_mm.size() > rim && solid.triangles.size() > kPerEdge * rim,
                 "no solid of this surface");
  return solid.triangles.size() - kPerEdge * rim;
}

TriMesh shaped(TriMesh solid, const heightmap::ModelField& surface, const Shaping& shaping) {
  const std::uint64_t rim = rim_of(all_nodes(surface)), top = top_triangles(solid, surface);
  const std::vector<MeshStream::Triangle> walls(
      solid.triangles.begin() + static_cast<std::ptrdiff_t>(top), solid.triangles.end());
  solid.triangles.resize(top);
  solid.vertices_mm.pop_back();  // the middle of the plain base
  const Below below = close_below(walls, solid.vertices_mm.size() - rim, shaping);
  solid.triangles.insert(solid.triangles.end(), below.triangles.begin(), below.triangles.end());
  solid.vertices_mm.insert(solid.vertices_mm.end(), below.vertices.begin(), below.vertices.end());
  return solid;
}

}  // namespace maquette::meshing

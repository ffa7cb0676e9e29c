// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/shaped_solid.hpp"

#include <algorithm>

#include "core/check.hpp"

namespace maquette::meshing {
namespace {

/// Of the plain solid's three triangles at each edge of the outline the third is the base's.
constexpr std::uint64_t kPerEdge = 3;

std::uint64_t rim_of(const heightmap::ModelField& surface) {
  return 2 * static_cast<std::uint64_t>(surface.z_mm.rows() + surface.z_mm.cols() - 2);
}

/// Walls, then the underside, whose own vertices follow the rim's.
void close_below(std::span<const MeshStream::Triangle> walls_and_base, std::uint64_t first_of_rim,
                 const Underside& under, std::vector<MeshStream::Triangle>& out) {
  for (std::size_t i = 0; i < walls_and_base.size(); ++i)
    if (i % kPerEdge != kPerEdge - 1) out.push_back(walls_and_base[i]);
  const auto shift = static_cast<std::uint32_t>(first_of_rim);
  for (const auto& t : under.mesh.triangles)
    out.push_back({t[0] + shift, t[1] + shift, t[2] + shift});
}

}  // namespace

Result<ShapedSolid> ShapedSolid::create(const heightmap::ModelField& surface,
                                        const SolidOptions& options, const Underside& under) {
  MAQUETTE_TRY(const GridSolidStream grid, GridSolidStream::create(surface, options));
  const std::uint64_t rim = rim_of(surface), plain = grid.triangle_count();
  MAQUETTE_CHECK(under.rim_vertices == rim, "{} of {} vertices of the rim", under.rim_vertices,
                 rim);
  ShapedSolid solid(grid, plain - kPerEdge * rim, grid.vertex_count() - 1);
  MAQUETTE_CHECK(solid.shared_vertices_ + under.mesh.vertices_mm.size() < 0xF0000000U,
                 "{} vertices: more than 32 bit indices reach", under.mesh.vertices_mm.size());
  std::vector<Triangle> walls(kPerEdge * rim);
  grid.triangles(solid.top_triangles_, walls);
  close_below(walls, solid.shared_vertices_ - rim, under, solid.own_triangles_);
  solid.own_vertices_.assign(under.mesh.vertices_mm.begin() + static_cast<std::ptrdiff_t>(rim),
                             under.mesh.vertices_mm.end());
  solid.base_z_mm_ = options.base_z.value();
  solid.removed_mm3_ = under.volume_mm3;
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

TriMesh with_underside(TriMesh solid, const heightmap::ModelField& surface,
                       const Underside& under) {
  const std::uint64_t rim = rim_of(surface);
  MAQUETTE_CHECK(solid.vertices_mm.size() > rim && solid.triangles.size() > kPerEdge * rim &&
                     under.rim_vertices == rim,
                 "no solid of this surface");
  const std::vector<MeshStream::Triangle> walls(
      solid.triangles.end() - static_cast<std::ptrdiff_t>(kPerEdge * rim), solid.triangles.end());
  solid.triangles.resize(solid.triangles.size() - walls.size());
  solid.vertices_mm.pop_back();  // the middle of the plain base
  close_below(walls, solid.vertices_mm.size() - rim, under, solid.triangles);
  solid.vertices_mm.insert(solid.vertices_mm.end(),
                           under.mesh.vertices_mm.begin() + static_cast<std::ptrdiff_t>(rim),
                           under.mesh.vertices_mm.end());
  return solid;
}

}  // namespace maquette::meshing

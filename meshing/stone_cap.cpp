// SPDX-License-Identifier: GPL-3.0-or-later
// Terrain and stones as narrow-band level sets, their union, and its dual contour
// near the stones: Museth, "VDB: high-resolution sparse volumes with dynamic
// topology", ACM Trans. Graph. 32(3), 2013, doi:10.1145/2487228.2487235; contouring
// in OpenVDB follows Ju et al. 2002, doi:10.1145/566654.566586. The fillet is the
// polynomial smooth minimum of Quilez.

#include "meshing/detail/stone_cap.hpp"

#include <numeric>

#include <fmt/format.h>
#include <openvdb/openvdb.h>
#include <openvdb/tools/Composite.h>
#include <openvdb/tools/Interpolation.h>
#include <openvdb/tools/MeshToVolume.h>
#include <openvdb/tools/VolumeToMesh.h>

#include "meshing/detail/terrain_level_set.hpp"

namespace maquette::meshing::detail {
namespace {

using heightmap::ModelField;
using openvdb::FloatGrid;
using Quad = std::array<std::uint32_t, 4>;

constexpr int kCollarRings = 2;

LatticeBox lattice_box(const ModelField& field, const StoneCluster& cluster,
                       const Lattice& lattice) {
  Box3 around;
  for (const TriMesh* stone : cluster.stones)
    for (const Vec3& v : stone->vertices_mm) around.add(v);
  const double voxel = lattice.voxel_mm;
  const double margin = kMarginVoxels * voxel;
  LatticeBox box;
  // On a node of the field, so that lattice and field coincide if voxel = spacing.
  const double s = field.spacing.value();
  box.origin_mm.x =
      field.x0.value() + s * std::floor((around.min.x - margin - field.x0.value()) / s);
  box.origin_mm.y =
      field.y0.value() + s * std::floor((around.min.y - margin - field.y0.value()) / s);
  // Terrain that is lower than the stone leaves the box through its bottom, far
  // from the stone; a plane of lattice nodes should not lie in level ground.
  box.origin_mm.z = around.min.z - margin;
  box.origin_mm += lattice.shift * voxel * Vec3{1.0, 1.0, 0.618};
  const auto count = [&](double from, double to) {
    return static_cast<int>(std::ceil((to + margin - from) / voxel)) + 1;
  };
  box.nodes = {count(box.origin_mm.x, around.max.x), count(box.origin_mm.y, around.max.y),
               count(box.origin_mm.z, around.max.z)};
  return box;
}

FloatGrid::Ptr stone_level_set(const TriMesh& stone, const LatticeBox& box, double voxel) {
  std::vector<openvdb::Vec3s> points;
  points.reserve(stone.vertices_mm.size());
  for (const Vec3& v : stone.vertices_mm) {
    const Vec3 p = v - box.origin_mm;
    points.emplace_back(static_cast<float>(p.x), static_cast<float>(p.y), static_cast<float>(p.z));
  }
  std::vector<openvdb::Vec3I> triangles;
  triangles.reserve(stone.triangles.size());
  for (const auto& t : stone.triangles) triangles.emplace_back(t[0], t[1], t[2]);
  return openvdb::tools::meshToLevelSet<FloatGrid>(
      *openvdb::math::Transform::createLinearTransform(voxel), points, triangles, kBandVoxels);
}

FloatGrid::Ptr filleted_union(const FloatGrid& a, const FloatGrid& b, double voxel) {
  FloatGrid::Ptr both = openvdb::tools::csgUnionCopy(a, b);
  const auto width = static_cast<float>(kFilletVoxels * voxel);
  const auto in_a = a.getConstAccessor();
  const auto in_b = b.getConstAccessor();
  for (auto it = both->beginValueOn(); it; ++it) {
    const float da = in_a.getValue(it.getCoord());
    const float db = in_b.getValue(it.getCoord());
    const float apart = std::abs(da - db);
    if (apart < width)
      it.setValue(std::min(da, db) - (width - apart) * (width - apart) / (4.0F * width));
  }
  return both;
}

struct Contour {
  std::vector<Vec3> points_mm;
  std::vector<Quad> quads;  ///< a triangle repeats its last corner
};

Contour contour(const FloatGrid& grid, Vec3 origin_mm) {
  openvdb::tools::VolumeToMesh mesher(0.0, 0.0);
  mesher(grid);
  Contour out;
  for (std::size_t i = 0; i < mesher.pointListSize(); ++i) {
    const openvdb::Vec3s& p = mesher.pointList()[i];
    out.points_mm.push_back(origin_mm + Vec3{p.x(), p.y(), p.z()});
  }
  // OpenVDB turns its polygons clockwise seen from outside.
  for (std::size_t i = 0; i < mesher.polygonPoolListSize(); ++i) {
    const openvdb::tools::PolygonPool& pool = mesher.polygonPoolList()[i];
    for (std::size_t n = 0; n < pool.numQuads(); ++n) {
      const openvdb::Vec4I& q = pool.quad(n);
      out.quads.push_back({q[3], q[2], q[1], q[0]});
    }
    for (std::size_t n = 0; n < pool.numTriangles(); ++n) {
      const openvdb::Vec3I& t = pool.triangle(n);
      out.quads.push_back({t[2], t[1], t[0], t[0]});
    }
  }
  return out;
}

/// Edges of the chosen quads without a partner.
std::vector<std::array<std::uint32_t, 2>> border_edges(const std::vector<Quad>& quads,
                                                       const std::vector<char>& chosen) {
  std::vector<std::array<std::uint32_t, 4>> edges;  // low, high, from, to
  for (std::size_t q = 0; q < quads.size(); ++q) {
    if (!chosen[q]) continue;
    for (std::size_t i = 0; i < 4; ++i) {
      const std::uint32_t a = quads[q][i];
      const std::uint32_t b = quads[q][(i + 1) % 4];
      if (a != b) edges.push_back({std::min(a, b), std::max(a, b), a, b});
    }
  }
  std::sort(edges.begin(), edges.end());
  std::vector<std::array<std::uint32_t, 2>> border;
  for (std::size_t i = 0; i < edges.size();) {
    std::size_t j = i + 1;
    while (j < edges.size() && edges[j][0] == edges[i][0] && edges[j][1] == edges[i][1]) ++j;
    if (j == i + 1) border.push_back({edges[i][2], edges[i][3]});
    i = j;
  }
  return border;
}

/// All quads with a vertex that is not terrain, `kCollarRings` round them, and more
/// where the border would touch itself.
std::vector<char> choose_quads(const Contour& all, const std::vector<char>& is_terrain) {
  std::vector<char> near(all.points_mm.size());
  for (std::size_t v = 0; v < near.size(); ++v) near[v] = !is_terrain[v];
  std::vector<char> chosen(all.quads.size(), 0);
  const auto grow = [&](bool mark) {
    bool grew = false;
    for (std::size_t q = 0; q < chosen.size(); ++q) {
      const Quad& c = all.quads[q];
      if (chosen[q] || !(near[c[0]] || near[c[1]] || near[c[2]] || near[c[3]])) continue;
      chosen[q] = 1;
      grew = true;
    }
    if (mark)
      for (std::size_t q = 0; q < chosen.size(); ++q)
        if (chosen[q])
          for (const std::uint32_t v : all.quads[q]) near[v] = 1;
    return grew;
  };
  for (int ring = 0; ring <= kCollarRings; ++ring) grow(ring < kCollarRings);
  for (;;) {
    std::vector<std::uint8_t> leaving(all.points_mm.size(), 0);
    for (const auto& e : border_edges(all.quads, chosen)) ++leaving[e[0]];
    std::fill(near.begin(), near.end(), 0);
    for (std::size_t v = 0; v < near.size(); ++v) near[v] = leaving[v] > 1;
    if (!grow(false)) return chosen;
  }
}

/// Drops closed pieces: pockets of air under a stone are filled. A closed piece that
/// is solid hangs in the air; bits under three voxels are artefacts and go too.
/// @return false if something hangs in the air
bool drop_closed_pieces(const Contour& all, double voxel, std::vector<char>& chosen) {
  std::vector<std::uint32_t> parent(all.points_mm.size());
  std::iota(parent.begin(), parent.end(), 0U);
  const auto root = [&](std::uint32_t v) {
    while (parent[v] != v) v = parent[v] = parent[parent[v]];
    return v;
  };
  for (std::size_t q = 0; q < chosen.size(); ++q)
    if (chosen[q])
      for (const std::uint32_t v : all.quads[q]) parent[root(v)] = root(all.quads[q][0]);
  std::vector<char> open(all.points_mm.size(), 0);
  for (const auto& e : border_edges(all.quads, chosen)) open[root(e[0])] = 1;
  std::vector<double> volume(all.points_mm.size(), 0.0);
  std::vector<Box3> bounds(all.points_mm.size());
  for (std::size_t q = 0; q < chosen.size(); ++q) {
    if (!chosen[q]) continue;
    const Quad& c = all.quads[q];
    const std::uint32_t piece = root(c[0]);
    const auto p = [&](std::size_t i) { return all.points_mm[c[i]] - all.points_mm[piece]; };
    volume[piece] += dot(p(0), cross(p(1), p(2))) + dot(p(0), cross(p(2), p(3)));
    for (const std::uint32_t v : c) bounds[piece].add(all.points_mm[v]);
  }
  for (std::size_t v = 0; v < volume.size(); ++v) {
    if (open[v] || bounds[v].empty() || volume[v] <= 0.0) continue;
    const Vec3 size = bounds[v].max - bounds[v].min;
    if (std::fmax(size.x, std::fmax(size.y, size.z)) >= 3.0 * voxel) return false;
  }
  for (std::size_t q = 0; q < chosen.size(); ++q)
    if (chosen[q] && !open[root(all.quads[q][0])]) chosen[q] = 0;
  return true;
}

/// Cuts a quad along the diagonal that bends less, so that no triangle turns over.
void split(const Contour& all, const Quad& q, std::vector<std::array<std::uint32_t, 3>>& out) {
  const auto normal = [&](std::size_t a, std::size_t b, std::size_t c) {
    const Vec3 n =
        cross(all.points_mm[q[b]] - all.points_mm[q[a]], all.points_mm[q[c]] - all.points_mm[q[a]]);
    return (1.0 / std::fmax(norm(n), 1e-300)) * n;
  };
  if (q[3] == q[2]) {
    out.push_back({q[0], q[1], q[2]});
  } else if (dot(normal(0, 1, 2), normal(0, 2, 3)) >= dot(normal(0, 1, 3), normal(1, 2, 3))) {
    out.push_back({q[0], q[1], q[2]});
    out.push_back({q[0], q[2], q[3]});
  } else {
    out.push_back({q[0], q[1], q[3]});
    out.push_back({q[1], q[2], q[3]});
  }
}

/// The chosen part with vertices in the order of their places and triangles in the
/// order of their vertices: nothing of the order in which threads found them is left.
StoneCap canonical_cap(Contour all, const std::vector<Vec3>& projected_mm,
                       const std::vector<char>& chosen) {
  std::vector<std::uint32_t> order;
  {
    std::vector<char> used(all.points_mm.size(), 0);
    for (std::size_t q = 0; q < chosen.size(); ++q)
      if (chosen[q])
        for (const std::uint32_t v : all.quads[q]) used[v] = 1;
    for (std::uint32_t v = 0; v < used.size(); ++v)
      if (used[v]) order.push_back(v);
  }
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    const Vec3 &p = all.points_mm[a], &q = all.points_mm[b];
    return std::array{p.y, p.x, p.z} < std::array{q.y, q.x, q.z};
  });
  StoneCap cap;
  std::vector<std::uint32_t> renamed(all.points_mm.size(), 0);
  for (std::uint32_t i = 0; i < order.size(); ++i) {
    renamed[order[i]] = i;
    cap.contoured_mm.push_back(all.points_mm[order[i]]);
    cap.projected_mm.push_back(projected_mm[order[i]]);
  }
  std::vector<Quad> kept;
  for (std::size_t q = 0; q < chosen.size(); ++q) {
    if (!chosen[q]) continue;
    Quad c = all.quads[q];
    for (std::uint32_t& v : c) v = renamed[v];
    if (c[3] != c[2]) std::rotate(c.begin(), std::min_element(c.begin(), c.end()), c.end());
    kept.push_back(c);
  }
  std::sort(kept.begin(), kept.end());
  cap.rim = border_edges(kept, std::vector<char>(kept.size(), 1));
  all.points_mm = cap.contoured_mm;
  for (const Quad& q : kept) split(all, q, cap.triangles);
  return cap;
}

}  // namespace

Result<StoneCap> contour_stones(const ModelField& surface, const StoneCluster& cluster,
                                const Lattice& lattice) try {
  openvdb::initialize();
  const double voxel = lattice.voxel_mm;
  const LatticeBox box = lattice_box(surface, cluster, lattice);
  const FloatGrid::Ptr terrain = terrain_level_set(surface, box, voxel);
  FloatGrid::Ptr whole = terrain;
  for (const TriMesh* stone : cluster.stones)
    whole = filleted_union(*whole, *stone_level_set(*stone, box, voxel), voxel);
  Contour all = contour(*whole, box.origin_mm);
  whole.reset();

  const StoneDistance stones(cluster.stones);
  const double fillet = kFilletVoxels * voxel;
  const auto in_terrain = terrain->getConstAccessor();
  std::vector<char> is_terrain(all.points_mm.size(), 0);
  std::vector<Vec3> projected = all.points_mm;
  for (std::size_t v = 0; v < projected.size(); ++v) {
    const Vec3 p = all.points_mm[v];
    const Vec3 at = (1.0 / voxel) * (p - box.origin_mm);
    const double to_terrain = std::abs(static_cast<double>(
        openvdb::tools::BoxSampler::sample(in_terrain, openvdb::Vec3R(at.x, at.y, at.z))));
    const StoneDistance::Nearest stone = stones.nearest(p);
    if (to_terrain <= stone.distance_mm - fillet) {
      is_terrain[v] = 1;
      projected[v].z = clamped_height(surface, p.x, p.y);
    } else if (stone.distance_mm <= std::fmin(to_terrain, stone.second_distance_mm) - fillet &&
               stone.distance_mm <= voxel) {
      projected[v] = stone.point_mm;
    }
  }
  std::vector<char> chosen = choose_quads(all, is_terrain);
  if (!drop_closed_pieces(all, voxel, chosen)) return fail(kNotASolid, std::string(kHangsInTheAir));
  return canonical_cap(std::move(all), projected, chosen);
} catch (const std::bad_alloc&) {
  return fail(kVoxelTooSmall, fmt::format("memory ran out at a voxel of {} mm; choose a larger one",
                                          lattice.voxel_mm));
} catch (const std::exception& e) {
  return fail(kNotASolid, fmt::format("OpenVDB could not unite stones and terrain: {}", e.what()));
}

}  // namespace maquette::meshing::detail

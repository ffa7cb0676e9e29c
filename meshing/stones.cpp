// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/stones.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <optional>

#include <oneapi/tbb/parallel_for.h>

#include "core/check.hpp"

namespace maquette::meshing {
namespace {

using heightmap::ModelField;

/// z = z0 + slope_x (x - x0) + slope_y (y - y0), (x0, y0) being the stone's position.
struct Plane {
  double z0 = 0.0, slope_x = 0.0, slope_y = 0.0;
};

struct NodeRange {
  std::ptrdiff_t first = 0, last = -1;
};

/// Nodes within from .. to (in node units), clipped to the field.
NodeRange nodes_between(double from, double to, std::ptrdiff_t count) {
  const auto end = static_cast<double>(count - 1);
  return {static_cast<std::ptrdiff_t>(std::clamp(std::ceil(from), 0.0, end + 1.0)),
          static_cast<std::ptrdiff_t>(std::clamp(std::floor(to), -1.0, end))};
}

/// Least squares over the nodes within `radius_mm`; nothing if one of them is void.
/// Centred on the mean first, so that a footprint far from the origin loses no digits.
/// @pre the position lies on the field and radius_mm >= 1.5 spacings: then the corners
///      of its cell are among the nodes and the system is regular
std::optional<Plane> fit_plane(const ModelField& f, double x_mm, double y_mm, double radius_mm) {
  const double s = f.spacing.value();
  const double u = (x_mm - f.x0.value()) / s, v = (y_mm - f.y0.value()) / s, r = radius_mm / s;
  const NodeRange rows = nodes_between(v - r, v + r, f.z_mm.rows());
  const auto for_each_node = [&](auto&& visit) {
    for (std::ptrdiff_t row = rows.first; row <= rows.last; ++row) {
      const double dv = static_cast<double>(row) - v;
      const double half = std::sqrt(std::fmax(0.0, r * r - dv * dv));
      const NodeRange cols = nodes_between(u - half, u + half, f.z_mm.cols());
      for (std::ptrdiff_t col = cols.first; col <= cols.last; ++col)
        visit(s * (static_cast<double>(col) - u), s * dv, static_cast<double>(f.z_mm(row, col)));
    }
  };
  double n = 0.0, mx = 0.0, my = 0.0, mz = 0.0;
  for_each_node([&](double x, double y, double z) { n += 1.0, mx += x, my += y, mz += z; });
  mx /= n, my /= n, mz /= n;
  if (!std::isfinite(mz)) return std::nullopt;
  double xx = 0.0, xy = 0.0, yy = 0.0, xz = 0.0, yz = 0.0;
  for_each_node([&](double x, double y, double z) {
    x -= mx, y -= my, z -= mz;
    xx += x * x, xy += x * y, yy += y * y, xz += x * z, yz += y * z;
  });
  const double det = xx * yy - xy * xy;
  Plane plane;
  plane.slope_x = (xz * yy - yz * xy) / det;
  plane.slope_y = (yz * xx - xz * xy) / det;
  plane.z0 = mz - plane.slope_x * mx - plane.slope_y * my;
  return plane;
}

/// Turns the vertical onto `normal` the shortest way, after the heading.
Quaternion lay_rotation(Vec3 normal, Radians heading) {
  const Quaternion tilt = normalized(Quaternion{1.0 + normal.z, -normal.y, normal.x, 0.0});
  return normalized(tilt * rotation_about({0, 0, 1}, heading.value()));
}

std::optional<PlacedStone> lay_one(const SiteStone& stone, const ModelField& surface, double x_mm,
                                   double y_mm, double scale_mm, double embedded_share) {
  const double x_end = surface.x_mm(surface.z_mm.cols() - 1);
  const double y_end = surface.y_mm(surface.z_mm.rows() - 1);
  if (!(x_mm >= surface.x0.value() && x_mm <= x_end && y_mm >= surface.y0.value() && y_mm <= y_end))
    return std::nullopt;
  const TriMesh rock = unit_stone(stone.shape, stone.body);
  double footprint_mm = 0.0;
  for (const Vec3& v : rock.vertices_mm)
    footprint_mm = std::fmax(footprint_mm, scale_mm * std::hypot(v.x, v.y));
  const double spacing = surface.spacing.value();
  const auto plane = fit_plane(surface, x_mm, y_mm, std::fmax(footprint_mm, 1.5 * spacing));
  if (!plane) return std::nullopt;

  const Box3 box = rock.bounds();
  const Vec3 normal = normalized(Vec3{-plane->slope_x, -plane->slope_y, 1.0});
  // Distance of the origin from the plane along its normal; upright above the site
  // position that is a height of distance / normal.z.
  const double distance_mm = scale_mm * (-box.min.z - embedded_share * (box.max.z - box.min.z));
  PlacedStone placed{
      .number = stone.number,
      .shape = stone.shape,
      .body = stone.body,
      .scale_mm = scale_mm,
      .model_from_stone = {.rotation = lay_rotation(normal, stone.heading),
                           .translation_mm = {x_mm, y_mm, plane->z0 + distance_mm / normal.z}}};

  const double rim_z = box.min.z + embedded_share * (box.max.z - box.min.z);
  double gap_mm = 0.0;
  Vec3 lowest{0, 0, INFINITY};
  for (const Vec3& v : rock.vertices_mm) {
    const Vec3 p = placed.model_from_stone.point(scale_mm * v);
    const double ground = heightmap::height_at(surface, p.x, p.y);
    if (std::isnan(ground)) return std::nullopt;  // over the border or over a void
    if (v.z <= rim_z) gap_mm = std::fmax(gap_mm, p.z - ground);
    if (p.z < lowest.z) lowest = p;
  }
  placed.model_from_stone.translation_mm.z -= gap_mm;
  placed.embedded_depth_mm =
      heightmap::height_at(surface, lowest.x, lowest.y) - (lowest.z - gap_mm);
  return placed;
}

/// Twice the signed area of (a, b, p). The same two ends in any order give the same
/// bits with opposite sign, so that no node falls between two neighbouring triangles.
double edge_side(Vec3 a, Vec3 b, double x, double y) {
  const bool swapped = b.x < a.x || (b.x == a.x && b.y < a.y);
  if (swapped) std::swap(a, b);
  const double side = (b.x - a.x) * (y - a.y) - (b.y - a.y) * (x - a.x);
  return swapped ? -side : side;
}

void raise_to_triangle(ModelField& f, Vec3 a, Vec3 b, Vec3 c) {
  if (!(edge_side(a, b, c.x, c.y) > 0.0)) return;  // seen from below or edge-on
  const double s = f.spacing.value();
  const auto range = [s](double p, double q, double r, double origin, std::ptrdiff_t count) {
    // Half a node of slack: edge_side decides, this only bounds the search.
    return nodes_between((std::min({p, q, r}) - origin) / s - 0.5,
                         (std::max({p, q, r}) - origin) / s + 0.5, count);
  };
  const NodeRange rows = range(a.y, b.y, c.y, f.y0.value(), f.z_mm.rows());
  const NodeRange cols = range(a.x, b.x, c.x, f.x0.value(), f.z_mm.cols());
  for (std::ptrdiff_t row = rows.first; row <= rows.last; ++row) {
    const double y = f.y_mm(row);
    for (std::ptrdiff_t col = cols.first; col <= cols.last; ++col) {
      const double x = f.x_mm(col);
      const double wa = edge_side(b, c, x, y), wb = edge_side(c, a, x, y),
                   wc = edge_side(a, b, x, y);
      if (wa < 0.0 || wb < 0.0 || wc < 0.0) continue;
      const double total = wa + wb + wc;
      if (!(total > 0.0)) continue;
      const auto z = static_cast<float>((wa * a.z + wb * b.z + wc * c.z) / total);
      float& node = f.z_mm(row, col);
      if (z > node) node = z;  // false for a void
    }
  }
}

}  // namespace

std::vector<PlacedStone> lay_stones(std::span<const SiteStone> stones, const ModelField& surface,
                                    const ModelScale& scale, double east_of_x0_m,
                                    double north_of_y0_m, double embedded_share) {
  MAQUETTE_CHECK(embedded_share >= 0.0 && embedded_share <= 1.0, "{}", embedded_share);
  MAQUETTE_CHECK(surface.z_mm.rows() >= 2 && surface.z_mm.cols() >= 2, "{} x {} nodes",
                 surface.z_mm.rows(), surface.z_mm.cols());
  std::vector<std::optional<PlacedStone>> laid(stones.size());
  tbb::parallel_for(std::size_t{0}, stones.size(), [&](std::size_t i) {
    const SiteStone& stone = stones[i];
    laid[i] = lay_one(stone, surface, scale.horizontal(Metres{stone.east_m - east_of_x0_m}).value(),
                      scale.horizontal(Metres{stone.north_m - north_of_y0_m}).value(),
                      scale.horizontal(stone.diameter).value(), embedded_share);
  });
  std::vector<PlacedStone> all;
  for (const auto& stone : laid)
    if (stone) all.push_back(*stone);
  return all;
}

bool same_shape(const PlacedStone& a, const PlacedStone& b) {
  if (a.body == nullptr || b.body == nullptr) return a.body == b.body && a.shape == b.shape;
  return a.body == b.body || *a.body == *b.body;
}

bool operator==(const PlacedStone& a, const PlacedStone& b) {
  return a.number == b.number && same_shape(a, b) && a.scale_mm == b.scale_mm &&
         a.model_from_stone == b.model_from_stone && a.embedded_depth_mm == b.embedded_depth_mm;
}

TriMesh unit_stone(const assets::RockShape& shape, const StoneBodyPtr& body) {
  return body != nullptr ? body->mesh : assets::make_rock(shape);
}

TriMesh stone_mesh(const PlacedStone& stone) {
  TriMesh mesh = unit_stone(stone.shape, stone.body);
  for (Vec3& v : mesh.vertices_mm) v = stone.model_from_stone.point(stone.scale_mm * v);
  return mesh;
}

ModelField with_stones(const ModelField& surface, std::span<const PlacedStone> stones) {
  std::vector<TriMesh> meshes(stones.size());
  tbb::parallel_for(std::size_t{0}, stones.size(),
                    [&](std::size_t i) { meshes[i] = stone_mesh(stones[i]); });
  ModelField raised = surface;
  for (const TriMesh& m : meshes)
    for (const auto& [a, b, c] : m.triangles)
      raise_to_triangle(raised, m.vertices_mm[a], m.vertices_mm[b], m.vertices_mm[c]);
  return raised;
}

}  // namespace maquette::meshing

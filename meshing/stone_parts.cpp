// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/stone_parts.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <optional>
#include <string>
#include <tuple>

#include <fmt/format.h>
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_reduce.h>

#include "core/check.hpp"
#include "meshing/detail/stone_cap.hpp"

namespace maquette::meshing {
namespace {

using detail::StoneDistance;

/// Vertices are brought so near to the wanted distance.
constexpr double kReached_mm = 1e-6;
/// Steps shrink by 1 - cos of the angle between ray and normal: at 80 degrees 200 steps still end
/// with 1e-16 of the first one.
constexpr int kMostSteps = 200;

auto key_of(const PlacedStone& stone) {
  const assets::RockShape& s = stone.shape;
  return std::tuple(stone.body != nullptr ? stone.body->name : std::string(), s.seed, s.angularity,
                    s.flatness, s.elongation, s.roughness, s.subdivisions);
}

/// The first triangle that faces the origin, if any does.
std::optional<std::size_t> facing_origin(const TriMesh& mesh) {
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const auto& [a, b, c] = mesh.triangles[i];
    if (!(dot(mesh.vertices_mm[a], cross(mesh.vertices_mm[b], mesh.vertices_mm[c])) > 0.0))
      return i;
  }
  return std::nullopt;
}

/// Share of the way to the origin that is left once the distance to the surface is `wanted_mm`;
/// below 0 if it never is.
double share_left(const StoneDistance& surface, Vec3 vertex, double wanted_mm) {
  const double radius = norm(vertex);
  double way = 0.0;
  for (int step = 0; step < kMostSteps; ++step) {
    const double missing = wanted_mm - surface.nearest((1.0 - way / radius) * vertex).distance_mm;
    if (missing <= kReached_mm) break;
    way += missing;
    if (way >= radius) return -1.0;
  }
  return 1.0 - way / radius;
}

ClearanceRange joined(const ClearanceRange& a, const ClearanceRange& b) {
  return {std::fmin(a.least_mm, b.least_mm), std::fmax(a.most_mm, b.most_mm)};
}

}  // namespace

std::vector<CatalogueStone> stone_catalogue(std::span<const PlacedStone> stones) {
  const auto kind = [](const PlacedStone& s) { return std::tuple(-s.scale_mm, key_of(s)); };
  std::vector<const PlacedStone*> order;
  for (const PlacedStone& s : stones) order.push_back(&s);
  std::sort(order.begin(), order.end(), [&](const PlacedStone* a, const PlacedStone* b) {
    return std::tuple(kind(*a), a->number) < std::tuple(kind(*b), b->number);
  });
  std::vector<CatalogueStone> catalogue;
  std::map<decltype(key_of(PlacedStone{})), int> shapes;
  for (std::size_t i = 0; i < order.size(); ++i) {
    const PlacedStone& s = *order[i];
    if (i == 0 || kind(s) != kind(*order[i - 1])) {
      const auto [shape, is_new] =
          shapes.try_emplace(key_of(s), static_cast<int>(shapes.size()) + 1);
      catalogue.push_back({.part_number = fmt::format("S{:03}", catalogue.size() + 1),
                           .shape_number = shape->second,
                           .shape = s.shape,
                           .body = s.body,
                           .scale_mm = s.scale_mm,
                           .places = {}});
    }
    catalogue.back().places.push_back(static_cast<std::size_t>(order[i] - stones.data()));
  }
  return catalogue;
}

Result<TriMesh> shrink_stone(const TriMesh& stone, Millimetres clearance) {
  MAQUETTE_CHECK(clearance.value() >= 0.0, "{}", clearance.value());
  TriMesh shrunk = stone;
  if (clearance.value() == 0.0) return shrunk;
  if (const auto facing = facing_origin(stone)) {
    const Vec3 at = stone.vertices_mm[stone.triangles[*facing][0]];
    return fail(kStoneFolds,
                fmt::format("a stone folds: seen from its middle not all of its surface shows (at "
                            "x {:.3f} y {:.3f} z {:.3f} mm from there), so that it cannot be made "
                            "smaller by a clearance; take a clearance of 0, or a body without "
                            "overhangs",
                            at.x, at.y, at.z));
  }
  const TriMesh* const body = &stone;
  const StoneDistance surface({&body, 1});
  for (Vec3& v : shrunk.vertices_mm) {
    const double left = share_left(surface, v, clearance.value());
    if (left < 0.0) {
      const Box3 box = stone.bounds();
      return fail(kStoneVanishes,
                  fmt::format("nothing is left of a stone of {:.3f} x {:.3f} x {:.3f} mm with a "
                              "clearance of {} mm on every side; choose a smaller one",
                              box.max.x - box.min.x, box.max.y - box.min.y, box.max.z - box.min.z,
                              clearance.value()));
    }
    v = left * v;
  }
  return shrunk;
}

ClearanceRange clearance_of(const TriMesh& shrunk, const TriMesh& designed) {
  const TriMesh* const body = &designed;
  const StoneDistance surface({&body, 1});
  const auto look = [&](ClearanceRange range, Vec3 p) {
    const double d = surface.nearest(p).distance_mm;
    return ClearanceRange{std::fmin(range.least_mm, d), std::fmax(range.most_mm, d)};
  };
  using Range = oneapi::tbb::blocked_range<std::size_t>;
  const auto over = [](std::size_t count, const auto& each) {
    return oneapi::tbb::parallel_reduce(
        Range(0, count), ClearanceRange{INFINITY, 0.0},
        [&](const Range& some, ClearanceRange range) {
          for (std::size_t i = some.begin(); i < some.end(); ++i) range = each(range, i);
          return range;
        },
        joined);
  };
  const auto vertices = over(shrunk.vertices_mm.size(), [&](ClearanceRange range, std::size_t i) {
    return look(range, shrunk.vertices_mm[i]);
  });
  return joined(vertices, over(shrunk.triangles.size(), [&](ClearanceRange range, std::size_t t) {
                  const auto& [i, j, k] = shrunk.triangles[t];
                  const Vec3 a = shrunk.vertices_mm[i], b = shrunk.vertices_mm[j],
                             c = shrunk.vertices_mm[k];
                  range = look(range, (1.0 / 3.0) * (a + b + c));
                  // Each edge once: its other triangle has it turned round.
                  if (i < j) range = look(range, 0.5 * (a + b));
                  if (j < k) range = look(range, 0.5 * (b + c));
                  if (k < i) range = look(range, 0.5 * (c + a));
                  return range;
                }));
}

double thinner_than_wall_mm(const TriMesh& stone, Millimetres wall) {
  MAQUETTE_CHECK(wall.value() > 0.0, "{}", wall.value());
  const double radius_mm = 0.5 * wall.value();
  const auto centres = shrink_stone(stone, Millimetres{radius_mm});
  if (!centres) return centres.error().code == kStoneFolds ? NAN : INFINITY;
  const TriMesh* const body = &*centres;
  const StoneDistance reach({&body, 1});
  double most = 0.0;
  for (const Vec3& v : stone.vertices_mm)
    most = std::fmax(most, reach.nearest(v).distance_mm - radius_mm);
  return most;
}

}  // namespace maquette::meshing

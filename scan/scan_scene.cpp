// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/scan_scene.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include <fmt/format.h>

#include "scan/detail/profile_walk.hpp"
#include "scan/scanner_sim.hpp"

namespace maquette::scan::detail {
namespace {

using heightmap::ModelField;

// A point that a ray has found is looked at from elsewhere: rounding may put it this far
// behind its own triangle.
constexpr double kSamePointMm = 1e-3;

/// @param top  of the surface
/// @return distance at which the ray enters the part through a wall; infinite if it does not.
double wall_distance(const ModelField& f, double top, Vec3 o, Vec3 d) {
  const double x0 = f.x0.value(), x1 = f.x_mm(f.z_mm.cols() - 1);
  const double y0 = f.y0.value(), y1 = f.y_mm(f.z_mm.rows() - 1);
  double t_in = 0.0, t_out = INFINITY;
  const auto clip = [&](double from, double along, double lo, double hi) {
    if (along == 0.0) {
      if (from < lo || from > hi) t_out = -INFINITY;
      return;
    }
    const double a = (lo - from) / along, b = (hi - from) / along;
    t_in = std::fmax(t_in, std::fmin(a, b));
    t_out = std::fmin(t_out, std::fmax(a, b));
  };
  clip(o.x, d.x, x0, x1);
  clip(o.y, d.y, y0, y1);
  if (!(t_in <= t_out) || t_in == 0.0) return INFINITY;
  const Vec3 p = o + t_in * d;
  if (p.z > top) return INFINITY;
  // Rounding may leave the entry a hair outside.
  const double height = heightmap::height_at(f, std::clamp(p.x, x0, x1), std::clamp(p.y, y0, y1));
  return p.z < height ? t_in : INFINITY;
}

}  // namespace

ScanScene::ScanScene(const ModelField& surface, std::span<const TriMesh> stones, StoneScene scene)
    : surface_(&surface), stones_(stones), stone_scene_(std::move(scene)), tracer_(surface) {
  bounds_ = stone_scene_.bounds();
  const heightmap::HeightRange heights = heightmap::height_range(surface.z_mm);
  if (!(heights.min <= heights.max)) return;
  top_mm_ = static_cast<double>(heights.max);
  whole_ = std::all_of(surface.z_mm.cells().begin(), surface.z_mm.cells().end(),
                       [](float z) { return std::isfinite(z); });
  bounds_.add({surface.x0.value(), surface.y0.value(), static_cast<double>(heights.min)});
  bounds_.add({surface.x_mm(surface.z_mm.cols() - 1), surface.y_mm(surface.z_mm.rows() - 1),
               static_cast<double>(heights.max)});
}

Result<ScanScene> ScanScene::build(const ModelField& surface, std::span<const TriMesh> stones) {
  MAQUETTE_TRY(StoneScene scene, StoneScene::build(stones));
  return ScanScene(surface, stones, std::move(scene));
}

Result<void> ScanScene::check_outside(Vec3 p, std::string_view what) const {
  const double ground = heightmap::height_at(*surface_, p.x, p.y);
  if (ground >= p.z)  // false over a void and beside the part
    return fail(kStationUnderSurface,
                fmt::format("the {} at ({}, {}, {}) mm stands {} mm under the surface", what, p.x,
                            p.y, p.z, ground - p.z));
  for (std::size_t i = 0; i < stones_.size(); ++i)
    if (inside_mesh(stones_[i], p))
      return fail(kStationUnderSurface,
                  fmt::format("the {} at ({}, {}, {}) mm stands inside stone {}", what, p.x, p.y,
                              p.z, i + 1));
  return {};
}

std::optional<Echo> ScanScene::look(Vec3 o, Vec3 d) const {
  return answer(o, d, tracer_.trace(o, d));
}

void ScanScene::look(std::span<const heightmap::FieldTracer::Ray> rays,
                     std::span<std::optional<heightmap::FieldHit>> ground,
                     std::span<std::optional<Echo>> echoes) const {
  tracer_.trace_many(rays, ground);
  for (std::size_t i = 0; i < rays.size(); ++i)
    echoes[i] = answer(rays[i].origin_mm, rays[i].direction, ground[i]);
}

void ScanScene::look_across(Vec3 o, Vec3 horizontal, std::span<const Vec3> directions,
                            std::span<std::optional<Echo>> echoes) const {
  ProfileWalk walk(*surface_, o, horizontal);
  for (std::size_t i = directions.size(); i-- > 0;) {
    const Vec3 d = directions[i];
    const auto ground = walk.hit(dot(d, horizontal), d.z);
    // What meets a wall has no ground: a stone in front of the wall is nearer than it.
    echoes[i] = ground ? answer(o, d, ground, ground->distance_mm)
                       : answer(o, d, ground, wall_distance(*surface_, top_mm_, o, d));
  }
}

std::optional<Echo> ScanScene::answer(Vec3 o, Vec3 d,
                                      const std::optional<heightmap::FieldHit>& ground) const {
  return answer(
      o, d, ground,
      std::fmin(ground ? ground->distance_mm : INFINITY, wall_distance(*surface_, top_mm_, o, d)));
}

std::optional<Echo> ScanScene::answer(Vec3 o, Vec3 d,
                                      const std::optional<heightmap::FieldHit>& ground,
                                      double nearest) const {
  if (const auto stone = stone_scene_.trace(o, d, nearest)) {
    const double facing = -dot(stone->normal, d);
    return Echo{stone->distance_mm, facing < 0.0 ? -stone->normal : stone->normal, std::abs(facing),
                true};
  }
  if (!ground || nearest < ground->distance_mm) return std::nullopt;
  const double cos_incidence = -dot(ground->normal, d);
  // From below: through a void or from under the part.
  if (!(cos_incidence > 0.0)) return std::nullopt;
  return Echo{ground->distance_mm, ground->normal, cos_incidence, false};
}

bool ScanScene::sees(Vec3 from, Vec3 point) const {
  const Vec3 way = point - from;
  const double distance = norm(way);
  if (!(distance > 0.0)) return false;
  const Vec3 d = (1.0 / distance) * way;
  const double limit = distance - kSamePointMm;
  if (const auto ground = tracer_.trace(from, d); ground && ground->distance_mm < limit)
    return false;
  if (wall_distance(*surface_, top_mm_, from, d) < limit) return false;
  return !stone_scene_.trace(from, d, limit).has_value();
}

StationSink into(Cloud& cloud) {
  return [&cloud](const ScanStation& station, const PointBatch& batch) -> Result<void> {
    if (batch.begins_station) {
      cloud.stations.push_back(station);
      cloud.stations.back().points = 0;
      cloud.station_mm = cloud.stations.size() == 1 ? station.position_mm : std::nullopt;
    }
    cloud.stations.back().points += batch.size();
    const RigidTransform& pose = station.model_from_station;
    for (const Vec3& p : batch.points_mm) cloud.points_mm.push_back(pose.point(p));
    for (const Vec3& n : batch.normals) cloud.normals.push_back(pose.direction(n));
    const auto add = [](auto& to, const auto& from) {
      to.insert(to.end(), from.begin(), from.end());
    };
    add(cloud.intensity, batch.intensity);
    add(cloud.colours, batch.colours);
    add(cloud.grid, batch.grid);
    add(cloud.counts, batch.counts);
    add(cloud.spread_mm, batch.spread_mm);
    return {};
  };
}

StationSink into(CloudWriter& writer) {
  return [&writer](const ScanStation& station, const PointBatch& batch) -> Result<void> {
    if (batch.begins_station) MAQUETTE_TRY_VOID(writer.begin_station(station));
    return writer.write(batch);
  };
}

}  // namespace maquette::scan::detail

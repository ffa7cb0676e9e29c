// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>

#include "camera/detail/ray_scene_state.hpp"

// Whether something stands between a surface and a place.

namespace maquette::camera {
namespace {

using detail::clip;
using detail::float_ray;
using detail::kTogether;
using detail::Span;

/// Terrain is traced in double, whose steps are 2^-29 of a float's: a millionth is ample.
constexpr double kFieldShare = 1e-6;

}  // namespace

/// From `off_mm` off each surface, as directions of unit length; relative to `origin`.
detail::RayLanes RayScene::State::ways_of(std::span<const ShadowRay> rays, double off_mm,
                                          Vec3 origin) {
  detail::RayLanes ways;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const Vec3 start = rays[i].point_mm + off_mm * rays[i].normal - origin;
    ways.put(i, start, rays[i].to_mm - origin - start, 0.0);
  }
  for (std::size_t i = rays.size(); i < kTogether; ++i) ways.repeat(0, i);
  for (std::size_t i = 0; i < kTogether; ++i) {
    const double x = ways.way_x[i], y = ways.way_y[i], z = ways.way_z[i];
    const double length = std::sqrt(x * x + y * y + z * z), k = 1.0 / length;
    ways.way_x[i] = k * x, ways.way_y[i] = k * y, ways.way_z[i] = k * z;
    ways.length[i] = length;
  }
  return ways;
}

bool RayScene::State::walls_block(Vec3 start, Vec3 direction, double length) const {
  return !walls.empty && length > offset_mm && may_meet_walls(start, direction, length) &&
         blocked_in(walls, start, direction, length);
}

/// Rays of one packet that are not blocked: Embree is asked only if one of them may come to a mesh.
void RayScene::State::meshes_block(std::span<const ShadowRay> rays, std::span<bool> blocked) const {
  const auto open =
      static_cast<std::size_t>(std::find(blocked.begin(), blocked.end(), false) - blocked.begin());
  if (geometries.empty() || open == rays.size()) return;
  detail::RayLanes ways = ways_of(rays, offset_mm, middle);
  for (std::size_t i = 0; i < kTogether; ++i)
    if (i >= rays.size() || blocked[i]) ways.repeat(open, i);
  const bool near_meshes = !meshes.empty && mesh_boxes.may_meet(detail::BoxTree::Bundle(ways));
  std::array<char, kTogether> within{};
  if (!walls.empty) within = within_walls(ways);
  for (std::size_t i = 0; i < rays.size(); ++i) {
    if (blocked[i]) continue;
    const Vec3 start = ways.origin(i), direction = ways.way(i);
    const double length = ways.length[i];
    blocked[i] =
        (near_meshes && length > offset_mm && blocked_in(meshes, start, direction, length)) ||
        (within[i] == 0 && walls_block(start, direction, length));
  }
}

bool RayScene::State::blocked_in(const Group& group, Vec3 start, Vec3 direction,
                                 double length) const {
  if (group.empty) return false;
  const Span span = clip(group.box, start, direction);
  if (span.enter > span.leave || span.enter > length) return false;
  RTCRay ray = float_ray(start + span.enter * direction, direction,
                         std::min(length, span.leave) - span.enter);
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcOccluded1(group.scene, &context, &ray);
  return ray.tfar < 0.0F;
}

bool RayScene::blocked(const ShadowRay& ray) const {
  bool answer = false;
  blocked({&ray, 1}, {&answer, 1});
  return answer;
}

void RayScene::blocked(std::span<const ShadowRay> rays, std::span<bool> blocked) const {
  const State& s = *state_;
  std::fill(blocked.begin(), blocked.end(), false);
  std::array<heightmap::FieldTracer::Segment, kTogether> packet;
  std::array<bool, kTogether> met;
  for (std::size_t first = 0; first < rays.size(); first += kTogether) {
    const std::size_t n = std::min(kTogether, rays.size() - first);
    const auto some = rays.subspan(first, n);
    if (!s.terrains.empty()) {
      const auto ways = State::ways_of(some, kFieldShare * s.offset_mm, {});
      for (std::size_t i = 0; i < n; ++i) packet[i] = {ways.origin(i), ways.way(i), ways.length[i]};
    }
    for (const auto& terrain : s.terrains) {
      terrain.tracer.blocked_many({packet.data(), n}, {met.data(), n});
      for (std::size_t i = 0; i < n; ++i) blocked[first + i] = blocked[first + i] || met[i];
    }
    s.meshes_block(some, blocked.subspan(first, n));
  }
}

}  // namespace maquette::camera

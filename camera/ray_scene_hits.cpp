// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <limits>

#include "camera/detail/ray_scene_state.hpp"

// Which surface a ray meets first.

namespace maquette::camera {
namespace {

using detail::clip;
using detail::float_ray;
using detail::geometry_of;
using detail::HitContext;
using detail::kBoxMargin;
using detail::kTogether;
using detail::Span;

}  // namespace

/// No, if what of the ray is low enough and over the ground is inside the walls: it cannot come to
/// them without an end outside, for the inside of a box is convex.
bool RayScene::State::may_meet_walls(Vec3 start, Vec3 direction, double length) const {
  const auto inside = [](const Box3& box, Vec3 p) {
    return p.x > box.min.x && p.x < box.max.x && p.y > box.min.y && p.y < box.max.y &&
           p.z > box.min.z && p.z <= box.max.z;
  };
  for (const Skirt& skirt : skirts) {
    const Span span = clip(skirt.outer, start, direction);
    const double leave = std::min(span.leave, length);
    if (span.enter > leave) continue;
    // Rounding may put an end at the upper border beyond it.
    const auto low = [&](double t) {
      Vec3 p = start + t * direction;
      p.z = std::min(p.z, skirt.inner.max.z);
      return p;
    };
    if (!inside(skirt.inner, low(span.enter)) || !inside(skirt.inner, low(leave))) return true;
  }
  return false;
}

/// Rays of which all that is low enough is certainly inside the walls, for may_meet_walls() to be
/// asked about the others only: both ends of what lies below the upper border do.
std::array<char, kTogether> RayScene::State::within_walls(const detail::RayLanes& rays) const {
  std::array<char, kTogether> within;
  within.fill(1);
  for (const Skirt& skirt : skirts) {
    const Box3& box = skirt.inner;
    std::array<std::int64_t, kTogether> inside;
    for (std::size_t i = 0; i < kTogether; ++i) {
      const double border = (box.max.z - rays.origin_z[i]) / rays.way_z[i];
      const bool down = rays.way_z[i] < 0.0;
      const double enter = down && border > 0.0 ? border : 0.0;
      const double leave = !down && border < rays.length[i] ? border : rays.length[i];
      const auto holds = [](bool b) { return static_cast<std::int64_t>(b); };
      std::int64_t both = 1;
      for (const double t : {enter, leave}) {
        const double x = rays.origin_x[i] + t * rays.way_x[i];
        const double y = rays.origin_y[i] + t * rays.way_y[i];
        const double z = rays.origin_z[i] + t * rays.way_z[i];
        both &= holds(x > box.min.x) & holds(x < box.max.x) & holds(y > box.min.y) &
                holds(y < box.max.y) & holds(z > box.min.z);
      }
      inside[i] = holds(leave < enter) | both;
    }
    for (std::size_t i = 0; i < kTogether; ++i)
      if (inside[i] == 0) within[i] = 0;
  }
  return within;
}

/// The nearest triangle of the meshes and walls, if it is nearer than what is known.
void RayScene::State::mesh_hit(Vec3 origin_mm, Vec3 direction,
                               std::optional<RayHit>& nearest) const {
  hit_in(meshes, origin_mm, direction, nearest);
  wall_hit(origin_mm, direction, nearest);
}

void RayScene::State::wall_hit(Vec3 origin_mm, Vec3 direction,
                               std::optional<RayHit>& nearest) const {
  if (walls.empty) return;
  const double length = nearest ? nearest->distance_mm : std::numeric_limits<double>::infinity();
  if (may_meet_walls(origin_mm - middle, direction, length))
    hit_in(walls, origin_mm, direction, nearest);
}

/// mesh_hit() of rays of one packet: Embree is asked only if one of them may come to a mesh.
void RayScene::State::mesh_hits(std::span<const Ray> rays,
                                std::span<std::optional<RayHit>> nearest) const {
  if (geometries.empty()) return;
  detail::RayLanes lanes;
  for (std::size_t i = 0; i < rays.size(); ++i)
    lanes.put(i, rays[i].origin_mm - middle, rays[i].direction,
              nearest[i] ? nearest[i]->distance_mm + kBoxMargin * offset_mm
                         : std::numeric_limits<double>::infinity());
  for (std::size_t i = rays.size(); i < kTogether; ++i) lanes.repeat(0, i);
  if (!meshes.empty && mesh_boxes.may_meet(detail::BoxTree::Bundle(lanes)))
    for (std::size_t i = 0; i < rays.size(); ++i)
      hit_in(meshes, rays[i].origin_mm, rays[i].direction, nearest[i]);
  if (walls.empty) return;
  const auto within = within_walls(lanes);
  for (std::size_t i = 0; i < rays.size(); ++i)
    if (within[i] == 0) wall_hit(rays[i].origin_mm, rays[i].direction, nearest[i]);
}

void RayScene::State::hit_in(const Group& group, Vec3 origin_mm, Vec3 direction,
                             std::optional<RayHit>& nearest) const {
  if (group.empty) return;
  const Vec3 start = origin_mm - middle;
  const Span span = clip(group.box, start, direction);
  const double leave = nearest ? std::min(span.leave, nearest->distance_mm) : span.leave;
  if (span.enter > leave) return;

  RTCRayHit found{};
  found.ray = float_ray(start + span.enter * direction, direction, leave - span.enter + offset_mm);
  found.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  found.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  HitContext context;
  rtcInitIntersectContext(&context.embree);
  rtcIntersect1(group.scene, &context.embree, &found);
  if (found.hit.geomID == RTC_INVALID_GEOMETRY_ID) return;

  const Geometry& geometry = geometries[geometry_of(found.hit)];
  const TriMesh& mesh = *geometry.mesh;
  const auto& t = mesh.triangles[found.hit.primID];
  const auto vertex = [&](std::size_t k) {
    const Vec3 v = mesh.vertices_mm[t[k]];
    return geometry.moved ? geometry.in_model(v) : v;
  };
  const Vec3 a = vertex(0), b = vertex(1), c = vertex(2);
  const Vec3 normal = cross(b - a, c - a);
  const double length = norm(normal);
  const double along = dot(direction, normal);
  RayHit hit;
  hit.object = geometry.object;
  hit.triangle = found.hit.primID;
  hit.front = along <= 0.0;
  if (length > 0.0) hit.normal = (1.0 / length) * normal;
  hit.distance_mm = span.enter + static_cast<double>(found.ray.tfar);
  // Refined on the true plane, unless the triangle is seen so nearly edge-on that
  // its plane says nothing about the distance.
  const double on_plane = dot(a - origin_mm, normal) / along;
  if (std::abs(on_plane - hit.distance_mm) < 100.0 * offset_mm) hit.distance_mm = on_plane;
  if (nearest && nearest->distance_mm <= hit.distance_mm) return;
  hit.point_mm = origin_mm + hit.distance_mm * direction;
  nearest = hit;
}

namespace {

/// Keeps the nearer of what is known and the terrain's hit.
void keep_nearer(const std::optional<heightmap::FieldHit>& hit, std::uint32_t object,
                 Vec3 direction, std::optional<RayHit>& nearest) {
  if (!hit || (nearest && nearest->distance_mm <= hit->distance_mm)) return;
  nearest = RayHit{
      hit->distance_mm, hit->point_mm, hit->normal, object, 0, dot(direction, hit->normal) <= 0.0};
}

}  // namespace

std::optional<RayHit> RayScene::first_hit(Vec3 origin_mm, Vec3 direction) const {
  std::optional<RayHit> nearest;
  for (const auto& terrain : state_->terrains)
    keep_nearer(terrain.tracer.trace(origin_mm, direction), terrain.object, direction, nearest);
  state_->mesh_hit(origin_mm, direction, nearest);
  return nearest;
}

void RayScene::first_hits(std::span<const Ray> rays, std::span<std::optional<RayHit>> hits) const {
  std::fill(hits.begin(), hits.end(), std::nullopt);
  std::array<heightmap::FieldTracer::Ray, kTogether> packet;
  std::array<std::optional<heightmap::FieldHit>, kTogether> met;
  for (std::size_t first = 0; first < rays.size(); first += kTogether) {
    const std::size_t n = std::min(kTogether, rays.size() - first);
    for (std::size_t i = 0; i < n; ++i)
      packet[i] = {rays[first + i].origin_mm, rays[first + i].direction};
    for (const auto& terrain : state_->terrains) {
      terrain.tracer.trace_many({packet.data(), n}, {met.data(), n});
      for (std::size_t i = 0; i < n; ++i)
        keep_nearer(met[i], terrain.object, rays[first + i].direction, hits[first + i]);
    }
    state_->mesh_hits(rays.subspan(first, n), hits.subspan(first, n));
  }
}

bool RayScene::inside(Vec3 point_mm) const {
  for (const double way : {-1.0, 1.0})
    if (const auto hit = first_hit(point_mm, {0.0, 0.0, way}))
      if (!hit->front || hit->distance_mm <= offset_mm()) return true;
  return false;
}

}  // namespace maquette::camera

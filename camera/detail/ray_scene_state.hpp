// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file ray_scene_state.hpp
/// What a ray scene is made of: for the files that build it and that ask it.

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include <embree3/rtcore.h>

#include "camera/detail/box_tree.hpp"
#include "camera/detail/ray_lanes.hpp"
#include "camera/ray_scene.hpp"
#include "heightmap/field_tracer.hpp"

namespace maquette::camera {
namespace detail {

/// What a mesh's box is wider than the mesh when rays are asked whether they may come to it, and
/// how much farther they reach, in steps of offset_mm: more than Embree, which works in float, may
/// be off by, and more than a hit is moved along its ray afterwards.
inline constexpr double kBoxMargin = 4.0;

/// So many rays are worked on together.
inline constexpr std::size_t kTogether = RayLanes::kCount;

struct Span {
  double enter, leave;
};

/// Where a ray is inside the box; enter > leave if never.
inline Span clip(const Box3& box, Vec3 o, Vec3 d) {
  Span span{0.0, std::numeric_limits<double>::infinity()};
  const auto slab = [&span](double lo, double hi, double start, double step) {
    if (step == 0.0) {
      if (start < lo || start > hi) span = {1.0, 0.0};
      return;
    }
    const double a = (lo - start) / step, b = (hi - start) / step;
    span.enter = std::max(span.enter, std::min(a, b));
    span.leave = std::min(span.leave, std::max(a, b));
  };
  slab(box.min.x, box.max.x, o.x, d.x);
  slab(box.min.y, box.max.y, o.y, d.y);
  slab(box.min.z, box.max.z, o.z, d.z);
  return span;
}

struct HitContext {
  RTCIntersectContext embree;
  float distance = std::numeric_limits<float>::infinity();
  unsigned int geometry = RTC_INVALID_GEOMETRY_ID, triangle = RTC_INVALID_GEOMETRY_ID;
};

/// Of the upper scene: an instance hides the number of what it holds.
inline unsigned int geometry_of(const RTCHit& hit) {
  return hit.instID[0] != RTC_INVALID_GEOMETRY_ID ? hit.instID[0] : hit.geomID;
}

inline RTCRay float_ray(Vec3 origin, Vec3 direction, double length) {
  RTCRay ray{};
  ray.org_x = static_cast<float>(origin.x);
  ray.org_y = static_cast<float>(origin.y);
  ray.org_z = static_cast<float>(origin.z);
  ray.dir_x = static_cast<float>(direction.x);
  ray.dir_y = static_cast<float>(direction.y);
  ray.dir_z = static_cast<float>(direction.z);
  ray.tnear = 0.0F;
  ray.tfar = static_cast<float>(length);
  ray.mask = 0xFFFFFFFFU;
  return ray;
}

}  // namespace detail

struct RayScene::State {
  /// What Embree knows by one number.
  struct Geometry {
    const TriMesh* mesh = nullptr;
    RigidTransform model_from_mesh;
    double scale = 1.0;
    bool moved = false, skirt = false;
    std::uint32_t object = 0;

    [[nodiscard]] Vec3 in_model(Vec3 of_mesh) const {
      return model_from_mesh.point(scale * of_mesh);
    }
  };
  struct Terrain {
    heightmap::FieldTracer tracer;
    std::uint32_t object;
  };
  struct Shared {
    RTCScene scene;
    Vec3 middle;
  };
  std::vector<Geometry> geometries;
  std::vector<Terrain> terrains;
  /// What Embree searches together.
  struct Group {
    RTCScene scene = nullptr;
    bool empty = true;
    Box3 box;  ///< relative to the middle, widened by a few float steps
  };
  /// A terrain's walls and underside: the faces, but the upper one, of a box. Relative to the
  /// middle; widened, and narrowed, by a few float steps.
  struct Skirt {
    Box3 outer, inner;
  };
  std::vector<std::unique_ptr<TriMesh>> skirt_meshes;
  std::vector<Skirt> skirts;
  std::map<const TriMesh*, Shared> shared;
  Vec3 middle;  ///< of the box; Embree's origin
  Box3 whole;   ///< of everything, model frame
  Group meshes, walls;
  /// Of each mesh as it stands; widened as the group's box is, and no ray is asked about one less
  /// far than Embree would look.
  detail::BoxTree mesh_boxes;
  double offset_mm = 0.0;
  RTCDevice device = nullptr;

  State() = default;
  State(const State&) = delete;
  State& operator=(const State&) = delete;
  ~State() {
    for (const auto& [mesh, part] : shared) rtcReleaseScene(part.scene);
    for (const Group* group : {&meshes, &walls})
      if (group->scene != nullptr) rtcReleaseScene(group->scene);
    if (device != nullptr) rtcReleaseDevice(device);
  }

  void check() const {
    const RTCError error = rtcGetDeviceError(device);
    if (error == RTC_ERROR_OUT_OF_MEMORY) throw std::bad_alloc();
    MAQUETTE_CHECK(error == RTC_ERROR_NONE, "Embree reports error {}", static_cast<int>(error));
  }
  [[nodiscard]] RTCScene new_scene() const;
  [[nodiscard]] RTCGeometry triangles(const TriMesh& mesh, Vec3 origin) const;
  void attach(unsigned int number);
  void measure(const std::vector<RayObject>& objects);
  void mesh_hit(Vec3 origin_mm, Vec3 direction, std::optional<RayHit>& nearest) const;
  void mesh_hits(std::span<const Ray> rays, std::span<std::optional<RayHit>> nearest) const;
  void wall_hit(Vec3 origin_mm, Vec3 direction, std::optional<RayHit>& nearest) const;
  void hit_in(const Group& group, Vec3 origin_mm, Vec3 direction,
              std::optional<RayHit>& nearest) const;
  [[nodiscard]] bool blocked_in(const Group& group, Vec3 start, Vec3 direction,
                                double length) const;
  [[nodiscard]] bool may_meet_walls(Vec3 start, Vec3 direction, double length) const;
  [[nodiscard]] std::array<char, detail::kTogether> within_walls(
      const detail::RayLanes& rays) const;
  [[nodiscard]] static detail::RayLanes ways_of(std::span<const ShadowRay> rays, double off_mm,
                                                Vec3 origin);
  [[nodiscard]] bool walls_block(Vec3 start, Vec3 direction, double length) const;
  void meshes_block(std::span<const ShadowRay> rays, std::span<bool> blocked) const;
};

}  // namespace maquette::camera

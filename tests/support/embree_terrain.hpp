// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file embree_terrain.hpp
/// Embree as a peer of our tracer: the same surface as a grid of quads, robust. (As triangles 16 M
/// quads would take 3 GiB.)

#include <cstddef>

#include <embree3/rtcore.h>

#include "core/vec.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::testing_support {

struct EmbreeTerrain {
  RTCDevice device = rtcNewDevice(nullptr);
  RTCScene scene = rtcNewScene(device);

  EmbreeTerrain(const EmbreeTerrain&) = delete;
  EmbreeTerrain& operator=(const EmbreeTerrain&) = delete;
  explicit EmbreeTerrain(const heightmap::ModelField& f) {
    rtcSetDeviceMemoryMonitorFunction(
        device,
        [](void* sum, ssize_t change, bool) {
          __atomic_fetch_add(static_cast<ssize_t*>(sum), change, __ATOMIC_RELAXED);
          return true;
        },
        &bytes);
    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
    RTCGeometry g = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_GRID);
    const auto rows = static_cast<std::size_t>(f.z_mm.rows()),
               cols = static_cast<std::size_t>(f.z_mm.cols());
    auto* v = static_cast<float*>(
        rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, rows * cols));
    for (std::ptrdiff_t r = 0; r < f.z_mm.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < f.z_mm.cols(); ++c) {
        *v++ = static_cast<float>(f.x_mm(c));
        *v++ = static_cast<float>(f.y_mm(r));
        *v++ = f.z_mm(r, c);
      }
    auto* grid = static_cast<RTCGrid*>(
        rtcSetNewGeometryBuffer(g, RTC_BUFFER_TYPE_GRID, 0, RTC_FORMAT_GRID, sizeof(RTCGrid), 1));
    *grid = {0, static_cast<unsigned>(cols), static_cast<unsigned short>(cols),
             static_cast<unsigned short>(rows)};
    rtcCommitGeometry(g);
    rtcAttachGeometry(scene, g);
    rtcReleaseGeometry(g);
    rtcCommitScene(scene);
  }
  ~EmbreeTerrain() {
    rtcReleaseScene(scene);
    rtcReleaseDevice(device);
  }
  static RTCRay ray(Vec3 o, Vec3 d, double length) {
    RTCRay r{};
    r.org_x = static_cast<float>(o.x);
    r.org_y = static_cast<float>(o.y);
    r.org_z = static_cast<float>(o.z);
    r.dir_x = static_cast<float>(d.x);
    r.dir_y = static_cast<float>(d.y);
    r.dir_z = static_cast<float>(d.z);
    r.tfar = static_cast<float>(length);
    r.mask = ~0U;
    return r;
  }
  [[nodiscard]] bool trace(Vec3 o, Vec3 d) const {
    RTCRayHit q{};
    q.ray = ray(o, d, 1e9);
    q.hit.geomID = RTC_INVALID_GEOMETRY_ID;
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcIntersect1(scene, &context, &q);
    return q.hit.geomID != RTC_INVALID_GEOMETRY_ID;
  }
  [[nodiscard]] bool blocked(Vec3 o, Vec3 d, double length) const {
    RTCRay r = ray(o, d, length);
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcOccluded1(scene, &context, &r);
    return r.tfar < 0.0F;
  }

  /// Sixteen rays at a time that stay close together. `hit` of each: something is met.
  void trace16(const Vec3* o, const Vec3* d, bool* hit) const {
    alignas(64) int valid[16];
    alignas(64) RTCRayHit16 q;
    for (int i = 0; i < 16; ++i) {
      valid[i] = -1;
      set(q.ray, i, ray(o[i], d[i], 1e9));
      q.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
    }
    RTCIntersectContext context = coherent();
    rtcIntersect16(valid, scene, &context, &q);
    for (int i = 0; i < 16; ++i) hit[i] = q.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID;
  }
  void blocked16(const Vec3* o, const Vec3* d, const double* length, bool* hit) const {
    alignas(64) int valid[16];
    alignas(64) RTCRay16 q;
    for (int i = 0; i < 16; ++i) {
      valid[i] = -1;
      set(q, i, ray(o[i], d[i], length[i]));
    }
    RTCIntersectContext context = coherent();
    rtcOccluded16(valid, scene, &context, &q);
    for (int i = 0; i < 16; ++i) hit[i] = q.tfar[i] < 0.0F;
  }

  ssize_t bytes = 0;  ///< that Embree holds

 private:
  static RTCIntersectContext coherent() {
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
    return context;
  }
  static void set(RTCRay16& to, int i, const RTCRay& r) {
    to.org_x[i] = r.org_x;
    to.org_y[i] = r.org_y;
    to.org_z[i] = r.org_z;
    to.dir_x[i] = r.dir_x;
    to.dir_y[i] = r.dir_y;
    to.dir_z[i] = r.dir_z;
    to.tnear[i] = 0.0F;
    to.tfar[i] = r.tfar;
    to.time[i] = 0.0F;
    to.mask[i] = r.mask;
    to.id[i] = to.flags[i] = 0;
  }
};

}  // namespace maquette::testing_support

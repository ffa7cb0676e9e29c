// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/ray_scene.hpp"

#include <atomic>
#include <cmath>
#include <limits>
#include <new>

#include <embree3/rtcore.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "core/check.hpp"

namespace maquette::camera {
namespace {

/// How many float steps (at the scene's half size) lie between a surface point and
/// the start of its shadow ray. Vertex and start are each rounded by up to half a
/// step in each of three coordinates: sqrt(3) steps; the rest is for the ray's own
/// arithmetic.
constexpr double kOffsetSteps = 4.0;

struct Span {
  double enter, leave;
};

/// Where a ray is inside the box; enter > leave if never.
Span clip(const Box3& box, Vec3 o, Vec3 d) {
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
  unsigned int object = RTC_INVALID_GEOMETRY_ID, triangle = RTC_INVALID_GEOMETRY_ID;
};

/// Called for every triangle met that is not farther than the nearest so far. Which
/// of two equally distant ones Embree keeps depends on the order in its tree, and
/// that on the number of threads; here the lower number wins.
void keep_lowest_number(const RTCFilterFunctionNArguments* args) {
  auto* context = reinterpret_cast<HitContext*>(args->context);
  const auto* ray = reinterpret_cast<const RTCRay*>(args->ray);
  const auto* hit = reinterpret_cast<const RTCHit*>(args->hit);
  const bool tie = ray->tfar == context->distance;
  if (tie && (hit->geomID > context->object ||
              (hit->geomID == context->object && hit->primID > context->triangle))) {
    args->valid[0] = 0;
    return;
  }
  context->distance = ray->tfar;
  context->object = hit->geomID;
  context->triangle = hit->primID;
}

RTCRay float_ray(Vec3 origin, Vec3 direction, double length) {
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

}  // namespace

struct RayScene::State {
  std::vector<const TriMesh*> meshes;
  Vec3 middle;  ///< of the box; Embree's origin
  Box3 box;     ///< relative to the middle, widened by a few float steps
  double offset_mm = 0.0;
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;

  State() = default;
  State(const State&) = delete;
  State& operator=(const State&) = delete;
  ~State() {
    if (scene != nullptr) rtcReleaseScene(scene);
    if (device != nullptr) rtcReleaseDevice(device);
  }

  void check() const {
    const RTCError error = rtcGetDeviceError(device);
    if (error == RTC_ERROR_OUT_OF_MEMORY) throw std::bad_alloc();
    MAQUETTE_CHECK(error == RTC_ERROR_NONE, "Embree reports error {}", static_cast<int>(error));
  }
  void attach(const TriMesh& mesh) const;
};

void RayScene::State::attach(const TriMesh& mesh) const {
  const std::size_t vertices = mesh.vertices_mm.size();
  for (const auto& t : mesh.triangles)
    MAQUETTE_CHECK(t[0] < vertices && t[1] < vertices && t[2] < vertices,
                   "triangle {} {} {} of a mesh with {} vertices", t[0], t[1], t[2], vertices);
  RTCGeometry geometry = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* xyz = static_cast<float*>(rtcSetNewGeometryBuffer(
      geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), vertices));
  if (xyz == nullptr) {
    rtcReleaseGeometry(geometry);
    throw std::bad_alloc();
  }
  tbb::parallel_for(tbb::blocked_range<std::size_t>(0, vertices, 65536), [&](const auto& range) {
    for (std::size_t i = range.begin(); i < range.end(); ++i) {
      const Vec3 v = mesh.vertices_mm[i] - middle;
      xyz[3 * i] = static_cast<float>(v.x);
      xyz[3 * i + 1] = static_cast<float>(v.y);
      xyz[3 * i + 2] = static_cast<float>(v.z);
    }
  });
  // The triangles are used where they lie: at 32 M of them a copy would be 0.4 GB.
  rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                             mesh.triangles.data(), 0, sizeof(mesh.triangles[0]),
                             mesh.triangles.size());
  rtcSetGeometryBuildQuality(geometry, RTC_BUILD_QUALITY_MEDIUM);
  rtcSetGeometryIntersectFilterFunction(geometry, keep_lowest_number);
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(scene, geometry);
  rtcReleaseGeometry(geometry);
}

Result<RayScene> RayScene::build(const std::vector<const TriMesh*>& meshes, const RunContext& run) {
  auto state = std::make_unique<State>();
  Box3 box;
  for (const TriMesh* mesh : meshes) {
    const Box3 part = mesh->bounds();
    if (part.empty()) continue;
    box.add(part.min);
    box.add(part.max);
  }
  MAQUETTE_CHECK(!box.empty(), "a ray scene of {} meshes without a vertex", meshes.size());
  state->meshes = meshes;
  state->middle = 0.5 * (box.min + box.max);
  const Vec3 half = 0.5 * (box.max - box.min);
  const double size = std::max({half.x, half.y, half.z, 1e-6});
  state->offset_mm = kOffsetSteps * size * std::numeric_limits<float>::epsilon();
  const Vec3 margin{state->offset_mm, state->offset_mm, state->offset_mm};
  state->box = {-half - margin, half + margin};

  state->device = rtcNewDevice(nullptr);
  MAQUETTE_CHECK(state->device != nullptr, "Embree cannot start: error {}",
                 static_cast<int>(rtcGetDeviceError(nullptr)));
  state->scene = rtcNewScene(state->device);
  // Robust: the default mode misses about one hit in 10 000 along edges. Compact:
  // see the measured memory in render.hpp.
  rtcSetSceneFlags(state->scene, RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_COMPACT);
  rtcSetSceneBuildQuality(state->scene, RTC_BUILD_QUALITY_MEDIUM);
  for (const TriMesh* mesh : meshes) state->attach(*mesh);
  rtcSetSceneProgressMonitorFunction(
      state->scene,
      [](void* context, double) { return !static_cast<const RunContext*>(context)->stopped(); },
      const_cast<RunContext*>(&run));
  rtcCommitScene(state->scene);
  if (run.stopped()) return fail(kCancelled, "stopped while the ray scene was built");
  state->check();
  rtcSetSceneProgressMonitorFunction(state->scene, nullptr, nullptr);
  return RayScene(std::move(state));
}

RayScene::RayScene(std::unique_ptr<State> state) : state_(std::move(state)) {}
RayScene::RayScene(RayScene&&) noexcept = default;
RayScene& RayScene::operator=(RayScene&&) noexcept = default;
RayScene::~RayScene() = default;

double RayScene::offset_mm() const {
  return state_->offset_mm;
}

std::optional<RayHit> RayScene::first_hit(Vec3 origin_mm, Vec3 direction) const {
  const State& s = *state_;
  const Vec3 start = origin_mm - s.middle;
  const Span span = clip(s.box, start, direction);
  if (span.enter > span.leave) return std::nullopt;

  RTCRayHit found{};
  found.ray =
      float_ray(start + span.enter * direction, direction, span.leave - span.enter + s.offset_mm);
  found.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  HitContext context;
  rtcInitIntersectContext(&context.embree);
  rtcIntersect1(s.scene, &context.embree, &found);
  if (found.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;

  RayHit hit;
  hit.object = found.hit.geomID;
  hit.triangle = found.hit.primID;
  const TriMesh& mesh = *s.meshes[hit.object];
  const auto& t = mesh.triangles[hit.triangle];
  const Vec3 a = mesh.vertices_mm[t[0]], b = mesh.vertices_mm[t[1]], c = mesh.vertices_mm[t[2]];
  const Vec3 normal = cross(b - a, c - a);
  const double length = norm(normal);
  const double along = dot(direction, normal);
  hit.front = along <= 0.0;
  if (length > 0.0) hit.normal = (1.0 / length) * normal;
  hit.distance_mm = span.enter + static_cast<double>(found.ray.tfar);
  // Refined on the true plane, unless the triangle is seen so nearly edge-on that
  // its plane says nothing about the distance.
  const double on_plane = dot(a - origin_mm, normal) / along;
  if (std::abs(on_plane - hit.distance_mm) < 100.0 * s.offset_mm) hit.distance_mm = on_plane;
  hit.point_mm = origin_mm + hit.distance_mm * direction;
  return hit;
}

bool RayScene::blocked(Vec3 point_mm, Vec3 normal, Vec3 to_mm) const {
  const State& s = *state_;
  const Vec3 start = point_mm + s.offset_mm * normal - s.middle;
  const Vec3 way = to_mm - s.middle - start;
  const double length = norm(way);
  if (length <= s.offset_mm) return false;
  const Vec3 direction = (1.0 / length) * way;
  const Span span = clip(s.box, start, direction);
  if (span.enter > span.leave) return false;
  RTCRay ray = float_ray(start, direction, std::min(length, span.leave));
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcOccluded1(s.scene, &context, &ray);
  return ray.tfar < 0.0F;
}

bool RayScene::inside(Vec3 point_mm) const {
  for (const double way : {-1.0, 1.0})
    if (const auto hit = first_hit(point_mm, {0.0, 0.0, way}))
      if (!hit->front || hit->distance_mm <= offset_mm()) return true;
  return false;
}

}  // namespace maquette::camera

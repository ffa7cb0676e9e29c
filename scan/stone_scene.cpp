// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/stone_scene.hpp"

#include <cmath>
#include <cstring>
#include <numbers>
#include <utility>

#include <embree3/rtcore.h>
#include <fmt/format.h>

#include "core/check.hpp"

namespace maquette::scan::detail {
namespace {

constexpr ErrorCode kEmbreeFailed{"SCAN_EMBREE_FAILED", ErrorKind::environment};

Vec3 corner(const TriMesh& mesh, std::size_t triangle, std::size_t k) {
  return mesh.vertices_mm[mesh.triangles[triangle][k]];
}

}  // namespace

struct StoneScene::State {
  std::span<const TriMesh> stones;
  Box3 bounds;
  Vec3 middle;
  double radius_mm = 0.0;
  RTCDevice device = nullptr;
  RTCScene scene = nullptr;
  ~State() {
    if (scene != nullptr) rtcReleaseScene(scene);
    if (device != nullptr) rtcReleaseDevice(device);
  }
};

StoneScene::StoneScene(std::unique_ptr<State> state) : state_(std::move(state)) {}
StoneScene::StoneScene(StoneScene&&) noexcept = default;
StoneScene& StoneScene::operator=(StoneScene&&) noexcept = default;
StoneScene::~StoneScene() = default;
const Box3& StoneScene::bounds() const {
  return state_->bounds;
}

Result<StoneScene> StoneScene::build(std::span<const TriMesh> stones) {
  auto s = std::make_unique<State>();
  s->stones = stones;
  for (const TriMesh& mesh : stones) {
    const Box3 box = mesh.bounds();
    if (box.empty()) continue;
    s->bounds.add(box.min);
    s->bounds.add(box.max);
  }
  if (s->bounds.empty()) return StoneScene(std::move(s));
  s->middle = 0.5 * (s->bounds.min + s->bounds.max);
  s->radius_mm = 0.5 * norm(s->bounds.max - s->bounds.min);

  // One build thread: the tree, and with it the choice between two triangles that a ray
  // meets on their common edge, does not depend on the machine.
  s->device = rtcNewDevice("threads=1,set_affinity=0");
  if (s->device == nullptr)
    return fail(kEmbreeFailed, fmt::format("Embree did not start (error {})",
                                           static_cast<int>(rtcGetDeviceError(nullptr))));
  s->scene = rtcNewScene(s->device);
  rtcSetSceneFlags(s->scene, RTC_SCENE_FLAG_ROBUST);
  for (std::size_t i = 0; i < stones.size(); ++i) {
    const TriMesh& mesh = stones[i];
    if (mesh.triangles.empty()) continue;
    RTCGeometry geometry = rtcNewGeometry(s->device, RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* vertices = static_cast<float*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3,
                                3 * sizeof(float), mesh.vertices_mm.size()));
    auto* indices = static_cast<unsigned*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                3 * sizeof(unsigned), mesh.triangles.size()));
    if (vertices == nullptr || indices == nullptr) {
      rtcReleaseGeometry(geometry);
      return fail(kEmbreeFailed, fmt::format("no memory for stone {} in Embree", i));
    }
    for (const Vec3& v : mesh.vertices_mm) {
      const Vec3 local = v - s->middle;
      *vertices++ = static_cast<float>(local.x);
      *vertices++ = static_cast<float>(local.y);
      *vertices++ = static_cast<float>(local.z);
    }
    static_assert(sizeof(std::array<std::uint32_t, 3>) == 3 * sizeof(unsigned));
    std::memcpy(indices, mesh.triangles.data(), mesh.triangles.size() * 3 * sizeof(unsigned));
    rtcCommitGeometry(geometry);
    rtcAttachGeometryByID(s->scene, geometry, static_cast<unsigned>(i));
    rtcReleaseGeometry(geometry);
  }
  rtcCommitScene(s->scene);
  if (const RTCError error = rtcGetDeviceError(s->device); error != RTC_ERROR_NONE)
    return fail(kEmbreeFailed,
                fmt::format("Embree could not build the scene of {} stones (error {})",
                            stones.size(), static_cast<int>(error)));
  return StoneScene(std::move(s));
}

std::optional<StoneHit> StoneScene::trace(Vec3 origin, Vec3 direction, double limit_mm) const {
  const State& s = *state_;
  if (s.scene == nullptr) return std::nullopt;
  // Start close to the stones, where single precision is fine enough.
  const Vec3 to_middle = s.middle - origin;
  const double along = dot(to_middle, direction);
  const double across2 = dot(to_middle, to_middle) - along * along;
  const double reach = 1.001 * s.radius_mm + 1e-3;
  if (across2 > reach * reach) return std::nullopt;
  const double start = std::fmax(0.0, along - reach);
  if (start > limit_mm) return std::nullopt;
  const Vec3 local = origin + start * direction - s.middle;

  RTCRayHit query{};
  query.ray.org_x = static_cast<float>(local.x);
  query.ray.org_y = static_cast<float>(local.y);
  query.ray.org_z = static_cast<float>(local.z);
  query.ray.dir_x = static_cast<float>(direction.x);
  query.ray.dir_y = static_cast<float>(direction.y);
  query.ray.dir_z = static_cast<float>(direction.z);
  query.ray.tnear = 0.0F;
  query.ray.tfar = static_cast<float>(std::fmin(limit_mm - start, 3.0 * reach)) + 1e-2F;
  query.ray.mask = ~0U;
  query.hit.geomID = RTC_INVALID_GEOMETRY_ID;
  query.hit.instID[0] = RTC_INVALID_GEOMETRY_ID;
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect1(s.scene, &context, &query);
  if (query.hit.geomID == RTC_INVALID_GEOMETRY_ID) return std::nullopt;

  const TriMesh& mesh = s.stones[query.hit.geomID];
  const Vec3 a = corner(mesh, query.hit.primID, 0);
  const Vec3 n =
      cross(corner(mesh, query.hit.primID, 1) - a, corner(mesh, query.hit.primID, 2) - a);
  const double length = norm(n), slope = dot(n, direction);
  const double rough = start + static_cast<double>(query.ray.tfar);
  // Seen edge-on, the plane says less about the place than the single-precision hit.
  double distance = rough;
  if (std::abs(slope) > 1e-6 * length) {
    const double exact = dot(n, a - origin) / slope;
    if (std::abs(exact - rough) < 1e-2) distance = exact;
  }
  if (!(distance > 0.0 && distance < limit_mm) || length == 0.0) return std::nullopt;
  return StoneHit{distance, (1.0 / length) * n};
}

bool inside_mesh(const TriMesh& mesh, Vec3 p) {
  double angle = 0.0;
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    const Vec3 a = corner(mesh, t, 0) - p, b = corner(mesh, t, 1) - p, c = corner(mesh, t, 2) - p;
    const double la = norm(a), lb = norm(b), lc = norm(c);
    angle += 2.0 * std::atan2(dot(a, cross(b, c)),
                              la * lb * lc + dot(a, b) * lc + dot(b, c) * la + dot(c, a) * lb);
  }
  return std::abs(angle) > 2.0 * std::numbers::pi;
}

}  // namespace maquette::scan::detail

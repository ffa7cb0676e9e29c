// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/ray_scene.hpp"

#include <algorithm>
#include <cmath>
#include <new>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "camera/detail/field_skirt.hpp"
#include "camera/detail/ray_scene_state.hpp"
#include "core/check.hpp"

namespace maquette::camera {
namespace {

using detail::geometry_of;
using detail::HitContext;
using detail::kBoxMargin;

/// How many float steps (at the scene's half size) lie between a surface point and
/// the start of its shadow ray. Vertex and start are each rounded by up to half a
/// step in each of three coordinates: sqrt(3) steps; the rest is for the ray's own
/// arithmetic.
constexpr double kOffsetSteps = 4.0;
/// Of a mesh of which each place gets a box by vertices, not by corners of the mesh's own box.
constexpr std::size_t kFewVertices = 2000;

/// Called for every triangle met that is not farther than the nearest so far. Which
/// of two equally distant ones Embree keeps depends on the order in its tree, and
/// that on the number of threads; here the lower number wins.
void keep_lowest_number(const RTCFilterFunctionNArguments* args) {
  auto* context = reinterpret_cast<HitContext*>(args->context);
  const auto* ray = reinterpret_cast<const RTCRay*>(args->ray);
  const auto* hit = reinterpret_cast<const RTCHit*>(args->hit);
  const unsigned int geometry = geometry_of(*hit);
  const bool tie = ray->tfar == context->distance;
  if (tie && (geometry > context->geometry ||
              (geometry == context->geometry && hit->primID > context->triangle))) {
    args->valid[0] = 0;
    return;
  }
  context->distance = ray->tfar;
  context->geometry = geometry;
  context->triangle = hit->primID;
}

bool is_identity(const RigidTransform& t) {
  return t == RigidTransform{};
}

void widen(Box3& box, double by) {
  const Vec3 margin{by, by, by};
  box.min = box.min - margin;
  box.max = box.max + margin;
}

}  // namespace

RTCScene RayScene::State::new_scene() const {
  const RTCScene made = rtcNewScene(device);
  // Robust: the default mode misses about one hit in 10 000 along edges. Compact:
  // see the measured memory in render.hpp.
  rtcSetSceneFlags(made, RTC_SCENE_FLAG_ROBUST | RTC_SCENE_FLAG_COMPACT);
  rtcSetSceneBuildQuality(made, RTC_BUILD_QUALITY_MEDIUM);
  return made;
}

RTCGeometry RayScene::State::triangles(const TriMesh& mesh, Vec3 origin) const {
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
      const Vec3 v = mesh.vertices_mm[i] - origin;
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
  return geometry;
}

void RayScene::State::attach(unsigned int number) {
  const Geometry& g = geometries[number];
  Group& group = g.skirt ? walls : meshes;
  group.empty = false;
  const RTCScene scene = group.scene;
  if (!g.moved) {
    const RTCGeometry geometry = triangles(*g.mesh, middle);
    rtcAttachGeometryByID(scene, geometry, number);
    rtcReleaseGeometry(geometry);
    return;
  }
  auto [entry, fresh] = shared.try_emplace(g.mesh);
  Shared& part = entry->second;
  if (fresh) {
    const Box3 box = g.mesh->bounds();
    part.middle = 0.5 * (box.min + box.max);
    part.scene = new_scene();
    const RTCGeometry geometry = triangles(*g.mesh, part.middle);
    rtcAttachGeometry(part.scene, geometry);
    rtcReleaseGeometry(geometry);
    rtcCommitScene(part.scene);
  }
  const RTCGeometry instance = rtcNewGeometry(device, RTC_GEOMETRY_TYPE_INSTANCE);
  rtcSetGeometryInstancedScene(instance, part.scene);
  std::array<float, 12> columns{};
  const Vec3 shift = g.in_model(part.middle) - middle;
  const double s = g.scale;
  const std::array<Vec3, 4> column{g.model_from_mesh.direction({s, 0, 0}),
                                   g.model_from_mesh.direction({0, s, 0}),
                                   g.model_from_mesh.direction({0, 0, s}), shift};
  for (std::size_t i = 0; i < 4; ++i) {
    columns[3 * i] = static_cast<float>(column[i].x);
    columns[3 * i + 1] = static_cast<float>(column[i].y);
    columns[3 * i + 2] = static_cast<float>(column[i].z);
  }
  rtcSetGeometryTransform(instance, 0, RTC_FORMAT_FLOAT3X4_COLUMN_MAJOR, columns.data());
  rtcCommitGeometry(instance);
  rtcAttachGeometryByID(scene, instance, number);
  rtcReleaseGeometry(instance);
}

/// Boxes, and what the objects are to Embree and to the tracer.
void RayScene::State::measure(const std::vector<RayObject>& objects) {
  std::map<const TriMesh*, int> uses;
  for (const RayObject& o : objects)
    if (o.mesh != nullptr) ++uses[o.mesh];
  std::vector<Box3> boxes;
  const auto add = [&](const Geometry& g) {
    const Box3 part = g.mesh->bounds();
    if (part.empty()) return;
    Box3 corners;
    for (int corner = 0; corner < 8; ++corner) {
      const Vec3 p = g.in_model({(corner & 1) != 0 ? part.max.x : part.min.x,
                                 (corner & 2) != 0 ? part.max.y : part.min.y,
                                 (corner & 4) != 0 ? part.max.z : part.min.z});
      (g.skirt ? walls : meshes).box.add(p);
      corners.add(p);
      whole.add(p);
    }
    if (!g.skirt) {
      // A turned mesh is smaller than its box, turned.
      Box3 box;
      if (g.moved && g.mesh->vertices_mm.size() <= kFewVertices)
        for (const Vec3& v : g.mesh->vertices_mm) box.add(g.in_model(v));
      boxes.push_back(box.empty() ? corners : box);
    }
    geometries.push_back(g);
  };
  for (std::size_t i = 0; i < objects.size(); ++i) {
    const RayObject& o = objects[i];
    const auto number = static_cast<std::uint32_t>(i);
    if (o.mesh != nullptr) {
      MAQUETTE_CHECK(o.scale > 0.0 && std::isfinite(o.scale), "object {} at a scale of {}", i,
                     o.scale);
      const bool moved = uses[o.mesh] > 1 || !is_identity(o.model_from_mesh) || o.scale != 1.0;
      add({o.mesh, o.model_from_mesh, o.scale, moved, false, number});
    }
    if (o.field == nullptr) continue;
    const heightmap::ModelField& f = *o.field;
    terrains.push_back({heightmap::FieldTracer(f), number});
    const auto range = heightmap::height_range(f.z_mm);
    if (!std::isfinite(range.min)) continue;
    for (const double z : {static_cast<double>(range.min), static_cast<double>(range.max)}) {
      whole.add({f.x_mm(0), f.y_mm(0), z});
      whole.add({f.x_mm(f.z_mm.cols() - 1), f.y_mm(f.z_mm.rows() - 1), z});
    }
    if (!std::isfinite(o.base_mm)) continue;
    skirt_meshes.push_back(std::make_unique<TriMesh>(detail::field_skirt(f, o.base_mm)));
    add({skirt_meshes.back().get(), {}, 1.0, false, true, number});
  }
  MAQUETTE_CHECK(!whole.empty(), "a ray scene of {} objects without a vertex", objects.size());
  middle = 0.5 * (whole.min + whole.max);
  const Vec3 half = 0.5 * (whole.max - whole.min);
  offset_mm = kOffsetSteps * std::max({half.x, half.y, half.z, 1e-6}) *
              static_cast<double>(std::numeric_limits<float>::epsilon());
  const auto from_middle = [&](Box3 box, double by) {
    box = {box.min - middle, box.max - middle};
    widen(box, by);
    return box;
  };
  for (Group* group : {&meshes, &walls}) group->box = from_middle(group->box, offset_mm);
  for (Box3& box : boxes) box = from_middle(box, kBoxMargin * offset_mm);
  mesh_boxes = detail::BoxTree(boxes);
  for (const auto& mesh : skirt_meshes) {
    const Box3 box = mesh->bounds();
    Skirt skirt{from_middle(box, offset_mm), from_middle(box, -offset_mm)};
    skirt.inner.max.z = skirt.outer.max.z;  // there is no upper face
    skirts.push_back(skirt);
  }
}

Result<RayScene> RayScene::build(const std::vector<RayObject>& objects, const RunContext& run) {
  auto state = std::make_unique<State>();
  state->measure(objects);
  state->device = rtcNewDevice(nullptr);
  MAQUETTE_CHECK(state->device != nullptr, "Embree cannot start: error {}",
                 static_cast<int>(rtcGetDeviceError(nullptr)));
  for (State::Group* group : {&state->meshes, &state->walls}) group->scene = state->new_scene();
  for (unsigned int i = 0; i < state->geometries.size(); ++i) state->attach(i);
  for (const State::Group* group : {&state->meshes, &state->walls}) {
    rtcSetSceneProgressMonitorFunction(
        group->scene,
        [](void* context, double) { return !static_cast<const RunContext*>(context)->stopped(); },
        const_cast<RunContext*>(&run));
    rtcCommitScene(group->scene);
    if (run.stopped()) return fail(kCancelled, "stopped while the ray scene was built");
    state->check();
    rtcSetSceneProgressMonitorFunction(group->scene, nullptr, nullptr);
  }
  return RayScene(std::move(state));
}

RayScene::RayScene(std::unique_ptr<State> state) : state_(std::move(state)) {}
RayScene::RayScene(RayScene&&) noexcept = default;
RayScene& RayScene::operator=(RayScene&&) noexcept = default;
RayScene::~RayScene() = default;

double RayScene::offset_mm() const {
  return state_->offset_mm;
}
Box3 RayScene::bounds() const {
  return state_->whole;
}

}  // namespace maquette::camera

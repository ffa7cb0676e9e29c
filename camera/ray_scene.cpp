// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/ray_scene.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <new>

#include <embree3/rtcore.h>
#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "camera/detail/box_tree.hpp"
#include "camera/detail/field_skirt.hpp"
#include "camera/detail/ray_lanes.hpp"
#include "core/check.hpp"
#include "heightmap/field_tracer.hpp"

namespace maquette::camera {
namespace {

/// How many float steps (at the scene's half size) lie between a surface point and
/// the start of its shadow ray. Vertex and start are each rounded by up to half a
/// step in each of three coordinates: sqrt(3) steps; the rest is for the ray's own
/// arithmetic.
constexpr double kOffsetSteps = 4.0;
/// Terrain is traced in double, whose steps are 2^-29 of a float's: a millionth is ample.
constexpr double kFieldShare = 1e-6;
/// What a mesh's box is wider than the mesh when rays are asked whether they may come to it, and
/// how much farther they reach, in steps of offset_mm: more than Embree, which works in float, may
/// be off by, and more than a hit is moved along its ray afterwards.
constexpr double kBoxMargin = 4.0;
/// Of a mesh of which each place gets a box by vertices, not by corners of the mesh's own box.
constexpr std::size_t kFewVertices = 2000;

/// So many rays are worked on together.
constexpr std::size_t kTogether = detail::RayLanes::kCount;

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
  unsigned int geometry = RTC_INVALID_GEOMETRY_ID, triangle = RTC_INVALID_GEOMETRY_ID;
};

/// Of the upper scene: an instance hides the number of what it holds.
unsigned int geometry_of(const RTCHit& hit) {
  return hit.instID[0] != RTC_INVALID_GEOMETRY_ID ? hit.instID[0] : hit.geomID;
}

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

bool is_identity(const RigidTransform& t) {
  return t == RigidTransform{};
}

void widen(Box3& box, double by) {
  const Vec3 margin{by, by, by};
  box.min = box.min - margin;
  box.max = box.max + margin;
}

}  // namespace

struct RayScene::State {
  /// What Embree knows by one number.
  struct Geometry {
    const TriMesh* mesh = nullptr;
    RigidTransform model_from_mesh;
    bool moved = false, skirt = false;
    std::uint32_t object = 0;
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
  [[nodiscard]] std::array<char, kTogether> within_walls(const detail::RayLanes& rays) const;
  [[nodiscard]] static detail::RayLanes ways_of(std::span<const ShadowRay> rays, double off_mm,
                                                Vec3 origin);
  [[nodiscard]] bool walls_block(Vec3 start, Vec3 direction, double length) const;
  void meshes_block(std::span<const ShadowRay> rays, std::span<bool> blocked) const;
};

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
  const Vec3 shift = g.model_from_mesh.point(part.middle) - middle;
  const std::array<Vec3, 4> column{g.model_from_mesh.direction({1, 0, 0}),
                                   g.model_from_mesh.direction({0, 1, 0}),
                                   g.model_from_mesh.direction({0, 0, 1}), shift};
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
  const auto add = [&](const TriMesh* mesh, const RigidTransform& pose, bool moved, bool skirt,
                       std::size_t object) {
    const Box3 part = mesh->bounds();
    if (part.empty()) return;
    Box3 corners;
    for (int corner = 0; corner < 8; ++corner) {
      const Vec3 p = pose.point({(corner & 1) != 0 ? part.max.x : part.min.x,
                                 (corner & 2) != 0 ? part.max.y : part.min.y,
                                 (corner & 4) != 0 ? part.max.z : part.min.z});
      (skirt ? walls : meshes).box.add(p);
      corners.add(p);
      whole.add(p);
    }
    if (!skirt) {
      // A turned mesh is smaller than its box, turned.
      Box3 box;
      if (moved && mesh->vertices_mm.size() <= kFewVertices)
        for (const Vec3& v : mesh->vertices_mm) box.add(pose.point(v));
      boxes.push_back(box.empty() ? corners : box);
    }
    geometries.push_back({mesh, pose, moved, skirt, static_cast<std::uint32_t>(object)});
  };
  for (std::size_t i = 0; i < objects.size(); ++i) {
    const RayObject& o = objects[i];
    if (o.mesh != nullptr)
      add(o.mesh, o.model_from_mesh, uses[o.mesh] > 1 || !is_identity(o.model_from_mesh), false, i);
    if (o.field == nullptr) continue;
    const heightmap::ModelField& f = *o.field;
    terrains.push_back({heightmap::FieldTracer(f), static_cast<std::uint32_t>(i)});
    const auto range = heightmap::height_range(f.z_mm);
    if (!std::isfinite(range.min)) continue;
    for (const double z : {static_cast<double>(range.min), static_cast<double>(range.max)}) {
      whole.add({f.x_mm(0), f.y_mm(0), z});
      whole.add({f.x_mm(f.z_mm.cols() - 1), f.y_mm(f.z_mm.rows() - 1), z});
    }
    if (!std::isfinite(o.base_mm)) continue;
    skirt_meshes.push_back(std::make_unique<TriMesh>(detail::field_skirt(f, o.base_mm)));
    add(skirt_meshes.back().get(), {}, false, true, i);
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
    return geometry.moved ? geometry.model_from_mesh.point(v) : v;
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

bool RayScene::inside(Vec3 point_mm) const {
  for (const double way : {-1.0, 1.0})
    if (const auto hit = first_hit(point_mm, {0.0, 0.0, way}))
      if (!hit->front || hit->distance_mm <= offset_mm()) return true;
  return false;
}

}  // namespace maquette::camera

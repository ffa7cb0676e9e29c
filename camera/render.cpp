// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/render.hpp"

#include <atomic>
#include <cmath>
#include <limits>
#include <numbers>

#include <fmt/format.h>
#include <tbb/blocked_range.h>
#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include "camera/disc_samples.hpp"
#include "camera/ray_scene.hpp"
#include "core/check.hpp"
#include "core/random.hpp"

namespace maquette::camera {
namespace {

constexpr int kTile = 16;            ///< pixels; 16 x 16 rays stay in one part of the tree
constexpr int kRimChecks = 16;       ///< points of the lens rim that must be in the open
constexpr double kBuildShare = 0.3;  ///< of the progress shown
constexpr std::int64_t kMaxPixels = std::int64_t{1} << 30;
constexpr int kMaxSamples = 1 << 16;

bool finite(Vec3 v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

/// Two unit vectors that make a right-handed frame with the unit vector n.
/// Duff et al. 2017, JCGT 6(1), "Building an orthonormal basis, revisited".
std::array<Vec3, 2> across(Vec3 n) {
  const double sign = std::copysign(1.0, n.z);
  const double a = -1.0 / (sign + n.z), b = n.x * n.y * a;
  return {Vec3{1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x},
          Vec3{b, sign + n.y * n.y * a, -n.y}};
}

/// The lamp, worked out once.
struct Light {
  Vec3 centre, axis, across_x, across_y;
  double radius_mm = 0.0;
  double target_distance_squared = 0.0;
  double cos_half_beam = -1.0;

  explicit Light(const Lamp& lamp)
      : centre(lamp.position_mm), radius_mm(0.5 * lamp.lens_diameter_mm) {
    const Vec3 to_target = lamp.target_mm - lamp.position_mm;
    target_distance_squared = dot(to_target, to_target);
    axis = normalized(to_target);
    const auto frame = across(axis);
    across_x = frame[0];
    across_y = frame[1];
    cos_half_beam = std::cos(0.5 * degrees(lamp.beam_deg).value());
  }
  [[nodiscard]] Vec3 point(DiscPoint p) const {
    return centre + radius_mm * (p.x * across_x + p.y * across_y);
  }
  /// The beam has the same cone about every point of the lens.
  [[nodiscard]] bool in_beam(Vec3 from, Vec3 to) const {
    const Vec3 way = to - from;
    return dot(way, axis) >= cos_half_beam * norm(way);
  }
};

struct View {
  Vec3 eye;
  RigidTransform model_from_camera;
  double pitch_mm, focal_mm, middle_x, middle_y;

  View(const CameraModel& camera, const RigidTransform& pose)
      : eye(pose.translation_mm),
        model_from_camera(pose),
        pitch_mm(1e-3 * camera.pixel_pitch_um),
        focal_mm(camera.focal_length_mm),
        middle_x(0.5 * camera.width_px),
        middle_y(0.5 * camera.height_px) {}
  [[nodiscard]] Vec3 direction(double x_px, double y_px) const {
    return normalized(model_from_camera.direction(
        {pitch_mm * (x_px - middle_x), -pitch_mm * (y_px - middle_y), -focal_mm}));
  }
};

Result<void> check_camera(const CameraModel& camera, const RigidTransform& pose) {
  if (camera.width_px < 1 || camera.height_px < 1 ||
      std::int64_t{camera.width_px} * camera.height_px > kMaxPixels)
    return fail(kCameraOutOfRange, fmt::format("image of {} x {} pixels: each side must be at "
                                               "least 1 and the product at most {}",
                                               camera.width_px, camera.height_px, kMaxPixels));
  if (!(camera.pixel_pitch_um > 0.0) || !(camera.focal_length_mm > 0.0) ||
      !std::isfinite(camera.pixel_pitch_um) || !std::isfinite(camera.focal_length_mm))
    return fail(kCameraOutOfRange,
                fmt::format("pixel pitch {} um and focal length {} mm must be positive",
                            camera.pixel_pitch_um, camera.focal_length_mm));
  const Quaternion& q = pose.rotation;
  const double length = q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z;
  if (!finite(pose.translation_mm) || !std::isfinite(length))
    return fail(kPoseNotFinite,
                "the camera's pose has a number that is not finite; position and "
                "target must differ");
  if (std::abs(length - 1.0) > 1e-6)
    return fail(
        kPoseNotFinite,
        fmt::format("the camera's quaternion has length {}, a rotation has 1", std::sqrt(length)));
  return {};
}

Result<void> check_lamp(const Lamp& lamp) {
  if (!finite(lamp.position_mm) || !finite(lamp.target_mm) || lamp.position_mm == lamp.target_mm)
    return fail(kCameraOutOfRange,
                "the lamp's position and target must be finite and differ from each other");
  if (!(lamp.lens_diameter_mm >= 0.0) || !std::isfinite(lamp.lens_diameter_mm))
    return fail(kCameraOutOfRange,
                fmt::format("lens diameter {} mm: 0 or more expected", lamp.lens_diameter_mm));
  if (!(lamp.beam_deg > 0.0 && lamp.beam_deg <= 360.0))
    return fail(
        kCameraOutOfRange,
        fmt::format("beam of {} degrees: a full angle in (0, 360] expected", lamp.beam_deg));
  return {};
}

Result<void> check_options(const RenderOptions& options) {
  const int side = static_cast<int>(std::lround(std::sqrt(std::max(0, options.samples_per_pixel))));
  if (options.samples_per_pixel < 1 || side * side != options.samples_per_pixel ||
      options.samples_per_pixel > kMaxSamples)
    return fail(kCameraOutOfRange,
                fmt::format("{} samples per pixel: a square number (1, 4, 9, ... {}) expected",
                            options.samples_per_pixel, kMaxSamples));
  if (options.lamp_samples < 1 ||
      std::int64_t{options.lamp_samples} * options.samples_per_pixel > kMaxSamples)
    return fail(kCameraOutOfRange,
                fmt::format("{} lamp samples for each of {} pixel samples: at least 1 and at most "
                            "{} together expected",
                            options.lamp_samples, options.samples_per_pixel, kMaxSamples));
  if (!(options.exposure_scale >= 0.0) || !std::isfinite(options.exposure_scale))
    return fail(kCameraOutOfRange,
                fmt::format("exposure scale {}: 0 or more expected", options.exposure_scale));
  return {};
}

Result<void> check_objects(const std::vector<SceneObject>& objects) {
  std::size_t triangles = 0;
  for (const SceneObject& object : objects) {
    MAQUETTE_TRY_VOID(check_material(object.material));
    if (object.mesh != nullptr) triangles += object.mesh->triangles.size();
  }
  if (triangles == 0) return fail(kEmptyScene, "the scene has no triangle; give at least one mesh");
  return {};
}

/// The camera is where a camera can be: outside every solid and not under one that
/// has no ground below it (a lander's deck overhead is fine).
Result<void> check_above_ground(const RayScene& scene, Vec3 eye) {
  const auto place = [eye] {
    return fmt::format("the camera at ({:.3f}, {:.3f}, {:.3f}) mm", eye.x, eye.y, eye.z);
  };
  if (scene.inside(eye))
    return fail(kUnderGround, place() + " is inside the solid or on its surface; move it up");
  const auto above = scene.first_hit(eye, {0.0, 0.0, 1.0});
  if (above && !scene.first_hit(eye, {0.0, 0.0, -1.0}))
    return fail(kUnderGround,
                place() + fmt::format(" is below the model, whose underside is {:.3f} mm above it",
                                      above->distance_mm));
  return {};
}

Result<void> check_lamp_in_the_open(const RayScene& scene, const Light& light) {
  for (int i = 0; i <= kRimChecks; ++i) {
    const double turn = 2.0 * std::numbers::pi * i / kRimChecks;
    const DiscPoint p = i == kRimChecks ? DiscPoint{} : DiscPoint{std::cos(turn), std::sin(turn)};
    const Vec3 at = light.point(p);
    if (scene.inside(at))
      return fail(kLampInSurface,
                  fmt::format("the lamp's lens at ({:.3f}, {:.3f}, {:.3f}) mm reaches into the "
                              "surface; move the lamp or make its lens smaller",
                              at.x, at.y, at.z));
    if (light.radius_mm == 0.0 && i == 0) break;
  }
  return {};
}

class Renderer {
 public:
  Renderer(const RayScene& scene, const std::vector<Material>& materials, const View& view,
           const Light& light, const RenderOptions& options, bool lens)
      : scene_(scene), materials_(materials), view_(view), light_(light), options_(options) {
    side_ = static_cast<int>(std::lround(std::sqrt(options.samples_per_pixel)));
    lamp_samples_ = lens ? options.lamp_samples : 1;
    lens_ = lens;
  }

  void pixel(Image& image, std::ptrdiff_t row, std::ptrdiff_t col,
             std::vector<DiscPoint>& lens_points) const {
    const auto x = static_cast<double>(col), y = static_cast<double>(row);
    const Vec3 centre_way = view_.direction(x + 0.5, y + 0.5);
    const auto centre = scene_.first_hit(view_.eye, centre_way);
    if (centre) {
      image.depth_mm(row, col) = static_cast<float>(centre->distance_mm);
      image.lit(row, col) = arriving(*centre, light_.centre) > 0.0 ? 1 : 0;
    }

    const auto number = static_cast<std::uint64_t>(row * image.radiance.cols() + col);
    const std::uint64_t stream = random_bits(options_.seed, 2 * number);
    lens_points.assign(1, DiscPoint{});
    if (lens_)
      stratified_disc(options_.samples_per_pixel * lamp_samples_,
                      random_bits(options_.seed, 2 * number + 1), lens_points);
    double sum = 0.0;
    for (int s = 0; s < options_.samples_per_pixel; ++s) {
      auto hit = centre;
      Vec3 way = centre_way;
      if (side_ > 1) {
        const auto draw = 2 * static_cast<std::uint64_t>(s);
        way = view_.direction(x + (s % side_ + random_uniform(stream, draw)) / side_,
                              y + (s / side_ + random_uniform(stream, draw + 1)) / side_);
        hit = scene_.first_hit(view_.eye, way);
      }
      if (!hit) continue;
      for (int l = 0; l < lamp_samples_; ++l) {
        const auto which = lens_ ? static_cast<std::size_t>(s * lamp_samples_ + l) : 0;
        sum += brightness(*hit, way, light_.point(lens_points[which]));
      }
    }
    image.radiance(row, col) = static_cast<float>(options_.exposure_scale * sum /
                                                  (options_.samples_per_pixel * lamp_samples_));
  }

 private:
  /// Cosine of incidence of the light from one point of the lens; 0 in shadow.
  [[nodiscard]] double arriving(const RayHit& hit, Vec3 lamp) const {
    const Vec3 way = lamp - hit.point_mm;
    const double facing = dot(way, hit.normal);
    if (facing <= 0.0 || !light_.in_beam(lamp, hit.point_mm) ||
        scene_.blocked(hit.point_mm, hit.normal, lamp))
      return 0.0;
    return facing / norm(way);
  }
  [[nodiscard]] double brightness(const RayHit& hit, Vec3 view, Vec3 lamp) const {
    const double emission = -dot(view, hit.normal);
    if (emission <= 0.0) return 0.0;
    const double incidence = arriving(hit, lamp);
    if (incidence <= 0.0) return 0.0;
    const Vec3 way = lamp - hit.point_mm;
    const Angles angles{incidence, emission, -dot(view, way) / norm(way)};
    return radiance_factor(materials_[hit.object].law, angles)[1] * light_.target_distance_squared /
           dot(way, way);
  }

  const RayScene& scene_;
  const std::vector<Material>& materials_;
  const View& view_;
  const Light& light_;
  const RenderOptions& options_;
  int side_ = 1, lamp_samples_ = 1;
  bool lens_ = false;
};

}  // namespace

Result<Image> render(const std::vector<SceneObject>& objects, const CameraModel& camera,
                     const RigidTransform& model_from_camera, const Lamp& lamp,
                     const RenderOptions& options, const RunContext& run) {
  MAQUETTE_TRY_VOID(check_camera(camera, model_from_camera));
  MAQUETTE_TRY_VOID(check_lamp(lamp));
  MAQUETTE_TRY_VOID(check_options(options));
  MAQUETTE_TRY_VOID(check_objects(objects));

  std::vector<const TriMesh*> meshes;
  std::vector<Material> materials;
  for (const SceneObject& object : objects) {
    if (object.mesh == nullptr || object.mesh->triangles.empty()) continue;
    meshes.push_back(object.mesh);
    materials.push_back(object.material);
  }
  MAQUETTE_TRY(const auto scene, RayScene::build(meshes, run));
  run.progress(kBuildShare);

  const View view(camera, model_from_camera);
  const Light light(lamp);
  MAQUETTE_TRY_VOID(check_above_ground(scene, view.eye));
  MAQUETTE_TRY_VOID(check_lamp_in_the_open(scene, light));

  const std::ptrdiff_t rows = camera.height_px, cols = camera.width_px;
  Image image{Grid<float>(rows, cols, 0.0F),
              Grid<float>(rows, cols, std::numeric_limits<float>::infinity()),
              Grid<std::uint8_t>(rows, cols, 0)};
  const Renderer renderer(scene, materials, view, light, options, lamp.lens_diameter_mm > 0.0);
  const std::ptrdiff_t tiles_across = (cols + kTile - 1) / kTile;
  const std::ptrdiff_t tiles = tiles_across * ((rows + kTile - 1) / kTile);
  std::atomic<std::ptrdiff_t> done{0};
  tbb::enumerable_thread_specific<std::vector<DiscPoint>> lens_points;
  tbb::parallel_for(tbb::blocked_range<std::ptrdiff_t>(0, tiles, 1), [&](const auto& range) {
    for (std::ptrdiff_t tile = range.begin(); tile < range.end(); ++tile) {
      const std::ptrdiff_t top = tile / tiles_across * kTile, left = tile % tiles_across * kTile;
      for (std::ptrdiff_t r = top; r < std::min(rows, top + kTile); ++r) {
        if (run.stopped()) return;
        for (std::ptrdiff_t c = left; c < std::min(cols, left + kTile); ++c)
          renderer.pixel(image, r, c, lens_points.local());
      }
      const std::ptrdiff_t now = ++done;
      if (now % 16 == 0 || now == tiles)
        run.progress(kBuildShare +
                     (1.0 - kBuildShare) * static_cast<double>(now) / static_cast<double>(tiles));
    }
  });
  if (run.stopped()) return fail(kCancelled, "stopped while the picture was rendered");
  return image;
}

RigidTransform look_at(Vec3 position_mm, Vec3 target_mm, Vec3 up) {
  const Vec3 back = normalized(position_mm - target_mm);  // camera z
  Vec3 right = cross(up, back);
  // Straight up or down: north is up in the picture.
  if (norm(right) <= 1e-9 * norm(up)) right = cross(Vec3{0, 1, 0}, back);
  right = normalized(right);
  const Vec3 top = cross(back, right);
  // Rotation matrix with columns right, top, back to quaternion: Shepperd 1978,
  // doi:10.2514/3.55767b (divide by the largest component).
  const double xx = right.x, yy = top.y, zz = back.z;
  const std::array<double, 4> weight{xx + yy + zz, xx - yy - zz, yy - xx - zz, zz - xx - yy};
  const auto largest = std::max_element(weight.begin(), weight.end()) - weight.begin();
  Quaternion q;
  const double root = std::sqrt(1.0 + weight[static_cast<std::size_t>(largest)]);
  const double k = 0.5 / root;
  switch (largest) {
    case 0:
      q = {0.5 * root, k * (top.z - back.y), k * (back.x - right.z), k * (right.y - top.x)};
      break;
    case 1:
      q = {k * (top.z - back.y), 0.5 * root, k * (right.y + top.x), k * (back.x + right.z)};
      break;
    case 2:
      q = {k * (back.x - right.z), k * (right.y + top.x), 0.5 * root, k * (top.z + back.y)};
      break;
    default:
      q = {k * (right.y - top.x), k * (back.x + right.z), k * (top.z + back.y), 0.5 * root};
  }
  return {normalized(q), position_mm};
}

}  // namespace maquette::camera

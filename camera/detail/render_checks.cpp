// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/detail/render_checks.hpp"

#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "camera/effects/frame.hpp"

namespace maquette::camera::detail {
namespace {

constexpr int kRimChecks = 16;  ///< points of the lens rim that must be in the open
constexpr std::int64_t kMaxPixels = std::int64_t{1} << 30;
constexpr int kMaxSamples = 1 << 16;

bool finite(Vec3 v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

bool is_square(int n) {
  const int side = static_cast<int>(std::lround(std::sqrt(std::max(0, n))));
  return n >= 1 && side * side == n;
}

Result<void> check_radiance(const Bands& bands, const char* what) {
  for (const double b : bands)
    if (!(b >= 0.0) || !std::isfinite(b))
      return fail(kCameraOutOfRange,
                  fmt::format("{} has a radiance of {}; 0 or more expected", what, b));
  return {};
}

}  // namespace

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
  if (!(camera.aspect > 0.0) || !std::isfinite(camera.aspect) || !std::isfinite(camera.skew_px) ||
      std::isinf(camera.principal_x_px) || std::isinf(camera.principal_y_px))
    return fail(
        kCameraOutOfRange,
        fmt::format("aspect {}, skew {} or principal point ({}, {}) of the camera makes no "
                    "sense",
                    camera.aspect, camera.skew_px, camera.principal_x_px, camera.principal_y_px));
  Intrinsics k = intrinsics_of(camera.width_px, camera.height_px, camera.pixel_pitch_um,
                               camera.focal_length_mm);
  k.fy_px *= camera.aspect;
  k.skew_px = camera.skew_px;
  if (!std::isnan(camera.principal_x_px)) k.cx_px = camera.principal_x_px;
  if (!std::isnan(camera.principal_y_px)) k.cy_px = camera.principal_y_px;
  MAQUETTE_TRY_VOID(check(k));
  const LensOpening& lens = camera.lens;
  if (!(lens.f_number >= 0.0) || !std::isfinite(lens.f_number) || !(lens.focus_mm >= 0.0) ||
      !std::isfinite(lens.rotation_deg))
    return fail(
        kCameraOutOfRange,
        fmt::format("a lens of f-number {}, focused at {} mm, turned by {} degrees; a finite "
                    "f-number and a distance of 0 or more and a finite turn expected",
                    lens.f_number, lens.focus_mm, lens.rotation_deg));
  if (lens.blades != 0 && (lens.blades < 3 || lens.blades > 30))
    return fail(kCameraOutOfRange,
                fmt::format("a lens of {} blades: 0 (round) or 3 to 30 expected", lens.blades));
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

Result<void> check_options(const RenderOptions& options) {
  if (!is_square(options.samples_per_pixel) || options.samples_per_pixel > kMaxSamples)
    return fail(kCameraOutOfRange,
                fmt::format("{} samples per pixel: a square number (1, 4, 9, ... {}) expected",
                            options.samples_per_pixel, kMaxSamples));
  if (options.lamp_samples < 1 ||
      std::int64_t{options.lamp_samples} * options.samples_per_pixel > kMaxSamples)
    return fail(kCameraOutOfRange,
                fmt::format("{} lamp samples for each of {} pixel samples: at least 1 and at most "
                            "{} together expected",
                            options.lamp_samples, options.samples_per_pixel, kMaxSamples));
  if (options.gather_samples < 0 ||
      std::int64_t{options.gather_samples} * options.samples_per_pixel > kMaxSamples)
    return fail(kCameraOutOfRange,
                fmt::format("{} gather samples for each of {} pixel samples: 0 or more and at most "
                            "{} together expected",
                            options.gather_samples, options.samples_per_pixel, kMaxSamples));
  if (!(options.exposure_scale >= 0.0) || !std::isfinite(options.exposure_scale))
    return fail(kCameraOutOfRange,
                fmt::format("exposure scale {}: 0 or more expected", options.exposure_scale));
  for (const double w : options.white_balance)
    if (!(w >= 0.0) || !std::isfinite(w))
      return fail(kCameraOutOfRange, fmt::format("white balance {}: 0 or more expected", w));
  if (!(options.noise_target >= 0.0) || !std::isfinite(options.noise_target))
    return fail(kCameraOutOfRange, fmt::format("noise target {}: a share of 0 or more expected",
                                               options.noise_target));
  if (options.noise_target > 0.0 &&
      (options.max_samples < options.samples_per_pixel || options.max_samples > kMaxSamples))
    return fail(kCameraOutOfRange,
                fmt::format("at most {} samples: {} to {} expected", options.max_samples,
                            options.samples_per_pixel, kMaxSamples));
  return {};
}

Result<void> check_lighting(const Lighting& lighting) {
  for (const Lamp& lamp : lighting.lamps) MAQUETTE_TRY_VOID(check_lamp(lamp));
  MAQUETTE_TRY_VOID(check_radiance(lighting.ambient, "the surroundings"));
  for (const Panel& panel : lighting.panels) {
    MAQUETTE_TRY_VOID(check_radiance(panel.radiance, "a panel"));
    const double area = norm(cross(panel.side_a_mm, panel.side_b_mm));
    if (!finite(panel.corner_mm) || !(area > 0.0) || !std::isfinite(area))
      return fail(kCameraOutOfRange,
                  "a panel needs a finite corner and two sides that span an area");
  }
  return {};
}

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

Result<void> check_lens_above_ground(const RayScene& scene, const ThinLens& lens) {
  for (int i = 0; i < kRimChecks; ++i) {
    const double turn = 2.0 * std::numbers::pi * i / kRimChecks;
    const Vec3 at = lens.place({std::cos(turn), std::sin(turn)});
    if (scene.inside(at))
      return fail(kUnderGround, fmt::format("the rim of the camera's lens at ({:.3f}, {:.3f}, "
                                            "{:.3f}) mm reaches into the surface; move the camera, "
                                            "or stop its lens down",
                                            at.x, at.y, at.z));
  }
  return {};
}

Result<void> check_lamp_in_the_open(const RayScene& scene, const Light& light) {
  if (light.sun()) return {};
  for (int i = 0; i <= kRimChecks; ++i) {
    const double turn = 2.0 * std::numbers::pi * i / kRimChecks;
    const DiscPoint p = i == kRimChecks ? DiscPoint{} : DiscPoint{std::cos(turn), std::sin(turn)};
    const Vec3 at = light.point(p);
    if (scene.inside(at))
      return fail(kLampInSurface,
                  fmt::format("the lamp's lens at ({:.3f}, {:.3f}, {:.3f}) mm reaches into the "
                              "surface; move the lamp or make its lens smaller",
                              at.x, at.y, at.z));
    if (!light.extended()) break;
  }
  return {};
}

}  // namespace maquette::camera::detail

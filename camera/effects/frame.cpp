// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/frame.hpp"

#include <cmath>
#include <numbers>

#include <fmt/format.h>

namespace maquette::camera {
namespace {

constexpr double kWidestDeg = 170.0;    ///< a pinhole's picture of 180 degrees has no end
constexpr double kNarrowestDeg = 1e-4;  ///< 0.4 seconds of arc: no lens of this trade
constexpr double kDegree = std::numbers::pi / 180.0;

}  // namespace

std::string_view name_of(Signal signal) {
  switch (signal) {
    case Signal::radiance:
      return "radiance";
    case Signal::photons:
      return "photons";
    case Signal::electrons:
      return "electrons";
    case Signal::dn:
      return "numbers of the converter";
    case Signal::linear:
      return "developed values";
    case Signal::display:
      return "display values";
  }
  return "";
}

double field_of_view_rad(double pixels, double pitch_um, double focal_length_mm) {
  return 2.0 * std::atan(pixels * pitch_um * 1e-3 / (2.0 * focal_length_mm));
}

Intrinsics intrinsics_of(int width_px, int height_px, double pixel_pitch_um,
                         double focal_length_mm) {
  const double f = focal_length_mm / (pixel_pitch_um * 1e-3);
  return {width_px, height_px, f, f, 0.5 * width_px, 0.5 * height_px, 0.0};
}

Result<void> check(const Intrinsics& k) {
  const auto wrong = [](const std::string& what) { return fail(kIntrinsics, what); };
  constexpr int kLargest = 100000;
  if (k.width_px < 1 || k.height_px < 1 || k.width_px > kLargest || k.height_px > kLargest)
    return wrong(fmt::format("resolution {} x {} pixels; 1 to {} each way is possible", k.width_px,
                             k.height_px, kLargest));
  for (const double v : {k.fx_px, k.fy_px, k.cx_px, k.cy_px, k.skew_px})
    if (!std::isfinite(v))
      return wrong(
          "the camera matrix K has an entry that is not a number; give focal length, "
          "principal point and skew in pixels");
  if (!(k.fx_px > 0.0) || !(k.fy_px > 0.0))
    return wrong(fmt::format("focal length {} x {} pixels: it must be positive", k.fx_px, k.fy_px));
  for (const double fov : {2.0 * std::atan(0.5 * k.width_px / k.fx_px) / kDegree,
                           2.0 * std::atan(0.5 * k.height_px / k.fy_px) / kDegree})
    if (fov > kWidestDeg || fov < kNarrowestDeg)
      return wrong(
          fmt::format("the field of view is {:.6g} degrees for {} x {} pixels; {} to {} "
                      "is possible: check focal length (mm) and pixel pitch (um)",
                      fov, k.width_px, k.height_px, kNarrowestDeg, kWidestDeg));
  if (k.fx_px > 10.0 * k.fy_px || k.fy_px > 10.0 * k.fx_px)
    return wrong(
        fmt::format("fx is {} and fy {} pixels: no pixel is that oblong", k.fx_px, k.fy_px));
  if (std::abs(k.skew_px) > k.fx_px)
    return wrong(
        fmt::format("skew {} pixels is more than 45 degrees (fx = {})", k.skew_px, k.fx_px));
  if (std::abs(k.cx_px - 0.5 * k.width_px) > 1.5 * k.width_px ||
      std::abs(k.cy_px - 0.5 * k.height_px) > 1.5 * k.height_px)
    return wrong(
        fmt::format("principal point ({}, {}) lies more than a picture's size outside "
                    "{} x {} pixels",
                    k.cx_px, k.cy_px, k.width_px, k.height_px));
  return {};
}

Result<void> in_range(std::string_view effect, std::string_view key, double value, double low,
                      double high) {
  if (value >= low && value <= high) return {};
  return fail(kEffectOutOfRange,
              fmt::format("{}.{} is {}; {} to {} is possible", effect, key, value, low, high));
}

Result<void> check(const Shot& s) {
  MAQUETTE_TRY_VOID(check(s.intrinsics));
  MAQUETTE_TRY_VOID(in_range("camera", "pixel_pitch_um", s.pixel_pitch_um, 0.01, 1000.0));
  MAQUETTE_TRY_VOID(in_range("camera", "focal_length_mm", s.focal_length_mm, 0.1, 1e5));
  MAQUETTE_TRY_VOID(in_range("camera", "f_number", s.f_number, 0.5, 1000.0));
  MAQUETTE_TRY_VOID(in_range("exposure", "time_s", s.exposure_s, 1e-9, 1e6));
  MAQUETTE_TRY_VOID(in_range("sensor", "full_well_e", s.full_well_e, 1.0, 1e9));
  MAQUETTE_TRY_VOID(in_range("sensor", "gain_e_per_dn", s.gain_e_per_dn, 0.0, 1e9));
  MAQUETTE_TRY_VOID(in_range("sensor", "bits", s.bits, 1, 24));
  MAQUETTE_TRY_VOID(
      in_range("sensor", "black_level_dn", s.black_level_dn, 0.0, 0.9 * std::ldexp(1.0, s.bits)));
  MAQUETTE_TRY_VOID(in_range("sensor", "temperature_c", s.temperature_c, -200.0, 150.0));
  if (s.wavelength_nm.empty() || s.quantum_efficiency.empty())
    return fail(kEffectOutOfRange,
                "a camera needs a wavelength and a quantum efficiency for each "
                "band, or one for all");
  if (s.quantum_efficiency.size() != 1 && s.quantum_efficiency.size() != 3)
    return fail(
        kEffectOutOfRange,
        fmt::format("{} values of quantum efficiency; one (grey) or three (red, green, blue) "
                    "are possible",
                    s.quantum_efficiency.size()));
  for (const double v : s.wavelength_nm)
    MAQUETTE_TRY_VOID(in_range("sensor", "wavelength_nm", v, 10.0, 1e5));
  for (const double v : s.quantum_efficiency)
    MAQUETTE_TRY_VOID(in_range("sensor", "quantum_efficiency", v, 1e-6, 1.0));
  for (const Vec3& v : {s.velocity_mm_s, s.angular_rate_rad_s})
    if (!std::isfinite(v.x) || !std::isfinite(v.y) || !std::isfinite(v.z))
      return fail(kEffectOutOfRange, "the camera's velocity or angular rate is not a number");
  if (!std::isfinite(s.time_s))
    return fail(kEffectOutOfRange, "the time of the shot is not a number");
  return {};
}

}  // namespace maquette::camera

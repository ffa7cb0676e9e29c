// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file frame.hpp
/// What flows through the effects of a camera, and what all of them know about the shot.
///
/// Row 0 is the UPPER row; pixel centres are at half integers, (0, 0) is the upper left corner.

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string_view>
#include <vector>

#include "core/grid.hpp"
#include "core/result.hpp"
#include "core/vec.hpp"

namespace maquette::camera {

inline constexpr ErrorCode kEffectOutOfRange{"CAMERA_EFFECT_OUT_OF_RANGE"};
/// Not one or three bands, sizes that differ, values that are not finite, depth that is missing.
inline constexpr ErrorCode kFrame{"CAMERA_FRAME"};
inline constexpr ErrorCode kIntrinsics{"CAMERA_INTRINSICS"};

/// What a pixel's number counts. Light becomes charge, charge becomes a number.
enum class Signal {
  radiance,   ///< linear, 1: see Exposure
  photons,    ///< that arrive at the pixel during the exposure
  electrons,  ///< in the pixel's well
  dn,         ///< numbers of the converter
  linear,     ///< developed: 0 black, 1 white, linear in light
  display,    ///< 0 to 1, encoded for a screen
};
[[nodiscard]] std::string_view name_of(Signal signal);

/// Colour of pixel (row, col) of a mosaic: the letters of the first two rows.
struct BayerPattern {
  std::array<int, 4> band{0, 1, 1, 2};  ///< of (0, 0), (0, 1), (1, 0), (1, 1); rggb
  [[nodiscard]] int at(std::ptrdiff_t row, std::ptrdiff_t col) const {
    return band[static_cast<std::size_t>(2 * (row & 1) + (col & 1))];
  }
};

struct Frame {
  Signal signal = Signal::radiance;
  /// One (grey) or three (red, green, blue); of a mosaic one.
  std::vector<Grid<float>> bands;
  /// mm along the ray through the pixel's centre, infinite: background; empty: not known.
  Grid<float> depth_mm{};
  std::optional<BayerPattern> mosaic{};
  /// Which lamps' light arrives, as render() says; nothing acts on it, but it goes where the lens
  /// bends the picture to, so that edges of shadows are known in the photograph; empty: not known.
  Grid<float> lit{};
};

/// The camera matrix K = [fx skew cx; 0 fy cy; 0 0 1] in pixels. OpenCV puts pixel centres at whole
/// numbers: its cx and cy are these less one half.
struct Intrinsics {
  int width_px = 1024, height_px = 768;
  double fx_px = 4000.0, fy_px = 4000.0;
  double cx_px = 512.0, cy_px = 384.0;
  double skew_px = 0.0;
};

struct Vec2 {
  double x = 0.0, y = 0.0;
};

/// K with square pixels and the principal point in the middle.
[[nodiscard]] Intrinsics intrinsics_of(int width_px, int height_px, double pixel_pitch_um,
                                       double focal_length_mm);
/// Full angle that `pixels` of `pitch` see: FOV = 2 atan(r d / (2 f)), radians.
[[nodiscard]] double field_of_view_rad(double pixels, double pitch_um, double focal_length_mm);

/// Tangents of the field angles of a place in the image, and back.
[[nodiscard]] inline Vec2 tangents(const Intrinsics& k, Vec2 px) {
  const double y = (px.y - k.cy_px) / k.fy_px;
  return {(px.x - k.cx_px - k.skew_px * y) / k.fx_px, y};
}
[[nodiscard]] inline Vec2 pixel(const Intrinsics& k, Vec2 t) {
  return {k.fx_px * t.x + k.skew_px * t.y + k.cx_px, k.fy_px * t.y + k.cy_px};
}

/// @return CAMERA_INTRINSICS: sizes, focal lengths not positive; a field of view that is empty or
///         above 170 degrees; a skew or an aspect that no lens and sensor have; a principal point
///         more than a picture's size outside
[[nodiscard]] Result<void> check(const Intrinsics& k);

/// What the effects share.
struct Shot {
  Intrinsics intrinsics;
  double pixel_pitch_um = 8.45;
  double focal_length_mm = 35.0;
  double f_number = 8.0;
  double exposure_s = 0.01;
  std::vector<double> wavelength_nm{600.0, 540.0, 460.0};  ///< middle of each band
  /// Electrons for a photon in each band, filter and fill factor included.
  std::vector<double> quantum_efficiency{0.25, 0.35, 0.25};
  double full_well_e = 60000.0;
  double gain_e_per_dn = 0.0;  ///< of the converter; 0: full well and black level fill its range
  int bits = 14;
  double black_level_dn = 0.0;
  double temperature_c = 20.0;                 ///< of the sensor
  Vec3 velocity_mm_s{}, angular_rate_rad_s{};  ///< of the camera: see motion.hpp
  std::uint64_t serial = 1;                    ///< of the sensor: whose fixed pattern it is
  std::uint64_t seed = 1;
  double time_s = 0.0;  ///< simulation time: the same time, the same noise
};
[[nodiscard]] Result<void> check(const Shot& shot);

/// Of a list with one value for all bands or one for each.
[[nodiscard]] inline double of_band(const std::vector<double>& values, std::size_t band) {
  return values[values.size() == 1 ? 0 : band];
}

/// What an effect is called, where it stands, and why there.
struct EffectInfo {
  std::string_view name;
  Signal takes, gives;
  std::string_view why;  ///< continues "it acts here because ..."
};

/// Works on one row of every band in place. Thread-safe.
using RowFunction = std::function<void(std::ptrdiff_t row, const std::vector<std::span<float>>&)>;

/// CAMERA_EFFECT_OUT_OF_RANGE unless low <= value <= high.
[[nodiscard]] Result<void> in_range(std::string_view effect, std::string_view key, double value,
                                    double low, double high);

}  // namespace maquette::camera

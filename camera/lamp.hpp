// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file lamp.hpp
/// Lamps: where light comes from, how much of it arrives, in which colour.
///
/// A lamp with a lens (diameter 0: a point) shines from `position_mm` towards `target_mm`. On a
/// surface that faces it at its target the irradiance is `colour`; elsewhere it goes with 1/d^2 and
/// with the intensity at the angle off the axis: a table, or even inside the beam and nothing
/// outside. Every point of the lens has the same share of the light and the same intensity law, so
/// the lens gives penumbrae (a Fresnel lens at a distance of many diameters). A sun stands in the
/// direction of `position_mm` seen from `target_mm`, as an evenly bright disc; its irradiance is
/// the same everywhere.
///
/// In a picture 1.0 is the radiance of a white Lambert surface under irradiance 1;
/// white_radiance() says how many W m^-2 sr^-1 that is.

#include <filesystem>
#include <memory>
#include <optional>
#include <span>
#include <string_view>
#include <vector>

#include "camera/disc_samples.hpp"
#include "camera/reflectance/angles.hpp"
#include "core/result.hpp"
#include "core/vec.hpp"

namespace maquette::camera {

inline constexpr ErrorCode kIntensityFile{"CAMERA_INTENSITY_FILE"};

/// Intensity over the angle off the axis and the azimuth about it, in the file's unit.
struct IntensityTable {
  std::vector<double> angle_deg;    ///< off the axis, ascending, from 0
  std::vector<double> azimuth_deg;  ///< ascending from 0; one entry: the same all around
  std::vector<double> intensity;    ///< angle runs fastest

  /// Linear between angles, 0 beyond the last, azimuths mirrored as LM-63 says.
  [[nodiscard]] double at(double angle_deg, double azimuth_deg) const;
};

/// `.ies`: ANSI/IES LM-63 (1991 to 2019), type C, the lamp's axis at vertical angle 0. Other names:
/// CSV with the head `angle_deg,intensity`, the same all around; lines that begin with # say what
/// they like.
/// CORE_FILE_*; CAMERA_INTENSITY_FILE: what is wrong and where.
[[nodiscard]] Result<IntensityTable> read_intensity(const std::filesystem::path& path);
/// The content of such a CSV. @param name  for messages
[[nodiscard]] Result<IntensityTable> read_intensity_csv(const std::filesystem::path& name,
                                                        std::string_view text);

/// Luminous flux by the axis' intensity, sr: exact for intensities that are linear between the
/// table's angles; azimuths by the degree. A cone of half angle a that is even: 2 pi (1 - cos a).
/// @pre intensity on the axis > 0
[[nodiscard]] double solid_angle_sr(const IntensityTable& table);

struct Lamp {
  Vec3 position_mm{-3000.0, 500.0, 2500.0};
  Vec3 target_mm;
  double lens_diameter_mm = 0.0;  ///< 0: point
  double beam_deg = 56.0;         ///< full angle; nothing outside, also with a table
  std::shared_ptr<const IntensityTable> intensity{};  ///< null: even inside the beam
  std::optional<double> sun_diameter_deg{};  ///< a sun of this angular diameter, 0: a point
  Bands colour{1.0, 1.0, 1.0};               ///< irradiance at the target, facing the lamp
};

/// A lamp, worked out once.
class Light {
 public:
  explicit Light(const Lamp& lamp);

  /// Does it have a size, so that it needs samples?
  [[nodiscard]] bool extended() const { return radius_ > 0.0; }
  [[nodiscard]] bool sun() const { return sun_; }

  /// What one point of the lens or disc sends to `at_mm`.
  struct Arrival {
    Vec3 direction;      ///< unit, towards the lamp
    double distance_mm;  ///< infinite for a sun
    double strength;     ///< of the irradiance on a surface that faces it, times colour()
  };
  [[nodiscard]] Arrival arrive(Vec3 at_mm, DiscPoint p) const;
  /// The same for many places, each from its own point: faster, the same bits.
  /// @pre all three are of one length
  void arrive(std::span<const Vec3> at_mm, std::span<const DiscPoint> p,
              std::span<Arrival> to) const;
  [[nodiscard]] const Bands& colour() const { return colour_; }

  /// Points of the lens; not for a sun.
  [[nodiscard]] Vec3 point(DiscPoint p) const {
    return centre_ + radius_ * (p.x * across_x_ + p.y * across_y_);
  }

 private:
  Vec3 centre_, axis_, across_x_, across_y_;
  double radius_ = 0.0;  ///< mm; tangent of the sun's half angle
  double target_distance_squared_ = 0.0, cos_half_beam_ = -1.0, axis_intensity_ = 1.0;
  std::shared_ptr<const IntensityTable> table_;
  Bands colour_;
  bool sun_ = false;
};

/// CAMERA_OPTION_OUT_OF_RANGE with what is wrong.
[[nodiscard]] Result<void> check_lamp(const Lamp& lamp);

}  // namespace maquette::camera

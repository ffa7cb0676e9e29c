// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file photo_render.hpp
/// What falls on a sensor, without noise: pinhole with distortion, one lamp, light from all round,
/// light from the surface itself. Written from the definitions of the case file alone.
///
/// Values: 1 is a white Lambert surface that faces the lamp at its target when `scale` is 1.
/// Lengths mm, angles rad, pixels from the upper left corner, centres at half integers. The camera
/// looks along its -z, y up; tangents x = (px - w/2) / f, y = (h/2 - py) / f.
///
/// A pixel is the mean over its square: 2 x 2 places, one drawn in each quarter, and 4 x 4 where
/// these differ by more than kFine of the lamp's scale or only some meet the surface. Of a lamp
/// with an extent every place draws four points, and the 4 x 4 places where shadows of these
/// differ.

#include <array>
#include <cstdint>
#include <vector>

#include "challenge/photo_relief.hpp"

namespace challenge {

struct PhotoCamera {
  Vec3 place;
  maquette::Quaternion turn;  ///< model_from_camera
  int width = 1024, height = 768;
  double focal_px = 4142.0;
  double k1 = 0, k2 = 0;                      ///< real = ideal (1 + k1 r^2 + k2 r^4), tangents
  std::array<double, 3> band_scale{1, 1, 1};  ///< magnification of each band, besides
  std::array<double, 3> band_k1{0, 0, 0};     ///< of each band, added to k1
};
/// Unit direction in the model frame of what lies at (px, py) of the picture.
Vec3 ray_at(const PhotoCamera& camera, double px, double py, int band);
/// Where the picture has a place of the model. @pre in front of the camera
std::array<double, 2> pixel_of(const PhotoCamera& camera, Vec3 place, int band);
/// Camera at `place` that looks at `target`, its y axis as near to z as can be, then rolled.
maquette::Quaternion looking(Vec3 place, Vec3 target, double roll);

struct PhotoLamp {
  Vec3 place, target;
  double reference = 1;     ///< where a surface has `scale`: distance of the lamp as declared
  double scale = 1;         ///< exposure_scale
  double beam_half = 0.49;  ///< even inside, nothing outside
  double diameter = 0;      ///< of a disc that faces the target
  double power = 2;         ///< of the distance
  double hot_spot = 0;      ///< width of a Gaussian in the angle from the axis; 0: even
};
/// Light on a surface that faces the lamp's point `from`, without shadow.
double light_at(const PhotoLamp& lamp, Vec3 from, Vec3 place);

struct Paint {
  double albedo = 0.3;
  Field factor;                   ///< of the albedo; n = 0: 1
  double roughness = 0;           ///< Oren-Nayar's sigma, rad
  double surge = 0, width = 0.1;  ///< 1 + surge / (1 + tan(phase / 2) / width)
  double gloss = 0, lobe = 0.25;  ///< reflectance at normal incidence and Beckmann's slope
  double albedo_at(double x, double y) const;
};
/// Radiance over that of white which faces the light; zero from behind. Unit vectors.
double reflected(const Paint& paint, double albedo, Vec3 normal, Vec3 to_lamp, Vec3 to_eye);

struct PhotoScene {
  const Relief* relief = nullptr;
  Paint paint;
  /// What a level place in the open gets of it, of each band, over the lamp's scale.
  std::array<double, 3> ambient{0, 0, 0};
  Field openness;  ///< share of it that reaches a place; n = 0: not needed
};
/// Radiance of the room from a direction with z above 0, over that of an even room as bright on a
/// level place.
struct Room {
  double zenith = 0;  ///< 1: an overcast sky, thrice as bright above as at the horizon
  Vec3 side;          ///< towards a wall with windows, level; its length how much
  double from(Vec3 d) const;
};
/// What of the room's light reaches places of a grid of `step`, over a level place in the open.
Field openness_of(const Relief& relief, const Room& room, double step, int rays,
                  std::uint64_t seed);
/// Light (over white that faces the lamp) that comes from the surface itself after 1 to `bounces`
/// reflections, on a grid of `step`.
Field bounced_light(const Relief& relief, const Paint& paint, const PhotoLamp& lamp, int bounces,
                    double step, int rays, std::uint64_t seed);

/// Row by row from above.
struct Plane {
  int width = 0, height = 0;
  std::vector<float> v;
  float& at(int row, int col) {
    return v[static_cast<std::size_t>(row) * static_cast<std::size_t>(width) +
             static_cast<std::size_t>(col)];
  }
  float at(int row, int col) const { return const_cast<Plane*>(this)->at(row, col); }
};
Plane make_plane(int width, int height);
using Picture = std::array<Plane, 3>;

inline constexpr double kFine = 0.02;

/// @param bounced  n = 0: none
/// @param margin  pixels more on every side
/// @param stride  of every stride x stride pixels only the middle one
Picture render(const PhotoScene& scene, const PhotoCamera& camera, const PhotoLamp& lamp,
               const Field& bounced, int margin, int stride, std::uint64_t seed);

}  // namespace challenge

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file photo_case.hpp
/// Cases of photographs whose truth is known: three places of the camera, two of the lamp, six
/// pictures of the designed surface, drawn from the seed. What a case file declares is what the
/// world would be without what is hidden.

#include <array>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <utility>
#include <vector>

#include "challenge/photo_render.hpp"
#include "challenge/photo_sensor.hpp"

namespace challenge {

/// Effects that can be hidden, by the names of the library; and things without a name.
const std::vector<std::string>& photo_hideable();
const std::vector<std::string>& photo_nameless();

inline constexpr int kPoses = 3, kLamps = 2, kPhotos = kPoses * kLamps;

struct PhotoOptions {
  std::uint64_t seed = 1;
  std::vector<std::string> effects;
  double size = 1.0;          ///< of all effects, over what is usual
  std::vector<double> sizes;  ///< of each effect, besides; empty: 1
  Relief::Between between = Relief::Between::bilinear;
  int width = 1024, height = 768;
  int held_out = 0;   ///< the last ones
  bool weigh = true;  ///< PhotoHidden's weights: a tenth more time
};

/// One photograph: pose k / kLamps, lamp k % kLamps.
struct Photo {
  PhotoCamera camera;
  PhotoLamp lamp;
  Lens lens;
  Sensor sensor;
};

struct PhotoHidden {
  std::string effect;
  double size = 1.0;  ///< factor on what is usual
  std::vector<std::pair<std::string, double>> parameters;
  std::string photographs = "all";
  /// What the case's pictures have otherwise for its sake alone: root mean square over pixels that
  /// see the surface, of 255; and over the noise as declared, over all pixels. The limit of an
  /// ideal detector that knows everything else.
  double rms_255 = 0, over_noise = 0;
};

struct PhotoWorld {
  Field design;
  double pixel_pitch_um = 8.45, focal_mm = 35;
  std::array<Photo, kPhotos> photos;
  Paint paint;
  std::array<double, 3> ambient{0, 0, 0};
  Room room;
  double bounce = 0;
  int bounces = 3;
  /// On the light that reaches the sensor, before it becomes electrons.
  std::vector<std::function<void(Picture&, int photo)>> stains;
};

/// As declared: nothing is hidden.
PhotoWorld draw_photo_world(const PhotoOptions& options, Draw& d);
/// Hides one effect; draws the same numbers whatever its size. @throw std::runtime_error no such
/// effect
PhotoHidden hide_in_photos(const std::string& effect, double size, PhotoWorld& world, Draw& d);

/// design.tif, photo_1.exr .. photo_6.exr, case.toml, truth.json in `folder`.
std::vector<PhotoHidden> make_photo_case(const PhotoOptions& options,
                                         const std::filesystem::path& folder);

}  // namespace challenge

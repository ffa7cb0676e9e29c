// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file picture_noise.hpp
/// Noise laid over a finished picture without a model of a sensor, as programs do that make mock-up
/// photographs: hot pixels (white), colour noise (each band for itself) and monochrome noise (all
/// bands alike), normal, in parts of white. For comparison with such pictures; a camera has the
/// effects of its sensor instead.

#include "camera/effects/frame.hpp"

namespace maquette::camera {

struct PictureNoise {
  double hot_pixel_share = 0.0;  ///< of all pixels, others in each shot
  double colour_sigma = 0.0, monochrome_sigma = 0.0;

  static constexpr EffectInfo kInfo{
      "picture_noise", Signal::linear, Signal::linear,
      "it stands for the noise of a developed picture, before a tone curve bends it"};
};

[[nodiscard]] Result<void> check(const PictureNoise& e, const Shot& shot);
[[nodiscard]] RowFunction rows(const PictureNoise& e, const Shot& shot, const Frame& frame);

}  // namespace maquette::camera

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file shot_noise.hpp
/// Charge comes in whole electrons at random: a Poisson count of the mean that light, smear and
/// heat have given. EMVA 1288 release 4.0, section 2.1: variance = mean.

#include "camera/effects/frame.hpp"

namespace maquette::camera {

struct ShotNoise {
  static constexpr EffectInfo kInfo{
      "shot_noise", Signal::electrons, Signal::electrons,
      "electrons of light and of heat are counted together; what is added later is not counted"};
};

[[nodiscard]] inline Result<void> check(const ShotNoise&, const Shot&) {
  return {};
}
[[nodiscard]] RowFunction rows(const ShotNoise& e, const Shot& shot, const Frame& frame);

}  // namespace maquette::camera

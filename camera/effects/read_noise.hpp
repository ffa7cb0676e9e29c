// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file read_noise.hpp
/// Noise of the readout chain: normal, independent from pixel to pixel and shot to shot.
/// EMVA 1288 release 4.0, section 2.3 (sigma_d).

#include "camera/effects/frame.hpp"

namespace maquette::camera {

struct ReadNoise {
  double sigma_e = 10.0;  ///< electrons

  static constexpr EffectInfo kInfo{"read_noise", Signal::electrons, Signal::electrons,
                                    "the amplifier adds its noise when the charge is read, after "
                                    "the well and before the converter"};
};

[[nodiscard]] Result<void> check(const ReadNoise& e, const Shot& shot);
[[nodiscard]] RowFunction rows(const ReadNoise& e, const Shot& shot, const Frame& frame);

}  // namespace maquette::camera

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file bayer.hpp
/// A filter over each pixel: of three bands one remains. Bayer 1976, US patent 3 971 065.

#include <string>

#include "camera/effects/frame.hpp"

namespace maquette::camera {

struct Bayer {
  std::string pattern = "rggb";  ///< of the two upper rows; rggb, bggr, grbg, gbrg

  static constexpr EffectInfo kInfo{
      "bayer", Signal::photons, Signal::photons,
      "the filters lie on the pixels: a photon passes its filter before it frees an electron"};
};

/// Two of g and one each of r and b.
[[nodiscard]] std::optional<BayerPattern> bayer_pattern(std::string_view letters);
[[nodiscard]] Result<void> check(const Bayer& e, const Shot& shot);
/// Three bands become one; grey frames stay as they are.
void apply(const Bayer& e, const Shot& shot, Frame& frame);

}  // namespace maquette::camera

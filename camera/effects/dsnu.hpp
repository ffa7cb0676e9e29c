// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file dsnu.hpp
/// Dark signal non-uniformity: each pixel has an offset of its own, normal about 0, the same in
/// every shot of a sensor. EMVA 1288 release 4.0, section 4.3 (DSNU1288). It is an offset of the
/// readout, not charge: it may be negative and has no shot noise. Pixels of high dark current:
/// HotPixels.

#include "camera/effects/frame.hpp"

namespace maquette::camera {

struct Dsnu {
  double sigma_e = 1.0;  ///< electrons

  static constexpr EffectInfo kInfo{
      "dsnu", Signal::electrons, Signal::electrons,
      "each pixel's amplifier adds its own offset to charge that has been collected and counted"};
};

[[nodiscard]] Result<void> check(const Dsnu& e, const Shot& shot);
[[nodiscard]] RowFunction rows(const Dsnu& e, const Shot& shot, const Frame& frame);

}  // namespace maquette::camera

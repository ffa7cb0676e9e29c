// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file prnu.hpp
/// Photo response non-uniformity: each pixel has a gain of its own, normal about 1, the same in
/// every shot of a sensor. EMVA 1288 release 4.0, section 4.3 (PRNU1288).

#include "camera/effects/frame.hpp"

namespace maquette::camera {

struct Prnu {
  double sigma = 0.005;  ///< of the gain, 1 = 100 %

  static constexpr EffectInfo kInfo{"prnu", Signal::electrons, Signal::electrons,
                                    "pixels differ in how they turn light into charge, not in the "
                                    "charge that comes after it (dark current, noise)"};
};

[[nodiscard]] Result<void> check(const Prnu& e, const Shot& shot);
[[nodiscard]] RowFunction rows(const Prnu& e, const Shot& shot, const Frame& frame);

}  // namespace maquette::camera

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file adc.hpp
/// Gain and converter: DN = black level + charge / gain, rounded, from 0 to 2^bits - 1.
/// Gain, bits and black level are the shot's, for developing needs them too.
/// EMVA 1288 release 4.0, section 2.1 (K = 1 / gain), and 2.3: rounding adds 1/12 DN^2.

#include "camera/effects/frame.hpp"

namespace maquette::camera {

struct Adc {
  static constexpr EffectInfo kInfo{"adc", Signal::electrons, Signal::dn,
                                    "what has been read is turned into whole numbers"};
};

/// Electrons for one number.
[[nodiscard]] double gain_of(const Shot& shot);
/// The highest number.
[[nodiscard]] double largest_dn(const Shot& shot);
[[nodiscard]] inline Result<void> check(const Adc&, const Shot&) {
  return {};
}
[[nodiscard]] RowFunction rows(const Adc& e, const Shot& shot, const Frame& frame);

}  // namespace maquette::camera

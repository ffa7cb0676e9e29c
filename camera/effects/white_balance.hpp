// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file white_balance.hpp
/// The black level is taken off, the converter's range becomes 0 to 1, and each band gets its gain:
/// a grey surface in the light of the scene is grey. Gains not given are those that undo the
/// differences of the bands' quantum efficiency. Values above 1 are kept: the tone curve clips
/// them.

#include "camera/effects/frame.hpp"

namespace maquette::camera {

struct WhiteBalance {
  std::vector<double> gains{0.0};  ///< one for all bands or one each; 0: from quantum efficiency

  static constexpr EffectInfo kInfo{
      "white_balance", Signal::dn, Signal::linear,
      "bands are weighed in numbers that are linear in light, before a tone curve bends them"};
};

[[nodiscard]] Result<void> check(const WhiteBalance& e, const Shot& shot);
[[nodiscard]] double gain_of_band(const WhiteBalance& e, const Shot& shot, std::size_t band);
[[nodiscard]] RowFunction rows(const WhiteBalance& e, const Shot& shot, const Frame& frame);

}  // namespace maquette::camera

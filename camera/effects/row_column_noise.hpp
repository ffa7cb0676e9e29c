// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file row_column_noise.hpp
/// Offsets that whole rows and columns share: rows are read one after the other through the same
/// reference, which is noisy (another offset in every shot); columns have an amplifier each (the
/// same in every shot). EMVA 1288 release 4.0, section 4.4 (row and column DSNU).

#include "camera/effects/frame.hpp"

namespace maquette::camera {

struct RowColumnNoise {
  double row_sigma_e = 0.0, column_sigma_e = 0.0;  ///< electrons

  static constexpr EffectInfo kInfo{
      "row_column_noise", Signal::electrons, Signal::electrons,
      "rows and columns share their amplifiers, through which the charge passes on its way to the "
      "converter"};
};

[[nodiscard]] Result<void> check(const RowColumnNoise& e, const Shot& shot);
[[nodiscard]] RowFunction rows(const RowColumnNoise& e, const Shot& shot, const Frame& frame);

}  // namespace maquette::camera

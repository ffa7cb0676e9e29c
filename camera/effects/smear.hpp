// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file smear.hpp
/// Smear of a frame transfer CCD: while a picture is shifted into its store, each pixel passes
/// under the light of its whole column, once on its way out and once, for the picture before, on
/// the way in. Each pixel gains the column's sum times shift time / exposure time:
///
///     S(r, c) = E(r, c) + (t_row / t) sum over r' != r of E(r', c)
///
/// Source: Powell, Chana, Fish, Thompson, "Restoration and frequency analysis of smeared CCD
/// images", Applied Optics 38, 1999, doi:10.1364/AO.38.001343.

#include "camera/effects/frame.hpp"

namespace maquette::camera {

struct Smear {
  double row_shift_s = 0.0;  ///< time under each row's light

  static constexpr EffectInfo kInfo{
      "smear", Signal::electrons, Signal::electrons,
      "light of the other rows is collected while the charge is shifted, before it is counted: its "
      "shot noise is real and it helps to fill the well"};
};

[[nodiscard]] Result<void> check(const Smear& e, const Shot& shot);
void apply(const Smear& e, const Shot& shot, Frame& frame);

}  // namespace maquette::camera

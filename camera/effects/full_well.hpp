// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file full_well.hpp
/// Saturation and blooming: a pixel holds `Shot::full_well_e`; of what is more a share spills along
/// its column, half upwards and half downwards, and fills the next wells that have room; the rest
/// goes into the drain (an antiblooming sensor has share 0, a bare CCD 1). Charge is conserved:
/// what stays, what is drained and what leaves at the two ends of the column add up to what was
/// there. Source: Janesick, Scientific Charge-Coupled Devices, SPIE 2001, section 4.2 (blooming),
/// doi:10.1117/3.374903.

#include "camera/effects/frame.hpp"

namespace maquette::camera {

struct FullWell {
  double blooming_share = 0.0;  ///< 0 to 1

  static constexpr EffectInfo kInfo{"full_well", Signal::electrons, Signal::electrons,
                                    "only charge that has been collected, noise included, can "
                                    "overflow, and only what stays in the "
                                    "well is read"};
};

struct LostCharge {
  double drained_e = 0.0, ends_e = 0.0;
};
/// One column in place. @param column  electrons, top to bottom
[[nodiscard]] LostCharge spill(std::span<double> column, double full_well_e, double blooming_share);

[[nodiscard]] Result<void> check(const FullWell& e, const Shot& shot);
void apply(const FullWell& e, const Shot& shot, Frame& frame);

}  // namespace maquette::camera

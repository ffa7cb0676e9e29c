// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file vignetting.hpp
/// Light falls towards the corners: naturally with the fourth power of the cosine of the field
/// angle (any textbook; Kolb et al. 1995, doi:10.1145/218380.218463), mechanically where the barrel
/// cuts the oblique beam: the share of the pupil's disc that a second disc of `barrel_ratio` times
/// its radius, displaced by `barrel_shift` pupil radii for each unit of the tangent, leaves open;
/// and as flats show it, a polynomial 1 + a2 q^2 + a4 q^4 + a6 q^6 in q = distance from the
/// principal point over half the diagonal.

#include "camera/effects/frame.hpp"

namespace maquette::camera {

struct Vignetting {
  double cosine_power = 4.0;
  double barrel_ratio = 0.0;  ///< 0: no barrel; else at least 1
  double barrel_shift = 0.0;
  std::vector<double> polynomial{0.0, 0.0, 0.0};  ///< a2, a4, a6

  static constexpr EffectInfo kInfo{"vignetting", Signal::radiance, Signal::radiance,
                                    "how much of the pupil a place of the sensor sees depends on "
                                    "where it lies, after the lens has "
                                    "bent the rays to it"};
};

/// Share of the unit disc inside a disc of radius `ratio` at distance `shift`.
[[nodiscard]] double disc_overlap(double ratio, double shift);
/// Light at a place of the picture over that on the axis.
[[nodiscard]] double fall_of_light(const Vignetting& e, const Shot& shot, Vec2 px);

[[nodiscard]] Result<void> check(const Vignetting& e, const Shot& shot);
[[nodiscard]] RowFunction rows(const Vignetting& e, const Shot& shot, const Frame& frame);

}  // namespace maquette::camera

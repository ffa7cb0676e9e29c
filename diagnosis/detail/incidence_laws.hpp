// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// How much farther than it is a surface is read that a beam meets obliquely.

#include <array>
#include <cmath>

namespace maquette::diagnosis::detail {

struct IncidenceLaw {
  const char *key, *name;
  /// Of a cosine of incidence; a coefficient in mm makes it a range.
  double (*of)(double cosine);
};

/// Zamecnikova and Neuner, VGI 2015: a tan^2 i; a (1 / cos i - 1) of a stretched spot.
inline constexpr std::array<IncidenceLaw, 4> kIncidenceLaws{{
    {"incidence_tan2", "tan^2", [](double c) { return 1.0 / (c * c) - 1.0; }},
    {"incidence_sec", "1 / cos - 1", [](double c) { return 1.0 / c - 1.0; }},
    {"incidence_sin2", "sin^2", [](double c) { return 1.0 - c * c; }},
    {"incidence_tan", "tan",
     [](double c) { return std::sqrt(std::fmax(0.0, 1.0 / (c * c) - 1.0)); }},
}};
/// Beams more oblique than that tell nothing of a law.
inline constexpr double kLeastCosine = 0.15;

}  // namespace maquette::diagnosis::detail

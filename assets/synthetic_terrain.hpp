// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file synthetic_terrain.hpp
/// The closed function behind the synthetic site: what it is made of.
///
///   height = base + fractal relief + craters + ripples
///
/// Fractal relief: gradient noise in octaves of wavelength 1600 m down to 1.6 m, each
/// turned against the last so that no lattice shows. Standard deviation of an octave
/// goes with wavelength to the power H = 0.95, the median Hurst exponent of the lunar
/// highlands (Rosenburg et al. 2011, doi:10.1029/2010JE003716), and to the power
/// 1.35 below 100 m, where soil creep smooths and craters carry the roughness
/// (assumed; chosen by eye against images of the Moon).
///
/// Craters: a Poisson process, so each place is evaluated without knowing any
/// other. Cumulative number per square metre N(> D) = 0.0794 D^-2 up to 64 m, the
/// steady state of small lunar craters (Trask 1966, JPL Tech. Rep. 32-800), and
/// falling with D^-3 above it, the production slope (Neukum, Ivanov, Hartmann 2001,
/// doi:10.1023/A:1011989004263). A fresh crater is 0.2 D deep from rim to floor
/// with a rim 0.036 D high (Pike 1977, Impact and Explosion Cratering, p. 489) and
/// ejecta that thin with the third power of distance (McGetchin et al. 1973,
/// doi:10.1016/0012-821X(73)90162-3), cut off smoothly at 2.5 radii. In regolith
/// even the freshest reach only 0.16 D (Stopar et al. 2017, Icarus 298, 34), and
/// most are worn to a fraction of that (distribution assumed).
///
/// Ripples: 4 m apart, at most 0.08 m high from mean to crest, in patches.

#include <cstdint>
#include <vector>

namespace maquette::assets {

/// Height of the plain on which everything stands, above the reference sphere.
/// Not zero, so that a lost offset is noticed.
inline constexpr double kSyntheticBase_m = -1500.0;

inline constexpr double kSmallestCrater_m = 2.0;
inline constexpr double kLargestCrater_m = 512.0;
/// Between the steady state (slope -2) and the production (slope -3).
inline constexpr double kEquilibriumCrater_m = 64.0;
inline constexpr double kEjectaReach = 2.5;  ///< crater radii
inline constexpr double kHurst = 0.95;       ///< of wavelengths above kCreepWavelength_m
inline constexpr double kCreepWavelength_m = 100.0;
inline constexpr double kCreepExponent = 0.4;  ///< added to kHurst below it

struct SyntheticCrater {
  double east_m = 0.0, north_m = 0.0;
  double diameter_m = 0.0;
  double freshness = 1.0;  ///< depth relative to that of a fresh crater, 0.06 .. 0.8
};

[[nodiscard]] double fractal_relief_m(std::uint64_t seed, double east_m, double north_m);
[[nodiscard]] double crater_relief_m(std::uint64_t seed, double east_m, double north_m);
[[nodiscard]] double ripple_relief_m(std::uint64_t seed, double east_m, double north_m);

/// One crater at `distance_m` from its centre.
[[nodiscard]] double crater_profile_m(const SyntheticCrater& crater, double distance_m);

/// All craters whose centre lies in [east_min, east_max) x [north_min, north_max).
[[nodiscard]] std::vector<SyntheticCrater> synthetic_craters(std::uint64_t seed, double east_min_m,
                                                             double north_min_m, double east_max_m,
                                                             double north_max_m);

/// Expected number of craters larger than `diameter_m` per square metre.
/// @pre kSmallestCrater_m <= diameter_m
[[nodiscard]] double crater_density_per_m2(double diameter_m);

}  // namespace maquette::assets

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file phase_range.hpp
/// What a phase-shift scanner measures when its beam meets several surfaces at once.
///
/// Method  Each part of the beam comes back as a phasor: amplitude a, phase 2 pi r / U, where
///         U (the unambiguous interval) is half the modulation wavelength. The detector adds
///         them; the argument of the sum is the measured phase. The coarsest wavelength says
///         where, each finer one says so better (the multiple of its interval that is nearest
///         to the coarser range).
/// Shows   Mixed pixels: two surfaces in one beam give a range between them, not on the line
///         between them by energy but by phasors; with a step of more than U / 2 of the finest
///         wavelength also in front or behind.
/// Accuracy  Where the ranges spread by less than U / 200 of the finest wavelength, their mean
///         by amplitude is taken: it differs from the argument by at most (2 pi / 200)^2 / 24 of
///         the spread (third cumulant of a two-point distribution), so by 4.2e-5 of it.
/// Source  Adams and Probert, "The interpretation of phase and intensity data from AMCW light
///         detection sensors", Int. J. Robotics Research 15(5), 1996,
///         doi:10.1177/027836499601500502

#include <span>

namespace maquette::scan {

struct BeamReturn {
  double range_mm = 0.0;
  double amplitude = 0.0;  ///< any unit, >= 0
};

struct PhaseRange {
  double range_mm = 0.0;   ///< in [0, coarsest interval)
  double amplitude = 0.0;  ///< of the sum, at the finest wavelength
};

/// @param unambiguous_mm  U, coarse to fine, > 0
/// @pre at least one return and one interval
[[nodiscard]] PhaseRange phase_range(std::span<const BeamReturn> returns,
                                     std::span<const double> unambiguous_mm);

}  // namespace maquette::scan

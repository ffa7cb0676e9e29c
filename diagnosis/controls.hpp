// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file controls.hpp
/// A diagnosis checked against itself: the same analysis of data whose truth is known, made at the
/// same places with the noise that was fitted.
///
/// Room    diagnosis:  measure -> diagnose -> [controls] -> report
/// Null        the accepted model and noise: whatever is claimed is a false claim
/// Recovery    the same and the named causes at their estimated size: they must come back
///
/// Noise   Points are white. At each scale of details (detail/sums.hpp) what the fit found above
///         that is a stationary Gaussian field of the squares' size, shared by all set-ups or of
///         one set-up; at the largest scale the fitted process. Fields are white noise coloured in
///         the spectrum; their details have the fitted variances (mean correlation over squares).
/// Places  Every k-th observation, k so that at most kControlPoints stay, white noise smaller by
///         sqrt(k): information on all that is wider than a few points is that of all of them.
/// Accuracy  variances of details within a third of the fitted ones; of thinned points up to half
///           as much again, which errs on the safe side (test).
/// Cost    a diagnosis of 40 000 points each, 2 to 3 s of processor time.

#include "diagnosis/diagnose.hpp"

namespace maquette::diagnosis {

inline constexpr std::size_t kControlPoints = 40'000;

/// Residuals of noise alone at these places, thinned by `every`.
[[nodiscard]] std::vector<double> simulated_noise(const std::vector<Observation>& places,
                                                  std::size_t set_ups, const Box3& box,
                                                  const FittedNoise& noise, double every,
                                                  std::uint64_t seed);

/// Which of the injected causes were found, and what else: recoveries and false claims.
void recover(const std::vector<Cause>& injected, const std::vector<Cause>& found,
             Controls& controls);

/// @return DIAGNOSIS_UNKNOWN_CAUSE, CORE_CANCELLED
[[nodiscard]] Result<Controls> controls(const Measurements& measurements,
                                        const Diagnosis& diagnosis, std::uint64_t seed,
                                        const RunContext& run = {});

}  // namespace maquette::diagnosis

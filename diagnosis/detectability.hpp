// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file detectability.hpp
/// How small could each cause be and still be found in measurements like these?
///
/// Takes   measurements (case_input.hpp); their places, stations and noise count, not what they say
/// Gives   the smallest size of each cause, and what another station would make of it
///
/// Method. Fisher information on each cause's coefficient, nuisances and the form's other columns
/// free, at the noise that the residuals have (effective weights, process of the cell means
/// included). A cause of size c is found if it is chosen on one third of the blocks and confirmed
/// on another: c sqrt(information) of each must pass its threshold with 90 %,
/// that is exceed it by 1.28.
/// Another station is tried at four sides, same distance and elevation as the first, same points
/// again, its own pose free.
/// Cost: as sums of diagnose, and once more a quarter of it for each station.

#include <string>
#include <vector>

#include "diagnosis/case_input.hpp"

namespace maquette::diagnosis {

struct Detectable {
  std::string effect, law, parameter;
  double smallest = 0.0;  ///< in the parameter's unit
  double rms_mm = 0.0;    ///< of what it then moves, registration taken off
};

struct ExtraStation {
  std::string where;
  Vec3 station_mm;
  /// By which factor the smallest size falls, by effect; only those of 1.2 and more.
  std::vector<std::pair<std::string, double>> better;
  double mean_factor = 1.0;  ///< geometric mean over all effects
};

struct Detectability {
  std::vector<Detectable> effects;
  std::vector<ExtraStation> stations;  ///< best first
  std::vector<std::string> untestable;
};

[[nodiscard]] Result<Detectability> detectability(const Measurements& measurements,
                                                  std::uint64_t seed, const RunContext& run = {});

/// Schema maquette.detectability/1.
[[nodiscard]] std::string to_json(const Detectability& detectability);

}  // namespace maquette::diagnosis

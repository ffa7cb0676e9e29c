// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// What a model leaves of each observation.

#include <string>
#include <unordered_map>
#include <vector>

#include "diagnosis/detail/lag_and_slack.hpp"
#include "diagnosis/detail/model_search.hpp"

namespace maquette::diagnosis::detail {

/// Signatures of columns at all observations, by key: they cost as much as a cut.
using Signatures = std::unordered_map<std::string, std::vector<float>>;
struct Beyond {
  std::vector<double> mm;   ///< one for each observation
  bool rows_moved = false;  ///< poses and the like were cut with, too
};
/// What cutting anew with all causes together moves beyond the sum of their signatures, mm.
/// @param coefficients  of nuisances and members, in the order of columns_of
/// @param rows_may_move  poses and what moves the whole part say where rows of the cut lie
[[nodiscard]] Beyond beyond_linear(const std::vector<Observation>& all,
                                   const std::vector<Member>& members, const Bank& bank,
                                   const Eigen::VectorXd& coefficients, double ball_radius_mm,
                                   Signatures& known, LagAndSlack& both, bool rows_may_move);
/// Residuals of a fitted model, its nuisances levelled on all sets (squares.hpp), mm.
[[nodiscard]] std::vector<double> residuals_of(const std::vector<Observation>& all,
                                               const std::vector<Member>& members, const Bank& bank,
                                               const Fit& f);

}  // namespace maquette::diagnosis::detail

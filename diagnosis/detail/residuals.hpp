// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// What a model leaves of each observation.

#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "diagnosis/detail/lag_and_slack.hpp"
#include "diagnosis/detail/model_search.hpp"

namespace maquette::diagnosis::detail {

/// Signatures of columns at all observations, by key: they cost as much as a cut.
using Signatures = std::unordered_map<std::string, std::vector<float>>;
/// What cutting anew with all causes together moves beyond the sum of their signatures, mm.
/// @param measured_mm  residuals as measured, which tell how much of the ridges between passes they
///   show; empty: all of them
/// @param coefficients  of nuisances and members, in the order of columns_of
/// @param has_ridges  whether a program is known: what moves the part then moves its ridges, beside
///   causes that act through the cut or not, so that models of either kind compare
/// @param wanted  one for each: 0 where no answer is needed, and what is there means nothing;
///   nullptr: all
[[nodiscard]] std::vector<double> beyond_linear(
    const std::vector<Observation>& all, std::span<const double> measured_mm,
    const std::vector<Member>& members, const Bank& bank, const Eigen::VectorXd& coefficients,
    double ball_radius_mm, bool has_ridges, Signatures& known, LagAndSlack& both,
    const std::vector<char>* wanted = nullptr);
/// Residuals of a fitted model, its nuisances levelled (squares.hpp), mm.
[[nodiscard]] std::vector<double> residuals_of(const std::vector<Observation>& all,
                                               const std::vector<Member>& members, const Bank& bank,
                                               const Fit& f);

}  // namespace maquette::diagnosis::detail

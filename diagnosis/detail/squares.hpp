// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// Plain sums of squares: every point alike, whatever the noise is. Shares, rms and what the
// simulation is believed are stated in these.

#include <vector>

#include "diagnosis/detail/sums.hpp"

namespace maquette::diagnosis::detail {

/// Coefficients with the causes held and the nuisances (the first ones) fitted by plain least
/// squares. A fit with a long process leaves poses to the process: its own nuisances may be off by
/// a constant, which is no misfit of the model.
[[nodiscard]] Eigen::VectorXd levelled(const Bank& bank, const std::vector<int>& model,
                                       Eigen::VectorXd coefficients, const std::vector<int>& sets);
/// Sum of squares over some sets, the nuisances levelled on them.
/// @param count  unless null: the points are added to it
[[nodiscard]] double squares(const Bank& bank, const std::vector<int>& model,
                             const Eigen::VectorXd& coefficients, const std::vector<int>& sets,
                             double* count);
/// rms of what one unit of a column moves, less what the nuisances take of it, all points alike.
[[nodiscard]] double rms_beside_nuisances(const Bank& bank, int column);

}  // namespace maquette::diagnosis::detail

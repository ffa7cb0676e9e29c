// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// Columns at many places. What bends passes is swept a dozen states of the program a place, and
// neighbouring places ask for the same ones: they are tabled first.

#include <array>
#include <functional>
#include <vector>

#include "diagnosis/effect.hpp"

namespace maquette::diagnosis::detail {

/// The one program that observations come from; nullptr without.
[[nodiscard]] const Pass* pass_of(const std::vector<Observation>& all);
/// Displacements of the tip at all states of a pass, mm.
using Displacements = std::vector<std::array<float, 3>>;
/// @param of  tip's displacement at a CutState
[[nodiscard]] Displacements displacements(const Pass& pass,
                                          const std::function<Vec3(const CutState&)>& of);

/// Column::value for places of `all`, which has to outlive it. While it lives it takes 12 bytes for
/// each state of the program (24 of a tangent), of columns that follow one of up to 6 million.
[[nodiscard]] std::function<double(const Observation&)> at_many_places(
    const Column& column, const std::vector<Observation>& all);

}  // namespace maquette::diagnosis::detail

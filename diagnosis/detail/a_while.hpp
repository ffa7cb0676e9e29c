// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// Waves that do not last for the whole program: a spindle comes into resonance and out of it again.
// Passes that swing leave the lowest that any of them reaches, so that what a wave does is mostly a
// step down where it begins and one up where it ends.

#include <array>
#include <optional>
#include <string>
#include <utility>
#include <vector>

#include "diagnosis/detail/linearised.hpp"

namespace maquette::diagnosis::detail {

/// A wave's ends, shares of the program's time, by what its law fixes; nullopt: it lasts all the
/// while.
[[nodiscard]] std::optional<std::array<double, 2>> ends_of(
    const std::vector<std::pair<std::string, double>>& fixed, double duration_min);

/// Waves among the members (Form::during) for the while in which they gain most, beside the others
/// or without those that stood for what they do, where that does better cut anew. Their forms
/// become candidates. Residuals are about the model that comes back.
[[nodiscard]] Members lasting_a_while(Members with, Search& search, Bank& bank,
                                      Linearised& residuals, const RunContext& run);

}  // namespace maquette::diagnosis::detail

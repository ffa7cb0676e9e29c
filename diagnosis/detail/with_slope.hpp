// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <vector>

#include "diagnosis/detail/linearised.hpp"

namespace maquette::diagnosis::detail {

/// What a law says more that has the slope of its curve.
inline constexpr const char* kWithSlope = ", with its slope";

/// A guide's sideways curve and the slope of the line that it is measured from, which is a
/// squareness of x and y by another name.
[[nodiscard]] Form with_slope(Form curve, const Scene& scene);

/// A guide that bends sideways is said from a line through its ends, or the best one: what lies
/// between these is no squareness. One that is not larger than that is the slope of the curve.
/// @post such are taken from `confirmed`, and told of
void join_slopes(const Search& search, const Bank& bank, Linearised& residuals,
                 std::vector<Confirmed>& confirmed, std::vector<Rejected>& rejected);

}  // namespace maquette::diagnosis::detail

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// What a large cause leaves because its signature is not exact is not to be named after a small
// one.

#include <cstddef>
#include <vector>

#include "diagnosis/detail/linearised.hpp"

namespace maquette::diagnosis::detail {

/// The square of what signatures may be wrong by (Effect::signature_error), as a share of what all
/// members explain together, each by its part of that.
/// @param explained  what is missed without each member: squares, or -2 log likelihood
/// @param but        a member whose own error does not count; members.size(): all do
[[nodiscard]] double wrong_share(const Members& members, const std::vector<double>& explained,
                                 std::size_t but);

/// The same beside the k-th, less where it does not look like an error of the others: where it
/// gains as much once each of their signatures is let grow and shrink smoothly over the part and
/// with the slope (a warp beside a scanner's spot, which has none of its length). Residuals are
/// about the members then.
/// @param sets  blocks that are looked at
[[nodiscard]] double wrong_share_like(std::size_t k, const Members& members,
                                      const std::vector<double>& explained, const Search& search,
                                      Bank& bank, Linearised& residuals,
                                      const std::vector<int>& sets);

/// Does the law of an effect leave nothing open (a scale, a step: Effect::signature_error of at
/// most 0.03)?
[[nodiscard]] bool has_exact_law(const Effect& effect);

/// Is what the k-th names not what the data show? A cause whose law leaves nothing open moves the
/// part by that law or is none: where its signature, let grow and shrink smoothly over the part,
/// with the slope and with height, explains more than chance would by a tenth of what it explains
/// as it is, another law is at work (a block that has crept by the cube of its height looks like a
/// scale of z). What the others' signatures may be wrong by (smoothly over the part and with the
/// slope) counts for none of that. Residuals are about the members then.
/// @param explained  squares that are missed without the k-th
[[nodiscard]] bool breaks_its_law(std::size_t k, const Members& members, double explained,
                                  const Search& search, Bank& bank, Linearised& residuals);

}  // namespace maquette::diagnosis::detail

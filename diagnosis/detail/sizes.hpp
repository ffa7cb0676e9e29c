// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// How large the causes of a model are, with standard errors.

#include <cstddef>
#include <vector>

#include "diagnosis/detail/linearised.hpp"

namespace maquette::diagnosis::detail {

/// Sizes of the k-th member as fitted, with standard errors: those of the fit, wider where the law
/// might have been another (Form::alternatives).
[[nodiscard]] std::vector<Estimate> sizes_of(const Search& search, const Bank& bank,
                                             const Members& members, const Fit& fit, std::size_t k);

/// The first size of the k-th in its standard errors, by its law as it stands: a law that is open
/// makes a size uncertain, not the cause.
[[nodiscard]] double sureness(const Bank& bank, const Members& members, const Fit& fit,
                              std::size_t k);

/// What is said of sizes once they are those of all points: errors by what is doubtful, lags that
/// follow from them; causes are sorted by their shares. Residuals are about the members then.
/// @pre diagnosis.causes are those of `members` with their sizes, in their order
/// @param doubtful  others that may be there (widen_by_doubtful); the bank has their columns, too
void settle_sizes(const Bank& bank, Linearised& residuals, const Members& members,
                  const Members& doubtful, Diagnosis& diagnosis);

/// Causes that were confirmed, but are too small beside the others to be named, may be there:
/// errors of the others' sizes come to hold what these would be beside each of them, too, and a
/// note says so where that is further off than twice a size's own error.
/// @pre diagnosis.causes are those of `members`, in their order
void widen_by_doubtful(const Bank& bank, Linearised& residuals, const Members& members,
                       const Members& doubtful, Diagnosis& diagnosis);

}  // namespace maquette::diagnosis::detail

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// What remains beside confirmed causes, and which of them stand beside that; then their names.

#include <functional>

#include "diagnosis/detail/linearised.hpp"
#include "diagnosis/diagnose.hpp"

namespace maquette::diagnosis::detail {

/// Of one claim that confirming blocks bear out. A law of noise that is a little too short makes
/// chances of smooth causes ten times too small: two that were not there had 2 to 3 in 10000.
inline constexpr double kConfirmLevel = 0.1 * kClaimLevel;

[[nodiscard]] Members members_of(const std::vector<Confirmed>& confirmed);

/// What a model leaves, in squares of mm over all points.
struct Left {
  double squares = 0.0, points = 0.0;
  double moved_mm = 0.0;    ///< rms of what the model explains
  double structured = 0.0;  ///< squares of what nothing explains
  double excess = 0.0;      ///< explained and structured together, above 0
};
/// @param null_squares  what the nuisances alone leave
[[nodiscard]] Left left_of(const Linearised& residuals, const Members& members, double null_squares,
                           const Remainder& remainder);

/// Judges what remains (diagnosis.remainder) and takes those causes from `confirmed` that are
/// smaller than what the simulation may be wrong by, explain less than what nothing explains, or
/// hang on a few odd places (diagnosis.rejected); residuals are about those that stay.
/// @return those that are smaller: they may be there
[[nodiscard]] Members keep_what_stands(const Search& search, Bank& bank, Linearised& residuals,
                                       double null_squares, std::vector<Confirmed>& confirmed,
                                       Diagnosis& diagnosis);
/// A cause that is another one and something beside it (a film from one side beside an even one) is
/// that other one where its own sizes are none; the rest's forms are chosen again beside it.
void make_plain(const Search& search, const Bank& bank, Linearised& residuals,
                std::vector<Confirmed>& confirmed);

/// A curve of many parameters fits whatever is smooth, where it is a micrometre better for what
/// second order leaves of a large cause. A law of a third of them or fewer that it looks like is
/// preferred where what it leaves more is less than it may be wrong by, and than is told apart.
void prefer_few_parameters(const Search& search, Bank& bank, Linearised& residuals,
                           std::vector<Confirmed>& confirmed);

/// Of causes that the rest of the data cannot tell apart the one that needs no shift of the scans:
/// a smaller ball whose tip was held leaves them where their files say, the film that looks the
/// same raises them all. The larger the shift that is spared, the less likely the data may be.
/// @param shift_mm  how far the poses of a fit are from those of the files
void prefer_poses_as_given(const Search& search, const Bank& bank, Linearised& residuals,
                           const std::function<double(const Fit&)>& shift_mm,
                           std::vector<Confirmed>& confirmed);

/// Makes confirmed causes those of the diagnosis, in their order, with what would do as well in
/// their place. Small ones that several others could stand for get no name.
/// @param doubtful  gets more that may be there
/// @return what has no name, as a share of the excess
[[nodiscard]] double name_causes(const Search& search, Bank& bank, Linearised& residuals,
                                 double null_squares, std::vector<Confirmed>& confirmed,
                                 Members& doubtful, Diagnosis& diagnosis);

}  // namespace maquette::diagnosis::detail

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// Which causes the choosing blocks ask for, cut anew with each other.

#include "diagnosis/detail/linearised.hpp"

namespace maquette::diagnosis::detail {

/// Chosen, cut anew, refined, dropped where not missed, changed for rivals that do better; again
/// from nothing with the residuals which that leaves, until the causes stay. Residuals are about
/// the model that comes back, and the weights of the bank's details those that it leaves.
/// @pre residuals are about no cause
/// @param ranking  what each candidate gains alone, best first
[[nodiscard]] Members choose_and_recut(Search& search, Bank& bank, Linearised& residuals,
                                       std::vector<Ranked>& ranking, const RunContext& run);

/// Lost motion alone is followed at the width that is found, and answers there as it does: with
/// the secant of another width what the machine or the scanner does to the ridges has a say. So
/// does a ball that runs out. Residuals are about the model that comes back.
[[nodiscard]] Members at_own_size(Members members, const Search& search, Bank& bank,
                                  Linearised& residuals);

/// Is one of its steps so large that what passes do beside the border is not of first order?
[[nodiscard]] bool is_large_step(const Bank& bank, const Members& with, std::size_t k,
                                 const Fit& f);

/// Steps told from those at moments nearby, cut anew: a ball that goes down by dz reaches over the
/// border by dz R / stepover, and to first order the step seems that much earlier or later and, for
/// all that contradicts it, half as large.
/// @param k      a member that has Form::move_moment
/// @param also   forms that were chosen before; where one of them does better than what is given,
///   or is what is given, it stays as it is
/// @param score  less is better; leaves the residuals about the model
[[nodiscard]] Members at_best_moments(Members with, std::size_t k, const std::vector<Form>& also,
                                      const Search& search, Bank& bank, Linearised& residuals,
                                      const RunContext& run,
                                      const std::function<double(const Members&)>& score);

/// In -2 log likelihood, what the last member's law may be wrong by (a ball does not wear by a
/// power of the length cut): causes more that gain no more than that only patch it up.
[[nodiscard]] double owed_to_its_law(const Members& with, Linearised& residuals);

/// Is it a step at some moment of the program?
[[nodiscard]] bool has_a_moment(const Member& member);

/// Is a lag (or lost motion) among them?
[[nodiscard]] bool follows_any(const Members& members, bool lag);

}  // namespace maquette::diagnosis::detail

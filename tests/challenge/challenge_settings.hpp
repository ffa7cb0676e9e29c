// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file challenge_settings.hpp
/// What challenges in scans and in photographs are told alike, and how their cases are run.

#include <cstdint>
#include <functional>
#include <map>
#include <string>
#include <vector>

namespace challenge {

struct CommonSettings {
  std::map<std::string, int> counts;  ///< of null, single, double, triple, outside
  std::uint64_t seed = 1;
  std::string program, effect, keep, picture;
  bool strict = false, all_right = false;
  int from = 0, only = -1;
  unsigned jobs = 1;
};

/// An option that only one of them knows; the value is empty for one without.
using OwnOption = std::function<bool(const std::string& option, const std::string& value)>;

/// @param words  what follows the program's name: first the program that diagnoses
/// @param full   counts of --full
/// @param flag   takes an option without a value; @param valued  one with
/// @return false: not understood
bool read_settings(const std::vector<std::string>& words, const std::map<std::string, int>& full,
                   const OwnOption& flag, const OwnOption& valued, CommonSettings& settings);

/// Of one case; the same for a seed, whatever else is run.
std::uint64_t seed_of(const CommonSettings& settings, const std::string& kind, int i);
/// What is hidden in a case, drawn by its seed.
/// @param in_turn  the names one after another
std::vector<std::string> effects_of(const CommonSettings& settings, const std::string& kind, int i,
                                    const std::vector<std::string>& names, bool in_turn);
/// Runs `one` for each case, as many at a time as is said.
void run_cases(const CommonSettings& settings,
               const std::function<void(const std::string& kind, int i)>& one);

}  // namespace challenge

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file challenge_score.hpp
/// What a diagnosis is worth whose truth is known: names, sizes, tables.

#include <map>
#include <string>
#include <utility>
#include <vector>

#include <nlohmann/json.hpp>

namespace challenge {

/// How often something that was hidden (or "null") was called something.
using Confusion = std::map<std::pair<std::string, std::string>, int>;

struct Verdict {
  std::string said;        ///< what the report says, for the log
  int wrong = 0;           ///< causes that are not hidden, nor equivalent to what is
  int missed = 0;          ///< what is hidden and not named
  bool none = false;       ///< no cause named
  bool remainder = false;  ///< something is said to be unexplained
  bool right = false;
  const char* word() const { return wrong > 0 ? "WRONG" : right ? "right" : "missed"; }
};
/// A cause is right under its own name or one of its equivalents, each hidden effect once.
/// @param kind  null: right if nothing is named nor left; outside: right if nothing is named and
///              something left; else: right if all is named and nothing else
Verdict judge(const std::string& kind, const std::vector<std::string>& hidden,
              const nlohmann::json& diagnosis, Confusion& confusion);

struct Count {
  int cases = 0, right = 0, wrong = 0, missed = 0, claimed = 0, unexplained = 0;
  void add(const Verdict& v);
};

/// Sizes that were found against those that were hidden, over the stated standard errors.
struct Sizes {
  int all = 0, covered = 0;  ///< by 95 % intervals
  double squares = 0.0, shares = 0.0;
};
/// Counts the size of a cause that was named as it was hidden, if the report has the parameter.
/// @return words for the log
std::string compare_size(const nlohmann::json& diagnosis, const std::string& effect,
                         const std::string& parameter, double hidden, Sizes& sizes);

/// What the report blocks gained over what they gain where nothing is hidden, the same noise.
struct Gains {
  int all = 0;
  double sum = 0.0, least = 1.0;
  /// @param before, after  rms on the report blocks; @param without  the same of the twin without
  ///   effects: what one who knows the causes leaves
  double add(double before, double after, double without);
};

struct Outcome {
  bool fell = false;  ///< a wrong name, a claim on nothing, or something outside explained
  bool all_right = true;
};
/// Prints a line for each kind of case, the sizes and the gains.
Outcome print_table(const std::map<std::string, Count>& counts, const Sizes& sizes,
                    const Gains& gains = {});

/// Drawn as SVG.
void write_confusion(const Confusion& table, const std::string& file);

}  // namespace challenge

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file meshing_table.hpp
/// Rows of what was measured beside what it should be.

#include <string>

#include <fmt/format.h>

namespace maquette::meshing {

struct Goal {
  enum class Kind { none, at_least, at_most } kind = Kind::none;
  double limit = 0.0;
};
inline Goal at_least(double limit) {
  return {Goal::Kind::at_least, limit};
}
inline Goal at_most(double limit) {
  return {Goal::Kind::at_most, limit};
}

/// `what | value unit | goal | holds or SHORT`
inline void row(const std::string& what, double value, const std::string& unit, Goal goal = {}) {
  std::string wanted, said;
  if (goal.kind != Goal::Kind::none) {
    const bool least = goal.kind == Goal::Kind::at_least;
    wanted = fmt::format("{} {:g}", least ? ">=" : "<=", goal.limit);
    said = (least ? value >= goal.limit : value <= goal.limit) ? "holds" : "SHORT";
  }
  fmt::print("  {:<66}{:>10.4g} {:<22}{:<10}{}\n", what, value, unit, wanted, said);
}

}  // namespace maquette::meshing

// SPDX-License-Identifier: GPL-3.0-or-later

// The expressions of RS-274: [..] with operators, functions with degrees.

#include <cmath>

#include <fmt/format.h>

#include "cnc/gcode_words.hpp"

namespace maquette::cnc {
namespace {

enum Operator : int {
  kNone,
  kPower,
  kTimes,
  kOver,
  kMod,
  kPlus,
  kMinus,
  kEq,
  kNe,
  kGt,
  kGe,
  kLt,
  kLe,
  kAnd,
  kOr,
  kXor
};

struct OperatorName {
  std::string_view text;
  Operator op;
  int level;
};
// "**" before "*": the first that fits is taken.
constexpr std::array<OperatorName, 15> kOperators{{{"**", kPower, 5},
                                                   {"*", kTimes, 4},
                                                   {"/", kOver, 4},
                                                   {"MOD", kMod, 4},
                                                   {"+", kPlus, 3},
                                                   {"-", kMinus, 3},
                                                   {"EQ", kEq, 2},
                                                   {"NE", kNe, 2},
                                                   {"GT", kGt, 2},
                                                   {"GE", kGe, 2},
                                                   {"LT", kLt, 2},
                                                   {"LE", kLe, 2},
                                                   {"AND", kAnd, 1},
                                                   {"OR", kOr, 1},
                                                   {"XOR", kXor, 1}}};

[[nodiscard]] double apply(Operator op, double a, double b) {
  const auto truth = [](bool yes) { return yes ? 1.0 : 0.0; };
  switch (op) {
    case kPower:
      return std::pow(a, b);
    case kTimes:
      return a * b;
    case kOver:
      return b == 0.0 ? NAN : a / b;
    case kMod: {  // the result has the divisor's sign, as in RS-274
      const double rest = std::fmod(a, b);
      return rest != 0.0 && (rest < 0.0) != (b < 0.0) ? rest + b : rest;
    }
    case kPlus:
      return a + b;
    case kMinus:
      return a - b;
    case kEq:
      return truth(a == b);
    case kNe:
      return truth(a != b);
    case kGt:
      return truth(a > b);
    case kGe:
      return truth(a >= b);
    case kLt:
      return truth(a < b);
    case kLe:
      return truth(a <= b);
    case kAnd:
      return truth(a != 0.0 && b != 0.0);
    case kOr:
      return truth(a != 0.0 || b != 0.0);
    case kXor:
      return truth((a != 0.0) != (b != 0.0));
    case kNone:
      break;
  }
  return NAN;
}

}  // namespace

bool LineParser::bracket(double& value) {
  if (++depth_ > kDeepestGcodeNesting)
    return set_fault("found more than 64 levels of nesting, expected fewer");
  const std::size_t start = at_++;
  if (!expression(value, 1)) return false;
  skip_blanks();
  if (at_ >= line_.size() || line_[at_] != ']')
    return set_fault(fmt::format("found {}, expected ']' or an operator", found()));
  ++at_;
  --depth_;
  if (!std::isfinite(value))
    return set_fault_at(
        start, "found an expression without a finite value (division by zero?), expected a number");
  return true;
}

int LineParser::peek_operator(int& level, std::size_t& length) const {
  for (const OperatorName& candidate : kOperators) {
    if (line_.size() - at_ < candidate.text.size()) continue;
    bool same = true;
    for (std::size_t i = 0; i < candidate.text.size() && same; ++i)
      same = gcode_upper(line_[at_ + i]) == candidate.text[i];
    if (!same) continue;
    level = candidate.level;
    length = candidate.text.size();
    return candidate.op;
  }
  return kNone;
}

// Precedence climbing; operators of equal level go from left to right, ** too.
bool LineParser::expression(double& value, int lowest) {
  skip_blanks();
  if (!real_value(value)) return false;
  for (;;) {
    skip_blanks();
    int level = 0;
    std::size_t length = 0;
    const int op = at_ < line_.size() ? peek_operator(level, length) : int{kNone};
    if (op == kNone || level < lowest) return true;
    at_ += length;
    double right = 0.0;
    if (!expression(right, level + 1)) return false;
    value = apply(static_cast<Operator>(op), value, right);
  }
}

bool LineParser::function(double& value) {
  const std::size_t start = at_;
  std::string name;
  while (at_ < line_.size() && line_[at_] != '[' && name.size() < 8) {
    if (!gcode_blank(line_[at_])) name += gcode_upper(line_[at_]);
    ++at_;
  }
  constexpr double kDegree = 3.14159265358979323846 / 180.0;
  const bool known = name == "ATAN" || name == "SIN" || name == "COS" || name == "TAN" ||
                     name == "ASIN" || name == "ACOS" || name == "SQRT" || name == "ABS" ||
                     name == "ROUND" || name == "FIX" || name == "FUP" || name == "EXP" ||
                     name == "LN";
  if (!known || at_ >= line_.size() || line_[at_] != '[') {
    at_ = start;
    return set_fault(fmt::format(
        "found {}, expected a number, '#', '[' or a function such as sin[..]", found()));
  }
  double x = 0.0;
  if (!bracket(x)) return false;
  if (name == "ATAN") {
    skip_blanks();
    if (at_ >= line_.size() || line_[at_] != '/')
      return set_fault(fmt::format("found {}, expected '/' as in atan[y]/[x]", found()));
    ++at_;
    skip_blanks();
    if (at_ >= line_.size() || line_[at_] != '[')
      return set_fault(fmt::format("found {}, expected '[' as in atan[y]/[x]", found()));
    double divisor = 0.0;
    if (!bracket(divisor)) return false;
    value = std::atan2(x, divisor) / kDegree;
  } else if (name == "SIN") {
    value = std::sin(x * kDegree);
  } else if (name == "COS") {
    value = std::cos(x * kDegree);
  } else if (name == "TAN") {
    value = std::tan(x * kDegree);
  } else if (name == "ASIN") {
    value = std::asin(x) / kDegree;
  } else if (name == "ACOS") {
    value = std::acos(x) / kDegree;
  } else if (name == "SQRT") {
    value = std::sqrt(x);
  } else if (name == "ABS") {
    value = std::abs(x);
  } else if (name == "ROUND") {
    value = std::round(x);
  } else if (name == "FIX") {
    value = std::floor(x);
  } else if (name == "FUP") {
    value = std::ceil(x);
  } else if (name == "EXP") {
    value = std::exp(x);
  } else {
    value = std::log(x);
  }
  if (!std::isfinite(value))
    return set_fault_at(
        start,
        fmt::format("found {}[{}], which has no value, expected an argument in range", name, x));
  return true;
}

}  // namespace maquette::cnc

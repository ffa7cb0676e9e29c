// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/gcode_words.hpp"

#include <charconv>
#include <cmath>
#include <cstring>

#include <fmt/format.h>

namespace maquette::cnc {
namespace {

// Larger numbers are a mistake in every unit.
constexpr double kLargestNumber = 1e10;
constexpr int kLastParameter = 5602;
constexpr int kFirstSystemParameter = 5061;

constexpr std::array<double, 19> kPowersOfTen{1e0,  1e1,  1e2,  1e3,  1e4,  1e5,  1e6,
                                              1e7,  1e8,  1e9,  1e10, 1e11, 1e12, 1e13,
                                              1e14, 1e15, 1e16, 1e17, 1e18};

[[nodiscard]] bool is_digit(char c) {
  return c >= '0' && c <= '9';
}
}  // namespace

std::string LineParser::found() const {
  if (at_ >= line_.size()) return "the end of the line";
  const char c = line_[at_];
  if (c < 0x20 || c > 0x7e)
    return fmt::format("byte 0x{:02x}", static_cast<unsigned>(static_cast<unsigned char>(c)));
  return fmt::format("'{}'", c);
}

bool LineParser::set_fault_at(std::size_t at, std::string text, WordFault::Kind kind) {
  fault_ = {kind, static_cast<int>(at) + 1, std::move(text)};
  return false;
}
bool LineParser::set_fault(std::string text, WordFault::Kind kind) {
  return set_fault_at(at_, std::move(text), kind);
}

void LineParser::skip_blanks() {
  while (at_ < line_.size() && gcode_blank(line_[at_])) ++at_;
}

bool LineParser::skip_comment() {
  const std::size_t close = line_.find(')', at_);
  if (close == std::string_view::npos)
    return set_fault("found a comment that is not closed, expected ')' on the same line");
  at_ = close + 1;
  return true;
}

// Digits with blanks between them. Up to 18 digits are gathered in an integer and
// divided once by a power of ten; below 2^53 that division is correctly rounded,
// like from_chars, in a third of its time. Longer ones go to from_chars.
bool LineParser::number(double& value) {
  const std::size_t start = at_;
  bool negative = false;
  if (at_ < line_.size() && (line_[at_] == '+' || line_[at_] == '-')) {
    negative = line_[at_] == '-';
    ++at_;
  }
  std::uint64_t mantissa = 0;
  int digits = 0, significant = 0, decimals = 0;
  bool point = false;
  std::size_t end = at_;  // after the last character that belongs to the number
  for (; at_ < line_.size(); ++at_) {
    const char c = line_[at_];
    if (is_digit(c)) {
      ++digits;
      if (significant > 0 || c != '0') ++significant;
      if (significant <= 18) mantissa = mantissa * 10 + static_cast<std::uint64_t>(c - '0');
      decimals += point;
    } else if (c == '.' && !point) {
      point = true;
    } else if (gcode_blank(c)) {
      continue;
    } else {
      break;
    }
    end = at_ + 1;
  }
  if (digits == 0) {
    // A lone sign or point: the fault is where the first digit should stand.
    at_ = std::max(end, start);
    skip_blanks();
    return set_fault(fmt::format("found {}, expected a number", found()));
  }
  if (mantissa < (std::uint64_t{1} << 53) && significant <= 18 && decimals <= 18) {
    value = static_cast<double>(mantissa) / kPowersOfTen[static_cast<std::size_t>(decimals)];
  } else {
    std::string plain;
    for (std::size_t i = start; i < end; ++i)
      if (is_digit(line_[i]) || line_[i] == '.') plain += line_[i];
    std::from_chars(plain.data(), plain.data() + plain.size(), value, std::chars_format::fixed);
  }
  if (negative) value = -value;
  if (!(std::abs(value) <= kLargestNumber))
    return set_fault_at(start, "found a number beyond 1e10, expected a length or rate in reach");
  return true;
}

bool LineParser::parameter_name(int& number_out, std::string& name) {
  ++at_;  // '#'
  skip_blanks();
  number_out = 0;
  name.clear();
  if (at_ < line_.size() && line_[at_] == '<') {
    const std::size_t start = at_;
    for (++at_; at_ < line_.size() && line_[at_] != '>'; ++at_)
      if (!gcode_blank(line_[at_]))
        name += static_cast<char>(std::tolower(static_cast<unsigned char>(line_[at_])));
    if (at_ >= line_.size())
      return set_fault_at(start, "found a parameter name that is not closed, expected '>'");
    ++at_;
    if (name.empty()) return set_fault_at(start, "found an empty parameter name, expected #<name>");
    return true;
  }
  const std::size_t start = at_;
  double index = 0.0;
  if (!real_value(index)) return false;
  if (index != std::floor(index) || index < 1.0 || index > kLastParameter)
    return set_fault_at(
        start, fmt::format("found parameter number {}, expected a whole number from 1 to {}", index,
                           kLastParameter));
  number_out = static_cast<int>(index);
  return true;
}

bool LineParser::parameter_value(double& value) {
  const std::size_t start = at_;
  int index = 0;
  std::string name;
  if (++depth_ > kDeepestGcodeNesting)
    return set_fault("found more than 64 levels of nesting, expected fewer");
  if (!parameter_name(index, name)) return false;
  --depth_;
  if (index == 0) {
    const GcodeParameters::Named& named = name[0] == '_' ? parameters_.global : parameters_.local;
    const auto it = named.find(name);
    if (it == named.end())
      return set_fault_at(start, fmt::format("found #<{}>, which has no value yet; expected an "
                                             "assignment before",
                                             name));
    value = it->second;
    return true;
  }
  const auto it = parameters_.numbered.find(index);
  if (it != parameters_.numbered.end()) {
    value = it->second;
  } else if (index >= kFirstSystemParameter) {
    return set_fault_at(start,
                        fmt::format("found #{}, which only the machine knows; expected a program "
                                    "that does not depend on it",
                                    index),
                        WordFault::Kind::unsupported);
  } else {
    value = 0.0;
  }
  return true;
}

bool LineParser::assignment() {
  Assignment a{};
  if (!parameter_name(a.number, a.name)) return false;
  skip_blanks();
  if (at_ >= line_.size() || line_[at_] != '=')
    return set_fault(fmt::format("found {}, expected '=' after a parameter", found()));
  ++at_;
  skip_blanks();
  if (!real_value(a.value)) return false;
  pending_.push_back(std::move(a));
  return true;
}

// number | #parameter | [expression] | function[..], with a sign in front of any.
bool LineParser::real_value(double& value) {
  skip_blanks();
  const std::size_t start = at_;
  const char c = at_ < line_.size() ? line_[at_] : '\0';
  bool negative = false;
  if (c == '+' || c == '-') {
    std::size_t next = at_ + 1;
    while (next < line_.size() && gcode_blank(line_[next])) ++next;
    if (next < line_.size() &&
        (line_[next] == '#' || line_[next] == '[' ||
         (gcode_upper(line_[next]) >= 'A' && gcode_upper(line_[next]) <= 'Z'))) {
      negative = c == '-';
      at_ = next;
    } else {
      return number(value);
    }
  } else if (is_digit(c) || c == '.') {
    return number(value);
  }
  if (at_ >= line_.size())
    return set_fault("found the end of the line, expected a number, '#' or '['");
  const char d = line_[at_];
  if (d == '#') {
    if (!parameter_value(value)) return false;
  } else if (d == '[') {
    if (!bracket(value)) return false;
  } else {
    if (!function(value)) return false;
  }
  if (negative) value = -value;
  if (!(std::abs(value) <= kLargestNumber))
    return set_fault_at(start, "found a value beyond 1e10, expected a length or rate in reach");
  return true;
}

bool LineParser::word(char letter, BlockWords& words) {
  const std::size_t start = at_++;
  if (letter == 'O')
    return set_fault_at(start, "found an O word behind others, expected it alone on its line");
  double value = 0.0;
  if (!real_value(value)) return false;
  const int column = static_cast<int>(start) + 1;
  words.any = true;
  if (letter == 'G' || letter == 'M') {
    const double tenths = value * 10.0;
    if (!(tenths >= 0.0 && tenths < 10000.0) || std::abs(tenths - std::round(tenths)) > 1e-6)
      return set_fault_at(start, fmt::format("found {}{}, expected a code such as {}", letter,
                                             value, letter == 'G' ? "G1" : "M3"));
    int& count = letter == 'G' ? words.g_count : words.m_count;
    if (count >= BlockWords::kMaxCodes)
      return set_fault_at(start,
                          fmt::format("found more than {} {} codes on one line, expected fewer",
                                      BlockWords::kMaxCodes, letter));
    auto& list = letter == 'G' ? words.g : words.m;
    list[static_cast<std::size_t>(count++)] = {static_cast<int>(std::lround(tenths)), column};
    return true;
  }
  const auto index = static_cast<std::size_t>(letter - 'A');
  if ((words.present >> index) & 1U)
    return set_fault_at(start, fmt::format("found a second {} word, expected one per line "
                                           "(the first is in column {})",
                                           letter, words.column[index]));
  words.present |= 1U << index;
  words.value[index] = value;
  words.column[index] = column;
  return true;
}

bool LineParser::parse(std::string_view line, BlockWords& words) {
  line_ = line;
  at_ = 0;
  depth_ = 0;
  pending_.clear();
  words.present = 0;
  words.g_count = words.m_count = 0;
  words.deleted = words.percent = words.any = false;
  skip_blanks();
  if (at_ < line_.size() && line_[at_] == '%') {
    words.percent = true;
    return true;
  }
  if (at_ < line_.size() && line_[at_] == '/') {
    words.deleted = true;
    return true;
  }
  for (;;) {
    skip_blanks();
    if (at_ >= line_.size()) break;
    const char c = gcode_upper(line_[at_]);
    if (c >= 'A' && c <= 'Z') {
      if (!word(c, words)) return false;
    } else if (c == '(') {
      if (!skip_comment()) return false;
    } else if (c == ';') {
      break;
    } else if (c == '#') {
      if (!assignment()) return false;
      words.any = true;
    } else {
      return set_fault(
          fmt::format("found {}, expected a word (a letter and a number) or a comment", found()));
    }
  }
  for (Assignment& a : pending_) {
    if (a.number > 0)
      parameters_.numbered[a.number] = a.value;
    else
      set(std::move(a.name), a.value);
  }
  return true;
}

void LineParser::set(std::string name, double value) {
  auto& named = name[0] == '_' ? parameters_.global : parameters_.local;
  named[std::move(name)] = value;
}

bool LineParser::values(std::string_view line, std::size_t at, std::vector<double>& out) {
  line_ = line;
  at_ = at;
  depth_ = 0;
  out.clear();
  for (;;) {
    skip_blanks();
    if (at_ >= line_.size() || line_[at_] == ';') return true;
    if (line_[at_] == '(') {
      if (!skip_comment()) return false;
    } else if (line_[at_] == '[') {
      double value = 0.0;
      if (!bracket(value)) return false;
      out.push_back(value);
    } else {
      return set_fault(fmt::format("found {}, expected '[' or the end of the line", found()));
    }
  }
}

bool LineParser::label(std::string_view line, std::size_t& at, double& value) {
  line_ = line;
  at_ = at;
  depth_ = 0;
  if (!real_value(value)) return false;
  skip_blanks();
  at = at_;
  return true;
}

void LineParser::enter(const std::vector<double>& arguments) {
  GcodeParameters caller;
  caller.local = std::move(parameters_.local);
  parameters_.local.clear();
  const auto last = parameters_.numbered.upper_bound(GcodeParameters::kLocals);
  caller.numbered.insert(parameters_.numbered.begin(), last);
  parameters_.numbered.erase(parameters_.numbered.begin(), last);
  callers_.push_back(std::move(caller));
  for (std::size_t i = 0; i < arguments.size(); ++i)
    parameters_.numbered[static_cast<int>(i) + 1] = arguments[i];
}

void LineParser::leave() {
  parameters_.numbered.erase(parameters_.numbered.begin(),
                             parameters_.numbered.upper_bound(GcodeParameters::kLocals));
  parameters_.numbered.merge(callers_.back().numbered);
  parameters_.local = std::move(callers_.back().local);
  callers_.pop_back();
}

}  // namespace maquette::cnc

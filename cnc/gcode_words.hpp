// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file gcode_words.hpp
/// One line of RS-274 -> its words. Used by gcode_reader only.
///
/// Understands comments `( )` and `;`, any letter case, blanks anywhere (also inside
/// a number, as the standard allows), parameters `#n`, `#<name>`, assignments and
/// bracketed expressions. It knows the shape of a word, not what a code means.
///
/// Source: Kramer, Proctor, Messina, "The NIST RS274NGC Interpreter - Version 3",
/// NISTIR 6556, 2000, doi:10.6028/NIST.IR.6556.

#include <array>
#include <cstdint>
#include <map>
#include <string>
#include <string_view>
#include <vector>

namespace maquette::cnc {

/// Deeper nesting of brackets is not a program but a mistake, and would end on the stack.
inline constexpr int kDeepestGcodeNesting = 64;

[[nodiscard]] constexpr bool gcode_blank(char c) {
  return c == ' ' || c == '\t' || c == '\r';
}
[[nodiscard]] constexpr char gcode_upper(char c) {
  return c >= 'a' && c <= 'z' ? static_cast<char>(c - 'a' + 'A') : c;
}

/// What is wrong with a line, and where; the reader adds file and line number.
struct WordFault {
  enum class Kind : std::uint8_t { none, syntax, unsupported };
  Kind kind = Kind::none;
  int column = 0;  ///< 1 for the first character
  std::string text;
};

/// Inside a subprogram #1 .. #30 and the named ones without a leading '_' are its own.
struct GcodeParameters {
  static constexpr int kLocals = 30;
  using Named = std::map<std::string, double, std::less<>>;  ///< lower case, without blanks
  std::map<int, double> numbered;
  Named global, local;
};

/// The words of one line. G and M may occur several times, every other letter once.
struct BlockWords {
  struct Code {
    int tenths;  ///< 431 for G43.1
    int column;
  };
  static constexpr int kMaxCodes = 16;

  std::uint32_t present = 0;  ///< bit 0 is A
  std::array<double, 26> value{};
  std::array<int, 26> column{};
  std::array<Code, kMaxCodes> g{}, m{};
  int g_count = 0, m_count = 0;
  bool deleted = false;  ///< starts with '/'
  bool percent = false;  ///< a '%' line
  bool any = false;      ///< has a word or an assignment

  [[nodiscard]] bool has(char letter) const { return (present >> (letter - 'A')) & 1U; }
  [[nodiscard]] double of(char letter) const {
    return value[static_cast<std::size_t>(letter - 'A')];
  }
  [[nodiscard]] int column_of(char letter) const {
    return column[static_cast<std::size_t>(letter - 'A')];
  }
};

/// Splits one line (without its line end). Assignments take effect when the whole
/// line has been read, as the standard says.
class LineParser {
 public:
  /// @return false: fault() says why
  [[nodiscard]] bool parse(std::string_view line, BlockWords& words);
  [[nodiscard]] const WordFault& fault() const { return fault_; }

  /// The values "[..] [..]" from `at` to the line's end or comment.
  [[nodiscard]] bool values(std::string_view line, std::size_t at, std::vector<double>& out);
  /// "#1 call [2]": a label that has to be worked out; moves `at` behind it.
  [[nodiscard]] bool label(std::string_view line, std::size_t& at, double& value);
  /// A subprogram begins: its arguments are #1 .. #30, what is not given is 0; and ends.
  void enter(const std::vector<double>& arguments);
  void leave();
  /// #<name> = value, as from a line.
  void set(std::string name, double value);

 private:
  struct Assignment {
    int number;  ///< 0: named
    std::string name;
    double value;
  };
  bool set_fault(std::string text, WordFault::Kind kind = WordFault::Kind::syntax);
  bool set_fault_at(std::size_t at, std::string text,
                    WordFault::Kind kind = WordFault::Kind::syntax);
  void skip_blanks();
  bool skip_comment();
  bool word(char letter, BlockWords& words);
  bool number(double& value);
  bool real_value(double& value);
  bool parameter_value(double& value);
  bool parameter_name(int& number, std::string& name);
  bool assignment();
  bool bracket(double& value);
  bool expression(double& value, int lowest);
  bool function(double& value);
  [[nodiscard]] int peek_operator(int& level, std::size_t& length) const;
  [[nodiscard]] std::string found() const;

  std::string_view line_;
  std::size_t at_ = 0;
  int depth_ = 0;
  WordFault fault_;
  GcodeParameters parameters_;
  std::vector<GcodeParameters> callers_;  // the locals of who called
  std::vector<Assignment> pending_;
};

}  // namespace maquette::cnc

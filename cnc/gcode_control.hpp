// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file gcode_control.hpp
/// The lines of RS-274 that say which line comes next. Used by gcode_reader only.
///
/// O words of LinuxCNC ("O Codes" of its documentation): sub, endsub, return, call, if,
/// elseif, else, endif, while, endwhile, do, repeat, endrepeat, break, continue. A lone O word
/// or ':' with a number is a program's name (Fanuc, Haas).

#include <cstdint>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

namespace maquette::cnc {

struct ControlLine {
  enum class Kind : std::uint8_t {
    none,
    program,  ///< "O1000": a name
    sub,
    end_sub,
    return_,
    call,
    if_,
    else_if,
    else_,
    end_if,
    while_,
    end_while,
    do_,
    repeat,
    end_repeat,
    break_,
    continue_,
    unknown
  };
  Kind kind = Kind::none;
  std::string label;       ///< digits without leading zeros, or <name> in lower case without blanks
  std::size_t after = 0;   ///< where the line goes on behind the keyword
  std::size_t column = 0;  ///< of the O word, from 1
};

/// Looks only; evaluates nothing. A label that is an expression comes with `label` empty and
/// kind unknown.
[[nodiscard]] ControlLine control_line(std::string_view line);
/// The word that ends what `kind` begins, for messages: "endsub".
[[nodiscard]] std::string_view end_of(ControlLine::Kind kind);

/// Lines that are kept because they may run more than once.
struct KeptLine {
  std::string text;
  std::uint64_t number;
  ControlLine control;
  /// Where a jump from here goes, index into the lines: an if, elseif or else to the next of
  /// its branches or its endif; the end of a loop to its head and the head to its end;
  /// break and continue to the end of their loop.
  std::size_t partner = 0;
  std::size_t end = 0;  ///< branches: the endif
};

struct ControlFault {
  std::uint64_t line;
  std::size_t column;
  std::string text;
};

/// Fills in the jumps. @return what does not match
[[nodiscard]] std::optional<ControlFault> match(std::vector<KeptLine>& lines);

}  // namespace maquette::cnc

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file posts.hpp
/// What differs from one machine control to the next: one row each in posts.cpp, with the
/// manual it follows. program.hpp writes by it; nothing else knows a control.
///
/// In the texts {tool}, {rpm}, {safe}, {tolerance}, {name} and {number} are replaced by what
/// they say; a text of several lines has a '\n' between them and none at its end.

#include <array>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>

#include "core/result.hpp"

namespace maquette::cnc {

inline constexpr ErrorCode kUnknownPost{"CNC_UNKNOWN_POST"};

struct Post {
  std::string_view name{};
  std::string_view control{};    ///< for a person
  std::string_view extension{};  ///< of its programs, without the point

  // numbers and lines
  bool conversational = false;  ///< Heidenhain's own language instead of RS-274 words
  int decimals = 4;             ///< of a coordinate, 3 or 4; more would be cut off by the control
  bool point = false;           ///< whole numbers need their point: "X10." (else least increments)
  std::size_t longest_line = 255;
  int last_line_number = 0;  ///< numbers start again after it; 0: the control has none
  bool numbered = false;     ///< every line has a number, asked for or not
  std::string_view comment_open = "(", comment_close = ")";

  // motion
  /// Sums of increments (G91) are what they would be in G90: decimal or binary64 inside.
  bool exact_increments = false;
  bool helices = true;          ///< arcs with a third axis; else chords
  bool straight_rapids = true;  ///< else axes arrive one after the other: written apart
  /// Largest difference of an arc's radii at its start and its end.
  double arc_radius_tolerance_mm = 0.00127;

  // text, in the order of a program
  std::string_view open{};                    ///< first lines
  std::string_view modes{};                   ///< metric, absolute, no compensation
  std::array<std::string_view, 9> offsets{};  ///< G54 .. G59, G59.1 .. G59.3; empty: has none
  std::string_view retreat{};                 ///< to the machine's own change place
  std::string_view first_tool{}, next_tool{};
  bool length_with_z = false;  ///< the tool's length is taken up on the way down, above the start
  std::string_view length{};   ///< with `length_with_z` one line with {safe}
  std::string_view spindle_on{}, spindle_off{};
  std::string_view coolant_on{}, coolant_off{};
  std::string_view blend{}, blend_off{};  ///< leave the written path by at most {tolerance}
  std::string_view exact{};               ///< follow it exactly
  std::string_view end{};                 ///< last lines
};

[[nodiscard]] std::optional<Post> post_by_name(std::string_view name);
[[nodiscard]] std::string post_names();  ///< "linuxcnc, grbl, ..."

}  // namespace maquette::cnc

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file gcode_writer.hpp
/// RS-274 text of moves. A word that says what is already so is left out (G, X, Y, Z and F
/// are modal), numbers are as short as their value allows, a move to where the tool stands
/// is no block.

#include <cstdint>
#include <string>
#include <string_view>

#include "cnc/toolpath.hpp"

namespace maquette::cnc {

class GcodeWriter {
 public:
  GcodeWriter() = default;
  /// Starts in the middle of a program where the machine's state is known.
  GcodeWriter(ToolPosition at, int motion, double feed) : at_(at), motion_(motion), feed_(feed) {}

  /// G0; a coordinate that is kUnknown does not move.
  void rapid(ToolPosition to) { move(0, to, 0.0); }
  /// G1 at `feed` mm/min, whole hundredths.
  void cut(ToolPosition to, double feed) { move(1, to, feed); }
  void line(std::string_view text);  ///< verbatim; must not change what is modal here

  [[nodiscard]] const std::string& text() const { return text_; }
  [[nodiscard]] std::uint64_t blocks() const { return blocks_; }
  [[nodiscard]] ToolPosition position() const { return at_; }
  [[nodiscard]] double cutting_length_mm() const { return cutting_length_mm_; }
  [[nodiscard]] double cutting_time_min() const { return cutting_time_min_; }

 private:
  void move(int motion, ToolPosition to, double feed);

  std::string text_;
  ToolPosition at_;
  int motion_ = -1;
  double feed_ = 0.0;
  std::uint64_t blocks_ = 0;
  double cutting_length_mm_ = 0.0, cutting_time_min_ = 0.0;
};

/// Shortest decimal of ticks / 10000: "12.5", "-0.003", "7".
void append_decimal(std::string& text, std::int64_t ticks);

/// A comment's text: what would end it early is replaced.
[[nodiscard]] std::string comment_text(std::string_view text);

}  // namespace maquette::cnc

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file block_text.hpp
/// Moves -> blocks of one control, in memory. Used by program only.
///
/// A word that says what is already so is left out; numbers are as short as their value
/// allows; coordinates are rounded once to what the control keeps, so that what is read
/// back is what the machine does. About 15 M lines/s.

#include <cstdint>
#include <string>
#include <string_view>
#include <vector>

#include "cnc/posts.hpp"
#include "cnc/toolpath.hpp"

namespace maquette::cnc {

class BlockText {
 public:
  /// @param numbered  every line gets a number
  /// @param relative  cuts in G91, see ProgramOptions; @pre then post.exact_increments
  BlockText(const Post& post, bool numbered, bool relative);

  /// Nothing is known of the control any more: position, modes, feed.
  void forget();
  /// Line numbers start again.
  void restart();

  /// G0; a coordinate that is kUnknown does not move. A move that does not move is no block.
  void rapid(ToolPosition to);
  void line(ToolPosition to, double feed_mm_min);
  /// @pre the position is known, the centre is none of the two ends; by radius: that times two is
  ///      longer than the chord
  void arc(const PathMove& move);
  /// Verbatim, one block a line; must leave plane, distance mode and units alone. Motion mode
  /// and feed are written anew after it.
  void lines(std::string_view text);
  /// A line of lines() has moved there.
  void stands_at_z(std::int64_t ticks);
  /// As many lines as it takes.
  void comment(std::string_view text);

  /// Where the move was to end, ticks; kUnknown after forget().
  [[nodiscard]] ToolPosition exact() const { return exact_; }
  /// Ticks of one unit of the last decimal, and the nearest such units.
  [[nodiscard]] std::int64_t unit() const { return unit_; }
  [[nodiscard]] std::int64_t in_units(std::int64_t ticks) const;
  [[nodiscard]] ToolPosition in_units(ToolPosition ticks) const;

  /// What was written since the last drop().
  [[nodiscard]] std::string_view text() const { return {text_.data(), used_}; }
  void drop() { used_ = 0; }
  /// Since restart().
  [[nodiscard]] std::uint64_t line_count() const { return lines_; }
  [[nodiscard]] std::uint64_t byte_count() const { return bytes_; }

 private:
  enum class Mode : std::uint8_t { unknown, rapid, line, clockwise, counter_clockwise };

  [[nodiscard]] char* begin();
  void end(char* at);
  [[nodiscard]] char* coordinate(char* at, char letter, std::int64_t units) const;
  [[nodiscard]] char* axes(char* at, ToolPosition to) const;
  [[nodiscard]] char* feed(char* at, double feed_mm_min);
  void straight(Mode mode, ToolPosition to, double feed_mm_min);
  /// Before the words of a cut or a rapid: the distance mode in which its axes() will be.
  [[nodiscard]] char* distance_mode(char* at, bool cut);

  Post post_;
  bool numbered_, relative_;
  bool incremental_ = false;  // the control is in G91
  bool all_axes_ = false;     // of this block, whether they move or not
  int since_absolute_ = -1;   // cuts since the last with all its axes in G90; < 0: a rapid
  std::int64_t unit_;         // ticks of a unit in the last decimal
  std::vector<char> text_;
  std::size_t used_ = 0;
  std::uint64_t lines_ = 0, bytes_ = 0;
  int next_number_;
  ToolPosition at_;     // in units
  ToolPosition exact_;  // in ticks, as it was asked for
  Mode mode_ = Mode::unknown;
  int plane_ = -1;
  std::int64_t feed_ = -1;  // hundredths
};

}  // namespace maquette::cnc

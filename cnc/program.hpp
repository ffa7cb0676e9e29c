// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file program.hpp
/// Moves -> program of one control.
///
/// Room    cnc:  strategies -> PathMove -> [program] -> verify
/// Takes   moves of the tip in the model frame, as a stream; the tools they are made with
/// Gives   files that appear whole or not at all; memory does not grow with the path
///
/// The first move after the start, tool() or lines() is a rapid, or go_to(): where the machine
/// stands is not known, so the writer goes to the safe height first, then over the place, then
/// down. Before a tool change and at the end it retreats to the safe height by itself.
///
/// Where the control wants something else than the path has (posts.hpp), the writer
/// - rounds coordinates to what the control keeps (3 decimals: off by up to 0.0005 mm an
///   axis); nothing adds up along the path
/// - writes an arc that is flatter than half a unit of the last decimal as a line; one that
///   the control has not, or whose radii rounding puts further apart than it allows, as chords
///   within `arc_chords` of it
/// - parts a rapid that is not along one axis, where the control would not fly it straight:
///   up to the safe height, over, down
///
/// Splitting: a part ends before a block that would not fit beside the end of the program.
/// It retreats to the safe height; the next part has the whole head, goes over the place
/// where the path was left, down by rapid to 1 mm above it (where the cutter just was) and
/// on at `entry_feed`. Parts are named part.ngc, part_2.ngc, part_3.ngc...
///
/// Cost: 5 M blocks/s and more, without the disk.

#include <cmath>
#include <compare>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "cnc/posts.hpp"
#include "cnc/tool.hpp"
#include "cnc/toolpath.hpp"
#include "core/result.hpp"
#include "core/units.hpp"

namespace maquette::cnc {

inline constexpr ErrorCode kProgramOptionOutOfRange{"CNC_PROGRAM_OPTION_OUT_OF_RANGE"};

struct ProgramOptions {
  std::string post = "linuxcnc";
  std::string name = "maquette";  ///< letters, digits, - and _ are kept, at most 24
  int number = 1;                 ///< 1 .. 7999, of controls that count programs; parts count on
  int work_offset = 54;           ///< 54 .. 59; 591 .. 593 for G59.1 .. G59.3
  /// What the control may leave the written path by to keep its speed; 0: not at all where
  /// the control can be told so.
  Millimetres blending{0.0};
  Millimetres arc_chords{0.001};  ///< 0.0001 .. 1
  Millimetres safe_z{NAN};        ///< of the tip; above all that stands on the table
  FeedRate entry_feed{600.0};     ///< down to where a part of the program goes on
  std::uint64_t max_lines = 0;    ///< of one file, at least 200; 0: any number
  std::uint64_t max_bytes = 0;    ///< of one file, at least 16384; 0: any number
  bool line_numbers = false;      ///< where the control has them
  /// Cuts by how far they go (G91): a sixth to a quarter fewer bytes. After each rapid, and after
  /// every hundred cuts, one says where it ends in all axes (G90), so that a person who goes on
  /// from the middle has not far to look. Rapids and all else stay in G90. Nothing adds up:
  /// increments are between places that are rounded already. For controls that add exactly
  /// (posts.hpp).
  bool relative = false;
  bool coolant = false;               ///< M8
  std::vector<std::string> comments;  ///< in the head of each file
};

struct ProgramReport {
  std::vector<std::filesystem::path> files;
  std::uint64_t blocks = 0;  ///< lines of text, comments too
  std::uint64_t bytes = 0;
  std::uint64_t cutting_moves = 0, rapid_moves = 0;  ///< as given to add()
  std::uint64_t arcs_as_lines = 0, arcs_as_chords = 0;
  /// Of the moves as given, not of retreats and returns.
  double cutting_length_mm = 0.0, rapid_length_mm = 0.0;
  double cutting_time_min = 0.0;  ///< length over feed
};

/// A line of one of a program's files, both counted from where the program begins: file from 0,
/// line from 1.
struct ProgramPlace {
  std::size_t file = 0;
  std::uint64_t line = 0;
  friend auto operator<=>(const ProgramPlace&, const ProgramPlace&) = default;
};

class ProgramWriter {
 public:
  /// @return the writer; CNC_UNKNOWN_POST; CNC_PROGRAM_OPTION_OUT_OF_RANGE with option, value
  ///         and range, also for a work offset that the control has not; CORE_FILE_NOT_WRITABLE
  [[nodiscard]] static Result<ProgramWriter> create(const std::filesystem::path& path,
                                                    const ProgramOptions& options);
  ProgramWriter(ProgramWriter&&) noexcept;
  ProgramWriter& operator=(ProgramWriter&&) noexcept;
  ~ProgramWriter();  ///< without commit() nothing is left

  /// The first one is the start of the program.
  /// @pre 1 <= number <= 99999; 0 <= spindle_rpm <= 10^6; 0: it stands still, for a probe
  void tool(const Tool& tool, double spindle_rpm);
  /// The same for one operation of several: its own blending, safe height, entry feed and comments;
  /// the rest of `options` is as create() had it. The tool that is in the spindle already, at the
  /// same speed, stays there. @pre as of tool(); options as create() takes them
  void operation(const Tool& tool, double spindle_rpm, const ProgramOptions& options);
  /// The line written last.
  [[nodiscard]] ProgramPlace place() const;
  void comment(std::string_view text);  ///< @pre a tool
  /// Verbatim blocks of the post's control, such as a probing cycle; they may move but must
  /// leave units, distance mode, plane and offsets as they found them. @pre a tool
  void lines(std::string_view text);
  /// Over `start` at the safe height, down by rapid to 1 mm above it, then at `feed`.
  /// Before: retreats from where it is. @pre as of add()
  void go_to(ToolPosition start, double feed_mm_min);
  /// @pre a tool; after it, go_to() or a rapid first; coordinates known and below 100 m; feeds
  ///      of cuts in (0, 10^6]; arcs as PathMove says
  /// @return what kept the next file of a split program from being opened, or
  ///         CNC_PROGRAM_OPTION_OUT_OF_RANGE where its limits do not hold even the head
  [[nodiscard]] Result<void> add(std::span<const PathMove> moves);
  /// The same, by a rapid to the path's start where it does not stand there.
  [[nodiscard]] Result<void> add(const Toolpath& path);

  /// Ends the program and puts all files in place.
  /// @return CORE_DISK_FULL or CORE_FILE_NOT_WRITABLE if a write failed, or add()'s errors; then
  ///         the first file is not there, or is the one that was there before
  [[nodiscard]] Result<ProgramReport> commit();

 private:
  struct State;
  explicit ProgramWriter(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace maquette::cnc

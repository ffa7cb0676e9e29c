// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file gcode_machine.hpp
/// The modal state of the control: words of one block -> at most one motion. Used by
/// gcode_reader only; what the words mean is written there.

#include <array>
#include <optional>
#include <string>

#include "cnc/gcode_reader.hpp"
#include "cnc/gcode_words.hpp"
#include "cnc/verify.hpp"

namespace maquette::cnc {

struct BlockFault {
  ErrorCode code;
  int column;
  std::string text;
};

/// M98 and M99.
struct SubprogramJump {
  enum class Kind : std::uint8_t { none, call, back };
  Kind kind = Kind::none;
  std::uint64_t number = 0, times = 1;
  int column = 1;
};

class GcodeMachine {
 public:
  /// Executes one block.
  /// @param[out] motion  set `moved` to tell whether there is one
  /// @return nothing, or what is wrong
  [[nodiscard]] std::optional<BlockFault> execute(const BlockWords& words, Motion& motion,
                                                  bool& moved);
  [[nodiscard]] bool ended() const { return ended_; }
  [[nodiscard]] double dwell_s() const { return dwell_s_; }
  [[nodiscard]] std::uint64_t tool_changes() const { return tool_changes_; }
  /// What the last block asks for, after its motion.
  [[nodiscard]] const SubprogramJump& jump() const { return jump_; }

 private:
  enum class Mode : std::uint8_t { none, rapid, line, clockwise, counter_clockwise };
  enum class AxisUse : std::uint8_t { motion, offset_set, offset_length, set_data, home, probe };

  [[nodiscard]] static BlockFault syntax(int column, std::string text);
  [[nodiscard]] static BlockFault unsupported(int column, std::string_view what,
                                              std::string_view expected);
  std::optional<BlockFault> codes(const BlockWords& words);
  std::optional<BlockFault> one_code(const BlockWords& words, BlockWords::Code code);
  std::optional<BlockFault> m_codes(const BlockWords& words);
  std::optional<BlockFault> one_m_code(const BlockWords& words, BlockWords::Code code);
  std::optional<BlockFault> coordinate_system(int system, int column);
  std::optional<BlockFault> set_offset(const BlockWords& words);
  std::optional<BlockFault> set_data(const BlockWords& words);
  std::optional<BlockFault> home(const BlockWords& words, Motion& motion, bool& moved);
  std::optional<BlockFault> probe(const BlockWords& words, Motion& motion, bool& moved);
  std::optional<BlockFault> select_tool(const BlockWords& words);
  std::optional<BlockFault> move(const BlockWords& words, Motion& motion, bool& moved);
  std::optional<BlockFault> arc(const BlockWords& words, Motion& motion);

  double unit_mm_ = 1.0;
  bool incremental_ = false, centre_absolute_ = false;
  ArcPlane plane_ = ArcPlane::xy;
  Mode mode_ = Mode::none;
  double feed_mm_min_ = 0.0;
  int coordinate_system_ = 54;  ///< 59.1 is 591, G54.1 P2 and G154 P2 5402
  bool moved_ever_ = false;
  std::array<double, 3> at_mm_{};  ///< model frame
  std::array<bool, 3> known_{};
  std::array<double, 3> offset_mm_{}, saved_offset_mm_{};  ///< G92: model = program + offset
  bool ended_ = false;
  double dwell_s_ = 0.0;
  std::uint64_t tool_changes_ = 0;
  int tool_ = 0, selected_tool_ = 0;
  std::optional<PathControl> control_;

  // of the block at hand
  bool machine_frame_ = false, dwell_ = false, smoothing_ = false;
  int mode_column_ = 0;
  AxisUse axis_use_ = AxisUse::motion;
  SubprogramJump jump_;
};

}  // namespace maquette::cnc

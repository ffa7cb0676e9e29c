// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file heidenhain_reader.hpp
/// Heidenhain conversational program, line by line -> motions. Used by gcode_reader only,
/// which chooses it for programs that begin with BEGIN PGM.
///
/// Blocks that act: BEGIN PGM with MM or INCH, TOOL CALL, L, CC, C, CR, CP (the angle in PA or
/// IPA, a height makes it a helix), F, FMAX, incremental IX IY IZ, M91 and M92, M140 (tool
/// axis: away to a place that only the machine knows), CYCL DEF 9 (dwell), 32 (tolerance T of the
/// contour, which the time depends on; without T as the machine is set), M2, M30, END PGM. Read and
/// changing nothing: comments, '*' headings, BLK FORM, TOOL DEF, LBL, CYCL DEF 247, R0, S, M0 ..
/// M14 otherwise. All else is CNC_GCODE_UNSUPPORTED: radius compensation, roundings and tangents,
/// polar lines, Q parameters, label calls, rotary axes, other cycles.
///
/// Source: Heidenhain, "TNC 640 User's Manual for Conversational Programming", 892903.

#include <array>
#include <cstdint>
#include <functional>
#include <optional>
#include <string>
#include <string_view>

#include "cnc/gcode_reader.hpp"

namespace maquette::cnc {

/// Largest difference of the radii at an arc's two ends (machine parameter circleDeviation).
inline constexpr double kHeidenhainArcTolerance_mm = 0.016;

class HeidenhainReader {
 public:
  /// Whether a program with this first line is one.
  [[nodiscard]] static bool begins(std::string_view line);

  struct Fault {
    ErrorCode code;
    int column;
    std::string text;
    std::optional<Error> sink;  ///< what the receiver of the motions said
  };
  using Give = std::function<Result<void>(const Motion&)>;
  /// @return what is wrong
  [[nodiscard]] std::optional<Fault> line(std::string_view text, const Give& give);

  [[nodiscard]] bool ended() const { return ended_; }
  [[nodiscard]] std::uint64_t blocks() const { return blocks_; }
  [[nodiscard]] double dwell_s() const { return dwell_s_; }
  [[nodiscard]] std::uint64_t tool_changes() const { return tool_changes_; }

 private:
  /// What a path block says.
  struct Block {
    std::array<std::optional<double>, 3> absolute{}, incremental{};  // mm
    std::optional<double> radius, angle;                             // mm, degrees
    bool angle_incremental = false;
    std::optional<bool> counter_clockwise;
    bool rapid = false, machine_frame = false, any_axis = false;
    int column = 1;
  };

  std::optional<Fault> statement();
  std::optional<Fault> begin_program();
  std::optional<Fault> tool_call();
  std::optional<Fault> cycle();
  std::optional<Fault> words(Block& block);
  std::optional<Fault> m_code(int code, int column, Block& block);
  std::optional<Fault> set_centre(const Block& block);
  std::optional<Fault> path(std::string_view kind, Block& block, const Give& give);
  std::optional<Fault> arc(std::string_view kind, const Block& block, Motion& motion);
  std::optional<Fault> move(const Block& block, Motion& motion);

  void skip_blanks();
  [[nodiscard]] bool at_end();
  [[nodiscard]] std::string_view letters();
  std::optional<Fault> number(double& value);
  [[nodiscard]] std::optional<Fault> syntax(int column, std::string text) const;
  [[nodiscard]] std::optional<Fault> unsupported(int column, std::string_view what,
                                                 std::string_view expected) const;
  [[nodiscard]] int column() const { return static_cast<int>(at_) + 1; }
  [[nodiscard]] std::string found() const;

  std::string_view line_;
  std::size_t at_ = 0;
  std::string word_;

  double unit_mm_ = 1.0;
  bool begun_ = false, ended_ = false, continued_ = false;
  std::array<double, 3> position_mm_{};
  std::array<bool, 3> known_{};
  std::array<double, 3> centre_mm_{};
  std::optional<ArcPlane> centre_plane_;
  double feed_mm_min_ = 0.0, dwell_s_ = 0.0;
  int tool_ = 0;
  std::optional<PathControl> control_;
  std::uint64_t tool_changes_ = 0, blocks_ = 0;
};

}  // namespace maquette::cnc

// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/gcode_machine.hpp"

#include <cmath>

#include <fmt/format.h>

namespace maquette::cnc {
namespace {

[[nodiscard]] std::string code_name(char letter, int tenths) {
  if (tenths % 10 == 0) return fmt::format("{}{}", letter, tenths / 10);
  return fmt::format("{}{}.{}", letter, tenths / 10, tenths % 10);
}

[[nodiscard]] std::string system_name(int system) {
  if (system < 100) return fmt::format("G{}", system);
  if (system < 1000) return fmt::format("G59.{}", system % 10);
  return fmt::format("the additional system {}", system - 5400);
}

[[nodiscard]] bool has_code(const BlockWords& words, int m_tenths) {
  for (int i = 0; i < words.m_count; ++i)
    if (words.m[static_cast<std::size_t>(i)].tenths == m_tenths) return true;
  return false;
}

}  // namespace

BlockFault GcodeMachine::syntax(int column, std::string text) {
  return {kGcodeSyntax, column, std::move(text)};
}
BlockFault GcodeMachine::unsupported(int column, std::string_view what, std::string_view expected) {
  return {kGcodeUnsupported, column, fmt::format("found {}, expected {}", what, expected)};
}

std::optional<BlockFault> GcodeMachine::execute(const BlockWords& words, Motion& motion,
                                                bool& moved) {
  moved = false;
  machine_frame_ = dwell_ = smoothing_ = false;
  mode_column_ = 0;
  axis_use_ = AxisUse::motion;
  jump_ = {};
  for (const char axis : {'A', 'B', 'C', 'U', 'V', 'W'})
    if (words.has(axis))
      return unsupported(words.column_of(axis), fmt::format("axis word {}", axis),
                         "a three-axis program (X, Y, Z)");
  if (auto fault = codes(words)) return fault;
  if (words.has('E') && !smoothing_)
    return syntax(words.column_of('E'),
                  "found E, expected it with G187 only and plain numbers (1500, not 1.5e3)");
  if (words.has('L') && axis_use_ != AxisUse::set_data && !has_code(words, 980))
    return syntax(words.column_of('L'), "found L, expected it with G10 or M98 only");
  if (words.has('F')) {
    const double feed = words.of('F') * unit_mm_;
    if (!(feed >= 0.0))
      return syntax(words.column_of('F'),
                    fmt::format("found feed {}, expected one above zero", words.of('F')));
    feed_mm_min_ = feed;
  }
  if (auto fault = select_tool(words)) return fault;
  if (auto fault = m_codes(words)) return fault;
  if (dwell_) {
    if (!words.has('P') || !(words.of('P') >= 0.0))
      return syntax(words.has('P') ? words.column_of('P') : 1,
                    "found G4 without a dwell time, expected P with seconds");
    dwell_s_ += words.of('P');
  }
  if (axis_use_ == AxisUse::offset_set) return set_offset(words);
  if (axis_use_ == AxisUse::offset_length) return std::nullopt;
  if (axis_use_ == AxisUse::set_data) return set_data(words);
  if (axis_use_ == AxisUse::home) return home(words, motion, moved);
  if (axis_use_ == AxisUse::probe) return probe(words, motion, moved);
  return move(words, motion, moved);
}

std::optional<BlockFault> GcodeMachine::codes(const BlockWords& words) {
  for (int i = 0; i < words.g_count; ++i)
    if (auto fault = one_code(words, words.g[static_cast<std::size_t>(i)])) return fault;
  return std::nullopt;
}

std::optional<BlockFault> GcodeMachine::one_code(const BlockWords& words, BlockWords::Code code) {
  const auto set_mode = [&](Mode mode) -> std::optional<BlockFault> {
    if (mode_column_ != 0 && mode != mode_)
      return syntax(code.column,
                    fmt::format("found {} beside another motion in column {}, expected one "
                                "motion per line",
                                code_name('G', code.tenths), mode_column_));
    mode_ = mode;
    mode_column_ = code.column;
    return std::nullopt;
  };
  switch (code.tenths) {
    case 0:
      return set_mode(Mode::rapid);
    case 10:
      return set_mode(Mode::line);
    case 20:
      return set_mode(Mode::clockwise);
    case 30:
      return set_mode(Mode::counter_clockwise);
    case 40:
      dwell_ = true;
      return std::nullopt;
    case 170:
      plane_ = ArcPlane::xy;
      return std::nullopt;
    case 180:
      plane_ = ArcPlane::zx;
      return std::nullopt;
    case 190:
      plane_ = ArcPlane::yz;
      return std::nullopt;
    case 200:
      unit_mm_ = 25.4;
      return std::nullopt;
    case 210:
      unit_mm_ = 1.0;
      return std::nullopt;
    case 431:
      axis_use_ = AxisUse::offset_length;  // its axis words are lengths, not a move
      return std::nullopt;
    case 400:
    case 430:
    case 432:
    case 490:
    case 500:
    case 940:
    case 970:
    case 980:
    case 990:
      return std::nullopt;
    case 610:
      control_ = {PathControl::Mode::exact_path, 0.0};
      return std::nullopt;
    case 611:
      control_ = {PathControl::Mode::exact_stop, 0.0};
      return std::nullopt;
    case 640:
      control_ = {PathControl::Mode::blend, words.has('P') ? words.of('P') * unit_mm_ : 0.0};
      return std::nullopt;
    case 530:
      machine_frame_ = true;
      return std::nullopt;
    case 540:
    case 550:
    case 560:
    case 570:
    case 580:
    case 590:
      return coordinate_system(code.tenths / 10, code.column);
    case 591:
    case 592:
    case 593:
      return coordinate_system(code.tenths, code.column);
    case 541:
    case 1540: {
      const double p = words.has('P') ? words.of('P') : 0.0;
      if (p != std::floor(p) || p < 1.0 || p > 300.0)
        return syntax(code.column, fmt::format("found {} without its number, expected P1 to P300",
                                               code_name('G', code.tenths)));
      return coordinate_system(5400 + static_cast<int>(p), code.column);
    }
    case 51:  // AI contour control, whose tolerance is the machine builder's
      control_.reset();
      if (words.has('Q') && words.of('Q') > 0.0) {
        control_.emplace();
        control_->stated = false;
      }
      return std::nullopt;
    case 80:
      return std::nullopt;
    case 1870:
      smoothing_ = true;
      if (words.has('E')) control_ = {PathControl::Mode::blend, words.of('E') * unit_mm_};
      return std::nullopt;
    case 800:
      // Post-processors write it beside G0 in the safety line: there the motion stays.
      if (mode_column_ == 0) mode_ = Mode::none;
      return std::nullopt;
    case 900:
      incremental_ = false;
      return std::nullopt;
    case 910:
      incremental_ = true;
      return std::nullopt;
    case 901:
      centre_absolute_ = true;
      return std::nullopt;
    case 911:
      centre_absolute_ = false;
      return std::nullopt;
    case 920:
      axis_use_ = AxisUse::offset_set;
      return std::nullopt;
    case 921:
      offset_mm_ = saved_offset_mm_ = {};
      return std::nullopt;
    case 922:
      saved_offset_mm_ = offset_mm_;
      offset_mm_ = {};
      return std::nullopt;
    case 923:
      offset_mm_ = saved_offset_mm_;
      return std::nullopt;
    case 280:
    case 300:
      axis_use_ = AxisUse::home;
      return std::nullopt;
    case 100:
      axis_use_ = AxisUse::set_data;
      return std::nullopt;
    case 382:
    case 383:
    case 384:
    case 385:
      axis_use_ = AxisUse::probe;
      return std::nullopt;
    case 410:
    case 411:
    case 420:
    case 421:
      return unsupported(code.column, code_name('G', code.tenths),
                         "a path of the tool's centre (G40); radius compensation is not simulated");
    case 930:
    case 950:
      return unsupported(code.column, code_name('G', code.tenths),
                         "feed in units per minute (G94)");
    default:
      return unsupported(code.column, code_name('G', code.tenths),
                         "one of the codes listed in gcode_reader.hpp");
  }
}

std::optional<BlockFault> GcodeMachine::coordinate_system(int system, int column) {
  if (moved_ever_ && system != coordinate_system_)
    return unsupported(column, system_name(system),
                       fmt::format("all motion in one work coordinate system; it began in {} and "
                                   "only the machine knows how the two lie",
                                   system_name(coordinate_system_)));
  coordinate_system_ = system;
  return std::nullopt;
}

std::optional<BlockFault> GcodeMachine::select_tool(const BlockWords& words) {
  if (!words.has('T')) return std::nullopt;
  const double tool = words.of('T');
  if (tool != std::floor(tool) || tool < 0.0 || tool > 99999999.0)
    return syntax(words.column_of('T'),
                  fmt::format("found tool {}, expected a whole number of the tool table", tool));
  selected_tool_ = static_cast<int>(tool);
  // A control without M6: T says what a hand has put in.
  if (tool_changes_ == 0) tool_ = selected_tool_;
  return std::nullopt;
}

std::optional<BlockFault> GcodeMachine::m_codes(const BlockWords& words) {
  for (int i = 0; i < words.m_count; ++i)
    if (auto fault = one_m_code(words, words.m[static_cast<std::size_t>(i)])) return fault;
  return std::nullopt;
}

std::optional<BlockFault> GcodeMachine::one_m_code(const BlockWords& words, BlockWords::Code code) {
  const int m = code.tenths % 10 == 0 ? code.tenths / 10 : -1;
  const auto whole = [&](char letter, double most) {
    const double value = words.has(letter) ? words.of(letter) : -1.0;
    return value == std::floor(value) && value >= 0.0 && value <= most ? value : -1.0;
  };
  if (m == 2 || m == 30) {
    ended_ = true;
  } else if (m == 6 || ((m == 0 || m == 1) && words.has('T'))) {
    // T beside a stop is a change by hand.
    ++tool_changes_;
    tool_ = selected_tool_;
  } else if (m == 61) {
    if (whole('Q', 99999999.0) < 0.0)
      return syntax(code.column, "found M61 without a tool, expected Q with its number");
    ++tool_changes_;
    tool_ = selected_tool_ = static_cast<int>(words.of('Q'));
  } else if (m == 98) {
    const double p = whole('P', 99999999.0);
    if (p < 0.0)
      return syntax(code.column, "found M98 without a subprogram, expected P with its number");
    jump_ = {SubprogramJump::Kind::call, static_cast<std::uint64_t>(p), 1, code.column};
    if (words.has('L')) {
      const double times = whole('L', 9999.0);
      if (times < 0.0)
        return syntax(words.column_of('L'), "found a count that is none, expected L0 to L9999");
      jump_.times = static_cast<std::uint64_t>(times);
    } else if (jump_.number > 9999) {  // older Fanuc: P<times><four digits>
      jump_.times = jump_.number / 10000;
      jump_.number %= 10000;
    }
  } else if (m == 99) {
    jump_ = {SubprogramJump::Kind::back, 0, 1, code.column};
  } else if (!((m >= 0 && m <= 9) || m == 19 || (m >= 48 && m <= 53) || m == 60)) {
    return unsupported(code.column, code_name('M', code.tenths),
                       "one of the codes listed in gcode_reader.hpp");
  }
  return std::nullopt;
}

}  // namespace maquette::cnc

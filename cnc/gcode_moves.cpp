// SPDX-License-Identifier: GPL-3.0-or-later

// The blocks of RS-274 with axis words: moves, arcs, offsets, homing, probing.

#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "cnc/arc_geometry.hpp"
#include "cnc/gcode_machine.hpp"

namespace maquette::cnc {
namespace {

constexpr std::array<char, 3> kAxes{'X', 'Y', 'Z'};
constexpr double kLongestTravel_mm = 1e6;
constexpr int kMostTurns = 1000;

[[nodiscard]] bool has_axis(const BlockWords& words) {
  return words.has('X') || words.has('Y') || words.has('Z');
}
[[nodiscard]] int first_axis_column(const BlockWords& words) {
  for (const char axis : kAxes)
    if (words.has(axis)) return words.column_of(axis);
  return 1;
}

[[nodiscard]] Vec3 vec(const std::array<double, 3>& a) {
  return {a[0], a[1], a[2]};
}

}  // namespace

// After G92 the present place is called by the given coordinates.
std::optional<BlockFault> GcodeMachine::set_offset(const BlockWords& words) {
  if (!has_axis(words)) return syntax(1, "found G92 without X, Y or Z, expected at least one");
  for (std::size_t i = 0; i < 3; ++i) {
    if (!words.has(kAxes[i])) continue;
    if (!known_[i])
      return unsupported(words.column_of(kAxes[i]),
                         fmt::format("G92 {} at a place that is not known yet", kAxes[i]),
                         "a move with that axis before");
    offset_mm_[i] = at_mm_[i] - words.of(kAxes[i]) * unit_mm_;
  }
  return std::nullopt;
}

// G10: L1 and its kin write the tool table, which changes nothing here; L20 says what the
// present place is called, L2 moves a frame by what only the machine knows.
std::optional<BlockFault> GcodeMachine::set_data(const BlockWords& words) {
  const double l = words.has('L') ? words.of('L') : 0.0;
  if (l == 1.0 || l == 10.0 || l == 11.0) return std::nullopt;
  if (l != 2.0 && l != 20.0)
    return unsupported(words.has('L') ? words.column_of('L') : 1, fmt::format("G10 L{}", l),
                       "L1, L2, L10, L11 or L20");
  const double p = words.has('P') ? words.of('P') : 0.0;
  if (p != std::floor(p) || p < 0.0 || p > 9.0)
    return syntax(words.has('P') ? words.column_of('P') : 1,
                  "found a work coordinate system that is none, expected P0 to P9");
  const int system = p <= 6.0 ? 53 + static_cast<int>(p) : 584 + static_cast<int>(p);
  if (p != 0.0 && system != coordinate_system_) return std::nullopt;
  for (std::size_t i = 0; i < 3; ++i) {
    if (!words.has(kAxes[i])) continue;
    known_[i] = l == 20.0;
    if (l == 20.0) at_mm_[i] = words.of(kAxes[i]) * unit_mm_ + offset_mm_[i];
  }
  return std::nullopt;
}

// To the reference point, by way of a place given by axis words.
std::optional<BlockFault> GcodeMachine::home(const BlockWords& words, Motion& motion, bool& moved) {
  if (!has_axis(words)) {
    known_ = {};
    return std::nullopt;
  }
  const Mode mode = mode_;
  mode_ = Mode::rapid;
  auto fault = move(words, motion, moved);
  mode_ = mode;
  if (moved && motion.to_mm == motion.from_mm) moved = false;
  for (std::size_t i = 0; i < 3; ++i)
    if (words.has(kAxes[i])) known_[i] = false;
  return fault;
}

// Where it stops only the machine knows.
std::optional<BlockFault> GcodeMachine::probe(const BlockWords& words, Motion& motion,
                                              bool& moved) {
  if (!has_axis(words)) return syntax(1, "found a probing move without X, Y or Z, expected one");
  mode_ = Mode::none;
  // Onwards by some way from where a probe touched: no more is known than before.
  for (std::size_t i = 0; i < 3; ++i)
    if (incremental_ && words.has(kAxes[i]) && !known_[i]) return std::nullopt;
  mode_ = Mode::line;
  auto fault = move(words, motion, moved);
  mode_ = Mode::none;
  motion.probe = true;
  for (std::size_t i = 0; i < 3; ++i)
    if (words.has(kAxes[i])) known_[i] = false;
  return fault;
}

std::optional<BlockFault> GcodeMachine::move(const BlockWords& words, Motion& motion, bool& moved) {
  const bool is_arc = mode_ == Mode::clockwise || mode_ == Mode::counter_clockwise;
  const bool centre = words.has('I') || words.has('J') || words.has('K') || words.has('R');
  if (!has_axis(words) && !(is_arc && centre)) {
    if (machine_frame_) return syntax(1, "found G53 without X, Y or Z, expected at least one");
    return std::nullopt;
  }
  if (mode_ == Mode::none)
    return syntax(first_axis_column(words),
                  "found an axis word without a motion, expected G0, G1, G2 or G3 before");
  if (!is_arc)
    for (const char letter : {'I', 'J', 'K', 'R'})
      if (words.has(letter))
        return syntax(words.column_of(letter),
                      fmt::format("found {} without an arc, expected it with G2 or G3", letter));
  if (machine_frame_) {
    if (mode_ != Mode::rapid)
      return unsupported(first_axis_column(words), "a cut in machine coordinates",
                         "G53 with G0 only; only the machine knows how its frame lies");
    for (std::size_t i = 0; i < 3; ++i)
      if (words.has(kAxes[i])) known_[i] = false;
    return std::nullopt;
  }

  const std::array<double, 3> from = at_mm_;
  const std::array<bool, 3> was_known = known_;
  for (std::size_t i = 0; i < 3; ++i) {
    if (!words.has(kAxes[i])) continue;
    const double value = words.of(kAxes[i]) * unit_mm_;
    if (incremental_) {
      at_mm_[i] += value;
    } else {
      at_mm_[i] = value + offset_mm_[i];
      known_[i] = true;
    }
    if (!(std::abs(at_mm_[i]) <= kLongestTravel_mm))
      return syntax(words.column_of(kAxes[i]),
                    fmt::format("found {} at {} mm, expected less than 1 km", kAxes[i], at_mm_[i]));
  }
  const bool from_known = was_known[0] && was_known[1] && was_known[2];
  const bool to_known = known_[0] && known_[1] && known_[2];
  moved_ever_ = true;
  motion.from_mm = vec(from);
  motion.to_mm = vec(at_mm_);
  motion.plane = plane_;
  motion.tool = tool_;
  motion.control = control_;
  motion.probe = false;
  motion.sweep_rad = 0.0;
  motion.feed_mm_min = feed_mm_min_;
  if (mode_ == Mode::rapid) {
    motion.kind = Motion::Kind::rapid;
    moved = from_known && to_known;
    return std::nullopt;
  }
  if (!to_known) {
    const std::size_t i = !known_[0] ? 0 : !known_[1] ? 1 : 2;
    return syntax(first_axis_column(words),
                  fmt::format("found a cut before {0} was ever given, expected an absolute {0} in "
                              "a move before",
                              kAxes[i]));
  }
  if (feed_mm_min_ <= 0.0)
    return BlockFault{kGcodeNoFeed, mode_column_ != 0 ? mode_column_ : first_axis_column(words),
                      "found a cut without a feed, expected an F word above zero on this line or "
                      "before"};
  if (!from_known) {
    if (is_arc)
      return syntax(first_axis_column(words),
                    "found an arc from a place that is not known, expected a move before");
    for (std::size_t i = 0; i < 3; ++i) {
      double& start = i == 0 ? motion.from_mm.x : i == 1 ? motion.from_mm.y : motion.from_mm.z;
      if (!was_known[i]) start = at_mm_[i];
    }
  }
  motion.kind = is_arc ? Motion::Kind::arc : Motion::Kind::line;
  moved = true;
  return is_arc ? arc(words, motion) : std::nullopt;
}

// Centre from I J K or R, sweep from the two directions. In each plane (first, second)
// is right-handed seen from the positive end of the third axis: xy, zx, yz.
std::optional<BlockFault> GcodeMachine::arc(const BlockWords& words, Motion& motion) {
  const auto [first, second, third] = axes_of(plane_);
  constexpr std::array<char, 3> kCentre{'I', 'J', 'K'};
  const std::array<double, 3> a{motion.from_mm.x, motion.from_mm.y, motion.from_mm.z};
  const std::array<double, 3> b{motion.to_mm.x, motion.to_mm.y, motion.to_mm.z};
  const bool ccw = mode_ == Mode::counter_clockwise;
  std::array<double, 3> c = a;
  const int column = mode_column_ != 0 ? mode_column_ : first_axis_column(words);
  if (words.has(kCentre[third]))
    return syntax(words.column_of(kCentre[third]),
                  fmt::format("found {}, which is not in the arc's plane, expected {} and {}",
                              kCentre[third], kCentre[first], kCentre[second]));
  const double d1 = b[first] - a[first], d2 = b[second] - a[second];
  if (words.has('R')) {
    if (words.has(kCentre[first]) || words.has(kCentre[second]))
      return syntax(words.column_of('R'), "found R beside a centre, expected either R or I, J, K");
    const double radius = std::abs(words.of('R')) * unit_mm_;
    const double half = 0.5 * std::hypot(d1, d2);
    if (!(half > 0.0))
      return BlockFault{kGcodeArc, words.column_of('R'),
                        "found an R arc that ends where it begins, expected I, J, K for a full "
                        "circle"};
    if (half > radius + std::fmax(kArcRadiusTolerance_mm, kArcRadiusToleranceRelative * radius))
      return BlockFault{kGcodeArc, words.column_of('R'),
                        fmt::format("found radius {:.6g} mm for ends {:.6g} mm apart, expected at "
                                    "least {:.6g} mm",
                                    radius, 2.0 * half, half)};
    const PlanePoint arm = centre_by_radius({d1, d2}, words.of('R') * unit_mm_, ccw);
    c[first] = a[first] + arm.u;
    c[second] = a[second] + arm.v;
  } else {
    if (!words.has(kCentre[first]) && !words.has(kCentre[second]))
      return syntax(column, fmt::format("found an arc without centre or radius, expected R or {} "
                                        "and {}",
                                        kCentre[first], kCentre[second]));
    for (const std::size_t i : {first, second}) {
      const double value = words.has(kCentre[i]) ? words.of(kCentre[i]) * unit_mm_ : 0.0;
      if (centre_absolute_ && !words.has(kCentre[i]))
        return syntax(column, fmt::format("found no {}, expected both centre coordinates with "
                                          "G90.1",
                                          kCentre[i]));
      c[i] = centre_absolute_ ? value + offset_mm_[i] : a[i] + value;
    }
  }
  const double r0 = std::hypot(a[first] - c[first], a[second] - c[second]);
  const double r1 = std::hypot(b[first] - c[first], b[second] - c[second]);
  const double allowed =
      std::fmax(kArcRadiusTolerance_mm, kArcRadiusToleranceRelative * std::fmax(r0, r1));
  if (!(r0 > 0.0) || !(r0 <= kLongestTravel_mm) || std::abs(r1 - r0) > allowed)
    return BlockFault{kGcodeArc, column,
                      fmt::format("found an arc with radius {:.6f} mm at its start and {:.6f} mm "
                                  "at its end, expected equal ones within {:.4g} mm",
                                  r0, r1, allowed)};
  double turns = 1.0;
  if (words.has('P')) {
    turns = words.of('P');
    if (turns != std::floor(turns) || turns < 1.0 || turns > kMostTurns)
      return syntax(words.column_of('P'), fmt::format("found {} turns, expected a whole number "
                                                      "from 1 to {}",
                                                      turns, kMostTurns));
  }
  constexpr double kTurn = 2.0 * std::numbers::pi;
  double sweep = kTurn;
  if (d1 != 0.0 || d2 != 0.0) {
    sweep = sweep_rad({a[first] - c[first], a[second] - c[second]},
                      {b[first] - c[first], b[second] - c[second]}, ccw);
    if (sweep <= 0.0) sweep += kTurn;
  }
  sweep += kTurn * (turns - 1.0);
  motion.sweep_rad = ccw ? sweep : -sweep;
  motion.centre_mm = vec(c);
  return std::nullopt;
}

}  // namespace maquette::cnc

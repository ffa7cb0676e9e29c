// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/motion_time.hpp"

#include <algorithm>

namespace maquette::cnc {
MotionTimer::MotionTimer(const Machine& machine, const PathControl& control, Watch watch)
    : machine_(machine),
      control_(control),
      watch_(std::move(watch)),
      plan_(static_cast<std::size_t>(machine.look_ahead_blocks),
            [this](const PlannedPiece& p) { take(p); }),
      planned_end_s_(static_cast<std::size_t>(machine.look_ahead_blocks), 0.0),
      real_end_s_(planned_end_s_) {}

void MotionTimer::add(const Motion& motion) {
  const Vec3 d = motion.to_mm - motion.from_mm;
  constexpr double kNoLength_mm = 1e-9;
  if (motion.kind != Motion::Kind::arc && dot(d, d) < kNoLength_mm * kNoLength_mm) {
    ++time_.moves;
    ++blocks_;
    return;
  }
  const MoveLimits next = move_limits(machine_, motion);
  const bool rapid = next.rapid;
  if (last_) join(corner(machine_, motion.control.value_or(control_), *last_, next), next);
  rapid_ = rapid;
  last_ = next;

  ++time_.moves;
  if (rapid) {
    time_.rapid_mm += next.length_mm;
  } else {
    time_.cutting_mm += next.length_mm;
    time_.programmed_s += next.length_mm / (motion.feed_mm_min / 60.0);
    if (time_.shortest_cut_mm == 0.0 || next.length_mm < time_.shortest_cut_mm)
      time_.shortest_cut_mm = next.length_mm;
  }
}

/// The last move, whose end is known now, and the corner behind it.
void MotionTimer::join(const Corner& c, const MoveLimits& next) {
  const MoveLimits& m = *last_;
  const double share = 1.0 - std::fmax(lost_in_, c.lost_share);
  double rest = m.length_mm - trim_in_mm_ - c.trim_mm;
  SpeedPiece arc{c.length_mm,   c.speed_mm_s,
                 c.along_mm_s2, std::fmin(m.jerk_mm_s3, next.jerk_mm_s3),
                 c.speed_mm_s,  0};
  // What corners leave of a line is run at the speed of the corner if it is that short.
  constexpr double kShortestCycles = 4.0;
  // Arcs of corners may meet in the middle of a move: nothing is left to be run by itself, least of
  // all within a cycle, which would be a standstill.
  constexpr double kNothing_mm = 1e-7;
  const double least = m.curved ? kNothing_mm : kShortestCycles * machine_.cycle_s * c.speed_mm_s;
  const bool whole = c.length_mm > 0.0 && rest < std::fmax(least, kNothing_mm);
  if (whole) {
    arc.length_mm += std::fmax(rest, 0.0);
    arc.entry_mm_s = entry_mm_s_;
    arc.moves_ended = ++blocks_;
  } else {
    rest = std::fmax(rest, kNothing_mm);
    plan_.add({rest, std::fmin(m.speed_mm_s, rest / machine_.cycle_s), m.along_mm_s2 * share,
               m.jerk_mm_s3, entry_mm_s_, ++blocks_});
  }
  blocks_ = 0;
  if (c.length_mm > 0.0) {
    arc.speed_mm_s = std::fmin(arc.speed_mm_s, arc.length_mm / machine_.cycle_s);
    plan_.add(arc);
  }
  if (c.speed_mm_s == 0.0) {
    plan_.rest();
    ++time_.stops;
    move_s_ = 0.0;
  }
  lost_in_ = c.lost_share;
  trim_in_mm_ = c.trim_mm;
  entry_mm_s_ = c.speed_mm_s;
}

void MotionTimer::rest() {
  if (!last_) return;
  join({}, *last_);
  last_.reset();
}

void MotionTimer::take(const PlannedPiece& planned) {
  (rapid_ ? time_.rapid_s : time_.cutting_s) += planned.seconds;
  move_s_ += planned.seconds;
  if (const std::uint32_t ended = planned.piece.moves_ended; ended > 0) {
    for (std::uint32_t i = 0; i < ended; ++i) move_done(move_s_ / ended);
    move_s_ = 0.0;
  }
  if (watch_) watch_(planned);
}

void MotionTimer::move_done(double seconds) {
  const std::size_t n = planned_end_s_.size();
  const std::size_t slot = done_++ % n;
  planned_s_ += seconds;
  if (done_ > n && planned_s_ > planned_end_s_[slot])
    time_.highest_blocks_per_s = std::fmax(
        time_.highest_blocks_per_s, static_cast<double>(n) / (planned_s_ - planned_end_s_[slot]));
  planned_end_s_[slot] = planned_s_;
  // The buffer has room when the block n before is done.
  read_s_ = std::fmax(read_s_, real_end_s_[slot]) + 1.0 / machine_.blocks_per_s;
  time_.waiting_s += std::fmax(0.0, read_s_ - real_s_);
  real_s_ = std::fmax(real_s_, read_s_) + seconds;
  real_end_s_[slot] = real_s_;
}

Result<MotionTime> time_program(const std::filesystem::path& program, const Machine& machine,
                                const PathControl& control, const RunContext& run) {
  MotionTimer timer(machine, control);
  MAQUETTE_TRY([[maybe_unused]] const auto summary,
               read_gcode(
                   program,
                   [&](std::span<const Motion> motions) -> Result<void> {
                     for (const Motion& m : motions) timer.add(m);
                     return {};
                   },
                   run));
  timer.rest();
  return timer.time();
}

MotionTime time_path(const Toolpath& path, const Machine& machine, const PathControl& control) {
  MotionTimer timer(machine, control);
  ToolPosition at = path.start;
  for (const PathMove& move : path.moves) {
    timer.add(motion_of(at, move));
    at = move.to;
  }
  timer.rest();
  return timer.time();
}

MotionTime& MotionTime::operator+=(const MotionTime& other) {
  rapid_s += other.rapid_s;
  cutting_s += other.cutting_s;
  waiting_s += other.waiting_s;
  rapid_mm += other.rapid_mm;
  cutting_mm += other.cutting_mm;
  programmed_s += other.programmed_s;
  moves += other.moves;
  stops += other.stops;
  if (shortest_cut_mm == 0.0 ||
      (other.shortest_cut_mm > 0.0 && other.shortest_cut_mm < shortest_cut_mm))
    shortest_cut_mm = other.shortest_cut_mm;
  highest_blocks_per_s = std::fmax(highest_blocks_per_s, other.highest_blocks_per_s);
  return *this;
}

}  // namespace maquette::cnc

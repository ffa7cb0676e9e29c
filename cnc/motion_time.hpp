// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file motion_time.hpp
/// How long a machine takes for a stream of motions.
///
/// Takes   motions of the reader, or moves of a strategy, one by one
/// Gives   seconds and lengths of rapids and cuts, and what the controller must keep up with
///
/// Method. Every move gets its limits and every corner its speed (motion_limits.hpp); the
/// fastest run along them follows (speed_plan.hpp); moves that come faster than the controller
/// reads blocks wait for it: a block is read 1 / blocks_per_s after the one before, and not
/// before there is room for it in the look-ahead buffer.
///
/// Accuracy. The limits of the plan are those of the machine file to rounding. Without jerk the
/// time is within 2 % of LinuxCNC 2.9's planner and within 3 % of an integration in steps of a
/// tenth of a millisecond that shares no code with it, on the paths of
/// tests/cnc/motion_time_test.cpp; what dwells, tool changes and spindle need is added by the
/// caller. A wait for blocks brakes and
/// starts the motion in truth; here it is just added.
///
/// Cost: at least 3 M moves/s on one core (10 M lines of a rough pass: 2.8 s), 1 M with jerk;
/// memory does not grow with the length.

#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <string>
#include <vector>

#include "cnc/motion_limits.hpp"
#include "cnc/speed_plan.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"

namespace maquette::cnc {

struct MotionTime {
  double rapid_s = 0.0, cutting_s = 0.0;
  double waiting_s = 0.0;  ///< for blocks to be read; not in the two above
  double rapid_mm = 0.0, cutting_mm = 0.0;
  double programmed_s = 0.0;  ///< cutting_mm at the programmed feeds, without acceleration
  std::uint64_t moves = 0;
  std::uint64_t stops = 0;            ///< corners and ends at rest
  double shortest_cut_mm = 0.0;       ///< 0: no cut
  double highest_blocks_per_s = 0.0;  ///< mean over as many moves as the look-ahead holds
  [[nodiscard]] double total_s() const { return rapid_s + cutting_s + waiting_s; }
  /// One after the other.
  MotionTime& operator+=(const MotionTime& other);
};

class MotionTimer {
 public:
  /// Called for each piece of the plan in order; corners' arcs are pieces too.
  using Watch = std::function<void(const PlannedPiece&)>;
  /// @param control  where a motion does not say
  MotionTimer(const Machine& machine, const PathControl& control, Watch watch = {});
  MotionTimer(const MotionTimer&) = delete;
  MotionTimer& operator=(const MotionTimer&) = delete;

  /// A move that ends where it begins counts as a block and takes no time.
  void add(const Motion& motion);
  /// The machine comes to rest: a tool change, a stop, the end of the program.
  void rest();
  /// What was added before the last rest().
  [[nodiscard]] const MotionTime& time() const { return time_; }

 private:
  void join(const Corner& corner, const MoveLimits& next);
  void take(const PlannedPiece& planned);
  void move_done(double seconds);

  Machine machine_;
  PathControl control_;
  Watch watch_;
  SpeedPlan plan_;
  MotionTime time_;
  std::optional<MoveLimits> last_;  ///< its end is not known yet
  double trim_in_mm_ = 0.0, lost_in_ = 0.0, entry_mm_s_ = 0.0;
  bool rapid_ = false;                              ///< what the plan holds
  double move_s_ = 0.0;                             ///< of the move that is being taken
  std::vector<double> planned_end_s_, real_end_s_;  ///< of the last moves, a ring
  double planned_s_ = 0.0, real_s_ = 0.0, read_s_ = 0.0;
  std::uint64_t done_ = 0;
  std::uint32_t blocks_ = 0;  ///< since the last piece that ended a move
};

/// @return time of the program, dwells included in none of its fields; the reader's errors
[[nodiscard]] Result<MotionTime> time_program(const std::filesystem::path& program,
                                              const Machine& machine, const PathControl& control,
                                              const RunContext& run = {});

/// Time of a path of a strategy. @pre its start is known
[[nodiscard]] MotionTime time_path(const Toolpath& path, const Machine& machine,
                                   const PathControl& control);

}  // namespace maquette::cnc

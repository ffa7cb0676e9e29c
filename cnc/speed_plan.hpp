// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file speed_plan.hpp
/// The fastest run along a path of pieces, each with a limit of speed, of acceleration and
/// perhaps of jerk, from rest to rest, as a controller with look-ahead does it.
///
/// Takes   pieces one by one, of any number: memory is bounded
/// Gives   each piece once, in order, with the speeds at its ends and its time
///
/// Method. Without jerk the square of the speed grows by at most 2 a L along a piece: one pass
/// backwards gives the highest speed from which every later limit can still be kept, one pass
/// forwards what is reached of it; each piece is then a trapeze or a triangle. The pass
/// backwards starts at rest at the end of what is known; where it meets a limit, nothing
/// that comes later can change what lies before, and this much is given out. So the plan is
/// that of the whole path at once, for any size of the window. (Time-optimal for the limits
/// given: J. E. Bobrow, S. Dubowsky, J. S. Gibson, doi:10.1177/027836498500400301, with limits
/// that are constant in each piece.)
///
/// A controller that looks ahead over n pieces must be able to stop n pieces on:
/// v^2 <= sum of 2 a L over the next n.
///
/// With jerk, pieces of one speed limit (within 2 %) that meet at a corner that does not
/// slow them down become one, and the acceleration is 0 at the ends of what results: a change
/// of speed by dv takes dv / a + a / j, or 2 sqrt(dv / j) if dv < a^2 / j, and
/// (v0 + v1) / 2 times that in length. Slower than a controller whose acceleration goes
/// through the ends, by what the tests measure on their paths; never faster than the limits.
///
/// Cost: some 60 ns a piece without jerk, 300 ns with.

#include <cstdint>
#include <functional>
#include <vector>

namespace maquette::cnc {

struct SpeedPiece {
  double length_mm = 0.0;                             ///< > 0
  double speed_mm_s = 0.0, acceleration_mm_s2 = 0.0;  ///< > 0
  double jerk_mm_s3 = 0.0;                            ///< 0: not limited
  double entry_mm_s = 0.0;        ///< limit at its beginning, beside the speeds of both pieces
  std::uint32_t moves_ended = 0;  ///< of the path's moves: how many end with this piece
};

struct PlannedPiece {
  SpeedPiece piece;
  double entry_mm_s = 0.0, top_mm_s = 0.0, exit_mm_s = 0.0;
  double seconds = 0.0;
};

class SpeedPlan {
 public:
  using Sink = std::function<void(const PlannedPiece&)>;
  /// @param look_ahead  pieces; 0: no limit
  SpeedPlan(std::size_t look_ahead, Sink sink) : look_ahead_(look_ahead), sink_(std::move(sink)) {}

  /// The first piece, and the first after rest(), begins at rest whatever its entry says.
  void add(const SpeedPiece& piece);
  /// The path ends, or pauses, at rest: everything is given out.
  void rest();

 private:
  void plan(bool to_the_end);
  [[nodiscard]] double reach(double from, const SpeedPiece& p) const;
  [[nodiscard]] PlannedPiece run(double entry, double exit, const SpeedPiece& p) const;

  std::size_t look_ahead_;
  Sink sink_;
  std::vector<SpeedPiece> pieces_;
  std::vector<double> limit_;     ///< at the beginning of each piece, and at the end: scratch
  std::vector<double> stopping_;  ///< sums of 2 a L or of lengths: scratch
  double speed_ = 0.0;            ///< at the beginning of the first piece
  std::size_t plan_at_ = 0;
};

}  // namespace maquette::cnc

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file motion_limits.hpp
/// How fast one move may be run, and how fast the corner between two.
///
/// Takes   moves in the model frame, a machine, how corners may be left (G61, G64 P)
/// Gives   speeds and accelerations along the path that keep every axis within its limits
///
/// Method. A line in the direction u may use v <= V_i / |u_i| and a <= A_i / |u_i| of each axis
/// i. An arc of radius r turns through all directions of its plane: V and A are the smaller
/// of its two axes, the acceleration across the path takes at most sqrt(3)/2 of A, so
/// v^2 <= sqrt(3)/2 A r, and along the path stays sqrt(1 - (v^2 / (A r))^2) A, at least A / 2,
/// with the v that the axes allow, for the feed may be raised on the way.
///
/// A corner between tangents u1, u2 can be passed in three ways, and the fastest is taken:
///  - as it is, with a jump of the velocity of v |u2 - u1| within one cycle of the
///    interpolator. It may take 0.1 of each axis' acceleration, which is then missing to both
///    moves;
///  - by an arc that leaves the corner by no more than the tolerance P: with h = |u2 - u1| / 2
///    (the sine of half the turn) and c = sqrt(1 - h^2) its tangent points lie
///    d = P (1 + c) / h before and behind the corner, not more than half a line, a third of the
///    arc behind or two thirds of the arc before, and its radius is d c / h. An arc that
///    bends as the corner does counts by its secant over that part: its angle with the
///    tangent, half of it, is added to half the turn;
///  - by a stop.
/// This is how LinuxCNC 2.9's planner behaves (its manual, "Trajectory Control"; R. W. Ellenberg's
/// circular blends); with arcs of zero length, only speeds, it is GRBL's junction deviation
/// (S. K. Jeon, "Improving Grbl: Cornering Algorithm", 2011).
///
/// Not modelled: the parabolic blends that LinuxCNC falls back to where an arc is not in the
/// plane of the corner; there the arc's speed is taken.

#include "cnc/gcode_reader.hpp"
#include "cnc/machine.hpp"
#include "cnc/toolpath.hpp"

namespace maquette::cnc {

struct MoveLimits {
  bool rapid = false;
  double length_mm = 0.0;
  double speed_mm_s = 0.0;
  double axis_speed_mm_s = 0.0;     ///< what the axes alone allow
  double acceleration_mm_s2 = 0.0;  ///< in the move's plane or direction
  double along_mm_s2 = 0.0;         ///< what is left of it along the path
  double jerk_mm_s3 = 0.0;          ///< along the path; 0: not limited
  bool curved = false;
  Vec3 start, end;                               ///< unit tangents
  double blend_in_mm = 0.0, blend_out_mm = 0.0;  ///< that a corner's arc may use up
  double radius_mm = 0.0, sweep_rad = 0.0;       ///< arcs
  Vec3 bend_start, bend_end;                     ///< arcs: unit, across the path, to the centre
};

/// @pre length_mm(motion) > 0; cuts have a feed > 0
[[nodiscard]] MoveLimits move_limits(const Machine& machine, const Motion& motion);

struct Corner {
  double speed_mm_s = 0.0;  ///< 0: stop
  /// Of the arc that replaces the corner, 0 if there is none: radius, its own length, and
  /// the length that it takes from each move.
  double radius_mm = 0.0, length_mm = 0.0, trim_mm = 0.0;
  double along_mm_s2 = 0.0;  ///< acceleration along the arc
  double lost_share = 0.0;   ///< of the acceleration along both moves, to the corner's jump
};

[[nodiscard]] Corner corner(const Machine& machine, const PathControl& control,
                            const MoveLimits& before, const MoveLimits& after);

/// A move of a strategy as the reader gives it. @pre from and move.to are known
[[nodiscard]] Motion motion_of(const ToolPosition& from, const PathMove& move);

}  // namespace maquette::cnc

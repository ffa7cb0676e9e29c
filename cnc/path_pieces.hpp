// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file path_pieces.hpp
/// Motions cut into pieces simple enough for closed forms: straight lines, circular arcs
/// in a vertical plane (G18, G19) and level ones (G17). Used by the simulation and by the proof.
///
/// Arcs end at the quadrants of their circle, so that on each piece both coordinates of the
/// plane are monotone. An arc whose radius changes (the ends of a written arc never lie on one
/// circle exactly) becomes arcs through its own points; where that or a helix would leave more
/// than kPieceDeviation_mm, it becomes chords.
///
/// Accuracy: every place of the motion is within `deviation_mm` of its piece, and deviation_mm is
/// at most kPieceDeviation_mm. A piece of sweep s <= 90 degrees whose radius changes by e, the
/// pitch p = e / s, has curvatures that differ from that of the circle through both ends by at
/// most (e + 1.5 p^2 / r) / r^2; two curves with common ends, at most 45 degrees steep over a
/// chord of at most s r, are then at most half of s^2 (e + 1.5 p^2 / r) apart, and never more
/// than e / 2.

#include <functional>

#include "cnc/gcode_reader.hpp"

namespace maquette::cnc {

inline constexpr double kPieceDeviation_mm = 1e-4;

struct PathPiece {
  enum class Kind : std::uint8_t { line, vertical_arc, level_arc };
  Kind kind = Kind::line;
  /// vertical_arc: the path lies above its centre (rolls over a hill).
  bool upper = false;
  Vec3 from_mm{}, to_mm{};
  Vec3 centre_mm{};  ///< arcs; vertical ones lie along x or along y
  double radius_mm = 0.0;
  double deviation_mm = 0.0;
};

/// In the order of the motion, unbroken; rapids are lines. A motion without length gives a line.
void for_each_piece(const Motion& motion, const std::function<void(const PathPiece&)>& visit);

/// Point of an arc piece in the middle of its sweep; of a line, its middle.
[[nodiscard]] Vec3 middle_of(const PathPiece& piece);

}  // namespace maquette::cnc

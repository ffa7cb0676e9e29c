// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/tool_moves.hpp"

#include <cmath>

namespace maquette::cnc {
namespace {

/// Halves an arc's piece until it is flat enough.
template <class Visit>
void flat_enough(const PathPiece& piece, Visit&& visit) {
  const double half = 0.5 * norm(piece.to_mm - piece.from_mm), r = piece.radius_mm;
  if (r - std::sqrt(std::fmax(0.0, r * r - half * half)) <= kPieceSag_mm) {
    visit(piece);
    return;
  }
  PathPiece part = piece;
  part.to_mm = middle_of(piece);
  flat_enough(part, visit);
  part.from_mm = part.to_mm;
  part.to_mm = piece.to_mm;
  flat_enough(part, visit);
}

}  // namespace

void append_tool_moves(const Motion& motion, const Cutter& cutter, std::uint16_t cutter_index,
                       std::uint32_t motion_index, std::vector<ToolMove>& moves) {
  const bool rapid = motion.kind == Motion::Kind::rapid;
  const auto push = [&](const PathPiece& piece) {
    moves.push_back({piece, rapid, cutter_index, motion_index});
  };
  if (motion.kind != Motion::Kind::arc) {
    push({.from_mm = motion.from_mm, .to_mm = motion.to_mm});
  } else if (!cutter.is_ball() && motion.plane != ArcPlane::xy) {
    for_each_chord(motion, kPieceDeviation_mm, [&](Vec3 from, Vec3 to) {
      push({.from_mm = from, .to_mm = to, .deviation_mm = kPieceDeviation_mm});
    });
  } else {
    for_each_piece(motion, [&](const PathPiece& piece) {
      if (piece.kind == PathPiece::Kind::line)
        push(piece);
      else
        flat_enough(piece, push);
    });
  }
}

double widest_mm(const Cutter& cutter) {
  double radius = cutter.radius_mm;
  for (const HolderPart& part : cutter.holder)
    radius = std::fmax(radius, std::fmax(part.bottom_radius_mm, part.top_radius_mm));
  return radius;
}

}  // namespace maquette::cnc

// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/path_pieces.hpp"

#include <array>
#include <cmath>
#include <numbers>

#include "cnc/arc_geometry.hpp"

namespace maquette::cnc {
namespace {

constexpr double kQuadrant = 0.5 * std::numbers::pi;
/// Pieces of a smaller sweep are joined to their neighbour.
constexpr double kSliver_rad = 1e-9;

using Coordinates = std::array<double, 3>;
[[nodiscard]] Coordinates coordinates(Vec3 v) {
  return {v.x, v.y, v.z};
}

/// Circle through both ends whose centre is as near to `centre` as can be.
[[nodiscard]] PathPiece arc_piece(PathPiece::Kind kind, const Coordinates& from,
                                  const Coordinates& to, Coordinates centre, std::size_t first,
                                  std::size_t second) {
  const double d1 = to[first] - from[first], d2 = to[second] - from[second];
  const double off = d1 * (centre[first] - 0.5 * (from[first] + to[first])) +
                     d2 * (centre[second] - 0.5 * (from[second] + to[second]));
  const double shift = off / (d1 * d1 + d2 * d2);
  centre[first] -= shift * d1;
  centre[second] -= shift * d2;
  PathPiece piece;
  piece.kind = kind;
  piece.from_mm = {from[0], from[1], from[2]};
  piece.to_mm = {to[0], to[1], to[2]};
  piece.centre_mm = {centre[0], centre[1], centre[2]};
  piece.radius_mm = std::hypot(from[first] - centre[first], from[second] - centre[second]);
  piece.upper = 0.5 * (from[2] + to[2]) > centre[2];
  return piece;
}

/// How far the spiral of a piece may be from the circle through its ends (path_pieces.hpp).
[[nodiscard]] double circle_deviation(double radius, double radius_change, double sweep) {
  const double pitch = radius_change / sweep;
  return std::fmin(0.5 * radius_change,
                   0.5 * sweep * sweep * (radius_change + 1.5 * pitch * pitch / radius));
}

void arcs(const Motion& motion, const std::function<void(const PathPiece&)>& visit) {
  const auto [first, second, third] = axes_of(motion.plane);
  const Coordinates a = coordinates(motion.from_mm), b = coordinates(motion.to_mm),
                    c = coordinates(motion.centre_mm);
  const double r0 = std::hypot(a[first] - c[first], a[second] - c[second]);
  const double r1 = std::hypot(b[first] - c[first], b[second] - c[second]);
  const double sweep = motion.sweep_rad, turn = std::abs(sweep);
  const double widest = std::fmin(turn, kQuadrant);
  const double deviation =
      circle_deviation(std::fmin(r0, r1), std::abs(r1 - r0) * widest / turn, widest);
  if (a[third] != b[third] || deviation > kPieceDeviation_mm) {
    for_each_chord(motion, kPieceDeviation_mm, [&](Vec3 from, Vec3 to) {
      visit({.from_mm = from, .to_mm = to, .deviation_mm = kPieceDeviation_mm});
    });
    return;
  }
  const auto kind =
      motion.plane == ArcPlane::xy ? PathPiece::Kind::level_arc : PathPiece::Kind::vertical_arc;
  const double begin = std::atan2(a[second] - c[second], a[first] - c[first]), end = begin + sweep;
  const double direction = sweep > 0.0 ? 1.0 : -1.0;
  // Quadrants in the direction of the motion: phi = direction * k * 90 degrees.
  auto k = static_cast<long>(std::floor((direction * begin + kSliver_rad) / kQuadrant)) + 1;
  Coordinates from = a;
  for (bool last = false; !last;) {
    const double phi = direction * static_cast<double>(k) * kQuadrant;
    last = direction * (end - phi) <= kSliver_rad;
    Coordinates to = b;
    if (!last) {
      const double r = r0 + (phi - begin) / sweep * (r1 - r0);
      constexpr std::array<double, 4> kCos{1.0, 0.0, -1.0, 0.0};
      const auto quarter = static_cast<std::size_t>(((k % 4) + 4) % 4);
      to = a;
      to[first] = c[first] + r * kCos[quarter];
      to[second] = c[second] + direction * r * kCos[(quarter + 3) % 4];
    }
    if (to != from) {
      PathPiece piece = arc_piece(kind, from, to, c, first, second);
      piece.deviation_mm = deviation;
      visit(piece);
    }
    from = to;
    ++k;
  }
}

}  // namespace

void for_each_piece(const Motion& motion, const std::function<void(const PathPiece&)>& visit) {
  if (motion.kind == Motion::Kind::arc)
    arcs(motion, visit);
  else
    visit({.from_mm = motion.from_mm, .to_mm = motion.to_mm});
}

Vec3 middle_of(const PathPiece& piece) {
  const Vec3 middle = 0.5 * (piece.from_mm + piece.to_mm);
  if (piece.kind == PathPiece::Kind::line) return middle;
  // A piece is at most a quadrant: the chord's middle is never the centre.
  Vec3 out = middle - piece.centre_mm;
  if (piece.kind == PathPiece::Kind::level_arc) {
    out.z = 0.0;
  } else if (piece.from_mm.x == piece.to_mm.x) {
    out.x = 0.0;
  } else {
    out.y = 0.0;
  }
  const Vec3 p = piece.centre_mm + (piece.radius_mm / norm(out)) * out;
  if (piece.kind == PathPiece::Kind::level_arc) return {p.x, p.y, middle.z};
  return piece.from_mm.x == piece.to_mm.x ? Vec3{middle.x, p.y, p.z} : Vec3{p.x, middle.y, p.z};
}

}  // namespace maquette::cnc

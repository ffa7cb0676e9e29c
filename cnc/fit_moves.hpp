// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file fit_moves.hpp
/// Samples of the exact cutter location along a straight line -> few lines and circular arcs in
/// the vertical plane of that line, inside a tolerance that is narrower below than above.
/// Without arcs: fit_lines.hpp.
///
/// Method. In the plane (t along the line, z up) relative to where a move starts, every line and
/// every circle through the start is
///     z = a t + b (t^2 + z^2),   b = 0: a line, b < 0: an arc with its centre below
/// so that a sample's tolerance band bounds (a, b) by two straight lines. Greedy: the polygon of
/// (a, b) that pass all samples' bands is clipped until it is empty, for arcs over (b < 0) and
/// under (b > 0) the surface, beside it the cone of slopes for b = 0 (J. Sklansky, V. Gonzalez,
/// "Fast polygonal approximation of digitized curves", Pattern Recognition 12, 1980,
/// doi:10.1016/0031-3203(80)90031-X; for circles through a point as half planes of their centres
/// see R. Drysdale, G. Rote, A. Sturm, "Approximation of an open polygonal curve with a minimum
/// number of circular arcs and biarcs", Comput. Geom. 41, 2008, doi:10.1016/j.comgeo.2007.10.009).
/// Whichever of line and arc reaches farther becomes the move. While the ball rolls over a single
/// vertex its path is an arc of the first kind, exactly.
///
/// Arcs are given by their radius (R words): then both ends are on the circle whatever is rounded,
/// a control cannot complain of two radii, and a digit or two of the radius is enough.
///
/// Accuracy. Each move is rounded to 0.001 mm and then checked again as written, at every sample
/// and between. Bounds are of the rounded numbers (docs/derivations/path_between_samples.md).
/// Controls that part arcs into chords deviate by what they are told to, in addition.
/// Cost. Linear in the samples; about 0.1 us each.

#include <cstdint>
#include <vector>

#include "cnc/pass_sampler.hpp"

namespace maquette::cnc {

struct FitLimits {
  double gouge_mm = 0.0049;   ///< below the exact cutter location, all in all; measured vertically
  double excess_mm = 0.0090;  ///< above it
  bool arcs = true;           ///< the line runs along x or y and the control has G18 and G19
  double least_radius_mm = 0.1, greatest_radius_mm = 200.0;
};

/// Of the tolerance, what samples may miss above the path: beyond, a sample more costs less than
/// a move. Lines gain from a wider tube, arcs hardly.
[[nodiscard]] constexpr double dip_share(bool arcs) {
  return arcs ? 0.2 : 0.1;
}

/// Ends at `place` of the line, at height z.
struct FittedMove {
  std::int64_t place = 0, z = 0;  ///< z in ticks, a multiple of kResolution
  enum class Shape : std::uint8_t { line, over, under } shape = Shape::line;
  std::int64_t radius = 0;  ///< ticks, of arcs: less than half a turn through both ends
};

struct FitBounds {
  double gouge_mm = 0.0;   ///< nowhere deeper below the exact cutter location
  double excess_mm = 0.0;  ///< nowhere higher above it; walls that force a lift are in it
};

/// Replaces `moves`: the first is where the path starts (a line of no length), each further one
/// begins where the one before ended. Both ends of the line are at their samples' own height,
/// rounded up, so that lines with a common end meet; at samples that are a stop a move ends. The
/// gouge is at most limits.gouge_mm; the excess at most limits.excess_mm but where lifts or
/// unresolved dips of the samples exceed it.
/// @pre samples are in order of place, their gouge below 0.6 limits.gouge_mm; limits at least
///      0.5 um wide beyond that
[[nodiscard]] FitBounds fit_moves(const std::vector<PathSample>& samples, double step_mm,
                                  const FitLimits& limits, std::vector<FittedMove>& moves);

/// The same path the other way round.
void reverse_moves(std::vector<FittedMove>& moves);

/// Adds moves to a path that ends at the first one's place, in machine coordinates.
void append_fitted(Toolpath& path, const LatticeLine& line, const std::vector<FittedMove>& moves,
                   double feed_mm_min);

}  // namespace maquette::cnc

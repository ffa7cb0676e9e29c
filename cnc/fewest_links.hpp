// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file fewest_links.hpp
/// The polyline with the fewest links through a tube in the plane (t along, z up): for a path
/// whose height may be anywhere between two bounds.
///
/// Takes   stations: places in order of t, each with the least and the greatest height there; at
///         corners the polyline must have a vertex
/// Gives   its vertices, first and last station included; between stations anywhere else
///
/// Method. What can be reached with k links ends at a window: the last piece of the line that gets
/// farthest, from its last contact p with the side that holds it back to where it runs through the
/// other side. The next link is a line that crosses the window; after crossing it stays on that
/// side, so from p to the window's end only the side that holds back counts, and further on
/// both. Lines z = a t + b that do are a convex polygon in (a, b), clipped station by station until
/// it is empty; its corner that comes nearest to the station that emptied it is the next window's
/// line. Links lie on the windows' lines, so vertices are where two of them cross (S. Suri, "A
/// linear time algorithm for minimum link paths inside a simple polygon", Comput. Vision Graph.
/// Image Process. 35, 1986, doi:10.1016/0734-189X(86)90127-1; H. Imai, M. Iri, "An optimal
/// algorithm for approximating a piecewise linear function", J. Inf. Process. 9, 1986). At a corner
/// the window is upright.
///
/// Accuracy. No polyline through the tube has fewer links. Every station is passed within its
/// bounds up to rounding (1e-8 mm).
/// Cost. Linear in the stations; about 0.1 us each.

#include <span>
#include <vector>

namespace maquette::cnc {

struct TubeStation {
  double t = 0.0, low = 0.0, high = 0.0;
  bool corner = false;
  /// Of corners: where between the two the vertex had best be, if that costs no link.
  double aim = 0.0;
};

struct TubePoint {
  double t = 0.0, z = 0.0;
};

/// @pre at least two stations, t ascending, low <= high
/// @return empty where rounding leaves no way, in tubes of hardly any width beside walls
[[nodiscard]] std::vector<TubePoint> fewest_links(std::span<const TubeStation> stations);

}  // namespace maquette::cnc

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file geodesic_passes.hpp
/// Finishing path along curves of equal distance on the surface of the cutter's locations: the
/// same stepover on slopes as on the flat, and hardly a lift of the cutter.
///
/// Room    cnc:  tips on a grid -> geodesic field -> level curves -> spirals -> gaps -> exact moves
/// Takes   ModelField, millimetres, no voids
/// Gives   moves piece by piece (mill.hpp's sink); the model frame, tip of the ball
///
/// Method. The exact cutter location at the nodes of a grid, at most half the stepover apart, is
/// itself a triangulated surface, parallel to that of the ball's centres. The distance on it from
/// the outline, a point or a line (meshing/geodesic.hpp) has level curves that are `stepover` apart
/// in space whatever the slope (R. Kimmel, A. Bruckstein, "Shape offsets via level sets", Comput.
/// Aided Des. 25, 1993, doi:10.1016/0010-4485(93)90040-U). Nested closed ones become spirals
/// (level_curves.hpp); where the path leaves more than 0.65 of a stepover to the surface (kinks
/// sharper than a right angle, fronts that meet, the middle) strokes are added (cover_gaps.hpp).
/// The outline is always cut: what lies beside it is touched from there alone. With `scallop_limit`
/// the distance counts more in hollows, by the root of what a hollow adds to the ridge, up to 3
/// times, and the stepover follows from the limit. Along these curves, as chords off by at most a
/// twentieth of the stepover and in directions that a program can write exactly, the path is the
/// exact cutter location, sampled and fitted within bounds as raster passes are (pass_sampler.hpp,
/// fit_lines.hpp).
///
/// Accuracy. Gouge: certified, as for raster passes. Ridges: predicted from the finished path
/// (cover_gaps.hpp), to which the certified excess of the path itself comes: on planes and domes
/// the ridge of the stepover between two curves, up to 1.9 times that at kinks; with a limit, the
/// limit. Where the surface of locations has creases (valleys that the ball touches on both
/// sides) second differences tell how much more stays; `scallop` maps it.
/// Cost. Beside the surface 12 bytes a node of the grid of tips, 16 with a scallop limit, and 8 a
/// place of the curves; moves are handed over as they come.

#include <vector>

#include "cnc/mill.hpp"
#include "meshing/geodesic.hpp"

namespace maquette::cnc {

struct GeodesicPassOptions {
  Millimetres ball_diameter{6.0};
  Millimetres stepover{0.5};       ///< in space; not used with a scallop limit
  Millimetres scallop_limit{NAN};  ///< NaN: constant stepover
  /// Where the curves start, in plan: empty: the outline; one point; or a line of two and more.
  std::vector<meshing::PlanPoint> start{};
  Millimetres tolerance{0.01};  ///< of the written path, all causes together: share_tolerance
  FeedRate feed{3000.0};
  FeedRate plunge_feed{600.0};
  Millimetres clearance{5.0};  ///< rapids stay this far above everything they fly over
  /// How far roughing left material above the design at most; NaN: not known, rapids fly over
  /// the design's highest point.
  Millimetres stock_allowance{NAN};
};

struct GeodesicPassReport {
  std::uint64_t field_nodes = 0;
  std::uint64_t curves = 0;   ///< level curves, without outline and start
  std::uint64_t pieces = 0;   ///< unbroken ways they were joined into
  std::uint64_t strokes = 0;  ///< added where curves leave gaps
  std::uint64_t links_cut = 0, links_flown = 0;
  std::uint64_t points_sampled = 0, lines = 0;
  double stepover_mm = 0.0;  ///< between curves, as used
  double path_length_mm = 0.0, rapid_length_mm = 0.0;
  double cutting_time_min = 0.0;  ///< length over feed; no acceleration
  double shortest_move_mm = 0.0, highest_block_rate_per_s = 0.0;
  ToleranceShares shares;
  double certified_gouge_mm = 0.0, certified_excess_mm = 0.0;  ///< as in MillReport
  double scallop_flat_mm = 0.0;                                ///< of two curves on a plane
  ScallopMap scallop;                                          ///< predicted, of the finished path
  double lowest_tip_mm = 0.0, highest_tip_mm = 0.0;
};

/// The same moves for any number of threads. The first piece starts above the first cut at a
/// height that clears everything, the last ends there.
/// @pre the design has at least 2 x 2 nodes
/// @return figures, or an error of check_mill; CNC_STEPOVER_OUT_OF_RANGE also where the field would
///         need more than 2^30 nodes; MESHING_GEODESIC_SOURCE: a start off the surface; the sink's
///         error; CORE_CANCELLED
[[nodiscard]] Result<GeodesicPassReport> geodesic_passes(const heightmap::ModelField& design,
                                                         const GeodesicPassOptions& options,
                                                         const ToolpathSink& sink,
                                                         const RunContext& run = {});

}  // namespace maquette::cnc

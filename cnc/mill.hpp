// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file mill.hpp
/// Height field -> G-code of the finishing pass with a ball-nose cutter.
///
/// Room    cnc:  cutter location -> raster -> fit_moves -> linking -> [mill] -> program -> verify
/// Takes   ModelField, millimetres, no voids
/// Gives   moves pass by pass, or a program of any post; the model frame, tip of the ball
///
/// Path: parallel passes at any angle, clipped to the outline (raster.hpp), `stepover` apart in
/// plan; with `constant_scallop` further passes between them wherever the ridge would be higher
/// than `scallop_limit` (scallop.hpp). Along a pass the exact cutter location of the triangulated
/// surface (facets, edges, vertices; cutter_location.hpp) is sampled adaptively, so that the path
/// between samples cuts no deeper than a certified bound, then written as lines and arcs inside
/// `tolerance` (fit_moves.hpp), narrower below than above. Gouge is measured vertically.
///
/// This is the finishing pass alone: stock is expected to stand no higher above the design than
/// the cutter may take in one go. Passes are joined along the exact cutter location where that is
/// short, else by rapids at the lowest safe height of the line flown (linking.hpp). Where a cut
/// begins or ends on the design's outline after or before a rapid, it is led in or out by a quarter
/// circle outwards, level at the surface: from the edge outwards the cutter location only falls,
/// so that touches nothing.
///
/// Material may stay on beside walls steeper than about 75 : 1, where the path is lifted
/// rather than cut too deep. The machine's own deviation is not in the bounds.

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <string>
#include <vector>

#include "cnc/path_figures.hpp"
#include "cnc/posts.hpp"
#include "cnc/scallop.hpp"
#include "cnc/toolpath.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/units.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::cnc {

inline constexpr ErrorCode kToolNotPositive{"CNC_TOOL_NOT_POSITIVE"};
inline constexpr ErrorCode kStepoverOutOfRange{"CNC_STEPOVER_OUT_OF_RANGE"};
inline constexpr ErrorCode kToleranceOutOfRange{"CNC_TOLERANCE_OUT_OF_RANGE"};
inline constexpr ErrorCode kFeedOutOfRange{"CNC_FEED_OUT_OF_RANGE"};
inline constexpr ErrorCode kHeightNotFinite{"CNC_HEIGHT_NOT_FINITE"};
inline constexpr ErrorCode kMillOptionOutOfRange{"CNC_MILL_OPTION_OUT_OF_RANGE"};

struct MillOptions {
  Millimetres ball_diameter{6.0};
  Millimetres stepover{0.5};         ///< in plan; rounded down to 0.001 mm
  Radians direction{0.0};            ///< of the passes, counter-clockwise from +x; see raster.hpp
  bool zigzag = true;                ///< else one way
  bool climb = true;                 ///< one way: uncut material to the right, else conventional
  bool constant_scallop = false;     ///< add passes where the ridge would exceed the limit
  Millimetres scallop_limit{0.011};  ///< ridge between passes, normal to the surface
  /// What may stay above the scallop stated for the slope wherever the ball reaches, vertically:
  /// beside creases and in pits between passes by cuts across to them (side_cuts.hpp), each a stop.
  /// NaN: none. For passes along an axis.
  Millimetres excess_limit{NAN};
  /// The passes whose scallop the limit counts from; NaN: the stepover. Passes that lie closer than
  /// that leave less beside creases, and need the fewer cuts across.
  Millimetres stated_stepover{NAN};
  Millimetres tolerance{0.01};  ///< of the written path, all causes together: share_tolerance
  bool arcs = true;             ///< G2 and G3 in G18 and G19, for passes along an axis
  FeedRate feed{3000.0};
  FeedRate plunge_feed{600.0};
  double spindle_rpm = 18000.0;
  Millimetres clearance{5.0};    ///< rapids stay this far above everything they fly over
  Millimetres lead_radius{1.0};  ///< 0: straight down and up
  /// How far passes go on beyond the design's outline, where ground that falls outwards is touched
  /// from (border_overrun()); at most 0.6 of the ball's radius. Rows beyond it are whole stepovers
  /// away, sides that a band shares with its neighbours stay.
  Millimetres overrun{0.0};
  /// What stands before this pass, so that rapids can stay low: a height field, or how far
  /// roughing left material above the design at most. Neither: rapids fly over the design's
  /// highest point, and what goes down from there is cut.
  const heightmap::ModelField* stock = nullptr;
  Millimetres stock_allowance{NAN};
  std::string post = "linuxcnc";  ///< see posts.hpp
  std::string program_name = "maquette";
  int work_offset = 54;         ///< see program.hpp
  bool relative = false;        ///< see program.hpp
  std::uint64_t max_lines = 0;  ///< of one file of the program; 0: any number
  std::uint64_t max_bytes = 0;
  /// Only passes with y in [first_y, last_y]; NaN: the whole field. A band passes its
  /// own range and a field widened by the cutter's radius.
  double first_y_mm = NAN, last_y_mm = NAN;
};

/// What each cause may take of the tolerance. The mesh takes nothing: the triangles themselves are
/// cut. Rounding to 0.001 mm is part of fitting, which is checked on the rounded moves.
///
/// The written path and what the control makes of it are kept apart: the path is proven by reading
/// it back, vertically; the control may leave it by `blending`, a distance in space. So the cutter
/// goes nowhere deeper than gouge + blending, at right angles to the surface; vertically, on a
/// slope, than gouge + blending / cos(slope). docs/derivations/path_between_samples.md
struct ToleranceShares {
  double gouge_mm = 0.0;     ///< of the path, below: half the tolerance
  double excess_mm = 0.0;    ///< of the path, above: what blending leaves of the tolerance
  double sampling_mm = 0.0;  ///< of the gouge: between samples
  double fitting_mm = 0.0;   ///< of the gouge: chords, arcs, rounding; a little is kept back
  double blending_mm = 0.0;  ///< beside the path: the control may round corners by it (G64 P, Q0)
};
[[nodiscard]] ToleranceShares share_tolerance(Millimetres tolerance);
/// The shares as a line of a program's head.
[[nodiscard]] std::string head_line(const ToleranceShares& shares);

/// What the ball has to go beyond the outline to touch the facets along it: R times the outward
/// part of their normals, at most 0.6 R (ground of 37 degrees), rounded up to 0.001 mm. Without it
/// what falls outwards keeps up to R (1 / cos(slope) - 1) at the outline.
[[nodiscard]] Millimetres border_overrun(const heightmap::ModelField& design, BallNose tool);

struct MillReport {
  std::uint64_t passes = 0;        ///< rows of the raster
  std::uint64_t extra_passes = 0;  ///< pieces of passes added to hold the scallop
  std::uint64_t side_cuts = 0;     ///< to hold the excess
  std::uint64_t links_cut = 0, links_flown = 0;
  std::uint64_t points_sampled = 0;          ///< before
  std::uint64_t lines = 0, arcs = 0;         ///< after: cutting moves
  std::uint64_t blocks = 0, bytes = 0;       ///< of the program
  std::vector<std::filesystem::path> files;  ///< of the program
  double path_length_mm = 0.0;               ///< at cutting feed
  double rapid_length_mm = 0.0;
  double cutting_time_min = 0.0;  ///< length over feed; no acceleration
  double shortest_move_mm = 0.0;
  /// Cutting moves a second at the programmed feed, at worst over 32 in a row; 0 for fewer.
  double highest_block_rate_per_s = 0.0;
  double direction_deg = 0.0;  ///< of the passes, as cut
  ToleranceShares shares;
  double certified_gouge_mm = 0.0;   ///< bound on how deep the path cuts, vertically
  double certified_excess_mm = 0.0;  ///< and how far above the exact path, lifts at walls included
  double scallop_flat_mm = 0.0;      ///< R - sqrt(R^2 - (stepover / 2)^2)
  ScallopMap scallop;                ///< predicted, against scallop_limit
  double lowest_tip_mm = 0.0, highest_tip_mm = 0.0;
};

/// With its default.
[[nodiscard]] inline Millimetres stated_stepover(const MillOptions& o) {
  return std::isnan(o.stated_stepover.value()) ? o.stepover : o.stated_stepover;
}

/// Ranges of all options but those of the program, see mill_passes; voids of the design.
[[nodiscard]] Result<void> check_mill(const heightmap::ModelField& design,
                                      const MillOptions& options);

/// Takes the path piece by piece, in order; each starts where the one before ended, the first
/// above the first cut at a height that clears everything. An error ends the work.
using ToolpathSink = std::function<Result<void>(const Toolpath& piece)>;

/// The same moves for the same design and options, for any number of threads. Ranges: diameter >
/// 0; stepover from one step of the raster to the diameter; tolerance in [0.001, 1] mm; feeds and
/// spindle > 0, finite; clearance, lead radius, stock allowance >= 0; scallop limit in (0, radius];
/// first_y <= last_y, both on the field. Memory: 64 passes beside the surface and its copies.
/// @pre the design has at least 2 x 2 nodes; the stock, if given, too
/// @return figures, but for those of the program; or one of the codes above with option, value and
///         range; the sink's error; CORE_CANCELLED
[[nodiscard]] Result<MillReport> mill_passes(const heightmap::ModelField& design,
                                             const MillOptions& options, const ToolpathSink& sink,
                                             const RunContext& run = {});

/// The same into a program, written whole or not at all.
/// @return as mill_passes; and the errors of program.hpp
[[nodiscard]] Result<MillReport> mill(const heightmap::ModelField& design,
                                      const MillOptions& options,
                                      const std::filesystem::path& program_path,
                                      const RunContext& run = {});

}  // namespace maquette::cnc

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file verify.hpp
/// Reads a program back as the machine will, cuts with it, and says how far the
/// result is from the design.
///
/// Room    cnc, last step:  G-code -> gcode_reader -> milling_sim, path_certificate -> certificate
/// Takes   any RS-274 program (see gcode_reader.hpp for the words), the design
/// Gives   certificate, predicted as-milled heights on a grid of `cell`, row by row
///
/// Cutters are swept exactly along each line and arc (closed form, no sampling along the move;
/// helices as chords within 0.1 um, which the bound contains). The stock is a height per cell
/// centre, in bands of rows; cell centres are the nodes of the as-milled field.
/// max_gouge + bound holds for the continuous surface. Balls are proven by their path alone
/// (path_certificate.hpp), so the cell does not limit what can be certified; other cutters by
/// theirs, in steps (cutter_proof.hpp), or by what a grid of cells can miss
/// (docs/derivations/verify_bound.md), whichever is less.
///
/// Full scale, 2 m x 2 m with 0.1 mm cells (4 x 10^8), roughing and finish of together 7 M blocks:
/// 180 s of processor time, proof included, 1.3 GB.

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <functional>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "cnc/compensate.hpp"
#include "cnc/engagement.hpp"
#include "cnc/machine.hpp"
#include "cnc/motion_time.hpp"
#include "cnc/path_certificate.hpp"
#include "cnc/tool.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/units.hpp"
#include "core/vec.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::cnc {

inline constexpr ErrorCode kGcodeSyntax{"CNC_GCODE_SYNTAX"};
inline constexpr ErrorCode kGcodeUnsupported{"CNC_GCODE_UNSUPPORTED"};
inline constexpr ErrorCode kGcodeTruncated{"CNC_GCODE_TRUNCATED"};
inline constexpr ErrorCode kGcodeArc{"CNC_GCODE_ARC"};
inline constexpr ErrorCode kGcodeNoFeed{"CNC_GCODE_NO_FEED"};
inline constexpr ErrorCode kGcodeNoCut{"CNC_GCODE_NO_CUT"};
inline constexpr ErrorCode kCellOutOfRange{"CNC_CELL_OUT_OF_RANGE"};
inline constexpr ErrorCode kToolNotInTable{"CNC_TOOL_NOT_IN_TABLE"};

struct VerifyOptions {
  Millimetres ball_diameter{6.0};  ///< of the one cutter, where there is no tool table
  std::vector<Tool> tools{};       ///< tool table; empty: one ball, whatever T says
  Millimetres cell{0.1};       ///< at most; see Certificate::cell_mm. At most half the least radius
  Millimetres stock_top{NAN};  ///< NaN: 1 mm above the highest point of the design
  /// What an earlier operation left, instead of a flat top; beyond it and in its voids stock_top.
  const heightmap::ModelField* stock = nullptr;
  /// Design with stones standing on it, which nothing may meet (stone_clearance.hpp).
  const heightmap::ModelField* with_stones = nullptr;
  /// Whose reach and stepover the excess is compared with, of `tools`; 0: the one that cuts last.
  int finish_tool = 0;
  Millimetres gouge_limit{0.005};  ///< deeper gouges of balls are counted and listed
  Millimetres stepover{NAN};       ///< to compare the excess with the scallop it states
  /// Its travel is compared with the tip's, and times are its own; none: length over feed.
  std::optional<Machine> machine{};
  /// Programs are cut as a machine with these errors takes the tip (machine_run.hpp): those that
  /// are written for it must then cut the design. Travel and time are those of the tip.
  std::optional<MachineErrors> errors{};
  /// If set: called with every motion in program order once all is cut, with the number of its
  /// program and the volume it removed (for a backplot).
  std::function<void(const Motion&, std::size_t program, double removed_mm3)> visit{};
};

inline constexpr double kStoneDepth_mm = 0.05;

struct Place {
  double x_mm = 0.0, y_mm = 0.0, depth_mm = 0.0;
};

/// A motion of a program, and where it ends.
struct MotionPlace {
  std::size_t program = 0;
  std::uint64_t line = 0;
  Vec3 at_mm{};
};

/// Height of ridges, normal to the surface, where the design slopes from `from` to `to`. Nodes
/// within a radius of the outline are not in it; concave places that the ball cannot reach are.
struct ScallopClass {
  double from_deg = 0.0, to_deg = 0.0;
  double area_mm2 = 0.0;  ///< in plan
  double median_mm = 0.0, p95_mm = 0.0, p99_mm = 0.0;
  double stated_mm = NAN;  ///< of the stepover, at the steeper end; across the slope
};

/// What one tool does in one program. Without a machine cutting takes length over feed, and rapids
/// nothing.
struct ToolUse {
  std::size_t program = 0;
  int number = 0;  ///< 0: none was named
  MotionTime time{};
};

struct Certificate {
  /// Deepest cut below the design that was found, >= 0: at cell centres, or anywhere on the path.
  double max_gouge_mm = 0.0;
  /// max_gouge + bound is nowhere exceeded on the continuous surface. The better of what the
  /// cells and what the path can show, where all cutters are balls.
  double bound_mm = 0.0;
  double cell_gouge_mm = 0.0, cell_bound_mm = 0.0;  ///< what the grid of cells alone shows
  /// How far the control may leave the path while it cuts, from finish_tool on (G64 P; 0: G61). All
  /// figures here are of the path as written: this comes on top. Infinite if the program does not
  /// bound it, none if it does not say.
  std::optional<double> blending_mm{};
  std::optional<PathCertificate> path{};  ///< of the balls; none if no ball cuts
  /// Highest material left above it where the ball can reach: where it touches the design and
  /// would have to rise by at most 5 um to cut nothing elsewhere (certificate.hpp). Of all nodes,
  /// those of the border too; max_excess_inside leaves out what is within a radius of the outline.
  double max_excess_mm = 0.0;
  double max_excess_inside_mm = 0.0, max_excess_border_mm = 0.0;
  /// What may stand higher than max_excess_inside between the nodes that can be reached.
  double excess_bound_mm = 0.0;
  /// Inside: largest excess minus the scallop that the stepover states for the slope; < 0 if it
  /// is nowhere reached. NaN without a stepover. Where the ball reaches with half a stepover of
  /// room around (certificate.hpp), sampled at every third node along each axis:
  double max_excess_over_scallop_mm = NAN;
  /// And wherever it reaches, beside creases and in pits too, at all nodes.
  double max_tight_over_scallop_mm = NAN;
  /// Area, in plan, that stands more than kOverScallop_mm above the stated scallop because the ball
  /// has no room, and because it does not reach at all (map_rest() in rest.hpp shows where).
  double tight_area_mm2 = 0.0, unreached_area_mm2 = 0.0;
  /// The same above what no path of the ball can better, the closing of the design by the ball:
  /// whether it touches or rests on the rims of a pit. At a quarter of those nodes; the highest is
  /// -INFINITY where none stands more than kOverScallop_mm above the stated scallop.
  double max_over_closing_mm = NAN, over_closing_area_mm2 = 0.0;
  double max_excess_anywhere_mm = 0.0;  ///< also where it cannot (concave below the radius)
  /// Of as-milled minus design, gouges negative, over all nodes.
  double mean_excess_mm = 0.0, rms_excess_mm = 0.0;
  std::vector<ScallopClass> scallops{};
  double gouged_area_mm2 = 0.0;       ///< deeper than 1 um
  std::vector<Place> worst_gouges{};  ///< at most 10, deepest first, a radius apart
  /// G0 moves that went more than 1 um into the stock as it was at that moment; they cut too.
  std::uint64_t rapid_collisions = 0;
  std::uint64_t holder_collisions = 0;        ///< moves whose holder or shank met the stock
  std::uint64_t stone_collisions = 0;         ///< moves whose cutter met a stone
  std::uint64_t stone_holder_collisions = 0;  ///< moves whose holder or shank did
  /// The first of each kind, at most 10.
  std::vector<MotionPlace> first_rapid_collisions{}, first_holder_collisions{},
      first_stone_collisions{}, first_stone_holder_collisions{};
  EngagementFigures engagement{};
  std::uint64_t blocks = 0, moves = 0;
  double cutting_length_mm = 0.0, rapid_length_mm = 0.0;
  double time_min = 0.0;  ///< of all tools, and dwells
  std::vector<ToolUse> tools{};
  Box3 travel;  ///< of the tip, cutting and rapid
  /// Axes ("x", "y", "z") along which the tip travels farther than the machine can.
  std::string beyond_travel{};
  double ball_diameter_mm = 0.0;
  double cell_mm = 0.0;  ///< the design's spacing over the smallest whole number that will do
  double stepover_mm = NAN;
  /// Largest change of a coordinate by VerifyOptions::errors; 0 without.
  double displaced_mm = 0.0;
  /// Several programs: that of their hashes, one a line.
  std::string program_sha256;
};

/// The shape of what a RowSink will get.
struct MilledShape {
  std::ptrdiff_t rows = 0, cols = 0;
  Millimetres cell{0.0}, x0{0.0}, y0{0.0};
};
/// Receives the as-milled heights, the northernmost row first, each row once.
using RowSink =
    std::function<Result<void>(const MilledShape&, std::ptrdiff_t row, std::span<const float>)>;

/// @return the certificate, or a G-code error that names file, line, column and what
///         was expected; CNC_GCODE_NO_CUT if the stock stays whole; CORE_FILE_NOT_FOUND;
///         CNC_CELL_OUT_OF_RANGE (also for more than 3 x 10^9 cells); CNC_TOOL_NOT_IN_TABLE with
///         file and line; mill.hpp's CNC_TOOL_NOT_POSITIVE and CNC_HEIGHT_NOT_FINITE; what the
///         sink returned; CORE_CANCELLED.
/// Warns of a program without an end, of tool changes without a tool table, of skipped '/' blocks.
/// Several programs (bands) are cut one after the other into the same stock. Memory: design, 40
/// bytes a move and a band of rows. Same bits for any number of threads.
[[nodiscard]] Result<Certificate> verify(std::span<const std::filesystem::path> programs,
                                         const heightmap::ModelField& design,
                                         const VerifyOptions& options, const RowSink& rows,
                                         const RunContext& run = {});

struct Verification {
  Certificate certificate;
  heightmap::ModelField as_milled;  ///< nodes `cell` apart, over the design's outline
};
/// The same, with all rows in memory.
[[nodiscard]] Result<Verification> verify(std::span<const std::filesystem::path> programs,
                                          const heightmap::ModelField& design,
                                          const VerifyOptions& options = {},
                                          const RunContext& run = {});

[[nodiscard]] std::string to_json(const Certificate& certificate);

}  // namespace maquette::cnc

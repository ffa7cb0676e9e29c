// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file verify.hpp
/// Reads a program back as the machine will, cuts with it, and says how far the
/// result is from the design.
///
/// Room    cnc, last step:  G-code -> gcode_reader -> milling_sim -> [certificate]
/// Takes   any RS-274 program (see gcode_reader.hpp for the words), the design
/// Gives   certificate, predicted as-milled ModelField on a grid of `cell`
///
/// The cutter is swept exactly along each line (closed form, no sampling along the
/// move); arcs are swept as chords that stay within 0.5 um of them, which the bound
/// contains. The stock is a height per cell centre; cell centres are the nodes of as_milled.
/// `bound` adds what a cell grid cannot see, so max_gouge + bound holds for the continuous
/// surface, but for the very edge of the outline under a ball centred outside it
/// (docs/derivations/verify_bound.md). Where the design is nearly vertical the bound is coarse.
///
/// Full scale, 2 m x 2 m with 0.1 mm cells (4 x 10^8) and 16 M blocks: 71 s of processor time,
/// 1.7 GB.

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <span>
#include <string>
#include <vector>

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

struct VerifyOptions {
  Millimetres ball_diameter{6.0};
  Millimetres cell{0.1};  ///< at most; see Certificate::cell_mm. At most half the ball's radius
  Millimetres stock_top{NAN};  ///< NaN: 1 mm above the highest point of the design
};

struct Place {
  double x_mm = 0.0, y_mm = 0.0, depth_mm = 0.0;
};

struct Certificate {
  double max_gouge_mm = 0.0;  ///< deepest cut below the design at cell centres, >= 0
  /// Highest material left above it where the ball can reach: where the design's closing by
  /// the ball on this grid lies within 5 um of the design (certificate.hpp).
  double max_excess_mm = 0.0;
  double max_excess_anywhere_mm = 0.0;  ///< also where it cannot (concave below the radius)
  double bound_mm = 0.0;                ///< what the grid of cells may have missed of the gouge
  /// Of as-milled minus design, gouges negative, over all nodes.
  double mean_excess_mm = 0.0, rms_excess_mm = 0.0;
  double gouged_area_mm2 = 0.0;     ///< deeper than 1 um
  std::vector<Place> worst_gouges;  ///< at most 10, deepest first, a radius apart
  /// G0 moves that went more than 1 um into the stock as it was at that moment; they cut too.
  std::uint64_t rapid_collisions = 0;
  std::uint64_t blocks = 0, moves = 0;
  double cutting_length_mm = 0.0, rapid_length_mm = 0.0;
  double time_min = 0.0;  ///< cutting length over feed, and dwells; rapids take no time
  Box3 travel;            ///< of the tip, cutting and rapid
  double ball_diameter_mm = 0.0;
  double cell_mm = 0.0;  ///< the design's spacing over the smallest whole number that will do
  /// Several programs: that of their hashes, one a line.
  std::string program_sha256;
};

struct Verification {
  Certificate certificate;
  heightmap::ModelField as_milled;  ///< nodes `cell` apart, over the design's outline
};

/// @return the verification, or a G-code error that names file, line, column and what
///         was expected; CNC_GCODE_NO_CUT if the stock stays whole; CORE_FILE_NOT_FOUND;
///         CNC_CELL_OUT_OF_RANGE (also for more than 3 x 10^9 cells); mill.hpp's
///         CNC_TOOL_NOT_POSITIVE and CNC_HEIGHT_NOT_FINITE; CORE_CANCELLED.
/// Warns of a program without an end, of tool changes after the first, of skipped '/' blocks.
/// Several programs (bands) are cut one after the other into the same stock.
[[nodiscard]] Result<Verification> verify(std::span<const std::filesystem::path> programs,
                                          const heightmap::ModelField& design,
                                          const VerifyOptions& options = {},
                                          const RunContext& run = {});

[[nodiscard]] std::string to_json(const Certificate& certificate);

}  // namespace maquette::cnc

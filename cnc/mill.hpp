// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file mill.hpp
/// Height field -> G-code of the finishing pass with a ball-nose cutter.
///
/// Room    cnc:  cutter location -> raster -> [mill: filter, link, write] -> verify
/// Takes   ModelField, millimetres, no voids
/// Gives   RS-274 program in the model frame; programmed z is the ball's lowest point
///
/// Path: parallel passes along x, `stepover` apart in y (first and last on the
/// outline), zig-zag or one way. Along a pass the exact cutter location of the
/// triangulated surface (facets, edges, vertices; cutter_location.hpp) is sampled
/// adaptively, so that the path between samples cuts no deeper than a certified
/// bound, then reduced to fewer blocks inside `tolerance`, one-sided where it
/// matters: gouge is bounded, not only deviation. Gouge is measured vertically.
///
/// This is the finishing pass alone: stock is expected to stand no higher above the
/// design than the cutter may take in one go. Zig-zag passes are joined along the exact
/// cutter location of the outline; nothing below the clearance plane is a rapid.
///
/// Material may stay on beside walls steeper than about 75 : 1, where the path is lifted
/// rather than cut too deep. The linuxcnc post allows blending (G64) of a twentieth of the
/// tolerance beside the written path; the machine's own deviation is not in the bounds.

#include <cmath>
#include <cstdint>
#include <filesystem>
#include <string>

#include "cnc/posts.hpp"
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
inline constexpr ErrorCode kBeyondTravel{"CNC_BEYOND_TRAVEL"};
inline constexpr ErrorCode kMillOptionOutOfRange{"CNC_MILL_OPTION_OUT_OF_RANGE"};

struct MillOptions {
  Millimetres ball_diameter{6.0};
  Millimetres stepover{0.5};
  Millimetres tolerance{0.01};  ///< gouge and deviation of the written path, all causes together
  bool zigzag = true;
  FeedRate feed{3000.0};
  FeedRate plunge_feed{600.0};
  double spindle_rpm = 18000.0;
  Millimetres clearance{5.0};     ///< rapids fly this much above the highest point of the design
  std::string post = "linuxcnc";  ///< or "grbl"
  std::string program_name = "maquette";
  int work_offset = 54;  ///< 54 .. 59
  /// Travel of the machine, 0: not checked.
  Millimetres travel_x{0.0}, travel_y{0.0}, travel_z{0.0};
  /// Only passes with y in [first_y, last_y]; NaN: the whole field. A band passes its
  /// own range and a field widened by the cutter's radius.
  double first_y_mm = NAN, last_y_mm = NAN;
};

struct MillReport {
  std::uint64_t passes = 0, points_sampled = 0, blocks = 0, bytes = 0;
  double path_length_mm = 0.0;      ///< at cutting feed
  double cutting_time_min = 0.0;    ///< length over feed; no acceleration yet
  double scallop_flat_mm = 0.0;     ///< R - sqrt(R^2 - (stepover / 2)^2)
  double certified_gouge_mm = 0.0;  ///< bound on how deep the written path cuts, rounding included
  double lowest_tip_mm = 0.0, highest_tip_mm = 0.0;
};

/// Writes the program whole or not at all; same design and options, same bytes, for any
/// number of threads. Ranges: diameter > 0; stepover in (0, diameter]; tolerance in
/// [0.001, 1] mm; feeds and spindle > 0, finite; clearance >= 0; work offset 54 .. 59;
/// first_y <= last_y, both on the field.
/// @pre the design has at least 2 x 2 nodes
/// @return figures, or one of the codes above with option, value and range;
///         CNC_BEYOND_TRAVEL with the axis and both lengths; CORE_DISK_FULL; CORE_CANCELLED
[[nodiscard]] Result<MillReport> mill(const heightmap::ModelField& design,
                                      const MillOptions& options,
                                      const std::filesystem::path& program_path,
                                      const RunContext& run = {});

}  // namespace maquette::cnc

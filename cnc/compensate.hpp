// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file compensate.hpp
/// A program rewritten so that a machine with known errors cuts what the program meant.
///
/// Takes   any flat program (lines, arcs, rapids in G90 G21), the errors of machine and tool
/// Gives   the same program with other coordinates: comments, feeds, speeds, tool changes stay
///
/// Errors. Called to p, the tip stands at p + d(p): scale and squareness about a place where the
/// axes are right, straightness by tables, a length off by a constant; and behind by half the
/// backlash on the side it comes from (ISO 230-1, ISO 230-2). The program then calls
/// p' = p - d(p'), two fixed-point steps (d changes by less than 1 % of itself over d), and takes
/// the slack up by a move of its own wherever an axis turns back. Errors that depend on time or
/// chance are not mapped.
/// A ball of another radius is called to where it touches the design: higher by the difference of
/// both drop-cutter heights (cutter_location.hpp).
/// A part that stands elsewhere than planned is cut where it stands: the middle of the cutter's
/// corner goes through the rigid transform, which is exact for balls at any tilt. The axis stays
/// upright: under a tilt of t a cutter of radius R and corner r leaves floors (R - r) t wrong.
/// Lines are split until the rewritten path is within kMapping_mm of what is meant; arcs become
/// lines.
/// Cost: 2 M lines a second; with a radius some 10 us a line more.

#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "cnc/tool.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/vec.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::cnc {

/// A program that cannot be rewritten line by line: loops, moves in G91, G20, shifted coordinates.
inline constexpr ErrorCode kNotFlat{"CNC_NOT_FLAT"};

inline constexpr double kMapping_mm = 0.001;

struct MachineErrors {
  Vec3 exact_at_mm;                 ///< where scale and squareness displace nothing
  Vec3 scale_um_per_m;              ///< > 0: travels too far
  double squareness_xy_urad = 0.0;  ///< x goes along with y
  double squareness_xz_urad = 0.0, squareness_yz_urad = 0.0;  ///< x and y go along with z
  /// The other three, where axes were measured in a frame that is not theirs: y goes along with x,
  /// z with x, z with y.
  double squareness_yx_urad = 0.0, squareness_zx_urad = 0.0, squareness_zy_urad = 0.0;
  Vec3 backlash_mm;  ///< width
  struct Straightness {
    int along = 0, moves = 2;                   ///< axes 0, 1, 2
    std::vector<double> position_mm, error_mm;  ///< between them linear, beyond them constant
  };
  std::vector<Straightness> straightness;
  double length_offset_mm = 0.0;     ///< the tip stands that much higher than called
  double radius_error_mm = 0.0;      ///< the ball is that much larger, its tip touched off
  int tool = 0;                      ///< whose length and radius these are; 0: of every tool
  RigidTransform machine_from_part;  ///< where the part stands, in the frame programs are in

  [[nodiscard]] bool tool_counts(int number) const { return tool == 0 || number == tool; }
  /// Where the tip of that tool stands beside where it is called to; without backlash.
  [[nodiscard]] Vec3 at(Vec3 called_mm, int number = 0) const;
};

struct CompensateOptions {
  /// What a ball of another radius may not cut into; nullptr where the radius is right.
  const heightmap::ModelField* design = nullptr;
  double ball_radius_mm = 3.0;  ///< as programmed, of the tool whose radius is off
  /// Corners of the cutters, for parts that stand tilted; empty: balls of that radius.
  std::vector<Tool> tools{};
  /// Comments before the first block, and after them how far the path is moved at most.
  std::vector<std::string> head{};
  std::vector<std::uint64_t> marks{};  ///< lines of the program, ascending
};

struct CompensateFigures {
  std::uint64_t moves = 0;             ///< rewritten
  std::uint64_t lines = 0;             ///< that they became
  std::uint64_t take_ups = 0;          ///< moves that take up slack
  double largest_mm = 0.0;             ///< change of a coordinate
  std::vector<std::uint64_t> marks{};  ///< lines written when those of the options had been
};

/// @return figures; CNC_NOT_FLAT with file and line; errors of the reader and of files.
///   Without an error `out` has appeared at once.
[[nodiscard]] Result<CompensateFigures> compensate(const std::filesystem::path& program,
                                                   const MachineErrors& errors,
                                                   const CompensateOptions& options,
                                                   const std::filesystem::path& out,
                                                   const RunContext& run = {});

}  // namespace maquette::cnc

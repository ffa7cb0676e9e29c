// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file milling.hpp
/// Design -> program, by one of the strategies of the room cnc. One table says what there is
/// (strategies.cpp); the command `mill` and the stages of `run` take their defaults from it.
///
/// Every program is written beside its place first, read back as the machine will read it, timed,
/// and checked against the machine's travel; balls are proven against what they must not cut. An
/// error leaves nothing behind. A program whose proof exceeds its tolerance is left as
/// <name>.rejected, and is a bound that is not met.

#include <cmath>
#include <filesystem>
#include <optional>
#include <span>
#include <string>

#include "cnc/feeds.hpp"
#include "cnc/machine.hpp"
#include "cnc/program.hpp"
#include "cnc/tool.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/units.hpp"
#include "meshing/bands.hpp"
#include "tools/adjustment.hpp"
#include "tools/pipeline.hpp"

namespace maquette::tools {

class JoinedProgram;

struct MillJob {
  std::string strategy;
  std::string name;  ///< of the operation, for a person; unique in a program of several
  std::filesystem::path design;
  /// What an earlier operation left (<program>.stock.tif, as_milled.tif): rapids then stay low
  /// over it, and roughing takes off only what is still there.
  std::optional<std::filesystem::path> stock;
  std::optional<std::filesystem::path> stones;  ///< seats and outlines are theirs
  /// These stand already: a program that meets them, with cutter, shank or holder, is rejected.
  std::optional<std::filesystem::path> standing_stones;
  std::optional<std::filesystem::path> spheres;  ///< sphere_file.hpp: seats and probing are theirs

  cnc::Tool tool;             ///< of a probe: the ball's radius
  double stepover_mm = 0.5;   ///< between passes, in plan
  double step_down_mm = 5.0;  ///< rough: between levels; waterline too; rest, seats: in one go
  /// What rough and semi-finish leave; elsewhere: what stands above the design at most, where no
  /// stock says it (NaN: not known).
  double allowance_mm = NAN;
  Millimetres tolerance{0.01};  ///< of finishing paths, all causes together
  /// 0: from the chip that the material stands, as the machine can do it; without a material
  /// 3000 and 600 mm/min, 18000 1/min.
  FeedRate feed{0.0}, plunge_feed{0.0};
  double spindle_rpm = 0.0;
  std::optional<cnc::Material> material;
  bool feed_given = false;  ///< set by mill_job
  Millimetres clearance{5.0};
  cnc::ProgramOptions program{};     ///< post, name, work offset, splitting; the rest is set here
  Millimetres base_thickness{10.0};  ///< from the table to the design's lowest point
  cnc::Machine machine = *cnc::find_machine("unlimited");

  // raster and semi-finish, mill.hpp; arcs also rest; the limit also geodesic
  Radians direction{0.0};
  bool zigzag = true, climb = true, arcs = true, constant_scallop = false;
  Millimetres scallop_limit{0.011}, lead_radius{1.0};
  Millimetres excess_limit{NAN};  ///< raster: above the stated scallop; NaN: none
  /// raster: the passes whose scallop is stated, NaN: the stepover; needs an excess limit
  Millimetres stated_stepover{NAN};
  Millimetres overrun{NAN};  ///< raster: beyond the outline; NaN: as the ground there wants it

  // rough
  double cell_mm = 1.0, ramp_deg = 3.0;
  Millimetres stock_top{NAN};  ///< of the block; NaN: `stock_margin` above the highest point
  Millimetres stock_margin{1.0};

  double least_slope_deg = 55.0;       ///< waterline
  double ball_before_diameter_mm = 6;  ///< rest: of the ball whose rest it takes
  double gap_mm = 1.5, bed_mm = 0.2;   ///< seats: around a stone, and under it
  double mark_depth_mm = 0.3;          ///< outlines

  /// The program is written for a machine with these errors, beside it the one that is meant
  /// (meant_of()): that one is proven against the design, the other by the path that the machine
  /// makes of it. Needs G90 and a control that reads RS-274.
  std::optional<Adjustment> adjust;

  bool leave_stock = true;          ///< <program>.stock.tif is written
  JoinedProgram* joined = nullptr;  ///< set by mill_operations_job

  std::size_t band = 0;                     ///< index, of as many as `bands` makes
  std::optional<meshing::BandSplit> bands;  ///< none: the whole surface
};

struct Strategy {
  std::string_view name;
  std::string_view does;  ///< for a person, one line
  bool in_bands;          ///< can mill one band beside others that still stand
  bool cuts;              ///< the part: it may be one of several operations
  int tool;               ///< T, unless another is asked for
  cnc::Cutter cutter;
  double stepover_mm, step_down_mm, allowance_mm;  ///< NaN: not used, or not known
  /// Makes the program; the job's strategy is this one.
  Result<JobResult> (*make)(const MillJob&, const std::filesystem::path& out, const RunContext&);
};
[[nodiscard]] std::span<const Strategy> strategies();
/// @pre one of strategies()
[[nodiscard]] const Strategy& strategy_of(std::string_view name);
[[nodiscard]] MillJob default_job(std::string_view strategy);

/// The program, or its parts where it is split. Beside it, where a next operation wants it,
/// <program>.stock.tif: what this one leaves of `stock` (those that go over
/// the whole surface: else of a block with its margin); of passes <program>.scallop.tif: the
/// predicted height of ridges. @return errors of the strategy; CNC_BEYOND_TRAVEL,
/// CNC_TOOL_TOO_LONG; TOOLS_CONFIG_INVALID for an adjustment that the program cannot have;
/// CNC_FEED_OUT_OF_RANGE and CNC_SPINDLE_OUT_OF_RANGE for more than the machine
/// can do
[[nodiscard]] Result<JobResult> mill_job(const MillJob& job, const std::filesystem::path& out,
                                         const RunContext& run);

/// What the program of `probe-spheres` has had written, as [[datum]] tables of a case file; figures
/// say how far each sphere is off its plan. @return errors of sphere_file.hpp, probed_spheres.hpp
[[nodiscard]] Result<JobResult> probed_spheres_job(const std::filesystem::path& contacts,
                                                   const std::filesystem::path& spheres,
                                                   double probe_radius_mm,
                                                   const std::filesystem::path& out);

/// What programs of several bands leave together, at the design's nodes, of a model field or of a
/// block that ends `margin` above the highest point. @return as cnc::stock_after()
[[nodiscard]] Result<JobResult> stock_job(std::span<const std::filesystem::path> programs,
                                          std::span<const cnc::Tool> tools,
                                          const std::filesystem::path& design,
                                          const std::optional<std::filesystem::path>& stock,
                                          Millimetres margin, const std::filesystem::path& out,
                                          const RunContext& run);

/// Seats, outlines and bores: what they take away is not of the design.
[[nodiscard]] bool cuts_into_design(const MillJob& job);
/// The design with what those of `jobs` take out of it, on its own nodes: what all operations
/// together may leave at the least. Seats are as their programs are proven; a mark is its depth, a
/// bore its floor over all facets that it touches. @return errors of the strategies' files
[[nodiscard]] Result<JobResult> machined_job(std::span<const MillJob> jobs,
                                             const std::filesystem::path& design,
                                             const std::filesystem::path& out);

/// One program of several operations, with a tool change where the next one has another tool. Each
/// cuts what the one before has left, and is timed and proven by its own lines of the program.
/// Post, name, work offset and splitting are those of the first job. Beside the program: what each
/// operation leaves and the ridges it predicts (<program>.<operation>.stock.tif, .scallop.tif),
/// what is to be left where one cuts into the design (<program>.machined.tif), and the tools for
/// verify (<program>.tools.toml). @pre at least one job; names and tools as jobs_of()
/// (operations.hpp) gives them. @return as mill_job()
[[nodiscard]] Result<JobResult> mill_operations_job(std::span<const MillJob> jobs,
                                                    const std::filesystem::path& out,
                                                    const RunContext& run);

/// part.ngc, part_2.ngc, part_3.ngc ... as far as they are there.
[[nodiscard]] std::vector<std::filesystem::path> parts_of(const std::filesystem::path& program);

}  // namespace maquette::tools

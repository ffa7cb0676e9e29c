// SPDX-License-Identifier: GPL-3.0-or-later

// What a smaller ball does after the finish: where the larger one did not fit, and for the stones.

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "cnc/engrave.hpp"
#include "cnc/mill.hpp"
#include "cnc/rest.hpp"
#include "meshing/stones.hpp"
#include "tools/milling/mill_program.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
using nlohmann::json;
namespace {

cnc::RestOptions rest_options(const MillJob& job) {
  cnc::RestOptions o;
  o.ball_radius_mm = job.tool.cutter.radius_mm;
  o.stepover_mm = job.stepover_mm;
  o.depth_mm = job.step_down_mm;
  o.tolerance_mm = job.tolerance.value();
  o.arcs = job.arcs;
  o.feed_mm_min = job.feed.value();
  o.plunge_feed_mm_min = job.plunge_feed.value();
  o.clearance_mm = job.clearance.value();
  return o;
}

/// It cuts full width, as deep as it may.
void takes_layers(const MillJob& job, Piece& piece) {
  piece.depth.reset();
  piece.deepest_mm = std::max(job.step_down_mm, job.tool.cutter.radius_mm);
}

/// Nothing is to be done where a neighbouring band will do it.
void keep_band(const Piece& piece, cnc::RestMap& map) {
  if (std::isnan(piece.first_y_mm)) return;
  heightmap::ModelField& field = map.remaining;
  const double cell = field.spacing.value() * field.spacing.value();
  map.area_mm2 = map.volume_mm3 = map.highest_mm = 0.0;
  for (std::ptrdiff_t r = 0; r < field.z_mm.rows(); ++r) {
    const double y = field.y_mm(r);
    const bool inside = y >= piece.first_y_mm && y <= piece.last_y_mm;
    for (float& left : field.z_mm.row(r)) {
      if (!inside) left = 0.0F;
      map.highest_mm = std::max(map.highest_mm, static_cast<double>(left));
      if (static_cast<double>(left) <= map.threshold_mm) continue;
      map.area_mm2 += cell;
      map.volume_mm3 += cell * static_cast<double>(left);
    }
  }
}

/// The passes that take away what the map shows above `surface`.
Result<JobResult> take_away(const MillJob& job, const Piece& piece,
                            const heightmap::ModelField& surface, const cnc::RestMap& map,
                            const std::string& what, const fs::path& out, const RunContext& run) {
  const cnc::ToleranceShares shares = cnc::share_tolerance(job.tolerance);
  MAQUETTE_TRY(
      auto program,
      MillProgram::begin(
          job, piece, out, piece.top_mm, Millimetres{shares.blending_mm},
          {"frame of the model, x east, y north, z up", what, cnc::head_line(shares),
           fmt::format("{:.1f} mm2, up to {:.2f} mm high", map.area_mm2, map.highest_mm)}));
  MAQUETTE_TRY(const auto report,
               cnc::rest_finish(
                   surface, map, rest_options(job),
                   [&](const cnc::Toolpath& path) { return program.add(path); }, run));
  MAQUETTE_TRY(auto result,
               program.finish(Proof{surface, job.tool.cutter.radius_mm, shares.gouge_mm, 0.0},
                              {{"passes", report.passes},
                               {"layers", report.layers},
                               {"area_mm2", map.area_mm2},
                               {"volume_mm3", map.volume_mm3},
                               {"highest_mm", map.highest_mm},
                               {"certified_gouge_mm", report.certified_gouge_mm}},
                              run));
  result.note += fmt::format(", {:.0f} mm2", map.area_mm2);
  return result;
}

}  // namespace

Result<std::vector<cnc::Seat>> seats_of(const MillJob& job, const heightmap::ModelField& design) {
  if (!job.stones)
    return fail(cnc::kEngraveOptionOutOfRange,
                fmt::format("{}: no stones are given; expected the stones.json that `maquette "
                            "stones` writes",
                            job.strategy));
  if (!(job.gap_mm >= 0.0 && job.gap_mm <= 100.0 && job.bed_mm >= 0.0 && job.bed_mm <= 100.0))
    return fail(
        cnc::kEngraveOptionOutOfRange,
        fmt::format("gap is {} mm, bed {} mm; both must be from 0 to 100", job.gap_mm, job.bed_mm));
  MAQUETTE_TRY(const auto stones, meshing::read_stone_plan(*job.stones));
  return cnc::stone_seats(design, stones, job.gap_mm, job.bed_mm);
}

Result<JobResult> rest_job(const MillJob& job, const fs::path& out, const RunContext& run) {
  const double before = 0.5 * job.ball_before_diameter_mm, radius = job.tool.cutter.radius_mm;
  if (!(before > radius))
    return fail(
        cnc::kRestOptionOutOfRange,
        fmt::format("the ball before has {} mm, this one {} mm diameter; it must be smaller",
                    2.0 * before, 2.0 * radius));
  // What the ball before leaves depends on what it feels.
  MAQUETTE_TRY(Piece piece, piece_of(job, 4.0 * before));
  takes_layers(job, piece);
  MAQUETTE_TRY(cnc::RestMap map, cnc::map_rest(piece.design, {before}, Millimetres{0.05}, run));
  keep_band(piece, map);
  return take_away(job, piece, piece.design, map,
                   fmt::format("rest finish, what a ball of {} mm left", 2.0 * before), out, run);
}

Result<JobResult> seats_job(const MillJob& job, const fs::path& out, const RunContext& run) {
  MAQUETTE_TRY(Piece piece, piece_of(job, 4.0 * job.tool.cutter.radius_mm));
  takes_layers(job, piece);
  MAQUETTE_TRY(const auto seats, seats_of(job, piece.design));
  const heightmap::ModelField seated = cnc::with_seats(piece.design, seats);
  cnc::RestMap map = cnc::seat_map(piece.design, seated);
  keep_band(piece, map);
  return take_away(job, piece, seated, map, fmt::format("seats of {} stones", seats.size()), out,
                   run);
}

Result<JobResult> outlines_job(const MillJob& job, const fs::path& out, const RunContext& run) {
  const double radius = job.tool.cutter.radius_mm;
  MAQUETTE_TRY(const Piece piece, piece_of(job, 4.0 * radius));
  MAQUETTE_TRY(auto seats, seats_of(job, piece.design));
  if (!std::isnan(piece.first_y_mm))  // of those in this band
    std::erase_if(seats, [&](const cnc::Seat& seat) {
      double y = 0.0;
      for (const auto& corner : seat.border_mm) y += corner[1];
      y /= static_cast<double>(seat.border_mm.size());
      return !(y >= piece.first_y_mm && y < piece.last_y_mm);
    });
  cnc::EngraveOptions options;
  options.ball_radius_mm = radius;
  options.depth_mm = job.mark_depth_mm;
  options.feed_mm_min = job.feed.value();
  options.plunge_feed_mm_min = job.plunge_feed.value();
  options.clearance_mm = job.clearance.value();
  MAQUETTE_TRY(const auto path, cnc::engrave_outlines(piece.design, seats, options));
  const cnc::ToleranceShares shares = cnc::share_tolerance(job.tolerance);
  MAQUETTE_TRY(auto program,
               MillProgram::begin(job, piece, out, piece.top_mm, Millimetres{shares.blending_mm},
                                  {"frame of the model, x east, y north, z up",
                                   fmt::format("outlines of {} stones, {} mm deep", seats.size(),
                                               job.mark_depth_mm)}));
  if (!path.moves.empty()) MAQUETTE_TRY_VOID(program.add(path));
  return program.finish(Proof{piece.design, radius, job.mark_depth_mm + shares.gouge_mm, 0.0},
                        {{"passes", seats.size()}, {"depth_mm", job.mark_depth_mm}}, run);
}

}  // namespace maquette::tools

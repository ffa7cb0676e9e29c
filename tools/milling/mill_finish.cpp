// SPDX-License-Identifier: GPL-3.0-or-later
#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "cnc/geodesic_passes.hpp"
#include "cnc/mill.hpp"
#include "cnc/semi_finish.hpp"
#include "cnc/waterline.hpp"
#include "heightmap/field_io.hpp"
#include "tools/milling/mill_program.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
using nlohmann::json;
namespace {

constexpr double kPathShare = 0.6;  // of the work; the proof takes the rest

RunContext milling(const RunContext& run) {
  RunContext context = run;
  context.progress = [&run](double share) { run.progress(kPathShare * share); };
  return context;
}

std::vector<std::string> head(const Piece& piece, const MillJob& job, const std::string& what) {
  const heightmap::ModelField& d = piece.design;
  const auto range = heightmap::height_range(d.z_mm);
  return {"frame of the model, x east, y north, z up", what,
          cnc::head_line(cnc::share_tolerance(job.tolerance)),
          fmt::format("design x {} .. {} y {} .. {} z {} .. {} mm, nodes {} mm apart", d.x0.value(),
                      d.x_mm(d.z_mm.cols() - 1), d.y0.value(), d.y_mm(d.z_mm.rows() - 1), range.min,
                      range.max, d.spacing.value())};
}

cnc::MillOptions mill_options(const MillJob& job, const Piece& piece) {
  cnc::MillOptions o;
  o.ball_diameter = Millimetres{2.0 * job.tool.cutter.radius_mm};
  o.stepover = Millimetres{job.stepover_mm};
  o.tolerance = job.tolerance;
  o.direction = job.direction;
  o.zigzag = job.zigzag;
  o.climb = job.climb;
  o.arcs = job.arcs;
  o.constant_scallop = job.constant_scallop;
  o.scallop_limit = job.scallop_limit;
  o.excess_limit = job.excess_limit;
  o.stated_stepover = job.stated_stepover;
  o.lead_radius = job.lead_radius;
  o.feed = job.feed;
  o.plunge_feed = job.plunge_feed;
  o.clearance = job.clearance;
  o.first_y_mm = piece.first_y_mm;
  o.last_y_mm = piece.last_y_mm;
  if (piece.stock) o.stock = &*piece.stock;
  return o;
}

json figures_of(const cnc::MillReport& r, const MillJob& job) {
  return {{"passes", r.passes},
          {"extra_passes", r.extra_passes},
          {"side_cuts", r.side_cuts},
          {"direction_deg", r.direction_deg},
          {"points_sampled", r.points_sampled},
          {"scallop_flat_mm", r.scallop_flat_mm},
          {"scallop_highest_mm", r.scallop.highest_mm},
          {"scallop_mean_mm", r.scallop.mean_mm},
          {"scallop_limit_mm", job.scallop_limit.value()},
          {"share_above_scallop_limit", r.scallop.share_above_limit},
          {"certified_gouge_mm", r.certified_gouge_mm},
          {"certified_excess_mm", r.certified_excess_mm}};
}

Result<void> write_scallop(const cnc::ScallopMap& map, const fs::path& out, JobResult& result) {
  result.outputs.push_back(beside(out, "scallop"));
  return heightmap::write_model_field(map.predicted_mm, result.outputs.back());
}

}  // namespace

Result<JobResult> raster_job(const MillJob& job, const fs::path& out, const RunContext& run) {
  const double radius = job.tool.cutter.radius_mm;
  MAQUETTE_TRY(const Piece piece, piece_of(job, 2.0 * radius));
  cnc::MillOptions options = mill_options(job, piece);
  options.stock_allowance = Millimetres{job.allowance_mm};
  options.overrun = std::isnan(job.overrun.value())
                        ? cnc::border_overrun(piece.design, cnc::BallNose{radius})
                        : job.overrun;
  MAQUETTE_TRY_VOID(cnc::check_mill(piece.design, options));
  const cnc::ToleranceShares shares = cnc::share_tolerance(job.tolerance);
  MAQUETTE_TRY(
      auto program,
      MillProgram::begin(
          job, piece, out, piece.top_mm + (std::isnan(job.allowance_mm) ? 0.0 : job.allowance_mm),
          Millimetres{shares.blending_mm},
          head(piece, job,
               fmt::format("finishing, stepover {} mm, scallop on flat ground {:.4f} mm",
                           job.stepover_mm, cnc::scallop_mm({radius}, job.stepover_mm)))));
  MAQUETTE_TRY(const auto report,
               cnc::mill_passes(
                   piece.design, options,
                   [&](const cnc::Toolpath& path) { return program.add(path); }, milling(run)));
  MAQUETTE_TRY(auto result, program.finish(Proof{piece.design, radius, shares.gouge_mm, 0.0},
                                           figures_of(report, job), run));
  MAQUETTE_TRY_VOID(write_scallop(report.scallop, out, result));
  return result;
}

Result<JobResult> semi_finish_job(const MillJob& job, const fs::path& out, const RunContext& run) {
  const double radius = job.tool.cutter.radius_mm;
  MAQUETTE_TRY(const Piece piece, piece_of(job, 2.0 * (radius + job.allowance_mm)));
  cnc::MillOptions options = mill_options(job, piece);
  options.excess_limit = options.stated_stepover = Millimetres{NAN};  // of the finish
  MAQUETTE_TRY_VOID(cnc::check_mill(piece.design, options));
  const cnc::ToleranceShares shares = cnc::share_tolerance(job.tolerance);
  MAQUETTE_TRY(
      auto program,
      MillProgram::begin(
          job, piece, out, piece.top_mm + job.allowance_mm, Millimetres{shares.blending_mm},
          head(piece, job, fmt::format("semi-finish, leaves {} mm in space", job.allowance_mm))));
  MAQUETTE_TRY(const auto report,
               cnc::semi_finish(
                   piece.design, options, Millimetres{job.allowance_mm},
                   [&](const cnc::Toolpath& path) { return program.add(path); }, milling(run)));
  const double raised = std::ceil(job.allowance_mm * 1000.0 - 1e-6) / 1000.0;  // to what is written
  json figures = figures_of(report, job);
  figures["allowance_mm"] = job.allowance_mm;
  return program.finish(Proof{piece.design, radius + raised, shares.gouge_mm, raised},
                        std::move(figures), run);
}

Result<JobResult> geodesic_job(const MillJob& job, const fs::path& out, const RunContext& run) {
  const double radius = job.tool.cutter.radius_mm;
  MAQUETTE_TRY(const Piece piece, piece_of(job, 0.0));
  cnc::GeodesicPassOptions options;
  options.ball_diameter = Millimetres{2.0 * radius};
  options.stepover = Millimetres{job.stepover_mm};
  if (job.constant_scallop) options.scallop_limit = job.scallop_limit;
  options.tolerance = job.tolerance;
  options.feed = job.feed;
  options.plunge_feed = job.plunge_feed;
  options.clearance = job.clearance;
  // It knows the stock as a height over the design only.
  double allowance = job.allowance_mm;
  if (piece.stock) allowance = piece.top_mm - heightmap::height_range(piece.design.z_mm).min;
  options.stock_allowance = Millimetres{allowance};
  const cnc::ToleranceShares shares = cnc::share_tolerance(job.tolerance);
  MAQUETTE_TRY(
      auto program,
      MillProgram::begin(job, piece, out, piece.top_mm + (std::isnan(allowance) ? 0.0 : allowance),
                         Millimetres{shares.blending_mm},
                         head(piece, job,
                              fmt::format("finishing along curves {} mm apart on the "
                                          "surface",
                                          job.stepover_mm))));
  MAQUETTE_TRY(const auto report,
               cnc::geodesic_passes(
                   piece.design, options,
                   [&](const cnc::Toolpath& path) { return program.add(path); }, milling(run)));
  MAQUETTE_TRY(auto result, program.finish(Proof{piece.design, radius, shares.gouge_mm, 0.0},
                                           {{"passes", report.pieces},
                                            {"curves", report.curves},
                                            {"strokes", report.strokes},
                                            {"points_sampled", report.points_sampled},
                                            {"stepover_mm", report.stepover_mm},
                                            {"scallop_flat_mm", report.scallop_flat_mm},
                                            {"scallop_highest_mm", report.scallop.highest_mm},
                                            {"scallop_mean_mm", report.scallop.mean_mm},
                                            {"certified_gouge_mm", report.certified_gouge_mm},
                                            {"certified_excess_mm", report.certified_excess_mm}},
                                           run));
  MAQUETTE_TRY_VOID(write_scallop(report.scallop, out, result));
  return result;
}

Result<JobResult> waterline_job(const MillJob& job, const fs::path& out, const RunContext& run) {
  const double radius = job.tool.cutter.radius_mm;
  MAQUETTE_TRY(const Piece piece, piece_of(job, 0.0));
  const cnc::ToleranceShares shares = cnc::share_tolerance(job.tolerance);
  cnc::WaterlineOptions options;
  options.ball_radius_mm = radius;
  options.step_mm = job.step_down_mm;
  options.least_slope_deg = job.least_slope_deg;
  options.tolerance_mm = shares.sampling_mm;
  options.feed_mm_min = job.feed.value();
  options.plunge_feed_mm_min = job.plunge_feed.value();
  options.clearance_mm = job.clearance.value();
  if (piece.stock) options.stock = &*piece.stock;
  MAQUETTE_TRY(auto program,
               MillProgram::begin(job, piece, out, piece.top_mm, Millimetres{shares.blending_mm},
                                  head(piece, job,
                                       fmt::format("levels {} mm apart where it is steeper than "
                                                   "{} degrees",
                                                   job.step_down_mm, job.least_slope_deg))));
  MAQUETTE_TRY(const auto report,
               cnc::waterline(
                   piece.design, options,
                   [&](const cnc::Toolpath& path) { return program.add(path); }, milling(run)));
  return program.finish(Proof{piece.design, radius, shares.gouge_mm, 0.0},
                        {{"passes", report.contours},
                         {"levels", report.levels},
                         {"certified_gouge_mm", report.certified_gouge_mm},
                         {"certified_normal_gouge_mm", report.certified_normal_gouge_mm}},
                        run);
}

}  // namespace maquette::tools

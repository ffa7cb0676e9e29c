// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "cnc/gcode_reader.hpp"
#include "cnc/path_certificate.hpp"
#include "cnc/program.hpp"
#include "cnc/stock_grid.hpp"
#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/bands.hpp"
#include "tools/jobs.hpp"

namespace maquette::tools {
using nlohmann::json;
namespace {

/// Where programs wait for their proof. What is left in it when it goes is nobody's.
class Waiting {
 public:
  static Result<Waiting> beside(const fs::path& out) {
    Waiting waiting;
    waiting.folder_ = out.parent_path() / fmt::format(".{}.partial-unproven", out.stem().string());
    std::error_code ec;
    fs::remove_all(waiting.folder_, ec);
    fs::create_directories(waiting.folder_, ec);
    if (ec) return tl::unexpected(write_error(out, ec.value()));
    return waiting;
  }
  Waiting(Waiting&& other) noexcept : folder_(std::exchange(other.folder_, {})) {}
  Waiting& operator=(Waiting&&) = delete;
  ~Waiting() {
    std::error_code ec;
    if (!folder_.empty()) fs::remove_all(folder_, ec);
  }
  [[nodiscard]] fs::path file(const fs::path& out) const { return folder_ / out.filename(); }

 private:
  Waiting() = default;
  fs::path folder_;
};

/// Moves the parts beside `out`, as they are called or with `ending` behind it.
Result<std::vector<fs::path>> put_in_place(const std::vector<fs::path>& parts, const fs::path& out,
                                           const std::string& ending) {
  std::vector<fs::path> placed;
  for (const fs::path& part : parts) {
    placed.push_back(out.parent_path() / part.filename());
    placed.back() += ending;
    std::error_code ec;
    fs::rename(part, placed.back(), ec);
    if (ec) return tl::unexpected(write_error(placed.back(), ec.value()));
  }
  return placed;
}

Result<cnc::PathCertificate> prove(const std::vector<fs::path>& parts,
                                   const heightmap::ModelField& design, double ball_radius_mm,
                                   double limit_mm, const RunContext& run) {
  cnc::PathProof proof(design, {ball_radius_mm}, {.limit_mm = limit_mm});
  for (const fs::path& part : parts)
    MAQUETTE_TRY_VOID(cnc::read_gcode(
        part,
        [&](std::span<const cnc::Motion> motions) -> Result<void> {
          proof.add(motions);
          return {};
        },
        run));
  return proof.finish();
}

json places_of(const cnc::PathCertificate& proof) {
  json places = json::array();
  for (std::size_t i = 0; i < std::min<std::size_t>(proof.places.size(), 10); ++i)
    places.push_back({{"x_mm", proof.places[i].x_mm},
                      {"y_mm", proof.places[i].y_mm},
                      {"depth_mm", proof.places[i].depth_mm},
                      {"line", proof.places[i].line}});
  return places;
}

/// <program>.<what>.tif
fs::path beside(const fs::path& program, const std::string& what) {
  return program.parent_path() / fmt::format("{}.{}.tif", program.stem().string(), what);
}

Result<JobResult> raster_job(const MillJob& job, const heightmap::ModelField& design,
                             cnc::MillOptions options, const fs::path& out, const RunContext& run) {
  heightmap::ModelField stock;
  if (job.stock) {
    MAQUETTE_TRY(stock, heightmap::read_model_field(*job.stock));
    options.stock = &stock;
  }
  MAQUETTE_TRY(const Waiting waiting, Waiting::beside(out));
  // The proof takes about as long as the path.
  RunContext milling = run;
  milling.progress = [&run](double share) { run.progress(0.6 * share); };
  MAQUETTE_TRY(const auto report, cnc::mill(design, options, waiting.file(out), milling));
  const double limit = cnc::share_tolerance(options.tolerance).gouge_mm;
  MAQUETTE_TRY(const auto proof,
               prove(report.files, design, 0.5 * options.ball_diameter.value(), limit, run));
  const bool proven = proof.proven_mm <= limit;
  JobResult result;
  MAQUETTE_TRY(result.outputs, put_in_place(report.files, out, proven ? "" : ".rejected"));
  if (!proven)
    result.unmet = fmt::format(
        "{}: may cut {:.4f} mm below the design, more than the {:.4f} mm that the tolerance of {} "
        "mm leaves for it; kept as {} for inspection",
        out.string(), proof.proven_mm, limit, options.tolerance.value(),
        result.outputs.front().string());
  result.outputs.push_back(beside(out, "scallop"));
  MAQUETTE_TRY_VOID(
      heightmap::write_model_field(report.scallop.predicted_mm, result.outputs.back()));
  result.figures_json = json{{"strategy", job.strategy},
                             {"passes", report.passes},
                             {"extra_passes", report.extra_passes},
                             {"direction_deg", report.direction_deg},
                             {"points_sampled", report.points_sampled},
                             {"lines", report.lines},
                             {"arcs", report.arcs},
                             {"blocks", report.blocks},
                             {"bytes", report.bytes},
                             {"path_length_mm", report.path_length_mm},
                             {"rapid_length_mm", report.rapid_length_mm},
                             {"cutting_time_min", report.cutting_time_min},
                             {"shortest_move_mm", report.shortest_move_mm},
                             {"highest_block_rate_per_s", report.highest_block_rate_per_s},
                             {"scallop_flat_mm", report.scallop_flat_mm},
                             {"scallop_highest_mm", report.scallop.highest_mm},
                             {"scallop_mean_mm", report.scallop.mean_mm},
                             {"scallop_limit_mm", options.scallop_limit.value()},
                             {"share_above_scallop_limit", report.scallop.share_above_limit},
                             {"certified_gouge_mm", report.certified_gouge_mm},
                             {"certified_excess_mm", report.certified_excess_mm},
                             {"proven_gouge_mm", proof.proven_mm},
                             {"gouges", places_of(proof)},
                             {"lowest_tip_mm", report.lowest_tip_mm},
                             {"highest_tip_mm", report.highest_tip_mm}}
                            .dump();
  result.note = fmt::format("{} blocks, {:.1f} m, gouge proven below {:.1f} um", report.blocks,
                            report.path_length_mm / 1000.0, 1e3 * proof.proven_mm);
  return result;
}

/// Length of the path's box along each axis.
Result<void> check_travel(const cnc::Toolpath& path, const cnc::MillOptions& o) {
  Box3 box;
  const auto add = [&](const cnc::ToolPosition& p) {
    box.add({cnc::mm_of_ticks(p.x), cnc::mm_of_ticks(p.y), cnc::mm_of_ticks(p.z)});
  };
  add(path.start);
  for (const cnc::PathMove& move : path.moves) add(move.to);
  const auto check = [](char axis, double length_mm, Millimetres travel) -> Result<void> {
    if (travel.value() == 0.0 || length_mm <= travel.value()) return {};
    return fail(cnc::kBeyondTravel,
                fmt::format("the program needs {:.1f} mm of travel in {}, the machine has {:.1f} "
                            "mm; cut the part in bands",
                            length_mm, axis, travel.value()));
  };
  MAQUETTE_TRY_VOID(check('x', box.max.x - box.min.x, o.travel_x));
  MAQUETTE_TRY_VOID(check('y', box.max.y - box.min.y, o.travel_y));
  return check('z', box.max.z - box.min.z, o.travel_z);
}

Result<JobResult> rough_job(const MillJob& job, const heightmap::ModelField& design,
                            const fs::path& out, const RunContext& run) {
  const cnc::MillOptions& o = job.finish;
  cnc::StockBox stock;
  stock.x0_mm = design.x0.value();
  stock.x1_mm = design.x_mm(design.z_mm.cols() - 1);
  stock.y0_mm = design.y0.value();
  stock.y1_mm = design.y_mm(design.z_mm.rows() - 1);
  const Millimetres highest{static_cast<double>(heightmap::height_range(design.z_mm).max)};
  stock.top_mm =
      (std::isnan(job.stock_top.value()) ? highest + job.stock_margin : job.stock_top).value();
  cnc::RoughingOptions options = job.rough;
  options.feed_mm_min = o.feed.value();
  options.plunge_feed_mm_min = o.plunge_feed.value();
  Result<cnc::Roughing> roughed = [&]() -> Result<cnc::Roughing> {
    if (!job.stock) return cnc::rough(design, stock, options, run);
    MAQUETTE_TRY(const auto left, heightmap::read_model_field(*job.stock));
    stock.top_mm = static_cast<double>(heightmap::height_range(left.z_mm).max);
    return cnc::rough(design, left, options, run);
  }();
  MAQUETTE_TRY(const cnc::Roughing roughing, std::move(roughed));
  MAQUETTE_TRY_VOID(check_travel(roughing.path, o));

  cnc::ProgramOptions program;
  program.post = o.post;
  program.name = o.program_name;
  program.work_offset = o.work_offset;
  program.blending = Millimetres{0.02};  // against an allowance of tenths
  program.safe_z = Millimetres{std::ceil(stock.top_mm + o.clearance.value())};
  program.entry_feed = o.plunge_feed;
  program.max_lines = o.max_lines;
  program.max_bytes = o.max_bytes;
  program.comments = {"frame of the model, x east, y north, z up",
                      fmt::format("roughing, leaves {} mm", options.allowance_mm),
                      fmt::format("block x {} .. {} y {} .. {} top z {} mm", stock.x0_mm,
                                  stock.x1_mm, stock.y0_mm, stock.y1_mm, stock.top_mm)};
  MAQUETTE_TRY(auto writer, cnc::ProgramWriter::create(out, program));
  cnc::Tool tool;
  tool.number = job.rough_tool;
  tool.cutter = options.cutter;
  tool.name = fmt::format("{} {} mm", options.cutter.corner_radius_mm > 0.0 ? "bull nose" : "flat",
                          2.0 * options.cutter.radius_mm);
  writer.tool(tool, o.spindle_rpm);
  cnc::PathMove above;
  above.kind = cnc::PathMove::Kind::rapid;
  above.to = roughing.path.start;
  MAQUETTE_TRY_VOID(writer.add({&above, 1}));
  MAQUETTE_TRY_VOID(writer.add(roughing.path.moves));
  MAQUETTE_TRY(const auto written, writer.commit());
  const cnc::RoughingReport& report = roughing.report;
  if (report.lacking_mm > 0.0)
    run.warn(fmt::format("the block's top, z = {} mm, is up to {:.2f} mm below the design",
                         stock.top_mm, report.lacking_mm));
  JobResult result;
  result.outputs = written.files;
  result.outputs.push_back(beside(out, "stock"));
  MAQUETTE_TRY_VOID(
      heightmap::write_model_field(cnc::surface_over(roughing.stock), result.outputs.back()));
  result.figures_json = json{
      {"strategy", job.strategy},
      {"levels", report.levels},
      {"pieces", report.pieces},
      {"side_entries", report.side_entries},
      {"ramps", report.ramps},
      {"blocks", written.blocks},
      {"bytes", written.bytes},
      {"path_length_mm", report.cutting_length_mm},
      {"rapid_length_mm", report.rapid_length_mm},
      {"cutting_time_min", written.cutting_time_min},
      {"removed_cm3", 1e-3 * report.removed_mm3},
      {"lowest_tip_mm", report.lowest_tip_mm},
      {"stock_top_mm",
       stock.top_mm}}.dump();
  result.note =
      fmt::format("{} levels, {} blocks, {:.1f} m, {:.0f} cm3 removed", report.levels,
                  written.blocks, report.cutting_length_mm / 1000.0, 1e-3 * report.removed_mm3);
  return result;
}

}  // namespace

const std::vector<std::string>& mill_strategies() {
  static const std::vector<std::string> all{"raster", "rough"};
  return all;
}

Result<JobResult> mill_job(const MillJob& job, const fs::path& out, const RunContext& run) {
  MAQUETTE_TRY(auto design, heightmap::read_model_field(job.design));
  if (job.strategy == "rough") return rough_job(job, design, out, run);
  cnc::MillOptions options = job.finish;
  if (job.band) {
    MAQUETTE_TRY(const auto bands,
                 meshing::split_into_bands(design, meshing::BandAxis::y, job.max_width));
    MAQUETTE_CHECK(*job.band < bands.size(), "band {} of {}", *job.band, bands.size());
    const meshing::Band& b = bands[*job.band];
    options.first_y_mm = design.y_mm(b.first);
    options.last_y_mm = design.y_mm(b.last);
    // The cutter feels the neighbours as far as its radius reaches.
    design = meshing::band_field(design, b, options.ball_diameter);
  }
  return raster_job(job, design, options, out, run);
}

}  // namespace maquette::tools

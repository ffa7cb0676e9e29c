// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/milling/mill_program.hpp"

#include <algorithm>

#include <fmt/format.h>

#include "cnc/gcode_reader.hpp"
#include "cnc/motion_time.hpp"
#include "cnc/path_certificate.hpp"
#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/bands.hpp"
#include "tools/tool_table.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
using nlohmann::json;
namespace {

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

/// What reading the program back says.
struct ReadBack {
  cnc::MotionTime time;
  std::optional<cnc::PathCertificate> proof;
};

Result<ReadBack> read_back(const std::vector<fs::path>& parts, const std::optional<Proof>& proof,
                           const cnc::Machine& machine, const cnc::PathControl& control,
                           const RunContext& run) {
  cnc::MotionTimer timer(machine, control);
  std::optional<cnc::PathProof> path;
  if (proof)
    path.emplace(proof->surface, cnc::BallNose{proof->ball_radius_mm},
                 cnc::PathProofOptions{.limit_mm = proof->limit_mm});
  Box3 box;
  std::vector<cnc::Motion> lowered;
  for (const fs::path& part : parts) {
    MAQUETTE_TRY_VOID(cnc::read_gcode(
        part,
        [&](std::span<const cnc::Motion> motions) -> Result<void> {
          for (const cnc::Motion& m : motions) {
            timer.add(m);
            box.add(m.from_mm);
            box.add(m.to_mm);
          }
          if (!path) return {};
          if (proof->lowered_mm == 0.0) {
            path->add(motions);
            return {};
          }
          lowered.assign(motions.begin(), motions.end());
          for (cnc::Motion& m : lowered)
            for (Vec3* p : {&m.from_mm, &m.to_mm, &m.centre_mm}) p->z -= proof->lowered_mm;
          path->add(lowered);
          return {};
        },
        run));
    timer.rest();
  }
  // Retreats and entries of the parts too; the bulges of arcs were looked at with the path.
  MAQUETTE_TRY_VOID(cnc::check_travel(machine, box));
  ReadBack back;
  back.time = timer.time();
  if (path) back.proof = path->finish();
  return back;
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

}  // namespace

Result<Waiting> Waiting::beside(const fs::path& out) {
  Waiting waiting;
  waiting.folder_ = out.parent_path() / fmt::format(".{}.partial-unproven", out.stem().string());
  std::error_code ec;
  fs::remove_all(waiting.folder_, ec);
  fs::create_directories(waiting.folder_, ec);
  if (ec) return tl::unexpected(write_error(out, ec.value()));
  return waiting;
}

Waiting::~Waiting() {
  std::error_code ec;
  if (!folder_.empty()) fs::remove_all(folder_, ec);
}

fs::path beside(const fs::path& program, const std::string& what) {
  return program.parent_path() / fmt::format("{}.{}.tif", program.stem().string(), what);
}

Result<MillProgram> MillProgram::begin(const MillJob& job, const Piece& piece, const fs::path& out,
                                       double top_mm, Millimetres blending,
                                       std::vector<std::string> comments) {
  cnc::ProgramOptions options = job.program;
  options.blending = blending;
  options.safe_z = Millimetres{std::ceil((top_mm + job.clearance.value()) * 1000.0) / 1000.0};
  options.entry_feed = job.plunge_feed;
  options.comments = std::move(comments);
  MAQUETTE_TRY_VOID(cnc::check_tool_length(job.machine, job.tool, gauge_length_mm(job.tool),
                                           options.safe_z.value() - piece.table_mm));
  MAQUETTE_TRY(Waiting waiting, Waiting::beside(out));
  MAQUETTE_TRY(auto writer, cnc::ProgramWriter::create(waiting.file(out), options));
  cnc::Tool tool = job.tool;
  if (tool.name.empty()) tool.name = shape_name(tool.cutter);
  writer.tool(tool, job.spindle_rpm);
  return MillProgram(job, out, std::move(waiting), std::move(writer), blending.value());
}

Result<void> MillProgram::add(const cnc::Toolpath& piece) {
  figures_.add(piece);
  MAQUETTE_TRY_VOID(cnc::check_travel(job_.machine, figures_.extent_mm()));
  return writer_.add(piece);
}

Result<JobResult> MillProgram::finish(const std::optional<Proof>& proof, json figures,
                                      const RunContext& run) {
  MAQUETTE_TRY(const cnc::ProgramReport written, writer_.commit());
  cnc::PathControl control;
  control.mode =
      blending_mm_ > 0.0 ? cnc::PathControl::Mode::blend : cnc::PathControl::Mode::exact_path;
  control.tolerance_mm = blending_mm_;
  MAQUETTE_TRY(const ReadBack back, read_back(written.files, proof, job_.machine, control, run));
  const double proven_mm = back.proof ? back.proof->proven_mm : 0.0;
  const bool rejected = proof && proven_mm > proof->limit_mm;
  JobResult result;
  MAQUETTE_TRY(result.outputs, put_in_place(written.files, out_, rejected ? ".rejected" : ""));
  if (rejected)
    result.unmet = fmt::format(
        "{}: may cut {:.4f} mm below what it must leave, more than the {:.4f} mm that its "
        "tolerance "
        "allows; kept as {} for inspection",
        out_.string(), proven_mm, proof->limit_mm, result.outputs.front().string());
  if (back.time.highest_blocks_per_s > job_.machine.blocks_per_s)
    run.warn(fmt::format(
        "{}: {:.0f} blocks a second at its densest, {} reads {:.0f}: it will wait {:.1f} min in "
        "all; lower the feed or raise the tolerance",
        out_.string(), back.time.highest_blocks_per_s, job_.machine.name, job_.machine.blocks_per_s,
        back.time.waiting_s / 60.0));
  const cnc::MotionTime& t = back.time;
  figures.update(
      {{"strategy", job_.strategy},
       {"tool", job_.tool.number},
       {"blocks", written.blocks},
       {"bytes", written.bytes},
       {"lines", figures_.lines},
       {"arcs", figures_.arcs},
       {"path_length_mm", figures_.cutting_length_mm},
       {"rapid_length_mm", figures_.rapid_length_mm},
       {"machining_time",
        json::array({{{"program", out_.filename().string()},
                      {"tool", job_.tool.number},
                      {"band", job_.max_width ? fmt::format("band_{:02}", job_.band + 1) : ""},
                      {"cutting_min", t.cutting_s / 60.0},
                      {"rapid_min", t.rapid_s / 60.0},
                      {"waiting_min", t.waiting_s / 60.0},
                      {"total_min", t.total_s() / 60.0},
                      {"length_m", t.cutting_mm / 1000.0},
                      {"highest_blocks_per_s", t.highest_blocks_per_s}}})},
       {"cutting_time_min", t.cutting_s / 60.0},
       {"total_time_min", t.total_s() / 60.0},
       {"shortest_move_mm",
        std::isfinite(figures_.shortest_cut_mm) ? figures_.shortest_cut_mm : 0.0},
       {"highest_block_rate_per_s", t.highest_blocks_per_s},
       {"machine_blocks_per_s", job_.machine.blocks_per_s}});
  if (figures_.lines + figures_.arcs > 0)
    figures.update({{"lowest_tip_mm", cnc::mm_of_ticks(figures_.lowest_cut)},
                    {"highest_tip_mm", cnc::mm_of_ticks(figures_.highest_cut)}});
  if (back.proof)
    figures.update({{"proven_gouge_mm", proven_mm}, {"gouges", places_of(*back.proof)}});
  result.figures_json = figures.dump();
  result.note = fmt::format("{} blocks, {:.1f} m, {:.1f} min", written.blocks,
                            figures_.cutting_length_mm / 1000.0, t.total_s() / 60.0);
  if (back.proof) result.note += fmt::format(", gouge proven below {:.1f} um", 1e3 * proven_mm);
  return result;
}

Result<JobResult> MillProgram::finish_unread(json figures) {
  MAQUETTE_TRY(const cnc::ProgramReport written, writer_.commit());
  JobResult result;
  MAQUETTE_TRY(result.outputs, put_in_place(written.files, out_, ""));
  figures.update({{"strategy", job_.strategy},
                  {"tool", job_.tool.number},
                  {"blocks", written.blocks},
                  {"bytes", written.bytes}});
  result.figures_json = figures.dump();
  result.note = fmt::format("{} blocks", written.blocks);
  return result;
}

Result<Piece> piece_of(const MillJob& job, double margin_mm) {
  Piece piece;
  MAQUETTE_TRY(piece.design, heightmap::read_model_field(job.design));
  if (job.stock) {
    MAQUETTE_TRY(piece.stock, heightmap::read_model_field(*job.stock));
  }
  piece.table_mm = static_cast<double>(heightmap::height_range(piece.design.z_mm).min) -
                   job.base_thickness.value();
  if (job.max_width) {
    MAQUETTE_TRY(const auto bands,
                 meshing::split_into_bands(piece.design, meshing::BandAxis::y, *job.max_width));
    MAQUETTE_CHECK(job.band < bands.size(), "band {} of {}", job.band, bands.size());
    const meshing::Band& b = bands[job.band];
    piece.first_y_mm = piece.design.y_mm(b.first);
    piece.last_y_mm = piece.design.y_mm(b.last);
    // The cutter feels the neighbours as far as it reaches.
    piece.design = meshing::band_field(piece.design, b, Millimetres{margin_mm});
  }
  piece.top_mm = static_cast<double>(heightmap::height_range(piece.design.z_mm).max);
  if (piece.stock)
    piece.top_mm =
        std::max(piece.top_mm, static_cast<double>(heightmap::height_range(piece.stock->z_mm).max));
  return piece;
}

std::vector<fs::path> parts_of(const fs::path& program) {
  std::vector<fs::path> parts{program};
  for (int k = 2;; ++k) {
    const fs::path next = program.parent_path() / fmt::format("{}_{}{}", program.stem().string(), k,
                                                              program.extension().string());
    if (!fs::exists(next)) return parts;
    parts.push_back(next);
  }
}

}  // namespace maquette::tools

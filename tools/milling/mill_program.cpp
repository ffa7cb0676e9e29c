// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/milling/joined_program.hpp"

#include <algorithm>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "cnc/gcode_reader.hpp"
#include "cnc/mill.hpp"
#include "cnc/posts.hpp"
#include "cnc/stone_clearance.hpp"
#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/bands.hpp"
#include "meshing/stones.hpp"
#include "tools/schema.hpp"
#include "tools/tool_table.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
using nlohmann::json;

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

json places_of(const cnc::PathCertificate& proof) {
  json places = json::array();
  for (std::size_t i = 0; i < std::min<std::size_t>(proof.places.size(), 10); ++i)
    places.push_back({{"x_mm", proof.places[i].x_mm},
                      {"y_mm", proof.places[i].y_mm},
                      {"depth_mm", proof.places[i].depth_mm},
                      {"line", proof.places[i].line}});
  return places;
}

cnc::PathControl control_of(const std::string& post, Millimetres blending) {
  cnc::PathControl control;
  // Grbl and Fanuc are not told how far: as any program that does not say.
  if (cnc::post_by_name(post)->blend.find("{tolerance}") == std::string_view::npos) return control;
  control.mode =
      blending.value() > 0.0 ? cnc::PathControl::Mode::blend : cnc::PathControl::Mode::exact_path;
  control.tolerance_mm = blending.value();
  return control;
}

Result<std::string> meets_stones(const MillJob& job, std::span<const fs::path> parts,
                                 std::span<const cnc::Tool> tools, const RunContext& run) {
  if (!job.standing_stones) return std::string();
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(job.design));
  MAQUETTE_TRY(const auto plan, meshing::read_stone_plan(*job.standing_stones));
  const heightmap::ModelField with_stones = meshing::with_stones(design, plan);
  std::vector<cnc::Cutter> cutters;
  for (const cnc::Tool& tool : tools) cutters.push_back(tool.cutter);
  cnc::StoneClearance clearance(design, with_stones, cutters);
  for (std::size_t file = 0; file < parts.size(); ++file)
    MAQUETTE_TRY_VOID(cnc::read_gcode(
        parts[file],
        [&](std::span<const cnc::Motion> motions) -> Result<void> {
          for (std::size_t end = 0, begin = 0; begin < motions.size(); begin = end) {
            const int number = motions[begin].tool;
            while (end < motions.size() && motions[end].tool == number) ++end;
            std::size_t cutter = 0;
            while (cutter + 1 < tools.size() && tools[cutter].number != number) ++cutter;
            clearance.add(motions.subspan(begin, end - begin), static_cast<std::uint16_t>(cutter),
                          file);
          }
          return {};
        },
        run));
  const cnc::StoneMeetings met = clearance.finish();
  std::string text;
  const auto say = [&](const char* what, std::uint64_t count,
                       const std::vector<cnc::MotionPlace>& places) {
    if (count == 0) return;
    const cnc::MotionPlace& p = places.front();
    text += fmt::format(
        "{}{} meets stones in {} moves, first at x {:.3f} y {:.3f} z {:.3f} by "
        "{}:{}",
        text.empty() ? "" : "; ", what, count, p.at_mm.x, p.at_mm.y, p.at_mm.z,
        parts[p.program].filename().string(), p.line);
  };
  say("the cutter", met.cutters, met.first_cutters);
  say("holder or shank", met.holders, met.first_holders);
  return text;
}

void warn_of_blocks(double highest_blocks_per_s, double waiting_s, const cnc::Machine& machine,
                    const fs::path& program, const RunContext& run) {
  if (highest_blocks_per_s <= machine.blocks_per_s) return;
  run.warn(fmt::format(
      "{}: {:.0f} blocks a second at its densest, {} reads {:.0f}: it will wait {:.1f} min in all; "
      "lower the feed or raise the tolerance",
      program.string(), highest_blocks_per_s, machine.name, machine.blocks_per_s,
      waiting_s / 60.0));
}

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

namespace {

/// Before the first motion with all axes known there is nothing to rewrite: the way there stays
/// above the part where it really stands.
double rise_mm(const Adjustment& a, const Piece& piece) {
  const heightmap::ModelField& d = piece.design;
  double rise = 0.0;
  for (const double x : {d.x0.value(), d.x_mm(d.z_mm.cols() - 1)})
    for (const double y : {d.y0.value(), d.y_mm(d.z_mm.rows() - 1)}) {
      const Vec3 top{x, y, piece.top_mm};
      rise = std::max(rise, a.errors.machine_from_part.point(top).z - top.z);
    }
  return rise > 0.0 ? std::ceil(rise * 1000.0) / 1000.0 : 0.0;
}

}  // namespace

Result<MillProgram> MillProgram::begin(const MillJob& job, const Piece& piece, const fs::path& out,
                                       double top_mm, Millimetres blending,
                                       std::vector<std::string> comments) {
  cnc::ProgramOptions options = job.program;
  options.blending = blending;
  options.safe_z = Millimetres{std::ceil((top_mm + job.clearance.value()) * 1000.0) / 1000.0};
  if (job.adjust) options.safe_z = options.safe_z + Millimetres{rise_mm(*job.adjust, piece)};
  options.entry_feed = job.plunge_feed;
  options.comments = std::move(comments);
  MAQUETTE_TRY_VOID(cnc::check_tool_length(job.machine, job.tool, gauge_length_mm(job.tool),
                                           options.safe_z.value() - piece.table_mm));
  cnc::Tool tool = job.tool;
  if (tool.name.empty()) tool.name = shape_name(tool.cutter);
  cnc::SpindleSpeed spindle{job.spindle_rpm, 0.0, false};
  if (job.material && spindle.rpm == 0.0) {
    MAQUETTE_TRY(spindle, cnc::spindle_speed(job.machine, *job.material, tool, piece.deepest_mm));
    if (spindle.below_material)
      options.comments.push_back(
          fmt::format("spindle: the fastest of {}, {:.3g} m/min where it cuts; {} asks for {:.0f}",
                      job.machine.name, spindle.surface_speed_m_min, job.material->name,
                      job.material->min_surface_speed_m_min));
  }
  MAQUETTE_TRY(Waiting waiting, Waiting::beside(out));
  const bool adjust = job.adjust && job.joined == nullptr;
  MAQUETTE_TRY(auto writer,
               cnc::ProgramWriter::create(waiting.file(adjust ? meant_of(out) : out), options));
  writer.tool(tool, spindle.rpm);
  if (job.joined != nullptr) job.joined->begin(job, tool, spindle.rpm, options);
  return MillProgram(job, piece, out, std::move(waiting), std::move(writer), blending.value(),
                     spindle);
}

/// By the chip where nothing else is asked for; never more than the machine can do.
Result<void> MillProgram::set_feeds(cnc::Toolpath& path) {
  if (!job_.material || job_.feed_given) {
    cnc::limit_feeds(path, job_.machine);
    return {};
  }
  // Across the feed as much as can be: somewhere every pass is the first one.
  const double width = 2.0 * job_.tool.cutter.radius_mm;
  std::vector<cnc::Engagement> engagement;
  if (piece_.depth) {
    cnc::ToolPosition from = path.start;
    for (const cnc::PathMove& m : path.moves) {
      engagement.push_back(
          {width, piece_.depth->along_mm(cnc::mm_of_ticks(from.x), cnc::mm_of_ticks(from.y),
                                         cnc::mm_of_ticks(m.to.x), cnc::mm_of_ticks(m.to.y))});
      from = m.to;
    }
  } else {
    engagement.push_back({width, piece_.deepest_mm});
  }
  if (engagement.empty()) return {};
  cnc::FeedOptions options;
  options.control.tolerance_mm = blending_mm_;
  options.spindle_rpm = spindle_.rpm;
  MAQUETTE_TRY(const auto report,
               cnc::set_feeds(path, job_.machine, *job_.material, job_.tool, engagement, options));
  if (report.moves == 0) return {};
  feeds_.lowest_mm_min = feeds_.moves == 0 ? report.lowest_mm_min
                                           : std::min(feeds_.lowest_mm_min, report.lowest_mm_min);
  feeds_.highest_mm_min = std::max(feeds_.highest_mm_min, report.highest_mm_min);
  feeds_.moves += report.moves;
  feeds_.by_chip += report.by_chip;
  feeds_.by_axes += report.by_axes;
  feeds_.by_plunge += report.by_plunge;
  feeds_.by_acceleration += report.by_acceleration;
  return {};
}

Result<void> MillProgram::add(const cnc::Toolpath& piece) {
  cnc::Toolpath path = piece;
  MAQUETTE_TRY_VOID(set_feeds(path));
  figures_.add(path);
  MAQUETTE_TRY_VOID(cnc::check_travel(job_.machine, figures_.extent_mm()));
  if (job_.joined != nullptr) MAQUETTE_TRY_VOID(job_.joined->add(path));
  return writer_.add(path);
}

Result<JobResult> MillProgram::finish(const std::optional<Proof>& proof, json figures,
                                      const RunContext& run) {
  MAQUETTE_TRY(const cnc::ProgramReport written, writer_.commit());
  JobResult result;
  figures.update({{"strategy", job_.strategy},
                  {"tool", job_.tool.number},
                  {"blocks", written.blocks},
                  {"bytes", written.bytes},
                  {"lines", figures_.lines},
                  {"arcs", figures_.arcs},
                  {"path_length_mm", figures_.cutting_length_mm},
                  {"rapid_length_mm", figures_.rapid_length_mm},
                  {"shortest_move_mm",
                   std::isfinite(figures_.shortest_cut_mm) ? figures_.shortest_cut_mm : 0.0},
                  {"spindle_rpm", spindle_.rpm}});
  if (spindle_.surface_speed_m_min > 0.0)
    figures.update({{"surface_speed_m_min", spindle_.surface_speed_m_min},
                    {"spindle_below_material", spindle_.below_material}});
  if (feeds_.moves > 0)
    figures["feeds"] = {{"material", job_.material->name},
                        {"lowest_mm_min", feeds_.lowest_mm_min},
                        {"highest_mm_min", feeds_.highest_mm_min},
                        {"by_chip", feeds_.by_chip},
                        {"by_axes", feeds_.by_axes},
                        {"by_plunge", feeds_.by_plunge},
                        {"by_acceleration", feeds_.by_acceleration}};
  if (figures_.lines + figures_.arcs > 0)
    figures.update({{"lowest_tip_mm", cnc::mm_of_ticks(figures_.lowest_cut)},
                    {"highest_tip_mm", cnc::mm_of_ticks(figures_.highest_cut)}});
  if (job_.joined != nullptr) {  // timed and proven there, as the machine will read it
    job_.joined->end(proof);
    MAQUETTE_TRY(result.outputs, put_in_place(written.files, out_, ""));
    result.figures_json = figures.dump();
    return result;
  }
  Section section{job_.name,
                  job_.tool.number,
                  control_of(job_.program.post, Millimetres{blending_mm_}),
                  blending_mm_,
                  {},
                  {}};
  if (proof) section.proof.emplace(*proof);
  MAQUETTE_TRY(const auto back, read_back(written.files, {&section, 1}, job_.machine, run));
  const double proven_mm = back.front().proven_mm();
  std::optional<Adjusted> called;
  if (job_.adjust) {
    MAQUETTE_TRY(called, adjusted(job_, written.files, {&section, 1}, {&job_.tool, 1},
                                  waiting_.file(out_).parent_path(), run));
    figures["adjusted"] = json::parse(called->figures_json);
  }
  const cnc::MotionTime& t = called ? called->back.front().time : back.front().time;
  MAQUETTE_TRY(result.unmet, meets_stones(job_, written.files, {&job_.tool, 1}, run));
  if (proof && proven_mm > proof->limit_mm)
    result.unmet = fmt::format(
        "{}: may cut {:.4f} mm below what it must leave, more than the {:.4f} mm that its "
        "tolerance allows{}{}",
        out_.string(), proven_mm, proof->limit_mm, result.unmet.empty() ? "" : "; ", result.unmet);
  std::vector<fs::path> files = written.files;
  if (called) {
    if (!called->unmet.empty()) result.unmet += (result.unmet.empty() ? "" : "; ") + called->unmet;
    files.insert(files.begin(), called->files.begin(), called->files.end());
  }
  MAQUETTE_TRY(result.outputs, put_in_place(files, out_, result.unmet.empty() ? "" : ".rejected"));
  if (called)
    result.meant.assign(result.outputs.begin() + static_cast<std::ptrdiff_t>(called->files.size()),
                        result.outputs.end());
  if (!result.unmet.empty())
    result.unmet += fmt::format("; kept as {} for inspection", result.outputs.front().string());
  warn_of_blocks(t.highest_blocks_per_s, t.waiting_s, job_.machine, out_, run);
  figures.update(
      {{"machining_time",
        json::array({time_row(out_.filename().string(), section,
                              job_.bands ? fmt::format("band_{:02}", job_.band + 1) : "", t)})},
       {"cutting_time_min", t.cutting_s / 60.0},
       {"total_time_min", t.total_s() / 60.0},
       {"highest_block_rate_per_s", t.highest_blocks_per_s},
       {"machine_blocks_per_s", job_.machine.blocks_per_s}});
  if (proof)
    figures.update({{"proven_gouge_mm", proven_mm},
                    {"blending_mm", blending_mm_},
                    {"proven_with_blending_mm", proven_mm + blending_mm_},
                    {"gouges", places_of(*back.front().proof)}});
  result.figures_json = figures.dump();
  result.note = fmt::format("{} blocks, {:.1f} m, {:.1f} min", written.blocks,
                            figures_.cutting_length_mm / 1000.0, t.total_s() / 60.0);
  if (proof)
    result.note += fmt::format(", gouge proven below {:.1f} um, {:.1f} um with blending",
                               1e3 * proven_mm, 1e3 * (proven_mm + blending_mm_));
  if (called)
    result.note += fmt::format(
        "; called at most {:.4f} mm beside, gouge of what the machine makes of it below {:.1f} um",
        called->largest_mm, 1e3 * called->back.front().proven_mm());
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

Result<MillJob> with_feeds(const MillJob& job) {
  if (job.adjust) {
    const std::string by = head_of(*job.adjust).front();
    if (!strategy_of(job.strategy).cuts)
      return fail(kConfigInvalid,
                  fmt::format("{}: {} touches what is there; only programs that cut are rewritten",
                              by, job.strategy));
    if (job.program.relative)
      return fail(kConfigInvalid,
                  fmt::format("{}: only programs of absolute moves (G90) can be rewritten; leave "
                              "out relative",
                              by));
    if (job.program.post == "heidenhain")
      return fail(kConfigInvalid,
                  fmt::format("{}: programs for heidenhain are not rewritten; enter the errors in "
                              "the control's own tables",
                              by));
    if (job.adjust->errors.radius_error_mm != 0.0 && !job.tool.cutter.is_ball() &&
        job.adjust->errors.tool_counts(job.tool.number))
      return fail(kConfigInvalid,
                  fmt::format("{}: radius_error_mm is a ball's, {} mills with another cutter", by,
                              job.strategy));
  }
  const cnc::Machine& m = job.machine;
  const double fastest = std::max(m.max_feed_mm_min.x, m.max_feed_mm_min.y);
  const auto check = [&](const char* what, double value, double most) -> Result<void> {
    if (value == 0.0 || (value >= 0.01 && value <= most)) return {};
    return fail(cnc::kFeedOutOfRange,
                fmt::format("{} is {} mm/min; {} allows 0.01 to {}", what, value, m.name, most));
  };
  MAQUETTE_TRY_VOID(check("feed", job.feed.value(), fastest));
  MAQUETTE_TRY_VOID(check("plunge feed", job.plunge_feed.value(), m.max_plunge_mm_min));
  if (job.spindle_rpm != 0.0 &&
      !(job.spindle_rpm >= m.min_spindle_rpm && job.spindle_rpm <= m.max_spindle_rpm))
    return fail(cnc::kSpindleOutOfRange,
                fmt::format("spindle is {} rpm; {} turns {} to {}", job.spindle_rpm, m.name,
                            m.min_spindle_rpm, m.max_spindle_rpm));
  MillJob whole = job;
  whole.feed_given = job.feed.value() > 0.0;
  const auto fill = [](FeedRate& rate, double mm_min) {
    if (rate.value() == 0.0) rate = FeedRate{mm_min};
  };
  if (job.material) {
    // What strategies weigh ways by; moves get their own feeds when they are written.
    fill(whole.feed, fastest);
    fill(whole.plunge_feed, std::min(m.max_plunge_mm_min, 0.2 * fastest));
  } else {
    fill(whole.feed, std::min(3000.0, fastest));
    fill(whole.plunge_feed, std::min(600.0, m.max_plunge_mm_min));
    if (whole.spindle_rpm == 0.0)
      whole.spindle_rpm = std::clamp(18000.0, m.min_spindle_rpm, m.max_spindle_rpm);
  }
  return whole;
}

Result<Piece> piece_of(const MillJob& job, double margin_mm) {
  Piece piece;
  MAQUETTE_TRY(piece.design, heightmap::read_model_field(job.design));
  if (job.stock) {
    MAQUETTE_TRY(piece.stock, heightmap::read_model_field(*job.stock));
  }
  piece.table_mm = static_cast<double>(heightmap::height_range(piece.design.z_mm).min) -
                   job.base_thickness.value();
  if (job.bands) {
    MAQUETTE_TRY(const auto bands, meshing::split_into_bands(piece.design, *job.bands));
    MAQUETTE_CHECK(job.band < bands.size(), "band {} of {}", job.band, bands.size());
    const meshing::Band& b = bands[job.band];
    piece.first_y_mm = piece.design.y_mm(b.first);
    piece.last_y_mm = piece.design.y_mm(b.last);
    // The cutter feels the neighbours as far as it reaches.
    piece.design = meshing::band_field(piece.design, b, Millimetres{margin_mm});
  }
  const cnc::Cutter& cutter = job.tool.cutter;
  piece.deepest_mm = cutter.corner_radius_mm;
  if (job.material && !job.feed_given && cutter.is_ball() &&
      (piece.stock || !std::isnan(job.allowance_mm))) {
    piece.depth.emplace(piece.design, piece.stock ? &*piece.stock : nullptr, job.allowance_mm,
                        cutter);
    piece.deepest_mm = piece.depth->deepest_mm();
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

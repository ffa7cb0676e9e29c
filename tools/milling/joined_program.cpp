// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/milling/joined_program.hpp"

#include <algorithm>
#include <deque>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "cnc/gcode_reader.hpp"
#include "cnc/motion_time.hpp"
#include "heightmap/field_io.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
using nlohmann::json;
namespace {

/// One section while its motions come by.
struct Reading {
  Reading(const Section& section, const cnc::Machine& machine) : timer(machine, section.control) {
    if (section.proof)
      path.emplace(section.proof->surface, cnc::BallNose{section.proof->ball_radius_mm},
                   cnc::PathProofOptions{.limit_mm = section.proof->limit_mm});
  }
  cnc::MotionTimer timer;
  std::optional<cnc::PathProof> path;
  std::vector<cnc::Motion> lowered, made;

  void add(const cnc::Motion& motion, const Section& section, cnc::MachineRun* machine_run) {
    timer.add(motion);
    made.assign(1, motion);
    if (machine_run != nullptr) {
      made.clear();
      machine_run->add(motion, made);
    }
    if (!path) return;
    for (cnc::Motion& m : made) {
      for (Vec3* p : {&m.from_mm, &m.to_mm, &m.centre_mm}) p->z -= section.proof->lowered_mm;
      lowered.push_back(m);
    }
  }
  void prove() {
    if (path) path->add(lowered);
    lowered.clear();
  }
};

}  // namespace

Result<std::vector<SectionFigures>> read_back(std::span<const fs::path> parts,
                                              std::span<const Section> sections,
                                              const cnc::Machine& machine, const RunContext& run,
                                              cnc::MachineRun* machine_run) {
  std::deque<Reading> readings;
  for (const Section& s : sections) readings.emplace_back(s, machine);
  Box3 box;
  std::size_t now = 0;
  for (std::size_t file = 0; file < parts.size(); ++file) {
    MAQUETTE_TRY_VOID(cnc::read_gcode(
        parts[file],
        [&](std::span<const cnc::Motion> motions) -> Result<void> {
          for (const cnc::Motion& m : motions) {
            while (now + 1 < sections.size() &&
                   sections[now + 1].begin < cnc::ProgramPlace{file, m.line}) {
              readings[now].prove();
              readings[now].timer.rest();
              ++now;
            }
            readings[now].add(m, sections[now], machine_run);
            box.add(m.from_mm);
            box.add(m.to_mm);
          }
          readings[now].prove();
          return {};
        },
        run));
    readings[now].timer.rest();
  }
  // Retreats and entries of the parts too; the bulges of arcs were looked at with the path.
  MAQUETTE_TRY_VOID(cnc::check_travel(machine, box));
  std::vector<SectionFigures> figures;
  for (Reading& r : readings) {
    figures.push_back({r.timer.time(), {}});
    if (r.path) figures.back().proof = r.path->finish();
  }
  return figures;
}

Result<Adjusted> adjusted(const MillJob& job, std::span<const fs::path> meant,
                          std::span<const Section> sections, std::span<const cnc::Tool> tools,
                          const fs::path& folder, const RunContext& run) {
  const Adjustment& a = *job.adjust;
  cnc::CompensateOptions options;
  options.head = head_of(a);
  options.tools.assign(tools.begin(), tools.end());
  std::optional<heightmap::ModelField> design;
  if (a.errors.radius_error_mm != 0.0) {
    MAQUETTE_TRY(design, heightmap::read_model_field(job.design));
    options.design = &*design;
    for (const cnc::Tool& tool : tools)
      if (a.errors.tool_counts(tool.number)) options.ball_radius_mm = tool.cutter.radius_mm;
  }
  Adjusted result{{}, {sections.begin(), sections.end()}, {}, 0.0, {}, {}};
  std::uint64_t moves = 0, lines = 0, take_ups = 0;
  double& largest = result.largest_mm;
  for (std::size_t file = 0; file < meant.size(); ++file) {
    std::string name = meant[file].filename().string();
    name.erase(name.rfind(".meant"), std::string_view(".meant").size());
    result.files.push_back(folder / name);
    options.marks.clear();
    for (const Section& s : sections)
      if (s.begin.file == file) options.marks.push_back(s.begin.line);
    MAQUETTE_TRY(const auto f,
                 cnc::compensate(meant[file], a.errors, options, result.files.back(), run));
    for (std::size_t k = 0, mark = 0; k < sections.size(); ++k)
      if (sections[k].begin.file == file) result.sections[k].begin.line = f.marks[mark++];
    moves += f.moves;
    lines += f.lines;
    take_ups += f.take_ups;
    largest = std::max(largest, f.largest_mm);
    std::error_code ec;
    const std::uintmax_t bytes = fs::file_size(result.files.back(), ec);
    const cnc::ProgramOptions& most = job.program;
    if (!ec && ((most.max_lines > 0 && f.lines > most.max_lines) ||
                (most.max_bytes > 0 && bytes > most.max_bytes)))
      return fail(
          cnc::kProgramOptionOutOfRange,
          fmt::format("{}: {} lines and {} bytes once rewritten by {}, more than a file may "
                      "have; ask for smaller ones",
                      name, f.lines, bytes, options.head.front()));
  }
  // Balls are proven with the radius that they have.
  for (Section& s : result.sections)
    if (s.proof && a.errors.radius_error_mm != 0.0 && a.errors.tool_counts(s.tool))
      s.proof.emplace(Proof{s.proof->surface, s.proof->ball_radius_mm + a.errors.radius_error_mm,
                            s.proof->limit_mm, s.proof->lowered_mm});
  cnc::MachineRun machine_run(a.errors, options.tools, options.ball_radius_mm);
  MAQUETTE_TRY(result.back,
               read_back(result.files, result.sections, job.machine, run, &machine_run));
  double proven = 0.0;
  // Rewriting adds its own deviation, and the chords of arcs theirs.
  constexpr double kMore_mm = 2.0 * cnc::kMapping_mm;
  for (std::size_t k = 0; k < sections.size(); ++k) {
    proven = std::max(proven, result.back[k].proven_mm());
    if (result.sections[k].proof &&
        result.back[k].proven_mm() > result.sections[k].proof->limit_mm + kMore_mm)
      result.unmet += fmt::format(
          "{}{}: the machine of {} may cut {:.4f} mm below what it must leave, more than the "
          "{:.4f} "
          "mm that its tolerance and {:.4f} mm for rewriting allow",
          result.unmet.empty() ? "" : "; ", sections[k].name, options.head.front(),
          result.back[k].proven_mm(), result.sections[k].proof->limit_mm, kMore_mm);
  }
  json figures = json_of(a);
  figures.update({{"moves", moves},
                  {"lines", lines},
                  {"take_ups", take_ups},
                  {"largest_change_mm", largest},
                  {"proven_gouge_mm", proven}});
  result.figures_json = figures.dump();
  return result;
}

json time_row(const std::string& program, const Section& section, const std::string& band,
              const cnc::MotionTime& t) {
  return {{"program", program},
          {"operation", section.name},
          {"tool", section.tool},
          {"band", band},
          {"cutting_min", t.cutting_s / 60.0},
          {"rapid_min", t.rapid_s / 60.0},
          {"waiting_min", t.waiting_s / 60.0},
          {"total_min", t.total_s() / 60.0},
          {"length_m", t.cutting_mm / 1000.0},
          {"highest_blocks_per_s", t.highest_blocks_per_s}};
}

Result<JoinedProgram> JoinedProgram::create(const MillJob& first, const fs::path& out) {
  cnc::ProgramOptions options = first.program;
  options.safe_z = Millimetres{0.0};  // each operation brings its own
  MAQUETTE_TRY(Waiting waiting, Waiting::beside(out));
  MAQUETTE_TRY(auto writer, cnc::ProgramWriter::create(
                                waiting.file(first.adjust ? meant_of(out) : out), options));
  return JoinedProgram(out, std::move(waiting), std::move(writer));
}

void JoinedProgram::begin(const MillJob& job, const cnc::Tool& tool, double spindle_rpm,
                          const cnc::ProgramOptions& options) {
  writer_.operation(tool, spindle_rpm, options);
  tools_.push_back(tool);
  Section& s = sections_.emplace_back();
  s.name = job.name;
  s.tool = tool.number;
  s.control = control_of(options.post, options.blending);
  s.blending_mm = options.blending.value();
  s.begin = writer_.place();
}

void JoinedProgram::end(const std::optional<Proof>& proof) {
  if (!proof) return;
  // The strategy's own surface goes with it.
  surfaces_.push_back(std::make_unique<heightmap::ModelField>(proof->surface));
  sections_.back().proof.emplace(
      Proof{*surfaces_.back(), proof->ball_radius_mm, proof->limit_mm, proof->lowered_mm});
}

Result<JobResult> JoinedProgram::finish(const MillJob& first, json operations,
                                        const RunContext& run) {
  MAQUETTE_TRY(const cnc::ProgramReport written, writer_.commit());
  MAQUETTE_TRY(const auto back, read_back(written.files, sections_, first.machine, run));
  std::optional<Adjusted> called;
  if (first.adjust) {
    MAQUETTE_TRY(called, adjusted(first, written.files, sections_, tools_,
                                  waiting_.file(out_).parent_path(), run));
  }
  JobResult result;
  if (called) result.unmet = called->unmet;
  json times = json::array();
  double total_min = 0.0, worst_mm = 0.0, most_blocks = 0.0, waiting_s = 0.0;
  const std::string name = out_.filename().string();
  for (std::size_t k = 0; k < sections_.size(); ++k) {
    const Section& s = sections_[k];
    const double proven = back[k].proven_mm();
    const cnc::MotionTime& time = called ? called->back[k].time : back[k].time;
    times.push_back(time_row(name, s, "", time));
    total_min += time.total_s() / 60.0;
    waiting_s += time.waiting_s;
    most_blocks = std::max(most_blocks, time.highest_blocks_per_s);
    json& row = operations[k];
    row["operation"] = s.name;
    if (!s.proof) continue;
    worst_mm = std::max(worst_mm, proven);
    row["proven_gouge_mm"] = proven;
    row["blending_mm"] = s.blending_mm;
    row["gouges"] = places_of(*back[k].proof);
    if (proven > s.proof->limit_mm)
      result.unmet += fmt::format(
          "{}{}: operation {} may cut {:.4f} mm below what it must leave, more than the {:.4f} mm "
          "that its tolerance allows",
          result.unmet.empty() ? "" : "; ", out_.string(), s.name, proven, s.proof->limit_mm);
  }
  MAQUETTE_TRY(const std::string met, meets_stones(first, written.files, tools_, run));
  if (!met.empty()) result.unmet += (result.unmet.empty() ? "" : "; ") + met;
  std::vector<fs::path> files = called ? called->files : written.files;
  if (called) files.insert(files.end(), written.files.begin(), written.files.end());
  MAQUETTE_TRY(result.outputs, put_in_place(files, out_, result.unmet.empty() ? "" : ".rejected"));
  if (!result.unmet.empty())
    result.unmet += fmt::format("; kept as {} for inspection", result.outputs.front().string());
  warn_of_blocks(most_blocks, waiting_s, first.machine, out_, run);
  json figures = {{"strategy", "operations"},
                  {"operations", std::move(operations)},
                  {"blocks", written.blocks},
                  {"bytes", written.bytes},
                  {"path_length_mm", written.cutting_length_mm},
                  {"rapid_length_mm", written.rapid_length_mm},
                  {"machining_time", std::move(times)},
                  {"total_time_min", total_min},
                  {"highest_block_rate_per_s", most_blocks},
                  {"machine_blocks_per_s", first.machine.blocks_per_s},
                  {"proven_gouge_mm", worst_mm}};
  if (called) figures["adjusted"] = json::parse(called->figures_json);
  result.figures_json = figures.dump();
  result.note = fmt::format("{} operations, {} blocks, {:.1f} m, {:.1f} min", sections_.size(),
                            written.blocks, written.cutting_length_mm / 1000.0, total_min);
  if (worst_mm > 0.0) result.note += fmt::format(", gouge proven below {:.1f} um", 1e3 * worst_mm);
  return result;
}

}  // namespace maquette::tools

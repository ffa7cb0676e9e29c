// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/operations.hpp"

#include <algorithm>
#include <deque>

#include <fmt/format.h>

#include "cnc/mill.hpp"
#include "cnc/verify.hpp"
#include "tools/milling.hpp"
#include "tools/tool_table.hpp"

namespace maquette::tools {
namespace {

constexpr double kInf = INFINITY;

bool same_cutter(const cnc::Cutter& a, const cnc::Cutter& b) {
  return a.radius_mm == b.radius_mm && a.corner_radius_mm == b.corner_radius_mm;
}

void set(double& value, double given) {
  if (!std::isnan(given)) value = given;
}

/// The cutter by the table, or by its measures. @return what is wrong
Result<void> set_cutter(MillJob& job, const Operation& o, std::span<const cnc::Tool> table) {
  const bool ball = job.tool.cutter.is_ball();
  if (o.tool > 0) job.tool.number = static_cast<int>(o.tool);
  cnc::Cutter& cutter = job.tool.cutter;
  if (!table.empty()) {
    if (!std::isnan(o.diameter_mm) || !std::isnan(o.corner_radius_mm))
      return fail(kConfigInvalid,
                  "the tool table says what the cutter is; diameter_mm and corner_radius_mm do not "
                  "go with it");
    const auto* found = std::find_if(table.data(), table.data() + table.size(),
                                     [&](const auto& t) { return t.number == job.tool.number; });
    if (found == table.data() + table.size()) {
      std::vector<int> numbers;
      for (const cnc::Tool& t : table) numbers.push_back(t.number);
      return fail(cnc::kToolNotInTable, fmt::format("tool {} is not in the tool table; it has {}",
                                                    job.tool.number, fmt::join(numbers, ", ")));
    }
    job.tool = *found;
    if (ball && !cutter.is_ball())
      return fail(kConfigInvalid, fmt::format("tool {} ({}) is no ball; {} is milled with one",
                                              job.tool.number, job.tool.name, job.strategy));
    return {};
  }
  if (!std::isnan(o.diameter_mm)) {
    cutter.radius_mm = 0.5 * o.diameter_mm;
    if (ball) cutter.corner_radius_mm = cutter.radius_mm;
  }
  if (!std::isnan(o.corner_radius_mm)) {
    if (ball)
      return fail(kConfigInvalid,
                  fmt::format("corner_radius_mm: {} is milled with a ball", job.strategy));
    cutter.corner_radius_mm = o.corner_radius_mm;
  }
  if (cutter.corner_radius_mm > cutter.radius_mm)
    return fail(kConfigInvalid,
                fmt::format("its corner radius of {} mm is more than half of its diameter, {} mm",
                            cutter.corner_radius_mm, 2.0 * cutter.radius_mm));
  return {};
}

MillJob with_values(MillJob job, const Operation& o) {
  job.name = o.name.empty() ? o.strategy : o.name;
  set(job.stepover_mm, o.stepover_mm);
  set(job.step_down_mm, o.step_down_mm);
  set(job.allowance_mm, o.allowance_mm);
  if (!std::isnan(o.direction_deg)) job.direction = degrees(o.direction_deg);
  if (!std::isnan(o.scallop_limit_mm)) {
    job.constant_scallop = true;
    job.scallop_limit = Millimetres{o.scallop_limit_mm};
  }
  if (!std::isnan(o.excess_limit_mm)) job.excess_limit = Millimetres{o.excess_limit_mm};
  if (!std::isnan(o.stated_stepover_mm)) job.stated_stepover = Millimetres{o.stated_stepover_mm};
  if (!std::isnan(o.tolerance_mm)) job.tolerance = Millimetres{o.tolerance_mm};
  set(job.least_slope_deg, o.least_slope_deg);
  set(job.ball_before_diameter_mm, o.ball_before_mm);
  set(job.ramp_deg, o.ramp_deg);
  set(job.cell_mm, o.cell_mm);
  set(job.gap_mm, o.gap_mm);
  set(job.bed_mm, o.bed_mm);
  set(job.mark_depth_mm, o.mark_depth_mm);
  if (!std::isnan(o.feed_mm_per_min)) job.feed = FeedRate{o.feed_mm_per_min};
  if (!std::isnan(o.plunge_feed_mm_per_min)) job.plunge_feed = FeedRate{o.plunge_feed_mm_per_min};
  set(job.spindle_rpm, o.spindle_rpm);
  return job;
}

bool leaves_what_a_ball_leaves(const MillJob& job) {
  return job.strategy == "raster" || job.strategy == "geodesic";
}

}  // namespace

std::vector<std::string> cutting_strategies() {
  std::vector<std::string> names;
  for (const Strategy& s : strategies())
    if (s.cuts) names.emplace_back(s.name);
  return names;
}

Schema operation_schema(Operation& o, std::vector<std::string> strategies) {
  Schema t;
  t.add({"strategy", &o.strategy, "", -kInf, kInf, std::move(strategies), true});
  t.add({"name", &o.name, "of its program; the strategy unless given"});
  t.add({"tool", &o.tool, "T word", 1, 99999});
  t.add({"diameter_mm", &o.diameter_mm, "of the cutter", 0.01, 500});
  t.add({"corner_radius_mm", &o.corner_radius_mm, "rough: 0 is a flat end", 0, 250});
  t.add({"stepover_mm", &o.stepover_mm, "between passes", 0.01, 200});
  t.add({"step_down_mm", &o.step_down_mm, "between levels; rest: in one go", 0.01, 200});
  t.add({"allowance_mm", &o.allowance_mm, "that rough and semi-finish leave", 0, 50});
  t.add({"direction_deg", &o.direction_deg, "of the passes, counter-clockwise from +x", -180, 180});
  t.add({"scallop_limit_mm", &o.scallop_limit_mm, "constant scallop of at most this", 1e-4, 10});
  t.add({"excess_limit_mm", &o.excess_limit_mm,
         "raster: what may stay above the stated scallop; cuts across to pits, each a stop", 1e-3,
         1});
  t.add({"stated_stepover_mm", &o.stated_stepover_mm,
         "raster: passes whose scallop that limit counts from; stepover_mm unless given", 0.01,
         200});
  t.add({"tolerance_mm", &o.tolerance_mm, "of the written path, all causes together", 1e-4, 1});
  t.add({"least_slope_deg", &o.least_slope_deg, "waterline: where it is steeper", 0, 90});
  t.add({"ball_before_mm", &o.ball_before_mm,
         "rest: diameter of the ball whose rest it takes; the "
         "last finishing operation's unless given",
         0.01, 500});
  t.add({"ramp_deg", &o.ramp_deg, "rough: steepest way down in material", 0.5, 45});
  t.add({"cell_mm", &o.cell_mm, "rough: grid it is planned on", 0.05, 20});
  t.add({"gap_mm", &o.gap_mm, "seats, outlines: room around a stone", 0, 100});
  t.add({"bed_mm", &o.bed_mm, "seats: room under a stone", 0, 100});
  t.add({"mark_depth_mm", &o.mark_depth_mm, "outlines", 0, 100});
  t.add({"feed_mm_per_min", &o.feed_mm_per_min, "instead of the material's", 0.01, 100000});
  t.add({"plunge_feed_mm_per_min", &o.plunge_feed_mm_per_min, "the same", 0.01, 100000});
  t.add({"spindle_rpm", &o.spindle_rpm, "the same", 1, 200000});
  return t;
}

Result<std::vector<Operation>> read_operations(const std::filesystem::path& file) {
  std::deque<Operation> operations;  // their addresses stay
  Schema t;
  std::string schema = "maquette.operations/1";
  t.add({"schema", &schema, "version of this file's keys", -kInf, kInf, {"maquette.operations/1"}});
  t.array("operation", "",
          [&] { return operation_schema(operations.emplace_back(), cutting_strategies()); });
  MAQUETTE_TRY_VOID(t.read(file));
  if (operations.empty())
    return fail(kConfigInvalid, fmt::format("{}: no [[operation]] is there", file.string()));
  return std::vector<Operation>(operations.begin(), operations.end());
}

Result<std::vector<MillJob>> jobs_of(std::span<const Operation> operations,
                                     const std::function<MillJob(std::string_view)>& defaults,
                                     std::span<const cnc::Tool> table, const std::string& file) {
  std::vector<MillJob> jobs;
  const MillJob* finish = nullptr;
  jobs.reserve(operations.size());
  for (const Operation& o : operations) {
    MillJob job = with_values(defaults(o.strategy), o);
    const auto wrong = [&](ErrorCode code, const std::string& what) {
      return fail(code,
                  fmt::format("{}: operation {} ({}): {}", file, jobs.size() + 1, job.name, what));
    };
    if (auto cutter = set_cutter(job, o, table); !cutter)
      return wrong(cutter.error().code, cutter.error().message);
    if (o.strategy != "raster" &&
        !(std::isnan(o.excess_limit_mm) && std::isnan(o.stated_stepover_mm)))
      return wrong(kConfigInvalid,
                   "excess_limit_mm and stated_stepover_mm are of raster passes; leave them out");
    if (job.name.find_first_not_of(
            "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789-") != std::string::npos)
      return wrong(kConfigInvalid, "a name is part of a file's name: letters, digits and '-'");
    if (o.strategy == "rest" && std::isnan(o.ball_before_mm) && finish != nullptr)
      job.ball_before_diameter_mm = 2.0 * finish->tool.cutter.radius_mm;
    for (const MillJob& other : jobs) {
      if (other.name == job.name)
        return wrong(kConfigInvalid,
                     "another operation has this name; give it one of its own with name");
      if (other.tool.number == job.tool.number && !same_cutter(other.tool.cutter, job.tool.cutter))
        return wrong(
            kConfigInvalid,
            fmt::format("tool {} is a {} here and a {} in operation '{}'; give each cutter "
                        "its own number with tool",
                        job.tool.number, shape_name(job.tool.cutter), shape_name(other.tool.cutter),
                        other.name));
    }
    jobs.push_back(std::move(job));
    if (leaves_what_a_ball_leaves(jobs.back())) finish = &jobs.back();
  }
  return jobs;
}

const MillJob* finishing(std::span<const MillJob> jobs) {
  const MillJob* last = nullptr;
  for (const MillJob& job : jobs)
    if (job.strategy == "raster" || job.strategy == "geodesic") last = &job;
  return last;
}

std::vector<cnc::Tool> tools_of(std::span<const MillJob> jobs) {
  std::vector<cnc::Tool> tools;
  for (const MillJob& job : jobs) {
    if (std::any_of(tools.begin(), tools.end(),
                    [&](const cnc::Tool& t) { return t.number == job.tool.number; }))
      continue;
    tools.push_back(job.tool);
    if (tools.back().name.empty()) tools.back().name = shape_name(job.tool.cutter);
  }
  return tools;
}

}  // namespace maquette::tools

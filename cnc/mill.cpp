// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/mill.hpp"

#include <algorithm>
#include <vector>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include "cnc/cutter_location.hpp"
#include "cnc/gcode_writer.hpp"
#include "cnc/pass_sampler.hpp"
#include "cnc/path_filter.hpp"
#include "cnc/posts.hpp"
#include "cnc/steepness.hpp"
#include "core/check.hpp"
#include "core/files.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;

constexpr std::ptrdiff_t kPassesAtATime = 64;
/// Of the tolerance, what may be lost between samples; the rest is for leaving samples out.
/// Measured on rough ground: less needs more samples, more needs more blocks.
constexpr double kSamplingShare = 0.3;
constexpr double kBlendingShare = 0.05;

/// Where the passes lie, in ticks.
struct Raster {
  std::int64_t left, right;
  std::vector<std::int64_t> rows;
};

bool positive(double v) {
  return std::isfinite(v) && v > 0.0;
}

std::int64_t first_tick_inside(double mm) {
  return static_cast<std::int64_t>(std::ceil(mm * 10000.0 - 1e-5));
}
std::int64_t last_tick_inside(double mm) {
  return static_cast<std::int64_t>(std::floor(mm * 10000.0 + 1e-5));
}

Result<void> check_options(const ModelField& design, const MillOptions& o) {
  const double diameter = o.ball_diameter.value();
  if (!positive(diameter))
    return fail(kToolNotPositive,
                fmt::format("ball_diameter is {} mm; it must be greater than 0", diameter));
  if (!positive(o.stepover.value()) || o.stepover > o.ball_diameter)
    return fail(kStepoverOutOfRange,
                fmt::format("stepover is {} mm; it must be greater than 0 and at most the ball's "
                            "diameter, {} mm",
                            o.stepover.value(), diameter));
  if (!(o.tolerance.value() >= 0.001 && o.tolerance.value() <= 1.0))
    return fail(
        kToleranceOutOfRange,
        fmt::format("tolerance is {} mm; it must be from 0.001 to 1 mm", o.tolerance.value()));
  const auto check_rate = [](const char* name, double value, const char* unit) -> Result<void> {
    if (value >= 0.01 && value <= 1e6) return {};
    return fail(kFeedOutOfRange,
                fmt::format("{} is {} {}; it must be from 0.01 to 1000000", name, value, unit));
  };
  MAQUETTE_TRY_VOID(check_rate("feed", o.feed.value(), "mm/min"));
  MAQUETTE_TRY_VOID(check_rate("plunge_feed", o.plunge_feed.value(), "mm/min"));
  MAQUETTE_TRY_VOID(check_rate("spindle_rpm", o.spindle_rpm, "1/min"));
  // The other controls are written by program.hpp alone.
  if (o.post != "linuxcnc" && o.post != "grbl")
    return fail(kUnknownPost,
                fmt::format("post '{}' is not known; there are: {}", o.post, post_names()));
  if (!(o.clearance.value() >= 0.0 && o.clearance.value() <= 1e4))
    return fail(kMillOptionOutOfRange,
                fmt::format("clearance is {} mm; it must be from 0 to 10000", o.clearance.value()));
  if (o.work_offset < 54 || o.work_offset > 59)
    return fail(kMillOptionOutOfRange,
                fmt::format("work_offset is G{}; it must be G54 to G59", o.work_offset));
  const double bottom = design.y0.value(), top = design.y_mm(design.z_mm.rows() - 1);
  const double first = std::isnan(o.first_y_mm) ? bottom : o.first_y_mm;
  const double last = std::isnan(o.last_y_mm) ? top : o.last_y_mm;
  // A caller's band limits may differ from the field's by rounding, not by more.
  if (!(first <= last && first >= bottom - kTick_mm && last <= top + kTick_mm))
    return fail(kMillOptionOutOfRange,
                fmt::format("passes are asked for from y = {} to {} mm; the design spans {} to {}",
                            first, last, bottom, top));
  return {};
}

Result<void> check_heights(const ModelField& design) {
  for (std::ptrdiff_t r = 0; r < design.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < design.z_mm.cols(); ++c)
      if (!std::isfinite(design.z_mm(r, c)))
        return fail(kHeightNotFinite,
                    fmt::format("height is {} at row {}, column {} (x = {} mm, y = {} mm); fill "
                                "voids before milling",
                                design.z_mm(r, c), r, c, design.x_mm(c), design.y_mm(r)));
  return {};
}

Result<void> check_travel(char axis, double length_mm, Millimetres travel) {
  if (travel.value() == 0.0 || length_mm <= travel.value()) return {};
  return fail(kBeyondTravel, fmt::format("the program needs {:.4f} mm of travel in {}, the machine "
                                         "has {:.4f} mm; cut the part in bands",
                                         length_mm, axis, travel.value()));
}

Raster lay_out(const ModelField& design, const MillOptions& o) {
  const double bottom = design.y0.value(), top = design.y_mm(design.z_mm.rows() - 1);
  const double first = std::isnan(o.first_y_mm) ? bottom : std::max(bottom, o.first_y_mm);
  const double last = std::isnan(o.last_y_mm) ? top : std::min(top, o.last_y_mm);
  Raster raster{first_tick_inside(design.x0.value()),
                last_tick_inside(design.x_mm(design.z_mm.cols() - 1)),
                {}};
  const std::int64_t lowest = first_tick_inside(first), highest = last_tick_inside(last);
  for (std::int64_t k = 0;; ++k) {
    const double y = first + o.stepover.value() * static_cast<double>(k);
    const std::int64_t tick =
        std::max(lowest, static_cast<std::int64_t>(std::llround(y * 10000.0)));
    if (tick >= highest) break;
    if (raster.rows.empty() || tick > raster.rows.back()) raster.rows.push_back(tick);
  }
  raster.rows.push_back(std::max(lowest, highest));
  return raster;
}

std::string header(const ModelField& design, const MillOptions& o, const Post& post,
                   const Raster& raster, double lowest, double highest, std::int64_t clearance) {
  const double R = 0.5 * o.ball_diameter.value();
  const double width = mm_of_ticks(raster.right - raster.left);
  const double flat = width * static_cast<double>(raster.rows.size());
  std::string h;
  h += fmt::format("({})\n", comment_text(o.program_name));
  h += "(unit mm, frame of the model: x east, y north, z up; z is the tip of the ball)\n";
  h += "(finishing only: remove the rough stock first)\n";
  h += fmt::format("(tool: ball nose, diameter {} mm)\n", o.ball_diameter.value());
  h += fmt::format("(stepover {} mm, scallop on flat ground {:.4f} mm, tolerance {} mm)\n",
                   o.stepover.value(), scallop_mm({R}, o.stepover.value()), o.tolerance.value());
  h += fmt::format("(design x {} .. {} y {} .. {} z {} .. {} mm, nodes {} mm apart)\n",
                   design.x0.value(), design.x_mm(design.z_mm.cols() - 1), design.y0.value(),
                   design.y_mm(design.z_mm.rows() - 1), lowest, highest, design.spacing.value());
  h += fmt::format("(passes {}, y {} .. {} mm, clearance plane z {} mm)\n", raster.rows.size(),
                   mm_of_ticks(raster.rows.front()), mm_of_ticks(raster.rows.back()),
                   mm_of_ticks(clearance));
  h += fmt::format("(at least {:.1f} min of cutting; what it came to stands at the end)\n",
                   flat / o.feed.value());
  h += fmt::format("{} G{}\n", post.modes, o.work_offset);
  if (!post.blend.empty()) {
    h += "(the path is already inside the tolerance: blend a little, never leave out points)\n";
    h += fmt::format("G64 P{:.5f} Q0\n", kBlendingShare * o.tolerance.value());
  }
  if (!post.blend.empty()) h += "T1 M6\nG43 H1\n";
  h += fmt::format("S{:.0f} M3\n", o.spindle_rpm);
  return h;
}

/// One pass and the link that leads to it.
struct Pass {
  std::vector<PathVertex> link;   // along y at the end of the pass before; empty: none
  std::vector<PathVertex> along;  // along x, in the order of cutting
  std::uint64_t sampled = 0;
  double gouge_mm = 0.0;
  bool cancelled = false;
  GcodeWriter text;
};

class Milling {
 public:
  Milling(const ModelField& design, const MillOptions& o, Raster raster, std::int64_t clearance)
      : design_(design),
        options_(o),
        tool_{0.5 * o.ball_diameter.value()},
        cutter_(design, tool_),
        tiles_(design, tool_),
        raster_(std::move(raster)),
        clearance_(clearance) {}

  [[nodiscard]] std::ptrdiff_t passes() const {
    return static_cast<std::ptrdiff_t>(raster_.rows.size());
  }
  [[nodiscard]] std::int64_t y(std::ptrdiff_t pass) const {
    return raster_.rows[static_cast<std::size_t>(pass)];
  }
  [[nodiscard]] bool backwards(std::ptrdiff_t pass) const {
    return options_.zigzag && pass % 2 != 0;
  }

  [[nodiscard]] Pass plan(std::ptrdiff_t index, DropCutter& cutter) const {
    Pass pass;
    std::vector<PathSample> samples;
    const double share = kSamplingShare * options_.tolerance.value();
    const auto line = [&](Axis axis, std::int64_t from, std::int64_t to, std::int64_t across,
                          std::vector<PathVertex>& vertices) {
      sample_line(cutter, tiles_, design_, tool_, axis, from, to, across, {share, share}, samples);
      pass.sampled += samples.size();
      pass.gouge_mm =
          std::max(pass.gouge_mm, filter_path(samples, options_.tolerance.value(), vertices));
    };
    line(Axis::x, raster_.left, raster_.right, y(index), pass.along);
    if (backwards(index)) std::reverse(pass.along.begin(), pass.along.end());
    if (options_.zigzag && index > 0)
      line(Axis::y, y(index - 1), y(index), pass.along.front().along, pass.link);
    return pass;
  }

  [[nodiscard]] ToolPosition start(const Pass& pass, std::ptrdiff_t index) const {
    return {pass.along.front().along, y(index), pass.along.front().z};
  }
  [[nodiscard]] ToolPosition end(const Pass& pass, std::ptrdiff_t index) const {
    return {pass.along.back().along, y(index), pass.along.back().z};
  }

  /// From above the start of the first pass down to it, then every pass from where the one
  /// before ended.
  void write_plunge(GcodeWriter& out, ToolPosition to) const {
    constexpr auto kStay = ToolPosition::kUnknown;
    out.rapid({kStay, kStay, clearance_});
    out.rapid({to.x, to.y, kStay});
    out.cut({kStay, kStay, to.z}, options_.plunge_feed.value());
  }
  void write_pass(GcodeWriter& out, const Pass& pass, std::ptrdiff_t index) const {
    constexpr auto kStay = ToolPosition::kUnknown;
    const double feed = options_.feed.value();
    if (index > 0 && !options_.zigzag) write_plunge(out, start(pass, index));
    for (const PathVertex& v : pass.link) out.cut({kStay, v.along, v.z}, feed);
    for (const PathVertex& v : pass.along) out.cut({v.along, kStay, v.z}, feed);
  }

  [[nodiscard]] const DropCutter& cutter() const { return cutter_; }
  [[nodiscard]] std::int64_t clearance() const { return clearance_; }

 private:
  const ModelField& design_;
  const MillOptions& options_;
  BallNose tool_;
  DropCutter cutter_;
  SteepnessTiles tiles_;
  Raster raster_;
  std::int64_t clearance_;
};

void count(MillReport& report, const Pass& pass) {
  report.points_sampled += pass.sampled;
  report.certified_gouge_mm = std::max(report.certified_gouge_mm, pass.gouge_mm);
  for (const auto* line : {&pass.link, &pass.along})
    for (const PathVertex& v : *line) {
      report.lowest_tip_mm = std::min(report.lowest_tip_mm, mm_of_ticks(v.z));
      report.highest_tip_mm = std::max(report.highest_tip_mm, mm_of_ticks(v.z));
    }
}

void put(AtomicFile& file, MillReport& report, const GcodeWriter& text) {
  file.write(text.text());
  report.bytes += text.text().size();
  report.blocks += text.blocks();
  report.path_length_mm += text.cutting_length_mm();
  report.cutting_time_min += text.cutting_time_min();
}

}  // namespace

Result<MillReport> mill(const ModelField& design, const MillOptions& options,
                        const std::filesystem::path& program_path, const RunContext& run) {
  MAQUETTE_CHECK(design.z_mm.rows() >= 2 && design.z_mm.cols() >= 2 && design.spacing.value() > 0.0,
                 "{} x {} nodes, {} mm apart", design.z_mm.rows(), design.z_mm.cols(),
                 design.spacing.value());
  MAQUETTE_TRY_VOID(check_options(design, options));
  MAQUETTE_TRY_VOID(check_heights(design));
  const auto [lowest, highest] =
      std::minmax_element(design.z_mm.cells().begin(), design.z_mm.cells().end());
  Raster raster = lay_out(design, options);
  const double width = mm_of_ticks(raster.right - raster.left);
  const double depth = mm_of_ticks(raster.rows.back() - raster.rows.front());
  MAQUETTE_TRY_VOID(check_travel('x', width, options.travel_x));
  MAQUETTE_TRY_VOID(check_travel('y', depth, options.travel_y));
  const auto clearance = static_cast<std::int64_t>(
      std::ceil((static_cast<double>(*highest) + options.clearance.value()) * 10000.0));

  MAQUETTE_TRY(auto file, AtomicFile::create(program_path));
  MillReport report;
  report.passes = raster.rows.size();
  report.scallop_flat_mm =
      scallop_mm({0.5 * options.ball_diameter.value()}, options.stepover.value());
  report.lowest_tip_mm = INFINITY;
  report.highest_tip_mm = -INFINITY;
  const Post post = *post_by_name(options.post);
  const std::string head = header(design, options, post, raster, static_cast<double>(*lowest),
                                  static_cast<double>(*highest), clearance);
  file.write(head);
  report.bytes = head.size();
  report.blocks = static_cast<std::uint64_t>(std::count(head.begin(), head.end(), '\n'));

  const Milling job(design, options, std::move(raster), clearance);
  ToolPosition at;
  std::vector<Pass> batch;
  for (std::ptrdiff_t first = 0; first < job.passes(); first += kPassesAtATime) {
    const std::ptrdiff_t size = std::min(kPassesAtATime, job.passes() - first);
    batch.assign(static_cast<std::size_t>(size), {});
    const auto pass = [&](std::ptrdiff_t i) -> Pass& { return batch[static_cast<std::size_t>(i)]; };
    oneapi::tbb::parallel_for(std::ptrdiff_t{0}, size, [&](std::ptrdiff_t i) {
      if (run.stopped()) return;
      DropCutter cutter = job.cutter();
      pass(i) = job.plan(first + i, cutter);
    });
    if (run.stopped()) return fail(kCancelled, "stopped while milling; no program was written");
    if (first == 0) {
      GcodeWriter plunge;
      job.write_plunge(plunge, job.start(pass(0), 0));
      put(file, report, plunge);
      at = job.start(pass(0), 0);
    }
    oneapi::tbb::parallel_for(std::ptrdiff_t{0}, size, [&](std::ptrdiff_t i) {
      const ToolPosition from = i > 0 ? job.end(pass(i - 1), first + i - 1) : at;
      const double feed = first + i > 0 ? options.feed.value() : options.plunge_feed.value();
      pass(i).text = GcodeWriter(from, 1, feed);
      job.write_pass(pass(i).text, pass(i), first + i);
    });
    for (std::ptrdiff_t i = 0; i < size; ++i) {
      put(file, report, pass(i).text);
      count(report, pass(i));
    }
    at = job.end(pass(size - 1), first + size - 1);
    MAQUETTE_TRY_VOID(
        check_travel('z', mm_of_ticks(clearance) - report.lowest_tip_mm, options.travel_z));
    run.progress(static_cast<double>(first + size) / static_cast<double>(job.passes()));
  }

  GcodeWriter tail(at, 1, options.feed.value());
  tail.rapid({ToolPosition::kUnknown, ToolPosition::kUnknown, clearance});
  tail.line(fmt::format("(cut {:.1f} mm in {:.1f} min, tip z {:.4f} .. {:.4f} mm)",
                        report.path_length_mm, report.cutting_time_min, report.lowest_tip_mm,
                        report.highest_tip_mm));
  tail.line(
      fmt::format("(gouge of the written path at most {:.5f} mm)", report.certified_gouge_mm));
  tail.line("M5");
  tail.line("M30");
  put(file, report, tail);
  MAQUETTE_TRY_VOID(file.commit());
  return report;
}

}  // namespace maquette::cnc

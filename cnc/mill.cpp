// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/mill.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "cnc/pass_sampler.hpp"
#include "cnc/program.hpp"
#include "cnc/raster.hpp"
#include "core/check.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;

bool positive(double v) {
  return std::isfinite(v) && v > 0.0;
}

/// What may stay above the stated scallop, and whose scallop that is.
Result<void> check_excess(const MillOptions& o) {
  const double excess = o.excess_limit.value(), stated = o.stated_stepover.value();
  if (!std::isnan(stated)) {
    if (std::isnan(excess))
      return fail(kMillOptionOutOfRange,
                  "stated_stepover is what excess_limit counts from; give an excess_limit too");
    if (!(stated >= o.stepover.value() && stated <= o.ball_diameter.value()))
      return fail(kMillOptionOutOfRange,
                  fmt::format("stated_stepover is {} mm; it must be from the stepover, {} mm, to "
                              "the ball's diameter, {} mm",
                              stated, o.stepover.value(), o.ball_diameter.value()));
  }
  if (std::isnan(excess)) return {};
  if (!(excess >= o.tolerance.value() && excess <= 1.0))
    return fail(kMillOptionOutOfRange,
                fmt::format("excess_limit is {} mm; it must be from the tolerance, {} mm, to 1 mm",
                            excess, o.tolerance.value()));
  if (!raster_frame({}, o.direction).along_an_axis())
    return fail(kMillOptionOutOfRange,
                "excess_limit holds for passes along an axis; take 0 or 90 degrees");
  return {};
}

Result<void> check_ranges(const MillOptions& o) {
  const double diameter = o.ball_diameter.value();
  if (!positive(diameter))
    return fail(kToolNotPositive,
                fmt::format("ball_diameter is {} mm; it must be greater than 0", diameter));
  if (!std::isfinite(o.direction.value()))
    return fail(kMillOptionOutOfRange, "direction of the passes is not a number");
  const double least = raster_frame({}, o.direction).step_mm();
  if (!(o.stepover.value() >= least * (1.0 - 1e-9)) || !(o.stepover <= o.ball_diameter))
    return fail(kStepoverOutOfRange,
                fmt::format("stepover is {} mm; it must be at least {:.4f} mm and at most the "
                            "ball's diameter, {} mm",
                            o.stepover.value(), least, diameter));
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
  const auto check_length = [](const char* name, Millimetres value, double most) -> Result<void> {
    if (value.value() >= 0.0 && value.value() <= most) return {};
    return fail(kMillOptionOutOfRange,
                fmt::format("{} is {} mm; it must be from 0 to {}", name, value.value(), most));
  };
  MAQUETTE_TRY_VOID(check_length("clearance", o.clearance, 1e4));
  MAQUETTE_TRY_VOID(check_length("lead_radius", o.lead_radius, 100.0));
  if (!std::isnan(o.stock_allowance.value()))
    MAQUETTE_TRY_VOID(check_length("stock_allowance", o.stock_allowance, 1e4));
  if (!(o.scallop_limit.value() > 0.0 && o.scallop_limit.value() <= 0.5 * diameter))
    return fail(kMillOptionOutOfRange,
                fmt::format("scallop_limit is {} mm; it must be greater than 0 and at most the "
                            "ball's radius, {} mm",
                            o.scallop_limit.value(), 0.5 * diameter));
  if (!(o.overrun.value() >= 0.0 && o.overrun.value() <= 0.3 * diameter + 0.001))
    return fail(
        kMillOptionOutOfRange,
        fmt::format("overrun is {} mm; it must be from 0 to 0.6 of the ball's radius, {} mm",
                    o.overrun.value(), 0.3 * diameter));
  return check_excess(o);
}

Result<void> check_heights(const ModelField& field, const char* what) {
  for (std::ptrdiff_t r = 0; r < field.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < field.z_mm.cols(); ++c)
      if (!std::isfinite(field.z_mm(r, c)))
        return fail(kHeightNotFinite,
                    fmt::format("height of the {} is {} at row {}, column {} (x = {} mm, y = {} "
                                "mm); fill voids before milling",
                                what, field.z_mm(r, c), r, c, field.x_mm(c), field.y_mm(r)));
  return {};
}

std::vector<std::string> head_comments(const ModelField& design, const MillOptions& o,
                                       heightmap::HeightRange heights) {
  const double width = design.x_mm(design.z_mm.cols() - 1) - design.x0.value();
  const double depth = design.y_mm(design.z_mm.rows() - 1) - design.y0.value();
  const double first = std::isnan(o.first_y_mm) ? 0.0 : o.first_y_mm - design.y0.value();
  const double last = std::isnan(o.last_y_mm) ? depth : o.last_y_mm - design.y0.value();
  return {
      "frame of the model, x east, y north, z up",
      "finishing only, remove the rough stock first",
      fmt::format("stepover {} mm, scallop on flat ground {:.4f} mm", o.stepover.value(),
                  scallop_mm({0.5 * o.ball_diameter.value()}, o.stepover.value())),
      head_line(share_tolerance(o.tolerance)),
      fmt::format("design x {} .. {} y {} .. {} z {} .. {} mm, nodes {} mm apart",
                  design.x0.value(), design.x0.value() + width, design.y0.value(),
                  design.y0.value() + depth, heights.min, heights.max, design.spacing.value()),
      fmt::format("at least {:.1f} min of cutting, what it came to stands at the end",
                  width * (last - first) / o.stepover.value() / o.feed.value()),
  };
}

}  // namespace

Millimetres border_overrun(const ModelField& design, BallNose tool) {
  constexpr double kMostShare = 0.6;
  const Grid<float>& z = design.z_mm;
  const std::ptrdiff_t rows = z.rows(), cols = z.cols();
  double outward = 0.0;  // sine of the steepest fall outwards
  const auto facet = [&](double along_x, double along_y, double to_outside) {
    const double d = design.spacing.value(), fall = -to_outside / d;
    if (fall > 0.0)
      outward = std::max(outward,
                         fall / std::sqrt(1.0 + (along_x * along_x + along_y * along_y) / (d * d)));
  };
  const auto cell = [&](std::ptrdiff_t r, std::ptrdiff_t c, int out_x, int out_y) {
    const double z00 = static_cast<double>(z(r, c)), z10 = static_cast<double>(z(r, c + 1)),
                 z01 = static_cast<double>(z(r + 1, c)), z11 = static_cast<double>(z(r + 1, c + 1));
    facet(z10 - z00, z11 - z10, out_x * (z10 - z00) + out_y * (z11 - z10));
    facet(z11 - z01, z01 - z00, out_x * (z11 - z01) + out_y * (z01 - z00));
  };
  // As far in as the ball that touches them is beyond the outline.
  const auto deep =
      static_cast<std::ptrdiff_t>(std::ceil(kMostShare * tool.radius_mm / design.spacing.value()));
  for (std::ptrdiff_t r = 0; r + 1 < rows; ++r)
    for (std::ptrdiff_t k = 0; k < std::min(deep, cols - 1); ++k) {
      cell(r, k, -1, 0);
      cell(r, cols - 2 - k, 1, 0);
    }
  for (std::ptrdiff_t c = 0; c + 1 < cols; ++c)
    for (std::ptrdiff_t k = 0; k < std::min(deep, rows - 1); ++k) {
      cell(k, c, 0, -1);
      cell(rows - 2 - k, c, 0, 1);
    }
  return Millimetres{std::ceil(1000.0 * tool.radius_mm * std::min(outward, kMostShare)) / 1000.0};
}

std::string head_line(const ToleranceShares& shares) {
  return fmt::format("gouge of the path at most {:.4f} mm, with blending {:.4f} in space",
                     shares.gouge_mm, shares.gouge_mm + shares.blending_mm);
}

Result<void> check_mill(const ModelField& design, const MillOptions& o) {
  MAQUETTE_CHECK(design.z_mm.rows() >= 2 && design.z_mm.cols() >= 2 && design.spacing.value() > 0.0,
                 "{} x {} nodes, {} mm apart", design.z_mm.rows(), design.z_mm.cols(),
                 design.spacing.value());
  MAQUETTE_TRY_VOID(check_ranges(o));
  const double bottom = design.y0.value(), top = design.y_mm(design.z_mm.rows() - 1);
  const double first = std::isnan(o.first_y_mm) ? bottom : o.first_y_mm;
  const double last = std::isnan(o.last_y_mm) ? top : o.last_y_mm;
  // A caller's band limits may differ from the field's by rounding, not by more.
  if (!(first <= last && first >= bottom - kTick_mm && last <= top + kTick_mm))
    return fail(kMillOptionOutOfRange,
                fmt::format("passes are asked for from y = {} to {} mm; the design spans {} to {}",
                            first, last, bottom, top));
  MAQUETTE_TRY_VOID(check_heights(design, "design"));
  if (o.stock != nullptr) MAQUETTE_TRY_VOID(check_heights(*o.stock, "stock"));
  return {};
}

Result<MillReport> mill(const ModelField& design, const MillOptions& options,
                        const std::filesystem::path& program_path, const RunContext& run) {
  MAQUETTE_TRY_VOID(check_mill(design, options));
  const heightmap::HeightRange heights = heightmap::height_range(design.z_mm);
  float top = heights.max;
  if (options.stock != nullptr)
    top = std::max(top, heightmap::height_range(options.stock->z_mm).max);
  const double allowance =
      std::isnan(options.stock_allowance.value()) ? 0.0 : options.stock_allowance.value();
  ProgramOptions program;
  program.post = options.post;
  program.name = options.program_name;
  program.work_offset = options.work_offset;
  program.relative = options.relative;
  program.blending = Millimetres{share_tolerance(options.tolerance).blending_mm};
  program.safe_z = Millimetres{
      std::ceil((static_cast<double>(top) + allowance + options.clearance.value()) * 1000.0) /
      1000.0};
  program.entry_feed = options.plunge_feed;
  program.max_lines = options.max_lines;
  program.max_bytes = options.max_bytes;
  program.comments = head_comments(design, options, heights);
  MAQUETTE_TRY(auto writer, ProgramWriter::create(program_path, program));
  Tool tool;
  tool.name = fmt::format("ball nose {} mm", options.ball_diameter.value());
  tool.cutter = Cutter::ball(0.5 * options.ball_diameter.value());
  writer.tool(tool, options.spindle_rpm);
  MAQUETTE_TRY(auto report,
               mill_passes(
                   design, options, [&](const Toolpath& piece) { return writer.add(piece); }, run));
  writer.comment(fmt::format("cut {:.1f} mm in {:.1f} min, tip z {:.4f} .. {:.4f} mm",
                             report.path_length_mm, report.cutting_time_min, report.lowest_tip_mm,
                             report.highest_tip_mm));
  writer.comment(fmt::format("gouge of the path at most {:.5f} mm", report.certified_gouge_mm));
  MAQUETTE_TRY(auto written, writer.commit());
  report.blocks = written.blocks;
  report.bytes = written.bytes;
  report.files = std::move(written.files);
  return report;
}

}  // namespace maquette::cnc

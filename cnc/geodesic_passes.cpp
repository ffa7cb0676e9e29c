// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/geodesic_passes.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include "cnc/cover_gaps.hpp"
#include "cnc/cutter_location.hpp"
#include "cnc/surface_path.hpp"
#include "core/run_part.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;

constexpr double kFarthest = 0.65;  // of a stepover, from the surface to the path
constexpr double kSamplesAStepover = 12.0;
constexpr double kMostSlow = 3.0;     // how much nearer curves come in hollows
constexpr double kMostHollow = 2.0;   // to strokes; what is sharper is a crease, not a hollow
constexpr double kChordError = 0.05;  // of a stepover: curves are reduced to chords

MillOptions raster_options(const GeodesicPassOptions& o) {
  MillOptions m;
  m.ball_diameter = o.ball_diameter;
  m.tolerance = o.tolerance;
  m.feed = o.feed;
  m.plunge_feed = o.plunge_feed;
  m.clearance = o.clearance;
  m.stock_allowance = o.stock_allowance;
  if (std::isnan(o.scallop_limit.value()))
    m.stepover = o.stepover;
  else
    m.scallop_limit = o.scallop_limit;
  return m;
}

/// Exact cutter locations at the design's nodes and at equal steps between them.
ModelField tips_of(const ModelField& design, BallNose tool, std::ptrdiff_t steps,
                   const RunContext& run) {
  ModelField tips;
  tips.spacing = Millimetres{design.spacing.value() / static_cast<double>(steps)};
  tips.x0 = design.x0;
  tips.y0 = design.y0;
  tips.z_mm =
      Grid<float>((design.z_mm.rows() - 1) * steps + 1, (design.z_mm.cols() - 1) * steps + 1);
  oneapi::tbb::enumerable_thread_specific<DropCutter> cutters(
      DropCutter(design, Cutter::ball(tool.radius_mm)));
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, tips.z_mm.rows(), [&](std::ptrdiff_t r) {
    if (run.stopped()) return;
    DropCutter& cutter = cutters.local();
    for (std::ptrdiff_t c = 0; c < tips.z_mm.cols(); ++c)
      tips.z_mm(r, c) = static_cast<float>(cutter.drop(tips.x_mm(c), tips.y_mm(r)).tip_mm);
  });
  return tips;
}

PlanPlace rounded(double x_mm, double y_mm) {
  return {static_cast<std::int32_t>(std::lround(1e3 * x_mm)),
          static_cast<std::int32_t>(std::lround(1e3 * y_mm))};
}

}  // namespace

Result<GeodesicPassReport> geodesic_passes(const ModelField& design,
                                           const GeodesicPassOptions& options,
                                           const ToolpathSink& sink, const RunContext& run) {
  MAQUETTE_TRY_VOID(check_mill(design, raster_options(options)));
  const BallNose tool{0.5 * options.ball_diameter.value()};
  const bool constant_scallop = !std::isnan(options.scallop_limit.value());
  GapLimits limits;
  limits.hollows_count = constant_scallop;
  limits.most_hollow = kMostHollow;
  double stepover = options.stepover.value();
  if (constant_scallop) {
    limits.ridge_mm = options.scallop_limit.value();
    // Half the samples' distance is what the prediction adds.
    limits.distance_mm = 0.5 * centre_distance_of_ridge_mm(tool, limits.ridge_mm) /
                         (1.0 + 0.5 / (kFarthest * kSamplesAStepover));
    stepover = limits.distance_mm / kFarthest;
  } else {
    limits.distance_mm = kFarthest * stepover;
    limits.ridge_mm = ridge_mm(tool, 2.0 * limits.distance_mm);
  }
  limits.sampling_mm = stepover / kSamplesAStepover;

  std::ptrdiff_t steps = 1;
  while (design.spacing.value() / static_cast<double>(steps) > 0.5 * stepover * (1.0 + 1e-9))
    steps *= 2;
  const double nodes = static_cast<double>((design.z_mm.rows() - 1) * steps + 1) *
                       static_cast<double>((design.z_mm.cols() - 1) * steps + 1);
  if (nodes >= 0x1p30)
    return fail(kStepoverOutOfRange,
                fmt::format("curves {} mm apart need a field of {:.0f} nodes; at most {:.0f} are "
                            "possible, so take a larger stepover or cut the part in bands",
                            stepover, nodes, 0x1p30));

  GeodesicPassReport report;
  report.field_nodes = static_cast<std::uint64_t>(nodes);
  report.stepover_mm = stepover;
  report.scallop_flat_mm = ridge_mm(tool, stepover);
  report.shares = share_tolerance(options.tolerance);
  const auto cancelled = [] {
    return fail(kCancelled, "stopped while planning geodesic passes; no program was written");
  };

  const ModelField tips = tips_of(design, tool, steps, run);
  run.progress(0.1);
  meshing::GeodesicSources sources;
  std::vector<PlanCurve> ways;
  // The outline is cut in any case: what the ball touches from there it touches from nowhere else.
  const PlanPlace low = rounded(tips.x0.value(), tips.y0.value());
  const PlanPlace high = rounded(tips.x_mm(tips.z_mm.cols() - 1), tips.y_mm(tips.z_mm.rows() - 1));
  ways.push_back({{low, {high.x, low.y}, high, {low.x, high.y}, low}, 1});
  if (options.start.empty()) {
    meshing::add_outline(sources, tips);
  } else {
    MAQUETTE_TRY_VOID(meshing::add_polyline(sources, tips, options.start));
    PlanCurve line;
    for (const meshing::PlanPoint& p : options.start)
      line.places.push_back(rounded(p.x_mm, p.y_mm));
    if (line.places.size() > 1) ways.push_back(std::move(line));
  }
  if (run.stopped()) return cancelled();

  std::vector<LevelCurve> curves;
  {
    std::vector<float> slowness;
    meshing::GeodesicOptions geodesic;
    if (constant_scallop) {
      slowness.resize(tips.z_mm.cells().size());
      oneapi::tbb::parallel_for(std::ptrdiff_t{0}, tips.z_mm.rows(), [&](std::ptrdiff_t r) {
        for (std::ptrdiff_t c = 0; c < tips.z_mm.cols(); ++c)
          slowness[static_cast<std::size_t>(r * tips.z_mm.cols() + c)] = static_cast<float>(
              std::min(kMostSlow, std::sqrt(hollow_factor(tips, r, c, tool.radius_mm))));
      });
      geodesic.slowness = slowness;
    }
    ModelField distance;
    distance.spacing = tips.spacing;
    distance.x0 = tips.x0;
    distance.y0 = tips.y0;
    MAQUETTE_TRY(distance.z_mm,
                 meshing::geodesic_distance(tips, sources, geodesic, part(run, 0.1, 0.4)));
    curves = level_curves(distance, stepover, stepover, kChordError * stepover, stepover, run);
  }
  report.curves = curves.size();
  std::vector<PlanCurve> joined = link_spirals(curves, 2.0 * stepover, kChordError * stepover);
  curves = {};
  std::move(joined.begin(), joined.end(), std::back_inserter(ways));
  report.pieces = ways.size();
  // Gaps are looked for beside what will be cut, to the last micrometre.
  const PlanBox box = box_within(design);
  for (PlanCurve& way : ways) way = writable(way, box);
  if (run.stopped()) return cancelled();
  run.progress(0.5);

  GapReport gaps = cover_gaps(tips, tool, ways, limits, run);
  if (run.stopped()) return cancelled();
  report.strokes = gaps.strokes.size();
  report.scallop = std::move(gaps.scallop);
  std::move(gaps.strokes.begin(), gaps.strokes.end(), std::back_inserter(ways));
  run.progress(0.6);

  SurfacePathOptions cutting;
  cutting.tool = tool;
  cutting.tolerance = options.tolerance;
  cutting.feed = options.feed;
  cutting.plunge_feed = options.plunge_feed;
  cutting.clearance = options.clearance;
  cutting.stock_allowance = options.stock_allowance;
  MAQUETTE_TRY(const SurfacePathReport cut,
               cut_along(design, ways, cutting, sink, part(run, 0.6, 1.0)));
  report.links_cut = cut.links_cut;
  report.links_flown = cut.links_flown;
  report.points_sampled = cut.points_sampled;
  report.lines = cut.figures.lines;
  report.path_length_mm = cut.figures.cutting_length_mm;
  report.rapid_length_mm = cut.figures.rapid_length_mm;
  report.cutting_time_min = cut.figures.cutting_time_min;
  report.shortest_move_mm = cut.figures.shortest_cut_mm;
  report.highest_block_rate_per_s = cut.figures.highest_rate_per_s;
  report.lowest_tip_mm = mm_of_ticks(cut.figures.lowest_cut);
  report.highest_tip_mm = mm_of_ticks(cut.figures.highest_cut);
  report.certified_gouge_mm = cut.bounds.gouge_mm;
  report.certified_excess_mm = cut.bounds.excess_mm;
  return report;
}

}  // namespace maquette::cnc

// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/rest.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <vector>

#include <fmt/format.h>
#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include "cnc/cutter_location.hpp"
#include "cnc/fit_moves.hpp"
#include "cnc/linking.hpp"
#include "cnc/pass_sampler.hpp"
#include "cnc/piece_order.hpp"
#include "cnc/steepness.hpp"
#include "core/check.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;

constexpr std::size_t kPassesAtATime = 256;
/// What the first ball may leave above the map between its passes and by its own tolerance.
constexpr double kRidges_mm = 0.1;

Result<void> check(const RestOptions& o) {
  const auto range = [](const char* name, double value, double least, double most,
                        const char* unit) -> Result<void> {
    if (value >= least && value <= most) return {};
    return fail(kRestOptionOutOfRange, fmt::format("{} is {} {}; it must be from {} to {}", name,
                                                   value, unit, least, most));
  };
  MAQUETTE_TRY_VOID(range("ball_radius", o.ball_radius_mm, 0.05, 100.0, "mm"));
  MAQUETTE_TRY_VOID(range("stepover", o.stepover_mm, 0.001, 2.0 * o.ball_radius_mm, "mm"));
  MAQUETTE_TRY_VOID(range("overlap", o.overlap_mm, 0.0, 100.0, "mm"));
  MAQUETTE_TRY_VOID(range("depth", o.depth_mm, 0.01, 1000.0, "mm"));
  MAQUETTE_TRY_VOID(range("tolerance", o.tolerance_mm, 0.001, 1.0, "mm"));
  MAQUETTE_TRY_VOID(range("feed", o.feed_mm_min, 0.01, 1e6, "mm/min"));
  MAQUETTE_TRY_VOID(range("plunge_feed", o.plunge_feed_mm_min, 0.01, 1e6, "mm/min"));
  MAQUETTE_TRY_VOID(range("clearance", o.clearance_mm, 0.0, 1e4, "mm"));
  return {};
}

/// Nodes within `reach` cells of one that has more than `least` on it.
Grid<std::uint8_t> around(const Grid<float>& remaining, double least, double reach) {
  const std::ptrdiff_t rows = remaining.rows(), cols = remaining.cols();
  const auto n = static_cast<std::ptrdiff_t>(reach);
  const auto far = static_cast<std::int32_t>(n + 1);
  Grid<std::int32_t> beside(rows, cols, far);  // to the nearest one of the row
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
    const auto pass = [&](std::ptrdiff_t c, std::int32_t& away) {
      away = static_cast<double>(remaining(r, c)) > least ? 0 : std::min(far, away + 1);
      beside(r, c) = std::min(beside(r, c), away);
    };
    std::int32_t away = far;
    for (std::ptrdiff_t c = 0; c < cols; ++c) pass(c, away);
    away = far;
    for (std::ptrdiff_t c = cols; c-- > 0;) pass(c, away);
  });
  Grid<std::uint8_t> near(rows, cols, 0);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t i = std::max<std::ptrdiff_t>(0, r - n); i <= std::min(rows - 1, r + n); ++i)
      for (std::ptrdiff_t c = 0; c < cols; ++c) {
        const double a = beside(i, c), b = static_cast<double>(i - r);
        if (a * a + b * b <= reach * reach) near(r, c) = 1;
      }
  });
  return near;
}

std::int64_t unit_below(double mm) {
  return static_cast<std::int64_t>(std::floor(mm / (kTick_mm * kResolution) + 1e-6));
}
std::int64_t unit_above(double mm) {
  return static_cast<std::int64_t>(std::ceil(mm / (kTick_mm * kResolution) - 1e-6));
}

/// Along x at y; all in units of kResolution.
struct Row {
  std::int64_t y, from, to;
};

/// A row as it is cut, and how it is reached: along y at `from` from the row before, or flown to.
struct Pass {
  Row row;
  bool joined = false;
  std::int64_t y_before = 0;
  std::vector<FittedMove> join, moves;
  double gouge_mm = 0.0;
};

class Rest {
 public:
  Rest(const ModelField& design, const RestMap& map, const RestOptions& o)
      : design_(design),
        map_(map),
        o_(o),
        tool_{o.ball_radius_mm},
        cutter_(design, Cutter::ball(o.ball_radius_mm)),
        tiles_(design, tool_),
        cutters_([this] { return DropCutter(cutter_); }),
        shares_(share_tolerance(Millimetres{o.tolerance_mm})),
        x0_(unit_above(design.x0.value())),
        x1_(unit_below(design.x_mm(design.z_mm.cols() - 1))),
        y0_(unit_above(design.y0.value())),
        y1_(unit_below(design.y_mm(design.z_mm.rows() - 1))) {}

  [[nodiscard]] std::vector<Row> rows(double least_mm) const {
    const double d = design_.spacing.value();
    // A row is within half a spacing of the nodes that decide for it.
    const double reach = (o_.ball_radius_mm + o_.overlap_mm) / d + 1.0;
    const Grid<std::uint8_t> wanted = around(map_.remaining.z_mm, least_mm, reach);
    const std::int64_t apart = std::max<std::int64_t>(1, unit_below(o_.stepover_mm));
    std::vector<Row> found;
    for (std::int64_t y = y0_; y <= y1_; y = y == y1_ ? y + 1 : std::min(y + apart, y1_)) {
      const double y_mm = mm_of_ticks(y * kResolution);
      const std::ptrdiff_t r = std::clamp<std::ptrdiff_t>(
          std::llround((y_mm - design_.y0.value()) / d), 0, wanted.rows() - 1);
      std::ptrdiff_t begin = -1;
      for (std::ptrdiff_t c = 0; c <= wanted.cols(); ++c) {
        if (c < wanted.cols() && wanted(r, c) != 0) {
          if (begin < 0) begin = c;
        } else if (begin >= 0) {
          const std::int64_t from = std::max(x0_, unit_above(design_.x_mm(begin)));
          const std::int64_t to = std::min(x1_, unit_below(design_.x_mm(c - 1)));
          if (from < to) found.push_back({y, from, to});
          begin = -1;
        }
      }
    }
    return found;
  }

  /// The nearest end next; a neighbouring row begins where the one before ended.
  [[nodiscard]] std::vector<Pass> ordered(const std::vector<Row>& rows) const {
    PieceOrder order(static_cast<double>(x0_), static_cast<double>(y0_), static_cast<double>(x1_),
                     static_cast<double>(y1_), 5.0 / (kTick_mm * kResolution));
    for (const Row& r : rows)
      order.add(static_cast<double>(r.from), static_cast<double>(r.y), static_cast<double>(r.to),
                static_cast<double>(r.y));
    std::vector<Pass> passes;
    const auto near = static_cast<double>(4 * unit_below(o_.stepover_mm) +
                                          unit_below(2.0 * design_.spacing.value()));
    std::int64_t x = x0_, y = y0_;
    while (order.left() > 0) {
      const auto end = order.take_nearest(static_cast<double>(x), static_cast<double>(y));
      Pass pass;
      pass.row = rows[end.piece];
      if (end.last) std::swap(pass.row.from, pass.row.to);
      if (!passes.empty() && pass.row.y != y &&
          std::hypot(static_cast<double>(pass.row.from - x), static_cast<double>(pass.row.y - y)) <=
              near)
        join(passes.back(), pass);
      x = pass.row.to, y = pass.row.y;
      passes.push_back(pass);
    }
    return passes;
  }

  /// Straight across from the end of the row before; whichever row would be cut short by it is
  /// made longer instead.
  static void join(Pass& before, Pass& pass) {
    const std::int64_t gap = pass.row.from - before.row.to;
    const auto same_way = [](std::int64_t a, std::int64_t b) { return (a > 0) == (b > 0); };
    if (gap == 0 || same_way(gap, pass.row.to - pass.row.from)) {
      pass.row.from = before.row.to;
    } else if (same_way(gap, before.row.to - before.row.from)) {
      before.row.to = pass.row.from;
    } else {
      return;
    }
    pass.joined = true;
    pass.y_before = before.row.y;
  }

  void plan(Pass& pass) {
    const Row& row = pass.row;
    if (pass.joined) fit({row_line(row.from), pass.y_before, row.y}, pass.join, pass);
    fit({{0, row.y * kResolution, kResolution, 0}, row.from, row.to}, pass.moves, pass);
  }

  [[nodiscard]] LatticeLine row_line(std::int64_t x) const {
    return {x * kResolution, 0, 0, kResolution};
  }

 private:
  struct Line {
    LatticeLine line;
    std::int64_t from, to;
  };
  void fit(const Line& cut, std::vector<FittedMove>& moves, Pass& pass) {
    std::vector<PathSample> samples;
    sample_line(cutters_.local(), tiles_, design_, tool_, cut.line, std::min(cut.from, cut.to),
                std::max(cut.from, cut.to),
                {shares_.sampling_mm, dip_share(o_.arcs) * o_.tolerance_mm}, samples);
    FitLimits limits;
    limits.gouge_mm = shares_.sampling_mm + shares_.fitting_mm;
    limits.excess_mm = shares_.excess_mm;
    limits.arcs = o_.arcs;
    const FitBounds bounds = fit_moves(samples, cut.line.step_mm(), limits, moves);
    pass.gouge_mm = std::max(pass.gouge_mm, bounds.gouge_mm);
    if (cut.from > cut.to) reverse_moves(moves);
  }

  const ModelField& design_;
  const RestMap& map_;
  const RestOptions& o_;
  BallNose tool_;
  DropCutter cutter_;
  SteepnessTiles tiles_;
  oneapi::tbb::enumerable_thread_specific<DropCutter> cutters_;
  ToleranceShares shares_;
  std::int64_t x0_, x1_, y0_, y1_;
};

/// What the first ball leaves, as a surface.
ModelField standing(const ModelField& design, const RestMap& map) {
  ModelField left = design;
  for (std::size_t i = 0; i < left.z_mm.cells().size(); ++i)
    left.z_mm.cells()[i] += map.remaining.z_mm.cells()[i] + static_cast<float>(kRidges_mm);
  return left;
}

}  // namespace

Result<RestReport> rest_finish(const ModelField& design, const RestMap& map,
                               const RestOptions& options, const ToolpathSink& sink,
                               const RunContext& run) {
  MAQUETTE_CHECK(map.remaining.z_mm.rows() == design.z_mm.rows() &&
                     map.remaining.z_mm.cols() == design.z_mm.cols(),
                 "map of {} x {} nodes for a design of {} x {}", map.remaining.z_mm.rows(),
                 map.remaining.z_mm.cols(), design.z_mm.rows(), design.z_mm.cols());
  MAQUETTE_TRY_VOID(check(options));
  RestReport report;
  if (map.highest_mm <= map.threshold_mm) return report;
  const ModelField left = standing(design, map);
  const LinkSurface surface =
      CutterClearance(left, Cutter::ball(options.ball_radius_mm)).for_thread();
  const double highest =
      static_cast<double>(*std::max_element(left.z_mm.cells().begin(), left.z_mm.cells().end()));
  const std::int64_t safe = unit_above(highest + options.clearance_mm) * kResolution;
  Rest rest(design, map, options);

  ToolPosition at;
  const auto layers = static_cast<std::int64_t>(std::ceil(map.highest_mm / options.depth_mm));
  for (std::int64_t layer = layers - 1; layer >= 0; --layer) {
    const double above = static_cast<double>(layer) * options.depth_mm;
    const std::int64_t raise = unit_above(above) * kResolution;
    std::vector<Pass> passes = rest.ordered(rest.rows(std::max(above, map.threshold_mm)));
    if (passes.empty()) continue;
    ++report.layers;
    for (std::size_t first = 0; first < passes.size(); first += kPassesAtATime) {
      const std::size_t end = std::min(passes.size(), first + kPassesAtATime);
      oneapi::tbb::parallel_for(first, end, [&](std::size_t i) {
        if (!run.stopped()) rest.plan(passes[i]);
      });
      if (run.stopped()) return fail(kCancelled, "stopped while planning the rest");
      Toolpath path;
      path.start = at;
      for (std::size_t i = first; i < end; ++i) {
        Pass& pass = passes[i];
        for (auto* moves : {&pass.join, &pass.moves})
          for (FittedMove& m : *moves) m.z += raise;
        const Row& row = pass.row;
        const ToolPosition begin{row.from * kResolution, row.y * kResolution, pass.moves.front().z};
        if (at.x == ToolPosition::kUnknown) path.start = {begin.x, begin.y, safe};
        if (pass.joined) {
          append_fitted(path, rest.row_line(row.from), pass.join, options.feed_mm_min);
          ++report.links_cut;
        } else {
          append_link(path, begin, surface,
                      {options.clearance_mm, 1.0, options.plunge_feed_mm_min});
          ++report.links_flown;
        }
        append_fitted(path, {0, begin.y, kResolution, 0}, pass.moves, options.feed_mm_min);
        report.certified_gouge_mm = std::max(report.certified_gouge_mm, pass.gouge_mm);
        ++report.passes;
        at = end_of(path);
        pass = {};
      }
      if (layer == 0 && end == passes.size()) {
        PathMove up;
        up.kind = PathMove::Kind::rapid;
        up.to = {at.x, at.y, std::max(safe, at.z)};
        path.moves.push_back(up);
        at = up.to;
      }
      ToolPosition from = path.start;
      for (const PathMove& m : path.moves) {
        if (m.kind != PathMove::Kind::rapid)
          report.cutting_length_mm +=
              std::hypot(mm_of_ticks(m.to.x - from.x), mm_of_ticks(m.to.y - from.y),
                         mm_of_ticks(m.to.z - from.z));
        from = m.to;
      }
      report.moves += path.moves.size();
      MAQUETTE_TRY_VOID(sink(path));
    }
    run.progress(static_cast<double>(layers - layer) / static_cast<double>(layers));
  }
  return report;
}

}  // namespace maquette::cnc

// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/surface_path.hpp"

#include <algorithm>
#include <cmath>
#include <optional>

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include "cnc/fit_lines.hpp"
#include "cnc/linking.hpp"
#include "cnc/piece_order.hpp"
#include "core/check.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;

constexpr double kLongestLine_mm = 20.0;  // longer ones are parted, to share the work
constexpr double kApproach_mm = 1.0;
constexpr std::size_t kLinesAtATime = 16384, kLinesATask = 64;

struct Cut {
  AimedLine aimed;
  bool by_air = false;  // the cutter flies to its start
};

struct Planned {
  std::vector<FittedMove> moves;
  FitBounds bounds;
  std::uint64_t sampled = 0;
};

class Cutting {
 public:
  Cutting(const ModelField& design, const SurfacePathOptions& o)
      : design_(design),
        options_(o),
        shares_(share_tolerance(o.tolerance)),
        tiles_(design, o.tool),
        cutters_(DropCutter(design, Cutter::ball(o.tool.radius_mm))) {
    area_ = box_within(design);
    const bool known = !std::isnan(o.stock_allowance.value());
    const double allowance = known ? o.stock_allowance.value() : 0.0;
    const double highest =
        static_cast<double>(heightmap::height_range(design.z_mm).max) + allowance;
    safe_z_ = static_cast<std::int64_t>(std::ceil((highest + o.clearance.value()) * 1000.0)) *
              kResolution;
    if (known) {
      clearance_.emplace(design, Cutter::ball(o.tool.radius_mm));
      obstacles_ = clearance_->for_thread();
      obstacles_.tip_mm = [tip = obstacles_.tip_mm, allowance](double x, double y) {
        return tip(x, y) + allowance;
      };
    } else {
      obstacles_ = {1e3, [highest](double, double) { return highest; }};
    }
    link_ = {o.clearance.value(),
             known ? std::min(kApproach_mm, o.clearance.value()) : o.clearance.value(),
             o.plunge_feed.value()};
  }

  Result<SurfacePathReport> run(std::span<const PlanCurve> ways, const ToolpathSink& sink,
                                const RunContext& run) {
    PieceOrder order(1e-3 * area_.left, 1e-3 * area_.bottom, 1e-3 * area_.right, 1e-3 * area_.top,
                     5.0);
    std::uint64_t total = 0, done = 0;
    for (const PlanCurve& way : ways) {
      const PlanPlace a = clamped(way.places.front()), b = clamped(way.places.back());
      order.add(1e-3 * a.x, 1e-3 * a.y, 1e-3 * b.x, 1e-3 * b.y);
      total += way.places.size();
    }
    PlanPlace at = clamped(ways.front().places.front());
    bool first = true;
    while (order.left() > 0) {
      const PieceOrder::End end = order.take_nearest(1e-3 * at.x, 1e-3 * at.y);
      const std::vector<PlanPlace>& places = ways[end.piece].places;
      const auto place = [&](std::size_t i) {
        return clamped(places[end.last ? places.size() - 1 - i : i]);
      };
      const PlanPlace start = place(0);
      bool by_air = first || std::hypot(start.x - at.x, start.y - at.y) > 1e3 * kLongestCutLink_mm;
      if (!first) ++(by_air ? report_.links_flown : report_.links_cut);
      if (by_air) at = start;
      first = false;
      for (std::size_t i = by_air ? 1 : 0; i < places.size(); ++i) {
        go(at, place(i), by_air);
        if (cuts_.size() >= kLinesAtATime) MAQUETTE_TRY_VOID(flush(sink, run));
      }
      done += places.size();
      run.progress(static_cast<double>(done) / static_cast<double>(total));
    }
    last_ = true;
    MAQUETTE_TRY_VOID(flush(sink, run));
    return report_;
  }

 private:
  [[nodiscard]] PlanPlace clamped(PlanPlace p) const {
    return {std::clamp(p.x, area_.left, area_.right), std::clamp(p.y, area_.bottom, area_.top)};
  }

  /// Adds lines from `at` to `to`; moves `at` there.
  void go(PlanPlace& at, PlanPlace to, bool& by_air) {
    while (!(at == to)) {
      AimedLine aimed = aim(at, to, area_);
      const auto most = static_cast<std::int64_t>(kLongestLine_mm / aimed.line.step_mm());
      aimed.steps = std::min(aimed.steps, most);
      cuts_.push_back({aimed, by_air});
      by_air = false;
      at = aimed.end();
    }
  }

  Result<void> flush(const ToolpathSink& sink, const RunContext& run) {
    std::vector<Planned> planned(cuts_.size());
    const std::size_t tasks = (cuts_.size() + kLinesATask - 1) / kLinesATask;
    oneapi::tbb::parallel_for(std::size_t{0}, tasks, [&](std::size_t task) {
      if (run.stopped()) return;
      std::vector<std::vector<PathSample>> samples;
      const std::size_t end = std::min(cuts_.size(), (task + 1) * kLinesATask);
      for (std::size_t i = task * kLinesATask; i < end;) {
        std::size_t next = i + 1;
        while (next < end && !cuts_[next].by_air) ++next;
        plan(std::span(cuts_).subspan(i, next - i), samples, &planned[i]);
        i = next;
      }
    });
    if (run.stopped()) return fail(kCancelled, "stopped while milling; no program was written");
    Toolpath path;
    path.start = at_;
    for (std::size_t i = 0; i < cuts_.size(); ++i) append(path, cuts_[i], planned[i]);
    cuts_.clear();
    if (last_ && cnc::end_of(path).x != ToolPosition::kUnknown) {
      PathMove up;
      up.kind = PathMove::Kind::rapid;
      up.to = cnc::end_of(path);
      up.to.z = std::max(up.to.z, safe_z_);
      path.moves.push_back(up);
    }
    if (path.moves.empty()) return {};
    at_ = cnc::end_of(path);
    report_.figures.add(path);
    return sink(path);
  }

  /// Lines that follow each other; between them the path may pass anywhere in the tolerance.
  void plan(std::span<const Cut> cuts, std::vector<std::vector<PathSample>>& samples,
            Planned* out) {
    samples.resize(std::max(samples.size(), cuts.size()));
    std::vector<SampledLine> lines;
    for (std::size_t i = 0; i < cuts.size(); ++i) {
      sample_line(cutters_.local(), tiles_, design_, options_.tool, cuts[i].aimed.line, 0,
                  cuts[i].aimed.steps,
                  {shares_.sampling_mm, dip_share(false) * options_.tolerance.value()}, samples[i]);
      lines.push_back({samples[i], cuts[i].aimed.line.step_mm()});
      out[i].sampled = samples[i].size();
    }
    FitLimits limits;
    limits.gouge_mm = shares_.sampling_mm + shares_.fitting_mm;
    limits.excess_mm = shares_.excess_mm;
    limits.arcs = false;  // curves hardly ever run along an axis
    std::vector<std::vector<FittedMove>> moves;
    out->bounds = fit_lines(lines, limits, moves);
    for (std::size_t i = 0; i < cuts.size(); ++i) out[i].moves = std::move(moves[i]);
  }

  void append(Toolpath& path, const Cut& cut, const Planned& planned) {
    const ToolPosition start{cut.aimed.line.x, cut.aimed.line.y, planned.moves.front().z};
    const ToolPosition at = cnc::end_of(path);
    if (cut.by_air) {
      if (at.x == ToolPosition::kUnknown) path.start = {start.x, start.y, safe_z_};
      append_link(path, start, obstacles_, link_);
    } else {
      MAQUETTE_CHECK(at.x == start.x && at.y == start.y, "({}, {}) and ({}, {}) do not meet", at.x,
                     at.y, start.x, start.y);
      if (at.z != start.z) {  // lifted there by different walls
        PathMove move;
        move.to = start;
        move.feed_mm_min = options_.plunge_feed.value();
        path.moves.push_back(move);
      }
    }
    append_fitted(path, cut.aimed.line, planned.moves, options_.feed.value());
    report_.points_sampled += planned.sampled;
    report_.bounds.gouge_mm = std::max(report_.bounds.gouge_mm, planned.bounds.gouge_mm);
    report_.bounds.excess_mm = std::max(report_.bounds.excess_mm, planned.bounds.excess_mm);
  }

  const ModelField& design_;
  const SurfacePathOptions& options_;
  ToleranceShares shares_;
  SteepnessTiles tiles_;
  oneapi::tbb::enumerable_thread_specific<DropCutter> cutters_;
  std::optional<CutterClearance> clearance_;
  LinkSurface obstacles_;
  LinkOptions link_;
  PlanBox area_;
  std::int64_t safe_z_ = 0;
  std::vector<Cut> cuts_;
  ToolPosition at_;  // where the last piece handed over ended
  bool last_ = false;
  SurfacePathReport report_;
};

}  // namespace

Result<SurfacePathReport> cut_along(const ModelField& design, std::span<const PlanCurve> ways,
                                    const SurfacePathOptions& options, const ToolpathSink& sink,
                                    const RunContext& run) {
  MAQUETTE_CHECK(!ways.empty(), "nothing to cut");
  return Cutting(design, options).run(ways, sink, run);
}

}  // namespace maquette::cnc

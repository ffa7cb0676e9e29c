// SPDX-License-Identifier: GPL-3.0-or-later

// Works on batches of neighbouring passes: plan them (parallel), see where passes must be added
// (parallel), put all in order, add links (parallel), hand over. Nothing depends on threads.

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>

#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include "cnc/linking.hpp"
#include "cnc/mill.hpp"
#include "cnc/raster_plan.hpp"
#include "core/check.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;

constexpr std::size_t kPassesAtATime = 64;
constexpr double kApproach_mm = 1.0;
constexpr std::size_t kLooksAgain = 3;  // for what rows leave as they are written beside cuts

/// How the tool gets to a cut, and both as a path.
struct Piece : PlannedCut {
  std::vector<LineSegment> link;  // along the surface
  bool by_air = false;            // else by `link`, or it starts where the one before ended
  ToolPosition before;            // where the one before ended; unknown: the first
  Toolpath path;
};

/// Over what stands: the stock, or the design and an allowance.
double highest_of(const ModelField& design, const MillOptions& o) {
  double highest = static_cast<double>(heightmap::height_range(design.z_mm).max);
  if (o.stock != nullptr)
    return std::max(highest, static_cast<double>(heightmap::height_range(o.stock->z_mm).max));
  return std::isnan(o.stock_allowance.value()) ? highest : highest + o.stock_allowance.value();
}

/// A flight costs about as much as cutting on for as long as the plunge takes, and a little.
double air_worth_mm(const ModelField& design, const MillOptions& o) {
  const bool known = o.stock != nullptr || !std::isnan(o.stock_allowance.value());
  const double lowest = static_cast<double>(heightmap::height_range(design.z_mm).min);
  const double plunge =
      known ? kApproach_mm : 0.5 * (highest_of(design, o) - lowest) + o.clearance.value();
  return 10.0 + plunge * o.feed.value() / o.plunge_feed.value();
}

class Milling {
 public:
  Milling(const ModelField& design, const MillOptions& o)
      : options_(o),
        tool_{0.5 * o.ball_diameter.value()},
        air_worth_mm_(air_worth_mm(design, o)),
        planner_(design, o, air_worth_mm_),
        area_(planner_.area()),
        frame_(planner_.frame()),
        shares_(share_tolerance(o.tolerance)),
        scallop_(design, o.scallop_limit.value(), 2.0 * o.stepover.value()),
        highest_mm_(highest_of(design, o)) {
    if (o.stock != nullptr) {
      clearance_.emplace(stock_clearance(*o.stock, design, Cutter::ball(tool_.radius_mm)));
    } else if (!std::isnan(o.stock_allowance.value())) {
      allowance_mm_ = o.stock_allowance.value();
      clearance_.emplace(design, Cutter::ball(tool_.radius_mm));
    }
    safe_z_ = static_cast<std::int64_t>(std::ceil((highest_mm_ + o.clearance.value()) * 1000.0)) *
              kResolution;
  }

  Result<MillReport> run(const ToolpathSink& sink, const RunContext& run) {
    const std::vector<RasterRow> rows = raster_rows(frame_, area_, options_.stepover.value());
    report_.passes = rows.size();
    report_.shares = shares_;
    report_.direction_deg =
        std::atan2(static_cast<double>(frame_.dy), static_cast<double>(frame_.dx)) * 180.0 /
        std::numbers::pi;
    report_.scallop_flat_mm = ridge_mm(tool_, options_.stepover.value());
    forwards_ = options_.zigzag || !options_.climb;

    std::vector<Piece> pieces;
    // Rows at an angle end a stepover or more apart along the outline: cut it first.
    if (!frame_.along_an_axis())
      for (PlannedCut& side : planner_.outline())
        pieces.push_back({std::move(side), {}, false, {}, {}});
    // Rows that wait for the gaps on both their sides; gap i lies behind row i.
    std::vector<PlannedRow> waiting;
    std::vector<PlannedGap> gaps;
    struct Round {
      std::size_t written = 0, looked_at = 0;  // rows, gaps
    };
    std::array<Round, kLooksAgain> rounds;
    RowCare care_before;
    // By what both gaps ask for.
    const auto care_of = [&](std::size_t i) {
      RowCare care = i > 0 ? gaps[i - 1].for_b : care_before;
      if (i < gaps.size()) {
        const RowCare& more = gaps[i].for_a;
        care.cuts.insert(care.cuts.end(), more.cuts.begin(), more.cuts.end());
        care.closer.insert(care.closer.end(), more.closer.begin(), more.closer.end());
      }
      return care;
    };
    const auto rows_in_parallel = [&](std::size_t from, std::size_t to, const auto& work) {
      in_parallel(to - from, run, [&](std::size_t i) { work(from + i); });
    };
    for (std::size_t first = 0; first < rows.size(); first += kPassesAtATime) {
      const std::size_t size = std::min(kPassesAtATime, rows.size() - first);
      const bool last = first + size == rows.size();
      const std::size_t old = waiting.size(), known = gaps.size();
      waiting.resize(old + size);
      rows_in_parallel(old, old + size, [&](std::size_t i) {
        waiting[i] = planner_.plan_row(rows[first + i - old]);
      });
      gaps.resize(waiting.size() - 1);
      rows_in_parallel(known, gaps.size(), [&](std::size_t i) {
        gaps[i] = planner_.plan_gap(waiting[i], waiting[i + 1]);
      });
      // Rows that know both their gaps are written, gaps that know both their rows looked at.
      std::size_t ready = last ? waiting.size() : waiting.size() - 1;
      for (Round& round : rounds) {
        rows_in_parallel(round.written, ready, [&](std::size_t i) {
          planner_.write_with_care(waiting[i], care_of(i), false);
        });
        round.written = ready;
        const std::size_t sure = std::max<std::size_t>(ready, 1) - 1;
        rows_in_parallel(round.looked_at, sure, [&](std::size_t i) {
          planner_.look_again(waiting[i], waiting[i + 1], gaps[i]);
        });
        round.looked_at = sure;
        ready = last ? waiting.size() : sure;
      }
      rows_in_parallel(
          0, ready, [&](std::size_t i) { planner_.write_with_care(waiting[i], care_of(i), true); });
      if (run.stopped()) return fail(kCancelled, "stopped while milling; no program was written");
      for (std::size_t i = 0; i < ready; ++i) {
        PlannedRow& row = waiting[i];
        report_.side_cuts += row.care.cuts.size();
        std::vector<PlannedCut> ways = std::move(row.with_care);
        if (ways.empty()) ways.push_back(std::move(row.cut));
        put_in_order(ways, pieces);
        if (i == gaps.size()) break;
        count_gap(row, waiting[i + 1], gaps[i]);
        report_.extra_passes += gaps[i].added.size();
        put_in_order(gaps[i].added, pieces);
      }
      if (ready > 0 && !last) care_before = std::move(gaps[ready - 1].for_b);
      waiting.erase(waiting.begin(), waiting.begin() + static_cast<std::ptrdiff_t>(ready));
      gaps.erase(gaps.begin(),
                 gaps.begin() + static_cast<std::ptrdiff_t>(std::min(ready, gaps.size())));
      for (Round& round : rounds) {
        round.written -= ready;
        round.looked_at -= std::min(round.looked_at, ready);
      }
      connect(pieces);
      in_parallel(pieces.size(), run,
                  [&](std::size_t i) { assemble(pieces[i], last && i + 1 == pieces.size()); });
      if (run.stopped()) return fail(kCancelled, "stopped while milling; no program was written");
      for (Piece& piece : pieces) {
        count(piece);
        MAQUETTE_TRY_VOID(sink(piece.path));
      }
      pieces.clear();
      run.progress(static_cast<double>(first + size) / static_cast<double>(rows.size()));
    }
    report_.lines = figures_.lines;
    report_.arcs = figures_.arcs;
    report_.path_length_mm = figures_.cutting_length_mm;
    report_.rapid_length_mm = figures_.rapid_length_mm;
    report_.cutting_time_min = figures_.cutting_time_min;
    report_.shortest_move_mm = figures_.shortest_cut_mm;
    report_.highest_block_rate_per_s = figures_.highest_rate_per_s;
    report_.lowest_tip_mm = mm_of_ticks(figures_.lowest_cut);
    report_.highest_tip_mm = mm_of_ticks(figures_.highest_cut);
    report_.certified_gouge_mm = bounds_.gouge_mm;
    report_.certified_excess_mm = bounds_.excess_mm;
    report_.scallop = std::move(scallop_).finish();
    return report_;
  }

 private:
  template <class Work>
  static void in_parallel(std::size_t size, const RunContext& run, const Work& work) {
    oneapi::tbb::parallel_for(std::size_t{0}, size, [&](std::size_t i) {
      if (!run.stopped()) work(i);
    });
  }

  // ---- order and links ---------------------------------------------------------------------

  /// Appends what lies side by side, each row in the direction whose turn it is.
  void put_in_order(std::vector<PlannedCut>& added, std::vector<Piece>& pieces) {
    for (std::size_t i = 0; i < added.size();) {
      std::size_t end = i;
      while (end < added.size() && added[end].across == added[i].across) ++end;
      if (!forwards_) {
        std::reverse(added.begin() + static_cast<std::ptrdiff_t>(i),
                     added.begin() + static_cast<std::ptrdiff_t>(end));
        for (std::size_t k = i; k < end; ++k) added[k].turn_round();
      }
      for (; i < end; ++i) pieces.push_back({std::move(added[i]), {}, false, {}, {}});
      if (options_.zigzag) forwards_ = !forwards_;
    }
  }

  /// Decides how each piece is reached.
  void connect(std::vector<Piece>& pieces) {
    for (Piece& piece : pieces) {
      piece.before = end_;
      const ToolPosition start = piece.end_at(false);
      piece.by_air = true;
      if (start.x == end_.x && start.y == end_.y) {
        piece.by_air = false;
      } else if (options_.zigzag && row_) {
        piece.link = link_inside(frame_, area_, row_->across, row_->cut_to, piece.across,
                                 piece.cut.from, air_worth_mm_);
        piece.by_air = piece.link.empty();
      }
      end_ = piece.end_at(true);
      const LatticeLine line = frame_.row(piece.across);
      if (piece.cut.line.x == line.x && piece.cut.line.y == line.y)
        row_ = {piece.across, piece.cut.to};
      else
        row_.reset();  // on the outline
    }
  }

  /// Outwards where a cut starts or ends on the design's outline; {0, 0} elsewhere.
  [[nodiscard]] std::array<std::int64_t, 2> outwards(const ToolPosition& at) const {
    const bool whole = std::isnan(options_.first_y_mm) && std::isnan(options_.last_y_mm);
    const std::int64_t x = at.x == area_.left ? -1 : at.x == area_.right ? 1 : 0;
    const std::int64_t y = !whole ? 0 : at.y == area_.bottom ? -1 : at.y == area_.top ? 1 : 0;
    if (frame_.dx == 0 && y != 0) return {0, y};
    if (x != 0) return {x, 0};
    return {0, y};
  }

  /// Quarter circle between a place on the outline, level there, and a radius out and up.
  void append_lead(Toolpath& path, const ToolPosition& on_surface, bool in) const {
    const std::int64_t r = lead_ticks();
    const auto [nx, ny] = outwards(on_surface);
    if (r == 0 || (nx == 0 && ny == 0)) return;
    PathMove move;
    move.kind = PathMove::Kind::arc;
    move.plane = nx != 0 ? ArcPlane::zx : ArcPlane::yz;
    move.to = in ? on_surface : lead_place(on_surface);
    (nx != 0 ? move.i : move.j) = in ? -(nx + ny) * r : 0;
    move.k = in ? 0 : r;
    // The arc hangs below its centre: towards +x clockwise seen from +y, towards +y the other way.
    const bool forwards = (nx + ny > 0) != in;
    move.counter_clockwise = forwards == (nx == 0);
    move.feed_mm_min = in ? options_.plunge_feed.value() : options_.feed.value();
    path.moves.push_back(move);
  }
  [[nodiscard]] std::int64_t lead_ticks() const {
    return std::llround(options_.lead_radius.value() * 1000.0) * kResolution;
  }
  [[nodiscard]] ToolPosition lead_place(const ToolPosition& on_surface) const {
    const auto [nx, ny] = outwards(on_surface);
    const std::int64_t r = lead_ticks();
    if (nx == 0 && ny == 0) return on_surface;
    return {on_surface.x + nx * r, on_surface.y + ny * r, on_surface.z + r};
  }

  void assemble(Piece& piece, bool last) {
    Toolpath& path = piece.path;
    const ToolPosition start = piece.end_at(false);
    const double feed = options_.feed.value();
    if (piece.by_air) {
      const ToolPosition to = lead_place(start);
      if (piece.before.x == ToolPosition::kUnknown) {
        path.start = {to.x, to.y, std::max(safe_z_, to.z)};
      } else {
        path.start = piece.before;
        append_lead(path, piece.before, false);
      }
      LinkSurface& surface = surfaces_.local();
      if (!surface.tip_mm) surface = obstacles();
      // Above a block whose height is not known better, from the clearance plane on.
      const double approach = clearance_ ? std::min(kApproach_mm, options_.clearance.value())
                                         : options_.clearance.value();
      append_link(path, to, surface,
                  {options_.clearance.value(), approach, options_.plunge_feed.value()});
      append_lead(path, start, true);
    } else {
      path.start = piece.before;
      for (const LineSegment& segment : piece.link) {
        const PlannedCut link = planner_.plan(segment, 0);
        meet(path, link.end_at(false));
        append_fitted(path, segment.line, link.moves, feed);
        piece.sampled += link.sampled;
        piece.bounds.gouge_mm = std::max(piece.bounds.gouge_mm, link.bounds.gouge_mm);
        piece.bounds.excess_mm = std::max(piece.bounds.excess_mm, link.bounds.excess_mm);
      }
      meet(path, start);
    }
    append_fitted(path, piece.cut.line, piece.moves, feed);
    if (last) {
      append_lead(path, end_of(path), false);
      ToolPosition up = end_of(path);
      up.z = std::max(up.z, safe_z_);
      PathMove move;
      move.kind = PathMove::Kind::rapid;
      move.to = up;
      path.moves.push_back(move);
    }
    piece.moves = {};
  }

  /// Of the calling thread.
  [[nodiscard]] LinkSurface obstacles() const {
    if (!clearance_) return {1e3, [highest = highest_mm_](double, double) { return highest; }};
    LinkSurface surface = clearance_->for_thread();
    if (allowance_mm_ > 0.0)
      surface.tip_mm = [tip = surface.tip_mm, up = allowance_mm_](double x, double y) {
        return tip(x, y) + up;
      };
    return surface;
  }

  /// Lines that end at one place may have been lifted there by different walls.
  void meet(Toolpath& path, const ToolPosition& start) const {
    const ToolPosition at = end_of(path);
    MAQUETTE_CHECK(at.x == start.x && at.y == start.y, "({}, {}) and ({}, {}) do not meet", at.x,
                   at.y, start.x, start.y);
    if (at.z == start.z) return;
    PathMove move;
    move.to = start;
    move.feed_mm_min = options_.plunge_feed.value();
    path.moves.push_back(move);
  }

  // ---- figures -------------------------------------------------------------------------------

  void count_gap(const PlannedRow& a, const PlannedRow& b, const PlannedGap& gap) {
    const LatticeLine middle = frame_.row((a.row.across + b.row.across) / 2);
    const double step = frame_.step_mm();
    const double area = step * static_cast<double>(b.row.across - a.row.across) * step *
                        static_cast<double>(planner_.grain());
    for (std::size_t i = 0; i < gap.ridges.size(); ++i) {
      const std::int64_t m = (gap.first_index + static_cast<std::int64_t>(i)) * planner_.grain();
      scallop_.add(middle.x_mm(m), middle.y_mm(m), gap.ridges[i], area);
    }
  }

  void count(const Piece& piece) {
    report_.points_sampled += piece.sampled;
    if (piece.before.x != ToolPosition::kUnknown) {
      if (piece.by_air)
        ++report_.links_flown;
      else
        ++report_.links_cut;
    }
    bounds_.gouge_mm = std::max(bounds_.gouge_mm, piece.bounds.gouge_mm);
    bounds_.excess_mm = std::max(bounds_.excess_mm, piece.bounds.excess_mm);
    figures_.add(piece.path);
  }

  const MillOptions& options_;
  BallNose tool_;
  double air_worth_mm_;
  RasterPlanner planner_;
  RasterArea area_;
  RasterFrame frame_;
  ToleranceShares shares_;
  ScallopCollector scallop_;
  double highest_mm_, allowance_mm_ = 0.0;
  oneapi::tbb::enumerable_thread_specific<LinkSurface> surfaces_;
  std::optional<CutterClearance> clearance_;  // nothing: what stands is not known
  std::int64_t safe_z_ = 0;

  struct RowEnd {
    std::int64_t across, cut_to;
  };
  bool forwards_ = true;
  ToolPosition end_;           // of the last piece put in order
  std::optional<RowEnd> row_;  // the same on the raster
  FitBounds bounds_;
  PathFigures figures_;
  MillReport report_;
};

}  // namespace

ToleranceShares share_tolerance(Millimetres tolerance) {
  const double t = tolerance.value();
  ToleranceShares s;
  s.gouge_mm = 0.5 * t;
  s.blending_mm = 0.1 * t;
  s.excess_mm = t - s.blending_mm;
  s.sampling_mm = 0.18 * t;
  // Short of the gouge: who reads the program back rounds otherwise, and holds it to just that.
  s.fitting_mm = 0.49 * t - s.sampling_mm;
  return s;
}

Result<MillReport> mill_passes(const ModelField& design, const MillOptions& options,
                               const ToolpathSink& sink, const RunContext& run) {
  MAQUETTE_TRY_VOID(check_mill(design, options));
  return Milling(design, options).run(sink, run);
}

}  // namespace maquette::cnc

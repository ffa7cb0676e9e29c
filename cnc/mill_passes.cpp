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

#include "cnc/fit_moves.hpp"
#include "cnc/linking.hpp"
#include "cnc/mill.hpp"
#include "cnc/raster.hpp"
#include "core/check.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;

constexpr std::size_t kPassesAtATime = 64;
constexpr double kAddedOverlap_mm = 1.0;  ///< added passes reach this far beyond where they must
constexpr int kMostHalvings = 3;
constexpr double kApproach_mm = 1.0;

std::int64_t tick_inside_from(double mm) {
  return static_cast<std::int64_t>(std::ceil(mm * 1000.0 - 1e-4)) * kResolution;
}
std::int64_t tick_inside_to(double mm) {
  return static_cast<std::int64_t>(std::floor(mm * 1000.0 + 1e-4)) * kResolution;
}

RasterArea area_of(const ModelField& design, const MillOptions& o) {
  const double bottom = design.y0.value(), top = design.y_mm(design.z_mm.rows() - 1);
  RasterArea area;
  area.left = tick_inside_from(design.x0.value());
  area.right = tick_inside_to(design.x_mm(design.z_mm.cols() - 1));
  area.bottom =
      tick_inside_from(std::isnan(o.first_y_mm) ? bottom : std::max(bottom, o.first_y_mm));
  area.top = tick_inside_to(std::isnan(o.last_y_mm) ? top : std::min(top, o.last_y_mm));
  area.top = std::max(area.top, area.bottom);
  return area;
}

/// One line cut, and how the tool gets to it.
struct Piece {
  LineSegment cut;
  std::int64_t across = 0;        // its row
  std::vector<FittedMove> moves;  // in the order of cutting
  std::vector<LineSegment> link;  // along the surface
  bool by_air = false;            // else by `link`, or it starts where the one before ended
  ToolPosition before;            // where the one before ended; unknown: the first
  FitBounds bounds;
  std::uint64_t sampled = 0;
  Toolpath path;

  [[nodiscard]] ToolPosition end_at(bool last) const {
    const FittedMove& m = last ? moves.back() : moves.front();
    return {cut.line.x + m.place * cut.line.dx, cut.line.y + m.place * cut.line.dy, m.z};
  }
};

/// A row and its heights every `grain` places: index g is place g * grain.
struct Row {
  RasterRow row;
  Piece piece;
  std::int64_t first_index = 0;
  std::vector<float> tips;
};

/// Between two rows.
struct Gap {
  std::vector<double> ridges;  // from `first_index` on
  std::int64_t first_index = 0;
  std::vector<Piece> added;  // by row, then along it
};

class Milling {
 public:
  Milling(const ModelField& design, const MillOptions& o)
      : design_(design),
        options_(o),
        tool_{0.5 * o.ball_diameter.value()},
        area_(area_of(design, o)),
        frame_(raster_frame(area_, o.direction)),
        tiles_(design, tool_),
        cutters_(DropCutter(design, Cutter::ball(tool_.radius_mm))),
        shares_(share_tolerance(o.tolerance)),
        grain_(std::max<std::int64_t>(1, std::llround(design.spacing.value() / frame_.step_mm()))),
        allowed_mm_(centre_distance_of_ridge_mm(tool_, o.scallop_limit.value())),
        scallop_(design, o.scallop_limit.value(), 2.0 * o.stepover.value()) {
    double highest = static_cast<double>(heightmap::height_range(design.z_mm).max);
    if (o.stock != nullptr) {
      highest = std::max(highest, static_cast<double>(heightmap::height_range(o.stock->z_mm).max));
      clearance_.emplace(*o.stock, Cutter::ball(tool_.radius_mm));
    } else if (!std::isnan(o.stock_allowance.value())) {
      allowance_mm_ = o.stock_allowance.value();
      clearance_.emplace(design, Cutter::ball(tool_.radius_mm));
    }
    highest_mm_ = highest + allowance_mm_;
    safe_z_ = static_cast<std::int64_t>(std::ceil((highest_mm_ + o.clearance.value()) * 1000.0)) *
              kResolution;
    // A flight costs about as much as cutting on for as long as the plunge takes, and a little.
    const double lowest = static_cast<double>(heightmap::height_range(design.z_mm).min);
    const double plunge =
        clearance_ ? kApproach_mm : 0.5 * (highest_mm_ - lowest) + o.clearance.value();
    air_worth_mm_ = 10.0 + plunge * o.feed.value() / o.plunge_feed.value();
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
    if (!frame_.along_an_axis()) pieces = outline();
    Row before;
    for (std::size_t first = 0; first < rows.size(); first += kPassesAtATime) {
      const std::size_t size = std::min(kPassesAtATime, rows.size() - first);
      std::vector<Row> batch(size + 1);
      batch[0] = std::move(before);
      const bool has_before = first > 0;
      in_parallel(size, run, [&](std::size_t i) { plan_row(rows[first + i], batch[i + 1]); });
      std::vector<Gap> gaps(size);  // gap i lies before row i + 1 of the batch
      in_parallel(size, run, [&](std::size_t i) {
        if (i > 0 || has_before) plan_gap(batch[i], batch[i + 1], gaps[i]);
      });
      if (run.stopped()) return fail(kCancelled, "stopped while milling; no program was written");
      for (std::size_t i = 0; i < size; ++i) {
        if (i > 0 || has_before) count_gap(batch[i], batch[i + 1], gaps[i]);
        report_.extra_passes += gaps[i].added.size();
        put_in_order(gaps[i].added, pieces);
        std::vector<Piece> row(1);
        row[0] = std::move(batch[i + 1].piece);
        put_in_order(row, pieces);
      }
      before = std::move(batch[size]);
      const bool last = first + size == rows.size();
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
    report_.certified_gouge_mm = bounds_.gouge_mm + shares_.blending_mm;
    report_.certified_excess_mm = bounds_.excess_mm + shares_.blending_mm;
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

  // ---- cuts ------------------------------------------------------------------------------

  /// Exact cutter locations and moves of a segment; the samples stay in `samples`, ascending.
  Piece plan(const LineSegment& cut, std::int64_t across, std::vector<PathSample>& samples) {
    Piece piece;
    piece.cut = cut;
    piece.across = across;
    FitLimits limits;
    limits.gouge_mm = shares_.gouge_mm - shares_.blending_mm;
    limits.excess_mm = shares_.excess_mm - shares_.blending_mm;
    limits.arcs = options_.arcs && (cut.line.dx == 0 || cut.line.dy == 0) &&
                  std::abs(cut.line.dx + cut.line.dy) == kResolution;
    const auto [low, high] = std::minmax({cut.from, cut.to});
    sample_line(cutters_.local(), tiles_, design_, tool_, cut.line, low, high,
                {shares_.sampling_mm, dip_share(limits.arcs) * options_.tolerance.value()},
                samples);
    piece.bounds = fit_moves(samples, cut.line.step_mm(), limits, piece.moves);
    piece.sampled = samples.size();
    if (cut.from > cut.to) reverse_moves(piece.moves);
    return piece;
  }

  void plan_row(const RasterRow& row, Row& out) {
    std::vector<PathSample> samples;
    out.row = row;
    const LatticeLine line = frame_.row(row.across);
    out.piece = plan({line, row.first, row.last}, row.across, samples);
    out.first_index = row.first >= 0 ? (row.first + grain_ - 1) / grain_ : -(-row.first / grain_);
    std::size_t k = 1;
    for (std::int64_t g = out.first_index; g * grain_ <= row.last; ++g) {
      while (samples[k].place < g * grain_) ++k;
      const PathSample &a = samples[k - 1], &b = samples[k];
      const double t =
          static_cast<double>(g * grain_ - a.place) / static_cast<double>(b.place - a.place);
      out.tips.push_back(static_cast<float>(a.tip_mm + t * (b.tip_mm - a.tip_mm)));
    }
  }

  /// What the ridge will be between two rows, and what must be cut besides.
  void plan_gap(const Row& a, const Row& b, Gap& gap) {
    const auto end = [](const Row& r) {
      return r.first_index + static_cast<std::int64_t>(r.tips.size());
    };
    const std::int64_t first = std::max(a.first_index, b.first_index);
    const std::int64_t size = std::min(end(a), end(b)) - first;
    gap.first_index = first;
    if (size < 2) return;
    const auto tip = [&](const Row& r, std::int64_t i) {
      return static_cast<double>(r.tips[static_cast<std::size_t>(first + i - r.first_index)]);
    };
    const double step = frame_.step_mm();
    const double apart = step * static_cast<double>(b.row.across - a.row.across);
    std::vector<int> halved(static_cast<std::size_t>(size), 0);
    gap.ridges.resize(halved.size());
    for (std::int64_t i = 0; i < size; ++i) {
      const std::int64_t i0 = std::max<std::int64_t>(i - 1, 0), i1 = std::min(i + 1, size - 1);
      const double run = step * static_cast<double>((i1 - i0) * grain_);
      const double along = 0.5 * (tip(a, i1) - tip(a, i0) + tip(b, i1) - tip(b, i0)) / run;
      const double across = (tip(b, i) - tip(a, i)) / apart;
      const double distance = centre_distance_mm(apart, along, across);
      const auto at = static_cast<std::size_t>(i);
      if (options_.constant_scallop) halved[at] = halvings(distance, allowed_mm_, kMostHalvings);
      gap.ridges[at] = ridge_mm(tool_, std::ldexp(distance, -halved[at]));
    }
    if (options_.constant_scallop) add_passes(a, b, halved, gap);
  }

  void add_passes(const Row& a, const Row& b, const std::vector<int>& halved, Gap& gap) {
    const std::int64_t across = b.row.across - a.row.across;
    const auto places = [this](double mm) {
      return static_cast<std::int64_t>(std::ceil(mm / frame_.step_mm()));
    };
    const std::int64_t overlap = places(kAddedOverlap_mm), least = places(air_worth_mm_);
    std::vector<PathSample> samples;
    constexpr std::int64_t kParts = std::int64_t{1} << kMostHalvings;
    for (std::int64_t part = 1; part < kParts; ++part) {
      int level = kMostHalvings;  // at which this line first appears
      for (std::int64_t p = part; p % 2 == 0; p /= 2) --level;
      const std::int64_t j = a.row.across + (across * part + kParts / 2) / kParts;
      if (j <= a.row.across || j >= b.row.across) continue;
      const RasterRow row = clip_row(frame_, area_, j);
      std::optional<std::pair<std::int64_t, std::int64_t>> open;
      const auto close = [&] {
        const std::int64_t from = std::max(open->first - overlap, row.first);
        const std::int64_t to = std::min(open->second + overlap, row.last);
        if (to - from >= places(0.01))
          gap.added.push_back(plan({frame_.row(j), from, to}, j, samples));
      };
      for (std::size_t i = 0; i < halved.size(); ++i) {
        if (halved[i] < level) continue;
        const std::int64_t m = (gap.first_index + static_cast<std::int64_t>(i)) * grain_;
        if (open && m - open->second > least + 2 * overlap) {
          close();
          open.reset();
        }
        if (open)
          open->second = m;
        else
          open = {m, m};
      }
      if (open) close();
    }
  }

  /// Rows at an angle end a stepover or more apart along the outline: cut it first.
  std::vector<Piece> outline() {
    std::vector<PathSample> samples;
    std::vector<Piece> pieces;
    const std::int64_t width = (area_.right - area_.left) / kResolution,
                       depth = (area_.top - area_.bottom) / kResolution;
    if (width == 0 || depth == 0) return pieces;
    const LatticeLine bottom{area_.left, area_.bottom, kResolution, 0},
        right{area_.right, area_.bottom, 0, kResolution},
        top{area_.left, area_.top, kResolution, 0}, left{area_.left, area_.bottom, 0, kResolution};
    for (const LineSegment& side : {LineSegment{bottom, 0, width}, LineSegment{right, 0, depth},
                                    LineSegment{top, width, 0}, LineSegment{left, depth, 0}})
      pieces.push_back(plan(side, 0, samples));
    return pieces;
  }

  // ---- order and links ---------------------------------------------------------------------

  /// Appends what lies side by side, each row in the direction whose turn it is.
  void put_in_order(std::vector<Piece>& added, std::vector<Piece>& pieces) {
    for (std::size_t i = 0; i < added.size();) {
      std::size_t end = i;
      while (end < added.size() && added[end].across == added[i].across) ++end;
      if (!forwards_) {
        std::reverse(added.begin() + static_cast<std::ptrdiff_t>(i),
                     added.begin() + static_cast<std::ptrdiff_t>(end));
        for (std::size_t k = i; k < end; ++k) {
          reverse_moves(added[k].moves);
          std::swap(added[k].cut.from, added[k].cut.to);
        }
      }
      for (; i < end; ++i) pieces.push_back(std::move(added[i]));
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
      std::vector<PathSample> samples;
      for (const LineSegment& segment : piece.link) {
        const Piece link = plan(segment, 0, samples);
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

  void count_gap(const Row& a, const Row& b, const Gap& gap) {
    const LatticeLine middle = frame_.row((a.row.across + b.row.across) / 2);
    const double step = frame_.step_mm();
    const double area = step * static_cast<double>(b.row.across - a.row.across) * step *
                        static_cast<double>(grain_);
    for (std::size_t i = 0; i < gap.ridges.size(); ++i) {
      const std::int64_t m = (gap.first_index + static_cast<std::int64_t>(i)) * grain_;
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

  const ModelField& design_;
  const MillOptions& options_;
  BallNose tool_;
  RasterArea area_;
  RasterFrame frame_;
  SteepnessTiles tiles_;
  oneapi::tbb::enumerable_thread_specific<DropCutter> cutters_;
  oneapi::tbb::enumerable_thread_specific<LinkSurface> surfaces_;
  std::optional<CutterClearance> clearance_;  // nothing: what stands is not known
  ToleranceShares shares_;
  std::int64_t grain_;
  double allowed_mm_;
  ScallopCollector scallop_;
  double allowance_mm_ = 0.0, highest_mm_ = 0.0, air_worth_mm_ = 0.0;
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
  s.excess_mm = t;
  s.blending_mm = 0.05 * t;
  s.sampling_mm = 0.18 * t;
  s.fitting_mm = s.gouge_mm - s.blending_mm - s.sampling_mm;
  return s;
}

Result<MillReport> mill_passes(const ModelField& design, const MillOptions& options,
                               const ToolpathSink& sink, const RunContext& run) {
  MAQUETTE_TRY_VOID(check_mill(design, options));
  return Milling(design, options).run(sink, run);
}

}  // namespace maquette::cnc

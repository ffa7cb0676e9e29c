// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/raster_plan.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include "cnc/arc_geometry.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;

constexpr double kAddedOverlap_mm = 1.0;  // added passes reach this far beyond where they must
constexpr int kMostHalvings = 3;
// Of the tolerance: how far rows that are written closer stand above at most, and what of it
// samples may miss.
constexpr double kCloserShare = 0.1, kCloserDipShare = 0.05;
// And what the finder of side cuts is off by at most: on 2 m x 2 m of the default site, at a limit
// of 10 um, its word left 11.5 um on 34 mm^2.
constexpr double kFinderShare = 0.15;
constexpr int kRewrites = 4;
constexpr float kAsHigh_mm = 0.0005F;  // what is written again may be higher than known by this

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
  const std::int64_t over = tick_inside_from(o.overrun.value());
  // Whole stepovers, so that rows lie where they would.
  const std::int64_t stepover = std::max(kResolution, tick_inside_to(o.stepover.value()));
  const std::int64_t rows_over = (over + stepover - 1) / stepover * stepover;
  const bool along_x = raster_frame(area, o.direction).dy == 0,
             along_y = raster_frame(area, o.direction).dx == 0;
  const std::int64_t over_x = along_y ? rows_over : over, over_y = along_x ? rows_over : over;
  const bool at_bottom = area.bottom == tick_inside_from(bottom),
             at_top = area.top == tick_inside_to(top);
  area.left -= over_x;
  area.right += over_x;
  if (at_bottom) area.bottom -= over_y;
  if (at_top) area.top += over_y;
  return area;
}

/// Calls visit(place, height) for those of first, first + RowHeights::kStep, ... that the moves
/// pass, which lie in the order of their places.
template <class Visit>
void for_each_height(const std::vector<FittedMove>& moves, double step_mm, std::int64_t first,
                     Visit&& visit) {
  constexpr std::int64_t kStep = RowHeights::kStep;
  std::int64_t place = first + (moves.front().place - first + kStep - 1) / kStep * kStep;
  for (std::size_t k = 1; k < moves.size(); ++k) {
    const FittedMove &from = moves[k - 1], &to = moves[k];
    const double z0 = mm_of_ticks(from.z), rise = mm_of_ticks(to.z - from.z);
    const double run = step_mm * static_cast<double>(to.place - from.place);
    const double r = mm_of_ticks(to.radius);
    const bool over = to.shape == FittedMove::Shape::over;
    const PlanePoint centre = r > 0.0 ? centre_by_radius({run, rise}, r, !over) : PlanePoint{};
    for (; place < to.place || (k + 1 == moves.size() && place == to.place); place += kStep) {
      const double t = step_mm * static_cast<double>(place - from.place);
      double z = z0 + rise * t / run;
      if (r > 0.0) {
        const double depth = std::sqrt(std::max(0.0, r * r - (t - centre.u) * (t - centre.u)));
        z = z0 + centre.v + (over ? depth : -depth);
      }
      visit(place, static_cast<float>(z));
    }
  }
}

}  // namespace

void PlannedCut::turn_round() {
  reverse_moves(moves);
  std::swap(cut.from, cut.to);
}

RasterPlanner::RasterPlanner(const ModelField& design, const MillOptions& o, double air_worth_mm)
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
      air_worth_mm_(air_worth_mm) {
  if (!std::isnan(o.excess_limit.value()))
    finder_.emplace(design, tool_, frame_, stated_stepover(o).value(),
                    o.excess_limit.value() - kFinderShare * o.tolerance.value(),
                    SideCutFinder::Excess{kCloserShare * o.tolerance.value(), shares_.excess_mm});
}

/// From that height straight to the end, where that cuts too deep nowhere: what it leaves on its
/// way the finder of side cuts knows (and it is not in the bounds' excess).
void RasterPlanner::take_chord(PlannedCut& cut, std::int64_t from_z,
                               const std::vector<PathSample>& samples) const {
  FittedMove from = cut.moves.front(), to = cut.moves.back();
  to.shape = FittedMove::Shape::line;
  to.radius = 0;
  from.z = from_z;
  const double z0 = mm_of_ticks(from.z), run = static_cast<double>(to.place - from.place);
  const auto deeper = [&](const PathSample& s) {
    const double t = static_cast<double>(s.place - from.place) / run;
    return std::max(0.0, s.tip_mm - (z0 + t * mm_of_ticks(to.z - from.z)));
  };
  double gouge = 0.0;
  for (std::size_t k = 1; k < samples.size(); ++k)
    gouge = std::max(
        gouge, std::max(deeper(samples[k - 1]), deeper(samples[k])) + samples[k - 1].gouge_mm);
  if (gouge > shares_.sampling_mm + shares_.fitting_mm) return;
  cut.moves = {from, to};
  cut.bounds = {gouge, 0.0};
}

/// Exact cutter locations and moves of a segment; the samples stay in `samples`, ascending.
PlannedCut RasterPlanner::plan(const LineSegment& cut, std::int64_t across,
                               std::vector<PathSample>& samples, Written written) {
  PlannedCut piece;
  piece.cut = cut;
  piece.across = across;
  FitLimits limits;
  limits.gouge_mm = shares_.sampling_mm + shares_.fitting_mm;
  limits.excess_mm = shares_.excess_mm;
  // Cuts across are too short for arcs to pay for a change of plane.
  limits.arcs = options_.arcs && written != Written::across &&
                (cut.line.dx == 0 || cut.line.dy == 0) &&
                std::abs(cut.line.dx + cut.line.dy) == kResolution;
  const auto [low, high] = std::minmax({cut.from, cut.to});
  sample_line(cutters_.local(), tiles_, design_, tool_, cut.line, low, high,
              {shares_.sampling_mm, dip_share(limits.arcs) * options_.tolerance.value()}, samples);
  piece.bounds = fit_moves(samples, cut.line.step_mm(), limits, piece.moves);
  piece.sampled = samples.size();
  if (cut.from > cut.to) reverse_moves(piece.moves);  // the segment is turned already
  return piece;
}

/// Of a row, ascending: closer where it must be, with a move's end at each cut across.
PlannedCut RasterPlanner::plan_closer(const LineSegment& cut, std::int64_t across,
                                      const RowCare& care, std::vector<PathSample>& samples) {
  FitLimits limits;
  limits.gouge_mm = shares_.sampling_mm + shares_.fitting_mm;
  limits.excess_mm = shares_.excess_mm;
  limits.arcs = options_.arcs;
  const double tolerance = options_.tolerance.value();
  std::vector<PathSample> part;
  samples.clear();
  const auto add_part = [&](std::int64_t from, std::int64_t to, double dip_share,
                            double excess_mm) {
    sample_line(cutters_.local(), tiles_, design_, tool_, cut.line, from, to,
                {shares_.sampling_mm, dip_share * tolerance}, part);
    // The fit leaves the dips their room: what is added to them is taken from its own, which is
    // never less than the resolution.
    const double most = shares_.excess_mm - kCloserShare * tolerance;
    for (std::size_t k = 0; k + 1 < part.size(); ++k) {
      double& dip = part[k].dip_mm;
      dip = std::max(dip, std::min(most, dip + shares_.excess_mm - excess_mm));
    }
    if (!samples.empty()) {
      // Lifted differently on both sides: the higher one counts.
      PathSample& joint = samples.back();
      const double up = part.front().tip_mm - joint.tip_mm;
      if (up > 0.0 && samples.size() > 1) samples[samples.size() - 2].dip_mm += up;
      if (up < 0.0) part.front().dip_mm -= up;
      part.front().tip_mm = std::max(part.front().tip_mm, joint.tip_mm);
      part.front().stop = joint.stop;
      samples.pop_back();
    }
    samples.insert(samples.end(), part.begin(), part.end());
  };
  auto next = care.cuts.begin();
  const auto add = [&](std::int64_t from, std::int64_t to, double dip_share, double excess_mm) {
    while (from < to) {
      while (next != care.cuts.end() && next->place <= from) ++next;
      const bool stops = next != care.cuts.end() && next->place <= to;
      const std::int64_t end = stops ? next->place : to;
      add_part(from, end, dip_share, excess_mm);
      samples.back().stop = stops && end < cut.to;
      from = end;
    }
  };
  std::int64_t at = cut.from;
  for (const RowStretch& s : care.closer) {
    const std::int64_t from = std::max(at, s.from), to = std::min(cut.to, s.to);
    if (from >= to) continue;
    add(at, from, dip_share(limits.arcs), shares_.excess_mm);
    add(from, to, kCloserDipShare, s.excess_mm);
    at = to;
  }
  add(at, cut.to, dip_share(limits.arcs), shares_.excess_mm);
  PlannedCut piece;
  piece.cut = cut;
  piece.across = across;
  piece.bounds = fit_moves(samples, cut.line.step_mm(), limits, piece.moves);
  piece.sampled = samples.size();
  return piece;
}

PlannedCut RasterPlanner::plan(const LineSegment& cut, std::int64_t across) {
  std::vector<PathSample> samples;
  return plan(cut, across, samples);
}

PlannedRow RasterPlanner::plan_row(const RasterRow& row) {
  PlannedRow out;
  std::vector<PathSample> samples;
  out.row = row;
  const LatticeLine line = frame_.row(row.across);
  out.cut = plan({line, row.first, row.last}, row.across, samples);
  out.first_index = row.first >= 0 ? (row.first + grain_ - 1) / grain_ : -(-row.first / grain_);
  std::size_t k = 1;
  for (std::int64_t g = out.first_index; g * grain_ <= row.last; ++g) {
    while (samples[k].place < g * grain_) ++k;
    const PathSample &a = samples[k - 1], &b = samples[k];
    const double t =
        static_cast<double>(g * grain_ - a.place) / static_cast<double>(b.place - a.place);
    out.tips.push_back(static_cast<float>(a.tip_mm + t * (b.tip_mm - a.tip_mm)));
  }
  if (finder_) {
    RowHeights& heights = out.heights;
    heights = {row.across, row.first, row.last, {}, {}};
    for_each_height(out.cut.moves, frame_.step_mm(), row.first,
                    [&](std::int64_t, float z) { heights.written_mm.push_back(z); });
    k = 1;
    for (std::int64_t place = row.first; place <= row.last; place += RowHeights::kStep) {
      while (samples[k].place < place) ++k;
      const PathSample &a = samples[k - 1], &b = samples[k];
      const double t =
          static_cast<double>(place - a.place) / static_cast<double>(b.place - a.place);
      heights.exact_mm.push_back(static_cast<float>(a.tip_mm + t * (b.tip_mm - a.tip_mm)));
    }
  }
  return out;
}

std::vector<PlannedCut> RasterPlanner::plan_with_care(const RasterRow& row, const RowCare& care,
                                                      const RowHeights* known) {
  const LineSegment whole{frame_.row(row.across), row.first, row.last};
  std::vector<PathSample> samples;
  RowCare now = care;
  PlannedCut along = plan_closer(whole, row.across, now, samples);
  const double least = kCloserShare * options_.tolerance.value();
  for (int again = 0; known != nullptr && again < kRewrites; ++again) {
    const std::size_t before = now.closer.size();
    for_each_height(along.moves, frame_.step_mm(), known->first, [&](std::int64_t place, float z) {
      const std::size_t k = known->index(place);
      if (z <= known->written_mm[k] + kAsHigh_mm) return;
      const auto room = static_cast<double>(known->written_mm[k] - known->exact_mm[k]);
      now.closer.push_back({std::max(row.first, place - RowHeights::kStep),
                            std::min(row.last, place + RowHeights::kStep),
                            again + 1 < kRewrites ? std::max(least, room) : least});
    });
    if (now.closer.size() == before) break;
    arrange(now);
    along = plan_closer(whole, row.across, now, samples);
  }
  return with_cuts(std::move(along), care.cuts);
}

/// The row in pieces, and between them the way out and back of each cut.
std::vector<PlannedCut> RasterPlanner::with_cuts(PlannedCut row, const std::vector<SideCut>& cuts) {
  std::vector<PlannedCut> pieces;
  std::vector<PathSample> samples;
  std::size_t from = 0;
  const auto up_to = [&](std::size_t k) {
    PlannedCut piece;
    piece.cut = {row.cut.line, row.moves[from].place, row.moves[k].place};
    piece.across = row.across;
    piece.moves.assign(row.moves.begin() + static_cast<std::ptrdiff_t>(from),
                       row.moves.begin() + static_cast<std::ptrdiff_t>(k) + 1);
    piece.moves.front() = {row.moves[from].place, row.moves[from].z, FittedMove::Shape::line, 0};
    piece.bounds = row.bounds;
    piece.sampled = from == 0 ? row.sampled : 0;
    pieces.push_back(std::move(piece));
    from = k;
  };
  for (const SideCut& cut : cuts) {
    std::size_t k = from;
    while (row.moves[k].place != cut.place) ++k;
    if (k > from) up_to(k);
    PlannedCut out = plan({frame_.column(cut.place), row.across, cut.across}, row.across, samples,
                          Written::across);
    take_chord(out, row.moves[k].z, samples);
    PlannedCut back = out;
    back.turn_round();
    pieces.push_back(std::move(out));
    pieces.push_back(std::move(back));
  }
  if (from + 1 < row.moves.size()) up_to(row.moves.size() - 1);
  return pieces;
}

void RasterPlanner::write_with_care(PlannedRow& row, RowCare care, bool finally) {
  arrange(care);
  if (care == row.care) return;
  row.with_care.clear();
  if (!care.cuts.empty() || !care.closer.empty())
    row.with_care = plan_with_care(row.row, care, finally ? &row.heights : nullptr);
  else
    row.with_care.push_back(row.cut);
  row.care = std::move(care);
  RowHeights& heights = row.heights;
  for (const PlannedCut& piece : row.with_care)
    if (piece.cut.line.dx == frame_.dx && piece.cut.line.dy == frame_.dy)
      for_each_height(
          piece.moves, frame_.step_mm(), heights.first,
          [&](std::int64_t place, float z) { heights.written_mm[heights.index(place)] = z; });
  // What will be written once more may be written closer, but no closer than that.
  const auto closer = static_cast<float>(kCloserShare * options_.tolerance.value());
  for (std::size_t i = 0; i < heights.written_mm.size(); ++i)
    heights.written_mm[i] = std::max(heights.written_mm[i], heights.exact_mm[i] + closer);
}

void RasterPlanner::look_again(const PlannedRow& a, const PlannedRow& b, PlannedGap& gap) {
  if (finder_ && gap.ridges.size() >= 2)
    finder_->find(a.heights, b.heights, gap.known, gap.for_a, gap.for_b);
}

/// What the ridge will be between two rows, and what must be cut besides.
PlannedGap RasterPlanner::plan_gap(const PlannedRow& a, const PlannedRow& b) {
  PlannedGap gap;
  const auto end = [](const PlannedRow& r) {
    return r.first_index + static_cast<std::int64_t>(r.tips.size());
  };
  const std::int64_t first = std::max(a.first_index, b.first_index);
  const std::int64_t size = std::min(end(a), end(b)) - first;
  gap.first_index = first;
  if (size < 2) return gap;
  const auto tip = [&](const PlannedRow& r, std::int64_t i) {
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
  if (finder_) finder_->find(a.heights, b.heights, gap.known, gap.for_a, gap.for_b);
  return gap;
}

void RasterPlanner::add_passes(const PlannedRow& a, const PlannedRow& b,
                               const std::vector<int>& halved, PlannedGap& gap) {
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
std::vector<PlannedCut> RasterPlanner::outline() {
  std::vector<PathSample> samples;
  std::vector<PlannedCut> pieces;
  const std::int64_t width = (area_.right - area_.left) / kResolution,
                     depth = (area_.top - area_.bottom) / kResolution;
  if (width == 0 || depth == 0) return pieces;
  const LatticeLine bottom{area_.left, area_.bottom, kResolution, 0},
      right{area_.right, area_.bottom, 0, kResolution}, top{area_.left, area_.top, kResolution, 0},
      left{area_.left, area_.bottom, 0, kResolution};
  for (const LineSegment& side : {LineSegment{bottom, 0, width}, LineSegment{right, 0, depth},
                                  LineSegment{top, width, 0}, LineSegment{left, depth, 0}})
    pieces.push_back(plan(side, 0, samples));
  return pieces;
}

}  // namespace maquette::cnc

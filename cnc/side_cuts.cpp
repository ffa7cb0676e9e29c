// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/side_cuts.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

#include "cnc/certificate.hpp"
#include "cnc/scallop.hpp"
#include "core/check.hpp"

namespace maquette::cnc {
namespace {

constexpr double kKeptBack_mm = 0.0005;      // of the limit, for what is rounded
constexpr double kRestKeptBack_mm = 0.0005;  // where the ball rests is known to 0.01 mm only
constexpr double kRounding_mm = 0.001;       // of the end of a cut across
constexpr double kNearlyReached_mm = 0.015;  // worth looking beside
constexpr int kLooks = 3;                    // that often, each half as far
constexpr double kBesideGap_mm = 0.25;       // touching places of points whose best one is inside
// Where a ball rests is looked for on a lattice, by steps from the first down to one.
constexpr double kPlace_mm = 0.01;
constexpr std::int32_t kWidestStep = 16, kNextStep = 4;
constexpr double kLookStep_mm = 0.05;  // along rows and cuts across
constexpr double kCloser_mm = 0.05;    // a row is written closer this far either way
constexpr double kSwept_mm = 0.6;      // a cut across clears nothing farther along than this
constexpr double kOtherEnd_mm = 0.4;   // along the row, of other cuts that may clear more
constexpr std::size_t kOtherEnds = 8;  // so many are tried, about
constexpr std::int64_t kNoCut = std::numeric_limits<std::int64_t>::min();
constexpr double kShortestCut_mm = 0.01;  // the row is as good
constexpr std::int64_t kFromEnd = 100;    // places: rows begin and end on themselves
constexpr int kBlockers = 3;              // nodes around a point that are looked at first

}  // namespace

/// A point of the design, and where the ball touches it; along and across the rows.
struct SideCutFinder::Open {
  double u, v;        // of the ball
  double pu, pv, pz;  // of the point
  double allowed;     // height that may stay
  double over;        // what stays above that now

  /// Height over the point of a ball's lower side.
  [[nodiscard]] double left_by(double at_u, double at_v, double tip, double R) const {
    const double du = at_u - pu, dv = at_v - pv, q = R * R - du * du - dv * dv;
    return q > 0.0 ? tip + R - std::sqrt(q) : INFINITY;
  }
};

struct SideCutFinder::Gap {
  const RowHeights &a, &b;
  double step_mm;
  [[nodiscard]] double across_mm(const RowHeights& row) const {
    return step_mm * static_cast<double>(row.across);
  }
  /// INFINITY beyond the row's ends.
  [[nodiscard]] double height(const RowHeights& row, const std::vector<float>& heights,
                              double u) const {
    const double t = (u / step_mm - static_cast<double>(row.first)) / RowHeights::kStep;
    if (!(t >= 0.0) || t > static_cast<double>(heights.size() - 1)) return INFINITY;
    const auto i = std::min(static_cast<std::size_t>(t), heights.size() - 2);
    const double z = static_cast<double>(heights[i]);
    return z + (t - static_cast<double>(i)) * (static_cast<double>(heights[i + 1]) - z);
  }
  /// The least that a row leaves over a point, of places beside the ball's own, and where.
  struct Least {
    double left = INFINITY, u = 0.0;
  };
  [[nodiscard]] Least least(const RowHeights& row, const std::vector<float>& heights, const Open& p,
                            double R) const {
    Least least;
    const double v = across_mm(row);
    for (double off = -kLookAlong_mm; off <= kLookAlong_mm + 1e-9; off += kLookStep_mm) {
      const double left = p.left_by(p.u + off, v, height(row, heights, p.u + off), R);
      if (left < least.left) least = {left, p.u + off};
    }
    return least;
  }
  /// By both rows as they are written.
  [[nodiscard]] double left(const Open& p, double R) const {
    return std::min(least(a, a.written_mm, p, R).left, least(b, b.written_mm, p, R).left);
  }
};

/// Exact cutter locations on a lattice along and across the rows; the last ones are kept.
class SideCutFinder::CachedDrops {
 public:
  CachedDrops(const DropCutter& of, double x0, double y0, double ex, double ey)
      : cutter(of), kept_(kKept), x0_(x0), y0_(y0), ex_(ex), ey_(ey) {}

  DropCutter cutter;
  [[nodiscard]] double tip(std::int32_t i, std::int32_t j) {
    Kept& k = kept_[(static_cast<std::uint32_t>(i) * 0x9E3779B1U ^
                     static_cast<std::uint32_t>(j) * 0x85EBCA77U) >>
                    (32U - kBits)];
    if (k.i != i || k.j != j) {
      const double u = kPlace_mm * i, v = kPlace_mm * j;
      k = {i, j, cutter.drop(x0_ + u * ex_ - v * ey_, y0_ + u * ey_ + v * ex_).tip_mm};
    }
    return k.tip;
  }

 private:
  static constexpr std::uint32_t kBits = 17, kKept = std::uint32_t{1} << kBits;
  struct Kept {
    std::int32_t i = std::numeric_limits<std::int32_t>::min(), j = 0;
    double tip = 0.0;
  };
  std::vector<Kept> kept_;
  double x0_, y0_, ex_, ey_;
};

SideCutFinder::~SideCutFinder() = default;

SideCutFinder::SideCutFinder(const heightmap::ModelField& design, BallNose tool,
                             const RasterFrame& frame, double stated_stepover_mm, double limit_mm,
                             Excess written)
    : design_(design),
      R_(tool.radius_mm),
      frame_(frame),
      step_mm_(frame.step_mm()),
      stated_stepover_mm_(stated_stepover_mm),
      limit_mm_(limit_mm - kKeptBack_mm),
      written_(written),
      ex_(kTick_mm * static_cast<double>(frame.dx) / step_mm_),
      ey_(kTick_mm * static_cast<double>(frame.dy) / step_mm_),
      x0_(mm_of_ticks(frame.x0)),
      y0_(mm_of_ticks(frame.y0)),
      per_spacing_(std::max(
          1, static_cast<int>(std::ceil(design.spacing.value() / kContactsApart_mm - 1e-9)))),
      cutter_(design, Cutter::ball(R_)) {
  MAQUETTE_CHECK(frame.along_an_axis(), "rows along {}, {}", frame.dx, frame.dy);
}

/// Half a cell; heights are z00 + s along_x + t along_y.
struct SideCutFinder::Facet {
  std::ptrdiff_t row, col;
  bool lower;
  double z00, along_x, along_y;
  double to_x = 0.0, to_y = 0.0, up = 0.0;  // from a point to the tip of the ball that touches it
};

double SideCutFinder::steepest(std::ptrdiff_t row, std::ptrdiff_t col) const {
  const Grid<float>& z = design_.z_mm;
  const double z00 = z(row, col), z10 = z(row, col + 1), z01 = z(row + 1, col),
               z11 = z(row + 1, col + 1);
  const double a = (z10 - z00) * (z10 - z00) + (z11 - z10) * (z11 - z10);
  const double b = (z11 - z01) * (z11 - z01) + (z01 - z00) * (z01 - z00);
  return std::sqrt(std::max(a, b)) / design_.spacing.value();
}

/// The point (s, t) of a facet's cell, without what may stay there.
SideCutFinder::Open SideCutFinder::touch(const Facet& f, double s, double t) const {
  const double d = design_.spacing.value();
  const double px = design_.x_mm(f.col) + s * d - x0_, py = design_.y_mm(f.row) + t * d - y0_;
  const double x = px + f.to_x, y = py + f.to_y;
  Open p{};
  p.u = x * ex_ + y * ey_;
  p.v = y * ex_ - x * ey_;
  p.pu = px * ex_ + py * ey_;
  p.pv = py * ex_ - px * ey_;
  p.pz = f.z00 + s * f.along_x + t * f.along_y;
  return p;
}

/// How far the ball that touches it has to rise.
double SideCutFinder::rise(const Open& p, const Facet& f, DropCutter& cutter) const {
  const double x = x0_ + p.u * ex_ - p.v * ey_, y = y0_ + p.u * ey_ + p.v * ex_;
  return cutter.drop(x, y).tip_mm - (p.pz + f.up);
}

/// Whether the ball reaches the point or one beside it, which then takes its place.
bool SideCutFinder::reached(const Facet& f, double s, double t, DropCutter& cutter, Open& p) const {
  const double x = x0_ + p.u * ex_ - p.v * ey_, y = y0_ + p.u * ey_ + p.v * ex_;
  if (blocked(f.row, f.col, x, y, p.pz + f.up + kNearlyReached_mm)) return false;
  double least = rise(p, f, cutter);
  if (least > kNearlyReached_mm) return false;
  double step = 0.5 / per_spacing_;
  for (int look = 0; look < kLooks && least > kReachTolerance_mm; ++look, step *= 0.5) {
    const double from_s = s, from_t = t;
    for (const auto& [ds, dt] : {std::pair{step, 0.0}, {-step, 0.0}, {0.0, step}, {0.0, -step}}) {
      const double to_s = std::clamp(from_s + ds, 0.0, 1.0),
                   to_t = std::clamp(from_t + dt, 0.0, 1.0);
      if (f.lower ? to_s < to_t : to_t < to_s) continue;
      const Open q = touch(f, to_s, to_t);
      const double up = rise(q, f, cutter);
      if (up >= least) continue;
      least = up;
      p = q;
      s = to_s;
      t = to_t;
    }
  }
  return least <= kReachTolerance_mm;
}

/// Where the ball leaves least over a point that it does not touch, and how high that is: the
/// closing of the design by the ball. Looked for around its place for touching and `near`, the
/// place found before.
double SideCutFinder::rest(Open& p, PlanePoint& near, CachedDrops& drops) const {
  double least = INFINITY;
  std::int32_t best_i = 0, best_j = 0;
  const auto look = [&](std::int32_t i, std::int32_t j) {
    const double u = kPlace_mm * i, v = kPlace_mm * j;
    if (!((u - p.pu) * (u - p.pu) + (v - p.pv) * (v - p.pv) < R_ * R_)) return false;
    const double left = p.left_by(u, v, drops.tip(i, j), R_);
    if (left >= least) return false;
    least = left;
    best_i = i;
    best_j = j;
    return true;
  };
  const auto place = [](double mm) {
    return static_cast<std::int32_t>(std::lround(mm / kPlace_mm));
  };
  look(place(p.u), place(p.v));
  const bool nearer = !std::isnan(near.u) && look(place(near.u), place(near.v));
  for (std::int32_t step = nearer ? kNextStep : kWidestStep; step > 0; step /= 2)
    for (bool moved = true; moved;) {
      const std::int32_t i = best_i, j = best_j;
      moved = look(i + step, j);
      moved |= look(i, j + step);
      moved |= look(i - step, j);
      moved |= look(i, j - step);
      if (moved) continue;
      for (const auto& [di, dj] : {std::pair{1, 1}, {-1, 1}, {-1, -1}, {1, -1}})
        moved |= look(i + step * di, j + step * dj);
    }
  p.u = kPlace_mm * best_i;
  p.v = kPlace_mm * best_j;
  near = {p.u, p.v};
  return std::max(p.pz, least);
}

/// Nodes near a point stand inside the ball there: spares most of what it does not reach a drop.
bool SideCutFinder::blocked(std::ptrdiff_t row, std::ptrdiff_t col, double x, double y,
                            double tip) const {
  const Grid<float>& z = design_.z_mm;
  const double centre = tip + R_;
  for (std::ptrdiff_t r = std::max<std::ptrdiff_t>(0, row - kBlockers);
       r <= std::min(z.rows() - 1, row + 1 + kBlockers); ++r)
    for (std::ptrdiff_t c = std::max<std::ptrdiff_t>(0, col - kBlockers);
         c <= std::min(z.cols() - 1, col + 1 + kBlockers); ++c) {
      const double dx = design_.x_mm(c) - x, dy = design_.y_mm(r) - y;
      const double dz = centre - static_cast<double>(z(r, c));
      const double q = R_ * R_ - dx * dx - dy * dy;
      if (q > 0.0 && (dz <= 0.0 || dz * dz < q)) return true;
    }
  return false;
}

void SideCutFinder::open_points(const Gap& gap, CachedDrops& drops, std::vector<KnownPoint>& known,
                                std::vector<Open>& open) const {
  std::vector<KnownPoint> now;
  auto before = known.begin();
  const Grid<float>& z = design_.z_mm;
  const double d = design_.spacing.value(), va = gap.across_mm(gap.a), vb = gap.across_mm(gap.b);
  // The cells whose points the ball can touch from between the rows.
  const double u0 = step_mm_ * static_cast<double>(std::max(gap.a.first, gap.b.first)),
               u1 = step_mm_ * static_cast<double>(std::min(gap.a.last, gap.b.last));
  const auto [x_min, x_max] = std::minmax({x0_ + u0 * ex_ - va * ey_, x0_ + u1 * ex_ - va * ey_,
                                           x0_ + u0 * ex_ - vb * ey_, x0_ + u1 * ex_ - vb * ey_});
  const auto [y_min, y_max] = std::minmax({y0_ + u0 * ey_ + va * ex_, y0_ + u1 * ey_ + va * ex_,
                                           y0_ + u0 * ey_ + vb * ex_, y0_ + u1 * ey_ + vb * ex_});
  const auto cell = [d](double mm, double origin, std::ptrdiff_t nodes) {
    return std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(std::floor((mm - origin) / d)), 0,
                                      nodes - 2);
  };
  const std::ptrdiff_t c0 = cell(x_min - R_, design_.x0.value(), z.cols()),
                       c1 = cell(x_max + R_, design_.x0.value(), z.cols()),
                       r0 = cell(y_min - R_, design_.y0.value(), z.rows()),
                       r1 = cell(y_max + R_, design_.y0.value(), z.rows());
  const double share = 1.0 / per_spacing_, beside = kBesideGap_mm,
               flat = stated_scallop_mm({R_}, stated_stepover_mm_, 0.0);
  PlanePoint near{NAN, NAN};
  for (std::ptrdiff_t r = r0; r <= r1; ++r)
    for (std::ptrdiff_t c = c0; c <= c1; ++c) {
      const double z00 = z(r, c), z10 = z(r, c + 1), z01 = z(r + 1, c), z11 = z(r + 1, c + 1);
      double inside = NAN, around = NAN;  // stated scallop of the cell, and least of those around
      const auto stated = [&](bool border) {
        if (std::isnan(inside)) {
          inside = around = stated_scallop_mm({R_}, stated_stepover_mm_, steepest(r, c));
          for (std::ptrdiff_t i = std::max<std::ptrdiff_t>(0, r - 1);
               i <= std::min(z.rows() - 2, r + 1); ++i)
            for (std::ptrdiff_t j = std::max<std::ptrdiff_t>(0, c - 1);
                 j <= std::min(z.cols() - 2, c + 1); ++j)
              around =
                  std::min(around, stated_scallop_mm({R_}, stated_stepover_mm_, steepest(i, j)));
        }
        // A point between cells belongs to the least steep of them.
        return border ? around : inside;
      };
      for (const bool lower : {true, false}) {
        Facet f{r, c, lower, z00, lower ? z10 - z00 : z11 - z01, lower ? z11 - z10 : z01 - z00};
        const double gx = f.along_x / d, gy = f.along_y / d;
        const double steep = std::sqrt(1.0 + gx * gx + gy * gy);
        f.to_x = -R_ * gx / steep;
        f.to_y = -R_ * gy / steep;
        f.up = R_ / steep - R_;
        // Facets whose balls all lie outside.
        const double v_cell =
            (design_.y_mm(r) + f.to_y - y0_) * ex_ - (design_.x_mm(c) + f.to_x - x0_) * ey_;
        if (v_cell + 1.5 * d < va - beside || v_cell - 1.5 * d > vb + beside) continue;
        for (int i = 0; i <= per_spacing_; ++i)
          for (int j = lower ? i : 0; j <= (lower ? per_spacing_ : i); ++j) {
            Open p = touch(f, share * j, share * i);
            // Beyond the rows' ends there is nothing to compare with.
            if (p.v < va - beside || p.v > vb + beside || p.u < u0 || p.u > u1) continue;
            // One facet of those that share a point asks where the ball rests.
            const bool inside_gap = p.v >= va && p.v <= vb;
            const bool may_rest = i % 2 == 0 && j % 2 == 0 && (lower || i != j) &&
                                  (i != per_spacing_ || r + 2 == z.rows()) &&
                                  (j != per_spacing_ || c + 2 == z.cols());
            if (!inside_gap && !may_rest) continue;
            const double as_written =
                std::min(p.left_by(p.u, va, gap.height(gap.a, gap.a.written_mm, p.u), R_),
                         p.left_by(p.u, vb, gap.height(gap.b, gap.b.written_mm, p.u), R_));
            if (as_written <= p.pz + flat + limit_mm_) continue;
            const bool border = i == 0 || j == 0 || i == per_spacing_ || j == per_spacing_;
            const double most = stated(border) + limit_mm_;
            // What places beside it leave is dearer to look at, but spares most of the searches.
            if (as_written <= p.pz + most || gap.left(p, R_) <= p.pz + most) continue;
            const auto key =
                ((static_cast<std::uint64_t>(r) << 24U | static_cast<std::uint64_t>(c)) << 1U |
                 static_cast<std::uint64_t>(!lower))
                    << 12U |
                static_cast<std::uint64_t>(i << 6 | j);
            while (before != known.end() && before->key < key) now.push_back(*before++);
            if (before != known.end() && before->key == key) {
              p.u = before->u;
              p.v = before->v;
              p.allowed = before->allowed;
              p.pu = before->pu;
              p.pv = before->pv;
              p.pz = before->pz;
              now.push_back(*before++);
            } else {
              double height = INFINITY;
              if (inside_gap && reached(f, share * j, share * i, drops.cutter, p)) {
                height = p.pz;
              } else if (may_rest) {
                height = rest(p, near, drops) - kRestKeptBack_mm;
                if (p.v < va || p.v > vb || p.u < u0 || p.u > u1) height = INFINITY;
              }
              p.allowed = height + most;
              now.push_back({key, static_cast<float>(p.u), static_cast<float>(p.v), p.allowed, p.pu,
                             p.pv, p.pz});
            }
            if (p.allowed == INFINITY) continue;
            const double left = gap.left(p, R_);
            if (left <= p.allowed) continue;
            p.over = left - p.allowed;
            open.push_back(p);
          }
      }
    }
  now.insert(now.end(), before, known.end());
  known = std::move(now);
}

void SideCutFinder::find(const RowHeights& a, const RowHeights& b, std::vector<KnownPoint>& known,
                         RowCare& for_a, RowCare& for_b) {
  const Gap gap{a, b, step_mm_};
  std::unique_ptr<CachedDrops>& drops = drops_.local();
  if (!drops) drops = std::make_unique<CachedDrops>(cutter_, x0_, y0_, ex_, ey_);
  DropCutter& cutter = drops->cutter;
  std::vector<Open> open;
  open_points(gap, *drops, known, open);
  std::sort(open.begin(), open.end(), [](const Open& p, const Open& q) {
    if (p.u != q.u) return p.u < q.u;
    return p.v != q.v ? p.v < q.v : p.over < q.over;
  });
  std::vector<bool> done(open.size(), false);
  std::vector<std::size_t> cleared, most_cleared;
  for (const RowCare* care : {&for_a, &for_b})
    for (const SideCut& cut : care->cuts) {
      cleared.clear();
      clears(gap, cut, open, done, cutter, cleared);
      for (const std::size_t n : cleared) done[n] = true;
    }
  // What the rows clear when they are written closer.
  const std::int64_t around = std::llround(kCloser_mm / step_mm_);
  for (std::size_t n = 0; n < open.size(); ++n) {
    if (done[n]) continue;
    const Gap::Least by_a = gap.least(a, a.exact_mm, open[n], R_),
                     by_b = gap.least(b, b.exact_mm, open[n], R_);
    const bool is_a = by_a.left <= by_b.left;
    const double room = open[n].allowed - (is_a ? by_a : by_b).left;
    if (room < written_.closer_mm) continue;
    done[n] = true;
    const RowHeights& row = is_a ? a : b;
    const std::int64_t m = std::llround((is_a ? by_a : by_b).u / step_mm_);
    const RowStretch stretch{std::max(row.first, m - around), std::min(row.last, m + around),
                             std::min(room, written_.across_mm)};
    if (stretch.from < stretch.to) (is_a ? for_a : for_b).closer.push_back(stretch);
  }
  std::vector<std::size_t> order(open.size());
  for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
  std::sort(order.begin(), order.end(), [&](std::size_t p, std::size_t q) {
    return open[p].over != open[q].over ? open[p].over > open[q].over : p < q;
  });
  // Of what is left the highest is taken away first, by whichever cut nearby takes most with it.
  std::vector<std::size_t> beside;
  for (const std::size_t k : order) {
    if (done[k]) continue;
    beside.clear();
    for (std::size_t n = k; n-- > 0 && open[n].u > open[k].u - kOtherEnd_mm;)
      if (!done[n]) beside.push_back(n);
    for (std::size_t n = k + 1; n < open.size() && open[n].u < open[k].u + kOtherEnd_mm; ++n)
      if (!done[n]) beside.push_back(n);
    most_cleared.clear();
    SideCut best = cut_to(gap, open[k]);
    clears(gap, best, open, done, cutter, most_cleared);
    const std::size_t every = std::max<std::size_t>(1, beside.size() / kOtherEnds);
    for (std::size_t i = 0; i < beside.size(); i += every) {
      const SideCut other = cut_to(gap, open[beside[i]]);
      cleared.clear();
      clears(gap, other, open, done, cutter, cleared);
      if (cleared.size() <= most_cleared.size() ||
          std::find(cleared.begin(), cleared.end(), k) == cleared.end())
        continue;
      best = other;
      most_cleared.swap(cleared);
    }
    done[k] = true;
    if (best.place == kNoCut) continue;
    for (const std::size_t n : most_cleared) done[n] = true;
    (from_a(gap, best) ? for_a : for_b).cuts.push_back(best);
  }
}

/// From the nearer row to where the ball goes for a point; place kNoCut if the row is as good.
SideCut SideCutFinder::cut_to(const Gap& gap, const Open& p) const {
  const auto place_of = [this](double mm) -> std::int64_t { return std::llround(mm / step_mm_); };
  SideCut cut{0, std::clamp(place_of(p.v), gap.a.across, gap.b.across)};
  const RowHeights& row = from_a(gap, cut) ? gap.a : gap.b;
  cut.place = std::clamp(place_of(p.u), row.first + kFromEnd, row.last - kFromEnd);
  const double length = step_mm_ * std::abs(static_cast<double>(cut.across - row.across));
  if (length < kShortestCut_mm) cut.place = kNoCut;
  return cut;
}

bool SideCutFinder::from_a(const Gap& gap, const SideCut& cut) {
  return cut.across - gap.a.across <= gap.b.across - cut.across;
}

/// Which open points, in order of u, a cut clears of those not done.
void SideCutFinder::clears(const Gap& gap, const SideCut& cut, const std::vector<Open>& open,
                           const std::vector<bool>& done, DropCutter& cutter,
                           std::vector<std::size_t>& cleared) const {
  if (cut.place == kNoCut) return;
  const std::int64_t start = (from_a(gap, cut) ? gap.a : gap.b).across;
  const LatticeLine line = frame_.column(cut.place);
  const double u = step_mm_ * static_cast<double>(cut.place);
  const double length = step_mm_ * std::abs(static_cast<double>(cut.across - start));
  const int pieces = static_cast<int>(std::ceil(length / kLookStep_mm));
  const auto exact = [&](std::int64_t j) { return cutter.drop(line.x_mm(j), line.y_mm(j)).tip_mm; };
  const double from_z = exact(start), to_z = exact(cut.across);
  struct Look {
    double v, tip;
  };
  std::vector<Look> looks;
  for (int i = 1; i <= pieces; ++i) {
    const std::int64_t j = start + (cut.across - start) * i / pieces;  // the last is the end
    const double share = static_cast<double>(i) / pieces;
    double tip = to_z + kRounding_mm;
    // One line from wherever the row is written, where the ball can take it, else as near as it
    // is written.
    if (i < pieces)
      tip = std::max(
          from_z + share * (to_z - from_z) + (1.0 - share) * written_.across_mm + kRounding_mm,
          exact(j) + written_.across_mm);
    looks.push_back({step_mm_ * static_cast<double>(j), tip});
  }
  auto p = std::lower_bound(open.begin(), open.end(), u - kSwept_mm,
                            [](const Open& q, double from) { return q.u < from; });
  for (; p != open.end() && p->u < u + kSwept_mm; ++p) {
    const auto n = static_cast<std::size_t>(p - open.begin());
    if (done[n]) continue;
    if (std::any_of(looks.begin(), looks.end(),
                    [&](const Look& at) { return p->left_by(u, at.v, at.tip, R_) <= p->allowed; }))
      cleared.push_back(n);
  }
}

void arrange(RowCare& care) {
  std::sort(care.cuts.begin(), care.cuts.end(), [](const SideCut& p, const SideCut& q) {
    return p.place != q.place ? p.place < q.place : p.across < q.across;
  });
  std::sort(care.closer.begin(), care.closer.end(), [](const RowStretch& p, const RowStretch& q) {
    return p.from != q.from ? p.from < q.from : p.to < q.to;
  });
  std::vector<RowStretch> joined;
  for (const RowStretch& s : care.closer)
    if (!joined.empty() && s.from <= joined.back().to) {
      joined.back().to = std::max(joined.back().to, s.to);
      joined.back().excess_mm = std::min(joined.back().excess_mm, s.excess_mm);
    } else
      joined.push_back(s);
  care.closer = std::move(joined);
}

}  // namespace maquette::cnc

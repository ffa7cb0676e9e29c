// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/fit_moves.hpp"

#include <algorithm>
#include <cmath>
#include <span>

#include "cnc/arc_geometry.hpp"
#include "cnc/fit_lines.hpp"
#include "core/check.hpp"

namespace maquette::cnc {
namespace {

/// A cutter location in double is this exact (cutter_location.hpp).
constexpr double kExactness_mm = 1e-9;
constexpr double kUnit_mm = kTick_mm * static_cast<double>(kResolution);
/// Of the radius: near half a turn the centre hangs on the radius' last digit.
constexpr double kLongestChord = 1.95;
/// Rounding of a radius may move the arc's middle by this much at first.
constexpr double kRoundingSagitta_mm = 0.0005;
/// Arcs end where they are steeper than 3 : 1.
constexpr double kFlattest = 0.1;  // (z - centre)^2 >= this * radius^2

std::int64_t units(double mm) {
  return std::llround(mm / kUnit_mm);
}
double mm_of_units(std::int64_t u) {
  return mm_of_ticks(u * kResolution);
}

struct Point {
  double a, b;
};
using Polygon = std::vector<Point>;

/// Keeps what has na * a + nb * b >= c.
void clip(Polygon& polygon, Polygon& scratch, double na, double nb, double c) {
  scratch.clear();
  if (polygon.empty()) return;
  Point before = polygon.back();
  double d_before = na * before.a + nb * before.b - c;
  for (const Point& p : polygon) {
    const double d = na * p.a + nb * p.b - c;
    if ((d >= 0.0) != (d_before >= 0.0)) {
      const double t = d_before / (d_before - d);
      scratch.push_back({before.a + t * (p.a - before.a), before.b + t * (p.b - before.b)});
    }
    if (d >= 0.0) scratch.push_back(p);
    before = p;
    d_before = d;
  }
  std::swap(polygon, scratch);
}

class Fitter {
 public:
  Fitter(const std::vector<PathSample>& samples, double step_mm, const FitLimits& limits)
      : s_(samples), step_mm_(step_mm), limits_(limits), last_(samples.size() - 1) {}

  FitBounds run(std::vector<FittedMove>& moves) {
    moves.clear();
    z_ = up(s_.front().tip_mm);
    moves.push_back({s_.front().place, z_ * kResolution, FittedMove::Shape::line, 0});
    from_ = 0;
    while (from_ < last_) {
      const Reach reach = look_ahead();
      FittedMove move;
      std::size_t end = arc(reach, move);
      if (end == from_) end = line(reach.line, move);
      moves.push_back(move);
      z_ = move.z / kResolution;
      from_ = end;
    }
    bounds_.gouge_mm += kExactness_mm;
    bounds_.excess_mm += kExactness_mm;
    return bounds_;
  }

 private:
  struct Reach {
    std::size_t line, over, under;  // last sample that some line, some arc passes
  };
  /// Room of a sample for the path at it: what the bounds on both sides leave.
  struct Band {
    double low, high;
  };

  [[nodiscard]] static std::int64_t up(double mm) {
    return static_cast<std::int64_t>(std::ceil(mm / kUnit_mm - 1e-6));
  }
  [[nodiscard]] double gouge_beside(std::size_t k) const {
    return std::max(s_[k].gouge_mm, k > 0 ? s_[k - 1].gouge_mm : 0.0);
  }
  [[nodiscard]] double dip_beside(std::size_t k) const {
    return std::max(s_[k].dip_mm, k > 0 ? s_[k - 1].dip_mm : 0.0);
  }
  /// Longest interval beside the sample.
  [[nodiscard]] double interval(std::size_t k) const {
    const std::int64_t before = k > 0 ? s_[k].place - s_[k - 1].place : 0;
    const std::int64_t after = k < last_ ? s_[k + 1].place - s_[k].place : 0;
    return step_mm_ * static_cast<double>(std::max(before, after));
  }
  [[nodiscard]] Band band(std::size_t k) const {
    if (k == last_) {  // the next line starts there
      const double z = mm_of_units(up(s_[k].tip_mm));
      return {z, z};
    }
    const double below = limits_.gouge_mm - kExactness_mm - gouge_beside(k);
    const double above = std::max(kUnit_mm, limits_.excess_mm - kExactness_mm - dip_beside(k));
    return {s_[k].tip_mm - below, s_[k].tip_mm + above};
  }

  [[nodiscard]] double run_to(std::size_t k) const {
    return step_mm_ * static_cast<double>(s_[k].place - s_[from_].place);
  }

  /// Clips until nothing is left. Fills slopes_ and, of the last samples reached, the polygons.
  Reach look_ahead() {
    const double z0 = mm_of_units(z_);
    Reach reach{from_, from_, from_};
    double low = -INFINITY, high = INFINITY;
    slopes_.clear();
    constexpr double kSteepest = 20.0;
    const double most = 0.5 * std::hypot(1.0, kSteepest) / limits_.least_radius_mm;
    const double least = 0.5 / limits_.greatest_radius_mm;
    over_ = {{-kSteepest, -most}, {kSteepest, -most}, {kSteepest, -least}, {-kSteepest, -least}};
    under_ = {{-kSteepest, least}, {kSteepest, least}, {kSteepest, most}, {-kSteepest, most}};
    bool line = true, over = limits_.arcs, under = limits_.arcs;
    for (std::size_t k = from_ + 1; k <= last_ && (line || over || under); ++k) {
      const double t = run_to(k), half = 0.5 * interval(k);
      const Band room = band(k);
      if (line) {
        low = std::max(low, (room.low - z0) / t);
        high = std::min(high, (room.high - z0) / t);
        line = low <= high;
        if (line) {
          slopes_.push_back({low, high});
          reach.line = k;
        }
      }
      // An arc's end is put on the line's end by rounding.
      const double slack = k == last_ ? 0.4 * kUnit_mm : 0.0;
      const double l = room.low - slack - z0, h = room.high + slack - z0;
      // Between samples an arc leaves its chord by about |b| (1 + slope^2) interval^2 / 4.
      const double slope = (s_[k].tip_mm - z0) / t;
      const double sagitta = (1.0 + slope * slope) * half * half;
      if (over) {
        before_ = over_;
        clip(over_, scratch_, t, t * t + l * l, l);
        clip(over_, scratch_, -t, -(t * t + h * h) + sagitta, -h);
        over = !over_.empty();
        if (over)
          reach.over = k;
        else
          over_.swap(before_);
      }
      if (under) {
        before_ = under_;
        clip(under_, scratch_, t, t * t + l * l - sagitta, l);
        clip(under_, scratch_, -t, -(t * t + h * h), -h);
        under = !under_.empty();
        if (under)
          reach.under = k;
        else
          under_.swap(before_);
      }
      if (s_[k].stop) break;
    }
    return reach;
  }

  /// A straight move to the farthest sample up to `end` where a height of the resolution fits.
  std::size_t line(std::size_t end, FittedMove& move) {
    const double z0 = mm_of_units(z_);
    for (;; --end) {
      MAQUETTE_CHECK(end > from_, "no height fits at place {}", s_[from_ + 1].place);
      const Cone& cone = slopes_[end - from_ - 1];
      const double t = run_to(end);
      std::int64_t z;
      if (end == last_) {
        z = up(s_[end].tip_mm);
      } else {
        const auto lowest =
            static_cast<std::int64_t>(std::ceil((z0 + cone.low * t) / kUnit_mm - 1e-7));
        const auto highest =
            static_cast<std::int64_t>(std::floor((z0 + cone.high * t) / kUnit_mm + 1e-7));
        if (lowest > highest) continue;
        z = std::clamp(units(s_[end].tip_mm), lowest, highest);
      }
      move = {s_[end].place, z * kResolution, FittedMove::Shape::line, 0};
      const double slope = (mm_of_units(z) - z0) / t;
      at_.resize(end - from_ + 1);
      for (std::size_t k = from_; k <= end; ++k) {
        const double path = z0 + slope * run_to(k);
        at_[k - from_] = {s_[k].tip_mm - path, path - s_[k].tip_mm};
      }
      add_bounds(end, 0.0, 0.0);
      return end;
    }
  }

  /// The longest arc that stays inside the bands as written and reaches farther than lines do;
  /// from_ if none.
  std::size_t arc(const Reach& reach, FittedMove& move) {
    const double line = run_to(reach.line);
    const bool over = reach.over >= reach.under;
    std::size_t end = std::max(reach.over, reach.under);
    if (end == from_ || run_to(end) <= line) return from_;
    const Polygon& polygon = over ? over_ : under_;
    Point centroid{0.0, 0.0};
    for (const Point& p : polygon) centroid = {centroid.a + p.a, centroid.b + p.b};
    const auto corners = static_cast<double>(polygon.size());
    centroid = {centroid.a / corners, centroid.b / corners};
    // Where the arc is too steep, or rounding broke a band, a shorter one may do.
    for (int attempt = 0; attempt < 4 && run_to(end) > line; ++attempt) {
      // Half a grain of the radius moves the middle of the arc by t^2 grain / (16 R^2).
      const double t = run_to(end), bend = 2.0 * centroid.b;
      const double grain = 16.0 * kRoundingSagitta_mm / (t * t * bend * bend);
      std::int64_t coarse = 1;
      while (coarse < 1000 && 10.0 * kUnit_mm * static_cast<double>(coarse) <= grain) coarse *= 10;
      if (try_arc(centroid, over, end, coarse, move)) return end;
      if (coarse > 1 && try_arc(centroid, over, end, 1, move)) return end;
      end = from_ + (end - from_) * 7 / 8;
    }
    return from_;
  }

  /// Radius on multiples of `coarse` units.
  bool try_arc(Point circle, bool over, std::size_t end, std::int64_t coarse, FittedMove& move) {
    const double a = circle.a, b = circle.b, t = run_to(end);
    const double lack = a * t + b * t * t, root = 1.0 - 4.0 * b * lack;
    if (!(root > 0.0)) return false;
    const std::int64_t z1 = end == last_
                                ? up(s_[end].tip_mm)
                                : units(mm_of_units(z_) + 2.0 * lack / (1.0 + std::sqrt(root)));
    const double radius = 0.5 * std::hypot(1.0, a) / std::abs(b);
    const double grain = kUnit_mm * static_cast<double>(coarse);
    move = {s_[end].place, z1 * kResolution,
            over ? FittedMove::Shape::over : FittedMove::Shape::under,
            std::llround(radius / grain) * coarse * kResolution};
    return fits(move, end);
  }

  /// Checks the arc as written and, if it is inside, adds its bounds.
  bool fits(const FittedMove& move, std::size_t end) {
    const bool over = move.shape == FittedMove::Shape::over;
    const double r = mm_of_ticks(move.radius);
    if (r < limits_.least_radius_mm || r > limits_.greatest_radius_mm) return false;
    const double t1 = run_to(end), z1 = mm_of_ticks(move.z) - mm_of_units(z_);
    if (!(std::hypot(t1, z1) < kLongestChord * r)) return false;
    // Over the top from left to right is clockwise.
    const PlanePoint centre = centre_by_radius({t1, z1}, r, !over);
    const double ct = centre.u, cz = centre.v;
    if (over ? !(cz < 0.0 && cz < z1) : !(cz > 0.0 && cz > z1)) return false;
    const double u = std::max(std::abs(ct), std::abs(t1 - ct));
    const double flattest = r * r - u * u;
    if (flattest < kFlattest * r * r) return false;
    const double curvature = r * r / (flattest * std::sqrt(flattest));  // greatest |z''|
    at_.resize(end - from_ + 1);
    double longest = 0.0;
    for (std::size_t k = from_; k <= end; ++k) {
      const double along = run_to(k) - ct;
      const double depth = std::sqrt(r * r - along * along);
      const double path = mm_of_units(z_) + cz + (over ? depth : -depth);
      at_[k - from_] = {s_[k].tip_mm - path, path - s_[k].tip_mm};
      if (k > from_)
        longest = std::max(longest, step_mm_ * static_cast<double>(s_[k].place - s_[k - 1].place));
    }
    const double sagitta = curvature * longest * longest / 8.0;
    const double sag_below = over ? 0.0 : sagitta, sag_above = over ? sagitta : 0.0;
    for (std::size_t k = from_; k <= end; ++k) {
      // The move's end must leave the next one the room that its first interval needs.
      const double gouge = k == from_ ? s_[k].gouge_mm : gouge_beside(k);
      const double dip = k == from_ ? s_[k].dip_mm : dip_beside(k);
      const Beside here = at_[k - from_];
      if (here.below + gouge + sag_below > limits_.gouge_mm - kExactness_mm) return false;
      if (here.above + sag_above >
          std::max(limits_.excess_mm - kExactness_mm - dip, 2.0 * kUnit_mm))
        return false;
    }
    add_bounds(end, sag_below, sag_above);
    return true;
  }

  /// At a sample the dip beside it contains its lift.
  void add_bounds(std::size_t end, double sag_below, double sag_above) {
    for (std::size_t k = from_ + 1; k <= end; ++k) {
      const Beside here = at_[k - from_], before = at_[k - from_ - 1];
      const double gouge = std::max(here.below, before.below) + s_[k - 1].gouge_mm + sag_below;
      const double excess = std::max(here.above, before.above) + s_[k - 1].dip_mm + sag_above;
      bounds_.gouge_mm = std::max(bounds_.gouge_mm, gouge);
      bounds_.excess_mm = std::max(bounds_.excess_mm, excess);
    }
  }

  struct Cone {
    double low, high;
  };
  struct Beside {
    double below, above;
  };
  const std::vector<PathSample>& s_;
  double step_mm_;
  FitLimits limits_;
  std::size_t last_, from_ = 0;
  std::int64_t z_ = 0;  // units; where the move starts
  std::vector<Cone> slopes_;
  std::vector<Beside> at_;
  Polygon over_, under_, before_, scratch_;
  FitBounds bounds_;
};

}  // namespace

FitBounds fit_moves(const std::vector<PathSample>& samples, double step_mm, const FitLimits& limits,
                    std::vector<FittedMove>& moves) {
  MAQUETTE_CHECK(samples.size() >= 2, "{} samples", samples.size());
  if (!limits.arcs) {
    // Where lines meet a move ends.
    std::vector<SampledLine> lines;
    for (std::size_t first = 0, k = 1; k < samples.size(); ++k)
      if (samples[k].stop || k + 1 == samples.size()) {
        lines.push_back({std::span(samples).subspan(first, k - first + 1), step_mm});
        first = k;
      }
    std::vector<std::vector<FittedMove>> of_lines;
    const FitBounds bounds = fit_lines(lines, limits, of_lines);
    moves.swap(of_lines.front());
    for (std::size_t l = 1; l < of_lines.size(); ++l)
      moves.insert(moves.end(), of_lines[l].begin(), of_lines[l].end());
    return bounds;
  }
  return Fitter(samples, step_mm, limits).run(moves);
}

void reverse_moves(std::vector<FittedMove>& moves) {
  // A move belongs to the vertex it ends at; turned round, to the one it started from.
  std::vector<FittedMove> turned;
  turned.reserve(moves.size());
  turned.push_back({moves.back().place, moves.back().z, FittedMove::Shape::line, 0});
  for (std::size_t k = moves.size(); k-- > 1;) {
    const FittedMove &m = moves[k], &to = moves[k - 1];
    turned.push_back({to.place, to.z, m.shape, m.radius});
  }
  moves.swap(turned);
}

void append_fitted(Toolpath& path, const LatticeLine& line, const std::vector<FittedMove>& moves,
                   double feed_mm_min) {
  for (std::size_t k = 1; k < moves.size(); ++k) {
    const FittedMove& m = moves[k];
    PathMove move;
    move.to = {line.x + m.place * line.dx, line.y + m.place * line.dy, m.z};
    move.feed_mm_min = feed_mm_min;
    if (m.shape != FittedMove::Shape::line) {
      const bool along_x = line.dy == 0;
      const std::int64_t step = along_x ? line.dx : line.dy;
      MAQUETTE_CHECK((along_x || line.dx == 0) && (step == kResolution || step == -kResolution),
                     "arc on a line of direction {}, {}", line.dx, line.dy);
      move.kind = PathMove::Kind::arc;
      move.plane = along_x ? ArcPlane::zx : ArcPlane::yz;
      move.radius = m.radius;
      // Over the top towards +x is counter-clockwise seen from +y; towards +y clockwise from +x.
      const bool forwards = (m.place > moves[k - 1].place) == (step > 0);
      const bool over = m.shape == FittedMove::Shape::over;
      move.counter_clockwise = (over == forwards) == along_x;
    }
    path.moves.push_back(move);
  }
}

}  // namespace maquette::cnc

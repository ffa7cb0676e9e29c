// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/pass_sampler.hpp"

#include <algorithm>
#include <cmath>

#include "core/check.hpp"

namespace maquette::cnc {
namespace {

constexpr double kShortest_mm = 0.0015;
constexpr int kLatticePerCell = 16;  // as in cutter_location.cpp: such places are cheap

class LineSampler {
 public:
  LineSampler(DropCutter& cutter, const SteepnessTiles& tiles, const heightmap::ModelField& field,
              BallNose tool, const LatticeLine& line, const SamplingLimits& limits,
              std::vector<PathSample>& samples)
      : cutter_(cutter),
        tiles_(tiles),
        line_(line),
        R_(tool.radius_mm),
        step_mm_(line.step_mm()),
        along_x_(kTick_mm * static_cast<double>(line.dx) / step_mm_),
        along_y_(kTick_mm * static_cast<double>(line.dy) / step_mm_),
        shortest_(std::max(std::int64_t{1},
                           static_cast<std::int64_t>(std::ceil(kShortest_mm / step_mm_)))),
        lattice_mm_(field.spacing.value() / kLatticePerCell),
        limits_(limits),
        samples_(samples) {
    // Where the field's nodes lie along the line, if it runs along a row or a column of them.
    if (line.dy == 0)
      origin_mm_ = (field.x0.value() - line.x_mm(0)) * (line.dx > 0 ? 1.0 : -1.0);
    else if (line.dx == 0)
      origin_mm_ = (field.y0.value() - line.y_mm(0)) * (line.dy > 0 ? 1.0 : -1.0);
  }

  void run(std::int64_t from, std::int64_t to) {
    // On ground sloping by a third (K about 1.2 / R) this step just meets the limit.
    const double step_mm = std::sqrt(8.0 * limits_.gouge_mm * R_ / 1.2);
    std::int64_t step = 1;
    while (2.0 * static_cast<double>(step) * lattice_mm_ <= step_mm) step *= 2;
    auto k = static_cast<std::int64_t>(
        std::floor((static_cast<double>(from) * step_mm_ - origin_mm_) / lattice_mm_));
    k = k / step * step;
    Sample a = at(from);
    while (a.place < to) {
      k += step;
      std::int64_t place = std::min(to, on_lattice(k));
      if (to - place < shortest_) place = to;
      if (place - a.place < shortest_ && place != to) continue;
      const Sample b = at(place);
      refine(a, b);
      a = b;
    }
    samples_.push_back({a.place, a.contact.tip_mm, lift_, 0.0, 0.0});
    finish();
  }

 private:
  struct Sample {
    std::int64_t place;
    CutterContact contact;
    double u;  // from the axis to the contact, along the line
    double w;  // depth of the contact below the ball's centre
  };
  struct Between {
    double gouge, dip, meet;  // meet: where the arcs of both ends meet, as a share of the interval
  };

  [[nodiscard]] std::int64_t on_lattice(std::int64_t k) const {
    return std::llround((origin_mm_ + lattice_mm_ * static_cast<double>(k)) / step_mm_);
  }

  [[nodiscard]] Sample at(std::int64_t place) {
    const CutterContact c = cutter_.drop(line_.x_mm(place), line_.y_mm(place));
    return {place, c, c.dx_mm * along_x_ + c.dy_mm * along_y_,
            std::sqrt(std::max(0.0, R_ * R_ - c.dx_mm * c.dx_mm - c.dy_mm * c.dy_mm))};
  }

  /// Tip at `step` along the line from s while the ball keeps touching the same point.
  [[nodiscard]] static double rolled(const Sample& s, double step) {
    const double q = s.u * s.u + s.w * s.w - (s.u - step) * (s.u - step);
    return q < 0.0 ? -INFINITY : s.contact.tip_mm - s.w + std::sqrt(q);
  }

  [[nodiscard]] Between between(const Sample& a, const Sample& b) const {
    const double h = step_mm_ * static_cast<double>(b.place - a.place);
    const double za = a.contact.tip_mm, zb = b.contact.tip_mm;
    const double a_at_b = rolled(a, h), b_at_a = rolled(b, -h);
    const double A = std::max(0.0, zb - a_at_b), B = std::max(0.0, za - b_at_a);
    Between result{0.0, 0.0, 0.5};
    if (A > 0.0 && B > 0.0) {
      result.dip = std::isinf(A) ? B : std::isinf(B) ? A : A * B / (A + B);
      if (std::isfinite(A + B)) result.meet = B / (A + B);
    }
    const double lowest = std::max(std::min(za, a_at_b), std::min(zb, b_at_a));
    const auto [x_min, x_max] = std::minmax({line_.x_mm(a.place), line_.x_mm(b.place)});
    const auto [y_min, y_max] = std::minmax({line_.y_mm(a.place), line_.y_mm(b.place)});
    const ContactBound contact = tiles_.bound(x_min, x_max, y_min, y_max, lowest);
    const double w = contact.least_depth_mm, m = (zb - za) / h;
    const double steepest2 = std::max(R_ * R_ / (w * w) - 1.0, m * m);
    const double by_curvature = R_ * R_ / (w * w * w) * h * h / 8.0;
    const double by_slope =
        steepest2 > 0.0 ? (steepest2 - m * m) * h / (2.0 * std::sqrt(steepest2)) : 0.0;
    const double by_height = std::max(0.0, contact.highest_mm - std::min(za, zb));
    result.gouge = std::min({by_curvature, by_slope, by_height});
    return result;
  }

  [[nodiscard]] std::int64_t split(const Sample& a, const Sample& b, double share) const {
    const auto length = static_cast<double>(b.place - a.place);
    const double raw = static_cast<double>(a.place) + std::clamp(share, 0.125, 0.875) * length;
    const double k = std::round((raw * step_mm_ - origin_mm_) / lattice_mm_);
    const std::int64_t even = on_lattice(static_cast<std::int64_t>(k));
    const std::int64_t least = (shortest_ + 1) / 2;
    if (even - a.place >= least && b.place - even >= least) return even;
    return std::clamp<std::int64_t>(std::llround(raw), a.place + 1, b.place - 1);
  }

  void refine(const Sample& a, const Sample& b) {
    const Between found = between(a, b);
    const bool gouges = found.gouge > limits_.gouge_mm, dips = found.dip > limits_.dip_mm;
    if ((gouges || dips) && b.place - a.place > shortest_) {
      const Sample middle = at(split(a, b, dips ? found.meet : 0.5));
      refine(a, middle);
      refine(middle, b);
      return;
    }
    const double lift = std::max(0.0, found.gouge - limits_.gouge_mm);
    samples_.push_back({a.place, a.contact.tip_mm, std::max(lift_, lift), found.gouge, found.dip});
    lift_ = lift;
  }

  /// Applies the lifts. Both ends of an interval are lifted by at least what it needs.
  void finish() {
    for (std::size_t i = 0; i < samples_.size(); ++i) {
      PathSample& s = samples_[i];
      s.tip_mm += s.lift_mm;
      if (i + 1 == samples_.size()) break;
      const double next = samples_[i + 1].lift_mm;
      s.gouge_mm = std::max(0.0, s.gouge_mm - std::min(s.lift_mm, next));
      s.dip_mm += std::max(s.lift_mm, next);
    }
  }

  DropCutter& cutter_;
  const SteepnessTiles& tiles_;
  const LatticeLine& line_;
  double R_, step_mm_, along_x_, along_y_;
  std::int64_t shortest_;
  double origin_mm_ = 0.0, lattice_mm_;
  SamplingLimits limits_;
  std::vector<PathSample>& samples_;
  double lift_ = 0.0;  // that the interval before asks of the sample to come
};

}  // namespace

void sample_line(DropCutter& cutter, const SteepnessTiles& tiles,
                 const heightmap::ModelField& field, BallNose tool, const LatticeLine& line,
                 std::int64_t from, std::int64_t to, const SamplingLimits& limits,
                 std::vector<PathSample>& samples) {
  MAQUETTE_CHECK(from < to, "line from {} to {}", from, to);
  samples.clear();
  LineSampler(cutter, tiles, field, tool, line, limits, samples).run(from, to);
}

}  // namespace maquette::cnc

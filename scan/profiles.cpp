// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/profiles.hpp"

#include <algorithm>
#include <cmath>

#include "core/check.hpp"

namespace maquette::scan {
namespace {

constexpr double kPointsInStretch = 30.0;
constexpr double kMostStretches = 500.0;
constexpr std::size_t kLeastPoints = 3;

struct OnLine {
  double along_mm, deviation_mm;
};

/// What a stretch adds up to; sums about the first value, so that squares do not cancel.
struct Stretch {
  double first = 0.0, sum = 0.0, square = 0.0;
  std::size_t n = 0;
  void add(double d) {
    if (n == 0) first = d;
    sum += d - first;
    square += (d - first) * (d - first);
    ++n;
  }
  [[nodiscard]] double mean() const { return first + sum / static_cast<double>(n); }
  [[nodiscard]] double freedom() const { return static_cast<double>(n) - 1.0; }
  /// Sum of squared distances from the mean.
  [[nodiscard]] double scatter() const {
    return std::fmax(0.0, square - sum * sum / static_cast<double>(n));
  }
};

}  // namespace

Profile profile_along(std::span<const Vec3> points, std::span<const float> deviation,
                      const ProfileLine& line, const heightmap::ModelField& design,
                      double inflation, const Registration* registration) {
  const Vec3 way{line.to_mm.x - line.from_mm.x, line.to_mm.y - line.from_mm.y, 0.0};
  const double length = norm(way);
  MAQUETTE_CHECK(length > 0.0 && line.width_mm > 0.0 && line.step_mm >= 0.0,
                 "a profile of {} mm, {} mm wide, in steps of {} mm", length, line.width_mm,
                 line.step_mm);
  const Vec3 unit = (1.0 / length) * way;
  std::vector<OnLine> near;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (std::isnan(deviation[i])) continue;
    const double x = points[i].x - line.from_mm.x, y = points[i].y - line.from_mm.y;
    const double along = x * unit.x + y * unit.y;
    if (along < 0.0 || along > length || std::abs(x * unit.y - y * unit.x) > 0.5 * line.width_mm)
      continue;
    near.push_back({along, static_cast<double>(deviation[i])});
  }
  const double wanted =
      line.step_mm > 0.0
          ? length / line.step_mm
          : std::fmin(kMostStretches, static_cast<double>(near.size()) / kPointsInStretch);
  const double count = std::fmax(1.0, std::round(wanted));
  Profile p;
  p.name = line.name;
  p.step_mm = length / count;
  std::vector<Stretch> stretches(static_cast<std::size_t>(count));
  for (const OnLine& o : near)
    stretches[std::min(stretches.size() - 1, static_cast<std::size_t>(o.along_mm / p.step_mm))].add(
        o.deviation_mm);
  // Scatter of all stretches together: that of a few points is no measure of their mean.
  double scatter = 0.0, freedom = 0.0;
  for (const Stretch& s : stretches)
    if (s.n > 0) scatter += s.scatter(), freedom += s.freedom();
  const double pooled = freedom > 0.0 ? scatter / freedom : NAN;
  constexpr double kFewPoints = 20.0;
  for (std::size_t k = 0; k < stretches.size(); ++k) {
    const Stretch& s = stretches[k];
    const double along = (static_cast<double>(k) + 0.5) * p.step_mm;
    Vec3 at = line.from_mm + along * unit;
    at.z = heightmap::height_at(design, at.x, at.y);
    p.at_mm.push_back(at);
    p.along_mm.push_back(along);
    p.points.push_back(s.n);
    const bool enough = s.n >= kLeastPoints;
    p.mean_mm.push_back(enough ? s.mean() : NAN);
    if (!enough) {
      p.sigma_mm.push_back(NAN);
      continue;
    }
    const double variance = s.freedom() < kFewPoints
                                ? (s.scatter() + kFewPoints * pooled) / (s.freedom() + kFewPoints)
                                : s.scatter() / s.freedom();
    const double pose =
        registration != nullptr ? pose_sigma_mm(*registration, at, {0.0, 0.0, 1.0}) : 0.0;
    p.sigma_mm.push_back(
        std::hypot(inflation * std::sqrt(variance / static_cast<double>(s.n)), pose));
  }
  return p;
}

}  // namespace maquette::scan

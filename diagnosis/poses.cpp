// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/poses.hpp"

#include <algorithm>
#include <cmath>

namespace maquette::diagnosis::detail {
namespace {

constexpr double kLeastPattern_mm = 0.03;  // what careful registration leaves is below this
constexpr double kLeastPose_mm = 0.002;    // no pose is believed to be better
constexpr double kLevel = kFamilyLevel / 20.0;
/// A pattern within this share of the best one's projection is not told from it.
constexpr double kAlike = 0.8;

/// Two-sided tail of Student's t, by the integral's leading term; too large by at most a few per
/// cent beyond t = 4, which is the safe side.
double student_tail(double t, double freedom) {
  const double log_density = std::lgamma(0.5 * (freedom + 1.0)) - std::lgamma(0.5 * freedom) -
                             0.5 * std::log(freedom * 3.14159265358979323846) -
                             0.5 * (freedom + 1.0) * std::log1p(t * t / freedom);
  return std::fmin(1.0, 2.0 * std::exp(log_density) * (freedom + t * t) / (t * freedom));
}

struct Pattern {
  std::string effect, parameter;
  std::vector<double> along;  // six components a set-up, of length sqrt(set-ups)
};

}  // namespace

void add_pose_causes(const Measurements& m, Diagnosis& d) {
  const std::size_t n = d.poses.size();
  const double half = m.scene.half_mm();
  std::vector<double> pose;
  for (const PoseEstimate& p : d.poses)
    for (const double v : {p.shift_mm.x, p.shift_mm.y, p.shift_mm.z, 1e-6 * half * p.turn_urad.x,
                           1e-6 * half * p.turn_urad.y, 1e-6 * half * p.turn_urad.z})
      pose.push_back(v);
  std::vector<Pattern> patterns(1);
  patterns[0] = {"tool.length_offset", "offset_mm", std::vector<double>(6 * n, 0.0)};
  for (std::size_t s = 0; s < n; ++s) patterns[0].along[6 * s + 2] = 1.0;
  if (std::all_of(m.scene.has_station.begin(), m.scene.has_station.end(),
                  [](bool b) { return b; })) {
    Pattern bias{"scanner.range_bias", "bias_mm", std::vector<double>(6 * n, 0.0)};
    for (std::size_t s = 0; s < n; ++s) {
      const Vec3 beam = normalized(m.set_ups[s].centre_mm - m.scene.stations[s]);
      bias.along[6 * s] = beam.x;
      bias.along[6 * s + 1] = beam.y;
      bias.along[6 * s + 2] = beam.z;
    }
    patterns.push_back(std::move(bias));
  }
  struct Found {
    std::size_t pattern;
    double size, sigma, p;
  };
  std::vector<Found> found;
  for (std::size_t k = 0; k < patterns.size(); ++k) {
    const auto& v = patterns[k].along;
    double size = 0.0, rest = 0.0;
    for (std::size_t i = 0; i < pose.size(); ++i) size += v[i] * pose[i] / static_cast<double>(n);
    for (std::size_t i = 0; i < pose.size(); ++i)
      rest += (pose[i] - size * v[i]) * (pose[i] - size * v[i]);
    const double freedom = static_cast<double>(pose.size()) - 1.0;
    const double sigma =
        std::fmax(kLeastPose_mm, std::sqrt(rest / freedom)) / std::sqrt(static_cast<double>(n));
    found.push_back({k, size, sigma, student_tail(std::abs(size) / sigma, freedom)});
  }
  std::sort(found.begin(), found.end(), [](const Found& a, const Found& b) { return a.p < b.p; });
  const auto named = [&](const std::string& effect) {
    const Effect* e = find_effect(effect);
    Cause c;
    c.effect = effect;
    c.law = "seen in the poses of the measurements only";
    c.separate_by = e->separate_by;
    return c;
  };
  const Found& best = found.front();
  if (std::abs(best.size) > kLeastPattern_mm && best.p < kLevel) {
    Cause c = named(patterns[best.pattern].effect);
    c.parameters = {{patterns[best.pattern].parameter, best.size, best.sigma}};
    c.p_value = best.p;
    for (const Found& f : found)
      if (f.pattern != best.pattern && std::abs(f.size) > kAlike * std::abs(best.size))
        c.equivalent.push_back(patterns[f.pattern].effect);
    if (n == 1) c.equivalent.push_back("scanner.registration");
    d.causes.push_back(std::move(c));
    return;
  }
  // One pose that stands apart from all others, three times in rms for each of at least twelve.
  if (n < 2) return;
  std::vector<double> squares(n, 0.0);
  double all = 0.0;
  for (std::size_t s = 0; s < n; ++s) {
    for (std::size_t k = 0; k < 6; ++k) squares[s] += pose[6 * s + k] * pose[6 * s + k] / 6.0;
    all += squares[s];
  }
  const auto worst =
      static_cast<std::size_t>(std::max_element(squares.begin(), squares.end()) - squares.begin());
  const double others =
      std::fmax(kLeastPose_mm * kLeastPose_mm, (all - squares[worst]) / static_cast<double>(n - 1));
  // F(6, 6) of 20 has a tail of 0.001; two scans' noise of registration is rarely that unequal.
  if (squares[worst] / others > 40.0 && std::sqrt(squares[worst]) > 2.0 * kLeastPattern_mm) {
    Cause c = named("scanner.registration");
    const PoseEstimate& p = d.poses[worst];
    c.parameters = {{"shift_x_mm", p.shift_mm.x, p.shift_sigma_mm.x},
                    {"shift_y_mm", p.shift_mm.y, p.shift_sigma_mm.y},
                    {"shift_z_mm", p.shift_mm.z, p.shift_sigma_mm.z},
                    {"turn_x_urad", p.turn_urad.x, p.turn_sigma_urad.x},
                    {"turn_y_urad", p.turn_urad.y, p.turn_sigma_urad.y},
                    {"turn_z_urad", p.turn_urad.z, p.turn_sigma_urad.z}};
    c.fixed = {{"scan", static_cast<double>(worst + 1)}};
    c.p_value = kLevel;
    d.causes.push_back(std::move(c));
  }
}

}  // namespace maquette::diagnosis::detail

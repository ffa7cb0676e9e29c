// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/noise_model.hpp"

#include <algorithm>
#include <cmath>

#include "core/median.hpp"

namespace maquette::scan::detail {
namespace {

constexpr std::size_t kLeast = 200;  // residuals of a bin: its spread is known to some 6 %

template <std::size_t N>
std::size_t bin_of(const std::array<double, N>& limits, double value) {
  return static_cast<std::size_t>(std::upper_bound(limits.begin(), limits.end(), value) -
                                  limits.begin());
}

template <std::size_t N>
void set_limits(std::array<double, N>& limits, std::vector<double> values) {
  std::sort(values.begin(), values.end());
  for (std::size_t k = 0; k < N; ++k)
    limits[k] = values.empty() ? INFINITY : values[(k + 1) * values.size() / (N + 1)];
}

double cosine(Vec3 look, Vec3 normal) {
  return std::abs(dot(look, normal)) / std::fmax(1e-9, norm(look));
}

}  // namespace

NoiseModel::NoiseModel(const Met& met, Vec3 station) : station_(station) {
  std::vector<double> ranges, all;
  for (std::size_t i = 0; i < met.feet.size(); ++i)
    if (!std::isnan(met.feet[i].e_mm)) {
      ranges.push_back(norm(station_ - met.points_mm[i]));
      all.push_back(met.feet[i].e_mm);
    }
  set_limits(range_limits_, ranges);
  const double typical = nmad(all);
  for (std::size_t a = 0; a < kBins; ++a) {
    std::vector<double> cosines, residuals;
    for (std::size_t i = 0; i < met.feet.size(); ++i) {
      if (std::isnan(met.feet[i].e_mm)) continue;
      const Vec3 look = station_ - met.points_mm[i];
      if (bin_of(range_limits_, norm(look)) != a) continue;
      cosines.push_back(cosine(look, met.feet[i].normal));
      residuals.push_back(met.feet[i].e_mm);
    }
    set_limits(cosine_limits_[a], cosines);
    for (std::size_t b = 0; b < kBins; ++b) {
      std::vector<double> here;
      for (std::size_t i = 0; i < cosines.size(); ++i)
        if (bin_of(cosine_limits_[a], cosines[i]) == b) here.push_back(residuals[i]);
      const double own = here.size() >= kLeast ? nmad(here) : typical;
      // A bin that is exact (simulated without noise) must not take all weight.
      relative_[a][b] = typical > 0.0 ? std::clamp(own / typical, 0.1, 10.0) : 1.0;
    }
  }
}

double NoiseModel::relative(Vec3 p, Vec3 normal) const {
  const Vec3 look = station_ - p;
  const std::size_t a = bin_of(range_limits_, norm(look));
  return relative_[a][bin_of(cosine_limits_[a], cosine(look, normal))];
}

double NoiseModel::spread() const {
  double low = INFINITY, high = 0.0;
  for (const auto& row : relative_)
    for (const double r : row) low = std::fmin(low, r), high = std::fmax(high, r);
  return high / low;
}

}  // namespace maquette::scan::detail

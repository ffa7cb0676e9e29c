// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/steps.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {
namespace {

constexpr std::size_t kBins = 1024;  // of the program's time: finer than its passes
constexpr double kPeak = 4.0;
constexpr std::size_t kMost = 4;

/// Sums of a regression of r on a, and a constant.
struct Line {
  double n = 0.0, a = 0.0, r = 0.0, aa = 0.0, ar = 0.0;
  Line& operator+=(const Line& o) {
    n += o.n, a += o.a, r += o.r, aa += o.aa, ar += o.ar;
    return *this;
  }
  Line operator-(const Line& o) const { return {n - o.n, a - o.a, r - o.r, aa - o.aa, ar - o.ar}; }
};

}  // namespace

std::vector<double> sharpest_steps(const std::vector<Observation>& all,
                                   const std::vector<double>& residual, const Layout& layout,
                                   int axis) {
  std::vector<Line> until(kBins + 1);
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Observation& o = all[i];
    if (!(o.path_share >= 0.0) || layout.set_of(o.place.x, o.place.y) != kChoose) continue;
    const double a = component(level_along(o), axis), r = residual[i];
    until[1 + std::min(kBins - 1, static_cast<std::size_t>(o.path_share * kBins))] +=
        Line{1.0, a, r, a * a, a * r};
  }
  for (std::size_t k = 0; k < kBins; ++k) until[k + 1] += until[k];
  struct Peak {
    double height;
    std::size_t at, window;
  };
  std::vector<Peak> peaks;
  for (const std::size_t window : {8U, 25U, 80U}) {
    std::vector<double> t(kBins, 0.0), sizes;
    for (std::size_t k = window; k + window <= kBins; ++k) {
      double value = 0.0, variance = 0.0;
      for (const auto& [from, to, sign] :
           {std::tuple{k - window, k, -1.0}, std::tuple{k, k + window, 1.0}}) {
        const Line s = until[to] - until[from];
        // Sideways displacements show as slope times shift beside whatever height there is; upright
        // ones are the height.
        const double information = axis == 2 ? s.aa : s.aa - s.a * s.a / std::fmax(1.0, s.n);
        const double score = axis == 2 ? s.ar : s.ar - s.a * s.r / std::fmax(1.0, s.n);
        if (!(information > 1e-6 * s.n) || s.n < 20.0) {
          variance = INFINITY;
          break;
        }
        value += sign * score / information;
        variance += 1.0 / information;
      }
      if (!std::isfinite(variance)) continue;
      t[k] = std::abs(value) / std::sqrt(variance);
      sizes.push_back(t[k]);
    }
    if (sizes.size() < 50) continue;
    std::nth_element(sizes.begin(), sizes.begin() + static_cast<std::ptrdiff_t>(sizes.size() / 2),
                     sizes.end());
    const double usual = 1.4826 * sizes[sizes.size() / 2];
    for (std::size_t k = window; k + window <= kBins; ++k) {
      const auto from = t.begin() + static_cast<std::ptrdiff_t>(k - window / 2);
      if (t[k] > kPeak * usual &&
          t[k] >= *std::max_element(from, from + static_cast<std::ptrdiff_t>(window + 1)))
        peaks.push_back({t[k] / usual, k, window});
    }
  }
  std::sort(peaks.begin(), peaks.end(),
            [](const Peak& a, const Peak& b) { return a.height > b.height; });
  std::vector<Peak> kept;
  for (const Peak& p : peaks) {
    const bool seen = std::any_of(kept.begin(), kept.end(), [&](const Peak& k) {
      return std::max(p.at, k.at) - std::min(p.at, k.at) <= std::max(p.window, k.window) / 2;
    });
    if (!seen && kept.size() < kMost) kept.push_back(p);
  }
  std::vector<double> shares;
  for (const Peak& p : kept) shares.push_back(static_cast<double>(p.at) / kBins);
  return shares;
}

}  // namespace maquette::diagnosis::detail

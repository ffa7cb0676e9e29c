// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/disc_fit.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/grid.hpp"

namespace maquette::scan::detail {
namespace {

constexpr double kLeastWide = 0.4, kMostWide = 1.8;        // of the disc that began it
constexpr double kLeastAround = 12.0, kLeastInside = 3.0;  // points
constexpr double kPrior = 20.0;  // points that scatter as is typical, beside the surroundings' own

/// What is there without the disc.
struct Base {
  double level = 0.0, variance = 0.0;  ///< of a point, correlation counted in
  double points = 0.0;
};

/// Of the points round the disc that began it.
std::optional<Base> base_of(const Disc& first, std::span<const Sample> around, double typical) {
  const double inner = kDiscBase * first.width_mm, outer = kDiscWindow * first.width_mm;
  Base b;
  double sum = 0.0, square = 0.0;
  for (const Sample& s : around) {
    const double off = std::hypot(s.x_mm - first.x_mm, s.y_mm - first.y_mm);
    if (off < inner || off > outer) continue;
    b.points += 1.0;
    sum += s.d_mm;
    square += s.d_mm * s.d_mm;
  }
  if (b.points < kLeastAround) return std::nullopt;
  b.level = sum / b.points;
  const double own = std::fmax(0.0, square - sum * b.level);
  b.variance =
      first.inflation * first.inflation * (own + kPrior * typical) / (b.points - 1.0 + kPrior);
  return b;
}

/// Discs about one centre, of all widths: the points in rings about it.
class Rings {
 public:
  /// @param most_mm   the largest radius
  /// @param blur_mm   standard deviation of the beam
  Rings(std::span<const Sample> samples, double level, double most_mm, double blur_mm)
      : samples_(samples), level_(level), ring_mm_(most_mm / kRings), blurred_(1) {
    // Share of the disc that a beam sees whose middle lies k rings outside of its edge: straight,
    // as the edge of a disc that is several beams wide nearly is.
    if (blur_mm > 0.1 * ring_mm_) {
      blurred_ = static_cast<std::ptrdiff_t>(std::ceil(3.0 * blur_mm / ring_mm_));
      for (std::ptrdiff_t k = -blurred_; k < blurred_; ++k)
        share_.push_back(0.5 * std::erfc((static_cast<double>(k) + 0.5) * ring_mm_ /
                                         (std::numbers::sqrt2 * blur_mm)));
    } else {
      share_ = {1.0, 0.0};
    }
    rings_.resize(static_cast<std::size_t>(kRings + blurred_) + 1);
  }

  void look_from(double x, double y) {
    std::fill(rings_.begin(), rings_.end(), Ring{});
    const auto end = static_cast<double>(rings_.size());
    for (const Sample& s : samples_) {
      const double at = std::hypot(s.x_mm - x, s.y_mm - y) / ring_mm_;
      if (at >= end) continue;
      Ring& ring = rings_[static_cast<std::size_t>(at)];
      ring.n += 1.0;
      ring.sum += s.d_mm - level_;
    }
  }
  /// @param visit  called with the radius, the sum of squared shares and the sum of values by
  ///               shares: a disc of height h makes of the second h times the first
  template <class Visit>
  void each(double least_mm, const Visit& visit) const {
    double n = 0.0, sum = 0.0;  // of rings that lie in the disc as a whole
    std::ptrdiff_t whole = 0;
    for (std::ptrdiff_t edge = 1; edge <= kRings; ++edge) {
      for (; whole < edge - blurred_; ++whole) {
        n += rings_[static_cast<std::size_t>(whole)].n;
        sum += rings_[static_cast<std::size_t>(whole)].sum;
      }
      const double radius = static_cast<double>(edge) * ring_mm_;
      if (radius < least_mm) continue;
      double n_all = n, sum_all = sum;
      for (std::ptrdiff_t k = std::max<std::ptrdiff_t>(0, edge - blurred_); k < edge + blurred_;
           ++k) {
        const double share = share_[static_cast<std::size_t>(k - edge + blurred_)];
        const Ring& ring = rings_[static_cast<std::size_t>(k)];
        n_all += share * share * ring.n;
        sum_all += share * ring.sum;
      }
      if (n_all >= kLeastInside) visit(radius, n_all, sum_all);
    }
  }

 private:
  static constexpr std::ptrdiff_t kRings = 72;  // 40 of the disc that began it
  struct Ring {
    double n = 0.0, sum = 0.0;
  };
  std::span<const Sample> samples_;
  double level_, ring_mm_;
  std::ptrdiff_t blurred_;  ///< rings on either side of an edge that are partly in the disc
  std::vector<double> share_;
  std::vector<Ring> rings_;
};

struct Best {
  double x = 0.0, y = 0.0, radius = 0.0;
  double gain = -1.0;  ///< twice the logarithm of the likelihood
};

}  // namespace

std::optional<DiscFit> fit_disc(const Disc& first, std::span<const Sample> around, double typical,
                                double beam_diameter_mm) {
  const auto base = base_of(first, around, typical);
  if (!base) return std::nullopt;
  const double r0 = 0.5 * first.width_mm, least = kLeastWide * r0, most = kMostWide * r0;
  const bool up = first.z > 0.0;
  Rings rings(around, base->level, most, 0.25 * beam_diameter_mm);
  Best best;
  const auto try_at = [&](double x, double y) {
    rings.look_from(x, y);
    rings.each(least, [&](double radius, double n, double sum) {
      const double gain = sum * sum / n / base->variance;
      if ((sum > 0.0) != up || gain <= best.gain) return;
      best = {x, y, radius, gain};
    });
  };
  // From coarse to fine: a step of r0 / 40 changes a disc's area by 3 %.
  double step = 0.2 * r0;
  try_at(first.x_mm, first.y_mm);
  if (best.gain < 0.0) return std::nullopt;
  for (int level = 0; level < 4; ++level, step *= 0.5) {
    const double x = best.x, y = best.y;
    for (int i = -3; i <= 3; ++i)
      for (int j = -3; j <= 3; ++j)
        if (i != 0 || j != 0) try_at(x + step * j, y + step * i);
  }

  // Centres up to 0.8 radii off; finely where a coarse look shows that there is likelihood.
  constexpr int kCoarse = 8, kFine = 4;
  constexpr double kNothing = 25.0;  // gain below the best
  const double coarse = 0.1 * best.radius, fine = coarse / kFine;
  Grid<double> gains(2 * kCoarse + 1, 2 * kCoarse + 1, -1.0);
  for (int i = -kCoarse; i <= kCoarse; ++i)
    for (int j = -kCoarse; j <= kCoarse; ++j) {
      double& gain = gains(i + kCoarse, j + kCoarse);
      rings.look_from(best.x + coarse * j, best.y + coarse * i);
      rings.each(least, [&](double, double n, double sum) {
        if ((sum > 0.0) == up) gain = std::fmax(gain, sum * sum / n / base->variance);
      });
    }
  double weight = 0.0, x = 0.0, y = 0.0, d1 = 0.0, d2 = 0.0, h1 = 0.0, h2 = 0.0, v1 = 0.0, v2 = 0.0,
         area = 0.0;
  const auto add_at = [&](double cx, double cy) {
    rings.look_from(cx, cy);
    rings.each(least, [&](double radius, double n, double sum) {
      if ((sum > 0.0) != up) return;
      const double h = sum / n, own = base->variance / n;
      const double gain = sum * h / base->variance;
      const double w = std::exp(0.5 * (gain - best.gain)) * std::sqrt(own);
      const double a = std::numbers::pi * radius * radius;
      weight += w;
      x += w * cx, y += w * cy;
      d1 += w * 2.0 * radius, d2 += w * 4.0 * radius * radius;
      h1 += w * h, h2 += w * (h * h + own);
      area += w * a;
      v1 += w * h * a, v2 += w * a * a * (h * h + own);
    });
  };
  for (int i = 0; i <= 2 * kCoarse; ++i)
    for (int j = 0; j <= 2 * kCoarse; ++j) {
      if (gains(i, j) < best.gain - kNothing) continue;
      for (int a = 0; a < kFine; ++a)
        for (int b = 0; b < kFine; ++b)
          add_at(best.x + coarse * (j - kCoarse) + fine * (b - 0.5 * (kFine - 1)),
                 best.y + coarse * (i - kCoarse) + fine * (a - 0.5 * (kFine - 1)));
    }
  if (!(weight > 0.0)) return std::nullopt;
  const auto spread = [&](double first_moment, double second_moment) {
    const double mean = first_moment / weight;
    return std::sqrt(std::fmax(0.0, second_moment / weight - mean * mean));
  };
  const double of_base = std::sqrt(base->variance / base->points);
  DiscFit fit;
  fit.x_mm = x / weight, fit.y_mm = y / weight;
  fit.diameter_mm = d1 / weight, fit.sigma_diameter_mm = spread(d1, d2);
  fit.height_mm = h1 / weight, fit.sigma_height_mm = std::hypot(spread(h1, h2), of_base);
  fit.area_mm2 = area / weight;
  fit.volume_mm3 = v1 / weight;
  fit.sigma_volume_mm3 = std::hypot(spread(v1, v2), fit.area_mm2 * of_base);
  fit.base_mm = base->level, fit.variance = base->variance, fit.gain = best.gain;
  return fit;
}

}  // namespace maquette::scan::detail

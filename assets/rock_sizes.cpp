// SPDX-License-Identifier: GPL-3.0-or-later

// Sizes of rocks by the law of Golombek and Rapp 1997, doi:10.1029/96JE03319.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <functional>
#include <numbers>

#include "assets/rocks.hpp"
#include "core/check.hpp"
#include "core/random.hpp"

namespace maquette::assets {
namespace {

constexpr double kPi = std::numbers::pi;

double decay_per_metre(double k) {
  return 1.79 + 0.152 / k;
}

void check_law(double k, Metres min, Metres max) {
  MAQUETTE_CHECK(k >= 0.005 && k <= 0.5, "{}", k);
  MAQUETTE_CHECK(min.value() > 0.0 && min < max && std::isfinite(max.value()), "{} .. {}",
                 min.value(), max.value());
}

/// Number of rocks between two sizes, up to a constant factor. With u = 1 / D the
/// density exp(-q D) / D^2 dD becomes exp(-q / u) du, which is smooth and has no pole.
class RockNumbers {
 public:
  RockNumbers(double q, double min_m, double max_m)
      : q_(q), min_m_(min_m), u0_(1.0 / max_m), step_((1.0 / min_m - 1.0 / max_m) / kCells) {
    for (std::size_t i = 0; i < kCells; ++i)
      below_[i + 1] = below_[i] + integral(node(i), node(i + 1));
  }

  /// All of them, scaled by exp(q min).
  [[nodiscard]] double all() const { return below_.back(); }

  /// The diameter above which the share `p` of all rocks lies.
  [[nodiscard]] double diameter_exceeded_by(double p) const {
    const double wanted = p * below_.back();
    const auto upper = std::upper_bound(below_.begin() + 1, below_.end() - 1, wanted);
    const auto cell = static_cast<std::size_t>(upper - below_.begin()) - 1;
    double low = node(cell), high = node(cell + 1);
    // Bisection and not Newton: near the largest size the density may be 0 in double.
    for (int i = 0; i < 50 && high - low > 1e-14 * high; ++i) {
      const double middle = 0.5 * (low + high);
      (below_[cell] + integral(node(cell), middle) < wanted ? low : high) = middle;
    }
    return 2.0 / (low + high);
  }

 private:
  static constexpr std::size_t kCells = 2048;

  [[nodiscard]] double node(std::size_t i) const { return u0_ + step_ * static_cast<double>(i); }

  /// Five-point Gauss-Legendre, scaled by exp(q min) against underflow.
  [[nodiscard]] double integral(double a, double b) const {
    constexpr std::array<double, 5> x{-0.906179845938664, -0.538469310105683, 0.0,
                                      0.538469310105683, 0.906179845938664};
    constexpr std::array<double, 5> w{0.236926885056189, 0.478628670499366, 0.568888888888889,
                                      0.478628670499366, 0.236926885056189};
    double sum = 0.0;
    for (std::size_t i = 0; i < x.size(); ++i) {
      const double u = 0.5 * (a + b) + 0.5 * (b - a) * x[i];
      sum += w[i] * std::exp(-q_ * (1.0 / u - min_m_));
    }
    return 0.5 * (b - a) * sum;
  }

  double q_, min_m_, u0_, step_;
  std::array<double, kCells + 1> below_{};
};

}  // namespace

std::vector<Metres> draw_rock_diameters(int count, double k, Metres min, Metres max,
                                        std::uint64_t seed) {
  MAQUETTE_CHECK(count >= 0, "{}", count);
  check_law(k, min, max);
  const RockNumbers numbers(decay_per_metre(k), min.value(), max.value());
  std::vector<Metres> diameters;
  for (std::uint64_t i = 0; i < static_cast<std::uint64_t>(count); ++i) {
    const double d = numbers.diameter_exceeded_by(random_uniform(seed, i));
    diameters.push_back(std::clamp(Metres{d}, min, max));
  }
  std::sort(diameters.begin(), diameters.end(), std::greater<>{});
  return diameters;
}

double rocks_per_square_metre(double k, Metres min, Metres max) {
  check_law(k, min, max);
  const double q = decay_per_metre(k);
  const RockNumbers numbers(q, min.value(), max.value());
  return 4.0 * k * q / kPi * numbers.all() * std::exp(-q * min.value());
}

}  // namespace maquette::assets

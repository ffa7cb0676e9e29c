// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/roughness.hpp"

#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include "heightmap/detail/sinc.hpp"

namespace maquette::heightmap::detail {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr std::array<std::ptrdiff_t, 4> kLags{1, 2, 4, 8};
constexpr double kFewest = 50.0;  // second differences of a lag

double amplitude_of(double hurst) {
  const double i =
      std::tgamma(1.0 - hurst) / (std::exp2(2.0 * hurst + 1.0) * hurst * std::tgamma(1.0 + hurst));
  return 1.0 / (4.0 * kPi * std::pow(2.0 * kPi, 2.0 * hurst) * i);
}

/// Second differences of one lag along one axis.
struct Seen {
  bool along_u = true;
  std::ptrdiff_t lag = 1;
  double mean_square = 0.0;
};

std::vector<Seen> differences(const Grid<float>& h) {
  std::vector<Seen> out;
  for (const std::ptrdiff_t lag : kLags)
    for (const bool along_u : {true, false}) {
      const std::ptrdiff_t dr = along_u ? 0 : lag, dc = along_u ? lag : 0;
      double sum = 0.0, count = 0.0;
      for (std::ptrdiff_t r = dr; r + dr < h.rows(); ++r)
        for (std::ptrdiff_t c = dc; c + dc < h.cols(); ++c) {
          const double d = static_cast<double>(h(r - dr, c - dc)) +
                           static_cast<double>(h(r + dr, c + dc)) -
                           2.0 * static_cast<double>(h(r, c));
          if (std::isnan(d)) continue;
          sum += d * d;
          count += 1.0;
        }
      if (count >= kFewest && sum > 0.0) out.push_back({along_u, lag, sum / count});
    }
  return out;
}

/// For each difference, ring by ring of frequency, the share of the spectrum that it shows.
struct Rings {
  std::vector<double> frequency;            ///< 1/m
  std::vector<std::vector<double>> passed;  ///< [difference][ring], with the ring's area
};

Rings rings_of(const std::vector<Seen>& seen, double step_u, double step_v) {
  constexpr int kRings = 240, kWays = 24;
  // From 300 of the longest differences to images of the sixth order, beyond which means over
  // pixels leave nothing.
  const double longest = 8.0 * std::max(step_u, step_v), shortest = std::min(step_u, step_v);
  const double low = std::log(1.0 / (300.0 * longest)), high = std::log(6.0 / shortest);
  Rings out;
  out.passed.resize(seen.size());
  for (int i = 0; i < kRings; ++i) {
    const double f = std::exp(low + (i + 0.5) * (high - low) / kRings);
    out.frequency.push_back(f);
    for (std::size_t k = 0; k < seen.size(); ++k) {
      double sum = 0.0;
      for (int w = 0; w < kWays; ++w) {
        const double angle = 2.0 * kPi * (w + 0.31) / kWays;
        const double fu = f * std::cos(angle), fv = f * std::sin(angle);
        const double mean = sinc(fu * step_u) * sinc(fv * step_v);
        const double turns = seen[k].along_u ? fu * step_u : fv * step_v;
        const double second =
            2.0 - 2.0 * std::cos(2.0 * kPi * turns * static_cast<double>(seen[k].lag));
        sum += mean * mean * second * second;
      }
      out.passed[k].push_back(sum / kWays * 2.0 * kPi * f * f * (high - low) / kRings);
    }
  }
  return out;
}

}  // namespace

double Roughness::spectrum() const {
  return coefficient * amplitude_of(hurst);
}

Roughness measure_roughness(const PixelWindow& window, const PixelSize& pixel) {
  const double step_u = pixel.along_u_m * window.step_u, step_v = pixel.along_v_m * window.step_v;
  const std::vector<Seen> seen = differences(window.height_m);
  if (seen.size() < 5) return {};
  const Rings rings = rings_of(seen, step_u, step_v);
  Roughness best;
  double least = INFINITY;
  for (double hurst = 0.06; hurst < 0.975; hurst += 0.02) {
    // Relative residuals 1 - (c relief + n noise) / seen, squared: two unknowns, neither negative.
    double rr = 0.0, rn = 0.0, nn = 0.0, r1 = 0.0, n1 = 0.0;
    for (std::size_t k = 0; k < seen.size(); ++k) {
      double relief = 0.0;
      for (std::size_t i = 0; i < rings.frequency.size(); ++i)
        relief += rings.passed[k][i] * std::pow(rings.frequency[i], -2.0 * hurst - 2.0);
      const double r = amplitude_of(hurst) * relief / seen[k].mean_square;
      const double n = 6.0 / seen[k].mean_square;
      rr += r * r;
      rn += r * n;
      nn += n * n;
      r1 += r;
      n1 += n;
    }
    const double det = rr * nn - rn * rn;
    double c = det > 1e-12 * rr * nn ? (r1 * nn - n1 * rn) / det : r1 / rr;
    double n = det > 1e-12 * rr * nn ? (n1 * rr - r1 * rn) / det : 0.0;
    if (n < 0.0) {
      n = 0.0;
      c = r1 / rr;
    } else if (c < 0.0) {
      c = 0.0;
      n = n1 / nn;
    }
    const double off = static_cast<double>(seen.size()) - 2.0 * (c * r1 + n * n1) + c * c * rr +
                       2.0 * c * n * rn + n * n * nn;
    if (off < least) {
      least = off;
      best = {hurst, c, std::sqrt(n)};
    }
  }
  return best;
}

}  // namespace maquette::heightmap::detail

// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/knowledge.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <Eigen/Dense>

#include "heightmap/detail/bands.hpp"
#include "heightmap/detail/sinc.hpp"

namespace maquette::heightmap::detail {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr double kMostGain = 2.0;  // beyond it images of the relief would rule
constexpr double kAlikePixels = 64.0;
constexpr double kHold = 0.01;

/// Fourier transform of Keys' kernel, a = -1/2; f in cycles per pixel.
double keys(double f) {
  if (std::abs(f) < 1e-3) return 1.0;
  const double s = sinc(f), d = sinc(2.0 * f), q = kPi * f * kPi * f;
  return 3.0 / q * (s * s - d) - (3.0 * d * d - 2.0 * d - sinc(4.0 * f)) / q;
}

/// Relief as nodes see it, m^2 per area of frequency in nodes: means over their cells, in which
/// waves shorter than two nodes look like longer ones.
double relief_at(const WaveTable& waves, double fx, double fy) {
  const double spacing = waves.spacing_m;
  if (std::hypot(fx, fy) < spacing / waves.longest_m) return 0.0;
  double sum = 0.0;
  for (int i = -1; i <= 1; ++i)
    for (int j = -1; j <= 1; ++j) {
      const double x = fx + i, y = fy + j, cell = sinc(x) * sinc(y);
      sum += cell * cell * std::pow(std::hypot(x, y) / spacing, -2.0 * waves.law.hurst - 2.0);
    }
  return waves.law.spectrum() / (spacing * spacing) * sum;
}

/// w with the least sum over samples of weight (shares . w - wanted)^2.
std::vector<double> fitted(const WaveTable& waves, const std::vector<double>& weight,
                           const std::vector<double>& weighted_aim) {
  const auto n = static_cast<Eigen::Index>(bands_of(waves.levels));
  Eigen::MatrixXd a = Eigen::MatrixXd::Zero(n, n);
  Eigen::VectorXd b = Eigen::VectorXd::Zero(n), own = b, own_aim = b;
  for (std::size_t i = 0; i < waves.samples.size(); ++i) {
    const Eigen::Map<const Eigen::VectorXd> share(waves.samples[i].shares.data(), n);
    a.selfadjointView<Eigen::Lower>().rankUpdate(share, weight[i]);
    b += weighted_aim[i] * share;
    own += weight[i] * share;
    own_aim += weighted_aim[i] * share;
  }
  a = Eigen::MatrixXd(a.selfadjointView<Eigen::Lower>());
  // Bands overlap, and great weights of neighbours may cancel each other. Held lightly at what
  // each would have alone, weights stay as small as the waves allow.
  for (Eigen::Index k = 0; k < n; ++k) {
    const double hold = kHold * a(k, k) + 1e-30;
    a(k, k) += hold;
    b[k] += hold * (own[k] > 0.0 ? own_aim[k] / own[k] : 0.0);
  }
  const Eigen::VectorXd w = a.ldlt().solve(b);
  return {w.data(), w.data() + n};
}

double at(const WaveTable::Sample& sample, const std::vector<double>& weights) {
  double sum = 0.0;
  for (std::size_t k = 0; k < weights.size(); ++k) sum += sample.shares[k] * weights[k];
  return sum;
}

}  // namespace

WaveTable wave_table(const Roughness& law, double spacing_m, double longest_m, std::size_t levels) {
  WaveTable out;
  out.levels = levels;
  out.law = law;
  out.spacing_m = spacing_m;
  out.longest_m = longest_m;
  constexpr int kRings = 120, kWays = 12;  // a quarter of the plane says all
  const double low = std::log(spacing_m / longest_m), high = std::log(std::numbers::sqrt2 / 2.0);
  for (int i = 0; i < kRings; ++i) {
    const double f = std::exp(low + (i + 0.5) * (high - low) / kRings);
    for (int w = 0; w < kWays; ++w) {
      const double angle = 0.5 * kPi * (w + 0.5) / kWays;
      const double fx = f * std::cos(angle), fy = f * std::sin(angle);
      if (fx > 0.5 || fy > 0.5) continue;
      const double area = 2.0 * kPi * f * f * (high - low) / kRings / kWays;
      // A surface without roughness has a little, so that weights are defined.
      out.samples.push_back({fx, fy, std::max(1e-20, relief_at(out, fx, fy)) * area, area,
                             band_shares(fx, fy, levels)});
    }
  }
  return out;
}

Knowledge knowledge_of(const WaveTable& waves, double pixel_nodes, double white_m,
                       double correlated_m) {
  const double p = std::max(1.0, pixel_nodes);
  const auto alike = [p](const WaveTable::Sample& s) {
    return std::exp(-std::pow(std::hypot(s.fx, s.fy) * p * kAlikePixels, 2.0));
  };
  double whole = 0.0;
  for (const auto& s : waves.samples) whole += s.area * alike(s);
  const auto mean = [p](double fx, double fy) {
    return sinc(p * fx) * sinc(p * fy) / (sinc(fx) * sinc(fy));
  };
  Knowledge out;
  for (const auto& s : waves.samples) {
    const double between = p > 1.0 ? keys(p * s.fx) * keys(p * s.fy) : 1.0;
    double noise = white_m * white_m * p * p * between * between;
    if (p > 1.0)
      for (int i = -1; i <= 1; ++i)
        for (int j = -1; j <= 1; ++j) {
          const double x = s.fx + i / p, y = s.fy + j / p;
          if ((i == 0 && j == 0) || std::abs(x) >= 0.5 || std::abs(y) >= 0.5) continue;
          noise += std::pow(mean(x, y) * between, 2.0) * relief_at(waves, x, y);
        }
    out.kept.push_back(mean(s.fx, s.fy) * between);
    out.noise.push_back(noise * s.area);
    out.unseen.push_back(whole > 0.0 ? correlated_m * correlated_m * alike(s) / whole * s.area
                                     : 0.0);
  }
  return out;
}

Knowledge doubted(const WaveTable& waves, Knowledge of, double variance_m2) {
  double whole = 0.0;
  for (const auto& s : waves.samples) whole += s.relief;
  for (std::size_t i = 0; i < of.noise.size(); ++i)
    of.noise[i] += variance_m2 * waves.samples[i].relief / whole;
  return of;
}

double error_variance(const WaveTable& waves, const Knowledge& of) {
  double sum = 0.0;
  for (std::size_t i = 0; i < of.noise.size(); ++i)
    sum += of.noise[i] + of.unseen[i] + std::pow(1.0 - of.kept[i], 2.0) * waves.samples[i].relief;
  return sum;
}

std::vector<double> correlation_of_errors(const WaveTable& waves, const Knowledge& of,
                                          std::size_t nodes) {
  std::vector<double> out(nodes + 1, 0.0);
  double whole = 0.0;
  for (std::size_t i = 0; i < of.noise.size(); ++i) {
    const WaveTable::Sample& s = waves.samples[i];
    const double error = of.noise[i] + of.unseen[i] + std::pow(1.0 - of.kept[i], 2.0) * s.relief;
    const double turn = 2.0 * kPi * std::hypot(s.fx, s.fy);
    for (std::size_t d = 0; d <= nodes; ++d)  // mean over all directions
      out[d] += error * std::cyl_bessel_j(0.0, turn * static_cast<double>(d));
    whole += error;
  }
  for (double& rho : out) rho = whole > 0.0 ? rho / whole : 0.0;
  return out;
}

std::vector<double> best_weights(const WaveTable& waves, const Knowledge& there,
                                 const Knowledge& other) {
  std::vector<double> weight, aim;
  for (std::size_t i = 0; i < there.noise.size(); ++i) {
    const double more = other.kept[i] - there.kept[i], relief = waves.samples[i].relief;
    const auto noise = [i](const Knowledge& of, const Knowledge& against) {
      return of.noise[i] + std::min(1.0, against.kept[i] * against.kept[i]) * of.unseen[i];
    };
    const double noise_there = noise(there, other);
    weight.push_back(more * more * relief + noise_there + noise(other, there));
    aim.push_back((1.0 - there.kept[i]) * more * relief + noise_there);
  }
  return fitted(waves, weight, aim);
}

Knowledge combined(const WaveTable& waves, const Knowledge& there, const Knowledge& other,
                   const std::vector<double>& weights) {
  Knowledge out;
  for (std::size_t i = 0; i < there.noise.size(); ++i) {
    const double w = at(waves.samples[i], weights);
    out.kept.push_back(there.kept[i] + w * (other.kept[i] - there.kept[i]));
    out.noise.push_back((1.0 - w) * (1.0 - w) * there.noise[i] + w * w * other.noise[i]);
    out.unseen.push_back((1.0 - w) * (1.0 - w) * there.unseen[i] + w * w * other.unseen[i]);
  }
  return out;
}

std::vector<double> restoring_weights(const WaveTable& waves, const Knowledge& of) {
  std::vector<double> weight, aim;
  for (std::size_t i = 0; i < of.noise.size(); ++i) {
    const double relief = waves.samples[i].relief, kept = std::max(0.0, of.kept[i]);
    // Never without noise, or what shows nothing would be raised.
    const double noise = of.noise[i] + 1e-4 * relief;
    const double shown = kept * kept * relief, whole = shown + noise;
    const double strong = std::sqrt(relief / whole), safe = kept * relief / whole;
    // From the one to the other where noise is four to sixteen times the relief.
    const double t = std::clamp(2.0 + 0.5 * std::log2(shown / noise), 0.0, 1.0);
    weight.push_back(whole);
    aim.push_back(whole * std::min(kMostGain, safe + t * (strong - safe)));
  }
  return fitted(waves, weight, aim);
}

Knowledge restored(const WaveTable& waves, const Knowledge& of,
                   const std::vector<double>& weights) {
  Knowledge out = of;
  for (std::size_t i = 0; i < of.noise.size(); ++i) {
    const double w = at(waves.samples[i], weights);
    out.kept[i] *= w;
    out.noise[i] *= w * w;
    out.unseen[i] *= w * w;
  }
  return out;
}

}  // namespace maquette::heightmap::detail

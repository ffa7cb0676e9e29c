// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/small_relief.hpp"

#include <array>
#include <cmath>
#include <numbers>
#include <vector>

#include <oneapi/tbb/parallel_for.h>

#include "core/random.hpp"

namespace maquette::heightmap::detail {
namespace {

// High pass: a lattice of normals less its binomial mean (1 8 28 56 70 56 28 8 1) / 256.
constexpr std::size_t kReach = 4;
constexpr std::array<double, 9> kBinomial = {1 / 256.,  8 / 256.,  28 / 256., 56 / 256., 70 / 256.,
                                             56 / 256., 28 / 256., 8 / 256.,  1 / 256.};
// The octave [f, 2f] lies around 0.3 / lattice step, where this high pass and the spline
// both let through.
constexpr double kStepTimesFrequency = 0.21;

std::array<double, 4> b_spline(double t) {
  const double s = 1.0 - t;
  return {s * s * s / 6.0, (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0,
          (4.0 - 6.0 * s * s + 3.0 * s * s * s) / 6.0, t * t * t / 6.0};
}

/// Of the spline at one place along one axis. Its variance is not the same everywhere between
/// lattice points: 29 % more on them than in the middle, which nodes nearly as far apart show as a
/// pattern.
struct SplineAt {
  std::ptrdiff_t first = 0;  ///< of the four lattice points
  std::array<double, 4> weight{};
  double raw = 0.0, once = 0.0, twice = 0.0;  ///< variance with the mean taken 0, 1 and 2 times

  explicit SplineAt(double x)
      : first(static_cast<std::ptrdiff_t>(std::floor(x)) - 1), weight(b_spline(x - std::floor(x))) {
    static const std::array<double, 17> mean_of_mean = [] {
      std::array<double, 17> out{};
      for (std::size_t i = 0; i < 9; ++i)
        for (std::size_t j = 0; j < 9; ++j) out[i + j] += kBinomial[i] * kBinomial[j];
      return out;
    }();
    for (std::size_t i = 0; i < 4; ++i)
      for (std::size_t j = 0; j < 4; ++j) {
        const double product = weight[i] * weight[j];
        raw += i == j ? product : 0.0;
        once += product * kBinomial[kReach + i - j];
        twice += product * mean_of_mean[2 * kReach + i - j];
      }
  }
};

/// Standard deviation of the spline field of high-passed unit normals at a place.
double deviation(const SplineAt& x, const SplineAt& y) {
  return std::sqrt(x.raw * y.raw - 2.0 * x.once * y.once + x.twice * y.twice);
}

double normal_at(std::uint64_t seed, std::uint64_t octave, std::ptrdiff_t row, std::ptrdiff_t col) {
  const auto key = mix64(static_cast<std::uint64_t>(row) ^ mix64(octave));
  return random_normal(seed ^ key, static_cast<std::uint64_t>(col) & 0xffffffffULL);
}

/// High-passed normals on lattice rows and columns [row0, row0 + rows) x [col0, ...).
Grid<float> lattice(std::uint64_t seed, std::uint64_t octave, std::ptrdiff_t row0,
                    std::ptrdiff_t col0, std::ptrdiff_t rows, std::ptrdiff_t cols) {
  constexpr auto reach = static_cast<std::ptrdiff_t>(kReach);
  Grid<float> raw(rows + 2 * reach, cols + 2 * reach);
  Grid<float> across(raw.rows(), cols);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, raw.rows(), [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < raw.cols(); ++c)
      raw(r, c) = static_cast<float>(normal_at(seed, octave, row0 - reach + r, col0 - reach + c));
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      double sum = 0.0;
      for (std::ptrdiff_t k = 0; k < 9; ++k)
        sum += kBinomial[static_cast<std::size_t>(k)] * static_cast<double>(raw(r, c + k));
      across(r, c) = static_cast<float>(sum);
    }
  });
  Grid<float> out(rows, cols);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      double sum = 0.0;
      for (std::ptrdiff_t k = 0; k < 9; ++k)
        sum += kBinomial[static_cast<std::size_t>(k)] * static_cast<double>(across(r + k, c));
      out(r, c) = raw(r + reach, c + reach) - static_cast<float>(sum);
    }
  });
  return out;
}

void add_octave(Grid<float>& z, const NodeGrid& nodes, double step_m, double sigma_m,
                std::uint64_t seed, std::uint64_t octave, const RunContext& run) {
  const auto at = [&](double first_m, std::ptrdiff_t node) {
    return SplineAt((first_m + nodes.spacing_m * static_cast<double>(node)) / step_m);
  };
  std::vector<SplineAt> across;
  for (std::ptrdiff_t c = 0; c < nodes.cols; ++c) across.push_back(at(nodes.x0_m, c));
  const std::ptrdiff_t col0 = across.front().first, row0 = at(nodes.y0_m, 0).first;
  const Grid<float> coefficient =
      lattice(seed, octave, row0, col0, at(nodes.y0_m, nodes.rows - 1).first - row0 + 4,
              across.back().first - col0 + 4);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, nodes.rows, [&](std::ptrdiff_t r) {
    if (run.stopped()) return;
    const SplineAt y = at(nodes.y0_m, r);
    for (std::ptrdiff_t c = 0; c < nodes.cols; ++c) {
      const SplineAt& x = across[static_cast<std::size_t>(c)];
      double sum = 0.0;
      for (std::ptrdiff_t i = 0; i < 4; ++i) {
        const float* row = &coefficient(y.first - row0 + i, x.first - col0);
        double line = 0.0;
        for (std::size_t j = 0; j < 4; ++j) line += x.weight[j] * static_cast<double>(row[j]);
        sum += y.weight[static_cast<std::size_t>(i)] * line;
      }
      z(r, c) += static_cast<float>(sigma_m / deviation(x, y) * sum);
    }
  });
}

}  // namespace

// The profile has the two-sided spectrum A f^-(2H+1) with
// A = C Gamma(2H+1) sin(pi H) / (2 pi)^(2H+1), from V(L) = 2 int S (1 - cos 2 pi f L) df;
// the ratio of Gamma functions turns a profile's band into a ring of the plane.
double relief_variance_m2(const Roughness& roughness, double f_low, double f_high) {
  const double h = roughness.hurst;
  const double amplitude = roughness.coefficient * std::tgamma(2.0 * h + 1.0) *
                           std::sin(std::numbers::pi * h) /
                           std::pow(2.0 * std::numbers::pi, 2.0 * h + 1.0);
  const double ring = std::sqrt(std::numbers::pi) * std::tgamma(h + 1.0) / std::tgamma(h + 0.5);
  return ring * amplitude / h * (std::pow(f_low, -2.0 * h) - std::pow(f_high, -2.0 * h));
}

Result<double> add_small_relief(Grid<float>& z, const NodeGrid& nodes, const Roughness& roughness,
                                double pixel_m, double strength, std::uint64_t seed,
                                const RunContext& run) {
  const double f_end = 0.5 / nodes.spacing_m;
  double variance = 0.0;
  std::uint64_t octave = 0;
  for (double f = 0.5 / pixel_m; f < 0.999 * f_end && roughness.coefficient > 0.0;
       f *= 2.0, ++octave) {
    const double wanted =
        strength * strength * relief_variance_m2(roughness, f, std::min(2.0 * f, f_end));
    variance += wanted;
    add_octave(z, nodes, kStepTimesFrequency / f, std::sqrt(wanted), seed, octave, run);
    if (run.stopped()) return fail(kCancelled, "making small relief was stopped");
  }
  return std::sqrt(variance);
}

}  // namespace maquette::heightmap::detail

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
constexpr std::ptrdiff_t kReach = 4;
constexpr std::array<double, 9> kBinomial = {1 / 256.,  8 / 256.,  28 / 256., 56 / 256., 70 / 256.,
                                             56 / 256., 28 / 256., 8 / 256.,  1 / 256.};
// The octave [f, 2f] lies around 0.3 / lattice step, where this high pass and the spline
// both let through.
constexpr double kStepTimesFrequency = 0.21;

/// Variance of the spline field of unit normals after the high pass, averaged over
/// positions: sum over lags of the lattice's and the spline's autocorrelation.
double field_variance() {
  constexpr std::array<double, 4> spline = {151 / 315., 397 / 1680., 1 / 42., 1 / 5040.};
  std::array<double, 17> twice{};
  for (std::size_t i = 0; i < 9; ++i)
    for (std::size_t j = 0; j < 9; ++j) twice[i + j] += kBinomial[i] * kBinomial[j];
  double once_sum = 0.0, twice_sum = 0.0;
  for (std::ptrdiff_t lag = -3; lag <= 3; ++lag) {
    const double b = spline[static_cast<std::size_t>(std::abs(lag))];
    once_sum += kBinomial[static_cast<std::size_t>(kReach + lag)] * b;
    twice_sum += twice[static_cast<std::size_t>(2 * kReach + lag)] * b;
  }
  return spline[0] * spline[0] - 2.0 * once_sum * once_sum + twice_sum * twice_sum;
}

std::array<double, 4> b_spline(double t) {
  const double s = 1.0 - t;
  return {s * s * s / 6.0, (4.0 - 6.0 * t * t + 3.0 * t * t * t) / 6.0,
          (4.0 - 6.0 * s * s + 3.0 * s * s * s) / 6.0, t * t * t / 6.0};
}

double normal_at(std::uint64_t seed, std::uint64_t octave, std::ptrdiff_t row, std::ptrdiff_t col) {
  const auto key = mix64(static_cast<std::uint64_t>(row) ^ mix64(octave));
  return random_normal(seed ^ key, static_cast<std::uint64_t>(col) & 0xffffffffULL);
}

/// High-passed normals on lattice rows and columns [row0, row0 + rows) x [col0, ...).
Grid<float> lattice(std::uint64_t seed, std::uint64_t octave, std::ptrdiff_t row0,
                    std::ptrdiff_t col0, std::ptrdiff_t rows, std::ptrdiff_t cols) {
  Grid<float> raw(rows + 2 * kReach, cols + 2 * kReach);
  Grid<float> across(raw.rows(), cols);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, raw.rows(), [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < raw.cols(); ++c)
      raw(r, c) = static_cast<float>(normal_at(seed, octave, row0 - kReach + r, col0 - kReach + c));
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
      out(r, c) = raw(r + kReach, c + kReach) - static_cast<float>(sum);
    }
  });
  return out;
}

void add_octave(Grid<float>& z, const NodeGrid& nodes, double step_m, double gain,
                std::uint64_t seed, std::uint64_t octave, const RunContext& run) {
  const auto lattice_index = [&](double x_m) {
    return static_cast<std::ptrdiff_t>(std::floor(x_m / step_m));
  };
  const double x1 = nodes.x0_m + nodes.spacing_m * static_cast<double>(nodes.cols - 1);
  const double y1 = nodes.y0_m + nodes.spacing_m * static_cast<double>(nodes.rows - 1);
  const std::ptrdiff_t col0 = lattice_index(nodes.x0_m) - 1, row0 = lattice_index(nodes.y0_m) - 1;
  const Grid<float> coefficient =
      lattice(seed, octave, row0, col0, lattice_index(y1) - row0 + 3, lattice_index(x1) - col0 + 3);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, nodes.rows, [&](std::ptrdiff_t r) {
    if (run.stopped()) return;
    const double y = (nodes.y0_m + nodes.spacing_m * static_cast<double>(r)) / step_m;
    const double fy = std::floor(y);
    const auto wy = b_spline(y - fy);
    const std::ptrdiff_t i0 = static_cast<std::ptrdiff_t>(fy) - 1 - row0;
    for (std::ptrdiff_t c = 0; c < nodes.cols; ++c) {
      const double x = (nodes.x0_m + nodes.spacing_m * static_cast<double>(c)) / step_m;
      const double fx = std::floor(x);
      const auto wx = b_spline(x - fx);
      const std::ptrdiff_t j0 = static_cast<std::ptrdiff_t>(fx) - 1 - col0;
      double sum = 0.0;
      for (std::ptrdiff_t i = 0; i < 4; ++i) {
        const float* row = &coefficient(i0 + i, j0);
        double line = 0.0;
        for (std::ptrdiff_t j = 0; j < 4; ++j)
          line += wx[static_cast<std::size_t>(j)] * static_cast<double>(row[j]);
        sum += wy[static_cast<std::size_t>(i)] * line;
      }
      z(r, c) += static_cast<float>(gain * sum);
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
  const double unit_variance = field_variance();
  double variance = 0.0;
  std::uint64_t octave = 0;
  for (double f = 0.5 / pixel_m; f < 0.999 * f_end && roughness.coefficient > 0.0;
       f *= 2.0, ++octave) {
    const double wanted =
        strength * strength * relief_variance_m2(roughness, f, std::min(2.0 * f, f_end));
    variance += wanted;
    add_octave(z, nodes, kStepTimesFrequency / f, std::sqrt(wanted / unit_variance), seed, octave,
               run);
    if (run.stopped()) return fail(kCancelled, "making small relief was stopped");
  }
  return std::sqrt(variance);
}

}  // namespace maquette::heightmap::detail

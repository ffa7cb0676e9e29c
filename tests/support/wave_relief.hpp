// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file wave_relief.hpp
/// Rough ground that is known at every place: a sum of plane waves.

#include <array>
#include <cmath>
#include <complex>
#include <cstdint>
#include <numbers>
#include <vector>

#include "core/grid.hpp"
#include "core/random.hpp"

namespace maquette::testing_support {

/// Waves from 4 to 200 pixels, amplitude as length^(hurst + 1 / 2): known at every place and
/// as the mean of any square pixel.
class WaveRelief {
 public:
  WaveRelief(std::uint64_t seed, double hurst, double roughness, double directions_rad) {
    constexpr std::uint64_t kWaves = 120;
    for (std::uint64_t i = 0; i < kWaves; ++i) {
      const double length =
          4.0 * std::pow(50.0, (static_cast<double>(i) + random_uniform(seed, 3 * i)) / kWaves);
      const double way = directions_rad * (random_uniform(seed, 3 * i + 1) - 0.5) + 0.6;
      const double k = 2.0 * std::numbers::pi / length;
      waves_.push_back({roughness * std::pow(length / 10.0, hurst), k * std::cos(way),
                        k * std::sin(way),
                        2.0 * std::numbers::pi * random_uniform(seed, 3 * i + 2)});
    }
  }
  /// Adds what square pixels see whose middles are at first + column (dx, dy) + row (-dy, dx).
  void add_to(Grid<double>& z, std::array<double, 2> first, double dx, double dy,
              double pixel) const {
    for (const Wave& w : waves_) {
      const double amplitude = w.amplitude * sinc(0.5 * w.kx * pixel) * sinc(0.5 * w.ky * pixel);
      const std::complex<double> step = std::polar(1.0, w.kx * dx + w.ky * dy);
      for (std::ptrdiff_t r = 0; r < z.rows(); ++r) {
        const auto row = static_cast<double>(r);
        std::complex<double> at = std::polar(
            amplitude, w.kx * (first[0] - row * dy) + w.ky * (first[1] + row * dx) + w.phase);
        for (std::ptrdiff_t c = 0; c < z.cols(); ++c, at *= step) z(r, c) += at.imag();
      }
    }
  }

 private:
  struct Wave {
    double amplitude, kx, ky, phase;
  };
  static double sinc(double x) { return std::abs(x) < 1e-9 ? 1.0 : std::sin(x) / x; }
  std::vector<Wave> waves_;
};

}  // namespace maquette::testing_support

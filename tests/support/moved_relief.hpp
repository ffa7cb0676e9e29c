// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file moved_relief.hpp
/// Relief known at every place as two surfaces see it that do not lie on each other.

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>

#include "core/grid.hpp"
#include "core/random.hpp"
#include "support/wave_relief.hpp"

namespace maquette::testing_support {

struct Truth {
  double east = 0.0, north = 0.0, up = 0.0, tilt_east = 0.0, tilt_north = 0.0, turn = 0.0,
         scale = 1.0;
};

/// The relief on n x n nodes one unit apart, about the middle; `truth` is what moves this surface
/// onto the relief in its place.
inline Grid<float> seen(const WaveRelief& relief, std::ptrdiff_t n, const Truth& truth,
                        double noise, std::uint64_t seed, double pixel = 1.0) {
  Grid<double> exact(n, n, 0.0);
  Grid<float> z(n, n);
  const double middle = 0.5 * static_cast<double>(n - 1);
  const double c = truth.scale * std::cos(truth.turn), s = truth.scale * std::sin(truth.turn);
  const std::array<double, 2> first{-middle * (c - s) + truth.east,
                                    -middle * (s + c) + truth.north};
  relief.add_to(exact, first, c, s, pixel);
  for (std::ptrdiff_t r = 0; r < n; ++r)
    for (std::ptrdiff_t k = 0; k < n; ++k) {
      const auto row = static_cast<double>(r), col = static_cast<double>(k);
      const double x = first[0] + c * col - s * row, y = first[1] + s * col + c * row;
      z(r, k) =
          static_cast<float>(exact(r, k) - truth.up - truth.tilt_east * x - truth.tilt_north * y +
                             noise * random_normal(seed, static_cast<std::uint64_t>(r * n + k)));
    }
  return z;
}

/// What pixels of `pixel` nodes see, interpolated back to the nodes by cubic convolution: as a
/// coarse product reaches the fusion. Its noise is one draw a pixel.
inline Grid<float> seen_coarsely(const WaveRelief& relief, std::ptrdiff_t n, int pixel,
                                 double noise, std::uint64_t seed) {
  const auto m = static_cast<std::ptrdiff_t>(n / pixel + 6);
  const double middle = 0.5 * static_cast<double>(n - 1), p = pixel;
  const double first = -p * 0.5 * static_cast<double>(m - 1);  // from the middle
  Grid<double> coarse(m, m, 0.0);
  relief.add_to(coarse, {first, first}, p, 0.0, p);
  for (std::size_t i = 0; i < coarse.cells().size(); ++i)
    coarse.cells()[i] += noise * random_normal(seed, i);
  const auto weight = [](double t) {
    t = std::abs(t);
    return t < 1.0   ? (1.5 * t - 2.5) * t * t + 1.0
           : t < 2.0 ? ((-0.5 * t + 2.5) * t - 4.0) * t + 2.0
                     : 0.0;
  };
  Grid<float> z(n, n);
  for (std::ptrdiff_t r = 0; r < n; ++r)
    for (std::ptrdiff_t k = 0; k < n; ++k) {
      const double u = (static_cast<double>(k) - middle - first) / p,
                   v = (static_cast<double>(r) - middle - first) / p;
      double sum = 0.0;
      for (auto j = static_cast<std::ptrdiff_t>(v) - 1; j < static_cast<std::ptrdiff_t>(v) + 3; ++j)
        for (auto i = static_cast<std::ptrdiff_t>(u) - 1; i < static_cast<std::ptrdiff_t>(u) + 3;
             ++i)
          sum += weight(u - static_cast<double>(i)) * weight(v - static_cast<double>(j)) *
                 coarse(j, i);
      z(r, k) = static_cast<float>(sum);
    }
  return z;
}

struct Ground {
  const char* name;
  double hurst, roughness, directions_rad;
};
inline constexpr std::array<Ground, 3> kGrounds{
    {{"hills", 0.9, 0.03, 6.2832}, {"rough", 0.5, 0.05, 6.2832}, {"ridges", 0.8, 0.04, 1.2}}};

inline Truth drawn(std::uint64_t seed, double far) {
  return {far * (2.0 * random_uniform(seed, 1) - 1.0), far * (2.0 * random_uniform(seed, 2) - 1.0),
          20.0 * (random_uniform(seed, 3) - 0.5), 0.01 * (random_uniform(seed, 4) - 0.5),
          0.01 * (random_uniform(seed, 5) - 0.5)};
}

}  // namespace maquette::testing_support

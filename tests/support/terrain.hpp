// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file terrain.hpp
/// Generated surfaces, kind and harsh, from a seed.

#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>

#include "core/random.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::testing_support {

enum class Ground { flat, rolling, rough, spikes, cliffs, knife_edges, pits };
inline constexpr std::array kGrounds{Ground::flat,   Ground::rolling, Ground::rough,
                                     Ground::spikes, Ground::cliffs,  Ground::knife_edges,
                                     Ground::pits};

inline const char* name(Ground g) {
  constexpr std::array kNames{"flat", "rolling", "rough", "spikes", "cliffs", "knifeEdges", "pits"};
  return kNames[static_cast<std::size_t>(g)];
}

/// Heights of a function of x and y, mm, at the nodes.
template <class Height>
heightmap::ModelField filled(heightmap::ModelField f, const Height& height) {
  for (std::ptrdiff_t r = 0; r < f.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < f.z_mm.cols(); ++c)
      f.z_mm(r, c) = static_cast<float>(height(f.x_mm(c), f.y_mm(r)));
  return f;
}
/// Of a square.
template <class Height>
heightmap::ModelField field_of(std::ptrdiff_t nodes, double spacing_mm, const Height& height) {
  return filled({.z_mm = Grid<float>(nodes, nodes), .spacing = Millimetres{spacing_mm}}, height);
}
/// Of a rectangle whose corner is (-4, 2) mm: frames that are mistaken for each other differ.
template <class Height>
heightmap::ModelField field_of(std::ptrdiff_t rows, std::ptrdiff_t cols, double spacing_mm,
                               const Height& height) {
  return filled(
      {Grid<float>(rows, cols), Millimetres{spacing_mm}, Millimetres{-4.0}, Millimetres{2.0}},
      height);
}

inline heightmap::ModelField flat_field(std::ptrdiff_t rows, std::ptrdiff_t cols, double spacing_mm,
                                        float z_mm) {
  return {Grid<float>(rows, cols, z_mm), Millimetres{spacing_mm}};
}

/// n x n nodes; `spacing` decides how steep the ground is.
inline heightmap::ModelField ground(Ground kind, std::uint64_t seed, std::ptrdiff_t n,
                                    double spacing_mm) {
  heightmap::ModelField f = flat_field(n, n, spacing_mm, 5.0F);
  f.x0 = Millimetres{-3.0};
  f.y0 = Millimetres{1.25};
  for (std::ptrdiff_t r = 0; r < n; ++r)
    for (std::ptrdiff_t c = 0; c < n; ++c) {
      const double x = spacing_mm * static_cast<double>(c), y = spacing_mm * static_cast<double>(r);
      const double u = random_uniform(seed, static_cast<std::uint64_t>(r * n + c));
      float& z = f.z_mm(r, c);
      switch (kind) {
        case Ground::flat:
          break;
        case Ground::rolling:
          for (std::uint64_t k = 0; k < 5; ++k) {
            const double length = 3.0 * std::pow(1.7, static_cast<double>(k));
            const double turn = 2.0 * std::numbers::pi * random_uniform(seed + 1, 2 * k);
            const double phase = 2.0 * std::numbers::pi * random_uniform(seed + 1, 2 * k + 1);
            z +=
                static_cast<float>(0.06 * length *
                                   std::sin(phase + 2.0 * std::numbers::pi / length *
                                                        (x * std::cos(turn) + y * std::sin(turn))));
          }
          break;
        case Ground::rough:
          z += static_cast<float>(spacing_mm * (u - 0.5));
          break;
        case Ground::spikes:
          if (u < 0.03) z += static_cast<float>(600.0 * u);
          break;
        case Ground::cliffs:
          z += (std::floor(x / 4.1) + std::floor(y / 5.3)) > 2.0 ? 20.0F : 0.0F;
          z += static_cast<float>(0.1 * u);
          break;
        case Ground::knife_edges:
          if (r % 7 == 3) z += static_cast<float>(3.0 + 0.5 * x);
          if (c % 9 == 4) z += static_cast<float>(4.0 + u);
          if (r == c) z += 6.0F;
          break;
        case Ground::pits:
          if (u < 0.2) z -= static_cast<float>(100.0 * u);
          break;
      }
    }
  return f;
}

/// n x n nodes at 0.5 mm, 40 mm of relief in nine octaves that fall with the length to the power of
/// 1.09: as deep as terrain, kept quick for benchmarks of 4001 x 4001.
inline heightmap::ModelField fractal(std::ptrdiff_t n) {
  heightmap::ModelField f = flat_field(n, n, 0.5, 0.0F);
  for (std::ptrdiff_t r = 0; r < n; ++r) {
    double high = 40.0, length = 512.0;
    for (std::uint64_t octave = 0; octave < 9; ++octave, high *= 0.47, length *= 0.5) {
      const auto at = [&](std::ptrdiff_t i, std::ptrdiff_t j) {
        return random_uniform(77 + octave, static_cast<std::uint64_t>(i * 65536 + j)) - 0.5;
      };
      const auto smooth = [](double u) { return u * u * u * (u * (6.0 * u - 15.0) + 10.0); };
      const double y = static_cast<double>(r) / length;
      const auto i = static_cast<std::ptrdiff_t>(y);
      const double v = smooth(y - static_cast<double>(i));
      for (std::ptrdiff_t c = 0; c < n; ++c) {
        const double x = static_cast<double>(c) / length;
        const auto j = static_cast<std::ptrdiff_t>(x);
        const double u = smooth(x - static_cast<double>(j));
        f.z_mm(r, c) +=
            static_cast<float>(high * ((1 - u) * (1 - v) * at(i, j) + u * (1 - v) * at(i, j + 1) +
                                       (1 - u) * v * at(i + 1, j) + u * v * at(i + 1, j + 1)));
      }
    }
  }
  return f;
}

}  // namespace maquette::testing_support

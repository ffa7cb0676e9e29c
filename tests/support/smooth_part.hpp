// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cmath>
#include <functional>
#include <numbers>
#include <vector>

#include "core/random.hpp"
#include "diagnosis/detail/model_search.hpp"

namespace maquette::testing_support {

using diagnosis::Measurements;
using diagnosis::Observation;
using diagnosis::SetUp;
namespace detail = diagnosis::detail;

/// A field of Gaussian correlation by random waves.
inline std::function<double(double, double)> field(std::uint64_t seed, double sigma,
                                                   double length) {
  struct Wave {
    double kx, ky, phase;
  };
  std::vector<Wave> waves;
  for (std::uint64_t i = 0; i < 300; ++i)
    waves.push_back({random_normal(seed, 3 * i) / length, random_normal(seed, 3 * i + 1) / length,
                     2.0 * std::numbers::pi * random_uniform(seed + 1, i)});
  return [=](double x, double y) {
    double sum = 0.0;
    for (const Wave& w : waves) sum += std::cos(w.kx * x + w.ky * y + w.phase);
    return sigma * std::sqrt(2.0 / 300.0) * sum;
  };
}

/// Place on the part, -1 to 1.
inline double u(const Observation& o) {
  return o.place.x / 80.0 - 1.0;
}
inline double v(const Observation& o) {
  return o.place.y / 80.0 - 1.0;
}

/// Two set-ups of 10 000 points on a part of 160 mm with heights of a smooth field.
inline Measurements noise_alone(std::uint64_t seed, double white, double sigma, double length) {
  Measurements m;
  m.scene.box.add({0, 0, 0});
  m.scene.box.add({160, 160, 20});
  const auto smooth = field(mix64(seed), sigma, length);
  for (std::uint32_t s = 0; s < 2; ++s) {
    SetUp set_up;
    set_up.centre_mm = {80, 80, 10};
    m.set_ups.push_back(set_up);
    for (std::uint64_t i = 0; i < 10'000; ++i) {
      const std::uint64_t k = i + 10'000 * s;
      Observation o;
      const double x = 160.0 * random_uniform(seed + 1, 2 * k),
                   y = 160.0 * random_uniform(seed + 1, 2 * k + 1);
      const double gx = 0.35 * std::cos(x / 7.0) + 0.2 * std::cos(0.09 * x + 0.13 * y),
                   gy = 0.3 * std::sin(y / 9.0 + 0.02 * x) + 0.28 * std::cos(0.09 * x + 0.13 * y);
      o.place = {x, y, 10.0};
      o.normal = o.along = o.slope_normal = normalized(Vec3{-gx, -gy, 1.0});
      o.tip = o.place;
      o.path_share = y / 160.0;
      o.set_up = s;
      o.residual_mm = white * random_normal(seed + 2, k) + smooth(x, y) * o.normal.z;
      m.observations.push_back(o);
    }
  }
  return m;
}

/// With the law that the nuisances leave.
inline detail::Layout laid_out(const Measurements& m, std::uint64_t seed) {
  auto layout = detail::lay_out(m.scene.box, seed);
  layout.smooth = detail::smooth_law(
      detail::sum_up(m.observations, detail::nuisances_of(m), {}, layout), layout);
  return layout;
}

}  // namespace maquette::testing_support

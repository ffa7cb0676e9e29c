// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/disc_samples.hpp"

#include <cmath>
#include <numbers>
#include <utility>

#include "core/random.hpp"

namespace maquette::camera {

DiscPoint concentric_disc(double u, double v) {
  const double a = 2.0 * u - 1.0, b = 2.0 * v - 1.0;
  if (a == 0.0 && b == 0.0) return {};
  double radius = 0.0, angle = 0.0;
  if (std::abs(a) > std::abs(b)) {
    radius = a;
    angle = 0.25 * std::numbers::pi * (b / a);
  } else {
    radius = b;
    angle = 0.5 * std::numbers::pi - 0.25 * std::numbers::pi * (a / b);
  }
  return {radius * std::cos(angle), radius * std::sin(angle)};
}

void stratified_disc(int count, std::uint64_t stream, std::vector<DiscPoint>& points) {
  int rows = static_cast<int>(std::sqrt(static_cast<double>(count)));
  while (rows > 1 && count % rows != 0) --rows;
  const int cols = count / rows;
  points.resize(static_cast<std::size_t>(count));
  std::uint64_t draw = 0;
  for (int i = 0; i < count; ++i) {
    const double u = (i % cols + random_uniform(stream, draw++)) / cols;
    const double v = (i / cols + random_uniform(stream, draw++)) / rows;
    points[static_cast<std::size_t>(i)] = concentric_disc(u, v);
  }
  // Fisher and Yates, so that a pixel's sub-sample and its lamp cell are not tied.
  for (int i = count - 1; i > 0; --i) {
    const auto j = static_cast<int>(random_uniform(stream, draw++) * (i + 1));
    std::swap(points[static_cast<std::size_t>(i)], points[static_cast<std::size_t>(j)]);
  }
}

}  // namespace maquette::camera

// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <numbers>

#include <oneapi/tbb/parallel_for.h>

#include "heightmap/fuse.hpp"

namespace maquette::heightmap {

ModelField to_model(const PlanetField& field, const ModelScale& scale, Millimetres floor) {
  const auto lowest = static_cast<double>(height_range(field.z_m).min);
  ModelField model{Grid<float>(field.z_m.rows(), field.z_m.cols()), scale.horizontal(field.spacing),
                   Millimetres{0.0}, Millimetres{0.0}};
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, field.z_m.rows(), [&](std::ptrdiff_t r) {
    const auto from = field.z_m.row(r);
    const auto to = model.z_mm.row(r);
    for (std::size_t c = 0; c < from.size(); ++c) {
      const Metres above{static_cast<double>(from[c]) - lowest};  // a void stays NaN
      to[c] = static_cast<float>((scale.vertical(above) + floor).value());
    }
  });
  return model;
}

Grid<std::uint8_t> hillshade(const ModelField& field, Radians sun_azimuth, Radians sun_elevation) {
  const Grid<float>& z = field.z_mm;
  Grid<std::uint8_t> shade(z.rows(), z.cols());
  const double sun_x = std::sin(sun_azimuth.value()) * std::cos(sun_elevation.value());
  const double sun_y = std::cos(sun_azimuth.value()) * std::cos(sun_elevation.value());
  const double sun_z = std::sin(sun_elevation.value());
  // Central difference; one-sided at borders and beside voids; flat if alone.
  const auto slope = [&](std::ptrdiff_t r, std::ptrdiff_t c, std::ptrdiff_t dr, std::ptrdiff_t dc) {
    const bool plus = z.contains(r + dr, c + dc) && !std::isnan(z(r + dr, c + dc));
    const bool minus = z.contains(r - dr, c - dc) && !std::isnan(z(r - dr, c - dc));
    if (!plus && !minus) return 0.0;
    const auto high = static_cast<double>(plus ? z(r + dr, c + dc) : z(r, c));
    const auto low = static_cast<double>(minus ? z(r - dr, c - dc) : z(r, c));
    return (high - low) / (field.spacing.value() * (plus && minus ? 2.0 : 1.0));
  };
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, z.rows(), [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < z.cols(); ++c) {
      if (std::isnan(z(r, c))) continue;
      const double sx = slope(r, c, 0, 1), sy = slope(r, c, 1, 0);
      const double cosine = (sun_z - sx * sun_x - sy * sun_y) / std::sqrt(1.0 + sx * sx + sy * sy);
      shade(r, c) = static_cast<std::uint8_t>(std::lround(255.0 * std::clamp(cosine, 0.0, 1.0)));
    }
  });
  return shade;
}

}  // namespace maquette::heightmap

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file scan_terrain.hpp
/// Rough ground and clouds on it, from a seed.

#include <cmath>
#include <cstdint>
#include <vector>

#include "core/random.hpp"
#include "core/vec.hpp"
#include "heightmap/height_field.hpp"
#include "scan/cloud.hpp"

namespace maquette::testing_support {

/// Waves from the size of the part down to a few nodes.
/// @param persistence  1: amplitude in proportion to the wavelength, slopes of some 15
///                     degrees; 0: all waves equally high, so the short ones are steep
inline heightmap::ModelField rough_part(std::uint64_t seed, std::ptrdiff_t rows,
                                        std::ptrdiff_t cols, double spacing_mm, double relief = 1.0,
                                        double persistence = 1.0) {
  heightmap::ModelField f{Grid<float>(rows, cols), Millimetres{spacing_mm}, Millimetres{0.0},
                          Millimetres{0.0}};
  const double side = spacing_mm * static_cast<double>(std::max(rows, cols) - 1);
  struct Wave {
    double kx, ky, phase, amplitude;
  };
  std::vector<Wave> waves;
  for (std::uint64_t i = 0; i < 24; ++i) {
    const double length = side * std::pow(0.78, static_cast<double>(i));
    if (length < 6.0 * spacing_mm) break;
    const double heading = 6.283185307179586 * random_uniform(seed, 3 * i);
    const double k = 6.283185307179586 / length;
    waves.push_back({k * std::cos(heading), k * std::sin(heading),
                     6.283185307179586 * random_uniform(seed, 3 * i + 1),
                     relief * 0.012 * side * std::pow(length / side, persistence)});
  }
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      double h = 10.0;
      for (const Wave& w : waves)
        h += w.amplitude * std::sin(w.kx * f.x_mm(c) + w.ky * f.y_mm(r) + w.phase);
      f.z_mm(r, c) = static_cast<float>(h);
    }
  return f;
}

/// n points on the triangulated surface, each moved along z by normal noise.
inline scan::Cloud points_on(const heightmap::ModelField& f, std::size_t n, std::uint64_t seed,
                             double sigma_mm = 0.0) {
  scan::Cloud cloud;
  const double wide = f.x_mm(f.z_mm.cols() - 1) - f.x0.value();
  const double deep = f.y_mm(f.z_mm.rows() - 1) - f.y0.value();
  cloud.points_mm.reserve(n);
  for (std::uint64_t i = 0; cloud.points_mm.size() < n; ++i) {
    const double x = f.x0.value() + wide * random_uniform(seed, 2 * i);
    const double y = f.y0.value() + deep * random_uniform(seed, 2 * i + 1);
    const double h = heightmap::height_at(f, x, y);
    if (std::isnan(h)) continue;
    const double noise = sigma_mm > 0.0 ? sigma_mm * random_normal(seed + 0x5eed, i) : 0.0;
    cloud.points_mm.push_back({x, y, h + noise});
  }
  return cloud;
}

/// The same points as another frame sees them.
inline scan::Cloud seen_from(const scan::Cloud& cloud, const RigidTransform& other_from_model) {
  scan::Cloud moved = cloud;
  for (Vec3& p : moved.points_mm) p = other_from_model.point(p);
  for (Vec3& n : moved.normals) n = other_from_model.direction(n);
  if (moved.station_mm) moved.station_mm = other_from_model.point(*moved.station_mm);
  return moved;
}

/// A pose that turns by `angle_rad` about a random axis through `centre` and then shifts
/// by `shift_mm` in a random direction.
inline RigidTransform random_pose(std::uint64_t seed, Vec3 centre, double angle_rad,
                                  double shift_mm) {
  const auto direction = [seed](std::uint64_t i) {
    return normalized(
        Vec3{random_normal(seed, i), random_normal(seed, i + 1), random_normal(seed, i + 2)});
  };
  RigidTransform t;
  t.rotation = rotation_about(direction(10), angle_rad);
  t.translation_mm = centre - rotate(t.rotation, centre) + shift_mm * direction(20);
  return t;
}

}  // namespace maquette::testing_support

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file simple_solids.hpp
/// Closed solids whose volume, area and shadows are known, made without any room.

#include <cmath>
#include <cstdint>
#include <numbers>

#include "core/check.hpp"
#include "core/random.hpp"
#include "core/tri_mesh.hpp"

namespace maquette::testing_support {

/// Axis-aligned box, 8 vertices and 12 triangles, outward.
inline TriMesh box_solid(Vec3 lo, Vec3 hi) {
  TriMesh m;
  for (int i = 0; i < 8; ++i)
    m.vertices_mm.push_back(
        {(i & 1) != 0 ? hi.x : lo.x, (i & 2) != 0 ? hi.y : lo.y, (i & 4) != 0 ? hi.z : lo.z});
  m.triangles = {{0, 2, 3}, {0, 3, 1}, {4, 5, 7}, {4, 7, 6}, {0, 1, 5}, {0, 5, 4},
                 {2, 6, 7}, {2, 7, 3}, {0, 4, 6}, {0, 6, 2}, {1, 3, 7}, {1, 7, 5}};
  return m;
}

/// Sphere by longitude and latitude, `bands` from pole to pole, outward.
inline TriMesh sphere_solid(Vec3 centre, double radius, std::uint32_t bands) {
  TriMesh m;
  const std::uint32_t around = 2 * bands;
  m.vertices_mm.push_back(centre + Vec3{0, 0, radius});
  for (std::uint32_t i = 1; i < bands; ++i)
    for (std::uint32_t j = 0; j < around; ++j) {
      const double theta = std::numbers::pi * i / bands, phi = 2 * std::numbers::pi * j / around;
      m.vertices_mm.push_back(centre + radius * Vec3{std::sin(theta) * std::cos(phi),
                                                     std::sin(theta) * std::sin(phi),
                                                     std::cos(theta)});
    }
  m.vertices_mm.push_back(centre - Vec3{0, 0, radius});
  const auto last = static_cast<std::uint32_t>(m.vertices_mm.size() - 1);
  const auto at = [around](std::uint32_t i, std::uint32_t j) {
    return 1 + (i - 1) * around + j % around;
  };
  for (std::uint32_t j = 0; j < around; ++j) {
    m.triangles.push_back({0, at(1, j), at(1, j + 1)});
    for (std::uint32_t i = 1; i + 1 < bands; ++i) {
      m.triangles.push_back({at(i, j), at(i + 1, j), at(i + 1, j + 1)});
      m.triangles.push_back({at(i, j), at(i + 1, j + 1), at(i, j + 1)});
    }
    m.triangles.push_back({last, at(bands - 1, j + 1), at(bands - 1, j)});
  }
  return m;
}

/// Solid under z = height(x, y) on n x n nodes, walls and a flat base of one node for
/// each border node (two triangle fans would need far fewer, this is closed as well).
template <class Height>
TriMesh terrain_solid(std::uint32_t n, double spacing, double base_z, Height height) {
  TriMesh m;
  m.vertices_mm.reserve(std::size_t{n} * n + 4 * n);
  m.triangles.reserve(2 * std::size_t{n - 1} * (n - 1) + 12 * n);
  for (std::uint32_t r = 0; r < n; ++r)
    for (std::uint32_t c = 0; c < n; ++c)
      m.vertices_mm.push_back({c * spacing, r * spacing, height(c * spacing, r * spacing)});
  for (std::uint32_t r = 0; r + 1 < n; ++r)
    for (std::uint32_t c = 0; c + 1 < n; ++c) {
      const std::uint32_t a = r * n + c, b = a + 1, d = a + n, e = d + 1;
      m.triangles.push_back({a, b, e});
      m.triangles.push_back({a, e, d});
    }
  // The border, counter-clockwise from above, its copy on the base, and the middle.
  std::vector<std::uint32_t> border;
  for (std::uint32_t c = 0; c + 1 < n; ++c) border.push_back(c);
  for (std::uint32_t r = 0; r + 1 < n; ++r) border.push_back(r * n + n - 1);
  for (std::uint32_t c = n - 1; c > 0; --c) border.push_back((n - 1) * n + c);
  for (std::uint32_t r = n - 1; r > 0; --r) border.push_back(r * n);
  const auto first = static_cast<std::uint32_t>(m.vertices_mm.size());
  for (const std::uint32_t v : border)
    m.vertices_mm.push_back({m.vertices_mm[v].x, m.vertices_mm[v].y, base_z});
  const auto middle = static_cast<std::uint32_t>(m.vertices_mm.size());
  m.vertices_mm.push_back({0.5 * (n - 1) * spacing, 0.5 * (n - 1) * spacing, base_z});
  const auto count = static_cast<std::uint32_t>(border.size());
  for (std::uint32_t i = 0; i < count; ++i) {
    const std::uint32_t j = (i + 1) % count;
    m.triangles.push_back({first + i, first + j, border[j]});
    m.triangles.push_back({first + i, border[j], border[i]});
    m.triangles.push_back({middle, first + j, first + i});
  }
  return m;
}

/// Smooth hills and pits: a few sines of random direction, amplitude about `relief`.
class Hills {
 public:
  Hills(std::uint64_t seed, double size, double relief) {
    for (std::uint64_t k = 0; k < waves_.size(); ++k) {
      const double turn = 2 * std::numbers::pi * random_uniform(seed, 3 * k);
      const double wave = size / (1.5 + 1.3 * static_cast<double>(k));
      waves_[k] = {2 * std::numbers::pi / wave * std::cos(turn),
                   2 * std::numbers::pi / wave * std::sin(turn),
                   2 * std::numbers::pi * random_uniform(seed, 3 * k + 1),
                   relief / static_cast<double>(1 + k)};
    }
  }
  double operator()(double x, double y) const {
    double z = 0;
    for (const auto& w : waves_) z += w.amplitude * std::sin(w.kx * x + w.ky * y + w.phase);
    return z;
  }

 private:
  struct Wave {
    double kx, ky, phase, amplitude;
  };
  std::array<Wave, 8> waves_{};
};

/// Signed volume by the divergence theorem.
inline double volume_mm3(const TriMesh& mesh) {
  double six = 0.0;
  for (const auto& t : mesh.triangles)
    six += dot(mesh.vertices_mm[t[0]], cross(mesh.vertices_mm[t[1]], mesh.vertices_mm[t[2]]));
  return six / 6.0;
}

}  // namespace maquette::testing_support

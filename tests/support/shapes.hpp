// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file shapes.hpp
/// Surfaces and bodies from a seed, for tests that need many of them.

#include <cmath>
#include <cstdint>
#include <map>
#include <numbers>
#include <utility>

#include "core/random.hpp"
#include "core/tri_mesh.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::testing_support {

/// Six waves of 6 to 60 nodes with a slope of about `steepness` each, and noise of
/// `noise_mm` at every node.
inline heightmap::ModelField random_terrain(std::uint64_t seed, std::ptrdiff_t rows,
                                            std::ptrdiff_t cols, double spacing_mm,
                                            double steepness = 0.1, double noise_mm = 0.0) {
  heightmap::ModelField field{Grid<float>(rows, cols), Millimetres{spacing_mm}, Millimetres{0},
                              Millimetres{0}};
  Grid<double> z(rows, cols, 0.0);
  for (std::uint64_t wave = 0; wave < 6; ++wave) {
    const double length = 6.0 * std::pow(10.0, random_uniform(seed, 3 * wave));  // in nodes
    const double heading = 2.0 * std::numbers::pi * random_uniform(seed, 3 * wave + 1);
    const double start = 2.0 * std::numbers::pi * random_uniform(seed, 3 * wave + 2);
    const double k = 2.0 * std::numbers::pi / length;
    for (std::ptrdiff_t r = 0; r < rows; ++r)
      for (std::ptrdiff_t c = 0; c < cols; ++c)
        z(r, c) += steepness * spacing_mm / k *
                   std::sin(start + k * (static_cast<double>(r) * std::sin(heading) +
                                         static_cast<double>(c) * std::cos(heading)));
  }
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c)
      field.z_mm(r, c) = static_cast<float>(
          z(r, c) +
          noise_mm * random_normal(seed + 1000, static_cast<std::uint64_t>(r * cols + c)));
  return field;
}

/// Unit icosahedron, each triangle cut in four `subdivisions` times, corners on the sphere.
inline TriMesh unit_sphere(int subdivisions) {
  const double g = 0.5 * (1.0 + std::sqrt(5.0));
  TriMesh m;
  m.vertices_mm = {{-1, g, 0},  {1, g, 0},  {-1, -g, 0}, {1, -g, 0}, {0, -1, g},  {0, 1, g},
                   {0, -1, -g}, {0, 1, -g}, {g, 0, -1},  {g, 0, 1},  {-g, 0, -1}, {-g, 0, 1}};
  m.triangles = {{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11},
                 {1, 5, 9},  {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                 {3, 9, 4},  {3, 4, 2},  {3, 2, 6},   {3, 6, 8},  {3, 8, 9},
                 {4, 9, 5},  {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
  for (Vec3& v : m.vertices_mm) v = normalized(v);
  for (int level = 0; level < subdivisions; ++level) {
    std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middle;
    const auto between = [&](std::uint32_t a, std::uint32_t b) {
      const auto [it, fresh] = middle.try_emplace({std::min(a, b), std::max(a, b)},
                                                  static_cast<std::uint32_t>(m.vertices_mm.size()));
      if (fresh) m.vertices_mm.push_back(normalized(m.vertices_mm[a] + m.vertices_mm[b]));
      return it->second;
    };
    std::vector<std::array<std::uint32_t, 3>> finer;
    for (const auto& [a, b, c] : m.triangles) {
      const std::uint32_t ab = between(a, b), bc = between(b, c), ca = between(c, a);
      finer.push_back({a, ab, ca});
      finer.push_back({b, bc, ab});
      finer.push_back({c, ca, bc});
      finer.push_back({ab, bc, ca});
    }
    m.triangles = std::move(finer);
  }
  return m;
}

/// A lumpy body with facets: a sphere cut by random planes and dented by noise.
inline TriMesh random_rock(std::uint64_t seed, Vec3 centre_mm, double radius_mm,
                           int subdivisions = 4, double noise = 0.03) {
  TriMesh rock = unit_sphere(subdivisions);
  std::vector<Vec3> facet;
  std::vector<double> offset;
  for (std::uint64_t i = 0; i < 14; ++i) {
    facet.push_back(normalized(Vec3{random_normal(seed, 4 * i), random_normal(seed, 4 * i + 1),
                                    random_normal(seed, 4 * i + 2)}));
    offset.push_back(0.6 + 0.3 * random_uniform(seed, 1000 + i));
  }
  for (std::size_t v = 0; v < rock.vertices_mm.size(); ++v) {
    const Vec3 d = rock.vertices_mm[v];
    double r = 1.0;
    for (std::size_t i = 0; i < facet.size(); ++i)
      if (const double along = dot(d, facet[i]); along > 0.0) r = std::fmin(r, offset[i] / along);
    r *= 1.0 + noise * (2.0 * random_uniform(seed, 2000 + v) - 1.0);
    rock.vertices_mm[v] = centre_mm + radius_mm * r * Vec3{d.x, 1.2 * d.y, 0.8 * d.z};
  }
  return rock;
}

}  // namespace maquette::testing_support

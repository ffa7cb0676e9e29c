// SPDX-License-Identifier: GPL-3.0-or-later
#include "assets/rocks.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <unordered_map>

#include "core/check.hpp"
#include "core/random.hpp"

namespace maquette::assets {
namespace {

/// Streams of random numbers that one rock draws from.
enum Stream : std::uint64_t { kFacets = 1, kNoise = 2 };

Vec3 random_direction(std::uint64_t stream, std::uint64_t counter) {
  const double z = 2.0 * random_uniform(stream, 2 * counter) - 1.0;
  const double turn = 2.0 * std::numbers::pi * random_uniform(stream, 2 * counter + 1);
  const double r = std::sqrt(std::fmax(0.0, 1.0 - z * z));
  return {r * std::cos(turn), r * std::sin(turn), z};
}

// ---- unit directions --------------------------------------------------------

TriMesh icosahedron() {
  const double t = std::numbers::phi;
  TriMesh m;
  m.vertices_mm = {{-1, t, 0},  {1, t, 0},  {-1, -t, 0}, {1, -t, 0}, {0, -1, t},  {0, 1, t},
                   {0, -1, -t}, {0, 1, -t}, {t, 0, -1},  {t, 0, 1},  {-t, 0, -1}, {-t, 0, 1}};
  for (Vec3& v : m.vertices_mm) v = normalized(v);
  m.triangles = {{0, 11, 5}, {0, 5, 1},  {0, 1, 7},   {0, 7, 10}, {0, 10, 11},
                 {1, 5, 9},  {5, 11, 4}, {11, 10, 2}, {10, 7, 6}, {7, 1, 8},
                 {3, 9, 4},  {3, 4, 2},  {3, 2, 6},   {3, 6, 8},  {3, 8, 9},
                 {4, 9, 5},  {2, 4, 11}, {6, 2, 10},  {8, 6, 7},  {9, 8, 1}};
  return m;
}

/// Each triangle into four; the new vertices go onto the sphere.
void subdivide(TriMesh& m) {
  std::unordered_map<std::uint64_t, std::uint32_t> middle_of;
  middle_of.reserve(m.triangles.size() * 3 / 2);
  const auto middle = [&](std::uint32_t a, std::uint32_t b) {
    const std::uint64_t key = (std::uint64_t{std::min(a, b)} << 32) | std::max(a, b);
    const auto [it, is_new] =
        middle_of.try_emplace(key, static_cast<std::uint32_t>(m.vertices_mm.size()));
    if (is_new) m.vertices_mm.push_back(normalized(m.vertices_mm[a] + m.vertices_mm[b]));
    return it->second;
  };
  std::vector<std::array<std::uint32_t, 3>> finer;
  finer.reserve(4 * m.triangles.size());
  for (const auto& [a, b, c] : m.triangles) {
    const std::uint32_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
    finer.insert(finer.end(), {{a, ab, ca}, {b, bc, ab}, {c, ca, bc}, {ab, bc, ca}});
  }
  m.triangles = std::move(finer);
}

// ---- radius -----------------------------------------------------------------

struct HalfSpace {
  Vec3 normal;
  double distance = 1.0;
};

/// Six planes near the axes keep the polyhedron bounded; the rest cut its corners.
std::vector<HalfSpace> facets(std::uint64_t seed) {
  constexpr std::array<Vec3, 6> axes{
      {{0, 0, -1}, {0, 0, 1}, {1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}}};
  constexpr std::uint64_t cuts = 14;
  constexpr double tilt = 0.25;
  const std::uint64_t stream = random_bits(seed, kFacets);
  std::vector<HalfSpace> all;
  for (std::uint64_t i = 0; i < axes.size() + cuts; ++i) {
    HalfSpace h;
    const Vec3 random = random_direction(stream, 2 * i);
    const double u = random_uniform(stream, 4 * i + 2);
    if (i == 0) {  // the base stays horizontal
      h = {axes[0], 0.75 + 0.15 * u};
    } else if (i < axes.size()) {
      h = {normalized(axes[i] + tilt * random), 0.8 + 0.2 * u};
    } else {
      h = {random, 0.82 + 0.23 * u};
    }
    all.push_back(h);
  }
  return all;
}

double polyhedron_radius(const std::vector<HalfSpace>& planes, Vec3 direction) {
  double radius = 3.0;  // farther than any corner that the six axis planes leave
  for (const HalfSpace& h : planes) {
    const double along = dot(h.normal, direction);
    if (along * radius > h.distance) radius = h.distance / along;
  }
  return radius;
}

/// Unit gradients of one rock's noise, drawn once.
using Gradients = std::array<Vec3, 1024>;

Gradients draw_gradients(std::uint64_t seed) {
  const std::uint64_t stream = random_bits(seed, kNoise);
  Gradients all;
  for (std::uint64_t i = 0; i < all.size(); ++i) all[i] = random_direction(stream, i);
  return all;
}

/// Gradient noise in [-1, 1]: with unit gradients a 3-d cell reaches sqrt(3)/2 at most.
double gradient_noise(const Gradients& gradients, std::uint64_t octave, Vec3 p) {
  const Vec3 base{std::floor(p.x), std::floor(p.y), std::floor(p.z)};
  const Vec3 f = p - base;
  const auto fade = [](double t) { return t * t * t * (t * (6.0 * t - 15.0) + 10.0); };
  const Vec3 w{fade(f.x), fade(f.y), fade(f.z)};
  const auto lattice = [](double v) {
    return static_cast<std::uint64_t>(static_cast<std::int64_t>(v));
  };
  double sum = 0.0;
  for (int corner = 0; corner < 8; ++corner) {
    const Vec3 c{static_cast<double>(corner & 1), static_cast<double>((corner >> 1) & 1),
                 static_cast<double>(corner >> 2)};
    // 20 bits a coordinate are far more than a rock has cells.
    const std::uint64_t cell = mix64((octave << 60) ^ (lattice(base.x + c.x) & 0xfffff) ^
                                     ((lattice(base.y + c.y) & 0xfffff) << 20) ^
                                     ((lattice(base.z + c.z) & 0xfffff) << 40));
    const double weight = (c.x > 0.5 ? w.x : 1.0 - w.x) * (c.y > 0.5 ? w.y : 1.0 - w.y) *
                          (c.z > 0.5 ? w.z : 1.0 - w.z);
    sum += weight * dot(gradients[cell % gradients.size()], f - c);
  }
  return sum;
}

/// Five octaves, amplitudes halved, scaled so that the sum stays within [-1, 1].
double octaves(const Gradients& gradients, Vec3 direction) {
  double sum = 0.0, amplitude = 1.0, total = 0.0, frequency = 1.7;
  for (std::uint64_t octave = 0; octave < 5; ++octave) {
    sum += amplitude * gradient_noise(gradients, octave, frequency * direction);
    total += amplitude;
    amplitude *= 0.5;
    frequency *= 2.0;
  }
  return sum / total;
}

// ---- proportions --------------------------------------------------------------

/// Area of the convex hull seen from above (monotone chain).
double hull_area(std::span<const Vec3> vertices) {
  std::vector<std::array<double, 2>> p;
  p.reserve(vertices.size());
  for (const Vec3& v : vertices) p.push_back({v.x, v.y});
  std::sort(p.begin(), p.end());
  const auto turn = [](const auto& a, const auto& b, const auto& c) {
    return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
  };
  std::vector<std::array<double, 2>> hull;
  for (int side = 0; side < 2; ++side) {
    const std::size_t start = hull.size();
    for (const auto& q : p) {
      while (hull.size() >= start + 2 && turn(hull[hull.size() - 2], hull.back(), q) <= 0.0)
        hull.pop_back();
      hull.push_back(q);
    }
    hull.pop_back();
    std::reverse(p.begin(), p.end());
  }
  double twice = 0.0;
  for (std::size_t i = 0; i < hull.size(); ++i) {
    const auto& a = hull[i];
    const auto& b = hull[(i + 1) % hull.size()];
    twice += a[0] * b[1] - a[1] * b[0];
  }
  return 0.5 * twice;
}

void stretch(std::vector<Vec3>& vertices, Vec3 factor) {
  for (Vec3& v : vertices) v = {factor.x * v.x, factor.y * v.y, factor.z * v.z};
}

void give_proportions(TriMesh& rock, double flatness, double elongation) {
  const Box3 box = rock.bounds();
  const Vec3 extent = box.max - box.min;
  stretch(rock.vertices_mm, {1.0, elongation * extent.x / extent.y, 1.0});
  const double diameter = equivalent_diameter(rock.vertices_mm);
  stretch(rock.vertices_mm, {1.0 / diameter, 1.0 / diameter, flatness / extent.z});
}

}  // namespace

double equivalent_diameter(std::span<const Vec3> vertices) {
  return std::sqrt(hull_area(vertices) * 4.0 / std::numbers::pi);
}

TriMesh make_rock(const RockShape& shape) {
  MAQUETTE_CHECK(shape.angularity >= 0.0 && shape.angularity <= 1.0, "{}", shape.angularity);
  MAQUETTE_CHECK(shape.flatness >= 0.3 && shape.flatness <= 1.0, "{}", shape.flatness);
  MAQUETTE_CHECK(shape.elongation >= 0.4 && shape.elongation <= 1.0, "{}", shape.elongation);
  MAQUETTE_CHECK(shape.roughness >= 0.0 && shape.roughness <= 0.1, "{}", shape.roughness);
  MAQUETTE_CHECK(shape.subdivisions >= 0 && shape.subdivisions <= 7, "{}", shape.subdivisions);

  TriMesh rock = icosahedron();
  for (int i = 0; i < shape.subdivisions; ++i) subdivide(rock);
  const std::vector<HalfSpace> planes = facets(shape.seed);
  const Gradients gradients = draw_gradients(shape.seed);
  for (Vec3& v : rock.vertices_mm) {
    const double body = shape.angularity * polyhedron_radius(planes, v) + (1.0 - shape.angularity);
    const double bumps = shape.roughness > 0.0 ? octaves(gradients, v) : 0.0;
    // The displacement is a share of the diameter, which is two radii.
    v = body * (1.0 + 2.0 * shape.roughness * bumps) * v;
  }
  give_proportions(rock, shape.flatness, shape.elongation);
  return rock;
}

}  // namespace maquette::assets

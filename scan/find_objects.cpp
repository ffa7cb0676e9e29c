// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/find_objects.hpp"

#include <algorithm>
#include <cmath>

#include "core/grid.hpp"

namespace maquette::scan {
namespace {

constexpr double kPointsPerCell = 6.0;
constexpr std::size_t kLeastPoints = 12;
constexpr double kMostCells = 16e6;

struct Footprint {
  int number;
  Vec3 middle;
  double radius, length, width, height;
};

std::vector<Footprint> footprints_of(std::span<const meshing::PlacedStone> plan,
                                     const heightmap::ModelField& ground) {
  std::vector<Footprint> prints;
  for (const meshing::PlacedStone& stone : plan) {
    const TriMesh mesh = meshing::stone_mesh(stone);
    const Box3 box = mesh.bounds();
    Footprint f{stone.number, 0.5 * (box.min + box.max), 0.0, 0.0, 0.0, 0.0};
    double xx = 0.0, xy = 0.0, yy = 0.0;
    for (const Vec3& v : mesh.vertices_mm) {
      const double x = v.x - f.middle.x, y = v.y - f.middle.y;
      f.radius = std::fmax(f.radius, std::hypot(x, y));
      xx += x * x, xy += x * y, yy += y * y;
    }
    // Longest and shortest chord through the middle, along the principal axes.
    const double angle = 0.5 * std::atan2(2.0 * xy, xx - yy);
    double along[2] = {0.0, 0.0}, across[2] = {0.0, 0.0};
    for (const Vec3& v : mesh.vertices_mm) {
      const double x = v.x - f.middle.x, y = v.y - f.middle.y;
      const double u = x * std::cos(angle) + y * std::sin(angle);
      const double w = y * std::cos(angle) - x * std::sin(angle);
      along[0] = std::fmin(along[0], u), along[1] = std::fmax(along[1], u);
      across[0] = std::fmin(across[0], w), across[1] = std::fmax(across[1], w);
    }
    f.length = along[1] - along[0];
    f.width = across[1] - across[0];
    f.height = box.max.z - heightmap::height_at(ground, f.middle.x, f.middle.y);
    prints.push_back(f);
  }
  return prints;
}

/// Within a fifth of each other.
bool alike(double a, double b) {
  return std::abs(a - b) <= 0.2 * std::fmax(a, b);
}

}  // namespace

std::vector<ExtraObject> find_objects(std::span<const Vec3> points,
                                      const heightmap::ModelField& expected,
                                      std::span<const meshing::PlacedStone> plan,
                                      std::span<const int> missing, double noise_mm) {
  const double wide = expected.x_mm(expected.z_mm.cols() - 1) - expected.x0.value();
  const double deep = expected.y_mm(expected.z_mm.rows() - 1) - expected.y0.value();
  if (points.empty()) return {};
  const double cell =
      std::fmax(std::sqrt(kPointsPerCell * wide * deep / static_cast<double>(points.size())),
                std::sqrt(wide * deep / kMostCells));
  const auto prints = footprints_of(plan, expected);
  const double lift = 5.0 * noise_mm;
  struct Cell {
    std::uint32_t all = 0, high = 0;
  };
  Grid<Cell> cells(static_cast<std::ptrdiff_t>(deep / cell) + 1,
                   static_cast<std::ptrdiff_t>(wide / cell) + 1);
  const auto place = [&](Vec3 p) {
    return std::pair{static_cast<std::ptrdiff_t>((p.y - expected.y0.value()) / cell),
                     static_cast<std::ptrdiff_t>((p.x - expected.x0.value()) / cell)};
  };
  std::vector<std::pair<Vec3, double>> high;  // and how far above
  for (const Vec3& p : points) {
    const double above = p.z - heightmap::height_at(expected, p.x, p.y);
    if (std::isnan(above)) continue;
    const auto [r, c] = place(p);
    ++cells(r, c).all;
    if (above <= lift) continue;
    // Stones are few, high points too.
    if (std::any_of(prints.begin(), prints.end(), [&](const Footprint& f) {
          return std::hypot(p.x - f.middle.x, p.y - f.middle.y) < 1.25 * f.radius + cell &&
                 std::find(missing.begin(), missing.end(), f.number) == missing.end();
        }))
      continue;
    ++cells(r, c).high;
    high.emplace_back(p, above);
  }
  Grid<int> object(cells.rows(), cells.cols(), -1);
  std::vector<std::size_t> cells_of;
  const auto full = [&](std::ptrdiff_t r, std::ptrdiff_t c) {
    return cells.contains(r, c) && 2 * cells(r, c).high >= cells(r, c).all && cells(r, c).high > 0;
  };
  for (std::ptrdiff_t r = 0; r < cells.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < cells.cols(); ++c) {
      if (!full(r, c) || object(r, c) >= 0) continue;
      const int k = static_cast<int>(cells_of.size());
      std::vector<std::pair<std::ptrdiff_t, std::ptrdiff_t>> queue{{r, c}};
      object(r, c) = k;
      for (std::size_t i = 0; i < queue.size(); ++i)
        for (std::ptrdiff_t a = -1; a <= 1; ++a)
          for (std::ptrdiff_t b = -1; b <= 1; ++b) {
            const std::ptrdiff_t y = queue[i].first + a, x = queue[i].second + b;
            if (!full(y, x) || object(y, x) >= 0) continue;
            object(y, x) = k;
            queue.emplace_back(y, x);
          }
      cells_of.push_back(queue.size());
    }

  struct Gathered {
    std::vector<double> above;
    double x = 0.0, y = 0.0, xx = 0.0, xy = 0.0, yy = 0.0, sum = 0.0;
  };
  std::vector<Gathered> gathered(cells_of.size());
  for (const auto& [p, above] : high) {
    const auto [r, c] = place(p);
    if (object(r, c) < 0) continue;
    Gathered& g = gathered[static_cast<std::size_t>(object(r, c))];
    const double x = p.x - expected.x0.value(), y = p.y - expected.y0.value();
    g.above.push_back(above);
    g.x += x, g.y += y, g.xx += x * x, g.xy += x * y, g.yy += y * y, g.sum += above;
  }
  std::vector<ExtraObject> objects;
  for (std::size_t k = 0; k < gathered.size(); ++k) {
    Gathered& g = gathered[k];
    if (g.above.size() < kLeastPoints) continue;
    const auto n = static_cast<double>(g.above.size());
    ExtraObject o;
    o.points = g.above.size();
    o.centre_mm = {expected.x0.value() + g.x / n, expected.y0.value() + g.y / n, 0.0};
    o.centre_mm.z = heightmap::height_at(expected, o.centre_mm.x, o.centre_mm.y);
    const auto at = g.above.begin() + static_cast<std::ptrdiff_t>(0.95 * (n - 1.0));
    std::nth_element(g.above.begin(), at, g.above.end());
    o.height_mm = *at;
    o.sigma_height_mm = noise_mm;
    o.volume_mm3 = g.sum / n * static_cast<double>(cells_of[k]) * cell * cell;
    // An ellipse evenly filled has second moments a^2 / 16 and b^2 / 16 of its axes a, b.
    const double xx = g.xx / n - g.x * g.x / (n * n), yy = g.yy / n - g.y * g.y / (n * n);
    const double xy = g.xy / n - g.x * g.y / (n * n);
    const double half = 0.5 * (xx + yy), root = std::hypot(0.5 * (xx - yy), xy);
    o.length_mm = 4.0 * std::sqrt(std::fmax(0.0, half + root));
    o.width_mm = 4.0 * std::sqrt(std::fmax(0.0, half - root));
    double nearest = INFINITY;
    for (const Footprint& f : prints)
      if (std::find(missing.begin(), missing.end(), f.number) != missing.end() &&
          alike(o.length_mm, f.length) && alike(o.width_mm, f.width) &&
          alike(o.height_mm, f.height) && std::abs(o.height_mm - f.height) < nearest) {
        nearest = std::abs(o.height_mm - f.height);
        o.resembles = f.number;
      }
    objects.push_back(o);
  }
  std::sort(objects.begin(), objects.end(),
            [](const ExtraObject& a, const ExtraObject& b) { return a.volume_mm3 > b.volume_mm3; });
  return objects;
}

}  // namespace maquette::scan

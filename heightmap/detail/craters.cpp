// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/craters.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include <oneapi/tbb/parallel_for.h>

#include "core/random.hpp"
#include "heightmap/crater_production.hpp"

namespace maquette::heightmap::detail {
namespace {

constexpr double kFresh = 0.2, kFaded = 0.03;  // depth / diameter
constexpr double kReach = 3.0;                 // radii
constexpr double kRim = 0.2407;                // of the depth: no mean, see below
constexpr double kCellDiameters = 16.0;
constexpr std::ptrdiff_t kTileRows = 64;
constexpr std::uint64_t kStreams = 4;  // random numbers of a crater

/// Between rim and reach: x^-3 less its value at the end, one at the rim. With it the volumes are
/// pi R^2 (h - d / 2) below x = 1 and 2 pi R^2 h 0.5385 beyond, which is zero for h = 0.2407 d.
double ejecta(double x) {
  constexpr double end = 1.0 / (kReach * kReach * kReach);
  return (1.0 / (x * x * x) - end) / (1.0 - end);
}

double shape(double x, double depth_m) {
  if (x >= kReach) return 0.0;
  const double rim = kRim * depth_m;
  return x < 1.0 ? rim - depth_m * (1.0 - x * x) : rim * ejecta(x);
}

double class_diameter(int k) {
  return std::exp2(0.5 * k);
}

/// Of craters that have been there for the share `life` of what they last.
double depth_of(double diameter_m, double life) {
  return kFresh * diameter_m * std::pow(kFaded / kFresh, life);
}

/// How far craters of a size have come towards equilibrium.
double ripeness(const CraterField& f, double diameter_m) {
  return std::min(
      1.0, craters_produced(f.body, f.age_gyr, diameter_m) / craters_in_equilibrium(diameter_m));
}

/// The diameter of which `wanted` craters a square metre are larger, between two diameters.
double diameter_of(const CraterField& f, double wanted, double low, double high) {
  for (int i = 0; i < 50; ++i) {
    const double middle = std::sqrt(low * high);
    (craters_present(f.body, f.age_gyr, middle) > wanted ? low : high) = middle;
  }
  return std::sqrt(low * high);
}

/// Poisson number from one uniform number. Means are some tens at most.
int poisson(double mean, double uniform) {
  double chance = std::exp(-mean), sum = chance;
  int n = 0;
  while (uniform > sum && n < 1000) {
    ++n;
    chance *= mean / n;
    sum += chance;
  }
  return n;
}

std::uint64_t cell_seed(std::uint64_t seed, int k, std::ptrdiff_t row, std::ptrdiff_t col) {
  std::uint64_t s = mix64(seed ^ 0x6372617465727321ULL);
  for (const auto part : {static_cast<std::uint64_t>(k + 1000), static_cast<std::uint64_t>(row),
                          static_cast<std::uint64_t>(col)})
    s = mix64(s ^ part);
  return s;
}

struct Rectangle {
  double x0, y0, x1, y1;
};

void draw_class(const CraterField& f, int k, const Rectangle& in, std::vector<Crater>& out) {
  const double low = class_diameter(k), high = class_diameter(k + 1);
  const double more = craters_present(f.body, f.age_gyr, low),
               fewer = craters_present(f.body, f.age_gyr, high);
  const double side = kCellDiameters * high, reach = 0.5 * kReach * high;
  const double mean = (more - fewer) * side * side;
  const auto cell = [&](double x) { return static_cast<std::ptrdiff_t>(std::floor(x / side)); };
  for (std::ptrdiff_t row = cell(in.y0 - reach); row <= cell(in.y1 + reach); ++row)
    for (std::ptrdiff_t col = cell(in.x0 - reach); col <= cell(in.x1 + reach); ++col) {
      const std::uint64_t seed = cell_seed(f.seed, k, row, col);
      const int n = poisson(mean, random_uniform(seed, 0));
      for (int i = 0; i < n; ++i) {
        const auto draw = [&](std::uint64_t what) {
          return random_uniform(seed, 1 + kStreams * static_cast<std::uint64_t>(i) + what);
        };
        const double d = diameter_of(f, fewer + draw(2) * (more - fewer), low, high);
        Crater c{side * (static_cast<double>(col) + draw(0)),
                 side * (static_cast<double>(row) + draw(1)), d,
                 depth_of(d, draw(3) * ripeness(f, d))};
        const double far = 0.5 * kReach * d;
        if (d < f.smallest_m || d >= f.largest_m || c.x_m + far < in.x0 || c.x_m - far > in.x1 ||
            c.y_m + far < in.y0 || c.y_m - far > in.y1)
          continue;
        out.push_back(c);
      }
    }
}

/// Mean of a crater over the cell of a node.
double mean_over_cell(const Crater& c, double x, double y, double spacing) {
  const double radius = 0.5 * c.diameter_m;
  const int parts = std::clamp(static_cast<int>(std::ceil(6.0 * spacing / c.diameter_m)), 1, 6);
  double sum = 0.0;
  for (int i = 0; i < parts; ++i)
    for (int j = 0; j < parts; ++j) {
      const double dx = x - c.x_m + spacing * ((i + 0.5) / parts - 0.5);
      const double dy = y - c.y_m + spacing * ((j + 0.5) / parts - 0.5);
      sum += shape(std::hypot(dx, dy) / radius, c.depth_m);
    }
  return sum / (parts * parts);
}

void add_row(Grid<float>& z, std::ptrdiff_t r, const NodeGrid& nodes,
             const std::vector<const Crater*>& craters) {
  std::vector<double> line(static_cast<std::size_t>(nodes.cols), 0.0);
  const double y = nodes.y0_m + nodes.spacing_m * static_cast<double>(r);
  for (const Crater* c : craters) {
    const double far = 0.5 * kReach * c->diameter_m + nodes.spacing_m;
    if (std::abs(y - c->y_m) > far) continue;
    const auto column = [&](double x) { return std::floor((x - nodes.x0_m) / nodes.spacing_m); };
    const auto first = static_cast<std::ptrdiff_t>(std::max(0.0, column(c->x_m - far)));
    const auto last = static_cast<std::ptrdiff_t>(
        std::min(static_cast<double>(nodes.cols - 1), column(c->x_m + far) + 1.0));
    for (std::ptrdiff_t k = first; k <= last; ++k)
      line[static_cast<std::size_t>(k)] += mean_over_cell(
          *c, nodes.x0_m + nodes.spacing_m * static_cast<double>(k), y, nodes.spacing_m);
  }
  for (std::ptrdiff_t k = 0; k < nodes.cols; ++k)
    z(r, k) = static_cast<float>(static_cast<double>(z(r, k)) + line[static_cast<std::size_t>(k)]);
}

}  // namespace

std::vector<Crater> draw_craters(const CraterField& field, double x0_m, double y0_m, double x1_m,
                                 double y1_m) {
  std::vector<Crater> out;
  if (!(field.largest_m > field.smallest_m) || field.age_gyr <= 0.0) return out;
  const auto first = static_cast<int>(std::ceil(2.0 * std::log2(field.largest_m))) - 1;
  const auto last = static_cast<int>(std::floor(2.0 * std::log2(field.smallest_m)));
  for (int k = first; k >= last; --k) draw_class(field, k, {x0_m, y0_m, x1_m, y1_m}, out);
  return out;
}

double crater_height_m(const Crater& crater, double distance_m) {
  return shape(distance_m / (0.5 * crater.diameter_m), crater.depth_m);
}

double crater_variance_m2(const CraterField& field) {
  if (!(field.largest_m > field.smallest_m) || field.age_gyr <= 0.0) return 0.0;
  // Of one crater of unit radius and depth, over the plane.
  constexpr int kSteps = 3000;
  double unit = 0.0;
  for (int i = 0; i < kSteps; ++i) {
    const double x = kReach * (i + 0.5) / kSteps;
    unit += shape(x, 1.0) * shape(x, 1.0) * 2.0 * std::numbers::pi * x * kReach / kSteps;
  }
  double sum = 0.0;
  constexpr int kSizes = 200;
  const double ratio = std::pow(field.largest_m / field.smallest_m, 1.0 / kSizes);
  double low = field.smallest_m;
  for (int i = 0; i < kSizes; ++i, low *= ratio) {
    const double d = low * std::sqrt(ratio), ripe = ripeness(field, d);
    const double number = craters_present(field.body, field.age_gyr, low) -
                          craters_present(field.body, field.age_gyr, low * ratio);
    // Mean square of the depth over lives from 0 to `ripe`.
    const double fade = 2.0 * std::log(kFaded / kFresh) * ripe;
    const double depth2 = std::pow(kFresh * d, 2.0) * (fade == 0.0 ? 1.0 : std::expm1(fade) / fade);
    sum += number * depth2 * 0.25 * d * d * unit;
  }
  return sum;
}

Result<std::size_t> add_craters(Grid<float>& z, const NodeGrid& nodes, const CraterField& field,
                                const RunContext& run) {
  const double x1 = nodes.x0_m + nodes.spacing_m * static_cast<double>(nodes.cols - 1);
  const double y1 = nodes.y0_m + nodes.spacing_m * static_cast<double>(nodes.rows - 1);
  const double cell = nodes.spacing_m;
  const std::vector<Crater> craters =
      draw_craters(field, nodes.x0_m - cell, nodes.y0_m - cell, x1 + cell, y1 + cell);
  const std::ptrdiff_t tiles = (nodes.rows + kTileRows - 1) / kTileRows;
  std::vector<std::vector<const Crater*>> of_tile(static_cast<std::size_t>(tiles));
  for (const Crater& c : craters) {
    const double far = 0.5 * kReach * c.diameter_m + 2.0 * cell;
    const auto tile = [&](double y) {
      return std::clamp(static_cast<std::ptrdiff_t>(
                            std::floor((y - nodes.y0_m) / (cell * static_cast<double>(kTileRows)))),
                        std::ptrdiff_t{0}, tiles - 1);
    };
    for (std::ptrdiff_t t = tile(c.y_m - far); t <= tile(c.y_m + far); ++t)
      of_tile[static_cast<std::size_t>(t)].push_back(&c);
  }
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, nodes.rows, [&](std::ptrdiff_t r) {
    if (!run.stopped()) add_row(z, r, nodes, of_tile[static_cast<std::size_t>(r / kTileRows)]);
  });
  if (run.stopped()) return fail(kCancelled, "making craters was stopped");
  return craters.size();
}

}  // namespace maquette::heightmap::detail

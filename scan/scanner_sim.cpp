// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/scanner_sim.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <vector>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/random.hpp"
#include "heightmap/field_tracer.hpp"
#include "scan/detail/stone_scene.hpp"

namespace maquette::scan {
namespace {

using heightmap::FieldTracer;
using heightmap::ModelField;

constexpr double kTurn = 2.0 * std::numbers::pi;

/// Azimuth and zenith angles that can reach a box, radians.
struct AngularWindow {
  double azimuth_min, azimuth_max;
  double zenith_min, zenith_max;
};

AngularWindow window_of(const Box3& box, Vec3 station) {
  const double x0 = box.min.x - station.x, x1 = box.max.x - station.x;
  const double y0 = box.min.y - station.y, y1 = box.max.y - station.y;
  const double z0 = box.min.z - station.z, z1 = box.max.z - station.z;
  AngularWindow w{};
  const double near_x = std::fmax(0.0, std::fmax(x0, -x1));
  const double near_y = std::fmax(0.0, std::fmax(y0, -y1));
  const double nearest = std::hypot(near_x, near_y);
  const double farthest = std::hypot(std::fmax(-x0, x1), std::fmax(-y0, y1));
  if (nearest == 0.0) {  // above or below the box: all around
    w.azimuth_min = 0.0;
    w.azimuth_max = kTurn;
  } else {
    // Seen from outside a rectangle spans less than half a turn; measured from its middle
    // there is no jump in the angle.
    const double middle = std::atan2(y0 + y1, x0 + x1);
    w.azimuth_min = w.azimuth_max = middle;
    for (const double x : {x0, x1})
      for (const double y : {y0, y1}) {
        const double a = std::remainder(std::atan2(y, x) - middle, kTurn);
        w.azimuth_min = std::fmin(w.azimuth_min, middle + a);
        w.azimuth_max = std::fmax(w.azimuth_max, middle + a);
      }
  }
  // The zenith angle atan2(distance, height) is monotonic in each, so corners decide.
  w.zenith_min = std::fmin(std::atan2(nearest, z1), std::atan2(farthest, z1));
  w.zenith_max = std::fmax(std::atan2(nearest, z0), std::atan2(farthest, z0));
  return w;
}

/// The grid of directions; whole steps from azimuth 0 and the zenith.
struct DirectionGrid {
  double step_rad = 0.0;
  std::int64_t first_column = 0, columns = 0;
  std::int64_t first_row = 0, rows = 0;

  [[nodiscard]] Vec3 direction(std::int64_t column, std::int64_t row) const {
    const double azimuth = step_rad * static_cast<double>(first_column + column);
    const double zenith = step_rad * static_cast<double>(first_row + row);
    const double s = std::sin(zenith);
    return {s * std::cos(azimuth), s * std::sin(azimuth), std::cos(zenith)};
  }
};

DirectionGrid grid_over(const AngularWindow& w, double step) {
  DirectionGrid g;
  g.step_rad = step;
  const auto below = [&](double a) { return static_cast<std::int64_t>(std::floor(a / step)); };
  const auto above = [&](double a) { return static_cast<std::int64_t>(std::ceil(a / step)); };
  g.first_column = below(w.azimuth_min);
  g.columns = above(w.azimuth_max) - g.first_column + 1;
  // A full turn ends before it begins again.
  if (w.azimuth_max - w.azimuth_min >= kTurn)
    g.columns =
        std::max<std::int64_t>(1, static_cast<std::int64_t>(std::ceil(kTurn / step - 1e-9)));
  // Beyond the nadir the directions of the opposite azimuth would come again.
  g.first_row = below(w.zenith_min);
  g.rows = std::min(above(w.zenith_max), below(std::numbers::pi + 1e-9 * step)) - g.first_row + 1;
  return g;
}

/// Distance at which the ray enters the part through a wall; infinite if it does not.
double wall_distance(const ModelField& f, Vec3 o, Vec3 d) {
  const double x0 = f.x0.value(), x1 = f.x_mm(f.z_mm.cols() - 1);
  const double y0 = f.y0.value(), y1 = f.y_mm(f.z_mm.rows() - 1);
  double t_in = 0.0, t_out = INFINITY;
  const auto clip = [&](double from, double along, double lo, double hi) {
    if (along == 0.0) {
      if (from < lo || from > hi) t_out = -INFINITY;
      return;
    }
    const double a = (lo - from) / along, b = (hi - from) / along;
    t_in = std::fmax(t_in, std::fmin(a, b));
    t_out = std::fmin(t_out, std::fmax(a, b));
  };
  clip(o.x, d.x, x0, x1);
  clip(o.y, d.y, y0, y1);
  if (!(t_in <= t_out) || t_in == 0.0) return INFINITY;
  const Vec3 p = o + t_in * d;
  // Rounding may leave the entry a hair outside.
  const double height = heightmap::height_at(f, std::clamp(p.x, x0, x1), std::clamp(p.y, y0, y1));
  return p.z < height ? t_in : INFINITY;
}

struct Echo {
  double range_mm;
  double cos_incidence;
};

std::optional<Echo> look(const ModelField& surface, const FieldTracer& tracer,
                         const detail::StoneScene& stones, Vec3 station, Vec3 d) {
  const auto ground = tracer.trace(station, d);
  double nearest = ground ? ground->distance_mm : INFINITY;
  nearest = std::fmin(nearest, wall_distance(surface, station, d));
  if (const auto stone = stones.trace(station, d, nearest))
    return Echo{stone->distance_mm, std::abs(dot(stone->normal, d))};
  if (!ground || nearest < ground->distance_mm) return std::nullopt;
  const double cos_incidence = -dot(ground->normal, d);
  // From below: through a void or from under the part.
  if (!(cos_incidence > 0.0)) return std::nullopt;
  return Echo{ground->distance_mm, cos_incidence};
}

Result<void> check_options(const ScanOptions& o) {
  const auto bad = [](std::string_view what, double value) {
    return fail(kScanOptions, fmt::format("scanner: {} is {}", what, value));
  };
  const assets::ScannerPreset& s = o.scanner;
  if (!(s.lines_per_turn >= 4.0 && s.lines_per_turn <= 1e9))
    return bad("lines_per_turn must be between 4 and 1e9 but", s.lines_per_turn);
  if (!(s.range_sigma_mm >= 0.0 && s.range_sigma_mm < 1e3))
    return bad("range_sigma_mm must be between 0 and 1000 but", s.range_sigma_mm);
  if (!(s.range_resolution_mm >= 0.0 && s.range_resolution_mm < 1e3))
    return bad("range_resolution_mm must be between 0 and 1000 but", s.range_resolution_mm);
  if (o.max_points < 16)
    return bad("max_points must be at least 16 but", 1.0 * static_cast<double>(o.max_points));
  for (const double c : {o.station_mm.x, o.station_mm.y, o.station_mm.z})
    if (!(std::abs(c) <= kLargestCoordinateMm))
      return bad("the station must be finite millimetres but a coordinate", c);
  return {};
}

}  // namespace

double range_sigma_mm(const assets::ScannerPreset& scanner, double range_mm, double cos_incidence) {
  return scanner.range_sigma_mm * (range_mm / 3000.0) / std::sqrt(std::fmax(cos_incidence, 0.01));
}

Result<Cloud> simulate_scan(const ModelField& surface, std::span<const TriMesh> stones,
                            const ScanOptions& options, const RunContext& run) {
  MAQUETTE_TRY_VOID(check_options(options));
  const Vec3 station = options.station_mm;
  const double ground = heightmap::height_at(surface, station.x, station.y);
  if (ground >= station.z)  // false over a void and beside the part
    return fail(kStationUnderSurface,
                fmt::format("the scanner at ({}, {}, {}) mm stands {} mm under the surface",
                            station.x, station.y, station.z, ground - station.z));
  for (std::size_t i = 0; i < stones.size(); ++i)
    if (detail::inside_mesh(stones[i], station))
      return fail(kStationUnderSurface,
                  fmt::format("the scanner at ({}, {}, {}) mm stands inside stone {}", station.x,
                              station.y, station.z, i + 1));

  const heightmap::HeightRange heights = heightmap::height_range(surface.z_mm);
  MAQUETTE_TRY(const detail::StoneScene scene, detail::StoneScene::build(stones));
  Box3 box = scene.bounds();
  if (heights.min <= heights.max) {
    box.add({surface.x0.value(), surface.y0.value(), static_cast<double>(heights.min)});
    box.add({surface.x_mm(surface.z_mm.cols() - 1), surface.y_mm(surface.z_mm.rows() - 1),
             static_cast<double>(heights.max)});
  }
  if (box.empty()) return fail(kNothingHit, "the surface is all void and there are no stones");

  const AngularWindow window = window_of(box, station);
  double step = kTurn / options.scanner.lines_per_turn;
  DirectionGrid grid = grid_over(window, step);
  const auto directions = [&] {
    return static_cast<double>(grid.columns) * static_cast<double>(grid.rows);
  };
  const auto limit = static_cast<double>(options.max_points);
  while (directions() > limit) {
    step *= std::fmax(1.001, std::sqrt(directions() / limit));
    grid = grid_over(window, step);
  }
  if (const double widened = step * options.scanner.lines_per_turn / kTurn; widened > 1.0)
    run.warn(fmt::format("angular steps are {:.3g} times those of {}, to stay below {} points",
                         widened, options.scanner.name, options.max_points));

  const FieldTracer tracer(surface);
  Cloud cloud;
  cloud.station_mm = station;
  // Columns in batches: the cloud grows in order, and memory holds it once.
  constexpr std::int64_t kBatch = 128;
  struct Column {
    std::vector<Vec3> points;
    std::vector<float> intensity;
  };
  std::vector<Column> batch(kBatch);
  for (std::int64_t first = 0; first < grid.columns; first += kBatch) {
    if (run.stopped()) return fail(kCancelled, "the simulated scan was cancelled");
    run.progress(static_cast<double>(first) / static_cast<double>(grid.columns));
    const std::int64_t count = std::min(kBatch, grid.columns - first);
    oneapi::tbb::parallel_for(std::int64_t{0}, count, [&](std::int64_t k) {
      Column& column = batch[static_cast<std::size_t>(k)];
      column.points.clear();
      column.intensity.clear();
      for (std::int64_t row = 0; row < grid.rows; ++row) {
        const Vec3 d = grid.direction(first + k, row);
        const auto echo = look(surface, tracer, scene, station, d);
        if (!echo) continue;
        const auto ray = static_cast<std::uint64_t>((first + k) * grid.rows + row);
        double range =
            echo->range_mm + range_sigma_mm(options.scanner, echo->range_mm, echo->cos_incidence) *
                                 random_normal(options.seed, ray);
        if (const double unit = options.scanner.range_resolution_mm; unit > 0.0)
          range = unit * std::round(range / unit);
        column.points.push_back(station + range * d);
        column.intensity.push_back(static_cast<float>(echo->cos_incidence));
      }
    });
    for (std::int64_t k = 0; k < count; ++k) {
      const Column& column = batch[static_cast<std::size_t>(k)];
      cloud.points_mm.insert(cloud.points_mm.end(), column.points.begin(), column.points.end());
      cloud.intensity.insert(cloud.intensity.end(), column.intensity.begin(),
                             column.intensity.end());
    }
  }
  if (cloud.points_mm.empty())
    return fail(
        kNothingHit,
        fmt::format("none of {} x {} directions from ({}, {}, {}) mm meets the surface from "
                    "above; move the scanner",
                    grid.columns, grid.rows, station.x, station.y, station.z));
  run.progress(1.0);
  return cloud;
}

}  // namespace maquette::scan

// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/crater_density.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <numbers>
#include <utility>
#include <vector>

#include <fmt/format.h>

#include "core/check.hpp"
#include "meshing/geodesic.hpp"

namespace maquette::meshing {
namespace {

using heightmap::ModelField;

/// The parts of the circle that lie on the field, as lines whose chords are at most a spacing long.
std::vector<std::vector<PlanPoint>> rim_on(const ModelField& f, PlanPoint middle,
                                           double radius_mm) {
  const double x_end = f.x_mm(f.z_mm.cols() - 1), y_end = f.y_mm(f.z_mm.rows() - 1);
  const auto points = static_cast<std::size_t>(
      std::ceil(std::fmax(16.0, 2.0 * std::numbers::pi * radius_mm / f.spacing.value())));
  std::vector<std::vector<PlanPoint>> runs;
  bool on = false;
  for (std::size_t i = 0; i <= points; ++i) {
    const double angle =
        2.0 * std::numbers::pi * static_cast<double>(i % points) / static_cast<double>(points);
    const PlanPoint p{middle.x_mm + radius_mm * std::cos(angle),
                      middle.y_mm + radius_mm * std::sin(angle)};
    const bool inside =
        p.x_mm >= f.x0.value() && p.x_mm <= x_end && p.y_mm >= f.y0.value() && p.y_mm <= y_end;
    if (inside && !on) runs.emplace_back();
    if (inside) runs.back().push_back(p);
    on = inside;
  }
  return runs;
}

/// 1 + slope_slowness tan(slope), by central differences.
std::vector<float> slowness_of(const ModelField& f, double slope_slowness) {
  const std::ptrdiff_t rows = f.z_mm.rows(), cols = f.z_mm.cols();
  const double s = f.spacing.value();
  std::vector<float> slowness;
  slowness.reserve(static_cast<std::size_t>(rows * cols));
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      const std::ptrdiff_t west = std::max<std::ptrdiff_t>(c - 1, 0),
                           east = std::min(c + 1, cols - 1);
      const std::ptrdiff_t south = std::max<std::ptrdiff_t>(r - 1, 0),
                           north = std::min(r + 1, rows - 1);
      const double dx =
          (static_cast<double>(f.z_mm(r, east)) - static_cast<double>(f.z_mm(r, west))) /
          (s * static_cast<double>(east - west));
      const double dy =
          (static_cast<double>(f.z_mm(north, c)) - static_cast<double>(f.z_mm(south, c))) /
          (s * static_cast<double>(north - south));
      slowness.push_back(static_cast<float>(1.0 + slope_slowness * std::hypot(dx, dy)));
    }
  return slowness;
}

}  // namespace

Result<ModelField> travel_from_rims(std::span<const Crater> craters, const StoneGround& ground,
                                    double slope_slowness, const RunContext& run) {
  MAQUETTE_CHECK(!craters.empty() && slope_slowness >= 0.0, "{} craters, {}", craters.size(),
                 slope_slowness);
  const ModelField& f = ground.surface;
  GeodesicSources sources;
  for (const Crater& crater : craters) {
    MAQUETTE_CHECK(crater.diameter.value() > 0.0, "{}", crater.diameter.value());
    const PlanPoint middle{
        ground.scale.horizontal(Metres{crater.east_m - ground.east_of_x0_m}).value(),
        ground.scale.horizontal(Metres{crater.north_m - ground.north_of_y0_m}).value()};
    for (const auto& line :
         rim_on(f, middle, 0.5 * ground.scale.horizontal(crater.diameter).value()))
      MAQUETTE_TRY_VOID(add_polyline(sources, f, line));
  }
  if (sources.points.empty() && sources.segments.empty() && sources.vertices.empty())
    return fail(
        kNoRimOnSite,
        fmt::format("no rim of the {} craters crosses the surface; the first is at east {:g} "
                    "m north {:g} m with a diameter of {:g} m; give craters whose rims lie on "
                    "the site, in metres from its centre",
                    craters.size(), craters[0].east_m, craters[0].north_m,
                    craters[0].diameter.value()));
  const std::vector<float> slowness = slowness_of(f, slope_slowness);
  MAQUETTE_TRY(auto travel, geodesic_distance(f, sources, {.slowness = slowness}, run));
  return ModelField{std::move(travel), f.spacing, f.x0, f.y0};
}

std::function<double(double, double)> density_around(ModelField travel, const StoneGround& ground,
                                                     Metres decay, double far_share) {
  MAQUETTE_CHECK(decay.value() > 0.0 && far_share >= 0.0 && far_share <= 1.0, "{}, {}",
                 decay.value(), far_share);
  const auto field = std::make_shared<const ModelField>(std::move(travel));
  return [field, scale = ground.scale, east_m = ground.east_of_x0_m, north_m = ground.north_of_y0_m,
          decay_mm = ground.scale.horizontal(decay).value(), far_share](double east, double north) {
    const double travel_mm =
        heightmap::height_at(*field, scale.horizontal(Metres{east - east_m}).value(),
                             scale.horizontal(Metres{north - north_m}).value());
    if (std::isnan(travel_mm)) return far_share;
    return far_share + (1.0 - far_share) * std::exp(-travel_mm / decay_mm);
  };
}

}  // namespace maquette::meshing

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file analytic_planet.hpp
/// A planet whose height is known everywhere, rasters of it in any projection, and
/// where the nodes of a site stand on it, by plain vector algebra: an oracle that
/// shares neither GeographicLib nor the reader with what it judges.

#include <array>
#include <cmath>
#include <memory>
#include <numbers>
#include <string>

#include <ogr_spatialref.h>

#include "core/grid.hpp"
#include "heightmap/body.hpp"
#include "support/planet_raster.hpp"

namespace maquette::testing_support {

using Direction = std::array<double, 3>;  ///< unit, from the body's centre

/// Waves in space, cut by the sphere: smooth across seams and poles.
struct Waves {
  double amplitude_m = 40.0;
  double waves_per_radius = 100.0;
  [[nodiscard]] double operator()(const Direction& n) const {
    const double k = 2.0 * std::numbers::pi * waves_per_radius;
    return amplitude_m * (std::sin(k * (0.6 * n[0] + 0.64 * n[1] - 0.48 * n[2])) +
                          std::sin(k * (0.8 * n[1] + 0.6 * n[2]) + 0.7) +
                          std::sin(k * (0.8 * n[0] - 0.36 * n[1] + 0.48 * n[2]) + 1.9));
  }
};

inline Direction direction(double planetocentric_latitude_deg, double longitude_deg) {
  const double lat = planetocentric_latitude_deg * std::numbers::pi / 180.0;
  const double lon = longitude_deg * std::numbers::pi / 180.0;
  return {std::cos(lat) * std::cos(lon), std::cos(lat) * std::sin(lon), std::sin(lat)};
}

/// Map coordinates -> direction, through PROJ's inverse alone.
class MapInverse {
 public:
  explicit MapInverse(const std::string& projection) {
    srs_.SetFromUserInput(projection.c_str());
    srs_.SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
    const double ratio = srs_.GetSemiMinor() / srs_.GetSemiMajor();
    squared_ratio_ = ratio * ratio;
    if (srs_.IsGeographic()) return;
    const std::unique_ptr<OGRSpatialReference> geo(srs_.CloneGeogCS());
    geo->SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
    inverse_.reset(OGRCreateCoordinateTransformation(&srs_, geo.get()));
  }
  [[nodiscard]] Direction operator()(double x, double y) const {
    if (inverse_) inverse_->Transform(1, &x, &y);
    const double geodetic = y * std::numbers::pi / 180.0;
    const double centric = std::atan(squared_ratio_ * std::tan(geodetic));
    return direction(centric * 180.0 / std::numbers::pi, x);
  }
  /// Where a planetocentric point lies on the map.
  [[nodiscard]] std::array<double, 2> forward(double latitude_deg, double longitude_deg) const {
    const double centric = latitude_deg * std::numbers::pi / 180.0;
    double x = longitude_deg;
    double y = std::atan(std::tan(centric) / squared_ratio_) * 180.0 / std::numbers::pi;
    if (!srs_.IsGeographic()) {
      const std::unique_ptr<OGRSpatialReference> geo(srs_.CloneGeogCS());
      geo->SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
      const std::unique_ptr<OGRCoordinateTransformation> there(
          OGRCreateCoordinateTransformation(geo.get(), &srs_));
      there->Transform(1, &x, &y);
    }
    return {x, y};
  }

 private:
  OGRSpatialReference srs_;
  double squared_ratio_ = 1.0;
  std::unique_ptr<OGRCoordinateTransformation> inverse_;
};

/// Direction of the ellipsoid's point whose normal meets the tangent plane at (x, y).
inline Direction below_plane(const heightmap::Body& body, double latitude_deg, double longitude_deg,
                             double x, double y) {
  const double a = body.equatorial_radius_m, b = body.polar_radius_m;
  const double e2 = 1.0 - b * b / (a * a);
  const double centric = latitude_deg * std::numbers::pi / 180.0;
  const double phi = std::atan2(a * a * std::sin(centric), b * b * std::cos(centric));
  const double lon = longitude_deg * std::numbers::pi / 180.0;
  const double sp = std::sin(phi), cp = std::cos(phi), sl = std::sin(lon), cl = std::cos(lon);
  const double n = a / std::sqrt(1.0 - e2 * sp * sp);
  const double px = n * cp * cl - sl * x - sp * cl * y;
  const double py = n * cp * sl + cl * x - sp * sl * y;
  const double pz = n * (1.0 - e2) * sp + cp * y;
  const double p = std::hypot(px, py);
  double foot = std::atan2(pz, p * (1.0 - e2));
  for (int i = 0; i < 30; ++i) {
    const double s = std::sin(foot);
    foot = std::atan2(pz + e2 * a / std::sqrt(1.0 - e2 * s * s) * s, p);
  }
  const double centric_foot = std::atan2(b * b * std::sin(foot), a * a * std::cos(foot));
  return direction(centric_foot * 180.0 / std::numbers::pi,
                   std::atan2(py, px) * 180.0 / std::numbers::pi);
}

/// A raster of `planet` around a point, `cells` pixels wide.
template <class Planet>
PlanetRaster raster_around(const std::string& projection, double latitude_deg, double longitude_deg,
                           double pixel, int cells, const Planet& planet) {
  const auto inverse = std::make_shared<MapInverse>(projection);
  const auto [x, y] = inverse->forward(latitude_deg, longitude_deg);
  PlanetRaster r;
  r.projection = projection;
  r.pixel = pixel;
  r.cols = r.rows = cells;
  // Off the pixel raster on purpose.
  r.west = x - (0.5 * cells + 0.3) * pixel;
  r.north = y + (0.5 * cells - 0.2) * pixel;
  r.height = [inverse, planet](double mx, double my) { return planet((*inverse)(mx, my)); };
  return r;
}

/// By how much the heights stand east and north of where they should: least squares of
/// the difference on the slope.
struct Displacement {
  double east_m = 0.0, north_m = 0.0, worst_m = 0.0, bias_m = 0.0;
};
inline Displacement displacement(const Grid<float>& found, const Grid<float>& truth,
                                 double spacing_m) {
  double xx = 0, xy = 0, yy = 0, xd = 0, yd = 0, sum = 0, n = 0;
  Displacement out;
  for (std::ptrdiff_t r = 1; r + 1 < truth.rows(); ++r)
    for (std::ptrdiff_t c = 1; c + 1 < truth.cols(); ++c) {
      const double gx = static_cast<double>(truth(r, c + 1) - truth(r, c - 1)) / (2.0 * spacing_m);
      const double gy = static_cast<double>(truth(r + 1, c) - truth(r - 1, c)) / (2.0 * spacing_m);
      const double d = static_cast<double>(found(r, c) - truth(r, c));
      xx += gx * gx;
      xy += gx * gy;
      yy += gy * gy;
      xd -= gx * d;
      yd -= gy * d;
      sum += d;
      n += 1.0;
      out.worst_m = std::fmax(out.worst_m, std::abs(d));
    }
  const double det = xx * yy - xy * xy;
  out.east_m = (yy * xd - xy * yd) / det;
  out.north_m = (xx * yd - xy * xd) / det;
  out.bias_m = sum / n;
  return out;
}

}  // namespace maquette::testing_support

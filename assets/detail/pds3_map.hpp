// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file pds3_map.hpp
/// Where a pixel of a PDS3 map lies on the body and in the site frame.

#include <cmath>
#include <cstdint>
#include <numbers>
#include <string>

#include <GeographicLib/Geocentric.hpp>
#include <GeographicLib/LocalCartesian.hpp>

#include "heightmap/body.hpp"

namespace maquette::assets::detail {

inline constexpr double kDegree = std::numbers::pi / 180.0;

/// Site frame <-> planetocentric latitude and east longitude on the ellipsoid.
class SiteFrame {
 public:
  SiteFrame(const heightmap::Body& body, double centre_latitude_deg, double centre_longitude_deg)
      : axis_ratio2_(std::pow(body.equatorial_radius_m / body.polar_radius_m, 2)),
        frame_(geodetic(centre_latitude_deg), centre_longitude_deg, 0.0,
               GeographicLib::Geocentric(body.equatorial_radius_m,
                                         1.0 - body.polar_radius_m / body.equatorial_radius_m)) {}

  struct Plane {
    double east, north;
  };
  struct Globe {
    double latitude_deg, longitude_deg;  ///< planetocentric; -180 .. 180
  };

  [[nodiscard]] Plane plane(double latitude_deg, double longitude_deg) const {
    double east, north, up;
    frame_.Forward(geodetic(latitude_deg), longitude_deg, 0.0, east, north, up);
    return {east, north};
  }
  /// Of the point of the ellipsoid below (east, north) of the tangent plane: the
  /// plane's point is lowered until it meets the ellipsoid.
  [[nodiscard]] Globe globe(double east, double north) const {
    double lat = 0.0, lon = 0.0, height = 0.0, up = 0.0;
    for (int i = 0; i < 8; ++i) {
      frame_.Reverse(east, north, up, lat, lon, height);
      up -= height;
    }
    return {std::atan(std::tan(lat * kDegree) / axis_ratio2_) / kDegree, lon};
  }

 private:
  [[nodiscard]] double geodetic(double planetocentric_deg) const {
    if (axis_ratio2_ == 1.0) return planetocentric_deg;
    return std::atan(std::tan(planetocentric_deg * kDegree) * axis_ratio2_) / kDegree;
  }
  double axis_ratio2_;
  GeographicLib::LocalCartesian frame_;
};

/// Pixel grid of an equidistant cylindrical map on a sphere, as PDS3 describes it:
/// the centre of the (0-based) pixel (line, sample) lies at
/// x = (sample - sample_offset) scale, y = (line_offset - line) scale, where the
/// offsets are SAMPLE_ and LINE_PROJECTION_OFFSET: pixels from the centre of the
/// first pixel to the map's origin, right and down positive.
struct MapGrid {
  double radius_m = 0.0;
  double scale_m = 0.0;
  double standard_latitude_deg = 0.0;
  double centre_longitude_deg = 0.0;
  double line_offset = 0.0, sample_offset = 0.0;
  std::int64_t lines = 0, samples = 0;

  [[nodiscard]] double latitude_deg(double line) const {
    return (line_offset - line) * scale_m / radius_m / kDegree;
  }
  [[nodiscard]] double longitude_deg(double sample) const {
    const double x = (sample - sample_offset) * scale_m;
    return centre_longitude_deg +
           x / (radius_m * std::cos(standard_latitude_deg * kDegree)) / kDegree;
  }
};

/// Fills offsets and size of `grid` (radius, scale and standard latitude given) so
/// that pixel edges are whole multiples of the scale and the square +- half_width of
/// the site is covered with `margin` pixels to spare.
[[nodiscard]] MapGrid cover(const SiteFrame& frame, double centre_longitude_deg, MapGrid grid,
                            double half_width_m, std::int64_t margin);

/// Distance of the ellipsoid from the body's centre.
[[nodiscard]] double local_radius_m(const heightmap::Body& body, double latitude_deg);

/// The IMAGE_MAP_PROJECTION object; PDS lines end in CR LF.
/// @param type  value of MAP_PROJECTION_TYPE
[[nodiscard]] std::string projection_object(const MapGrid& grid, const std::string& type);

}  // namespace maquette::assets::detail

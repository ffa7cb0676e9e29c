// SPDX-License-Identifier: GPL-3.0-or-later
#include "assets/detail/pds3_map.hpp"

#include <algorithm>

#include <fmt/format.h>

namespace maquette::assets::detail {

MapGrid cover(const SiteFrame& frame, double centre_longitude_deg, MapGrid grid,
              double half_width_m, std::int64_t margin) {
  // The archives centre their maps on 180; not if the map's edge then cuts the site.
  const double lon0 = centre_longitude_deg - 360.0 * std::floor(centre_longitude_deg / 360.0);
  grid.centre_longitude_deg = lon0 < 10.0 || lon0 > 350.0 ? 0.0 : 180.0;
  const double metres_per_degree =
      grid.radius_m * std::cos(grid.standard_latitude_deg * kDegree) * kDegree;
  double west = INFINITY, east = -INFINITY, south = INFINITY, north = -INFINITY;
  constexpr int kSteps = 64;
  for (int i = 0; i <= kSteps; ++i)
    for (int side = 0; side < 4; ++side) {
      const double t = half_width_m * (2.0 * i / kSteps - 1.0);
      const double e = side == 0 ? -half_width_m : side == 1 ? half_width_m : t;
      const double n = side == 2 ? -half_width_m : side == 3 ? half_width_m : t;
      const SiteFrame::Globe p = frame.globe(e, n);
      const double dlon = std::remainder(p.longitude_deg - grid.centre_longitude_deg, 360.0);
      west = std::min(west, dlon * metres_per_degree);
      east = std::max(east, dlon * metres_per_degree);
      south = std::min(south, p.latitude_deg * kDegree * grid.radius_m);
      north = std::max(north, p.latitude_deg * kDegree * grid.radius_m);
    }
  const auto edge = [&](double x) {
    return static_cast<std::int64_t>(std::floor(x / grid.scale_m));
  };
  const std::int64_t left = edge(west) - margin, right = edge(east) + 1 + margin;
  const std::int64_t bottom = edge(south) - margin, top = edge(north) + 1 + margin;
  grid.samples = right - left;
  grid.lines = top - bottom;
  grid.sample_offset = -(static_cast<double>(left) + 0.5);
  grid.line_offset = static_cast<double>(top) - 0.5;
  return grid;
}

double local_radius_m(const heightmap::Body& body, double latitude_deg) {
  const double a = body.equatorial_radius_m, b = body.polar_radius_m;
  const double c = b * std::cos(latitude_deg * kDegree), s = a * std::sin(latitude_deg * kDegree);
  return a == b ? a : a * b / std::hypot(c, s);
}

std::string projection_object(const MapGrid& g, const std::string& type) {
  const double north = g.latitude_deg(-0.5), west = g.longitude_deg(-0.5);
  const double south = g.latitude_deg(static_cast<double>(g.lines) - 0.5);
  const double east = g.longitude_deg(static_cast<double>(g.samples) - 0.5);
  const auto turn = [](double lon) { return lon - 360.0 * std::floor(lon / 360.0); };
  std::string t = "OBJECT = IMAGE_MAP_PROJECTION\r\n";
  const auto put = [&](const char* key, const std::string& value) {
    t += fmt::format("  {:<28} = {}\r\n", key, value);
  };
  put("MAP_PROJECTION_TYPE", '"' + type + '"');
  put("A_AXIS_RADIUS", fmt::format("{} <KM>", g.radius_m / 1000.0));
  put("B_AXIS_RADIUS", fmt::format("{} <KM>", g.radius_m / 1000.0));
  put("C_AXIS_RADIUS", fmt::format("{} <KM>", g.radius_m / 1000.0));
  put("COORDINATE_SYSTEM_NAME", "PLANETOCENTRIC");
  put("COORDINATE_SYSTEM_TYPE", "\"BODY-FIXED ROTATING\"");
  put("POSITIVE_LONGITUDE_DIRECTION", "EAST");
  put("CENTER_LATITUDE", fmt::format("{} <DEG>", g.standard_latitude_deg));
  put("CENTER_LONGITUDE", fmt::format("{} <DEG>", g.centre_longitude_deg));
  put("REFERENCE_LATITUDE", "\"N/A\"");
  put("REFERENCE_LONGITUDE", "\"N/A\"");
  put("LINE_FIRST_PIXEL", "1");
  put("LINE_LAST_PIXEL", std::to_string(g.lines));
  put("SAMPLE_FIRST_PIXEL", "1");
  put("SAMPLE_LAST_PIXEL", std::to_string(g.samples));
  put("MAP_PROJECTION_ROTATION", "0.0 <DEG>");
  put("MAP_RESOLUTION", fmt::format("{:.12g} <PIX/DEG>", g.radius_m * kDegree / g.scale_m));
  put("MAP_SCALE", fmt::format("{} <METERS/PIXEL>", g.scale_m));
  put("MAXIMUM_LATITUDE", fmt::format("{:.9f} <DEG>", north));
  put("MINIMUM_LATITUDE", fmt::format("{:.9f} <DEG>", south));
  put("WESTERNMOST_LONGITUDE", fmt::format("{:.9f} <DEG>", turn(west)));
  put("EASTERNMOST_LONGITUDE", fmt::format("{:.9f} <DEG>", turn(east)));
  put("LINE_PROJECTION_OFFSET", fmt::format("{:.1f} <PIXEL>", g.line_offset));
  put("SAMPLE_PROJECTION_OFFSET", fmt::format("{:.1f} <PIXEL>", g.sample_offset));
  return t + "END_OBJECT = IMAGE_MAP_PROJECTION\r\n";
}

}  // namespace maquette::assets::detail

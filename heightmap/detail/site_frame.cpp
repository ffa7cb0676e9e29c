// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/site_frame.hpp"

#include <cmath>
#include <numbers>

#include <GeographicLib/Geocentric.hpp>

namespace maquette::heightmap::detail {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;

/// Latitude whose tangent is `factor` times as large; keeps the poles.
double stretched_latitude_deg(double latitude_deg, double factor) {
  const double lat = latitude_deg * kDegree;
  return std::atan2(factor * std::sin(lat), std::cos(lat)) / kDegree;
}

}  // namespace

SiteFrame::SiteFrame(const Body& body, double planetocentric_latitude_deg, double longitude_deg)
    : a_(body.equatorial_radius_m),
      b_(body.polar_radius_m),
      plane_(stretched_latitude_deg(planetocentric_latitude_deg, (a_ / b_) * (a_ / b_)),
             longitude_deg, 0.0, GeographicLib::Geocentric(a_, (a_ - b_) / a_)) {}

BodyPoint SiteFrame::below(double x_m, double y_m) const {
  double latitude = 0.0, longitude = 0.0, height = 0.0;  // latitude is geodetic here
  plane_.Reverse(x_m, y_m, 0.0, latitude, longitude, height);
  return {stretched_latitude_deg(latitude, (b_ / a_) * (b_ / a_)), longitude};
}

double SiteFrame::radius_deficit_m(double planetocentric_latitude_deg) const {
  const double lat = planetocentric_latitude_deg * kDegree;
  return a_ - a_ * b_ / std::hypot(b_ * std::cos(lat), a_ * std::sin(lat));
}

}  // namespace maquette::heightmap::detail

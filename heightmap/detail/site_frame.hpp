// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file site_frame.hpp
/// The tangent plane at the site's centre and the planet below it.

#include <GeographicLib/LocalCartesian.hpp>

#include "heightmap/body.hpp"

namespace maquette::heightmap::detail {

struct BodyPoint {
  double latitude_deg = 0.0;   ///< planetocentric
  double longitude_deg = 0.0;  ///< east positive
};

/// Thread-safe.
class SiteFrame {
 public:
  /// @pre -90 <= latitude <= 90
  SiteFrame(const Body& body, double planetocentric_latitude_deg, double longitude_deg);

  /// The point of the ellipsoid whose normal passes through (x east, y north, 0).
  [[nodiscard]] BodyPoint below(double x_m, double y_m) const;

  /// Equatorial radius less the ellipsoid's radius at this planetocentric latitude.
  [[nodiscard]] double radius_deficit_m(double planetocentric_latitude_deg) const;

 private:
  double a_, b_;
  GeographicLib::LocalCartesian plane_;
};

}  // namespace maquette::heightmap::detail

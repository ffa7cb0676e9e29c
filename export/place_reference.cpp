// SPDX-License-Identifier: GPL-3.0-or-later
#include "export/detail/place_reference.hpp"

#include <cmath>
#include <numbers>

#include <fmt/format.h>

namespace maquette::exporting::detail {

void set_place(OGRSpatialReference& frame, const LodPlace& place) {
  const double a = place.body.equatorial_radius_m, b = place.body.polar_radius_m;
  const double degree = std::numbers::pi / 180.0, centric = place.latitude_deg * degree;
  const double geodetic = std::atan2(a * a * std::sin(centric), b * b * std::cos(centric)) / degree;
  frame.SetProjCS(fmt::format("{} orthographic", place.body.name).c_str());
  frame.SetGeogCS(place.body.name.c_str(), fmt::format("D_{}", place.body.name).c_str(),
                  place.body.name.c_str(), a, a == b ? 0.0 : a / (a - b), "Reference meridian",
                  0.0);
  frame.SetOrthographic(geodetic, place.longitude_deg, 0.0, 0.0);
}

}  // namespace maquette::exporting::detail

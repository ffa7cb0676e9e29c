// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file body.hpp
/// The bodies whose elevation products can be read.

#include <optional>
#include <string>
#include <string_view>

namespace maquette::heightmap {

/// Reference surfaces in metres. IAU values: Archinal et al., "Report of the IAU
/// Working Group on Cartographic Coordinates and Rotational Elements: 2015",
/// Celest. Mech. Dyn. Astr. 130:22, 2018, doi:10.1007/s10569-017-9805-5.
struct Body {
  std::string name;            ///< "moon", "mars"
  double equatorial_radius_m;  ///< of the ellipsoid on which the site frame stands
  double polar_radius_m;
};

[[nodiscard]] std::optional<Body> body_by_name(std::string_view name);

}  // namespace maquette::heightmap

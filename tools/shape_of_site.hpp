// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include "tools/jobs_shaped.hpp"
#include "tools/site.hpp"

namespace maquette::tools {

/// The site's keys solid.* for the surface of a scale, 1:N.
[[nodiscard]] Shape shape_of(const Site& site, double scale);
/// Its keys bands.dowel_* and bands.magnet_*.
[[nodiscard]] InJoints in_joints_of(const Site& site);

}  // namespace maquette::tools

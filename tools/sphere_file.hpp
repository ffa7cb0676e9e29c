// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file sphere_file.hpp
/// Reference spheres of a part as a TOML file: what mill bores their seats from, has them probed
/// from, and what their probed centres are compared with.
///
///     sphere_radius_mm = 10.0
///     hole_radius_mm = 5.0     # of the rim that they rest on
///     below_mm = 0.5           # room between sphere and floor
///
///     [[sphere]]
///     name = "south-west"
///     at_mm = [-15.0, -15.0, 0.0]   # middle of the rim, model frame

#include <filesystem>
#include <string>
#include <vector>

#include "cnc/probing.hpp"
#include "core/result.hpp"

namespace maquette::tools {

struct ReferenceSphere {
  std::string name;
  cnc::SphereSeat seat;
  [[nodiscard]] Vec3 centre_mm() const {
    return {seat.x_mm, seat.y_mm, cnc::seated_centre_z_mm(seat)};
  }
};

/// At least one, all of one radius. @return TOOLS_CONFIG_SYNTAX, TOOLS_CONFIG_INVALID, CORE_FILE_*
[[nodiscard]] Result<std::vector<ReferenceSphere>> read_spheres(const std::filesystem::path& file);

}  // namespace maquette::tools

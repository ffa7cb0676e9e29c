// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <filesystem>

#include "heightmap/height_field.hpp"
#include "meshing/solid.hpp"

namespace maquette::tools {

/// The base lies `base_thickness` under the lowest point of the whole design, so that its bands and
/// tiles stand level beside each other.
[[nodiscard]] inline meshing::SolidOptions solid_options(const heightmap::ModelField& design,
                                                         Millimetres base_thickness) {
  const auto lowest = static_cast<double>(heightmap::height_range(design.z_mm).min);
  return {.base_z = Millimetres{lowest} - base_thickness};
}

/// Beside the solid: surface.ply, surface.certificate.json.
[[nodiscard]] inline std::filesystem::path certificate_path(const std::filesystem::path& solid) {
  return solid.parent_path() / (solid.stem().string() + ".certificate.json");
}

}  // namespace maquette::tools

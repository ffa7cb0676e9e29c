// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file scene_lamps.hpp
/// Lamps of a scene file as the renderer takes them: presets, intensities, colours.

#include <array>
#include <filesystem>
#include <string>
#include <vector>

#include "camera/lamp.hpp"
#include "camera/spectrum.hpp"
#include "core/result.hpp"
#include "tools/scene_parts.hpp"

namespace maquette::tools {

using Filters = std::array<camera::SpectralCurve, 3>;

/// The file's; boxes (camera/spectrum.hpp) if there is none. CAMERA_SPECTRUM_FILE, CORE_FILE_*.
[[nodiscard]] Result<Filters> filters_of(const std::filesystem::path& file);

/// Presets that a scene may name.
[[nodiscard]] std::vector<std::string> lamp_names();

/// A preset's table of intensities is stretched with `beam_deg`: its lens is focused. Beside a
/// table from a file `beam_deg` is where the light ends; where only a preset is named it ends with
/// the table. The colour of a lamp is that of its spectrum or temperature through the filters, with
/// 1 in G, times its irradiance.
/// @param beam_deg  where neither lamp nor preset says
/// CAMERA_INTENSITY_FILE, CAMERA_SPECTRUM_FILE, CORE_FILE_*, TOOLS_CONFIG_INVALID.
/// @pre the preset is empty or one of lamp_names()
[[nodiscard]] Result<camera::Lamp> lamp_of(const SceneLamp& l, const Filters& filters,
                                           double beam_deg = 180.0);

/// What 1.0 is in a picture, W m^-2 sr^-1 in each band: from the illuminance at the target as
/// given, else as the preset's luminous flux, intensities and distance make it. 0: not known.
/// @param lamp  lamp_of() the same
[[nodiscard]] Result<camera::Bands> white_radiance_of(const SceneLamp& l, const camera::Lamp& lamp,
                                                      const Filters& filters);

}  // namespace maquette::tools

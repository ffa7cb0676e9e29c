// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file rendered_light.hpp
/// A picture of linear radiance as `render` writes it, and what its metadata say about the shot.

#include <filesystem>
#include <optional>

#include "camera/image_io.hpp"
#include "camera/stack.hpp"
#include "core/result.hpp"
#include "tools/camera_file.hpp"

namespace maquette::tools {

/// Only pictures that a camera has exposed have this key: radiance no longer.
inline constexpr const char* kExposedKey = "maquette:signal";

/// The f-number of a rendering by rays through the lens' opening, which is out of focus already.
inline constexpr const char* kLensKey = "maquette:lens_f_number";

struct RenderedLight {
  camera::Frame frame;
  camera::Metadata metadata;
};

/// R, G, B or Y of a file, and Z and lit where it has them.
/// CAMERA_FRAME: other channels, 8 bits, exposed already; what read_image() returns
[[nodiscard]] Result<RenderedLight> read_rendered_light(const std::filesystem::path& path);

/// Rendered by rays through the lens' opening: depth_of_field is in it and not to act again.
[[nodiscard]] bool has_depth_of_field(const RenderedLight& light);

// CAMERA_FRAME from the three that follow: metadata that are no numbers.

/// Simulation time; nothing: the file has none.
[[nodiscard]] Result<std::optional<double>> time_of(const RenderedLight& light);
/// Value 1 in W m^-2 sr^-1, unless the camera's file says it (exposure.radiance_of_one, or
/// electrons_at_one). For a grey sensor, which counts what arrives in all bands, the light becomes
/// their mean, each weighed with its radiance.
[[nodiscard]] Result<void> take_radiance(RenderedLight& light, CameraFile& file);
/// The camera's velocity and turn rate, unless the camera's file says one of them.
[[nodiscard]] Result<void> take_motion(const RenderedLight& light, camera::Shot& shot);

}  // namespace maquette::tools

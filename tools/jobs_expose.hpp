// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file jobs_expose.hpp
/// What `expose` and `stack` do: a picture of linear radiance through the effects of a camera.

#include <cstdint>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "tools/pipeline.hpp"

namespace maquette::tools {

struct ExposeJob {
  /// Linear: Y, or R, G, B; depth in mm as Z and lit where there are any. Metadata of `render` are
  /// heeded: see expose_job().
  std::filesystem::path image;
  std::string camera = "nikon_d700_55deg";  ///< name or .toml
  std::vector<std::string> set{};           ///< key=value of the camera file
  std::vector<std::string> without{};       ///< effects to be left out
  std::optional<double> time_s{};           ///< simulation time; none: the rendering's, else 0
  std::uint64_t seed = 1;
  bool fit_sensor = false;  ///< the sensor gets the picture's size, at the same field of view
  bool masks = false;       ///< depth and lit as the lens bends them, beside: NAME.masks.exr
};

/// The picture behind the last effect, by the ending of `out`: .png, .jpg (display values), .png or
/// .tif with 16 bits (numbers of the converter, developed values), .exr (anything, as it is, with Z
/// and lit).
///
/// Of the rendering's metadata count: its time, unless one is given; what value 1 is in W m^-2
/// sr^-1, unless the camera file has exposure.radiance_of_one or electrons_at_one; the camera's
/// velocity and turn rate on its trajectory, unless the camera file has a motion. A grey sensor
/// then sees the bands by their radiance. All of them, and those of the exposure (camera, changes,
/// seed and time of its noise), are in the file.
[[nodiscard]] Result<JobResult> expose_job(const ExposeJob& job, const std::filesystem::path& out,
                                           const RunContext& run);

/// Pictures of a list; of a folder its .exr files in the order of their names (numbers by value),
/// but for masks. TOOLS_INPUT_MISSING: none
[[nodiscard]] Result<std::vector<std::filesystem::path>> pictures_in(
    const std::vector<std::filesystem::path>& images_or_folders);

/// Each as expose_job() (job.image aside), to OUT_0001.png, OUT_0002.png, ... in their order:
/// frames for a film. Frames of an earlier, longer sequence are not touched.
[[nodiscard]] Result<JobResult> expose_sequence_job(
    const ExposeJob& job, const std::vector<std::filesystem::path>& images,
    const std::filesystem::path& out, const RunContext& run);

/// stack.json (effects in their order, why there, what each swap would change in x/255, and which
/// two cannot change places) and stack.html: each effect alone, then all together.
[[nodiscard]] Result<JobResult> stack_job(const ExposeJob& job, const std::filesystem::path& folder,
                                          const RunContext& run);

}  // namespace maquette::tools

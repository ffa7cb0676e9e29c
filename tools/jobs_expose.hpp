// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file jobs_expose.hpp
/// What `expose` and `stack` do: a picture of linear radiance through the effects of a camera.

#include <filesystem>
#include <string>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "tools/pipeline.hpp"

namespace maquette::tools {

struct ExposeJob {
  std::filesystem::path image;  ///< linear: Y, or R, G, B; depth in mm as Z where there is one
  std::string camera = "nikon_d700_55deg";  ///< name or .toml
  std::vector<std::string> set{};           ///< key=value of the camera file
  std::vector<std::string> without{};       ///< effects to be left out
  double time_s = 0.0;
  std::uint64_t seed = 1;
  bool fit_sensor = false;  ///< the sensor gets the picture's size, at the same field of view
};

/// The picture behind the last effect, by the ending of `out`: .png, .jpg (display values), .png or
/// .tif with 16 bits (numbers of the converter, developed values), .exr (anything, as it is).
/// Parameters, seed and time are in the file.
[[nodiscard]] Result<JobResult> expose_job(const ExposeJob& job, const std::filesystem::path& out,
                                           const RunContext& run);

/// stack.json (effects in their order, why there, what each swap would change in x/255) and
/// stack.html: each effect alone, then all together.
[[nodiscard]] Result<JobResult> stack_job(const ExposeJob& job, const std::filesystem::path& folder,
                                          const RunContext& run);

}  // namespace maquette::tools

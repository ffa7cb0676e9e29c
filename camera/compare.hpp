// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file compare.hpp
/// Photograph against rendering, pixel by pixel, in units of x/255.

#include <filesystem>
#include <string>
#include <vector>

#include "camera/image_io.hpp"
#include "core/result.hpp"

namespace maquette::camera {

inline constexpr ErrorCode kImagesDiffer{"CAMERA_IMAGES_DIFFER_IN_SIZE"};

struct ChannelComparison {
  std::string name;
  double mean_abs_diff_255 = 0.0, rmse_255 = 0.0, bias_255 = 0.0;  ///< real - rendered
};
struct Comparison {
  std::vector<ChannelComparison> channels;
  double mean_abs_diff_255 = 0.0;  ///< over all compared channels
  Grid<Rgb8> difference;           ///< 128 + signed difference of the mean channel
};

/// Linear files (EXR) are encoded to sRGB before comparison with 8-bit files; two
/// files of the same kind are compared as they are. A one-channel file is compared
/// with every channel of a colour file. Depth, mask and alpha channels are left out,
/// and pixels that are not finite in either. CAMERA_IMAGES_DIFFER_IN_SIZE: pixels or
/// number of channels; CAMERA_IMAGE_FORMAT: nothing to compare.
[[nodiscard]] Result<Comparison> compare_images(const LoadedImage& real,
                                                const LoadedImage& rendered);
[[nodiscard]] std::string to_json(const Comparison& comparison);

}  // namespace maquette::camera

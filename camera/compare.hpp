// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file compare.hpp
/// Photograph against rendering, pixel by pixel, in units of x/255.

#include <cmath>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "camera/image_io.hpp"
#include "core/result.hpp"

namespace maquette::camera {

struct Image;  // render.hpp

inline constexpr ErrorCode kImagesDiffer{"CAMERA_IMAGES_DIFFER_IN_SIZE"};

struct ChannelComparison {
  std::string name;
  double mean_abs_diff_255 = 0.0, rmse_255 = 0.0, bias_255 = 0.0;  ///< real - rendered
  /// Area between the two cumulative histograms: how far brightness would have to be moved in the
  /// mean to make the histograms alike (first Wasserstein distance).
  double histogram_distance_255 = 0.0;
  double gain = 1.0;  ///< that rendered linear light was multiplied with (CompareOptions::match)
};
/// Differences over some of the pixels, all channels together.
struct PartComparison {
  std::size_t pixels = 0;
  double mean_abs_diff_255 = 0.0, rmse_255 = 0.0, bias_255 = 0.0;
};
struct Comparison {
  std::vector<ChannelComparison> channels;
  double mean_abs_diff_255 = 0.0, rmse_255 = 0.0, bias_255 = 0.0;  ///< over all compared channels
  std::size_t pixels = 0;                                          ///< compared
  std::size_t background_pixels = 0;  ///< left out: the rendering's depth is infinite
  std::optional<PartComparison> shadow_edges, rest;  ///< where the rendering has `lit`
  double ssim = NAN, flip = NAN;                     ///< means; NaN: not asked for
  std::string state;              ///< what was done to make the two comparable, for people
  Grid<std::uint8_t> difference;  ///< 128 + signed difference of the mean channel; empty: not asked
  Grid<std::uint8_t> absolute;    ///< mean of the channels' absolute differences
  /// 255 at edges of light and shadow, 128 elsewhere, 0 where nothing is compared; empty: not asked
  /// for, or the rendering has no `lit`.
  Grid<std::uint8_t> edges;
};

enum class Match {
  none,
  exposure,       ///< one factor for the rendering's linear light
  white_balance,  ///< a factor for each channel
};
struct CompareOptions {
  Match match = Match::none;
  bool background = false;  ///< compare pixels without depth too
  bool perceptual = false;  ///< ssim and flip: some seconds for 12 Mpixel
  bool pictures = true;     ///< difference and absolute, too
  int edge_px = 3;          ///< pixels this near to an edge of light and shadow are of the edge
};

/// A rendering as a file of it would be: its bands, "Z" and "lit", by which background and edges of
/// shadows are known.
[[nodiscard]] LoadedImage with_masks(Image image);

/// The bands of light of a file, linear: those of 8 bits are taken for sRGB. In the order R, G, B.
[[nodiscard]] std::vector<Grid<float>> linear_light(const LoadedImage& image);

/// Linear files (EXR) are encoded to sRGB before comparison with files for screens; two
/// files of the same kind are compared as they are. A one-channel file is compared
/// with every channel of a colour file. Depth, mask and alpha channels are left out,
/// and pixels that are not finite in either. 8-bit files, and those whose metadata say that they
/// hold display values (maquette:signal), are taken for sRGB where light is matched.
/// Factors are least squares over pixels that are neither black nor saturated in either, each
/// weighed down as it lies farther off than usual (Huber), so that stray pixels and shadow edges do
/// not decide. CAMERA_IMAGES_DIFFER_IN_SIZE: pixels or number of channels; CAMERA_IMAGE_FORMAT:
/// nothing to compare.
[[nodiscard]] Result<Comparison> compare_images(const LoadedImage& real,
                                                const LoadedImage& rendered,
                                                const CompareOptions& options = {});
[[nodiscard]] std::string to_json(const Comparison& comparison);

}  // namespace maquette::camera

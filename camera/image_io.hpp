// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file image_io.hpp
/// Image files by OpenImageIO. Row 0 is the upper row. Writers choose by the name's
/// ending (.exr, .png), appear whole or not at all, and give the same bytes each time.
/// CAMERA_IMAGE_FORMAT: no pixel, other ending, channels without names of their own or
/// of different sizes; CORE_FILE_NOT_WRITABLE.

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/grid.hpp"
#include "core/result.hpp"

namespace maquette::camera {

inline constexpr ErrorCode kImageNotReadable{"CAMERA_IMAGE_NOT_READABLE"};
inline constexpr ErrorCode kImageFormat{"CAMERA_IMAGE_FORMAT"};

using Rgb8 = std::array<std::uint8_t, 3>;
/// Keys ("maquette:...") and texts. PNG and EXR hold them under their keys, TIFF as one JSON object
/// in ImageDescription, JPEG as one in its comments.
using Metadata = std::vector<std::pair<std::string, std::string>>;
/// Empty if there is none.
[[nodiscard]] std::string_view text_in(const Metadata& metadata, std::string_view key);

/// Linear float image with named channels (EXR), e.g. {"Y", radiance}, {"Z", depth}.
[[nodiscard]] Result<void> write_exr(
    const std::vector<std::pair<std::string, const Grid<float>*>>& channels,
    const std::filesystem::path& path, const Metadata& metadata = {});
/// 8 or 16 bits a band, `white` the highest number, rounded and clipped: .png, .tif, .tiff; .jpg
/// (8 bits, quality 95) too.
[[nodiscard]] Result<void> write_whole_numbers(
    const std::vector<std::pair<std::string, const Grid<float>*>>& channels, double white, int bits,
    const std::filesystem::path& path, const Metadata& metadata = {});
/// 8-bit PNG, grey or colour, values as given (encode sRGB before).
[[nodiscard]] Result<void> write_png(const Grid<std::uint8_t>& grey,
                                     const std::filesystem::path& path,
                                     const Metadata& metadata = {});
[[nodiscard]] Result<void> write_png(const Grid<Rgb8>& colour, const std::filesystem::path& path,
                                     const Metadata& metadata = {});

/// The bytes of such a file, for a page. @pre at least one pixel
[[nodiscard]] std::string encode_png(const Grid<Rgb8>& colour);

/// Linear value 0..1 -> sRGB 0..255 (IEC 61966-2-1), clamped.
[[nodiscard]] std::uint8_t srgb8(double linear);

/// Channels as float, 8-bit and 16-bit files scaled to 0..1; encoding as in the file. Raw files of
/// cameras (by libraw, where OpenImageIO has it) come developed: black level off, white balance as
/// shot, interpolated colours with sRGB's primaries, linear, 1 where the sensor ends.
struct LoadedImage {
  std::vector<std::string> names;
  std::vector<Grid<float>> channels;
  bool eight_bit = false;
  double highest = 0.0;  ///< whole number that 1 stands for in the file; 0: floating point
  Metadata metadata{};   ///< those of our keys that the file has
};
/// nullptr: it has none of that name.
[[nodiscard]] const Grid<float>* channel_of(const LoadedImage& image, std::string_view name);
[[nodiscard]] Grid<float>* channel_of(LoadedImage& image, std::string_view name);
/// CORE_FILE_NOT_FOUND; CAMERA_IMAGE_NOT_READABLE: no image, or a damaged one;
/// CAMERA_IMAGE_FORMAT: a deep, volume or too large image. Alpha is a channel like any
/// other and multiplies nothing.
[[nodiscard]] Result<LoadedImage> read_image(const std::filesystem::path& path);
/// The same of a PNG or JPEG in memory, without its metadata.
/// @param name  for messages
[[nodiscard]] Result<LoadedImage> read_image(std::string_view bytes, const std::string& name);

}  // namespace maquette::camera

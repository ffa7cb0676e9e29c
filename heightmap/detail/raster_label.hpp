// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file raster_label.hpp
/// The labels of PDS3 and PDS4 images and ISIS3 cubes, as far as GDAL does not tell:
/// which file holds the pixels, how many bytes it must have, in which unit the
/// heights are. GDAL reads a truncated raw image as zeros without a word.

#include <filesystem>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "core/result.hpp"

namespace maquette::heightmap::detail {

/// "KEY = VALUE" statements in file order. Keys are upper case and carry the
/// objects and groups they stand in: "UNCOMPRESSED_FILE/IMAGE/LINES". PDS4's XML elements
/// are such statements too, without name spaces: "GEODETIC_MODEL/LATITUDE_TYPE".
struct RasterLabel {
  enum class Kind { pds3, isis3, pds4 };
  Kind kind = Kind::pds3;
  std::vector<std::pair<std::string, std::string>> statements;

  /// Value of the first key that is `tail` or ends in "/tail"; quotes removed.
  [[nodiscard]] std::optional<std::string> find(std::string_view tail) const;
  /// The same as a number; a unit in <> after it is ignored.
  [[nodiscard]] std::optional<double> number(std::string_view tail) const;
};

/// The label at the beginning of a file; nothing if the file has none.
[[nodiscard]] std::optional<RasterLabel> read_raster_label(const std::filesystem::path& path);

/// The statements of a PDS4 label; nothing if the text is no such XML. (pds4_label.cpp)
[[nodiscard]] std::optional<RasterLabel> parse_pds4_label(const std::string& text);
/// Image file that a PDS4 label names, and the bytes that it must have at least.
struct Pds4Image {
  std::string file;
  double bytes = 0.0;
};
[[nodiscard]] Pds4Image pds4_image(const RasterLabel& label);

/// What to open for `path`: the detached label beside a bare PDS3 or PDS4 image, else `path`.
[[nodiscard]] std::filesystem::path openable_path(const std::filesystem::path& path);

/// Checks that every pixel file a label (or a VRT, and what the VRT refers to)
/// speaks of is there and long enough. Files without such a label pass.
/// @return HEIGHTMAP_RASTER_NOT_READABLE naming the image and both sizes
[[nodiscard]] Result<void> check_pixels_complete(const std::filesystem::path& path);

}  // namespace maquette::heightmap::detail

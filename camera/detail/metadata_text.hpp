// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file metadata_text.hpp
/// Metadata where a format has no keys of its own: one JSON object, in comment segments of a JPEG
/// (ITU-T T.81, B.2.4.5; of any length, split into segments of 65533 bytes), in ImageDescription
/// of a TIFF (6.0, tag 270).

#include <filesystem>
#include <string>
#include <string_view>

#include "camera/image_io.hpp"

namespace maquette::camera::detail {

[[nodiscard]] std::string text_of(const Metadata& metadata);
/// Those of its keys that begin with "maquette:"; nothing where the text is no JSON object.
[[nodiscard]] Metadata metadata_of_text(std::string_view text);

/// The same file with comments behind its application segments. @pre a JPEG
[[nodiscard]] std::string with_jpeg_comment(std::string_view jpeg, std::string_view text);
/// Comments in front of the picture, one after the other; empty: none, or no JPEG.
[[nodiscard]] std::string jpeg_comment(const std::filesystem::path& path);
/// ImageDescription of the first picture, whole (OpenImageIO cuts it at 65536 bytes); empty: none,
/// or a file of another kind (BigTIFF).
[[nodiscard]] std::string tiff_description(const std::filesystem::path& path);

}  // namespace maquette::camera::detail

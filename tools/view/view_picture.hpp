// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file view_picture.hpp
/// Photographs and renderings as a browser shows them.

#include <filesystem>
#include <string>

#include "core/result.hpp"

namespace maquette::tools {

/// 8-bit PNG in sRGB; 1.0 of the file is white. Channels R, G, B, else Y or the first one.
/// @param linear   the file holds light, not sRGB
/// @param most_px  of the longer side; larger pictures are averaged down by a whole number
/// @return camera::read_image's errors
[[nodiscard]] Result<std::string> picture_png(const std::filesystem::path& file, bool linear,
                                              int most_px);

}  // namespace maquette::tools

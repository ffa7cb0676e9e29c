// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file dxf_text.hpp
/// Pieces of a DXF file (R12, AC1009).

#include <array>
#include <span>
#include <string>
#include <string_view>

#include <fmt/format.h>

#include "core/vec.hpp"

namespace maquette::exporting {

struct DxfLayer {
  std::string_view name;
  int colour = 7;  ///< AutoCAD's index
};

/// Comment, extent, line type and layers, up to where the first entity goes.
[[nodiscard]] std::string dxf_header(std::string_view comment, const Box3& extent,
                                     std::span<const DxfLayer> layers);
inline constexpr std::string_view kDxfEnd = "0\nENDSEC\n0\nEOF\n";

void append_dxf_polyline(fmt::memory_buffer& out, std::string_view layer,
                         std::span<const std::array<double, 2>> points_mm, bool closed, double z);
void append_dxf_line(fmt::memory_buffer& out, std::string_view layer, std::array<double, 2> from,
                     std::array<double, 2> to);
void append_dxf_point(fmt::memory_buffer& out, std::string_view layer, std::array<double, 2> at);
/// One line of text, its lower left corner at a place.
void append_dxf_text(fmt::memory_buffer& out, std::string_view layer, std::array<double, 2> at,
                     double height_mm, std::string_view text);

}  // namespace maquette::exporting

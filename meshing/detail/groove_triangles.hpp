// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file groove_triangles.hpp
/// A flat wall with grooves along strokes, as triangles.

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

namespace maquette::meshing::detail {

using FlatPoint = std::array<double, 2>;

struct Grooves {
  /// After the outline's corners: where edges of strokes end and meet.
  std::vector<FlatPoint> points;
  /// Counter-clockwise; corners are numbered through outline and points.
  std::vector<std::array<std::uint32_t, 3>> wall, floor;
};

/// Round strokes of this width along the lines; ends have 16 sides.
[[nodiscard]] std::vector<std::vector<FlatPoint>> stroke_outlines(
    std::span<const std::vector<FlatPoint>> lines, double width);

/// @param outline  simple polygon, counter-clockwise
/// @param strokes  convex, counter-clockwise, strictly within the outline
/// @return empty where it is no manifold (grooves that touch in a point), or so narrow a triangle
///         comes out that rounding turns it over: another width of strokes would do
[[nodiscard]] std::optional<Grooves> groove_triangles(
    std::span<const FlatPoint> outline, std::span<const std::vector<FlatPoint>> strokes);

}  // namespace maquette::meshing::detail

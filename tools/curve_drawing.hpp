// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file curve_drawing.hpp
/// A curve with its uncertainty (tools/document.hpp), laid out once for page and PDF.

#include <array>
#include <string>
#include <vector>

#include "tools/document.hpp"

namespace maquette::tools {

/// In shares of the drawing's width (from the left) and height (from below).
struct CurveLayout {
  struct Tick {
    double at, value;
  };
  using Line = std::vector<std::array<double, 2>>;
  std::vector<Tick> x_ticks, y_ticks;
  std::vector<Line> lines;   ///< one between two gaps
  std::vector<Line> shades;  ///< closed: +- half_width about them
};

/// Zero is on the drawing; empty where no y is a number.
/// @pre x, y and half_width of one length, x ascending
[[nodiscard]] CurveLayout layout_of(const Curve& curve);

[[nodiscard]] std::string curve_svg(const Curve& curve);

}  // namespace maquette::tools

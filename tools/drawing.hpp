// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file drawing.hpp
/// A picture of few parts (an image, lines, letters), written once and drawn twice: as SVG and as
/// pixels. Letters of the pixels are strokes of our own, so that no font has to be there.

#include <array>
#include <cstdint>
#include <string>
#include <variant>
#include <vector>

#include "core/grid.hpp"

namespace maquette::tools {

using Colour = std::array<std::uint8_t, 3>;

/// Pixels, x to the right, y down.
struct Point {
  double x = 0.0, y = 0.0;
};

struct DrawnImage {
  Point at;  ///< upper left corner; a pixel of the image is one of the drawing
  Grid<Colour> pixels;
};
struct DrawnLine {
  std::vector<Point> points;
  Colour colour{};
  double width = 1.0;
  double dash = 0.0;  ///< as long as the gap; 0: none
};
struct DrawnBox {
  Point at;
  double width = 0.0, height = 0.0;
  Colour fill{};
};
struct DrawnText {
  enum class Anchor : std::uint8_t { start, middle, end };
  Point at;          ///< on the base line
  std::string text;  ///< UTF-8; Latin letters, digits, signs, ², ³
  double size = 13.0;
  Anchor anchor = Anchor::start;
  bool upwards = false;  ///< turned by a quarter counter-clockwise
  Colour colour{34, 34, 34};
};

struct Drawing {
  double width = 1.0, height = 1.0;
  std::vector<std::variant<DrawnImage, DrawnLine, DrawnBox, DrawnText>>
      parts;  ///< later over earlier
};

[[nodiscard]] std::string to_svg(const Drawing& drawing, const std::string& title);
[[nodiscard]] Grid<Colour> to_pixels(const Drawing& drawing);

/// Width of a text of this size as the strokes draw it; SVG renderers differ by some percent.
[[nodiscard]] double text_width(const std::string& text, double size);

/// The ends of ticks of a scale: at most `most`, at 1, 2 or 5 times a power of ten.
[[nodiscard]] std::vector<double> nice_ticks(double low, double high, int most);
/// Of a logarithmic scale: powers of ten, with 2 and 5 times these where there is room.
/// @pre 0 < low < high
[[nodiscard]] std::vector<double> log_ticks(double low, double high, int most);

}  // namespace maquette::tools

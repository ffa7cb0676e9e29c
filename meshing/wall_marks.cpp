// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "core/stroke_letters.hpp"
#include "meshing/engraving.hpp"

namespace maquette::meshing {
namespace {

Result<void> check_style(const EngravingStyle& s) {
  for (const auto& [name, value] :
       {std::pair{"letters", s.letter.value()}, std::pair{"a depth", s.depth.value()},
        std::pair{"strokes", s.stroke_mm()}})
    if (!(value >= 0.02 && value <= 1000.0))
      return fail(kLabelDoesNotFit,
                  fmt::format("{} of {} mm; 0.02 to 1000 mm expected", name, value));
  if (s.stroke_mm() > 0.5 * s.letter.value())
    return fail(kLabelDoesNotFit, fmt::format("strokes of {:g} mm fill letters of {:g} mm; at most "
                                              "half of their height",
                                              s.stroke_mm(), s.letter.value()));
  return {};
}

/// Where on the ground a length of so many metres is written.
std::string length_text(double metres) {
  if (metres >= 1000.0) return fmt::format("{:g} km", metres / 1000.0);
  if (metres >= 1.0) return fmt::format("{:g} m", metres);
  return fmt::format("{:g} cm", 100.0 * metres);
}

}  // namespace

Result<WallMark> text_mark(const std::string& utf8, const EngravingStyle& style) {
  MAQUETTE_TRY_VOID(check_style(style));
  if (const std::string unknown = unknown_letters(utf8); !unknown.empty())
    return fail(
        kLabelLetter,
        fmt::format("\"{}\" has letters that cannot be engraved: {} (there are A to Z, a to "
                    "z, 0 to 9, space and . , : ; - + / ( ) % = _ < > ' ? \u00b2 \u00b3 \u00d7)",
                    utf8, unknown));
  const double unit = style.letter.value() / kCapitalHeight;
  WallMark mark{.name = fmt::format("\"{}\"", utf8)};
  double pen = 0.0, low = 0.0, high = style.letter.value();
  for (const StrokeLetter& letter : stroke_letters(utf8)) {
    for (const auto& stroke : letter.strokes) {
      auto& line = mark.lines_mm.emplace_back();
      for (const auto& [x, y] : stroke) {
        line.push_back({unit * (pen + x), unit * y});
        mark.width_mm = std::fmax(mark.width_mm, unit * (pen + x));
        low = std::fmin(low, unit * y);
        high = std::fmax(high, unit * y);
      }
    }
    pen += letter.advance;
  }
  if (mark.lines_mm.empty())
    return fail(kLabelLetter, fmt::format("\"{}\" has no letters to engrave", utf8));
  for (auto& line : mark.lines_mm)
    for (auto& p : line) p[1] -= low;
  mark.height_mm = high - low;
  return mark;
}

Result<WallMark> scale_bar_mark(double scale_denominator, double wall_mm,
                                const EngravingStyle& style) {
  MAQUETTE_TRY_VOID(check_style(style));
  if (!(scale_denominator >= 1e-3 && scale_denominator <= 1e12))
    return fail(kLabelDoesNotFit,
                fmt::format("a scale bar for 1:{}; 1:0.001 to 1:1e12 expected", scale_denominator));
  if (!(wall_mm > 0.0)) return fail(kLabelDoesNotFit, fmt::format("a wall of {} mm", wall_mm));
  const double most_m = 0.4 * wall_mm * 1e-3 * scale_denominator;
  const double decade = std::pow(10.0, std::floor(std::log10(most_m) + 1e-12));
  double length_m = decade;
  int parts = 5;
  for (const auto& [factor, count] : {std::pair{2.0, 4}, std::pair{5.0, 5}})
    if (factor * decade <= most_m * (1.0 + 1e-12)) {
      length_m = factor * decade;
      parts = count;
    }
  const double length_mm = length_m * 1e3 / scale_denominator, height = style.letter.value();
  const std::string text = length_text(length_m);
  MAQUETTE_TRY(WallMark mark, text_mark(text, style));
  const double beside = length_mm + 0.5 * height;
  for (auto& line : mark.lines_mm)
    for (auto& p : line) p[0] += beside;
  mark.name = fmt::format("the scale bar of {}", text);
  mark.width_mm += beside;
  mark.at_right = true;
  mark.lines_mm.push_back({{0.0, height}, {0.0, 0.0}, {length_mm, 0.0}, {length_mm, height}});
  for (int i = 1; i < parts; ++i) {
    const double x = length_mm * i / parts;
    mark.lines_mm.push_back({{x, 0.0}, {x, 0.5 * height}});
  }
  return mark;
}

double wall_length_mm(const heightmap::ModelField& surface, WallSide side) {
  return wall_length_mm(surface, all_nodes(surface), side);
}

double wall_length_mm(const heightmap::ModelField& surface, const NodeWindow& window,
                      WallSide side) {
  const bool along_x = side == WallSide::south || side == WallSide::north;
  return surface.spacing.value() *
         static_cast<double>((along_x ? window.cols() : window.rows()) - 1);
}

}  // namespace maquette::meshing

// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/curve_drawing.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "core/check.hpp"
#include "core/markup.hpp"
#include "tools/drawing.hpp"

namespace maquette::tools {
namespace {

struct Range {
  double low, high;
  [[nodiscard]] double share(double v) const { return (v - low) / (high - low); }
};

std::vector<CurveLayout::Tick> ticks_of(const Range& range, int most) {
  std::vector<CurveLayout::Tick> ticks;
  for (const double v : nice_ticks(range.low, range.high, most))
    if (range.share(v) >= -1e-9 && range.share(v) <= 1.0 + 1e-9)
      ticks.push_back({range.share(v), v});
  return ticks;
}

}  // namespace

CurveLayout layout_of(const Curve& c) {
  MAQUETTE_CHECK(c.x.size() == c.y.size() && c.x.size() == c.half_width.size(),
                 "a curve of {}, {} and {} values", c.x.size(), c.y.size(), c.half_width.size());
  CurveLayout layout;
  Range x{INFINITY, -INFINITY}, y{0.0, 0.0};
  for (std::size_t i = 0; i < c.x.size(); ++i) {
    x = {std::fmin(x.low, c.x[i]), std::fmax(x.high, c.x[i])};
    y = {std::fmin(y.low, c.y[i] - c.half_width[i]), std::fmax(y.high, c.y[i] + c.half_width[i])};
  }
  if (y.low == y.high || !(x.high > x.low)) return layout;
  const double margin = 0.05 * (y.high - y.low);
  y = {y.low - margin, y.high + margin};
  layout.x_ticks = ticks_of(x, 8);
  layout.y_ticks = ticks_of(y, 5);
  CurveLayout::Line line, below;
  const auto close = [&] {
    if (line.empty()) return;
    CurveLayout::Line shade;
    for (std::size_t i = 0; i < line.size(); ++i)
      shade.push_back({line[i][0], 2.0 * line[i][1] - below[i][1]});
    shade.insert(shade.end(), below.rbegin(), below.rend());
    layout.lines.push_back(std::move(line));
    layout.shades.push_back(std::move(shade));
    line = below = {};
  };
  for (std::size_t i = 0; i < c.x.size(); ++i) {
    if (std::isnan(c.y[i])) {
      close();
      continue;
    }
    line.push_back({x.share(c.x[i]), y.share(c.y[i])});
    below.push_back({x.share(c.x[i]), y.share(c.y[i] - c.half_width[i])});
  }
  close();
  return layout;
}

std::string curve_svg(const Curve& curve) {
  constexpr double kWidth = 960.0, kHeight = 200.0, kLeft = 70.0, kTop = 12.0;
  const CurveLayout layout = layout_of(curve);
  const auto across = [](double share) { return kLeft + share * kWidth; };
  const auto down = [](double share) { return kTop + (1.0 - share) * kHeight; };
  const auto path = [&](const CurveLayout::Line& line) {
    std::string text;
    for (const auto& [u, v] : line) text += fmt::format("{:.1f},{:.1f} ", across(u), down(v));
    return text;
  };
  std::string svg = fmt::format(
      "<svg viewBox='0 0 1050 262' width='1050' role='img' "
      "aria-label='{}'>",
      markup_escaped(curve.y_label + ", against " + curve.x_label));
  for (const auto& [at, value] : layout.y_ticks)
    svg += fmt::format(
        "<line x1='{:.1f}' x2='{:.1f}' y1='{:.1f}' y2='{:.1f}' stroke='#8886' "
        "stroke-width='{}'/><text x='{:.1f}' y='{:.1f}' font-size='12' "
        "text-anchor='end'>{:.3g}</text>",
        across(0.0), across(1.0), down(at), down(at), value == 0.0 ? 2 : 1, kLeft - 6.0,
        down(at) + 4.0, value);
  for (const auto& shade : layout.shades)
    svg += "<polygon fill='#7a9cc6' fill-opacity='0.45' points='" + path(shade) + "'/>";
  for (const auto& line : layout.lines)
    svg +=
        "<polyline fill='none' stroke='#b2182b' stroke-width='1.5' points='" + path(line) + "'/>";
  for (const auto& [at, value] : layout.x_ticks)
    svg +=
        fmt::format("<text x='{:.1f}' y='{:.1f}' font-size='12' text-anchor='middle'>{:g}</text>",
                    across(at), down(0.0) + 16.0, value);
  return svg + fmt::format(
                   "<text x='{:.1f}' y='{:.1f}' font-size='12' text-anchor='middle'>{}</text>"
                   "<text x='14' y='{:.1f}' font-size='12' text-anchor='middle' "
                   "transform='rotate(-90 14 {:.1f})'>{}</text></svg>",
                   across(0.5), down(0.0) + 36.0, markup_escaped(curve.x_label), down(0.5),
                   down(0.5), markup_escaped(curve.y_label));
}

}  // namespace maquette::tools

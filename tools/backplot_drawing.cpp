// SPDX-License-Identifier: GPL-3.0-or-later

// Where things stand in a backplot's picture.

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "tools/program_pictures.hpp"

namespace maquette::tools {
namespace {

using cnc::BackplotColour;

constexpr double kLeft = 84.0, kRight = 30.0, kHead = 78.0, kFoot = 168.0, kFootTall = 252.0;
constexpr double kLeastWidth = 640.0;  // room for title and scale
constexpr double kBar = 420.0, kWidePlot = 900.0;
constexpr Colour kInk{34, 34, 34}, kFaint{110, 110, 110}, kRapidLine{190, 0, 150};

const char* quantity(BackplotColour colour) {
  switch (colour) {
    case BackplotColour::feed:
      return "feed, mm/min";
    case BackplotColour::engagement:
      return "engagement, mm³ removed per mm of path";
    case BackplotColour::height:
      return "height of the tip, mm";
  }
  return "";
}

/// The part of a segment inside a box (Liang, Barsky); false if none is.
bool clip(Point& a, Point& b, Point low, Point high) {
  double t0 = 0.0, t1 = 1.0;
  const double dx = b.x - a.x, dy = b.y - a.y;
  for (const auto& [p, q] : {std::pair{-dx, a.x - low.x}, std::pair{dx, high.x - a.x},
                             std::pair{-dy, a.y - low.y}, std::pair{dy, high.y - a.y}}) {
    if (p == 0.0 && q < 0.0) return false;
    if (p < 0.0) t0 = std::fmax(t0, q / p);
    if (p > 0.0) t1 = std::fmin(t1, q / p);
  }
  if (t0 > t1) return false;
  const Point from = a;
  a = {from.x + t0 * dx, from.y + t0 * dy};
  b = {from.x + t1 * dx, from.y + t1 * dy};
  return true;
}

class Layout {
 public:
  Layout(const cnc::Backplot& plot, const Grid<cnc::Rgb>& picture) : o_(plot.options()) {
    px_mm_ = plot.pixel_mm();
    plot_width_ = static_cast<double>(picture.cols());
    plot_height_ = static_cast<double>(picture.rows());
    wide_ = plot_width_ >= kWidePlot;
    bottom_ = kHead + plot_height_;
    d_.width = kLeft + std::fmax(plot_width_, kLeastWidth) + kRight;
    d_.height = bottom_ + (wide_ ? kFoot : kFootTall);
    d_.parts.emplace_back(DrawnImage{{kLeft, kHead}, picture});
  }
  [[nodiscard]] Point at(double x_mm, double y_mm) const {
    return {kLeft + (x_mm - o_.x_min_mm) / px_mm_, kHead + (o_.y_max_mm - y_mm) / px_mm_};
  }
  void text(double x, double y, std::string words, double size = 13.0,
            DrawnText::Anchor anchor = DrawnText::Anchor::start, Colour colour = kInk,
            bool upwards = false) {
    d_.parts.emplace_back(DrawnText{{x, y}, std::move(words), size, anchor, upwards, colour});
  }
  void line(std::vector<Point> points, Colour colour, double width, double dash = 0.0) {
    d_.parts.emplace_back(DrawnLine{std::move(points), colour, width, dash});
  }
  /// Inside the plot only.
  void path(const std::vector<Point>& points, Colour colour, double width, double dash = 0.0) {
    const Point low{kLeft, kHead}, high{kLeft + plot_width_, bottom_};
    std::vector<Point> run;
    for (std::size_t i = 1; i < points.size(); ++i) {
      Point a = points[i - 1], b = points[i];
      if (!clip(a, b, low, high)) continue;
      if (run.empty() || run.back().x != a.x || run.back().y != a.y) {
        if (run.size() > 1) line(std::move(run), colour, width, dash);
        run = {a};
      }
      run.push_back(b);
    }
    if (run.size() > 1) line(std::move(run), colour, width, dash);
  }
  void ring(Point centre, double radius, int corners, double turn, Colour colour, double width) {
    std::vector<Point> points;
    for (int k = 0; k <= corners; ++k) {
      const double phi = turn + 2.0 * std::numbers::pi * k / corners;
      points.push_back({centre.x + radius * std::cos(phi), centre.y + radius * std::sin(phi)});
    }
    line(std::move(points), colour, width);
  }
  void box(double x, double y, double width, double height, Colour fill) {
    d_.parts.emplace_back(DrawnBox{{x, y}, width, height, fill});
  }
  void axes();
  void scale(BackplotColour colour, const cnc::BackplotScale& scale);

  const cnc::BackplotOptions& o_;
  double px_mm_ = 1.0, plot_width_ = 0.0, plot_height_ = 0.0, bottom_ = 0.0;
  bool wide_ = true;
  Drawing d_;
};

void Layout::axes() {
  const double right = kLeft + plot_width_;
  line({{kLeft, kHead}, {right, kHead}, {right, bottom_}, {kLeft, bottom_}, {kLeft, kHead}}, kFaint,
       1.0);
  for (const double v :
       nice_ticks(o_.x_min_mm, o_.x_max_mm, std::max(2, static_cast<int>(plot_width_ / 90.0)))) {
    const double x = at(v, 0.0).x;
    line({{x, bottom_}, {x, bottom_ + 6.0}}, kFaint, 1.0);
    text(x, bottom_ + 21.0, fmt::format("{:.6g}", v), 13.0, DrawnText::Anchor::middle);
  }
  for (const double v :
       nice_ticks(o_.y_min_mm, o_.y_max_mm, std::max(2, static_cast<int>(plot_height_ / 50.0)))) {
    const double y = at(0.0, v).y;
    line({{kLeft - 6.0, y}, {kLeft, y}}, kFaint, 1.0);
    text(kLeft - 9.0, y + 4.5, fmt::format("{:.6g}", v), 13.0, DrawnText::Anchor::end);
  }
  text(kLeft + 0.5 * plot_width_, bottom_ + 40.0, "x, mm", 13.0, DrawnText::Anchor::middle);
  text(26.0, kHead + 0.5 * plot_height_, "y, mm", 13.0, DrawnText::Anchor::middle, kInk, true);
}

void Layout::scale(BackplotColour colour, const cnc::BackplotScale& scale) {
  const double top = bottom_ + 76.0;
  text(kLeft, top - 8.0, quantity(colour));
  if (scale.constant) {
    box(kLeft, top, 30.0, 16.0, cnc::backplot_colour(scale.share(scale.high)));
    text(kLeft + 40.0, top + 13.0, fmt::format("{:.4g} everywhere", scale.high));
    return;
  }
  // Each over the next one's beginning: no seams where an SVG is scaled.
  for (int i = static_cast<int>(kBar) - 2; i >= 0; i -= 2)
    box(kLeft + i, top, std::fmin(4.0, kBar - i), 16.0, cnc::backplot_colour((i + 1.0) / kBar));
  const auto ticks = scale.logarithmic ? log_ticks(scale.low, scale.high, 8)
                                       : nice_ticks(scale.low, scale.high, 7);
  for (const double v : ticks) {
    const double x = kLeft + scale.share(v) * kBar;
    line({{x, top + 16.0}, {x, top + 21.0}}, kFaint, 1.0);
    text(x, top + 35.0, fmt::format("{:.4g}", v), 12.0, DrawnText::Anchor::middle);
  }
}

}  // namespace

const char* name(BackplotColour colour) {
  return colour == BackplotColour::feed         ? "feed"
         : colour == BackplotColour::engagement ? "engagement"
                                                : "height";
}

Drawing backplot_drawing(const cnc::Backplot& plot, BackplotColour colour,
                         const std::vector<std::vector<Vec3>>& rapids, double rapids_deviation_mm,
                         const std::string& title, const ProgramFigures& figures,
                         const std::optional<Outline>& outline) {
  const cnc::BackplotScale scale = plot.scale(colour);
  Layout l(plot, plot.picture(colour, scale));
  l.text(kLeft, 30.0, fmt::format("{}: {}", title, name(colour)), 20.0);
  l.text(kLeft, 54.0,
         plot.empty()
             ? std::string("no cutting move")
             : fmt::format("{} moves, {:.1f} m of cuts in {:.1f} min at the feed, {:.1f} m "
                           "of rapids, tip z {:.2f} to {:.2f} mm",
                           figures.moves, 1e-3 * figures.cut_mm, figures.time_min,
                           1e-3 * figures.rapid_mm, figures.lowest_mm, figures.highest_mm),
         13.0, DrawnText::Anchor::start, kFaint);
  l.axes();
  if (outline) {
    const Point a = l.at(outline->x_min_mm, outline->y_min_mm),
                b = l.at(outline->x_max_mm, outline->y_max_mm);
    l.path({a, {b.x, a.y}, b, {a.x, b.y}, a}, kInk, 1.4);
  }
  for (const auto& rapid : rapids) {
    std::vector<Point> points;
    for (const Vec3& p : rapid) points.push_back(l.at(p.x, p.y));
    l.path(points, kRapidLine, 1.2, 5.0);
  }
  for (const Vec3& entry : plot.entries_mm())
    l.ring(l.at(entry.x, entry.y), 3.0, 12, 0.0, kInk, 1.0);
  if (!plot.empty()) {
    l.ring(l.at(plot.begins_mm().x, plot.begins_mm().y), 8.0, 3, -0.5 * std::numbers::pi, kInk,
           2.0);
    l.ring(l.at(plot.ends_mm().x, plot.ends_mm().y), 7.0, 4, 0.25 * std::numbers::pi, kInk, 2.0);
  }
  l.scale(colour, scale);

  // Legend: right of the scale, or below it.
  const double x = l.wide_ ? kLeft + kBar + 70.0 : kLeft, y = l.bottom_ + (l.wide_ ? 68.0 : 140.0);
  constexpr double kColumn = 200.0;
  l.line({{x, y}, {x + 36.0, y}}, kRapidLine, 1.2, 5.0);
  l.text(x + 46.0, y + 4.5, "rapid moves");
  l.ring({x + 18.0, y + 24.0}, 3.0, 12, 0.0, kInk, 1.0);
  l.text(x + 46.0, y + 28.5, "a cut begins");
  l.ring({x + kColumn + 18.0, y + 1.0}, 8.0, 3, -0.5 * std::numbers::pi, kInk, 2.0);
  l.text(x + kColumn + 46.0, y + 4.5, "first cut");
  l.ring({x + kColumn + 18.0, y + 24.0}, 7.0, 4, 0.25 * std::numbers::pi, kInk, 2.0);
  l.text(x + kColumn + 46.0, y + 28.5, "last cut");
  if (outline) {
    l.line({{x + 2.0 * kColumn, y}, {x + 2.0 * kColumn + 36.0, y}}, kInk, 1.4);
    l.text(x + 2.0 * kColumn + 46.0, y + 4.5, "the part");
  }
  std::string note = fmt::format("a pixel is {:.3g} mm, the mean of all path in it", l.px_mm_);
  if (!scale.constant)
    note +=
        scale.all ? "; colours span all values" : "; colours end at the 2nd and 98th percentile";
  if (rapids_deviation_mm > 0.0)
    note += fmt::format("; rapids thinned, within {:.2g} mm", rapids_deviation_mm);
  l.text(kLeft, l.d_.height - 14.0, note, 12.0, DrawnText::Anchor::start, kFaint);
  return std::move(l.d_);
}

}  // namespace maquette::tools

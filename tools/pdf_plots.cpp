// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/pdf_plots.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <string>

#include <fmt/format.h>

#include "tools/curve_drawing.hpp"

namespace maquette::tools {
namespace {

constexpr double kMargin = PdfPage::kMargin, kText = PdfPage::kText, kLine = PdfPage::kLine;
constexpr double kColumn = PdfPage::kColumn;
constexpr double kWidth = PdfPage::kWidth;

void scale(PdfPage& page, double limit, const std::string& unit, double left, double wide) {
  page.font(0.9 * kText, false);
  const double apart = wide < 0.5 * kColumn ? 1.0 : 0.5;  // halves only where there is room
  for (double share = -1.0; share <= 1.0; share += apart) {
    const std::string text = fmt::format("{:+.3g} {}", share * limit, unit);
    const double at = left + 0.5 * (share + 1.0) * wide;
    page.put(std::clamp(at - 0.5 * page.width(text), left, left + wide - page.width(text)), text);
  }
  page.y += 1.6 * kLine;
}

/// @param left, wide  of the bar, points
void colour_bar(PdfPage& page, const SignedLegend& l, double left, double wide) {
  cairo_pattern_t* colours = cairo_pattern_create_linear(left, 0.0, left + wide, 0);
  cairo_pattern_add_color_stop_rgb(colours, 0.0, 0.13, 0.40, 0.67);
  cairo_pattern_add_color_stop_rgb(colours, 0.5, 0.97, 0.97, 0.97);
  cairo_pattern_add_color_stop_rgb(colours, 1.0, 0.70, 0.09, 0.17);
  cairo_set_source(page.cairo, colours);
  cairo_rectangle(page.cairo, left, page.y - kText, wide, kText);
  cairo_fill(page.cairo);
  cairo_pattern_destroy(colours);
  page.y += kLine;
  scale(page, l.limit, l.unit, left, wide);
}

}  // namespace

void print_pictures(PdfPage& page, const std::vector<const Picture*>& row) {
  constexpr double kGap = 14.0;
  const double wide = 0.5 * (kColumn - kGap);
  struct Shown {
    cairo_surface_t* image;
    double high;
  };
  std::vector<Shown> shown;
  double highest = 0.0;
  page.font(0.9 * kText, false);
  std::size_t lines = 0;
  for (const Picture* p : row) {
    cairo_surface_t* image = cairo_image_surface_create_from_png(p->png.c_str());
    const bool good = cairo_surface_status(image) == CAIRO_STATUS_SUCCESS;
    const double high = good ? std::fmin(1.4 * wide, wide * cairo_image_surface_get_height(image) /
                                                         cairo_image_surface_get_width(image))
                             : 0.0;
    shown.push_back({image, high});
    highest = std::fmax(highest, high);
    lines = std::max(lines, page.wrapped(p->caption, wide).size());
  }
  const bool legends =
      std::any_of(row.begin(), row.end(), [](const Picture* p) { return p->legend.has_value(); });
  const double legend_high = legends ? 2.6 * kLine : 0.0;
  page.room(highest + legend_high + static_cast<double>(lines) * kLine + 2.0 * kLine);
  const double top = page.y + 0.6 * kLine;
  double x = kMargin;
  for (std::size_t k = 0; k < row.size(); ++k, x += wide + kGap) {
    page.y = top;
    if (shown[k].high > 0.0) {
      const double scale =
          std::fmin(wide / cairo_image_surface_get_width(shown[k].image),
                    shown[k].high / cairo_image_surface_get_height(shown[k].image));
      cairo_save(page.cairo);
      cairo_translate(page.cairo, x, top - kText);
      cairo_scale(page.cairo, scale, scale);
      cairo_set_source_surface(page.cairo, shown[k].image, 0.0, 0.0);
      cairo_paint(page.cairo);
      cairo_restore(page.cairo);
    }
    page.y = top + highest + 0.4 * kLine;
    if (row[k]->legend && shown[k].high > 0.0) colour_bar(page, *row[k]->legend, x, wide);
    page.y = top + highest + legend_high + 0.4 * kLine;
    page.font(0.9 * kText, false);
    const std::string text =
        shown[k].high > 0.0 ? row[k]->caption : row[k]->png.filename().string() + " is missing";
    for (const std::string& line : page.wrapped(text, wide)) {
      page.put(x, line);
      page.y += kLine;
    }
    cairo_surface_destroy(shown[k].image);
  }
  page.y = top + highest + legend_high + static_cast<double>(lines) * kLine + 0.8 * kLine;
}

void print_legend(PdfPage& page, const SignedLegend& l) {
  page.room(4.0 * kLine);
  colour_bar(page, l, kMargin, 0.6 * kColumn);
}

void print_curve(PdfPage& page, const Curve& c) {
  constexpr double kHigh = 120.0, kLabels = 34.0;
  page.room(kHigh + 4.0 * kLine);
  const CurveLayout layout = layout_of(c);
  const double left = kMargin + kLabels, wide = kColumn - kLabels, top = page.y - kText;
  const auto follow = [&](const CurveLayout::Line& line) {
    for (const auto& [u, v] : line)
      cairo_line_to(page.cairo, left + wide * u, top + kHigh * (1.0 - v));
  };
  page.font(0.9 * kText, false);
  cairo_set_line_width(page.cairo, 0.5);
  for (const auto& [at, value] : layout.y_ticks) {
    page.y = top + kHigh * (1.0 - at);
    cairo_set_source_rgb(page.cairo, 0.7, 0.7, 0.7);
    cairo_move_to(page.cairo, left, page.y);
    cairo_line_to(page.cairo, left + wide, page.y);
    cairo_stroke(page.cairo);
    const std::string text = fmt::format("{:.3g}", value);
    page.y += 0.35 * kText;
    page.put(left - 4.0 - page.width(text), text);
  }
  cairo_set_source_rgba(page.cairo, 0.48, 0.61, 0.78, 0.5);
  for (const auto& shade : layout.shades) {
    follow(shade);
    cairo_fill(page.cairo);
  }
  cairo_set_source_rgb(page.cairo, 0.70, 0.09, 0.17);
  cairo_set_line_width(page.cairo, 1.0);
  for (const auto& line : layout.lines) {
    follow(line);
    cairo_stroke(page.cairo);
  }
  page.y = top + kHigh + kLine;
  for (const auto& [at, value] : layout.x_ticks) {
    const std::string text = fmt::format("{:g}", value);
    page.put(
        std::fmin(left + wide * at - 0.5 * page.width(text), kWidth - kMargin - page.width(text)),
        text);
  }
  page.y += kLine;
  const std::string under = c.y_label + ", against " + c.x_label;
  page.put(left + 0.5 * (wide - page.width(under)), under);
  page.y += 1.6 * kLine;
}

void print_histogram(PdfPage& page, const Histogram& h) {
  if (h.bins.empty()) return;
  constexpr double kHigh = 130.0;
  page.room(kHigh + 3.0 * kLine);
  const double wide = kColumn, top = page.y - kText;
  const double most =
      std::fmax(1.0, static_cast<double>(*std::max_element(h.bins.begin(), h.bins.end())));
  const double bar = wide / static_cast<double>(h.bins.size());
  cairo_set_source_rgb(page.cairo, 0.48, 0.61, 0.78);
  double total = 0.0;
  for (std::size_t i = 0; i < h.bins.size(); ++i) {
    const double high = kHigh * static_cast<double>(h.bins[i]) / most;
    total += static_cast<double>(h.bins[i]);
    cairo_rectangle(page.cairo, kMargin + bar * static_cast<double>(i), top + kHigh - high, bar,
                    high);
  }
  cairo_fill(page.cairo);
  if (h.sigma > 0.0) {
    cairo_set_source_rgb(page.cairo, 0.70, 0.09, 0.17);
    cairo_set_line_width(page.cairo, 1.0);
    const double bin = 2.0 * h.limit / static_cast<double>(h.bins.size());
    for (int i = 0; i <= 200; ++i) {
      const double v = h.limit * (i / 100.0 - 1.0), z = (v - h.mean) / h.sigma;
      const double count =
          std::exp(-0.5 * z * z) / (h.sigma * std::sqrt(2.0 * std::numbers::pi)) * total * bin;
      cairo_line_to(page.cairo, kMargin + wide * i / 200.0,
                    top + kHigh * (1.0 - std::fmin(1.0, count / most)));
    }
    cairo_stroke(page.cairo);
  }
  page.y = top + kHigh + kLine;
  scale(page, h.limit, h.unit, kMargin, wide);
}

}  // namespace maquette::tools

// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/pictures.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "heightmap/fuse.hpp"

namespace maquette::tools {
namespace {

/// Mean of each block of `step` x `step` cells that are not void; flips to north up.
Grid<float> shrink(const Grid<float>& values, int longest_px) {
  const std::ptrdiff_t longest = std::max(values.rows(), values.cols());
  const std::ptrdiff_t step = std::max<std::ptrdiff_t>(1, (longest + longest_px - 1) / longest_px);
  const std::ptrdiff_t rows = (values.rows() + step - 1) / step;
  const std::ptrdiff_t cols = (values.cols() + step - 1) / step;
  Grid<float> small(rows, cols, NAN);
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      double sum = 0.0;
      int n = 0;
      for (std::ptrdiff_t i = r * step; i < std::min(values.rows(), (r + 1) * step); ++i)
        for (std::ptrdiff_t j = c * step; j < std::min(values.cols(), (c + 1) * step); ++j)
          if (const float v = values(i, j); !std::isnan(v)) sum += static_cast<double>(v), ++n;
      if (n > 0) small(rows - 1 - r, c) = static_cast<float>(sum / n);
    }
  return small;
}

camera::Rgb8 signed_colour(double share) {
  // Ends of a red-blue diverging scale that stays distinct for red-green blindness.
  constexpr std::array<double, 3> kBelow{33, 102, 172}, kAbove{178, 24, 43};
  const double k = std::clamp(std::fabs(share), 0.0, 1.0);
  const auto& end = share < 0 ? kBelow : kAbove;
  camera::Rgb8 colour{};
  for (std::size_t i = 0; i < 3; ++i)
    colour[i] = static_cast<std::uint8_t>(std::lround(247.0 + k * (end[i] - 247.0)));
  return colour;
}

std::string hex(const camera::Rgb8& c) {
  return fmt::format("#{:02x}{:02x}{:02x}", c[0], c[1], c[2]);
}

}  // namespace

Grid<std::uint8_t> hillshade_picture(const heightmap::ModelField& field, int longest_px) {
  const Grid<std::uint8_t> full = heightmap::hillshade(field);
  Grid<float> values(full.rows(), full.cols());
  std::copy(full.cells().begin(), full.cells().end(), values.cells().begin());
  const Grid<float> small = shrink(values, longest_px);
  Grid<std::uint8_t> picture(small.rows(), small.cols());
  std::transform(small.cells().begin(), small.cells().end(), picture.cells().begin(),
                 [](float v) { return static_cast<std::uint8_t>(std::lround(v)); });
  return picture;
}

Grid<camera::Rgb8> signed_picture(const Grid<float>& values, double limit,
                                  const heightmap::ModelField* relief, int longest_px) {
  constexpr camera::Rgb8 kNone{128, 128, 128}, kNoneOnRelief{70, 70, 70};
  constexpr double kDarkest = 0.55;
  const Grid<float> small = shrink(values, longest_px);
  Grid<camera::Rgb8> picture(small.rows(), small.cols(), relief != nullptr ? kNoneOnRelief : kNone);
  Grid<std::uint8_t> shade;
  if (relief != nullptr) shade = hillshade_picture(*relief, longest_px);
  for (std::ptrdiff_t r = 0; r < small.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < small.cols(); ++c) {
      if (std::isnan(small(r, c))) continue;
      camera::Rgb8 colour = signed_colour(static_cast<double>(small(r, c)) / limit);
      if (relief != nullptr)
        for (std::uint8_t& part : colour)
          part = static_cast<std::uint8_t>(
              std::lround(part * (kDarkest + (1.0 - kDarkest) * shade(r, c) / 255.0)));
      picture(r, c) = colour;
    }
  return picture;
}

std::string signed_legend_svg(double limit, const std::string& unit) {
  constexpr int kSteps = 60, kWidth = 6;
  std::string svg =
      fmt::format("<svg viewBox='0 0 {} 40' width='{}' role='img' aria-label='colour scale'>",
                  kSteps * kWidth + 80, kSteps * kWidth + 80);
  for (int i = 0; i < kSteps; ++i)
    svg += fmt::format("<rect x='{}' y='2' width='{}' height='14' fill='{}'/>", 40 + i * kWidth,
                       kWidth + 1, hex(signed_colour(2.0 * (i + 0.5) / kSteps - 1.0)));
  for (const double v : {-limit, 0.0, limit})
    svg +=
        fmt::format("<text x='{:.0f}' y='34' font-size='12' text-anchor='middle'>{:+.3g} {}</text>",
                    40 + (v / limit + 1.0) / 2.0 * kSteps * kWidth, v, unit);
  return svg + "</svg>";
}

std::string histogram_svg(std::span<const std::uint64_t> bins, double limit, double mean,
                          double sigma, const std::string& unit) {
  if (bins.empty()) return "";
  const double highest =
      std::max(1.0, static_cast<double>(*std::max_element(bins.begin(), bins.end())));
  const double total = [&] {
    double t = 0.0;
    for (const auto b : bins) t += static_cast<double>(b);
    return t;
  }();
  constexpr double kWidth = 560, kHeight = 200, kLeft = 20;
  const double bar = kWidth / static_cast<double>(bins.size());
  std::string svg = fmt::format(
      "<svg viewBox='0 0 600 240' width='600' role='img' aria-label='histogram of deviations'>");
  for (std::size_t i = 0; i < bins.size(); ++i) {
    const double h = kHeight * static_cast<double>(bins[i]) / highest;
    svg +=
        fmt::format("<rect x='{:.2f}' y='{:.2f}' width='{:.2f}' height='{:.2f}' fill='#7a9cc6'/>",
                    kLeft + bar * static_cast<double>(i), 10 + kHeight - h, bar, h);
  }
  if (sigma > 0.0) {
    std::string points;
    const double bin_width = 2.0 * limit / static_cast<double>(bins.size());
    for (int i = 0; i <= 140; ++i) {
      const double v = -limit + 2.0 * limit * i / 140.0;
      const double density = std::exp(-0.5 * std::pow((v - mean) / sigma, 2)) /
                             (sigma * std::sqrt(2.0 * M_PI)) * total * bin_width;
      points += fmt::format("{:.1f},{:.1f} ", kLeft + (v / limit + 1.0) / 2.0 * kWidth,
                            10 + kHeight * (1.0 - std::min(1.0, density / highest)));
    }
    svg += "<polyline fill='none' stroke='#b2182b' stroke-width='1.5' points='" + points + "'/>";
  }
  for (const double v : {-limit, -limit / 2, 0.0, limit / 2, limit})
    svg += fmt::format(
        "<text x='{:.0f}' y='230' font-size='12' text-anchor='middle'>{:+.3g} {}</text>",
        kLeft + (v / limit + 1.0) / 2.0 * kWidth, v, unit);
  return svg + "</svg>";
}

double colour_limit(const Grid<float>& values, double least) {
  std::vector<float> sample;
  const std::size_t step = std::max<std::size_t>(1, values.cells().size() / 200000);
  for (std::size_t i = 0; i < values.cells().size(); i += step)
    if (const float v = values.cells()[i]; !std::isnan(v)) sample.push_back(std::fabs(v));
  if (sample.empty()) return least;
  const auto at =
      sample.begin() + static_cast<std::ptrdiff_t>(0.98 * static_cast<double>(sample.size() - 1));
  std::nth_element(sample.begin(), at, sample.end());
  return std::max(least, static_cast<double>(*at));
}

std::string base64(const std::string& data) {
  static constexpr const char* kLetters =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZabcdefghijklmnopqrstuvwxyz0123456789+/";
  std::string out;
  out.reserve((data.size() + 2) / 3 * 4);
  for (std::size_t i = 0; i < data.size(); i += 3) {
    unsigned bits = 0;
    for (std::size_t k = 0; k < 3; ++k)
      bits = bits << 8 | (i + k < data.size() ? static_cast<unsigned char>(data[i + k]) : 0U);
    for (std::size_t k = 0; k < 4; ++k)
      out += k <= data.size() - i || k < 2 ? kLetters[bits >> (18 - 6 * k) & 63U] : '=';
  }
  return out;
}

}  // namespace maquette::tools

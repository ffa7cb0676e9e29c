// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/backplot.hpp"

#include <algorithm>
#include <cmath>

#include "core/check.hpp"

namespace maquette::cnc {
namespace {

constexpr std::array<Rgb, 6> kColours{
    {{48, 18, 117}, {40, 110, 200}, {30, 160, 135}, {120, 190, 60}, {235, 185, 40}, {190, 35, 20}}};
constexpr double kMostSteps = 1e7;  // of one motion, however long
constexpr std::ptrdiff_t kEntryPixels = 8;

std::ptrdiff_t count_of(double length, double longest, int most) {
  return std::max<std::ptrdiff_t>(1, std::lround(std::ceil(length / longest * most)));
}

/// What lies on the last edge belongs to the last pixel.
std::ptrdiff_t index_of(double from_edge_mm, double px_mm, std::ptrdiff_t count) {
  const auto i = static_cast<std::ptrdiff_t>(std::floor(from_edge_mm / px_mm));
  return i == count ? i - 1 : i;
}

}  // namespace

Rgb backplot_colour(double share) {
  const double at = std::clamp(share, 0.0, 1.0) * static_cast<double>(kColours.size() - 1);
  const auto i = std::min(static_cast<std::size_t>(at), kColours.size() - 2);
  const double f = at - static_cast<double>(i);
  Rgb mixed{};
  for (std::size_t k = 0; k < 3; ++k)
    mixed[k] =
        static_cast<std::uint8_t>(std::lround((1.0 - f) * kColours[i][k] + f * kColours[i + 1][k]));
  return mixed;
}

double BackplotScale::share(double value) const {
  if (logarithmic) return std::log(value / low) / std::log(high / low);
  return (value - low) / (high - low);
}

Backplot::Backplot(const BackplotOptions& options) : o_(options) {
  const double width = o_.x_max_mm - o_.x_min_mm, height = o_.y_max_mm - o_.y_min_mm;
  MAQUETTE_CHECK(width > 0.0 && height > 0.0 && o_.longest_px >= 1, "{} x {} mm, {} pixels", width,
                 height, o_.longest_px);
  const double longest = std::max(width, height);
  px_mm_ = longest / o_.longest_px;
  pixels_ = Grid<Pixel>(count_of(height, longest, o_.longest_px),
                        count_of(width, longest, o_.longest_px));
  entered_ =
      Grid<std::uint8_t>(pixels_.rows() / kEntryPixels + 1, pixels_.cols() / kEntryPixels + 1, 0);
}

void Backplot::enter(Vec3 at) {
  const std::ptrdiff_t r = index_of(o_.y_max_mm - at.y, px_mm_, pixels_.rows()) / kEntryPixels;
  const std::ptrdiff_t c = index_of(at.x - o_.x_min_mm, px_mm_, pixels_.cols()) / kEntryPixels;
  if (!entered_.contains(r, c) || entered_(r, c) != 0) return;
  entered_(r, c) = 1;
  entries_.push_back(at);
}

void Backplot::add(const Motion& motion, double removed_mm3) {
  const double length = length_mm(motion);
  const bool rapid = motion.kind == Motion::Kind::rapid;
  if (!rapid) {
    if (!cutting_) enter(motion.from_mm);
    if (!any_cut_) begins_ = motion.from_mm;
    any_cut_ = true;
    ends_ = motion.to_mm;
  }
  cutting_ = !rapid;
  const double engagement = length > 0.0 ? removed_mm3 / length : 0.0;
  for_each_chord(motion, 1e-3 * px_mm_, [&](Vec3 from, Vec3 to) {
    const double chord = norm(to - from);
    const double steps = std::clamp(std::ceil(chord / (0.5 * px_mm_)), 1.0, kMostSteps);
    const auto n = static_cast<std::int64_t>(steps);
    const double piece = chord / steps;
    for (std::int64_t i = 0; i < n; ++i) {
      const Vec3 p = from + (static_cast<double>(i) + 0.5) / steps * (to - from);
      const std::ptrdiff_t r = index_of(o_.y_max_mm - p.y, px_mm_, pixels_.rows());
      const std::ptrdiff_t c = index_of(p.x - o_.x_min_mm, px_mm_, pixels_.cols());
      if (!pixels_.contains(r, c)) continue;
      Pixel& pixel = pixels_(r, c);
      if (rapid) {
        pixel.rapid = true;
        continue;
      }
      pixel.length += static_cast<float>(piece);
      pixel.feed_length += static_cast<float>(piece * motion.feed_mm_min);
      pixel.height_length += static_cast<float>(piece * p.z);
      pixel.volume += static_cast<float>(piece * engagement);
    }
  });
}

double Backplot::value(const Pixel& pixel, BackplotColour colour) {
  const auto length = static_cast<double>(pixel.length);
  if (colour == BackplotColour::feed) return static_cast<double>(pixel.feed_length) / length;
  if (colour == BackplotColour::height) return static_cast<double>(pixel.height_length) / length;
  return std::max(kLeastEngagement_mm2, static_cast<double>(pixel.volume) / length);
}

BackplotScale Backplot::scale(BackplotColour colour) const {
  std::vector<double> values;
  for (const Pixel& pixel : pixels_.cells())
    if (pixel.length > 0.0F) values.push_back(value(pixel, colour));
  BackplotScale scale;
  scale.logarithmic = colour == BackplotColour::engagement;
  if (values.empty()) {
    if (scale.logarithmic) scale.low = kLeastEngagement_mm2;
    return scale;
  }
  const auto quantile = [&](double share) {
    const auto k = static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), values.begin() + k, values.end());
    return values[static_cast<std::size_t>(k)];
  };
  scale.low = quantile(0.02);
  scale.high = quantile(0.98);
  // Single pixels of another value are worth a scale; a thousandth of it is rounding.
  const double least = 1e-3 * std::fmax(std::abs(scale.low), std::abs(scale.high));
  if (scale.high - scale.low <= least) {
    scale.all = true;
    scale.low = quantile(0.0);
    scale.high = quantile(1.0);
  }
  if (scale.high - scale.low <= least) {
    scale.constant = true;
    scale.low = scale.logarithmic ? 0.1 * scale.high : scale.high - 1.0;
  }
  return scale;
}

Grid<Rgb> Backplot::picture(BackplotColour colour, const BackplotScale& scale) const {
  Grid<Rgb> picture(pixels_.rows(), pixels_.cols(), kPaperColour);
  for (std::ptrdiff_t r = 0; r < pixels_.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < pixels_.cols(); ++c) {
      const Pixel& pixel = pixels_(r, c);
      if (pixel.length > 0.0F)
        picture(r, c) = backplot_colour(scale.share(value(pixel, colour)));
      else if (pixel.rapid)
        picture(r, c) = kRapidColour;
    }
  // Passes far apart are lines of one pixel, which nobody sees: three then.
  const auto cut = [&](std::ptrdiff_t r, std::ptrdiff_t c) {
    return pixels_.contains(r, c) && pixels_(r, c).length > 0.0F;
  };
  const auto count = std::count_if(pixels_.cells().begin(), pixels_.cells().end(),
                                   [](const Pixel& p) { return p.length > 0.0F; });
  if (2 * count >= static_cast<std::ptrdiff_t>(pixels_.cells().size())) return picture;
  for (std::ptrdiff_t r = 0; r < pixels_.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < pixels_.cols(); ++c) {
      if (cut(r, c) || pixels_(r, c).rapid) continue;
      for (const auto& [dr, dc] :
           {std::pair{1, 0}, std::pair{-1, 0}, std::pair{0, 1}, std::pair{0, -1}})
        if (cut(r + dr, c + dc)) {
          picture(r, c) = picture(r + dr, c + dc);
          break;
        }
    }
  return picture;
}

}  // namespace maquette::cnc

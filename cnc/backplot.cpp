// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/backplot.hpp"

#include <algorithm>
#include <cmath>
#include <iterator>

#include <fmt/format.h>

#include "cnc/arc_geometry.hpp"
#include "core/check.hpp"

namespace maquette::cnc {
namespace {

using Rgb = std::array<std::uint8_t, 3>;
constexpr std::array<Rgb, 6> kColours{
    {{48, 18, 117}, {40, 110, 200}, {30, 160, 135}, {120, 190, 60}, {235, 185, 40}, {190, 35, 20}}};
constexpr Rgb kRapid{170, 170, 170}, kNothing{255, 255, 255};
constexpr std::size_t kShades = 12;
// Runs end where feed or engagement leave this factor about their mean.
constexpr double kSameColour = 1.5;
constexpr double kLeastEngagement_mm2 = 1e-4;

Rgb colour_of(double share) {
  const double at = std::clamp(share, 0.0, 1.0) * static_cast<double>(kColours.size() - 1);
  const auto i = std::min(static_cast<std::size_t>(at), kColours.size() - 2);
  const double f = at - static_cast<double>(i);
  Rgb mixed{};
  for (std::size_t k = 0; k < 3; ++k)
    mixed[k] =
        static_cast<std::uint8_t>(std::lround((1.0 - f) * kColours[i][k] + f * kColours[i + 1][k]));
  return mixed;
}

std::ptrdiff_t count_of(double length, double longest, int most) {
  return std::max<std::ptrdiff_t>(1, std::lround(std::ceil(length / longest * most)));
}

/// Place of a motion at a share of its sweep; arcs as a circle of linearly changing radius.
class Walker {
 public:
  explicit Walker(const Motion& m) : m_(m) {
    if (m.kind != Motion::Kind::arc) return;
    const auto [first, second, third] = axes_of(m.plane);
    a_ = {m.from_mm.x, m.from_mm.y, m.from_mm.z};
    b_ = {m.to_mm.x, m.to_mm.y, m.to_mm.z};
    c_ = {m.centre_mm.x, m.centre_mm.y, m.centre_mm.z};
    r0_ = std::hypot(a_[first] - c_[first], a_[second] - c_[second]);
    r1_ = std::hypot(b_[first] - c_[first], b_[second] - c_[second]);
    begin_ = std::atan2(a_[second] - c_[second], a_[first] - c_[first]);
  }
  [[nodiscard]] Vec3 at(double share) const {
    if (m_.kind != Motion::Kind::arc) return m_.from_mm + share * (m_.to_mm - m_.from_mm);
    const auto [first, second, third] = axes_of(m_.plane);
    const double r = r0_ + share * (r1_ - r0_), phi = begin_ + share * m_.sweep_rad;
    std::array<double, 3> p{};
    p[first] = c_[first] + r * std::cos(phi);
    p[second] = c_[second] + r * std::sin(phi);
    p[third] = a_[third] + share * (b_[third] - a_[third]);
    return {p[0], p[1], p[2]};
  }

 private:
  const Motion& m_;
  std::array<double, 3> a_{}, b_{}, c_{};
  double r0_ = 0.0, r1_ = 0.0, begin_ = 0.0;
};

bool same(double a, double b) {
  return a <= kSameColour * b && b <= kSameColour * a;
}

}  // namespace

Backplot::Backplot(const BackplotOptions& options) : o_(options) {
  const double width = o_.x_max_mm - o_.x_min_mm, height = o_.y_max_mm - o_.y_min_mm;
  MAQUETTE_CHECK(width > 0.0 && height > 0.0 && o_.longest_px >= 1 && o_.longest_cells >= 1,
                 "{} x {} mm, {} pixels, {} cells", width, height, o_.longest_px, o_.longest_cells);
  const double longest = std::max(width, height);
  px_mm_ = longest / o_.longest_px;
  cell_mm_ = longest / o_.longest_cells;
  pixels_ = Grid<Pixel>(count_of(height, longest, o_.longest_px),
                        count_of(width, longest, o_.longest_px));
  cut_cells_ = Grid<std::uint8_t>(count_of(height, longest, o_.longest_cells),
                                  count_of(width, longest, o_.longest_cells), 0);
  rapid_cells_ = cut_cells_;
}

void Backplot::add(const Motion& motion, double removed_mm3) {
  const double length = length_mm(motion);
  const bool rapid = motion.kind == Motion::Kind::rapid;
  const Walker walker(motion);
  const double step = 0.5 * std::min(px_mm_, cell_mm_);
  const double steps = std::fmax(1.0, std::ceil(length / step));
  const auto n = static_cast<std::int64_t>(std::fmin(steps, 1e7));
  const double piece = length / static_cast<double>(n);
  const double engagement = length > 0.0 ? removed_mm3 / length : 0.0;
  for (std::int64_t i = 0; i < n; ++i) {
    const Vec3 p = walker.at((static_cast<double>(i) + 0.5) / static_cast<double>(n));
    const auto row = static_cast<std::ptrdiff_t>(std::floor((o_.y_max_mm - p.y) / px_mm_));
    const auto col = static_cast<std::ptrdiff_t>(std::floor((p.x - o_.x_min_mm) / px_mm_));
    // What lies on the last edge belongs to the last pixel.
    const std::ptrdiff_t r = row == pixels_.rows() ? row - 1 : row;
    const std::ptrdiff_t c = col == pixels_.cols() ? col - 1 : col;
    if (pixels_.contains(r, c)) {
      Pixel& pixel = pixels_(r, c);
      if (rapid) {
        pixel.rapid = true;
      } else {
        pixel.length += static_cast<float>(piece);
        pixel.feed_length += static_cast<float>(piece * motion.feed_mm_min);
        pixel.volume += static_cast<float>(piece * engagement);
      }
    }
    thin(motion, p, engagement);
  }
}

void Backplot::thin(const Motion& motion, Vec3 at, double engagement) {
  const bool rapid = motion.kind == Motion::Kind::rapid;
  Grid<std::uint8_t>& cells = rapid ? rapid_cells_ : cut_cells_;
  const auto row = static_cast<std::ptrdiff_t>(std::floor((at.y - o_.y_min_mm) / cell_mm_));
  const auto col = static_cast<std::ptrdiff_t>(std::floor((at.x - o_.x_min_mm) / cell_mm_));
  const std::ptrdiff_t r = row == cells.rows() ? row - 1 : row;
  const std::ptrdiff_t c = col == cells.cols() ? col - 1 : col;
  if (!cells.contains(r, c)) {
    open_ = false;
    return;
  }
  const double e = std::max(engagement, kLeastEngagement_mm2);
  if (open_) {
    BackplotRun& run = runs_.back();
    const Vec3 from = run.points_mm.back();
    const bool here = std::hypot(at.x - from.x, at.y - from.y) < 0.5 * cell_mm_;
    if (here && run.rapid == rapid) return;  // the cell of the last point
    if (run.rapid == rapid && cells(r, c) == 0 && same(e, run.engagement_mm2) &&
        (rapid || same(motion.feed_mm_min, run.feed_mm_min))) {
      cells(r, c) = 1;
      run.points_mm.push_back(at);
      return;
    }
    open_ = false;
  }
  if (cells(r, c) != 0) return;
  cells(r, c) = 1;
  runs_.push_back({rapid, motion.feed_mm_min, e, {at}});
  open_ = true;
}

double Backplot::value(const Pixel& pixel, BackplotColour colour) const {
  const auto length = static_cast<double>(pixel.length);
  if (colour == BackplotColour::feed) return static_cast<double>(pixel.feed_length) / length;
  return std::max(kLeastEngagement_mm2, static_cast<double>(pixel.volume) / length);
}

Backplot::Scale Backplot::scale(BackplotColour colour) const {
  std::vector<double> values;
  for (const Pixel& pixel : pixels_.cells())
    if (pixel.length > 0.0F) values.push_back(value(pixel, colour));
  if (values.empty()) return {};
  const auto quantile = [&](double share) {
    const auto k = static_cast<std::ptrdiff_t>(share * static_cast<double>(values.size() - 1));
    std::nth_element(values.begin(), values.begin() + k, values.end());
    return values[static_cast<std::size_t>(k)];
  };
  Scale scale{quantile(0.02), quantile(0.98)};
  // A program of one feed has a scale too.
  if (!(scale.high > scale.low * 1.001)) scale = {scale.low * 0.5, scale.high};
  return scale;
}

Rgb Backplot::shade(double v, BackplotColour colour, const Scale& scale) const {
  if (colour == BackplotColour::feed) return colour_of((v - scale.low) / (scale.high - scale.low));
  return colour_of(std::log(v / scale.low) / std::log(scale.high / scale.low));
}

Grid<Rgb> Backplot::picture(BackplotColour colour) const {
  const Scale of = scale(colour);
  Grid<Rgb> picture(pixels_.rows(), pixels_.cols(), kNothing);
  for (std::ptrdiff_t r = 0; r < pixels_.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < pixels_.cols(); ++c) {
      const Pixel& pixel = pixels_(r, c);
      if (pixel.length > 0.0F)
        picture(r, c) = shade(value(pixel, colour), colour, of);
      else if (pixel.rapid)
        picture(r, c) = kRapid;
    }
  return picture;
}

std::string Backplot::svg(BackplotColour colour, const std::string& title) const {
  const double width = o_.x_max_mm - o_.x_min_mm, height = o_.y_max_mm - o_.y_min_mm;
  const double unit = std::max(width, height) / 1000.0;  // of lines and letters
  const Scale of = scale(colour);
  const char* name = colour == BackplotColour::feed ? "feed, mm/min" : "engagement, mm³ per mm";
  std::string out;
  const auto put = [&]<class... T>(fmt::format_string<T...> text, T&&... values) {
    fmt::format_to(std::back_inserter(out), text, std::forward<T>(values)...);
  };
  put("<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"{:.6g} {:.6g} {:.6g} {:.6g}\" "
      "font-family=\"sans-serif\" font-size=\"{:.4g}\">\n",
      -70.0 * unit, -60.0 * unit, width + 100.0 * unit, height + 160.0 * unit, 18.0 * unit);
  std::string safe;
  for (const char ch : title) safe += ch == '<' ? "&lt;" : ch == '&' ? "&amp;" : std::string(1, ch);
  put("<title>{}</title>\n<text y=\"{:.4g}\" font-size=\"{:.4g}\">{}</text>\n", safe, -25.0 * unit,
      24.0 * unit, safe);

  // Paths by shade: few groups, each with one colour.
  std::array<std::string, kShades> cuts;
  std::string rapids;
  for (const BackplotRun& run : runs_) {
    const double v = colour == BackplotColour::feed ? run.feed_mm_min : run.engagement_mm2;
    const double share = colour == BackplotColour::feed
                             ? (v - of.low) / (of.high - of.low)
                             : std::log(v / of.low) / std::log(of.high / of.low);
    const auto k = static_cast<std::size_t>(
        std::lround(std::clamp(share, 0.0, 1.0) * static_cast<double>(kShades - 1)));
    std::string& path = run.rapid ? rapids : cuts[k];
    const char* command = "M";
    for (const Vec3& p : run.points_mm) {
      fmt::format_to(std::back_inserter(path), "{}{:.2f} {:.2f}", command, p.x - o_.x_min_mm,
                     o_.y_max_mm - p.y);
      command = "L";
    }
    if (run.points_mm.size() == 1) path += "h0.01";  // a dot
  }
  const auto rgb = [](Rgb c) { return fmt::format("#{:02x}{:02x}{:02x}", c[0], c[1], c[2]); };
  const auto shade_of = [](std::size_t k) {
    return colour_of(static_cast<double>(k) / static_cast<double>(kShades - 1));
  };
  put("<g fill=\"none\" stroke-linecap=\"round\" stroke-width=\"{:.4g}\">\n", 0.8 * cell_mm_);
  for (std::size_t k = 0; k < kShades; ++k)
    if (!cuts[k].empty()) put("<path stroke=\"{}\" d=\"{}\"/>\n", rgb(shade_of(k)), cuts[k]);
  put("</g>\n");
  if (!rapids.empty())
    put("<path fill=\"none\" stroke=\"#777\" stroke-width=\"{:.4g}\" stroke-dasharray=\"{:.4g}\" "
        "d=\"{}\"/>\n",
        1.2 * unit, 6.0 * unit, rapids);

  put("<rect width=\"{:.6g}\" height=\"{:.6g}\" fill=\"none\" stroke=\"#000\" "
      "stroke-width=\"{:.4g}\"/>\n",
      width, height, unit);
  for (int i = 0; i <= 4; ++i) {
    const double f = 0.25 * i;
    put("<text x=\"{:.6g}\" y=\"{:.6g}\" text-anchor=\"middle\">{:.6g}</text>\n", f * width,
        height + 24.0 * unit, o_.x_min_mm + f * width);
    put("<text x=\"{:.6g}\" y=\"{:.6g}\" text-anchor=\"end\">{:.6g}</text>\n", -6.0 * unit,
        (1.0 - f) * height + 6.0 * unit, o_.y_min_mm + f * height);
  }
  for (std::size_t k = 0; k < kShades; ++k)
    put("<rect x=\"{:.6g}\" y=\"{:.6g}\" width=\"{:.6g}\" height=\"{:.6g}\" fill=\"{}\"/>\n",
        30.0 * unit * static_cast<double>(k), height + 50.0 * unit, 31.0 * unit, 18.0 * unit,
        rgb(shade_of(k)));
  put("<text x=\"0\" y=\"{0:.6g}\">{1:.3g}</text>\n<text x=\"{2:.6g}\" y=\"{0:.6g}\" "
      "text-anchor=\"end\">{3:.3g}</text>\n<text x=\"{4:.6g}\" y=\"{0:.6g}\">{5}, rapids "
      "dashed</text>\n</svg>\n",
      height + 90.0 * unit, of.low, 360.0 * unit, of.high, 380.0 * unit, name);
  return out;
}

}  // namespace maquette::cnc

// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/drawing.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "camera/image_io.hpp"
#include "core/markup.hpp"
#include "core/stroke_letters.hpp"
#include "tools/pictures.hpp"

namespace maquette::tools {
namespace {

constexpr Colour kPaper{255, 255, 255};
// Capitals of common fonts are about this share of the font's size.
constexpr double kCapitalShare = 0.72;

std::string hex(Colour c) {
  return fmt::format("#{:02x}{:02x}{:02x}", c[0], c[1], c[2]);
}

class Painter {
 public:
  Painter(double width, double height)
      : pixels_(static_cast<std::ptrdiff_t>(std::ceil(height)),
                static_cast<std::ptrdiff_t>(std::ceil(width)), kPaper) {}

  void paint(const DrawnImage& image) {
    const auto r0 = std::lround(image.at.y), c0 = std::lround(image.at.x);
    for (std::ptrdiff_t r = 0; r < image.pixels.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < image.pixels.cols(); ++c)
        if (pixels_.contains(r0 + r, c0 + c)) pixels_(r0 + r, c0 + c) = image.pixels(r, c);
  }
  void paint(const DrawnBox& box) {
    for (auto r = std::lround(box.at.y); r < std::lround(box.at.y + box.height); ++r)
      for (auto c = std::lround(box.at.x); c < std::lround(box.at.x + box.width); ++c)
        if (pixels_.contains(r, c)) pixels_(r, c) = box.fill;
  }
  void paint(const DrawnLine& line) {
    double way = 0.0;
    for (std::size_t i = 1; i < line.points.size(); ++i) {
      const Point a = line.points[i - 1], b = line.points[i];
      const double length = std::hypot(b.x - a.x, b.y - a.y);
      if (line.dash <= 0.0 || length == 0.0) {
        stroke(a, b, line.width, line.colour);
        continue;
      }
      // Dashes go on round the corners.
      for (double s = 0.0; s < length;) {
        const double phase = std::fmod(way + s, 2.0 * line.dash);
        const double end = std::fmin(
            length, s + std::fmax((phase < line.dash ? line.dash : 2.0 * line.dash) - phase, 1e-6));
        const auto at = [&](double t) {
          return Point{a.x + t / length * (b.x - a.x), a.y + t / length * (b.y - a.y)};
        };
        if (phase < line.dash) stroke(at(s), at(end), line.width, line.colour);
        s = end;
      }
      way += length;
    }
  }
  void paint(const DrawnText& text) {
    const double scale = kCapitalShare * text.size / kCapitalHeight;
    const double width = text_width(text.text, text.size);
    double x = text.anchor == DrawnText::Anchor::start    ? 0.0
               : text.anchor == DrawnText::Anchor::middle ? -0.5 * width
                                                          : -width;
    const auto at = [&](std::array<double, 2> p) {
      const double along = x + scale * p[0], up = scale * p[1];
      return text.upwards ? Point{text.at.x - up, text.at.y - along}
                          : Point{text.at.x + along, text.at.y - up};
    };
    for (const StrokeLetter& letter : stroke_letters(text.text)) {
      for (const auto& stroked : letter.strokes)
        for (std::size_t i = 1; i < stroked.size(); ++i)
          stroke(at(stroked[i - 1]), at(stroked[i]), std::fmax(1.2, 0.1 * text.size), text.colour);
      x += scale * letter.advance;
    }
  }
  [[nodiscard]] Grid<Colour> take() { return std::move(pixels_); }

 private:
  /// With round ends; a pixel is covered by how far its centre is inside.
  void stroke(Point a, Point b, double width, Colour colour) {
    const double reach = 0.5 * width + 0.5;
    const double dx = b.x - a.x, dy = b.y - a.y, dd = dx * dx + dy * dy;
    const auto low = [](double v) { return static_cast<std::ptrdiff_t>(std::floor(v)); };
    const std::ptrdiff_t r1 = std::min(pixels_.rows() - 1, low(std::fmax(a.y, b.y) + reach));
    const std::ptrdiff_t c1 = std::min(pixels_.cols() - 1, low(std::fmax(a.x, b.x) + reach));
    for (auto r = std::max<std::ptrdiff_t>(0, low(std::fmin(a.y, b.y) - reach)); r <= r1; ++r)
      for (auto c = std::max<std::ptrdiff_t>(0, low(std::fmin(a.x, b.x) - reach)); c <= c1; ++c) {
        const double x = static_cast<double>(c) + 0.5 - a.x, y = static_cast<double>(r) + 0.5 - a.y;
        const double t = dd > 0.0 ? std::clamp((x * dx + y * dy) / dd, 0.0, 1.0) : 0.0;
        const double cover =
            std::clamp(reach - std::hypot(x - t * dx, y - t * dy), 0.0, std::fmin(1.0, width));
        for (std::size_t k = 0; k < 3; ++k)
          pixels_(r, c)[k] = static_cast<std::uint8_t>(
              std::lround((1.0 - cover) * pixels_(r, c)[k] + cover * colour[k]));
      }
  }

  Grid<Colour> pixels_;
};

struct SvgWriter {
  std::string out;

  void operator()(const DrawnImage& image) {
    out += fmt::format(
        "<image x=\"{:.6g}\" y=\"{:.6g}\" width=\"{}\" height=\"{}\" "
        "style=\"image-rendering:pixelated\" href=\"data:image/png;base64,{}\"/>\n",
        image.at.x, image.at.y, image.pixels.cols(), image.pixels.rows(),
        base64(camera::encode_png(image.pixels)));
  }
  void operator()(const DrawnBox& box) {
    out += fmt::format(
        "<rect x=\"{:.6g}\" y=\"{:.6g}\" width=\"{:.6g}\" height=\"{:.6g}\" fill=\"{}\"/>\n",
        box.at.x, box.at.y, box.width, box.height, hex(box.fill));
  }
  void operator()(const DrawnLine& line) {
    out += fmt::format("<path fill=\"none\" stroke=\"{}\" stroke-width=\"{:.3g}\"",
                       hex(line.colour), line.width);
    if (line.dash > 0.0) out += fmt::format(" stroke-dasharray=\"{:.3g}\"", line.dash);
    out += " d=\"";
    char command = 'M';
    for (const Point& p : line.points) {
      out += fmt::format("{}{:.2f} {:.2f}", command, p.x, p.y);
      command = 'L';
    }
    out += "\"/>\n";
  }
  void operator()(const DrawnText& text) {
    const char* anchor = text.anchor == DrawnText::Anchor::start    ? "start"
                         : text.anchor == DrawnText::Anchor::middle ? "middle"
                                                                    : "end";
    out += fmt::format(
        "<text x=\"{0:.6g}\" y=\"{1:.6g}\" font-size=\"{2:.3g}\" text-anchor=\"{3}\" "
        "fill=\"{4}\"",
        text.at.x, text.at.y, text.size, anchor, hex(text.colour));
    if (text.upwards)
      out += fmt::format(" transform=\"rotate(-90 {:.6g} {:.6g})\"", text.at.x, text.at.y);
    out += fmt::format(">{}</text>\n", markup_escaped(text.text));
  }
};

}  // namespace

double text_width(const std::string& text, double size) {
  double width = 0.0;
  for (const StrokeLetter& letter : stroke_letters(text)) width += letter.advance;
  return kCapitalShare * size / kCapitalHeight * width;
}

std::string to_svg(const Drawing& drawing, const std::string& title) {
  SvgWriter svg;
  svg.out = fmt::format(
      "<svg xmlns=\"http://www.w3.org/2000/svg\" viewBox=\"0 0 {0:.6g} {1:.6g}\" "
      "font-family=\"sans-serif\">\n<title>{2}</title>\n"
      "<rect width=\"{0:.6g}\" height=\"{1:.6g}\" fill=\"#ffffff\"/>\n",
      drawing.width, drawing.height, markup_escaped(title));
  for (const auto& part : drawing.parts) std::visit(svg, part);
  svg.out += "</svg>\n";
  return std::move(svg.out);
}

Grid<Colour> to_pixels(const Drawing& drawing) {
  Painter painter(drawing.width, drawing.height);
  for (const auto& part : drawing.parts) std::visit([&](const auto& p) { painter.paint(p); }, part);
  return painter.take();
}

std::vector<double> nice_ticks(double low, double high, int most) {
  if (!(high > low) || most < 1) return {low};
  double step = std::pow(10.0, std::floor(std::log10((high - low) / most)));
  for (const double factor : {1.0, 2.0, 5.0, 10.0})
    if ((high - low) / (factor * step) <= most) {
      step *= factor;
      break;
    }
  std::vector<double> ticks;
  const double slack = 1e-6 * step;
  for (double k = std::ceil((low - slack) / step); k * step <= high + slack; k += 1.0)
    ticks.push_back(k == 0.0 ? 0.0 : k * step);
  return ticks;
}

std::vector<double> log_ticks(double low, double high, int most) {
  const auto made = [&](const std::vector<double>& factors) {
    std::vector<double> ticks;
    for (double e = std::floor(std::log10(low)); e <= std::ceil(std::log10(high)); e += 1.0)
      for (const double factor : factors) {
        const double v = factor * std::pow(10.0, e);
        if (v >= low * (1.0 - 1e-9) && v <= high * (1.0 + 1e-9)) ticks.push_back(v);
      }
    return ticks;
  };
  const std::vector<std::vector<double>> choices{
      {1.0, 2.0, 3.0, 4.0, 5.0, 6.0, 8.0}, {1.0, 2.0, 5.0}, {1.0, 3.0}, {1.0}};
  for (const auto& factors : choices) {
    auto ticks = made(factors);
    if (static_cast<int>(ticks.size()) <= most && !ticks.empty()) return ticks;
  }
  const auto decades = made({1.0});
  if (decades.empty()) return {low, high};  // no round number between
  std::vector<double> some;
  const std::size_t step =
      (decades.size() + static_cast<std::size_t>(most) - 1) / static_cast<std::size_t>(most);
  for (std::size_t i = 0; i < decades.size(); i += step) some.push_back(decades[i]);
  return some;
}

}  // namespace maquette::tools

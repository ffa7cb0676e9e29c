// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/exploded_view.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>

#include <fmt/format.h>

#include "core/check.hpp"
#include "core/tri_mesh.hpp"

namespace maquette::tools {
namespace {

using heightmap::ModelField;
using meshing::NodeWindow;

constexpr double kTurn = 30.0 * std::numbers::pi / 180.0;       ///< of the part about the vertical
constexpr double kElevation = 35.0 * std::numbers::pi / 180.0;  ///< of the eye above the horizon
constexpr int kFine = 2;                                        ///< fine pixels a pixel, each way
constexpr double kMargin_px = 24.0, kTitle_px = 40.0, kLine_px = 20.0;
constexpr double kTextSize = 15.0;

constexpr Colour kGround{206, 200, 188}, kOtherGround{188, 198, 206};
constexpr Colour kStone{176, 122, 74}, kMarkedStone{210, 40, 40};
constexpr Colour kDowel{48, 96, 192}, kMagnet{192, 48, 48}, kInk{34, 34, 34};

/// In millimetres: x to the right, y up, z towards the eye.
Vec3 turned(Vec3 p) {
  const double x = p.x * std::cos(kTurn) - p.y * std::sin(kTurn);
  const double y = p.x * std::sin(kTurn) + p.y * std::cos(kTurn);
  return {x, y * std::sin(kElevation) + p.z * std::cos(kElevation),
          p.z * std::sin(kElevation) - y * std::cos(kElevation)};
}

/// From the upper left of the picture, and from the front, so that both visible walls differ.
Vec3 light() {
  return normalized(Vec3{-0.55, 0.25, 0.8});
}

Colour shaded(Colour colour, double share) {
  for (auto& c : colour)
    c = static_cast<std::uint8_t>(std::lround(std::clamp(share, 0.0, 1.25) * 0.8 * c));
  return colour;
}

class Canvas {
 public:
  Canvas(std::ptrdiff_t rows, std::ptrdiff_t cols)
      : colour_(rows * kFine, cols * kFine, Colour{255, 255, 255}),
        near_(rows * kFine, cols * kFine, -std::numeric_limits<float>::infinity()) {}

  /// Corners in fine pixels (x right, y down), z towards the eye.
  void triangle(Vec3 a, Vec3 b, Vec3 c, Colour colour) {
    const double area = (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
    if (area == 0.0 || !std::isfinite(area)) return;
    const auto low = [](double v) { return static_cast<std::ptrdiff_t>(std::floor(v)); };
    const auto r0 = std::max<std::ptrdiff_t>(0, low(std::min({a.y, b.y, c.y}) - 0.5));
    const auto r1 = std::min(colour_.rows() - 1, low(std::max({a.y, b.y, c.y}) + 0.5));
    const auto c0 = std::max<std::ptrdiff_t>(0, low(std::min({a.x, b.x, c.x}) - 0.5));
    const auto c1 = std::min(colour_.cols() - 1, low(std::max({a.x, b.x, c.x}) + 0.5));
    constexpr double kSeam = -1e-9;  // neighbours may both draw their edge, nobody may leave it out
    for (auto r = r0; r <= r1; ++r)
      for (auto k = c0; k <= c1; ++k) {
        const double x = static_cast<double>(k) + 0.5, y = static_cast<double>(r) + 0.5;
        const double u = ((b.x - x) * (c.y - y) - (b.y - y) * (c.x - x)) / area;
        const double v = ((c.x - x) * (a.y - y) - (c.y - y) * (a.x - x)) / area;
        const double w = 1.0 - u - v;
        if (u < kSeam || v < kSeam || w < kSeam) continue;
        const auto z = static_cast<float>(u * a.z + v * b.z + w * c.z);
        if (z <= near_(r, k)) continue;
        near_(r, k) = z;
        colour_(r, k) = colour;
      }
  }

  [[nodiscard]] Grid<Colour> averaged() const {
    Grid<Colour> out(colour_.rows() / kFine, colour_.cols() / kFine);
    for (std::ptrdiff_t r = 0; r < out.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < out.cols(); ++c)
        for (std::size_t k = 0; k < 3; ++k) {
          int sum = 0;
          for (int i = 0; i < kFine; ++i)
            for (int j = 0; j < kFine; ++j) sum += colour_(r * kFine + i, c * kFine + j)[k];
          out(r, c)[k] = static_cast<std::uint8_t>((sum + kFine * kFine / 2) / (kFine * kFine));
        }
    return out;
  }

 private:
  Grid<Colour> colour_;
  Grid<float> near_;
};

/// first, first + step, ..., last
std::vector<std::ptrdiff_t> lines_of(std::ptrdiff_t first, std::ptrdiff_t last,
                                     std::ptrdiff_t step) {
  std::vector<std::ptrdiff_t> lines;
  for (std::ptrdiff_t i = first; i < last; i += step) lines.push_back(i);
  lines.push_back(last);
  return lines;
}

class Exploded {
 public:
  Exploded(const ModelField& design, const ExplodedView& view, int width_px)
      : design_(design), view_(view) {
    MAQUETTE_CHECK(!view.parts.empty(), "no parts");
    double wide = 0.0, deep = 0.0;
    for (const ExplodedPart& p : view.parts) {
      wide += extent_x(p.nodes), deep += extent_y(p.nodes);
      columns_ = std::max(columns_, p.column + 1);
    }
    const auto parts = static_cast<double>(view.parts.size());
    gap_mm_ = 0.22 * (columns_ > 1 ? std::fmin(wide, deep) : deep) / parts;
    range_ = heightmap::height_range(design.z_mm);
    Box3 box;
    for (const ExplodedPart& p : view.parts)
      for (const double x : {design.x_mm(p.nodes.col0), design.x_mm(p.nodes.col1)})
        for (const double y : {design.y_mm(p.nodes.row0), design.y_mm(p.nodes.row1)})
          for (const double z : {view.base_z.value(), static_cast<double>(range_.max)})
            box.add(turned(Vec3{x, y, z} + moved(p)));
    left_px_ = kMargin_px + (columns_ > 1 ? 0.0 : label_room());
    scale_ = (width_px - left_px_ - kMargin_px) / (box.max.x - box.min.x);
    // A long row of bands is limited by the height of the picture instead.
    scale_ = std::fmin(scale_, 1.1 * width_px / (box.max.y - box.min.y));
    corner_ = {box.min.x, box.max.y, 0.0};
    width_px_ = left_px_ + kMargin_px + scale_ * (box.max.x - box.min.x);
    height_px_ = kTitle_px + scale_ * (box.max.y - box.min.y);
    text_from_px_ = height_px_ + 52.0;
    steepen();
  }

  Drawing drawn() {
    const auto rows = static_cast<std::ptrdiff_t>(std::ceil(height_px_)) + 1;
    Canvas canvas(rows, static_cast<std::ptrdiff_t>(std::ceil(width_px_)));
    for (std::size_t i = 0; i < view_.parts.size(); ++i)
      paint(canvas, view_.parts[i],
            (view_.parts[i].row + view_.parts[i].column) % 2 == 0 ? kGround : kOtherGround);
    for (const auto& stone : view_.stones) paint(canvas, stone);
    Drawing drawing;
    drawing.width = std::ceil(width_px_);
    drawing.parts.emplace_back(DrawnImage{{0.0, 0.0}, canvas.averaged()});
    drawing.parts.emplace_back(DrawnText{{kMargin_px, 28.0}, view_.title, 20.0});
    holes(drawing);
    if (columns_ > 1)
      names_on_tiles(drawing);
    else
      names_beside_strips(drawing);
    double y = text_from_px_;
    for (const std::string& note : all_notes()) {
      drawing.parts.emplace_back(DrawnText{{kMargin_px, y}, note, kTextSize});
      drawing.width = std::fmax(drawing.width, 2 * kMargin_px + 1.1 * text_width(note, kTextSize));
      y += kLine_px;
    }
    drawing.width =
        std::ceil(std::fmax(drawing.width, 2 * kMargin_px + 1.1 * text_width(view_.title, 20.0)));
    drawing.height = std::ceil(y);
    return drawing;
  }

 private:
  [[nodiscard]] double extent_x(const NodeWindow& w) const {
    return design_.x_mm(w.col1) - design_.x_mm(w.col0);
  }
  [[nodiscard]] double extent_y(const NodeWindow& w) const {
    return design_.y_mm(w.row1) - design_.y_mm(w.row0);
  }
  [[nodiscard]] Vec3 moved(const ExplodedPart& p) const {
    return {gap_mm_ * p.column, gap_mm_ * p.row, 0.0};
  }
  [[nodiscard]] std::string size_of(const ExplodedPart& p) const {
    return fmt::format("{:.6g} × {:.6g} mm", extent_x(p.nodes), extent_y(p.nodes));
  }
  [[nodiscard]] double label_room() const {
    double room = 0.0;
    for (const ExplodedPart& p : view_.parts)
      room = std::fmax(room, text_width(size_of(p), kTextSize));
    return 1.1 * room + 20.0;
  }
  /// Pixels of the drawing; z stays millimetres towards the eye.
  [[nodiscard]] Vec3 seen(Vec3 p) const {
    const Vec3 t = turned(p);
    return {left_px_ + scale_ * (t.x - corner_.x), kTitle_px + scale_ * (corner_.y - t.y), t.z};
  }
  [[nodiscard]] Point point(Vec3 p) const {
    const Vec3 s = seen(p);
    return {s.x, s.y};
  }
  [[nodiscard]] Vec3 node(std::ptrdiff_t r, std::ptrdiff_t c) const {
    return {design_.x_mm(c), design_.y_mm(r), static_cast<double>(design_.z_mm(r, c))};
  }
  /// Nodes that are a fine pixel or less apart add nothing.
  [[nodiscard]] std::ptrdiff_t step() const {
    return std::max<std::ptrdiff_t>(
        1, static_cast<std::ptrdiff_t>(1.5 / (kFine * scale_ * design_.spacing.value())));
  }

  /// Gentle relief is shaded as if slopes were steeper, so that it can be seen.
  void steepen() {
    constexpr double kWellSeen = 0.3;  // root mean square of slopes
    const std::ptrdiff_t s = step();
    double sum = 0.0, n = 0.0;
    for (std::ptrdiff_t r = 0; r + s < design_.z_mm.rows(); r += s)
      for (std::ptrdiff_t c = 0; c + s < design_.z_mm.cols(); c += s) {
        const double d = design_.spacing.value() * static_cast<double>(s);
        const double here = design_.z_mm(r, c);
        const double x = (design_.z_mm(r, c + s) - here) / d;
        const double y = (design_.z_mm(r + s, c) - here) / d;
        if (!std::isfinite(x) || !std::isfinite(y)) continue;
        sum += x * x + y * y, n += 1.0;
      }
    const double rms = n > 0.0 ? std::sqrt(sum / n) : 0.0;
    steeper_ = rms > 0.0 ? std::clamp(std::round(kWellSeen / rms), 1.0, 12.0) : 1.0;
  }

  void triangle(Canvas& canvas, Vec3 a, Vec3 b, Vec3 c, Colour colour) const {
    const auto fine = [&](Vec3 p) {
      const Vec3 s = seen(p);
      return Vec3{kFine * s.x, kFine * s.y, s.z};
    };
    canvas.triangle(fine(a), fine(b), fine(c), colour);
  }
  void quad(Canvas& canvas, const std::array<Vec3, 4>& q, Colour colour) const {
    triangle(canvas, q[0], q[1], q[2], colour);
    triangle(canvas, q[0], q[2], q[3], colour);
  }

  void paint(Canvas& canvas, const ExplodedPart& part, Colour colour) const {
    const Vec3 by = moved(part), l = light();
    const NodeWindow& w = part.nodes;
    const auto rows = lines_of(w.row0, w.row1, step()), cols = lines_of(w.col0, w.col1, step());
    for (std::size_t i = 1; i < rows.size(); ++i)
      for (std::size_t j = 1; j < cols.size(); ++j) {
        const std::array<Vec3, 4> q{node(rows[i - 1], cols[j - 1]), node(rows[i - 1], cols[j]),
                                    node(rows[i], cols[j]), node(rows[i], cols[j - 1])};
        const Vec3 across = cross(q[2] - q[0], q[3] - q[1]);
        const Vec3 normal = normalized(Vec3{steeper_ * across.x, steeper_ * across.y, across.z});
        quad(canvas, {q[0] + by, q[1] + by, q[2] + by, q[3] + by},
             shaded(colour, 0.2 + 1.05 * std::fmax(0.0, dot(normal, l))));
      }
    const double base = view_.base_z.value();
    const auto wall = [&](Vec3 a, Vec3 b, double share) {
      const Vec3 a0{a.x, a.y, base}, b0{b.x, b.y, base};
      quad(canvas, {a0 + by, b0 + by, b + by, a + by}, shaded(colour, share));
    };
    for (std::size_t j = 1; j < cols.size(); ++j)
      wall(node(w.row0, cols[j - 1]), node(w.row0, cols[j]), 0.55);
    for (std::size_t i = 1; i < rows.size(); ++i)
      wall(node(rows[i], w.col0), node(rows[i - 1], w.col0), 0.8);
  }

  /// It moves with the part that its middle is on.
  void paint(Canvas& canvas, const meshing::PlacedStone& stone) const {
    const Vec3 at = stone.model_from_stone.translation_mm;
    const ExplodedPart* on = nullptr;
    for (const ExplodedPart& p : view_.parts)
      if (at.x >= design_.x_mm(p.nodes.col0) && at.x <= design_.x_mm(p.nodes.col1) &&
          at.y >= design_.y_mm(p.nodes.row0) && at.y <= design_.y_mm(p.nodes.row1)) {
        on = &p;
        break;
      }
    if (on == nullptr) return;
    const Vec3 by = moved(*on), l = light();
    const Colour colour = view_.marked.contains(stone.number) ? kMarkedStone : kStone;
    const TriMesh mesh = meshing::stone_mesh(stone);
    for (const auto& t : mesh.triangles) {
      const Vec3 a = mesh.vertices_mm[t[0]], b = mesh.vertices_mm[t[1]], c = mesh.vertices_mm[t[2]];
      const Vec3 across = cross(b - a, c - a);
      if (norm(across) == 0.0) continue;
      triangle(canvas, a + by, b + by, c + by,
               shaded(colour, 0.3 + 0.95 * std::fmax(0.0, dot(normalized(across), l))));
    }
  }

  void holes(Drawing& drawing) const {
    for (const HolesOfKind* kind : {&view_.holes.dowels, &view_.holes.magnets})
      for (const meshing::Dowel& d : kind->places) {
        DrawnLine line;
        line.colour = kind == &view_.holes.dowels ? kDowel : kMagnet;
        line.width = 2.0;
        for (const int number : d.tiles)
          for (const ExplodedPart& p : view_.parts)
            if (p.number == number) line.points.push_back(point(d.centre_mm + moved(p)));
        if (line.points.size() == 2) drawing.parts.emplace_back(std::move(line));
      }
  }

  void names_beside_strips(Drawing& drawing) {
    double rows_apart = std::numeric_limits<double>::infinity();
    const auto place = [&](const ExplodedPart& p) {
      // Beside the western wall of strips along x; below the southern one of those along y.
      return point(Vec3{design_.x_mm(p.nodes.col0),
                        0.5 * (design_.y_mm(p.nodes.row0) + design_.y_mm(p.nodes.row1)),
                        view_.base_z.value()} +
                   moved(p));
    };
    for (std::size_t i = 1; i < view_.parts.size(); ++i)
      rows_apart = std::fmin(rows_apart, place(view_.parts[i - 1]).y - place(view_.parts[i]).y);
    const bool two_lines = rows_apart > 2.4 * kTextSize;
    const double size = std::clamp(0.85 * rows_apart, 7.0, kTextSize);
    for (const ExplodedPart& p : view_.parts) {
      const Point at = place(p);
      const Point text{at.x - 14.0, at.y + 0.35 * size};
      const auto add = [&](const std::string& what, double down) {
        drawing.parts.emplace_back(
            DrawnText{{text.x, text.y + down}, what, size, DrawnText::Anchor::end});
      };
      if (two_lines) {
        add(p.name, -0.1 * size);
        add(size_of(p), 1.2 * size);
      } else {
        add(fmt::format("{}: {:.6g} mm", p.name, extent_y(p.nodes)), 0.0);
      }
    }
    // The length of all, under the first.
    const ExplodedPart& first = view_.parts.front();
    const double y = design_.y_mm(first.nodes.row0), z = view_.base_z.value();
    Point a = point(Vec3{design_.x_mm(first.nodes.col0), y, z} + moved(first));
    Point b = point(Vec3{design_.x_mm(first.nodes.col1), y, z} + moved(first));
    a.y += 16.0, b.y += 16.0;
    drawing.parts.emplace_back(DrawnLine{{a, b}, kInk, 1.2});
    for (const Point& end : {a, b})
      drawing.parts.emplace_back(
          DrawnLine{{{end.x, end.y - 8.0}, {end.x, end.y + 8.0}}, kInk, 1.2});
    drawing.parts.emplace_back(DrawnText{{0.5 * (a.x + b.x) + 10.0, 0.5 * (a.y + b.y) + 24.0},
                                         fmt::format("{:.6g} mm", extent_x(first.nodes)),
                                         kTextSize});
  }

  void names_on_tiles(Drawing& drawing) const {
    for (const ExplodedPart& p : view_.parts) {
      const NodeWindow& w = p.nodes;
      const double room = 0.8 * scale_ * std::fmin(extent_x(w), extent_y(w) / std::sin(kTurn));
      const std::string size = size_of(p);
      const bool both = text_width(size, kTextSize) * 1.1 < room;
      const double wide =
          1.1 * std::fmax(text_width(p.name, kTextSize), both ? text_width(size, kTextSize) : 0.0);
      const double high = both ? 2.5 * kTextSize : 1.4 * kTextSize;
      const Point at = free_place(p, wide + 10.0, high);
      drawing.parts.emplace_back(DrawnBox{
          {at.x - 0.5 * wide - 5.0, at.y - 0.5 * high}, wide + 10.0, high, Colour{255, 255, 255}});
      const double first = at.y - 0.5 * high + 1.05 * kTextSize;
      drawing.parts.emplace_back(
          DrawnText{{at.x, first}, p.name, kTextSize, DrawnText::Anchor::middle});
      if (both)
        drawing.parts.emplace_back(
            DrawnText{{at.x, first + 1.2 * kTextSize}, size, kTextSize, DrawnText::Anchor::middle});
    }
  }

  /// Where a name hides the fewest of its part's stones: the middle, or a place around it.
  [[nodiscard]] Point free_place(const ExplodedPart& p, double wide_px, double high_px) const {
    constexpr std::array<std::array<double, 2>, 9> kShares{{{0.5, 0.5},
                                                            {0.4, 0.4},
                                                            {0.6, 0.6},
                                                            {0.4, 0.6},
                                                            {0.6, 0.4},
                                                            {0.5, 0.3},
                                                            {0.5, 0.7},
                                                            {0.3, 0.5},
                                                            {0.7, 0.5}}};
    const NodeWindow& w = p.nodes;
    Point best;
    std::size_t fewest = SIZE_MAX;
    for (const auto& [east, north] : kShares) {
      const auto line = [](double share, std::ptrdiff_t from, std::ptrdiff_t to) {
        return from + std::lround(share * static_cast<double>(to - from));
      };
      const Point at =
          point(node(line(north, w.row0, w.row1), line(east, w.col0, w.col1)) + moved(p));
      std::size_t hidden = 0;
      for (const auto& s : view_.stones) {
        const Point stone = point(s.model_from_stone.translation_mm + moved(p));
        const double radius = 0.5 * scale_ * s.scale_mm;
        if (std::abs(stone.x - at.x) < 0.5 * wide_px + radius &&
            std::abs(stone.y - at.y) < 0.5 * high_px + radius)
          ++hidden;
      }
      if (hidden < fewest) fewest = hidden, best = at;
    }
    return best;
  }

  [[nodiscard]] std::vector<std::string> all_notes() const {
    std::vector<std::string> notes{fmt::format(
        "Moved apart by {:.3g} mm. x to the right, y to the back. {:.4g} to {:.4g} mm high.",
        gap_mm_, static_cast<double>(range_.min) - view_.base_z.value(),
        static_cast<double>(range_.max) - view_.base_z.value())};
    if (steeper_ > 1.0)
      notes.back() += fmt::format(" Shaded as if slopes were {:g} times as steep.", steeper_);
    if (!view_.holes.dowels.places.empty())
      notes.push_back(fmt::format("Blue: {} dowels of {:g} mm.", view_.holes.dowels.places.size(),
                                  view_.holes.dowels.options.diameter_mm));
    if (!view_.holes.magnets.places.empty())
      notes.push_back(fmt::format("Red: {} pairs of magnets of {:g} mm.",
                                  view_.holes.magnets.places.size(),
                                  view_.holes.magnets.options.diameter_mm));
    notes.insert(notes.end(), view_.notes.begin(), view_.notes.end());
    return notes;
  }

  const ModelField& design_;
  const ExplodedView& view_;
  heightmap::HeightRange range_{};
  int columns_ = 1;
  double gap_mm_ = 0.0, scale_ = 1.0, left_px_ = 0.0, steeper_ = 1.0;
  double width_px_ = 0.0, height_px_ = 0.0, text_from_px_ = 0.0;
  Vec3 corner_;
};

}  // namespace

Drawing exploded_drawing(const ModelField& design, const ExplodedView& view, int width_px) {
  return Exploded(design, view, width_px).drawn();
}

}  // namespace maquette::tools

// SPDX-License-Identifier: GPL-3.0-or-later

// Pictures of bands and tiles moved apart, looked at by a machine:
//
//   every part has its name and dimensions .. texts of the drawing
//   nothing is cut off ...................... boxes of all texts, ends of all lines, the image
//   texts do not overlap .................... strips few and many, tiles
//   parts are apart ......................... white between two strips, ground on both sides
//   stones are where their part is .......... their colour on the picture, marked ones red
//   relief is seen .......................... shades of a hilly part differ, those of a plane do
//   not

#include "tools/exploded_view.hpp"

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "meshing/bands.hpp"
#include "support/shapes.hpp"

namespace maquette::tools {
namespace {

using heightmap::ModelField;
using testing_support::random_terrain;

ExplodedView strips(const ModelField& field, int count) {
  ExplodedView view{.title = fmt::format("{} bands", count), .base_z = Millimetres{-12.0}};
  const auto bands = meshing::split_into_bands(field, {.count = count});
  for (const meshing::Band& b : *bands)
    view.parts.push_back({fmt::format("band {}", b.number), b.number,
                          meshing::band_window(field, b), 0, b.number - 1});
  return view;
}

ExplodedView tiles(const ModelField& field, int count) {
  ExplodedView view{.title = "tiles", .base_z = Millimetres{-12.0}};
  const auto last = field.z_mm.rows() - 1;
  for (int r = 0; r < count; ++r)
    for (int c = 0; c < count; ++c)
      view.parts.push_back(
          {std::to_string(r * count + c + 1),
           r * count + c + 1,
           {r * last / count, (r + 1) * last / count, c * last / count, (c + 1) * last / count},
           c,
           r});
  return view;
}

struct TextBox {
  std::string text;
  double left, right, top, bottom;
};

std::vector<TextBox> text_boxes(const Drawing& drawing) {
  std::vector<TextBox> boxes;
  for (const auto& part : drawing.parts)
    if (const auto* t = std::get_if<DrawnText>(&part)) {
      const double width = text_width(t->text, t->size);
      const double left = t->anchor == DrawnText::Anchor::start    ? t->at.x
                          : t->anchor == DrawnText::Anchor::middle ? t->at.x - 0.5 * width
                                                                   : t->at.x - width;
      boxes.push_back({t->text, left, left + width, t->at.y - 0.72 * t->size, t->at.y});
    }
  return boxes;
}

void expect_legible(const Drawing& drawing) {
  const auto boxes = text_boxes(drawing);
  for (std::size_t i = 0; i < boxes.size(); ++i) {
    const TextBox& a = boxes[i];
    EXPECT_GE(a.left, 0.0) << a.text;
    EXPECT_LE(a.right, drawing.width) << a.text;
    EXPECT_GE(a.top, 0.0) << a.text;
    EXPECT_LE(a.bottom, drawing.height) << a.text;
    for (std::size_t j = 0; j < i; ++j) {
      const TextBox& b = boxes[j];
      EXPECT_FALSE(a.left < b.right && b.left < a.right && a.top < b.bottom && b.top < a.bottom)
          << a.text << " over " << b.text;
    }
  }
  for (const auto& part : drawing.parts) {
    if (const auto* line = std::get_if<DrawnLine>(&part))
      for (const Point& p : line->points) {
        EXPECT_TRUE(p.x >= 0.0 && p.x <= drawing.width && p.y >= 0.0 && p.y <= drawing.height);
      }
    if (const auto* image = std::get_if<DrawnImage>(&part)) {
      EXPECT_LE(static_cast<double>(image->pixels.cols()), drawing.width);
      EXPECT_LE(static_cast<double>(image->pixels.rows()), drawing.height);
      // A white border: no part of the solid is cut off.
      const auto& px = image->pixels;
      const Colour white{255, 255, 255};
      for (std::ptrdiff_t r = 0; r < px.rows(); ++r) {
        EXPECT_EQ(px(r, 0), white);
        EXPECT_EQ(px(r, px.cols() - 1), white);
      }
      for (std::ptrdiff_t c = 0; c < px.cols(); ++c) EXPECT_EQ(px(0, c), white);
    }
  }
}

std::string all_text(const Drawing& drawing) {
  std::string all;
  for (const TextBox& b : text_boxes(drawing)) all += b.text + "\n";
  return all;
}

const Grid<Colour>& image_of(const Drawing& drawing) {
  return std::get<DrawnImage>(drawing.parts.front()).pixels;
}

std::size_t count(const Grid<Colour>& pixels, const std::function<bool(Colour)>& is) {
  return static_cast<std::size_t>(std::count_if(pixels.cells().begin(), pixels.cells().end(), is));
}

TEST(ExplodedView, NamesAndMeasuresStrips) {
  const ModelField field = random_terrain(3, 201, 201, 1.0, 0.1);
  for (const int n : {1, 2, 5, 12, 40}) {
    SCOPED_TRACE(n);
    const Drawing drawing = exploded_drawing(field, strips(field, n), 1200);
    expect_legible(drawing);
    const std::string text = all_text(drawing);
    for (int b = 1; b <= n; ++b) EXPECT_THAT(text, testing::HasSubstr(fmt::format("band {}", b)));
    if (n == 5) {
      EXPECT_THAT(text, testing::HasSubstr("200 × 40 mm"));
      EXPECT_THAT(text, testing::HasSubstr("Moved apart"));
    }
  }
}

TEST(ExplodedView, NamesAndMeasuresTiles) {
  const ModelField field = random_terrain(3, 201, 201, 1.0, 0.1);
  for (const int n : {2, 3, 6}) {
    SCOPED_TRACE(n);
    const Drawing drawing = exploded_drawing(field, tiles(field, n), 1200);
    expect_legible(drawing);
    if (n == 2) {
      EXPECT_THAT(all_text(drawing), testing::HasSubstr("100 × 100 mm"));
    }
  }
}

TEST(ExplodedView, MovesPartsApart) {
  const ModelField field = random_terrain(3, 201, 201, 1.0, 0.1);
  const Drawing drawing = exploded_drawing(field, strips(field, 2), 1000);
  const auto& px = image_of(drawing);
  const Colour white{255, 255, 255};
  // Up the middle: ground, the gap, ground.
  int changes = 0;
  bool before = true;
  for (std::ptrdiff_t r = 0; r < px.rows(); ++r) {
    const bool is_white = px(r, px.cols() / 2) == white;
    changes += is_white != before ? 1 : 0;
    before = is_white;
  }
  EXPECT_EQ(changes, 4);
}

TEST(ExplodedView, ShowsStonesAndMarksThem) {
  const ModelField field = random_terrain(3, 201, 201, 1.0, 0.1);
  ExplodedView view = strips(field, 2);
  const auto red = [](Colour c) { return c[0] > 60 && c[0] > 3 * c[1] && c[0] > 3 * c[2]; };
  EXPECT_EQ(count(image_of(exploded_drawing(field, view, 800)), red), 0U);
  std::vector<meshing::PlacedStone> stones(2);
  for (int i = 0; i < 2; ++i) {
    auto& s = stones[static_cast<std::size_t>(i)];
    s.number = i + 1;
    s.scale_mm = 20.0;
    s.model_from_stone.translation_mm = {100.0, 50.0 + 100.0 * i, 5.0};
  }
  view.stones = stones;
  const auto plain = image_of(exploded_drawing(field, view, 800));
  EXPECT_EQ(count(plain, red), 0U);
  view.marked = {2};
  const Drawing drawing = exploded_drawing(field, view, 800);
  const auto& px = image_of(drawing);
  EXPECT_GT(count(px, red), 100U);
  // The second stands on the second strip: in the upper half of the picture.
  for (std::ptrdiff_t r = px.rows() / 2; r < px.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < px.cols(); ++c) EXPECT_FALSE(red(px(r, c))) << r << " " << c;
}

TEST(ExplodedView, ShadesTheRelief) {
  const auto shades = [](const ModelField& field) {
    const Drawing drawing = exploded_drawing(field, strips(field, 1), 800);
    const auto& px = image_of(drawing);
    std::set<Colour> seen;
    const auto r = px.rows() / 2, c = px.cols() / 2;
    for (std::ptrdiff_t i = -40; i < 40; ++i)
      for (std::ptrdiff_t j = -40; j < 40; ++j) seen.insert(px(r + i, c + j));
    return seen.size();
  };
  ModelField plane = random_terrain(3, 201, 201, 1.0, 0.05);
  EXPECT_GT(shades(plane), 20U);
  std::fill(plane.z_mm.cells().begin(), plane.z_mm.cells().end(), 1.0F);
  EXPECT_EQ(shades(plane), 1U);
}

}  // namespace
}  // namespace maquette::tools

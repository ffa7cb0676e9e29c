// SPDX-License-Identifier: GPL-3.0-or-later

// export/placing_template.hpp:
//   sheets cover the part, one fewer not .. counted for many sizes
//   paper is at 1:1 ....................... poppler draws the sheets at 10 pixels a millimetre:
//                                           the bar is 1000 long; each stone's outline is dark
//                                           where the header says, and nothing is dark within it
//   labels cover no stone, no label ....... forty in a heap, boxes against boxes
//   neighbours show the same crosses ...... in the pixels of both
//   each sheet says which it is ........... pdftotext
//   DXF ................................... OGR: layers, outlines, texts, ends of headings
//   same bytes ............................ twice
//   each error code ....................... reached

#include "export/placing_template.hpp"

#include <cstdlib>
#include <map>
#include <numbers>
#include <sstream>

#include <gdal_priv.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <ogrsf_frmts.h>

#include "core/files.hpp"
#include "export/cad.hpp"
#include "support/matchers.hpp"

namespace maquette::exporting {
namespace {

using testing::HasSubstr;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

TemplateStone hexagon(int number, double x, double y, double radius) {
  TemplateStone s;
  s.number = number;
  s.part = "S00" + std::to_string(number);
  s.centre_mm = {x, y};
  s.radius_mm = radius;
  s.heading_deg = 25.0 * number;
  for (int k = 0; k < 6; ++k) {
    const double t = (s.heading_deg + 60.0 * k) * std::numbers::pi / 180;
    s.outline_mm.push_back({x + radius * std::cos(t), y + radius * std::sin(t)});
  }
  return s;
}

/// 300 x 400 mm from (5, -7): two sheets by two; stones on each, one in the overlap.
PlacingTemplate plan() {
  PlacingTemplate p;
  p.name = "crater";
  p.min_mm = {5.0, -7.0};
  p.max_mm = {305.0, 393.0};
  p.joints = {{5.0, 200.0, 305.0, 200.0}};
  p.stones = {hexagon(1, 60, 40, 9), hexagon(2, 250, 50, 6), hexagon(3, 183, 150, 4),
              hexagon(4, 40, 350, 12), hexagon(5, 270, 330, 8)};
  return p;
}

TEST(SheetsOf, AreAsFewAsCoverThePart) {
  const Sheet sheet = a4_sheet();
  for (const double size : {50.0, 186.0, 186.5, 357.0, 357.5, 2000.0}) {
    PlacingTemplate p;
    p.max_mm = {size, 100.0};
    const SheetGrid grid = sheets_of(p, sheet);
    const auto covered = [&](int n) { return (n - 1) * grid.step_x_mm + sheet.window_width_mm(); };
    EXPECT_GE(covered(grid.columns), size - 1e-6);
    if (grid.columns > 1) {
      EXPECT_LT(covered(grid.columns - 1), size);
    }
    EXPECT_EQ(grid.rows, 1);
  }
}

TEST(LabelPlaces, KeepOffStonesAndEachOther) {
  PlacingTemplate p;
  for (int i = 0; i < 40; ++i)
    p.stones.push_back(hexagon(i + 1, 13.0 * (i % 8) + (i / 8 % 2) * 4.0, 9.0 * (i / 8), 1.2));
  const auto places = label_places(p);
  ASSERT_EQ(places.size(), 40U);
  // A width that the common sans-serif fonts stay below.
  const auto wide = [&](std::size_t i) {
    return 0.6 * kLabelLetters_mm * static_cast<double>(label_of(p.stones[i]).size());
  };
  for (std::size_t i = 0; i < 40; ++i)
    for (std::size_t j = 0; j < 40; ++j) {
      const auto [x, y] = p.stones[j].centre_mm;
      const double px = std::clamp(x, places[i][0], places[i][0] + wide(i));
      const double py = std::clamp(y, places[i][1], places[i][1] + 0.7 * kLabelLetters_mm);
      EXPECT_GT(std::hypot(px - x, py - y), 1.2) << i << " over stone " << j;
      if (i == j) continue;
      const bool meet = places[i][0] < places[j][0] + wide(j) &&
                        places[j][0] < places[i][0] + wide(i) &&
                        std::abs(places[i][1] - places[j][1]) < 0.7 * kLabelLetters_mm;
      EXPECT_FALSE(meet) << i << " and " << j;
    }
}

/// One page in grey, at 10 pixels a millimetre.
struct Page {
  int width = 0, height = 0;
  std::string pixels;
  [[nodiscard]] int at(double x_mm, double y_up_mm) const {
    const int column = static_cast<int>(std::floor(10.0 * x_mm));
    const int row = height - 1 - static_cast<int>(std::floor(10.0 * y_up_mm));
    if (column < 0 || column >= width || row < 0 || row >= height) return -1;
    return static_cast<unsigned char>(pixels[static_cast<std::size_t>(row * width + column)]);
  }
  /// The darkest pixel within this distance, in both directions.
  [[nodiscard]] int darkest(double x, double y, double reach) const {
    int least = 255;
    for (double dx = -reach; dx <= reach + 1e-9; dx += 0.1)
      for (double dy = -reach; dy <= reach + 1e-9; dy += 0.1)
        least = std::min(least, at(x + dx, y + dy));
    return least;
  }
};

Page draw(const ScratchFolder& folder, int page) {
  const std::string stem = folder / "page";
  const std::string command = fmt::format("pdftoppm -gray -r 254 -f {} -l {} -singlefile '{}' '{}'",
                                          page, page, (folder / "a.pdf").string(), stem);
  EXPECT_EQ(std::system(command.c_str()), 0);
  std::istringstream in(read_file(stem + ".pgm").value());
  Page result;
  std::string magic;
  int most = 0;
  in >> magic >> result.width >> result.height >> most;
  in.get();
  result.pixels.resize(static_cast<std::size_t>(result.width * result.height));
  in.read(result.pixels.data(), static_cast<std::streamsize>(result.pixels.size()));
  EXPECT_TRUE(in.good() && magic == "P5" && most == 255);
  return result;
}

#define NEEDS_POPPLER()                                                  \
  if (std::system("command -v pdftoppm pdftotext >/dev/null 2>&1") != 0) \
  GTEST_SKIP() << "no poppler-utils"

TEST(WriteTemplatePdf, IsTrueToScaleOnPaper) {
  NEEDS_POPPLER();
  const ScratchFolder folder;
  const Sheet sheet = a4_sheet();
  ASSERT_THAT(write_template_pdf(plan(), sheet, folder / "a.pdf"), Succeeds());
  const SheetGrid grid = sheets_of(plan(), sheet);
  ASSERT_EQ(grid.columns, 2);
  ASSERT_EQ(grid.rows, 2);
  int seen = 0, crosses = 0;
  for (int row = 0; row < 2; ++row)
    for (int column = 0; column < 2; ++column) {
      const Page page = draw(folder, 2 + 2 * row + column);
      EXPECT_NEAR(page.width, 2100, 1);
      EXPECT_NEAR(page.height, 2970, 1);
      // The bar: dark from end to end, and white beyond.
      for (int mm = 0; mm <= 100; ++mm) EXPECT_LT(page.darkest(20.0 + mm, 6.0, 0.2), 100) << mm;
      for (const double beyond : {19.6, 120.4}) EXPECT_GT(page.darkest(beyond, 6.0, 0.2), 200);
      const double to_x = sheet.margin_mm - (5.0 + column * grid.step_x_mm);
      const double to_y = sheet.margin_mm - (-7.0 + row * grid.step_y_mm);
      for (const TemplateStone& s : plan().stones) {
        const double x = s.centre_mm[0] + to_x, y = s.centre_mm[1] + to_y;
        const double inside = s.radius_mm + 1.0;
        if (x - inside < 12 || x + inside > 198 || y - inside < 12 || y + inside > 285) continue;
        ++seen;
        for (std::size_t k = 0; k < 6; ++k) {
          const auto a = s.outline_mm[k], b = s.outline_mm[(k + 1) % 6];
          for (const double t : {0.0, 0.3, 0.5, 0.7}) {
            const double px = a[0] + t * (b[0] - a[0]) + to_x, py = a[1] + t * (b[1] - a[1]) + to_y;
            EXPECT_LT(page.darkest(px, py, 0.15), 120) << s.number;
            // Halfway to the centre only the heading's tick is drawn, towards the first corner.
            if (k > 0 && k < 5 && s.radius_mm > 5.0) {
              EXPECT_GT(page.darkest(0.5 * (px + x), 0.5 * (py + y), 0.2), 200) << s.number;
            }
          }
        }
        EXPECT_LT(page.darkest(0.5 * (s.outline_mm[0][0] + to_x + x),
                               0.5 * (s.outline_mm[0][1] + to_y + y), 0.15),
                  120)
            << "heading of " << s.number;
      }
      // The crosses between columns: at the same model points on the left and on the right sheet.
      for (const double share : {0.25, 0.75}) {
        const double mx = 5.0 + grid.step_x_mm + 0.5 * sheet.overlap_mm;
        const double my = -7.0 + row * grid.step_y_mm + share * sheet.window_height_mm();
        const double x = mx + to_x, y = my + to_y;
        if (page.darkest(x + 3.0, y, 0.15) < 150 && page.darkest(x, y - 3.0, 0.15) < 150) ++crosses;
      }
    }
  EXPECT_EQ(seen, 6) << "five stones, the one in the overlap twice";
  EXPECT_EQ(crosses, 8);
}

TEST(WriteTemplatePdf, SaysWhichSheetItIs) {
  NEEDS_POPPLER();
  const ScratchFolder folder;
  ASSERT_THAT(write_template_pdf(plan(), a4_sheet(), folder / "a.pdf"), Succeeds());
  ASSERT_EQ(std::system(("pdftotext -layout '" + (folder / "a.pdf").string() + "' '" +
                         (folder / "a.txt").string() + "'")
                            .c_str()),
            0);
  const std::string text = read_file(folder / "a.txt").value();
  for (const char* part : {"5 stones on 300 x 400 mm", "4 sheets", "sheet 1-1", "sheet 2-2",
                           "x 5 to 191", "100 mm", "4 S004"})
    EXPECT_THAT(text, HasSubstr(part));
  ASSERT_THAT(write_template_pdf(plan(), a4_sheet(), folder / "b.pdf"), Succeeds());
  EXPECT_EQ(read_file(folder / "a.pdf").value(), read_file(folder / "b.pdf").value());
}

TEST(WriteTemplatePdf, SaysWhyItCannot) {
  const ScratchFolder folder;
  const auto path = folder / "a.pdf";
  Sheet sheet = a4_sheet();
  sheet.overlap_mm = 100.0;
  EXPECT_THAT(write_template_pdf(plan(), sheet, path), FailsWith(kOptionOutOfRange));
  sheet = a4_sheet();
  sheet.margin_mm = 80.0;
  EXPECT_THAT(write_template_pdf(plan(), sheet, path), FailsWith(kOptionOutOfRange));
  PlacingTemplate huge = plan();
  huge.max_mm = {20000.0, 20000.0};
  const auto refused = write_template_pdf(huge, a4_sheet(), path);
  ASSERT_THAT(refused, FailsWith(kOptionOutOfRange));
  EXPECT_THAT(refused.error().message, HasSubstr("sheets"));
  EXPECT_THAT(write_template_pdf(plan(), a4_sheet(), folder / "no/a.pdf"),
              FailsWith(kFileNotWritable));
  EXPECT_THAT(write_template_dxf(plan(), folder / "no/a.dxf"), FailsWith(kFileNotWritable));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(WriteTemplateDxf, IsReadByOgr) {
  const ScratchFolder folder;
  ASSERT_THAT(write_template_dxf(plan(), folder / "a.dxf"), Succeeds());
  GDALAllRegister();
  const std::unique_ptr<GDALDataset> data(
      GDALDataset::Open((folder / "a.dxf").c_str(), GDAL_OF_VECTOR | GDAL_OF_VERBOSE_ERROR));
  ASSERT_NE(data, nullptr);
  std::map<std::string, std::vector<std::unique_ptr<OGRGeometry>>> layers;
  std::vector<std::string> texts;
  for (const auto& feature : *data->GetLayer(0)) {
    const std::string layer = feature->GetFieldAsString("Layer");
    layers[layer].emplace_back(feature->GetGeometryRef()->clone());
    if (layer == "NUMBER") texts.emplace_back(feature->GetFieldAsString("Text"));
  }
  const PlacingTemplate known = plan();
  EXPECT_EQ(layers["PART"].size(), 1U);
  EXPECT_EQ(layers["JOINT"].size(), 1U);
  EXPECT_EQ(texts, (std::vector<std::string>{"1 S001", "2 S002", "3 S003", "4 S004", "5 S005"}));
  ASSERT_EQ(layers["STONE"].size(), 5U);
  ASSERT_EQ(layers["HEADING"].size(), 5U);
  ASSERT_EQ(layers["CENTRE"].size(), 5U);
  for (std::size_t i = 0; i < 5; ++i) {
    const TemplateStone& s = known.stones[i];
    const auto& ring = *layers["STONE"][i]->toLineString();
    ASSERT_EQ(ring.getNumPoints(), 7);
    EXPECT_TRUE(ring.get_IsClosed() != 0);
    for (int k = 0; k < 6; ++k) {
      EXPECT_NEAR(ring.getX(k), s.outline_mm[static_cast<std::size_t>(k)][0], 1e-6);
      EXPECT_NEAR(ring.getY(k), s.outline_mm[static_cast<std::size_t>(k)][1], 1e-6);
    }
    const auto& tick = *layers["HEADING"][i]->toLineString();
    EXPECT_NEAR(tick.getX(0), s.centre_mm[0], 1e-6);
    EXPECT_NEAR(tick.getX(1), s.outline_mm[0][0], 1e-6);
    EXPECT_NEAR(tick.getY(1), s.outline_mm[0][1], 1e-6);
    EXPECT_NEAR(layers["CENTRE"][i]->toPoint()->getY(), s.centre_mm[1], 1e-6);
  }
}

}  // namespace
}  // namespace maquette::exporting

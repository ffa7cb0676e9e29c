// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in tools/document.hpp and tools/path_under.hpp:
//
//   both say the same ... each text of the blocks is in the page, escaped, and (pdftotext, where it
//   is
//                         installed) in the PDF; long tables go over pages with their head
//   tables .............. wherever they begin on a page, heading, lead, head and two rows are on
//                         one; wide ones become several, no letter under 7 points, none beyond the
//                         margin
//   same bytes .......... twice
//   path under .......... a program by hand: order, direction and feed; links above are no passes

#include "tools/document.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "camera/image_io.hpp"
#include "core/files.hpp"
#include "support/matchers.hpp"
#include "tools/curve_drawing.hpp"
#include "tools/path_under.hpp"

namespace maquette::tools {
namespace {

using testing::HasSubstr;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

TEST(Document, PageAndPdfSayTheSame) {
  const ScratchFolder scratch;
  Grid<camera::Rgb8> image(40, 60);
  ASSERT_TRUE(camera::write_png(image, scratch / "a.png"));
  Document doc;
  doc.emplace_back(Heading{2, "Deviation < & >"});
  doc.emplace_back(Paragraph{"Heights \u00b1 one standard deviation, mm\u00b3."});
  doc.emplace_back(Picture{scratch / "a.png", "left"});
  doc.emplace_back(Picture{scratch / "missing.png", "right"});
  doc.emplace_back(SignedLegend{0.25, "mm"});
  Table table{{"number", "a long heading that needs its place", "text"}, {}};
  for (int i = 0; i < 120; ++i)
    table.rows.push_back({{fmt::format("row{}", i), true},
                          {"2.5", true},
                          {"words that are many enough to be broken into several lines of a cell "
                           "because the sheet is not wide enough for them",
                           false}});
  doc.emplace_back(table);
  doc.emplace_back(Histogram{{1, 5, 9, 5, 1}, 1.0, 0.0, 0.4, "mm"});
  doc.emplace_back(Curve{{0, 1, 2}, {0.1, NAN, 0.2}, {0.01, NAN, 0.02}, "way, mm", "height, mm"});
  doc.emplace_back(Interactive{"<b>only here</b>"});
  const std::string html = to_html(doc);
  for (const char* text : {"Deviation &lt; &amp; &gt;", "\u00b1 one", "row119", "<b>only here</b>",
                           "missing.png is missing", "data:image/png;base64,"})
    EXPECT_THAT(html, HasSubstr(text));

  ASSERT_THAT(write_pdf(doc, "Scan against design", scratch / "a.pdf"), Succeeds());
  ASSERT_THAT(write_pdf(doc, "Scan against design", scratch / "b.pdf"), Succeeds());
  const auto bytes = read_file(scratch / "a.pdf");
  ASSERT_THAT(bytes, Succeeds());
  EXPECT_EQ(*bytes, *read_file(scratch / "b.pdf"));
  EXPECT_EQ(bytes->substr(0, 5), "%PDF-");
  EXPECT_THAT(*bytes, HasSubstr("/FontFile")) << "letters are inside";
  if (std::system("command -v pdftotext >/dev/null 2>&1") != 0) GTEST_SKIP() << "no pdftotext";
  const std::string folder = scratch.path().string();
  ASSERT_EQ(
      std::system(("pdftotext -layout '" + folder + "/a.pdf' '" + folder + "/a.txt'").c_str()), 0);
  const std::string text = *read_file(scratch / "a.txt");
  for (const char* part : {"Scan against design", "Deviation < & >", "\u00b1 one", "row0", "row119",
                           "missing.png is missing", "+0.25 mm", "checked by"})
    EXPECT_THAT(text, HasSubstr(part));
  EXPECT_THAT(text, testing::Not(HasSubstr("only here")));
  std::size_t heads = 0;
  for (std::size_t at = 0; (at = text.find("a long heading", at)) != std::string::npos; ++at)
    ++heads;
  EXPECT_GE(heads, 2U) << "one on each page";
}

/// The pages' text, or their words with boxes.
std::string pages_of(const Document& doc, const std::string& option) {
  const ScratchFolder scratch;
  const std::string folder = scratch.path().string();
  EXPECT_THAT(write_pdf(doc, "Title", scratch / "a.pdf"), Succeeds());
  EXPECT_EQ(std::system(
                ("pdftotext " + option + " '" + folder + "/a.pdf' '" + folder + "/a.txt'").c_str()),
            0);
  return *read_file(scratch / "a.txt");
}

// Two pieces beside a gap; zero and all that the curve may be are on the drawing.
TEST(Curve, IsLaidOutWithItsGaps) {
  const CurveLayout l = layout_of(
      {{0, 10, 20, 30, 40}, {1, 2, NAN, 3, 3}, {0.5, 0.5, NAN, 1, 0}, "way, mm", "height, mm"});
  ASSERT_EQ(l.lines.size(), 2U);
  EXPECT_EQ(l.lines[0].size(), 2U);
  EXPECT_EQ(l.lines[1].size(), 2U);
  // From 0 to 4, a twentieth of that more to either side.
  const auto share = [](double y) { return (y + 0.2) / 4.4; };
  EXPECT_NEAR(l.lines[0][1][0], 0.25, 1e-12);
  EXPECT_NEAR(l.lines[0][1][1], share(2.0), 1e-12);
  ASSERT_EQ(l.shades[1].size(), 4U);
  EXPECT_NEAR(l.shades[1][0][1], share(4.0), 1e-12);
  EXPECT_NEAR(l.shades[1][3][1], share(2.0), 1e-12);
  ASSERT_GE(l.y_ticks.size(), 3U);
  for (const auto& t : l.y_ticks) EXPECT_NEAR(t.at, share(t.value), 1e-12);
  EXPECT_TRUE(layout_of({{0, 1}, {NAN, NAN}, {NAN, NAN}, "", ""}).lines.empty());
}

TEST(Document, AHeadIsWithItsRows) {
  if (std::system("command -v pdftotext >/dev/null 2>&1") != 0) GTEST_SKIP() << "no pdftotext";
  for (std::size_t lines = 40; lines < 64; ++lines) {
    Document doc;
    for (std::size_t i = 0; i < lines; ++i) doc.emplace_back(Paragraph{"filler"});
    doc.emplace_back(Heading{2, "heading"});
    doc.emplace_back(Paragraph{"leading"});
    doc.emplace_back(Table{{"topmost"}, {{{"rowA", false}}, {{"rowB", false}}, {{"rowC", false}}}});
    const std::string text = pages_of(doc, "-layout");
    const auto page = [&](const char* word) {
      const std::size_t at = text.find(word);
      EXPECT_NE(at, std::string::npos) << word;
      return std::count(text.begin(), text.begin() + static_cast<std::ptrdiff_t>(at), '\f');
    };
    for (const char* word : {"leading", "topmost", "rowA", "rowB"})
      ASSERT_EQ(page(word), page("heading")) << word << " after " << lines << " paragraphs";
  }
}

TEST(Document, WideTablesAreBrokenNotShrunk) {
  if (std::system("command -v pdftotext >/dev/null 2>&1") != 0) GTEST_SKIP() << "no pdftotext";
  Table table;
  table.rows.resize(3);
  for (int k = 0; k < 30; ++k) {
    table.head.push_back(fmt::format("head{}", k));
    for (int r = 0; r < 3; ++r)
      table.rows[static_cast<std::size_t>(r)].push_back(
          {k == 0 ? fmt::format("key{}", r) : fmt::format("{}.{:06}", r, k), k > 0});
  }
  table.rows[1][1].text = std::string(150, 'w');  // no blank to break at
  const std::string words = pages_of({table}, "-bbox");
  double smallest = 100.0, right = 0.0;
  std::size_t keys = 0, count = 0;
  for (std::size_t at = 0; (at = words.find("<word ", at)) != std::string::npos; ++at) {
    double x0 = 0, y0 = 0, x1 = 0, y1 = 0;
    ASSERT_EQ(
        std::sscanf(words.c_str() + at, "<word xMin=\"%lf\" yMin=\"%lf\" xMax=\"%lf\" yMax=\"%lf\"",
                    &x0, &y0, &x1, &y1),
        4);
    smallest = std::fmin(smallest, y1 - y0);
    right = std::fmax(right, x1);
    keys += words.compare(words.find('>', at) + 1, 4, "key2") == 0 ? 1U : 0U;
    ++count;
  }
  EXPECT_GT(count, 120U);
  EXPECT_GT(keys, 1U) << "each part begins with the first column";
  EXPECT_GE(smallest, 7.0) << "points";
  EXPECT_LE(right, 595.28 - 47.0) << "within the margin";
  for (int k = 1; k < 30; ++k) EXPECT_THAT(words, HasSubstr(fmt::format("2.{:06}", k)));
}

TEST(PathUnder, SaysWhichPassMadeAPlace) {
  const ScratchFolder scratch;
  heightmap::ModelField flat{Grid<float>(41, 41, 0.0F), Millimetres{0.5}};
  // Two passes there and back at y 5 and y 5.5; a link at z 20 over y 12; then over the first
  // again.
  ASSERT_TRUE(write_file(scratch / "a.ngc",
                         "G21 G90 G17\nF1000\nG0 X0 Y5 Z20\nG1 Z0\nX20\nY5.5 F500\nX0 F1000\n"
                         "G1 Z20\nY12 F3000\nX20\nG0 X0 Y8\nG1 Z0 F1000\nX10 F200\nM2\n"));
  const std::array<std::filesystem::path, 1> programs{scratch / "a.ngc"};
  const std::vector<Vec3> points{{10, 5, 0}, {10, 5.5, 0}, {10, 12, 0}, {5, 8, 0}, {-9, 0, 0}};
  const auto under = path_under(programs, flat, 3.0, points, {});
  ASSERT_THAT(under, Succeeds());
  // The plunge of 20 mm, then 10 mm of the pass.
  EXPECT_NEAR(under->order_m[0], 0.030F, 3e-4F);
  EXPECT_NEAR(under->direction_deg[0], 0.0F, 1e-4F);
  EXPECT_EQ(under->feed_mm_min[0], 1000.0F);
  EXPECT_NEAR(under->order_m[1], 0.0505F, 3e-4F);
  EXPECT_NEAR(std::abs(under->direction_deg[1]), 180.0F, 1e-4F);
  EXPECT_TRUE(std::isnan(under->order_m[2])) << "a link";
  EXPECT_EQ(under->feed_mm_min[3], 200.0F);
  EXPECT_TRUE(std::isnan(under->order_m[4])) << "beside the part";
}

}  // namespace
}  // namespace maquette::tools

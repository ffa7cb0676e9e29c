// SPDX-License-Identifier: GPL-3.0-or-later

// Pictures of programs, and the page in three dimensions, looked at by a machine:
//
//   ticks .................................. closed forms, linear and logarithmic
//   letters ................................ each that pictures use is known, none is '?'
//   nothing overlaps, nothing is cut off ... boxes of all texts, for wide, square, tall, tiny and
//                                            empty programs, each colour
//   the SVG ................................ read by pugixml: image and lines there, bounded
//   the pixels ............................. ink where a text is, the colours of the image kept
//   two programs of one name ............... two pictures
//   the page ............................... one file, no address in it; in a browser without a
//                                            window (chromium, where it is there): no message on
//                                            the console, the path where it belongs on the canvas,
//                                            and each control changes what is drawn

#include <cstdlib>
#include <sstream>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>
#include <pugixml.hpp>

#include "core/files.hpp"
#include "support/browser.hpp"
#include "support/matchers.hpp"
#include "support/terrain.hpp"
#include "tools/path_view.hpp"
#include "tools/program_pictures.hpp"

namespace maquette::tools {
namespace {

namespace fs = std::filesystem;
using cnc::BackplotColour;
using nlohmann::json;
using testing::ElementsAre;
using testing::HasSubstr;
using testing::Not;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

struct Drawn {
  std::string program;
  BackplotColour colour;
  Drawing drawing;
};

struct Drawings {
  std::vector<Drawn> all;
  std::string scene;
};

Drawings draw(const std::vector<std::string>& texts, ProgramPicturesOptions options) {
  const ScratchFolder folder;
  std::vector<fs::path> files;
  for (const std::string& text : texts) {
    files.push_back(folder / fmt::format("{}/part.ngc", files.size()));
    fs::create_directories(files.back().parent_path());
    EXPECT_THAT(write_file(files.back(), text + "M2\n"), Succeeds());
  }
  Drawings result;
  auto pictures = ProgramPictures::plan(
      files, options,
      [&](const std::string& program, BackplotColour colour, const Drawing& drawing) {
        result.all.push_back({program, colour, drawing});
        return Result<void>{};
      });
  EXPECT_THAT(pictures, Succeeds());
  for (std::size_t i = 0; i < files.size(); ++i) {
    const auto read = cnc::read_gcode(files[i], [&](std::span<const cnc::Motion> motions) {
      for (const cnc::Motion& m : motions)
        pictures->add(m, i, 0.01 * std::abs(m.to_mm.x) * length_mm(m));
      return Result<void>{};
    });
    EXPECT_THAT(read, Succeeds());
  }
  EXPECT_THAT(pictures->finish(), Succeeds());
  result.scene = pictures->scene_json();
  return result;
}

/// Zig-zag with a feed that changes, a rapid at its end.
std::string passes(double x0, double x1, double y0, double y1, int count) {
  std::string text = fmt::format("G21 G90 G17\nG0 X{} Y{} Z20\nG1 Z1 F300\n", x0, y0);
  for (int i = 0; i < count; ++i)
    text += fmt::format("Y{:.4f} F{}\nX{} Z{}\n", y0 + (y1 - y0) * i / std::max(1, count - 1),
                        1000 + 10 * i, i % 2 == 0 ? x1 : x0, 1 + i % 3);
  return text + fmt::format("G0 Z20\nX{} Y{}\n", x0, y0);
}

ProgramPicturesOptions all_colours() {
  ProgramPicturesOptions o;
  o.colours = {BackplotColour::feed, BackplotColour::engagement, BackplotColour::height};
  o.engagement = true;
  return o;
}

TEST(Ticks, AreRoundNumbers) {
  EXPECT_THAT(nice_ticks(0.0, 10.0, 5), ElementsAre(0, 2, 4, 6, 8, 10));
  EXPECT_THAT(nice_ticks(-0.3, 0.3, 4), ElementsAre(-0.2, 0.0, 0.2));
  EXPECT_THAT(nice_ticks(1234.0, 1236.0, 2), ElementsAre(1234, 1235, 1236));
  EXPECT_THAT(nice_ticks(3.0, 3.0, 5), ElementsAre(3.0));
  EXPECT_THAT(log_ticks(0.09, 120.0, 5), ElementsAre(testing::DoubleEq(0.1), 1, 10, 100));
  EXPECT_THAT(log_ticks(0.9, 5.5, 7), ElementsAre(1, 2, 3, 4, 5));
  EXPECT_THAT(log_ticks(1e-4, 1e4, 4), testing::SizeIs(testing::Le(5U)));
  EXPECT_THAT(log_ticks(2.1, 2.6, 3), testing::SizeIs(2)) << "no round number between: the ends";
}

struct Bounds {
  double x0, y0, x1, y1;
};
Bounds bounds_of(const DrawnText& t) {
  const double width = text_width(t.text, t.size);
  const double back = t.anchor == DrawnText::Anchor::start    ? 0.0
                      : t.anchor == DrawnText::Anchor::middle ? 0.5 * width
                                                              : width;
  if (t.upwards) return {t.at.x - 0.72 * t.size, t.at.y + back - width, t.at.x, t.at.y + back};
  return {t.at.x - back, t.at.y - 0.72 * t.size, t.at.x - back + width, t.at.y};
}

TEST(ProgramPictures, NothingOverlapsAndNothingIsCutOff) {
  const std::vector<std::string> programs = {
      passes(0, 2000, 0, 500, 20),          // a band
      passes(0, 200, 0, 200, 100),          // a block
      passes(-30, -10, 1000, 1900, 5),      // tall, far from the origin
      passes(0, 0.5, 0, 0.2, 3),            // tiny
      "G21 G90\nG0 X1 Y1 Z1\nG1 X9 F100\n"  // one line, one feed
      "G0 Z5\n",
      "G21 G90\nG0 X1 Y1 Z1\nG0 X3\n",  // nothing cut
  };
  const auto design = testing_support::flat_field(401, 401, 0.5, 3.0F);
  for (const bool outline : {false, true})
    for (const std::string& program : programs) {
      ProgramPicturesOptions o = all_colours();
      if (outline) o.design = &design;
      const Drawings drawings = draw({program}, o);
      ASSERT_EQ(drawings.all.size(), 3U);
      for (const Drawn& d : drawings.all) {
        SCOPED_TRACE(fmt::format("{} {}", name(d.colour), program.substr(0, 60)));
        EXPECT_LT(d.drawing.width, 1600.0);
        std::vector<std::pair<Bounds, std::string>> placed;
        for (const auto& part : d.drawing.parts) {
          if (const auto* line = std::get_if<DrawnLine>(&part)) {
            for (const Point& p : line->points) {
              EXPECT_TRUE(p.x >= 0 && p.y >= 0 && p.x <= d.drawing.width &&
                          p.y <= d.drawing.height);
            }
          }
          const auto* text = std::get_if<DrawnText>(&part);
          if (text == nullptr) continue;
          EXPECT_EQ(text->text.find('?'), std::string::npos);
          EXPECT_EQ(text->text.find("nan"), std::string::npos) << text->text;
          EXPECT_EQ(text->text.find("inf"), std::string::npos) << text->text;
          EXPECT_GE(text->size, 12.0) << "readable";
          const Bounds b = bounds_of(*text);
          // A tenth more: fonts of browsers are not ours.
          EXPECT_GE(b.x0, 2.0) << text->text;
          EXPECT_LE(b.x1 + 0.1 * (b.x1 - b.x0), d.drawing.width) << text->text;
          EXPECT_LE(b.y1, d.drawing.height) << text->text;
          EXPECT_GE(b.y0, 2.0) << text->text;
          for (const auto& [other, words] : placed)
            EXPECT_FALSE(b.x0 < other.x1 && other.x0 < b.x1 && b.y0 < other.y1 && other.y0 < b.y1)
                << text->text << " over " << words;
          placed.emplace_back(b, text->text);
        }
        EXPECT_GE(placed.size(), 8U);
      }
    }
}

TEST(ProgramPictures, TheSvgHoldsAnImageAndFewLines) {
  const Drawings drawings = draw({passes(0, 200, 0, 200, 400)}, all_colours());
  for (const Drawn& d : drawings.all) {
    const std::string svg = to_svg(d.drawing, "a < b & c");
    pugi::xml_document document;
    ASSERT_TRUE(document.load_string(svg.c_str()));
    const auto root = document.child("svg");
    EXPECT_STREQ(root.child("title").text().get(), "a < b & c");
    EXPECT_THAT(root.child("image").attribute("href").value(),
                testing::StartsWith("data:image/png;base64,iVBORw0KGgo"));
    EXPECT_LT(std::distance(root.children("path").begin(), root.children("path").end()), 600);
    EXPECT_LT(svg.size(), 800000U);
  }
}

TEST(ProgramPictures, PixelsAreTheDrawing) {
  const Drawings drawings = draw({passes(0, 200, 0, 100, 200)}, all_colours());
  const Drawing& drawing = drawings.all[0].drawing;
  const auto pixels = to_pixels(drawing);
  EXPECT_EQ(pixels.cols(), static_cast<std::ptrdiff_t>(std::ceil(drawing.width)));
  const auto dark = [&](const Bounds& b) {
    int n = 0;
    for (auto r = std::lround(b.y0); r < std::lround(b.y1); ++r)
      for (auto c = std::lround(b.x0); c < std::lround(b.x1); ++c) n += pixels(r, c)[0] < 160;
    return n;
  };
  for (const auto& part : drawing.parts) {
    const auto* text = std::get_if<DrawnText>(&part);
    if (text == nullptr) continue;
    EXPECT_GT(dark(bounds_of(*text)), 4 * static_cast<int>(text->text.size())) << text->text;
  }
  const auto& image = std::get<DrawnImage>(drawing.parts[0]);
  const auto r = image.pixels.rows() / 2, c = image.pixels.cols() / 2;
  EXPECT_EQ(pixels(std::lround(image.at.y) + r, std::lround(image.at.x) + c), image.pixels(r, c));
}

TEST(ProgramPictures, ProgramsOfOneNameStayApart) {
  const Drawings two = draw({passes(0, 20, 0, 20, 4), passes(0, 20, 20, 40, 4)}, all_colours());
  ASSERT_EQ(two.all.size(), 6U);
  EXPECT_EQ(two.all[0].program, "part");
  EXPECT_EQ(two.all[3].program, "part_2");
  ProgramPicturesOptions o = all_colours();
  o.together = true;
  EXPECT_EQ(draw({passes(0, 20, 0, 20, 4), passes(0, 20, 20, 40, 4)}, o).all.size(), 3U);
}

TEST(ProgramPictures, ASinkThatFailsIsHeard) {
  const ScratchFolder folder;
  const fs::path file = folder / "a.ngc";
  ASSERT_THAT(write_file(file, passes(0, 9, 0, 9, 3) + "M2\n"), Succeeds());
  auto pictures =
      ProgramPictures::plan(std::span(&file, 1), all_colours(),
                            [](const std::string&, BackplotColour, const Drawing&) -> Result<void> {
                              return fail(kDiskFull, "no");
                            });
  ASSERT_THAT(pictures, Succeeds());
  pictures->add({}, 0);
  EXPECT_FALSE(pictures->finish());
}

// ---- the page --------------------------------------------------------------

TEST(PathView, IsOneFileThatAsksNobody) {
  const auto design = testing_support::flat_field(41, 41, 0.5, 0.0F);
  ProgramPicturesOptions o = all_colours();
  o.design = &design;
  const Drawings drawings = draw({passes(0, 20, 0, 20, 10)}, o);
  const json scene = json::parse(drawings.scene);
  EXPECT_EQ(scene["programs"][0]["name"], "part");
  EXPECT_EQ(scene["ground"]["rows"], 41);
  const ScratchFolder folder;
  ASSERT_THAT(write_path_page("a </script> page", drawings.scene, folder / "p.html"), Succeeds());
  const std::string page = *read_file(folder / "p.html");
  for (const char* address : {"http:", "https:", "//cdn", "import(", "fetch(", "XMLHttp"})
    EXPECT_THAT(page, Not(HasSubstr(address)));
}

// What a page draws is told by a script that is added to it.
TEST(PathView, DrawsInABrowser) {
  if (!testing_support::browser()) GTEST_SKIP() << "no chromium here: the page is not looked at";
  // From above 100 mm of x fill the canvas; two passes at the southern and the northern edge.
  const std::string cuts =
      "G21 G90\nG0 X0 Y0 Z0\nG1 X100 F1000\nG0 Z30\nX0 Y40 Z30\nZ0\nG1 X100 F3000\nG0 Z30\n";
  ProgramPicturesOptions o = all_colours();
  const Drawings drawings = draw({cuts, "G21 G90\nG0 X0 Y20 Z0\nG1 X100 F500\n"}, o);
  const ScratchFolder folder;
  ASSERT_THAT(write_path_page("test", drawings.scene, folder / "p.html"), Succeeds());
  std::string page = *read_file(folder / "p.html");
  page += R"js(<script>
addEventListener('load', () => {
  const v = maquetteViews[0], gl = v.gl, out = {};
  const look = () => {
    v.draw();
    const w = gl.drawingBufferWidth, h = gl.drawingBufferHeight, p = new Uint8Array(4 * w * h);
    gl.readPixels(0, 0, w, h, gl.RGBA, gl.UNSIGNED_BYTE, p);
    const seen = {w, h, ink: 0, pink: 0, x0: w, x1: -1, y0: h, y1: -1, sum: 0};
    for (let y = 0; y < h; ++y)
      for (let x = 0; x < w; ++x) {
        const k = 4 * (y * w + x);
        if (Math.abs(p[k] - 245) + Math.abs(p[k + 1] - 246) + Math.abs(p[k + 2] - 247) < 60) continue;
        ++seen.ink;
        if (p[k] > 150 && p[k + 1] < 60 && p[k + 2] > 100) ++seen.pink;
        seen.x0 = Math.min(seen.x0, x); seen.x1 = Math.max(seen.x1, x);
        seen.y0 = Math.min(seen.y0, y); seen.y1 = Math.max(seen.y1, y);
        seen.sum = (seen.sum * 31 + p[k] * 7 + p[k + 1] * 3 + p[k + 2]) % 1000003;
      }
    return seen;
  };
  const root = document.querySelector('.pathview'), all = (q) => [...root.querySelectorAll(q)];
  const press = (text) => all('button').find((b) => b.textContent === text).click();
  const tick = (text) => all('label').find((l) => l.textContent.trim() === text)
    .querySelector('input').click();
  const choose = (n, value) => {
    const s = all('select')[n];
    s.value = value;
    s.dispatchEvent(new Event('change'));
  };
  out.oblique = look();
  press('from above');
  out.above = look();
  out.labels = root.querySelector('.scale').textContent;
  choose(0, 'feed');
  out.feed = look();
  out.feed_labels = root.querySelector('.scale').textContent;
  tick('rapids');
  out.rapids = look();
  tick('rapids');
  tick('part_2');
  out.without = look();
  tick('part');
  out.none = look();
  tick('part'); tick('part_2');
  const ticked = () => ['part', 'part_2'].map((text) => all('label')
    .find((l) => l.textContent.trim() === text).querySelector('input').checked);
  out.offered = [...all('select')[2].options].map((o) => o.textContent);
  choose(2, 'part_2');
  out.only = look();
  out.only_ticked = ticked();
  choose(2, '');
  out.again = look();
  out.again_ticked = ticked();
  const range = root.querySelector('input[type=range]');
  range.value = 300;
  range.dispatchEvent(new Event('input'));
  out.begun = look();
  range.value = 1000;
  range.dispatchEvent(new Event('input'));
  const c = v.canvas, box = c.getBoundingClientRect();
  c.dispatchEvent(new WheelEvent('wheel', {deltaY: 400, clientX: box.left + 0.5 * box.width,
    clientY: box.top + 0.5 * box.height, cancelable: true}));
  out.far = look();
  out.wide = document.documentElement.scrollWidth <= innerWidth;
  document.body.append(Object.assign(document.createElement('pre'),
    {id: 'told', textContent: JSON.stringify(out)}));
});
</script>)js";
  ASSERT_THAT(write_file(folder / "q.html", page), Succeeds());
  for (const char* size : {"1200,900", "500,800"}) {
    const json out = json::parse(testing_support::told_by(folder / "q.html", size, folder.path()));
    SCOPED_TRACE(out.dump());
    const auto number = [&](const char* picture, const char* key) {
      return out[picture][key].get<double>();
    };
    const double w = number("above", "w"), h = number("above", "h");
    // 100 x 40 mm, 94 % of the width or of the height, in the middle; a line is 1.3 px wide.
    const double unit = std::min(0.94 * w / 100.0, 0.94 * h / 40.0);
    EXPECT_NEAR(number("above", "x0"), 0.5 * w - 50.0 * unit, 3.0);
    EXPECT_NEAR(number("above", "x1"), 0.5 * w + 50.0 * unit, 3.0);
    EXPECT_NEAR(number("above", "y0"), 0.5 * h - 20.0 * unit, 3.0);
    EXPECT_NEAR(number("above", "y1"), 0.5 * h + 20.0 * unit, 3.0);
    EXPECT_GE(number("above", "ink"), 3 * 99.0 * unit);
    EXPECT_GT(number("oblique", "ink"), 100.0);
    EXPECT_NE(number("oblique", "sum"), number("above", "sum"));
    EXPECT_NE(number("feed", "sum"), number("above", "sum")) << "another colour";
    EXPECT_EQ(number("feed", "ink"), number("above", "ink")) << "of the same lines";
    EXPECT_EQ(number("feed", "pink"), 0.0);
    EXPECT_GT(number("rapids", "pink"), 20.0);
    EXPECT_NEAR(number("without", "ink"), 2.0 / 3.0 * number("feed", "ink"), 10.0);
    EXPECT_EQ(number("none", "ink"), 0.0);
    EXPECT_EQ(out["offered"], json({"all", "part", "part_2"})) << "an operation each";
    EXPECT_NEAR(number("only", "ink"), 1.0 / 3.0 * number("feed", "ink"), 10.0);
    EXPECT_EQ(out["only_ticked"], json({false, true}));
    EXPECT_EQ(number("again", "sum"), number("feed", "sum"));
    EXPECT_EQ(out["again_ticked"], json({true, true}));
    EXPECT_LT(number("begun", "ink"), 0.9 * number("feed", "ink"));
    EXPECT_GT(number("begun", "ink"), 0.0);
    EXPECT_LT(number("far", "x1") - number("far", "x0"), 0.7 * 100.0 * unit);
    EXPECT_THAT(out["labels"], HasSubstr("engagement"));
    EXPECT_THAT(out["feed_labels"], testing::AllOf(HasSubstr("mm/min"), HasSubstr("1000")));
    EXPECT_TRUE(out["wide"]) << "nothing sticks out sideways";
  }
}

}  // namespace
}  // namespace maquette::tools

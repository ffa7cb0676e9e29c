// SPDX-License-Identifier: GPL-3.0-or-later

// meshing/engraving.hpp, and shaped_solid.hpp with engraved walls:
//   volume of one groove ................... capsule with ends of 16 sides, by hand
//   grooves lie where marks say, readable from outside ... points on the middle lines, on each of
//   the
//                                            four walls, have a floor behind them at the depth;
//                                            those a stroke away from all lines have none
//   all letters of the font, in several sizes ... CGAL: closed, manifold, outward, Euler 2, does
//   not
//                                            cut itself; the certificate says what CGAL finds
//   grooves stay under the relief .......... a trench behind the wall: CGAL
//   everything else stays .................. top and other walls to the bit
//   a scale bar is as long as it says ...... ends of its line; 1, 2 or 5 times a power of ten
//   hollow and engraved .................... the wall behind grooves is as thick as asked
//   with stones ............................ CGAL
//   MESHING_LABEL_LETTER, MESHING_LABEL_DOES_NOT_FIT ... each case; what is said to do does

#include "meshing/engraving.hpp"

#include <numbers>
#include <regex>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cnc/ball_offset.hpp"
#include "core/stroke_letters.hpp"
#include "meshing/mesh_checks.hpp"
#include "meshing/shaped_solid.hpp"
#include "support/matchers.hpp"
#include "support/mesh_properties.hpp"
#include "support/shapes.hpp"

namespace maquette::meshing {
namespace {

using heightmap::ModelField;
using testing::HasSubstr;
using testing_support::collected;
using testing_support::FailsWith;
using testing_support::random_terrain;
using testing_support::Succeeds;

constexpr std::array kSides{WallSide::south, WallSide::east, WallSide::north, WallSide::west};
constexpr double kBase = -12.0;

/// 120 x 80 mm at an odd place.
ModelField part() {
  ModelField f = random_terrain(7, 161, 241, 0.5, 0.25, 0.02);
  const double low = static_cast<double>(heightmap::height_range(f.z_mm).min);
  for (float& z : f.z_mm.cells()) z -= static_cast<float>(low);
  f.x0 = Millimetres{17.3};
  f.y0 = Millimetres{-41.7};
  return f;
}

ShapedSolid engraved(const ModelField& f, std::vector<EngravedWall> walls) {
  return ShapedSolid::create(f, {.base_z = Millimetres{kBase}},
                             {plain_underside(f, Millimetres{kBase}), std::move(walls)})
      .value();
}

void expect_sound(const ShapedSolid& solid, const std::string& what) {
  const auto found = check_mesh(collected(solid)).value();
  const auto said = solid.certify().value();
  EXPECT_TRUE(found.passed()) << what << to_json(found);
  EXPECT_TRUE(found.self_intersection_checked);
  EXPECT_EQ(found.euler_number, 2) << what;
  EXPECT_EQ(found.shells, 1U) << what;
  EXPECT_EQ(said.triangles, found.triangles);
  EXPECT_EQ(said.vertices, found.vertices);
  EXPECT_NEAR(said.volume_mm3, found.volume_mm3, 1e-9 * found.volume_mm3);
  EXPECT_NEAR(said.area_mm2, found.area_mm2, 1e-9 * found.area_mm2);
}

TEST(Engraving, OneGroove) {
  const ModelField f = part();
  const EngravingStyle style{.depth = Millimetres{0.75}, .stroke = Millimetres{1.0}};
  const WallMark mark{.name = "a line", .lines_mm = {{{0.0, 0.0}, {20.0, 0.0}}}, .width_mm = 20.0};
  const auto walls = engrave_wall(f, Millimetres{kBase}, {mark}, style).value();
  const double end = 0.5 * 16.0 * 0.25 * std::sin(2.0 * std::numbers::pi / 16.0);
  // Corners lie on a lattice of 1/1024 mm.
  EXPECT_NEAR(walls[0].floor_area_mm2, 20.0 * 1.0 + end, 0.005);
  EXPECT_NEAR(walls[0].volume_mm3, 0.75 * walls[0].floor_area_mm2, 1e-12);
  const auto solid = engraved(f, walls);
  expect_sound(solid, "a line");
  const auto plain = GridSolidStream::create(f, {.base_z = Millimetres{kBase}}).value();
  EXPECT_NEAR(solid.certify().value().volume_mm3,
              plain.certify(CoordinateRounding::none).value().volume_mm3 - walls[0].volume_mm3,
              1e-6);
}

/// What a wall has at a place, seen from outside.
class Seen {
 public:
  Seen(const ModelField& f, WallSide side, const TriMesh& mesh) : mesh_(mesh) {
    const double x1 = f.x_mm(f.z_mm.cols() - 1), y1 = f.y_mm(f.z_mm.rows() - 1);
    switch (side) {
      case WallSide::south:
        outward_ = {0, -1, 0};
        left_ = {f.x_mm(0), f.y_mm(0), 0};
        break;
      case WallSide::east:
        outward_ = {1, 0, 0};
        left_ = {x1, f.y_mm(0), 0};
        break;
      case WallSide::north:
        outward_ = {0, 1, 0};
        left_ = {x1, y1, 0};
        break;
      case WallSide::west:
        outward_ = {-1, 0, 0};
        left_ = {f.x_mm(0), y1, 0};
        break;
    }
    right_ = cross(-1.0 * outward_, Vec3{0, 0, 1});
  }
  /// Depth of the facet that faces outwards there; NaN where there is none or are several.
  [[nodiscard]] double depth(double right, double z) const {
    double found = NAN;
    int count = 0;
    for (const auto& t : mesh_.triangles) {
      std::array<std::array<double, 3>, 3> p{};
      for (std::size_t k = 0; k < 3; ++k) {
        const Vec3 v = mesh_.vertices_mm[t[k]] - left_;
        p[k] = {dot(v, right_), v.z, -dot(v, outward_)};
      }
      if (p[0][2] != p[1][2] || p[1][2] != p[2][2] || p[0][2] > 5.0) continue;
      bool inside = true;
      for (std::size_t k = 0; k < 3; ++k) {
        const auto &a = p[k], &b = p[(k + 1) % 3];
        inside = inside && (b[0] - a[0]) * (z - a[1]) - (right - a[0]) * (b[1] - a[1]) > 0.0;
      }
      if (!inside) continue;
      found = p[0][2];
      ++count;
    }
    return count == 1 ? found : NAN;
  }

 private:
  const TriMesh& mesh_;
  Vec3 outward_, left_, right_;
};

class EngravingSide : public testing::TestWithParam<WallSide> {};

TEST_P(EngravingSide, ReadsFromOutside) {
  const ModelField f = part();
  const EngravingStyle style{
      .side = GetParam(), .letter = Millimetres{6.0}, .depth = Millimetres{0.5}};
  const WallMark mark = text_mark("FLg7", style).value();
  const auto walls = engrave_wall(f, Millimetres{kBase}, {mark}, style).value();
  const auto solid = engraved(f, walls);
  expect_sound(solid, "FLg7");
  const TriMesh mesh = collected(solid);
  const Seen seen(f, GetParam(), mesh);
  // The label begins a letter's height and half a stroke from the left end.
  const double from = 6.0 + 0.375, up = walls[0].from_mm[1];
  std::uint64_t floors = 0, others = 0;
  const auto away = [&](double x, double y) {
    double least = INFINITY;
    for (const auto& line : mark.lines_mm)
      for (std::size_t i = 0; i + 1 < line.size(); ++i) {
        const double ex = line[i + 1][0] - line[i][0], ey = line[i + 1][1] - line[i][1];
        const double dx = x - line[i][0], dy = y - line[i][1];
        const double s = std::clamp((dx * ex + dy * ey) / (ex * ex + ey * ey), 0.0, 1.0);
        least = std::fmin(least, std::hypot(dx - s * ex, dy - s * ey));
      }
    return least;
  };
  for (std::uint64_t i = 0; i < 600; ++i) {
    const double x = (mark.width_mm + 2.0) * random_uniform(5, 2 * i) - 1.0;
    const double y = (mark.height_mm + 2.0) * random_uniform(5, 2 * i + 1) - 1.0;
    const double off = away(x, y);
    if (off < 0.375 * 0.97) {
      EXPECT_NEAR(seen.depth(from + x, up + y), 0.5, 1e-12) << x << ' ' << y;
      ++floors;
    } else if (off > 0.377) {
      EXPECT_NEAR(seen.depth(from + x, up + y), 0.0, 1e-12) << x << ' ' << y;
      ++others;
    }
  }
  EXPECT_GT(floors, 80U);
  EXPECT_GT(others, 200U);
}
INSTANTIATE_TEST_SUITE_P(Sides, EngravingSide, testing::ValuesIn(kSides));

TEST(Engraving, AllLettersInSeveralSizes) {
  ModelField f = random_terrain(9, 41, 1201, 0.5, 0.1);
  const std::string all =
      "ABCDEFGHIJKLMNOPQRSTUVWXYZ abcdefghijklmnopqrstuvwxyz 0123456789 .,:;-+/()%=_<>'? "
      "\u00b2\u00b3\u00d7";
  ASSERT_EQ(unknown_letters(all), "");
  for (float& z : f.z_mm.cells()) z += 10.0F;
  for (const auto& [letter, stroke] :
       {std::pair{5.0, 0.0}, std::pair{3.7, 0.31}, std::pair{6.0, 1.1}, std::pair{4.0, 0.1}}) {
    const EngravingStyle style{
        .letter = Millimetres{letter}, .depth = Millimetres{0.4}, .stroke = Millimetres{stroke}};
    const auto mark = text_mark(all, style);
    ASSERT_THAT(mark, Succeeds());
    const auto walls = engrave_wall(f, Millimetres{kBase}, {*mark}, style);
    ASSERT_THAT(walls, Succeeds()) << letter << ' ' << stroke;
    expect_sound(engraved(f, *walls), std::to_string(letter));
  }
}

TEST(Engraving, LeavesEverythingElse) {
  const ModelField f = part();
  const EngravingStyle style{.side = WallSide::north};
  const auto walls =
      engrave_wall(f, Millimetres{kBase}, {text_mark("North", style).value()}, style).value();
  const auto solid = engraved(f, walls);
  const TriMesh mesh = collected(solid);
  const TriMesh plain =
      collected(GridSolidStream::create(f, {.base_z = Millimetres{kBase}}).value());
  const auto corners = [](const TriMesh& m) {
    std::set<std::array<std::array<double, 3>, 3>> all;
    for (const auto& t : m.triangles) {
      std::array<std::array<double, 3>, 3> p{};
      for (std::size_t k = 0; k < 3; ++k)
        p[k] = {m.vertices_mm[t[k]].x, m.vertices_mm[t[k]].y, m.vertices_mm[t[k]].z};
      all.insert(p);
    }
    return all;
  };
  const auto before = corners(plain), after = corners(mesh);
  std::uint64_t missing = 0;
  for (const auto& t : before) missing += !after.contains(t);
  EXPECT_EQ(missing, 2 * walls[0].edges);
}

TEST(ScaleBar, IsAsLongAsItSays) {
  const EngravingStyle style;
  for (const auto& [scale, wall, length, name] :
       {std::tuple{1000.0, 200.0, 50.0, "50 m"}, std::tuple{1000.0, 2000.0, 500.0, "500 m"},
        std::tuple{200.0, 200.0, 50.0, "10 m"}, std::tuple{1e6, 125.0, 50.0, "50 km"},
        std::tuple{5000.0, 500.0, 200.0, "1 km"}, std::tuple{1.0, 700.0, 200.0, "20 cm"}}) {
    const WallMark bar = scale_bar_mark(scale, wall, style).value();
    EXPECT_THAT(bar.name, testing::EndsWith(std::string(" of ") + name));
    EXPECT_TRUE(bar.at_right);
    double longest = 0.0;
    for (const auto& line : bar.lines_mm)
      for (std::size_t i = 0; i + 1 < line.size(); ++i)
        longest = std::fmax(longest, std::abs(line[i + 1][0] - line[i][0]));
    EXPECT_NEAR(longest, length, 1e-9) << name;
    EXPECT_LE(longest, 0.4 * wall + 1e-9);
  }
}

TEST(Engraving, StaysUnderATrenchBehindTheWall) {
  ModelField f = part();
  for (std::ptrdiff_t c = 0; c < f.z_mm.cols(); ++c) f.z_mm(2, c) = -8.0F;  // 1 mm behind the wall
  const EngravingStyle style{.letter = Millimetres{1.5}, .depth = Millimetres{2.0}};
  const auto walls =
      engrave_wall(f, Millimetres{kBase}, {text_mark("Trench", style).value()}, style).value();
  for (const Vec3& v : walls[0].vertices_mm) EXPECT_LT(v.z, -8.4);
  expect_sound(engraved(f, walls), "trench");
}

TEST(Engraving, LabelAndScaleBarOnAHollowPart) {
  const ModelField f = part();
  const EngravingStyle style{.side = WallSide::east, .letter = Millimetres{4.0}};
  HollowOptions o{.wall = Millimetres{2.0}, .rib = Millimetres{2.0}, .pocket = Millimetres{25.0}};
  o.cut[1] = style.depth;
  const auto roof = cnc::offset_surface(f, Millimetres{-2.0}).value();
  Shaping shaping{
      hollow_underside(f, roof, Millimetres{kBase}, o).value(),
      engrave_wall(f, Millimetres{kBase},
                   {text_mark("B 2", style).value(),
                    scale_bar_mark(1000.0, wall_length_mm(f, style.side), style).value()},
                   style)
          .value()};
  const double x1 = f.x_mm(f.z_mm.cols() - 1);
  double floor = INFINITY, pocket = -INFINITY;
  for (const auto& w : shaping.walls)
    for (const Vec3& v : w.vertices_mm) floor = std::fmin(floor, v.x);
  for (std::size_t i = shaping.underside.rim_vertices;
       i < shaping.underside.mesh.vertices_mm.size(); ++i)
    pocket = std::fmax(pocket, shaping.underside.mesh.vertices_mm[i].x);
  EXPECT_NEAR(floor, x1 - 0.6, 1e-12);
  EXPECT_NEAR(floor - pocket, 2.0, 1e-12);
  expect_sound(ShapedSolid::create(f, {.base_z = Millimetres{kBase}}, shaping).value(), "hollow");
}

TEST(Engraving, WithStones) {
  const ModelField f = part();
  const std::vector<TriMesh> stones{
      testing_support::random_rock(5, {60.0, -10.0, heightmap::height_at(f, 60.0, -10.0)}, 3.0)};
  const TriMesh full = volume_solid(f, stones, {.base_z = Millimetres{kBase}}).value();
  for (const WallSide side : kSides) {
    const EngravingStyle style{.side = side};
    Shaping shaping{
        plain_underside(f, Millimetres{kBase}),
        engrave_wall(f, Millimetres{kBase}, {text_mark("Stone", style).value()}, style).value()};
    const auto c = check_mesh(shaped(full, f, shaping)).value();
    EXPECT_TRUE(c.passed()) << to_json(c);
    EXPECT_EQ(c.euler_number, 2);
    EXPECT_NEAR(c.volume_mm3, check_mesh(full).value().volume_mm3 - shaping.walls[0].volume_mm3,
                1e-6);
  }
}

TEST(Engraving, RefusesWhatDoesNotFit) {
  const ModelField f = part();
  const EngravingStyle style;
  const auto unknown = text_mark("Krater \u00c4! \u00c4", style);
  ASSERT_THAT(unknown, FailsWith(kLabelLetter));
  EXPECT_THAT(unknown.error().message, HasSubstr("cannot be engraved: \u00c4! ("));
  EXPECT_THAT(text_mark("a\xff", style), FailsWith(kLabelLetter));
  EXPECT_THAT(text_mark("", style), FailsWith(kLabelLetter));
  EXPECT_THAT(text_mark("   ", style), FailsWith(kLabelLetter));

  const auto engrave = [&](const std::string& text, const EngravingStyle& s) {
    return engrave_wall(f, Millimetres{kBase}, {text_mark(text, s).value()}, s);
  };
  const std::string text = "Somewhere on the far side of the moon, 1:1000";
  const auto long_one = engrave(text, style);
  ASSERT_THAT(long_one, FailsWith(kLabelDoesNotFit));
  EXPECT_THAT(long_one.error().message, HasSubstr("the southern wall 120 mm"));
  std::smatch match;
  ASSERT_TRUE(
      std::regex_search(long_one.error().message, match, std::regex("letters of ([0-9.]+) mm")));
  EngravingStyle smaller = style;
  smaller.letter = Millimetres{std::stod(match[1])};
  EXPECT_THAT(engrave(text, smaller), Succeeds());

  EngravingStyle tall = style;
  tall.letter = Millimetres{14.0};
  const auto high = engrave("I", tall);
  ASSERT_THAT(high, FailsWith(kLabelDoesNotFit));
  EXPECT_THAT(high.error().message, HasSubstr("mm high with its margins"));
  EngravingStyle deep = style;
  deep.depth = Millimetres{20.1};  // of 80 mm
  EXPECT_THAT(engrave("I", deep), FailsWith(kLabelDoesNotFit));

  const auto both = engrave_wall(f, Millimetres{kBase},
                                 {text_mark("Tycho and around, 2026", style).value(),
                                  scale_bar_mark(1000.0, 120.0, style).value()},
                                 style);
  ASSERT_THAT(both, FailsWith(kLabelDoesNotFit));
  EXPECT_THAT(both.error().message, HasSubstr("meet on the southern wall"));

  for (const double bad : {0.0, -1.0, double{NAN}, double{INFINITY}}) {
    EngravingStyle s;
    s.letter = Millimetres{bad};
    EXPECT_THAT(text_mark("I", s), FailsWith(kLabelDoesNotFit));
    s = {};
    s.depth = Millimetres{bad};
    EXPECT_THAT(text_mark("I", s), FailsWith(kLabelDoesNotFit));
    EXPECT_THAT(scale_bar_mark(bad, 100.0, {}), FailsWith(kLabelDoesNotFit));
    EXPECT_THAT(scale_bar_mark(1000.0, bad == INFINITY ? 0.0 : bad, {}),
                FailsWith(kLabelDoesNotFit));
  }
  EngravingStyle fat;
  fat.stroke = Millimetres{2.6};
  EXPECT_THAT(text_mark("I", fat), FailsWith(kLabelDoesNotFit));
}

}  // namespace
}  // namespace maquette::meshing

// SPDX-License-Identifier: GPL-3.0-or-later

// The library of causes: what each does to a place, in closed form.

#include <algorithm>
#include <cmath>
#include <set>
#include <vector>

#include <gtest/gtest.h>

#include "diagnosis/detail/drawn_behind.hpp"
#include "diagnosis/diagnose.hpp"
#include "diagnosis/effect.hpp"
#include "diagnosis/extended_model.hpp"
#include "diagnosis/surface.hpp"

namespace maquette::diagnosis {
namespace {

Scene scene() {
  Scene s;
  s.slack = [](double) { return [](const CutState&) { return Drift{{1, -1, 1}, {}}; }; };
  s.lag = [](double) { return [](const CutState&) { return Drift{{0, 0, -0.01}, {}}; }; };
  s.box.add({0, 0, 0});
  s.box.add({160, 160, 20});
  s.has_path = true;
  s.duration_min = 20.0;
  s.has_station = {true, true};
  s.stations = {{80, -900, 900}, {900, 80, 900}};
  s.waves_x = {20.0};
  s.waves_y = {20.0};
  return s;
}

Observation place() {
  Observation o;
  o.place = {120, 40, 10};
  o.normal = o.along = o.slope_normal = normalized(Vec3{-0.3, 0.2, 1.0});
  o.tip = {121, 41, 9};
  o.feed = normalized(Vec3{1, 0, 0.3});
  o.path_share = 0.6;
  o.cut_share = 0.55;
  o.path_mm = 25'000;
  o.has_station = true;
  o.beam = normalized(Vec3{40, 940, -890});
  o.range_mm = norm(Vec3{40, 940, -890});
  o.levelled.fill(0.02F);
  o.spot.fill(0.03F);
  return o;
}

double value(const std::string& effect, std::size_t form, const Observation& o) {
  const auto forms = find_effect(effect)->forms(scene());
  return forms.at(form).columns.at(0).value(o);
}

TEST(Library, NamesEveryScanSideCauseOfTheDesign) {
  for (const char* name : {"machine.scale_x",
                           "machine.scale_y",
                           "machine.scale_z",
                           "machine.squareness_xy",
                           "machine.squareness_xz",
                           "machine.squareness_yz",
                           "machine.straightness_x",
                           "machine.straightness_y",
                           "machine.backlash_x",
                           "machine.backlash_y",
                           "machine.backlash_z",
                           "machine.servo_lag",
                           "machine.thermal_growth_z",
                           "machine.step_loss_x",
                           "machine.step_loss_y",
                           "machine.step_loss_z",
                           "tool.radius_error",
                           "tool.length_offset",
                           "tool.wear",
                           "tool.runout",
                           "tool.deflection",
                           "process.band_step",
                           "process.chatter",
                           "stock.warp",
                           "stock.swelling",
                           "coating.thickness",
                           "coating.pooling",
                           "coating.shadow",
                           "scanner.range_bias",
                           "scanner.range_scale",
                           "scanner.incidence_bias",
                           "scanner.encoder_eccentricity",
                           "scanner.registration",
                           "scanner.spot_blur",
                           "photo.exposure",
                           "photo.white_balance",
                           "photo.black_level",
                           "photo.gamma",
                           "photo.vignetting",
                           "photo.focal_length",
                           "photo.radial_distortion",
                           "photo.chromatic_aberration",
                           "photo.defocus",
                           "photo.motion_blur",
                           "photo.veiling_glare",
                           "photo.pose",
                           "photo.noise",
                           "lamp.position",
                           "lamp.size",
                           "lamp.falloff",
                           "lamp.ambient",
                           "surface.albedo",
                           "surface.roughness",
                           "surface.opposition",
                           "surface.specular",
                           "surface.interreflection"})
    EXPECT_NE(find_effect(name), nullptr) << name;
}

TEST(Library, IsCompleteAndFinite) {
  std::set<std::string> names;
  for (const Effect& e : library()) {
    EXPECT_TRUE(names.insert(e.name).second) << e.name;
    for (const auto& text : {e.says, e.source, e.acts_on, e.depends_on, e.separate_by})
      EXPECT_FALSE(text.empty()) << e.name;
    if (!e.forms) continue;
    const auto forms = e.forms(scene());
    EXPECT_FALSE(forms.empty()) << e.name;
    for (const Form& f : forms) {
      EXPECT_FALSE(f.columns.empty()) << e.name;
      for (const Column& c : f.columns) {
        EXPECT_TRUE(std::isfinite(c.value(place()))) << e.name << " " << c.key;
        EXPECT_FALSE(c.parameter.name.empty()) << e.name;
      }
    }
  }
}

// Borders that the data show to a percent are refined in turn, each between its neighbours: steps
// of a fourth of a thousandth of the program.
TEST(Library, RefinesEachBorderOfBands) {
  Scene scene;
  scene.has_path = true;
  scene.duration_min = 10.0;
  scene.steps[2] = {0.75, 0.26, 0.24};
  std::vector<Form> forms = find_effect("process.band_step")->forms(scene);
  const auto seen = std::find_if(forms.begin(), forms.end(), [](const Form& f) {
    return f.law == "after 0.2400 and 0.2600 and 0.7500 of the program";
  });
  ASSERT_NE(seen, forms.end());
  const auto moments = [](const Form& f) {
    std::vector<double> m;
    for (const auto& [name, minutes] : f.fixed) m.push_back(0.1 * minutes);
    return m;
  };
  Form now = *seen;
  std::vector<double> last = moments(now);
  EXPECT_EQ(last, (std::vector{0.24, 0.26, 0.75}));
  int rounds = 0;
  double narrowest = 1.0;
  for (; now.finer; ++rounds) {
    const auto near = now.finer();
    ASSERT_GE(near.size(), 2U);
    const auto moves = static_cast<std::size_t>(rounds % 3);
    for (const Form& f : near) {
      const auto m = moments(f);
      EXPECT_TRUE(std::is_sorted(m.begin(), m.end()));
      for (std::size_t k = 0; k < 3; ++k)
        EXPECT_TRUE(k == moves || m[k] == last[k]) << "round " << rounds;
    }
    for (std::size_t k = 1; k < near.size(); ++k)
      narrowest = std::fmin(narrowest, moments(near[k])[moves] - moments(near[k - 1])[moves]);
    now = near.back();
    last = moments(now);
  }
  EXPECT_EQ(rounds, 4) << "each once, the first twice";
  EXPECT_NEAR(narrowest, 1.0 / 4096.0, 1e-12);
}

TEST(Library, MovesOneOfTwoMomentsUnlessItMeetsTheOther) {
  Scene scene;
  scene.has_path = true;
  scene.duration_min = 10.0;
  scene.steps[0] = {0.5, 0.2};
  const auto forms = find_effect("machine.step_loss_x")->forms(scene);
  const auto two =
      std::find_if(forms.begin(), forms.end(), [](const Form& f) { return f.columns.size() == 2; });
  ASSERT_NE(two, forms.end());
  const auto moved = two->move_moment(1, -0.1);
  ASSERT_TRUE(moved);
  EXPECT_EQ(moved->law, "after 0.2000 and 0.4000 of the program");
  EXPECT_FALSE(two->move_moment(1, -0.29)) << "a pass or two apart is one step to first order";
  EXPECT_FALSE(two->move_moment(1, 0.5)) << "after the program";
  EXPECT_FALSE(two->move_moment(0, -0.2)) << "before the program";
  EXPECT_TRUE(moved->move_moment(0, 0.1)) << "as often as it is asked";
  // More moments than two would follow any drift.
  scene.steps[0] = {0.5, 0.2, 0.7, 0.9};
  for (const Form& f : find_effect("machine.step_loss_x")->forms(scene))
    EXPECT_LE(f.columns.size(), 2U) << f.law;
}

TEST(Library, MovesMaterialAsItsPhysicsSays) {
  const Observation o = place();
  const Vec3 n = o.normal;
  EXPECT_NEAR(value("machine.scale_x", 0, o), n.x * (121.0 - 80.0) / 80.0, 1e-12);
  EXPECT_NEAR(value("machine.squareness_xz", 0, o), n.x * (9.0 - 10.0) / 80.0, 1e-12);
  EXPECT_NEAR(value("machine.backlash_x", 0, o), -n.x, 1e-6) << "moving up x, the table trails";
  // A cylinder of 3.02 mm in the place of one of 3 mm, lowest line held: across the feed it is a
  // circle whose lowest point is up.across / |across| away.
  const double c2 = 1.0 - o.feed.z * o.feed.z, side2 = 9.0 * (1.0 - n.z * n.z / c2);
  EXPECT_NEAR(value("tool.radius_error", 0, o),
              (0.02 - (std::sqrt(3.02 * 3.02 - side2) - std::sqrt(9.0 - side2)) / std::sqrt(c2)) /
                  0.02 * n.z,
              1e-9);
  EXPECT_NEAR(value("tool.radius_error", 0, o), n.z - 1.0, 1e-3) << "to first order";
  EXPECT_NEAR(value("coating.thickness", 0, o), 1.0, 1e-12);
  EXPECT_NEAR(value("scanner.range_bias", 0, o), dot(n, o.beam), 1e-12);
  EXPECT_LT(value("scanner.incidence_bias", 0, o), 0.0) << "too long a range is below the surface";
  EXPECT_NEAR(value("machine.thermal_growth_z", 4, o), -n.z * (1.0 - std::exp(-1.0)), 1e-12);
  EXPECT_NEAR(value("machine.step_loss_z", 8, o), n.z, 1e-12);
  EXPECT_NEAR(value("machine.step_loss_z", 9, o), 0.0, 1e-12)
      << "lost later than this place was cut";
  Observation flat = o;
  flat.normal = flat.along = flat.slope_normal = {0, 0, 1};
  EXPECT_EQ(value("tool.radius_error", 0, flat), 0.0) << "nothing on flats";
  EXPECT_EQ(value("machine.backlash_x", 0, flat), 0.0);
}

// A block that bends takes its ridges along, as one that is moved does.
TEST(Library, AWarpMovesRidgesWithThePart) {
  const Observation o = place();
  for (const Form& f : find_effect("stock.warp")->forms(scene()))
    for (const Column& c : f.columns) {
      ASSERT_TRUE(c.moves) << c.key;
      EXPECT_NEAR(c.value(o), dot(level_along(o), c.moves(o)), 1e-12) << c.key;
      EXPECT_NE(c.moves(o).z, 0.0) << c.key;
    }
}

// Bent about y to a radius of 20 m, a block keeps its length in one plane, and what lies h over it
// comes to (r - h) sin(x / r) along x and to r - (r - h) cos(x / r): what is left of the third
// order is below x^3 / r^2, a micrometre.
TEST(Library, ABlockThatBendsLeansOverThePlaneThatKeepsItsLength) {
  constexpr double kBend_mm = 20'000.0;
  const Scene s = scene();
  const double half = s.half_mm();
  int leaning = 0;
  for (const Form& f : find_effect("stock.warp")->forms(s)) {
    if (f.fixed.empty()) continue;
    ++leaning;
    ASSERT_EQ(f.fixed[0].first, "plane_depth_mm");
    ASSERT_EQ(f.columns.size(), 3U);
    for (const double x : {-70.0, -20.0, 45.0})
      for (const double z : {-4.0, 6.0}) {
        Observation o = place();
        o.place = s.centre() + Vec3{x, 13.0, z};
        const double h = z + f.fixed[0].second;
        const Vec3 moved = (half * half / (2.0 * kBend_mm)) * f.columns[0].moves(o);
        EXPECT_NEAR(moved.x, (kBend_mm - h) * std::sin(x / kBend_mm) - x, 1e-3) << f.law;
        EXPECT_NEAR(moved.y, 0.0, 1e-12) << f.law;
        EXPECT_NEAR(moved.z, kBend_mm - (kBend_mm - h) * std::cos(x / kBend_mm) - h, 1e-3) << f.law;
      }
  }
  EXPECT_EQ(leaning, 4);
}

// A cutter whose force grows going up and with the wall on its left: of a displacement
// k (1 + f_z / 2 + (f x n)_z / 3) n_h each part is one column; feeds and walls worked out by hand.
TEST(Library, ACutterBendsByRampAndSide) {
  const auto forms = find_effect("tool.deflection")->forms(scene());
  const auto form =
      std::find_if(forms.begin(), forms.end(), [](const Form& f) { return f.columns.size() == 3; });
  ASSERT_TRUE(form != forms.end());
  struct Row {
    Vec3 feed, wall, bend;  // per mm: even, up, left
  };
  for (const Row& row : {Row{{1, 0, 0}, {0, -0.6, 0.8}, {-0.6, 0.0, 0.36}},
                         Row{{-1, 0, 0}, {0, -0.6, 0.8}, {-0.6, 0.0, -0.36}},
                         Row{{0, 0.8, 0.6}, {0, -0.6, 0.8}, {-0.6, -0.36, 0.0}},
                         Row{{0, -0.8, -0.6}, {0, -0.6, 0.8}, {-0.6, 0.36, 0.0}}}) {
    Observation o = place();
    o.slope_normal = row.wall;
    CutState s = o;
    s.feed = row.feed;
    const auto bend = [&](std::size_t k) { return form->columns[k].cut(o, s, row.wall).tip_mm; };
    EXPECT_NEAR(bend(0).y, row.bend.x, 1e-12);
    EXPECT_NEAR(bend(1).y, row.bend.y, 1e-12);
    EXPECT_NEAR(bend(2).y, row.bend.z, 1e-12);
    EXPECT_EQ(bend(0).z, 0.0);
  }
}

// Drawn behind by b (1 + c f_z) of the feed in plan, up a ramp more than down: no lift, and on
// level ground what lost motion does.
TEST(Library, ACutterIsDrawnBehindTheFeed) {
  const auto forms = detail::drawn_behind(scene());
  ASSERT_FALSE(forms.empty());
  for (const Form& form : forms) {
    ASSERT_TRUE(detail::is_drawn_behind(form)) << form.law;
    for (const Vec3 feed : {Vec3{1, 0, 0}, Vec3{0, -0.8, 0.6}, Vec3{-0.8, 0, -0.6}}) {
      CutState s = place();
      s.feed = feed;
      const Vec3 even = form.columns[3].cut(place(), s, {}).tip_mm,
                 up = form.columns[4].cut(place(), s, {}).tip_mm;
      EXPECT_NEAR(norm(even + Vec3{feed.x, feed.y, 0.0}), 0.0, 1e-12);
      EXPECT_NEAR(norm(up - feed.z * even), 0.0, 1e-12);
    }
  }
  for (const Form& form : find_effect("tool.deflection")->forms(scene()))
    EXPECT_FALSE(detail::is_drawn_behind(form)) << form.law << " is not chosen by";
  // Of a file that has it, it is read back.
  const KnownCause known{"tool.deflection",
                         forms[1].law,
                         {{"sideways_mm", 0.1},
                          {"sideways_up_against_down_mm", 0.02},
                          {"sideways_left_against_right_mm", 0.0},
                          {"behind_mm", 0.08},
                          {"behind_up_against_down_mm", 0.0}},
                         {}};
  EXPECT_TRUE(restore({known}, scene(), {}).has_value());
}

// Wear by any power of the length between a half and two is reached to a percent or two: a worn
// ball whose loss went with 1.2 was even, beside a bend that was not there.
TEST(Library, WearGoesByAnyPowerOfTheLength) {
  const auto power = [](const Form& f) { return f.fixed.at(0).second; };
  for (const double wanted : {0.62, 0.87, 1.2, 1.65}) {
    auto forms = find_effect("tool.wear")->forms(scene());
    for (int depth = 0; depth < 4 && !forms.empty(); ++depth) {
      const auto best =
          *std::min_element(forms.begin(), forms.end(), [&](const Form& a, const Form& b) {
            return std::abs(power(a) - wanted) < std::abs(power(b) - wanted);
          });
      forms = best.finer ? best.finer() : std::vector<Form>();
      if (!forms.empty()) continue;
      // Half of a step of a sixteenth of an octave.
      EXPECT_NEAR(std::log2(power(best) / wanted), 0.0, 0.5 / 16.0 + 1e-9) << wanted;
      EXPECT_NEAR(best.columns[0].cut(place(), place(), {}).radius_mm,
                  -std::pow(place().cut_share, power(best)), 1e-12);
    }
  }
}

TEST(Library, CoatAndRadiusDifferByAShiftOnly) {
  // The look-alikes that need a pad without coat: their sum is n_z, a registration.
  const Observation o = place();
  EXPECT_NEAR(value("coating.thickness", 0, o) + value("tool.radius_error", 0, o), o.normal.z, 1e-3)
      << "to first order";
}

TEST(Library, BlursABowlByItsCurvature) {
  // z = q (x^2 + y^2) / 2: the mean over a spot or a film of width w is higher by q w^2, seen from
  // straight above; at 60 degrees along x the footprint is twice as long there: q w^2 (4 + 1) / 2.
  constexpr double kBowl = 0.01;  // 1/mm
  heightmap::ModelField bowl{Grid<float>(161, 161), Millimetres{0.5}, Millimetres{-40.0},
                             Millimetres{-40.0}};
  for (std::ptrdiff_t r = 0; r < 161; ++r)
    for (std::ptrdiff_t c = 0; c < 161; ++c)
      bowl.z_mm(r, c) = static_cast<float>(
          0.5 * kBowl * (bowl.x_mm(c) * bowl.x_mm(c) + bowl.y_mm(r) * bowl.y_mm(r)));
  const SimulatedSurface surface(bowl, nullptr, {});
  Observation o = place();
  o.place = {0, 0, 0};
  o.normal = o.along = {0, 0, 1};
  o.levelled = surface.levelled(0, 0, 0);
  for (const auto& [beam, stretch] :
       {std::pair{Vec3{0, 0, -1}, 1.0}, {Vec3{std::sqrt(0.75), 0, -0.5}, 2.5}}) {
    o.beam = beam;
    o.spot = surface.spots(-20'000.0 * beam).further(o.place);
    for (std::size_t k = 0; k < kSpotWidths_mm.size(); ++k)
      // At 60 degrees beams meet the bowl before or behind the plane: 100 q^3 w^4 more. A grid of
      // 0.25 mm, linear between its nodes, is higher by q 0.25^2 / 6 along each axis, and so are
      // rays between pixels; the Gaussian ends at 3.5 widths, which leaves 0.6 % of its variance
      // out.
      EXPECT_NEAR(
          value("scanner.spot_blur", 2 * k, o),
          kBowl * stretch * kSpotWidths_mm[k] * kSpotWidths_mm[k] +
              (stretch > 1.0 ? 100.0 : 0.0) * std::pow(kBowl, 3) * std::pow(kSpotWidths_mm[k], 4),
          6e-4 * stretch + 0.008 * kBowl * stretch * kSpotWidths_mm[k] * kSpotWidths_mm[k]);
  }
  for (std::size_t k = 0; k < kFilmLengths_mm.size(); ++k)
    // The Gaussian ends at 3.5 lengths, which leaves 0.6 % of its variance out.
    EXPECT_NEAR(value("coating.pooling", 2 * k, o), kBowl * kFilmLengths_mm[k] * kFilmLengths_mm[k],
                3e-4 + 0.006 * kBowl * kFilmLengths_mm[k] * kFilmLengths_mm[k]);
}

TEST(Library, BlursACreaseFromAnySide) {
  // z = s |x|: along a beam that is u to the side the surface is k u further, with a k of each
  // flank; the mean of both halves of a Gaussian is (k+ - k-) w / sqrt(2 pi).
  constexpr double kSlope = 0.3;
  heightmap::ModelField crease{Grid<float>(161, 161), Millimetres{0.5}, Millimetres{-40.0},
                               Millimetres{-40.0}};
  for (std::ptrdiff_t r = 0; r < 161; ++r)
    for (std::ptrdiff_t c = 0; c < 161; ++c)
      crease.z_mm(r, c) = static_cast<float>(kSlope * std::abs(crease.x_mm(c)));
  const SimulatedSurface surface(crease, nullptr, {});
  for (const double tilt : {0.0, 0.5, 0.9}) {
    const double sine = std::sin(tilt), cosine = std::cos(tilt);
    const auto k = [&](double m) { return (sine - m * cosine) / (cosine + m * sine); };
    const auto spot = surface.spots(20'000.0 * Vec3{-sine, 0.0, cosine}).further({0, 0, 0});
    for (std::size_t j = 0; j < kSpotWidths_mm.size(); ++j) {
      const double w = kSpotWidths_mm[j], mean = (k(kSlope) - k(-kSlope)) * w / std::sqrt(2 * M_PI);
      // A pixel of 0.25 mm rounds the crease by slope * 0.25 / 8.
      EXPECT_NEAR(static_cast<double>(spot[j]), mean, 0.012 + 0.002 * std::abs(mean))
          << w << " mm at " << tilt;
    }
  }
}

TEST(Library, ABallOutOfTrueCutsFlatBelowAndWiderBeside) {
  // A level pass along x: the swept body's section is flat for e to either side, then the circle.
  constexpr double kRadius = 3.0;
  const auto height = [](double u) { return kRadius - std::sqrt(kRadius * kRadius - u * u); };
  for (const double e : {0.02, 0.1, 0.3})
    for (const double u : {0.0, 0.05, 0.1, 0.25, 0.8, 1.7}) {
      CutState s;
      s.feed = {1, 0, 0};
      CutChange change;
      change.runout_mm = e;
      const Vec3 n{0.0, -u / kRadius, std::sqrt(1.0 - u * u / (kRadius * kRadius))};
      EXPECT_NEAR(rise_mm({s, n}, kRadius, change, {0.0, 0.0, 1.0}),
                  height(std::fmax(0.0, u - e)) - height(u), 1e-12)
          << "eccentric by " << e << ", " << u << " beside the pass";
    }
}

TEST(Library, MarksAreMovedByMachinesOnly) {
  Observation mark = place();
  mark.on_surface = false;
  mark.along = {1, 0, 0};
  EXPECT_EQ(value("coating.thickness", 0, mark), 0.0);
  EXPECT_EQ(value("tool.radius_error", 0, mark), 0.0);
  EXPECT_NEAR(value("machine.scale_x", 0, mark), 41.0 / 80.0, 1e-12);
}

}  // namespace
}  // namespace maquette::diagnosis

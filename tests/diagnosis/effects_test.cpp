// SPDX-License-Identifier: GPL-3.0-or-later

// The library of causes: what each does to a place, in closed form.

#include <cmath>
#include <set>

#include <gtest/gtest.h>

#include "diagnosis/effect.hpp"

namespace maquette::diagnosis {
namespace {

Scene scene() {
  Scene s;
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
  o.normal = o.along = normalized(Vec3{-0.3, 0.2, 1.0});
  o.tip = {121, 41, 9};
  o.feed = normalized(Vec3{1, 0, 0.3});
  o.path_share = 0.6;
  o.cut_share = 0.55;
  o.path_mm = 25'000;
  o.play.fill(Vec3{1, -1, 1});
  o.lag.fill(Vec3{0, 0, -0.01});
  o.has_station = true;
  o.beam = normalized(Vec3{40, 940, -890});
  o.range_mm = norm(Vec3{40, 940, -890});
  for (auto& c : o.curvature) c = {0.01F, 0.002F, -0.02F};
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
                           "scanner.spot_blur"})
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

TEST(Library, MovesMaterialAsItsPhysicsSays) {
  const Observation o = place();
  const Vec3 n = o.normal;
  EXPECT_NEAR(value("machine.scale_x", 0, o), n.x * (121.0 - 80.0) / 80.0, 1e-12);
  EXPECT_NEAR(value("machine.squareness_xz", 0, o), n.x * (9.0 - 10.0) / 80.0, 1e-12);
  EXPECT_NEAR(value("machine.backlash_x", 0, o), -n.x, 1e-6) << "moving up x, the table trails";
  // A ball of 3.02 mm in the place of one of 3 mm, its tip held, by its circle.
  const double rho2 = 9.0 * (1.0 - n.z * n.z);
  EXPECT_NEAR(value("tool.radius_error", 0, o),
              (3.02 - std::sqrt(3.02 * 3.02 - rho2) - 3.0 + std::sqrt(9.0 - rho2)) / 0.02 * n.z,
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
  flat.normal = flat.along = {0, 0, 1};
  EXPECT_EQ(value("tool.radius_error", 0, flat), 0.0) << "nothing on flats";
  EXPECT_EQ(value("machine.backlash_x", 0, flat), 0.0);
}

TEST(Library, CoatAndRadiusDifferByAShiftOnly) {
  // The look-alikes that need a pad without coat: their sum is n_z, a registration.
  const Observation o = place();
  EXPECT_NEAR(value("coating.thickness", 0, o) + value("tool.radius_error", 0, o), o.normal.z, 1e-3)
      << "to first order";
}

TEST(Library, BlursASphereByItsCurvature) {
  // Seen straight from above the footprint is round: half w^2 times the sum of curvatures.
  Observation o = place();
  o.normal = o.along = {0, 0, 1};
  o.beam = {0, 0, -1};
  const double w = kCurvatureScales_mm[1] * std::sqrt(2.0);
  EXPECT_NEAR(value("scanner.spot_blur", 1, o), 0.5 * w * w * (0.01 - 0.02), 1e-9);
  EXPECT_NEAR(value("coating.pooling", 1, o), value("scanner.spot_blur", 1, o), 1e-9)
      << "and the same as a levelled film";
  // At 60 degrees along x the footprint is twice as long there.
  o.beam = {std::sqrt(0.75), 0, -0.5};
  EXPECT_NEAR(value("scanner.spot_blur", 1, o), 0.5 * w * w * (4.0 * 0.01 - 0.02), 1e-7);
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

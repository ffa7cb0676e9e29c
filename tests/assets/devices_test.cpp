// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in assets/devices.hpp, and how each claim is attacked:
//
//   a preset is found by its name alone ...... names unique; every name found; others not
//   values are physical ...................... all positive, limits of plausibility
//   nikon_d700_55deg sees 55 degrees ......... closed form of the pinhole
//   sun_at_20m shows the Sun's angle ......... closed form

#include "assets/devices.hpp"

#include <cmath>
#include <numbers>
#include <set>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

namespace maquette::assets {
namespace {

template <class Preset>
void expect_found_by_unique_name(const std::vector<Preset>& presets) {
  ASSERT_FALSE(presets.empty());
  std::set<std::string> names;
  for (const Preset& p : presets) {
    EXPECT_FALSE(p.name.empty());
    EXPECT_TRUE(names.insert(p.name).second) << p.name << " twice";
    const auto found = find_preset(presets, p.name);
    ASSERT_TRUE(found.has_value()) << p.name;
    EXPECT_EQ(found->name, p.name);
  }
  EXPECT_FALSE(find_preset(presets, "").has_value());
  EXPECT_FALSE(find_preset(presets, presets.front().name + "x").has_value());
}

TEST(Devices, AreFoundByUniqueNames) {
  expect_found_by_unique_name(camera_presets());
  expect_found_by_unique_name(lamp_presets());
  expect_found_by_unique_name(scanner_presets());
  expect_found_by_unique_name(structured_light_presets());
  // One name, one scanner: commands take either kind by name.
  for (const StructuredLightPreset& s : structured_light_presets())
    EXPECT_FALSE(find_preset(scanner_presets(), s.name).has_value()) << s.name;
}

TEST(Devices, TheOnesThatOthersNameExist) {
  for (const char* name : {"nikon_d700_55deg", "canon_5d3", "canon_5ds_r", "mono_space"})
    EXPECT_TRUE(find_preset(camera_presets(), name).has_value()) << name;
  for (const char* name : {"arri_d5", "point"})
    EXPECT_TRUE(find_preset(lamp_presets(), name).has_value()) << name;
  EXPECT_TRUE(find_preset(scanner_presets(), "zf5006h").has_value());
  EXPECT_TRUE(find_preset(structured_light_presets(), "structured_light").has_value());
}

double horizontal_fov_deg(const CameraPreset& c) {
  return 2.0 * std::atan(0.5e-3 * c.width_px * c.pixel_pitch_um / c.focal_length_mm) * 180.0 /
         std::numbers::pi;
}

TEST(Devices, CamerasSeeWhatTheirNamesSay) {
  const auto nikon = find_preset(camera_presets(), "nikon_d700_55deg");
  ASSERT_TRUE(nikon.has_value());
  EXPECT_EQ(nikon->width_px, 4256);
  EXPECT_EQ(nikon->height_px, 2832);
  EXPECT_NEAR(horizontal_fov_deg(*nikon), 55.0, 1e-9);
  const auto space = find_preset(camera_presets(), "mono_space");
  ASSERT_TRUE(space.has_value());
  EXPECT_EQ(space->width_px, 1024);
  EXPECT_EQ(space->height_px, 1024);
  EXPECT_NEAR(horizontal_fov_deg(*space), 5.5, 0.05) << "published to one decimal";
}

TEST(Devices, CamerasArePhysical) {
  for (const CameraPreset& c : camera_presets()) {
    SCOPED_TRACE(c.name);
    EXPECT_GT(c.width_px, 0);
    EXPECT_GT(c.height_px, 0);
    EXPECT_GT(c.pixel_pitch_um, 0.0);
    EXPECT_GT(c.focal_length_mm, 0.0);
    EXPECT_GT(c.f_number, 0.0);
    EXPECT_GT(c.read_noise_e, 0.0);
    EXPECT_GT(c.full_well_e, 100.0 * c.read_noise_e);
    // A pixel of silicon holds of the order of 1000 electrons per square micrometre.
    const double per_um2 = c.full_well_e / (c.pixel_pitch_um * c.pixel_pitch_um);
    EXPECT_GT(per_um2, 300.0);
    EXPECT_LT(per_um2, 3000.0);
  }
}

TEST(Devices, FullFrameSensorsAreThirtySixMillimetresWide) {
  for (const char* name : {"nikon_d700_55deg", "canon_5d3", "canon_5ds_r"}) {
    const auto c = find_preset(camera_presets(), name);
    ASSERT_TRUE(c.has_value());
    EXPECT_NEAR(1e-3 * c->width_px * c->pixel_pitch_um, 36.0, 0.1) << name;
  }
}

TEST(Devices, LampsArePhysical) {
  for (const LampPreset& l : lamp_presets()) {
    SCOPED_TRACE(l.name);
    EXPECT_GT(l.power_w, 0.0);
    EXPECT_GT(l.colour_temperature_k, 1000.0);
    EXPECT_LT(l.colour_temperature_k, 10000.0);
    EXPECT_GE(l.lens_diameter_mm, 0.0);
    EXPECT_GT(l.beam_deg, 0.0);
    EXPECT_LE(l.beam_deg, 180.0);
  }
  EXPECT_EQ(find_preset(lamp_presets(), "point")->lens_diameter_mm, 0.0);
  EXPECT_EQ(find_preset(lamp_presets(), "arri_d5")->power_w, 575.0);
  EXPECT_EQ(find_preset(lamp_presets(), "arri_d5")->beam_deg, 56.0);
  // A lens lets out less than the discharge gives: HMI lamps reach some 100 lm/W.
  EXPECT_GT(find_preset(lamp_presets(), "arri_d5")->luminous_flux_lm, 0.1 * 575.0 * 100.0);
  EXPECT_LT(find_preset(lamp_presets(), "arri_d5")->luminous_flux_lm, 0.6 * 575.0 * 100.0);
  // Solar diameter 1.3914e9 m at 1.495978707e11 m; the lens is rounded to a millimetre.
  EXPECT_NEAR(find_preset(lamp_presets(), "sun_at_20m")->lens_diameter_mm,
              20e3 * 1.3914e9 / 1.495978707e11, 0.5);
}

TEST(Devices, ScannersArePhysical) {
  for (const ScannerPreset& s : scanner_presets()) {
    SCOPED_TRACE(s.name);
    EXPECT_GT(s.lines_per_turn, 0.0);
    EXPECT_GT(s.range_resolution_mm, 0.0);
    EXPECT_GT(s.range_sigma_mm, 0.0);
    EXPECT_GT(s.beam_diameter_mm, 0.0);
    EXPECT_GT(s.beam_divergence_mrad, 0.0);
  }
  const auto zf = find_preset(scanner_presets(), "zf5006h");
  ASSERT_TRUE(zf.has_value());
  EXPECT_EQ(zf->lines_per_turn, 20000.0);
  EXPECT_EQ(zf->range_resolution_mm, 0.1);
  EXPECT_EQ(zf->beam_diameter_mm, 3.0);
  EXPECT_EQ(zf->beam_divergence_mrad, 0.22);
  EXPECT_EQ(zf->unambiguous_mm.front(), 79'000.0);
  EXPECT_EQ(zf->turns_per_s * zf->lines_per_turn, 500'000.0);
}

TEST(Devices, StructuredLightIsPhysical) {
  for (const StructuredLightPreset& s : structured_light_presets()) {
    SCOPED_TRACE(s.name);
    EXPECT_GT(s.width_px, 0);
    EXPECT_GT(s.height_px, 0);
    // The projector lights what the camera sees at the distance it is made for.
    const double seen = std::atan(0.5 * s.width_px / s.focal_length_px) * 360.0 / std::numbers::pi;
    EXPECT_GT(s.projector_width_deg, 0.9 * seen);
    EXPECT_LT(s.projector_width_deg, 2.0 * seen);
    EXPECT_LT(s.baseline_mm, s.working_distance_mm);
    EXPECT_GT(s.exposure, s.least_value);
    EXPECT_LE(s.exposure, 1.0);
  }
}

}  // namespace
}  // namespace maquette::assets

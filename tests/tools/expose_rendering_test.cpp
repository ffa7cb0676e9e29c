// SPDX-License-Identifier: GPL-3.0-or-later

// tools/jobs_expose.hpp, rendered_light.hpp, trajectory_motion.hpp with render_job:
//   an image is made again ............ from its own metadata, rendering and exposure: the same
//   bits,
//                                       of a single picture and of a trajectory's frame
//   time of a frame ................... frames that show the same have other noise; --time-s
//   absolute light .................... lux of a lamp to electrons against Planck, V(lambda) and
//   the
//                                       camera equation, colour and grey sensors, with
//                                       exposure_scale and white_balance; what the camera file says
//                                       comes first
//   motion of a trajectory ............ closed forms of a turn and a parabola; image motion against
//                                       where points of the neighbouring pictures lie
//   a streak .......................... of a frame's motion, as long as the exposure says
//   masks ............................. bent by the lens, beside a .png and in an .exr; `compare`
//   has
//                                       edges and background with them
//   measured dark frames .............. two temperatures and exposures against the law between
//   them;
//                                       whole numbers; made again from the metadata; what is
//                                       refused
//   sequences ......................... numbered in the order of numbers; what cannot be

#include <cmath>
#include <fstream>
#include <numbers>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "camera/image_io.hpp"
#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "support/matchers.hpp"
#include "tools/jobs.hpp"
#include "tools/jobs_compare.hpp"
#include "tools/jobs_expose.hpp"
#include "tools/rendered_light.hpp"
#include "tools/trajectory_motion.hpp"

namespace maquette::tools {
namespace {

using testing::HasSubstr;
using testing_support::FailsWith;
using testing_support::Succeeds;

const std::string kWay = "time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz\n";

class ExposeRendering : public testing::Test {
 protected:
  testing_support::ScratchFolder folder;

  void SetUp() override {
    // A plane and hills of 4 mm, 50 x 50 mm.
    heightmap::ModelField field{Grid<float>(101, 101, 2.0F), Millimetres{0.5}, Millimetres{0},
                                Millimetres{0}};
    ASSERT_THAT(heightmap::write_model_field(field, folder / "flat.tif"), Succeeds());
    for (std::ptrdiff_t r = 0; r < 101; ++r)
      for (std::ptrdiff_t c = 0; c < 101; ++c)
        field.z_mm(r, c) = 2.0F + 4.0F * std::sin(0.2F * static_cast<float>(r)) *
                                      std::sin(0.25F * static_cast<float>(c));
    ASSERT_THAT(heightmap::write_model_field(field, folder / "hills.tif"), Succeeds());
  }
  [[nodiscard]] std::string scene(const std::string& more = "",
                                  const std::string& surface = "hills.tif") const {
    return fmt::format(
        "schema = \"maquette.scene/1\"\nsurface = \"{}\"\nresolution_px = [48, 36]\n"
        "pixel_pitch_um = 100\nfocal_length_mm = 10\ncamera_position_mm = [25, 20, 102]\n"
        "camera_target_mm = [25, 26, 2]\nlamp_position_mm = [-200, 25, 152]\n"
        "lamp_target_mm = [25, 25, 2]\nlamp_beam_deg = 90\nsamples_per_pixel = 4\n{}",
        surface, more);
  }
  void write(const std::string& name, const std::string& text) const {
    std::ofstream(folder / name) << text;
  }
  [[nodiscard]] Result<JobResult> render(const std::string& text, const std::string& out) const {
    write("scene.toml", text);
    return render_job(folder / "scene.toml", folder / out, {});
  }
  [[nodiscard]] ExposeJob job(const std::string& image, const std::string& camera) const {
    ExposeJob j;
    j.image = folder / image;
    j.camera = camera;
    return j;
  }
  [[nodiscard]] std::string bytes(const std::string& name) const {
    return read_file(folder / name).value();
  }
  [[nodiscard]] std::string text(const std::string& image, const std::string& key) const {
    return std::string(
        camera::text_in(camera::read_image(folder / image)->metadata, "maquette:" + key));
  }
  static const Grid<float>& channel(const camera::LoadedImage& image, const std::string& name) {
    for (std::size_t i = 0; i < image.names.size(); ++i)
      if (image.names[i] == name) return image.channels[i];
    throw std::runtime_error("no channel " + name);
  }
  /// Rendering and exposure of an exposed picture, from its metadata alone. @param out  with the
  /// ending of the picture
  void make_again(const std::string& picture, const std::string& light, const std::string& out) {
    std::string again;
    std::istringstream lines(text(picture, "scene"));
    for (std::string line; std::getline(lines, line);)
      if (!line.starts_with("camera_") && !line.starts_with("trajectory") &&
          !line.starts_with("seed"))
        again += line + "\n";
    again += fmt::format("camera_position_mm = {}\ncamera_quaternion_wxyz = {}\nseed = {}\n",
                         text(picture, "camera_position_mm"),
                         text(picture, "camera_quaternion_wxyz"), text(picture, "seed"));
    ASSERT_THAT(render(again, light), Succeeds());
    write("again.toml", text(picture, "camera"));
    ExposeJob j = job(light, (folder / "again.toml").string());
    if (const auto set = text(picture, "set"); !set.empty()) j.set = {set};
    if (const auto without = text(picture, "without"); !without.empty()) j.without = {without};
    j.fit_sensor = text(picture, "fit_sensor") == "true";
    j.seed = std::stoull(text(picture, "noise_seed"));
    j.time_s = std::stod(text(picture, "noise_time_s"));
    ASSERT_THAT(expose_job(j, folder / out, {}), Succeeds());
  }
};

TEST_F(ExposeRendering, MakesAPictureAgainFromItsMetadata) {
  ASSERT_THAT(render(scene("seed = 41\nlamp_diameter_mm = 20\nlamp_kelvin = 3200\n"), "light.exr"),
              Succeeds());
  ExposeJob j = job("light.exr", "canon_5d3");
  j.set = {"exposure.time_s=0.02"};
  j.without = {"diffraction"};
  j.fit_sensor = true;
  j.seed = 9;
  j.time_s = 3.25;
  for (const char* ending : {".png", ".tif", ".jpg", ".exr"}) {
    const std::string photo = std::string("photo") + ending, twin = std::string("twin") + ending;
    ASSERT_THAT(expose_job(j, folder / photo, {}), Succeeds());
    EXPECT_EQ(text(photo, "seed"), "41");
    EXPECT_EQ(text(photo, "noise_seed"), "9");
    EXPECT_FALSE(text(photo, "version").empty());
    make_again(photo, "light_again.exr", twin);
    const auto first = camera::read_image(folder / photo),
               second = camera::read_image(folder / twin);
    ASSERT_THAT(first, Succeeds());
    ASSERT_THAT(second, Succeeds());
    EXPECT_EQ(first->names, second->names);
    ASSERT_EQ(first->channels.size(), second->channels.size());
    EXPECT_EQ(first->channels, second->channels) << ending;
  }
  // Another seed of either is another picture: what was compared is no accident.
  j.seed = 10;
  ASSERT_THAT(expose_job(j, folder / "other.png", {}), Succeeds());
  EXPECT_NE(camera::read_image(folder / "other.png")->channels,
            camera::read_image(folder / "photo.png")->channels);
}

TEST_F(ExposeRendering, MakesAFrameOfATrajectoryAgain) {
  write("way.csv", kWay +
                       "0,25,25,102,0.99,0.06,0.1,0.07\n0.5,24,26,92,0.99,0.03,0.11,0.08\n"
                       "1,23,27,83,0.99,0.01,0.12,0.08\n");
  ASSERT_THAT(
      render(scene("trajectory = \"way.csv\"\nlamp_diameter_mm = 20\nseed = 5\n"), "down.exr"),
      Succeeds());
  ExposeJob j = job("down_0002.exr", "mono_space");
  j.fit_sensor = true;
  j.without = {"motion_blur"};  // a single picture knows nothing of its neighbours
  ASSERT_THAT(expose_job(j, folder / "photo.png", {}), Succeeds());
  EXPECT_EQ(text("photo.png", "noise_time_s"), "0.5");
  make_again("photo.png", "light_again.exr", "twin.png");
  EXPECT_EQ(camera::read_image(folder / "photo.png")->channels,
            camera::read_image(folder / "twin.png")->channels);
}

TEST_F(ExposeRendering, HasNewNoiseInEachFrame) {
  write("still.csv", kWay + "0,25,25,102,1,0,0,0\n0.04,25,25,102,1,0,0,0\n");
  std::string text_of_scene = scene("trajectory = \"still.csv\"\ngeometry = false\n");
  text_of_scene.replace(text_of_scene.find("samples_per_pixel = 4"), 21, "samples_per_pixel = 1");
  ASSERT_THAT(render(text_of_scene, "still.exr"), Succeeds());
  const auto photo = [&](const char* light, std::optional<double> time_s) {
    ExposeJob j = job(light, "mono_space");
    j.fit_sensor = true;
    j.time_s = time_s;
    EXPECT_THAT(expose_job(j, folder / "photo.exr", {}), Succeeds());
    return camera::read_image(folder / "photo.exr")->channels;
  };
  const auto first = photo("still_0001.exr", {}), second = photo("still_0002.exr", {});
  EXPECT_NE(first, second);
  EXPECT_EQ(photo("still_0002.exr", 0.0), first);  // the light is the same, the time was not
  EXPECT_EQ(photo("still_0001.exr", 0.04), second);
}

/// W m^-2 sr^-1 of a white Lambert surface under `lux` of a black body, in a box of wavelengths:
/// once more from Planck's law and V(lambda), by Simpson's rule.
double white_of(double kelvin, double lux, double low_nm, double high_nm) {
  const auto spectrum = [kelvin](double nm) {
    const double c = 299792458.0, h = 6.62607015e-34, k = 1.380649e-23, l = 1e-9 * nm;
    return 2.0 * h * c * c / std::pow(l, 5) / std::expm1(h * c / (l * k * kelvin));
  };
  const auto simpson = [](const auto& f, double a, double b) {
    constexpr int kSteps = 4000;
    double sum = f(a) + f(b);
    for (int i = 1; i < kSteps; ++i) sum += (i % 2 == 1 ? 4.0 : 2.0) * f(a + (b - a) * i / kSteps);
    return sum * (b - a) / kSteps / 3.0;
  };
  const auto luminous = [&](double nm) {
    // Wyman, Sloan and Shirley 2013, y of the 1931 observer
    const auto lobe = [nm](double height, double middle, double left, double right) {
      const double t = (nm - middle) * (nm < middle ? left : right);
      return height * std::exp(-0.5 * t * t);
    };
    return spectrum(nm) * (lobe(0.821, 568.8, 0.0213, 0.0247) + lobe(0.286, 530.9, 0.0613, 0.0322));
  };
  return lux / (683.0 * simpson(luminous, 300.0, 1100.0)) * simpson(spectrum, low_nm, high_nm) /
         std::numbers::pi;
}

TEST_F(ExposeRendering, CountsTheElectronsOfALampsLux) {
  // White under the lamp, seen from beside it; the lamp's axis is the surface's normal.
  const double kelvin = 3200.0, lux = 800.0;
  const std::string rendered =
      "surface_material = \"white\"\n[[material]]\nname = \"white\"\nalbedo = [1.0]\n";
  const auto plate = [&](const std::string& more) {
    std::string s = scene(
        fmt::format("lamp_kelvin = {}\nlamp_illuminance_lux = {}\n", kelvin, lux) + more + rendered,
        "flat.tif");
    const std::string lamp = "lamp_position_mm = [-200, 25, 152]";
    return s.replace(s.find(lamp), lamp.size(), "lamp_position_mm = [25, 25, 2002]");
  };
  const std::string head =
      "schema = \"maquette.camera/1\"\neffects = [\"exposure\", \"quantum_efficiency\"]\n"
      "[lens]\nfocal_length_mm = 10\nf_number = 4\n[sensor]\nwidth_px = 48\nheight_px = 36\n"
      "pixel_pitch_um = 5\nfull_well_e = 20000\n";
  write("colour.toml", head +
                           "wavelength_nm = [630, 535, 445]\nquantum_efficiency = "
                           "[0.3, 0.4, 0.2]\n[exposure]\ntime_s = 0.01\ntransmission = 0.8\n");
  write("grey.toml", head +
                         "wavelength_nm = [550]\nquantum_efficiency = [0.5]\n"
                         "[exposure]\ntime_s = 0.01\ntransmission = 0.8\n");
  // pi L tau / (4 F^2) A t lambda / (h c) q
  const auto electrons = [](double radiance, double nm, double efficiency) {
    const double irradiance = std::numbers::pi * radiance * 0.8 / (4.0 * 16.0);
    return irradiance * 25e-12 * 0.01 * nm * 1e-9 / (6.62607015e-34 * 299792458.0) * efficiency;
  };
  const double red = white_of(kelvin, lux, 580, 680), green = white_of(kelvin, lux, 490, 580),
               blue = white_of(kelvin, lux, 400, 490);
  const double want[3] = {electrons(red, 630, 0.3), electrons(green, 535, 0.4),
                          electrons(blue, 445, 0.2)};
  EXPECT_GT(want[1], 1000.0);
  // The same light, whatever the picture's scale is.
  for (const char* more : {"", "exposure_scale = 0.4\n", "white_balance = [0.5, 1.0, 2.5]\n"}) {
    ASSERT_THAT(render(plate(more), "light.exr"), Succeeds());
    ASSERT_THAT(
        expose_job(job("light.exr", (folder / "colour.toml").string()), folder / "charge.exr", {}),
        Succeeds());
    const auto charge = camera::read_image(folder / "charge.exr");
    // A millimetre from the foot of a lamp 2 m up: 1e-6. Bands by trapezia: 1e-4.
    for (std::size_t b = 0; b < 3; ++b)
      EXPECT_NEAR(channel(*charge, std::string(1, "RGB"[b]))(18, 24) / want[b], 1.0, 5e-4) << more;
    EXPECT_EQ(text("charge.exr", "unit"), "electrons");
    ASSERT_THAT(
        expose_job(job("light.exr", (folder / "grey.toml").string()), folder / "charge.exr", {}),
        Succeeds());
    EXPECT_NEAR(channel(*camera::read_image(folder / "charge.exr"), "Y")(18, 24) /
                    electrons(red + green + blue, 550, 0.5),
                1.0, 5e-4)
        << more;
  }
  // The camera file knows better, in two ways: 1 is 2 W m^-2 sr^-1; 1 is 5000 electrons of green.
  ASSERT_THAT(render(plate(""), "light.exr"), Succeeds());
  const double value =
      static_cast<double>(channel(*camera::read_image(folder / "light.exr"), "G")(18, 24));
  ExposeJob j = job("light.exr", (folder / "colour.toml").string());
  j.set = {"exposure.radiance_of_one=[2.0]"};
  ASSERT_THAT(expose_job(j, folder / "charge.exr", {}), Succeeds());
  EXPECT_NEAR(channel(*camera::read_image(folder / "charge.exr"), "G")(18, 24) /
                  electrons(2.0 * value, 535, 0.4),
              1.0, 1e-5);
  j.set = {"exposure.electrons_at_one=5000"};
  ASSERT_THAT(expose_job(j, folder / "charge.exr", {}), Succeeds());
  EXPECT_NEAR(channel(*camera::read_image(folder / "charge.exr"), "G")(18, 24), 5000.0 * value,
              1e-5 * 5000.0);
}

TEST(MotionsOf, AreTheClosedForms) {
  EXPECT_TRUE(motions_of({}).empty());
  const TimedPose alone{1.0, {{1, 0, 0, 0}, {1, 2, 3}}};
  EXPECT_EQ(motions_of({alone})[0].velocity_mm_s, (Vec3{}));
  // p = p0 + v t + a t^2 / 2 and a turn about one axis with a rate that grows, at uneven times.
  const Vec3 v{3, -2, 7}, a{-4, 5, 1}, axis = normalized(Vec3{1, 2, -2});
  const Quaternion start = rotation_about(normalized(Vec3{2, 1, 1}), 0.7);
  std::vector<TimedPose> poses;
  for (const double t : {0.0, 0.1, 0.3, 0.35, 0.6}) {
    Quaternion turned = start * rotation_about(axis, 0.8 * t + 0.5 * 0.6 * t * t);
    if (poses.size() == 2) turned = {-turned.w, -turned.x, -turned.y, -turned.z};  // the same
    poses.push_back({t, {turned, Vec3{10, 20, 30} + t * v + 0.5 * t * t * a}});
  }
  const auto motions = motions_of(poses);
  for (std::size_t i = 0; i < poses.size(); ++i) {
    const double t = poses[i].time_s;
    const Vec3 speed = rotate(poses[i].model_from_camera.rotation, motions[i].velocity_mm_s);
    EXPECT_LT(norm(speed - (v + t * a)), 1e-12) << i;
    EXPECT_LT(norm(motions[i].angular_rate_rad_s - (0.8 + 0.6 * t) * axis), 1e-12) << i;
  }
  const auto two = motions_of({poses[0], poses[1]});
  EXPECT_LT(norm(two[0].angular_rate_rad_s - (0.8 + 0.6 * 0.05) * axis), 1e-12);
  EXPECT_EQ(two[0].angular_rate_rad_s, two[1].angular_rate_rad_s);
}

// A point of the ground that a pixel of the middle picture sees lies elsewhere in the pictures
// before and after: half their distance in the picture is what the metadata make of it.
TEST_F(ExposeRendering, KnowsHowThePictureMovesOnATrajectory) {
  const double step_s = 0.02;
  std::string way = kWay;
  std::vector<RigidTransform> poses;
  for (int i = 0; i < 3; ++i) {
    const Quaternion q = rotation_about(normalized(Vec3{3, 1, 2}), 0.1 + 0.004 * i);
    poses.push_back({q, {25.0 + 0.3 * i, 22.0 - 0.2 * i, 90.0 - 0.5 * i}});
    way += fmt::format("{},{},{},{},{},{},{},{}\n", step_s * i, poses.back().translation_mm.x,
                       poses.back().translation_mm.y, poses.back().translation_mm.z, q.w, q.x, q.y,
                       q.z);
  }
  write("way.csv", way);
  ASSERT_THAT(render(scene("trajectory = \"way.csv\"\n"), "down.exr"), Succeeds());
  const auto light = read_rendered_light(folder / "down_0002.exr");
  ASSERT_THAT(light, Succeeds());
  camera::Shot shot;
  shot.intrinsics = camera::intrinsics_of(48, 36, 100, 10);
  ASSERT_THAT(take_motion(*light, shot), Succeeds());
  const auto image = camera::read_image(folder / "down_0002.exr");
  const auto seen_at = [&](const RigidTransform& pose, Vec3 p) {
    const Vec3 at = pose.inverse().point(p);
    return camera::pixel(shot.intrinsics, {at.x / -at.z, at.y / at.z});
  };
  for (const auto& [r, c] : {std::pair{5, 7}, {18, 24}, {30, 40}, {8, 41}}) {
    const Vec3 p{static_cast<double>(channel(*image, "position.X")(r, c)),
                 static_cast<double>(channel(*image, "position.Y")(r, c)),
                 static_cast<double>(channel(*image, "position.Z")(r, c))};
    const camera::Vec2 before = seen_at(poses[0], p), after = seen_at(poses[2], p);
    const camera::Vec2 said = camera::image_motion(shot, {c + 0.5, r + 0.5},
                                                   static_cast<double>(channel(*image, "Z")(r, c)));
    const double dx = (after.x - before.x) / (2 * step_s), dy = (after.y - before.y) / (2 * step_s);
    EXPECT_GT(std::hypot(dx, dy), 3.0);  // pixels a second
    // What is left is of third order: (0.005 per step)^2.
    EXPECT_NEAR(said.x, dx, 1e-3 * std::hypot(dx, dy));
    EXPECT_NEAR(said.y, dy, 1e-3 * std::hypot(dx, dy));
  }
  // What the camera file says comes first.
  shot.velocity_mm_s = {0, 0, 1}, shot.angular_rate_rad_s = {};
  ASSERT_THAT(take_motion(*light, shot), Succeeds());
  EXPECT_EQ(norm(shot.angular_rate_rad_s), 0.0);
}

TEST_F(ExposeRendering, BlursAFrameAsItsTrajectoryMoves) {
  // Past a step of light (the lamp's beam ends there) at 100 mm/s, 100 mm above the plane: 10 mm
  // focal length, 0.1 mm pixels, 0.05 s: 5 pixels.
  std::string flat = scene("trajectory = \"by.csv\"\n", "flat.tif");
  write("by.csv", kWay + "0,20,25,102,1,0,0,0\n0.1,30,25,102,1,0,0,0\n");
  ASSERT_THAT(render(flat, "by.exr"), Succeeds());
  const auto image = camera::read_image(folder / "by_0001.exr");
  // A step drawn into the picture of the frame, whose metadata and depth are the rendering's.
  Grid<float> step(36, 48);
  for (std::ptrdiff_t r = 0; r < 36; ++r)
    for (std::ptrdiff_t c = 24; c < 48; ++c) step(r, c) = 1.0F;
  const Grid<float> depth = channel(*image, "Z");
  ASSERT_THAT(
      camera::write_exr({{"Y", &step}, {"Z", &depth}}, folder / "step.exr", image->metadata),
      Succeeds());
  write("blur.toml",
        "schema = \"maquette.camera/1\"\neffects = [\"motion_blur\"]\n[lens]\nfocal_length_mm = "
        "10\n[sensor]\nwidth_px = 48\nheight_px = 36\npixel_pitch_um = 100\nquantum_efficiency = "
        "[0.5]\n"
        "[exposure]\ntime_s = 0.05\n");
  ASSERT_THAT(expose_job(job("step.exr", (folder / "blur.toml").string()), folder / "out.exr", {}),
              Succeeds());
  const auto streak = camera::read_image(folder / "out.exr");
  // The ramp's second moment about its middle: a box of w pixels gives w^2 / 12, linear sampling
  // of the step 1/6 more.
  double sum = 0, first = 0, second = 0;
  for (std::ptrdiff_t c = 1; c < 48; ++c) {
    const double rise = static_cast<double>(channel(*streak, "Y")(18, c)) -
                        static_cast<double>(channel(*streak, "Y")(18, c - 1));
    sum += rise, first += rise * static_cast<double>(c);
    second += rise * static_cast<double>(c * c);
  }
  EXPECT_NEAR(sum, 1.0, 1e-5);
  const double variance = second - first * first;
  EXPECT_NEAR(std::sqrt(12.0 * (variance - 1.0 / 6.0)), 5.0, 0.1);
}

TEST_F(ExposeRendering, LeavesTheDepthOfFieldOfALensAsItIs) {
  // At f/2 ten millimetres from the focus, 100 mm away: circles of confusion of 5 pixels.
  const std::string lens = "through_lens = true\nf_number = 2\nfocus_mm = 90\n";
  ASSERT_THAT(render(scene(), "sharp.exr"), Succeeds());
  ASSERT_THAT(render(scene(lens), "lens.exr"), Succeeds());
  EXPECT_EQ(text("sharp.exr", "lens_f_number"), "");
  EXPECT_EQ(text("lens.exr", "lens_f_number"), "2");
  EXPECT_NE(bytes("sharp.exr"), bytes("lens.exr"));
  ExposeJob with = job("lens.exr", "nikon_d700_55deg");
  with.fit_sensor = true;
  with.set = {"depth_of_field.focus_mm=90", "lens.f_number=2"};
  ExposeJob without = with;
  without.without = {"depth_of_field"};
  const auto done = expose_job(with, folder / "with.exr", {});
  ASSERT_THAT(done, Succeeds());
  EXPECT_THAT(done->note, HasSubstr("depth of field as rendered"));
  ASSERT_THAT(expose_job(without, folder / "without.exr", {}), Succeeds());
  const auto a = camera::read_image(folder / "with.exr"),
             b = camera::read_image(folder / "without.exr");
  ASSERT_THAT(a, Succeeds());
  ASSERT_THAT(b, Succeeds());
  for (const std::string band : {"R", "G", "B"})
    EXPECT_TRUE(std::ranges::equal(channel(*a, band).cells(), channel(*b, band).cells())) << band;
  // What the scene leaves open is as the camera's file has it.
  write("own.toml",
        "schema = \"maquette.camera/1\"\nname = \"own\"\n"
        "effects = [\"depth_of_field\", \"exposure\", \"quantum_efficiency\"]\n"
        "[sensor]\nwidth_px = 48\nheight_px = 36\npixel_pitch_um = 100\n"
        "[lens]\nfocal_length_mm = 10\nf_number = 2\n"
        "[depth_of_field]\nfocus_mm = 90\n");
  ASSERT_THAT(render(scene("camera = \"own.toml\"\nthrough_lens = true\n"), "own.exr"), Succeeds());
  const auto own = camera::read_image(folder / "own.exr"),
             same = camera::read_image(folder / "lens.exr");
  EXPECT_TRUE(std::ranges::equal(channel(*own, "Y").cells(), channel(*same, "Y").cells()));
  const auto refused = render(scene("f_number = 2\n"), "refused.exr");
  ASSERT_FALSE(refused);
  EXPECT_THAT(refused.error().message, HasSubstr("through_lens"));
}

TEST_F(ExposeRendering, HandsMasksOnToCompare) {
  // A camera above the edge of the part, so that there is background, and a low lamp.
  std::string text_of_scene = scene();
  text_of_scene.replace(text_of_scene.find("[25, 26, 2]"), 11, "[35, 26, 2]");
  ASSERT_THAT(render(text_of_scene, "light.exr"), Succeeds());
  write("bends.toml",
        "schema = \"maquette.camera/1\"\neffects = [\"distortion\", \"exposure\", "
        "\"quantum_efficiency\", \"adc\", \"white_balance\", \"tone\"]\n[lens]\nfocal_length_mm = "
        "10\n[sensor]\nwidth_px = 48\nheight_px = 36\npixel_pitch_um = 100\n"
        "[distortion]\nmodel = \"brown_conrady\"\ncoefficients = [5.0, 0.0]\n");
  ExposeJob j = job("light.exr", (folder / "bends.toml").string());
  j.masks = true;
  const auto made = expose_job(j, folder / "made.png", {});
  ASSERT_THAT(made, Succeeds());
  EXPECT_THAT(made->outputs, testing::ElementsAre(folder / "made.png", folder / "made.masks.exr"));
  j.masks = false;
  ASSERT_THAT(expose_job(j, folder / "made.exr", {}), Succeeds());
  ASSERT_THAT(expose_job(j, folder / "real.jpg", {}), Succeeds());

  const auto compared = [&](const std::string& rendered, const std::string& masks) {
    CompareJob c{folder / "real.jpg", folder / rendered, {}, {}, INFINITY};
    if (!masks.empty()) c.masks = folder / masks;
    const auto result = compare_job(c, folder / "compare", {});
    EXPECT_THAT(result, Succeeds());
    return nlohmann::json::parse(result->figures_json);
  };
  const auto none = compared("made.png", "");
  EXPECT_FALSE(none.contains("shadow_edges"));
  EXPECT_EQ(none["background_pixels"], 0);
  const auto beside = compared("made.png", "made.masks.exr");
  EXPECT_TRUE(fs::exists(folder / "compare/edges.png"));
  const auto inside = compared("made.exr", "");
  ASSERT_TRUE(beside.contains("shadow_edges") && inside.contains("shadow_edges"));
  EXPECT_EQ(beside["shadow_edges"]["pixels"], inside["shadow_edges"]["pixels"]);
  EXPECT_EQ(beside["background_pixels"], inside["background_pixels"]);
  EXPECT_GT(beside["shadow_edges"]["pixels"], 20);
  EXPECT_GT(beside["background_pixels"], 50);
  // JPEG of quality 95 is all that differs; a picture encoded twice would be 30/255 off.
  EXPECT_LT(inside["mean_abs_diff_255"], 4.0);

  // Where the lens bends: masks that are not bent name other pixels.
  const auto straight = compared("made.png", "light.exr");
  EXPECT_NE(straight["background_pixels"], beside["background_pixels"]);
  // Of the picture, black sky: what is bright is not of the background.
  const auto picture = camera::read_image(folder / "made.png");
  const auto masks = camera::read_image(folder / "made.masks.exr");
  const auto plain = camera::read_image(folder / "light.exr");
  int wrong_bent = 0, wrong_straight = 0;
  for (std::size_t i = 0; i < picture->channels[1].cells().size(); ++i) {
    if (picture->channels[1].cells()[i] < 0.3F) continue;
    wrong_bent += std::isinf(channel(*masks, "Z").cells()[i]) ? 1 : 0;
    wrong_straight += std::isinf(channel(*plain, "Z").cells()[i]) ? 1 : 0;
  }
  EXPECT_GT(wrong_straight, 20);
  EXPECT_LT(3 * wrong_bent, wrong_straight);

  CompareJob bad{folder / "real.jpg", folder / "made.png", folder / "real.jpg", {}, INFINITY};
  EXPECT_THAT(compare_job(bad, folder / "compare", {}), FailsWith(camera::kImageFormat));
  Grid<float> small(3, 4);
  ASSERT_THAT(camera::write_exr({{"lit", &small}}, folder / "small.exr"), Succeeds());
  bad.masks = folder / "small.exr";
  EXPECT_THAT(compare_job(bad, folder / "compare", {}), FailsWith(camera::kImagesDiffer));
}

TEST_F(ExposeRendering, ExposesASequence) {
  Grid<float> light(4, 6);
  fs::create_directory(folder / "frames");
  for (const int i : {1, 2, 10}) {
    for (float& v : light.cells()) v = 0.05F * static_cast<float>(i);
    ASSERT_THAT(camera::write_exr({{"Y", &light}}, folder / fmt::format("frames/f_{}.exr", i),
                                  {{"maquette:time_s", fmt::format("{}", 0.5 * i)}}),
                Succeeds());
  }
  write("frames/f_3.masks.exr", "no picture of light");
  const auto frames = pictures_in({folder / "frames"});
  ASSERT_THAT(frames, Succeeds());
  EXPECT_THAT(*frames, testing::ElementsAre(folder / "frames/f_1.exr", folder / "frames/f_2.exr",
                                            folder / "frames/f_10.exr"));
  write("plain.toml",
        "schema = \"maquette.camera/1\"\neffects = [\"exposure\", \"quantum_efficiency\", \"adc\", "
        "\"white_balance\", \"tone\"]\n[lens]\nfocal_length_mm = 10\n[sensor]\nwidth_px = "
        "6\nheight_px = 4\npixel_pitch_um = 100\n");
  ExposeJob j;
  j.camera = (folder / "plain.toml").string();
  std::vector<double> shares;
  RunContext run;
  run.progress = [&](double share) { shares.push_back(share); };
  const auto film = expose_sequence_job(j, *frames, folder / "film/p.png", run);
  ASSERT_THAT(film, Succeeds());
  EXPECT_THAT(film->outputs,
              testing::ElementsAre(folder / "film/p_0001.png", folder / "film/p_0002.png",
                                   folder / "film/p_0003.png"));
  EXPECT_TRUE(std::is_sorted(shares.begin(), shares.end()));
  EXPECT_DOUBLE_EQ(shares.back(), 1.0);
  EXPECT_THAT(film->note, HasSubstr("3 pictures"));
  float before = 0.0F;
  for (const fs::path& path : film->outputs) {
    const float v = camera::read_image(path)->channels[0](2, 3);
    EXPECT_GT(v, before);
    before = v;
  }
  EXPECT_EQ(std::string(camera::text_in(camera::read_image(film->outputs[2])->metadata,
                                        "maquette:noise_time_s")),
            "5");

  fs::create_directory(folder / "empty");
  EXPECT_THAT(pictures_in({folder / "empty"}), FailsWith(kInputMissing));
  // An exposed picture is no radiance; and none of the frames is written over.
  ASSERT_THAT(expose_job(
                  [&] {
                    ExposeJob one = j;
                    one.image = frames->front();
                    return one;
                  }(),
                  folder / "done.exr", {}),
              Succeeds());
  EXPECT_THAT(expose_sequence_job(j, {folder / "done.exr"}, folder / "film/q.png", {}),
              FailsWith(camera::kFrame));
  fs::copy_file(frames->front(), folder / "r_0001.exr");
  EXPECT_THAT(expose_sequence_job(j, {folder / "r_0001.exr"}, folder / "r.exr", {}),
              FailsWith(kUnknownFormat));
}

TEST_F(ExposeRendering, AddsMeasuredDarkFrames) {
  Grid<float> light(4, 6, 0.0F), cool(4, 6), warm(4, 6);
  for (std::ptrdiff_t i = 0; i < 24; ++i) {
    cool.cells()[static_cast<std::size_t>(i)] = 20.0F + static_cast<float>(i);
    warm.cells()[static_cast<std::size_t>(i)] = 300.0F + 5.0F * static_cast<float>(i);
  }
  ASSERT_THAT(camera::write_exr({{"Y", &light}}, folder / "light.exr"), Succeeds());
  fs::create_directory(folder / "dark");
  ASSERT_THAT(camera::write_exr({{"Y", &cool}}, folder / "dark/cool.exr"), Succeeds());
  // Electrons as numbers of 16 bits.
  ASSERT_THAT(camera::write_whole_numbers({{"Y", &warm}}, 65535.0, 16, folder / "dark/warm.tif"),
              Succeeds());
  const auto camera_file = [&](const std::string& frames) {
    return "schema = \"maquette.camera/1\"\neffects = [\"exposure\", \"quantum_efficiency\", "
           "\"dark_library\"]\n[lens]\nfocal_length_mm = 10\n[sensor]\nwidth_px = 6\nheight_px "
           "= 4\npixel_pitch_um = 100\nquantum_efficiency = [0.5]\ntemperature_c = 14\n"
           "[exposure]\ntime_s = 0.25\n" +
           frames;
  };
  const std::string frames =
      "[[dark_frame]]\nimage = \"dark/cool.exr\"\ntemperature_c = 5\nexposure_s = 2\n"
      "[[dark_frame]]\nimage = \"dark/warm.tif\"\ntemperature_c = 30\nexposure_s = 4\n";
  write("dark.toml", camera_file(frames));
  ASSERT_THAT(expose_job(job("light.exr", (folder / "dark.toml").string()), folder / "a.exr", {}),
              Succeeds());
  const auto heat = camera::read_image(folder / "a.exr");
  const double share = (1 / 287.15 - 1 / 278.15) / (1 / 303.15 - 1 / 278.15);
  for (std::size_t i = 0; i < 24; ++i) {
    const double low = (20.0 + static_cast<double>(i)) / 2.0,
                 high = (300.0 + 5.0 * static_cast<double>(i)) / 4.0;
    EXPECT_NEAR(heat->channels[0].cells()[i], 0.25 * low * std::pow(high / low, share), 1e-4);
  }
  // The metadata name the frames wherever the file lies that is made of them.
  fs::create_directory(folder / "elsewhere");
  write("elsewhere/again.toml", text("a.exr", "camera"));
  ASSERT_THAT(expose_job(job("light.exr", (folder / "elsewhere/again.toml").string()),
                         folder / "b.exr", {}),
              Succeeds());
  EXPECT_EQ(camera::read_image(folder / "b.exr")->channels, heat->channels);

  const auto refuses = [&](const std::string& what, ErrorCode code, const char* says) {
    write("dark.toml", camera_file(what));
    const auto result =
        expose_job(job("light.exr", (folder / "dark.toml").string()), folder / "c.exr", {});
    ASSERT_THAT(result, FailsWith(code)) << what;
    EXPECT_THAT(result.error().message, HasSubstr(says));
    EXPECT_FALSE(fs::exists(folder / "c.exr"));
  };
  refuses("[[dark_frame]]\nimage = \"none.exr\"\ntemperature_c = 5\nexposure_s = 2\n",
          kFileNotFound, "none.exr");
  refuses("[[dark_frame]]\nimage = \"dark/cool.exr\"\nexposure_s = 2\n", kConfigInvalid,
          "temperature_c");
  refuses(frames + frames, camera::kEffectOutOfRange, "rising temperature");
  Grid<float> small(3, 3, 1.0F);
  ASSERT_THAT(camera::write_exr({{"Y", &small}}, folder / "small.exr"), Succeeds());
  refuses("[[dark_frame]]\nimage = \"small.exr\"\ntemperature_c = 5\nexposure_s = 2\n",
          camera::kEffectOutOfRange, "3 x 3");
}

TEST_F(ExposeRendering, RefusesMetadataThatAreNoNumbers) {
  Grid<float> light(4, 6, 0.1F);
  for (const auto& [key, value] : {std::pair{"time_s", "noon"},
                                   {"velocity_mm_s", "[1, 2]"},
                                   {"angular_rate_deg_s", "[1, 2, null]"},
                                   {"white_radiance_w_m2_sr", "[1, 0, 1]"}}) {
    ASSERT_THAT(camera::write_exr({{"Y", &light}}, folder / "bad.exr",
                                  {{fmt::format("maquette:{}", key), value}}),
                Succeeds());
    ExposeJob j = job("bad.exr", "nikon_d700_55deg");
    j.fit_sensor = true;
    const auto result = expose_job(j, folder / "out.png", {});
    EXPECT_THAT(result, FailsWith(camera::kFrame)) << key;
    EXPECT_FALSE(fs::exists(folder / "out.png"));
  }
}

}  // namespace
}  // namespace maquette::tools

// SPDX-License-Identifier: GPL-3.0-or-later

// expose, stack, compare from the outside:
//   expose ........... a preset's picture, the same twice, another at another time; 16-bit numbers;
//                      metadata name the camera; each preset is read
//   errors ........... wrong order, empty field of view, unknown camera and effect, a size that is
//   not
//                      the sensor's, a full disk: code, exit code, nothing half-written
//   disk full ........ render, compare, stack at every size that files may have: exit code 3, and
//                      files are whole or not there
//   sequences ........ a folder becomes numbered pictures, masks beside them
//   stack ............ swaps and the page; pairs that cannot change places are named
//   calibrate ........ a sensor and a lens from files: the camera file is one that expose and
//   render
//                      take, with the values hidden; what bad files are told
//   compare .......... a photograph with wrong white balance, matched; page; exit code 1

#include <filesystem>
#include <map>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "camera/image_io.hpp"
#include "core/vec.hpp"
#include "support/matchers.hpp"
#include "support/program.hpp"

namespace maquette {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::HasSubstr;
using testing_support::Outcome;
using testing_support::run_program;
using testing_support::ScratchFolder;

class CameraCommands : public testing::Test {
 protected:
  ScratchFolder scratch;

  Outcome run(const std::string& arguments, const std::string& before = "") {
    return run_program(scratch.path(), arguments, before);
  }
  /// Waves of light, 96 x 64, 2 m away.
  fs::path radiance(double factor = 1.0, const std::string& name = "light.exr") {
    Grid<float> light(64, 96), depth(64, 96, 2000.0F);
    for (std::ptrdiff_t r = 0; r < 64; ++r)
      for (std::ptrdiff_t c = 0; c < 96; ++c)
        light(r, c) = static_cast<float>(
            factor *
            (0.35 + 0.25 * std::sin(0.2 * static_cast<double>(c) + 0.1 * static_cast<double>(r))));
    EXPECT_TRUE(camera::write_exr({{"Y", &light}, {"Z", &depth}}, scratch / name));
    return scratch / name;
  }
  fs::path file(const std::string& name, const std::string& content) {
    EXPECT_TRUE(write_file(scratch / name, content));
    return scratch / name;
  }
};

TEST_F(CameraCommands, ExposeWithEveryPreset) {
  const auto light = radiance().string();
  for (const char* camera : {"nikon_d700_55deg", "canon_5d3", "canon_5ds_r", "mono_space"}) {
    const auto out = (scratch / (std::string(camera) + ".png")).string();
    const Outcome o =
        run(fmt::format("expose {} --camera {} --fit-sensor --out {}", light, camera, out));
    ASSERT_EQ(o.exit_code, 0) << camera << o.err;
    const auto picture = camera::read_image(out);
    ASSERT_TRUE(picture);
    EXPECT_EQ(picture->channels.size(), camera == std::string("mono_space") ? 1U : 3U);
    EXPECT_TRUE(picture->eight_bit);
  }
}

TEST_F(CameraCommands, ExposeDependsOnSeedAndTimeOnly) {
  const auto light = radiance().string();
  const auto with = [&](const std::string& options) {
    const auto out = scratch / "photo.png";
    const Outcome o =
        run(fmt::format("expose {} --fit-sensor --out {} {}", light, out.string(), options));
    EXPECT_EQ(o.exit_code, 0) << o.err;
    return testing_support::slurp(out);
  };
  const std::string once = with("--threads 1");
  EXPECT_EQ(with("--threads 16"), once);
  EXPECT_NE(with("--time-s 1"), once);
  EXPECT_NE(with("--seed 7"), once);
  EXPECT_THAT(once, HasSubstr("nikon_d700_55deg"));  // the camera file is in the metadata
}

TEST_F(CameraCommands, ExposeRefusesWhatNoCameraIs) {
  const auto light = radiance().string();
  const auto out = scratch / "photo.png";
  const auto fails = [&](const std::string& arguments, const std::string& code,
                         const std::string& says) {
    const Outcome o =
        run(fmt::format("expose {} --json --out {} {}", light, out.string(), arguments));
    EXPECT_EQ(o.exit_code, 2) << arguments;
    const json j = json::parse(o.out);
    EXPECT_EQ(j["error"]["code"], code) << o.out;
    EXPECT_THAT(j["error"]["message"].get<std::string>(), HasSubstr(says));
    EXPECT_FALSE(fs::exists(out));
  };
  const auto wrong = file("wrong.toml",
                          "schema = \"maquette.camera/1\"\neffects = [\"exposure\", "
                          "\"quantum_efficiency\", \"shot_noise\", \"prnu\", \"adc\"]\n");
  fails("--fit-sensor --camera " + wrong.string(), "CAMERA_STACK_ORDER", "acts before it");
  fails("--fit-sensor --set lens.focal_length_mm=100000 --set sensor.pixel_pitch_um=0.01",
        "CAMERA_INTRINSICS", "field of view");
  fails("--camera nikon_d70", "TOOLS_UNKNOWN_NAME", "nikon_d700_55deg");
  fails("--without fisheye", "TOOLS_UNKNOWN_NAME", "no such effect");
  fails("", "CAMERA_FRAME", "render at the camera's resolution");
  fails("--fit-sensor --set prnu.sigma=7", "TOOLS_CONFIG_INVALID", "prnu.sigma");
}

TEST_F(CameraCommands, ExposeSaysThatTheDiskIsFull) {
  const auto light = radiance().string();
  // Files above 8 blocks of 512 bytes are refused, as by a disk without space.
  const Outcome o =
      run(fmt::format("expose {} --fit-sensor --out {}", light, (scratch / "photo.png").string()),
          "trap '' XFSZ; ulimit -f 8;");
  EXPECT_EQ(o.exit_code, 3) << o.err;
  EXPECT_FALSE(fs::exists(scratch / "photo.png"));
}

TEST_F(CameraCommands, LeaveWholeFilesOrNoneWhenTheDiskIsFull) {
  const auto light = radiance().string(), other = radiance(0.9, "other.exr").string();
  file("plate.stl",
       "solid s\nfacet normal 0 0 1\nouter loop\nvertex -90 -90 0\nvertex 90 -90 0\nvertex 0 90 0\n"
       "endloop\nendfacet\nendsolid s\n");
  file("way.csv", "time_s,x_mm,y_mm,z_mm,qw,qx,qy,qz\n0,0,0,300,1,0,0,0\n1,0,0,280,1,0,0,0\n");
  const auto scene = file("scene.toml",
                          "schema = \"maquette.scene/1\"\nsurface = \"plate.stl\"\ntrajectory = "
                          "\"way.csv\"\nresolution_px = [96, 64]\nlamp_position_mm = [0, 50, "
                          "2000]\nlamp_target_mm = [0, 0, 0]\nlamp_diameter_mm = 300\n");
  const auto out = scratch / "out";
  const auto files = [&] {
    std::map<std::string, std::string> all;
    std::error_code none;
    for (const auto& entry : fs::recursive_directory_iterator(out, none))
      if (entry.is_regular_file())
        all[fs::relative(entry.path(), out).string()] = testing_support::slurp(entry.path());
    return all;
  };
  for (const std::string& command :
       {fmt::format("compare {} {} --out {}", light, other, out.string()),
        fmt::format("stack {} --camera mono_space --fit-sensor --out {}", light, out.string()),
        fmt::format("render {} --out {}", scene.string(), (out / "a.exr").string())}) {
    const auto anew = [&] {
      fs::remove_all(out);
      fs::create_directories(out);
    };
    anew();
    ASSERT_EQ(run(command).exit_code, 0) << command;
    const auto whole = files();
    ASSERT_GE(whole.size(), 2U);
    int refused = 0;
    for (const int blocks : {1, 4, 16, 64, 128, 256}) {  // of 512 bytes
      anew();
      const Outcome o = run(command, fmt::format("trap '' XFSZ; ulimit -f {};", blocks));
      const auto made = files();
      for (const auto& [name, content] : made) {
        ASSERT_TRUE(whole.contains(name)) << name << " is left behind, " << command;
        EXPECT_TRUE(whole.at(name) == content) << name << " is no whole file, " << command;
      }
      if (o.exit_code == 0) {
        EXPECT_EQ(made.size(), whole.size());
        break;
      }
      EXPECT_EQ(o.exit_code, 3) << command << " " << o.err;
      EXPECT_LT(made.size(), whole.size());
      ++refused;
    }
    EXPECT_GT(refused, 0) << command;
  }
}

TEST_F(CameraCommands, ExposesAFolderOfFrames) {
  fs::create_directories(scratch / "frames");
  for (const int i : {1, 2, 3}) radiance(0.5 + 0.2 * i, fmt::format("frames/f_{:04}.exr", i));
  const Outcome o =
      run(fmt::format("expose {} --fit-sensor --masks --json --out {}",
                      (scratch / "frames").string(), (scratch / "film/photo.jpg").string()));
  ASSERT_EQ(o.exit_code, 0) << o.err;
  EXPECT_THAT(o.out, HasSubstr("\"pictures\":3"));
  for (const char* name :
       {"photo_0001.jpg", "photo_0002.jpg", "photo_0003.jpg", "photo_0003.masks.exr"})
    EXPECT_TRUE(fs::exists(scratch / "film" / name)) << name;
  const Outcome none = run(fmt::format("expose {} --json", (scratch / "film").string()));
  EXPECT_EQ(none.exit_code, 2);
  EXPECT_THAT(none.out, HasSubstr("TOOLS_INPUT_MISSING"));
}

TEST_F(CameraCommands, StackShowsEachEffectAndSwap) {
  const Outcome o = run(fmt::format("stack {} --camera mono_space --fit-sensor --out {}",
                                    radiance().string(), (scratch / "stack").string()));
  ASSERT_EQ(o.exit_code, 0) << o.err;
  const json j = json::parse(testing_support::slurp(scratch / "stack" / "stack.json"));
  EXPECT_EQ(j["effects"].size(), 18U);
  EXPECT_GT(j["swaps"].size(), 20U);
  EXPECT_EQ(j["swaps"].size() + j["not_swappable"].size(), 18U * 17U / 2U);
  EXPECT_THAT(j["not_swappable"].dump(), HasSubstr("'adc' makes numbers of the converter of"));
  EXPECT_THAT(testing_support::slurp(scratch / "stack" / "stack.html"), HasSubstr("all together"));
}

/// Frames as `expose` makes them, of a camera whose values are hidden from `calibrate`.
class Calibrate : public CameraCommands {
 protected:
  const std::string hidden_ =
      "schema = \"maquette.camera/1\"\nname = \"hidden\"\n"
      "effects = [\"vignetting\", \"exposure\", \"quantum_efficiency\", \"prnu\", "
      "\"dark_current\", \"shot_noise\", \"full_well\", \"dsnu\", \"read_noise\", \"adc\"]\n"
      "[lens]\nfocal_length_mm = 2.5\n"
      "[sensor]\nwidth_px = 160\nheight_px = 120\npixel_pitch_um = 8.0\nquantum_efficiency = "
      "[0.5]\nfull_well_e = 40000\ngain_e_per_dn = 4\nbits = 14\nblack_level_dn = 300\n"
      "temperature_c = 20\n"
      "[vignetting]\npolynomial = [-0.1, 0.02, 0.0]\n"
      "[prnu]\nsigma = 0.01\n[dark_current]\nrate_e_s = 40\nreference_c = 20\n"
      "[dsnu]\nsigma_e = 6\n[read_noise]\nsigma_e = 10\n";
  int clock_ = 0;

  /// [[kind]] with frames of this light, in numbers of the converter.
  std::string frames(const std::string& kind, double light, double exposure_s, int count,
                     const std::string& without = "vignetting") {
    Grid<float> flat(120, 160, static_cast<float>(light));
    const auto radiance_file = scratch / fmt::format("light_{}.exr", light);
    EXPECT_TRUE(camera::write_exr({{"Y", &flat}}, radiance_file));
    const auto camera = file("hidden.toml", hidden_);
    std::string list;
    for (int i = 0; i < count; ++i) {
      const auto out = scratch / fmt::format("frame_{}.exr", ++clock_);
      const Outcome o = run(fmt::format(
          "expose {} --camera {} --set exposure.time_s={} --without {} --time-s {} --out {}",
          radiance_file.string(), camera.string(), exposure_s, without.empty() ? "jpeg" : without,
          clock_, out.string()));
      EXPECT_EQ(o.exit_code, 0) << o.err;
      list += fmt::format("\"{}\", ", out.filename().string());
    }
    return fmt::format("[[{}]]\nimages = [{}]\nexposure_s = {}\n", kind, list, exposure_s);
  }
  std::string head(const std::string& more = "") {
    file("start.toml",
         "schema = \"maquette.camera/1\"\nname = \"start\"\neffects = [\"exposure\", "
         "\"quantum_efficiency\", \"adc\", \"white_balance\", \"tone\"]\n[lens]\n"
         "focal_length_mm = 2.5\n[sensor]\nwidth_px = 160\nheight_px = 120\npixel_pitch_um = "
         "8.0\nquantum_efficiency = [0.5]\nbits = 14\n");
    return "schema = \"maquette.calibration/1\"\nname = \"mine\"\ncamera = \"start.toml\"\n" + more;
  }
  /// A board of points, seen through 310 pixels of focal length with k1 = -0.1.
  std::string targets(int views) {
    std::string csv = "X_mm,Y_mm,Z_mm,u_px,v_px,image\n";
    for (int view = 0; view < views; ++view)
      for (int i = 0; i < 35; ++i) {
        const Vec3 p{20.0 * (i % 7) - 60.0, 20.0 * double(i / 7) - 40.0, 0.0};
        const Vec3 at = rotate(rotation_about({1, 0, 0}, 0.5 * std::cos(2.0 * view)) *
                                   rotation_about({0, 1, 0}, 0.5 * std::sin(2.0 * view)),
                               p) +
                        Vec3{2.0 * view, -1.0 * view, 300.0 + 10.0 * view};
        const double x = at.x / at.z, y = at.y / at.z, l = 1.0 - 0.1 * (x * x + y * y);
        csv += fmt::format("{},{},{},{},{},picture_{}.png\n", p.x, p.y, p.z, 310.0 * l * x + 81.0,
                           310.0 * l * y + 59.0, view);
      }
    return csv;
  }
};

TEST_F(Calibrate, WritesACameraThatExposeAndRenderTake) {
  std::string toml = head("[targets]\npoints = \"points.csv\"\ncoefficients = 2\n");
  file("points.csv", targets(6));
  for (const double t : {0.01, 1.0, 4.0}) toml += frames("dark", 0.0, t, 6);
  for (const double light : {0.03, 0.1, 0.25, 0.4, 0.6, 2.0})
    toml += frames("bright", light, 0.01, light == 0.4 ? 8 : 3);
  toml += frames("flat", 0.6, 0.01, 4, "");
  const auto calibration = file("calibration.toml", toml);
  const auto out = scratch / "calibrated";
  const Outcome o = run(fmt::format("calibrate {} --out {}", calibration.string(), out.string()));
  ASSERT_EQ(o.exit_code, 0) << o.err;
  const json j = json::parse(testing_support::slurp(out / "calibration.json"));
  const auto near = [&](const json& m, double truth, const char* what) {
    ASSERT_FALSE(m.is_null()) << what;
    EXPECT_NEAR(m["value"].get<double>(), truth, 4.0 * m["u"].get<double>() + 1e-6) << what;
  };
  near(j["sensor"]["gain_e_per_dn"], 4.0, "gain");
  near(j["sensor"]["read_noise_e"], 10.0, "read noise");
  near(j["sensor"]["dark_current_e_s"], 40.0, "dark current");
  near(j["sensor"]["black_level_dn"], 300.0, "black level");
  near(j["sensor"]["prnu"], 0.01, "PRNU");
  near(j["sensor"]["dsnu_of_pixels_e"], 6.0, "DSNU");
  near(j["sensor"]["full_well_e"], 40000.0, "full well");
  near(j["targets"]["focal_px"], 310.0, "focal length");
  near(j["targets"]["coefficients"][0], -0.1, "k1");
  near(j["targets"]["cx_px"], 81.0, "principal point");
  // 2560 blocks' noise; the camera that flats were taken with has its principal point elsewhere.
  EXPECT_LT(j["vignetting"]["rms"].get<double>(), 0.01);
  for (const char* name :
       {"camera.toml", "calibration.html", "photon_transfer.png", "residuals.png"})
    EXPECT_TRUE(fs::exists(out / name)) << name;

  Grid<float> flat(120, 160, 0.3F);
  ASSERT_TRUE(camera::write_exr({{"Y", &flat}}, scratch / "flat.exr"));
  const Outcome exposed =
      run(fmt::format("expose {} --camera {} --out {}", (scratch / "flat.exr").string(),
                      (out / "camera.toml").string(), (scratch / "photo.png").string()));
  EXPECT_EQ(exposed.exit_code, 0) << exposed.err;
  // The render looks through the same principal point: the plane's middle moves as far.
  file("plate.stl",
       "solid s\nfacet normal 0 0 1\nouter loop\nvertex -90 -90 0\nvertex 90 -90 0\nvertex 0 90 0\n"
       "endloop\nendfacet\nendsolid s\n");
  const auto scene = file("scene.toml",
                          "schema = \"maquette.scene/1\"\nsurface = \"plate.stl\"\ncamera = "
                          "\"calibrated/camera.toml\"\ncamera_position_mm = [0, 0, 300]\n"
                          "camera_quaternion_wxyz = [1, 0, 0, 0]\nlamp_position_mm = [0, 0, 2000]\n"
                          "lamp_target_mm = [0, 0, 0]\n");
  const Outcome rendered =
      run(fmt::format("render {} --out {}", scene.string(), (scratch / "seen.exr").string()));
  ASSERT_EQ(rendered.exit_code, 0) << rendered.err;
  const auto seen = camera::read_image(scratch / "seen.exr");
  ASSERT_TRUE(seen);
  ASSERT_EQ(seen->channels[0].cols(), 160);
  // The lower edge runs from x = -90 to 90 mm: 93 pixels to both sides of cx = 81.
  for (std::size_t k = 0; k < seen->names.size(); ++k)
    if (seen->names[k] == "position.X" || seen->names[k] == "position.x") {
      EXPECT_NEAR(static_cast<double>(seen->channels[k](100, 100)), (100.5 - 81.0) * 300.0 / 310.0,
                  0.02);
    }
}

TEST_F(Calibrate, TellsWhatIsWrongWithItsFiles) {
  const auto out = scratch / "calibrated";
  const auto fails = [&](const std::string& toml, const std::string& code,
                         const std::string& says) {
    const auto path = file("calibration.toml", toml);
    const Outcome o = run(fmt::format("calibrate {} --json --out {}", path.string(), out.string()));
    EXPECT_EQ(o.exit_code, 2) << toml;
    const json j = json::parse(o.out);
    EXPECT_EQ(j["error"]["code"], code) << o.out;
    EXPECT_THAT(j["error"]["message"].get<std::string>(), HasSubstr(says));
    EXPECT_FALSE(fs::exists(out / "camera.toml"));
  };
  fails(head(), "TOOLS_CONFIG_INVALID", "nothing to calibrate from");
  fails(head() + frames("dark", 0.0, 0.01, 1), "TOOLS_CONFIG_INVALID", "one frame only");
  const std::string dark = frames("dark", 0.0, 0.01, 2);
  fails(head() + dark, "CAMERA_CALIBRATION_FRAMES", "dark frames alone");
  fails(head() + dark + frames("bright", 0.3, 0.01, 2), "CAMERA_CALIBRATION_FRAMES", "at least 3");
  const std::string points = "[targets]\npoints = \"points.csv\"\n";
  fails(head(points), "CORE_FILE_NOT_FOUND", "points.csv");
  file("points.csv", targets(1));
  fails(head(points), "CAMERA_CALIBRATION_TARGETS", "cannot be told apart");
  file("points.csv", "X,Y\n");
  fails(head(points), "TOOLS_TARGET_FILE", "line 1");
  file("points.csv", "X_mm,Y_mm,Z_mm,u_px,v_px,image\n1,2,3,nan,5,a\n");
  fails(head(points), "TOOLS_TARGET_FILE", "line 2");
  file("points.csv", "X_mm,Y_mm,Z_mm,u_px,v_px,image\n1,2,3,4,5,\n");
  fails(head(points), "TOOLS_TARGET_FILE", "name is missing");
  Grid<float> small(60, 80, 300.0F);
  ASSERT_TRUE(camera::write_exr({{"Y", &small}}, scratch / "small.exr"));
  fails(head() + "[[dark]]\nimages = [\"small.exr\", \"small.exr\"]\nexposure_s = 1\n" +
            frames("bright", 0.3, 1.0, 2),
        "CAMERA_CALIBRATION_FRAMES", "80 x 60 pixels");
}

TEST_F(CameraCommands, CompareMatchesExposure) {
  const auto a = radiance(1.2, "real.exr").string(), b = radiance(1.0, "made.exr").string();
  const auto out = scratch / "compare";
  EXPECT_EQ(
      run(fmt::format("compare {} {} --out {} --max-mean-255 3", a, b, out.string())).exit_code, 1);
  EXPECT_EQ(run(fmt::format("compare {} {} --out {} --max-mean-255 3 --match exposure", a, b,
                            out.string()))
                .exit_code,
            0);
  const json j = json::parse(testing_support::slurp(out / "compare.json"));
  EXPECT_LT(j["mean_abs_diff_255"].get<double>(), 0.01);
  EXPECT_NEAR(j["channels"][0]["gain"].get<double>(), 1.2, 1e-4);
  EXPECT_GT(j["ssim"].get<double>(), 0.999);
  EXPECT_TRUE(fs::exists(out / "compare.html"));
  EXPECT_TRUE(fs::exists(out / "absolute.png"));
}

}  // namespace
}  // namespace maquette

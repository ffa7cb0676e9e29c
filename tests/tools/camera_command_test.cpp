// SPDX-License-Identifier: GPL-3.0-or-later

// expose, stack, compare from the outside:
//   expose ........... a preset's picture, the same twice, another at another time; 16-bit numbers;
//                      metadata name the camera; each preset is read
//   errors ........... wrong order, empty field of view, unknown camera and effect, a size that is
//   not
//                      the sensor's, a full disk: code, exit code, nothing half-written
//   stack ............ swaps and the page
//   compare .......... a photograph with wrong white balance, matched; page; exit code 1

#include <filesystem>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "camera/image_io.hpp"
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

TEST_F(CameraCommands, StackShowsEachEffectAndSwap) {
  const Outcome o = run(fmt::format("stack {} --camera mono_space --fit-sensor --out {}",
                                    radiance().string(), (scratch / "stack").string()));
  ASSERT_EQ(o.exit_code, 0) << o.err;
  const json j = json::parse(testing_support::slurp(scratch / "stack" / "stack.json"));
  EXPECT_EQ(j["effects"].size(), 18U);
  EXPECT_GT(j["swaps"].size(), 20U);
  EXPECT_THAT(testing_support::slurp(scratch / "stack" / "stack.html"), HasSubstr("all together"));
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

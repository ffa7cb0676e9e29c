// SPDX-License-Identifier: GPL-3.0-or-later

// match from the outside: photographs are pictures of `render` with other numbers than the scene
// that the search starts from (that another renderer's are matched, tests/camera shows).
//   what was changed is found ....... match.json; scene files render to the photographs
//   held out ........................ 13/255 before, 3/255 after; exit code 1 beyond a bound
//   disk full ....................... exit code 3; files are whole or not there
//   bad files ....................... code and what to do, nothing written

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "camera/image_io.hpp"
#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "support/matchers.hpp"
#include "support/program.hpp"
#include "support/terrain.hpp"

namespace maquette {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::HasSubstr;
using testing_support::Outcome;
using testing_support::run_program;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

constexpr const char* kSouth = "[25, -70, 90]";
constexpr const char* kEast = "[110, 10, 90]";

class MatchCommand : public testing::Test {
 protected:
  ScratchFolder scratch;

  void SetUp() override {
    fs::create_directories(scratch / "truth");
    ASSERT_THAT(heightmap::write_model_field(
                    testing_support::ground(testing_support::Ground::rolling, 8, 101, 0.5),
                    scratch / "design.tif"),
                Succeeds());
  }
  Outcome run(const std::string& arguments, const std::string& before = "") {
    return run_program(scratch.path(), arguments, before);
  }
  fs::path file(const std::string& name, const std::string& content) {
    EXPECT_TRUE(write_file(scratch / name, content));
    return scratch / name;
  }
  static std::string scene(const std::string& camera, const std::string& more) {
    return fmt::format(
        "schema = \"maquette.scene/1\"\nsurface = \"design.tif\"\nresolution_px = [160, 120]\n"
        "pixel_pitch_um = 20\nfocal_length_mm = 6\ncamera_position_mm = {}\ncamera_target_mm = "
        "[22, 26, 5]\nlamp_target_mm = [22, 26, 5]\nlamp_beam_deg = 120\n{}",
        camera, more);
  }
  /// An 8-bit photograph under the true lamp.
  void shoot(const std::string& name, const std::string& camera) {
    const auto truth = file(name + ".toml", scene(camera,
                                                  "lamp_position_mm = [-110, 64, 128]\n"
                                                  "exposure_scale = 2.2\nwhite_balance = [0.7, 1, "
                                                  "1.3]\nsamples_per_pixel = 16\nseed = 9\n"));
    const Outcome o = run(
        fmt::format("render {} --out {}", truth.string(), (scratch / (name + ".exr")).string()));
    ASSERT_EQ(o.exit_code, 0) << o.err;
    fs::remove(scratch / (name + ".exr"));  // the preview beside it is the photograph
  }
  fs::path match_file(const std::string& search, const std::string& more) {
    file("scene.toml", scene(kSouth,
                             "lamp_position_mm = [-115, 60, 125]  # measured by hand\n"
                             "exposure_scale = 2.0\nsamples_per_pixel = 16\n"));
    return file("match.toml", "schema = \"maquette.match/1\"\nscene = \"scene.toml\"\nsearch = [" +
                                  search + "]\n" + more);
  }
};

TEST_F(MatchCommand, FindsWhatWasChangedAndHoldsForAnotherPhotograph) {
  shoot("south", kSouth);
  shoot("east", kEast);
  const auto match = match_file(
      "\"exposure\", \"white_balance\", \"lamp_position\"",
      fmt::format("[[photo]]\nimage = \"south.png\"\n[[photo]]\nimage = \"east.png\"\n"
                  "camera_position_mm = {}\ncamera_target_mm = [22, 26, 5]\nheld_out = true\n",
                  kEast));
  const auto out = scratch / "matched";
  const Outcome o =
      run(fmt::format("match {} --max-mean-255 3 --out {}", match.string(), out.string()));
  ASSERT_EQ(o.exit_code, 0) << o.err;
  EXPECT_THAT(o.out, HasSubstr("white_balance.red"));
  EXPECT_THAT(o.out, HasSubstr("held out"));
  const json j = json::parse(testing_support::slurp(out / "match.json"));
  const auto near = [&](const std::string& name, double truth, double least) {
    for (const json& n : j["numbers"])
      if (n["name"] == name) {
        EXPECT_NEAR(n["value"].get<double>(), truth, 4.0 * n["sigma"].get<double>() + least)
            << name;
        return;
      }
    ADD_FAILURE() << name;
  };
  // Beside sigma: 8 bits of sRGB round in the same way wherever the surface is as bright.
  near("exposure", 1.1, 1e-3);
  near("white_balance.red", 0.7, 1e-3);
  near("white_balance.blue", 1.3, 1e-3);
  near("lamp.x_mm", -110.0, 0.2);
  near("lamp.y_mm", 64.0, 0.2);
  near("lamp.z_mm", 128.0, 0.2);
  const json& east = j["photographs"][1];
  EXPECT_TRUE(east["held_out"].get<bool>());
  EXPECT_GT(east["mean_abs_diff_before_255"].get<double>(), 13.0);
  EXPECT_LT(east["mean_abs_diff_255"].get<double>(), 3.0);
  EXPECT_TRUE(fs::exists(out / "match.html"));
  EXPECT_TRUE(fs::exists(out / "scene.toml"));
  // What was written is what render takes, from another folder.
  const Outcome rendered = run(fmt::format("render {} --out {}", (out / "scene_east.toml").string(),
                                           (scratch / "again.exr").string()));
  ASSERT_EQ(rendered.exit_code, 0) << rendered.err;
  const Outcome compared = run(
      fmt::format("compare {} {} --fast --max-mean-255 3 --out {}", (scratch / "east.png").string(),
                  (scratch / "again.exr").string(), (scratch / "compared").string()));
  EXPECT_EQ(compared.exit_code, 0) << compared.err;
  EXPECT_EQ(run(fmt::format("match {} --max-mean-255 0.001 --out {}", match.string(), out.string()))
                .exit_code,
            1);
}

TEST_F(MatchCommand, FindsAPose) {
  shoot("east", kEast);
  const auto match = match_file("\"exposure\", \"white_balance\", \"lamp_position\", \"pose\"",
                                "[[photo]]\nimage = \"east.png\"\ncamera_position_mm = [109, 11.5, "
                                "89.5]\ncamera_target_mm = [22.3, 25.6, 5]\n");
  const auto out = scratch / "matched";
  const Outcome o =
      run(fmt::format("match {} --max-mean-255 3 --out {}", match.string(), out.string()));
  ASSERT_EQ(o.exit_code, 0) << o.err;
  EXPECT_THAT(testing_support::slurp(out / "scene_east.toml"),
              testing::AllOf(HasSubstr("camera_quaternion_wxyz"), HasSubstr("camera_position_mm"),
                             testing::Not(HasSubstr("camera_target_mm"))));
}

TEST_F(MatchCommand, LeavesWholeFilesOrNoneWhenTheDiskIsFull) {
  shoot("south", kSouth);
  const auto match =
      match_file("\"exposure\", \"white_balance\"", "[[photo]]\nimage = \"south.png\"\n");
  const std::string command =
      fmt::format("match {} --out {}", match.string(), (scratch / "out").string());
  ASSERT_EQ(run(command).exit_code, 0);
  fs::rename(scratch / "out", scratch / "whole");
  std::size_t before = 0;
  for (const int blocks : {1, 8, 16}) {  // of 512 bytes; pictures are larger
    const Outcome o = run(command, fmt::format("trap '' XFSZ; ulimit -f {};", blocks));
    EXPECT_EQ(o.exit_code, 3) << o.err;
    std::size_t made = 0;
    for (const auto& entry : fs::directory_iterator(scratch / "out")) {
      EXPECT_TRUE(testing_support::slurp(entry.path()) ==
                  testing_support::slurp(scratch / "whole" / entry.path().filename().string()))
          << entry.path();
      ++made;
    }
    EXPECT_GE(made, before);
    EXPECT_FALSE(fs::exists(scratch / "out" / "scene.toml"));
    before = made;
    fs::remove_all(scratch / "out");
  }
}

TEST_F(MatchCommand, SaysWhatIsWrong) {
  shoot("south", kSouth);
  const auto fails = [&](const fs::path& match, const char* code, const char* says) {
    const Outcome o = run(
        fmt::format("match {} --json --out {}", match.string(), (scratch / "not_made").string()));
    EXPECT_EQ(o.exit_code, 2);
    EXPECT_THAT(o.err + o.out, HasSubstr(code));
    EXPECT_THAT(o.err + o.out, HasSubstr(says));
    EXPECT_FALSE(fs::exists(scratch / "not_made"));
  };
  const std::string photo = "[[photo]]\nimage = \"south.png\"\n";
  fails(match_file("\"colour\"", photo), "TOOLS_CONFIG_INVALID", "colour");
  fails(match_file("\"exposure\"", ""), "TOOLS_CONFIG_INVALID", "nothing to search in");
  fails(match_file("\"exposure\", \"exposure_each\"", photo), "TOOLS_CONFIG_INVALID", "take one");
  fails(match_file("\"exposure\"", photo + photo), "TOOLS_CONFIG_INVALID", "are called south");
  fails(match_file("\"exposure\", \"lamp_brightness\"", photo), "CAMERA_MATCH_OPEN",
        "lamp.brightness");
  fails(match_file("\"exposure\"", photo + "camera_position_mm = [25, 20, 400]\n"
                                           "camera_target_mm = [25, 20, 900]\n"),
        "CAMERA_MATCH_PHOTOGRAPH", "show the scene");
}

}  // namespace
}  // namespace maquette

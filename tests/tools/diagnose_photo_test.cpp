// SPDX-License-Identifier: GPL-3.0-or-later

// diagnose with photographs from the outside; these are pictures of `render`, without noise.
//   [[material]] .................... the law that the case declares is the surface's
//   [[object]] ...................... the scene's own words leave it and its shadow out
//   bad files ....................... code and what to do, nothing written

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "support/matchers.hpp"
#include "support/program.hpp"
#include "support/terrain.hpp"

namespace maquette {
namespace {

namespace fs = std::filesystem;
using nlohmann::json;
using testing::AllOf;
using testing::HasSubstr;
using testing_support::Outcome;
using testing_support::run_program;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

constexpr const char* kRegolith =
    "[[material]]\nname = \"regolith\"\nlaw = \"hapke\"\nw = [0.6]\nb = 0.2\nc = 0.6\n"
    "surge = 0.5\nsurge_width = 0.2\nroughness_deg = 15\n";

class DiagnosePhoto : public testing::Test {
 protected:
  ScratchFolder scratch;

  void SetUp() override {
    ASSERT_THAT(heightmap::write_model_field(
                    testing_support::ground(testing_support::Ground::rolling, 8, 101, 0.5),
                    scratch / "design.tif"),
                Succeeds());
  }
  std::string at(const std::string& name) { return (scratch / name).string(); }
  Outcome diagnose() {
    return run(
        fmt::format("diagnose {} --out {} --no-controls --quiet", at("case.toml"), at("found")));
  }
  Outcome run(const std::string& arguments) { return run_program(scratch.path(), arguments); }
  void file(const std::string& name, const std::string& content) {
    ASSERT_TRUE(write_file(scratch / name, content));
  }
  /// Three pictures of the surface in regolith. @param with  more of the scene
  void shoot(const std::string& with = "") {
    for (int k = 0; k < 3; ++k) {
      file("scene.toml",
           fmt::format("schema = \"maquette.scene/1\"\nsurface = \"design.tif\"\n"
                       "surface_material = \"regolith\"\nsamples_per_pixel = 16\n{}{}{}",
                       stands(k), kRegolith, with));
      const Outcome o = run(
          fmt::format("render {} --out {}", at("scene.toml"), at(fmt::format("photo_{}.exr", k))));
      ASSERT_EQ(o.exit_code, 0) << o.err;
    }
  }
  /// Camera and lamp of the k-th picture, in the keys that scenes and cases share.
  static std::string stands(int k) {
    return fmt::format(
        "resolution_px = [320, 240]\npixel_pitch_um = 20\nfocal_length_mm = 30\n"
        "camera_position_mm = [{}, 25, 260]\ncamera_quaternion_wxyz = [1, 0, 0, 0]\n"
        "lamp_position_mm = [{}, {}, 900]\nlamp_target_mm = [25, 25, 5]\nlamp_beam_deg = 56\n"
        "exposure_scale = 1.5\n",
        20 + 5 * k, k == 1 ? -500 : 700, 100 + 250 * k);
  }
  void write_case(const std::string& of_each, const std::string& more) {
    std::string text = "schema = \"maquette.case/1\"\ndesign = \"design.tif\"\n" + more;
    for (int k = 0; k < 3; ++k)
      text += fmt::format("[[photo]]\nimage = \"photo_{}.exr\"\nsurface = \"design\"\n{}{}", k,
                          stands(k), of_each);
    file("case.toml", text);
  }
};

TEST_F(DiagnosePhoto, TakesTheLawThatTheCaseDeclares) {
  shoot();
  const auto rms = [&] {
    const Outcome o = diagnose();
    EXPECT_EQ(o.exit_code, 0) << o.err;
    return json::parse(
               testing_support::slurp(scratch / "found/diagnosis.json"))["gain"]["rms_before"]
        .get<double>();
  };
  write_case("material = \"regolith\"\n", kRegolith);
  const double declared_255 = rms();
  write_case("albedo = 0.2\n", "");
  const double lambert_255 = rms();
  // Without noise: rays of a pixel and slopes between nodes, a hundredth of 40 to 80.
  EXPECT_LT(declared_255, 0.8);
  EXPECT_GT(lambert_255, 5.0 * declared_255);
}

TEST_F(DiagnosePhoto, LeavesOutWhatStandsOnThePart) {
  // A block of 6 mm, 25 mm high, in the middle of 50 x 50 mm.
  file("block.obj",
       "v -3 -3 0\nv 3 -3 0\nv 3 3 0\nv -3 3 0\nv -3 -3 25\nv 3 -3 25\nv 3 3 25\nv -3 3 25\n"
       "f 4 3 2 1\nf 5 6 7 8\nf 1 2 6 5\nf 2 3 7 6\nf 3 4 8 7\nf 4 1 5 8\n");
  const std::string block =
      "[[object]]\nmesh = \"block.obj\"\nmaterial = \"regolith\"\nposition_mm = [25, 25, 2]\n";
  shoot(block);
  const auto found = [&](const std::string& more) {
    write_case("material = \"regolith\"\n", std::string(kRegolith) + more);
    const Outcome o = diagnose();
    EXPECT_EQ(o.exit_code, 0) << o.err;
    return json::parse(testing_support::slurp(scratch / "found/diagnosis.json"));
  };
  const json said = found(block), unsaid = found("");
  EXPECT_LT(said["gain"]["rms_before"].get<double>(), 0.8);  // as without it, above
  EXPECT_GT(unsaid["gain"]["rms_before"].get<double>(), 8.0);
}

TEST_F(DiagnosePhoto, RefusesAnObjectThatIsTurnedByNoRotation) {
  write_case("", "[[object]]\nmesh = \"block.obj\"\nquaternion_wxyz = [1, 1, 0, 0]\n");
  const Outcome o = diagnose();
  EXPECT_EQ(o.exit_code, 2);
  EXPECT_THAT(o.err, AllOf(HasSubstr("block.obj"), HasSubstr("no rotation")));
  EXPECT_FALSE(fs::exists(scratch / "found"));
}

TEST_F(DiagnosePhoto, RefusesAMaterialThatIsNotDescribed) {
  write_case("material = \"moondust\"\n", kRegolith);
  const Outcome o = diagnose();
  EXPECT_EQ(o.exit_code, 2);
  EXPECT_THAT(o.err,
              AllOf(HasSubstr("photo_0.exr"), HasSubstr("\"moondust\""), HasSubstr("regolith")));
  EXPECT_FALSE(fs::exists(scratch / "found"));
}

TEST_F(DiagnosePhoto, RefusesAMaterialInColour) {
  write_case("material = \"rust\"\n", "[[material]]\nname = \"rust\"\nalbedo = [0.4, 0.2, 0.1]\n");
  const Outcome o = diagnose();
  EXPECT_EQ(o.exit_code, 2);
  EXPECT_THAT(o.err, AllOf(HasSubstr("photo_0.exr"), HasSubstr("\"rust\""),
                           HasSubstr("one value for all bands")));
  EXPECT_FALSE(fs::exists(scratch / "found"));
}

}  // namespace
}  // namespace maquette

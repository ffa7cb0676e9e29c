// SPDX-License-Identifier: GPL-3.0-or-later

// tools/jobs_shaped.hpp: the file holds what the certificate says, hollow and engraved, with and
// without stones; what is refused leaves no file.

#include "tools/jobs_shaped.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/mesh_checks.hpp"
#include "meshing/mesh_io.hpp"
#include "meshing/stones.hpp"
#include "support/matchers.hpp"
#include "support/shapes.hpp"

namespace maquette::tools {
namespace {

using nlohmann::json;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

class ShapedFile : public testing::Test {
 protected:
  void SetUp() override {
    ASSERT_THAT(heightmap::write_model_field(field, scratch / "design.tif"), Succeeds());
    job.design = scratch / "design.tif";
    job.shape.hollow.emplace();
    job.shape.hollow->wall = Millimetres{2.0};
    job.shape.hollow->pocket = Millimetres{20.0};
  }
  json certificate() const {
    return json::parse(read_file(scratch / "part.certificate.json").value());
  }
  ScratchFolder scratch;
  const heightmap::ModelField field = testing_support::random_terrain(5, 101, 121, 0.5, 0.2);
  ShapedJob job;
};

TEST_F(ShapedFile, IsWhatItsCertificateSays) {
  ASSERT_THAT(shaped_job(job, scratch / "part.ply", {}), Succeeds());
  const auto mesh = meshing::read_mesh(scratch / "part.ply", {}).value();
  const auto found = meshing::check_mesh(mesh).value();
  const json said = certificate();
  EXPECT_TRUE(found.passed());
  EXPECT_EQ(said["passed"], true);
  EXPECT_EQ(said["proof"], "graph of a height above one below, and CGAL");
  EXPECT_EQ(said["triangles"], found.triangles);
  EXPECT_NEAR(said["volume_mm3"], found.volume_mm3, 1e-9 * found.volume_mm3);
  EXPECT_EQ(said["hollow"]["pockets"], json({3, 3}));
  EXPECT_GT(said["hollow"]["removed_mm3"], 0.3 * found.volume_mm3);
}

TEST_F(ShapedFile, IsEngraved) {
  job.shape.label = "Site 7";
  job.shape.scale_denominator = 1000.0;
  job.shape.engraving.side = meshing::WallSide::north;
  job.shape.engraving.letter = Millimetres{4.0};
  ASSERT_THAT(shaped_job(job, scratch / "part.ply", {}), Succeeds());
  const auto found =
      meshing::check_mesh(meshing::read_mesh(scratch / "part.ply", {}).value()).value();
  const json said = certificate();
  EXPECT_TRUE(found.passed());
  EXPECT_EQ(said["triangles"], found.triangles);
  EXPECT_NEAR(said["volume_mm3"], found.volume_mm3, 1e-9 * found.volume_mm3);
  EXPECT_EQ(said["engraved"][0]["what"], "\"Site 7\"");
  EXPECT_EQ(said["engraved"][1]["what"], "the scale bar of 20 m");
  EXPECT_GT(said["hollow"]["removed_mm3"], 0.0);
  job.shape.hollow.reset();
  ASSERT_THAT(shaped_job(job, scratch / "part.ply", {}), Succeeds());
  EXPECT_FALSE(certificate().contains("hollow"));
  job.shape.label = "Site 7!";
  EXPECT_THAT(shaped_job(job, scratch / "other.ply", {}), FailsWith(meshing::kLabelLetter));
  EXPECT_FALSE(fs::exists(scratch / "other.ply"));
}

TEST_F(ShapedFile, HasItsStones) {
  meshing::PlacedStone stone;
  stone.number = 1;
  stone.shape.subdivisions = 3;
  stone.scale_mm = 6.0;
  stone.model_from_stone.translation_mm = {30.0, 25.0, heightmap::height_at(field, 30.0, 25.0)};
  const std::vector<meshing::PlacedStone> plan{stone};
  ASSERT_THAT(meshing::write_stone_plan(plan, scratch / "stones.json"), Succeeds());
  job.stones = scratch / "stones.json";
  ASSERT_THAT(shaped_job(job, scratch / "part.ply", {}), Succeeds());
  const json said = certificate();
  EXPECT_EQ(said["passed"], true);
  EXPECT_LT(said["max_union_error_mm"], 1e-3);
  EXPECT_GT(said["vertices_above_surface"], 10);
}

TEST_F(ShapedFile, IsNotWrittenWhereItDoesNotFit) {
  job.base_thickness = Millimetres{2.0};
  EXPECT_THAT(shaped_job(job, scratch / "part.ply", {}), FailsWith(meshing::kHollowDoesNotFit));
  EXPECT_FALSE(fs::exists(scratch / "part.ply"));
  EXPECT_FALSE(fs::exists(scratch / "part.certificate.json"));
}

}  // namespace
}  // namespace maquette::tools

// SPDX-License-Identifier: GPL-3.0-or-later

// tools/jobs_shaped.hpp, jobs_tiles.hpp, part_with_stones.hpp:
//   the file holds what the certificate says .. hollow and engraved, with and without stones
//   the wall holds under stones, too .......... every corner of a ceiling, from all of the top
//   parts with stones are the whole ........... strips and tiles, hollow, engraved and bored:
//                                               volumes, walls to neighbours to the bit
//   what is refused leaves no file ............ no room, stones that cut themselves

#include "tools/jobs_shaped.hpp"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "core/triangle_distance.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/mesh_checks.hpp"
#include "meshing/mesh_io.hpp"
#include "meshing/stones.hpp"
#include "support/matchers.hpp"
#include "support/mesh_properties.hpp"
#include "support/placed_stones.hpp"
#include "support/shapes.hpp"
#include "tools/jobs.hpp"
#include "tools/jobs_tiles.hpp"
#include "tools/solid_base.hpp"

namespace maquette::tools {
namespace {

using heightmap::ModelField;
using nlohmann::json;
using testing_support::FailsWith;
using testing_support::placed_rock;
using testing_support::ScratchFolder;
using testing_support::Succeeds;
using testing_support::two_balls_in_one;

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
  // The first reaches deeper than the ceiling above which it stands, the last hangs over its rim.
  const std::vector plan{placed_rock(1, field, 30.0, 25.0, 9.0, 0.4),
                         placed_rock(2, field, 12.0, 33.0, 5.0),
                         placed_rock(3, field, 45.0, 12.0, 7.0, -0.1)};
  const Box3 deep = meshing::stone_mesh(plan[0]).bounds();
  ASSERT_LT(deep.min.z, heightmap::height_at(field, 30.0, 25.0) - 3.0);
  ASSERT_THAT(meshing::write_stone_plan(plan, scratch / "stones.json"), Succeeds());
  job.stones = scratch / "stones.json";
  job.shape.label = "7";
  ASSERT_THAT(mesh_job(job.design, job.stones, job.base_thickness, scratch / "full.ply", {}),
              Succeeds());
  ASSERT_THAT(shaped_job(job, scratch / "part.ply", {}), Succeeds());
  const json said = certificate();
  EXPECT_EQ(said["passed"], true);
  EXPECT_EQ(said["proof"], "CGAL");
  EXPECT_LT(said["max_union_error_mm"], 1.1e-3);
  EXPECT_GT(said["vertices_above_surface"], 100);
  const TriMesh part = meshing::read_mesh(scratch / "part.ply").value();
  const auto found = meshing::check_mesh(part).value();
  EXPECT_TRUE(found.passed() && found.self_intersection_checked) << meshing::to_json(found);
  EXPECT_EQ(found.euler_number, 2);
  EXPECT_EQ(found.triangles, said["triangles"]);
  const double removed = said["hollow"]["removed_mm3"].get<double>() +
                         said["engraved"][0]["removed_mm3"].get<double>();
  const auto full = meshing::check_mesh(meshing::read_mesh(scratch / "full.ply").value()).value();
  EXPECT_NEAR(found.volume_mm3 + removed, full.volume_mm3, 1e-9 * full.volume_mm3);
  // Ceilings are below the terrain; no triangle of the top is nearer than the wall to any corner of
  // theirs, but for the 1e-3 mm that the union moves vertices.
  const double base = part.bounds().min.z;
  const auto below = [&](Vec3 v) {
    const double ground = heightmap::height_at(field, v.x, v.y);
    return v.z > base + 0.5 && v.z < ground - 1.0 && v.x > 1.0 && v.x < 59.0 && v.y > 1.0 &&
           v.y < 49.0;
  };
  const auto on_top = [&](Vec3 v) { return v.z > heightmap::height_at(field, v.x, v.y) - 0.01; };
  std::size_t ceilings = 0;
  double least = INFINITY;
  for (const Vec3& v : part.vertices_mm) {
    if (!below(v)) continue;
    ++ceilings;
    for (const auto& t : part.triangles) {
      const Vec3 a = part.vertices_mm[t[0]], b = part.vertices_mm[t[1]], c = part.vertices_mm[t[2]];
      if (std::hypot(a.x - v.x, a.y - v.y) < 5.0 && on_top(a) && on_top(b) && on_top(c))
        least = std::fmin(least, std::sqrt(triangle_distance2(v, a, b, c)));
    }
  }
  EXPECT_GT(ceilings, 500U);
  EXPECT_GE(least, 2.0 - 1e-3);
  EXPECT_LT(least, 2.5);
}

TEST_F(ShapedFile, IsNotWrittenWhereStonesHaveNoExactUnion) {
  const Vec3 at{25.0, 25.0, heightmap::height_at(field, 25.0, 25.0)};
  ASSERT_THAT(meshing::write_stone_plan(std::vector{two_balls_in_one(at)}, scratch / "stones.json"),
              Succeeds());
  job.stones = scratch / "stones.json";
  ASSERT_THAT(shaped_job(job, scratch / "part.ply", {}), FailsWith(kSolidInexact));
  TilesJob tiles{.design = job.design,
                 .stones = job.stones,
                 .options = {},
                 .shape = job.shape,
                 .with_stones = true};
  ASSERT_THAT(tiles_job(tiles, scratch / "tiles", {}), FailsWith(kSolidInexact));
  for (const char* name : {"part", "tiles/tile_01"}) {
    const fs::path file = scratch / (std::string(name) + ".ply");
    EXPECT_FALSE(fs::exists(file));
    EXPECT_FALSE(fs::exists(certificate_path(file)));
    const json said =
        json::parse(read_file(scratch / (std::string(name) + ".refused.json")).value());
    EXPECT_EQ(said["passed"], false);
    EXPECT_GT(said["max_union_error_mm"], 0.02);
  }
}

/// Strips and tiles of a part with stones, with all that there is below and at the sides.
class ShapedParts : public testing::Test {
 protected:
  void SetUp() override {
    field.spacing = Millimetres{0.6};  // coordinates that binary numbers do not hold
    field.x0 = Millimetres{17.1};
    field.y0 = Millimetres{-6.7};
    ASSERT_THAT(heightmap::write_model_field(field, design), Succeeds());
    field = heightmap::read_model_field(design).value();
    for (const auto& [x, y] :
         {std::pair{15.0, 14.0}, {52.0, 17.0}, {20.0, 55.0}, {55.0, 57.0}, {35.0, 33.0}})
      plan.push_back(placed_rock(static_cast<int>(plan.size()) + 11, field, field.x_mm(0) + x,
                                 field.y_mm(0) + y, 8.0, 0.1));
    ASSERT_THAT(meshing::write_stone_plan(plan, stones), Succeeds());
    ASSERT_THAT(mesh_job(design, stones, kBase, scratch / "whole.ply", {}), Succeeds());
    whole_mm3 = certificate_of("whole")["volume_mm3"];
    shape.hollow.emplace();
    shape.hollow->wall = Millimetres{1.5};
    shape.hollow->rib = Millimetres{1.2};
    shape.hollow->pocket = Millimetres{15.0};
    shape.label = "N";
    shape.engraving.letter = Millimetres{4.0};
    in_joints.dowels = meshing::DowelOptions{.depth_mm = 6.0, .spacing_mm = 30.0};
    in_joints.magnets = meshing::DowelOptions{.diameter_mm = 5.0, .depth_mm = 2.2, .wall_mm = 1.0};
  }
  json certificate_of(const std::string& name) const {
    return json::parse(read_file(scratch / (name + ".certificate.json")).value());
  }
  /// What the part weighs with all that was taken from it; it is what its certificate says.
  double uncut_mm3(const std::string& name) {
    const TriMesh mesh = meshing::read_mesh(scratch / (name + ".ply")).value();
    const auto found = meshing::check_mesh(mesh).value();
    const json said = certificate_of(name);
    EXPECT_TRUE(found.passed() && found.self_intersection_checked) << meshing::to_json(found);
    EXPECT_EQ(said["passed"], true);
    EXPECT_NEAR(said["volume_mm3"], found.volume_mm3, 1e-9 * found.volume_mm3);
    EXPECT_LT(said["max_union_error_mm"], 1.1e-3);
    for (const json& number : said["stones"]) carried.push_back(number);
    meshes.push_back(mesh);
    return found.volume_mm3 + said["hollow"]["removed_mm3"].get<double>() +
           said["engraved"][0]["removed_mm3"].get<double>();
  }
  static double holes_mm3(const json& said) {
    double sum = 0.0;
    for (const char* kind : {"dowels", "magnets"}) {
      EXPECT_GE(said[kind]["places"].size(), 1U) << kind;
      sum += static_cast<double>(said[kind]["places"].size()) *
             said[kind]["hole_volume_mm3"].get<double>();
    }
    return sum;
  }
  static constexpr Millimetres kBase{12.0};
  ScratchFolder scratch;
  ModelField field = testing_support::random_terrain(6, 124, 121, 0.6, 0.15, 0.02);
  const fs::path design = scratch / "design.tif", stones = scratch / "stones.json";
  std::vector<meshing::PlacedStone> plan;
  double whole_mm3 = 0.0;
  Shape shape;
  InJoints in_joints;
  std::vector<int> carried;
  std::vector<TriMesh> meshes;
};

TEST_F(ShapedParts, StripsAddUpToTheWhole) {
  shape.engraving.side = meshing::WallSide::west;
  ShapedJob job{.design = design,
                .stones = stones,
                .base_thickness = kBase,
                .band = BandOf{{.count = 3}, 0},
                .shape = shape,
                .in_joints = in_joints};
  ASSERT_NE(field.y_mm(41) + 41 * 0.6, field.y_mm(82)) << "or walls are the same anyhow";
  double volume = 0.0;
  for (const std::size_t b : {0U, 1U, 2U}) {
    job.band->index = b;
    const std::string name = "band_" + std::to_string(b);
    ASSERT_THAT(shaped_job(job, scratch / (name + ".ply"), {}), Succeeds());
    volume += uncut_mm3(name) + holes_mm3(certificate_of(name));
  }
  // Unions of parts have stones' edges on 32-bit places of their own.
  EXPECT_NEAR(volume, whole_mm3, 1e-6 * whole_mm3);
  EXPECT_THAT(carried, testing::ElementsAre(11, 12, 15, 13, 14));
  for (const std::size_t b : {1U, 2U}) {
    const double y = field.y_mm(static_cast<std::ptrdiff_t>(41 * b));
    const auto wall = testing_support::in_plane(meshes[b], false, y, true);
    EXPECT_GT(wall.size(), 2U * 120U);  // round the holes there are more triangles
    EXPECT_TRUE(wall == testing_support::in_plane(meshes[b - 1], false, y, false));
  }
  // As other files hold it.
  for (const std::string format : {"stl", "3mf"}) {
    const auto written =
        export_job(format, scratch / "band_0.ply", {}, {}, scratch / "exported", {});
    ASSERT_THAT(written, Succeeds());
    EXPECT_EQ(written->unmet, "");
  }
}

TEST_F(ShapedParts, TilesAddUpToTheWhole) {
  shape.engraving.side = meshing::WallSide::south;  // at joints, too: grooves in one of two walls
  shape.engraving.letter = Millimetres{1.2};
  in_joints.dowels = meshing::DowelOptions{
      .diameter_mm = 2.0, .depth_mm = 4.0, .wall_mm = 1.0, .spacing_mm = 24.0};
  in_joints.magnets = meshing::DowelOptions{.diameter_mm = 3.0, .depth_mm = 1.5, .wall_mm = 0.8};
  TilesJob job{.design = design,
               .stones = stones,
               .options = {.max_width = Millimetres{45.0}, .max_length = Millimetres{45.0}},
               .base_thickness = kBase,
               .in_joints = in_joints,
               .shape = shape,
               .with_stones = true};
  ASSERT_THAT(tiles_job(job, scratch.path(), {}), Succeeds());
  const json tiles = json::parse(read_file(scratch / "tiles.json").value());
  ASSERT_EQ(tiles["tiles"].size(), 4U);
  double volume = 2.0 * holes_mm3(tiles);
  for (const json& tile : tiles["tiles"]) {
    const std::string file = tile["file"];
    volume += uncut_mm3(file.substr(0, file.size() - 4));
  }
  EXPECT_NEAR(volume, whole_mm3, 1e-6 * whole_mm3);
  EXPECT_THAT(carried, testing::UnorderedElementsAre(11, 12, 13, 14, 15));
  for (const auto& [west, east] : {std::pair{0U, 1U}, {2U, 3U}}) {
    const double x = meshes[west].bounds().max.x;
    const auto wall = testing_support::in_plane(meshes[west], true, x, false);
    EXPECT_GT(wall.size(), 100U);
    EXPECT_TRUE(wall == testing_support::in_plane(meshes[east], true, x, true));
  }
}

TEST_F(ShapedFile, IsNotWrittenWhereItDoesNotFit) {
  job.base_thickness = Millimetres{2.0};
  EXPECT_THAT(shaped_job(job, scratch / "part.ply", {}), FailsWith(meshing::kHollowDoesNotFit));
  EXPECT_FALSE(fs::exists(scratch / "part.ply"));
  EXPECT_FALSE(fs::exists(scratch / "part.certificate.json"));
}

}  // namespace
}  // namespace maquette::tools

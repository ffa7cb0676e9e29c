// SPDX-License-Identifier: GPL-3.0-or-later

// tools/jobs.hpp, solids as their files hold them:
//   bands joined are the whole ............... walls of the files compared to the bit, volumes
//   added
//                                              up; spacings that binary numbers do not hold
//   bands with stones joined ................. the same, each with the stones that it carries
//   a file that rounds ....................... read back: moved as far as the certificate says; not
//                                              written where rounding spoils the mesh
//   a union that is not exact ............... not written: a stone that cuts itself

#include <cmath>
#include <tuple>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/bands.hpp"
#include "meshing/mesh_checks.hpp"
#include "meshing/mesh_io.hpp"
#include "meshing/stones.hpp"
#include "support/matchers.hpp"
#include "support/mesh_properties.hpp"
#include "support/placed_stones.hpp"
#include "support/shapes.hpp"
#include "tools/jobs.hpp"
#include "tools/jobs_shaped.hpp"

namespace maquette::tools {
namespace {

using nlohmann::json;
using testing_support::FailsWith;
using testing_support::in_plane;
using testing_support::random_terrain;
using testing_support::ScratchFolder;
using testing_support::signed_volume_mm3;
using testing_support::Succeeds;

json certificate_of(const fs::path& mesh) {
  return json::parse(
      read_file(mesh.parent_path() / (mesh.stem().string() + ".certificate.json")).value());
}

class BandsJoined : public testing::TestWithParam<std::tuple<double, meshing::BandAxis>> {};
INSTANTIATE_TEST_SUITE_P(Spacings, BandsJoined,
                         testing::Combine(testing::Values(0.1, 0.25, 0.3),
                                          testing::Values(meshing::BandAxis::x,
                                                          meshing::BandAxis::y)));

TEST_P(BandsJoined, AreTheWhole) {
  const ScratchFolder scratch;
  const auto [spacing, axis] = GetParam();
  const bool along_x = axis == meshing::BandAxis::x;
  heightmap::ModelField field =
      random_terrain(4, along_x ? 83 : 211, along_x ? 211 : 83, spacing, 0.3, 0.05);
  field.x0 = Millimetres{-3.7};
  field.y0 = Millimetres{11.3};
  const fs::path design = scratch / "design.tif";
  ASSERT_THAT(heightmap::write_model_field(field, design), Succeeds());
  field = heightmap::read_model_field(design).value();
  const Millimetres base{4.0};
  const meshing::BandSplit split{.axis = axis, .max_width = Millimetres{31 * spacing}};
  const auto bands = meshing::split_into_bands(field, split).value();
  ASSERT_EQ(bands.size(), 7U);
  ASSERT_THAT(mesh_job(design, {}, base, scratch / "whole.ply", {}), Succeeds());
  const json whole = certificate_of(scratch / "whole.ply");

  double volume = 0.0, measured = 0.0;
  TriMesh before;
  for (std::size_t b = 0; b < bands.size(); ++b) {
    SCOPED_TRACE(testing::Message() << "band " << b + 1);
    const fs::path file = scratch / "band.ply";
    ASSERT_THAT(band_job(design, split, b, base, file, {}), Succeeds());
    const json said = certificate_of(file);
    EXPECT_EQ(said["passed"], true);
    EXPECT_EQ(said["proof"], "graph of a height");
    EXPECT_EQ(said["self_intersection_checked"], true);
    EXPECT_EQ(said["hausdorff_bound_mm"], 0.0);
    volume += said["volume_mm3"].get<double>();
    TriMesh mesh = meshing::read_mesh(file).value();
    measured += signed_volume_mm3(mesh);
    const auto found = meshing::check_mesh(mesh).value();
    EXPECT_TRUE(found.passed() && found.self_intersection_checked) << meshing::to_json(found);
    if (b > 0) {
      const double joint = along_x ? field.x_mm(bands[b].first) : field.y_mm(bands[b].first);
      const auto mine = in_plane(mesh, along_x, joint, false);
      EXPECT_EQ(mine.size(), 2U * 82U);
      EXPECT_TRUE(mine == in_plane(before, along_x, joint, true)) << "the wall at " << joint;
    }
    before = std::move(mesh);
  }
  const double all = whole["volume_mm3"].get<double>();
  EXPECT_NEAR(volume, all, 1e-9 * all);
  EXPECT_NEAR(measured, all, 1e-9 * all);
}

class BandsWithStones : public BandsJoined {};
INSTANTIATE_TEST_SUITE_P(Spacings, BandsWithStones,
                         testing::Combine(testing::Values(0.25, 0.3),
                                          testing::Values(meshing::BandAxis::x,
                                                          meshing::BandAxis::y)));

TEST_P(BandsWithStones, AreTheWholeWithStones) {
  const ScratchFolder scratch;
  const auto [spacing, axis] = GetParam();
  const bool along_x = axis == meshing::BandAxis::x;
  heightmap::ModelField field = random_terrain(4, 124, 124, spacing, 0.15, 0.02);
  field.x0 = Millimetres{along_x ? -2.4 : -3.7};
  field.y0 = Millimetres{along_x ? 11.3 : -2.4};
  const fs::path design = scratch / "design.tif", plan = scratch / "stones.json";
  ASSERT_THAT(heightmap::write_model_field(field, design), Succeeds());
  field = heightmap::read_model_field(design).value();
  // Three bands of 41 cells: two stones in the first, none in the second, one in the third.
  std::vector<meshing::PlacedStone> stones(3);
  const double places[3][2] = {{20.0, 30.0}, {18.0, 75.0}, {100.0, 50.0}};
  for (std::size_t i = 0; i < 3; ++i) {
    const double a = places[i][0] * spacing, b = places[i][1] * spacing;
    const double x = field.x0.value() + (along_x ? a : b), y = field.y0.value() + (along_x ? b : a);
    stones[i].number = 11 + static_cast<int>(i);
    stones[i].shape.seed = i + 1;
    stones[i].scale_mm = 12.0 * spacing;
    stones[i].model_from_stone.translation_mm = {x, y, heightmap::height_at(field, x, y)};
  }
  ASSERT_THAT(meshing::write_stone_plan(stones, plan), Succeeds());
  const Millimetres base{8.0};
  const meshing::BandSplit split{.axis = axis, .count = 3};
  ASSERT_THAT(mesh_job(design, plan, base, scratch / "whole.ply", {}), Succeeds());
  const double all = certificate_of(scratch / "whole.ply")["volume_mm3"];

  double volume = 0.0;
  TriMesh before;
  const std::vector<std::vector<int>> on{{11, 12}, {}, {13}};
  for (std::size_t b = 0; b < 3; ++b) {
    SCOPED_TRACE(testing::Message() << "band " << b + 1);
    const fs::path file = scratch / "band.ply";
    ASSERT_THAT(
        shaped_job(
            {.design = design, .stones = plan, .base_thickness = base, .band = BandOf{split, b}},
            file, {}),
        Succeeds());
    const json said = certificate_of(file);
    EXPECT_EQ(said["passed"], true);
    EXPECT_EQ(said["stones"], json(on[b]));
    TriMesh mesh = meshing::read_mesh(file).value();
    volume += signed_volume_mm3(mesh);
    const auto found = meshing::check_mesh(mesh).value();
    EXPECT_TRUE(found.passed() && found.self_intersection_checked) << meshing::to_json(found);
    if (b > 0) {
      const auto line = static_cast<std::ptrdiff_t>(41 * b);
      const double joint = along_x ? field.x_mm(line) : field.y_mm(line);
      const auto mine = in_plane(mesh, along_x, joint, false);
      EXPECT_EQ(mine.size(), 2U * 123U);
      EXPECT_TRUE(mine == in_plane(before, along_x, joint, true)) << "the wall at " << joint;
    }
    before = std::move(mesh);
  }
  // Both unions have their stones' edges on 32-bit places of their own; walls are the same.
  EXPECT_NEAR(volume, all, 1e-6 * all);

  // On a joint it belongs to no band.
  const double at = 41.0 * spacing;
  stones[0].model_from_stone.translation_mm.x = field.x0.value() + (along_x ? at : 15.0);
  stones[0].model_from_stone.translation_mm.y = field.y0.value() + (along_x ? 15.0 : at);
  ASSERT_THAT(meshing::write_stone_plan(stones, plan), Succeeds());
  const auto refused = shaped_job(
      {.design = design, .stones = plan, .base_thickness = base, .band = BandOf{split, 1}},
      scratch / "band.ply", {});
  ASSERT_THAT(refused, FailsWith(meshing::kNotASolid));
  EXPECT_THAT(refused.error().message,
              testing::AllOf(testing::HasSubstr("band 2"), testing::HasSubstr("walls")));
}

TEST(MeshJob, DoesNotWriteAUnionThatIsNotExact) {
  const ScratchFolder scratch;
  const heightmap::ModelField field = random_terrain(8, 101, 101, 0.5, 0.1);
  ASSERT_THAT(heightmap::write_model_field(field, scratch / "design.tif"), Succeeds());
  const std::vector stones{
      testing_support::two_balls_in_one({25, 25, heightmap::height_at(field, 25, 25)})};
  ASSERT_THAT(meshing::write_stone_plan(stones, scratch / "stones.json"), Succeeds());
  const auto refused = mesh_job(scratch / "design.tif", scratch / "stones.json", Millimetres{10},
                                scratch / "surface.ply", {});
  ASSERT_THAT(refused, FailsWith(kSolidInexact));
  EXPECT_THAT(refused.error().message, testing::HasSubstr("from terrain and stones"));
  EXPECT_FALSE(fs::exists(scratch / "surface.ply"));
  EXPECT_FALSE(fs::exists(scratch / "surface.certificate.json"));
  const json said = json::parse(read_file(scratch / "surface.refused.json").value());
  EXPECT_EQ(said["passed"], false);
  EXPECT_EQ(said["self_intersecting"], false);
  EXPECT_GT(said["max_union_error_mm"], 0.02);
}

/// A ball of 20 480 triangles far from the origin, as a PLY.
TriMesh ball_file(const fs::path& path, double radius_mm, Vec3 at) {
  TriMesh ball = testing_support::unit_sphere(5);
  for (Vec3& v : ball.vertices_mm) v = radius_mm * v + at;
  EXPECT_THAT(meshing::write_ply(ball, path), Succeeds());
  return ball;
}

TEST(ExportJob, SaysWhatRoundingLeavesOfAMesh) {
  const ScratchFolder scratch;
  const TriMesh ball = ball_file(scratch / "ball.ply", 20.0, {2000.0, 1900.0, 3.0});
  struct Case {
    const char* format;
    double least_mm, most_mm;  // float32 at 2 m: half of 1.2e-4 on two axes; 3MF up to twice that
  };
  for (const Case& c : {Case{"stl", 4e-5, 1e-4}, Case{"obj", 4e-7, 1e-6}, Case{"3mf", 6e-5, 2e-4},
                        Case{"ply", 0.0, 0.0}, Case{"usda", 4e-5, 1e-4}}) {
    SCOPED_TRACE(c.format);
    ASSERT_THAT(export_job(c.format, scratch / "ball.ply", {}, {}, scratch / "out", {}),
                Succeeds());
    const fs::path file = scratch / (std::string("out/ball.") + c.format);
    const json said = json::parse(read_file(file.string() + ".certificate.json").value());
    EXPECT_EQ(said["passed"], true);
    EXPECT_EQ(said["self_intersection_checked"], true);
    EXPECT_EQ(said["triangles"], ball.triangles.size());
    EXPECT_GE(said["rounding_mm"], c.least_mm);
    EXPECT_LE(said["rounding_mm"], c.most_mm);
    if (std::string(c.format) != "obj" && std::string(c.format) != "ply") continue;
    const TriMesh back = meshing::read_mesh(file).value();
    double moved = 0.0;
    for (std::size_t i = 0; i < back.vertices_mm.size(); ++i)
      moved = std::fmax(moved, norm(back.vertices_mm[i] - ball.vertices_mm[i]));
    EXPECT_NEAR(said["rounding_mm"], moved, 1e-12);
  }
}

// Edges of 1e-4 mm where floats are 1.2e-4 mm apart: some triangles lose their area or fold over.
TEST(ExportJob, GivesAnotherNameToWhatRoundingSpoils) {
  const ScratchFolder scratch;
  ball_file(scratch / "dust.ply", 0.003, {2000.0, 1900.0, 3.0});
  for (const std::string format : {"stl", "3mf"}) {
    SCOPED_TRACE(format);
    const auto result = export_job(format, scratch / "dust.ply", {}, {}, scratch / "out", {});
    ASSERT_THAT(result, Succeeds());
    EXPECT_THAT(result->unmet, testing::HasSubstr("spoil it"));
    EXPECT_FALSE(fs::exists(scratch / ("out/dust." + format)));
    const fs::path file = scratch / ("out/dust.refused." + format);
    EXPECT_TRUE(fs::exists(file));
    const json said = json::parse(read_file(file.string() + ".certificate.json").value());
    EXPECT_EQ(said["passed"], false);
  }
  const auto exact = export_job("ply", scratch / "dust.ply", {}, {}, scratch / "out", {});
  ASSERT_THAT(exact, Succeeds());
  EXPECT_EQ(exact->unmet, "");
}

TEST(ExportJob, WritesNoMeshThatIsNoSolid) {
  const ScratchFolder scratch;
  TriMesh open = testing_support::unit_sphere(2);
  open.triangles.pop_back();
  ASSERT_THAT(meshing::write_ply(open, scratch / "open.ply"), Succeeds());
  const auto refused = export_job("stl", scratch / "open.ply", {}, {}, scratch / "out", {});
  ASSERT_THAT(refused, FailsWith(meshing::kNotASolid));
  EXPECT_THAT(refused.error().message, testing::HasSubstr("it is open"));
}

// Terrain with stones, checked with its design: the terrain's own triangles are known, rounded,
// too.
TEST(ExportJob, ChecksASurfaceWithStones) {
  const ScratchFolder scratch;
  heightmap::ModelField field = random_terrain(8, 101, 101, 0.3, 0.1);
  field.x0 = Millimetres{1700.0};
  ASSERT_THAT(heightmap::write_model_field(field, scratch / "design.tif"), Succeeds());
  field = heightmap::read_model_field(scratch / "design.tif").value();
  meshing::PlacedStone stone;
  stone.number = 1;
  stone.scale_mm = 6.0;
  stone.model_from_stone.translation_mm = {1714.0, 13.0, heightmap::height_at(field, 1714, 13)};
  ASSERT_THAT(meshing::write_stone_plan(std::vector{stone}, scratch / "stones.json"), Succeeds());
  ASSERT_THAT(mesh_job(scratch / "design.tif", scratch / "stones.json", Millimetres{10},
                       scratch / "surface.ply", {}),
              Succeeds());
  ASSERT_THAT(
      export_job("obj", scratch / "surface.ply", scratch / "design.tif", {}, scratch / "out", {}),
      Succeeds());
  const fs::path file = scratch / "out/surface.obj";
  const json said = json::parse(read_file(file.string() + ".certificate.json").value());
  EXPECT_EQ(said["passed"], true);
  const auto found = meshing::check_mesh(meshing::read_mesh(file).value()).value();
  EXPECT_TRUE(found.passed()) << meshing::to_json(found);
  EXPECT_NEAR(said["volume_mm3"], found.volume_mm3, 1e-9 * found.volume_mm3);
}

TEST(ExportJob, CountsWhatThePositionGridOfAGlbSpoils) {
  const ScratchFolder scratch;
  TriMesh mesh = testing_support::unit_sphere(4);
  for (Vec3& v : mesh.vertices_mm) v = 500.0 * v;
  TriMesh small = testing_support::unit_sphere(1);  // 80 triangles within a step of 15 um
  for (Vec3& v : small.vertices_mm) v = 0.003 * v + Vec3{0, 0, 600.0};
  append(mesh, small);
  ASSERT_THAT(meshing::write_ply(mesh, scratch / "mesh.ply"), Succeeds());
  const auto result = export_job("glb", scratch / "mesh.ply", {}, {}, scratch / "out", {});
  ASSERT_THAT(result, Succeeds());
  const json said = json::parse(result->figures_json);
  const TriMesh back = meshing::read_mesh(scratch / "out/mesh.glb").value();
  std::uint64_t flat =
      mesh.triangles.size() - back.triangles.size();  // a reader may leave them out
  for (const auto& t : back.triangles) {
    const Vec3 a = back.vertices_mm[t[0]];
    flat += norm(cross(back.vertices_mm[t[1]] - a, back.vertices_mm[t[2]] - a)) < 1e-12;
  }
  EXPECT_GT(flat, 0U);
  EXPECT_EQ(said["flat_triangles"], flat);
}

}  // namespace
}  // namespace maquette::tools

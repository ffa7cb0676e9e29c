// SPDX-License-Identifier: GPL-3.0-or-later

// tools/jobs.hpp, solids as their files hold them:
//   bands joined are the whole ............... walls of the files compared to the bit, volumes
//   added
//                                              up; spacings that binary numbers do not hold
//   a union that is not exact ............... not written: a stone that cuts itself

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/bands.hpp"
#include "meshing/mesh_checks.hpp"
#include "meshing/mesh_io.hpp"
#include "meshing/stone_body.hpp"
#include "meshing/stones.hpp"
#include "support/matchers.hpp"
#include "support/mesh_properties.hpp"
#include "support/shapes.hpp"
#include "tools/jobs.hpp"

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

class BandsJoined : public testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(Spacings, BandsJoined, testing::Values(0.1, 0.25, 0.3));

TEST_P(BandsJoined, AreTheWhole) {
  const ScratchFolder scratch;
  heightmap::ModelField field = random_terrain(4, 211, 83, GetParam(), 0.3, 0.05);
  field.x0 = Millimetres{-3.7};
  field.y0 = Millimetres{11.3};
  const fs::path design = scratch / "design.tif";
  ASSERT_THAT(heightmap::write_model_field(field, design), Succeeds());
  field = heightmap::read_model_field(design).value();
  const Millimetres width{31 * GetParam()}, base{4.0};
  const auto bands = meshing::split_into_bands(field, meshing::BandAxis::y, width).value();
  ASSERT_EQ(bands.size(), 7U);
  ASSERT_THAT(mesh_job(design, {}, base, scratch / "whole.ply", {}), Succeeds());
  const json whole = certificate_of(scratch / "whole.ply");

  double volume = 0.0, measured = 0.0;
  TriMesh south;
  for (std::size_t b = 0; b < bands.size(); ++b) {
    SCOPED_TRACE(testing::Message() << "band " << b + 1);
    const fs::path file = scratch / "band.ply";
    ASSERT_THAT(band_job(design, width, b, base, file, {}), Succeeds());
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
      const double joint = field.y_mm(bands[b].first);
      const auto mine = in_plane(mesh, false, joint, false);
      EXPECT_EQ(mine.size(), 2U * 82U);
      EXPECT_TRUE(mine == in_plane(south, false, joint, true)) << "the wall at y = " << joint;
    }
    south = std::move(mesh);
  }
  const double all = whole["volume_mm3"].get<double>();
  EXPECT_NEAR(volume, all, 1e-9 * all);
  EXPECT_NEAR(measured, all, 1e-9 * all);
}

/// Two balls in one, so that only a level set with a fillet unites it with terrain.
meshing::PlacedStone that_cuts_itself(Vec3 at) {
  auto body = std::make_shared<meshing::StoneBody>();
  body->name = body->source = "two";
  body->mesh = testing_support::unit_sphere(3);
  for (Vec3& v : body->mesh.vertices_mm) v = 0.5 * v;
  TriMesh second = testing_support::unit_sphere(3);
  for (Vec3& v : second.vertices_mm) v = 0.2 * v + Vec3{0.4, 0.05, 0.1};
  append(body->mesh, second);
  meshing::PlacedStone stone;
  stone.number = 1;
  stone.body = body;
  stone.scale_mm = 12.0;
  stone.model_from_stone.translation_mm = at;
  return stone;
}

TEST(MeshJob, DoesNotWriteAUnionThatIsNotExact) {
  const ScratchFolder scratch;
  const heightmap::ModelField field = random_terrain(8, 101, 101, 0.5, 0.1);
  ASSERT_THAT(heightmap::write_model_field(field, scratch / "design.tif"), Succeeds());
  const std::vector stones{that_cuts_itself({25, 25, heightmap::height_at(field, 25, 25)})};
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

}  // namespace
}  // namespace maquette::tools

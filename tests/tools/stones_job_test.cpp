// SPDX-License-Identifier: GPL-3.0-or-later

// tools/jobs.hpp, stones_job: what lies in stones.json at the end, whatever the site asks for:
//   no two stones overlap .................... discs from all vertices of the final bodies; the
//                                              bodies in one mesh do not cut each other (CGAL)
//   settled stones ........................... the same; nothing in the ground once they are raised
//   no count given ........................... as many as the law has on the area; more than can be
//                                              drawn, none

#include <cmath>
#include <numbers>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/mesh_checks.hpp"
#include "meshing/stones.hpp"
#include "support/matchers.hpp"
#include "tools/jobs.hpp"
#include "tools/site.hpp"

namespace maquette::tools {
namespace {

using nlohmann::json;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

/// A square of waves, in the frame of a site's design: (0, 0) is its south-western corner.
heightmap::ModelField waves(double size_mm, double spacing_mm, double height_mm) {
  const auto nodes = static_cast<std::ptrdiff_t>(std::lround(size_mm / spacing_mm)) + 1;
  heightmap::ModelField f{Grid<float>(nodes, nodes), Millimetres{spacing_mm}, Millimetres{0},
                          Millimetres{0}};
  for (std::ptrdiff_t r = 0; r < nodes; ++r)
    for (std::ptrdiff_t c = 0; c < nodes; ++c)
      f.z_mm(r, c) = static_cast<float>(
          height_mm * (2.0 + std::sin(0.21 * f.x_mm(c)) + std::sin(0.17 * f.y_mm(r))));
  return f;
}

/// Seen from above, about the stone's place; a circle holds the body in whatever pose it is.
struct Seen {
  double x_mm, y_mm, radius_mm;
};
Seen seen(const meshing::PlacedStone& stone, const TriMesh& mesh) {
  const Vec3 at = stone.model_from_stone.translation_mm;
  double radius = 0.0;
  for (const Vec3& v : mesh.vertices_mm) radius = std::fmax(radius, norm(v - at));
  return {at.x, at.y, radius};
}

void expect_apart(const std::vector<meshing::PlacedStone>& stones) {
  std::vector<Seen> discs;
  TriMesh all;
  for (const auto& s : stones) {
    const TriMesh mesh = meshing::stone_mesh(s);
    discs.push_back(seen(s, mesh));
    const auto first = static_cast<std::uint32_t>(all.vertices_mm.size());
    all.vertices_mm.insert(all.vertices_mm.end(), mesh.vertices_mm.begin(), mesh.vertices_mm.end());
    for (const auto& t : mesh.triangles)
      all.triangles.push_back({t[0] + first, t[1] + first, t[2] + first});
  }
  for (std::size_t i = 0; i < stones.size(); ++i)
    for (std::size_t j = 0; j < i; ++j)
      EXPECT_GT(std::hypot(discs[i].x_mm - discs[j].x_mm, discs[i].y_mm - discs[j].y_mm),
                discs[i].radius_mm + discs[j].radius_mm)
          << "stones " << stones[j].number << " and " << stones[i].number;
  const auto found = meshing::check_mesh(all);
  ASSERT_THAT(found, Succeeds());
  EXPECT_EQ(found->shells, stones.size());
  EXPECT_TRUE(found->self_intersection_checked);
  EXPECT_FALSE(found->self_intersecting);
}

class StonesOfASite : public testing::TestWithParam<std::int64_t> {
 protected:
  StonesOfASite() {
    site.scales = {1000.0};
    site.size_mm = 50.0;
    site.spacing_mm = 0.5;
    site.seed = GetParam();
    site.stone_count = 80;
    site.stone_k = 0.3;
  }
  Result<JobResult> lay(double height_mm) {
    const fs::path design = scratch / "design.tif";
    EXPECT_THAT(
        heightmap::write_model_field(waves(site.size_mm, site.spacing_mm, height_mm), design),
        Succeeds());
    return stones_job(site, 1000.0, {.designs = {design}}, scratch.path(), {});
  }
  [[nodiscard]] std::vector<meshing::PlacedStone> placed() const {
    return meshing::read_stone_plan(scratch / "stones.json").value();
  }
  ScratchFolder scratch;
  Site site;
};
INSTANTIATE_TEST_SUITE_P(Seeds, StonesOfASite, testing::Range<std::int64_t>(1, 4));

// Angular stones reach up to 1.36 times as far as those of the shapes that are drawn: discs of
// these, which the plan once took, overlap on all of these sites, 4 to 6 pairs each.
TEST_P(StonesOfASite, LieApartHoweverAngularTheyAre) {
  for (const double angularity : {0.0, 0.6, 1.0}) {
    SCOPED_TRACE(testing::Message() << "angularity " << angularity);
    site.stone_angularity = angularity;
    ASSERT_THAT(lay(0.2), Succeeds());
    const auto stones = placed();
    ASSERT_EQ(stones.size(), 80U);
    for (const auto& s : stones) EXPECT_EQ(s.shape.angularity, angularity);
    expect_apart(stones);
  }
}

TEST_P(StonesOfASite, SettleApartAndOnTheGround) {
  site.stone_rest = "settled";
  site.stone_count = 25;
  site.stone_angularity = 0.8;
  site.stone_embedded_share = 0.0;
  ASSERT_THAT(lay(0.4), Succeeds());
  const auto ground = heightmap::read_model_field(scratch / "design.tif").value();
  const auto stones = placed();
  ASSERT_EQ(stones.size(), 25U);
  expect_apart(stones);
  for (const auto& s : stones) {
    double least = INFINITY;
    for (const Vec3& v : meshing::stone_mesh(s).vertices_mm)
      least = std::fmin(least, v.z - heightmap::height_at(ground, v.x, v.y));
    EXPECT_GE(least, -2e-6) << s.number;  // kSunken_mm, and rounding
    EXPECT_LE(least, 0.05) << s.number;   // nodes of the ground may hold it under its facets
  }
}

TEST_P(StonesOfASite, AreAsManyAsTheLawHasWhereNoCountIsGiven) {
  site.stone_count = Site{}.stone_count;
  site.stone_k = 0.1;
  site.stone_min_diameter_m = 1.0;
  site.stone_max_diameter_m = 4.0;
  ASSERT_THAT(lay(0.1), Succeeds());
  // Sum of n(D) = k q exp(-q D) / (pi D^2 / 4) over 50 m x 50 m, by the trapezoid rule.
  const double q = 1.79 + 0.152 / 0.1;
  double expected = 0.0;
  constexpr int kSteps = 30000;
  for (int i = 0; i <= kSteps; ++i) {
    const double d = 1.0 + 3.0 * i / kSteps;
    expected += (i == 0 || i == kSteps ? 0.5 : 1.0) * 0.1 * q * std::exp(-q * d) /
                (0.25 * std::numbers::pi * d * d) * (3.0 / kSteps) * 2500.0;
  }
  EXPECT_GT(expected, 5.0);
  EXPECT_EQ(placed().size(), static_cast<std::size_t>(std::lround(expected)));
}

TEST(StonesByTheLaw, AreRefusedWhereTheyAreTooMany) {
  const ScratchFolder scratch;
  Site site;
  site.scales = {1000.0};
  site.size_mm = 2000.0;
  site.stone_min_diameter_m = 0.05;
  EXPECT_THAT(stones_job(site, 1000.0, {.designs = {scratch / "none.tif"}}, scratch.path(), {}),
              FailsWith(meshing::kStonesDoNotFit));
}

}  // namespace
}  // namespace maquette::tools

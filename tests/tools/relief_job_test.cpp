// SPDX-License-Identifier: GPL-3.0-or-later

// tools/jobs_offset.hpp with stones as relief: balls sunk into a plane, against closed forms.
//   relief ................. sphere and plane at every node; what it says it added
//   fillet ................. the round of a ball that touches plane and sphere; the volume it adds;
//                            the solid's volume
//   offset outwards ........ sphere and plane, each moved
//   offset inwards ......... the same, and the round about the circle where they meet
//   a stone that sticks out  refused with its number

#include <cmath>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/solid.hpp"
#include "support/matchers.hpp"
#include "support/placed_stones.hpp"
#include "tools/jobs.hpp"
#include "tools/jobs_offset.hpp"
#include "tools/solid_base.hpp"

namespace maquette::tools {
namespace {

using heightmap::ModelField;
using nlohmann::json;
using std::numbers::pi;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

constexpr double kSpacing = 0.25, kBall = 10.0, kMiddle = 25.0;
/// Of facets over a ball: s^2 / (8 R) across an edge, twice in a cell; and the stone's own.
constexpr double kFacets = 2.0 * kSpacing * kSpacing / (8.0 * kBall) + 1e-3;

class BallOnPlane : public testing::Test {
 protected:
  /// @param height  of the ball's middle over the plane
  void make(double height) {
    const ModelField plane{Grid<float>(201, 201, 0.0F), Millimetres{kSpacing}, Millimetres{0},
                           Millimetres{0}};
    ASSERT_THAT(heightmap::write_model_field(plane, design), Succeeds());
    TriMesh ball = testing_support::unit_sphere(6);
    for (Vec3& v : ball.vertices_mm) v = 0.5 * v;
    ASSERT_THAT(meshing::write_stone_plan(std::vector{testing_support::placed_body(
                                              5, ball, 2.0 * kBall, {kMiddle, kMiddle, height})},
                                          stones),
                Succeeds());
    const auto made = relief_job(design, stones, relief, {});
    ASSERT_THAT(made, Succeeds());
    said = json::parse(made->figures_json);
  }
  /// Calls visit(distance from the ball's axis, height) at all nodes.
  template <class Visit>
  static void nodes(const fs::path& file, Visit&& visit) {
    const ModelField f = heightmap::read_model_field(file).value();
    for (std::ptrdiff_t r = 0; r < f.z_mm.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < f.z_mm.cols(); ++c)
        visit(std::hypot(f.x_mm(c) - kMiddle, f.y_mm(r) - kMiddle),
              static_cast<double>(f.z_mm(r, c)));
  }
  ScratchFolder scratch;
  const fs::path design = scratch / "design.tif", stones = scratch / "stones.json",
                 relief = scratch / "relief.tif";
  json said;
};

/// Of a body of revolution above the plane.
template <class Height>
double volume_mm3(double from, double to, Height&& height) {
  constexpr int kSteps = 20000;
  double sum = 0.0;
  for (int i = 0; i < kSteps; ++i) {
    const double rho = from + (to - from) * (i + 0.5) / kSteps;
    sum += 2.0 * pi * rho * height(rho);
  }
  return sum * (to - from) / kSteps;
}

TEST_F(BallOnPlane, IsSeenFromAbove) {
  make(-6.0);
  nodes(relief, [](double rho, double z) {
    const double known = rho < 8.0 ? std::sqrt(100.0 - rho * rho) - 6.0 : 0.0;
    ASSERT_NEAR(z, known, kFacets) << rho;
  });
  const double cap = pi * 16.0 * (3.0 * kBall - 4.0) / 3.0;
  EXPECT_NEAR(said["added_mm3"], cap, 2e-3 * cap);
  EXPECT_NEAR(said["most_mm"], 4.0, 1e-3);
  EXPECT_EQ(said["stones"], 1);
}

TEST_F(BallOnPlane, GetsTheRoundOfTheCutter) {
  make(-6.0);
  constexpr double kCutter = 4.0;
  // A ball on the plane that touches the sphere: its axis, and where it leaves the one for the
  // other.
  const double axis = std::sqrt(14.0 * 14.0 - 10.0 * 10.0), from = axis * kBall / 14.0;
  const auto before = [](double rho) {
    return rho < 8.0 ? std::sqrt(100.0 - rho * rho) - 6.0 : 0.0;
  };
  const auto known = [&](double rho) {
    if (rho <= from || rho >= axis) return before(rho);
    return kCutter - std::sqrt(kCutter * kCutter - (rho - axis) * (rho - axis));
  };
  const fs::path file = scratch / "fillet.tif";
  const auto made = fillet_job(relief, Millimetres{kCutter}, file, {});
  ASSERT_THAT(made, Succeeds());
  double most = 0.0;
  nodes(file, [&](double rho, double z) {
    // What is left less than 0.02 mm stays, and the search may end so much too high (fillet.hpp).
    ASSERT_NEAR(z, known(rho), 0.02 + kFacets) << rho;
    most = std::fmax(most, z - before(rho));
  });
  EXPECT_NEAR(most, known(8.0), 0.05);  // in the corner itself, where no node lies
  const double added = volume_mm3(from, axis, [&](double rho) {
    const double rise = known(rho) - before(rho);
    return rise > 0.02 ? rise : 0.0;
  });
  EXPECT_NEAR(json::parse(made->figures_json)["added_mm3"], added, 0.03 * added);
  ASSERT_THAT(mesh_job(file, {}, Millimetres{10.0}, scratch / "part.ply", {}), Succeeds());
  const double cap = pi * 16.0 * (3.0 * kBall - 4.0) / 3.0;
  const json solid = json::parse(read_file(certificate_path(scratch / "part.ply")).value());
  EXPECT_NEAR(solid["volume_mm3"].get<double>() - 50.0 * 50.0 * 10.0, cap + added,
              0.01 * (cap + added));
}

TEST_F(BallOnPlane, GrowsAsSphereAndPlaneDo) {
  make(0.0);  // a hemisphere
  ASSERT_THAT(offset_job(relief, Millimetres{3.0}, scratch / "grown.tif", {}), Succeeds());
  const double corner = std::sqrt(13.0 * 13.0 - 9.0);
  nodes(scratch / "grown.tif", [&](double rho, double z) {
    if (rho > corner) {
      ASSERT_NEAR(z, 3.0, 1e-5) << rho;
    } else {
      // Facets get longer by the slope: s^2 / (8 R cos^2), twice in a cell.
      const double longer = 13.0 * kSpacing / z;
      ASSERT_NEAR(std::hypot(rho, z), 13.0, longer * longer / (4.0 * kBall) + 1e-3) << rho;
    }
  });
}

TEST_F(BallOnPlane, ShrinksAsSphereAndPlaneDo) {
  make(0.0);
  ASSERT_THAT(offset_job(relief, Millimetres{-3.0}, scratch / "shrunk.tif", {}), Succeeds());
  nodes(scratch / "shrunk.tif", [&](double rho, double z) {
    // From the circle where both meet the surface keeps off, too; its facets lie a cell beside it.
    const double off = rho < 7.0    ? std::hypot(rho, z) - 7.0
                       : rho < 10.0 ? std::hypot(10.0 - rho, z) - 3.0
                                    : z + 3.0;
    const double longer = 7.0 * kSpacing / z;  // facets, as above
    const double facets = longer * longer / (4.0 * kBall) + 1e-3;
    ASSERT_NEAR(off, 0.0, rho < 5.0 ? facets : rho < 10.0 + kSpacing ? kSpacing : 1e-5) << rho;
  });
}

TEST_F(BallOnPlane, IsRefusedWhereItSticksOut) {
  make(0.0);
  TriMesh ball = testing_support::unit_sphere(2);
  for (Vec3& v : ball.vertices_mm) v = 0.5 * v;
  ASSERT_THAT(
      meshing::write_stone_plan(
          std::vector{testing_support::placed_body(7, ball, 4.0, {1.5, 20.0, 0.0})}, stones),
      Succeeds());
  const auto refused = relief_job(design, stones, scratch / "other.tif", {});
  ASSERT_THAT(refused, FailsWith(meshing::kNotASolid));
  EXPECT_THAT(refused.error().message, testing::HasSubstr("stone 7"));
  EXPECT_FALSE(fs::exists(scratch / "other.tif"));
}

}  // namespace
}  // namespace maquette::tools

// SPDX-License-Identifier: GPL-3.0-or-later

// Stones in the diagnosis. What is hidden is made here from formulas: ellipsoids on waves, rays of
// two scanners met with them in closed form, noise along the ray. The diagnosis has their
// tessellation (true to 1 um) in a plan, the waves at nodes, and the points.
//
//   as planned ............................ no claim
//   one moved and turned .................. stone.pose of that stone, within its errors; no other
//   one left out .......................... stone.missing
//   both .................................. both
//   all 2 % smaller, on the same seats .... stone.shrink and nothing else, share within its errors
//   all 0.1 mm thicker .................... stone.shrink by a length; a film is said to look alike
//   thicker by the coat that is declared .. no claim
//   another body in a stone's place ....... unexplained
//   machine's x scale, seats with it ...... machine.scale_x and no stone
//   what was found, as extended.toml ...... consistent

#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "diagnosis/controls.hpp"
#include "diagnosis/diagnose.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/stones.hpp"
#include "scan/cloud.hpp"
#include "support/matchers.hpp"

namespace maquette::diagnosis {
namespace {

using testing_support::ScratchFolder;
using testing_support::Succeeds;

constexpr double kSide_mm = 120.0, kSigma_mm = 0.03;
constexpr std::size_t kPoints = 60'000;

double wave(double x, double y) {
  return 4.0 + 2.5 * std::sin(x / 17.0) * std::cos(y / 23.0) + 1.2 * std::sin((x + 2.0 * y) / 31.0);
}

/// Semi-axes across, along and upwards, centre, heading.
struct Ellipsoid {
  Vec3 half_mm, centre_mm;
  Quaternion turn;
  /// Along a ray to its near side; none: it passes.
  [[nodiscard]] std::optional<double> met(Vec3 from, Vec3 way) const {
    const auto in = [&](Vec3 v) {
      const Vec3 w = rotate({turn.w, -turn.x, -turn.y, -turn.z}, v);
      return Vec3{w.x / half_mm.x, w.y / half_mm.y, w.z / half_mm.z};
    };
    const Vec3 o = in(from - centre_mm), d = in(way);
    const double a = dot(d, d), b = dot(o, d), root = b * b - a * (dot(o, o) - 1.0);
    if (!(root > 0.0)) return std::nullopt;
    return (-b - std::sqrt(root)) / a;
  }
};

/// A mesh of the unit sphere's latitudes and longitudes, stretched; its vertices lie as far outside
/// as the facets' middles lie inside.
TriMesh tessellated(Vec3 half) {
  constexpr int kRings = 90, kRound = 180;
  const double out = 0.5 + 0.5 / std::cos(std::numbers::pi / kRound);
  TriMesh mesh;
  const auto at = [&](double lat, double lon) {
    mesh.vertices_mm.push_back({out * half.x * std::cos(lat) * std::cos(lon),
                                out * half.y * std::cos(lat) * std::sin(lon),
                                out * half.z * std::sin(lat)});
  };
  at(-0.5 * std::numbers::pi, 0.0);
  for (int r = 1; r < kRings; ++r)
    for (int k = 0; k < kRound; ++k)
      at(std::numbers::pi * (static_cast<double>(r) / kRings - 0.5),
         2.0 * std::numbers::pi * k / kRound);
  at(0.5 * std::numbers::pi, 0.0);
  const auto index = [](int r, int k) {
    return static_cast<std::uint32_t>(1 + (r - 1) * kRound + k % kRound);
  };
  const auto top = static_cast<std::uint32_t>(mesh.vertices_mm.size() - 1);
  for (int k = 0; k < kRound; ++k) {
    mesh.triangles.push_back({0, index(1, k + 1), index(1, k)});
    mesh.triangles.push_back({top, index(kRings - 1, k), index(kRings - 1, k + 1)});
    for (int r = 1; r + 1 < kRings; ++r) {
      mesh.triangles.push_back({index(r, k), index(r, k + 1), index(r + 1, k + 1)});
      mesh.triangles.push_back({index(r, k), index(r + 1, k + 1), index(r + 1, k)});
    }
  }
  return mesh;
}

struct World {
  ScratchFolder folder;
  CaseInput input;
  std::vector<Ellipsoid> stones;
  double coat_mm = 0.0;    ///< on the ground, as declared
  double stretch_x = 0.0;  ///< by the machine
  std::uint64_t seed = 1;

  explicit World(std::uint64_t with_seed = 1) : seed(with_seed) {
    heightmap::ModelField ground{Grid<float>(241, 241), Millimetres{0.5}};
    for (std::ptrdiff_t r = 0; r < 241; ++r)
      for (std::ptrdiff_t c = 0; c < 241; ++c)
        ground.z_mm(r, c) = static_cast<float>(wave(ground.x_mm(c), ground.y_mm(r)));
    std::vector<meshing::PlacedStone> plan;
    for (int k = 0; k < 6; ++k) {
      const double size = 4.5 + 0.7 * k;
      const double x = 22.0 + 37.0 * (k % 3), y = 32.0 + 55.0 * (k / 3);
      Ellipsoid e{{size, 0.75 * size, 0.6 * size},
                  {x, y, wave(x, y) + 0.35 * size},
                  rotation_about({0, 0, 1}, 0.5 * k)};
      meshing::PlacedStone s;
      s.number = k + 1;
      auto body = std::make_shared<meshing::StoneBody>();
      body->name = fmt::format("ellipsoid_{}", k + 1);
      const double scale = 2.0 * size;
      body->mesh = tessellated((1.0 / scale) * e.half_mm);
      body->source = "formula";
      body->diameter_mm = scale;
      s.body = body;
      s.scale_mm = scale;
      s.model_from_stone = {e.turn, e.centre_mm};
      plan.push_back(s);
      stones.push_back(e);
    }
    input.ground = folder / "ground.tif";
    input.design = folder / "design.tif";
    input.stones = folder / "stones.json";
    EXPECT_THAT(heightmap::write_model_field(ground, input.ground), Succeeds());
    EXPECT_THAT(heightmap::write_model_field(meshing::with_stones(ground, plan), input.design),
                Succeeds());
    EXPECT_THAT(meshing::write_stone_plan(plan, input.stones), Succeeds());
    input.coat_sigma_mm = 0.0;
  }

  void scan() {
    for (const Vec3 station : {Vec3{60, -500, 550}, Vec3{600, 60, 500}}) {
      const auto number = input.scans.size();
      const std::uint64_t key = mix64(seed * 100 + number);
      scan::Cloud cloud;
      for (std::uint64_t i = 0; cloud.points_mm.size() < kPoints; ++i) {
        const Vec3 aim{kSide_mm * random_uniform(key, 2 * i),
                       kSide_mm * random_uniform(key, 2 * i + 1), 6.0};
        const Vec3 way = normalized(aim - station);
        // Down through the waves: steps, then halves.
        const auto over = [&](double t) {
          const Vec3 p = station + t * way;
          return p.z - wave(p.x / (1.0 + stretch_x), p.y) - coat_mm;
        };
        double low = (14.0 - station.z) / way.z, high = low;
        while (over(high) > 0.0) low = high, high += 0.2;
        for (int k = 0; k < 40; ++k)
          (over(0.5 * (low + high)) > 0.0 ? low : high) = 0.5 * (low + high);
        double t = high;
        for (const Ellipsoid& e : stones)
          if (const auto met = e.met(station, way); met && *met < t) t = *met;
        const Vec3 p = station + (t + kSigma_mm * random_normal(key + 1, i)) * way;
        if (p.x > 0 && p.x < kSide_mm && p.y > 0 && p.y < kSide_mm) cloud.points_mm.push_back(p);
      }
      // Its file is a little wrong.
      const RigidTransform off{rotation_about({0, 0, 1}, 2e-4), {0.05, -0.03, 0.02}};
      for (Vec3& p : cloud.points_mm) p = off.point(p);
      const auto file = folder / fmt::format("scan{}.ply", number);
      EXPECT_THAT(scan::write_cloud(cloud, file), Succeeds());
      input.scans.push_back({file, off.point(station), kSigma_mm});
    }
  }

  Result<Diagnosis> result() {
    if (input.scans.empty()) scan();
    auto m = measure(input);
    if (!m) return tl::unexpected(m.error());
    return diagnose(std::move(*m), 1);
  }
};

std::vector<std::string> names_of(const Diagnosis& d) {
  std::vector<std::string> names;
  for (const Cause& c : d.causes)
    names.push_back(c.law.starts_with("stone ") ? c.effect + " " + c.law : c.effect);
  return names;
}

using testing::ElementsAre;

const Estimate& parameter(const Cause& c, const std::string& name) {
  for (const Estimate& e : c.parameters)
    if (e.name == name) return e;
  ADD_FAILURE() << c.effect << " has no " << name;
  return c.parameters.front();
}

/// Four standard deviations, and the tessellation.
void expect_within(const Estimate& e, double truth, double tessellation) {
  EXPECT_NEAR(e.value, truth, 4.0 * e.sigma + tessellation) << e.name << " +- " << e.sigma;
}

void move_second(World& w) {
  w.stones[1].centre_mm += Vec3{0.3, -0.2, 0.15};
  w.stones[1].turn = rotation_about({0, 0, 1}, 0.05) * w.stones[1].turn;
}

TEST(Stones, AsPlannedNothingIsClaimed) {
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    World w(seed);
    const auto d = w.result();
    ASSERT_THAT(d, Succeeds());
    EXPECT_EQ(d->verdict, "consistent") << "seed " << seed;
    EXPECT_THAT(names_of(*d), ElementsAre()) << "seed " << seed;
    ASSERT_TRUE(d->stones);
    EXPECT_EQ(d->stones->states.size(), 6U);
    EXPECT_TRUE(d->untestable.size() < library().size());
  }
}

TEST(Stones, OneThatMovedIsNamed) {
  World w(2);
  move_second(w);
  const auto d = w.result();
  ASSERT_THAT(d, Succeeds());
  ASSERT_THAT(names_of(*d), ElementsAre("stone.pose stone 2"));
  EXPECT_EQ(d->verdict, "explained");
  const Cause& c = d->causes[0];
  expect_within(parameter(c, "dx_mm"), 0.3, 0.002);
  expect_within(parameter(c, "dy_mm"), -0.2, 0.002);
  expect_within(parameter(c, "dz_mm"), 0.15, 0.002);
  expect_within(parameter(c, "turn_z_mrad"), 50.0, 0.5);
  EXPECT_LT(parameter(c, "dx_mm").sigma, 0.02);
  EXPECT_LT(d->stones->rms_after, 0.9 * d->stones->rms_before);

  // What was found is the model now.
  CaseInput again = w.input;
  KnownCause known{c.effect, c.law, {}, c.fixed};
  for (const Estimate& e : c.parameters) known.parameters.emplace_back(e.name, e.value);
  again.known = {known};
  auto m = measure(again);
  ASSERT_THAT(m, Succeeds());
  const auto second = diagnose(std::move(*m), 1);
  ASSERT_THAT(second, Succeeds());
  EXPECT_THAT(names_of(*second), ElementsAre());
}

TEST(Stones, OneLeftOutIsMissingAndControlsPass) {
  World w(3);
  move_second(w);
  w.stones.erase(w.stones.begin() + 3);
  w.scan();
  auto m = measure(w.input);
  ASSERT_THAT(m, Succeeds());
  const auto d = diagnose(*m, 1);
  ASSERT_THAT(d, Succeeds());
  EXPECT_THAT(names_of(*d), ElementsAre("stone.pose stone 2", "stone.missing stone 4"));
  const auto c = controls(*m, *d, 1);
  ASSERT_THAT(c, Succeeds());
  EXPECT_TRUE(c->passed());
  EXPECT_EQ(c->recoveries.size(), 2U);
}

TEST(Stones, AllSmallerOnTheirSeatsHaveShrunk) {
  World w(4);
  for (Ellipsoid& e : w.stones) {
    e.centre_mm.z -= 0.02 * e.half_mm.z;
    e.half_mm = 0.98 * e.half_mm;
  }
  const auto d = w.result();
  ASSERT_THAT(d, Succeeds());
  ASSERT_THAT(names_of(*d), ElementsAre("stone.shrink"));
  expect_within(parameter(d->causes[0], "share"), -0.02, 2e-4);
  EXPECT_LT(parameter(d->causes[0], "share").sigma, 2e-3);
  EXPECT_NEAR(d->causes[0].fixed[0].second, 1.0, 0.3) << "they stand on their lowest point";
}

TEST(Stones, AllThickerMayBeAFilm) {
  World w(5);
  for (Ellipsoid& e : w.stones) e.half_mm += Vec3{0.1, 0.1, 0.1};
  const auto d = w.result();
  ASSERT_THAT(d, Succeeds());
  ASSERT_THAT(names_of(*d), ElementsAre("stone.shrink"));
  // An ellipsoid with longer axes is thicker by a length all over only to second order.
  expect_within(parameter(d->causes[0], "outwards_mm"), 0.1, 0.005);
  EXPECT_THAT(d->causes[0].equivalent, ElementsAre("coating.thickness"));

  // With that coat on the ground, and declared, it is the coat.
  World coated(6);
  coated.input.coat_mm = 0.1;
  coated.coat_mm = 0.1;  // upwards: the waves are flat
  for (Ellipsoid& e : coated.stones) e.half_mm += Vec3{0.1, 0.1, 0.1};
  const auto none = coated.result();
  ASSERT_THAT(none, Succeeds());
  for (const Cause& c : none->causes) EXPECT_FALSE(c.effect.starts_with("stone.")) << c.law;
}

TEST(Stones, AnotherBodyIsUnexplained) {
  World w(7);
  w.stones[4].half_mm = {7.5, 2.5, 2.0};
  const auto d = w.result();
  ASSERT_THAT(d, Succeeds());
  EXPECT_EQ(d->verdict, "unexplained");
  EXPECT_THAT(names_of(*d), ElementsAre());
}

TEST(Stones, SeatsGoWithTheMachine) {
  World w(8);
  w.stretch_x = 2e-3;
  for (Ellipsoid& e : w.stones) e.centre_mm.x *= 1.002;
  const auto d = w.result();
  ASSERT_THAT(d, Succeeds());
  for (const Cause& c : d->causes) EXPECT_FALSE(c.effect.starts_with("stone.")) << c.law;
}

}  // namespace
}  // namespace maquette::diagnosis

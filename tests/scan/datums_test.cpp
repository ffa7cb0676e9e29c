// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in scan/datums.hpp: a part with bare pads, spheres and dowels gets an even coat
// of 0.25 mm and is scanned. Best fit moves the coat away; the registration on datums does not,
// finds the true pose within its covariance, and says what the best fit absorbed.

#include "scan/datums.hpp"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "scan/deviate.hpp"
#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;
using testing_support::FailsWith;
using testing_support::points_on;
using testing_support::random_pose;
using testing_support::rough_part;
using testing_support::seen_from;
using testing_support::Succeeds;

struct Coated {
  ModelField part;
  std::vector<Datum> datums;
  Cloud truth;
};

Coated coated_part(std::uint64_t seed) {
  Coated c{rough_part(seed, 201, 201, 1.0, 0.3), {}, {}};
  const auto pad = [&](const char* name, double x, double y) {
    Datum d;
    d.name = name;
    d.at_mm = {x, y, 0.0};
    d.half_x_mm = d.half_y_mm = 12.0;
    c.datums.push_back(d);
  };
  pad("pad 1", 20.0, 20.0);
  pad("pad 2", 180.0, 20.0);
  pad("pad 3", 100.0, 180.0);
  const auto other = [&](Datum::Kind kind, const char* name, Vec3 at) {
    Datum d;
    d.kind = kind;
    d.name = name;
    d.at_mm = at;
    d.radius_mm = 8.0;
    d.length_mm = kind == Datum::Kind::dowel ? 25.0 : 0.0;
    c.datums.push_back(d);
  };
  other(Datum::Kind::sphere, "sphere", {-30.0, 100.0, 30.0});
  other(Datum::Kind::dowel, "dowel", {230.0, 150.0, 5.0});
  c.truth = points_on(c.part, 40'000, seed, 0.03);
  for (Vec3& p : c.truth.points_mm) {
    bool bare = false;
    for (const Datum& d : c.datums)
      bare = bare || (d.kind == Datum::Kind::pad && std::abs(p.x - d.at_mm.x) < 14.0 &&
                      std::abs(p.y - d.at_mm.y) < 14.0);
    if (!bare) p.z += 0.25;
  }
  for (std::uint64_t i = 0; i < 3'000; ++i) {
    const Vec3 u = normalized(Vec3{random_normal(seed, 3 * i), random_normal(seed, 3 * i + 1),
                                   std::abs(random_normal(seed, 3 * i + 2))});
    const double r = 8.0 + 0.03 * random_normal(seed + 7, i);
    c.truth.points_mm.push_back(c.datums[3].at_mm + r * u);
    const double angle = 6.28 * random_uniform(seed + 8, i);
    c.truth.points_mm.push_back(c.datums[4].at_mm + Vec3{r * std::cos(angle), r * std::sin(angle),
                                                         25.0 * random_uniform(seed + 9, i)});
  }
  return c;
}

TEST(Datums, KeepTheCoatThatABestFitTakesAway) {
  double chi2 = 0.0;
  for (std::uint64_t seed = 1; seed <= 6; ++seed) {
    const Coated c = coated_part(seed);
    const RigidTransform pose = random_pose(seed, {100.0, 100.0, 10.0}, 0.01, 2.0);
    const Cloud seen = seen_from(c.truth, pose);
    const auto best = register_scan(seen, c.part);
    ASSERT_THAT(best, Succeeds());
    const auto on = register_datums(seen, c.part, c.datums, best->model_from_scan);
    ASSERT_THAT(on, Succeeds()) << "seed " << seed;
    ASSERT_EQ(on->datums.size(), 5U);
    for (const DatumFit& f : on->datums) {
      EXPECT_GT(f.points, 400U) << f.name;
      EXPECT_NEAR(f.mean_mm, 0.0, 0.01) << f.name;
      EXPECT_NEAR(f.noise_mm, 0.03, 0.006) << f.name;
    }
    const RigidTransform error = on->registration.model_from_scan * pose;
    const Vec3 off = error.point(on->registration.centre_mm) - on->registration.centre_mm;
    for (const auto& [e, k] : {std::pair{off.x, 0U}, {off.y, 7U}, {off.z, 14U}})
      chi2 += e * e / on->registration.covariance[k];
    // The coat is vertical here and deviations are along the normal, hence a little less.
    const auto with = deviate(seen, on->registration.model_from_scan, c.part);
    const auto without = deviate(seen, best->model_from_scan, c.part);
    EXPECT_NEAR(with->statistics.median_mm, 0.245, 0.01);
    EXPECT_NEAR(without->statistics.median_mm, 0.0, 0.03);
    const Absorbed a = absorbed_by(*best, on->registration, c.part);
    EXPECT_NEAR(a.mean_mm, 0.24, 0.02) << "seed " << seed;
    EXPECT_LE(a.min_mm, a.mean_mm);
    EXPECT_GE(a.max_mm, a.mean_mm);
    EXPECT_GT(a.mean_mm, 10.0 * a.sigma_mm);
  }
  RecordProperty("chi2", std::to_string(chi2));
  EXPECT_LT(chi2, 42.3) << "18 degrees of freedom, 0.1 %";
}

TEST(Datums, RefuseWhatIsNotThere) {
  const Coated c = coated_part(1);
  EXPECT_THAT(register_datums(c.truth, c.part, {}, {}), FailsWith(kDatums));
  auto datums = c.datums;
  datums[3].at_mm.z += 60.0;
  const auto gone = register_datums(c.truth, c.part, datums, {});
  ASSERT_THAT(gone, FailsWith(kDatums));
  EXPECT_THAT(gone.error().message, testing::HasSubstr("datum sphere"));
  datums = c.datums;
  datums[4].length_mm = 0.0;
  EXPECT_THAT(register_datums(c.truth, c.part, datums, {}), FailsWith(kDatums));
  const std::vector<Datum> one{c.datums[3]};
  const auto few = register_datums(c.truth, c.part, one, {});
  ASSERT_THAT(few, Succeeds()) << "three directions are known, three are named";
  EXPECT_EQ(few->registration.free_directions.size(), 3U);
}

}  // namespace
}  // namespace maquette::scan

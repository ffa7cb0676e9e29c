// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed of deviate() in scan/deviate.hpp and in scan/statistics.hpp, and how:
//
//   deviation per point .............. planes in closed form; distances themselves are
//                                      tested in surface_distance_test.cpp
//   map .............................. points placed by hand: means, nearest node, NaN
//   coverage ......................... by hand: a single point, a full grid, voids
//   statistics ....................... numbers whose answers are known; a slow oracle with
//                                      everything sorted and summed in long double
//   histogram ........................ middle bin about zero, limit 1-2-5, all counted
//   same bits for any threads ........ one against many, map included
//   JSON, PLY ........................ keys there, NaN as null, cloud read back
//   errors ........................... empty, reach, nothing on the part, cancelled;
//                                      wrong unit warns

#include "scan/deviate.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "scan/statistics.hpp"
#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;
using testing_support::FailsWith;
using testing_support::points_on;
using testing_support::rough_part;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

TEST(Deviate, MeasuresAlongTheNormal) {
  ModelField f{Grid<float>(101, 101), Millimetres{0.5}};
  for (std::ptrdiff_t r = 0; r < 101; ++r)
    for (std::ptrdiff_t c = 0; c < 101; ++c) f.z_mm(r, c) = static_cast<float>(0.75 * f.x_mm(c));
  Cloud cloud = points_on(f, 5'000, 1);
  for (Vec3& p : cloud.points_mm) p.z += 0.125;  // along the normal: 0.8 x 0.125 = 0.1
  const auto d = deviate(cloud, {}, f);
  ASSERT_THAT(d, Succeeds());
  // Points near the low rim reach the surface obliquely, over the outline's edge.
  EXPECT_NEAR(d->statistics.median_mm, 0.1, 1e-8);
  EXPECT_NEAR(d->statistics.min_mm, 0.1, 1e-8);
  EXPECT_LE(d->statistics.max_mm, 0.125 + 1e-8);
  EXPECT_NEAR(d->statistics.rms_mm, 0.1, 1e-3);
  EXPECT_EQ(d->statistics.points, 5'000U);
  EXPECT_EQ(d->statistics.off_part, 0U);
}

TEST(Deviate, AppliesThePose) {
  const ModelField f{Grid<float>(21, 21, 3.0F), Millimetres{1.0}};
  const RigidTransform model_from_scan{rotation_about({0, 0, 1}, std::acos(0.0)), {20.0, 0.0, 1.0}};
  Cloud cloud;
  cloud.points_mm = {{5.0, 2.0, 2.5}};  // turned to (-2, 5), moved to (18, 5, 3.5)
  const auto d = deviate(cloud, model_from_scan, f);
  ASSERT_THAT(d, Succeeds());
  EXPECT_NEAR(d->per_point_mm[0], 0.5, 1e-7);
  EXPECT_NEAR(d->map_mm(5, 18), 0.5, 1e-7);
}

TEST(Deviate, MapsMeansToTheNearestNode) {
  ModelField f{Grid<float>(11, 11, 0.0F), Millimetres{2.0}, Millimetres{-4.0}, Millimetres{10.0}};
  f.z_mm(9, 9) = NAN;
  Cloud cloud;
  cloud.points_mm = {{0.9, 14.2, 0.5},  {-0.9, 13.1, -0.25},  // both nearest to (2, 2)
                     {1.1, 14.0, 1.0},                        // nearest to (2, 3)
                     {14.0, 28.0, 0.1},                       // on the void
                     {0.0, 14.0, 7.0},                        // beyond reach
                     {-4.1, 14.0, 0.0}};                      // beside the part
  const auto d = deviate(cloud, {}, f);
  ASSERT_THAT(d, Succeeds());
  EXPECT_EQ(d->map_mm(2, 2), 0.125F);
  EXPECT_EQ(d->map_mm(2, 3), 1.0F);
  int filled = 0;
  for (const float m : d->map_mm.cells()) filled += std::isnan(m) ? 0 : 1;
  EXPECT_EQ(filled, 2);
  EXPECT_EQ(d->statistics.points, 3U);
  EXPECT_EQ(d->statistics.off_part, 3U);
  EXPECT_THAT(std::vector<float>(d->per_point_mm.begin(), d->per_point_mm.begin() + 3),
              testing::ElementsAre(0.5F, -0.25F, 1.0F));
  for (std::size_t i = 3; i < 6; ++i) EXPECT_TRUE(std::isnan(d->per_point_mm[i])) << i;
}

TEST(Deviate, CountsCoveredNodes) {
  ModelField f{Grid<float>(11, 11, 0.0F), Millimetres{2.0}};
  const auto coverage = [&](std::vector<Vec3> points) {
    Cloud cloud;
    cloud.points_mm = std::move(points);
    return deviate(cloud, {}, f)->statistics.coverage;
  };
  EXPECT_DOUBLE_EQ(coverage({{10.0, 10.0, 0.0}}) * 121.0, 5.0) << "the node and its neighbours";
  EXPECT_DOUBLE_EQ(coverage({{11.0, 11.0, 0.0}}) * 121.0, 4.0) << "1.41 from its corners";
  EXPECT_DOUBLE_EQ(coverage({{0.0, 0.0, 0.0}}) * 121.0, 3.0);
  f.z_mm(5, 6) = NAN;
  EXPECT_DOUBLE_EQ(coverage({{9.0, 9.0, 0.0}}) * 120.0, 4.0) << "voids are not asked for";
  const ModelField part = rough_part(2, 51, 51, 1.0);
  const auto full = deviate(points_on(part, 50'000, 1), {}, part);
  EXPECT_EQ(full->statistics.coverage, 1.0);
}

// ---- statistics ------------------------------------------------------------

TEST(Statistics, OfKnownNumbers) {
  const std::vector<float> d{1.0F, NAN, -3.0F, 2.0F, 0.0F, 5.0F};
  const DeviationStatistics s = summarize(d);
  EXPECT_EQ(s.points, 5U);
  EXPECT_EQ(s.off_part, 1U);
  EXPECT_DOUBLE_EQ(s.mean_mm, 1.0);
  EXPECT_DOUBLE_EQ(s.rms_mm, std::sqrt(39.0 / 5.0));
  EXPECT_DOUBLE_EQ(s.sigma_mm, std::sqrt(34.0 / 4.0));
  EXPECT_DOUBLE_EQ(s.median_mm, 1.0);
  EXPECT_DOUBLE_EQ(s.nmad_mm, 1.4826 * 1.0);  // distances 0 1 1 4 4
  EXPECT_DOUBLE_EQ(s.p05_mm, -3.0 + 0.2 * 3.0);
  EXPECT_DOUBLE_EQ(s.p95_mm, 2.0 + 0.8 * 3.0);
  EXPECT_DOUBLE_EQ(s.abs_p95_mm, 3.0 + 0.8 * 2.0);  // 0 1 2 3 5
  EXPECT_EQ(s.min_mm, -3.0);
  EXPECT_EQ(s.max_mm, 5.0);
  const DeviationStatistics one = summarize(std::vector<float>{2.0F});
  EXPECT_EQ(one.median_mm, 2.0);
  EXPECT_EQ(one.nmad_mm, 0.0);
  EXPECT_EQ(one.sigma_mm, 0.0);
  EXPECT_EQ(one.abs_p95_mm, 2.0);
  EXPECT_TRUE(std::isnan(summarize(std::vector<float>{NAN, NAN}).mean_mm));
}

class StatisticsSeeded : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Seed, StatisticsSeeded, testing::Range(1, 9));

TEST_P(StatisticsSeeded, EqualASlowOracle) {
  const auto seed = static_cast<std::uint64_t>(GetParam());
  // Sizes around the chunk of 65536; a large offset so that squares would cancel.
  const std::size_t n =
      std::vector<std::size_t>{2, 3, 101, 65535, 65536, 65537, 200'000, 150'001}[seed - 1];
  std::vector<float> d(n);
  for (std::size_t i = 0; i < n; ++i)
    d[i] = i % 7 == 6 ? NAN : static_cast<float>(1000.0 + 0.01 * random_normal(seed, i));
  std::vector<double> finite;
  for (const float v : d)
    if (!std::isnan(v)) finite.push_back(static_cast<double>(v));
  std::sort(finite.begin(), finite.end());
  const auto quantile = [](const std::vector<double>& v, double q) {
    const double at = q * static_cast<double>(v.size() - 1);
    const auto i = static_cast<std::size_t>(at);
    const double next = v[std::min(i + 1, v.size() - 1)];
    return v[i] + (at - static_cast<double>(i)) * (next - v[i]);
  };
  long double sum = 0.0L, squares = 0.0L;
  for (const double v : finite) sum += static_cast<long double>(v);
  const auto count = static_cast<long double>(finite.size());
  const long double mean = sum / count;
  for (const double v : finite)
    squares += (static_cast<long double>(v) - mean) * (static_cast<long double>(v) - mean);
  std::vector<double> from_median;
  for (const double v : finite) from_median.push_back(std::abs(v - quantile(finite, 0.5)));
  std::sort(from_median.begin(), from_median.end());

  const DeviationStatistics s = summarize(d);
  EXPECT_NEAR(s.mean_mm, static_cast<double>(mean), 1e-10);
  EXPECT_NEAR(s.sigma_mm, static_cast<double>(std::sqrt(squares / (count - 1.0L))), 1e-10);
  EXPECT_NEAR(s.median_mm, quantile(finite, 0.5), 1e-12);
  EXPECT_NEAR(s.p05_mm, quantile(finite, 0.05), 1e-12);
  EXPECT_NEAR(s.p95_mm, quantile(finite, 0.95), 1e-12);
  EXPECT_NEAR(s.nmad_mm, 1.4826 * quantile(from_median, 0.5), 1e-12);
  EXPECT_NEAR(s.abs_p95_mm, quantile(finite, 0.95), 1e-12);
}

TEST(Statistics, AbsoluteQuantilesEqualSortedDistances) {
  // Centres before, inside, on values of and behind lists with many equal values.
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    const std::size_t n = 1 + static_cast<std::size_t>(60.0 * random_uniform(seed, 0));
    std::vector<float> ascending(n);
    for (std::size_t i = 0; i < n; ++i)
      ascending[i] = static_cast<float>(std::floor(12.0 * random_uniform(seed, 10 + i)) - 4.0);
    std::sort(ascending.begin(), ascending.end());
    for (const double centre : {-9.0, -4.0, -0.5, 0.0, 3.0, 7.0, 20.0}) {
      std::vector<double> distances;
      for (const float v : ascending)
        distances.push_back(std::abs(static_cast<double>(v) - centre));
      std::sort(distances.begin(), distances.end());
      for (const double q : {0.0, 0.1, 0.5, 0.77, 0.95, 1.0}) {
        const double at = q * static_cast<double>(n - 1);
        const auto i = static_cast<std::size_t>(at);
        const double next = distances[std::min(i + 1, n - 1)];
        ASSERT_EQ(absolute_quantile(ascending, centre, q),
                  distances[i] + (at - static_cast<double>(i)) * (next - distances[i]))
            << "seed " << seed << ", centre " << centre << ", q " << q;
      }
    }
  }
}

TEST(Statistics, HistogramHasItsMiddleAtZero) {
  const auto bins = histogram_101(
      std::vector<float>{0.0F, 0.0098F, -0.0098F, 0.011F, 1.0F, 7.0F, -9.0F, NAN}, 1.0);
  ASSERT_EQ(bins.size(), 101U);
  EXPECT_EQ(bins[50], 3U);
  EXPECT_EQ(bins[51], 1U);
  EXPECT_EQ(bins[100], 2U);
  EXPECT_EQ(bins[0], 1U);
  for (const auto& [value, rounded] : std::vector<std::pair<double, double>>{{0.011, 0.02},
                                                                             {0.02, 0.02},
                                                                             {0.3, 0.5},
                                                                             {0.51, 1.0},
                                                                             {1.0, 1.0},
                                                                             {7.0, 10.0},
                                                                             {3e-6, 5e-6}})
    EXPECT_DOUBLE_EQ(round_up_125(value), rounded);
}

TEST(Deviate, HistogramCountsEveryPoint) {
  const ModelField part = rough_part(2, 51, 51, 1.0);
  const auto d = deviate(points_on(part, 20'000, 3, 0.1), {}, part);
  ASSERT_THAT(d, Succeeds());
  std::uint64_t sum = 0;
  for (const auto bin : d->histogram) sum += bin;
  EXPECT_EQ(sum, d->statistics.points);
  EXPECT_DOUBLE_EQ(d->histogram_limit_mm, 0.5) << "2.8 sigma of 0.1 mm, rounded up";
}

TEST(Deviate, GivesTheSameBitsForAnyNumberOfThreads) {
  const ModelField part = rough_part(2, 101, 101, 0.5);
  const Cloud cloud = points_on(part, 300'000, 3, 0.1);
  const auto with_threads = [&](std::size_t n) {
    const oneapi::tbb::global_control limit(oneapi::tbb::global_control::max_allowed_parallelism,
                                            n);
    return deviate(cloud, {}, part);
  };
  const auto one = with_threads(1), four = with_threads(4);
  ASSERT_THAT(one, Succeeds());
  ASSERT_THAT(four, Succeeds());
  EXPECT_EQ(to_json(one->statistics, nullptr), to_json(four->statistics, nullptr));
  EXPECT_EQ(one->statistics.mean_mm, four->statistics.mean_mm);
  EXPECT_EQ(one->statistics.sigma_mm, four->statistics.sigma_mm);
  for (std::size_t i = 0; i < one->map_mm.cells().size(); ++i)
    ASSERT_EQ(one->map_mm.cells()[i], four->map_mm.cells()[i]);  // every node has points
}

// ---- files -----------------------------------------------------------------

TEST(DeviateReport, JsonHasTheKeys) {
  DeviationStatistics s;
  s.mean_mm = 0.5;
  s.sigma_mm = NAN;
  s.points = 7;
  Registration a;
  a.iterations = 5;
  a.free_directions = {"rotation z"};
  a.model_from_scan.translation_mm = {1.0, 2.0, 3.0};
  const auto j = nlohmann::json::parse(to_json(s, &a));
  for (const char* key :
       {"mean_mm", "rms_mm", "sigma_mm", "median_mm", "nmad_mm", "p05_mm", "p95_mm", "abs_p95_mm",
        "min_mm", "max_mm", "points", "off_part", "coverage"})
    EXPECT_TRUE(j.contains(key)) << key;
  EXPECT_EQ(j["mean_mm"], 0.5);
  EXPECT_TRUE(j["sigma_mm"].is_null()) << "JSON knows no NaN";
  EXPECT_EQ(j["points"], 7);
  const auto& r = j["registration"];
  EXPECT_EQ(r["converged"], true);
  EXPECT_EQ(r["iterations"], 5);
  EXPECT_EQ(r["free_directions"][0], "rotation z");
  EXPECT_EQ(r["model_from_scan"]["rotation_wxyz"], (std::vector<double>{1, 0, 0, 0}));
  EXPECT_EQ(r["model_from_scan"]["translation_mm"], (std::vector<double>{1, 2, 3}));
  for (const char* key :
       {"rms_before_mm", "rms_after_mm", "sigma_translation_mm", "sigma_rotation_rad"})
    EXPECT_TRUE(r.contains(key)) << key;
  EXPECT_FALSE(nlohmann::json::parse(to_json(s, nullptr)).contains("registration"));
}

TEST(DeviateReport, PlyCarriesTheDeviation) {
  const ScratchFolder folder;
  const ModelField f{Grid<float>(21, 21, 3.0F), Millimetres{1.0}};
  Cloud cloud;
  cloud.points_mm = {{1.0, 2.0, 2.5}, {100.0, 0.0, 0.0}};
  cloud.station_mm = Vec3{0.0, 0.0, 100.0};
  const RigidTransform up{{}, {0.0, 0.0, 1.0}};
  const auto d = deviate(cloud, up, f);
  ASSERT_THAT(d, Succeeds());
  ASSERT_THAT(write_deviation_ply(cloud, up, *d, folder / "d.ply"), Succeeds());
  const auto back = read_cloud(folder / "d.ply");
  ASSERT_THAT(back, Succeeds());
  EXPECT_EQ(back->points_mm[0], (Vec3{1.0, 2.0, 3.5})) << "in the model frame";
  EXPECT_EQ(back->station_mm, (Vec3{0.0, 0.0, 101.0}));
  const auto bytes = read_file(folder / "d.ply");
  EXPECT_THAT(*bytes, testing::HasSubstr("property float deviation_mm\nend_header"));
  float first = 0.0F;
  std::memcpy(&first, bytes->data() + bytes->size() - 2 * 28 + 24, sizeof first);
  EXPECT_EQ(first, 0.5F);
}

// ---- errors ----------------------------------------------------------------

TEST(DeviateRefuses, WhatCannotBeCompared) {
  const ModelField part = rough_part(1, 21, 21, 1.0);
  const Cloud cloud = points_on(part, 100, 1);
  EXPECT_THAT(deviate({}, {}, part), FailsWith(kCloudEmpty));
  for (const double reach : {0.0, -1.0, 1001.0, std::nan("")})
    EXPECT_THAT(deviate(cloud, {}, part, Millimetres{reach}), FailsWith(kReach));
  EXPECT_THAT(deviate(cloud, {{}, {1000.0, 0.0, 0.0}}, part), FailsWith(kTooFewPoints));
  std::stop_source stop;
  stop.request_stop();
  RunContext run;
  run.stop = stop.get_token();
  EXPECT_THAT(deviate(cloud, {}, part, Millimetres{5.0}, run), FailsWith(kCancelled));
}

TEST(DeviateRefuses, NothingButWarnsOfTheWrongUnit) {
  const ModelField part{Grid<float>(101, 101, 0.0F), Millimetres{1.0}};
  Cloud metres = points_on(part, 1000, 1);
  for (Vec3& p : metres.points_mm) p = 0.001 * p;
  std::string warning;
  RunContext run;
  run.warn = [&](const std::string& text) { warning = text; };
  EXPECT_THAT(deviate(metres, {}, part, Millimetres{5.0}, run), Succeeds());
  EXPECT_THAT(warning, testing::HasSubstr("metres"));
}

}  // namespace
}  // namespace maquette::scan

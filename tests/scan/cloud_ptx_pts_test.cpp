// SPDX-License-Identifier: GPL-3.0-or-later

// PTX and PTS, as scan/cloud_stream.hpp claims them:
//
//   files made by hand ............... poses (row vectors), missing cells, colours, several scans,
//                                      with and without counts, every column count
//   what is written is read .......... all fields the formats hold; gaps and stations without a
//                                      grid; limits of intensity
//   every error, with its line ....... one case each; counts beyond the file at once
//   any bytes at all ................. mutations: a cloud or one of our errors

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "scan/cloud_stream.hpp"
#include "support/matchers.hpp"
#include "support/mutations.hpp"
#include "support/streamed_cloud.hpp"

namespace maquette::scan {
namespace {

using namespace testing_support;
using testing::ElementsAre;
using testing::HasSubstr;

// A turn of 90 degrees about z: x goes to y, y to -x; then a shift.
const std::string kTurned =
    "1.5 -2 0.25\n0 1 0\n-1 0 0\n0 0 1\n0 1 0 0\n-1 0 0 0\n0 0 1 0\n1 2 3 1\n";
const std::string kStraight = "0 0 0\n1 0 0\n0 1 0\n0 0 1\n1 0 0 0\n0 1 0 0\n0 0 1 0\n0 0 0 1\n";

TEST(Ptx, ReadsAFileMadeByHand) {
  const std::string text = "2\r\n3\r\n" + kTurned +
                           "0.001 0.002 0.003 0.25\n0 0 0 0.5\n1 1 1 1\n"
                           "2 2 2 0\n0.000000 0.000000 0.000000 0.500000\n3 3 3 0.75\n\n"
                           "1\n1\n" +
                           kStraight + "1e-3 +2e-3 -3e-3 0.5 255 128 1";
  for (const std::size_t batch : {1U, 4U, 100U}) {
    const auto cloud = stream_bytes("a.ptx", text, {.unit_mm = {}, .batch_points = batch});
    ASSERT_THAT(cloud, Succeeds());
    EXPECT_EQ(cloud->format, "PTX");
    ASSERT_EQ(cloud->stations.size(), 2U);
    const ScanStation& a = cloud->stations[0];
    EXPECT_EQ(a.columns, 2U);
    EXPECT_EQ(a.rows, 3U);
    EXPECT_EQ(a.position_mm, (Vec3{1500.0, -2000.0, 250.0}));
    EXPECT_NEAR(norm(a.model_from_station.point({10, 0, 0}) - Vec3{1000, 2010, 3000}), 0.0, 1e-12);
    EXPECT_NEAR(norm(a.model_from_station.point({0, 10, 5}) - Vec3{990, 2000, 3005}), 0.0, 1e-12);
    const PointBatch& p = cloud->points[0];
    EXPECT_THAT(p.points_mm, ElementsAre(Vec3{1, 2, 3}, Vec3{}, Vec3{1000, 1000, 1000},
                                         Vec3{2000, 2000, 2000}, Vec3{}, Vec3{3000, 3000, 3000}));
    EXPECT_THAT(p.flags, ElementsAre(0, kNoPosition, 0, 0, kNoPosition, 0));
    EXPECT_THAT(p.grid, ElementsAre(GridIndex{0, 0}, GridIndex{1, 0}, GridIndex{2, 0},
                                    GridIndex{0, 1}, GridIndex{1, 1}, GridIndex{2, 1}));
    EXPECT_THAT(p.intensity, ElementsAre(0.25F, 0.5F, 1.0F, 0.0F, 0.5F, 0.75F));
    EXPECT_TRUE(p.colours.empty());
    EXPECT_EQ(cloud->stations[1].model_from_station, RigidTransform{});
    const PointBatch& q = cloud->points[1];
    EXPECT_THAT(q.points_mm, ElementsAre(Vec3{1, 2, -3}));
    EXPECT_THAT(q.colours, ElementsAre(Colour{65535, 128 * 257, 257}));
  }
}

TEST(Ptx, HoldsStationsWithPosesGapsAndColours) {
  const ScratchFolder folder;
  CloudFields f;
  f.intensity = f.colour = f.grid = f.flags = true;
  StreamedCloud cloud;
  for (std::uint64_t s = 0; s < 3; ++s) {
    cloud.stations.push_back(sample_station(f, 4, 5, s));
    cloud.stations.back().intensity_limits = {-1.0, 3.0};
    cloud.points.push_back(sample_points(f, 4, 5, s));
    cloud.points.back().flags.resize(20);
  }
  cloud.stations[2].position_mm = Vec3{1, 2, 3};
  cloud.points[1].flags[7] = kNoPosition;
  // Cells that are not even there: every other point of the third station.
  PointBatch sparse;
  for (std::size_t i = 0; i < 20; i += 2) append_batch(sparse, slice(cloud.points[2], i, 1));
  cloud.points[2] = sparse;
  ASSERT_THAT(stream_out(cloud, folder / "a.ptx"), Succeeds());
  const auto back = stream_in(folder / "a.ptx");
  ASSERT_THAT(back, Succeeds());
  ASSERT_EQ(back->stations.size(), 3U);
  for (std::size_t s = 0; s < 3; ++s) {
    EXPECT_EQ(back->stations[s].rows, 4U);
    EXPECT_EQ(back->stations[s].columns, 5U);
    EXPECT_EQ(back->points[s].size(), 20U);
    for (const Vec3 v : {Vec3{}, Vec3{1000, -500, 200}})
      EXPECT_NEAR(norm(back->stations[s].model_from_station.point(v) -
                       cloud.stations[s].model_from_station.point(v)),
                  0.0, 1e-11);
    EXPECT_NEAR(norm(*back->stations[s].position_mm - *cloud.stations[s].position_mm), 0.0, 1e-12);
    std::size_t k = 0;
    for (std::size_t i = 0; i < 20; ++i) {
      const PointBatch &p = cloud.points[s], &q = back->points[s];
      if (k == p.size() || p.grid[k] != q.grid[i]) {
        EXPECT_EQ(q.flags[i], kNoPosition) << "a gap is filled";
        continue;
      }
      EXPECT_EQ(q.flags[i], p.flags[k]);
      if (p.has_position(k)) {
        // To metres and back: two ulp.
        EXPECT_NEAR(q.points_mm[i].x, p.points_mm[k].x, 2.0 * 2.3e-16 * p.points_mm[k].x);
        EXPECT_NEAR(q.points_mm[i].z, p.points_mm[k].z, 2.0 * 2.3e-16 * p.points_mm[k].z);
        EXPECT_NEAR(q.intensity[i], (p.intensity[k] + 1.0F) / 4.0F, 1e-7F) << "limits to 0 and 1";
        EXPECT_EQ(q.colours[i], p.colours[k]);
      }
      ++k;
    }
    EXPECT_EQ(k, cloud.points[s].size());
  }
}

TEST(Ptx, WritesPointsWithoutAGridAsOneRow) {
  const ScratchFolder folder;
  Cloud cloud;
  for (int i = 0; i < 1000; ++i) cloud.points_mm.push_back({i + 1.0, 0.25, -i * 0.5});
  cloud.station_mm = Vec3{0.0, 0.0, 900.0};
  ASSERT_THAT(write_cloud(cloud, folder / "a.ptx"), Succeeds());
  const auto back = read_cloud(folder / "a.ptx");
  ASSERT_THAT(back, Succeeds());
  ASSERT_EQ(back->points_mm.size(), 1000U);
  EXPECT_EQ(back->stations[0].rows, 1U);
  EXPECT_EQ(back->stations[0].columns, 1000U);
  EXPECT_EQ(back->station_mm, cloud.station_mm);
  for (std::size_t i = 0; i < 1000; ++i)
    EXPECT_NEAR(norm(back->points_mm[i] - cloud.points_mm[i]), 0.0, 1e-12);
}

TEST(Ptx, RefusesAGridInAnotherOrder) {
  const ScratchFolder folder;
  CloudFields f;
  f.grid = true;
  StreamedCloud cloud;
  cloud.stations = {sample_station(f, 4, 5, 1)};
  cloud.points = {sample_points(f, 4, 5, 1)};
  std::swap(cloud.points[0].grid[3], cloud.points[0].grid[4]);
  const auto swapped = stream_out(cloud, folder / "a.ptx");
  ASSERT_THAT(swapped, FailsWith(kCloudCannotHold));
  EXPECT_THAT(swapped.error().message, HasSubstr("column by column"));
  cloud.stations[0].fields.grid = false;
  cloud.points[0].grid.clear();
  append_batch(cloud.points[0], slice(cloud.points[0], 0, 1));
  EXPECT_THAT(stream_out(cloud, folder / "a.ptx"), FailsWith(kCloudCannotHold)) << "21 in 4 x 5";
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(Pts, ReadsSetsMadeByHand) {
  const auto cloud = stream_bytes("a.pts",
                                  "2\n1 2 3 -2048 255 0 1\r\n4 5 6 2047 0 255 2\n\n"
                                  "1  \n 0.001 0.002 0.003\n0\n1\n1 1 1 17");
  ASSERT_THAT(cloud, Succeeds());
  EXPECT_EQ(cloud->format, "PTS");
  ASSERT_EQ(cloud->stations.size(), 4U);
  EXPECT_THAT(cloud->points[0].points_mm,
              ElementsAre(Vec3{1000, 2000, 3000}, Vec3{4000, 5000, 6000}));
  EXPECT_THAT(cloud->points[0].intensity, ElementsAre(-2048.0F, 2047.0F));
  EXPECT_EQ(cloud->stations[0].intensity_limits, (std::array<double, 2>{-2048.0, 2047.0}));
  EXPECT_THAT(cloud->points[0].colours, ElementsAre(Colour{65535, 0, 257}, Colour{0, 65535, 514}));
  EXPECT_THAT(cloud->points[1].points_mm, ElementsAre(Vec3{1, 2, 3}));
  EXPECT_TRUE(cloud->points[1].intensity.empty());
  EXPECT_EQ(cloud->points[2].size(), 0U);
  EXPECT_THAT(cloud->points[3].intensity, ElementsAre(17.0F));
  const auto bare = stream_bytes("a.pts", "1 2 3 9 8 7\n\n4 5 6 1 2 3\n");
  ASSERT_THAT(bare, Succeeds());
  EXPECT_EQ(bare->points[0].size(), 2U);
  EXPECT_EQ(bare->points[0].colours[0], (Colour{9 * 257, 8 * 257, 7 * 257}));
}

TEST(Pts, HoldsCoordinatesColoursAndTwelveBitsOfIntensity) {
  const ScratchFolder folder;
  CloudFields f;
  f.intensity = f.colour = f.flags = true;
  StreamedCloud cloud;
  for (std::uint64_t s = 0; s < 3; ++s) {
    cloud.stations.push_back(sample_station(f, 4, 5, s));
    cloud.points.push_back(sample_points(f, 4, 5, s));
    cloud.points.back().flags.resize(20);
  }
  cloud.points[0].flags[0] = kNoPosition;
  ASSERT_THAT(stream_out(cloud, folder / "a.pts"), Succeeds());
  const auto back = stream_in(folder / "a.pts");
  ASSERT_THAT(back, Succeeds());
  ASSERT_EQ(back->stations.size(), 3U);
  EXPECT_EQ(back->points[0].size(), 19U) << "left out";
  for (std::size_t s = 0; s < 3; ++s)
    for (std::size_t i = 0, k = s == 0 ? 1 : 0; k < 20; ++i, ++k) {
      const Vec3 p = cloud.stations[s].model_from_station.point(cloud.points[s].points_mm[k]);
      EXPECT_NEAR(back->points[s].points_mm[i].x, p.x, 2.0 * 2.3e-16 * std::abs(p.x));
      EXPECT_NEAR(back->points[s].points_mm[i].y, p.y, 2.0 * 2.3e-16 * std::abs(p.y));
      EXPECT_EQ(back->points[s].colours[i], cloud.points[s].colours[k]);
      EXPECT_NEAR(back->points[s].intensity[i], -2048.0F + 4095.0F * cloud.points[s].intensity[k],
                  0.5F + 1e-3F);
    }
}

struct BadFile {
  const char* name;
  std::string content;
  ErrorCode code;
  const char* says;
};

class PtxPtsRefuse : public testing::TestWithParam<BadFile> {};

TEST_P(PtxPtsRefuse, AndSayWhereAndWhat) {
  const BadFile& bad = GetParam();
  const auto cloud = stream_bytes(bad.name, bad.content);
  ASSERT_THAT(cloud, FailsWith(bad.code));
  EXPECT_THAT(cloud.error().message, HasSubstr(bad.says));
  EXPECT_THAT(cloud.error().message, HasSubstr(bad.name));
}

std::string with_matrix(const char* rows) {
  return std::string("1\n1\n0 0 0\n1 0 0\n0 1 0\n0 0 1\n") + rows + "1 2 3 0.5\n";
}

INSTANTIATE_TEST_SUITE_P(
    Files, PtxPtsRefuse,
    testing::Values(
        BadFile{"a.ptx", "two\n1\n" + kStraight, kCloudFormat, "line 1: expected the columns"},
        BadFile{"b.ptx", "2\n-1\n" + kStraight, kCloudFormat, "line 2: -1 rows"},
        BadFile{"c.ptx", "2\n1.5\n" + kStraight, kCloudFormat, "line 2: 1.5 rows"},
        BadFile{"d.ptx", "4294967295\n4294967295\n" + kStraight + "1 2 3 0.5\n", kCloudFormat,
                "are promised"},
        BadFile{"e.ptx", "2\n1\n" + kStraight + "1 2 3 0.500000000\n", kCloudFormat,
                "after 1 of 2 cells"},
        BadFile{"f.ptx", "2\n1\n1 2\n", kCloudFormat, "line 3: expected the scanner position"},
        BadFile{"g.ptx", "2\n1\n1 2 3 4\n", kCloudFormat, "more than 3 numbers"},
        BadFile{"h.ptx", "2\n1\n1 2 3\n", kCloudFormat, "the file ends before the scanner axes"},
        BadFile{"i.ptx", with_matrix("1 0 0 0\n0 1 0 0\n0 0 -1 0\n0 0 0 1\n"), kCloudFormat,
                "mirrored"},
        BadFile{"j.ptx", with_matrix("2 0 0 0\n0 2 0 0\n0 0 2 0\n0 0 0 1\n"), kCloudFormat,
                "line 10: the matrix is no rotation"},
        BadFile{"k.ptx", with_matrix("1 0 0 5\n0 1 0 0\n0 0 1 0\n0 0 0 1\n"), kCloudFormat,
                "line 7: the matrix's last column"},
        BadFile{"l.ptx", with_matrix("1 0 0 0\n0 1 0 0\n0 0 1 0\n1e9 0 0 1\n"), kCloudFormat,
                "mm away"},
        BadFile{"m.ptx", with_matrix("1 0 0 0\n0 1 0 0\n0 0 1 0\nnan 0 0 1\n"), kCloudFormat,
                "line 10: expected the matrix"},
        BadFile{"n.ptx", "1\n1\n" + kStraight + "1 2 3\n     ", kCloudFormat,
                "3 numbers in a cell"},
        BadFile{"o.ptx", "2\n1\n" + kStraight + "1 2 3 0\n1 2 3 0 5\n", kCloudFormat,
                "line 12: '5' after 4"},
        BadFile{"p.ptx", "2\n1\n" + kStraight + "1 2 3 0\n1 2 x 0\n", kCloudFormat,
                "line 12: expected 4 numbers, got 'x'"},
        BadFile{"q.ptx", "2\n1\n" + kStraight + "1 2 3 0\n1 nan 3 0\n", kCloudNotFinite,
                "point 1 "},
        BadFile{"r.ptx", "1\n1\n" + kStraight + "1 2 3 0\n1\n1\nagain\n", kCloudFormat,
                "line 14: expected the scanner position"},
        BadFile{"a.pts", "9999999999999999\n1 2 3\n", kCloudFormat,
                "line 1: 9999999999999999 points"},
        BadFile{"b.pts", "abc\n1 2 3\n", kCloudFormat, "line 1: expected a number of points"},
        BadFile{"c.pts", "2\n1.00000 2 3\n", kCloudFormat, "the file ends 1 points early"},
        BadFile{"d.pts", "1\n1 2\n      ", kCloudFormat, "line 2: 2 columns"},
        BadFile{"e.pts", "2\n1 2 3\n1 2 3 4\n", kCloudFormat, "line 3: '4' after 3 columns"},
        BadFile{"f.pts", "2\n1 2 3 4\n1 2 3\n", kCloudFormat, "line 3: expected 4 columns"},
        BadFile{"g.pts", "1 2 3\ninf 2 3\n", kCloudNotFinite, "point 1 "},
        BadFile{"h.pts", "1 2 3 4 5\n", kCloudFormat, "5 columns"}),
    [](const auto& bad) {
      std::string name = bad.param.name;
      name[1] = '_';
      return name;
    });

TEST(PtxPts, WithoutAnythingAreEmpty) {
  const ScratchFolder folder;
  for (const char* name : {"a.ptx", "a.pts"}) {
    EXPECT_EQ(stream_bytes(name, "")->stations.size(), 0U);
    EXPECT_EQ(stream_bytes(name, "\n \r\n")->stations.size(), 0U);
    ASSERT_THAT(write_cloud({}, folder / name), Succeeds());
    EXPECT_THAT(read_cloud(folder / name), FailsWith(kCloudEmpty));
  }
}

class PtxPtsMutated : public testing::TestWithParam<std::uint64_t> {};
INSTANTIATE_TEST_SUITE_P(Seed, PtxPtsMutated, testing::Range<std::uint64_t>(1, 9));

TEST_P(PtxPtsMutated, AreCloudsOrErrorsOfOurs) {
  const std::vector<std::pair<std::string, std::string>> good = {
      {"m.ptx", "2\n2\n" + kTurned + "1 2 3 0.5\n0 0 0 0.5\n7 8 9 1\n1 1 1 1\n1\n1\n" + kStraight +
                    "1 1 1 0 1 2 3\n"},
      {"m.pts", "2\n1 2 3 4\n4 5 6 7\n1\n1 2 3 1 2 3\n"},
      {"m.pts", "1 2 3 4 5 6 7\n4 5 6 7 8 9 0\n"}};
  Mutator mutated(GetParam());
  int clouds = 0, errors = 0;
  for (int i = 0; i < 4000; ++i) {
    const auto& [name, bytes] = good[mutated.index(good.size())];
    const auto cloud = stream_bytes(name, mutated(bytes));
    if (!cloud) {
      const ErrorCode code = cloud.error().code;
      ASSERT_TRUE(code == kCloudFormat || code == kCloudNotFinite) << cloud.error().message;
      ++errors;
      continue;
    }
    ++clouds;
    for (std::size_t s = 0; s < cloud->stations.size(); ++s)
      for (const Vec3& p : cloud->points[s].points_mm)
        ASSERT_TRUE(std::abs(p.x) <= kLargestCoordinateMm &&
                    std::abs(p.y) <= kLargestCoordinateMm && std::abs(p.z) <= kLargestCoordinateMm);
  }
  EXPECT_GT(clouds, 100) << "mutations that never survive test little";
  EXPECT_GT(errors, 100);
}

}  // namespace
}  // namespace maquette::scan

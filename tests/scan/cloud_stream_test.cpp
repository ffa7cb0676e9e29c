// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in scan/cloud_stream.hpp for all formats, and for the simple ones (PLY, XYZ,
// CSV) in particular; tests/scan/e57_test.cpp and its like attack the others.
//
//   what is written is read .......... PLY, XYZ, CSV: every field, to the bit
//   batches are small, order stays ... sizes and begins_station, any batch size
//   poses are applied ................ station frame in, model frame out
//   one layout, one position ......... second station: refused, or its position dropped
//   the unit can be said ............. factors both ways
//   a look at a whole file ........... counts, bounds and stations against the samples
//   nothing appears before finish .... folder listed

#include "scan/cloud_stream.hpp"

#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/matchers.hpp"
#include "support/streamed_cloud.hpp"

namespace maquette::scan {
namespace {

using namespace testing_support;
using testing::HasSubstr;

StreamedCloud one_station(const CloudFields& fields, int colour_bits = 8) {
  StreamedCloud cloud;
  cloud.stations = {sample_station(fields, 20, 30, 1)};
  cloud.stations[0].model_from_station = {};
  cloud.stations[0].colour_bits = colour_bits;
  cloud.points = {sample_points(fields, 20, 30, 1, colour_bits)};
  return cloud;
}

class SimpleFormat : public testing::TestWithParam<const char*> {};
INSTANTIATE_TEST_SUITE_P(By, SimpleFormat, testing::Values("a.ply", "a.xyz", "a.csv"),
                         [](const auto& file) { return std::string(file.param).substr(2); });

TEST_P(SimpleFormat, HoldsEveryFieldToTheBit) {
  const ScratchFolder folder;
  std::vector<int> choices = {0, 127};  // none, all, one alone, all but one
  for (int bit = 1; bit < 128; bit *= 2) choices.insert(choices.end(), {bit, 127 - bit});
  for (const int parts : choices) {
    CloudFields f;
    f.intensity = (parts & 1) != 0;
    f.colour = (parts & 2) != 0;
    f.normals = (parts & 4) != 0;
    f.grid = (parts & 8) != 0;
    f.time = (parts & 16) != 0;
    f.returns = (parts & 32) != 0;
    f.scan_angle = (parts & 64) != 0;
    const StreamedCloud cloud = one_station(f);
    ASSERT_THAT(stream_out(cloud, folder / GetParam()), Succeeds());
    const auto back = stream_in(folder / GetParam());
    ASSERT_THAT(back, Succeeds());
    ASSERT_EQ(back->stations.size(), 1U);
    EXPECT_EQ(back->stations[0].fields, f);
    EXPECT_EQ(back->stations[0].position_mm, cloud.stations[0].position_mm);
    const PointBatch &in = cloud.points[0], &out = back->points[0];
    EXPECT_EQ(out.points_mm, in.points_mm);
    EXPECT_EQ(out.intensity, in.intensity);
    EXPECT_EQ(out.colours, in.colours);
    EXPECT_EQ(out.grid, in.grid);
    EXPECT_EQ(out.time_s, in.time_s);
    EXPECT_EQ(out.return_index, in.return_index);
    EXPECT_EQ(out.return_count, in.return_count);
    EXPECT_EQ(out.scan_angle_rad, in.scan_angle_rad);
    ASSERT_EQ(out.normals.size(), in.normals.size());
    for (std::size_t i = 0; i < in.normals.size(); ++i)  // to unit length again: an ulp or two
      ASSERT_NEAR(norm(out.normals[i] - in.normals[i]), 0.0, 4e-16);
  }
}

TEST_P(SimpleFormat, GivesTheSameInBatchesOfAnySize) {
  const ScratchFolder folder;
  ASSERT_THAT(stream_out(one_station(all_fields()), folder / GetParam()), Succeeds());
  const auto whole = stream_in(folder / GetParam());
  ASSERT_THAT(whole, Succeeds());
  for (const std::size_t size : {1U, 7U, 599U, 600U, 601U}) {
    const auto reader = open_cloud(folder / GetParam(), {.unit_mm = {}, .batch_points = size});
    ASSERT_THAT(reader, Succeeds());
    PointBatch batch;
    std::size_t batches = 0;
    while (*(*reader)->next(batch)) {
      ++batches;
      EXPECT_LE(batch.size(), size);
    }
    EXPECT_EQ(batches, (600 + size - 1) / size);
    const auto again = stream_in(folder / GetParam(), {.unit_mm = {}, .batch_points = size});
    ASSERT_THAT(again, Succeeds());
    EXPECT_EQ(again->points[0].points_mm, whole->points[0].points_mm);
    EXPECT_EQ(again->points[0].grid, whole->points[0].grid);
  }
}

TEST_P(SimpleFormat, BringsStationsToTheModelFrameAndForgetsTheirPositions) {
  const ScratchFolder folder;
  CloudFields f;
  f.normals = true;
  StreamedCloud cloud;
  for (std::uint64_t s = 0; s < 3; ++s) {
    cloud.stations.push_back(sample_station(f, 4, 5, s));
    cloud.points.push_back(sample_points(f, 4, 5, s));
  }
  cloud.stations[1].fields.flags = true;
  cloud.points[1].flags.resize(20);
  cloud.points[1].flags[3] = kNoPosition;
  cloud.points[1].flags[4] = kDirectionOnly;
  ASSERT_THAT(stream_out(cloud, folder / GetParam()), Succeeds());
  const auto back = stream_in(folder / GetParam());
  ASSERT_THAT(back, Succeeds());
  ASSERT_EQ(back->points[0].size(), 58U) << "points without position are left out";
  EXPECT_FALSE(back->stations[0].position_mm);
  std::size_t i = 0;
  for (std::size_t s = 0; s < 3; ++s)
    for (std::size_t k = 0; k < 20; ++k) {
      if (!cloud.points[s].has_position(k)) continue;
      const RigidTransform& pose = cloud.stations[s].model_from_station;
      EXPECT_EQ(back->points[0].points_mm[i], pose.point(cloud.points[s].points_mm[k]));
      EXPECT_NEAR(norm(back->points[0].normals[i] - pose.direction(cloud.points[s].normals[k])), 0,
                  1e-15);
      ++i;
    }
}

TEST_P(SimpleFormat, RefusesAStationOfAnotherLayout) {
  const ScratchFolder folder;
  StreamedCloud cloud = one_station({});
  CloudFields f;
  f.intensity = true;
  cloud.stations.push_back(sample_station(f, 2, 2, 2));
  cloud.points.push_back(sample_points(f, 2, 2, 2));
  const auto result = stream_out(cloud, folder / GetParam());
  ASSERT_THAT(result, FailsWith(kCloudCannotHold));
  EXPECT_THAT(result.error().message, HasSubstr("station 1 has other fields"));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path())) << "nothing may remain";
}

TEST_P(SimpleFormat, TakesAnotherUnit) {
  const ScratchFolder folder;
  const StreamedCloud cloud = one_station({});
  CloudWriteOptions metres;
  metres.unit_mm = 1000.0;
  ASSERT_THAT(stream_out(cloud, folder / GetParam(), metres), Succeeds());
  const auto raw = stream_in(folder / GetParam());
  ASSERT_THAT(raw, Succeeds());
  const auto back = stream_in(folder / GetParam(), {.unit_mm = 1000.0});
  ASSERT_THAT(back, Succeeds());
  for (std::size_t i = 0; i < cloud.points[0].size(); ++i) {
    const Vec3 p = cloud.points[0].points_mm[i];
    EXPECT_EQ(raw->points[0].points_mm[i].x, p.x / 1000.0);
    EXPECT_NEAR(back->points[0].points_mm[i].x, p.x, 2.0 * 2.3e-16 * p.x);
  }
  EXPECT_EQ(back->stations[0].position_mm, cloud.stations[0].position_mm) << "its name says mm";
  for (const double unit : {0.0, -1.0, static_cast<double>(NAN), static_cast<double>(INFINITY)}) {
    CloudWriteOptions bad;
    bad.unit_mm = unit;
    EXPECT_THAT(create_cloud(folder / GetParam(), bad), FailsWith(kCloudFormat));
    EXPECT_THAT(open_cloud(folder / GetParam(), {.unit_mm = unit}), FailsWith(kCloudFormat));
  }
}

TEST_P(SimpleFormat, AppearsWhenFinished) {
  const ScratchFolder folder;
  {
    const auto writer = create_cloud(folder / GetParam());
    ASSERT_THAT(writer, Succeeds());
    ASSERT_THAT((*writer)->begin_station({}), Succeeds());
    PointBatch batch;
    batch.points_mm.resize(100'000);
    ASSERT_THAT((*writer)->write(batch), Succeeds());
    EXPECT_FALSE(std::filesystem::exists(folder / GetParam()));
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(PlyStream, KeepsSixteenBitColours) {
  const ScratchFolder folder;
  CloudFields f;
  f.colour = true;
  const StreamedCloud cloud = one_station(f, 16);
  ASSERT_THAT(stream_out(cloud, folder / "a.ply"), Succeeds());
  const auto back = stream_in(folder / "a.ply");
  ASSERT_THAT(back, Succeeds());
  EXPECT_EQ(back->stations[0].colour_bits, 16);
  EXPECT_EQ(back->points[0].colours, cloud.points[0].colours);
}

TEST(PlyStream, ScalesColoursByTheirType) {
  const auto colour = [](const char* type, const char* values) {
    const auto cloud = stream_bytes(
        "a.ply", std::string("ply\nformat ascii 1.0\nelement vertex 1\nproperty float x\nproperty "
                             "float y\nproperty float z\nproperty ") +
                     type + " red\nproperty " + type + " green\nproperty " + type +
                     " blue\nend_header\n1 2 3 " + values + "\n");
    return cloud ? cloud->points[0].colours.at(0) : Colour{};
  };
  EXPECT_EQ(colour("uchar", "0 1 255"), (Colour{0, 257, 65535}));
  EXPECT_EQ(colour("ushort", "0 1 65535"), (Colour{0, 1, 65535}));
  EXPECT_EQ(colour("float", "-1 0.5 7"), (Colour{0, 32768, 65535}));
}

TEST(Inspect, CountsAndBoundsAWholeFile) {
  const ScratchFolder folder;
  StreamedCloud cloud = one_station(all_fields());
  ASSERT_THAT(stream_out(cloud, folder / "a.ply"), Succeeds());
  const auto info = inspect_cloud(folder / "a.ply");
  ASSERT_THAT(info, Succeeds());
  Box3 box;
  for (const Vec3 p : cloud.points[0].points_mm) box.add(p);
  EXPECT_EQ(info->format, "PLY");
  EXPECT_EQ(info->points, 600U);
  EXPECT_EQ(info->without_position, 0U);
  EXPECT_EQ(info->bounds_mm.min, box.min);
  EXPECT_EQ(info->bounds_mm.max, box.max);
  std::stop_source stop;
  stop.request_stop();
  RunContext run;
  run.stop = stop.get_token();
  EXPECT_THAT(inspect_cloud(folder / "a.ply", {}, run), FailsWith(kCancelled));
}

// Of 200 000 about 20 000 stay, the same every time, evenly in the order of the file,
// whether the format says how many it has or not; a file with fewer is read as it is.
TEST(ReadShare, KeepsAnEvenPartOfALargeFile) {
  const ScratchFolder folder;
  Cloud cloud;
  for (int i = 0; i < 200'000; ++i) {
    cloud.points_mm.push_back({0.001 * i, 1.0, 2.0});
    cloud.intensity.push_back(static_cast<float>(i % 7));
  }
  for (const char* name : {"a.ply", "a.e57", "a.xyz", "a.pts"}) {
    ASSERT_THAT(write_cloud(cloud, folder / name), Succeeds());
    const auto whole = read_cloud(folder / name, {}, 200'000);
    ASSERT_THAT(whole, Succeeds());
    EXPECT_EQ(whole->points_mm.size(), 200'000U) << name;
    EXPECT_EQ(whole->passed_over, 0U) << name;
    const auto some = read_cloud(folder / name, {}, 20'000);
    ASSERT_THAT(some, Succeeds());
    EXPECT_NEAR(static_cast<double>(some->points_mm.size()), 20'000.0, 4.0 * std::sqrt(20'000.0))
        << name;
    EXPECT_EQ(some->points_mm.size() + some->passed_over, 200'000U) << name;
    ASSERT_EQ(some->intensity.size(), some->points_mm.size()) << name;
    std::array<int, 10> tenths{};
    for (std::size_t i = 0; i < some->points_mm.size(); ++i) {
      const double number = some->points_mm[i].x / 0.001;
      ++tenths[static_cast<std::size_t>(std::min(9.0, number / 20'000.0))];
      ASSERT_TRUE(i == 0 || some->points_mm[i].x > some->points_mm[i - 1].x) << name;
    }
    for (const int n : tenths) EXPECT_NEAR(n, 2'000, 5.0 * std::sqrt(1'800.0)) << name;
    const auto again = read_cloud(folder / name, {}, 20'000);
    ASSERT_THAT(again, Succeeds());
    EXPECT_EQ(again->points_mm, some->points_mm) << name;
  }
}

TEST(CloudStations, SurviveInACloudOnlyAsFarAsAllHaveTheSameParts) {
  const ScratchFolder folder;
  Cloud cloud;
  cloud.points_mm = {{1, 2, 3}, {4, 5, 6}};
  cloud.colours = {{257, 514, 65535}, {0, 1, 65534}};
  cloud.grid = {{3, 4}, {4, 4}};
  ASSERT_THAT(write_cloud(cloud, folder / "a.ply"), Succeeds());
  const auto back = read_cloud(folder / "a.ply");
  ASSERT_THAT(back, Succeeds());
  EXPECT_EQ(back->points_mm, cloud.points_mm);
  EXPECT_EQ(back->grid, cloud.grid);
  EXPECT_EQ(back->colours[0], cloud.colours[0]);
  EXPECT_EQ(back->colours[1], (Colour{0, 0, 65535})) << "to eight bits";
  ASSERT_EQ(back->stations.size(), 1U);
  EXPECT_EQ(back->stations[0].points, 2U);
}

TEST(ByteSource, ReadsLinesAndBytesAcrossItsWindow) {
  const ScratchFolder folder;
  std::string text;
  for (int i = 0; i < 300'000; ++i) text += std::to_string(i) + (i % 2 == 0 ? "\n" : "\r\n");
  text += std::string(3'000'000, 'x') + "\nlast";
  std::ofstream(folder / "a", std::ios::binary) << text;
  auto source = detail::ByteSource::open(folder / "a");
  ASSERT_THAT(source, Succeeds());
  for (int i = 0; i < 300'000; ++i) ASSERT_EQ(source->line(), std::to_string(i));
  EXPECT_EQ(source->line()->size(), detail::ByteSource::kLongestLine) << "cut";
  const std::uint64_t at = source->position();
  source->seek(5);
  EXPECT_EQ(source->peek(4), text.substr(5, 4));
  source->seek(at);
  EXPECT_EQ(source->peek(2'000'000), text.substr(at, 2'000'000));
  EXPECT_EQ(source->peek(9'000'000), text.substr(at)) << "what is there";
  source->seek(1'000'000'000);
  EXPECT_EQ(source->remaining(), 0U);
  EXPECT_FALSE(source->line());
  EXPECT_THAT(detail::ByteSource::open(folder / "none"), FailsWith(kFileNotFound));
  EXPECT_THAT(detail::ByteSource::open(folder.path()), FailsWith(kFileNotReadable));
}

}  // namespace
}  // namespace maquette::scan

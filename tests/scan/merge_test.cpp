// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in scan/merge.hpp, and how each claim is attacked:
//
//   poses ................. four scans round a part, displaced by up to 6 mm and 0.6 degrees: the
//                           true places come back, the loop closes
//   covariance ............ squares of normalised errors of 12 merges have mean 1
//   overlap ............... of two halves: what they share
//   colour ................ gains of each camera, with some pixels that are wrong
//   files ................. stations, order, gains, poses of what is written; shares for the poses
//   every refusal ......... one case each

#include "scan/merge.hpp"

#include <cmath>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <Eigen/Dense>

#include "scan/merge_files.hpp"
#include "scan/scanner_sim.hpp"
#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;
using testing_support::FailsWith;
using testing_support::random_pose;
using testing_support::rough_part;
using testing_support::ScratchFolder;
using testing_support::seen_from;
using testing_support::Succeeds;

const Vec3 kMiddle{150.0, 150.0, 10.0};

/// A scan of a part of 300 mm from one of four sides.
Cloud scan_from(const ModelField& part, int side, std::uint64_t seed, double sigma_mm = 0.1,
                double gain = 1.0) {
  ScanOptions o;
  o.scanner.name = "test";
  o.scanner.lines_per_turn = 4000.0;
  o.scanner.range_sigma_mm = sigma_mm * 5.0;  // at 600 mm the signal is 25 times that at 3 m
  const double a = 1.5707963267948966 * side;
  o.station_mm = kMiddle + Vec3{400.0 * std::cos(a), 400.0 * std::sin(a), 450.0};
  o.footprint_rays = 1;
  o.seed = seed;
  o.colour = true;
  o.paint = [gain](Vec3 p, bool) {
    const double v = 20'000.0 + 8'000.0 * std::sin(0.05 * p.x) * std::cos(0.04 * p.y);
    const auto level = [&](double g) { return static_cast<std::uint16_t>(v * g); };
    return SurfaceLook{0.5, {level(gain), level(1.0), level(0.8 / gain)}};
  };
  auto cloud = simulate_scan(part, {}, o);
  EXPECT_TRUE(cloud.has_value());
  return *std::move(cloud);
}

TEST(Merge, PutsFourScansInTheirPlaces) {
  const ModelField part = rough_part(3, 301, 301, 1.0, 2.0);
  std::vector<Cloud> scans;
  std::vector<RigidTransform> moved;
  for (int side = 0; side < 4; ++side) {
    const auto seed = static_cast<std::uint64_t>(side);
    moved.push_back(side == 0 ? RigidTransform{} : random_pose(40 + seed, kMiddle, 0.01, 6.0));
    scans.push_back(seen_from(scan_from(part, side, seed, 0.1, 1.0 + 0.1 * side), moved.back()));
    scans.back().stations.front().position_mm = scans.back().station_mm;
  }
  const auto merge = merge_scans(scans);
  ASSERT_THAT(merge, Succeeds());
  ASSERT_EQ(merge->scans.size(), 4U);
  EXPECT_EQ(merge->pairs.size(), 6U) << "all see all";
  EXPECT_EQ(merge->scans[0].correction, RigidTransform{});
  for (std::size_t i = 1; i < 4; ++i) {
    const RigidTransform left = merge->scans[i].correction * moved[i];
    // 20 000 points of 0.1 mm in some 4000 pieces: 0.002 mm of height; the rest is four times that.
    for (const Vec3 corner : {Vec3{0, 0, 10}, Vec3{300, 0, 10}, Vec3{0, 300, 10}, kMiddle})
      EXPECT_LT(norm(left.point(corner) - corner), 0.02) << i;
    EXPECT_GT(merge->scans[i].overlap, 0.8);
  }
  for (const MergePair& p : merge->pairs) {
    EXPECT_GT(p.overlap, 0.6);
    EXPECT_LT(p.misfit_mm, 0.05) << "the loop closes";
    EXPECT_GT(p.noise_mm, 0.01);
    EXPECT_LT(p.noise_mm, 0.2);
  }
  // Red differs by the gains, blue against them; green is the same. Geometric means are 1.
  const double g1 = merge->scans[1].gain[0] / merge->scans[0].gain[0];
  const double g3 = merge->scans[3].gain[0] / merge->scans[0].gain[0];
  EXPECT_NEAR(g1, 1.0 / 1.1, 0.002);
  EXPECT_NEAR(g3, 1.0 / 1.3, 0.002);
  EXPECT_NEAR(merge->scans[3].gain[2] / merge->scans[0].gain[2], 1.3, 0.003);
  EXPECT_NEAR(merge->scans[2].gain[1], 1.0, 0.002);
  double product = 1.0;
  for (const MergedPose& p : merge->scans) product *= p.gain[0];
  EXPECT_NEAR(product, 1.0, 1e-9);
}

TEST(Merge, StatesItsCovariance) {
  // Errors of the second of two scans by the stated covariance.
  double sum = 0.0;
  int n = 0;
  for (std::uint64_t run = 0; run < 12; ++run) {
    const ModelField part = rough_part(10 + run, 151, 151, 2.0, 3.0);
    const RigidTransform moved = random_pose(run, kMiddle, 0.003, 2.0);
    std::vector<Cloud> scans{scan_from(part, 0, 2 * run),
                             seen_from(scan_from(part, 1, 2 * run + 1), moved)};
    const auto merge = merge_scans(scans);
    ASSERT_THAT(merge, Succeeds());
    const MergedPose& p = merge->scans[1];
    const RigidTransform left = p.correction * moved;
    const Vec3 shift = left.point(p.centre_mm) - p.centre_mm;
    Eigen::Matrix<double, 6, 1> e;
    e << shift.x, shift.y, shift.z, 2 * left.rotation.x, 2 * left.rotation.y, 2 * left.rotation.z;
    if (left.rotation.w < 0.0) e.tail<3>() *= -1.0;
    const Eigen::Map<const Eigen::Matrix<double, 6, 6>> c(p.covariance.data());
    sum += e.dot(c.inverse() * e);
    EXPECT_LT(shift.x * shift.x + shift.y * shift.y + shift.z * shift.z, 0.01 * 0.01);
    n += 6;
  }
  // Mean of 72 squares: 1, three standard deviations of it are 0.5.
  EXPECT_GT(sum / n, 0.5);
  EXPECT_LT(sum / n, 1.5);
}

TEST(Merge, MeasuresTheOverlap) {
  const ModelField part = rough_part(4, 301, 301, 1.0, 2.0);
  const Cloud all = scan_from(part, 0, 1), other = scan_from(part, 1, 2);
  std::vector<Cloud> halves(2);
  for (const Vec3& p : all.points_mm)
    if (p.x < 200.0) halves[0].points_mm.push_back(p);
  for (const Vec3& p : other.points_mm)
    if (p.x > 100.0) halves[1].points_mm.push_back(p);
  MergeOptions o;
  o.poses = false;
  o.voxel_mm = 6.0;
  const auto merge = merge_scans(halves, o);
  ASSERT_THAT(merge, Succeeds());
  EXPECT_EQ(merge->scans[1].correction, RigidTransform{});
  // 100 of 200 mm and what the gate of two voxels adds.
  EXPECT_GT(merge->pairs[0].overlap, 0.45);
  EXPECT_LT(merge->pairs[0].overlap, 0.62);
}

TEST(Merge, GainsStandSomeWrongPixels) {
  const ModelField part = rough_part(5, 151, 151, 2.0, 2.0);
  std::vector<Cloud> scans{scan_from(part, 0, 1), scan_from(part, 1, 2, 0.1, 1.25)};
  // A tenth of one scan's area shows something else.
  for (std::size_t i = 0; i < scans[1].points_mm.size(); ++i)
    if (scans[1].points_mm[i].x < 30.0) scans[1].colours[i] = {60'000, 500, 30'000};
  MergeOptions o;
  o.poses = false;
  const auto merge = merge_scans(scans, o);
  ASSERT_THAT(merge, Succeeds());
  EXPECT_NEAR(merge->scans[0].gain[0] / merge->scans[1].gain[0], 1.25, 0.01);
  EXPECT_NEAR(merge->scans[0].gain[1] / merge->scans[1].gain[1], 1.0, 0.01);
}

TEST(MergedFiles, ReadsAllScansAsOneCloud) {
  const ScratchFolder folder;
  Cloud a, b;
  for (int i = 0; i < 200; ++i) {
    a.points_mm.push_back({1.0 * i, 0, 0});
    a.colours.push_back({60'000, 100, 10});
    b.points_mm.push_back({0, 1.0 * i, 0});
    b.colours.push_back({257, 514, 771});
    b.intensity.push_back(0.5F);
  }
  a.stations.resize(3);
  for (std::size_t k = 0; k < 3; ++k) {
    a.stations[k].points = k == 1 ? 0 : 100;  // one that saw nothing
    a.stations[k].name = fmt::format("s{}", k);
    a.stations[k].colour_bits = 16;
    a.stations[k].model_from_station.translation_mm = {0, 0, 100.0 + static_cast<double>(k)};
    a.stations[k].position_mm = a.stations[k].model_from_station.translation_mm;
  }
  ASSERT_THAT(write_cloud(a, folder / "a.e57"), Succeeds());
  ASSERT_THAT(write_cloud(b, folder / "b.ply"), Succeeds());
  MergedFiles merged;
  merged.files = {folder / "a.e57", folder / "b.ply"};
  merged.scans = {{"a", 0, 0, 100, 0}, {"c", 0, 2, 100, 0}, {"b", 1, 0, 200, 0}};
  merged.fields.colour = true;
  merged.merge.scans.resize(3);
  merged.merge.scans[1].correction = random_pose(3, kMiddle, 0.1, 5.0);
  merged.merge.scans[1].gain = {2.0, 0.5, 1.0};
  ASSERT_THAT(copy_cloud([&] { return open_merged(merged); }, folder / "m.e57"), Succeeds());
  const auto all = read_cloud(folder / "m.e57");
  ASSERT_THAT(all, Succeeds());
  ASSERT_EQ(all->points_mm.size(), 400U);
  EXPECT_TRUE(all->intensity.empty()) << "only one has it";
  ASSERT_EQ(all->stations.size(), 3U) << "the empty one is no scan";
  EXPECT_EQ(all->stations[1].name, "s2");
  const RigidTransform& moved = merged.merge.scans[1].correction;
  // Metres in the file: some 1e-13 mm.
  EXPECT_LT(norm(all->points_mm[99] - a.points_mm[99]), 1e-9);
  EXPECT_LT(norm(all->points_mm[103] - moved.point(a.points_mm[103])), 1e-9);
  EXPECT_LT(norm(all->points_mm[207] - b.points_mm[7]), 1e-9);
  EXPECT_LT(norm(*all->stations[1].position_mm - moved.point({0, 0, 102})), 1e-9);
  EXPECT_EQ(all->colours[0], a.colours[0]);
  EXPECT_EQ(all->colours[100], (Colour{65'535, 50, 10}));
}

// Poses from a share of the points are worth what that share is: the covariance says it.
TEST(MergedFiles, TakesAnEvenShareForThePoses) {
  const ScratchFolder folder;
  const ModelField part = rough_part(3, 301, 301, 1.0, 2.0);
  const RigidTransform moved = random_pose(41, kMiddle, 0.005, 3.0);
  const Cloud one = scan_from(part, 0, 1);
  Cloud two = seen_from(scan_from(part, 1, 2), moved);
  two.stations.front().position_mm = two.station_mm;
  std::vector<std::filesystem::path> files{folder / "a.ply", folder / "b.ply"};
  ASSERT_THAT(write_cloud(one, files[0]), Succeeds());
  ASSERT_THAT(write_cloud(two, files[1]), Succeeds());
  const auto whole = merge_files(files);
  ASSERT_THAT(whole, Succeeds());
  EXPECT_EQ(whole->scans[1].used, two.points_mm.size());
  const std::uint64_t all = one.points_mm.size() + two.points_mm.size();
  const auto share = merge_files(files, {}, {}, all / 5);
  ASSERT_THAT(share, Succeeds());
  std::uint64_t used = 0;
  for (std::size_t k = 0; k < 2; ++k) {
    const FileScan& s = share->scans[k];
    EXPECT_EQ(s.points, k == 0 ? one.points_mm.size() : two.points_mm.size());
    // Halved until they fit: an eighth each, or an eighth and a quarter of 1 : 1.
    EXPECT_GT(static_cast<double>(s.used), 0.1 * static_cast<double>(s.points));
    EXPECT_LT(static_cast<double>(s.used), 0.3 * static_cast<double>(s.points));
    used += s.used;
  }
  EXPECT_LE(used, all / 5);
  for (const auto* m : {&*whole, &*share}) {
    const MergedPose& p = m->merge.scans[1];
    const RigidTransform left = p.correction * moved;
    const double stated = std::sqrt(p.covariance[0] + p.covariance[7] + p.covariance[14]);
    EXPECT_LT(norm(left.point(p.centre_mm) - p.centre_mm), 3.0 * stated);
    EXPECT_LT(stated, m == &*whole ? 0.01 : 0.1);
  }
  EXPECT_GT(share->merge.scans[1].covariance[14], whole->merge.scans[1].covariance[14]);
}

TEST(MergeRefuses, WhatCannotBeMerged) {
  const ModelField part = rough_part(7, 151, 151, 2.0, 2.0);
  const Cloud one = scan_from(part, 0, 1), two = scan_from(part, 1, 2);
  EXPECT_THAT(merge_scans(std::vector<Cloud>{one}), FailsWith(kMergeOptions));
  EXPECT_THAT(merge_scans(std::vector<Cloud>{one, Cloud{}}), FailsWith(kMergeOptions));
  MergeOptions bad;
  bad.voxel_mm = -1.0;
  EXPECT_THAT(merge_scans(std::vector<Cloud>{one, two}, bad), FailsWith(kMergeOptions));
  Cloud far = two;
  for (Vec3& p : far.points_mm) p.x += 900.0;
  EXPECT_THAT(merge_scans(std::vector<Cloud>{one, far}), FailsWith(kMergeApart));
  MergeOptions hasty;
  hasty.most_rounds = 1;
  EXPECT_THAT(
      merge_scans(std::vector<Cloud>{one, seen_from(two, random_pose(1, kMiddle, 0.01, 5))}, hasty),
      FailsWith(kMergeNotConverged));
  // A plane slides on itself.
  const ModelField flat{Grid<float>(151, 151, 10.0F), Millimetres{2.0}};
  EXPECT_THAT(merge_scans(std::vector<Cloud>{scan_from(flat, 0, 1), scan_from(flat, 1, 2)}),
              FailsWith(kMergeFree));
  std::stop_source stop;
  stop.request_stop();
  RunContext run;
  run.stop = stop.get_token();
  EXPECT_THAT(merge_scans(std::vector<Cloud>{one, two}, {}, run), FailsWith(kCancelled));
}

}  // namespace
}  // namespace maquette::scan

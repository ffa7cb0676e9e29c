// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in scan/find_stones.hpp: six stones are laid, one is moved by 0.5 mm and turned
// by 3 degrees, one is missing, two are swapped, two lie as planned. The points are put on the
// meshes as they really lie, with noise along z; the search knows only the plan. Then simulated
// scanners look at stones of 9 mm from two sides: how often one that stands is called moved, and
// whether what moved is where it is said to be.

#include "scan/find_stones.hpp"

#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "scan/clean.hpp"
#include "scan/scanner_sim.hpp"
#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;
using meshing::PlacedStone;
using testing_support::points_on;
using testing_support::rough_part;
using testing_support::Succeeds;

constexpr double kDegree = std::numbers::pi / 180.0;

std::vector<PlacedStone> plan_on(const ModelField& ground, std::uint64_t seed) {
  std::vector<PlacedStone> plan;
  for (int k = 0; k < 6; ++k) {
    PlacedStone s;
    s.number = k + 1;
    s.shape.seed = seed + static_cast<std::uint64_t>(k);
    s.shape.elongation = 0.6 + 0.05 * k;
    s.shape.flatness = 0.6 + 0.05 * k;
    s.scale_mm = 24.0;
    const double x = 50.0 + 60.0 * (k % 3), y = 60.0 + 80.0 * (k / 3);
    s.model_from_stone.rotation = rotation_about({0, 0, 1}, 0.7 * k);
    s.model_from_stone.translation_mm = {x, y, heightmap::height_at(ground, x, y) + 3.0};
    plan.push_back(s);
  }
  return plan;
}

TEST(FindStones, ToldApartAndMeasured) {
  double chi2 = 0.0;
  int wrong = 0;
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const ModelField ground = rough_part(seed, 221, 221, 1.0, 0.2);
    const auto plan = plan_on(ground, 10 * seed);
    auto actual = plan;
    // Moved by 0.5 mm and turned by 3 degrees about its middle.
    const TriMesh before = meshing::stone_mesh(plan[1]);
    const Vec3 middle = 0.5 * (before.bounds().min + before.bounds().max);
    const Quaternion turn = rotation_about({0, 0, 1}, 3.0 * kDegree);
    const Vec3 shift{0.3, -0.4, 0.0};
    const RigidTransform move{turn, middle - rotate(turn, middle) + shift};
    actual[1].model_from_stone = move * plan[1].model_from_stone;
    std::swap(actual[3].shape, actual[4].shape);
    actual.erase(actual.begin() + 2);
    const double sigma = 0.05;
    // On the fine envelope of the meshes themselves.
    ModelField fine{Grid<float>(1761, 1761), Millimetres{0.125}};
    for (std::ptrdiff_t r = 0; r < 1761; ++r)
      for (std::ptrdiff_t c = 0; c < 1761; ++c)
        fine.z_mm(r, c) =
            static_cast<float>(heightmap::height_at(ground, fine.x_mm(c), fine.y_mm(r)));
    fine = meshing::with_stones(fine, actual);
    const Cloud cloud = points_on(fine, 120'000, seed, sigma);
    const auto found_stones = find_stones(cloud.points_mm, {}, ground, plan, sigma, nullptr);
    ASSERT_THAT(found_stones, Succeeds());
    const auto& found = *found_stones;
    ASSERT_EQ(found.size(), 6U);
    EXPECT_EQ(name_of(found[1].state), "moved") << "seed " << seed;
    EXPECT_EQ(name_of(found[2].state), "missing") << "seed " << seed;
    EXPECT_EQ(name_of(found[3].state), "swapped") << "seed " << seed;
    EXPECT_EQ(found[3].carries, 5) << "seed " << seed;
    EXPECT_EQ(name_of(found[4].state), "swapped") << "seed " << seed;
    EXPECT_EQ(found[4].carries, 4) << "seed " << seed;
    for (const int k : {0, 5})
      if (found[static_cast<std::size_t>(k)].state != StoneState::as_planned) ++wrong;
    const StoneFinding& f = found[1];
    EXPECT_NEAR(f.shift_mm.x, 0.3, 4.0 * f.sigma_shift_mm.x + 0.01) << "seed " << seed;
    EXPECT_NEAR(f.shift_mm.y, -0.4, 4.0 * f.sigma_shift_mm.y + 0.01) << "seed " << seed;
    EXPECT_NEAR(f.turn_rad / kDegree, 3.0, (4.0 * f.sigma_turn_rad) / kDegree + 0.05)
        << "seed " << seed;
    EXPECT_LT(f.sigma_shift_mm.x, 0.05);
    EXPECT_LT(f.sigma_turn_rad, 0.01);
    chi2 += std::pow((f.shift_mm.x - 0.3) / f.sigma_shift_mm.x, 2) +
            std::pow((f.shift_mm.y + 0.4) / f.sigma_shift_mm.y, 2) +
            std::pow((f.turn_rad - 3.0 * kDegree) / f.sigma_turn_rad, 2);
  }
  RecordProperty("chi2", std::to_string(chi2));
  // 9 degrees of freedom; 0.1 % beyond 27.9.
  EXPECT_LT(chi2, 27.9);
  EXPECT_LE(wrong, 1) << "of 6, each called moved with 1 %";
}

// Stones of 4 mm in noise of 0.4 mm (a single point's five sigma are half their height), and the
// same seen at half their height, as a beam of their width does.
TEST(FindStones, SmallStonesAreNotMissing) {
  int missing = 0, gone = 0, blurred = 0;
  for (std::uint64_t seed = 1; seed <= 3; ++seed) {
    const ModelField ground = rough_part(seed, 221, 221, 1.0, 0.02);
    auto plan = plan_on(ground, 10 * seed);
    for (PlacedStone& s : plan) {
      s.scale_mm = 4.0;
      s.model_from_stone.translation_mm.z -= 2.5;
    }
    ModelField fine{Grid<float>(881, 881), Millimetres{0.25}};
    for (std::ptrdiff_t r = 0; r < 881; ++r)
      for (std::ptrdiff_t c = 0; c < 881; ++c)
        fine.z_mm(r, c) =
            static_cast<float>(heightmap::height_at(ground, fine.x_mm(c), fine.y_mm(r)));
    const ModelField with = meshing::with_stones(fine, plan);
    ModelField half = with;
    for (std::ptrdiff_t r = 0; r < 881; ++r)
      for (std::ptrdiff_t c = 0; c < 881; ++c)
        half.z_mm(r, c) = 0.5F * (with.z_mm(r, c) + fine.z_mm(r, c));
    const auto count = [&](const ModelField& seen) {
      const Cloud cloud = points_on(seen, 500'000, seed, 0.4);
      int n = 0;
      const auto found = find_stones(cloud.points_mm, {}, ground, plan, 0.4, nullptr);
      EXPECT_THAT(found, Succeeds());
      for (const auto& f : *found) n += f.state == StoneState::missing ? 1 : 0;
      return n;
    };
    missing += count(with);
    blurred += count(half);
    gone += count(fine);
  }
  EXPECT_EQ(missing, 0);
  EXPECT_EQ(blurred, 0);
  EXPECT_EQ(gone, 18) << "of 18 that are not there";
}

/// Six stones of 9 mm on 70 x 50 mm, their meshes where they really are, and what two scanners see
/// of them.
struct Scanned {
  ModelField ground;
  std::vector<PlacedStone> plan;
  std::vector<Viewpoint> views;
  std::vector<Vec3> points;
};

/// How the stones stand and are looked at: one row clear of the other, or close behind it and from
/// low down, so that each hides part of the next.
struct Setting {
  double row_mm = 24.0, station_z_mm = 900.0;
};
constexpr Setting kOneBehindTheOther{13.0, 450.0};

/// @param moves  of the stones, by number
Scanned scanned(std::uint64_t seed, double beam_mm, std::span<const RigidTransform> moves = {},
                const Setting& setting = {}) {
  Scanned s{rough_part(seed, 101, 141, 0.5, 0.5), {}, {}, {}};
  std::vector<TriMesh> meshes;
  for (std::uint64_t k = 0; k < 6; ++k) {
    PlacedStone stone;
    stone.number = static_cast<int>(k) + 1;
    stone.shape.seed = 100 * seed + k;
    stone.shape.elongation = 0.6 + 0.4 * random_uniform(seed, 10 * k);
    stone.shape.flatness = 0.6 + 0.4 * random_uniform(seed, 10 * k + 1);
    stone.scale_mm = 9.0;
    const double x = 12.0 + 23.0 * static_cast<double>(k % 3);
    const double y = 25.0 + setting.row_mm * (static_cast<double>(k / 3) - 0.5);
    stone.model_from_stone.rotation =
        rotation_about({0, 0, 1}, 6.0 * random_uniform(seed, 10 * k + 2));
    stone.model_from_stone.translation_mm = {x, y, heightmap::height_at(s.ground, x, y) + 1.5};
    s.plan.push_back(stone);
    PlacedStone actual = stone;
    if (!moves.empty()) actual.model_from_stone = moves[k] * stone.model_from_stone;
    meshes.push_back(meshing::stone_mesh(actual));
  }
  ScanOptions o;
  o.scanner.range_sigma_mm = 0.19;
  o.scanner.noise_exponent = 0.0;
  o.scanner.lines_per_turn = 12'000;
  o.scanner.beam_diameter_mm = beam_mm;
  o.scanner.beam_divergence_mrad = 0.0;
  o.footprint_rays = beam_mm > 0.0 ? 61 : 1;
  for (const double side : {-1.0, 1.0}) {
    o.station_mm = {35.0, 25.0 + side * 800.0, setting.station_z_mm};
    o.seed = 2 * seed + (side > 0.0 ? 1 : 0);
    const auto cloud = simulate_scan(s.ground, meshes, o);
    EXPECT_THAT(cloud, Succeeds());
    s.views.push_back({o.station_mm, beam_mm, cloud->points_mm.size()});
    s.points.insert(s.points.end(), cloud->points_mm.begin(), cloud->points_mm.end());
  }
  return s;
}

// Chances of stones that stand are even between 0 and 1: as many below 0.1 as a tenth of them, as
// many below 0.5 as half (3.5 standard deviations of such counts).
// @param largest_bias  of the height, in its standard deviations
void false_calls(double beam_mm, std::uint64_t runs, double largest_bias,
                 const Setting& setting = {}) {
  int plans_called = 0, tenth = 0, half = 0;
  double n = 0.0, mean_z = 0.0;
  for (std::uint64_t seed = 1; seed <= runs; ++seed) {
    const Scanned s = scanned(seed, beam_mm, {}, setting);
    const auto found = find_stones(s.points, s.views, s.ground, s.plan, 0.19, nullptr);
    ASSERT_THAT(found, Succeeds());
    bool called = false;
    for (const StoneFinding& f : *found) {
      ASSERT_TRUE(f.state == StoneState::as_planned || f.state == StoneState::moved)
          << "seed " << seed << ", stone " << f.number << " is " << name_of(f.state);
      called = called || f.state == StoneState::moved;
      tenth += f.chance < 0.1 ? 1 : 0;
      half += f.chance < 0.5 ? 1 : 0;
      mean_z += f.shift_mm.z / f.sigma_shift_mm.z;
      n += 1.0;
    }
    plans_called += called ? 1 : 0;
  }
  ::testing::Test::RecordProperty(
      "rates", fmt::format("{} stones, {} plans called moved, {:.3f} below 0.1, {:.3f} below 0.5, "
                           "height {:+.2f} sigma",
                           n, plans_called, tenth / n, half / n, mean_z / n));
  // One plan in a hundred; three of forty come once in a hundred times.
  EXPECT_LE(plans_called, 2);
  EXPECT_NEAR(tenth / n, 0.1, 3.5 * std::sqrt(0.09 / n));
  EXPECT_NEAR(half / n, 0.5, 3.5 * std::sqrt(0.25 / n));
  EXPECT_LT(std::abs(mean_z / n), largest_bias);
}

TEST(FindStones, WhatStandsIsCalledMovedAsOftenAsTheLevelSays) {
  false_calls(0.0, 40, 3.5 / std::sqrt(240.0));
}

// What is measured of the stone in front is none of the one behind it: beams that would go on to
// that one pulled at its chance.
TEST(FindStones, SoBehindOtherStones) {
  false_calls(0.0, 40, 3.5 / std::sqrt(240.0), kOneBehindTheOther);
}

// Where 19 rays stood for a beam beside an edge too, beams counted by what these rays said of them,
// and all were 0.46 of a standard deviation low, 0.007 mm.
TEST(FindStones, SoWithABeamOfAThirdOfTheStone) {
  false_calls(3.0, 8, 3.0 / std::sqrt(48.0));
}

// Cleaning takes out what floats between a stone's edge and the ground behind it, farther than
// noise explains from both. Without these points those are left that noise or a small share of the
// beam keeps near the stone, and it comes out higher: by more than two standard deviations of the
// mean difference, whose noise both fits share in part. With them it is not high: 3.5 standard
// deviations of the mean of 48 stones.
TEST(FindStones, MixedPointsKeepThemFromBeingHigh) {
  double with = 0.0, without = 0.0, square = 0.0, n = 0.0;
  std::size_t points_with = 0, points_mixed = 0;
  for (std::uint64_t seed = 1; seed <= 8; ++seed) {
    const Scanned s = scanned(seed, 3.0);
    std::vector<Vec3> kept, mixed;
    std::vector<Viewpoint> views, mixed_views;
    std::size_t first = 0;
    for (const Viewpoint& view : s.views) {
      Cloud cloud, apart;
      cloud.points_mm.assign(s.points.begin() + static_cast<std::ptrdiff_t>(first),
                             s.points.begin() + static_cast<std::ptrdiff_t>(first + view.points));
      cloud.station_mm = view.station_mm;
      first += view.points;
      CleanOptions o;
      o.least_neighbours = 0;
      o.beam_diameter_mm = 3.0;
      o.beam_divergence_mrad = 0.0;
      const auto figures = clean_cloud(cloud, o, {}, &apart);
      ASSERT_THAT(figures, Succeeds());
      EXPECT_EQ(apart.points_mm.size(), figures->mixed);
      EXPECT_EQ(cloud.points_mm.size() + apart.points_mm.size(), view.points);
      EXPECT_EQ(apart.station_mm, view.station_mm);
      kept.insert(kept.end(), cloud.points_mm.begin(), cloud.points_mm.end());
      mixed.insert(mixed.end(), apart.points_mm.begin(), apart.points_mm.end());
      views.push_back({view.station_mm, 3.0, cloud.points_mm.size()});
      mixed_views.push_back({view.station_mm, 3.0, apart.points_mm.size()});
    }
    const auto heights = [&] {
      const auto found = find_stones(kept, views, s.ground, s.plan, 0.19, nullptr);
      EXPECT_THAT(found, Succeeds());
      std::vector<double> sigmas;
      for (const StoneFinding& f : *found) sigmas.push_back(f.shift_mm.z / f.sigma_shift_mm.z);
      return sigmas;
    };
    const std::vector<double> without_them = heights();
    points_mixed += mixed.size();
    kept.insert(kept.end(), mixed.begin(), mixed.end());
    views.insert(views.end(), mixed_views.begin(), mixed_views.end());
    points_with += kept.size();
    const std::vector<double> with_them = heights();
    for (std::size_t k = 0; k < 6; ++k) {
      with += with_them[k], without += without_them[k];
      square += std::pow(without_them[k] - with_them[k], 2);
    }
    n += 6.0;
  }
  const double higher = (without - with) / n;
  const double sigma = std::sqrt((square / n - higher * higher) / n);
  RecordProperty("height",
                 fmt::format("{:+.2f} sigma with, {:+.2f} without {} of {} points; "
                             "difference {:.2f} +- {:.2f}",
                             with / n, without / n, points_mixed, points_with, higher, sigma));
  EXPECT_LT(std::abs(with / n), 3.5 / std::sqrt(n));
  EXPECT_GT(higher, 2.0 * sigma);
}

TEST(FindStones, MovedStonesAreWhereTheyAreSaidToBe) {
  for (const auto& [beam_mm, runs] : {std::pair{0.0, 20U}, std::pair{3.0, 3U}}) {
    double chi2 = 0.0, degrees = 0.0;
    int called = 0;
    for (std::uint64_t seed = 1; seed <= runs; ++seed) {
      // Each by 0.5 mm somewhere, and turned by 3 degrees about its middle.
      const Scanned planned = scanned(seed, beam_mm);
      std::vector<RigidTransform> moves;
      std::vector<Vec3> shifts;
      for (std::uint64_t k = 0; k < 6; ++k) {
        const Box3 box = meshing::stone_mesh(planned.plan[k]).bounds();
        const Vec3 middle = 0.5 * (box.min + box.max);
        const double heading = 6.28 * random_uniform(seed, 1000 + k);
        shifts.push_back({0.5 * std::cos(heading), 0.5 * std::sin(heading), 0.0});
        const Quaternion turn = rotation_about({0, 0, 1}, 3.0 * kDegree);
        moves.push_back({turn, middle - rotate(turn, middle) + shifts.back()});
      }
      const Scanned s = scanned(seed, beam_mm, moves);
      const auto found = find_stones(s.points, s.views, s.ground, s.plan, 0.19, nullptr);
      ASSERT_THAT(found, Succeeds());
      for (std::size_t k = 0; k < 6; ++k) {
        const StoneFinding& f = (*found)[k];
        called += f.state == StoneState::moved ? 1 : 0;
        chi2 += std::pow((f.shift_mm.x - shifts[k].x) / f.sigma_shift_mm.x, 2) +
                std::pow((f.shift_mm.y - shifts[k].y) / f.sigma_shift_mm.y, 2) +
                std::pow((f.turn_rad - 3.0 * kDegree) / f.sigma_turn_rad, 2);
        degrees += 3.0;
      }
    }
    RecordProperty(
        fmt::format("beam_{:.0f}", beam_mm),
        fmt::format("{} of {} called, chi2 {:.1f} of {}", called, 6 * runs, chi2, degrees));
    EXPECT_EQ(called, static_cast<int>(6 * runs)) << beam_mm;
    EXPECT_LT(chi2, degrees + 4.0 * std::sqrt(2.0 * degrees)) << beam_mm;
    // 360 scores of rays: 1 to 0.04.
    if (beam_mm == 0.0) {
      EXPECT_NEAR(std::sqrt(chi2 / degrees), 1.0, 0.2);
    }
  }
}

TEST(FindStones, UnseenWithoutPoints) {
  const ModelField ground = rough_part(1, 221, 221, 1.0, 0.2);
  const auto plan = plan_on(ground, 1);
  const auto found = find_stones({}, {}, ground, plan, 0.05, nullptr);
  ASSERT_THAT(found, Succeeds());
  EXPECT_EQ(found->size(), 6U);
  for (const auto& f : *found) EXPECT_EQ(f.state, StoneState::unseen);
}

}  // namespace
}  // namespace maquette::scan

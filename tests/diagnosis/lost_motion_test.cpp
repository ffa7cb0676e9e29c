// SPDX-License-Identifier: GPL-3.0-or-later

// How large lost motion is found to be, on a zigzag whose tips are displaced by a play operator and
// whose surface is the least of dense samples of the balls (shares no code).
//
//   0.4 mm, ridges as cut ... named alone, with a width within its error

#include <algorithm>
#include <cmath>
#include <fstream>
#include <vector>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "diagnosis/diagnose.hpp"
#include "diagnosis/path_contact.hpp"
#include "diagnosis/surface.hpp"
#include "support/matchers.hpp"

namespace maquette::diagnosis {
namespace {

constexpr double kRadius_mm = 3.0, kStepover_mm = 0.5, kSide_mm = 60.0, kSample_mm = 0.05;
constexpr double kWhite_mm = 0.03;

double ground_mm(double x, double y) {
  return 10.0 + 1.6 * std::sin(x / 3.1 + 0.3 * std::sin(y / 5.0)) + 0.8 * std::cos(y / 4.3) +
         0.5 * std::sin(0.7 * x - 0.4 * y);
}

Vec3 slope_normal(double x, double y) {
  constexpr double h = 1e-4;
  return normalized(Vec3{-(ground_mm(x + h, y) - ground_mm(x - h, y)) / (2.0 * h),
                         -(ground_mm(x, y + h) - ground_mm(x, y - h)) / (2.0 * h), 1.0});
}

/// Tips along the zigzag, pass by pass.
std::vector<std::vector<Vec3>> command() {
  std::vector<std::vector<Vec3>> passes;
  const int count = static_cast<int>(kSide_mm / kSample_mm);
  for (double y = 0.0; y < kSide_mm + 1e-9; y += kStepover_mm) {
    std::vector<Vec3> pass;
    for (int i = 0; i <= count; ++i) {
      const double x = kSample_mm * (passes.size() % 2 == 0 ? i : count - i);
      const Vec3 n = slope_normal(x, y);
      pass.push_back(Vec3{x, y, ground_mm(x, y)} + kRadius_mm * n - Vec3{0.0, 0.0, kRadius_mm});
    }
    passes.push_back(std::move(pass));
  }
  return passes;
}

/// The same with play along x.
std::vector<std::vector<Vec3>> played(std::vector<std::vector<Vec3>> passes, double width_mm) {
  double at = passes.front().front().x;
  for (auto& pass : passes)
    for (Vec3& tip : pass)
      tip.x = at = std::clamp(at, tip.x - 0.5 * width_mm, tip.x + 0.5 * width_mm);
  return passes;
}

double lowest_mm(const std::vector<std::vector<Vec3>>& passes, double x, double y) {
  double low = INFINITY;
  for (const auto& pass : passes) {
    if (!(std::abs(y - pass.front().y) < kRadius_mm)) continue;
    for (const Vec3& t : pass) {
      const double q = kRadius_mm * kRadius_mm - (x - t.x) * (x - t.x) - (y - t.y) * (y - t.y);
      if (q > 0.0 && t.z < low) low = std::min(low, t.z + kRadius_mm - std::sqrt(q));
    }
  }
  return low;
}

Measurements part(const CutPath& path, const std::vector<std::vector<Vec3>>& cut,
                  std::uint64_t seed) {
  Measurements m;
  heightmap::ModelField corners;
  corners.spacing = Millimetres{kSide_mm};
  corners.z_mm = Grid<float>(2, 2, 7.0F);
  corners.z_mm(1, 1) = 13.0F;
  m.scene = scene_of(corners, &path, kRadius_mm);
  m.scene.has_station = {false};
  m.scene.stations = {{}};
  m.set_ups.emplace_back();
  m.set_ups[0].name = "scan";
  m.set_ups[0].centre_mm = {0.5 * kSide_mm, 0.5 * kSide_mm, 10.0};
  for (std::uint64_t i = 0; i < 12'000; ++i) {
    const double x = 4.0 + (kSide_mm - 8.0) * random_uniform(seed, 2 * i),
                 y = 4.0 + (kSide_mm - 8.0) * random_uniform(seed, 2 * i + 1);
    std::vector<Rival> rivals;
    const auto contact = path.at(x, y, &rivals);
    Observation o;
    static_cast<CutState&>(o) = *contact;
    o.place = {x, y, contact->height_mm};
    o.normal = o.along = contact->normal;
    o.slope_normal = slope_normal(x, y);
    o.level_tip = o.place + kRadius_mm * (o.slope_normal - Vec3{0.0, 0.0, 1.0});
    o.rivals = std::make_shared<std::vector<Rival>>(std::move(rivals));
    o.pass = path.pass();
    o.residual_mm =
        (lowest_mm(cut, x, y) - o.place.z) * o.normal.z + kWhite_mm * random_normal(seed + 1, i);
    m.observations.push_back(std::move(o));
  }
  return m;
}

TEST(LostMotion, IsFoundWhereItIsFarLargerThanTheRidges) {
  constexpr double kWidth_mm = 0.4;
  constexpr std::uint64_t kSeed = 20'261'127;
  const testing_support::ScratchFolder scratch;
  const auto passes = command();
  std::string text = "G21 G90 F2000\n";
  for (const auto& pass : passes)
    for (std::size_t i = 0; i < pass.size(); i += 5)
      text += fmt::format("G1 X{:.5f} Y{:.5f} Z{:.5f}\n", pass[i].x, pass[i].y, pass[i].z);
  std::ofstream(scratch / "part.ngc") << text << "M30\n";
  const std::vector<std::filesystem::path> files{scratch / "part.ngc"};
  const auto path = CutPath::read(files, kRadius_mm, {});
  ASSERT_TRUE(path.has_value());
  const auto d = diagnose(part(*path, played(passes, kWidth_mm), kSeed), 1);
  ASSERT_TRUE(d.has_value());
  const auto found = std::find_if(d->causes.begin(), d->causes.end(),
                                  [](const Cause& c) { return c.effect == "machine.backlash_x"; });
  ASSERT_TRUE(found != d->causes.end()) << d->verdict;
  EXPECT_EQ(d->causes.size(), 1U);
  const Estimate& size = found->parameters[0];
  EXPECT_NEAR(size.value, kWidth_mm, 4.5 * size.sigma) << "seed " << kSeed;
  EXPECT_LT(size.sigma, 0.01 * kWidth_mm);
}

}  // namespace
}  // namespace maquette::diagnosis

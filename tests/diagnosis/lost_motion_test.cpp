// SPDX-License-Identifier: GPL-3.0-or-later

// How large lost motion is found to be, on a zigzag whose tips are displaced by a play operator and
// whose surface is the least of dense samples of the balls (shares no code).
//
//   0.4 mm, measured upright or from aside ... named alone, with a width within its error
//   0.1 and 0.4 mm, from aside, no noise .... as predicted within 2.5 % of what it moves; no place
//       is thrown far off where a pass turns and the axis stands still

#include <algorithm>
#include <cmath>
#include <fstream>
#include <optional>
#include <vector>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "diagnosis/diagnose.hpp"
#include "diagnosis/effect.hpp"
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

/// Of a scanner beside the part; without, the surface is measured upright.
using Station_mm = std::optional<Vec3>;
const Station_mm kAside{{-800.0, 450.0, 750.0}};

/// @return false where no beam comes to the place
bool look(Observation& o, const Station_mm& station) {
  if (!station) return true;
  o.has_station = true;
  o.range_mm = norm(o.place - *station);
  o.beam = (1.0 / o.range_mm) * (o.place - *station);
  constexpr double kLeastCosine = 0.35;
  return dot(o.beam, o.slope_normal) < -kLeastCosine;
}

/// From the place to the cut surface along what it is measured by, along the normal.
double residual_mm(const Observation& o, const std::vector<std::vector<Vec3>>& cut) {
  const Vec3 back = o.has_station ? -1.0 * o.beam : Vec3{0.0, 0.0, 1.0};
  const auto above = [&](double far) {
    const Vec3 q = o.place + far * back;
    return q.z - lowest_mm(cut, q.x, q.y);
  };
  double near = 0.0, at_near = above(0.0), far = -at_near, at_far = above(far);
  for (int k = 0; k < 8 && std::abs(at_far) > 1e-6; ++k) {
    const double next = far - at_far * (far - near) / (at_far - at_near);
    near = far;
    at_near = at_far;
    far = next;
    at_far = above(far);
  }
  return far * dot(back, o.normal);
}

Measurements part(const CutPath& path, const std::vector<std::vector<Vec3>>& cut,
                  const Station_mm& station, double white_mm, std::uint64_t seed) {
  Measurements m;
  heightmap::ModelField corners;
  corners.spacing = Millimetres{kSide_mm};
  corners.z_mm = Grid<float>(2, 2, 7.0F);
  corners.z_mm(1, 1) = 13.0F;
  m.scene = scene_of(corners, &path, kRadius_mm);
  m.scene.has_station = {station.has_value()};
  m.scene.stations = {station.value_or(Vec3{})};
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
    if (!look(o, station)) continue;
    o.residual_mm = residual_mm(o, cut) + white_mm * random_normal(seed + 1, i);
    m.observations.push_back(std::move(o));
  }
  return m;
}

/// The program as it is written, every sample.
CutPath written(const std::vector<std::vector<Vec3>>& passes) {
  const testing_support::ScratchFolder scratch;
  std::string text = "G21 G90 F2000\n";
  for (const auto& pass : passes)
    for (const Vec3& p : pass) text += fmt::format("G1 X{:.5f} Y{:.5f} Z{:.5f}\n", p.x, p.y, p.z);
  std::ofstream(scratch / "part.ngc") << text << "M30\n";
  const std::vector<std::filesystem::path> files{scratch / "part.ngc"};
  return CutPath::read(files, kRadius_mm, {}).value();
}

class SeenFromAside : public testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(Width_mm, SeenFromAside, testing::Values(0.1, 0.4));

TEST_P(SeenFromAside, LostMotionMovesAllPlacesAsPredicted) {
  const double width_mm = GetParam();
  const auto passes = command();
  const CutPath path = written(passes);
  const Measurements m = part(path, played(passes, width_mm), kAside, 0.0, 1);
  const auto forms = find_effect("machine.backlash_x")->forms(m.scene);
  const Form form = forms[0].of_size(width_mm);
  double moved = 0.0, left = 0.0, worst_mm = 0.0;
  for (const Observation& o : m.observations) {
    const double off_mm = 0.5 * width_mm * form.columns[0].value(o) - o.residual_mm;
    moved += o.residual_mm * o.residual_mm;
    left += off_mm * off_mm;
    worst_mm = std::fmax(worst_mm, std::abs(off_mm));
  }
  EXPECT_LT(std::sqrt(left / moved), 0.025);
  // Seen at 65 degrees off the normal beyond passes that are not known to run there.
  EXPECT_LT(worst_mm, 0.06 * width_mm);
}

class LostMotion : public testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(FromAside, LostMotion, testing::Bool());

TEST_P(LostMotion, IsFoundWhereItIsFarLargerThanTheRidges) {
  constexpr double kWidth_mm = 0.4;
  constexpr std::uint64_t kSeed = 20'261'127;
  const auto passes = command();
  const CutPath path = written(passes);
  const auto d = diagnose(
      part(path, played(passes, kWidth_mm), GetParam() ? kAside : std::nullopt, kWhite_mm, kSeed),
      1);
  ASSERT_TRUE(d.has_value());
  const auto found = std::find_if(d->causes.begin(), d->causes.end(),
                                  [](const Cause& c) { return c.effect == "machine.backlash_x"; });
  ASSERT_TRUE(found != d->causes.end()) << d->verdict;
  EXPECT_EQ(d->causes.size(), 1U);
  EXPECT_EQ(d->verdict, "explained");
  const Estimate& size = found->parameters[0];
  EXPECT_NEAR(size.value, kWidth_mm, 4.5 * size.sigma) << "seed " << kSeed;
  // From aside a fifth of the places is not seen, and oblique ones say less.
  EXPECT_LT(size.sigma, (GetParam() ? 0.015 : 0.01) * kWidth_mm);
}

}  // namespace
}  // namespace maquette::diagnosis

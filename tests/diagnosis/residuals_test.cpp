// SPDX-License-Identifier: GPL-3.0-or-later

// What causes that move passes do together with the poses of the scans, on a part of level passes
// 0.5 mm apart along y; its surface is the lowest of circles.
//
//   all passes one way, the part the other .... nothing, to a float's rounding
//   half of the passes one way, and a pose .... the lowest of the moved circles
//   and a scanner that is off as far as the pose, far ... the same as without these two
//   a pose and a scanner, no such cause ....... the lowest of the moved circles

#include <algorithm>
#include <cmath>

#include <gtest/gtest.h>

#include "diagnosis/detail/forms.hpp"
#include "diagnosis/detail/residuals.hpp"

namespace maquette::diagnosis::detail {
namespace {

constexpr double kRadius_mm = 3.0, kStepover_mm = 0.5, kMiddle_mm = 20.0;

/// Underside of a ball whose pass runs `off` from a place.
double underside_mm(double off) {
  return kRadius_mm - std::sqrt(kRadius_mm * kRadius_mm - off * off);
}

/// Of a place the pass that made it, and its neighbours as rivals.
Observation seen_at(double x) {
  const double mine = std::round(x / kStepover_mm);
  const auto state = [](double pass) {
    CutState s;
    s.tip = {kStepover_mm * pass, 0.0, 0.0};
    s.feed = {0.0, 1.0, 0.0};
    return s;
  };
  const auto normal = [x](double pass) {
    const double off = x - kStepover_mm * pass;
    return (1.0 / kRadius_mm) * Vec3{-off, 0.0, std::sqrt(kRadius_mm * kRadius_mm - off * off)};
  };
  Observation o;
  static_cast<CutState&>(o) = state(mine);
  const double height = underside_mm(x - kStepover_mm * mine);
  o.place = {x, 0.0, height};
  o.normal = o.along = normal(mine);
  o.slope_normal = {0.0, 0.0, 1.0};
  std::vector<Rival> rivals;
  for (const double pass : {mine - 2.0, mine - 1.0, mine + 1.0, mine + 2.0})
    rivals.push_back({state(pass), normal(pass), underside_mm(x - kStepover_mm * pass) - height});
  o.rivals = std::make_shared<const std::vector<Rival>>(std::move(rivals));
  return o;
}

std::vector<Observation> part() {
  std::vector<Observation> all;
  for (double x = 15.003; x < 25.0; x += 0.017) all.push_back(seen_at(x));
  return all;
}

/// Passes from x on moved along x, to first order where the ball is alone.
Column moved_from(double x) {
  const auto from = [x](const CutState& s) { return Vec3{s.tip.x > x ? 1.0 : 0.0, 0.0, 0.0}; };
  Column c{"moved", {"moved_mm", 1.0, INFINITY}, [from](const Observation& o) {
             return dot(o.along, from(o));
           }};
  c.cut = [from](const Observation&, const CutState& s, Vec3) { return CutChange{from(s)}; };
  return c;
}

/// What passes moved by `cause`, and a scan moved by `pose` and by what its scanner is off, along
/// x, change of each observation, mm. Where `cause` is 0 the model has none that acts on passes.
std::vector<double> changes(const std::vector<Observation>& all, double from, double cause,
                            double pose, double scanner = 0.0) {
  Measurements m;
  m.scene.box.add({0, 0, 0});
  m.scene.box.add({40, 40, 1});
  m.set_ups.emplace_back();
  m.set_ups[0].centre_mm = {20, 20, 0};
  Bank bank;
  bank.columns = nuisances_of(m);
  bank.nuisances = static_cast<int>(bank.columns.size());
  bank.columns.push_back(moved_from(from));
  bank.columns.push_back(moving_column("scanner", {"", 1.0, INFINITY}, [](const Observation&) {
    return Vec3{1.0, 0.0, 0.0};
  }));
  for (int k = 0; k < bank.y(); ++k) bank.index[bank.columns[static_cast<std::size_t>(k)].key] = k;
  std::vector<Member> members{{nullptr, Form{"", {bank.columns.back()}}}};
  if (cause != 0.0) members.push_back({nullptr, Form{"", {bank.columns.end()[-2]}}});
  const auto model = columns_of(bank, members);
  Eigen::VectorXd b = Eigen::VectorXd::Zero(static_cast<Eigen::Index>(model.size()));
  const auto size_of = [&](int column) -> double& {
    return b(std::find(model.begin(), model.end(), column) - model.begin());
  };
  size_of(0) = pose;
  size_of(bank.y() - 1) = scanner;
  if (cause != 0.0) size_of(bank.y() - 2) = cause;
  Signatures known;
  LagAndSlack both{m.scene};
  std::vector<double> sum = beyond_linear(all, {}, members, bank, b, kRadius_mm, true, known, both);
  for (std::size_t i = 0; i < all.size(); ++i)
    for (std::size_t k = 0; k < model.size(); ++k)
      sum[i] += b(static_cast<Eigen::Index>(k)) *
                bank.columns[static_cast<std::size_t>(model[k])].value(all[i]);
  return sum;
}

/// Circles whose pass was planned at x are moved by moved_mm(x).
template <class Moved>
void expect_lowest_circles(const std::vector<Observation>& all, const std::vector<double>& found,
                           const Moved& moved_mm) {
  double most = 0.0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const double x = all[i].place.x;
    double lowest = INFINITY;
    for (int pass = 0; pass < 80; ++pass) {
      const double planned = kStepover_mm * pass, now = planned + moved_mm(planned);
      if (std::abs(x - now) < kRadius_mm) lowest = std::min(lowest, underside_mm(x - now));
    }
    const double truth = (lowest - all[i].place.z) * all[i].normal.z;
    most = std::max(most, std::abs(truth));
    EXPECT_NEAR(found[i], truth, 1e-7) << "x = " << x;
  }
  // Ridges are 10 um high: half a stepover from its pass a ball of 3 mm rises by 0.25^2 / 6 mm.
  EXPECT_GT(most, 0.005) << "there is something to see";
}

TEST(Residuals, APartThatIsMovedBackIsWhereItWas) {
  const auto all = part();
  // Signatures are kept as floats.
  for (const double c : changes(all, -INFINITY, 0.14, -0.14)) EXPECT_NEAR(c, 0.0, 1e-7);
}

TEST(Residuals, AStepOfHalfThePassesMovesRidgesWithThePart) {
  constexpr double kStep_mm = 0.14, kPose_mm = -0.07;
  const auto all = part();
  expect_lowest_circles(all, changes(all, kMiddle_mm, kStep_mm, kPose_mm), [](double planned) {
    return kPose_mm + (planned > kMiddle_mm ? kStep_mm : 0.0);
  });
}

// Models with such a cause and without compare: what both move, both move with its ridges.
TEST(Residuals, WhatMovesThePartAloneMovesItsRidgesToo) {
  constexpr double kPose_mm = -0.05, kScanner_mm = 0.19;
  const auto all = part();
  expect_lowest_circles(all, changes(all, kMiddle_mm, 0.0, kPose_mm, kScanner_mm),
                        [](double) { return kPose_mm + kScanner_mm; });
}

// A range that is 1.2 mm too long and poses that make up for it: the ridges stay where they are.
TEST(Residuals, WhatPosesMakeUpForMovesNoRidges) {
  const auto all = part();
  const auto plain = changes(all, kMiddle_mm, 0.14, -0.07),
             beside = changes(all, kMiddle_mm, 0.14, -0.07 - 1.2, 1.2);
  for (std::size_t i = 0; i < all.size(); ++i) EXPECT_NEAR(beside[i], plain[i], 1e-7);
}

}  // namespace
}  // namespace maquette::diagnosis::detail

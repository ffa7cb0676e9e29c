// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include "core/chi_squared.hpp"
#include "core/random.hpp"
#include "diagnosis/detail/model_search.hpp"
#include "diagnosis/detail/remainder.hpp"
#include "diagnosis/diagnose.hpp"
#include "support/smooth_part.hpp"

namespace maquette::diagnosis {
namespace {

using detail::kAll;
using testing_support::field;
using testing_support::laid_out;
using testing_support::noise_alone;
using testing_support::u;
using testing_support::v;

/// What smooth causes look like.
std::vector<Column> long_waves() {
  const auto column = [](const char* key, double (*value)(const Observation&)) {
    return Column{key, {"size", 1.0, 1.0}, value};
  };
  return {
      column("bow", [](const Observation& o) { return o.normal.z * u(o) * u(o); }),
      column("twist", [](const Observation& o) { return o.normal.z * u(o) * v(o); }),
      column("cubic", [](const Observation& o) { return o.normal.z * v(o) * v(o) * v(o); }),
      column("wave", [](const Observation& o) { return o.normal.z * std::sin(8.0 * u(o)); }),
      column("drift",
             [](const Observation& o) { return o.normal.z * std::expm1(-o.path_share / 0.1); }),
      column("scale", [](const Observation& o) { return o.normal.x * u(o); }),
      column("step", [](const Observation& o) { return o.path_share > 0.43 ? o.normal.z : 0.0; }),
  };
}

// A block with a smooth part of its own, under little noise of points: what it does to causes with
// long waves. Standard errors must be those that estimates have, and nothing is confirmed. With
// blocks of different sets taken for independent and heights taken for residuals along normals they
// were up to three times too small at 28 mm, four at 60 mm.
class SmoothNoise : public testing::TestWithParam<double> {};
INSTANTIATE_TEST_SUITE_P(Length_mm, SmoothNoise, testing::Values(10.0, 28.0, 60.0));

TEST_P(SmoothNoise, IsNotTakenForEvidence) {
  const double length_mm = GetParam();
  const auto columns = long_waves();
  constexpr int kDraws = 12;
  double all = 0.0;
  int confirmed = 0;
  std::vector<double> squares(columns.size());
  for (int k = 0; k < kDraws; ++k) {
    const auto seed = 1000 + 10 * static_cast<std::uint64_t>(k);
    const auto m = noise_alone(seed, 0.007, 0.019, length_mm);
    const auto layout = laid_out(m, static_cast<std::uint64_t>(k));
    detail::Bank bank = detail::sum_up(m.observations, detail::nuisances_of(m), columns, layout);
    const auto empty = detail::columns_of(bank, {});
    bank.weight = detail::effective_weights(bank, empty, detail::fit(bank, empty, kAll));
    const double null = detail::fit(bank, empty, {detail::kConfirm}).objective;
    for (std::size_t c = 0; c < columns.size(); ++c) {
      auto model = empty;
      model.push_back(bank.index.at(columns[c].key));
      const auto at = static_cast<Eigen::Index>(model.size()) - 1;
      const double gain = null - detail::fit(bank, model, {detail::kConfirm}).objective;
      confirmed += chi_squared_tail(std::fmax(0.0, gain), 1) < 1e-3;
      const auto f = detail::fit(bank, model, kAll);
      const double z2 = f.coefficients(at) * f.coefficients(at) / f.covariance(at, at);
      squares[c] += z2 / kDraws;
      all += z2 / static_cast<double>(kDraws * columns.size());
    }
  }
  // Of 84 estimates in 12 draws, correlated by halves within a draw: 10 % for the root of the mean
  // square; one column of 12 estimates 20 %. Lengths that the grid of processes has not: 15 % more.
  EXPECT_GT(std::sqrt(all), 0.7) << "seeds 1000, 1010, ...";
  EXPECT_LT(std::sqrt(all), 1.35);
  for (std::size_t c = 0; c < columns.size(); ++c)
    EXPECT_LT(std::sqrt(squares[c]), 1.9) << columns[c].key;
  EXPECT_LE(confirmed, 1) << "0.08 expected";
}

// Standard errors on a block that is uneven under a rough coat, as told (sizes.cpp). Details that
// were not told of the unevenness, for a coat hid it, and the likeliest law of the noise taken for
// the only one left them 1.26 times too small over these draws (10 % for that root, as above).
TEST(SmoothNoise, UnderACoatLeavesSizesOpen) {
  const auto columns = long_waves();
  constexpr int kDraws = 24;
  double all = 0.0;
  for (int k = 0; k < kDraws; ++k) {
    const auto seed = 1000 + 10 * static_cast<std::uint64_t>(k);
    auto m = noise_alone(seed, 0.007, 0.018, 60.0);
    const auto coat = field(seed + 5, 0.023, 1.5);
    for (Observation& o : m.observations) o.residual_mm += coat(o.place.x, o.place.y) * o.normal.z;
    const auto layout = laid_out(m, static_cast<std::uint64_t>(k));
    EXPECT_GE(layout.smooth.length_mm, 30.0) << "seed " << seed;
    detail::Bank bank = detail::sum_up(m.observations, detail::nuisances_of(m), columns, layout);
    const auto empty = detail::columns_of(bank, {});
    bank.weight = detail::effective_weights(bank, empty, detail::fit(bank, empty, kAll));
    for (const Column& c : columns) {
      auto model = empty;
      model.push_back(bank.index.at(c.key));
      const auto at = static_cast<Eigen::Index>(model.size()) - 1;
      const auto f = detail::fit(bank, model, kAll);
      const double variance = detail::overstated(bank, model, empty, f) *
                              detail::covariance_over_laws(bank, model, f, kAll)(at, at);
      all += f.coefficients(at) * f.coefficients(at) / variance /
             static_cast<double>(kDraws * columns.size());
    }
  }
  EXPECT_GT(std::sqrt(all), 0.8) << "seeds 1000, 1010, ...";
  EXPECT_LT(std::sqrt(all), 1.2);
}

// A block that is uneven under a rough coat. A process of one length for both was exponential, of
// 8 to 133 mm on these; beside one of 8 mm unevenness of 0.018 mm over 65 mm was a warp, confirmed.
TEST(SmoothNoise, IsToldFromTheCoatOnIt) {
  constexpr double kSmooth_mm = 0.018, kLength_mm = 60.0, kCoat_mm = 0.023, kCoatLength_mm = 2.5;
  for (const std::uint64_t seed : {11U, 12U, 13U, 14U}) {
    auto m = noise_alone(seed, 0.007, kSmooth_mm, kLength_mm);
    const auto coat = field(seed + 5, kCoat_mm, kCoatLength_mm);
    for (Observation& o : m.observations) o.residual_mm += coat(o.place.x, o.place.y) * o.normal.z;
    const auto layout = laid_out(m, 1);
    const auto bank = detail::sum_up(m.observations, detail::nuisances_of(m), {}, layout);
    const auto f = detail::fit(bank, detail::columns_of(bank, {}), kAll);
    const auto& law = bank.theta[static_cast<std::size_t>(f.theta[0])];
    const double smooth_mm = std::sqrt(law.smooth_ratio() * f.top_variance[0]);
    // Less its plane a process of 60 mm on a part of 160 mm is a dozen independent places: a
    // standard error of a fifth for what it is, two of them and a step of the grid's lengths.
    EXPECT_GT(law.rough, 0.0) << "seed " << seed;
    EXPECT_GT(law.length_mm, kLength_mm / 2.0) << "seed " << seed;
    EXPECT_LT(law.length_mm, kLength_mm * 2.0) << "seed " << seed;
    EXPECT_GT(smooth_mm, 0.6 * kSmooth_mm) << "seed " << seed;
    EXPECT_LT(smooth_mm, 1.6 * kSmooth_mm) << "seed " << seed;
  }
}

// Columns beside others never make the data less likely. Coefficients and process are fitted in
// turn, and with starts of one ratio for each length the longer of two curves was 30 worse (seeds
// as below; over a wavy guide of 0.07 mm).
TEST(SmoothNoise, IsFittedAsWellWithMoreColumns) {
  for (const auto seed : std::vector<std::uint64_t>{50, 60, 70, 80}) {
    auto m = noise_alone(seed, 0.05, 0.006, 34.0);
    for (Observation& o : m.observations)
      o.residual_mm += 0.1 * o.normal.z * std::sin(2.0 * std::numbers::pi * 0.6 * u(o) + 0.7);
    std::vector<Column> columns;
    for (int degree = 2; degree <= 8; ++degree)
      columns.push_back({std::to_string(degree), {"size", 1.0, 1.0}, [=](const Observation& o) {
                           return o.normal.z * std::legendre(static_cast<unsigned>(degree), u(o));
                         }});
    const detail::Bank bank =
        detail::sum_up(m.observations, detail::nuisances_of(m), columns, laid_out(m, seed));
    for (const auto& sets : {std::vector<int>{detail::kChoose}, kAll}) {
      auto model = detail::columns_of(bank, {});
      double before = detail::fit(bank, model, sets).objective;
      for (const Column& c : columns) {
        model.push_back(bank.index.at(c.key));
        const double now = detail::fit(bank, model, sets).objective;
        // Restricted likelihoods of the same nuisances; rounds end where they change by 0.01.
        EXPECT_LT(now, before + 0.5) << "seed " << seed << ", degree " << c.key;
        before = now;
      }
    }
  }
}

// A crack of 0.15 mm that runs obliquely over a part under a rough coat: a process of some length
// took it for unevenness, and along rows and columns of cells no edge is clear.
TEST(SmoothNoise, IsNoCrack) {
  constexpr std::uint64_t kSeed = 90;
  for (const double crack_mm : {0.0, 0.15})
    for (const double azimuth : {0.25, 0.79, 2.2}) {
      auto m = noise_alone(kSeed, 0.05, 0.006, 34.0);
      const auto coat = field(kSeed + 5, 0.04, 1.8);
      std::vector<double> left;
      for (Observation& o : m.observations) {
        const double side =
            std::cos(azimuth) * (o.place.y - 85.0) - std::sin(azimuth) * (o.place.x - 70.0);
        o.residual_mm += (coat(o.place.x, o.place.y) + (side > 0.0 ? crack_mm : 0.0)) * o.normal.z;
        left.push_back(o.residual_mm - 0.5 * crack_mm * o.normal.z);
      }
      const auto layout = laid_out(m, 1);
      const auto bank = detail::sum_up(m.observations, detail::nuisances_of(m), {}, layout);
      const auto f = detail::fit(bank, detail::columns_of(bank, {}), kAll);
      detail::Squares odd;
      const auto rest = detail::judge(m.observations, left, layout, bank, f, odd);
      EXPECT_EQ(std::count(rest.kinds.begin(), rest.kinds.end(), "edges"), crack_mm > 0.0 ? 1 : 0)
          << azimuth << ", seed " << kSeed;
    }
}

// A process of a few cells' length leaves nothing to details that means of cells do not tell.
TEST(SmoothNoise, LeavesDetailsBlind) {
  for (const auto& [length_mm, left] :
       {std::pair{60.0, 0.07}, {28.0, 0.12}, {16.0, 0.25}, {2.0, 2.0}}) {
    // Against those of a quadrant's mean about the cell's mean without what neighbours tell.
    auto m = noise_alone(77, 0.0, 0.019, length_mm);
    const auto layout = laid_out(m, 1);
    const auto bank = detail::sum_up(m.observations, detail::nuisances_of(m), {}, layout);
    double squares = 0.0, count = 0.0;
    for (const auto& set : bank.sets) {
      squares += set.gram[0](bank.y(), bank.y());
      count += set.count[0];
    }
    // Slopes of the process are sigma / length; quarters are a quarter of a cell off its centre,
    // of about nine points each from both set-ups.
    const double points = static_cast<double>(m.observations.size()) / (4.0 * 24 * 24);
    const double slopes =
        points * 4.0 / 3.0 * 2.0 * std::pow(0.019 / length_mm * 0.25 * layout.cell_mm, 2.0);
    EXPECT_LT(std::sqrt(squares / count / slopes), left) << length_mm;
  }
}

}  // namespace
}  // namespace maquette::diagnosis

// SPDX-License-Identifier: GPL-3.0-or-later

// Points for choosing among causes (diagnosis/detail/thinned.hpp).
//
//   a sparse part ........... chooses by all of its points
//   a dense one ............. by 5 a square millimetre, the same in all parts of it and all scans

#include "diagnosis/detail/thinned.hpp"

#include <array>
#include <cmath>

#include <gtest/gtest.h>

#include "core/random.hpp"

namespace maquette::diagnosis {
namespace {

constexpr std::uint64_t kSeed = 20'261'201;

std::vector<Observation> scattered(std::size_t count) {
  std::vector<Observation> all(count);
  for (std::size_t i = 0; i < count; ++i) {
    all[i].place = {80.0 * random_uniform(kSeed, 2 * i), 40.0 * random_uniform(kSeed, 2 * i + 1),
                    0.0};
    all[i].set_up = static_cast<std::uint32_t>(i % 2);
  }
  return all;
}

TEST(Thinned, SparsePointsAllChoose) {
  Box3 box;
  box.add({0.0, 0.0, 0.0});
  box.add({80.0, 40.0, 1.0});
  // 7 a square millimetre: less than half more than are asked for.
  EXPECT_TRUE(detail::thinned(scattered(7 * 80 * 40), detail::lay_out(box, 1)).empty());
}

TEST(Thinned, OfDensePointsFiveASquareMillimetreChoose) {
  Box3 box;
  box.add({0.0, 0.0, 0.0});
  box.add({80.0, 40.0, 1.0});
  const auto few = detail::thinned(scattered(20 * 80 * 40), detail::lay_out(box, 1));
  std::array<double, 4> quarter{};
  std::array<double, 2> set_up{};
  for (const Observation& o : few) {
    ++quarter[static_cast<std::size_t>(o.place.x / 20.0)];
    ++set_up[o.set_up];
  }
  // Poisson's scatter, four times over.
  for (const double n : quarter) EXPECT_NEAR(n, 5.0 * 20.0 * 40.0, 4.0 * std::sqrt(4000.0));
  for (const double n : set_up) EXPECT_NEAR(n, 0.5 * 5.0 * 80.0 * 40.0, 4.0 * std::sqrt(8000.0));
}

}  // namespace
}  // namespace maquette::diagnosis

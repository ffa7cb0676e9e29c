// SPDX-License-Identifier: GPL-3.0-or-later
// Truth: each cell looked up in a square about it.
#include "core/mask.hpp"

#include <cstdlib>

#include <gtest/gtest.h>

#include "core/random.hpp"

namespace maquette {
namespace {

TEST(Mask, WidenMakesASquareAboutEachOne) {
  constexpr std::ptrdiff_t kRows = 23, kCols = 31;
  for (const std::ptrdiff_t reach : {0, 1, 3, 40})
    for (const double share : {0.0, 0.01, 0.2}) {
      Grid<std::uint8_t> mask(kRows, kCols, std::uint8_t{0});
      for (std::size_t i = 0; i < mask.cells().size(); ++i)
        mask.cells()[i] = random_uniform(20261128, i) < share;
      mask(0, kCols - 1) = 1;  // at a corner
      const Grid<std::uint8_t> before = mask;
      widen(mask, reach);
      for (std::ptrdiff_t r = 0; r < kRows; ++r)
        for (std::ptrdiff_t c = 0; c < kCols; ++c) {
          int any = 0;
          for (std::ptrdiff_t i = 0; i < kRows; ++i)
            for (std::ptrdiff_t k = 0; k < kCols; ++k)
              any |= before(i, k) != 0 && std::abs(i - r) <= reach && std::abs(k - c) <= reach;
          ASSERT_EQ(mask(r, c), any) << r << ' ' << c << " reach " << reach << " share " << share;
        }
    }
}

}  // namespace
}  // namespace maquette

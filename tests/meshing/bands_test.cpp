// SPDX-License-Identifier: GPL-3.0-or-later

// meshing/bands.hpp:
//   bands joined are the whole .............. first/last chained, for all sizes 2 .. 60
//   not wider than asked, even, no more
//   of them than needed ..................... counted for all sizes and widths
//   a width that is whole cells but for
//   rounding counts as whole ................ 0.3 mm of 0.1 mm cells
//   a count .................................. covers, even; refused where a band is too narrow
//   the window is the band ................... both axes
//   band_field keeps heights and coordinates. node by node against the whole field
//   margin widens up to the border .......... closed cases
//   MESHING_BANDS_DEGENERATE ................ too narrow, NaN, field too small

#include "meshing/bands.hpp"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/check.hpp"
#include "core/random.hpp"
#include "support/matchers.hpp"

namespace maquette::meshing {
namespace {

using heightmap::ModelField;
using testing_support::FailsWith;
using testing_support::Succeeds;

ModelField field(std::ptrdiff_t rows, std::ptrdiff_t cols, double spacing) {
  ModelField f{.z_mm = Grid<float>(rows, cols),
               .spacing = Millimetres{spacing},
               .x0 = Millimetres{3.0},
               .y0 = Millimetres{-7.0}};
  std::uint64_t i = 0;
  for (float& z : f.z_mm.cells()) z = static_cast<float>(random_uniform(1, i++));
  return f;
}

TEST(SplitIntoBands, CoversEveryLengthWithFewEvenBands) {
  for (std::ptrdiff_t nodes = 2; nodes <= 60; ++nodes)
    for (std::ptrdiff_t width = 2; width <= 62; ++width) {
      SCOPED_TRACE(testing::Message() << nodes << " nodes, bands of " << width << " cells");
      const ModelField f = field(nodes, 3, 0.25);
      const auto bands =
          split_into_bands(f, BandAxis::y, Millimetres{0.25 * static_cast<double>(width)});
      ASSERT_THAT(bands, Succeeds());
      EXPECT_EQ(static_cast<std::ptrdiff_t>(bands->size()), (nodes - 1 + width - 1) / width);
      EXPECT_EQ(bands->front().first, 0);
      EXPECT_EQ(bands->back().last, nodes - 1);
      std::ptrdiff_t widest = 0, narrowest = nodes;
      for (std::size_t i = 0; i < bands->size(); ++i) {
        const Band& b = (*bands)[i];
        EXPECT_EQ(b.number, static_cast<int>(i + 1));
        EXPECT_EQ(b.axis, BandAxis::y);
        if (i > 0) {
          EXPECT_EQ(b.first, (*bands)[i - 1].last);
        }
        widest = std::max(widest, b.last - b.first);
        narrowest = std::min(narrowest, b.last - b.first);
      }
      EXPECT_LE(widest, width);
      EXPECT_GE(narrowest, 1);
      EXPECT_LE(widest - narrowest, 1);
    }
}

TEST(SplitIntoBands, ForgivesRoundingOfTheWidth) {
  const ModelField f = field(2, 10, 0.1);
  const auto bands = split_into_bands(f, BandAxis::x, Millimetres{0.3});  // 0.3 / 0.1 < 3
  ASSERT_THAT(bands, Succeeds());
  EXPECT_EQ(bands->size(), 3u);
}

TEST(SplitIntoBands, RefusesWhatCannotBeSplit) {
  const ModelField f = field(10, 10, 0.5);
  EXPECT_THAT(split_into_bands(f, BandAxis::x, Millimetres{0.9}), FailsWith(kBandsDegenerate));
  EXPECT_THAT(split_into_bands(f, BandAxis::x, Millimetres{-5}), FailsWith(kBandsDegenerate));
  EXPECT_THAT(split_into_bands(f, BandAxis::x, Millimetres{NAN}), FailsWith(kBandsDegenerate));
  EXPECT_THAT(split_into_bands(field(1, 10, 0.5), BandAxis::x, Millimetres{5}),
              FailsWith(kBandsDegenerate));
  const auto all = split_into_bands(f, BandAxis::x, Millimetres{INFINITY});
  ASSERT_THAT(all, Succeeds());
  EXPECT_EQ(all->size(), 1u);
}

TEST(SplitIntoBands, ByTheirNumber) {
  const ModelField f = field(24, 31, 0.3);
  for (const BandAxis axis : {BandAxis::x, BandAxis::y}) {
    const std::ptrdiff_t cells = axis == BandAxis::x ? 30 : 23;
    for (int count = 1; count <= cells / 2; ++count) {
      const auto bands = split_into_bands(f, {.axis = axis, .count = count});
      ASSERT_THAT(bands, Succeeds());
      ASSERT_EQ(bands->size(), static_cast<std::size_t>(count));
      std::ptrdiff_t at = 0;
      for (const Band& b : *bands) {
        EXPECT_EQ(b.first, at);
        EXPECT_GE(b.last - b.first, cells / count);
        EXPECT_LE(b.last - b.first, cells / count + 1);
        at = b.last;
        const NodeWindow w = band_window(f, b);
        EXPECT_EQ(w, axis == BandAxis::x ? (NodeWindow{0, 23, b.first, b.last})
                                         : (NodeWindow{b.first, b.last, 0, 30}));
      }
      EXPECT_EQ(at, cells);
    }
    const auto refused =
        split_into_bands(f, {.axis = axis, .count = static_cast<int>(cells / 2) + 1});
    ASSERT_THAT(refused, FailsWith(kBandsDegenerate));
    EXPECT_THAT(refused.error().message,
                ::testing::HasSubstr(std::to_string(cells / 2) + " are possible"));
  }
  EXPECT_EQ(split_into_bands(f, {.max_width = Millimetres{3.0}})->size(), 3U);
}

class BandField : public ::testing::TestWithParam<BandAxis> {};
INSTANTIATE_TEST_SUITE_P(Axes, BandField, ::testing::Values(BandAxis::x, BandAxis::y));

TEST_P(BandField, KeepsHeightsAndCoordinates) {
  const ModelField whole = field(23, 31, 0.125);  // dyadic: coordinates are exact
  const auto bands = split_into_bands(whole, GetParam(), Millimetres{0.75});
  ASSERT_THAT(bands, Succeeds());
  for (const double margin : {0.0, 0.1, 0.25, 100.0})
    for (const Band& band : *bands) {
      const ModelField part = band_field(whole, band, Millimetres{margin});
      const auto extra = static_cast<std::ptrdiff_t>(std::ceil(margin / 0.125));
      const bool along_x = GetParam() == BandAxis::x;
      const std::ptrdiff_t nodes = along_x ? 31 : 23;
      const std::ptrdiff_t first = std::max<std::ptrdiff_t>(0, band.first - extra);
      const std::ptrdiff_t last = std::min(nodes - 1, band.last + extra);
      EXPECT_EQ(along_x ? part.z_mm.cols() : part.z_mm.rows(), last - first + 1);
      EXPECT_EQ(along_x ? part.z_mm.rows() : part.z_mm.cols(), along_x ? 23 : 31);
      for (std::ptrdiff_t r = 0; r < part.z_mm.rows(); ++r)
        for (std::ptrdiff_t c = 0; c < part.z_mm.cols(); ++c) {
          const std::ptrdiff_t wr = along_x ? r : r + first, wc = along_x ? c + first : c;
          ASSERT_EQ(part.z_mm(r, c), whole.z_mm(wr, wc));
          ASSERT_EQ(part.x_mm(c), whole.x_mm(wc));
          ASSERT_EQ(part.y_mm(r), whole.y_mm(wr));
        }
    }
}

TEST(BandField, RefusesABandOfAnotherField) {
  const ModelField f = field(5, 5, 1.0);
  EXPECT_THROW((void)band_field(f, {.number = 1, .axis = BandAxis::x, .first = 2, .last = 5}),
               CheckFailed);
  EXPECT_THROW((void)band_field(f, {.number = 1, .axis = BandAxis::x, .first = 0, .last = 4},
                                Millimetres{-1}),
               CheckFailed);
}

}  // namespace
}  // namespace maquette::meshing

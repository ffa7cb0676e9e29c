// SPDX-License-Identifier: GPL-3.0-or-later

// Claims of heightmap/fuse.hpp about voids inside a finer source, and how each is attacked
//   up to two pixels of what lies below: relief as rough as    56 holes of 7 pixels, their second
//     around, marked, more uncertain                             differences against the truth's
//     there
//   wider ones show what lies below                            a hole of 3 pixels of the base
//   those that touch the source's border are no holes          a notch as narrow as the holes

#include <cmath>
#include <string>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "heightmap/fuse.hpp"
#include "support/matchers.hpp"
#include "support/planet_raster.hpp"

namespace maquette::heightmap {
namespace {

using testing_support::PlanetRaster;
using testing_support::ScratchFolder;
using testing_support::Succeeds;
using testing_support::write_planet_raster;

constexpr double kBasePixel = 20.0, kFinePixel = 2.0, kHalf = 300.0;

/// Waves from 7 to 500 m.
double relief(double x, double y) {
  double z = 0.0;
  for (std::uint64_t k = 0; k < 60; ++k) {
    const double length = 7.0 * std::pow(70.0, static_cast<double>(k) / 60.0);
    const double way = 6.283185 * random_uniform(3, k), f = 6.283185 / length;
    z += 0.004 * length *
         std::sin(f * (x * std::cos(way) + y * std::sin(way)) + 6.283185 * random_uniform(4, k));
  }
  return z;
}

enum class Void { none, narrow, wide, notch };

/// Which hole a pixel of the fine source lies in.
Void hole_at(int row, int col) {
  if (row >= 250 && row < 280 && col >= 250 && col < 280) return Void::wide;  // 60 m
  if (col < 40 && row >= 140 && row < 147) return Void::notch;  // open to the west border
  if (row < 240 && row % 30 >= 10 && row % 30 < 17 && col >= 60 && col < 270 && col % 30 >= 10 &&
      col % 30 < 17)
    return Void::narrow;  // 14 m
  return Void::none;
}

TEST(FineVoids, NarrowOnesAreFilledWideOnesShowTheBase) {
  const ScratchFolder scratch;
  PlanetRaster base;
  base.pixel = kBasePixel;
  base.cols = base.rows = 36;
  base.west = -360.0;
  base.north = 360.0;
  base.height = [](double x, double y) {
    double sum = 0.0;  // what a pixel sees
    for (int i = 0; i < 8; ++i)
      for (int j = 0; j < 8; ++j)
        sum += relief(x + (i - 3.5) / 8.0 * kBasePixel, y + (j - 3.5) / 8.0 * kBasePixel);
    return sum / 64.0;
  };
  write_planet_raster(base, scratch / "base.tif");
  PlanetRaster fine;
  fine.pixel = kFinePixel;
  fine.cols = fine.rows = 290;  // 10 m of the site's border are the base's
  fine.west = -kHalf + 10.0;
  fine.north = kHalf - 10.0;
  fine.has_nodata = true;
  fine.nodata = -9999.0;
  fine.height = [&](double x, double y) {
    const int col = static_cast<int>((x - fine.west) / kFinePixel),
              row = static_cast<int>((fine.north - y) / kFinePixel);
    return hole_at(row, col) == Void::none ? relief(x, y) : -9999.0;
  };
  write_planet_raster(fine, scratch / "fine.tif");

  FuseRequest request;
  request.body = *body_by_name("moon");
  request.half_width = Metres{kHalf - 1.0};
  request.spacing = Metres{kFinePixel};  // nodes on the fine source's pixels
  request.sources = {Source{"base", scratch / "base.tif", "auto", 1.0},
                     Source{"fine", scratch / "fine.tif", "auto", 0.05}};
  request.sources[1].align = Source::Align::none;
  request.restore = false;
  const auto fused = fuse(request);
  ASSERT_THAT(fused, Succeeds());

  const Grid<float>& z = fused->field.z_m;
  const std::ptrdiff_t n = z.rows();
  double made = 0.0, true_ = 0.0, narrow = 0.0, marked = 0.0, sigma_in = 0.0, sigma_out = 0.0;
  double outside = 0.0;
  const auto truth = [&](std::ptrdiff_t r, std::ptrdiff_t c) {
    return relief(-kHalf + 1.0 + kFinePixel * static_cast<double>(c),
                  -kHalf + 1.0 + kFinePixel * static_cast<double>(r));
  };
  for (std::ptrdiff_t r = 10; r < n - 10; ++r)
    for (std::ptrdiff_t c = 10; c < n - 10; ++c) {
      const int col = static_cast<int>(c) - 5, row = 290 - 1 - (static_cast<int>(r) - 5);
      const Void where = hole_at(row, col);
      const auto source = static_cast<int>(fused->source(r, c));
      if (where == Void::none) {
        sigma_out += static_cast<double>(fused->sigma_m(r, c));
        outside += 1.0;
      } else if (where == Void::narrow) {
        narrow += 1.0;
        marked += source == 255 ? 1.0 : 0.0;
        sigma_in += static_cast<double>(fused->sigma_m(r, c));
        // Second differences that lie in the hole with all their five nodes.
        if (hole_at(row - 1, col) != where || hole_at(row + 1, col) != where ||
            hole_at(row, col - 1) != where || hole_at(row, col + 1) != where)
          continue;
        const auto laplacian = [&](const auto& of) {
          return of(r - 1, c) + of(r + 1, c) + of(r, c - 1) + of(r, c + 1) - 4.0 * of(r, c);
        };
        made += std::pow(laplacian([&](std::ptrdiff_t i, std::ptrdiff_t j) {
                           return static_cast<double>(z(i, j));
                         }),
                         2.0);
        true_ += std::pow(laplacian(truth), 2.0);
      } else if (row % 30 != 0) {
        EXPECT_NE(source, 255) << "row " << row << " column " << col;
      }
    }
  EXPECT_EQ(narrow, 56.0 * 49.0);
  EXPECT_EQ(marked, narrow);
  EXPECT_GT(sigma_in / narrow, 2.0 * sigma_out / outside);
  EXPECT_EQ(static_cast<int>(fused->source(295 - 270, 5 + 265)), 0) << "the base, in the wide one";
  EXPECT_EQ(static_cast<int>(fused->source(295 - 144, 5 + 20)), 0) << "the base, in the notch";
  RecordProperty("laplacian_ratio", std::to_string(std::sqrt(made / true_)));
  // 56 holes of 25 second differences, some 4 of them independent: 200 of them, 5 % of a deviation.
  EXPECT_NEAR(std::sqrt(made / true_), 1.0, 0.15);
}

}  // namespace
}  // namespace maquette::heightmap

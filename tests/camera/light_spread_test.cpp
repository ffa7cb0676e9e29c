// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in camera/detail/light_spread.hpp:
//
//   one bit for all ......... tiles are what single pixels give one after the other, each sum over
//                             rows, then columns: one and three bands, round and with blades, one
//                             layer and several, behind and before the focus, at all borders
//   what a picture covers ... shares of a circle and of polygons add up to the circle's area, 5 %
//   nowhere beyond .......... nothing is covered at Aperture::beyond or farther

#include "camera/detail/light_spread.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <gtest/gtest.h>

#include "core/random.hpp"

namespace maquette::camera::detail {
namespace {

float coverage(const Aperture& aperture, float dx, float dy, float r) {
  const float side = r < 0.0F ? -1.0F : 1.0F;
  return std::clamp(aperture.edge(std::abs(r)) - aperture.distance(dx, dy, side), 0.0F, 1.0F);
}

/// One over the area, by sixteenths of a pixel of the radius.
float inverse_area(const Aperture& aperture, float radius) {
  const auto at = [&](int step) {
    const float r = static_cast<float>(step) / 16.0F;
    if (r <= 0.5F) return 1.0F;
    const int reach = static_cast<int>(std::ceil(1.8F * r + 1.0F));
    float sum = 0.0F;
    for (int y = -reach; y <= reach; ++y)
      for (int x = -reach; x <= reach; ++x)
        sum += coverage(aperture, static_cast<float>(x), static_cast<float>(y), r);
    return 1.0F / sum;
  };
  const float place = std::abs(radius) * 16.0F;
  const int i = static_cast<int>(place);
  const float lower = at(i), upper = at(i + 1);
  return lower + (place - static_cast<float>(i)) * (upper - lower);
}

struct Layer {
  float weight = 0.0F;
  std::vector<float> light = std::vector<float>(3, 0.0F);
};

struct Picture {
  std::vector<Grid<float>> sharp;
  Grid<float> radius, inverse;
};

std::vector<float> pixel(const Picture& p, const Aperture& aperture, std::ptrdiff_t r,
                         std::ptrdiff_t c) {
  const float own_radius = p.radius(r, c);
  Layer front, own, behind;
  for (std::ptrdiff_t y = 0; y < p.radius.rows(); ++y)
    for (std::ptrdiff_t x = 0; x < p.radius.cols(); ++x) {
      const float from = p.radius(y, x);
      const bool is_behind = from > own_radius + 1.0F;
      const float size = is_behind ? own_radius : from;
      const auto dx = static_cast<float>(c - x), dy = static_cast<float>(r - y);
      float w = 0.0F;
      if (std::abs(size) <= 0.5F)
        w = dx == 0.0F && dy == 0.0F ? 1.0F : 0.0F;
      else
        w = coverage(aperture, dx, dy, size) * (is_behind ? p.inverse(r, c) : p.inverse(y, x));
      if (w <= 0.0F) continue;
      Layer& layer = is_behind ? behind : from < own_radius - 1.0F ? front : own;
      layer.weight += w;
      for (std::size_t b = 0; b < p.sharp.size(); ++b) layer.light[b] += w * p.sharp[b](y, x);
    }
  const float hides = std::min(1.0F, front.weight);
  const float share = behind.weight > 0.0F ? std::min(1.0F, own.weight) : 1.0F;
  std::vector<float> values;
  for (std::size_t b = 0; b < p.sharp.size(); ++b) {
    const auto mean = [&](const Layer& l, float otherwise) {
      return l.weight > 0.0F ? l.light[b] / l.weight : otherwise;
    };
    const float around = mean(own, p.sharp[b](r, c));
    values.push_back(hides * mean(front, 0.0F) +
                     (1.0F - hides) * (share * around + (1.0F - share) * mean(behind, 0.0F)));
  }
  return values;
}

TEST(LightSpread, TilesAreWhatSinglePixelsGive) {
  std::uint64_t draw = 0;
  const auto uniform = [&](float lo, float hi) {
    return lo + (hi - lo) * static_cast<float>(random_uniform(31, draw++));
  };
  enum Shape { steps, slope, scattered, in_focus };
  for (const std::size_t bands : {1U, 3U})
    for (const int blades : {0, 5, 9})
      for (const Shape shape : {steps, slope, scattered, in_focus}) {
        const std::ptrdiff_t rows = 37, cols = 45;
        Picture p{std::vector<Grid<float>>(bands, Grid<float>(rows, cols)), Grid<float>(rows, cols),
                  Grid<float>(rows, cols)};
        const Aperture aperture(blades, 17.0);
        float largest = 0.0F;
        for (std::ptrdiff_t r = 0; r < rows; ++r)
          for (std::ptrdiff_t c = 0; c < cols; ++c) {
            float& radius = p.radius(r, c);
            if (shape == steps) radius = c < 13 ? -3.3F : c < 29 ? 0.4F : r < 20 ? 2.6F : 5.1F;
            if (shape == slope) radius = -0.45F + 0.02F * static_cast<float>(c);
            if (shape == scattered) radius = uniform(-4.0F, 4.0F);
            if (shape == in_focus) radius = r > 30 ? 0.9F : 0.0F;
            p.inverse(r, c) = inverse_area(aperture, radius);
            largest = std::max(largest, std::abs(radius));
            for (Grid<float>& band : p.sharp) band(r, c) = uniform(0.0F, 2.0F);
          }
        const LightSpread spread(p.sharp, p.radius, largest, aperture);
        LightSpread::Scratch scratch;
        std::vector<Grid<float>> out(bands, Grid<float>(rows, cols, -1.0F));
        for (std::ptrdiff_t i = 0; i * kSpreadTile < rows; ++i)
          for (std::ptrdiff_t j = 0; j * kSpreadTile < cols; ++j)
            spread.tile(i, j, largest, scratch, out);
        for (std::ptrdiff_t r = 0; r < rows; ++r)
          for (std::ptrdiff_t c = 0; c < cols; ++c) {
            const auto expected = pixel(p, aperture, r, c);
            for (std::size_t b = 0; b < bands; ++b)
              ASSERT_EQ(out[b](r, c), expected[b])
                  << bands << " bands, " << blades << " blades, shape " << shape << ", pixel " << r
                  << ", " << c;
          }
      }
}

TEST(LightSpread, APictureOfTheApertureHasTheCirclesArea) {
  for (const int blades : {0, 5, 6, 9})
    for (const float r : {2.0F, 7.3F, 20.0F}) {
      const Aperture aperture(blades, 11.0);
      const auto reach = static_cast<int>(aperture.beyond(r)) + 3;
      double area = 0.0;
      for (int y = -reach; y <= reach; ++y)
        for (int x = -reach; x <= reach; ++x) {
          const auto dx = static_cast<float>(x), dy = static_cast<float>(y);
          const float share = coverage(aperture, dx, dy, r);
          area += static_cast<double>(share);
          if (std::hypot(dx, dy) >= aperture.beyond(r)) {
            ASSERT_EQ(share, 0.0F);
          }
        }
      const double circle = std::numbers::pi * static_cast<double>(r * r);
      EXPECT_NEAR(area, circle, 0.05 * circle) << blades << " blades, radius " << r;
    }
}

}  // namespace
}  // namespace maquette::camera::detail

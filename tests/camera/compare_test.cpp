// SPDX-License-Identifier: GPL-3.0-or-later

// camera/compare.hpp:
//   differences in x/255 ............. hand-made pixels with known means
//   sign is real - rendered .......... bias and difference image
//   linear is encoded for 8 bit ...... a render against its own PNG: exactly zero
//   one channel against colour ....... both ways round
//   depth, mask, alpha left out ...... wild values in them; only they: an error
//   sizes and channel numbers ........ refused with both numbers
//   background, shadow edges ......... masks drawn by hand; their figures, and the mask as a
//   picture display values in EXR ............ as 8 bits, but for their rounding matching of light
//   ................ known factors come back in spite of stray pixels; 13/255 of
//                                      wrong white balance becomes less than 3 on held-out pictures
//   histogram distance ............... a shift by hand
//   SSIM, FLIP ....................... equal pictures; constant pictures by the formulas; order of
//                                      blur; SSIM against the definition, window by window
//   encoding by table ................ srgb8 at every threshold and at random
//   the JSON ......................... parsed again

#include "camera/compare.hpp"
#include "camera/compare_perceptual.hpp"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <nlohmann/json.hpp>

#include "core/random.hpp"
#include "support/matchers.hpp"

namespace maquette::camera {
namespace {

using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

LoadedImage image(std::vector<std::pair<std::string, std::vector<double>>> channels, bool eight) {
  LoadedImage result;
  result.eight_bit = eight;
  for (const auto& [name, values] : channels) {
    Grid<float> g(1, static_cast<std::ptrdiff_t>(values.size()));
    for (std::size_t i = 0; i < values.size(); ++i)
      g.cells()[i] = static_cast<float>(values[i] / 255.0);
    result.names.push_back(name);
    result.channels.push_back(std::move(g));
  }
  return result;
}

TEST(CompareImages, HasTheKnownMeans) {
  const auto real =
      image({{"R", {10, 20, 30, 40}}, {"G", {0, 0, 0, 0}}, {"B", {9, 9, 9, 9}}}, true);
  const auto made =
      image({{"R", {13, 20, 26, 40}}, {"G", {2, 2, 2, 2}}, {"B", {8, 8, 8, 8}}}, true);
  const auto c = compare_images(real, made);
  ASSERT_THAT(c, Succeeds());
  ASSERT_EQ(c->channels.size(), 3U);
  // 1e-5: float values of x/255
  EXPECT_EQ(c->channels[0].name, "R");
  EXPECT_NEAR(c->channels[0].mean_abs_diff_255, 7.0 / 4, 1e-5);
  EXPECT_NEAR(c->channels[0].rmse_255, 2.5, 1e-5);  // sqrt((9 + 16) / 4)
  EXPECT_NEAR(c->channels[0].bias_255, 0.25, 1e-5);
  EXPECT_NEAR(c->channels[1].bias_255, -2, 1e-5);
  EXPECT_NEAR(c->channels[2].bias_255, 1, 1e-5);
  EXPECT_NEAR(c->mean_abs_diff_255, (1.75 + 2 + 1) / 3, 1e-5);
  // mean of (-3, -2, 1), (0, -2, 1), (4, -2, 1): -4/3, -1/3, 1
  EXPECT_EQ(c->difference(0, 0), 127);
  EXPECT_EQ(c->difference(0, 1), 128);
  EXPECT_EQ(c->difference(0, 2), 129);
}

TEST(CompareImages, OfARenderAndItsOwnPngIsZero) {
  const ScratchFolder folder;
  Grid<float> light(20, 30);
  Grid<std::uint8_t> grey(20, 30);
  for (std::size_t i = 0; i < light.cells().size(); ++i) {
    light.cells()[i] = static_cast<float>(1.2 * random_uniform(5, i) - 0.1);
    grey.cells()[i] = srgb8(static_cast<double>(light.cells()[i]));
  }
  ASSERT_TRUE(write_exr({{"Y", &light}, {"Z", &light}}, folder / "a.exr"));
  ASSERT_TRUE(write_png(grey, folder / "a.png"));
  const auto exr = read_image(folder / "a.exr"), png = read_image(folder / "a.png");
  ASSERT_TRUE(exr && png);
  for (const auto& c : {compare_images(*exr, *png), compare_images(*png, *exr)}) {
    ASSERT_THAT(c, Succeeds());
    EXPECT_NEAR(c->mean_abs_diff_255, 0, 1e-5);
  }
}

TEST(CompareImages, ComparesLinearWithLinearAsTheyAre) {
  const auto c = compare_images(image({{"Y", {100}}}, false), image({{"Y", {90}}}, false));
  ASSERT_THAT(c, Succeeds());
  EXPECT_NEAR(c->mean_abs_diff_255, 10, 1e-4);
}

TEST(CompareImages, SetsOneChannelAgainstEveryColour) {
  const auto colour = image({{"R", {10}}, {"G", {20}}, {"B", {30}}}, true);
  const auto grey = image({{"Y", {20}}}, true);
  const auto a = compare_images(colour, grey), b = compare_images(grey, colour);
  ASSERT_THAT(a, Succeeds());
  ASSERT_THAT(b, Succeeds());
  ASSERT_EQ(a->channels.size(), 3U);
  ASSERT_EQ(b->channels.size(), 3U);
  EXPECT_NEAR(a->channels[0].bias_255, -10, 1e-5);
  EXPECT_NEAR(b->channels[0].bias_255, 10, 1e-5);
  EXPECT_EQ(b->channels[2].name, "B");
}

TEST(CompareImages, PairsChannelsByName) {
  const auto rgb = image({{"R", {10}}, {"G", {20}}, {"B", {30}}}, true);
  const auto bgr = image({{"B", {30}}, {"G", {20}}, {"R", {10}}}, true);
  const auto c = compare_images(rgb, bgr);
  ASSERT_THAT(c, Succeeds());
  EXPECT_EQ(c->mean_abs_diff_255, 0);
}

TEST(CompareImages, LeavesDepthMaskAndAlphaOut) {
  const auto a = image({{"Y", {10}}, {"Z", {1e6}}, {"lit", {255}}}, false);
  const auto b = image({{"Y", {10}}, {"A", {255}}}, false);
  const auto c = compare_images(a, b);
  ASSERT_THAT(c, Succeeds());
  EXPECT_EQ(c->channels.size(), 1U);
  EXPECT_EQ(c->mean_abs_diff_255, 0);
  EXPECT_THAT(compare_images(image({{"Z", {1}}}, false), b), FailsWith(kImageFormat));
}

TEST(CompareImages, IgnoresPixelsThatAreNotFinite) {
  const auto a = image({{"Y", {10, NAN, 10, INFINITY}}}, false);
  const auto b = image({{"Y", {12, 5, 12, 5}}}, false);
  const auto c = compare_images(a, b);
  ASSERT_THAT(c, Succeeds());
  EXPECT_NEAR(c->mean_abs_diff_255, 2, 1e-5);
  EXPECT_THAT(compare_images(image({{"Y", {NAN}}}, false), image({{"Y", {1}}}, false)),
              FailsWith(kImageFormat));
}

TEST(CompareImages, RefusesOtherSizesAndChannelNumbers) {
  const auto a = image({{"Y", {1, 2}}}, true), b = image({{"Y", {1, 2, 3}}}, true);
  const auto result = compare_images(a, b);
  ASSERT_THAT(result, FailsWith(kImagesDiffer));
  EXPECT_THAT(result.error().message, testing::HasSubstr("2 x 1"));
  EXPECT_THAT(compare_images(image({{"R", {1}}, {"G", {1}}}, true),
                             image({{"R", {1}}, {"G", {1}}, {"B", {1}}}, true)),
              FailsWith(kImagesDiffer));
}

TEST(CompareImages, LeavesTheBackgroundOutAndSaysItsNumber) {
  const auto real = image({{"Y", {10, 200, 30}}}, false);
  const auto made = image({{"Y", {12, 0, 30}}, {"Z", {100, INFINITY, 100}}}, false);
  const auto c = compare_images(real, made);
  ASSERT_THAT(c, Succeeds());
  EXPECT_NEAR(c->mean_abs_diff_255, 1.0, 1e-5);
  EXPECT_EQ(c->background_pixels, 1U);
  EXPECT_EQ(c->pixels, 2U);
  CompareOptions all;
  all.background = true;
  EXPECT_NEAR(compare_images(real, made, all)->mean_abs_diff_255, 202.0 / 3.0, 1e-4);
}

TEST(CompareImages, JudgesShadowEdgesByThemselves) {
  const int n = 40;
  LoadedImage real, made;
  for (LoadedImage* i : {&real, &made}) i->names = {"Y"}, i->channels = {Grid<float>(n, n)};
  made.names.push_back("lit"), made.channels.emplace_back(n, n);
  for (std::ptrdiff_t r = 0; r < n; ++r)
    for (std::ptrdiff_t c = 0; c < n; ++c) {
      made.channels[1](r, c) = c < 20 ? 1.0F : 0.0F;
      // 8/255 off in columns 17 to 22, the three to each side of the edge; 1/255 elsewhere.
      real.channels[0](r, c) = (c >= 17 && c <= 22 ? 8.0F : 1.0F) / 255.0F;
    }
  CompareOptions options;
  options.edge_px = 2;  // the edge's own pixels, 19 and 20, and two more to each side
  const auto result = compare_images(real, made, options);
  ASSERT_THAT(result, Succeeds());
  ASSERT_TRUE(result->shadow_edges && result->rest);
  EXPECT_EQ(result->shadow_edges->pixels, 240U);
  EXPECT_NEAR(result->shadow_edges->mean_abs_diff_255, 8.0, 1e-5);
  EXPECT_NEAR(result->rest->mean_abs_diff_255, 1.0, 1e-5);
}

/// A picture in linear light of many brightnesses.
LoadedImage linear_scene(std::uint64_t seed, std::array<double, 3> gains, double stray) {
  LoadedImage result;
  for (std::size_t b = 0; b < 3; ++b) {
    Grid<float> g(100, 120);
    for (std::size_t i = 0; i < g.cells().size(); ++i) {
      const double light = 0.03 + 0.55 * random_uniform(seed, i);
      g.cells()[i] = static_cast<float>(gains[b] * light);
      if (random_uniform(seed + 7, i) < stray)
        g.cells()[i] = static_cast<float>(random_uniform(seed + 9, i));
    }
    result.names.push_back(std::string(1, "RGB"[b]));
    result.channels.push_back(std::move(g));
  }
  return result;
}

TEST(CompareImages, FindsExposureAndWhiteBalance) {
  const std::array<double, 3> gains{1.31, 1.12, 0.87};
  const auto real = linear_scene(1, gains, 0.05), made = linear_scene(1, {1, 1, 1}, 0.0);
  CompareOptions options;
  EXPECT_GT(compare_images(real, made)->mean_abs_diff_255, 13.0);
  options.match = Match::white_balance;
  const auto c = compare_images(real, made, options);
  ASSERT_THAT(c, Succeeds());
  // 5 % of the pixels are strays, even from 0 to 1: Huber's weights keep their pull below 1 %.
  for (std::size_t b = 0; b < 3; ++b) EXPECT_NEAR(c->channels[b].gain / gains[b], 1.0, 0.01) << b;
  EXPECT_THAT(c->state, testing::HasSubstr("white balance of the rendering matched"));
  // On a picture that was not looked at, with these factors: strays alone are left.
  const auto held_out = linear_scene(2, gains, 0.0);
  auto corrected = linear_scene(2, {1, 1, 1}, 0.0);
  for (std::size_t b = 0; b < 3; ++b)
    for (float& v : corrected.channels[b].cells()) v *= static_cast<float>(c->channels[b].gain);
  EXPECT_LT(compare_images(held_out, corrected)->mean_abs_diff_255, 3.0);
  options.match = Match::exposure;
  const auto even = compare_images(linear_scene(3, {0.8, 0.8, 0.8}, 0.0),
                                   linear_scene(3, {1, 1, 1}, 0.0), options);
  ASSERT_THAT(even, Succeeds());
  EXPECT_NEAR(even->channels[1].gain, 0.8, 1e-6);
  EXPECT_LT(even->mean_abs_diff_255, 1e-4);
  EXPECT_THAT(
      compare_images(image({{"Y", {255, 255}}}, true), image({{"Y", {1, 2}}}, true), options),
      FailsWith(kImageFormat));
}

TEST(CompareImages, MeasuresHowFarHistogramsLieApart) {
  const auto a = image({{"Y", {10, 20, 30, 40}}}, true);
  EXPECT_NEAR(
      compare_images(a, image({{"Y", {17, 27, 37, 47}}}, true))->channels[0].histogram_distance_255,
      7.0, 1e-9);
  EXPECT_NEAR(
      compare_images(a, image({{"Y", {40, 30, 20, 10}}}, true))->channels[0].histogram_distance_255,
      0.0, 1e-9);
}

TEST(CompareImages, ShowsWhichPixelsAreOfShadowEdges) {
  LoadedImage made = image({{"Y", std::vector<double>(12, 100.0)}}, true);
  Grid<float> lit(1, 12), depth(1, 12, 5.0F);
  for (std::ptrdiff_t c = 0; c < 6; ++c) lit(0, c) = 3.0F;  // of two lamps; then of the second
  for (std::ptrdiff_t c = 6; c < 12; ++c) lit(0, c) = 2.0F;
  depth(0, 0) = INFINITY;
  made.names.insert(made.names.end(), {"lit", "Z"});
  made.channels.push_back(lit), made.channels.push_back(depth);
  CompareOptions options;
  options.edge_px = 1;
  const auto c = compare_images(image({{"Y", std::vector<double>(12, 90.0)}}, true), made, options);
  ASSERT_THAT(c, Succeeds());
  const std::vector<std::uint8_t> want{0, 128, 128, 128, 255, 255, 255, 255, 128, 128, 128, 128};
  EXPECT_THAT(c->edges.cells(), testing::ElementsAreArray(want));
  ASSERT_TRUE(c->shadow_edges);
  EXPECT_EQ(c->shadow_edges->pixels, 4U);
  options.pictures = false;
  EXPECT_TRUE(compare_images(made, made, options)->edges.empty());
}

TEST(CompareImages, TakesExposedPicturesForWhatTheyAre) {
  const auto eight = image({{"Y", {10, 80, 200, 250}}}, true);
  auto exposed = image({{"Y", {10.4, 80, 200, 250}}}, false);
  // Without the word it is linear, and sRGB makes it much brighter.
  EXPECT_GT(compare_images(eight, exposed)->mean_abs_diff_255, 20.0);
  exposed.metadata = {{"maquette:signal", "display values"}};
  EXPECT_NEAR(compare_images(eight, exposed)->mean_abs_diff_255, 0.1, 1e-5);
  exposed.metadata = {{"maquette:signal", "developed values"}};
  EXPECT_GT(compare_images(eight, exposed)->mean_abs_diff_255, 20.0);
}

TEST(CompareImages, EncodesByTableAsByFormula) {
  LoadedImage light, bytes;
  Grid<float> g(1, 40000), b(1, 40000);
  for (std::size_t i = 0; i < 40000; ++i) {
    const double u = random_uniform(11, i);
    g.cells()[i] = static_cast<float>(i % 2 == 0 ? u : u * u * u * 0.02);
    b.cells()[i] = static_cast<float>(srgb8(static_cast<double>(g.cells()[i])) / 255.0);
  }
  light.names = bytes.names = {"Y"};
  light.channels = {g}, bytes.channels = {b}, bytes.eight_bit = true;
  EXPECT_LT(compare_images(light, bytes)->rmse_255, 1e-4);  // one wrong code would be 5e-3
}

TEST(StructuralSimilarity, IsThatOfItsDefinition) {
  Grid<float> a(30, 40), b(30, 40);
  for (std::size_t i = 0; i < a.cells().size(); ++i) {
    a.cells()[i] = static_cast<float>(random_uniform(1, i));
    b.cells()[i] = static_cast<float>(0.7 * random_uniform(1, i) + 0.2 * random_uniform(2, i));
  }
  double sum = 0.0;
  int count = 0;
  for (std::ptrdiff_t r = 5; r < 25; ++r)
    for (std::ptrdiff_t c = 5; c < 35; ++c, ++count) {
      double w = 0, x = 0, y = 0, xx = 0, yy = 0, xy = 0;
      for (int i = -5; i <= 5; ++i)
        for (int j = -5; j <= 5; ++j) {
          const double k = std::exp(-(i * i + j * j) / 4.5);
          const auto p = static_cast<double>(a(r + i, c + j)),
                     q = static_cast<double>(b(r + i, c + j));
          w += k, x += k * p, y += k * q, xx += k * p * p, yy += k * q * q, xy += k * p * q;
        }
      x /= w, y /= w, xx = xx / w - x * x, yy = yy / w - y * y, xy = xy / w - x * y;
      sum += (2 * x * y + 1e-4) * (2 * xy + 9e-4) / ((x * x + y * y + 1e-4) * (xx + yy + 9e-4));
    }
  EXPECT_NEAR(structural_similarity(a, b), sum / count, 1e-4);  // float sums
  EXPECT_NEAR(structural_similarity(a, a), 1.0, 1e-6);
  EXPECT_TRUE(std::isnan(structural_similarity(Grid<float>(5, 50), Grid<float>(5, 50))));
}

TEST(Flip, OfEvenPicturesIsTheColourFormula) {
  const auto even = [](float r, float g, float b) {
    return std::vector<Grid<float>>{Grid<float>(20, 20, r), Grid<float>(20, 20, g),
                                    Grid<float>(20, 20, b)};
  };
  const auto value = [](const std::vector<Grid<float>>& a, const std::vector<Grid<float>>& b) {
    return static_cast<double>(flip(a, b)(10, 10));
  };
  EXPECT_NEAR(value(even(0.3F, 0.5F, 0.2F), even(0.3F, 0.5F, 0.2F)), 0.0, 1e-6);
  // Green against blue is the largest that the measure knows: 1 by definition.
  EXPECT_NEAR(value(even(0, 1, 0), even(0, 0, 1)), 1.0, 1e-3);
  // Black against white: HyAB is 100 in L; with Hunt's L, a, b of green (87.7, -75.6, 72.9) and
  // blue (32.3, 25.6, -34.8), by hand, the largest is 203.2: 100^0.7 = 25.12, 203.2^0.7 = 41.27.
  EXPECT_NEAR(value(even(0, 0, 0), even(1, 1, 1)), 0.95 + 0.05 * (25.12 - 16.51) / (41.27 - 16.51),
              2e-3);
  EXPECT_NEAR(
      static_cast<double>(flip({Grid<float>(20, 20, 0.0F)}, {Grid<float>(20, 20, 1.0F)})(3, 3)),
      value(even(0, 0, 0), even(1, 1, 1)), 1e-6);
}

TEST(Flip, GrowsWithBlur) {
  Grid<float> sharp(64, 64), soft(64, 64), softer(64, 64);
  for (std::ptrdiff_t r = 0; r < 64; ++r)
    for (std::ptrdiff_t c = 0; c < 64; ++c) {
      const double x = static_cast<double>(c) - 31.5;
      sharp(r, c) = x > 0 ? 0.8F : 0.2F;
      soft(r, c) = static_cast<float>(0.5 + 0.3 * std::erf(x / 2.0));
      softer(r, c) = static_cast<float>(0.5 + 0.3 * std::erf(x / 6.0));
    }
  const auto mean = [&](const Grid<float>& g) {
    double sum = 0.0;
    for (const float v : flip({sharp}, {g}).cells()) sum += static_cast<double>(v);
    return sum / 4096.0;
  };
  EXPECT_GT(mean(soft), 0.001);
  EXPECT_GT(mean(softer), 1.5 * mean(soft));
}

TEST(ToJson, HasEveryNumber) {
  const auto c = compare_images(image({{"R", {10}}, {"G", {20}}, {"B", {30}}}, true),
                                image({{"Y", {20}}}, true));
  ASSERT_THAT(c, Succeeds());
  const auto json = nlohmann::json::parse(to_json(*c));
  EXPECT_DOUBLE_EQ(json["mean_abs_diff_255"].get<double>(), c->mean_abs_diff_255);
  ASSERT_EQ(json["channels"].size(), 3U);
  EXPECT_EQ(json["channels"][0]["name"], "R");
  EXPECT_DOUBLE_EQ(json["channels"][0]["bias_255"].get<double>(), c->channels[0].bias_255);
}

}  // namespace
}  // namespace maquette::camera

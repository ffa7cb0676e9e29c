// SPDX-License-Identifier: GPL-3.0-or-later

// camera/compare.hpp:
//   differences in x/255 ............. hand-made pixels with known means
//   sign is real - rendered .......... bias and difference image
//   linear is encoded for 8 bit ...... a render against its own PNG: exactly zero
//   one channel against colour ....... both ways round
//   depth, mask, alpha left out ...... wild values in them; only they: an error
//   sizes and channel numbers ........ refused with both numbers
//   the JSON ......................... parsed again

#include "camera/compare.hpp"

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
  EXPECT_EQ(c->difference(0, 0)[0], 127);
  EXPECT_EQ(c->difference(0, 1)[1], 128);
  EXPECT_EQ(c->difference(0, 2)[2], 129);
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

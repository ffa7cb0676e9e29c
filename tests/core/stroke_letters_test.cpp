// SPDX-License-Identifier: GPL-3.0-or-later

// core/stroke_letters.hpp: one letter a sign, within the heights that the header gives; what is not
// known is drawn as '?' and named once.

#include "core/stroke_letters.hpp"

#include <gtest/gtest.h>

namespace maquette {
namespace {

TEST(StrokeLetters, AreOneASignAndAsHighAsSaid) {
  const auto letters = stroke_letters("A\u00b2z ");
  ASSERT_EQ(letters.size(), 4U);
  const auto highest = [](const StrokeLetter& letter) {
    double y = 0.0;
    for (const auto& stroke : letter.strokes)
      for (const auto& p : stroke) y = std::max(y, p[1]);
    return y;
  };
  EXPECT_EQ(highest(letters[0]), kCapitalHeight);
  EXPECT_EQ(highest(letters[2]), 8.0);
  EXPECT_TRUE(letters[3].strokes.empty());
  for (const auto& letter : letters) EXPECT_GT(letter.advance, 0.0);
}

TEST(StrokeLetters, UnknownOnesAreNamedOnce) {
  EXPECT_EQ(unknown_letters("Mare Imbrium, 1:1000 (2 m\u00b2)?"), "");
  EXPECT_EQ(unknown_letters("K\u00f6nig & \u00c4ra & \u00f6"), "\u00f6&\u00c4");
  EXPECT_EQ(unknown_letters("a\xff\x80"), "?");
  EXPECT_EQ(unknown_letters(""), "");
  EXPECT_EQ(stroke_letters("\u00c4")[0].strokes, stroke_letters("?")[0].strokes);
}

}  // namespace
}  // namespace maquette

// SPDX-License-Identifier: GPL-3.0-or-later

// core/vec.hpp, core/units.hpp, core/random.hpp:
//   rotation is right-handed ......... quarter turns with known results
//   composition, inverse ............. laws on random transforms
//   scale converts, not the reader ... numbers at 1:2500 with exaggeration 2
//   units do not mix ................. checked by the compiler
//   random numbers are uniform ....... moments within 5 standard errors

#include "core/vec.hpp"

#include <concepts>
#include <numbers>

#include <gtest/gtest.h>

#include "core/random.hpp"
#include "core/units.hpp"

namespace maquette {
namespace {

using namespace maquette::literals;

void expect_near(Vec3 a, Vec3 b, double tolerance) {
  EXPECT_NEAR(a.x, b.x, tolerance);
  EXPECT_NEAR(a.y, b.y, tolerance);
  EXPECT_NEAR(a.z, b.z, tolerance);
}

TEST(Rotation, QuarterTurnsAreRightHanded) {
  const double quarter = std::numbers::pi / 2;
  expect_near(rotate(rotation_about({0, 0, 1}, quarter), {1, 0, 0}), {0, 1, 0}, 1e-15);
  expect_near(rotate(rotation_about({1, 0, 0}, quarter), {0, 1, 0}), {0, 0, 1}, 1e-15);
}

TEST(RigidTransform, ComposesAndInverts) {
  for (std::uint64_t seed = 1; seed <= 20; ++seed) {
    const auto u = [&](std::uint64_t i) { return 2.0 * random_uniform(seed, i) - 1.0; };
    const RigidTransform a{normalized(Quaternion{u(0), u(1), u(2), u(3)}), {u(4), u(5), u(6)}};
    const RigidTransform b{normalized(Quaternion{u(7), u(8), u(9), u(10)}), {u(11), u(12), u(13)}};
    const Vec3 p{u(14), u(15), u(16)};
    // 1e-14: some tens of roundings of numbers near 1
    expect_near((a * b).point(p), a.point(b.point(p)), 1e-14);
    expect_near(a.inverse().point(a.point(p)), p, 1e-14);
  }
}

TEST(ModelScale, ConvertsWhereOneMetreIsNotOneMillimetre) {
  const ModelScale scale(2500.0, 2.0);
  EXPECT_DOUBLE_EQ(scale.horizontal(250_m).value(), 100.0);
  EXPECT_DOUBLE_EQ(scale.vertical(100_m).value(), 80.0);
  EXPECT_DOUBLE_EQ(scale.unscale_horizontal(100_mm).value(), 250.0);
  EXPECT_DOUBLE_EQ(scale.unscale_vertical(80_mm).value(), 100.0);
}

template <class A, class B>
concept Addable = requires(A a, B b) {
  a + b;
};
static_assert(Addable<Millimetres, Millimetres>);
static_assert(!Addable<Metres, Millimetres>, "planet and model lengths must not mix");
static_assert(!std::convertible_to<double, Millimetres>, "a bare number has no unit");
static_assert(!std::convertible_to<Metres, Millimetres>, "only ModelScale converts");

TEST(Random, HasTheMomentsOfItsDistribution) {
  constexpr int kDraws = 200000;
  double sum = 0, square = 0, normal = 0, normal_square = 0;
  for (int i = 0; i < kDraws; ++i) {
    const double u = random_uniform(7, static_cast<std::uint64_t>(i));
    const double n = random_normal(8, static_cast<std::uint64_t>(i));
    ASSERT_TRUE(u >= 0.0 && u < 1.0);
    sum += u, square += u * u, normal += n, normal_square += n * n;
  }
  // 5 standard errors: sqrt(1/12), sqrt(4/45), 1 and sqrt(2), each over sqrt(kDraws)
  const double root = std::sqrt(static_cast<double>(kDraws));
  EXPECT_NEAR(sum / kDraws, 0.5, 5 * 0.2887 / root);
  EXPECT_NEAR(square / kDraws, 1.0 / 3.0, 5 * 0.2981 / root);
  EXPECT_NEAR(normal / kDraws, 0.0, 5 / root);
  EXPECT_NEAR(normal_square / kDraws, 1.0, 5 * 1.4142 / root);
}

}  // namespace
}  // namespace maquette

// SPDX-License-Identifier: GPL-3.0-or-later

// meshing/simplify.hpp:
//   a box in small triangles .... 12 triangles, nothing has moved
//   a sphere .................... deviation between the sagitta of as many equilateral triangles
//                                 (no inscribed body does better) and five times that; volume
//   rough rocks ................. sound, as CGAL says, at every count; corners are old ones
//   to a deviation .............. kept, and with a third fewer triangles it would not be
//   an open mesh ................ its border stays, and a warning
//   refused ..................... an edge of three triangles

#include "meshing/simplify.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <map>
#include <numbers>
#include <set>
#include <tuple>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "support/matchers.hpp"
#include "support/shapes.hpp"
#include "support/simple_solids.hpp"

namespace maquette::meshing {
namespace {

using testing::HasSubstr;
using testing_support::FailsWith;
using testing_support::random_rock;
using testing_support::unit_sphere;
using testing_support::volume_mm3;

/// Each triangle in four, corners shared.
TriMesh subdivided(const TriMesh& mesh) {
  TriMesh fine{mesh.vertices_mm, {}};
  std::map<std::pair<std::uint32_t, std::uint32_t>, std::uint32_t> middles;
  const auto middle = [&](std::uint32_t a, std::uint32_t b) {
    const auto [at, fresh] =
        middles.try_emplace(std::minmax(a, b), static_cast<std::uint32_t>(fine.vertices_mm.size()));
    if (fresh) fine.vertices_mm.push_back(0.5 * (mesh.vertices_mm[a] + mesh.vertices_mm[b]));
    return at->second;
  };
  for (const auto& [a, b, c] : mesh.triangles) {
    const std::uint32_t ab = middle(a, b), bc = middle(b, c), ca = middle(c, a);
    for (const auto& t : {std::array{a, ab, ca}, {ab, b, bc}, {ca, bc, c}, {ab, bc, ca}})
      fine.triangles.push_back(t);
  }
  return fine;
}

TEST(Simplify, LeavesABoxItsTwelveTriangles) {
  TriMesh box = testing_support::box_solid({1.0, 2.0, 3.0}, {31.0, 12.0, 23.0});
  for (int i = 0; i < 4; ++i) box = subdivided(box);
  ASSERT_EQ(box.triangles.size(), 12U * 256U);
  const auto fewer = simplify(box, 12);
  ASSERT_TRUE(fewer.has_value()) << fewer.error().message;
  EXPECT_EQ(fewer->mesh.triangles.size(), 12U);
  EXPECT_TRUE(fewer->certificate.sound());
  EXPECT_LT(fewer->deviation_mm, 1e-9);
  EXPECT_NEAR(fewer->certificate.volume_mm3, 30.0 * 10.0 * 20.0, 1e-6);
}

TEST(Simplify, IsNearTheBestOnASphere) {
  constexpr double kRadius_mm = 50.0;
  TriMesh sphere = unit_sphere(5);
  for (Vec3& v : sphere.vertices_mm) v = kRadius_mm * v;
  for (const std::uint64_t count : {320U, 1280U}) {
    const auto fewer = simplify(sphere, count);
    ASSERT_TRUE(fewer.has_value()) << fewer.error().message;
    EXPECT_LE(fewer->mesh.triangles.size(), count);
    EXPECT_GT(fewer->mesh.triangles.size(), count - 3);
    EXPECT_TRUE(fewer->certificate.sound());
    EXPECT_EQ(fewer->certificate.euler_number, 2);
    // Of n equilateral triangles of the sphere's area: a third of the square of their edge is that
    // of the circle through the corners.
    const double square = 16.0 * std::numbers::pi * kRadius_mm * kRadius_mm /
                          (std::sqrt(3.0) * static_cast<double>(count));
    const double sagitta = square / 3.0 / (2.0 * kRadius_mm);
    EXPECT_GT(fewer->deviation_mm, sagitta);
    EXPECT_LT(fewer->deviation_mm, 5.0 * sagitta);
  }
}

TEST(Simplify, LeavesRocksSound) {
  for (const std::uint64_t seed : {1U, 2U, 3U, 4U}) {
    const TriMesh rock = random_rock(seed, {3.0, -2.0, 8.0}, 12.0, 4);
    const std::set<std::tuple<double, double, double>> corners = [&] {
      std::set<std::tuple<double, double, double>> all;
      for (const Vec3& v : rock.vertices_mm) all.insert({v.x, v.y, v.z});
      return all;
    }();
    double before_mm = 0.0;
    for (const std::uint64_t count : {1500U, 200U}) {
      const auto fewer = simplify(rock, count);
      ASSERT_TRUE(fewer.has_value()) << seed << ": " << fewer.error().message;
      EXPECT_LE(fewer->mesh.triangles.size(), count);
      EXPECT_TRUE(fewer->certificate.sound()) << shortcomings(fewer->certificate);
      EXPECT_GT(fewer->deviation_mm, before_mm);
      before_mm = fewer->deviation_mm;
      for (const Vec3& v : fewer->mesh.vertices_mm)
        EXPECT_TRUE(corners.contains({v.x, v.y, v.z})) << "half edges collapse onto old corners";
    }
    EXPECT_LT(before_mm, 0.2 * 12.0);
  }
}

TEST(Simplify, KeepsADeviation) {
  const TriMesh rock = random_rock(7, {}, 12.0, 4, 0.01);
  const auto fewer = simplify_within(rock, Millimetres{0.2});
  ASSERT_TRUE(fewer.has_value()) << fewer.error().message;
  EXPECT_LE(fewer->deviation_mm, 0.2);
  EXPECT_LT(fewer->mesh.triangles.size(), rock.triangles.size() / 3);
  const auto too_few = simplify(rock, fewer->mesh.triangles.size() * 2 / 3);
  ASSERT_TRUE(too_few.has_value());
  EXPECT_GT(too_few->deviation_mm, 0.2);
}

TEST(Simplify, KeepsABorderAndSaysThatItIsOpen) {
  const TriMesh whole = unit_sphere(4);
  TriMesh shell;
  std::map<std::uint32_t, std::uint32_t> kept;
  for (const auto& t : whole.triangles) {
    if (whole.vertices_mm[t[0]].z + whole.vertices_mm[t[1]].z + whole.vertices_mm[t[2]].z < 0.0)
      continue;
    auto& corners = shell.triangles.emplace_back();
    for (std::size_t k = 0; k < 3; ++k) {
      const auto [at, fresh] =
          kept.try_emplace(t[k], static_cast<std::uint32_t>(shell.vertices_mm.size()));
      if (fresh) shell.vertices_mm.push_back(whole.vertices_mm[t[k]]);
      corners[k] = at->second;
    }
  }
  std::vector<std::string> warnings;
  RunContext run;
  run.warn = [&](const std::string& text) { warnings.push_back(text); };
  const auto border = [](const TriMesh& mesh) {
    using Edge = std::array<double, 6>;
    std::set<Edge> edges;
    for (const auto& t : mesh.triangles)
      for (std::size_t k = 0; k < 3; ++k) {
        const Vec3 a = mesh.vertices_mm[t[k]], b = mesh.vertices_mm[t[(k + 1) % 3]];
        edges.insert({a.x, a.y, a.z, b.x, b.y, b.z});
      }
    std::erase_if(edges, [all = edges](const Edge& e) {
      return all.contains({e[3], e[4], e[5], e[0], e[1], e[2]});
    });
    return edges;
  };
  const auto fewer = simplify(shell, 400, run);
  ASSERT_TRUE(fewer.has_value()) << fewer.error().message;
  EXPECT_LE(fewer->mesh.triangles.size(), 400U);
  EXPECT_EQ(border(fewer->mesh), border(shell));
  ASSERT_EQ(warnings.size(), 1U);
  EXPECT_THAT(warnings[0], HasSubstr("so is what comes of it"));
}

TEST(Simplify, RefusesAnEdgeOfThreeTriangles) {
  TriMesh mesh = testing_support::box_solid({}, {1.0, 1.0, 1.0});
  mesh.vertices_mm.push_back({0.5, 0.5, 5.0});
  const auto& t = mesh.triangles[0];
  mesh.triangles.push_back({t[0], t[1], static_cast<std::uint32_t>(mesh.vertices_mm.size() - 1)});
  const auto refused = simplify(mesh, 8);
  ASSERT_THAT(refused, FailsWith(kNotSimplified));
  EXPECT_THAT(refused.error().message, HasSubstr("2-manifold"));
}

}  // namespace
}  // namespace maquette::meshing

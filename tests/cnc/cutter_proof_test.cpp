// SPDX-License-Identifier: GPL-3.0-or-later

// Claims of cutter_proof.hpp and how they are attacked:
//   bound of the gouge .......... flat ground: closed form; random terrain, lines, ramps, helices:
//   an
//                                 exact drop of the cutter every 10 um finds nothing deeper
//   not far above it ............ by two kFinestHalf_mm times the slope
//   not above the limit where the cutter keeps its distance: beside a wall of one cell
//   does not depend on portions . motions one by one and all at once

#include "cnc/cutter_proof.hpp"

#include <random>

#include <gtest/gtest.h>

#include "cnc/verify.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;

template <class Height>
ModelField field_of(std::ptrdiff_t n, double spacing, Height&& height) {
  ModelField f{Grid<float>(n, n), Millimetres{spacing}, {}, {}};
  for (std::ptrdiff_t r = 0; r < n; ++r)
    for (std::ptrdiff_t c = 0; c < n; ++c)
      f.z_mm(r, c) = static_cast<float>(height(f.x_mm(c), f.y_mm(r)));
  return f;
}

Motion line(Vec3 from, Vec3 to) {
  Motion m;
  m.from_mm = from;
  m.to_mm = to;
  m.feed_mm_min = 1000.0;
  return m;
}

double proven(const ModelField& f, const Cutter& cutter, const std::vector<Motion>& motions,
              double limit = 0.005) {
  CutterProof proof(f, cutter, limit);
  proof.add(motions);
  return proof.proven_mm();
}

TEST(CutterProof, MeasuresFlatGround) {
  const ModelField flat = field_of(41, 0.5, [](double, double) { return 2.0; });
  for (const Cutter& cutter : {Cutter::flat(3.0), Cutter::bull(4.0, 1.0)}) {
    EXPECT_NEAR(proven(flat, cutter, {line({2.0, 2.0, 3.0}, {18.0, 9.0, 2.0})}), 0.001, 1e-12)
        << "what chords of arcs may be off";
    EXPECT_NEAR(proven(flat, cutter, {line({2.0, 2.0, 1.7}, {18.0, 9.0, 1.7})}), 0.3, 0.0011);
    EXPECT_NEAR(proven(flat, cutter, {line({5.0, 5.0, 9.0}, {5.0, 5.0, 1.5})}), 0.5, 0.0011);
    EXPECT_EQ(proven(flat, cutter, {line({2.0, 2.0, 30.0}, {18.0, 9.0, 9.0})}), 0.0);
    EXPECT_EQ(proven(flat, cutter, {line({-30.0, 2.0, 0.0}, {-20.0, 9.0, 0.0})}), 0.0) << "beside";
  }
}

TEST(CutterProof, PassesBesideAWall) {
  // Rises by 20 mm from x = 10 to x = 10.5; cells show nothing of what is between them.
  const ModelField wall = field_of(41, 0.5, [](double x, double) { return x > 10.2 ? 20.0 : 0.0; });
  const Cutter cutter = Cutter::bull(4.0, 1.0);
  EXPECT_LE(proven(wall, cutter, {line({5.9, 3.0, 0.01}, {5.9, 17.0, 0.01})}), 0.005);
  EXPECT_LE(proven(wall, cutter, {line({5.9, 3.0, 9.0}, {5.9, 17.0, 0.01})}), 0.005);
  // 0.25 mm into it: 40 mm rise for a mm, less what the corner leaves free.
  EXPECT_GT(proven(wall, cutter, {line({6.25, 3.0, 0.01}, {6.25, 17.0, 0.01})}), 8.0);
}

TEST(CutterProof, BoundsWhatDropsFind) {
  for (const unsigned seed : {1U, 2U, 3U}) {
    std::mt19937 random(seed);
    std::uniform_real_distribution<double> unit(0.0, 1.0);
    const double a = unit(random), b = unit(random);
    const ModelField terrain = field_of(81, 0.5, [&](double x, double y) {
      return 2.0 * std::sin(0.4 * x + 6.0 * a) + 1.5 * std::cos(0.5 * y + 6.0 * b);
    });
    const Cutter cutter = seed % 2 == 0 ? Cutter::flat(2.5) : Cutter::bull(3.0, 0.8);
    const DropCutter exact(terrain, cutter);
    std::vector<Motion> motions;
    Vec3 at{20.0, 20.0, 3.0};
    for (int i = 0; i < 40; ++i) {
      const Vec3 to{5.0 + 30.0 * unit(random), 5.0 + 30.0 * unit(random), 5.0 * unit(random)};
      motions.push_back(line(at, to));
      at = to;
    }
    Motion helix = line({20.0, 14.0, 4.0}, {20.0, 14.0, 1.0});
    helix.kind = Motion::Kind::arc;
    helix.centre_mm = {20.0, 20.0, 4.0};
    helix.sweep_rad = 12.5663706143591725;
    motions.push_back(helix);
    double found = 0.0;
    for (const Motion& m : motions)
      for_each_chord(m, 1e-4, [&](Vec3 from, Vec3 to) {
        const double n = std::ceil(norm(to - from) / 0.01);
        for (double i = 0.0; i <= n; ++i) {
          const Vec3 p = from + (i / n) * (to - from);
          found = std::fmax(found, exact.drop(p.x, p.y).tip_mm - p.z);
        }
      });
    ASSERT_GT(found, 0.5);
    const double bound = proven(terrain, cutter, motions);
    EXPECT_GE(bound, found) << seed;
    // Ways fall by at most 5 mm in 1; terrain is less steep.
    EXPECT_LE(bound, found + 2.0 * kFinestHalf_mm * 5.0 + 0.003) << seed;
    CutterProof one_by_one(terrain, cutter, 0.005);
    for (const Motion& m : motions) one_by_one.add({&m, 1});
    EXPECT_EQ(one_by_one.proven_mm(), bound);
  }
}

}  // namespace
}  // namespace maquette::cnc

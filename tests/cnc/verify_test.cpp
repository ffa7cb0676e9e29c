// SPDX-License-Identifier: GPL-3.0-or-later

// What verify.hpp claims, and how each claim is attacked:
//
//   scallop, mean, rms, length, time ......... closed form: flat design, parallel passes
//   gouges are found, place and depth ........ plunges of 5 um at known nodes
//   max_gouge + bound holds between cells .... random cuts into random ground, sampled densely
//   arcs are swept exactly ................... dome by G18, groove by G2
//   max_excess only where the ball reaches ... slit narrower than the ball; a missing pass
//   nodes lie on the outline ................. odd cells
//   several programs, one stock .............. half and half
//   any number of threads, the same bits ..... 1 against 3
//   every error .............................. one case per code
//   mill and verify agree .................... certified gouge of random ground

#include "cnc/verify.hpp"

#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include "cnc/certificate.hpp"
#include "cnc/cutter_location.hpp"
#include "cnc/gcode_reader.hpp"
#include "cnc/mill.hpp"
#include "cnc/path_pieces.hpp"
#include "core/files.hpp"
#include "core/random.hpp"
#include "meshing/bands.hpp"
#include "support/matchers.hpp"
#include "support/terrain.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;
using testing::HasSubstr;
using testing_support::FailsWith;
using testing_support::flat_field;
using testing_support::Ground;
using testing_support::ground;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

Result<Verification> verify_text(const std::vector<std::string>& texts, const ModelField& design,
                                 const VerifyOptions& options = {}, const RunContext& run = {}) {
  const ScratchFolder folder;
  std::vector<std::filesystem::path> paths;
  for (const std::string& text : texts) {
    paths.push_back(folder / fmt::format("part{}.ngc", paths.size()));
    EXPECT_THAT(write_file(paths.back(), text), Succeeds());
  }
  return verify(paths, design, options, run);
}

/// Zig-zag along x at a constant height, from y1 to y2.
std::string flat_passes(double x1, double x2, double y1, double y2, double stepover, double z) {
  std::string text = fmt::format("G21 G90 G17\nG0 Z20\nG0 X{} Y{}\nG1 Z{} F1000\n", x1, y1, z);
  const int passes = static_cast<int>(std::lround((y2 - y1) / stepover));
  for (int i = 0; i <= passes; ++i)
    text += fmt::format("Y{:.4f}\nX{}\n", y1 + i * stepover, i % 2 == 0 ? x2 : x1);
  return text + "G0 Z20\nM2\n";
}

constexpr double kRounding_mm = 2e-5;

// ---- closed forms ----------------------------------------------------------

TEST(Verify, FlatDesignLeavesTheScallop) {
  const ModelField design = flat_field(41, 61, 0.5, 3.0F);  // 30 x 20 mm
  const auto v = verify_text({flat_passes(-4, 34, 0, 20, 0.5, 3.0)}, design);
  ASSERT_THAT(v, Succeeds());
  const Certificate& c = v->certificate;
  // Cells are 0.1 mm, so the farthest ones from a pass are at 0.2 mm, not 0.25.
  const double scallop = 3.0 - std::sqrt(9.0 - 0.04), near = 3.0 - std::sqrt(9.0 - 0.01);
  EXPECT_NEAR(c.max_gouge_mm, 0.0, kRounding_mm);
  EXPECT_NEAR(c.max_excess_mm, scallop, kRounding_mm);
  EXPECT_NEAR(c.max_excess_anywhere_mm, scallop, kRounding_mm);
  // Rows: 41 on a pass, 80 at 0.1 mm, 80 at 0.2 mm.
  EXPECT_NEAR(c.mean_excess_mm, (80 * near + 80 * scallop) / 201, 1e-7);
  EXPECT_NEAR(c.rms_excess_mm, std::sqrt((80 * near * near + 80 * scallop * scallop) / 201), 1e-7);
  EXPECT_EQ(c.gouged_area_mm2, 0.0);
  EXPECT_TRUE(c.worst_gouges.empty());
  EXPECT_EQ(c.rapid_collisions, 0U);
  // Between cells a flat facet hides at most c^2 / 4R, here a little more for the nodes' slope.
  EXPECT_GT(c.cell_bound_mm, 0.01 / 12.0);
  EXPECT_LT(c.cell_bound_mm, 0.01 / 12.0 * 1.01 + kRounding_mm);
  EXPECT_LT(c.bound_mm, 0.005) << "the path shows that nothing is deeper than the limit";
  EXPECT_NEAR(c.cutting_length_mm, 41 * 38 + 20 + 17, 1e-9);
  EXPECT_NEAR(c.time_min, (41 * 38 + 20 + 17) / 1000.0, 1e-12);
  EXPECT_NEAR(c.rapid_length_mm, 17.0, 1e-9) << "the first two rapids come from nowhere";
  EXPECT_EQ(c.travel.min, (Vec3{-4, 0, 3}));
  EXPECT_EQ(c.travel.max, (Vec3{34, 20, 20}));
  EXPECT_EQ(c.cell_mm, 0.1);
  EXPECT_EQ(c.program_sha256.size(), 64U);
  EXPECT_THAT(to_json(c), HasSubstr("\"max_gouge_mm\": "));
}

TEST(Verify, FindsInjectedGouges) {
  const ModelField design = flat_field(81, 81, 0.5, 3.0F);
  const std::vector<Place> planted = {{10.5, 7.0, 0.005}, {30.1, 8.2, 0.007}, {22.0, 33.3, 0.006}};
  std::string text = flat_passes(0, 40, 0, 40, 0.5, 3.0);
  text.resize(text.find("M2"));
  for (const Place& p : planted)
    text += fmt::format("G0 X{} Y{}\nG1 Z{}\nG0 Z20\n", p.x_mm, p.y_mm, 3.0 - p.depth_mm);
  const auto v = verify_text({text + "M2\n"}, design);
  ASSERT_THAT(v, Succeeds());
  const auto& worst = v->certificate.worst_gouges;
  ASSERT_EQ(worst.size(), 3U);
  const std::vector<std::size_t> by_depth = {1, 2, 0};
  for (std::size_t i = 0; i < 3; ++i) {
    const Place& p = planted[by_depth[i]];
    EXPECT_NEAR(worst[i].x_mm, p.x_mm, 1e-9);
    EXPECT_NEAR(worst[i].y_mm, p.y_mm, 1e-9);
    EXPECT_NEAR(worst[i].depth_mm, p.depth_mm, kRounding_mm);
  }
  EXPECT_NEAR(v->certificate.max_gouge_mm, 0.007, kRounding_mm);
  // Deeper than 1 um: cells within sqrt(2 R (depth - 1 um)) of each place, counted by hand.
  int cells = 0;
  for (const Place& p : planted)
    for (int i = -9; i <= 9; ++i)
      for (int j = -9; j <= 9; ++j)
        cells += 3.0 - std::sqrt(9.0 - 0.01 * (i * i + j * j)) < p.depth_mm - 0.001;
  EXPECT_NEAR(v->certificate.gouged_area_mm2, 0.01 * cells, 1e-9);
}

TEST(Verify, ArcsCutWhatTheyShould) {
  // A circular groove of radius 8 about (15, 15), a helix down and one turn at depth.
  const ModelField design = flat_field(61, 61, 0.5, 10.0F);
  const auto v = verify_text({"G0 Z20\nG0 X23 Y15\nG1 Z11 F500\nG2 X23 Y15 I-8 Z10\n"
                              "G3 X7 Y15 R8\nG3 I8\nG0 Z20\nM2\n"},
                             design, {.cell = Millimetres{0.25}, .stock_top = Millimetres{10.5}});
  ASSERT_THAT(v, Succeeds());
  const ModelField& cut = v->as_milled;
  for (std::ptrdiff_t r = 0; r < cut.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < cut.z_mm.cols(); ++c) {
      const double d = std::hypot(cut.x_mm(c) - 15.0, cut.y_mm(r) - 15.0) - 8.0;
      const double under = std::abs(d) < 3.0 ? 13.0 - std::sqrt(9.0 - d * d) : INFINITY;
      // Level arcs are exact; the groove is everywhere lower than what the helix left.
      ASSERT_NEAR(cut.z_mm(r, c), std::fmin(10.5, under), kRounding_mm) << r << " " << c;
    }
  EXPECT_GE(v->certificate.cell_bound_mm,
            gouge_between_nodes_mm(0.0, 0.25, Cutter::ball(3.0)) + kPieceDeviation_mm)
      << "the helix' chords count in the bound";
  // The circle's own extent, not that of the arcs' ends.
  EXPECT_NEAR(v->certificate.travel.min.y, 7.0, 1e-9);
  EXPECT_NEAR(v->certificate.travel.max.y, 23.0, 1e-9);
  EXPECT_EQ(v->certificate.travel.max.x, 23.0);
}

TEST(Verify, ADomeByVerticalArcs) {
  // Ball's tip on circles in z-x: the envelope of each pass is again a circle, R larger.
  const ModelField design = flat_field(11, 81, 0.5, 0.0F);  // only its outline matters
  std::string text = "G18\nG0 Z40\n";
  for (int i = 0; i <= 50; ++i)
    text += fmt::format("G0 X0 Y{0:.1f}\nG1 Z2 F900\nG3 X40 Z2 I20 K-20\nG0 Z40\n", 0.1 * i);
  const auto v = verify_text({text + "M2\n"}, design, {.stock_top = Millimetres{20.0}});
  ASSERT_THAT(v, Succeeds());
  const double tip_radius = std::hypot(20.0, 20.0), middle_z = 2.0 - 20.0 + 3.0;
  for (std::ptrdiff_t c = 50; c <= 350; ++c) {
    const double x = v->as_milled.x_mm(c) - 20.0;
    const double z = middle_z + std::sqrt(std::pow(tip_radius - 3.0, 2) - x * x);
    ASSERT_NEAR(v->as_milled.z_mm(25, c), z, kRounding_mm) << c;
  }
}

TEST(Verify, SeveralProgramsCutOneStock) {
  const ModelField design = flat_field(41, 41, 0.5, 3.0F);
  const std::string low = flat_passes(0, 20, 0, 10, 0.5, 3.0);
  const std::string high = flat_passes(0, 20, 10, 20, 0.5, 3.0);
  const auto both = verify_text({low, high}, design);
  const auto all = verify_text({flat_passes(0, 20, 0, 20, 0.5, 3.0)}, design);
  const auto half = verify_text({low}, design);
  ASSERT_TRUE(both && all && half);
  EXPECT_EQ(both->as_milled.z_mm, all->as_milled.z_mm);
  EXPECT_NEAR(half->certificate.max_excess_mm, 1.0, kRounding_mm) << "uncut stock is reachable";
  EXPECT_NE(both->certificate.program_sha256, half->certificate.program_sha256);
}

TEST(Verify, NodesLieOnTheOutlineAndCellsDivideTheDesign) {
  for (const auto& [spacing, cell, actual] : std::vector<std::array<double, 3>>{{0.5, 0.1, 0.1},
                                                                                {0.5, 0.15, 0.125},
                                                                                {0.3, 0.5, 0.3},
                                                                                {0.3, 0.1, 0.1},
                                                                                {1.0, 0.3, 0.25}}) {
    ModelField design = flat_field(9, 13, spacing, 1.0F);
    design.x0 = Millimetres{-7.0};
    const auto v =
        verify_text({"G0 X-6 Y1 Z5\nG1 Z0.5 F100\nM2\n"}, design, {.cell = Millimetres{cell}});
    ASSERT_THAT(v, Succeeds());
    const ModelField& m = v->as_milled;
    EXPECT_NEAR(v->certificate.cell_mm, actual, 1e-12);
    EXPECT_NEAR(m.x_mm(0), -7.0, 1e-12);
    EXPECT_NEAR(m.x_mm(m.z_mm.cols() - 1), design.x_mm(12), 1e-9);
    EXPECT_NEAR(m.y_mm(m.z_mm.rows() - 1), design.y_mm(8), 1e-9);
  }
}

// ---- reach -----------------------------------------------------------------

TEST(Verify, ExcessOutOfReachIsToldApart) {
  ModelField design = flat_field(81, 81, 0.5, 3.0F);
  for (std::ptrdiff_t r = 10; r < 70; ++r)  // a slit 1 mm wide and 2 mm deep
    for (std::ptrdiff_t c = 40; c <= 41; ++c) design.z_mm(r, c) = 1.0F;
  const auto v = verify_text({flat_passes(-4, 44, -2, 42, 0.5, 3.0)}, design);
  ASSERT_THAT(v, Succeeds());
  EXPECT_NEAR(v->certificate.max_excess_anywhere_mm, 2.0, 0.02);
  // In reach is the flat: the scallop at 0.2 mm, 6.7 um, and 5 um of tolerance for the slit's lips.
  EXPECT_LT(v->certificate.max_excess_mm, 0.0067 + kReachTolerance_mm);
  EXPECT_GT(v->certificate.max_excess_mm, 0.0066);
}

// A bowl is reached if and only if it is wider than the ball.
TEST(Verify, ReachDependsOnCurvature) {
  for (const double radius : {2.0, 5.0}) {
    ModelField design = flat_field(81, 81, 0.25, 3.0F);
    for (std::ptrdiff_t r = 0; r < 81; ++r)
      for (std::ptrdiff_t c = 0; c < 81; ++c) {
        const double d2 = std::pow(design.x_mm(c) - 10.0, 2) + std::pow(design.y_mm(r) - 10.0, 2);
        const double deep = std::sqrt(std::fmax(0.0, radius * radius - d2)) - 0.7 * radius;
        design.z_mm(r, c) -= static_cast<float>(std::fmax(0.0, deep));
      }
    const auto v = verify_text({flat_passes(-4, 24, -4, 24, 0.5, 3.0)}, design);
    ASSERT_THAT(v, Succeeds());
    EXPECT_NEAR(v->certificate.max_excess_anywhere_mm, 0.3 * radius, 0.01);
    if (radius < 3.0)
      EXPECT_LT(v->certificate.max_excess_mm, 0.1);
    else
      EXPECT_NEAR(v->certificate.max_excess_mm, 0.3 * radius, 0.01);
  }
}

// A furrow of two planes of 45 degrees, its crease 0.1 mm beside one pass and 0.4 mm beside the
// other: there the ball rests on the far wall, and the near one gets what the pass 0.4 mm off
// leaves.
TEST(Verify, BesideACreaseTheBallHasNoRoom) {
  ModelField design = flat_field(51, 51, 0.4, 0.0F);
  const double crease = design.y_mm(26), lift = 3.0 * (std::sqrt(2.0) - 1.0);
  for (std::ptrdiff_t r = 0; r < 51; ++r)
    for (std::ptrdiff_t c = 0; c < 51; ++c)
      design.z_mm(r, c) = static_cast<float>(std::abs(design.y_mm(r) - crease));
  std::string text = "G0 Z60\nF900\n";
  for (int i = 0; i <= 40; ++i)
    text += fmt::format("G0 X0 Y{0:.4f}\nG1 Z{1:.6f}\nX20\nG0 Z60\n", 0.5 * i,
                        std::abs(0.5 * i - crease) + lift);
  const auto v = verify_text({text + "M2\n"}, design,
                             {.cell = Millimetres{0.02}, .stepover = Millimetres{0.5}});
  ASSERT_THAT(v, Succeeds());
  const Certificate& c = v->certificate;
  const double touch = 3.0 / std::sqrt(2.0), half = 0.25 * std::sqrt(2.0);
  const double stated = (3.0 - std::sqrt(9.0 - half * half)) * std::sqrt(2.0);
  // What is left at a place `off` from the crease.
  const auto excess = [&](double off) {
    double left = INFINITY;
    for (int i = 0; i <= 40; ++i) {
      const double at = 0.5 * i - crease, d2 = 9.0 - (off - at) * (off - at);
      if (d2 > 0.0) left = std::fmin(left, std::abs(at) + lift + 3.0 - std::sqrt(d2));
    }
    return left - std::abs(off);
  };
  // The ball rests in the crease, or touches one wall.
  const auto closing = [&](double off) {
    return std::abs(off) > touch ? 0.0 : lift + 3.0 - std::sqrt(9.0 - off * off) - std::abs(off);
  };
  double room = -INFINITY, tight = -INFINITY, tight_mm = 0.0, unreached_mm = 0.0;
  double over_closing = -INFINITY, over_closing_mm = 0.0;
  for (double off = -5.0; off < 5.0; off += 0.0005) {
    const double over = excess(off) - stated, from_touch = std::abs(off) - touch;
    // Half a stepover of room, less what 3 um let the ball slide up: it rises 2 for 1.
    if (from_touch > 0.25 - 0.5 * kRoomTolerance_mm) room = std::fmax(room, over);
    const bool reached = from_touch > -0.5 * kReachTolerance_mm;
    if (reached) tight = std::fmax(tight, over);
    if (over > kOverScallop_mm) (reached ? tight_mm : unreached_mm) += 0.0005;
    over_closing = std::fmax(over_closing, over - closing(off));
    if (over - closing(off) > kOverScallop_mm) over_closing_mm += 0.0005;
  }
  EXPECT_GT(tight, 0.03) << "twice the stated scallop";
  EXPECT_NEAR(c.max_tight_over_scallop_mm, tight, 0.006);  // the last node may be 0.02 mm off
  EXPECT_LT(room, 0.001);
  EXPECT_NEAR(c.max_excess_over_scallop_mm, room, 0.003);
  // Sampled every 0.06 mm, at most one row too many or too few on each side of a strip.
  const double length = 20.0 - 2.0 * 3.0;
  EXPECT_GT(tight_mm, 0.09);
  EXPECT_NEAR(c.tight_area_mm2, tight_mm * length, 0.07 * length);
  EXPECT_GT(unreached_mm, 4.0);
  EXPECT_NEAR(c.unreached_area_mm2, unreached_mm * length, 0.13 * length);
  EXPECT_GT(over_closing, 0.05);
  EXPECT_NEAR(c.max_over_closing_mm, over_closing, 0.006);
  EXPECT_LT(over_closing_mm, tight_mm + unreached_mm) << "some of it no path can take";
  EXPECT_NEAR(c.over_closing_area_mm2, over_closing_mm * length, 0.13 * length);
}

// Against a ball tried every 0.02 mm: no place of those is better than what the search finds by
// more than the search may leave.
TEST(Verify, ClosingIsWhatNoPlaceBetters) {
  ModelField design = testing_support::ground(testing_support::Ground::rough, 3, 41, 0.5);
  for (float& z : design.z_mm.cells()) z = 5.0F + 0.4F * (z - 5.0F);
  const double R = 3.0, step = 0.02;
  const ReachSearch reach(design, 5, R);
  DropCutter cutter(design, Cutter::ball(R));
  constexpr int kSide = 400;  // places of the ball, from 6 mm on along both axes
  Grid<double> tips(kSide, kSide);
  for (int r = 0; r < kSide; ++r)
    for (int c = 0; c < kSide; ++c)
      tips(r, c) =
          cutter.drop(design.x0.value() + 6.0 + step * c, design.y0.value() + 6.0 + step * r)
              .tip_mm;
  const DividedDesign divided(design, 5);
  double most = 0.0;
  int missed = 0, nodes = 0;
  for (int row = 92; row < 108; ++row)  // 9.2 to 10.8 mm
    for (int col = 92; col < 108; ++col) {
      double least = INFINITY;
      for (int r = 0; r < kSide; ++r)
        for (int c = 0; c < kSide; ++c) {
          const double dx = 6.0 + step * c - 0.1 * col, dy = 6.0 + step * r - 0.1 * row;
          const double q = R * R - dx * dx - dy * dy;
          if (q > 0.0) least = std::fmin(least, tips(r, c) + R - std::sqrt(q));
        }
      least -= divided.at(row, col);
      const double found = reach.closing_mm(row, col);
      most = std::fmax(most, least);
      ++nodes;
      missed += found > least + 0.001;
      // Slopes of the tip are below 1 here: half a step's diagonal.
      ASSERT_GT(found, least - 0.015) << row << " " << col;
      ASSERT_LT(found, least + 0.02) << row << " " << col;
    }
  EXPECT_GT(most, 0.03);
  EXPECT_LT(missed, nodes / 20);
}

// ---- tools, stock, stones, travel --------------------------------------------------

TEST(Verify, EachToolCutsWithItsOwnShape) {
  const ModelField design = flat_field(41, 41, 0.5, 3.0F);
  VerifyOptions options;
  options.tools = {{1, "flat", Cutter::flat(2.0)}, {7, "ball", Cutter::ball(1.5)}};
  const std::string text =
      "G0 X5.02 Y5.02 Z20\nT1 M6\nG1 Z4 F500\nX15\nG0 Z20\nT7 M6\nG0 Y12.02\nG1 Z3.5 F200\nX5\nG0 "
      "Z20\nM2\n";
  const auto v = verify_text({text}, design, options);
  ASSERT_THAT(v, Succeeds());
  const ModelField& m = v->as_milled;
  for (std::ptrdiff_t r = 0; r < m.z_mm.rows(); ++r) {
    const double flat = std::abs(m.y_mm(r) - 5.02), ball = std::abs(m.y_mm(r) - 12.02);
    const double expected = flat < 2.0   ? 4.0
                            : ball < 1.5 ? 3.5 + 1.5 - std::sqrt(2.25 - ball * ball)
                                         : 4.0;
    EXPECT_NEAR(m.z_mm(r, 100), std::fmin(4.0, expected), kRounding_mm) << r;
  }
  const Certificate& c = v->certificate;
  ASSERT_EQ(c.tools.size(), 2U);
  EXPECT_EQ(c.tools[1].number, 7);
  EXPECT_NEAR(c.tools[0].time.cutting_mm, 16.0 + 9.98, 1e-9);
  EXPECT_NEAR(c.tools[1].time.cutting_s, 60.0 * (16.5 + 10.0) / 200.0, 1e-9);
  EXPECT_EQ(c.tools[1].time.rapid_s, 0.0);
  // With a machine: its own time, with acceleration and rapids, never less than at the feed.
  options.machine = find_machine("portal_mill_2500").value();
  const auto timed = verify_text({text}, design, options);
  ASSERT_THAT(timed, Succeeds());
  const Certificate& t = timed->certificate;
  EXPECT_GT(t.tools[1].time.cutting_s, c.tools[1].time.cutting_s);
  EXPECT_LT(t.tools[1].time.cutting_s, 1.1 * c.tools[1].time.cutting_s);
  EXPECT_GT(t.tools[1].time.rapid_s, 0.0);
  EXPECT_NEAR(t.time_min, (t.tools[0].time.total_s() + t.tools[1].time.total_s()) / 60.0, 1e-12);
  options.tools.pop_back();
  const auto missing = verify_text({text}, design, options);
  ASSERT_THAT(missing, FailsWith(kToolNotInTable));
  EXPECT_THAT(missing.error().message, HasSubstr("part0.ngc:7"));
}

TEST(Verify, AFlatCutterIsProvenByWhatItLeaves) {
  // A slope of 1 in 2, a flat end 2 mm wide along the contour, 0.3 mm clear of it.
  ModelField design = flat_field(61, 61, 0.5, 0.0F);
  for (std::ptrdiff_t r = 0; r < 61; ++r)
    for (std::ptrdiff_t c = 0; c < 61; ++c)
      design.z_mm(r, c) = static_cast<float>(0.5 * design.y_mm(r));
  VerifyOptions options;
  options.tools = {{1, "flat", Cutter::flat(1.0)}, {2, "ball", Cutter::ball(3.0)}};
  std::string rough = "T1 M6\nG0 Z40\nG0 X-5 Y1\nF900\n";
  for (int i = 0; i <= 28; ++i)
    rough += fmt::format("G0 Y{0}\nG1 Z{1}\nX35\nG0 Z40\nX-5\n", 1.0 + i, 0.5 * (2.0 + i) + 0.3);
  const auto v = verify_text({rough + "M2\n"}, design, options);
  ASSERT_THAT(v, Succeeds());
  EXPECT_EQ(v->certificate.max_gouge_mm, 0.0);
  // A cell's diagonal times the slope is less than the allowance.
  EXPECT_EQ(v->certificate.bound_mm, 0.0);
  EXPECT_FALSE(v->certificate.path.has_value());
  // Finished by a ball, what the flat end did is still known to be harmless.
  const double along = 3.0 * (std::sqrt(1.25) - 1.0);
  std::string finish = "T2 M6\n";
  for (int i = 0; i <= 50; ++i)
    finish += fmt::format("G0 Y{0:.4f}\nG1 Z{1:.5f}\nX35\nG0 Z40\nX-5\n", 2.0 + 0.5 * i,
                          0.5 * (2.0 + 0.5 * i) + along - 0.002);
  const auto both = verify_text({rough + finish + "M2\n"}, design, options);
  ASSERT_THAT(both, Succeeds());
  EXPECT_NEAR(both->certificate.max_gouge_mm, 0.002, 1e-4);
  EXPECT_LE(both->certificate.max_gouge_mm + both->certificate.bound_mm, 0.0051);
  // The same flat cuts 0.29 mm lower may gouge between the cells, as far as these can tell; the
  // path knows that 0.06 mm are left.
  std::string low = rough;
  for (std::size_t at = 0; (at = low.find("\nG1 Z", at)) != std::string::npos; ++at) {
    const double z = std::stod(low.substr(at + 5));
    low.replace(at + 5, low.find('\n', at + 1) - at - 5, fmt::format("{:.4f}", z - 0.29));
  }
  const auto near = verify_text({low + "M2\n"}, design, options);
  ASSERT_THAT(near, Succeeds());
  EXPECT_EQ(near->certificate.max_gouge_mm, 0.0);
  EXPECT_NEAR(near->certificate.cell_bound_mm, 0.5 * std::sqrt(2.0) * 0.1 - 0.06, 1e-3)
      << "the last node under the end's rim is 0.1 mm, so 0.05 mm of height, inside it";
  EXPECT_EQ(near->certificate.bound_mm, 0.0);
}

TEST(Verify, StartsFromWhatAnEarlierOperationLeft) {
  const ModelField design = flat_field(41, 41, 0.5, 3.0F);
  const std::string low = flat_passes(0, 20, 0, 10, 0.5, 3.0);
  const std::string high = flat_passes(0, 20, 10, 20, 0.5, 3.0);
  const auto first = verify_text({low}, design);
  ASSERT_THAT(first, Succeeds());
  VerifyOptions options;
  options.stock = &first->as_milled;
  const auto second = verify_text({high}, design, options);
  const auto both = verify_text({low, high}, design);
  ASSERT_TRUE(second && both);
  EXPECT_EQ(second->as_milled.z_mm, both->as_milled.z_mm);
  // A stock that does not reach everywhere: a flat top beside it.
  ModelField half = flat_field(11, 41, 0.5, 3.25F);
  half.z_mm(3, 3) = NAN;
  options.stock = &half;
  options.stock_top = Millimetres{5.0};
  const auto third = verify_text({"G0 X10 Y18 Z20\nG1 Z4 F9\nM2\n"}, design, options);
  ASSERT_THAT(third, Succeeds());
  EXPECT_EQ(third->as_milled.z_mm(30, 100), 3.25F);
  EXPECT_EQ(third->as_milled.z_mm(15, 15), 5.0F) << "a void";
  EXPECT_EQ(third->as_milled.z_mm(100, 10), 5.0F);
}

TEST(Verify, HoldersStonesAndTravel) {
  const ModelField design = flat_field(41, 41, 0.5, 3.0F);
  ModelField stones = design;
  stones.z_mm(20, 20) = 6.0F;  // at (10, 10)
  const std::string text = "G0 X2 Y10 Z12\nG1 Z3 F100\nX18\nY12\nX2\nG0 Z12\nM2\n";
  VerifyOptions options;
  options.stock_top = Millimetres{9.0};
  options.with_stones = &stones;
  options.machine = find_machine("unlimited").value();
  options.machine->travel_mm = {15.0, 15.0, 1000.0};
  Cutter cutter = Cutter::ball(3.0);
  cutter.holder = {{5.0, 30.0, 8.0, 8.0}};
  options.tools = {{0, "short", cutter}};
  const auto v = verify_text({text}, design, options);
  ASSERT_THAT(v, Succeeds());
  EXPECT_EQ(v->certificate.stone_collisions, 2U) << "one pass over it, one 2 mm beside";
  EXPECT_EQ(v->certificate.holder_collisions, 5U) << "5 mm into 6 mm of stock, the retreat too";
  ASSERT_FALSE(v->certificate.first_holder_collisions.empty());
  EXPECT_EQ(v->certificate.first_holder_collisions[0].line, 2U);
  EXPECT_EQ(v->certificate.beyond_travel, "x");
  options.stock_top = Millimetres{7.5};
  options.with_stones = nullptr;
  const auto lower = verify_text({text}, design, options);
  ASSERT_THAT(lower, Succeeds());
  EXPECT_EQ(lower->certificate.holder_collisions, 0U);
  EXPECT_EQ(lower->certificate.stone_collisions, 0U);
}

TEST(Verify, AirAndEngagement) {
  const ModelField design = flat_field(41, 81, 0.5, 3.0F);
  double visited = 0.0;
  std::vector<std::uint64_t> lines;
  VerifyOptions options;
  options.stock_top = Millimetres{4.0};
  options.visit = [&](const Motion& m, std::size_t program, double removed_mm3) {
    EXPECT_EQ(program, lines.size() < 5 ? 0U : 1U);
    lines.push_back(m.line);
    visited += removed_mm3;
  };
  // A groove 0.5 mm deep across the stock, back in it, and above it.
  const auto v =
      verify_text({"G0 X-10 Y10.03 Z20\nG1 Z3.5 F600\nX50\nX-10\nZ8\nX50\nM2\n", "G0 Z9\nM2\n"},
                  design, options);
  ASSERT_THAT(v, Succeeds());
  EXPECT_THAT(lines, testing::ElementsAre(2U, 3U, 4U, 5U, 6U));
  EXPECT_EQ(visited, v->certificate.engagement.removed_mm3);
  const EngagementFigures& e = v->certificate.engagement;
  EXPECT_NEAR(e.cutting_length_mm, 16.5 + 60 + 60 + 4.5 + 60, 1e-9);
  EXPECT_NEAR(e.air_length_mm, e.cutting_length_mm - 60.0, 1e-9) << "all but the first pass";
  const double half = std::sqrt(9.0 - 6.25), section = 9.0 * std::acos(2.5 / 3.0) - half * 2.5;
  EXPECT_NEAR(e.removed_mm3, 40.0 * section, 0.01 * 40.0 * section);
  EXPECT_NEAR(e.largest_mm2, section * 40.0 / 60.0, 0.01);
  EXPECT_NEAR(e.largest_rate_mm3_min, 600.0 * e.largest_mm2, 1e-9);
  EXPECT_NEAR(e.length_by_class_mm[4], 60.0, 1e-9) << "0.3 to 1 mm^2";
}

// A slope of 45 degrees along the passes: their spacing in plan is that on the surface.
// The part is cut in bands of rows that overlap; each cell's loss is counted once.
TEST(Verify, RemovedVolumeIsWhatIsMissing) {
  const ModelField design = flat_field(801, 25, 0.5, 3.0F);  // 400 mm: 4001 rows of cells
  const auto v =
      verify_text({flat_passes(-4, 16, 0, 400, 2.0, 3.0)}, design, {.stock_top = Millimetres{4.0}});
  ASSERT_THAT(v, Succeeds());
  double missing = 0.0;
  for (const float z : v->as_milled.z_mm.cells()) missing += 0.01 * (4.0 - static_cast<double>(z));
  EXPECT_NEAR(v->certificate.engagement.removed_mm3, missing, 1e-5 * missing);
}

TEST(Verify, ScallopsBySlopeAndBorderApart) {
  ModelField design = flat_field(81, 81, 0.5, 0.0F);
  for (std::ptrdiff_t r = 0; r < 81; ++r)
    for (std::ptrdiff_t c = 0; c < 81; ++c) design.z_mm(r, c) = static_cast<float>(design.y_mm(r));
  const double lift = 3.0 * (std::sqrt(2.0) - 1.0);
  std::string text = "G0 Z60\nF900\n";
  for (int i = 0; i <= 80; ++i)  // level passes, across the slope, inside the outline alone
    text += fmt::format("G0 X0 Y{0:.4f}\nG1 Z{1:.6f}\nX40\nG0 Z60\n", 0.5 * i, 0.5 * i + lift);
  const auto v = verify_text({text + "M2\n"}, design, {.stepover = Millimetres{0.5}});
  ASSERT_THAT(v, Succeeds());
  const Certificate& c = v->certificate;
  // The ball touches the slope 3 / sqrt 2 north of its axis; how high it stands beside there.
  const double touch = 3.0 / std::sqrt(2.0);
  const auto over = [&](double north) {
    return touch - std::sqrt(9.0 - std::pow(touch + north, 2)) - north;
  };
  std::vector<double> at_nodes;  // of the five rows between two passes
  for (int i = 0; i < 5; ++i) {
    const double north = std::remainder(0.1 * i - touch, 0.5);
    at_nodes.push_back(std::fmin(over(north), over(north + (north < 0.0 ? 0.5 : -0.5))));
  }
  std::sort(at_nodes.begin(), at_nodes.end());
  const double half = 0.25 * std::sqrt(2.0);
  const double stated = (3.0 - std::sqrt(9.0 - half * half)) * std::sqrt(2.0);
  EXPECT_NEAR(c.max_excess_inside_mm, at_nodes[4], kRounding_mm);
  EXPECT_NEAR(c.max_excess_over_scallop_mm, at_nodes[4] - stated, kRounding_mm);
  EXPECT_NEAR(c.max_tight_over_scallop_mm, at_nodes[4] - stated, kRounding_mm);
  EXPECT_EQ(c.tight_area_mm2, 0.0);
  EXPECT_EQ(c.unreached_area_mm2, 0.0);
  // Between the rows the ridge is where both passes leave the same.
  double ridge = 0.0;
  for (int i = 0; i <= 1000; ++i)
    ridge = std::fmax(ridge, std::fmin(over(0.0005 * i), over(0.0005 * i - 0.5)));
  EXPECT_GT(c.max_excess_inside_mm + c.excess_bound_mm, ridge);
  EXPECT_LT(c.max_excess_inside_mm + c.excess_bound_mm, 2.0 * ridge);
  // At the lower edge the ball would have to stand outside the outline to touch.
  EXPECT_GT(c.max_excess_border_mm, 0.5);
  EXPECT_EQ(c.max_excess_mm, c.max_excess_border_mm);
  ASSERT_EQ(c.scallops.size(), 1U);
  EXPECT_EQ(c.scallops[0].from_deg, 45.0);
  // Heights normal to the surface, in bins of 0.2 um.
  EXPECT_NEAR(c.scallops[0].p99_mm, at_nodes[4] / std::sqrt(2.0), 0.0002);
  EXPECT_NEAR(c.scallops[0].median_mm, at_nodes[2] / std::sqrt(2.0), 0.0002);
}

// ---- the bound -------------------------------------------------------------

class VerifyBound : public testing::TestWithParam<int> {};

// Plunges only, so that the true cut surface is a minimum of spheres; sampled 9 x 9 times
// per cell, the gouge must stay below max_gouge + bound.
TEST_P(VerifyBound, HoldsBetweenTheCells) {
  const auto seed = static_cast<std::uint64_t>(GetParam());
  ModelField design = ground(seed % 2 == 0 ? Ground::rolling : Ground::rough, seed, 21, 0.5);
  std::string text = "G90\nG0 Z40\nF500\n";
  std::vector<Vec3> tips;
  for (std::uint64_t i = 0; i < 12; ++i) {
    const double x = design.x_mm(0) + 1.0 + 8.0 * random_uniform(seed, 3 * i + 1000);
    const double y = design.y_mm(0) + 1.0 + 8.0 * random_uniform(seed, 3 * i + 1001);
    const double z = heightmap::height_at(design, x, y) - 0.3 * random_uniform(seed, 3 * i + 1002);
    text += fmt::format("G0 X{:.6f} Y{:.6f}\nG1 Z{:.6f}\nG0 Z40\n", x, y, z);
    tips.push_back(
        {std::round(x * 1e6) / 1e6, std::round(y * 1e6) / 1e6, std::round(z * 1e6) / 1e6});
  }
  const double cell = 0.25;
  const auto v = verify_text({text + "M2\n"}, design, {.cell = Millimetres{cell}});
  ASSERT_THAT(v, Succeeds());
  double deepest = 0.0;
  constexpr int kFine = 9;
  const int n = 40 * kFine;
  for (int i = 0; i <= n; ++i)
    for (int j = 0; j <= n; ++j) {
      const double x = design.x_mm(0) + cell * j / kFine, y = design.y_mm(0) + cell * i / kFine;
      double under = INFINITY;
      for (const Vec3& t : tips) {
        const double q = 9.0 - std::pow(x - t.x, 2) - std::pow(y - t.y, 2);
        if (q > 0.0) under = std::fmin(under, t.z + 3.0 - std::sqrt(q));
      }
      const double height = heightmap::height_at(design, x, y);
      if (std::isfinite(height)) deepest = std::fmax(deepest, height - under);
    }
  const Certificate& c = v->certificate;
  EXPECT_LE(deepest, c.cell_gouge_mm + c.cell_bound_mm);
  EXPECT_GE(deepest, c.cell_gouge_mm - kRounding_mm);
  RecordProperty("missed_nm", static_cast<int>(1e6 * (deepest - c.cell_gouge_mm)));
  RecordProperty("bound_nm", static_cast<int>(1e6 * c.cell_bound_mm));
  // The path's own proof knows no cells: it has the very bottom of each plunge.
  EXPECT_LE(deepest, c.max_gouge_mm + kRounding_mm);
  EXPECT_LE(c.bound_mm, 0.0003);
}
INSTANTIATE_TEST_SUITE_P(Seed, VerifyBound, testing::Range(1, 21),
                         testing::PrintToStringParamName());

// The worst case of the flat: the ball's tip in the middle of a cell hides almost all of
// c^2 / 4R.
TEST(VerifyBound, IsNearlyReached) {
  const ModelField design = flat_field(21, 21, 0.5, 3.0F);
  const auto v =
      verify_text({"G0 X5.25 Y5.25 Z20\nG1 Z2.9 F100\nM2\n"}, design, {.cell = Millimetres{0.5}});
  ASSERT_THAT(v, Succeeds());
  const double missed = 0.1 - v->certificate.cell_gouge_mm;
  EXPECT_NEAR(missed, 0.25 / 12.0, 2e-4);
  EXPECT_GT(v->certificate.cell_bound_mm, missed);
  EXPECT_LT(v->certificate.cell_bound_mm, 1.2 * missed);
  EXPECT_NEAR(v->certificate.max_gouge_mm, 0.1, 1e-9) << "but not from the path";
}

TEST(VerifyBound, GrowsWithSlopeAndGivesUpAtTheRim) {
  EXPECT_NEAR(gouge_between_nodes_mm(0.0, 0.1, Cutter::ball(3.0)), 0.01 / 12.0, 1e-5);
  EXPECT_GT(gouge_between_nodes_mm(1.0, 0.1, Cutter::ball(3.0)), 0.01 / 12.0 * std::pow(2.0, 1.5));
  EXPECT_LT(gouge_between_nodes_mm(1.0, 0.1, Cutter::ball(3.0)),
            0.01 / 12.0 * std::pow(2.0, 1.5) * 1.35);
  EXPECT_TRUE(std::isinf(gouge_between_nodes_mm(3.5, 0.1, Cutter::ball(3.0))));
}

// The curvature of a small corner says nothing where the corners of a cell get near its rim.
TEST(VerifyBound, ABullNoseNearTheRimIsBoundByTheRise) {
  ModelField design = flat_field(41, 41, 0.5, 0.0F);
  const double rim = 1.0 - 0.25 * std::sqrt(2.0);  // of corner 1 mm, cell 0.25 mm
  const double slope = rim / std::sqrt(1.0 - rim * rim) - 1e-5;
  for (std::ptrdiff_t r = 0; r < 41; ++r)
    for (std::ptrdiff_t c = 0; c < 41; ++c)
      design.z_mm(r, c) = static_cast<float>(slope * design.x_mm(c));
  VerifyOptions options{.cell = Millimetres{0.25}, .stock_top = Millimetres{20.0}};
  options.tools = {{1, "bull", Cutter::bull(3.0, 1.0)}};
  const auto v =
      verify_text({"T1 M6\nG0 Z30\nG0 X4 Y10\nG1 Z9 F500\nX5\nG0 Z30\nM2\n"}, design, options);
  ASSERT_THAT(v, Succeeds());
  EXPECT_LT(v->certificate.cell_gouge_mm + v->certificate.cell_bound_mm,
            slope * std::sqrt(2.0) * 0.25 + 1e-3);
}

// ---- the whole room --------------------------------------------------------

class MillThenVerify : public testing::TestWithParam<int> {};

TEST_P(MillThenVerify, TheCertifiedGougeIsNotExceeded) {
  const auto seed = static_cast<std::uint64_t>(GetParam());
  const ScratchFolder folder;
  const ModelField design = ground(Ground::rolling, seed, 61, 0.5);
  const auto program = folder / "part.ngc";
  const auto milled = mill(design, {}, program);
  ASSERT_THAT(milled, Succeeds());
  const auto v = verify(std::span(&program, 1), design);
  ASSERT_THAT(v, Succeeds());
  EXPECT_LE(v->certificate.max_gouge_mm, milled->certified_gouge_mm + kRounding_mm);
  EXPECT_EQ(v->certificate.blending_mm, milled->shares.blending_mm) << "G64 P, read back";
  EXPECT_EQ(v->certificate.rapid_collisions, 0U);
  EXPECT_NEAR(v->certificate.cutting_length_mm, milled->path_length_mm,
              0.01 * milled->path_length_mm);
}
INSTANTIATE_TEST_SUITE_P(Seed, MillThenVerify, testing::Values(1, 2, 3),
                         testing::PrintToStringParamName());

// The border of two bands is a pass of both programs. What is cut beside it must be as if one
// program had cut the whole surface, within 2 um.
TEST_P(MillThenVerify, TheSeamOfTwoBandsDoesNotShow) {
  const auto seed = static_cast<std::uint64_t>(GetParam());
  const ScratchFolder folder;
  const ModelField design = ground(Ground::rough, seed, 81, 0.5);
  const std::vector<std::filesystem::path> one{folder / "one.ngc"};
  ASSERT_THAT(mill(design, {}, one[0]), Succeeds());
  const auto whole = verify(one, design);
  ASSERT_THAT(whole, Succeeds());
  const auto bands = meshing::split_into_bands(design, meshing::BandAxis::y, Millimetres{20.0});
  ASSERT_THAT(bands, Succeeds());
  ASSERT_EQ(bands->size(), 2U);
  std::vector<std::filesystem::path> programs;
  for (const meshing::Band& band : *bands) {
    MillOptions options;
    options.first_y_mm = design.y_mm(band.first);
    options.last_y_mm = design.y_mm(band.last);
    programs.push_back(folder / fmt::format("band_{}.ngc", programs.size()));
    const ModelField part = meshing::band_field(design, band, options.ball_diameter);
    ASSERT_THAT(mill(part, options, programs.back()), Succeeds());
  }
  const auto joined = verify(programs, design);
  ASSERT_THAT(joined, Succeeds());
  // Passes differ by what the tolerance leaves to arcs, for the second band may begin at the other
  // end. A seam is what does not average out: mean height of a cutter's radius on either side, in
  // windows of 10 mm along the border.
  const auto& a = whole->as_milled;
  const auto& b = joined->as_milled;
  ASSERT_EQ(a.z_mm.rows(), b.z_mm.rows());
  const double border = design.y_mm(bands->front().last);
  double seam = 0.0;
  for (double from = 0.0; from < 40.0; from += 10.0) {
    double sum[2] = {0.0, 0.0}, count[2] = {0.0, 0.0};
    for (std::ptrdiff_t r = 0; r < a.z_mm.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < a.z_mm.cols(); ++c) {
        const double x = a.x_mm(c) - a.x0.value() - from, y = a.y_mm(r) - border;
        if (x < 0.0 || x >= 10.0 || y == 0.0 || std::fabs(y) > 3.0) continue;
        const int side = y > 0.0 ? 1 : 0;
        sum[side] += static_cast<double>(b.z_mm(r, c)) - static_cast<double>(a.z_mm(r, c));
        count[side] += 1.0;
      }
    seam = std::fmax(seam, std::fabs(sum[1] / count[1] - sum[0] / count[0]));
  }
  EXPECT_LE(seam, 0.002);
  RecordProperty("seam_mm", fmt::format("{:.6f}", seam));
}

// Ground that falls outwards is touched from beyond the outline: a plane of slope s keeps
// R (1 / cos s - 1) at its lower side where passes end on the outline.
TEST(Overrun, GroundThatFallsOutwardsIsCutToItsEdge) {
  const ScratchFolder folder;
  for (const int axis : {0, 1})
    for (const double side : {1.0, -1.0}) {
      ModelField design = flat_field(81, 81, 0.5, 0.0F);
      const double slope = 20.0 / 180.0 * std::numbers::pi;
      for (std::ptrdiff_t r = 0; r < 81; ++r)
        for (std::ptrdiff_t c = 0; c < 81; ++c)
          design.z_mm(r, c) = static_cast<float>(
              20.0 + side * std::tan(slope) * (axis == 0 ? design.x_mm(c) : design.y_mm(r)));
      const Millimetres overrun = border_overrun(design, BallNose{3.0});
      EXPECT_NEAR(overrun.value(), 3.0 * std::sin(slope), 0.0011);
      double excess[2];
      for (const bool beyond : {false, true}) {
        MillOptions options;
        if (beyond) options.overrun = overrun;
        const auto program = folder / "part.ngc";
        const auto milled = mill(design, options, program);
        ASSERT_THAT(milled, Succeeds());
        const auto v = verify(std::span(&program, 1), design);
        ASSERT_THAT(v, Succeeds());
        EXPECT_LE(v->certificate.max_gouge_mm + v->certificate.bound_mm, 0.0052);
        EXPECT_EQ(v->certificate.rapid_collisions, 0U);
        excess[beyond] = v->certificate.max_excess_mm;
        const auto& travel = v->certificate.travel;
        const double out = beyond ? overrun.value() : 0.0;
        EXPECT_NEAR(travel.max.x, 40.0 + out + options.lead_radius.value(), 1e-3) << "and the lead";
        EXPECT_NEAR(travel.max.y, 40.0 + (beyond ? std::ceil(out / 0.5) * 0.5 : 0.0), 1e-3)
            << "whole stepovers";
        // Beyond the outline nothing is predicted: the ridge is that of the plane everywhere.
        EXPECT_LE(milled->scallop.highest_mm, 0.0125);
      }
      EXPECT_NEAR(excess[0], 3.0 * (1.0 / std::cos(slope) - 1.0), 0.015);
      // Stated scallop across the slope 11.8 um, and what the tolerance leaves above.
      EXPECT_LE(excess[1], 0.022);
    }
}

// The lead of a pass comes down beside the block: as far out as the ball still reaches its rim.
TEST(Overrun, RapidsBesideAHighBlockTouchNothing) {
  const ScratchFolder folder;
  ModelField stock = flat_field(40, 40, 1.0, 30.0F);  // squares over the design's 40 mm
  stock.x0 = stock.y0 = Millimetres{0.5};
  for (const double slope_deg : {25.0, 37.0})
    for (const double direction_deg : {0.0, 90.0, 30.0})
      for (const bool zigzag : {true, false}) {
        ModelField design = flat_field(81, 81, 0.5, 0.0F);
        for (std::ptrdiff_t r = 0; r < 81; ++r)
          for (std::ptrdiff_t c = 0; c < 81; ++c)
            design.z_mm(r, c) =
                static_cast<float>(20.0 - std::tan(slope_deg / 180.0 * std::numbers::pi) *
                                              std::max(std::abs(design.x_mm(c) - 20.0),
                                                       std::abs(design.y_mm(r) - 20.0)));
        MillOptions options;
        options.stepover = Millimetres{2.0};
        options.direction = degrees(direction_deg);
        options.zigzag = zigzag;
        options.stock = &stock;
        options.overrun = border_overrun(design, BallNose{3.0});
        const auto program = folder / "part.ngc";
        ASSERT_THAT(mill(design, options, program), Succeeds());
        VerifyOptions whole;
        whole.stock_top = Millimetres{30.0};
        whole.cell = Millimetres{0.25};
        const auto v = verify(std::span(&program, 1), design, whole);
        ASSERT_THAT(v, Succeeds());
        EXPECT_EQ(v->certificate.rapid_collisions, 0U)
            << slope_deg << " degrees, passes along " << direction_deg
            << (zigzag ? "" : " one way");
      }
}

TEST(Overrun, IsAsTheBorderWantsIt) {
  ModelField design = flat_field(81, 81, 0.5, 3.0F);
  EXPECT_EQ(border_overrun(design, BallNose{3.0}).value(), 0.0);
  const auto shape = [&](double bend) {
    for (std::ptrdiff_t r = 0; r < 81; ++r)
      for (std::ptrdiff_t c = 0; c < 81; ++c) {
        const double x = design.x_mm(c) - 20.0, y = design.y_mm(r) - 20.0;
        design.z_mm(r, c) = static_cast<float>(30.0 + bend * (x * x + y * y));
      }
    return border_overrun(design, BallNose{3.0}).value();
  };
  EXPECT_EQ(shape(0.005), 0.0) << "a bowl";
  EXPECT_NEAR(shape(-0.005), 3.0 * std::sin(std::atan(0.2)), 0.02) << "a dome, 0.2 at its sides";
  EXPECT_NEAR(shape(-0.1), 1.8, 1e-9) << "no farther than 0.6 R";
  MillOptions options;
  options.overrun = Millimetres{1.9};
  EXPECT_THAT(check_mill(design, options), FailsWith(kMillOptionOutOfRange));
  // A band goes beyond its own part of the outline only.
  options.overrun = Millimetres{1.0};
  options.last_y_mm = 20.0;
  const ScratchFolder folder;
  shape(-0.005);
  ASSERT_THAT(mill(design, options, folder / "band.ngc"), Succeeds());
  const auto program = folder / "band.ngc";
  const auto v = verify(std::span(&program, 1), design);
  ASSERT_THAT(v, Succeeds());
  EXPECT_NEAR(v->certificate.travel.min.y, -1.0, 1e-3);
  EXPECT_NEAR(v->certificate.travel.max.y, 20.0, 1e-3);
}

TEST(Verify, SameBitsForAnyNumberOfThreads) {
  const ScratchFolder folder;
  const ModelField design = ground(Ground::rough, 4, 121, 0.5);
  const auto program = folder / "part.ngc";
  ASSERT_THAT(mill(design, {}, program), Succeeds());
  std::vector<Verification> results;
  for (const std::size_t threads : {1U, 3U}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    auto v = verify(std::span(&program, 1), design);
    ASSERT_THAT(v, Succeeds());
    results.push_back(*std::move(v));
  }
  EXPECT_EQ(results[0].as_milled.z_mm, results[1].as_milled.z_mm);
  EXPECT_EQ(to_json(results[0].certificate), to_json(results[1].certificate));
}

TEST(Verify, StatesWhatTheControlMayAdd) {
  const ModelField design = flat_field(21, 21, 0.5, 0.0F);
  const auto blending = [&](const std::string& before, const std::string& between) {
    const auto v = verify_text(
        {before + "G0 Z9\nG0 X2 Y5\nG1 Z2 F500\nX4\n" + between + "X6\nG64 P0.4\nG0 Z9\nM2\n"},
        design, {.stock_top = Millimetres{3.0}});
    EXPECT_THAT(v, Succeeds());
    return v->certificate.blending_mm;
  };
  EXPECT_EQ(blending("", ""), std::nullopt);
  EXPECT_EQ(blending("G61\n", ""), 0.0);
  EXPECT_EQ(blending("G64 P0.002\n", ""), 0.002);
  EXPECT_EQ(blending("G64 P0.002\n", "G64 P0.01\n"), 0.01) << "the most of all cuts";
  EXPECT_EQ(blending("G64 P0.01\n", "G61\n"), 0.01);
  EXPECT_EQ(blending("G64\n", ""), INFINITY);
}

TEST(Verify, CountsRapidCollisions) {
  const ModelField design = flat_field(41, 41, 0.5, 3.0F);
  const auto v =
      verify_text({"G0 X-9 Y10 Z20\nG0 Z3.5\nG0 X30\nG0 X-9\nG1 X30 F100\nM2\n"}, design);
  ASSERT_THAT(v, Succeeds());
  EXPECT_EQ(v->certificate.rapid_collisions, 1U);
}

// ---- errors ----------------------------------------------------------------

TEST(VerifyErrors, EveryCode) {
  const ModelField design = flat_field(21, 21, 0.5, 3.0F);
  const std::string good = "G0 X5 Y5 Z20\nG1 Z2.9 F100\nM2\n";
  ASSERT_THAT(verify_text({good}, design), Succeeds());
  const auto fails = [&](const std::string& text, ErrorCode code, const std::string& says) {
    const auto v = verify_text({good, text}, design);
    ASSERT_THAT(v, FailsWith(code));
    EXPECT_THAT(v.error().message, HasSubstr("part1.ngc:" + says));
  };
  fails("G1 ?\nM2\n", kGcodeSyntax, "1:4: ");
  fails("G21\n G81\nM2\n", kGcodeUnsupported, "2:2: ");
  fails("G0 X1 Y1 Z1\nG1 X", kGcodeTruncated, "2:5: ");
  fails("G0 X1 Y1 Z1\nF1 G2 X5 R1\nM2\n", kGcodeArc, "2:10: ");
  fails("G0 X1 Y1 Z1\nG1 X5\nM2\n", kGcodeNoFeed, "2:1: ");
  const auto v = verify_text({"G0 X500 Y5 Z20\nG1 Z2.9 F100\nM2\n"}, design);
  ASSERT_THAT(v, FailsWith(kGcodeNoCut));
  EXPECT_THAT(v.error().message, HasSubstr("500.000"));
  EXPECT_THAT(verify({}, design), FailsWith(kGcodeNoCut));
  for (const double cell : {0.0, -1.0, 1.51, static_cast<double>(NAN), 1e-6})
    EXPECT_THAT(verify_text({good}, design, {.cell = Millimetres{cell}}),
                FailsWith(kCellOutOfRange))
        << cell;
  for (const double diameter : {0.0, -6.0, static_cast<double>(INFINITY)})
    EXPECT_THAT(verify_text({good}, design, {.ball_diameter = Millimetres{diameter}}),
                FailsWith(kToolNotPositive));
  ModelField holed = design;
  holed.z_mm(3, 4) = NAN;
  EXPECT_THAT(verify_text({good}, holed), FailsWith(kHeightNotFinite));
  const std::filesystem::path none = "/nowhere/part.ngc";
  EXPECT_THAT(verify(std::span(&none, 1), design), FailsWith(kFileNotFound));
}

TEST(VerifyErrors, StopsWhenAsked) {
  const ModelField design = flat_field(21, 21, 0.5, 3.0F);
  std::stop_source source;
  source.request_stop();
  EXPECT_THAT(verify_text({"G0 X5 Y5 Z20\nG1 Z2.9 F100\nM2\n"}, design, {},
                          RunContext{.stop = source.get_token()}),
              FailsWith(kCancelled));
}

TEST(VerifyErrors, WarnsAboutWhatItCannotKnow) {
  const ModelField design = flat_field(21, 21, 0.5, 3.0F);
  std::vector<std::string> warnings;
  RunContext run;
  run.warn = [&](const std::string& text) { warnings.push_back(text); };
  const auto v =
      verify_text({"T1 M6\nG0 X5 Y5 Z20\n/G1 X6\nG1 Z2.9 F100\nT2 M6\n"}, design, {}, run);
  ASSERT_THAT(v, Succeeds());
  EXPECT_THAT(warnings, testing::UnorderedElementsAre(HasSubstr("without M2"), HasSubstr("tool 2"),
                                                      HasSubstr("1 blocks begin with '/'")));
}

}  // namespace
}  // namespace maquette::cnc

// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in cnc/side_cuts.hpp, and how it is attacked:
//
//   holds the limit ............ rough ground along both axes, one way and zig-zag: the program,
//   read
//                                back and cut in simulation, with verify's own search for what the
//                                ball reaches, at all nodes of 0.1 mm, which are among the finder's
//                                points, and of a grid that is not
//   what the ball cannot touch . the same above the closing of the design, by verify's own search
//   is needed .................. the same without it stands well above
//   still proven ............... gouge at most half the tolerance
//   a furrow at an angle ....... its floor is the circle that touches both walls: closed form
//   a furrow by hand ........... what stays without, and how many cuts it takes
//   nothing to do .............. planes and domes: no cut, not a byte changed
//   arrange .................... order; stretches that touch are one
//   same bytes ................. 1 and 3 threads
//   stated stepover ............ the scallop of passes farther apart, kept with fewer cuts
//   errors ..................... below the tolerance, rows at an angle; a stated stepover without a
//                                limit, below the stepover, above the ball

#include "cnc/side_cuts.hpp"

#include <cmath>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>

#include "cnc/mill.hpp"
#include "cnc/scallop.hpp"
#include "cnc/verify.hpp"
#include "core/files.hpp"
#include "support/matchers.hpp"
#include "support/terrain.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;
using testing_support::FailsWith;
using testing_support::flat_field;
using testing_support::Ground;
using testing_support::ground;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

struct Milled {
  MillReport report;
  std::string text;
  Certificate certificate;
};

Milled milled(const ModelField& design, const MillOptions& options, double cell_mm = 0.1) {
  const ScratchFolder folder;
  const auto report = mill(design, options, folder / "part.ngc");
  EXPECT_THAT(report, Succeeds());
  if (!report) return {};
  VerifyOptions o;
  o.stepover = stated_stepover(options);
  o.cell = Millimetres{cell_mm};
  const std::filesystem::path program = folder / "part.ngc";
  const auto v = verify(std::span(&program, 1), design, o);
  EXPECT_THAT(v, Succeeds());
  if (!v) return {};
  return {*report, *read_file(program), v->certificate};
}

class RoughGround : public testing::TestWithParam<int> {};

TEST_P(RoughGround, KeepsItsLimitWhereverTheBallReaches) {
  const int seed = GetParam();
  // Facets of half a millimetre that turn by some 20 degrees: pits and creases between all rows.
  ModelField design = ground(Ground::rough, static_cast<std::uint64_t>(seed), 61, 0.5);
  for (float& z : design.z_mm.cells()) z = 5.0F + 0.4F * (z - 5.0F);
  MillOptions o;
  o.direction = degrees(seed % 2 == 0 ? 0.0 : 90.0);
  o.zigzag = seed % 3 != 0;
  const Milled without = milled(design, o);
  o.excess_limit = Millimetres{0.010};
  const Milled with = milled(design, o);
  EXPECT_EQ(without.report.side_cuts, 0U);
  EXPECT_GT(with.report.side_cuts, 50U);
  EXPECT_GT(without.certificate.max_tight_over_scallop_mm, 0.015);
  EXPECT_LE(with.certificate.max_tight_over_scallop_mm, 0.010);
  // Points whose best place is more than a row's distance from where the ball would touch them are
  // passed over: on this ground, far rougher than terrain, up to 20 um stay (measured).
  EXPECT_LE(with.certificate.max_over_closing_mm, 0.021);
  EXPECT_LE(with.certificate.over_closing_area_mm2,
            0.1 * without.certificate.over_closing_area_mm2);
  // Between the points looked at, 0.05 mm apart, up to 0.0354 sqrt(0.02 / 3) = 0.0029 mm.
  const Milled between = milled(design, o, 0.0625);
  EXPECT_LE(between.certificate.max_tight_over_scallop_mm, 0.0129);
  EXPECT_LE(with.certificate.tight_area_mm2, 0.05 * without.certificate.tight_area_mm2);
  EXPECT_LE(with.report.certified_gouge_mm, 0.005);
  EXPECT_LE(with.certificate.max_gouge_mm + with.certificate.bound_mm, 0.005);
  EXPECT_EQ(with.certificate.rapid_collisions, 0U);
}
INSTANTIATE_TEST_SUITE_P(Seeds, RoughGround, testing::Range(1, 5));

// The ridge beside a crease is as high as the square of the passes' distance, or as that itself
// where the crease is sharp: 0.64 to 0.8 of it for 0.4 mm instead of 0.5. Few of the places that
// pass the limit by a little still do (574 cuts and 336, measured; on terrain a fifth).
TEST(SideCuts, CloserPassesNeedFewerForTheSameSurface) {
  ModelField design = ground(Ground::rough, 3, 61, 0.5);
  for (float& z : design.z_mm.cells()) z = 5.0F + 0.25F * (z - 5.0F);
  MillOptions o;
  o.excess_limit = Millimetres{0.010};
  const Milled as_far = milled(design, o);
  o.stepover = Millimetres{0.4};
  const Milled own_scallop = milled(design, o);
  o.stated_stepover = Millimetres{0.5};
  const Milled closer = milled(design, o);
  for (const Milled* m : {&as_far, &closer}) {
    EXPECT_LE(m->certificate.max_tight_over_scallop_mm, 0.010);
    EXPECT_LE(m->certificate.max_gouge_mm + m->certificate.bound_mm, 0.005);
  }
  EXPECT_LT(3 * closer.report.side_cuts, 2 * as_far.report.side_cuts);
  EXPECT_LT(closer.report.side_cuts, own_scallop.report.side_cuts);
  EXPECT_LT(closer.report.blocks, as_far.report.blocks);
}

// A furrow along x with walls of a slope of 1/4, 0.1 mm beside a row: the ball's places on the
// other wall have but the row up to 0.4 mm away, 0.41 in space. That leaves 28 um where 11.4 are
// stated, 19 too many where the ball may rise by verify's tolerance, a little less at its nodes.
TEST(SideCuts, AFurrowBesideARowIsReachedFromIt) {
  ModelField design = flat_field(81, 161, 0.1, 0.0F);
  for (std::ptrdiff_t r = 0; r < design.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < design.z_mm.cols(); ++c)
      design.z_mm(r, c) = static_cast<float>(0.25 * std::abs(design.y_mm(r) - 4.1));
  MillOptions o;
  const Milled without = milled(design, o, 0.02);
  o.excess_limit = Millimetres{0.010};
  const Milled with = milled(design, o, 0.02);
  EXPECT_GT(without.certificate.max_tight_over_scallop_mm, 0.015);
  EXPECT_LT(without.certificate.max_tight_over_scallop_mm, 0.0195);
  EXPECT_LE(with.certificate.max_tight_over_scallop_mm, 0.0136);
  // Each clears at most 0.35 mm either way; all start at the row beside the furrow.
  EXPECT_GE(with.report.side_cuts, 22U);
  EXPECT_LE(with.report.side_cuts, 160U);
}

// A furrow at 8 degrees to the rows, walls of a slope of 1/4. What no ball can take there is known
// in closed form: below the circle that touches both walls. Rows cross the furrow every 3.6 mm;
// halfway between two of them the ball stands 0.25 times 0.25 mm higher than in the furrow.
TEST(SideCuts, AFurrowAtAnAngleIsCutDownToTheBallThatRestsInIt) {
  constexpr double kSlope = 0.25, kR = 3.0;
  const double turn = degrees(8.0).value(), steep = std::sqrt(1.0 + kSlope * kSlope);
  const auto beside = [&](double x, double y) {
    return std::abs((y - 6.0) * std::cos(turn) - (x - 6.0) * std::sin(turn));
  };
  ModelField design = flat_field(121, 121, 0.1, 0.0F);
  for (std::ptrdiff_t r = 0; r < design.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < design.z_mm.cols(); ++c)
      design.z_mm(r, c) = static_cast<float>(kSlope * beside(design.x_mm(c), design.y_mm(r)));
  const double stated = stated_scallop_mm({kR}, 0.5, kSlope);
  // Highest above the best that the ball can leave and the scallop of 0.5 mm, away from the
  // outline.
  const auto highest = [&](const MillOptions& o) {
    const ScratchFolder folder;
    const std::filesystem::path program = folder / "part.ngc";
    EXPECT_THAT(mill(design, o, program), Succeeds());
    const auto v = verify(std::span(&program, 1), design);
    EXPECT_THAT(v, Succeeds());
    if (!v) return double{NAN};
    double most = -INFINITY;
    const ModelField& cut = v->as_milled;
    for (std::ptrdiff_t r = 0; r < cut.z_mm.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < cut.z_mm.cols(); ++c) {
        const double x = cut.x_mm(c), y = cut.y_mm(r), t = beside(x, y);
        if (std::min(std::min(x, 12.0 - x), std::min(y, 12.0 - y)) < kR + 0.1) continue;
        const double best =
            t < kR * kSlope / steep ? kR * steep - std::sqrt(kR * kR - t * t) : kSlope * t;
        most = std::max(most, static_cast<double>(cut.z_mm(r, c)) - best - stated);
      }
    return most;
  };
  MillOptions o;
  EXPECT_NEAR(highest(o), 0.0625, 0.0100);  // give or take the path's tolerance
  o.excess_limit = Millimetres{0.010};
  // Between the points looked at 0.0029 mm, as above.
  EXPECT_LE(highest(o), 0.0129);
  o.stepover = Millimetres{0.4};
  o.stated_stepover = Millimetres{0.5};
  EXPECT_LE(highest(o), 0.0129);
}

TEST(SideCuts, PlanesAndDomesNeedNone) {
  for (const bool dome : {false, true}) {
    ModelField design = flat_field(33, 33, 0.5, 0.0F);
    for (std::ptrdiff_t r = 0; r < 33; ++r)
      for (std::ptrdiff_t c = 0; c < 33; ++c) {
        const double x = design.x_mm(c) - 8.0, y = design.y_mm(r) - 8.0;
        design.z_mm(r, c) =
            static_cast<float>(dome ? std::sqrt(900.0 - x * x - y * y) : 0.3 * x + 0.6 * y);
      }
    MillOptions o;
    const Milled without = milled(design, o);
    o.excess_limit = Millimetres{0.012};
    const Milled with = milled(design, o);
    EXPECT_EQ(with.report.side_cuts, 0U) << dome;
    EXPECT_TRUE(with.text == without.text) << dome;
  }
}

TEST(SideCuts, AreArranged) {
  RowCare care{{{7, 3}, {2, 9}, {7, 1}}, {{50, 60}, {10, 20}, {15, 30}, {30, 31}, {40, 45}}};
  arrange(care);
  ASSERT_EQ(care.cuts.size(), 3U);
  EXPECT_EQ(care.cuts[0].place, 2);
  EXPECT_EQ(care.cuts[1].across, 1);
  EXPECT_EQ(care.cuts[2].across, 3);
  ASSERT_EQ(care.closer.size(), 3U);
  EXPECT_EQ(care.closer[0].from, 10);
  EXPECT_EQ(care.closer[0].to, 31);
  EXPECT_EQ(care.closer[1].from, 40);
  EXPECT_EQ(care.closer[2].to, 60);
}

TEST(SideCuts, AreTheSameForAnyNumberOfThreads) {
  const ModelField design = ground(Ground::rough, 9, 161, 0.25);
  std::vector<std::string> texts;
  for (const std::size_t threads : {std::size_t{1}, std::size_t{3}}) {
    const oneapi::tbb::global_control limit(oneapi::tbb::global_control::max_allowed_parallelism,
                                            threads);
    const ScratchFolder folder;
    MillOptions o;
    o.excess_limit = Millimetres{0.015};
    ASSERT_THAT(mill(design, o, folder / "part.ngc"), Succeeds());
    texts.push_back(*read_file(folder / "part.ngc"));
  }
  EXPECT_TRUE(texts[0] == texts[1]);
}

TEST(SideCuts, NeedALimitAboveTheToleranceAndRowsAlongAnAxis) {
  const ModelField design = flat_field(5, 5, 0.5, 0.0F);
  const auto sink = [](const Toolpath&) { return Result<void>{}; };
  MillOptions o;
  o.excess_limit = Millimetres{0.0099};
  EXPECT_THAT(mill_passes(design, o, sink), FailsWith(kMillOptionOutOfRange));
  o.excess_limit = Millimetres{0.010};
  EXPECT_THAT(mill_passes(design, o, sink), Succeeds());
  o.direction = degrees(45.0);
  EXPECT_THAT(mill_passes(design, o, sink), FailsWith(kMillOptionOutOfRange));
}

TEST(SideCuts, AStatedStepoverIsOfALimitAndNotBelowTheStepover) {
  const ModelField design = flat_field(5, 5, 0.5, 0.0F);
  const auto sink = [](const Toolpath&) { return Result<void>{}; };
  MillOptions o;
  o.stated_stepover = Millimetres{0.5};
  EXPECT_THAT(mill_passes(design, o, sink), FailsWith(kMillOptionOutOfRange));
  o.excess_limit = Millimetres{0.010};
  EXPECT_THAT(mill_passes(design, o, sink), Succeeds());
  for (const double stated : {0.499, 6.001}) {
    o.stated_stepover = Millimetres{stated};
    EXPECT_THAT(mill_passes(design, o, sink), FailsWith(kMillOptionOutOfRange)) << stated;
  }
}

}  // namespace
}  // namespace maquette::cnc

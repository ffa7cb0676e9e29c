// SPDX-License-Identifier: GPL-3.0-or-later

// What path_certificate.hpp and path_pieces.hpp claim, and how each claim is attacked:
//
//   pieces stay on the motion ................ random arcs in all planes, radii that differ at the
//                                              ends, helices: places of the motion against pieces
//   closed forms ............................. flat ground, a ramp, a lone needle under lines,
//   under
//                                              arcs that roll over it, plunges, beyond the outline
//   proven >= truth >= found ................. random motions over kind and harsh ground, against
//   the
//                                              exact cutter location at dense places of the path
//   a milled program passes, moved it fails .. certified gouge of mill; 30 um down, sideways in x,
//   y gouges of 5 um, all found, with places ... 100 plunges and 100 short cuts same result however
//   it is portioned ...... 1 against 3 threads, motion by motion

#include "cnc/path_certificate.hpp"

#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include "cnc/cutter_location.hpp"
#include "cnc/mill.hpp"
#include "cnc/path_pieces.hpp"
#include "support/matchers.hpp"
#include "support/motions.hpp"
#include "support/terrain.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;
using testing_support::Draws;
using testing_support::flat_field;
using testing_support::Ground;
using testing_support::ground;
using testing_support::motions_of;
using testing_support::motions_of_file;
using testing_support::place_at;
using testing_support::random_arc;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

constexpr BallNose kBall{3.0};
constexpr double kExact_mm = 2e-9;

PathCertificate prove(const ModelField& surface, const std::vector<Motion>& motions,
                      PathProofOptions options = {}, BallNose tool = kBall) {
  PathProof proof(surface, tool, options);
  proof.add(motions);
  return proof.finish();
}

PathCertificate prove(const ModelField& surface, const std::string& text,
                      PathProofOptions options = {}) {
  return prove(surface, motions_of("G0 X0 Y0 Z90\n" + text + "\nM2\n"), options);
}

// ---- pieces ----------------------------------------------------------------

double distance_to(const PathPiece& piece, Vec3 p) {
  const double to_ends = std::fmin(norm(p - piece.from_mm), norm(p - piece.to_mm));
  if (piece.kind == PathPiece::Kind::line) {
    const Vec3 d = piece.to_mm - piece.from_mm;
    const double t = dot(p - piece.from_mm, d) / dot(d, d);
    return t > 0.0 && t < 1.0 ? norm(piece.from_mm + t * d - p) : to_ends;
  }
  const Vec3 out = p - piece.centre_mm, middle = middle_of(piece) - piece.centre_mm;
  const double beside = dot(piece.from_mm - piece.centre_mm, middle) / piece.radius_mm;
  return dot(out, middle) / norm(out) >= beside ? std::abs(norm(out) - piece.radius_mm) : to_ends;
}

TEST(PathPieces, StayOnTheMotion) {
  Draws draw(11);
  int chords = 0;
  for (int i = 0; i < 600; ++i) {
    const double radius = std::pow(10.0, draw(-1.0, 2.0));
    const double error = i % 3 == 0 ? 0.0 : std::pow(10.0, draw(-6.0, -1.5));
    const Motion m = random_arc(draw, {draw(-9, 9), draw(-9, 9), draw(-9, 9)}, radius,
                                std::fmin(error, 0.3 * radius), i % 5 == 0 ? draw(-1, 1) : 0.0);
    std::vector<PathPiece> pieces;
    for_each_piece(m, [&](const PathPiece& p) { pieces.push_back(p); });
    ASSERT_FALSE(pieces.empty());
    EXPECT_EQ(pieces.front().from_mm, m.from_mm);
    EXPECT_EQ(pieces.back().to_mm, m.to_mm);
    for (std::size_t k = 1; k < pieces.size(); ++k)
      ASSERT_EQ(pieces[k].from_mm, pieces[k - 1].to_mm);
    const bool is_chords = pieces[0].kind == PathPiece::Kind::line;
    chords += is_chords;
    if (is_chords) continue;  // checked where the reader is
    for (const PathPiece& p : pieces) EXPECT_LE(p.deviation_mm, kPieceDeviation_mm);
    for (int s = 0; s <= 40; ++s) {
      double nearest = INFINITY, allowed = 0.0;
      for (const PathPiece& p : pieces) {
        const double d = distance_to(p, place_at(m, s / 40.0));
        if (d < nearest) nearest = d, allowed = p.deviation_mm;
      }
      // Rounding of places; some metres from the origin at most.
      ASSERT_LE(nearest, allowed + 1e-11) << "arc " << i << " share " << s;
    }
  }
  EXPECT_LT(chords, 300);
  EXPECT_GT(chords, 120) << "the helices at least";
}

TEST(PathPieces, EndAtQuadrants) {
  const auto pieces_of = [](const std::string& text) {
    std::vector<PathPiece> pieces;
    for (const Motion& m : motions_of("G0 X10 Y0 Z0\nF1 " + text + "\nM2\n"))
      for_each_piece(m, [&](const PathPiece& p) { pieces.push_back(p); });
    return pieces;
  };
  EXPECT_EQ(pieces_of("G3 I-10").size(), 4U);
  EXPECT_EQ(pieces_of("G2 I-10").size(), 4U);
  EXPECT_EQ(pieces_of("G18 G2 X-10 I-10").size(), 2U) << "half a turn";
  EXPECT_TRUE(pieces_of("G18 G2 X-10 I-10")[0].upper != pieces_of("G18 G3 X-10 I-10")[0].upper);
  EXPECT_EQ(pieces_of("G3 X0 Y10 I-10").size(), 1U);
  EXPECT_EQ(pieces_of("G3 X0 Y10 I-10")[0].kind, PathPiece::Kind::level_arc);
  EXPECT_EQ(pieces_of("G3 X0 Y10 I-10 Z1")[0].kind, PathPiece::Kind::line) << "a helix";
}

// ---- closed forms ----------------------------------------------------------

TEST(PathCertificate, FlatGround) {
  const ModelField flat = flat_field(81, 81, 0.5, 5.0F);
  for (const double depth : {-0.5, 0.0, 0.004, 0.006, 1.5}) {
    const PathCertificate c = prove(
        flat, fmt::format("G0 X5 Y7\nG1 Z{0} F100\nX30\nY33.3 X21\nG3 I3 J2\nG0 Z90", 5.0 - depth));
    EXPECT_NEAR(c.max_gouge_mm, std::fmax(0.0, depth), kExact_mm) << depth;
    EXPECT_LE(c.max_gouge_mm, c.proven_mm);
    // Below the limit it is enough to show that; above, the resolution.
    EXPECT_LE(c.proven_mm, std::fmax(0.005, depth + 0.0002) + kExact_mm) << depth;
    EXPECT_EQ(c.undecided, 0U);
    EXPECT_EQ(c.gouging_motions, depth > 0.005 ? 5U : 0U) << "plunge, three cuts and the retreat";
    EXPECT_EQ(c.places.empty(), depth <= 0.005);
  }
}

// Where a bound happens to meet the limit, the proof's own exactness must not lift it above.
TEST(PathCertificate, WhatIsWithinTheLimitIsProvenToBe) {
  const ModelField field = ground(Ground::rolling, 11, 41, 0.5);
  const auto lowest = static_cast<double>(heightmap::height_range(field.z_mm).min);
  const auto cut = fmt::format("G0 X{} Y{}\nG1 Z{:.9f} F100\nG91 X10\nG90 G0 Z90",
                               field.x0.value() + 4.0, field.y0.value() + 9.0, lowest);
  const PathCertificate loose = prove(field, cut, {.limit_mm = 100.0});
  ASSERT_LT(loose.max_gouge_mm, loose.proven_mm - 1e-6) << "a bound, not a value that is reached";
  for (const double below : {0.0, 2.5e-10, 5e-10, 1e-9, 2e-9}) {
    const double limit = loose.proven_mm - below;
    const PathCertificate c = prove(field, cut, {.limit_mm = limit});
    EXPECT_LE(c.proven_mm, limit) << below;
    EXPECT_EQ(c.undecided, 0U);
  }
}

// The ball rolls over a needle on an arc of its own radius: as an arc it is exact, as a chord
// of length h it is h^2 / 8R below.
TEST(PathCertificate, ALoneNeedle) {
  ModelField field = flat_field(121, 121, 0.25, 0.0F);
  field.z_mm(60, 60) = 8.0F;  // at (15, 15); its flanks are steeper than the ball touches
  const double from = 13.5, to = 16.5, low = 5.0 + std::sqrt(9.0 - 2.25);
  const std::string begin = fmt::format("G0 X{} Y15\nG1 Z{:.9f} F100\n", from, low);
  const PathProofOptions fine{.limit_mm = 1e-5, .resolution_mm = 1e-6};
  const PathCertificate arc =
      prove(field, begin + fmt::format("G18 G3 X{} I1.5 K{:.9f}\nG0 Z90", to, 5.0 - low), fine);
  EXPECT_LE(arc.proven_mm, 1e-5);
  const PathCertificate chord = prove(field, begin + fmt::format("G1 X{}\nG0 Z90", to), fine);
  EXPECT_NEAR(chord.max_gouge_mm, 8.0 - low, 1e-6);
  EXPECT_LE(chord.proven_mm, chord.max_gouge_mm + 1e-6 + kExact_mm);
  ASSERT_EQ(chord.places.size(), 1U);
  EXPECT_NEAR(chord.places[0].x_mm, 15.0, 1e-9);
  EXPECT_NEAR(chord.places[0].y_mm, 15.0, 1e-9);
  EXPECT_EQ(chord.places[0].line, 4U);
}

TEST(PathCertificate, BeyondTheOutlineTheBallHangsOverTheEdge) {
  const ModelField flat = flat_field(41, 41, 0.5, 5.0F);  // 20 x 20 mm
  for (const double away : {0.0, 1.0, 2.5, 2.9, 3.001, 40.0}) {
    const double touch = away < 3.0 ? 5.0 - 3.0 + std::sqrt(9.0 - away * away) : -INFINITY;
    const double tip = std::fmax(touch - 0.02, -20.0);
    const PathCertificate c =
        prove(flat, fmt::format("G0 X{0} Y-10\nG1 Z{1:.9f} F100\nY30\nG0 Z90", 20.0 + away, tip));
    EXPECT_NEAR(c.max_gouge_mm, away < 3.0 ? 0.02 : 0.0, 1e-8) << away;
    EXPECT_LE(c.proven_mm, away < 3.0 ? 0.0202 + 1e-8 : 0.005) << away;
    EXPECT_EQ(c.undecided, 0U) << away;
  }
}

// ---- against dense places --------------------------------------------------

class PathCertificateRandom : public testing::TestWithParam<Ground> {};

// Past the distance of a radius from the outline's corner the cutter location ends upright; a wall
// farther in, which the ball does not reach, must not keep that open.
TEST(PathCertificate, BesideTheOutlineAWallFartherInDoesNotCount) {
  ModelField field = flat_field(21, 21, 0.5, 12.0F);
  for (std::ptrdiff_t r = 0; r < 2; ++r)
    for (std::ptrdiff_t c = 0; c < 2; ++c) field.z_mm(r, c) = 2.0F;
  const double on_corner = 2.0 - 3.0 + std::sqrt(9.0 - 1.9 * 1.9 - 2.0 * 2.0);
  for (const double above : {0.0, 0.05, 1.0}) {
    const PathCertificate c =
        prove(field, motions_of(fmt::format("G0 X-1.9 Y-2 Z{0:.6f}\nG1 X-3.2 F600\nX-1.9\nM2\n",
                                            on_corner + above)));
    EXPECT_EQ(c.undecided, 0U) << above;
    EXPECT_LE(c.proven_mm, 0.005 + kExact_mm) << above;
  }
  const PathCertificate low =
      prove(field,
            motions_of(fmt::format("G0 X-1.9 Y-2 Z{:.6f}\nG1 X-3.2 F600\nM2\n", on_corner - 0.02)));
  EXPECT_NEAR(low.max_gouge_mm, 0.02, 1e-5) << "a gouge of the corner still counts";
}

TEST_P(PathCertificateRandom, NothingIsDeeperThanProven) {
  for (std::uint64_t seed = 1; seed <= 4; ++seed) {
    const ModelField field = ground(GetParam(), seed, 41, 0.5);
    DropCutter cutter(field, kBall);
    Draws draw(100 * seed);
    std::size_t deep = 0, given_up = 0;
    for (int i = 0; i < 60; ++i) {
      const Vec3 a{draw(-8.0, 22.0), draw(-4.0, 26.0), draw(2.0, 9.0)};
      Motion m;
      if (i % 2 == 0) {
        m.from_mm = a;
        m.to_mm = a + Vec3{draw(-4, 4), i % 4 == 0 ? 0.0 : draw(-4, 4), draw(-2, 2)};
      } else {
        m = random_arc(draw, a, draw(0.5, 6.0), i % 3 == 0 ? 1e-4 : 0.0,
                       i % 7 == 0 ? draw(-1, 1) : 0.0);
      }
      m.line = 7;
      const PathCertificate c = prove(field, {m});
      double truth = 0.0;
      for (int s = 0; s <= 400; ++s) {
        const Vec3 p = place_at(m, s / 400.0);
        truth = std::fmax(truth, cutter.drop(p.x, p.y).tip_mm - p.z);
      }
      ASSERT_GE(c.proven_mm, truth - kExact_mm) << "seed " << seed << " motion " << i;
      ASSERT_LE(c.max_gouge_mm, c.proven_mm);
      EXPECT_EQ(c.motions, 1U);
      given_up += c.undecided > 0;
      if (c.undecided == 0) {
        // Arcs are pieces within 0.1 um, which at slope L counts (1 + L) times; L below 1000.
        EXPECT_LE(c.proven_mm, std::fmax(0.005, c.max_gouge_mm + 2e-4 + (i % 2 == 0 ? 1e-8 : 0.1)));
        EXPECT_GE(c.max_gouge_mm,
                  std::fmin(truth, truth > 0.005 ? truth - 2e-4 - 0.1 * (i % 2) : 0.0));
      }
      deep += truth > 0.005;
    }
    EXPECT_GT(deep, 10U);
    EXPECT_LT(given_up, 30U) << "seed " << seed;
  }
}
INSTANTIATE_TEST_SUITE_P(Ground, PathCertificateRandom,
                         testing::ValuesIn(testing_support::kGrounds),
                         [](const auto& p) { return testing_support::name(p.param); });

// ---- whole programs --------------------------------------------------------

struct Milled {
  ModelField design;
  std::vector<Motion> motions;
  double certified_mm = 0.0;
};

Milled milled(std::uint64_t seed, double tolerance) {
  const ScratchFolder folder;
  Milled m{ground(Ground::rolling, seed, 81, 0.5), {}, 0.0};
  MillOptions options;
  options.tolerance = Millimetres{tolerance};
  const auto report = mill(m.design, options, folder / "part.ngc");
  EXPECT_THAT(report, Succeeds());
  m.certified_mm = report->certified_gouge_mm;
  m.motions = motions_of_file(folder / "part.ngc");
  return m;
}

TEST(PathCertificate, AMilledProgramPasses) {
  for (const std::uint64_t seed : {1U, 2U, 3U}) {
    const Milled m = milled(seed, 0.004);
    ASSERT_LE(m.certified_mm, 0.005);
    const PathCertificate c = prove(m.design, m.motions);
    EXPECT_LE(c.proven_mm, 0.005);
    EXPECT_LE(c.max_gouge_mm, m.certified_mm) << "mill's own bound is one";
    EXPECT_GT(c.max_gouge_mm, 0.001) << "and the tolerance is used";
    EXPECT_TRUE(c.places.empty());
    EXPECT_EQ(c.undecided, 0U);
  }
}

TEST(PathCertificate, APathMovedBy30MicrometresIsFound) {
  const Milled m = milled(4, 0.004);
  for (const Vec3 by : {Vec3{0, 0, -0.03}, Vec3{0.03, 0, 0}, Vec3{-0.03, 0, 0}, Vec3{0, 0.03, 0},
                        Vec3{0, -0.03, 0}}) {
    std::vector<Motion> moved = m.motions;
    for (Motion& motion : moved) {
      motion.from_mm += by;
      motion.to_mm += by;
    }
    const PathCertificate c = prove(m.design, moved);
    EXPECT_GT(c.max_gouge_mm, 0.005) << by.x << " " << by.y << " " << by.z;
    EXPECT_FALSE(c.places.empty());
    if (by.z < 0.0) {
      EXPECT_GT(c.max_gouge_mm, 0.03);
      EXPECT_LT(c.proven_mm, 0.035 + 0.0002);
    }
  }
}

TEST(PathCertificate, HundredGougesAreAllFoundWithTheirPlaces) {
  Milled m = milled(5, 0.001);
  DropCutter cutter(m.design, kBall);
  const PathProofOptions options{.limit_mm = 0.004};
  ASSERT_TRUE(prove(m.design, m.motions, options).places.empty());
  Draws draw(3);
  std::vector<Vec3> planted;
  for (int i = 0; i < 10; ++i)
    for (int j = 0; j < 10; ++j) {
      // 3.7 mm apart, jittered by less than 0.3; half of them short cuts at any angle.
      const double x = m.design.x0.value() + 3.0 + 3.7 * i + draw(-0.25, 0.25);
      const double y = m.design.y0.value() + 3.0 + 3.7 * j + draw(-0.25, 0.25);
      const double angle = draw(0.0, 6.28), length = (i + j) % 2 == 0 ? 0.05 : 0.0;
      Vec3 from{x - length * std::cos(angle), y - length * std::sin(angle), 0.0};
      Vec3 to{x + length * std::cos(angle), y + length * std::sin(angle), 0.0};
      // The middle is cut 5 um too deep, the ends as deep as the line needs.
      from.z = to.z = cutter.drop(x, y).tip_mm - 0.005;
      Motion motion;
      motion.from_mm = from;
      motion.to_mm = to;
      motion.line = 1000000 + planted.size();
      m.motions.insert(m.motions.begin() + 37 * (static_cast<std::ptrdiff_t>(planted.size()) + 1),
                       motion);
      const CutterContact contact = cutter.drop(x, y);
      planted.push_back({x + contact.dx_mm, y + contact.dy_mm, 0.0});
    }
  const PathCertificate c = prove(m.design, m.motions, options);
  EXPECT_GE(c.max_gouge_mm, 0.005 - kExact_mm);
  EXPECT_GE(c.gouging_motions, 100U);
  for (std::size_t i = 0; i < planted.size(); ++i) {
    double nearest = INFINITY;
    for (const PathGouge& g : c.places)
      nearest = std::fmin(nearest, std::hypot(g.x_mm - planted[i].x, g.y_mm - planted[i].y));
    // A neighbour's contact may be the deeper one, and then stands for both.
    EXPECT_LT(nearest, 3.0) << i;
  }
  EXPECT_GE(c.places.size(), 60U);
  EXPECT_LE(c.places.size(), 100U);
}

TEST(PathCertificate, TheSameHoweverItIsPortioned) {
  const Milled m = milled(6, 0.01);
  const PathProofOptions options{.limit_mm = 0.002};
  const auto in_portions = [&](std::size_t size) {
    PathProof proof(m.design, kBall, options);
    for (std::size_t i = 0; i < m.motions.size(); i += size)
      proof.add(std::span(m.motions).subspan(i, std::min(size, m.motions.size() - i)));
    return proof.finish();
  };
  const auto same = [](const PathCertificate& a, const PathCertificate& b) {
    EXPECT_EQ(a.max_gouge_mm, b.max_gouge_mm);
    EXPECT_EQ(a.proven_mm, b.proven_mm);
    EXPECT_EQ(a.drops, b.drops);
    EXPECT_EQ(a.gouging_motions, b.gouging_motions);
    ASSERT_EQ(a.places.size(), b.places.size());
    for (std::size_t i = 0; i < a.places.size(); ++i) EXPECT_EQ(a.places[i].line, b.places[i].line);
  };
  const PathCertificate whole = in_portions(m.motions.size());
  EXPECT_GT(whole.places.size(), 3U);
  same(in_portions(1), whole);
  same(in_portions(777), whole);
  for (const std::size_t threads : {1U, 3U}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    same(in_portions(100000), whole);
  }
}

}  // namespace
}  // namespace maquette::cnc

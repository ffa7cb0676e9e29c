// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in cnc/geodesic_passes.hpp, level_curves.hpp, cover_gaps.hpp and
// surface_path.hpp, and how each claim is attacked:
//
//   level curves .............. circles and lines in closed form; every crossing used once;
//                               orientation; chords within their tolerance
//   spirals ................... rings become one way, its turns a stepover apart; islands do not
//   aimed lines ............... random targets: within 8 um beside, steps exact and fine
//   stepover in space ......... turns of the path on a steep plane
//   certified gouge ........... every move at fine steps against the exact cutter location
//   ridges .................... brute-force envelope of the swept ball at random places against
//                               the ball at all cutter locations; not above what is predicted,
//                               and with a limit not above that
//   nothing left out .......... the same: kinks, corners, the middle, fronts that meet
//   unbroken, safe ............ pieces join, rapids stay clear of the surface
//   same for any threads, errors, cancel

#include "cnc/geodesic_passes.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>

#include "cnc/cover_gaps.hpp"
#include "cnc/cutter_location.hpp"
#include "cnc/level_curves.hpp"
#include "cnc/linking.hpp"
#include "cnc/surface_path.hpp"
#include "core/random.hpp"
#include "core/vec.hpp"
#include "support/matchers.hpp"
#include "support/terrain.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;
using testing_support::FailsWith;
using testing_support::flat_field;
using testing_support::Ground;

template <class F>
ModelField field_of(std::ptrdiff_t n, double spacing, F&& height) {
  ModelField f = flat_field(n, n, spacing, 0.0F);
  f.x0 = Millimetres{-2.0};
  f.y0 = Millimetres{3.0};
  for (std::ptrdiff_t r = 0; r < n; ++r)
    for (std::ptrdiff_t c = 0; c < n; ++c)
      f.z_mm(r, c) = static_cast<float>(height(f.x_mm(c), f.y_mm(r)));
  return f;
}

// ---- level curves -------------------------------------------------------------------------

double length_mm(const std::vector<PlanPlace>& places, bool closed) {
  double length = 0.0;
  for (std::size_t i = 1; i < places.size() + (closed ? 1 : 0); ++i) {
    const PlanPlace a = places[i - 1], b = places[i % places.size()];
    length += 1e-3 * std::hypot(b.x - a.x, b.y - a.y);
  }
  return length;
}

TEST(LevelCurves, OfAConeAreCircles) {
  const double cx = 3.07, cy = 7.9;
  const ModelField cone =
      field_of(201, 0.05, [&](double x, double y) { return 10.0 - std::hypot(x - cx, y - cy); });
  const auto curves = level_curves(cone, 6.5, 0.5, 0.001, 0.1);
  ASSERT_EQ(curves.size(), 7U);
  for (std::size_t k = 0; k < curves.size(); ++k) {
    EXPECT_EQ(curves[k].level, k);
    EXPECT_TRUE(curves[k].closed);
    const double radius = 3.5 - 0.5 * static_cast<double>(k);
    // On triangles 0.05 wide a circle lies inside by up to 0.05^2 / 4 / radius.
    EXPECT_NEAR(length_mm(curves[k].places, true), 2.0 * std::numbers::pi * radius,
                0.01 + 0.02 / radius);
    double area = 0.0;
    for (std::size_t i = 0; i < curves[k].places.size(); ++i) {
      const PlanPlace a = curves[k].places[i],
                      b = curves[k].places[(i + 1) % curves[k].places.size()];
      EXPECT_NEAR(std::hypot(1e-3 * a.x - cx, 1e-3 * a.y - cy), radius, 0.004 + 0.003 / radius);
      area += 0.5e-6 * (static_cast<double>(a.x) * b.y - static_cast<double>(b.x) * a.y);
    }
    EXPECT_GT(area, 0.0);  // the summit lies to the left
  }
}

TEST(LevelCurves, OpenOnesRunFromRimToRimWithTheHigherSideLeft) {
  const ModelField plane =
      field_of(31, 0.5, [](double x, double y) { return 0.6 * x - 0.8 * y + 20.0; });
  const auto curves = level_curves(plane, 6.0, 1.5, 0.001, 0.1);
  ASSERT_GT(curves.size(), 8U);
  for (const LevelCurve& c : curves) {
    EXPECT_FALSE(c.closed);
    ASSERT_EQ(c.places.size(), 2U);  // straight
    const PlanPlace a = c.places[0], b = c.places[1];
    EXPECT_GT((b.x - a.x) * -0.8 - (b.y - a.y) * 0.6, 0.0);
    for (const PlanPlace p : c.places) {
      const double x = 1e-3 * p.x, y = 1e-3 * p.y;
      EXPECT_NEAR(0.6 * x - 0.8 * y + 20.0, 6.0 + 1.5 * c.level, 0.0011);
      const bool on_rim = std::min({std::abs(x + 2.0), std::abs(x - 13.0), std::abs(y - 3.0),
                                    std::abs(y - 18.0)}) < 0.0006;
      EXPECT_TRUE(on_rim) << x << ", " << y;
    }
  }
}

TEST(LevelCurves, EveryTriangleOnALevelIsCrossedOnce) {
  // With the tolerance at 0, curves keep a place on every edge: count them.
  const ModelField f = testing_support::ground(Ground::rough, 11, 40, 0.5);
  const double first = 4.83, step = 0.071;
  const auto curves = level_curves(f, first, step, 0.0, 0.0);
  double length = 0.0, expected = 0.0;
  for (const LevelCurve& c : curves) length += length_mm(c.places, c.closed);
  for (std::ptrdiff_t r = 0; r < 39; ++r)
    for (std::ptrdiff_t c = 0; c < 39; ++c)
      for (const bool upper : {false, true}) {
        const auto corner = [&](std::ptrdiff_t i, std::ptrdiff_t j) {
          return Vec3{0.5 * static_cast<double>(c + j), 0.5 * static_cast<double>(r + i),
                      static_cast<double>(f.z_mm(r + i, c + j))};
        };
        const bool falls =
            f.z_mm(r, c + 1) + f.z_mm(r + 1, c) > f.z_mm(r, c) + f.z_mm(r + 1, c + 1);
        const std::array<Vec3, 3> t =
            falls ? std::array<Vec3, 3>{corner(0, 1), corner(1, 0),
                                        upper ? corner(1, 1) : corner(0, 0)}
                  : std::array<Vec3, 3>{corner(0, 0), corner(1, 1),
                                        upper ? corner(1, 0) : corner(0, 1)};
        for (int k = 0; k < 20; ++k) {
          const double level = first + step * k;
          std::vector<Vec3> cut;
          for (std::size_t i = 0; i < 3; ++i) {
            const Vec3 a = t[i], b = t[(i + 1) % 3];
            if ((a.z <= level) != (b.z <= level))
              cut.push_back(a + ((level - a.z) / (b.z - a.z)) * (b - a));
          }
          if (cut.size() == 2) expected += std::hypot(cut[0].x - cut[1].x, cut[0].y - cut[1].y);
        }
      }
  // Each place is rounded by up to 0.7 um.
  EXPECT_NEAR(length, expected, 1e-4 * expected);
}

TEST(LevelCurves, ChordsKeepTheirTolerance) {
  std::vector<PlanPlace> line;
  for (int i = 0; i <= 4000; ++i)
    line.push_back({10 * i, static_cast<std::int32_t>(std::lround(
                                3000.0 * std::sin(0.002 * i) +
                                20.0 * random_uniform(7, static_cast<std::uint64_t>(i))))});
  std::vector<PlanPlace> reduced = line;
  reduce_to_chords(reduced, 0.03);
  EXPECT_LT(reduced.size(), 80U);
  EXPECT_EQ(reduced.front(), line.front());
  EXPECT_EQ(reduced.back(), line.back());
  std::size_t k = 0;
  for (const PlanPlace& p : line) {
    while (reduced[k + 1].x < p.x) ++k;
    const PlanPlace a = reduced[k], b = reduced[k + 1];
    const double off = std::abs(static_cast<double>(b.x - a.x) * (p.y - a.y) -
                                static_cast<double>(b.y - a.y) * (p.x - a.x)) /
                       std::hypot(b.x - a.x, b.y - a.y);
    EXPECT_LE(off, 30.0 + 1e-9);
  }
}

TEST(Spirals, RingsBecomeOneWay) {
  const double cx = 3.07, cy = 7.9;
  const ModelField cone =
      field_of(201, 0.05, [&](double x, double y) { return 10.0 - std::hypot(x - cx, y - cy); });
  const auto curves = level_curves(cone, 6.5, 0.5, 0.001, 0.1);
  const auto ways = link_spirals(curves, 1.0, 0.001);
  ASSERT_EQ(ways.size(), 1U);
  EXPECT_EQ(ways[0].turns, 7U);
  // The radius only falls, a stepover a turn, between a full outer and a full inner circle.
  double turned = 0.0, before = 0.0;
  for (std::size_t i = 0; i < ways[0].places.size(); ++i) {
    const double x = 1e-3 * ways[0].places[i].x - cx, y = 1e-3 * ways[0].places[i].y - cy;
    const double angle = std::atan2(y, x);
    if (i > 0) turned += std::remainder(angle - before, 2.0 * std::numbers::pi);
    before = angle;
    const double turns = turned / (2.0 * std::numbers::pi);
    const double expected = 3.5 - 0.5 * std::clamp(turns - 1.0, 0.0, 6.0);
    EXPECT_NEAR(std::hypot(x, y), expected, 0.02) << "after " << turns << " turns";
  }
  EXPECT_NEAR(turned / (2.0 * std::numbers::pi), 8.0, 0.01);
}

TEST(Spirals, TwoSummitsAreTwoWays) {
  const ModelField hills = field_of(201, 0.05, [&](double x, double y) {
    return 10.0 - std::min(std::hypot(x - 1.0, y - 8.0), std::hypot(x - 5.0, y - 8.0));
  });
  const auto curves = level_curves(hills, 7.2, 0.4, 0.001, 0.1);
  const auto ways = link_spirals(curves, 0.8, 0.001);
  // Rings around both, then around each.
  EXPECT_EQ(ways.size(), 3U);
}

TEST(AimedLines, StayBesideTheirAimOnFineSteps) {
  double gone = 0.0;
  for (std::uint64_t k = 0; k < 20000; ++k) {
    const double reach = std::pow(10.0, 0.3 + 4.0 * random_uniform(3, 4 * k));
    const double angle = 2.0 * std::numbers::pi * random_uniform(3, 4 * k + 1);
    const PlanPlace from{static_cast<std::int32_t>(random_bits(3, 4 * k + 2) % 2000000), 77};
    const PlanPlace to{from.x + static_cast<std::int32_t>(std::lround(reach * std::cos(angle))),
                       from.y + static_cast<std::int32_t>(std::lround(reach * std::sin(angle)))};
    if (from == to) continue;
    const AimedLine aimed = aim(from, to);
    ASSERT_GE(aimed.steps, 1);
    EXPECT_EQ(aimed.line.x, from.x * kResolution);
    EXPECT_EQ(aimed.line.dx % kResolution, 0);
    EXPECT_EQ(aimed.line.dy % kResolution, 0);
    const double x = static_cast<double>(aimed.steps * aimed.line.dx) / kResolution;
    const double y = static_cast<double>(aimed.steps * aimed.line.dy) / kResolution;
    const double length = std::hypot(to.x - from.x, to.y - from.y);
    const double ux = (to.x - from.x) / length, uy = (to.y - from.y) / length;
    EXPECT_LE(std::abs(ux * y - uy * x), length < 3.0 ? 1.5 : 14.0 + 1e-9);
    EXPECT_GE(length - (ux * x + uy * y), -1e-6);
    const std::int64_t coarse =
        std::max(std::abs(aimed.line.dx), std::abs(aimed.line.dy)) / kResolution;
    EXPECT_LE(coarse, 32);
    // Dirichlet: some q <= 32 has an angle below 1 / (32 q), and its step is at least q.
    EXPECT_GE(std::hypot(x, y) + 46.0, std::min(length, 32.0 * 14.0));
    gone += std::min(1.0, (std::hypot(x, y) + 46.0) / std::min(length, 3000.0)) / 20000.0;
  }
  EXPECT_GE(gone, 0.8);
}

TEST(AimedLines, AWritableWayStaysNearAndIsMadeOfThem) {
  for (std::uint64_t seed = 1; seed <= 50; ++seed) {
    PlanCurve way;
    PlanPlace at{100000, 100000};
    for (std::uint64_t k = 0; k < 60; ++k) {
      const double reach = std::pow(10.0, 0.3 + 3.5 * random_uniform(seed, 2 * k));
      const double angle = 2.0 * std::numbers::pi * random_uniform(seed, 2 * k + 1);
      way.places.push_back(at);
      at = {at.x + static_cast<std::int32_t>(std::lround(reach * std::cos(angle))),
            at.y + static_cast<std::int32_t>(std::lround(reach * std::sin(angle)))};
    }
    const PlanCurve written = writable(way);
    EXPECT_EQ(written.places.front(), way.places.front());
    const auto distance = [](PlanPlace p, PlanPlace a, PlanPlace b) {
      const double ux = b.x - a.x, uy = b.y - a.y, vx = p.x - a.x, vy = p.y - a.y;
      const double l2 = ux * ux + uy * uy;
      const double t = l2 > 0.0 ? std::clamp((ux * vx + uy * vy) / l2, 0.0, 1.0) : 0.0;
      return std::hypot(vx - t * ux, vy - t * uy);
    };
    for (const PlanPlace p : written.places) {
      double nearest = INFINITY;
      for (std::size_t i = 1; i < way.places.size(); ++i)
        nearest = std::min(nearest, distance(p, way.places[i - 1], way.places[i]));
      EXPECT_LE(nearest, 1e3 * kBesideWay_mm) << seed;
    }
    for (std::size_t i = 1; i < written.places.size(); ++i) {
      if (written.places[i - 1] == written.places[i]) continue;
      EXPECT_EQ(aim(written.places[i - 1], written.places[i]).end(), written.places[i]);
      EXPECT_EQ(aim(written.places[i], written.places[i - 1]).end(), written.places[i - 1]);
    }
  }
}

// ---- whole paths --------------------------------------------------------------------------

struct Cut {
  GeodesicPassReport report;
  std::vector<PathMove> moves;
  ToolPosition start;
};

Cut passes(const ModelField& design, const GeodesicPassOptions& options) {
  Cut cut;
  const auto report = geodesic_passes(design, options, [&](const Toolpath& piece) -> Result<void> {
    if (cut.moves.empty())
      cut.start = piece.start;
    else
      EXPECT_TRUE(piece.start == cut.moves.back().to);
    cut.moves.insert(cut.moves.end(), piece.moves.begin(), piece.moves.end());
    return {};
  });
  if (!report)
    ADD_FAILURE() << report.error().message;
  else
    cut.report = *report;
  return cut;
}

Vec3 mm(const ToolPosition& p) {
  return {mm_of_ticks(p.x), mm_of_ticks(p.y), mm_of_ticks(p.z)};
}

/// Calls f(a, b) for each cutting move that goes somewhere in plan.
template <class F>
void for_each_cut(const Cut& cut, F&& f) {
  ToolPosition at = cut.start;
  for (const PathMove& m : cut.moves) {
    if (m.kind == PathMove::Kind::line && (m.to.x != at.x || m.to.y != at.y)) f(mm(at), mm(m.to));
    at = m.to;
  }
}

double deepest_gouge(const Cut& cut, const ModelField& design, double radius, double step) {
  DropCutter cutter(design, Cutter::ball(radius));
  double deepest = -INFINITY;
  for_each_cut(cut, [&](Vec3 a, Vec3 b) {
    const auto n = std::max(2, static_cast<int>(norm(b - a) / step));
    for (int k = 0; k <= n; ++k) {
      const Vec3 p = a + (static_cast<double>(k) / n) * (b - a);
      deepest = std::max(deepest, cutter.drop(p.x, p.y).tip_mm - p.z);
    }
  });
  return deepest;
}

/// Ridges at random places at least `inset` inside the outline: the swept ball's envelope above
/// that of the ball at all cutter locations, 0.05 mm apart, along the normal of the latter.
struct Ridges {
  double highest = 0.0, mean = 0.0;
};
Ridges measured(const Cut& cut, const ModelField& design, double radius, double inset,
                std::uint64_t places, std::uint64_t seed) {
  constexpr double kGrid = 0.05, kAlong = 0.02;
  DropCutter cutter(design, Cutter::ball(radius));
  const double x0 = design.x0.value(), y0 = design.y0.value();
  const double side = design.spacing.value() * static_cast<double>(design.z_mm.cols() - 1);
  const auto n = static_cast<std::ptrdiff_t>(std::floor(side / kGrid)) + 1;
  Grid<float> tips(n, n);
  for (std::ptrdiff_t r = 0; r < n; ++r)
    for (std::ptrdiff_t c = 0; c < n; ++c)
      tips(r, c) = static_cast<float>(
          cutter.drop(x0 + kGrid * static_cast<double>(c), y0 + kGrid * static_cast<double>(r))
              .tip_mm);
  std::vector<Vec3> path;
  for_each_cut(cut, [&](Vec3 a, Vec3 b) {
    const auto steps = static_cast<int>(std::ceil(std::hypot(b.x - a.x, b.y - a.y) / kAlong));
    for (int k = 0; k <= steps; ++k) path.push_back(a + (static_cast<double>(k) / steps) * (b - a));
  });
  std::sort(path.begin(), path.end(), [](Vec3 a, Vec3 b) { return a.x < b.x; });
  Ridges ridges;
  for (std::uint64_t i = 0; i < places; ++i) {
    const double x = x0 + inset + (side - 2.0 * inset) * random_uniform(seed, 2 * i);
    const double y = y0 + inset + (side - 2.0 * inset) * random_uniform(seed, 2 * i + 1);
    double reachable = INFINITY, cosine = 1.0;
    const auto first = [&](double t) {
      return std::max<std::ptrdiff_t>(0, static_cast<std::ptrdiff_t>(std::ceil(t / kGrid)));
    };
    for (std::ptrdiff_t r = first(y - radius - y0); r < n; ++r) {
      const double dy = y0 + kGrid * static_cast<double>(r) - y;
      if (dy > radius) break;
      for (std::ptrdiff_t c = first(x - radius - x0); c < n; ++c) {
        const double dx = x0 + kGrid * static_cast<double>(c) - x;
        if (dx > radius) break;
        const double q = radius * radius - dx * dx - dy * dy;
        if (q < 0.0) continue;
        const double z = static_cast<double>(tips(r, c)) + radius - std::sqrt(q);
        if (z < reachable) {
          reachable = z;
          cosine = std::sqrt(q) / radius;
        }
      }
    }
    double swept = INFINITY;
    for (auto p = std::lower_bound(path.begin(), path.end(), x - radius,
                                   [](Vec3 a, double v) { return a.x < v; });
         p != path.end() && p->x <= x + radius; ++p) {
      const double q = radius * radius - (p->x - x) * (p->x - x) - (p->y - y) * (p->y - y);
      if (q >= 0.0) swept = std::min(swept, p->z + radius - std::sqrt(q));
    }
    const double ridge = (swept - reachable) * cosine;
    ridges.highest = std::max(ridges.highest, ridge);
    ridges.mean += ridge / static_cast<double>(places);
  }
  return ridges;
}

GeodesicPassOptions fine(double stepover) {
  GeodesicPassOptions o;
  o.stepover = Millimetres{stepover};
  o.tolerance = Millimetres{0.001};
  return o;
}

ModelField dome() {
  return field_of(33, 0.5, [](double x, double y) {
    return 5.0 + std::sqrt(400.0 - (x - 5.0) * (x - 5.0) - (y - 12.0) * (y - 12.0)) - 20.0;
  });
}
ModelField bowl() {
  return field_of(33, 0.5, [](double x, double y) {
    return 5.0 - std::sqrt(225.0 - (x - 6.3) * (x - 6.3) - (y - 10.6) * (y - 10.6)) + 15.0;
  });
}
ModelField steep() {
  return field_of(33, 0.5, [](double x, double y) { return 1.2 * x + 0.4 * y; });
}
ModelField hills() {
  return field_of(41, 0.5, [](double x, double y) {
    return 5.0 + 1.2 * std::sin(0.55 * x) * std::cos(0.45 * y) + 0.1 * x;
  });
}

TEST(GeodesicPasses, OfAFlatSquareAreOneSpiralAndHardlyAnythingElse) {
  const ModelField flat = flat_field(41, 41, 0.5, 5.0F);
  const Cut cut = passes(flat, {});
  EXPECT_EQ(cut.report.field_nodes, 81U * 81U);
  // Square rings at 0.5, 1.0 ... 9.5.
  EXPECT_EQ(cut.report.curves, 19U);
  EXPECT_EQ(cut.report.pieces, 2U);
  EXPECT_LE(cut.report.strokes, 16U);
  EXPECT_LE(cut.report.links_flown, 4U);
  double expected = 80.0;
  for (int k = 1; k < 20; ++k) expected += 80.0 - 4.0 * k;
  // One more turn than rings.
  EXPECT_NEAR(cut.report.path_length_mm, expected + 70.0, 25.0);
  for_each_cut(cut, [](Vec3 a, Vec3 b) {
    EXPECT_NEAR(a.z, 5.0, 0.001);
    EXPECT_NEAR(b.z, 5.0, 0.001);
  });
  EXPECT_NEAR(cut.report.scallop_flat_mm, 3.0 - std::sqrt(9.0 - 0.0625), 1e-12);
  EXPECT_LE(cut.report.scallop.highest_mm, 1.95 * cut.report.scallop_flat_mm);
}

TEST(GeodesicPasses, KeepTheirStepoverInSpace) {
  // Straight curves along a steep plane from a line at its foot.
  const ModelField plane = field_of(41, 0.5, [](double x, double) { return 1.5 * x; });
  GeodesicPassOptions o = fine(0.5);
  o.start = {{-2.0, 3.0}, {-2.0, 23.0}};
  const Cut cut = passes(plane, o);
  std::vector<double> at;
  for_each_cut(cut, [&](Vec3 a, Vec3 b) {
    if (std::abs(b.y - a.y) < 1.0) return;
    EXPECT_NEAR(a.x, b.x, 0.02);
    if (at.empty() || std::abs(at.back() - a.x) > 0.02) at.push_back(a.x);
  });
  std::sort(at.begin(), at.end());
  at.erase(std::unique(at.begin(), at.end(), [](double a, double b) { return b - a < 0.02; }),
           at.end());
  ASSERT_GT(at.size(), 60U);
  // Above the ball's reach from the foot the tips form the plane itself.
  for (std::size_t i = 1; i < at.size(); ++i)
    if (at[i - 1] > 1.0 && at[i] < 15.0) {
      EXPECT_NEAR((at[i] - at[i - 1]) * std::hypot(1.0, 1.5), 0.5, 0.02);
    }
}

TEST(GeodesicPasses, RidgesAreNotHigherThanPredicted) {
  const std::vector<meshing::PlanPoint> point{{4.3, 11.2}},
      line{{-2.0, 8.0}, {6.0, 12.0}, {7.0, 19.0}};
  struct Case {
    const char* name;
    ModelField design;
    std::vector<meshing::PlanPoint> start;
  };
  const std::vector<Case> cases{{"dome", dome(), {}},
                                {"dome from a point", dome(), point},
                                {"bowl", bowl(), {}},
                                {"steep plane", steep(), line},
                                {"hills", hills(), {}},
                                {"hills from a line", hills(), line},
                                {"hills from a point", hills(), point}};
  for (const Case& c : cases) {
    GeodesicPassOptions o = fine(0.6);
    o.start = c.start;
    const Cut cut = passes(c.design, o);
    const Ridges r = measured(cut, c.design, 3.0, 0.5, 1500, 5);
    std::printf(
        "%-20s ridges: measured %.4f (mean %.4f), predicted %.4f (mean %.4f), flat %.4f; "
        "%llu strokes, %llu links flown, %llu cut, excess %.4f\n",
        c.name, r.highest, r.mean, cut.report.scallop.highest_mm, cut.report.scallop.mean_mm,
        cut.report.scallop_flat_mm, static_cast<unsigned long long>(cut.report.strokes),
        static_cast<unsigned long long>(cut.report.links_flown),
        static_cast<unsigned long long>(cut.report.links_cut), cut.report.certified_excess_mm);
    EXPECT_LE(r.highest, cut.report.scallop.highest_mm + cut.report.certified_excess_mm) << c.name;
    EXPECT_GE(r.highest, 0.5 * cut.report.scallop_flat_mm) << c.name;
  }
}

TEST(GeodesicPasses, HoldTheScallopLimit) {
  for (const ModelField& design : {dome(), bowl(), steep(), hills()}) {
    GeodesicPassOptions o = fine(0.5);
    o.scallop_limit = Millimetres{0.012};
    const Cut cut = passes(design, o);
    const Ridges r = measured(cut, design, 3.0, 0.5, 1500, 6);
    // Only the hills have valleys too narrow for the ball.
    const bool creased = design.z_mm.rows() == hills().z_mm.rows();
    const double allowed = creased ? cut.report.scallop.highest_mm : 0.012;
    EXPECT_LE(cut.report.scallop.highest_mm, allowed * (1.0 + 1e-6));
    EXPECT_LE(r.highest, allowed + cut.report.certified_excess_mm);
    EXPECT_GE(r.highest, 0.006);
    EXPECT_LE(cut.report.scallop.share_above_limit, 0.005);
    // The curves themselves come nearer in the bowl; were it the strokes alone, they were 400.
    if (!creased) {
      EXPECT_LE(cut.report.strokes, 200U);
    }
  }
}

class GeodesicPassesOn : public testing::TestWithParam<std::tuple<Ground, int>> {};

TEST_P(GeodesicPassesOn, NeverGougeDeeperThanCertified) {
  const auto [kind, seed] = GetParam();
  const ModelField ground =
      testing_support::ground(kind, static_cast<std::uint64_t>(seed), 22, seed == 1 ? 0.5 : 0.37);
  GeodesicPassOptions o;
  o.stepover = Millimetres{1.0};
  if (seed == 2) o.start = {{0.4, 3.3}};
  o.ball_diameter = Millimetres{seed == 1 ? 6.0 : 3.0};
  const Cut cut = passes(ground, o);
  const double deepest = deepest_gouge(cut, ground, 0.5 * o.ball_diameter.value(), 0.01);
  EXPECT_LE(deepest, cut.report.certified_gouge_mm);
  EXPECT_LE(cut.report.certified_gouge_mm, 0.005);
  if (kind == Ground::rough) {
    EXPECT_GE(deepest, 0.3 * cut.report.certified_gouge_mm);
  }
  // Nothing leaves the outline.
  const double right = ground.x_mm(ground.z_mm.cols() - 1),
               top = ground.y_mm(ground.z_mm.rows() - 1);
  for_each_cut(cut, [&](Vec3, Vec3 b) {
    EXPECT_TRUE(b.x >= ground.x0.value() && b.x <= right && b.y >= ground.y0.value() && b.y <= top);
  });
}
INSTANTIATE_TEST_SUITE_P(Seeds, GeodesicPassesOn,
                         testing::Combine(testing::ValuesIn(testing_support::kGrounds),
                                          testing::Range(1, 3)),
                         [](const auto& param) {
                           return std::string(testing_support::name(std::get<0>(param.param))) +
                                  "_seed" + std::to_string(std::get<1>(param.param));
                         });

TEST(GeodesicPasses, RapidsStayClear) {
  const ModelField ground = testing_support::ground(Ground::rolling, 4, 50, 0.5);
  for (const double allowance : {double{NAN}, 0.0, 0.7}) {
    GeodesicPassOptions o;
    o.stepover = Millimetres{1.2};
    o.stock_allowance = Millimetres{allowance};
    o.clearance = Millimetres{2.0};
    const Cut cut = passes(ground, o);
    const double top = static_cast<double>(heightmap::height_range(ground.z_mm).max);
    DropCutter cutter(ground, Cutter::ball(3.0));
    ToolPosition at = cut.start;
    EXPECT_GE(mm(at).z, top + 2.0);
    for (const PathMove& m : cut.moves) {
      if (m.kind == PathMove::Kind::rapid && (m.to.x != at.x || m.to.y != at.y)) {
        EXPECT_EQ(m.to.z, at.z);
        const Vec3 a = mm(at), b = mm(m.to);
        for (int k = 0; k <= 50; ++k) {
          const Vec3 p = a + (k / 50.0) * (b - a);
          const double low =
              std::isnan(allowance) ? top + 2.0 : cutter.drop(p.x, p.y).tip_mm + 2.0 + allowance;
          EXPECT_GE(p.z, low - 1e-9);
        }
      }
      at = m.to;
    }
    EXPECT_EQ(cut.moves.back().kind, PathMove::Kind::rapid);
    EXPECT_GE(mm(at).z, top + 2.0);
  }
}

TEST(GeodesicPasses, SameMovesForAnyNumberOfThreads) {
  const ModelField ground = testing_support::ground(Ground::rough, 7, 80, 0.5);
  std::vector<Cut> cuts;
  for (const std::size_t threads : {1U, 3U}) {
    const oneapi::tbb::global_control limit(oneapi::tbb::global_control::max_allowed_parallelism,
                                            threads);
    cuts.push_back(passes(ground, {}));
  }
  ASSERT_EQ(cuts[0].moves.size(), cuts[1].moves.size());
  for (std::size_t i = 0; i < cuts[0].moves.size(); ++i)
    ASSERT_TRUE(cuts[0].moves[i].to == cuts[1].moves[i].to);
  EXPECT_EQ(cuts[0].report.scallop.mean_mm, cuts[1].report.scallop.mean_mm);
}

TEST(GeodesicPassErrors, OneCaseEach) {
  const ModelField flat = flat_field(9, 9, 0.5, 1.0F);
  const ToolpathSink sink = [](const Toolpath&) -> Result<void> { return {}; };
  GeodesicPassOptions o;
  o.stepover = Millimetres{0.0};
  EXPECT_THAT(geodesic_passes(flat, o, sink), FailsWith(kStepoverOutOfRange));
  o.stepover = Millimetres{0.001};  // 8 M nodes a millimetre
  EXPECT_THAT(geodesic_passes(flat_field(200, 200, 0.5, 1.0F), o, sink),
              FailsWith(kStepoverOutOfRange));
  o = {};
  o.ball_diameter = Millimetres{-1.0};
  EXPECT_THAT(geodesic_passes(flat, o, sink), FailsWith(kToolNotPositive));
  o = {};
  o.tolerance = Millimetres{2.0};
  EXPECT_THAT(geodesic_passes(flat, o, sink), FailsWith(kToleranceOutOfRange));
  o = {};
  o.start = {{1.0, 1.0}, {9.0, 1.0}};
  EXPECT_THAT(geodesic_passes(flat, o, sink), FailsWith(meshing::kGeodesicSource));
  o = {};
  const ToolpathSink full = [](const Toolpath&) -> Result<void> {
    return fail(kMillOptionOutOfRange, "no more");
  };
  EXPECT_THAT(geodesic_passes(flat, o, full), FailsWith(kMillOptionOutOfRange));
  std::stop_source stop;
  stop.request_stop();
  RunContext run;
  run.stop = stop.get_token();
  EXPECT_THAT(geodesic_passes(flat, o, sink, run), FailsWith(kCancelled));
}

}  // namespace
}  // namespace maquette::cnc

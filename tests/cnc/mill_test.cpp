// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in cnc/mill.hpp, pass_sampler.hpp and steepness.hpp, and how it is attacked:
//
//   bounds between samples ....... dense exact cutter locations on kind and harsh ground, along
//                                  the axes and lines at rational angles
//   certified_gouge .............. every move of the written text, lines and arcs, read back by a
//                                  small parser of our own, against the exact cutter location at
//                                  fine steps; arcs with the radius of either end and between
//   <= half the tolerance ........ on every ground, walls included, all strategies
//   certified_excess ............. the same; at most the tolerance on ground without walls
//   raster ....................... rows, ends, stepover, bands, angles, zig-zag, climb, one way
//   constant scallop ............. planes of 0 to 60 degrees: passes where they must be, and the
//                                  ridge measured in a dense simulation of the written path
//   leads and rapids ............. nothing flies or plunges through the surface; read back
//   figures of the report ........ counted again from the text
//   same bytes ................... 1 and 3 threads
//   errors ....................... one case per code; nothing is left on disk

#include "cnc/mill.hpp"

#include <algorithm>
#include <charconv>
#include <cmath>
#include <numbers>
#include <sstream>
#include <stop_token>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <oneapi/tbb/global_control.h>

#include "cnc/cutter_location.hpp"
#include "cnc/pass_sampler.hpp"
#include "cnc/program.hpp"
#include "core/files.hpp"
#include "core/random.hpp"
#include "core/vec.hpp"
#include "support/matchers.hpp"
#include "support/terrain.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;
using testing::HasSubstr;
using testing_support::FailsWith;
using testing_support::flat_field;
using testing_support::Ground;
using testing_support::ScratchFolder;

// ---- reading back --------------------------------------------------------------------

struct Move {
  int motion;  // 0 .. 3
  int plane;   // 17 .. 19
  Vec3 from, to, centre;
  double feed;
};

/// Of the shorter arc of radius r, in the order of the plane's axes: left of the chord if it turns
/// left.
Vec3 centre_of(const Vec3& from, const Vec3& to, double r, int plane, bool left) {
  const Vec3 way = to - from;
  const Vec3 normal = plane == 17   ? Vec3{-way.y, way.x, 0.0}
                      : plane == 18 ? Vec3{way.z, 0.0, -way.x}
                                    : Vec3{0.0, -way.z, way.y};
  const double chord = norm(normal), rise = std::sqrt(r * r - 0.25 * chord * chord);
  return 0.5 * (from + to) + ((left ? rise : -rise) / chord) * normal;
}

/// Words of the RS-274 posts, modal; arcs with I J K from their start, or R.
std::vector<Move> moves_of(const std::string& program) {
  std::vector<Move> moves;
  std::istringstream lines(program);
  std::string line;
  int motion = -1, plane = 17;
  Vec3 at{NAN, NAN, NAN};
  double feed = 0.0;
  while (std::getline(lines, line)) {
    line.resize(std::min(line.size(), line.find_first_of("(%")));
    const Vec3 from = at;
    Vec3 centre = at;
    double radius = 0.0;
    bool moved = false;
    for (std::size_t i = 0; i < line.size();) {
      const char letter = line[i++];
      if (letter == ' ') continue;
      double value = NAN;
      const auto [end, error] = std::from_chars(line.data() + i, line.data() + line.size(), value);
      EXPECT_EQ(error, std::errc{}) << line;
      if (error != std::errc{}) break;
      i = static_cast<std::size_t>(end - line.data());
      if (letter == 'G' && value <= 3.0) motion = static_cast<int>(value);
      if (letter == 'G' && value >= 17.0 && value <= 19.0) plane = static_cast<int>(value);
      if (letter == 'X') at.x = value, moved = true;
      if (letter == 'Y') at.y = value, moved = true;
      if (letter == 'Z') at.z = value, moved = true;
      if (letter == 'I') centre.x += value;
      if (letter == 'J') centre.y += value;
      if (letter == 'K') centre.z += value;
      if (letter == 'R') radius = value;
      if (letter == 'F') feed = value;
    }
    if (radius > 0.0) centre = centre_of(from, at, radius, plane, motion == 3);
    if (moved) moves.push_back({motion, plane, from, at, centre, feed});
  }
  return moves;
}

/// Places along a move, ends included: an arc's with its radius going from one end's to the
/// other's, then with the one and with the other.
std::vector<Vec3> places_of(const Move& m, double step_mm) {
  std::vector<Vec3> places;
  if (m.motion < 2) {
    const int n = 1 + static_cast<int>(norm(m.to - m.from) / step_mm);
    for (int k = 0; k <= n; ++k) places.push_back(m.from + (k / double(n)) * (m.to - m.from));
    return places;
  }
  // Angles from the first to the second axis of the plane: XY, ZX, YZ.
  const auto axes = [&](const Vec3& v) {
    return m.plane == 17   ? std::pair{v.x, v.y}
           : m.plane == 18 ? std::pair{v.z, v.x}
                           : std::pair{v.y, v.z};
  };
  const auto [a0, b0] = axes(m.from - m.centre);
  const auto [a1, b1] = axes(m.to - m.centre);
  const double r0 = std::hypot(a0, b0), r1 = std::hypot(a1, b1), begin = std::atan2(b0, a0);
  double sweep = std::atan2(b1, a1) - begin;
  if (m.motion == 3 && sweep <= 0.0) sweep += 2.0 * std::numbers::pi;
  if (m.motion == 2 && sweep >= 0.0) sweep -= 2.0 * std::numbers::pi;
  const int n = 1 + static_cast<int>(r0 * std::abs(sweep) / step_mm);
  for (const int way : {0, 1, 2})
    for (int k = 0; k <= n; ++k) {
      const double t = k / double(n), angle = begin + t * sweep;
      const double r = way == 0 ? r0 + t * (r1 - r0) : way == 1 ? r0 : r1;
      const double a = r * std::cos(angle), b = r * std::sin(angle);
      places.push_back(m.centre + (m.plane == 17   ? Vec3{a, b, 0.0}
                                   : m.plane == 18 ? Vec3{b, 0.0, a}
                                                   : Vec3{0.0, a, b}));
    }
  return places;
}

struct Program {
  MillReport report;
  std::string text;
  std::vector<Move> moves;
  [[nodiscard]] std::vector<Move> cuts() const {
    std::vector<Move> found;
    for (const Move& m : moves)
      if (m.motion >= 1) found.push_back(m);
    return found;
  }
};

Program milled(const ModelField& field, const MillOptions& options) {
  const ScratchFolder folder;
  const auto report = mill(field, options, folder / "part.ngc");
  if (!report) {
    ADD_FAILURE() << report.error().code.name << ": " << report.error().message;
    return {};
  }
  std::string text = *read_file(folder / "part.ngc");
  auto moves = moves_of(text);
  return {*report, std::move(text), std::move(moves)};
}

/// Without leads, whose outer half is meant to be off the surface.
MillOptions bare() {
  MillOptions o;
  o.lead_radius = Millimetres{0.0};
  return o;
}

struct Deviation {
  double deepest = -INFINITY, highest = -INFINITY;
};

/// Written moves against the exact cutter location.
Deviation deviation(const Program& program, const ModelField& field, double radius,
                    double step_mm) {
  DropCutter cutter(field, Cutter::ball(radius));
  Deviation d;
  for (const Move& m : program.cuts()) {
    if (m.to.x == m.from.x && m.to.y == m.from.y) continue;  // plunge
    for (const Vec3& p : places_of(m, step_mm)) {
      const double below = cutter.drop(p.x, p.y).tip_mm - p.z;
      d.deepest = std::max(d.deepest, below);
      d.highest = std::max(d.highest, -below);
    }
  }
  return d;
}

/// Least height of rapids above the exact cutter location; climbs at one place left out.
double least_rapid_clearance(const Program& program, const ModelField& field, double radius) {
  DropCutter cutter(field, Cutter::ball(radius));
  double least = INFINITY;
  for (const Move& m : program.moves) {
    if (m.motion != 0 || std::isnan(m.from.x) || std::isnan(m.from.z)) continue;
    if (m.from.x == m.to.x && m.from.y == m.to.y && m.to.z >= m.from.z) continue;
    for (const Vec3& p : places_of(m, 0.04))
      least = std::min(least, p.z - cutter.drop(p.x, p.y).tip_mm);
  }
  return least;
}

// ---- closed forms ------------------------------------------------------------------------

TEST(Mill, CutsFlatGroundWithOneMoveAPass) {
  const Program p = milled(flat_field(5, 21, 0.5, 2.5F), bare());
  const auto cuts = p.cuts();
  ASSERT_EQ(p.report.passes, 5U);
  ASSERT_EQ(cuts.size(), 1U + 5U + 4U);  // plunge, passes, links
  for (const Move& m : cuts) EXPECT_EQ(m.to.z, 2.5);
  EXPECT_EQ(cuts[0].from.z, 7.5);  // nothing is known of the stock
  EXPECT_EQ(cuts[0].feed, 600.0);
  EXPECT_EQ(cuts[1].feed, 3000.0);
  EXPECT_NEAR(p.report.path_length_mm, 5.0 + 5 * 10.0 + 4 * 0.5, 1e-9);
  EXPECT_NEAR(p.report.cutting_time_min, 5.0 / 600.0 + 52.0 / 3000.0, 1e-12);
  EXPECT_LE(p.report.certified_gouge_mm, 1e-8);
  EXPECT_NEAR(p.report.scallop_flat_mm, 3.0 - std::sqrt(9.0 - 0.0625), 1e-12);
  EXPECT_EQ(p.report.lines, cuts.size());
  EXPECT_EQ(p.report.links_cut, 4U);
  EXPECT_EQ(p.report.links_flown, 0U);
  EXPECT_EQ(p.report.shortest_move_mm, 0.5);
}

TEST(Mill, ALoneVertexIsCutWithOneArcEachSide) {
  // One pass over a spike 20 mm high: while the ball rolls over it, a circle of its radius.
  ModelField field = flat_field(3, 61, 0.5, 0.0F);
  field.z_mm(1, 30) = 2.0F;
  MillOptions o = bare();
  o.first_y_mm = o.last_y_mm = 0.5;
  o.tolerance = Millimetres{0.002};
  const Program p = milled(field, o);
  EXPECT_LE(p.report.arcs, 5U);  // and one round each foot at most
  EXPECT_GE(p.report.arcs, 1U);
  double longest = 0.0;
  for (const Move& m : p.cuts()) {
    if (m.motion < 2) continue;
    EXPECT_EQ(m.plane, 18);
    longest = std::max(longest, m.to.x - m.from.x);
    // A band of 3 um leaves the circle through 2 mm of it this free: 8 s / c^2 * r^2. What is left
    // over at the foot is shorter, and free.
    if (m.to.x - m.from.x < 2.0) continue;
    EXPECT_EQ(m.motion, 3);  // over the top towards +x
    EXPECT_NEAR(m.centre.x, 15.0, 0.06);
    EXPECT_NEAR(m.centre.z, 2.0 - 3.0, 0.06);
    EXPECT_NEAR(norm(m.from - m.centre), 3.0, 0.06);
  }
  EXPECT_GE(longest, 3.0);
}

TEST(Mill, FollowsATiltedPlaneAtItsRaise) {
  ModelField plane = flat_field(21, 41, 0.5, 0.0F);
  for (std::ptrdiff_t r = 0; r < 21; ++r)
    for (std::ptrdiff_t c = 0; c < 41; ++c)
      plane.z_mm(r, c) = static_cast<float>(0.5 * plane.x_mm(c));
  const Program p = milled(plane, bare());
  const double raise = 3.0 * (std::sqrt(1.25) - 1.0);
  for (const Move& m : p.cuts()) {
    // Near the lower end the ball still touches the plane; near the upper one it leaves it.
    if (m.to.x > 20.0 - 3.0) continue;
    EXPECT_GE(m.to.z, 0.5 * m.to.x + raise - 0.005);
    EXPECT_LE(m.to.z, 0.5 * m.to.x + raise + 0.010);
  }
}

TEST(Mill, PassesStartAndEndOnTheOutlineAStepoverApart) {
  ModelField field = testing_support::ground(Ground::rolling, 3, 30, 0.5);
  MillOptions o = bare();
  o.stepover = Millimetres{0.4};
  const Program p = milled(field, o);
  std::vector<double> rows;
  for (const Move& m : p.cuts())
    if (m.from.y == m.to.y && m.from.x != m.to.x && (rows.empty() || rows.back() != m.to.y))
      rows.push_back(m.to.y);
  ASSERT_EQ(rows.size(), p.report.passes);
  EXPECT_EQ(rows.front(), 1.25);
  EXPECT_EQ(rows.back(), 1.25 + 14.5);
  for (std::size_t i = 1; i < rows.size(); ++i) {
    EXPECT_LE(rows[i] - rows[i - 1], 0.4 + 1e-9);
    if (i + 1 < rows.size()) {
      EXPECT_NEAR(rows[i] - rows[i - 1], 0.4, 1.1e-4);
    }
  }
  double left = INFINITY, right = -INFINITY;
  for (const Move& m : p.cuts()) {
    left = std::min(left, m.to.x);
    right = std::max(right, m.to.x);
  }
  EXPECT_EQ(left, -3.0);
  EXPECT_EQ(right, -3.0 + 14.5);
}

TEST(Mill, ABandKeepsToItsRows) {
  const ModelField field = testing_support::ground(Ground::rolling, 5, 30, 0.5);
  MillOptions o = bare();
  o.first_y_mm = 4.3;
  o.last_y_mm = 9.05;
  const Program p = milled(field, o);
  double low = INFINITY, high = -INFINITY;
  for (const Move& m : p.cuts()) {
    low = std::min(low, m.to.y);
    high = std::max(high, m.to.y);
  }
  EXPECT_EQ(low, 4.3);
  EXPECT_EQ(high, 9.05);
  EXPECT_EQ(p.report.passes, 11U);
  o.last_y_mm = 4.3;
  EXPECT_EQ(milled(field, o).report.passes, 1U);
}

TEST(Mill, OneWayKeepsItsDirectionAndReturnsByAir) {
  const ModelField field = testing_support::ground(Ground::rough, 5, 20, 0.5);
  for (const bool climb : {false, true}) {
    MillOptions o = bare();
    o.zigzag = false;
    o.climb = climb;
    const Program p = milled(field, o);
    for (const Move& m : p.cuts()) {
      EXPECT_EQ(m.to.y, m.from.y);
      // Rows follow each other northwards: going west has the uncut material on the right.
      if (climb)
        EXPECT_LE(m.to.x, m.from.x);
      else
        EXPECT_GE(m.to.x, m.from.x);
    }
    EXPECT_LE(deviation(p, field, 3.0, 0.01).deepest, p.report.certified_gouge_mm);
    EXPECT_EQ(p.report.links_flown, p.report.passes - 1);
    EXPECT_EQ(p.report.links_cut, 0U);
  }
}

TEST(Mill, RapidsAndLeadsTouchNothing) {
  for (const Ground kind : {Ground::rough, Ground::spikes, Ground::cliffs})
    for (const int way : {0, 1, 2}) {
      const ModelField field = testing_support::ground(kind, 2, 16, 0.5);
      MillOptions o;
      o.zigzag = way == 0;
      o.constant_scallop = way == 2;
      o.lead_radius = Millimetres{way == 1 ? 2.5 : 1.0};
      o.clearance = Millimetres{3.0};
      if (way > 0) o.stock_allowance = Millimetres{0.3};
      const Program p = milled(field, o);
      EXPECT_GE(least_rapid_clearance(p, field, 3.0), way > 0 ? 1.3 - 1e-9 : 3.0 - 1e-9);
      EXPECT_LE(deviation(p, field, 3.0, 0.05).deepest, p.report.certified_gouge_mm);
      EXPECT_EQ(p.moves.back().motion, 0);
      // What goes straight down does so at plunge feed.
      for (const Move& m : p.cuts())
        if (m.from.x == m.to.x && m.from.y == m.to.y) {
          EXPECT_EQ(m.feed, 600.0);
        }
    }
}

TEST(Mill, LeadsAreQuarterCirclesBesideTheOutline) {
  const ModelField field = testing_support::ground(Ground::rolling, 5, 20, 0.5);
  MillOptions o;
  o.zigzag = false;
  const Program p = milled(field, o);
  std::size_t leads = 0;
  for (const Move& m : p.cuts()) {
    if (std::min(m.from.x, m.to.x) >= -3.0 && std::max(m.from.x, m.to.x) <= 6.5) continue;
    if (m.motion == 1) {  // the last piece down to where a lead starts
      EXPECT_EQ(m.from.x, m.to.x);
      continue;
    }
    ++leads;
    EXPECT_EQ(m.plane, 18);
    EXPECT_DOUBLE_EQ(std::abs(m.from.x - m.to.x), 1.0);
    EXPECT_NEAR(std::abs(m.from.z - m.to.z), 1.0, 1e-12);
    EXPECT_NEAR(m.centre.z, std::max(m.from.z, m.to.z), 1e-12);
    for (const Vec3& place : places_of(m, 0.01)) EXPECT_LE(place.z, m.centre.z + 1e-9);
  }
  EXPECT_EQ(leads, 2 * p.report.passes);
}

TEST(Mill, RapidsFlyNoHigherThanTheLineTheyFlyNeeds) {
  // A tower in a corner does not raise the links on the other side.
  ModelField field = flat_field(41, 41, 0.5, 0.0F);
  field.z_mm(2, 2) = 40.0F;
  MillOptions o = bare();
  o.zigzag = false;
  o.stock_allowance = Millimetres{0.2};
  const Program p = milled(field, o);
  int returns = 0;
  for (const Move& m : p.moves)
    if (m.motion == 0 && m.from.y > 8.0 && m.to.x != m.from.x) {
      EXPECT_NEAR(m.to.z, 5.2, 1e-9);
      ++returns;
    }
  EXPECT_GE(returns, 20);
}

TEST(Mill, WithoutAnyWordOfTheStockRapidsFlyOverTheWholeDesign) {
  for (const bool zigzag : {false, true}) {
    const ModelField field = testing_support::ground(Ground::spikes, 2, 20, 0.5);
    const double top = static_cast<double>(heightmap::height_range(field.z_mm).max);
    MillOptions o;
    o.zigzag = zigzag;
    const Program p = milled(field, o);
    int rapids = 0;
    for (const Move& m : p.moves) {
      if (m.motion != 0) continue;
      ++rapids;
      EXPECT_GE(m.to.z, top + 5.0);
      if (m.from.z < top) {
        EXPECT_EQ(m.from.x, m.to.x);
        EXPECT_EQ(m.from.y, m.to.y);
      }
    }
    EXPECT_GE(rapids, 3);
  }
}

TEST(Mill, RapidsKeepClearOfStockThatStandsHigher) {
  const ModelField field = flat_field(21, 21, 0.5, 0.0F);
  const ModelField stock = flat_field(21, 21, 0.5, 4.0F);
  MillOptions o;
  o.zigzag = false;
  o.stock = &stock;
  const Program p = milled(field, o);
  EXPECT_GE(least_rapid_clearance(p, stock, 3.0), 1.0 - 1e-9);
}

TEST(Mill, AnglesAreCutAsTheReportSaysWithTheOutlineFirst) {
  const ModelField field = testing_support::ground(Ground::rolling, 3, 30, 0.5);
  const double side = 14.5;
  for (const double degrees_ccw : {90.0, 45.0, -20.0, 180.0, 210.0}) {
    MillOptions o = bare();
    o.direction = degrees(degrees_ccw);
    const Program p = milled(field, o);
    EXPECT_NEAR(std::remainder(p.report.direction_deg - degrees_ccw, 360.0), 0.0, 0.5);
    const double c = std::cos(p.report.direction_deg * std::numbers::pi / 180.0);
    const double s = std::sin(p.report.direction_deg * std::numbers::pi / 180.0);
    std::vector<double> offsets;
    for (const Move& m : p.cuts()) {
      for (const Vec3& v : {m.from, m.to}) {
        EXPECT_GE(v.x, -3.0);
        EXPECT_LE(v.x, -3.0 + side);
        EXPECT_GE(v.y, 1.25);
        EXPECT_LE(v.y, 1.25 + side);
      }
      const double across = -s * (m.to.x - m.from.x) + c * (m.to.y - m.from.y);
      if (std::abs(across) < 1e-9 && std::hypot(m.to.x - m.from.x, m.to.y - m.from.y) > 0.0)
        offsets.push_back(-s * m.to.x + c * m.to.y);
    }
    std::sort(offsets.begin(), offsets.end());
    ASSERT_FALSE(offsets.empty());
    for (std::size_t i = 1; i < offsets.size(); ++i)
      EXPECT_LE(offsets[i] - offsets[i - 1], 0.5 + 1e-9) << degrees_ccw;
    const double whole = side * (std::abs(c) + std::abs(s));
    EXPECT_NEAR(offsets.back() - offsets.front(), whole, 1.2) << degrees_ccw;
    EXPECT_LE(deviation(p, field, 3.0, 0.02).deepest, p.report.certified_gouge_mm);
    EXPECT_LE(p.report.certified_gouge_mm, 0.005 + 1e-12);
  }
}

// ---- scallop --------------------------------------------------------------------------------

/// Highest ridge left of a plane rising with y, normal to it, from the tip's places where the
/// written path crosses x = 10 in the plane's middle.
double measured_ridge(const Program& p, double slope, double x, double radius) {
  std::vector<Vec3> tips;
  for (const Move& m : p.cuts())
    if (std::min(m.from.x, m.to.x) <= x && std::max(m.from.x, m.to.x) > x) {
      Vec3 nearest = m.from;
      for (const Vec3& place : places_of(m, 0.005))
        if (std::abs(place.x - x) < std::abs(nearest.x - x)) nearest = place;
      tips.push_back(nearest);
    }
  const double raise = radius * (std::sqrt(1.0 + slope * slope) - 1.0);
  double highest = -INFINITY;
  for (double y = 14.0; y < 16.0; y += 0.002) {
    double left = INFINITY;
    for (const Vec3& tip : tips) {
      const double off = y - tip.y;
      if (std::abs(off) < radius)
        left = std::min(left, tip.z + radius - std::sqrt(radius * radius - off * off));
    }
    highest = std::max(highest, (left - slope * y) / std::sqrt(1.0 + slope * slope));
  }
  EXPECT_GT(raise, -1.0);
  return highest;
}

TEST(Mill, RidgesOnPlanesFollowTheLawAndConstantScallopHoldsTheLimit) {
  for (const double tilt_deg : {0.0, 25.0, 45.0, 60.0}) {
    const double slope = std::tan(tilt_deg * std::numbers::pi / 180.0);
    ModelField plane = flat_field(61, 41, 0.5, 0.0F);
    for (std::ptrdiff_t r = 0; r < 61; ++r)
      for (std::ptrdiff_t c = 0; c < 41; ++c)
        plane.z_mm(r, c) = static_cast<float>(slope * plane.y_mm(r));
    MillOptions o = bare();
    o.tolerance = Millimetres{0.001};  // so that the path's own excess is small
    const Program in_plane = milled(plane, o);
    const double distance = 0.5 / std::cos(tilt_deg * std::numbers::pi / 180.0);
    const double law = 3.0 - std::sqrt(9.0 - 0.25 * distance * distance);
    EXPECT_NEAR(measured_ridge(in_plane, slope, 10.0, 3.0), law, 0.0011) << tilt_deg;
    EXPECT_NEAR(in_plane.report.scallop.highest_mm, law, 1e-4) << tilt_deg;
    EXPECT_EQ(in_plane.report.extra_passes, 0U);

    o.constant_scallop = true;
    const Program constant = milled(plane, o);
    EXPECT_LE(measured_ridge(constant, slope, 10.0, 3.0), 0.011 + 0.0011) << tilt_deg;
    EXPECT_LE(constant.report.scallop.highest_mm, 0.011) << tilt_deg;
    EXPECT_EQ(constant.report.scallop.share_above_limit, 0.0);
    EXPECT_EQ(constant.report.extra_passes > 0, law > 0.011) << tilt_deg;
  }
  // 10.4, 21 and 42 um.
  const BallNose ball{3.0};
  EXPECT_NEAR(ridge_mm(ball, centre_distance_mm(0.5, 0.0, 0.0)), 0.0104, 5e-5);
  EXPECT_NEAR(ridge_mm(ball, centre_distance_mm(0.5, 0.0, 1.0)), 0.021, 5e-4);
  EXPECT_NEAR(ridge_mm(ball, centre_distance_mm(0.5, 0.0, std::sqrt(3.0))), 0.042, 5e-4);
  // Uphill along the passes nothing widens.
  EXPECT_DOUBLE_EQ(centre_distance_mm(0.5, 2.0, 0.0), 0.5);
}

TEST(Mill, AddsPassesOnlyWhereTheGroundIsSteepAcross) {
  // Flat for y < 10 and y > 20, 50 degrees between; only x in the middle third.
  ModelField field = flat_field(61, 181, 0.5, 0.0F);
  for (std::ptrdiff_t r = 0; r < 61; ++r)
    for (std::ptrdiff_t c = 0; c < 181; ++c) {
      const double rise = std::clamp(field.y_mm(r) - 10.0, 0.0, 10.0);
      const double share = std::clamp((30.0 - std::abs(field.x_mm(c) - 45.0)) / 15.0, 0.0, 1.0);
      field.z_mm(r, c) = static_cast<float>(1.2 * share * rise);
    }
  MillOptions o = bare();
  o.constant_scallop = true;
  o.stock_allowance = Millimetres{0.2};
  const Program p = milled(field, o);
  EXPECT_GE(p.report.extra_passes, 15U);
  EXPECT_LE(p.report.extra_passes, 60U);
  MillOptions plain = bare();
  const Program without = milled(field, plain);
  EXPECT_GT(without.report.scallop.highest_mm, 0.02);
  EXPECT_GT(without.report.scallop.share_above_limit, 0.1);
  EXPECT_LT(without.report.scallop.share_above_limit, 0.35);
  EXPECT_LE(p.report.scallop.highest_mm, 0.011 + 1e-12);
  EXPECT_LT(p.report.path_length_mm, 1.35 * without.report.path_length_mm);
  // The map shows where: steep in the middle, flat in the corners.
  const ModelField& map = without.report.scallop.predicted_mm;
  const auto at = [&](double x, double y) {
    return static_cast<double>(
        map.z_mm(std::lround(y / map.spacing.value()), std::lround(x / map.spacing.value())));
  };
  EXPECT_GT(at(45.0, 15.0), 0.02);
  EXPECT_LT(at(5.0, 5.0), 0.0106);
  EXPECT_LT(at(85.0, 25.0), 0.0106);
  EXPECT_LE(deviation(p, field, 3.0, 0.1).deepest, p.report.certified_gouge_mm);
}

// ---- bounds under attack -------------------------------------------------------------------

class PathOnTerrain : public testing::TestWithParam<std::tuple<Ground, int>> {
 protected:
  const Ground kind = std::get<0>(GetParam());
  const std::uint64_t seed = static_cast<std::uint64_t>(std::get<1>(GetParam()));
  const ModelField ground =
      testing_support::ground(kind, seed, 24, std::vector{0.5, 0.37, 1.0}[seed % 3]);
  const double radius = std::vector{3.0, 1.5}[seed % 2];
  [[nodiscard]] bool walls() const {
    return kind != Ground::flat && kind != Ground::rolling && kind != Ground::rough;
  }
};

TEST_P(PathOnTerrain, StaysInsideTheBoundsBetweenSamples) {
  DropCutter cutter(ground, Cutter::ball(radius));
  const SteepnessTiles tiles(ground, {radius});
  const double side = ground.spacing.value() * 23.0;
  const auto tick = [](double mm) { return 10 * static_cast<std::int64_t>(std::ceil(mm * 1e3)); };
  const std::int64_t x0 = tick(-3.0), y0 = tick(1.25), across = tick(0.31 * side);
  const std::int64_t most = static_cast<std::int64_t>(std::floor(side * 1e3));
  struct Line {
    LatticeLine line;
    std::int64_t last;
  };
  for (const auto& [line, last] :
       {Line{{x0, y0, 10, 0}, most}, Line{{x0, y0 + across, 10, 0}, most},
        Line{{x0 + 10 * most, y0 + across, -10, 0}, most}, Line{{x0, y0, 0, 10}, most},
        Line{{x0 + across, y0, 0, 10}, most}, Line{{x0, y0, 130, 70}, most / 13},
        Line{{x0 + 10 * most, y0, -70, 310}, most / 31}}) {
    std::vector<PathSample> samples;
    sample_line(cutter, tiles, ground, {radius}, line, 0, last, {0.003, 0.003}, samples);
    ASSERT_EQ(samples.front().place, 0);
    ASSERT_EQ(samples.back().place, last);
    for (std::size_t i = 0; i + 1 < samples.size(); ++i) {
      const PathSample &a = samples[i], &b = samples[i + 1];
      ASSERT_LT(a.place, b.place);
      EXPECT_LE(a.gouge_mm, 0.003 + 1e-12);
      for (int k = 0; k <= 6; ++k) {
        const double t = k / 6.0;
        const double x = line.x_mm(a.place) + t * (line.x_mm(b.place) - line.x_mm(a.place));
        const double y = line.y_mm(a.place) + t * (line.y_mm(b.place) - line.y_mm(a.place));
        const double tip = cutter.drop(x, y).tip_mm;
        const double path = a.tip_mm + t * (b.tip_mm - a.tip_mm);
        ASSERT_LE(tip - path, a.gouge_mm + 1e-9) << "at " << x << ", " << y;
        ASSERT_LE(path - tip, a.dip_mm + std::max(a.lift_mm, b.lift_mm) + 1e-9)
            << "at " << x << ", " << y;
      }
    }
  }
}

TEST_P(PathOnTerrain, WrittenProgramNeverGougesDeeperThanCertified) {
  for (const int way : {static_cast<int>(seed % 2), 2 + static_cast<int>(seed % 2)}) {
    MillOptions o = bare();
    o.ball_diameter = Millimetres{2.0 * radius};
    o.stepover = Millimetres{way == 0 ? 1.1 : 2.3};
    o.tolerance = Millimetres{std::vector{0.01, 0.003, 0.05}[seed % 3]};
    o.direction = degrees(std::vector{0.0, 90.0, 33.0, 180.0}[static_cast<std::size_t>(way)]);
    o.constant_scallop = way == 3;
    o.scallop_limit = Millimetres{0.3};
    const Program p = milled(ground, o);
    const Deviation d = deviation(p, ground, radius, 0.01);
    EXPECT_LE(d.deepest, p.report.certified_gouge_mm);
    EXPECT_LE(d.highest, p.report.certified_excess_mm);
    EXPECT_LE(p.report.certified_gouge_mm, 0.49 * o.tolerance.value() + 1e-12);
    if (!walls() && way != 2) {  // the steps of an angle are too long for 3 um on rough ground
      EXPECT_LE(p.report.certified_excess_mm, 0.9 * o.tolerance.value() + 1e-12);
    }
    if (kind == Ground::rough && way < 2) {
      EXPECT_GT(p.report.arcs, 0U);
      // The bound is not idle: most of it is used.
      EXPECT_GE(d.deepest, 0.5 * p.report.certified_gouge_mm);
      EXPECT_GE(d.highest, 0.5 * p.report.certified_excess_mm);
    }
    double low = INFINITY, high = -INFINITY;
    for (const Move& m : p.cuts())
      for (const Vec3& place : places_of(m, 0.05)) {
        low = std::min(low, place.z);
        high = std::max(high, place.z);
      }
    // Arcs may be read with the radius of either end.
    EXPECT_NEAR(low, p.report.lowest_tip_mm, 1.1e-3);
    EXPECT_NEAR(high, p.report.highest_tip_mm, 1.1e-3);
  }
}

INSTANTIATE_TEST_SUITE_P(Seeds, PathOnTerrain,
                         testing::Combine(testing::ValuesIn(testing_support::kGrounds),
                                          testing::Range(1, 4)),
                         [](const auto& param) {
                           return std::string(testing_support::name(std::get<0>(param.param))) +
                                  "_seed" + std::to_string(std::get<1>(param.param));
                         });

// ---- text ------------------------------------------------------------------------------

TEST(Mill, ProgramSaysWhatItIsAndBlendsByItsShare) {
  const std::string text = milled(flat_field(3, 3, 0.5, 1.0F), {}).text;
  for (const char* word : {"G64 P0.001 Q0", "T1 M6", "G43 H1", "S18000 M3", "M30\n",
                           "gouge of the path at most 0.0050 mm, with blending 0.0060 in space"})
    EXPECT_THAT(text, HasSubstr(word));
}

TEST(Mill, PathAndBlendingStayInTheTolerance) {
  for (const double t : {0.001, 0.003, 0.01, 1.0}) {
    const ToleranceShares s = share_tolerance(Millimetres{t});
    EXPECT_LE(s.gouge_mm, 0.5 * t);
    EXPECT_LE(s.excess_mm + s.blending_mm, t * (1.0 + 1e-12));
    EXPECT_LE(s.gouge_mm + s.blending_mm, t);
    // A proof of the program as read back finds room above what its moves may take.
    EXPECT_LT(s.sampling_mm + s.fitting_mm, 0.995 * s.gouge_mm);
  }
}

TEST(Mill, EveryPostGetsTheSamePath) {
  const ModelField field = testing_support::ground(Ground::rough, 9, 24, 0.5);
  MillOptions o;
  const Program linuxcnc = milled(field, o);
  for (const char* post : {"grbl", "fanuc", "haas"}) {
    o.post = post;
    const Program other = milled(field, o);
    const auto a = linuxcnc.cuts(), b = other.cuts();
    ASSERT_EQ(a.size(), b.size()) << post;
    for (std::size_t i = 0; i < a.size(); ++i) {
      EXPECT_EQ(a[i].motion, b[i].motion);
      EXPECT_EQ(a[i].to, b[i].to) << "nothing is rounded once more";
    }
  }
}

TEST(Mill, ReportCountsWhatWasWritten) {
  const ModelField field = testing_support::ground(Ground::rough, 8, 40, 0.5);
  const Program p = milled(field, {});
  EXPECT_EQ(p.report.bytes, p.text.size());
  EXPECT_EQ(p.report.blocks,
            static_cast<std::uint64_t>(std::count(p.text.begin(), p.text.end(), '\n')));
  double length = 0.0, time = 0.0, shortest = INFINITY, rapid = 0.0;
  std::uint64_t lines = 0, arcs = 0;
  std::vector<double> seconds;
  for (const Move& m : p.moves) {
    const auto places = places_of(m, 0.0005);
    double own = 0.0;  // of arcs the first of three ways
    for (std::size_t i = 1; i < (m.motion < 2 ? places.size() : places.size() / 3); ++i)
      own += norm(places[i] - places[i - 1]);
    if (m.motion == 0) {
      if (!std::isnan(own)) rapid += own;
      continue;
    }
    ++(m.motion == 1 ? lines : arcs);
    length += own;
    time += own / m.feed;
    shortest = std::min(shortest, own);
    seconds.push_back(60.0 * own / m.feed);
  }
  EXPECT_EQ(p.report.lines, lines);
  EXPECT_EQ(p.report.arcs, arcs);
  EXPECT_NEAR(p.report.path_length_mm, length, 1e-6 * length);
  EXPECT_NEAR(p.report.cutting_time_min, time, 1e-6 * time);
  EXPECT_NEAR(p.report.shortest_move_mm, shortest, 1e-6);
  EXPECT_NEAR(p.report.rapid_length_mm, rapid, 20.0);  // the way from unknown is not counted
  double rate = 0.0;
  for (std::size_t i = 32; i <= seconds.size(); ++i) {
    double sum = 0.0;
    for (std::size_t k = i - 32; k < i; ++k) sum += seconds[k];
    rate = std::max(rate, 32.0 / sum);
  }
  EXPECT_NEAR(p.report.highest_block_rate_per_s, rate, 1e-6 * rate);
  EXPECT_EQ(p.report.passes, 40U);
  EXPECT_GT(p.report.points_sampled, 40U * 40U);
}

TEST(Mill, SameBytesForAnyNumberOfThreads) {
  const ModelField field = testing_support::ground(Ground::rough, 21, 160, 0.5);
  std::vector<std::string> texts;
  for (const std::size_t threads : {1U, 3U}) {
    const oneapi::tbb::global_control limit(oneapi::tbb::global_control::max_allowed_parallelism,
                                            threads);
    texts.push_back(milled(field, {}).text);
  }
  EXPECT_TRUE(texts[0] == texts[1]);
}

// ---- errors ------------------------------------------------------------------------------

class MillErrors : public testing::Test {
 protected:
  ScratchFolder folder;
  MillOptions o;
  ModelField field = flat_field(9, 11, 0.5, 1.0F);
  [[nodiscard]] Result<MillReport> result() { return mill(field, o, folder / "part.ngc"); }
  void TearDown() override {
    EXPECT_TRUE(std::filesystem::is_empty(folder.path())) << "something was left behind";
  }
};

constexpr double kBad[] = {0.0, -1.0, NAN, INFINITY};

TEST_F(MillErrors, Tool) {
  for (const double v : kBad) {
    o.ball_diameter = Millimetres{v};
    EXPECT_THAT(result(), FailsWith(kToolNotPositive));
  }
}
TEST_F(MillErrors, Stepover) {
  for (const double v : {0.0, -1.0, double{NAN}, double{INFINITY}, 6.001, 0.0005}) {
    o.stepover = Millimetres{v};
    EXPECT_THAT(result(), FailsWith(kStepoverOutOfRange));
  }
}
TEST_F(MillErrors, Tolerance) {
  for (const double v : {0.0, -1.0, double{NAN}, double{INFINITY}, 0.0009, 1.1}) {
    o.tolerance = Millimetres{v};
    EXPECT_THAT(result(), FailsWith(kToleranceOutOfRange));
  }
}
TEST_F(MillErrors, Feeds) {
  for (const double v : kBad) {
    o = {};
    o.feed = FeedRate{v};
    EXPECT_THAT(result(), FailsWith(kFeedOutOfRange));
    o = {};
    o.plunge_feed = FeedRate{v};
    EXPECT_THAT(result(), FailsWith(kFeedOutOfRange));
    o = {};
    o.spindle_rpm = v;
    EXPECT_THAT(result(), FailsWith(kFeedOutOfRange));
  }
}
TEST_F(MillErrors, OtherOptions) {
  o.clearance = Millimetres{-1.0};
  EXPECT_THAT(result(), FailsWith(kMillOptionOutOfRange));
  o = {};
  o.work_offset = 60;
  EXPECT_THAT(result(), FailsWith(kProgramOptionOutOfRange));
  o = {};
  for (const double v : {0.0, -0.1, double{NAN}, 3.1}) {
    o.scallop_limit = Millimetres{v};
    EXPECT_THAT(result(), FailsWith(kMillOptionOutOfRange));
  }
  o = {};
  o.stock_allowance = Millimetres{-1.0};
  EXPECT_THAT(result(), FailsWith(kMillOptionOutOfRange));
  o = {};
  o.lead_radius = Millimetres{-1.0};
  EXPECT_THAT(result(), FailsWith(kMillOptionOutOfRange));
  o = {};
  o.direction = Radians{NAN};
  EXPECT_THAT(result(), FailsWith(kMillOptionOutOfRange));
  o = {};
  o.first_y_mm = 3.0;
  o.last_y_mm = 2.0;
  EXPECT_THAT(result(), FailsWith(kMillOptionOutOfRange));
  o.last_y_mm = 4.1;  // the field ends at 4
  EXPECT_THAT(result(), FailsWith(kMillOptionOutOfRange));
}
TEST_F(MillErrors, VoidNamesItsPlace) {
  for (const float v : {NAN, INFINITY}) {
    field.z_mm(3, 7) = v;
    const auto r = result();
    EXPECT_THAT(r, FailsWith(kHeightNotFinite));
    EXPECT_THAT(r.error().message, HasSubstr("row 3, column 7"));
  }
}
TEST_F(MillErrors, VoidOfTheStock) {
  ModelField stock = flat_field(9, 11, 0.5, 2.0F);
  stock.z_mm(4, 5) = NAN;
  o.stock = &stock;
  const auto r = result();
  EXPECT_THAT(r, FailsWith(kHeightNotFinite));
  EXPECT_THAT(r.error().message, HasSubstr("stock"));
}
TEST_F(MillErrors, PostIsUnknownAndTheKnownOnesAreNamed) {
  o.post = "abacus";
  const auto r = result();
  EXPECT_THAT(r, FailsWith(kUnknownPost));
  EXPECT_THAT(r.error().message, HasSubstr("linuxcnc, grbl"));
}
TEST_F(MillErrors, TheSinksErrorEndsTheWork) {
  int pieces = 0;
  const auto r = mill_passes(field, o, [&](const Toolpath&) -> Result<void> {
    return ++pieces < 3 ? Result<void>{} : fail(kDiskFull, "no more");
  });
  EXPECT_THAT(r, FailsWith(kDiskFull));
  EXPECT_EQ(pieces, 3);
}
TEST_F(MillErrors, Cancelled) {
  std::stop_source stop;
  stop.request_stop();
  RunContext run;
  run.stop = stop.get_token();
  EXPECT_THAT(mill(field, o, folder / "part.ngc", run), FailsWith(kCancelled));
}
TEST_F(MillErrors, FolderIsMissing) {
  EXPECT_THAT(mill(field, o, folder / "nowhere/part.ngc"), FailsWith(kFileNotWritable));
}

}  // namespace
}  // namespace maquette::cnc

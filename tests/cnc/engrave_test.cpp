// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in cnc/engrave.hpp and probing.hpp, and how each claim is attacked:
//
//   seat ......................... every sunk vertex of the stone, and the gap around it, is inside
//                                  the border and above the floor; convex
//   pocket ....................... nodes inside and outside; milled by rest_finish point by point:
//                                  floor reached, surroundings untouched
//   outline ...................... depth of the groove on a plane and on ground, milled point by
//                                  point; nowhere deeper than said, within the chord bound; place
//   no rapid through stock ....... milled point by point
//   offset on a block ............ a small machine of this test runs the text on a block that is
//                                  somewhere else, with an axis that runs on after contact
//   spheres ...................... the same machine; contacts lie on the sphere
//   LinuxCNC takes the text ...... its own interpreter, where it is there
//   sphere seat .................. moves dense along the helix: wall, floor, angle, closed form
//   errors

#include "cnc/engrave.hpp"

#include <fstream>
#include <map>
#include <numbers>
#include <sstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cnc/cutter_location.hpp"
#include "cnc/probed_spheres.hpp"
#include "cnc/probing.hpp"
#include "rs274_peer.hpp"
#include "support/matchers.hpp"
#include "support/milled_stock.hpp"
#include "support/terrain.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;
using maquette::testing_support::FailsWith;
using maquette::testing_support::flat_field;
using maquette::testing_support::Ground;
using maquette::testing_support::MilledStock;
using maquette::testing_support::ScratchFolder;

meshing::PlacedStone stone(int number, double x, double y, double z, double diameter,
                           std::uint64_t seed) {
  meshing::PlacedStone s;
  s.number = number;
  s.shape.seed = seed;
  s.shape.subdivisions = 3;
  s.scale_mm = diameter;
  s.model_from_stone.rotation = rotation_about(normalized(Vec3{0.3, -0.2, 1.0}), 0.8);
  s.model_from_stone.translation_mm = {x, y, z};
  return s;
}

bool within(const std::vector<std::array<double, 2>>& border, double x, double y) {
  for (std::size_t i = 0; i < border.size(); ++i) {
    const auto &a = border[i], &b = border[(i + 1) % border.size()];
    if ((b[0] - a[0]) * (y - a[1]) - (b[1] - a[1]) * (x - a[0]) < -1e-9) return false;
  }
  return true;
}

TEST(Seats, HoldTheSunkPartOfTheStoneAndTheGap) {
  const ModelField ground = maquette::testing_support::ground(Ground::rolling, 6, 81, 0.5);
  const std::vector stones{stone(3, 12.0, 14.0, 7.0, 9.0, 1), stone(5, 25.0, 30.0, 60.0, 6.0, 2)};
  const double gap = 0.6, bed = 0.2;
  const auto seats = stone_seats(ground, stones, gap, bed);
  ASSERT_EQ(seats.size(), 1U) << "the other one hangs in the air";
  EXPECT_EQ(seats[0].stone, 3);
  double lowest = INFINITY, nearest = INFINITY;
  for (const Vec3& v : meshing::stone_mesh(stones[0]).vertices_mm) {
    if (v.z >= heightmap::height_at(ground, v.x, v.y)) continue;
    lowest = std::min(lowest, v.z);
    for (int k = 0; k < 60; ++k) {
      const double t = 2.0 * std::numbers::pi * k / 60.0;
      EXPECT_TRUE(within(seats[0].border_mm, v.x + gap * std::cos(t), v.y + gap * std::sin(t)));
      // Not wider than the polygon around the circle makes it.
      if (!within(seats[0].border_mm, v.x + 1.01 * gap * std::cos(t),
                  v.y + 1.01 * gap * std::sin(t)))
        nearest = 0.0;
    }
  }
  EXPECT_EQ(nearest, 0.0);
  EXPECT_DOUBLE_EQ(seats[0].floor_mm, lowest - bed);
}

TEST(Seats, PocketsAreMilledToTheirFloorAndNothingElse) {
  const ModelField ground = maquette::testing_support::ground(Ground::rolling, 6, 81, 0.5);
  const std::vector stones{stone(1, 14.0, 16.0, 6.0, 10.0, 4)};
  const auto seats = stone_seats(ground, stones, 1.2, 0.1);
  ASSERT_EQ(seats.size(), 1U);
  const ModelField seated = with_seats(ground, seats);
  for (std::ptrdiff_t r = 0; r < 81; ++r)
    for (std::ptrdiff_t c = 0; c < 81; ++c) {
      const bool in = within(seats[0].border_mm, ground.x_mm(c), ground.y_mm(r));
      EXPECT_EQ(seated.z_mm(r, c),
                in ? std::min(ground.z_mm(r, c), static_cast<float>(seats[0].floor_mm))
                   : ground.z_mm(r, c));
    }
  RestOptions o;
  o.arcs = false;
  o.ball_radius_mm = 1.0;
  Toolpath path;
  const auto report =
      rest_finish(seated, seat_map(ground, seated), o, [&](const Toolpath& piece) -> Result<void> {
        if (path.moves.empty()) path.start = piece.start;
        path.moves.insert(path.moves.end(), piece.moves.begin(), piece.moves.end());
        return {};
      });
  ASSERT_TRUE(report) << report.error().message;
  ASSERT_GT(report->layers, 0);
  MilledStock stock(ground.x0.value(), ground.y0.value(), 0.25, 161, 161,
                    [&](double x, double y) { return heightmap::height_at(ground, x, y); });
  stock.mill(path, Cutter::ball(1.0), 0.1);
  EXPECT_EQ(stock.deepest_rapid, 0.0);
  int floor = 0;
  for (std::ptrdiff_t r = 0; r < 81; ++r)
    for (std::ptrdiff_t c = 0; c < 81; ++c) {
      const double z = stock.z()(2 * r, 2 * c);
      EXPECT_GE(z, static_cast<double>(seated.z_mm(r, c)) - report->certified_gouge_mm - 1e-6);
      bool open = true;  // a ball's radius and a cell from the border
      for (int k = 0; k < 16; ++k)
        open = open && within(seats[0].border_mm, ground.x_mm(c) + 1.75 * std::cos(0.3927 * k),
                              ground.y_mm(r) + 1.75 * std::sin(0.3927 * k));
      if (!open) continue;
      ++floor;
      // Ridges of rows 0.2 mm apart: 0.1^2 / 2 r; and the tolerance.
      EXPECT_LE(z, std::min(seats[0].floor_mm, static_cast<double>(ground.z_mm(r, c))) + 0.016);
    }
  EXPECT_GT(floor, 20);
}

TEST(Outlines, AreAsDeepAsSaid) {
  for (const bool plane : {true, false}) {
    ModelField ground = maquette::testing_support::ground(Ground::rolling, 6, 81, 0.5);
    if (plane)
      for (std::ptrdiff_t r = 0; r < 81; ++r)
        for (std::ptrdiff_t c = 0; c < 81; ++c)
          ground.z_mm(r, c) = static_cast<float>(0.75 * ground.x_mm(c));
    Seat seat;
    seat.border_mm = {{5.0, 8.0}, {24.0, 10.0}, {18.0, 27.0}, {7.0, 20.0}};
    Seat at_the_edge;  // partly outside
    at_the_edge.border_mm = {{30.0, 30.0}, {60.0, 31.0}, {34.0, 36.0}};
    const std::vector seats{seat, at_the_edge};
    EngraveOptions o;
    const auto path = engrave_outlines(ground, seats, o);
    ASSERT_TRUE(path) << path.error().message;
    ASSERT_GT(path->moves.size(), 500U);
    DropCutter cutter(ground, Cutter::ball(o.ball_radius_mm));
    const double normal = o.ball_radius_mm - std::sqrt(o.ball_radius_mm * o.ball_radius_mm -
                                                       0.25 * o.chord_mm * o.chord_mm);
    ToolPosition at = path->start;
    double deepest = 0.0, shallowest = INFINITY;
    for (const PathMove& m : path->moves) {
      const bool cut = m.kind == PathMove::Kind::line && (m.to.x != at.x || m.to.y != at.y);
      for (int i = 0; cut && i <= 4; ++i) {
        const double t = 0.25 * i;
        const auto mix = [t](std::int64_t a, std::int64_t b) {
          return mm_of_ticks(a) + t * mm_of_ticks(b - a);
        };
        const double x = mix(at.x, m.to.x), y = mix(at.y, m.to.y);
        const double depth = cutter.drop(x, y).tip_mm - mix(at.z, m.to.z);
        deepest = std::max(deepest, depth), shallowest = std::min(shallowest, depth);
      }
      at = m.to;
    }
    // On slopes up to 60 degrees twice the bound in space, vertically.
    EXPECT_LE(deepest, o.depth_mm + 2.0 * normal);
    EXPECT_GE(shallowest, o.depth_mm - 0.25 * o.chord_mm) << "a chord across sides of 45 degrees";
    MilledStock stock(ground.x0.value(), ground.y0.value(), 0.1, 401, 401,
                      [&](double x, double y) { return heightmap::height_at(ground, x, y); });
    stock.mill(*path, Cutter::ball(o.ball_radius_mm), 0.1);
    EXPECT_EQ(stock.deepest_rapid, 0.0);
    // Every corner and middle of the border is cut, and nothing a millimetre away.
    for (std::size_t i = 0; i < 4; ++i) {
      const auto &a = seat.border_mm[i], &b = seat.border_mm[(i + 1) % 4];
      const double x = 0.5 * (a[0] + b[0]), y = 0.5 * (a[1] + b[1]);
      const auto cut_at = [&](double px, double py) {
        const auto r = std::lround((py - ground.y0.value()) / 0.1);
        const auto c = std::lround((px - ground.x0.value()) / 0.1);
        return heightmap::height_at(ground, stock.x(c), stock.y(r)) - stock.z()(r, c);
      };
      EXPECT_GT(cut_at(x, y), 0.5 * o.depth_mm);
      const double h = std::hypot(b[0] - a[0], b[1] - a[1]);
      EXPECT_EQ(cut_at(x - (b[1] - a[1]) / h, y + (b[0] - a[0]) / h), 0.0);
      EXPECT_EQ(cut_at(x + (b[1] - a[1]) / h, y - (b[0] - a[0]) / h), 0.0);
    }
  }
}

TEST(Outlines, RefuseWhatMakesNoSense) {
  const ModelField ground = flat_field(21, 21, 0.5, 0.0F);
  const std::vector<Seat> none;
  EXPECT_TRUE(engrave_outlines(ground, none, {})->moves.empty());
  const auto with = [&](auto change) {
    EngraveOptions o;
    change(o);
    return engrave_outlines(ground, none, o);
  };
  const auto code = kEngraveOptionOutOfRange;  // CNC_ENGRAVE_OPTION_OUT_OF_RANGE
  EXPECT_THAT(with([](auto& o) { o.ball_radius_mm = 0.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.depth_mm = 0.6; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.chord_mm = 0.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.feed_mm_min = NAN; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.plunge_feed_mm_min = 0.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o) { o.clearance_mm = -1.0; }), FailsWith(code));
  ModelField hole = ground;
  hole.z_mm(2, 2) = NAN;
  EXPECT_THAT(engrave_outlines(hole, none, {}), FailsWith(kHeightNotFinite));
}

// ---- a small machine with a probe ---------------------------------------------------------

/// Runs blocks of G0, G38.2, G90, G91, G10 L2 and L20 (G54 alone). Machine coordinates are work
/// coordinates plus the offset.
class ProbingMachine {
 public:
  /// Distance of the probe's centre from the solid, less the ball's radius; machine coordinates.
  std::function<double(Vec3)> gap;
  double ball = 1.0, overrun = 0.0;  ///< mm it moves on after contact
  std::map<int, double> parameter;
  std::array<double, 3> at{};  ///< tip, machine
  std::vector<Vec3> contacts;  ///< tip, work
  std::string trouble;

  void run(const std::string& text) {
    std::istringstream lines(text);
    std::string line;
    while (std::getline(lines, line)) {
      if (!line.empty() && line[0] != '(') block(line);
    }
  }

 private:
  double& offset(std::size_t axis) { return parameter[5221 + static_cast<int>(axis)]; }

  double value(const std::string& s) const {
    if (s[0] != '[') return std::stod(s);
    // "[#a + #b - [c]]"
    int a = 0, b = 0;
    double c = 0.0;
    EXPECT_EQ(std::sscanf(s.c_str(), "[#%d + #%d - [%lf]]", &a, &b, &c), 3) << s;
    return parameter.at(a) + parameter.at(b) - c;
  }

  void block(const std::string& line) {
    std::map<char, std::string> words;
    std::vector<std::string> codes;
    for (std::size_t i = 0; i < line.size();) {
      const char letter = line[i++];
      if (letter == ' ') continue;
      std::size_t end = i;
      if (line[i] == '[') {
        int depth = 0;
        do {
          depth += line[end] == '[' ? 1 : line[end] == ']' ? -1 : 0;
          ++end;
        } while (depth > 0);
      } else {
        end = std::min(line.find(' ', i), line.size());
      }
      const std::string word = line.substr(i, end - i);
      if (letter == 'G') {
        codes.push_back(word);
      } else {
        words[letter] = word;
      }
      i = end;
    }
    int motion = -1;
    bool ten = false;
    for (const std::string& g : codes) {
      if (g == "90" || g == "91") {
        relative_ = g == "91";
      } else if (g == "0" || g == "38.2") {
        motion = g == "0" ? 0 : 38;
      } else if (g == "10") {
        ten = true;
      } else {
        trouble += "G" + g + " ";
      }
    }
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const char letter = static_cast<char>('X' + axis);
      if (!words.contains(letter)) continue;
      const double v = value(words[letter]);
      if (ten) {
        EXPECT_EQ(words['P'], "1");
        offset(axis) = words['L'] == "2" ? v : at[axis] - v;
      } else {
        target_[axis] = relative_ ? at[axis] + v : offset(axis) + v;
      }
    }
    if (motion >= 0) move(motion == 38);
    target_ = at;
  }

  void move(bool probing) {
    const std::array<double, 3> from = at;
    const double length =
        std::hypot(target_[0] - from[0], target_[1] - from[1], target_[2] - from[2]);
    const auto place = [&](double s) {
      std::array<double, 3> p{};
      for (std::size_t k = 0; k < 3; ++k)
        p[k] = from[k] + (length > 0.0 ? s / length : 0.0) * (target_[k] - from[k]);
      return p;
    };
    const auto clear = [&](double s) {
      const auto p = place(s);
      return gap({p[0], p[1], p[2] + ball}) - ball;
    };
    double s = 0.0;
    while (s < length) {  // never farther than the gap
      const double free = clear(s);
      if (free < 1e-7) {
        if (clear(s + 1e-3) <= free) break;
        s += 1e-3;  // moving out of contact
        continue;
      }
      s = std::min(length, s + free);
    }
    const bool touched = s < length;
    if (touched && !probing) trouble += "rapid touches; ";
    if (!touched && probing) trouble += "probe finds nothing; ";
    const auto p = place(s);
    if (probing) {
      for (std::size_t k = 0; k < 3; ++k) parameter[5061 + static_cast<int>(k)] = p[k] - offset(k);
      contacts.push_back({p[0] - offset(0), p[1] - offset(1), p[2] - offset(2)});
    }
    at = place(std::min(length, s + (probing ? overrun : 0.0)));
  }

  bool relative_ = false;
  std::array<double, 3> target_{};
};

/// Distance from the quarter space x > x0, y > y0, z < z0.
double gap_to_block(Vec3 p, Vec3 corner) {
  const double dx = corner.x - p.x, dy = corner.y - p.y, dz = p.z - corner.z;
  const double outside = std::hypot(std::max(0.0, dx), std::max(0.0, dy), std::max(0.0, dz));
  return outside > 0.0 ? outside : std::max({dx, dy, dz});
}

TEST(Probing, SetsTheOffsetOnTheBlocksCorner) {
  for (const std::string post : {"linuxcnc", "grbl"}) {
    BlockCorner corner;
    corner.x_mm = -3.0, corner.y_mm = 4.5, corner.top_mm = 80.0;
    ProbingOptions o;
    o.post = post;
    o.ball_radius_mm = 1.5;
    const auto text = probe_block_corner(corner, o);
    ASSERT_TRUE(text) << text.error().message;
    ProbingMachine machine;
    machine.ball = 1.5;
    machine.overrun = post == "linuxcnc" ? 0.07 : 0.0;
    // The offset says (100, 200, -50); the block is off by less than the search.
    machine.parameter = {{5221, 100.0}, {5222, 200.0}, {5223, -50.0}};
    const Vec3 truth{100.0 - 3.0 + 6.25, 200.0 + 4.5 - 4.75, -50.0 + 80.0 - 7.5};
    machine.gap = [&](Vec3 p) { return gap_to_block(p, truth); };
    machine.at = {50.0, 50.0, 300.0};
    machine.run(*text);
    EXPECT_EQ(machine.trouble, "");
    EXPECT_NEAR(machine.parameter[5221], 106.25, 2e-4);  // the text has four decimals
    EXPECT_NEAR(machine.parameter[5222], 195.25, 2e-4);
    EXPECT_NEAR(machine.parameter[5223], -57.5, 2e-4);
    EXPECT_EQ(machine.contacts.size(), 6U);
  }
}

TEST(Probing, NumbersTheOffsetsAsLinuxCncDoes) {
  ProbingOptions o;
  o.work_offset = 593;
  EXPECT_THAT(*probe_block_corner({}, o),
              testing::HasSubstr("G10 L2 P9 Z[#5383 + #5063 - [0.0000]]"));
  o.work_offset = 55;
  EXPECT_THAT(*probe_block_corner({}, o), testing::HasSubstr("G10 L2 P2 X[#5241 + #5061 - ["));
}

TEST(Probing, TouchesSpheresOnFiveSides) {
  const std::vector<Vec3> planned{{10.0, 20.0, 30.0}, {500.0, 20.0, 45.0}, {10.0, 700.0, 28.0}};
  const Vec3 off{3.0, -4.0, 2.5};
  const double radius = 12.5;
  ProbingOptions o;
  const auto text = probe_spheres(planned, radius, "spheres.txt", o);
  ASSERT_TRUE(text) << text.error().message;
  EXPECT_THAT(*text, testing::StartsWith("(PROBEOPEN spheres.txt)\n"));
  EXPECT_THAT(*text, testing::EndsWith("(PROBECLOSE)\n"));
  ProbingMachine machine;
  machine.parameter = {{5221, 0.0}, {5222, 0.0}, {5223, 0.0}};
  machine.overrun = 0.05;
  machine.gap = [&](Vec3 p) {
    double least = INFINITY;
    for (const Vec3& c : planned) least = std::min(least, norm(p - (c + off)) - radius);
    return least;
  };
  machine.at = {0.0, 0.0, 200.0};
  machine.run(*text);
  EXPECT_EQ(machine.trouble, "");
  ASSERT_EQ(machine.contacts.size(), 30U);
  for (std::size_t k = 0; k < 30; ++k) {
    const Vec3 centre = machine.contacts[k] + Vec3{0.0, 0.0, o.ball_radius_mm};
    EXPECT_NEAR(norm(centre - (planned[k / 10] + off)), radius + o.ball_radius_mm, 1e-6);
  }
  // What was touched says where they are, however far that is off the plan.
  const auto found =
      spheres_of_contacts(machine.contacts, planned, radius, o.ball_radius_mm, o.search_mm);
  ASSERT_TRUE(found) << found.error().message;
  for (std::size_t k = 0; k < 3; ++k) {
    EXPECT_NEAR(norm((*found)[k].centre_mm - (planned[k] + off)), 0.0, 2e-6);  // of the machine
    EXPECT_LT((*found)[k].residual_mm, 2e-6);
  }
}

TEST(Probing, FindsTheSpheresThatWereTouched) {
  // Exact touches of a sphere off its plan, fast ones late: 1e-9 mm.
  const double radius = 8.0, ball = 1.5;
  const Vec3 plan{100.0, -20.0, 30.0}, centre = plan + Vec3{1.5, -2.25, 0.75};
  const auto touches = [&](double sphere, double probe) {
    std::vector<Vec3> tips;
    const double reach = sphere + probe;
    const auto add = [&](Vec3 touching, Vec3 late) {
      tips.push_back(touching - Vec3{0.0, 0.0, probe} + late);
      tips.push_back(touching - Vec3{0.0, 0.0, probe});
    };
    const Vec3 d = plan - centre;
    const double up = std::sqrt(reach * reach - d.x * d.x - d.y * d.y);
    add({plan.x, plan.y, centre.z + up}, {0.0, 0.0, -0.3});
    const double along_x = std::sqrt(reach * reach - d.y * d.y - d.z * d.z);
    const double along_y = std::sqrt(reach * reach - d.x * d.x - d.z * d.z);
    for (const double side : {-1.0, 1.0})
      add({centre.x + side * along_x, plan.y, plan.z}, {-0.3 * side, 0.0, 0.0});
    for (const double side : {-1.0, 1.0})
      add({plan.x, centre.y + side * along_y, plan.z}, {0.0, -0.3 * side, 0.0});
    return tips;
  };
  const std::vector<Vec3> planned{plan};
  const auto fit = [&](const std::vector<Vec3>& tips, double probe) {
    return spheres_of_contacts(tips, planned, radius, probe, 10.0);
  };
  const auto exact = fit(touches(radius, ball), ball);
  ASSERT_TRUE(exact) << exact.error().message;
  EXPECT_LT(norm((*exact)[0].centre_mm - centre), 1e-9);
  EXPECT_LT((*exact)[0].residual_mm, 1e-9);
  // A ball of another radius: what the header says.
  const double d = 0.02;
  const auto other = fit(touches(radius, ball), ball + d);
  ASSERT_TRUE(other) << other.error().message;
  EXPECT_LE(norm((*other)[0].centre_mm - centre), 1.2 * d);
  EXPECT_GT((*other)[0].residual_mm, 0.6 * d);
  // Refused: CNC_PROBED_CONTACTS
  EXPECT_THAT(fit(touches(radius, ball), ball + 0.5), FailsWith(kProbedContacts));
  auto chip = touches(radius, ball);
  chip[5].x += 0.2;
  EXPECT_THAT(fit(chip, ball), FailsWith(kProbedContacts));
  chip = touches(radius, ball);
  chip[4].x += 0.2;  // a fast touch: does not count
  EXPECT_TRUE(fit(chip, ball));
  chip.pop_back();
  EXPECT_THAT(fit(chip, ball), FailsWith(kProbedContacts));
  EXPECT_THAT(spheres_of_contacts(touches(radius, ball), planned, radius, ball, 2.0),
              FailsWith(kProbedContacts));
  const ScratchFolder folder;
  std::ofstream(folder / "c.txt") << "1 2 3 0 0 0 0 0 0\n\n-4.5 5e1 6 0 0 0\n";
  const auto read = read_contacts(folder / "c.txt");
  ASSERT_TRUE(read);
  EXPECT_EQ(*read, (std::vector<Vec3>{{1.0, 2.0, 3.0}, {-4.5, 50.0, 6.0}}));
  std::ofstream(folder / "c.txt") << "1 2 3\n1 2\n";
  const auto bad = read_contacts(folder / "c.txt");
  EXPECT_THAT(bad, FailsWith(kProbedContacts));
  EXPECT_THAT(bad.error().message, testing::HasSubstr("c.txt:2"));
}

TEST(Probing, StaysAsHighAsItMust) {
  ProbingOptions o;
  o.over_mm = 123.5;
  EXPECT_THAT(*probe_spheres(std::vector<Vec3>{{0.0, 0.0, 30.0}}, 10.0, "s", o),
              testing::HasSubstr("G0 Z123.5000\n"));
}

TEST(Probing, LinuxCncReadsTheBlocks) {
  const auto linuxcnc = cnc::testing_support::linuxcnc_folder();
  if (!linuxcnc) GTEST_SKIP() << "rs274 is not here; tools/setup --peers gets it";
  const ScratchFolder folder;
  const std::vector<Vec3> spheres{{10.0, 20.0, 30.0}};
  const std::string program = "G21 G17 G90 G94 G54\n" + *probe_block_corner({}, {}) +
                              *probe_spheres(spheres, 12.5, "s.txt", {}) + "M2\n";
  std::ofstream(folder / "probe.ngc") << program;
  const auto canon =
      cnc::testing_support::run_rs274(*linuxcnc, folder / "probe.ngc", folder.path());
  EXPECT_EQ(canon.exit_code, 0) << canon.messages;
  EXPECT_EQ(canon.messages, "");
  EXPECT_TRUE(canon.ended);
  int probes = 0;
  for (const auto& m : canon.motions)
    probes += m.kind == cnc::testing_support::CanonMotion::Kind::probe ? 1 : 0;
  EXPECT_EQ(probes, 16);
}

TEST(Probing, RefusesWhatMakesNoSense) {
  const auto with = [&](auto change) {
    ProbingOptions o;
    BlockCorner corner;
    change(o, corner);
    return probe_block_corner(corner, o);
  };
  const auto code = kProbingOptionOutOfRange;  // CNC_PROBING_OPTION_OUT_OF_RANGE
  EXPECT_THAT(with([](auto& o, auto&) { o.ball_radius_mm = 0.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o, auto&) { o.search_mm = NAN; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o, auto&) { o.retract_mm = 10.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o, auto&) { o.fast_feed_mm_min = 0.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o, auto&) { o.slow_feed_mm_min = 300.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o, auto&) { o.work_offset = 60; }), FailsWith(code));
  EXPECT_THAT(with([](auto& o, auto&) { o.post = "grbl", o.work_offset = 591; }), FailsWith(code));
  EXPECT_THAT(with([](auto&, auto& c) { c.top_mm = NAN; }), FailsWith(code));
  EXPECT_THAT(with([](auto&, auto& c) { c.depth_mm = 0.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto&, auto& c) { c.inset_mm = 0.0; }), FailsWith(code));
  // CNC_PROBING_NOT_POSSIBLE
  EXPECT_THAT(with([](auto& o, auto&) { o.post = "haas"; }), FailsWith(kProbingNotPossible));
  ProbingOptions grbl;
  grbl.post = "grbl";
  EXPECT_THAT(probe_spheres({}, 10.0, "s", grbl), FailsWith(kProbingNotPossible));
  EXPECT_THAT(probe_spheres({}, 0.0, "s", {}), FailsWith(code));
}

// ---- seats of spheres ------------------------------------------------------------------

TEST(SphereSeat, IsABoreOfTheRightSize) {
  SphereSeat seat;
  seat.x_mm = 30.0, seat.y_mm = 40.0, seat.rim_mm = 25.0;
  seat.hole_radius_mm = 6.0, seat.sphere_radius_mm = 10.0, seat.below_mm = 0.5;
  EXPECT_EQ(seated_centre_z_mm(seat), 33.0);  // 6, 8, 10
  BoreOptions o;
  o.cutter_radius_mm = 4.0;
  const auto path = bore_sphere_seat(seat, o);
  ASSERT_TRUE(path) << path.error().message;
  // Arcs as chords of a degree, so that the slow milling takes them.
  Toolpath lines;
  lines.start = path->start;
  ToolPosition at = path->start;
  double steepest = 0.0;
  for (const PathMove& m : path->moves) {
    if (m.kind != PathMove::Kind::arc) {
      lines.moves.push_back(m);
      at = m.to;
      continue;
    }
    const double cx = mm_of_ticks(at.x + m.i), cy = mm_of_ticks(at.y + m.j);
    const double r = std::hypot(mm_of_ticks(m.i), mm_of_ticks(m.j));
    EXPECT_TRUE(m.counter_clockwise);
    EXPECT_EQ(cx, 30.0);
    EXPECT_EQ(cy, 40.0);
    EXPECT_NEAR(std::hypot(mm_of_ticks(m.to.x) - cx, mm_of_ticks(m.to.y) - cy), r, 1e-9);
    steepest = std::max(steepest, std::atan2(mm_of_ticks(at.z - m.to.z), std::numbers::pi * r));
    const double a0 = std::atan2(mm_of_ticks(at.y) - cy, mm_of_ticks(at.x) - cx);
    for (int k = 1; k <= 180; ++k) {
      const double a = a0 + std::numbers::pi * k / 180.0;
      PathMove chord;
      chord.to = {std::llround((cx + r * std::cos(a)) * 1e4),
                  std::llround((cy + r * std::sin(a)) * 1e4), at.z + (m.to.z - at.z) * k / 180};
      lines.moves.push_back(chord);
    }
    at = m.to;
  }
  EXPECT_LE(steepest * 180.0 / std::numbers::pi, o.ramp_angle_deg + 0.01);
  EXPECT_GT(steepest * 180.0 / std::numbers::pi, 0.9 * o.ramp_angle_deg);
  MilledStock stock(20.0, 30.0, 0.1, 201, 201, [](double, double) { return 25.0; });
  stock.mill(lines, Cutter::flat(4.0), 0.1);
  EXPECT_EQ(stock.deepest_rapid, 0.0);
  for (std::ptrdiff_t r = 0; r < 201; ++r)
    for (std::ptrdiff_t c = 0; c < 201; ++c) {
      const double d = std::hypot(stock.x(c) - 30.0, stock.y(r) - 40.0);
      if (d > 6.001) {
        EXPECT_EQ(stock.z()(r, c), 25.0);
      } else if (d < 5.998) {
        EXPECT_NEAR(stock.z()(r, c), 33.0 - 10.0 - 0.5, 0.0011);
      }
    }
  const auto code = kProbingOptionOutOfRange;
  const auto with = [&](auto change) {
    SphereSeat s = seat;
    BoreOptions b = o;
    change(s, b);
    return bore_sphere_seat(s, b);
  };
  EXPECT_THAT(with([](auto& s, auto&) { s.hole_radius_mm = 9.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& s, auto&) { s.sphere_radius_mm = 6.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& s, auto&) { s.below_mm = -1.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto& s, auto&) { s.rim_mm = NAN; }), FailsWith(code));
  EXPECT_THAT(with([](auto&, auto& b) { b.cutter_radius_mm = 0.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto&, auto& b) { b.ramp_angle_deg = 0.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto&, auto& b) { b.feed_mm_min = 0.0; }), FailsWith(code));
  EXPECT_THAT(with([](auto&, auto& b) { b.clearance_mm = -1.0; }), FailsWith(code));
}

}  // namespace
}  // namespace maquette::cnc

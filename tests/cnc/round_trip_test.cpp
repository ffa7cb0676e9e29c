// SPDX-License-Identifier: GPL-3.0-or-later

// What is written is what is meant: random paths go through each post and back through our
// reader, which shares no code with the writer but the table of posts.
//
//   lines end where they should ............ within half a unit of the control's last decimal
//   arcs are the same arcs ................. plane, sense, sweep, centre
//   arcs as lines or chords ................ every corner and the middle of every chord
//                                            against the arc as it was drawn
//   rapids reach their ends and fly free ... below the safe height along one axis, where the
//                                            control does not fly straight
//   increments (G91) ....................... every other path, where the control adds exactly
//   feeds, tools ........................... equal
//   parts ................................. joined again they are the whole
//   programs that break off, or have been
//   trampled on, never crash ............... cut at every 7th byte; bytes changed at random

#include <algorithm>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cnc/gcode_reader.hpp"
#include "cnc/pass_sampler.hpp"
#include "cnc/program.hpp"
#include "core/files.hpp"
#include "random_path.hpp"
#include "support/matchers.hpp"

namespace maquette::cnc {
namespace {

using maquette::testing_support::FailsWith;
using maquette::testing_support::ScratchFolder;
using maquette::testing_support::Succeeds;
using testing_support::random_path;
using testing_support::RandomPath;

constexpr double kSafe_mm = 40.0;

Vec3 mm(ToolPosition p) {
  return {mm_of_ticks(p.x), mm_of_ticks(p.y), mm_of_ticks(p.z)};
}
double unit_mm(const Post& post) {
  return post.decimals == 3 ? 1e-3 : 1e-4;
}
double largest(Vec3 v) {
  return std::max({std::abs(v.x), std::abs(v.y), std::abs(v.z)});
}

Result<std::vector<Motion>> read_all(std::span<const std::filesystem::path> files) {
  std::vector<Motion> motions;
  for (const auto& file : files) {
    MAQUETTE_TRY(const auto summary, read_gcode(file, [&](std::span<const Motion> batch) {
                   motions.insert(motions.end(), batch.begin(), batch.end());
                   return Result<void>{};
                 }));
    EXPECT_TRUE(summary.ended);
  }
  return motions;
}

/// Walks along the moves and the motions side by side.
class Comparison {
 public:
  Comparison(const Post& post, const RandomPath& path, const std::vector<Motion>& motions,
             double chords_mm)
      : post_(post), path_(path), motions_(motions), unit_(unit_mm(post)), chords_(chords_mm) {}

  void run() {
    Vec3 at = mm(path_.moves[0].to);
    for (std::size_t i = 0; i < path_.moves.size() && !testing::Test::HasFailure(); ++i) {
      const PathMove& m = path_.moves[i];
      const Vec3 to = mm(m.to);
      if (m.kind == PathMove::Kind::rapid) {
        rapid(to, i);
      } else if (m.kind == PathMove::Kind::line) {
        if (moves(at, to)) line(to, m.feed_mm_min, i);
      } else {
        arc(at, m, path_.sweep_rad[i], i);
      }
      at = to;
    }
    if (testing::Test::HasFailure()) return;
    // What is left is the retreat.
    for (; next_ < motions_.size(); ++next_) EXPECT_EQ(motions_[next_].kind, Motion::Kind::rapid);
  }
  int arcs = 0, chords = 0, flat = 0;

 private:
  [[nodiscard]] bool moves(Vec3 a, Vec3 b) const {
    const auto r = [&](double v) { return std::round(v / unit_ * (1.0 + 1e-13)); };
    return r(a.x) != r(b.x) || r(a.y) != r(b.y) || r(a.z) != r(b.z);
  }
  bool near(Vec3 a, Vec3 b) const { return largest(a - b) <= 0.5 * unit_ + 1e-9; }

  /// The motions are a chain: where the next one begins.
  [[nodiscard]] Vec3 position() const {
    return next_ < motions_.size() ? motions_[next_].from_mm : motions_.back().to_mm;
  }
  void rapid(Vec3 to, std::size_t i) {
    while (!near(position(), to) && next_ < motions_.size() &&
           motions_[next_].kind == Motion::Kind::rapid) {
      const Motion& m = motions_[next_++];
      const Vec3 d = m.to_mm - m.from_mm;
      const int axes = (d.x != 0.0) + (d.y != 0.0) + (d.z != 0.0);
      if (!post_.straight_rapids && axes > 1) {
        EXPECT_GE(std::min(m.from_mm.z, m.to_mm.z), kSafe_mm) << "move " << i;
      }
    }
    EXPECT_TRUE(near(position(), to)) << "move " << i;
  }

  void line(Vec3 to, double feed, std::size_t i) {
    ASSERT_LT(next_, motions_.size()) << "move " << i;
    const Motion& m = motions_[next_++];
    EXPECT_EQ(m.kind, Motion::Kind::line) << "move " << i;
    EXPECT_TRUE(near(m.to_mm, to))
        << "move " << i << ": " << m.to_mm.x << ' ' << m.to_mm.y << ' ' << m.to_mm.z;
    EXPECT_DOUBLE_EQ(m.feed_mm_min, feed) << "move " << i;
  }

  void arc(Vec3 from, const PathMove& move, double sweep, std::size_t i) {
    const Vec3 centre = from + Vec3{mm_of_ticks(move.i), mm_of_ticks(move.j), mm_of_ticks(move.k)};
    const auto flatten = [&](Vec3 v) {
      return move.plane == ArcPlane::xy   ? Vec3{v.x, v.y, 0.0}
             : move.plane == ArcPlane::zx ? Vec3{v.z, v.x, 0.0}
                                          : Vec3{v.y, v.z, 0.0};
    };
    const Vec3 to = mm(move.to);
    const double radius = norm(flatten(from - centre));
    const double sagitta = radius * (1.0 - std::cos(std::min(0.5 * sweep, std::numbers::pi)));
    if (!moves(from, to) && sagitta <= unit_) return;
    ASSERT_LT(next_, motions_.size()) << "move " << i;
    if (motions_[next_].kind == Motion::Kind::arc) {
      const Motion& m = motions_[next_++];
      ++arcs;
      EXPECT_TRUE(near(m.to_mm, to)) << "move " << i;
      EXPECT_EQ(m.plane, move.plane) << "move " << i;
      EXPECT_EQ(m.sweep_rad > 0.0, move.counter_clockwise) << "move " << i;
      EXPECT_LE(norm(flatten(m.centre_mm - centre)), 1.5 * unit_) << "move " << i;
      // Both ends off by up to 0.7 units, the centre too; a tick for the end as it was drawn.
      EXPECT_NEAR(std::abs(m.sweep_rad) * radius, sweep * radius,
                  (3.0 * unit_ + 1e-4) * (1.0 + sweep))
          << "move " << i;
      EXPECT_DOUBLE_EQ(m.feed_mm_min, move.feed_mm_min);
      return;
    }
    const bool is_flat = sagitta <= 0.51 * unit_ + 1e-5;
    (is_flat ? flat : chords) += 1;
    // From the arc no farther than asked, sideways and along its axis.
    const double allowed = (is_flat ? 0.5 * unit_ : chords_) + 1.5 * unit_ + 2e-4;
    double angle = 0.0;
    const auto on_arc = [&](Vec3 p) {
      const Vec3 arm = flatten(p - centre), start = flatten(from - centre);
      EXPECT_NEAR(norm(arm), radius, allowed) << "move " << i;
      double a = std::atan2(start.x * arm.y - start.y * arm.x, start.x * arm.x + start.y * arm.y);
      if (!move.counter_clockwise) a = -a;
      while (a < angle - 0.5 * std::numbers::pi) a += 2.0 * std::numbers::pi;
      angle = std::max(angle, a);
    };
    for (;;) {
      ASSERT_LT(next_, motions_.size()) << "move " << i;
      const Motion& m = motions_[next_++];
      ASSERT_EQ(m.kind, Motion::Kind::line) << "move " << i;
      EXPECT_DOUBLE_EQ(m.feed_mm_min, move.feed_mm_min) << "move " << i;
      on_arc(0.5 * (m.from_mm + m.to_mm));
      on_arc(m.to_mm);
      if (near(m.to_mm, to) && angle * radius > sweep * radius - allowed - 1e-3) break;
      if (::testing::Test::HasFailure()) break;
    }
    EXPECT_NEAR(angle * radius, sweep * radius, allowed + 1e-3) << "move " << i;
  }

  const Post& post_;
  const RandomPath& path_;
  const std::vector<Motion>& motions_;
  double unit_, chords_;
  std::size_t next_ = 0;
};

class RoundTrip : public testing::TestWithParam<std::tuple<const char*, int>> {
 protected:
  [[nodiscard]] ProgramOptions options() const {
    ProgramOptions o;
    o.post = std::get<0>(GetParam());
    o.safe_z = Millimetres{kSafe_mm};
    o.arc_chords = Millimetres{0.002};
    o.line_numbers = seed() % 2 != 0;
    o.relative = seed() % 2 == 0 && post_by_name(o.post)->exact_increments;
    o.coolant = true;
    o.blending = Millimetres{seed() % 3 == 0 ? 0.0 : 0.002};
    o.work_offset = seed() % 2 == 0 || o.post == "grbl" ? 57 : 592;
    o.comments = {"G0 Z-100 (M30) % ; not this"};
    return o;
  }
  [[nodiscard]] std::uint64_t seed() const {
    return static_cast<std::uint64_t>(std::get<1>(GetParam()));
  }
};

// Arcs by radius, on the resolution that every control keeps: the circle is found again from the
// chord and the law of sines, in each plane, both ways round, from shallow to nearly half a turn.
TEST_P(RoundTrip, ArcsByRadiusComeBack) {
  const ScratchFolder folder;
  PathMove start;
  start.kind = PathMove::Kind::rapid;
  start.to = {0, 0, 100'000};
  std::vector<PathMove> moves{start};
  std::uint64_t n = 0;
  const auto whole = [&](double from, double to) {
    return kResolution * std::llround(from + (to - from) * random_uniform(seed(), n++));
  };
  ToolPosition at = start.to;
  for (int i = 0; i < 300; ++i) {
    PathMove m;
    m.kind = PathMove::Kind::arc;
    m.plane = static_cast<ArcPlane>(i % 3);
    m.counter_clockwise = random_uniform(seed(), n++) < 0.5;
    m.to = at;
    const std::int64_t u = whole(200, 4000), v = whole(-3000, 3000);
    (m.plane == ArcPlane::xy ? m.to.x : m.plane == ArcPlane::zx ? m.to.z : m.to.y) += u;
    (m.plane == ArcPlane::xy ? m.to.y : m.plane == ArcPlane::zx ? m.to.x : m.to.z) += v;
    const double half = 0.05 * std::hypot(static_cast<double>(u), static_cast<double>(v));
    m.radius = whole(1.03 * half, 8.0 * half);
    m.feed_mm_min = 1000.0;
    moves.push_back(m);
    at = m.to;
  }
  auto writer = ProgramWriter::create(folder / "part.ngc", options());
  ASSERT_THAT(writer, Succeeds());
  writer->tool({.number = 7}, 12000.0);
  ASSERT_THAT(writer->add(moves), Succeeds());
  const auto report = writer->commit();
  ASSERT_THAT(report, Succeeds());
  EXPECT_EQ(report->arcs_as_chords + report->arcs_as_lines, 0U);
  const auto motions = read_all(report->files);
  ASSERT_THAT(motions, Succeeds());
  std::size_t next = 0;
  const double unit = unit_mm(*post_by_name(std::get<0>(GetParam())));
  for (std::size_t i = 1; i < moves.size(); ++i) {
    while (next < motions->size() && (*motions)[next].kind != Motion::Kind::arc) ++next;
    ASSERT_LT(next, motions->size());
    const Motion& m = (*motions)[next++];
    const Vec3 from = mm(moves[i - 1].to), to = mm(moves[i].to);
    EXPECT_LE(largest(m.from_mm - from), 1e-9);
    EXPECT_LE(largest(m.to_mm - to), 1e-9);
    const double r = mm_of_ticks(moves[i].radius);
    // Heidenhain's centres are rounded; near half a turn that is all there is to hold on to.
    EXPECT_NEAR(norm(m.centre_mm - from), r, unit) << i;
    EXPECT_NEAR(norm(m.centre_mm - to), r, unit) << i;
    EXPECT_EQ(m.plane, moves[i].plane);
    EXPECT_EQ(m.sweep_rad > 0.0, moves[i].counter_clockwise);
    EXPECT_NEAR(2.0 * r * std::sin(0.5 * std::abs(m.sweep_rad)), norm(to - from), 3.0 * unit) << i;
    EXPECT_LT(std::abs(m.sweep_rad), std::numbers::pi);
  }
}

TEST_P(RoundTrip, GivesTheSameMotions) {
  const ScratchFolder folder;
  const ProgramOptions o = options();
  const RandomPath path = random_path(seed(), 4000);
  auto writer = ProgramWriter::create(folder / "part.ngc", o);
  ASSERT_THAT(writer, Succeeds());
  writer->tool({.number = 7}, 12000.0);
  ASSERT_THAT(writer->add(path.moves), Succeeds());
  const auto report = writer->commit();
  ASSERT_THAT(report, Succeeds());
  const auto motions = read_all(report->files);
  ASSERT_THAT(motions, Succeeds());
  for (const Motion& m : *motions) ASSERT_EQ(m.tool, 7);
  const Post post = *post_by_name(o.post);
  Comparison comparison(post, path, *motions, o.arc_chords.value());
  comparison.run();
  EXPECT_GT(comparison.arcs, post.helices ? 800 : 400);
  EXPECT_GT(comparison.flat, 50);
  EXPECT_EQ(comparison.chords > 300, !post.helices) << comparison.chords;
  // What the writer says of itself.
  EXPECT_EQ(report->cutting_moves + report->rapid_moves, path.moves.size());
  double length = 0.0, minutes = 0.0;
  for (const Motion& m : *motions)
    if (m.kind != Motion::Kind::rapid) {
      length += length_mm(m);
      minutes += length_mm(m) / m.feed_mm_min;
    }
  EXPECT_NEAR(report->cutting_length_mm, length, 1e-4 * length);
  EXPECT_NEAR(report->cutting_time_min, minutes, 1e-4 * minutes);
}

// Each part begins above the place where the one before has left the path; the way there and
// the way out are taken away, the rest must be the whole.
TEST_P(RoundTrip, PartsAreTheWholeInPieces) {
  const ScratchFolder folder;
  ProgramOptions o = options();
  const RandomPath path = random_path(seed() + 100, o.post == "heidenhain" ? 300 : 3000);
  const auto written = [&](std::string_view name) -> Result<ProgramReport> {
    MAQUETTE_TRY(auto writer, ProgramWriter::create(folder / name, o));
    writer.tool({.number = 2}, 12000.0);
    MAQUETTE_TRY_VOID(writer.add(path.moves));
    return writer.commit();
  };
  const auto whole = written("whole.ngc");
  ASSERT_THAT(whole, Succeeds());
  if (seed() % 2 == 0)
    o.max_lines = 400;
  else
    o.max_bytes = 17000;
  const auto parts = written("part.ngc");
  ASSERT_THAT(parts, Succeeds());
  ASSERT_GT(parts->files.size(), 4U);
  // What a reader adds up in G91 it rounds.
  const auto same = [&](Vec3 a, Vec3 b) { return largest(a - b) <= (o.relative ? 1e-9 : 0.0); };
  const auto cuts = [&](std::span<const std::filesystem::path> files) {
    std::vector<Motion> all;
    Vec3 left{NAN, NAN, NAN};  // where the last part has left the path
    for (const auto& file : files) {
      const auto motions = read_all({&file, 1});
      EXPECT_THAT(motions, Succeeds());
      bool entering = &file != files.data();
      for (const Motion& m : *motions) {
        if (m.kind == Motion::Kind::rapid) continue;
        // The entry: straight down, at most 1 mm.
        if (entering && same(m.to_mm, left) && same({m.from_mm.x, m.from_mm.y, left.z}, left)) {
          EXPECT_EQ(m.feed_mm_min, o.entry_feed.value());
          EXPECT_LE(m.from_mm.z - m.to_mm.z, 1.0 + 1e-9);
        } else {
          all.push_back(m);
        }
        entering = false;
      }
      const Motion& last = motions->back();
      const bool retreat = last.kind == Motion::Kind::rapid && last.from_mm.z < kSafe_mm;
      left = retreat ? last.from_mm : last.to_mm;
    }
    return all;
  };
  const auto expected = cuts(whole->files), got = cuts(parts->files);
  ASSERT_EQ(got.size(), expected.size());
  for (std::size_t i = 0; i < got.size(); ++i) {
    EXPECT_EQ(got[i].kind, expected[i].kind) << i;
    EXPECT_TRUE(same(got[i].from_mm, expected[i].from_mm)) << i;
    EXPECT_TRUE(same(got[i].to_mm, expected[i].to_mm)) << i;
    EXPECT_NEAR(got[i].sweep_rad, expected[i].sweep_rad, o.relative ? 1e-6 : 0.0) << i;
    EXPECT_EQ(got[i].feed_mm_min, expected[i].feed_mm_min) << i;
    if (HasFailure()) break;
  }
}

TEST_P(RoundTrip, ToolsAreTold) {
  const ScratchFolder folder;
  auto writer = ProgramWriter::create(folder / "part.ngc", options());
  ASSERT_THAT(writer, Succeeds());
  const RandomPath path = random_path(seed() + 200, 50);
  std::vector<int> numbers{3, 1, 12, 3};
  for (const int number : numbers) {
    writer->tool({.number = number}, 12000.0);
    ASSERT_THAT(writer->add(path.moves), Succeeds());
  }
  const auto report = writer->commit();
  ASSERT_THAT(report, Succeeds());
  const auto motions = read_all(report->files);
  ASSERT_THAT(motions, Succeeds());
  std::vector<int> told;
  for (const Motion& m : *motions)
    if (m.kind != Motion::Kind::rapid && (told.empty() || told.back() != m.tool))
      told.push_back(m.tool);
  EXPECT_EQ(told, numbers);
}

TEST_P(RoundTrip, BrokenProgramsGiveAnErrorAndNoCrash) {
  const ScratchFolder folder;
  const ProgramOptions o = options();
  auto writer = ProgramWriter::create(folder / "part.ngc", o);
  ASSERT_THAT(writer, Succeeds());
  writer->tool({.number = 1}, 12000.0);
  ASSERT_THAT(writer->add(random_path(seed() + 300, 60).moves), Succeeds());
  ASSERT_THAT(writer->commit(), Succeeds());
  const std::string good = *read_file(folder / "part.ngc");
  const auto read = [](std::string_view text) {
    return read_gcode_text(text, "part.ngc", [](std::span<const Motion> batch) {
      for (const Motion& m : batch) {
        EXPECT_TRUE(std::isfinite(norm(m.from_mm) + norm(m.to_mm) + m.sweep_rad));
        EXPECT_TRUE(m.kind == Motion::Kind::rapid || m.feed_mm_min > 0.0);
      }
      return Result<void>{};
    });
  };
  ASSERT_THAT(read(good), Succeeds());
  const std::size_t end = good.rfind("M30");
  for (std::size_t bytes = 1; bytes < end; bytes += 7) {
    const auto r = read(std::string_view(good).substr(0, bytes));
    // Only at a line's end, and only where the language has no frame, it looks whole.
    if (r) {
      EXPECT_TRUE(good[bytes - 1] == '\n' && (o.post == "linuxcnc" || o.post == "grbl")) << bytes;
      EXPECT_FALSE(r->ended);
    }
  }
  constexpr std::string_view kAlphabet =
      "GXYZFRIJKMLCNOTPDEB#<>[]=.-+*/0123456789 \n\t%();~:\x00\xff";
  std::uint64_t draw = 0;
  int failures = 0;
  for (int round = 0; round < 500; ++round) {
    std::string text = good;
    const auto edits = 1 + random_bits(seed(), draw++) % 4;
    for (std::uint64_t e = 0; e < edits; ++e) {
      const std::size_t at = random_bits(seed(), draw++) % text.size();
      text[at] = kAlphabet[random_bits(seed(), draw++) % kAlphabet.size()];
      if (random_bits(seed(), draw++) % 3 == 0) text.erase(at, random_bits(seed(), draw++) % 40);
      if (text.empty()) text = "%";
    }
    if (const auto r = read(text); !r) {
      ++failures;
      EXPECT_THAT(r.error().message, testing::MatchesRegex("part.ngc:[0-9]+:[0-9]+: (.|\n)*"));
    }
  }
  EXPECT_GT(failures, 50) << "the edits should hurt";
  EXPECT_LT(failures, 500) << "some should be harmless";
}

INSTANTIATE_TEST_SUITE_P(Posts, RoundTrip,
                         testing::Combine(testing::Values("linuxcnc", "grbl", "fanuc", "heidenhain",
                                                          "haas"),
                                          testing::Range(1, 5)),
                         [](const auto& test) {
                           return fmt::format("{}Seed{}", std::get<0>(test.param),
                                              std::get<1>(test.param));
                         });

}  // namespace
}  // namespace maquette::cnc

// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/path_contact.hpp"

#include <algorithm>
#include <limits>
#include <map>
#include <mutex>
#include <numeric>

#include "cnc/gcode_reader.hpp"
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis {
namespace {
constexpr double kChord_mm = 0.002;
constexpr double kRapid_mm_min = 10'000.0;
constexpr double kBin_mm = 0.75;
constexpr double kPiece_mm = 1.0;  // the lag is interpolated along pieces of this length
/// A Vec3 in half the memory: there is one for each piece of the program.
struct Small {
  float x = 0.0F, y = 0.0F, z = 0.0F;
  Small() = default;
  Small(Vec3 v)
      : x(static_cast<float>(v.x)), y(static_cast<float>(v.y)), z(static_cast<float>(v.z)) {}
  operator Vec3() const {
    return {static_cast<double>(x), static_cast<double>(y), static_cast<double>(z)};
  }
};

/// The same in a quarter, each component as one of 65535 steps between -most and most.
class Packed {
 public:
  Packed(const std::vector<Small>& all, double most) : unit_(most > 0.0 ? most / kSteps : 1.0) {
    const auto step = [this](float v) {
      return static_cast<std::int16_t>(
          std::lround(std::clamp(static_cast<double>(v) / unit_, -kSteps, kSteps)));
    };
    steps_.reserve(all.size());
    for (const Small& v : all) steps_.push_back({step(v.x), step(v.y), step(v.z)});
  }
  explicit Packed(const std::vector<Small>& all) : Packed(all, most_of(all)) {}
  Vec3 operator[](std::size_t i) const {
    return unit_ * Vec3{static_cast<double>(steps_[i][0]), static_cast<double>(steps_[i][1]),
                        static_cast<double>(steps_[i][2])};
  }

 private:
  static constexpr double kSteps = 32767.0;
  static_assert(kSteps * (1.0 / kSteps) == 1.0, "slack that is taken up comes back as that");
  static double most_of(const std::vector<Small>& all) {
    float most = 0.0F;
    for (const Small& v : all) most = std::max({most, std::abs(v.x), std::abs(v.y), std::abs(v.z)});
    return static_cast<double>(most);
  }
  double unit_;
  std::vector<std::array<std::int16_t, 3>> steps_;
};

struct Move {
  Vec3 from, to;
  double start_min, end_min;
  double start_mm, end_mm;  // cutting length
  std::uint32_t end;        // its end in the command; its start is one before
  std::uint32_t stops;      // lifts and sharp turns before it
  float rapid_mm;
};

/// A move as its underside needs it: a line in plan, upright moves without length.
struct Swath {
  double x, y, z;     // of the tip at its start
  double ux, uy;      // unit direction in plan
  double plan, rise;  // length in plan, height a length; of upright moves the sign of the motion
  double sine;        // of the angle of rise
  double low;         // lowest tip
};

Swath swath(Vec3 from, Vec3 to) {
  const double ux = to.x - from.x, uy = to.y - from.y, plan = std::sqrt(ux * ux + uy * uy);
  const double low = std::min(from.z, to.z);
  if (plan <= 1e-9)
    return {from.x, from.y, from.z, 1.0, 0.0, 0.0, from.z < to.z ? 1.0 : -1.0, 0.0, low};
  const double rise = (to.z - from.z) / plan;
  return {from.x,    from.y, from.z, ux / plan,
          uy / plan, plan,   rise,   rise / std::sqrt(1.0 + rise * rise),
          low};
}

Vec3 between(Vec3 a, Vec3 b, double share) {
  return a + share * (b - a);
}

/// How far the slack of an axis is taken up to one side after a step, -1 .. 1.
double taken(double before, double step, double width) {
  return std::clamp(before + 2.0 * step / width, -1.0, 1.0);
}
Vec3 taken(Vec3 before, Vec3 step, double width) {
  return {taken(before.x, step.x, width), taken(before.y, step.y, width),
          taken(before.z, step.z, width)};
}

/// Where work is taken up anew: with another tool, as another program, or elsewhere after a lift.
class Sections {
 public:
  /// @param apart_mm  further off than that is elsewhere
  explicit Sections(double apart_mm) : apart_mm_(apart_mm) {}

  void rapid() { lifted_ = true; }
  void cut(Vec3 from, Vec3 to, int tool, std::size_t program, double minutes) {
    if (!stretch_.empty()) {
      if (tool != tool_ || program != program_) {
        begun_.push_back(minutes);
      } else if (lifted_) {
        lifts_.push_back(minutes);
        if (off_mm(from) > apart_mm_) jumps_.push_back(minutes);
      }
    }
    const Vec3 plan{to.x - from.x, to.y - from.y, 0.0};
    const Vec3 way = norm(plan) > 0.0 ? normalized(plan) : Vec3{};
    if (lifted_) stretch_ = {};
    if (lifted_ || turned_from(way)) {
      ++stops_;
      way_ = {};
    }
    if (!(norm(way_) > 0.0)) way_ = way;
    lifted_ = false;
    tool_ = tool;
    program_ = program;
    stretch_.add(from);
    stretch_.add(to);
  }

  /// Lifts, and turns at which the machine all but stops, so far.
  [[nodiscard]] std::uint32_t stops() const { return stops_; }
  /// In order. A program that lifts after each pass begins no band by that: there only where it
  /// goes elsewhere; and where all of that is often, at tools and programs alone.
  [[nodiscard]] std::vector<double> starts_min() const {
    std::vector<double> starts = begun_;
    for (const auto* some : {&lifts_, &jumps_})
      if (begun_.size() + some->size() <= kMostSections) {
        starts.insert(starts.end(), some->begin(), some->end());
        break;
      }
    std::sort(starts.begin(), starts.end());
    return starts;
  }

 private:
  [[nodiscard]] double off_mm(Vec3 p) const {
    const auto beside = [](double v, double least, double most) {
      return std::fmax(0.0, std::fmax(least - v, v - most));
    };
    return std::hypot(beside(p.x, stretch_.min.x, stretch_.max.x),
                      beside(p.y, stretch_.min.y, stretch_.max.y));
  }

  /// In plan: machines slow down little where a pass begins to climb.
  [[nodiscard]] bool turned_from(Vec3 way) const {
    constexpr double kSharp = 0.7;  // cosine
    return norm(way) > 0.0 && norm(way_) > 0.0 && dot(way, way_) < kSharp;
  }

  double apart_mm_;
  bool lifted_ = false;
  int tool_ = -1;
  std::size_t program_ = 0;
  std::uint32_t stops_ = 0;
  Vec3 way_;      // in plan, of the first cut since the last stop
  Box3 stretch_;  // cut since the last lift
  std::vector<double> begun_, lifts_, jumps_;
};

}  // namespace

/// What trails look up. They are copied with every form and column that has one; their tables, a
/// third of a gigabyte for a path of 8 km in arcs, are not.
struct CutPath::SlackTable {
  Packed side;  ///< -1 .. 1, at the places of the command
  std::vector<std::array<bool, 3>> bends;
  Vec3 mean;
};

struct CutPath::Moves {
  double radius = 3.0;
  /// All axes are in one, and each asks for its own: those that are still in use, by width.
  mutable std::mutex tables_in_use;
  mutable std::map<double, std::weak_ptr<const SlackTable>> slack_tables;
  std::vector<Move> moves;
  std::vector<Swath> swaths;              // of the moves
  std::vector<Vec3> command;              // every place of it, rapids too
  std::vector<float> feed_mm_min;         // of the way to each of them; 0: rapid
  std::vector<double> section_start_min;  // the first left out
  double total_min = 0.0, total_mm = 0.0, rapid_mm = 0.0;
  double main_feed_mm_min = 0.0;  // that most of the cutting length has
  double x0 = 0.0, y0 = 0.0;
  std::ptrdiff_t rows = 0, cols = 0;
  std::vector<std::uint32_t> start, items;
  std::vector<double> lowest;  // tip of the moves of a bin

  void bin();
  template <class Visit>
  void each_ring(double x, double y, const Visit& visit) const;
  template <class Visit>
  void each_near(double x, double y, const double& limit, const Visit& visit) const;
  [[nodiscard]] std::vector<std::array<bool, 3>> bends(const std::vector<Small>& side) const;
  [[nodiscard]] CutState state(std::uint32_t index, double share) const;
  /// CutState::path_mm after that time and that way of rapids.
  [[nodiscard]] double way_mm(double minutes, double rapids_mm) const {
    return (minutes - rapids_mm / kRapid_mm_min) * main_feed_mm_min;
  }
  /// From one place of the command to the next, as a servo feels it: at half the feed twice as
  /// long. Rapids count as they are, for nobody knows how fast they are.
  [[nodiscard]] double felt_mm(std::size_t to) const {
    const double length = norm(command[to] - command[to - 1]),
                 feed = static_cast<double>(feed_mm_min[to]);
    return feed > 0.0 ? length * main_feed_mm_min / feed : length;
  }
  [[nodiscard]] Vec3 normal(const CutState& s, double x, double y, double height) const;
  [[nodiscard]] std::shared_ptr<const SlackTable> slack(double width) const;
};

CutPath::CutPath(std::shared_ptr<const Moves> moves) : moves_(std::move(moves)) {}

/// Ends of moves, by axis: is a place within kBendReach_mm of the way where `side` begins or ceases
/// to change?
std::vector<std::array<bool, 3>> CutPath::Moves::bends(const std::vector<Small>& side) const {
  const std::size_t n = command.size();
  std::vector<std::array<bool, 3>> near(n, {false, false, false});
  const auto still = [&](std::size_t i, int axis) {
    return detail::component(side[i], axis) == detail::component(side[i - 1], axis);
  };
  for (int axis = 0; axis < 3; ++axis) {
    const auto a = static_cast<std::size_t>(axis);
    const auto sweep = [&](auto index) {
      double since = INFINITY;
      for (std::size_t k = 1; k < n; ++k) {
        const std::size_t i = index(k);
        if (!still(i, axis)) since = 0.0;
        near[i][a] |= since < kBendReach_mm;
        since += norm(command[i] - command[i - 1]);
      }
    };
    sweep([](std::size_t k) { return k; });
    sweep([n](std::size_t k) { return n - k; });
  }
  return near;
}

std::shared_ptr<const CutPath::SlackTable> CutPath::Moves::slack(double width) const {
  const std::lock_guard lock(tables_in_use);
  if (auto known = slack_tables[width].lock()) return known;
  std::vector<Small> at(command.size());
  Vec3 now;
  for (std::size_t i = 1; i < command.size(); ++i)
    at[i] = now = taken(now, command[i] - command[i - 1], width);
  // What is the same for all of the cut is a shift, which belongs to registration.
  Vec3 mean;
  for (const Move& move : moves)
    mean += ((move.end_mm - move.start_mm) / std::fmax(1e-9, total_mm)) * Vec3(at[move.end]);
  auto table = std::make_shared<const SlackTable>(SlackTable{Packed(at, 1.0), bends(at), mean});
  slack_tables[width] = table;
  return table;
}

Trail CutPath::slack(double width) const {
  return [width, table = moves_->slack(width), moves = moves_](const CutState& s) {
    const Move& move = moves->moves[s.move];
    const Vec3 way = move.to - move.from, before = table->side[move.end - 1];
    // Slack is taken up at once, not evenly along the move.
    const Vec3 here = taken(before, static_cast<double>(s.move_share) * way, width);
    const double per_mm = 2.0 / (width * norm(way));
    const auto going = [&](double side, double step) {
      return std::abs(side) < 1.0 ? per_mm * step : 0.0;
    };
    return Drift{here - table->mean,
                 {going(here.x, way.x), going(here.y, way.y), going(here.z, way.z)},
                 table->bends[move.end]};
  };
}

/// First-order lag of the whole motion, rapids included: p' = (c - p) / e in way at the main feed
/// (a lag is a time), exact along lines. Off the path: p(s + e) - c(s), for delay along the path is
/// no error of form.
Trail CutPath::lag(double e) const {
  const auto& all = moves_->command;
  const std::size_t n = all.size();
  std::vector<double> s(n, 0.0);
  for (std::size_t i = 1; i < n; ++i) s[i] = s[i - 1] + moves_->felt_mm(i);
  const auto advance = [e](Vec3 p0, Vec3 c0, Vec3 u, double length) {
    return c0 + length * u - e * u + std::exp(-length / e) * (p0 - c0 + e * u);
  };
  std::vector<Vec3> p(all.begin(), all.begin() + (n > 0 ? 1 : 0));
  for (std::size_t i = 1; i < n; ++i) {
    const double length = s[i] - s[i - 1];
    p.push_back(length > 0.0
                    ? advance(p[i - 1], all[i - 1], (1.0 / length) * (all[i] - all[i - 1]), length)
                    : p[i - 1]);
  }
  // At the ends of pieces, and by how much more in their middle than between the ends: the command
  // goes straight there and the tip does not. With a lag of 1.2 mm and pieces of half one it is 3 %
  // of all that the lag does.
  std::vector<Small> off(n), bulge(n), way(n);
  std::size_t j = 0;
  Vec3 follows;  // where it goes, for each mm of the command's way
  const auto off_at = [&](double at, Vec3 commanded) {
    const double ahead = at + e;
    while (j + 1 < n && s[j + 1] < ahead) ++j;
    Vec3 there = p[j], command = all[j];
    if (j + 1 < n && s[j + 1] > s[j]) {
      const Vec3 u = (1.0 / (s[j + 1] - s[j])) * (all[j + 1] - all[j]);
      there = advance(p[j], all[j], u, ahead - s[j]);
      command += (ahead - s[j]) * u;
    }
    follows = (1.0 / e) * (command - there);
    return there - commanded;
  };
  for (std::size_t i = 0; i < n; ++i) {
    Vec3 middle;
    if (i > 0) middle = off_at(0.5 * (s[i - 1] + s[i]), between(all[i - 1], all[i], 0.5));
    off[i] = off_at(s[i], all[i]);
    way[i] = follows;
    if (i > 0) bulge[i] = middle - between(off[i - 1], off[i], 0.5);
  }
  return [off = std::make_shared<const Packed>(off), bulge = std::make_shared<const Packed>(bulge),
          way = std::make_shared<const Packed>(way), moves = moves_](const CutState& at) {
    const Move& move = moves->moves[at.move];
    const auto share = static_cast<double>(at.move_share);
    return Drift{between((*off)[move.end - 1], (*off)[move.end], share) +
                     4.0 * share * (1.0 - share) * (*bulge)[move.end],
                 between((*way)[move.end - 1], (*way)[move.end], share) - at.feed};
  };
}

/// Slack behind the lag: of the lagged motion; before it: the sides of the command, lagged. As the
/// lag, compared at the same place.
Trail CutPath::slack_with_lag(int axis, double width, double e, bool lag_first) const {
  const auto& all = moves_->command;
  const std::size_t n = all.size();
  const auto of = [axis](Vec3 v) { return detail::component(v, axis); };
  std::vector<float> alone(n, 0.0F), both(n, 0.0F);
  std::vector<double> place(n, 0.0);  // along the way
  double side = 0.0, now = 0.0, before = 0.0, lagged = n > 0 ? of(all[0]) : 0.0, at = 0.0;
  std::size_t next = 0;  // the first place whose `both` is not yet reached
  for (std::size_t i = 1; i < n; ++i) {
    const double length = moves_->felt_mm(i), start = at;
    place[i] = start + length;
    const auto steps = std::max(1, static_cast<int>(std::fmin(1e6, std::ceil(8.0 * length / e))));
    const double h = length / steps, rise = (of(all[i]) - of(all[i - 1])) / steps;
    const double kept = std::exp(-h / e), u = length > 0.0 ? rise / h : 0.0;
    for (int k = 0; k < steps; ++k) {
      const double c = of(all[i - 1]) + k * rise, was = side;
      side = taken(side, rise, width);
      before = now;
      if (lag_first) {
        const double p = c + rise - e * u + kept * (lagged - c + e * u);
        now = taken(now, p - lagged, width);
        lagged = p;
      } else {
        const double middle = 0.5 * (was + side);
        now = middle + kept * (now - middle);
      }
      const double from = at;
      at = start + (k + 1) * h;
      for (; next <= i && place[next] + e <= at; ++next)
        both[next] = static_cast<float>(before + (h > 0.0 ? (place[next] + e - from) / h : 1.0) *
                                                     (now - before));
    }
    alone[i] = static_cast<float>(side);
  }
  for (; next < n; ++next) both[next] = static_cast<float>(now);
  using Sides = const std::vector<float>;
  return [=, alone = std::make_shared<Sides>(std::move(alone)),
          both = std::make_shared<Sides>(std::move(both)), moves = moves_](const CutState& s) {
    const Move& move = moves->moves[s.move];
    const double share = static_cast<double>(s.move_share), way = of(move.to) - of(move.from),
                 length = norm(move.to - move.from);
    const double b0 = static_cast<double>((*both)[move.end - 1]),
                 b1 = static_cast<double>((*both)[move.end]);
    const double here = taken(static_cast<double>((*alone)[move.end - 1]), share * way, width);
    const double going = std::abs(here) < 1.0 ? 2.0 * way / width : 0.0;
    return Drift{detail::along_axis(axis, b0 + share * (b1 - b0) - here),
                 detail::along_axis(axis, length > 0.0 ? (b1 - b0 - going) / length : 0.0)};
  };
}

void CutPath::Moves::bin() {
  swaths.clear();
  for (const Move& m : moves) swaths.push_back(swath(m.from, m.to));
  Box3 box;
  for (const Move& m : moves) {
    box.add(m.from);
    box.add(m.to);
  }
  if (box.empty()) return;
  x0 = box.min.x;
  y0 = box.min.y;
  cols = static_cast<std::ptrdiff_t>((box.max.x - x0) / kBin_mm) + 1;
  rows = static_cast<std::ptrdiff_t>((box.max.y - y0) / kBin_mm) + 1;
  const auto each_bin = [&](const Move& m, const auto& visit) {
    const auto index = [](double v, double o) {
      return static_cast<std::ptrdiff_t>((v - o) / kBin_mm);
    };
    const auto c0 = index(std::fmin(m.from.x, m.to.x), x0),
               c1 = index(std::fmax(m.from.x, m.to.x), x0);
    const auto r0 = index(std::fmin(m.from.y, m.to.y), y0),
               r1 = index(std::fmax(m.from.y, m.to.y), y0);
    for (auto r = r0; r <= r1; ++r)
      for (auto c = c0; c <= c1; ++c) visit(static_cast<std::size_t>(r * cols + c));
  };
  const auto bins = static_cast<std::size_t>(rows * cols);
  start.assign(bins + 1, 0);
  lowest.assign(bins, INFINITY);
  for (const Move& m : moves)
    each_bin(m, [&](std::size_t b) {
      ++start[b + 1];
      lowest[b] = std::fmin(lowest[b], std::fmin(m.from.z, m.to.z));
    });
  std::partial_sum(start.begin(), start.end(), start.begin());
  items.resize(start.back());
  auto next = start;
  for (std::uint32_t i = 0; i < moves.size(); ++i)
    each_bin(moves[i], [&](std::size_t b) { items[next[b]++] = i; });
}

Result<CutPath> CutPath::read(std::span<const std::filesystem::path> programs,
                              double ball_radius_mm, const RunContext& run) {
  auto made = std::make_shared<Moves>();
  Moves& m = *made;
  m.radius = ball_radius_mm;
  Sections sections(2.0 * ball_radius_mm);
  std::map<double, double> length_at_mm;  // cutting length by feed, mm/min
  for (std::size_t program = 0; program < programs.size(); ++program) {
    const auto take = [&](std::span<const cnc::Motion> motions) -> Result<void> {
      for (const cnc::Motion& motion : motions) {
        if (motion.probe) continue;
        const bool rapid = motion.kind == cnc::Motion::Kind::rapid;
        const auto take_piece = [&](Vec3 a, Vec3 b) {
          const double length = norm(b - a);
          const bool at_feed = !rapid && motion.feed_mm_min > 0.0;
          const auto go_to = [&](Vec3 p) {
            m.command.push_back(p);
            m.feed_mm_min.push_back(at_feed ? static_cast<float>(motion.feed_mm_min) : 0.0F);
          };
          if (m.command.empty() || !(m.command.back() == a)) go_to(a);
          go_to(b);
          const double feed_mm_min = at_feed ? motion.feed_mm_min : kRapid_mm_min;
          const double minutes = length / feed_mm_min;
          if (rapid) {
            sections.rapid();
            m.rapid_mm += length;
          } else {
            sections.cut(a, b, motion.tool, program, m.total_min);
            m.moves.push_back({a, b, m.total_min, m.total_min + minutes, m.total_mm,
                               m.total_mm + length,
                               static_cast<std::uint32_t>(m.command.size() - 1), sections.stops(),
                               static_cast<float>(m.rapid_mm)});
            m.total_mm += length;
            length_at_mm[feed_mm_min] += length;
          }
          m.total_min += minutes;
        };
        cnc::for_each_chord(motion, kChord_mm, [&](Vec3 a, Vec3 b) {
          const double length = norm(b - a);
          if (!(length > 0.0)) return;
          const int pieces =
              rapid ? 1 : static_cast<int>(std::fmin(1e6, std::ceil(length / kPiece_mm)));
          Vec3 from = a;
          for (int i = 1; i <= pieces; ++i) {
            const Vec3 to = i == pieces ? b : a + (static_cast<double>(i) / pieces) * (b - a);
            take_piece(from, to);
            from = to;
          }
        });
      }
      return {};
    };
    MAQUETTE_TRY(const auto summary, cnc::read_gcode(programs[program], take, run));
    (void)summary;
  }
  m.section_start_min = sections.starts_min();
  double most_mm = 0.0;
  for (const auto& [feed_mm_min, length_mm] : length_at_mm)
    if (length_mm >= most_mm) {
      m.main_feed_mm_min = feed_mm_min;
      most_mm = length_mm;
    }
  m.bin();
  return CutPath(std::move(made));
}

namespace {

/// False where a ball along a line is not below `limit`: it is at least d^2 / (2 r) above its
/// lowest tip, d being the line's distance in plan.
bool may_be_below(Vec3 from, Vec3 to, double x, double y, double radius, double limit) {
  const double room = 2.0 * radius * (limit - std::min(from.z, to.z));
  if (!(room > 0.0)) return false;
  const double vx = to.x - from.x, vy = to.y - from.y, ax = x - from.x, ay = y - from.y;
  const double way = ax * vx + ay * vy, length2 = vx * vx + vy * vy, a2 = ax * ax + ay * ay;
  if (!(way > 0.0)) return a2 < room;
  if (way >= length2) return a2 - 2.0 * way + length2 < room;
  const double across = ax * vy - ay * vx;
  return across * across < room * length2;
}

/// A move's underside over a place, and where along the move it is.
struct Under {
  double height = INFINITY, share = 0.0;
};

/// @return infinity where the move is not below `limit`
Under under(const Swath& m, double x, double y, double r2, double radius, double limit) {
  const double ax = x - m.x, ay = y - m.y;
  const double d = ax * m.uy - ay * m.ux;
  // r - sqrt(r^2 - d^2) is at least d^2 / (2 r): most moves are told by that.
  if (m.low + d * d / (2.0 * radius) >= limit) return {};
  const double rho2 = r2 - d * d;
  if (!(rho2 > 0.0)) return {};
  if (!(m.plan > 0.0)) {
    const double q = r2 - ax * ax - ay * ay;
    if (!(q > 0.0)) return {};
    return {m.low + radius - std::sqrt(q), m.rise < 0.0 ? 1.0 : 0.0};
  }
  const double s = ax * m.ux + ay * m.uy;
  const double t = std::clamp(s - m.sine * std::sqrt(rho2), 0.0, m.plan);
  const double q = rho2 - (s - t) * (s - t);
  if (!(q > 0.0)) return {};
  return {m.z + m.rise * t + radius - std::sqrt(q), t / m.plan};
}

}  // namespace

/// Calls visit(move, its underside) for all moves that come below `limit`, a reference that the
/// visitor may lower.
template <class Visit>
void CutPath::Moves::each_near(double x, double y, const double& limit, const Visit& visit) const {
  const double r2 = radius * radius;
  each_ring(x, y, [&](std::ptrdiff_t, std::ptrdiff_t row, std::ptrdiff_t col) {
    const auto b = static_cast<std::size_t>(row * cols + col);
    if (!(lowest[b] < limit)) return;
    const double bx = x0 + kBin_mm * static_cast<double>(col),
                 by = y0 + kBin_mm * static_cast<double>(row);
    const double gx = std::fmax(0.0, std::fmax(bx - x, x - bx - kBin_mm));
    const double gy = std::fmax(0.0, std::fmax(by - y, y - by - kBin_mm));
    const double near2 = gx * gx + gy * gy;
    if (near2 >= r2 || lowest[b] + radius - std::sqrt(r2 - near2) >= limit) return;
    for (std::uint32_t i = start[b]; i < start[b + 1]; ++i) {
      const Under u = under(swaths[items[i]], x, y, r2, radius, limit);
      if (u.height < limit) visit(items[i], u);
    }
  });
}

/// Calls visit(ring, row, column) for all squares within a radius, those about the place first.
template <class Visit>
void CutPath::Moves::each_ring(double x, double y, const Visit& visit) const {
  const auto c = static_cast<std::ptrdiff_t>(std::floor((x - x0) / kBin_mm));
  const auto r = static_cast<std::ptrdiff_t>(std::floor((y - y0) / kBin_mm));
  const auto reach = static_cast<std::ptrdiff_t>(std::ceil(radius / kBin_mm));
  for (std::ptrdiff_t ring = 0; ring <= reach; ++ring)
    for (std::ptrdiff_t i = -ring; i <= ring; ++i)
      for (std::ptrdiff_t j = -ring; j <= ring;
           j += (std::abs(i) == ring || ring == 0) ? 1 : 2 * ring)
        if (r + i >= 0 && c + j >= 0 && r + i < rows && c + j < cols) visit(ring, r + i, c + j);
}

CutState CutPath::Moves::state(std::uint32_t index, double share) const {
  const Move& move = moves[index];
  CutState s;
  s.tip = move.from + share * (move.to - move.from);
  s.feed = normalized(move.to - move.from);
  const double minutes = move.start_min + share * (move.end_min - move.start_min);
  s.path_mm = way_mm(minutes, static_cast<double>(move.rapid_mm));
  s.path_share = total_min > 0.0 ? minutes / total_min : 0.0;
  s.cut_share =
      total_mm > 0.0 ? (move.start_mm + share * (move.end_mm - move.start_mm)) / total_mm : 0.0;
  s.move = index;
  s.move_share = static_cast<float>(share);
  s.stops = move.stops;
  s.rapid_mm = move.rapid_mm;
  return s;
}

Vec3 CutPath::Moves::normal(const CutState& s, double x, double y, double height) const {
  return (1.0 / radius) * (s.tip + Vec3{0.0, 0.0, radius} - Vec3{x, y, height});
}

namespace {
/// Of the pieces a bent pass is swept in, per move: moves are at most kPiece_mm long.
constexpr int kPiecesOfBend = 2;
}  // namespace

struct CutPath::Walk final : Pass {
  std::shared_ptr<const Moves> moves;
  explicit Walk(std::shared_ptr<const Moves> m) : moves(std::move(m)) {}

  /// @param displaced  displaced(move, k): its tip after k of kPiecesOfBend pieces
  template <class Displaced>
  double lowest_mm(const CutState& s, double x, double y, double radius,
                   const Displaced& displaced) const {
    const Moves& m = *moves;
    const auto follows = [&](std::uint32_t i) { return m.moves[i].end == m.moves[i - 1].end + 1; };
    const auto length = [&](std::uint32_t i) { return m.moves[i].end_mm - m.moves[i].start_mm; };
    std::uint32_t first = s.move, last = s.move;
    const auto share = static_cast<double>(s.move_share);
    // What comes to the place from as far as it is displaced, and that again by half for the slope
    // that it has there.
    const Vec3 by = displaced(s.move, 0) - m.moves[s.move].from;
    const double reach = kBendReach_mm + 1.5 * std::hypot(by.x, by.y);
    for (double d = share * length(first); d < reach && first > 0 && follows(first);)
      d += length(--first);
    for (double d = (1.0 - share) * length(last);
         d < reach && last + 1 < m.moves.size() && follows(last + 1);)
      d += length(++last);
    double best = INFINITY;
    const auto sweep = [&](std::uint32_t i) {
      Vec3 from = displaced(i, 0);
      for (int k = 1; k <= kPiecesOfBend; ++k) {
        const Vec3 to = displaced(i, k);
        if (may_be_below(from, to, x, y, radius, best)) {
          const double height = under(swath(from, to), x, y, radius * radius, radius, best).height;
          if (height < best) best = height;
        }
        from = to;
      }
    };
    sweep(s.move);  // mostly the lowest: the others are then told at a glance
    for (std::uint32_t i = first; i <= last; ++i)
      if (i != s.move) sweep(i);
    return best;
  }
  static double share_of(int k) { return static_cast<double>(k) / kPiecesOfBend; }

  double height_mm(const CutState& s, double x, double y, double radius,
                   const std::function<Vec3(const CutState&)>& off) const override {
    return lowest_mm(s, x, y, radius, [&](std::uint32_t i, int k) {
      const CutState t = moves->state(i, share_of(k));
      return t.tip + off(t);
    });
  }

  std::size_t states() const override { return (kPiecesOfBend + 1) * moves->moves.size(); }
  CutState state(std::size_t index) const override {
    return moves->state(static_cast<std::uint32_t>(index / (kPiecesOfBend + 1)),
                        share_of(static_cast<int>(index % (kPiecesOfBend + 1))));
  }
  double height_mm(const CutState& s, double x, double y, double radius,
                   std::span<const std::array<float, 3>> off, Vec3 more) const override {
    return lowest_mm(s, x, y, radius, [&](std::uint32_t i, int k) {
      const Move& m = moves->moves[i];
      const auto& by = off[(kPiecesOfBend + 1) * std::size_t{i} + static_cast<std::size_t>(k)];
      return between(m.from, m.to, share_of(k)) + more +
             Vec3{static_cast<double>(by[0]), static_cast<double>(by[1]),
                  static_cast<double>(by[2])};
    });
  }
};

std::shared_ptr<const Pass> CutPath::pass() const {
  return std::make_shared<Walk>(moves_);
}

/// Of nearly the same time passes move nearly alike: fewer of them come to make the surface.
constexpr double kNeighbourHeight_mm = 0.2, kOtherTime = 0.05;

std::optional<Contact> CutPath::at(double x, double y, std::vector<Rival>* rivals) const {
  const Moves& m = *moves_;
  double best = INFINITY, share = 0.0;
  std::uint32_t found = 0;
  m.each_near(x, y, best, [&](std::uint32_t i, const Under& u) {
    best = u.height;
    share = u.share;
    found = i;
  });
  if (!std::isfinite(best)) return std::nullopt;
  Contact contact;
  static_cast<CutState&>(contact) = m.state(found, share);
  contact.height_mm = best;
  contact.normal = m.normal(contact, x, y, best);
  if (rivals == nullptr) return contact;
  std::vector<std::pair<std::uint32_t, Under>> near;
  const double limit = best + kRivalHeight_mm;
  m.each_near(x, y, limit, [&](std::uint32_t i, const Under& u) {
    if (u.height < best + kNeighbourHeight_mm ||
        std::abs(m.state(i, u.share).path_share - contact.path_share) > kOtherTime)
      near.emplace_back(i, u);
  });
  // Moves that follow each other are one pass: its lowest stands for it.
  std::sort(near.begin(), near.end(),
            [](const auto& a, const auto& b) { return a.first < b.first; });
  std::vector<std::pair<std::uint32_t, Under>> passes;
  for (std::size_t i = 0; i < near.size(); ++i)
    if (i > 0 && near[i].first - near[i - 1].first <= 3)
      passes.back() = near[i].second.height < passes.back().second.height ? near[i] : passes.back();
    else
      passes.push_back(near[i]);
  std::sort(passes.begin(), passes.end(),
            [](const auto& a, const auto& b) { return a.second.height < b.second.height; });
  rivals->clear();
  for (std::size_t i = 1; i < passes.size() && i <= kMostRivals; ++i) {
    Rival r;
    r.state = m.state(passes[i].first, passes[i].second.share);
    r.normal = m.normal(r.state, x, y, passes[i].second.height);
    r.above_mm = passes[i].second.height - best;
    if (r.normal.z > 0.05) rivals->push_back(r);
  }
  return contact;
}

std::optional<CutState> CutPath::above(double x, double y) const {
  const Moves& m = *moves_;
  double least2 = m.radius * m.radius, share = 0.0;
  std::optional<std::uint32_t> found;
  const auto look_at = [&](std::uint32_t i) {
    const Swath& s = m.swaths[i];
    if (!(s.plan > 0.0)) return;
    const double ax = x - s.x, ay = y - s.y, t = std::clamp(ax * s.ux + ay * s.uy, 0.0, s.plan),
                 dx = ax - t * s.ux, dy = ay - t * s.uy, d2 = dx * dx + dy * dy;
    if (!(d2 < least2)) return;
    least2 = d2;
    share = t / s.plan;
    found = i;
  };
  m.each_ring(x, y, [&](std::ptrdiff_t ring, std::ptrdiff_t row, std::ptrdiff_t col) {
    const auto bin = static_cast<std::size_t>(row * m.cols + col);
    const double nearest = kBin_mm * static_cast<double>(ring - 1);
    if (ring > 1 && nearest * nearest > least2) return;
    for (std::uint32_t i = m.start[bin]; i < m.start[bin + 1]; ++i) look_at(m.items[i]);
  });
  return found ? std::optional(m.state(*found, share)) : std::nullopt;
}

std::optional<double> CutPath::height(double x, double y) const {
  double best = INFINITY;
  moves_->each_near(x, y, best, [&](std::uint32_t, const Under& u) { best = u.height; });
  return std::isfinite(best) ? std::optional(best) : std::nullopt;
}

double CutPath::ball_radius_mm() const {
  return moves_->radius;
}

double CutPath::duration_min() const {
  return moves_->total_min;
}

double CutPath::cut_mm() const {
  return moves_->way_mm(moves_->total_min, moves_->rapid_mm);
}

std::vector<double> CutPath::section_starts() const {
  std::vector<double> starts;
  for (const double minutes : moves_->section_start_min)
    starts.push_back(minutes / moves_->total_min);
  return starts;
}

}  // namespace maquette::diagnosis

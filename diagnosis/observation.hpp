// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file observation.hpp
/// One measured coordinate and everything that a cause may act through.
///
/// A cause moves material (or the point) by a small vector d; the residual then changes by
/// along . d. Scanned points: along = outward normal of the simulated surface. Probed marks:
/// one observation for each coordinate, along = its axis.
///
/// Frame: model frame, millimetres. Time and order are those of the program; where there is no
/// program `feed` is zero and `path_share` NaN.

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "core/vec.hpp"

namespace maquette::diagnosis {

struct CastShadow;  // cast_shadow.hpp

/// Lengths over which a film levels, mm (standard deviation of the Gaussian); what lies between two
/// is a mixture of both, good to a hundredth at this step.
inline constexpr std::array<double, 13> kFilmLengths_mm{0.5, 0.6, 0.75, 0.9, 1.1, 1.35, 1.6,
                                                        1.9, 2.3, 2.8,  3.4, 4.1, 5.0};
/// Widths (standard deviations) of a scanner's spot for which its mean is taken, mm.
inline constexpr std::array<double, 7> kSpotWidths_mm{0.6, 0.8, 1.05, 1.4, 1.8, 2.3, 3.0};

/// Passes that are higher by more than this are taken to stay out of the surface.
inline constexpr double kRivalHeight_mm = 0.28;
/// More passes than that run nowhere side by side within it.
inline constexpr std::size_t kMostRivals = 10;

/// More bands than that are no bands.
inline constexpr std::size_t kMostSections = 12;

/// What the machine did at a place of the program.
struct CutState {
  Vec3 tip;                 ///< of the cutter
  Vec3 feed;                ///< unit direction of motion, or zero
  double path_share = NAN;  ///< of the program's time, 0 to 1
  double cut_share = NAN;   ///< of its cutting length
  /// Time of cutting so far, as way at the feed that most of the cut has: plunges at half of it
  /// count twice. What swings steadily goes by this.
  double path_mm = NAN;
  std::uint32_t move = 0;   ///< of the program: what a Trail goes by
  float move_share = 0.0F;  ///< of that move's length
  /// Lifts and sharp turns so far: what makes the machine stop, which takes time.
  std::uint32_t stops = 0;
  float rapid_mm = 0.0F;  ///< way of the rapids so far
};

/// A pass that runs by a place, a little above the one that made it: if passes are displaced
/// against each other, another one makes the surface.
struct Rival {
  CutState state;
  Vec3 normal;            ///< of its ball there
  double above_mm = 0.0;  ///< its underside over the surface
};

/// The program's pass through a state, for changes that bend it: where an axis stands still until
/// lost motion is taken up, a straight pass would cut on below what the ball really leaves.
class Pass {
 public:
  virtual ~Pass() = default;
  /// Underside at (x, y) of the pass around a state, its tips displaced by off(state), mm; not
  /// finite where the ball is elsewhere.
  [[nodiscard]] virtual double height_mm(const CutState& s, double x_mm, double y_mm,
                                         double radius_mm,
                                         const std::function<Vec3(const CutState&)>& off) const = 0;
  /// All states that `off` may be asked for.
  [[nodiscard]] virtual std::size_t states() const = 0;
  [[nodiscard]] virtual CutState state(std::size_t index) const = 0;
  /// The same of displacements that are known at all of them, and `more` everywhere: for many
  /// places, which ask for the same states again and again.
  [[nodiscard]] virtual double height_mm(const CutState& s, double x_mm, double y_mm,
                                         double radius_mm,
                                         std::span<const std::array<float, 3>> off_mm,
                                         Vec3 more_mm) const = 0;
};
/// How far along the way a bend is felt: a ball of 3 mm over a bend of 0.4.
inline constexpr double kBendReach_mm = 1.2;

struct Observation : CutState {
  Vec3 place;   ///< on the simulated surface
  Vec3 normal;  ///< outward
  /// The same of the surface levelled over 0.5 mm: the slope without the ridges between passes.
  Vec3 slope_normal;
  /// The same surface's second derivatives along xx, xy, yy, 1 / mm.
  std::array<float, 3> curvature_per_mm{};
  /// Where the tip would be were there a pass just here: `tip` goes by half a stepover from pass to
  /// pass. NaN: as `tip`.
  Vec3 level_tip{NAN, NAN, NAN};
  Vec3 along;  ///< direction of the residual
  double residual_mm = 0.0;
  double sigma_mm = 0.05;               ///< as declared
  std::uint32_t set_up = 0;             ///< scan or probe list it belongs to
  bool on_surface = true;               ///< false: a mark, which coats and cutters do not move
  bool by_tip = false;                  ///< the pass above made it, not where its ball touches
  double milled_minus_design_mm = 0.0;  ///< along the normal

  /// Passes within kRivalHeight_mm above, kMostRivals at most; shared, for most causes do not look
  /// at them.
  std::shared_ptr<const std::vector<Rival>> rivals;
  std::shared_ptr<const Pass> pass;  ///< of the program; none without

  // The view.
  bool has_station = false;
  Vec3 beam;  ///< unit, from the station to the place
  double range_mm = 0.0;
  /// The surface levelled over each of the film lengths less the surface, upwards, mm.
  std::array<float, kFilmLengths_mm.size()> levelled{};
  /// Mean range over a spot of each width less that of its middle, mm.
  std::array<float, kSpotWidths_mm.size()> spot{};
};

/// Direction in which the surface shows that it was moved as a whole: its slope without the ridges
/// between passes. Ridges in the data are flatter than simulated (coat, worn edge, a scanner's
/// spot) and come back after half a stepover: sizes read off them are too small. Without them they
/// have no say in what moves neighbouring passes alike. Of marks, and where a vector is asked for
/// axis by axis, `along` itself.
[[nodiscard]] inline Vec3 level_along(const Observation& o) {
  constexpr double kSame = 1.0 - 1e-9;
  if (!o.on_surface || !(dot(o.along, o.normal) > kSame)) return o.along;
  return (o.normal.z / o.slope_normal.z) * o.slope_normal;
}

/// What a cause does to a pass: the tip is elsewhere, the ball larger (its tip where it is), or out
/// of true.
struct CutChange {
  Vec3 tip_mm;
  double radius_mm = 0.0;
  Vec3 tip_per_mm{};   ///< by how much more elsewhere with each mm of way; small changes need none
  bool bends = false;  ///< within kBendReach_mm of the way `tip_per_mm` jumps
  double runout_mm = 0.0;         ///< its axis turns about the spindle's at that distance
  double curvature_per_mm = 0.0;  ///< of the tip's way along the feed, at most
  [[nodiscard]] bool turns() const { return dot(tip_per_mm, tip_per_mm) > 0.0; }
  /// Is it not as good as straight to the ball? What curves as that does is more than its slopes.
  [[nodiscard]] bool curves(double ball_radius_mm) const {
    constexpr double kStraight = 0.1;
    return bends || curvature_per_mm * ball_radius_mm > kStraight;
  }
  CutChange& operator+=(const CutChange& o) {
    tip_mm += o.tip_mm;
    radius_mm += o.radius_mm;
    tip_per_mm += o.tip_per_mm;
    bends |= o.bends;
    runout_mm += o.runout_mm;
    curvature_per_mm += o.curvature_per_mm;
    return *this;
  }
  friend CutChange operator*(double k, const CutChange& c) {
    return {k * c.tip_mm,        k * c.radius_mm, k * c.tip_per_mm,
            c.bends && k != 0.0, k * c.runout_mm, std::abs(k) * c.curvature_per_mm};
  }
};

/// Of all balls that a runout turns to a place, seen from the ball's middle along -n, the nearest:
/// it comes no nearer than above it, and the swept body is flat below.
[[nodiscard]] inline Vec3 towards_place(Vec3 n, double radius_mm, double runout_mm) {
  if (runout_mm == 0.0) return {};
  const double plan = std::hypot(n.x, n.y);
  if (!(plan > 0.0)) return {};
  const double nearer = std::fmin(radius_mm, runout_mm / plan);
  return {-nearer * n.x, -nearer * n.y, 0.0};
}

/// Rise a length of the steepest pass whose slope is taken from its command and displacement.
inline constexpr double kSteepPass = 0.8;

/// A pass that is moved further than that in plan is swept as it is: straight on from its place it
/// would soon be far below or above itself (a valley that moves by 1 mm along its pass, by 0.1 mm).
inline constexpr double kStraight_mm = 0.2;
[[nodiscard]] inline bool is_far(const CutChange& c) {
  return std::hypot(c.tip_mm.x, c.tip_mm.y) > kStraight_mm;
}

/// A pass as it is beside a place: the ball's normal there, and its underside over the place.
struct PassBeside {
  const CutState& state;
  Vec3 normal;
  double above_mm = 0.0;
};

/// Least cosine between a pass's normal and a direction along which it is met to first order.
inline constexpr double kLeastCosine = 0.1;

/// rise_mm to first order in `tip_mm` (runout included) and radius. Undersides are convex, in the
/// place and in the radius, so where the normal is within 90 degrees of `up` a pass whose direction
/// does not change rises by no less.
[[nodiscard]] inline double first_order_rise_mm(const PassBeside& p, Vec3 tip_mm,
                                                const CutChange& c, Vec3 up) {
  return (dot(p.normal, tip_mm) + p.above_mm * p.normal.z - c.radius_mm * (1.0 - p.normal.z)) /
         std::fmax(kLeastCosine, dot(p.normal, up));
}

/// How far from the place a changed pass leaves its surface, along `up` (a unit vector), mm. The
/// pass is straight there: its ball sweeps a cylinder along the feed, and the lower of the two
/// points at which the line through the place meets the changed cylinder is on the new surface.
/// Exact for passes that are straight before and after; where the changed ball does not reach, to
/// first order.
[[nodiscard]] inline double rise_mm(const PassBeside& p, double radius_mm, const CutChange& c,
                                    Vec3 up) {
  const CutState& s = p.state;
  const Vec3 along = s.feed - dot(s.feed, p.normal) * p.normal;
  const double length = norm(along);
  Vec3 f = length > 1e-9 ? (1.0 / length) * along : Vec3{};
  // Only of passes along the surface: a plunge or lift whose axis stands still has no direction.
  if (length > 1e-9 && std::abs(s.feed.z) < kSteepPass && c.turns())
    f = normalized(f + c.tip_per_mm);
  const auto across = [&](Vec3 v) { return v - dot(v, f) * f; };
  const Vec3 tip = c.tip_mm + towards_place(p.normal, radius_mm, c.runout_mm);
  const Vec3 way = across(up),
             from = across(-radius_mm * p.normal - tip - Vec3{0.0, 0.0, p.above_mm + c.radius_mm});
  const double r = radius_mm + c.radius_mm, a = dot(way, way), b = dot(from, way),
               d = dot(from, from) - r * r, root = b * b - a * d;
  if (!(root > 0.0) || !(r > 0.0)) return first_order_rise_mm(p, tip, c, up);
  return d / (std::sqrt(root) - b);
}

/// Along which a residual is: a scanner's beam meets the changed surface elsewhere than the upright
/// through the place does. Where passes are displaced by tenths of a millimetre against each other
/// that is beyond a ridge, and lost motion would come out some hundredths too small. Beams further
/// than 60 degrees off the normal as at 60, for what they meet is further away than the passes that
/// are known.
[[nodiscard]] inline Vec3 seen_along(const Observation& o) {
  constexpr double kLeast = 0.5;
  if (!o.has_station) return {0.0, 0.0, 1.0};
  const Vec3 back = -1.0 * o.beam;
  const double cosine = dot(back, o.normal);
  if (cosine > kLeast) return back;
  const Vec3 aside = normalized(back - cosine * o.normal);
  return kLeast * o.normal + std::sqrt(1.0 - kLeast * kLeast) * aside;
}

[[nodiscard]] inline std::span<const Rival> rivals_of(const Observation& o) {
  if (!o.rivals) return {};
  return {o.rivals->data(), std::min(o.rivals->size(), kMostRivals)};
}

/// What a surface without ridges rises by beyond its slope if it is moved as a whole, mm: half of
/// its curvature times the way squared.
[[nodiscard]] inline double second_order_rise_mm(const Observation& o, Vec3 moved_mm) {
  const auto& h = o.curvature_per_mm;
  return 0.5 * (static_cast<double>(h[0]) * moved_mm.x * moved_mm.x +
                2.0 * static_cast<double>(h[1]) * moved_mm.x * moved_mm.y +
                static_cast<double>(h[2]) * moved_mm.y * moved_mm.y);
}

/// How a place's passes are changed: the one that made it, then its rivals.
using PassChanges = std::array<CutChange, 1 + kMostRivals>;

/// Whether passes beside the place are changed otherwise than the one there by what matters.
[[nodiscard]] inline bool passes_part(const Observation& o, const PassChanges& changes) {
  constexpr double kApart_mm = 0.01;  // what is left of it is a product of two such
  for (std::size_t i = 0; i < rivals_of(o).size(); ++i) {
    const Vec3 apart = changes[i + 1].tip_mm - changes[0].tip_mm;
    if (dot(apart, apart) > kApart_mm * kApart_mm) return true;
  }
  return false;
}

/// Where along a line a surface is met that lies over_mm(at) above it, by secants from a place and
/// slope near it; where they do not come closer, as far as they came. Few go a second time.
template <class Over>
[[nodiscard]] double met_mm(double at_mm, double slope, const Over& over_mm) {
  constexpr double kGood_mm = 0.01;  // what is left of a step by the slope is its square
  constexpr int kMost = 4;
  double over = over_mm(at_mm);
  for (int k = 0; k < kMost && std::isfinite(over); ++k) {
    const double next = at_mm - over / slope;
    if (std::abs(next - at_mm) < kGood_mm) return next;
    const double over_next = over_mm(next);
    if (!(std::abs(over_next) < std::abs(over))) break;
    slope = (over_next - over) / (next - at_mm);
    at_mm = next;
    over = over_next;
  }
  return at_mm;
}

/// How far from the place, along `up`, the lowest is of what the changed passes leave, mm. Passes
/// that bend there or come from far are swept as they are, by bent(pass, x, y, radius), others as
/// straight ones.
template <class Bent>
[[nodiscard]] double lowest_rise_mm(const Observation& o, double radius_mm,
                                    const PassChanges& changes, const Bent& bent, Vec3 up) {
  double lowest = INFINITY;
  const auto let_in = [&](const PassBeside& p, const CutChange& c) {
    const bool as_it_is = o.pass && (c.curves(radius_mm) || is_far(c));
    if (!as_it_is && !c.turns() && dot(p.normal, up) > kLeastCosine) {
      const Vec3 tip = c.tip_mm + towards_place(p.normal, radius_mm, c.runout_mm);
      if (first_order_rise_mm(p, tip, c, up) >= lowest) return;
    }
    if (!as_it_is) {
      lowest = std::fmin(lowest, rise_mm(p, radius_mm, c, up));
      return;
    }
    // Looked for from where it is met if all of it is moved as it is here: a straight one along the
    // bent direction is soon far from all that the ball comes to.
    CutChange here = c;
    here.tip_per_mm = {};
    const auto over_mm = [&](double rise) {
      const Vec3 at = o.place + rise * up;
      return bent(p, at.x, at.y, radius_mm + c.radius_mm) - at.z;
    };
    lowest = std::fmin(lowest,
                       met_mm(rise_mm(p, radius_mm, here, up),
                              -std::fmax(kLeastCosine, dot(p.normal, up)) / p.normal.z, over_mm));
  };
  let_in({o, o.normal}, changes[0]);
  std::size_t i = 0;
  for (const Rival& r : rivals_of(o)) let_in({r.state, r.normal, r.above_mm}, changes[++i]);
  return lowest;
}

/// By how much the residual moves if each pass is changed by change(state, normal of its ball at
/// the place): the lowest is what remains. Along the beam where passes beside the place are changed
/// otherwise; what moves them alike is looked up over it, for along the beam it would be met beyond
/// the passes that are known.
/// @param bent  bent(pass, x, y, radius): Pass::height_mm of a pass that bends, so changed
/// @param shift  unless null: how all of them are moved alike; nullopt: they are not, or the ball
///   is another
template <class Change, class Bent>
[[nodiscard]] double recut_mm(const Observation& o, double radius_mm, const Change& change,
                              const Bent& bent, std::optional<Vec3>* shift = nullptr) {
  if (!o.on_surface) return dot(o.along, change(o, o.normal).tip_mm);
  PassChanges changes;
  changes[0] = change(o, o.normal);
  if (o.by_tip) {
    const CutChange& c = changes[0];
    if (shift != nullptr && c.radius_mm == 0.0 && c.runout_mm == 0.0) *shift = c.tip_mm;
    const Vec3 tip = c.tip_mm + towards_place(o.normal, radius_mm, c.runout_mm);
    return dot(o.along, o.normal) * first_order_rise_mm({o, o.normal}, tip, c, o.normal);
  }
  const auto rivals = rivals_of(o);
  // The second bound is one that compilers see.
  for (std::size_t i = 0; i < rivals.size() && i < kMostRivals; ++i)
    changes[i + 1] = change(rivals[i].state, rivals[i].normal);
  const bool part = passes_part(o, changes);
  if (shift != nullptr && !part && changes[0].radius_mm == 0.0 && changes[0].runout_mm == 0.0)
    *shift = changes[0].tip_mm;
  const Vec3 up = part ? seen_along(o) : Vec3{0.0, 0.0, 1.0};
  return lowest_rise_mm(o, radius_mm, changes, bent, up) * dot(o.along, o.normal) *
         dot(up, o.normal);
}
template <class Change>
[[nodiscard]] double recut_mm(const Observation& o, double radius_mm, const Change& change,
                              std::optional<Vec3>* shift = nullptr) {
  return recut_mm(
      o, radius_mm, change,
      [&](const PassBeside& p, double x, double y, double radius) {
        return o.pass->height_mm(p.state, x, y, radius, [&](const CutState& t) {
          const CutChange there = change(t, p.normal);
          return there.tip_mm + towards_place(p.normal, radius_mm, there.runout_mm);
        });
      },
      shift);
}

/// Off the command by `at`, and by `per_mm` more with each mm of way.
struct Drift {
  Vec3 at, per_mm;
  std::array<bool, 3> bends{};    ///< by axis: `per_mm` jumps within kBendReach_mm of the way
  double curvature_per_mm = 0.0;  ///< of a wave, at most
};
/// What follows the command all along the program: where it stands at a state.
using Trail = std::function<Drift(const CutState&)>;

/// Waves along the path. What is steady in time goes on while the cutter is lifted, and while the
/// machine slows down and speeds up.
struct PathWave {
  double waves = 0.0;        ///< over Scene::cut_mm
  double rapid_share = 0.0;  ///< what a mm of rapid way counts for, in mm of CutState::path_mm
  double at_stops = 0.0;     ///< waves that each of CutState::stops adds
};

/// What all observations of a case have in common.
struct Scene {
  Box3 box;  ///< of the part's surface
  bool has_path = false;
  /// Passes of quite other times run through the surface side by side: one raster over another.
  bool passes_cross = false;
  /// They do along borders: one half milled after the other.
  bool passes_meet = false;
  double duration_min = 0.0;
  double ball_radius_mm = 3.0;
  double coat_mm = 0.0;  ///< as declared
  std::vector<double>
      section_starts;  ///< shares of time at which sections begin, the first left out
  /// Candidates of chatter: waves over the longer side along x and y, along the path.
  std::vector<double> waves_x, waves_y;
  std::vector<PathWave> waves_path;
  /// Candidates of guides that wave: over the longer side.
  std::vector<double> slow_waves_x, slow_waves_y;
  double cut_mm = 0.0;  ///< CutState::path_mm at the program's end
  /// Of a width of lost motion, mm: the side of the slack on which each axis stands, -1 .. 1, less
  /// its mean over the cut. Empty without a program.
  std::function<Trail(double width_mm)> slack;
  /// Of a first-order lag, mm of way at the feed that most of the cut has: how far the tip is off
  /// the path, mm. Empty without a program.
  std::function<Trail(double lag_mm)> lag;
  /// Of a lag and lost motion of one axis in the same machine: on which side of the slack the axis
  /// stands, less where it stands with the slack alone. @param lag_first  the slack is behind the
  /// drive that lags (a table that the screw turns late), else before it (a scale on the motor)
  std::function<Trail(int axis, double width_mm, double lag_mm, bool lag_first)> slack_with_lag;
  /// Candidates of steps along x, y, z: shares of the program's time.
  std::array<std::vector<double>, 3> steps;
  /// What the machine did above a place, for a cutter that cuts with its tip; none: no pass within
  /// a ball's radius. Empty without a program.
  std::function<std::optional<CutState>(double x_mm, double y_mm)> above;
  /// What crests keep of a spray from afar, by the unit direction towards the gun. Empty: unknown.
  std::function<std::shared_ptr<const CastShadow>(Vec3 towards)> shadow;
  std::vector<bool> has_station;  ///< by set-up
  std::vector<Vec3> stations;
  [[nodiscard]] Vec3 centre() const { return 0.5 * (box.min + box.max); }
  /// Half the longer side in plan.
  [[nodiscard]] double half_mm() const {
    return 0.5 * std::fmax(box.max.x - box.min.x, box.max.y - box.min.y);
  }
};

}  // namespace maquette::diagnosis

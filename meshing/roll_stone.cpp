// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/detail/roll_stone.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>
#include <vector>

#include "core/random.hpp"
#include "meshing/detail/solid_mass.hpp"
#include "meshing/detail/stone_clearance.hpp"
#include "meshing/settle_stones.hpp"

namespace maquette::meshing::detail {
namespace {

/// A turn ends before anything is deeper than this; above the rounding of coordinates of metres.
constexpr double kTouch_mm = 1e-9;
/// It turns about what is not farther from the ground than this: about what only nearly touches, it
/// would turn what does touch into it.
constexpr double kTouches_mm = 1e-7;
/// So far outside the contacts' polygon the centre of mass is still held.
constexpr double kHeld_mm = 1e-5;
/// Contacts that seen from above are nearer to each other, or to the line of others, are no
/// corners.
constexpr double kSame_mm = 1e-8;
/// What the first look whether an axis is blocked turns by; an axis about which it turns by
/// kLongTurn is not.
constexpr double kSmallestTurn = 1e-6, kLongTurn = 1e-4;
constexpr double kLeastDescent_mm = 1e-12;
/// Looked up at once, and the steps within that a contact is looked for.
constexpr double kTurn = 0.05, kStep = 0.0125;
/// A stone whose centre of mass came down by less in so many turns is wedged.
constexpr int kPatience = 200;
constexpr double kProgress_mm = 1e-4;
constexpr int kWays = 12;  // about one corner, where the fastest is blocked

struct Axis {
  Vec3 at, direction;  ///< unit
  double speed = 0.0;  ///< of the centre of mass upwards, mm per radian
};

RigidTransform turned(const RigidTransform& pose, const Axis& axis, double angle) {
  const Quaternion q = rotation_about(axis.direction, angle);
  return {normalized(q * pose.rotation), axis.at + rotate(q, pose.translation_mm - axis.at)};
}

/// Twice the area of a, b, c seen from above.
double area_of(Vec3 a, Vec3 b, Vec3 c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}
double apart(Vec3 a, Vec3 b) {
  return std::hypot(a.x - b.x, a.y - b.y);
}

/// Convex polygon of the contacts seen from above, counter-clockwise; one or two points where they
/// lie in one place or on one line.
std::vector<Vec3> support_polygon(const std::vector<StoneContact>& contacts) {
  std::vector<Vec3> p;
  for (const StoneContact& c : contacts) p.push_back(c.at);
  std::sort(p.begin(), p.end(), [](Vec3 a, Vec3 b) {
    return a.x != b.x ? a.x < b.x : a.y != b.y ? a.y < b.y : a.z < b.z;
  });
  p.erase(std::unique(p.begin(), p.end(), [](Vec3 a, Vec3 b) { return apart(a, b) < kSame_mm; }),
          p.end());
  if (p.size() < 3) return p;
  std::vector<Vec3> hull;
  for (int side = 0; side < 2; ++side) {
    const std::size_t start = hull.size();
    for (const Vec3 q : p) {
      while (hull.size() >= start + 2 && area_of(hull[hull.size() - 2], hull.back(), q) <=
                                             kSame_mm * apart(hull[hull.size() - 2], q))
        hull.pop_back();
      hull.push_back(q);
    }
    hull.pop_back();
    std::reverse(p.begin(), p.end());
  }
  return hull;
}

bool holds(const std::vector<Vec3>& polygon, Vec3 mass) {
  if (polygon.size() < 3) return false;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Vec3 a = polygon[i], b = polygon[(i + 1) % polygon.size()];
    if (area_of(a, b, mass) < -kHeld_mm * apart(a, b)) return false;
  }
  return true;
}

/// About a line, the way that gravity turns it.
Axis about(Vec3 at, Vec3 direction, Vec3 mass) {
  Axis axis{at, normalized(direction), 0.0};
  axis.speed = cross(axis.direction, mass - at).z;
  if (axis.speed > 0.0) axis.direction = -axis.direction, axis.speed = -axis.speed;
  return axis;
}

/// About the polygon's edges, and about its corners where the centre of mass then goes straight
/// away from them; fastest down first.
std::vector<Axis> axes_of(const std::vector<Vec3>& polygon, Vec3 mass) {
  std::vector<Axis> all;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Vec3 a = polygon[i], way{mass.x - a.x, mass.y - a.y, 0.0};
    if (norm(way) > kHeld_mm) all.push_back(about(a, {-way.y, way.x, 0.0}, mass));
    if (polygon.size() > 1 && (polygon.size() > 2 || i == 0))
      all.push_back(about(a, polygon[(i + 1) % polygon.size()] - a, mass));
  }
  return all;
}
/// All other level axes through the corners that let the centre of mass down.
std::vector<Axis> more_axes_of(const std::vector<Vec3>& polygon, Vec3 mass) {
  std::vector<Axis> all;
  for (const Vec3 a : polygon)
    for (int k = 0; k < kWays; ++k) {
      const double angle = std::numbers::pi * k / kWays;
      all.push_back(about(a, {std::cos(angle), std::sin(angle), 0.0}, mass));
    }
  return all;
}

/// From where the centre of mass is to where it is lowest, hanging below the axis.
double angle_to_lowest(const Axis& axis, Vec3 mass) {
  const Vec3 to_mass = mass - axis.at;
  const Vec3 arm = to_mass - dot(to_mass, axis.direction) * axis.direction;
  const Vec3 up = Vec3{0, 0, 1} - axis.direction.z * axis.direction;
  const double angle = std::atan2(-dot(cross(axis.direction, arm), up), -dot(arm, up));
  return angle > 0.0 ? angle : angle + 2.0 * std::numbers::pi;
}

class Roller {
 public:
  Roller(const TriMesh& stone, const heightmap::ModelField& surface, RigidTransform& pose)
      : clear_(stone, surface), pose_(pose), centre_(solid_mass(stone).centre) {
    for (const Vec3& v : stone.vertices_mm) radius_ = std::fmax(radius_, norm(v - centre_));
  }

  RollEnd roll(double farthest_mm, std::uint64_t toss) {
    if (!clear_.gather(pose_, INFINITY)) return RollEnd::leaves;
    drop();
    const Vec3 start = pose_.point(centre_);
    double height = INFINITY;
    for (int turn = 0;; ++turn) {
      // Any point turns about one of the stone's, at most a diameter away.
      if (!clear_.gather(pose_, kTurn * 2.0 * radius_ + 2.0 * kContact_mm)) return RollEnd::leaves;
      const Vec3 mass = pose_.point(centre_);
      if (apart(mass, start) > farthest_mm) return RollEnd::rolls_on;
      if (turn % kPatience == 0) {
        if (mass.z > height - kProgress_mm) return RollEnd::wedged;
        height = mass.z;
      }
      if (holds(support_polygon(clear_.contacts(pose_, kContact_mm)), mass)) return RollEnd::rests;
      const auto polygon = support_polygon(clear_.contacts(pose_, kTouches_mm));
      bool moved = false;
      if (is_balanced(polygon, mass)) {
        moved = topple(polygon, mass, toss);
        if (!moved) return RollEnd::rests;
      } else {
        moved = turn_about(axes_of(polygon, mass), mass) ||
                turn_about(more_axes_of(polygon, mass), mass);
      }
      if (!moved) return RollEnd::wedged;
      if (off_) return RollEnd::leaves;
      drop();
    }
  }

 private:
  void drop() { pose_.translation_mm.z -= clear_.least_gap_mm(pose_); }

  /// The centre of mass straight above its one contact, or above the line of two.
  static bool is_balanced(const std::vector<Vec3>& polygon, Vec3 mass) {
    if (polygon.size() == 1) return apart(polygon[0], mass) <= kHeld_mm;
    if (polygon.size() != 2) return false;
    const double length = apart(polygon[0], polygon[1]);
    const double along = (mass.x - polygon[0].x) * (polygon[1].x - polygon[0].x) +
                         (mass.y - polygon[0].y) * (polygon[1].y - polygon[0].y);
    return std::abs(area_of(polygon[0], polygon[1], mass)) <= kHeld_mm * length && along >= 0.0 &&
           along <= length * length;
  }

  bool topple(const std::vector<Vec3>& polygon, Vec3 mass, std::uint64_t toss) {
    const double angle = 2.0 * std::numbers::pi * random_uniform(toss, 0);
    Vec3 direction{std::cos(angle), std::sin(angle), 0.0};
    if (polygon.size() == 2) {
      direction = normalized(polygon[1] - polygon[0]);
      if (random_uniform(toss, 1) < 0.5) direction = -direction;
    }
    for (const Vec3 d : {direction, -direction}) {
      const Axis axis{polygon[0], d, 0.0};
      const RigidTransform there = turned(pose_, axis, free_angle(axis, mass));
      if (there.point(centre_).z < mass.z) {
        pose_ = there;
        return true;
      }
    }
    return false;
  }

  /// About the axis that lets the centre of mass down fastest if it turns by kLongTurn about it, or
  /// about the one that lets it down farthest.
  bool turn_about(std::vector<Axis> axes, Vec3 mass) {
    std::stable_sort(axes.begin(), axes.end(),
                     [](const Axis& a, const Axis& b) { return a.speed < b.speed; });
    double best = kLeastDescent_mm;
    RigidTransform there;
    bool moves = false;
    for (const bool in_the_way : {false, true}) {
      for (const Axis& axis : axes) {
        if (!(axis.speed < -0.1 * kHeld_mm)) break;
        if (goes(axis, kSmallestTurn) == in_the_way) continue;
        const double angle = free_angle(axis, mass);
        const double descent = -axis.speed * angle;
        if (angle >= kLongTurn || descent > best) {
          best = descent;
          there = turned(pose_, axis, angle);
          moves = true;
        }
        if (angle >= kLongTurn) break;
      }
      if (moves) break;
    }
    if (moves) pose_ = there;
    return moves;
  }

  bool goes(const Axis& axis, double angle) {
    const double gap = clear_.least_gap_mm(turned(pose_, axis, angle), -kTouch_mm);
    if (std::isnan(gap)) off_ = true;
    return !(gap < -kTouch_mm);
  }

  /// Until something new touches, the centre of mass is at its lowest, or what was looked up ends.
  double free_angle(const Axis& axis, Vec3 mass) {
    const double end = std::fmin(kTurn, angle_to_lowest(axis, mass));
    double reached = 0.0, blocked = std::fmin(kSmallestTurn, end);
    while (goes(axis, blocked)) {
      reached = blocked;
      if (reached >= end || off_) return reached;
      blocked = std::fmin(reached + kStep, end);
    }
    // So near that what stops it touches.
    const double exact = 0.25 * kTouches_mm / radius_;
    while (blocked - reached > exact) {
      const double middle = 0.5 * (reached + blocked);
      (goes(axis, middle) ? reached : blocked) = middle;
    }
    return reached;
  }

  StoneClearance clear_;
  RigidTransform& pose_;
  Vec3 centre_;
  double radius_ = 0.0;
  bool off_ = false;  ///< something came over a void or the border
};

}  // namespace

RollEnd roll_stone(const TriMesh& stone, const heightmap::ModelField& surface, double farthest_mm,
                   std::uint64_t toss, RigidTransform& model_from_stone) {
  return Roller(stone, surface, model_from_stone).roll(farthest_mm, toss);
}

}  // namespace maquette::meshing::detail

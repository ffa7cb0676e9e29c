// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/probing.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "cnc/pass_sampler.hpp"

namespace maquette::cnc {
namespace {

Result<void> range(const char* name, double value, double least, double most) {
  if (value >= least && value <= most) return {};
  return fail(kProbingOptionOutOfRange,
              fmt::format("{} is {}; it must be from {} to {}", name, value, least, most));
}

Result<void> check(const ProbingOptions& o) {
  if (o.post != "linuxcnc" && o.post != "grbl")
    return fail(kProbingNotPossible,
                fmt::format("'{}' has no G38.2; set the work offset with the control's own probing "
                            "cycles, or take the linuxcnc or grbl post",
                            o.post));
  const bool extended = o.post == "linuxcnc" && o.work_offset >= 591 && o.work_offset <= 593;
  if (!extended && !(o.work_offset >= 54 && o.work_offset <= 59))
    return fail(kProbingOptionOutOfRange,
                fmt::format("work_offset is {}; it must be 54 to 59, on LinuxCNC also 591 to 593",
                            o.work_offset));
  MAQUETTE_TRY_VOID(range("probe ball radius (mm)", o.ball_radius_mm, 0.1, 20.0));
  MAQUETTE_TRY_VOID(range("search (mm)", o.search_mm, 0.5, 100.0));
  MAQUETTE_TRY_VOID(range("retract (mm)", o.retract_mm, 0.1, 0.9 * o.search_mm));
  MAQUETTE_TRY_VOID(range("fast_feed (mm/min)", o.fast_feed_mm_min, 1.0, 2000.0));
  MAQUETTE_TRY_VOID(range("slow_feed (mm/min)", o.slow_feed_mm_min, 0.1, o.fast_feed_mm_min));
  return {};
}

/// One touch after another, as text.
class Touches {
 public:
  explicit Touches(const ProbingOptions& o) : o_(o) {}
  void line(const std::string& text) { text_ += text + "\n"; }
  void rapid(const std::string& words) { line("G0 " + words); }

  /// From where the probe stands towards `nominal` along the axis, `search` beyond it at
  /// most; ends `search` before it.
  void touch(char axis, double nominal, double direction) {
    const double beyond = nominal + direction * o_.search_mm;
    line(fmt::format("G38.2 {}{:.4f} F{}", axis, beyond, o_.fast_feed_mm_min));
    line(fmt::format("G91 G0 {}{:.4f}", axis, -direction * o_.retract_mm));
    // The second touch may come up to twice the retract later.
    line(fmt::format("G38.2 {}{:.4f} F{}", axis, direction * 2.0 * o_.retract_mm,
                     o_.slow_feed_mm_min));
    line("G90");
  }
  /// Makes the place of the last contact the nominal one. The numbers of an offset: G54 is P1,
  /// its x, y, z are #5221 to #5223, each further offset 20 later.
  void set(char axis, double nominal) {
    const int number = o_.work_offset < 60 ? o_.work_offset - 53 : o_.work_offset - 584;
    const int of_axis = axis - 'X';
    if (o_.post == "linuxcnc") {
      line(fmt::format("G10 L2 P{} {}[#{} + #{} - [{:.4f}]]", number, axis,
                       5221 + 20 * (number - 1) + of_axis, 5061 + of_axis, nominal));
    } else {
      line(fmt::format("G10 L20 P{} {}{:.4f}", number, axis, nominal));
    }
  }
  [[nodiscard]] std::string text() const { return text_; }

 private:
  const ProbingOptions& o_;
  std::string text_;
};

std::int64_t on_lattice(double mm) {
  return std::llround(mm / (kTick_mm * kResolution)) * kResolution;
}

}  // namespace

Result<std::string> probe_block_corner(const BlockCorner& corner, const ProbingOptions& options) {
  MAQUETTE_TRY_VOID(check(options));
  for (const double v : {corner.x_mm, corner.y_mm, corner.top_mm})
    MAQUETTE_TRY_VOID(range("corner (mm)", v, -1e5, 1e5));
  MAQUETTE_TRY_VOID(range("inset (mm)", corner.inset_mm, options.ball_radius_mm, 1000.0));
  // The ball's equator touches: it must be below the top edge.
  MAQUETTE_TRY_VOID(range("depth (mm)", corner.depth_mm, options.ball_radius_mm, 1000.0));
  Touches t(options);
  const double away = options.ball_radius_mm + options.search_mm;
  const double over = corner.top_mm + options.search_mm, deep = corner.top_mm - corner.depth_mm;
  t.line("(probe: work offset on the block's corner)");
  t.rapid(fmt::format("Z{:.4f}", over));
  t.rapid(
      fmt::format("X{:.4f} Y{:.4f}", corner.x_mm + corner.inset_mm, corner.y_mm + corner.inset_mm));
  t.touch('Z', corner.top_mm, -1.0);
  t.set('Z', corner.top_mm);
  t.rapid(fmt::format("Z{:.4f}", over));
  t.rapid(fmt::format("X{:.4f}", corner.x_mm - away));
  t.rapid(fmt::format("Z{:.4f}", deep));
  t.touch('X', corner.x_mm - options.ball_radius_mm, 1.0);
  t.set('X', corner.x_mm - options.ball_radius_mm);
  t.rapid(fmt::format("X{:.4f}", corner.x_mm - away));
  t.rapid(fmt::format("Z{:.4f}", over));
  t.rapid(fmt::format("X{:.4f} Y{:.4f}", corner.x_mm + corner.inset_mm, corner.y_mm - away));
  t.rapid(fmt::format("Z{:.4f}", deep));
  t.touch('Y', corner.y_mm - options.ball_radius_mm, 1.0);
  t.set('Y', corner.y_mm - options.ball_radius_mm);
  t.rapid(fmt::format("Y{:.4f}", corner.y_mm - away));
  t.rapid(fmt::format("Z{:.4f}", over));
  t.rapid(fmt::format("X{:.4f} Y{:.4f}", corner.x_mm, corner.y_mm));
  return t.text();
}

Result<std::string> probe_spheres(std::span<const Vec3> centres_mm, double sphere_radius_mm,
                                  const std::string& log_name, const ProbingOptions& options) {
  MAQUETTE_TRY_VOID(check(options));
  if (options.post != "linuxcnc")
    return fail(kProbingNotPossible,
                fmt::format("'{}' cannot write contacts to a file; measure the spheres by hand, or "
                            "take the linuxcnc post",
                            options.post));
  MAQUETTE_TRY_VOID(range("sphere radius (mm)", sphere_radius_mm, 1.0, 200.0));
  Touches t(options);
  const double reach = sphere_radius_mm + options.ball_radius_mm;
  const double away = reach + options.search_mm;
  double over = options.over_mm;
  for (const Vec3& c : centres_mm) {
    for (const double v : {c.x, c.y, c.z})
      MAQUETTE_TRY_VOID(range("sphere centre (mm)", v, -1e5, 1e5));
    over = std::max(over, c.z + sphere_radius_mm + options.search_mm);
  }
  t.line("(PROBEOPEN " + log_name + ")");
  for (const Vec3& c : centres_mm) {
    const double equator = c.z - options.ball_radius_mm;  // of the tip
    t.rapid(fmt::format("Z{:.4f}", over));
    t.rapid(fmt::format("X{:.4f} Y{:.4f}", c.x, c.y));
    t.touch('Z', c.z + sphere_radius_mm, -1.0);
    t.rapid(fmt::format("Z{:.4f}", over));
    for (const auto& [axis, side] : {std::pair{'X', -1.0}, {'X', 1.0}, {'Y', -1.0}, {'Y', 1.0}}) {
      const double middle = axis == 'X' ? c.x : c.y;
      t.rapid(axis == 'X' ? fmt::format("X{:.4f} Y{:.4f}", c.x + side * away, c.y)
                          : fmt::format("X{:.4f} Y{:.4f}", c.x, c.y + side * away));
      t.rapid(fmt::format("Z{:.4f}", equator));
      t.touch(axis, middle + side * reach, -side);
      t.rapid(fmt::format("{}{:.4f}", axis, middle + side * away));
      t.rapid(fmt::format("Z{:.4f}", over));
    }
  }
  t.line("(PROBECLOSE)");
  return t.text();
}

double seated_centre_z_mm(const SphereSeat& seat) {
  return seat.rim_mm + std::sqrt(seat.sphere_radius_mm * seat.sphere_radius_mm -
                                 seat.hole_radius_mm * seat.hole_radius_mm);
}

Result<Toolpath> bore_sphere_seat(const SphereSeat& seat, const BoreOptions& o) {
  MAQUETTE_TRY_VOID(range("cutter radius (mm)", o.cutter_radius_mm, 0.2, 50.0));
  MAQUETTE_TRY_VOID(range("hole radius (mm)", seat.hole_radius_mm, o.cutter_radius_mm + 0.01,
                          2.0 * o.cutter_radius_mm));
  MAQUETTE_TRY_VOID(
      range("sphere radius (mm)", seat.sphere_radius_mm, 1.01 * seat.hole_radius_mm, 1000.0));
  MAQUETTE_TRY_VOID(range("below (mm)", seat.below_mm, 0.0, 100.0));
  MAQUETTE_TRY_VOID(range("ramp_angle (degrees)", o.ramp_angle_deg, 0.5, 30.0));
  MAQUETTE_TRY_VOID(range("feed (mm/min)", o.feed_mm_min, 0.01, 1e6));
  MAQUETTE_TRY_VOID(range("clearance (mm)", o.clearance_mm, 0.0, 1e4));
  for (const double v : {seat.x_mm, seat.y_mm, seat.rim_mm})
    MAQUETTE_TRY_VOID(range("place of the seat (mm)", v, -1e5, 1e5));

  const std::int64_t x = on_lattice(seat.x_mm), y = on_lattice(seat.y_mm);
  const std::int64_t radius = on_lattice(seat.hole_radius_mm - o.cutter_radius_mm);
  const std::int64_t rim = on_lattice(seat.rim_mm), high = on_lattice(seat.rim_mm + o.clearance_mm);
  const double lowest = seated_centre_z_mm(seat) - seat.sphere_radius_mm - seat.below_mm;
  const std::int64_t floor = on_lattice(lowest);
  Toolpath path;
  path.start = {x + radius, y, high};
  const auto add = [&](PathMove::Kind kind, ToolPosition to) {
    PathMove move;
    move.kind = kind;
    move.to = to;
    if (kind != PathMove::Kind::rapid) move.feed_mm_min = o.feed_mm_min;
    path.moves.push_back(move);
  };
  // Half turns, counter-clockwise: climb milling of an inner wall.
  bool right = true;
  const auto half_turn = [&](std::int64_t z) {
    add(PathMove::Kind::arc, {right ? x - radius : x + radius, y, z});
    path.moves.back().counter_clockwise = true;
    path.moves.back().i = right ? -radius : radius;
    right = !right;
  };
  add(PathMove::Kind::line, {x + radius, y, rim});
  const double slope = std::tan(o.ramp_angle_deg * std::numbers::pi / 180.0);
  const double a_turn = std::numbers::pi * mm_of_ticks(radius) * slope;
  const auto turns = std::max<std::int64_t>(
      1, static_cast<std::int64_t>(std::ceil(mm_of_ticks(rim - floor) / a_turn)));
  for (std::int64_t k = 1; k <= turns; ++k) {
    const double z = mm_of_ticks(rim) +
                     mm_of_ticks(floor - rim) * static_cast<double>(k) / static_cast<double>(turns);
    half_turn(on_lattice(z));
  }
  half_turn(floor);
  half_turn(floor);
  add(PathMove::Kind::line, {x, y, floor});
  add(PathMove::Kind::rapid, {x, y, high});
  return path;
}

}  // namespace maquette::cnc

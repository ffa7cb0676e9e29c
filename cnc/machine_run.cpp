// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/machine_run.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

namespace maquette::cnc {
namespace {

double& axis_of(Vec3& v, int axis) {
  return axis == 0 ? v.x : axis == 1 ? v.y : v.z;
}
double axis_of(const Vec3& v, int axis) {
  return axis == 0 ? v.x : axis == 1 ? v.y : v.z;
}

}  // namespace

MachineRun::MachineRun(MachineErrors errors, std::vector<Tool> tools, double ball_radius_mm)
    : errors_(std::move(errors)),
      part_from_machine_(errors_.machine_from_part.inverse()),
      tools_(std::move(tools)),
      ball_radius_mm_(ball_radius_mm) {}

Vec3 MachineRun::tip(Vec3 called, int tool) const {
  double corner = tools_.empty() ? ball_radius_mm_ : tools_.front().cutter.corner_radius_mm;
  for (const Tool& t : tools_)
    if (t.number == tool) corner = t.cutter.corner_radius_mm;
  const Vec3 up{0.0, 0.0, corner};
  const Vec3 stands =
      called + Vec3{behind_mm_[0], behind_mm_[1], behind_mm_[2]} + errors_.at(called, tool);
  return part_from_machine_.point(stands + up) - up;
}

void MachineRun::line(Vec3 from, Vec3 to, const Motion& called, std::vector<Motion>& made) {
  const Vec3 step = to - from;
  // Where along the line, 0 to 1, the slack of an axis ends or a table has a stop.
  std::vector<double> bends;
  for (int axis = 0; axis < 3; ++axis) {
    const double s = axis_of(step, axis), half = 0.5 * axis_of(errors_.backlash_mm, axis);
    if (s == 0.0) continue;
    if (!std::exchange(moved_[axis], true)) behind_mm_[axis] = s > 0.0 ? -half : half;
    const double slack = s > 0.0 ? behind_mm_[axis] + half : half - behind_mm_[axis];
    if (slack > 0.0) bends.push_back(slack / std::fabs(s));
    for (const auto& table : errors_.straightness)
      if (table.along == axis)
        for (const double stop : table.position_mm)
          bends.push_back((stop - axis_of(from, axis)) / s);
  }
  std::erase_if(bends, [](double t) { return !(t > 0.0 && t < 1.0); });
  bends.push_back(1.0);
  std::sort(bends.begin(), bends.end());
  double before = 0.0;
  Vec3 at = tip(from, called.tool);
  for (const double t : bends) {
    if (t <= before) continue;
    for (int axis = 0; axis < 3; ++axis) {
      const double half = 0.5 * axis_of(errors_.backlash_mm, axis);
      behind_mm_[axis] =
          std::clamp(behind_mm_[axis] - (t - before) * axis_of(step, axis), -half, half);
    }
    before = t;
    const Vec3 place = t < 1.0 ? from + t * step : to;
    const Vec3 next = tip(place, called.tool), off = next - place;
    largest_mm_ = std::max({largest_mm_, std::fabs(off.x), std::fabs(off.y), std::fabs(off.z)});
    if (next == at) continue;
    Motion& m = made.emplace_back(called);
    if (m.kind == Motion::Kind::arc) m.kind = Motion::Kind::line;
    m.from_mm = at;
    m.to_mm = at = next;
  }
}

void MachineRun::add(const Motion& called, std::vector<Motion>& made) {
  if (called.kind == Motion::Kind::arc)
    for_each_chord(called, kRunChord_mm, [&](Vec3 from, Vec3 to) { line(from, to, called, made); });
  else
    line(called.from_mm, called.to_mm, called, made);
}

}  // namespace maquette::cnc

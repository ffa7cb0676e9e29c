// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/path_under.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "cnc/gcode_reader.hpp"

namespace maquette::tools {
namespace {

struct Pass {
  float order_m = NAN, direction_deg = NAN, feed_mm_min = NAN;
};

/// A node of the design by place; nothing beside it.
Pass* node_at(Grid<Pass>& grid, const heightmap::ModelField& f, double x, double y) {
  const auto c = std::lround((x - f.x0.value()) / f.spacing.value());
  const auto r = std::lround((y - f.y0.value()) / f.spacing.value());
  return grid.contains(r, c) ? &grid(r, c) : nullptr;
}

}  // namespace

Result<PathUnder> path_under(std::span<const std::filesystem::path> programs,
                             const heightmap::ModelField& design, double reach_mm,
                             std::span<const Vec3> points, const RunContext& run) {
  Grid<Pass> grid(design.z_mm.rows(), design.z_mm.cols(), Pass{});
  const double step = 0.5 * design.spacing.value();
  double before_mm = 0.0;
  const auto mark = [&](const cnc::Motion& m, Vec3 from, Vec3 to) {
    const double length = norm(to - from);
    const double flat = std::hypot(to.x - from.x, to.y - from.y);
    if (flat > 1e-9) {
      const auto heading =
          static_cast<float>(180.0 / std::numbers::pi * std::atan2(to.y - from.y, to.x - from.x));
      const auto n = static_cast<int>(std::ceil(flat / step));
      for (int k = 0; k <= n; ++k) {
        const double t = static_cast<double>(k) / n;
        const Vec3 p = from + t * (to - from);
        Pass* at = node_at(grid, design, p.x, p.y);
        if (at == nullptr) continue;
        const double h = heightmap::height_at(design, p.x, p.y);
        if (!(std::abs(p.z - h) <= reach_mm)) continue;
        *at = {static_cast<float>((before_mm + t * length) / 1000.0), heading,
               static_cast<float>(m.feed_mm_min)};
      }
    }
    before_mm += length;
  };
  for (const auto& program : programs) {
    const cnc::MotionSink sink = [&](std::span<const cnc::Motion> motions) -> Result<void> {
      for (const cnc::Motion& m : motions)
        if (m.kind != cnc::Motion::Kind::rapid && !m.probe)
          cnc::for_each_chord(m, 0.1 * step, [&](Vec3 a, Vec3 b) { mark(m, a, b); });
      return {};
    };
    MAQUETTE_TRY_VOID(cnc::read_gcode(program, sink, run));
  }
  PathUnder under;
  for (const Vec3& p : points) {
    const Pass* pass = node_at(grid, design, p.x, p.y);
    const Pass here = pass == nullptr ? Pass{} : *pass;
    under.order_m.push_back(here.order_m);
    under.direction_deg.push_back(here.direction_deg);
    under.feed_mm_min.push_back(here.feed_mm_min);
  }
  return under;
}

}  // namespace maquette::tools

// SPDX-License-Identifier: GPL-3.0-or-later

// Whether the ball can touch the design at a node: it is put there along the normal of a facet
// that holds the node, and the exact cutter location says how far it would have to rise. Whether it
// has room: the same around, on the facet's plane. What it leaves there at best: a search for the
// lowest place of its underside over the node.

#include <algorithm>
#include <array>
#include <cmath>

#include <tbb/enumerable_thread_specific.h>
#include <tbb/parallel_for.h>

#include "cnc/certificate.hpp"
#include "cnc/cutter_location.hpp"

namespace maquette::cnc {
namespace {

constexpr std::size_t kBlocksAtOnce = 16;  // fixed, so that the result is the same for any threads

constexpr double kHalf = 0.70710678118654752;
constexpr std::array<std::array<double, 2>, 8> kAround{{{1.0, 0.0},
                                                        {kHalf, kHalf},
                                                        {0.0, 1.0},
                                                        {-kHalf, kHalf},
                                                        {-1.0, 0.0},
                                                        {-kHalf, -kHalf},
                                                        {0.0, -1.0},
                                                        {kHalf, -kHalf}}};

constexpr double kWidestLook_mm = 0.16, kFinestLook_mm = 0.008;  // for the ball's best place

struct PlanPlaceMm {
  double x, y;
};

struct Candidate {
  double value;
  std::ptrdiff_t row, col;
};

}  // namespace

struct ReachSearch::State {
  const heightmap::ModelField& design;
  std::ptrdiff_t k;
  double R;
  tbb::enumerable_thread_specific<DropCutter> cutters;

  /// True if a node of the design stands inside the ball: a tenth of the cost of a drop.
  [[nodiscard]] bool vertex_above(double px, double py, double tip) const {
    const Grid<float>& z = design.z_mm;
    const double d = design.spacing.value();
    const double tx = (px - design.x0.value()) / d, ty = (py - design.y0.value()) / d, n = R / d;
    const auto first = [](double t) {
      return std::max<std::ptrdiff_t>(0, static_cast<std::ptrdiff_t>(std::ceil(t)));
    };
    const std::ptrdiff_t r1 =
        std::min(z.rows() - 1, static_cast<std::ptrdiff_t>(std::floor(ty + n)));
    const std::ptrdiff_t c0 = first(tx - n),
                         c1 = std::min(z.cols() - 1,
                                       static_cast<std::ptrdiff_t>(std::floor(tx + n)));
    const auto centre = static_cast<float>(tip + R);
    const auto from = static_cast<float>(tx - static_cast<double>(c0));
    const auto d2 = static_cast<float>(d * d);
    for (std::ptrdiff_t r = first(ty - n); r <= r1; ++r) {
      const double dy = (static_cast<double>(r) - ty) * d;
      // Less than the ball by what single precision may add.
      const auto left = static_cast<float>((R * R - dy * dy) * (1.0 - 1e-5));
      const float* row = &z(r, c0);
      bool inside = false;
      for (std::ptrdiff_t c = 0; c <= c1 - c0; ++c) {
        const float dx = static_cast<float>(c) - from, q = left - d2 * dx * dx;
        const float below = centre - row[c];  // of the node, below the centre
        inside |= (q > 0.0F) & (below * (below > 0.0F ? below : 0.0F) < q - 1e-4F);
      }
      if (inside) return true;
    }
    return false;
  }

  /// Calls visit(height of the node, slope along x, along y) for each facet that holds the node,
  /// until it returns false.
  template <class Visit>
  void for_each_facet(std::ptrdiff_t row, std::ptrdiff_t col, Visit&& visit) const {
    const Grid<float>& z = design.z_mm;
    const double d = design.spacing.value();
    for (std::ptrdiff_t r = std::max<std::ptrdiff_t>(0, (row + k - 1) / k - 1);
         r <= std::min(z.rows() - 2, row / k); ++r)
      for (std::ptrdiff_t c = std::max<std::ptrdiff_t>(0, (col + k - 1) / k - 1);
           c <= std::min(z.cols() - 2, col / k); ++c) {
        const std::ptrdiff_t i = row - r * k, j = col - c * k;
        const double v = static_cast<double>(i) / static_cast<double>(k);
        const double u = static_cast<double>(j) / static_cast<double>(k);
        const double z00 = z(r, c), z10 = z(r, c + 1), z01 = z(r + 1, c), z11 = z(r + 1, c + 1);
        if (j >= i &&
            !visit(z00 + u * (z10 - z00) + v * (z11 - z10), (z10 - z00) / d, (z11 - z10) / d))
          return;
        if (i >= j &&
            !visit(z00 + v * (z01 - z00) + u * (z11 - z01), (z11 - z01) / d, (z01 - z00) / d))
          return;
      }
  }
  [[nodiscard]] PlanPlaceMm place(std::ptrdiff_t row, std::ptrdiff_t col) const {
    const double step = design.spacing.value() / static_cast<double>(k);
    return {design.x0.value() + step * static_cast<double>(col),
            design.y0.value() + step * static_cast<double>(row)};
  }

  /// @param room_mm  0: whether there is room does not matter
  [[nodiscard]] BallReach reach(std::ptrdiff_t row, std::ptrdiff_t col, double room_mm,
                                DropCutter& cutter) const {
    const auto [x, y] = place(row, col);
    BallReach best = BallReach::none;
    for_each_facet(row, col, [&, x = x, y = y](double height, double gx, double gy) {
      const double steep = std::sqrt(1.0 + gx * gx + gy * gy);
      const double tip = height + R / steep - R;
      const double px = x - R * gx / steep, py = y - R * gy / steep;
      if (vertex_above(px, py, tip + kReachTolerance_mm)) return true;
      if (cutter.drop(px, py).tip_mm > tip + kReachTolerance_mm) return true;
      best = BallReach::tight;
      for (const auto& [ux, uy] : kAround) {
        if (room_mm == 0.0) break;
        const double dx = room_mm * ux, dy = room_mm * uy;
        const double slid = tip + gx * dx + gy * dy + kRoomTolerance_mm;
        if (cutter.drop(px + dx, py + dy).tip_mm > slid) return true;
      }
      best = BallReach::roomy;
      return false;
    });
    return best;
  }

  [[nodiscard]] double closing(std::ptrdiff_t row, std::ptrdiff_t col, DropCutter& cutter) const {
    const auto [x, y] = place(row, col);
    double design_mm = 0.0, left = INFINITY, bx = 0.0, by = 0.0;
    const auto look = [&, x = x, y = y](double px, double py) {
      const double q = R * R - (px - x) * (px - x) - (py - y) * (py - y);
      if (!(q > 0.0)) return false;
      const double over = cutter.drop(px, py).tip_mm + R - std::sqrt(q) - design_mm;
      if (over >= left) return false;
      left = over;
      bx = px;
      by = py;
      return true;
    };
    for_each_facet(row, col, [&, x = x, y = y](double height, double gx, double gy) {
      const double steep = std::sqrt(1.0 + gx * gx + gy * gy);
      design_mm = height;
      look(x - R * gx / steep, y - R * gy / steep);
      return true;
    });
    for (double step = kWidestLook_mm; step > kFinestLook_mm; step *= 0.5)
      for (bool moved = true; moved && left > 0.0;) {
        const double cx = bx, cy = by;
        moved = false;
        for (const auto& [ux, uy] : kAround) moved |= look(cx + step * ux, cy + step * uy);
      }
    return std::max(0.0, left);
  }
};

ReachSearch::ReachSearch(const heightmap::ModelField& design, std::ptrdiff_t per_spacing,
                         double ball_radius_mm) {
  // Without a radius everything is within reach.
  if (ball_radius_mm > 0.0)
    state_ = std::make_unique<State>(State{design, per_spacing, ball_radius_mm,
                                           tbb::enumerable_thread_specific<DropCutter>(
                                               DropCutter(design, Cutter::ball(ball_radius_mm)))});
}
ReachSearch::~ReachSearch() = default;

BallReach ReachSearch::at(std::ptrdiff_t row, std::ptrdiff_t col, double room_mm) const {
  return state_ ? state_->reach(row, col, room_mm, state_->cutters.local()) : BallReach::roomy;
}

double ReachSearch::closing_mm(std::ptrdiff_t row, std::ptrdiff_t col) const {
  return state_ ? state_->closing(row, col, state_->cutters.local()) : 0.0;
}

Result<double> ReachSearch::raise(
    std::vector<ReachBlock> blocks,
    const std::function<double(std::ptrdiff_t, std::ptrdiff_t)>& value, double best,
    const RunContext& run) {
  std::sort(blocks.begin(), blocks.end(), [](const ReachBlock& a, const ReachBlock& b) {
    if (a.value != b.value) return a.value > b.value;
    return a.r0 != b.r0 ? a.r0 < b.r0 : a.c0 < b.c0;
  });
  const auto best_of = [&](const ReachBlock& b) {
    std::vector<Candidate> candidates;
    for (std::ptrdiff_t r = b.r0; r < b.r1; ++r)
      for (std::ptrdiff_t c = b.c0; c < b.c1; ++c)
        if (const double at_node = value(r, c); at_node > best)
          candidates.push_back({at_node, r, c});
    std::sort(candidates.begin(), candidates.end(), [](const Candidate& p, const Candidate& q) {
      if (p.value != q.value) return p.value > q.value;
      return p.row != q.row ? p.row < q.row : p.col < q.col;
    });
    for (const Candidate& p : candidates)
      if (at(p.row, p.col, 0.0) != BallReach::none) return p.value;
    return best;
  };
  for (std::size_t begin = 0; begin < blocks.size(); begin += kBlocksAtOnce) {
    if (!(static_cast<double>(blocks[begin].value) > best)) break;
    if (run.stopped()) return fail(kCancelled, "looking for reachable excess was stopped");
    const std::size_t count = std::min(kBlocksAtOnce, blocks.size() - begin);
    std::array<double, kBlocksAtOnce> found{};
    tbb::parallel_for(std::size_t{0}, count, [&](std::size_t i) {
      const ReachBlock& b = blocks[begin + i];
      found[i] = static_cast<double>(b.value) > best ? best_of(b) : best;
    });
    for (std::size_t i = 0; i < count; ++i) best = std::fmax(best, found[i]);
  }
  return best;
}

}  // namespace maquette::cnc

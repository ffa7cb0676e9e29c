// SPDX-License-Identifier: GPL-3.0-or-later

// Closing of the design by the ball, on demand: the lowest surface that any path of the
// ball can leave. A node where it lies on the design is within reach.

#include <cmath>
#include <limits>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "cnc/certificate.hpp"

namespace maquette::cnc {
namespace {

constexpr double kFinestDisc = 32.0;       // nodes per radius
constexpr std::size_t kBlocksAtOnce = 16;  // fixed, so that the result is the same for any threads

struct Offset {
  std::ptrdiff_t row, col;
  float cap_mm;  // of the ball above its lowest point
};

std::vector<Offset> ball_offsets(double step_mm, double radius_mm) {
  std::vector<Offset> offsets;
  const auto n = static_cast<std::ptrdiff_t>(radius_mm / step_mm);
  for (std::ptrdiff_t r = -n; r <= n; ++r)
    for (std::ptrdiff_t c = -n; c <= n; ++c) {
      const double d2 = static_cast<double>(r * r + c * c) * step_mm * step_mm;
      if (d2 > radius_mm * radius_mm) continue;
      offsets.push_back(
          {r, c, static_cast<float>(radius_mm - std::sqrt(radius_mm * radius_mm - d2))});
    }
  return offsets;
}

struct Box {
  std::ptrdiff_t r1, r2, c1, c2;  // inclusive, in lattice steps
};

struct Candidate {
  std::ptrdiff_t row, col;  // in lattice steps
  double excess_mm;
};

/// Largest excess among `candidates` within reach; `floor` if none.
double best_of(const DividedDesign& design, const std::vector<Candidate>& candidates,
               std::ptrdiff_t stride, const std::vector<Offset>& offsets, std::ptrdiff_t n,
               double floor) {
  Box box{std::numeric_limits<std::ptrdiff_t>::max(), 0, std::numeric_limits<std::ptrdiff_t>::max(),
          0};
  for (const Candidate& p : candidates)
    box = {std::min(box.r1, p.row), std::max(box.r2, p.row), std::min(box.c1, p.col),
           std::max(box.c2, p.col)};
  // Tips within one radius of the candidates, ground within one radius of the tips. Beyond the
  // outline there is nothing to touch, but the ball may hang over it. Heights are taken
  // from one node, so that single precision is enough.
  constexpr float kNothing = -1e30F;
  const double datum = design.at(box.r1 * stride, box.c1 * stride);
  const std::ptrdiff_t rows = box.r2 - box.r1 + 1, cols = box.c2 - box.c1 + 1;
  Grid<float> ground(rows + 4 * n, cols + 4 * n, kNothing);
  const std::ptrdiff_t last_row = (design.rows() - 1) / stride;
  const std::ptrdiff_t last_col = (design.cols() - 1) / stride;
  for (std::ptrdiff_t r = 0; r < ground.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < ground.cols(); ++c) {
      const std::ptrdiff_t row = box.r1 - 2 * n + r, col = box.c1 - 2 * n + c;
      if (row >= 0 && col >= 0 && row <= last_row && col <= last_col)
        ground(r, c) = static_cast<float>(design.at(row * stride, col * stride) - datum);
    }
  Grid<float> tip(rows + 2 * n, cols + 2 * n, kNothing);
  for (std::ptrdiff_t r = 0; r < tip.rows(); ++r)
    for (const Offset& o : offsets) {
      float* to = tip.row(r).data();
      const float* from = ground.row(r + n + o.row).data() + n + o.col;
      for (std::ptrdiff_t c = 0; c < tip.cols(); ++c) {
        const float height = from[c] - o.cap_mm;
        to[c] = to[c] > height ? to[c] : height;
      }
    }
  double best = floor;
  for (const Candidate& p : candidates) {
    if (p.excess_mm <= best) continue;
    float closing = std::numeric_limits<float>::max();
    for (const Offset& o : offsets)
      closing =
          std::min(closing, tip(p.row - box.r1 + n + o.row, p.col - box.c1 + n + o.col) + o.cap_mm);
    const double above =
        static_cast<double>(closing) - (design.at(p.row * stride, p.col * stride) - datum);
    if (above <= kReachTolerance_mm) best = p.excess_mm;
  }
  return best;
}

}  // namespace

Result<double> reachable_excess(const DividedDesign& design, const Grid<float>& as_milled_mm,
                                double cell_mm, double ball_radius_mm,
                                const Grid<float>& block_excess, std::ptrdiff_t block,
                                const RunContext& run) {
  const auto stride = static_cast<std::ptrdiff_t>(
      std::fmax(1.0, std::ceil(ball_radius_mm / kFinestDisc / cell_mm)));
  const double step_mm = static_cast<double>(stride) * cell_mm;
  const std::vector<Offset> offsets = ball_offsets(step_mm, ball_radius_mm);
  const auto n = static_cast<std::ptrdiff_t>(ball_radius_mm / step_mm);

  std::vector<std::pair<float, std::ptrdiff_t>> order;  // excess, block
  for (std::ptrdiff_t i = 0; i < block_excess.rows() * block_excess.cols(); ++i) {
    const float excess = block_excess(i / block_excess.cols(), i % block_excess.cols());
    if (excess > 0.0F) order.emplace_back(excess, i);
  }
  std::sort(order.begin(), order.end(), [](const auto& a, const auto& b) {
    return a.first != b.first ? a.first > b.first : a.second < b.second;
  });

  double best = 0.0;
  for (std::size_t begin = 0; begin < order.size(); begin += kBlocksAtOnce) {
    if (static_cast<double>(order[begin].first) <= best) break;
    if (run.stopped()) return fail(kCancelled, "looking for reachable excess was stopped");
    const std::size_t count = std::min(kBlocksAtOnce, order.size() - begin);
    std::array<double, kBlocksAtOnce> found{};
    tbb::parallel_for(std::size_t{0}, count, [&](std::size_t i) {
      found[i] = best;
      if (static_cast<double>(order[begin + i].first) <= best) return;
      const std::ptrdiff_t index = order[begin + i].second;
      const std::ptrdiff_t r0 = index / block_excess.cols() * block;
      const std::ptrdiff_t c0 = index % block_excess.cols() * block;
      // The last block has the outline's nodes too.
      const std::ptrdiff_t r1 =
          index / block_excess.cols() + 1 == block_excess.rows() ? as_milled_mm.rows() : r0 + block;
      const std::ptrdiff_t c1 =
          index % block_excess.cols() + 1 == block_excess.cols() ? as_milled_mm.cols() : c0 + block;
      std::vector<Candidate> candidates;
      for (std::ptrdiff_t r = (r0 + stride - 1) / stride; r * stride < r1; ++r)
        for (std::ptrdiff_t c = (c0 + stride - 1) / stride; c * stride < c1; ++c) {
          const double excess = static_cast<double>(as_milled_mm(r * stride, c * stride)) -
                                design.at(r * stride, c * stride);
          if (excess > best) candidates.push_back({r, c, excess});
        }
      if (!candidates.empty()) found[i] = best_of(design, candidates, stride, offsets, n, best);
    });
    for (std::size_t i = 0; i < count; ++i) best = std::fmax(best, found[i]);
  }
  return best;
}

}  // namespace maquette::cnc

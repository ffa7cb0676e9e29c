// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/field_tracer.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <utility>
#include <vector>

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/check.hpp"
#include "heightmap/detail/field_walk.hpp"

namespace maquette::heightmap {
namespace {

constexpr std::ptrdiff_t kLeafCells = 4;  // side of a leaf, cells
constexpr std::ptrdiff_t kBranch = 4;     // side of a block, boxes
constexpr double kInf = std::numeric_limits<double>::infinity();

/// Boxes of one level, stored in blocks of 4 x 4, so that a block is two cache lines
/// of heights. Boxes beyond the field are empty (low = +inf, high = -inf).
struct Level {
  std::ptrdiff_t rows = 0, cols = 0;  // boxes
  std::ptrdiff_t block_cols = 0;
  std::vector<float> low, high;

  Level(std::ptrdiff_t r, std::ptrdiff_t c)
      : rows(r), cols(c), block_cols((c + kBranch - 1) / kBranch) {
    const auto blocks = static_cast<std::size_t>((r + kBranch - 1) / kBranch * block_cols);
    low.assign(blocks * 16, INFINITY);
    high.assign(blocks * 16, -INFINITY);
  }
  [[nodiscard]] std::size_t block(std::ptrdiff_t r, std::ptrdiff_t c) const {
    return static_cast<std::size_t>(r * block_cols + c) * 16;
  }
  [[nodiscard]] std::size_t box(std::ptrdiff_t r, std::ptrdiff_t c) const {
    return block(r / kBranch, c / kBranch) +
           static_cast<std::size_t>((r % kBranch) * kBranch + c % kBranch);
  }
};

/// Least and greatest of the five nodes along and across each leaf; what is not finite is left out.
void fill_leaf_row(Level& level, const Grid<float>& z, std::ptrdiff_t row, std::vector<float>& low,
                   std::vector<float>& high) {
  const std::ptrdiff_t r0 = row * kLeafCells;
  const std::ptrdiff_t r1 = std::min(r0 + kLeafCells, z.rows() - 1);
  const auto cols = static_cast<std::size_t>(z.cols());
  // A leaf beyond the last node takes that node again.
  low.assign(static_cast<std::size_t>(level.cols * kLeafCells + 1), INFINITY);
  high.assign(low.size(), -INFINITY);
  for (std::ptrdiff_t r = r0; r <= r1; ++r) {
    const float* from = z.row(r).data();
    for (std::size_t c = 0; c < cols; ++c) {
      // A comparison with what is no number is false and steps over it.
      const float h = std::abs(from[c]) <= std::numeric_limits<float>::max() ? from[c] : NAN;
      low[c] = h < low[c] ? h : low[c];
      high[c] = h > high[c] ? h : high[c];
    }
  }
  for (std::ptrdiff_t col = 0; col < level.cols; ++col) {
    const std::size_t c = static_cast<std::size_t>(col * kLeafCells), to = level.box(row, col);
    level.low[to] = std::min({low[c], low[c + 1], low[c + 2], low[c + 3], low[c + 4]});
    level.high[to] = std::max({high[c], high[c + 1], high[c + 2], high[c + 3], high[c + 4]});
  }
}

void fill_leaves(Level& level, const Grid<float>& z) {
  oneapi::tbb::parallel_for(oneapi::tbb::blocked_range<std::ptrdiff_t>(0, level.rows, 16),
                            [&](const auto& range) {
                              std::vector<float> low, high;
                              for (std::ptrdiff_t row = range.begin(); row < range.end(); ++row)
                                fill_leaf_row(level, z, row, low, high);
                            });
}

/// A box of `upper` is a block of `lower`.
void fill_from_below(Level& upper, const Level& lower) {
  for (std::ptrdiff_t r = 0; r < upper.rows; ++r)
    for (std::ptrdiff_t c = 0; c < upper.cols; ++c) {
      const std::size_t block = lower.block(r, c);
      float low = INFINITY, high = -INFINITY;
      for (std::size_t i = 0; i < 16; ++i) {
        low = std::min(low, lower.low[block + i]);
        high = std::max(high, lower.high[block + i]);
      }
      upper.low[upper.box(r, c)] = low;
      upper.high[upper.box(r, c)] = high;
    }
}

}  // namespace

struct FieldTracer::Pyramid {
  std::vector<Level> levels;  // leaves first; the last one is a single block
  double low = INFINITY, high = -INFINITY;
  std::vector<detail::WalkLevel> walk_levels;
  detail::WalkField field{};
  detail::Walks walks = detail::best_walks();
};

FieldTracer::FieldTracer(const ModelField& field, Instructions instructions)
    : field_(&field), pyramid_(std::make_unique<Pyramid>()) {
  const Grid<float>& z = field.z_mm;
  MAQUETTE_CHECK(z.rows() >= 2 && z.cols() >= 2 && field.spacing.value() > 0.0,
                 "a field of {} x {} nodes, spacing {} mm, has no triangles", z.rows(), z.cols(),
                 field.spacing.value());
  if (instructions == Instructions::common) pyramid_->walks = detail::common_walks();
  auto& levels = pyramid_->levels;
  levels.emplace_back((z.rows() - 1 + kLeafCells - 1) / kLeafCells,
                      (z.cols() - 1 + kLeafCells - 1) / kLeafCells);
  fill_leaves(levels.back(), z);
  while (levels.back().rows > kBranch || levels.back().cols > kBranch) {
    const Level& lower = levels.back();
    Level upper((lower.rows + kBranch - 1) / kBranch, lower.block_cols);
    fill_from_below(upper, lower);
    levels.push_back(std::move(upper));
  }
  for (const float h : levels.back().low)
    pyramid_->low = std::min(pyramid_->low, static_cast<double>(h));
  for (const float h : levels.back().high)
    pyramid_->high = std::max(pyramid_->high, static_cast<double>(h));
  for (const Level& level : levels)
    pyramid_->walk_levels.push_back({level.low.data(), level.high.data(), level.block_cols});
  detail::WalkField& walk = pyramid_->field;
  walk.z_mm = z.cells().data();
  walk.rows = z.rows();
  walk.cols = z.cols();
  walk.x0_mm = field.x0.value();
  walk.y0_mm = field.y0.value();
  walk.spacing_mm = field.spacing.value();
  walk.levels = pyramid_->walk_levels.data();
  walk.level_count = static_cast<std::int32_t>(levels.size());
  const std::array<double, 3> low{field.x0.value(), field.y0.value(), pyramid_->low};
  const std::array<double, 3> high{field.x_mm(z.cols() - 1), field.y_mm(z.rows() - 1),
                                   pyramid_->high};
  walk.size_mm = (high[0] - low[0]) + (high[1] - low[1]) + (high[2] - low[2]);
  for (std::size_t i = 0; i < 3; ++i) {
    walk.low[i] = low[i] - 1e-6 * walk.size_mm;
    walk.high[i] = high[i] + 1e-6 * walk.size_mm;
  }
  walk.per_mm = 1.0 / walk.spacing_mm;
  walk.height_slack_mm = 0x1.0p-20 * (std::abs(low[2]) + std::abs(high[2]));
}
FieldTracer::FieldTracer(FieldTracer&&) noexcept = default;
FieldTracer::~FieldTracer() = default;

std::size_t FieldTracer::memory_bytes() const {
  std::size_t bytes = 0;
  for (const Level& level : pyramid_->levels)
    bytes += (level.low.size() + level.high.size()) * sizeof(float);
  return bytes;
}

namespace {

detail::WalkRay walk_ray(Vec3 o, Vec3 d, double from_mm, double to_mm) {
  return {{o.x, o.y, o.z}, {d.x, d.y, d.z}, from_mm, to_mm};
}

std::optional<FieldHit> hit_of(const ModelField& f, const detail::WalkHit& hit, Vec3 origin,
                               Vec3 direction) {
  if (hit.row < 0) return std::nullopt;
  const std::ptrdiff_t r = hit.row, c = hit.col;
  const auto z = [&](std::ptrdiff_t i, std::ptrdiff_t j) {
    return static_cast<double>(f.z_mm(r + i, c + j));
  };
  const double rise_x = hit.lower_right ? z(0, 1) - z(0, 0) : z(1, 1) - z(1, 0);
  const double rise_y = hit.lower_right ? z(1, 1) - z(0, 1) : z(1, 0) - z(0, 0);
  return FieldHit{hit.distance_mm, origin + hit.distance_mm * direction,
                  normalized(Vec3{-rise_x, -rise_y, f.spacing.value()})};
}

/// Sixteen rays at a time; `take` gets each one's answer.
template <class Pyramid, class Give, class Take>
void in_packets(const Pyramid& p, std::size_t count, bool any, const Give& give, const Take& take) {
  constexpr std::size_t kMost = 16;
  std::array<detail::WalkRay, kMost> rays;
  std::array<detail::WalkHit, kMost> hits;
  for (std::size_t i = 0; i < count; i += kMost) {
    const std::size_t n = std::min(kMost, count - i);
    for (std::size_t k = 0; k < n; ++k) rays[k] = give(i + k);
    p.walks.many(p.field, rays.data(), static_cast<std::int64_t>(n), any, hits.data());
    for (std::size_t k = 0; k < n; ++k) take(i + k, hits[k]);
  }
}

}  // namespace

std::optional<FieldHit> FieldTracer::trace(Vec3 origin, Vec3 direction, double from_mm) const {
  const Pyramid& p = *pyramid_;
  if (!(p.low <= p.high)) return std::nullopt;  // nothing but voids
  detail::WalkHit hit;
  p.walks.one(p.field, walk_ray(origin, direction, from_mm, kInf), false, hit);
  return hit_of(*field_, hit, origin, direction);
}

void FieldTracer::trace_many(std::span<const Ray> rays,
                             std::span<std::optional<FieldHit>> hits) const {
  MAQUETTE_CHECK(rays.size() == hits.size(), "{} rays, {} hits", rays.size(), hits.size());
  const Pyramid& p = *pyramid_;
  std::fill(hits.begin(), hits.end(), std::nullopt);
  if (!(p.low <= p.high)) return;
  in_packets(
      p, rays.size(), false,
      [&](std::size_t i) { return walk_ray(rays[i].origin_mm, rays[i].direction, 0.0, kInf); },
      [&](std::size_t i, const detail::WalkHit& hit) {
        hits[i] = hit_of(*field_, hit, rays[i].origin_mm, rays[i].direction);
      });
}

bool FieldTracer::blocked(Vec3 origin, Vec3 direction, double to_mm, double from_mm) const {
  const Pyramid& p = *pyramid_;
  if (!(p.low <= p.high)) return false;
  detail::WalkHit hit;
  p.walks.one(p.field, walk_ray(origin, direction, from_mm, to_mm), true, hit);
  return hit.row >= 0;
}

void FieldTracer::blocked_many(std::span<const Segment> rays, std::span<bool> blocked) const {
  MAQUETTE_CHECK(rays.size() == blocked.size(), "{} rays, {} answers", rays.size(), blocked.size());
  const Pyramid& p = *pyramid_;
  std::fill(blocked.begin(), blocked.end(), false);
  if (!(p.low <= p.high)) return;
  in_packets(
      p, rays.size(), true,
      [&](std::size_t i) {
        return walk_ray(rays[i].origin_mm, rays[i].direction, 0.0, rays[i].to_mm);
      },
      [&](std::size_t i, const detail::WalkHit& hit) { blocked[i] = hit.row >= 0; });
}

}  // namespace maquette::heightmap

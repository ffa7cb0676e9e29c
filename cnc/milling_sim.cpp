// SPDX-License-Identifier: GPL-3.0-or-later

// The plane that lets blocks be skipped: the capsule is convex, so for every gradient
// g = (gs, gd) all of its underside lies above
//     A.z + R - R sqrt(1 + |g|^2) + gs s + gd d + min over its ends of (m - gs) t,
// whatever g is; g is taken from the sphere at the block's centre, where it is tight.

#include "cnc/milling_sim.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <memory>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "core/check.hpp"

namespace maquette::cnc {
namespace {

constexpr int kBlock = 8;   // cells along a block's side: one AVX register of floats
constexpr int kTile = 128;  // cells along a tile's side: 64 KiB of heights
constexpr int kBlocks = kTile / kBlock;
// Steeper moves (plunges, retracts) are swept in double: a single-precision place times
// such a slope would show in the height.
constexpr double kSteepestSingle = 8.0;
// The gradient of the supporting plane is taken inside this share of the ball's disc.
constexpr float kInnerDisc = 0.96F;
// More than single precision can err in a supporting plane below 1 m of height.
constexpr float kPlaneMargin_mm = 1e-3F;

struct Tile {
  alignas(64) std::array<float, kTile * kTile> z;  // row by row
  alignas(64) std::array<float, kBlocks * kBlocks> highest;
  double x0_mm, y0_mm;  // of the first cell's centre
};

/// The piece of a move that can reach a tile, seen from its point nearest the tile's
/// middle, so that all lengths are small.
struct LocalMove {
  double x_mm, y_mm, z_mm;  // tip at t = 0
  double ux, uy;            // horizontal direction
  double rise;              // mm per horizontal mm
  double t1, t2;            // t1 <= 0 <= t2
};

LocalMove localise(const ToolMove& move, double cx, double cy, double reach) {
  const Vec3 a = move.from_mm, b = move.to_mm;
  const double dx = b.x - a.x, dy = b.y - a.y, dz = b.z - a.z;
  const double length = std::sqrt(dx * dx + dy * dy);
  // A vertical move leaves what its lower end leaves; shorter than a nanometre is vertical.
  if (length < 1e-6) {
    const Vec3 low = dz < 0.0 ? b : a;
    return {low.x, low.y, low.z, 1.0, 0.0, 0.0, 0.0, 0.0};
  }
  const double ux = dx / length, uy = dy / length, rise = dz / length;
  const double t = std::fmin(std::fmax((cx - a.x) * ux + (cy - a.y) * uy, 0.0), length);
  return {a.x + t * ux, a.y + t * uy, a.z + t * rise,        ux,
          uy,           rise,         std::fmax(-t, -reach), std::fmin(length - t, reach)};
}

/// Cuts one block; the new highest cell of it, and by how much one cell fell at most.
template <class T>
struct BlockResult {
  T highest, deepest;
};

template <class T>
BlockResult<T> cut_block(float* z, T dx0, T dy0, T cell, T radius, const LocalMove& m, T k) {
  const T ux = static_cast<T>(m.ux), uy = static_cast<T>(m.uy), rise = static_cast<T>(m.rise);
  const T t1 = static_cast<T>(m.t1), t2 = static_cast<T>(m.t2);
  const T base = static_cast<T>(m.z_mm + static_cast<double>(radius));
  const T r2 = radius * radius;
  constexpr T kNone = std::numeric_limits<T>::max();
  std::array<T, kBlock> highest, deepest;
  highest.fill(-kNone);
  deepest.fill(T{0});
  for (int r = 0; r < kBlock; ++r) {
    const T dy = dy0 + static_cast<T>(r) * cell;
    float* row = z + r * kTile;
    for (int c = 0; c < kBlock; ++c) {
      const auto i = static_cast<std::size_t>(c);
      const T dx = dx0 + static_cast<T>(c) * cell;
      const T s = dx * ux + dy * uy;
      const T d = dx * uy - dy * ux;
      const T rho2 = r2 - d * d;
      const T rho = std::sqrt(rho2 > T{0} ? rho2 : T{0});
      T t = s - k * rho;
      t = t > t1 ? t : t1;
      t = t < t2 ? t : t2;
      const T w = s - t;
      const T q = rho2 - w * w;
      const T under = base + rise * t - std::sqrt(q > T{0} ? q : T{0});
      const T old = static_cast<T>(row[c]);
      const bool cuts = (q > T{0}) & (under < old);
      const T now = cuts ? under : old;
      row[c] = static_cast<float>(now);
      highest[i] = highest[i] > now ? highest[i] : now;
      deepest[i] = deepest[i] > old - now ? deepest[i] : old - now;
    }
  }
  BlockResult<T> result{highest[0], deepest[0]};
  for (std::size_t i = 1; i < kBlock; ++i) {
    result.highest = std::max(result.highest, highest[i]);
    result.deepest = std::max(result.deepest, deepest[i]);
  }
  return result;
}

/// @return deepest cut, mm
template <class T>
double sweep_tile(Tile& tile, const LocalMove& m, double cell_mm, double radius_mm) {
  // Blocks under the piece's bounding box.
  const double lo_x = std::fmin(m.t1 * m.ux, m.t2 * m.ux) + m.x_mm - radius_mm - tile.x0_mm;
  const double hi_x = std::fmax(m.t1 * m.ux, m.t2 * m.ux) + m.x_mm + radius_mm - tile.x0_mm;
  const double lo_y = std::fmin(m.t1 * m.uy, m.t2 * m.uy) + m.y_mm - radius_mm - tile.y0_mm;
  const double hi_y = std::fmax(m.t1 * m.uy, m.t2 * m.uy) + m.y_mm + radius_mm - tile.y0_mm;
  const auto block_of = [&](double mm) {
    return static_cast<int>(
        std::fmin(std::fmax(std::floor(mm / (cell_mm * kBlock)), -1.0), double{kBlocks}));
  };
  const int bx1 = std::max(0, block_of(lo_x)), bx2 = std::min(kBlocks - 1, block_of(hi_x));
  const int by1 = std::max(0, block_of(lo_y)), by2 = std::min(kBlocks - 1, block_of(hi_y));
  if (bx1 > bx2 || by1 > by2) return 0.0;

  const double k = m.rise / std::sqrt(1.0 + m.rise * m.rise);
  const double middle = 0.5 * (kBlock - 1) * cell_mm;  // of a block, from its first cell
  const auto ux = static_cast<float>(m.ux), uy = static_cast<float>(m.uy);
  const auto rise = static_cast<float>(m.rise), kf = static_cast<float>(k);
  const auto t1 = static_cast<float>(m.t1), t2 = static_cast<float>(m.t2);
  const auto radius = static_cast<float>(radius_mm);
  const float r2 = radius * radius, inner2 = kInnerDisc * r2;
  const auto half = static_cast<float>(middle);
  const auto base = static_cast<float>(m.z_mm + radius_mm) - kPlaneMargin_mm;
  const float far = radius + 1.4143F * half;
  const float far2 = far * far * 1.0001F;
  const auto pitch = static_cast<float>(cell_mm * kBlock);
  const auto first_x = static_cast<float>(tile.x0_mm + middle - m.x_mm);
  constexpr float kNone = std::numeric_limits<float>::max();

  double deepest = 0.0;
  alignas(64) std::array<float, kBlocks> lowest{};
  for (int by = by1; by <= by2; ++by) {
    const auto dy = static_cast<float>(tile.y0_mm + by * kBlock * cell_mm + middle - m.y_mm);
    const float* highest = tile.highest.data() + by * kBlocks;
    for (int bx = bx1; bx <= bx2; ++bx) {
      const float dx = first_x + static_cast<float>(bx) * pitch;
      const float s = dx * ux + dy * uy, d = dx * uy - dy * ux;
      const float rho2 = r2 - d * d;
      const float rho = std::sqrt(rho2 > 0.0F ? rho2 : 0.0F);
      float t = s - kf * rho;
      t = t > t1 ? t : t1;
      t = t < t2 ? t : t2;
      const float w = s - t;
      const float dist2 = w * w + d * d;
      const bool inside = dist2 <= inner2;
      const float scale = std::sqrt(inner2 / (inside ? inner2 : dist2));
      const float height = std::sqrt(r2 - (inside ? dist2 : inner2));
      const float gs = w * scale / height, gd = d * scale / height;
      const float at1 = (rise - gs) * t1, at2 = (rise - gs) * t2;
      const float gx = gs * ux + gd * uy, gy = gs * uy - gd * ux;
      const float plane = base - r2 / height + gs * s + gd * d + (at1 < at2 ? at1 : at2) -
                          half * (std::abs(gx) + std::abs(gy));
      float near = s < t1 ? t1 : s;
      near = near > t2 ? t2 : near;
      const float gap2 = (s - near) * (s - near) + d * d;
      lowest[static_cast<std::size_t>(bx)] = gap2 > far2 ? kNone : plane;
    }
    for (int bx = bx1; bx <= bx2; ++bx) {
      if (lowest[static_cast<std::size_t>(bx)] >= highest[bx]) continue;
      const BlockResult<T> result =
          cut_block<T>(tile.z.data() + by * kBlock * kTile + bx * kBlock,
                       static_cast<T>(tile.x0_mm + bx * kBlock * cell_mm - m.x_mm),
                       static_cast<T>(tile.y0_mm + by * kBlock * cell_mm - m.y_mm),
                       static_cast<T>(cell_mm), static_cast<T>(radius_mm), m, static_cast<T>(k));
      tile.highest[static_cast<std::size_t>(by * kBlocks + bx)] =
          static_cast<float>(result.highest);
      deepest = std::fmax(deepest, static_cast<double>(result.deepest));
    }
  }
  return deepest;
}

void load(Tile& tile, const Grid<float>& stock, std::ptrdiff_t r0, std::ptrdiff_t c0) {
  // Cells beyond the stock are bottomless: nothing cuts them.
  constexpr float kBeyond = -std::numeric_limits<float>::max();
  const std::ptrdiff_t rows = std::min<std::ptrdiff_t>(kTile, stock.rows() - r0);
  const std::ptrdiff_t cols = std::min<std::ptrdiff_t>(kTile, stock.cols() - c0);
  if (rows < kTile || cols < kTile) tile.z.fill(kBeyond);
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    std::copy_n(&stock(r0 + r, c0), cols, tile.z.data() + r * kTile);
  tile.highest.fill(kBeyond);
  for (int r = 0; r < kTile; ++r)
    for (int c = 0; c < kTile; ++c) {
      float& highest = tile.highest[static_cast<std::size_t>(r / kBlock * kBlocks + c / kBlock)];
      highest = std::max(highest, tile.z[static_cast<std::size_t>(r * kTile + c)]);
    }
}

void store(const Tile& tile, Grid<float>& stock, std::ptrdiff_t r0, std::ptrdiff_t c0) {
  const std::ptrdiff_t rows = std::min<std::ptrdiff_t>(kTile, stock.rows() - r0);
  const std::ptrdiff_t cols = std::min<std::ptrdiff_t>(kTile, stock.cols() - c0);
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    std::copy_n(tile.z.data() + r * kTile, cols, &stock(r0 + r, c0));
}

}  // namespace

MillingSim::MillingSim(std::ptrdiff_t rows, std::ptrdiff_t cols, double x0_mm, double y0_mm,
                       double cell_mm, double ball_radius_mm, double stock_top_mm)
    : stock_(rows, cols, static_cast<float>(stock_top_mm)),
      x0_mm_(x0_mm),
      y0_mm_(y0_mm),
      cell_mm_(cell_mm),
      radius_mm_(ball_radius_mm),
      top_mm_(static_cast<double>(static_cast<float>(stock_top_mm))),
      tile_rows_((rows + kTile - 1) / kTile),
      tile_cols_((cols + kTile - 1) / kTile) {
  MAQUETTE_CHECK(rows >= 1 && cols >= 1 && cell_mm > 0.0 && ball_radius_mm > 0.0,
                 "{} x {} cells of {} mm, ball radius {} mm", rows, cols, cell_mm, ball_radius_mm);
}

/// Calls visit(tile) for every tile that the move's capsule may touch: row of tiles by
/// row of tiles, the span in x of the part of the segment within reach of that row.
template <class Visit>
void MillingSim::for_each_tile(const ToolMove& move, Visit&& visit) const {
  const Vec3 a = move.from_mm, b = move.to_mm;
  if (std::fmin(a.z, b.z) >= top_mm_) return;
  const double pitch = cell_mm_ * kTile;
  const double margin = radius_mm_ + cell_mm_;
  const auto tile_of = [&](double mm, std::ptrdiff_t count) {
    return static_cast<std::ptrdiff_t>(
        std::fmin(std::fmax(std::floor(mm / pitch), -1.0), static_cast<double>(count)));
  };
  const double lo_y = std::fmin(a.y, b.y) - y0_mm_ - margin;
  const double hi_y = std::fmax(a.y, b.y) - y0_mm_ + margin;
  const std::ptrdiff_t ty1 = std::max<std::ptrdiff_t>(0, tile_of(lo_y, tile_rows_));
  const std::ptrdiff_t ty2 = std::min(tile_rows_ - 1, tile_of(hi_y, tile_rows_));
  for (std::ptrdiff_t ty = ty1; ty <= ty2; ++ty) {
    double f1 = 0.0, f2 = 1.0;
    if (const double dy = b.y - a.y; std::abs(dy) > 1e-9) {
      const double p = (y0_mm_ + static_cast<double>(ty) * pitch - margin - a.y) / dy;
      const double q = (y0_mm_ + static_cast<double>(ty + 1) * pitch + margin - a.y) / dy;
      f1 = std::fmax(0.0, std::fmin(p, q));
      f2 = std::fmin(1.0, std::fmax(p, q));
      if (f1 > f2) continue;
    }
    const double x1 = a.x + f1 * (b.x - a.x), x2 = a.x + f2 * (b.x - a.x);
    const std::ptrdiff_t tx1 =
        std::max<std::ptrdiff_t>(0, tile_of(std::fmin(x1, x2) - x0_mm_ - margin, tile_cols_));
    const std::ptrdiff_t tx2 =
        std::min(tile_cols_ - 1, tile_of(std::fmax(x1, x2) - x0_mm_ + margin, tile_cols_));
    for (std::ptrdiff_t tx = tx1; tx <= tx2; ++tx)
      visit(static_cast<std::size_t>(ty * tile_cols_ + tx));
  }
}

void MillingSim::bin(std::span<const ToolMove> moves) {
  start_.assign(static_cast<std::size_t>(tile_rows_ * tile_cols_) + 1, 0);
  for (const ToolMove& move : moves)
    for_each_tile(move, [&](std::size_t tile) { ++start_[tile + 1]; });
  for (std::size_t i = 1; i < start_.size(); ++i) start_[i] += start_[i - 1];
  order_.resize(start_.back());
  // start_[tile] walks to the tile's end, which is the next tile's beginning.
  for (std::size_t i = 0; i < moves.size(); ++i)
    for_each_tile(moves[i], [&](std::size_t tile) {
      order_[start_[tile]++] = static_cast<std::uint32_t>(i);
    });
  for (std::size_t i = start_.size() - 1; i > 0; --i) start_[i] = start_[i - 1];
  start_[0] = 0;
}

void MillingSim::cut(std::span<const ToolMove> moves) {
  if (moves.empty()) return;
  bin(moves);
  collided_.assign(moves.size(), 0);
  std::vector<std::size_t> active;
  for (std::size_t i = 0; i + 1 < start_.size(); ++i)
    if (start_[i + 1] > start_[i]) active.push_back(i);
  const double half_pitch = 0.5 * (kTile - 1) * cell_mm_;
  // From the tile's middle to the farthest centre of a ball that touches it.
  const double reach = 2.0 * (std::sqrt(2.0) * half_pitch + radius_mm_) + cell_mm_;
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(0, active.size(), 1),
      [&](const tbb::blocked_range<std::size_t>& range) {
        const auto tile = std::make_unique<Tile>();
        for (std::size_t a = range.begin(); a < range.end(); ++a) {
          const std::size_t index = active[a];
          const std::ptrdiff_t r0 = static_cast<std::ptrdiff_t>(index) / tile_cols_ * kTile;
          const std::ptrdiff_t c0 = static_cast<std::ptrdiff_t>(index) % tile_cols_ * kTile;
          tile->x0_mm = x0_mm_ + static_cast<double>(c0) * cell_mm_;
          tile->y0_mm = y0_mm_ + static_cast<double>(r0) * cell_mm_;
          load(*tile, stock_, r0, c0);
          for (std::uint64_t i = start_[index]; i < start_[index + 1]; ++i) {
            const ToolMove& move = moves[order_[i]];
            const LocalMove local =
                localise(move, tile->x0_mm + half_pitch, tile->y0_mm + half_pitch, reach);
            const double deepest = std::abs(local.rise) > kSteepestSingle
                                       ? sweep_tile<double>(*tile, local, cell_mm_, radius_mm_)
                                       : sweep_tile<float>(*tile, local, cell_mm_, radius_mm_);
            if (move.rapid && deepest > kCollisionDepth_mm)
              std::atomic_ref<std::uint8_t>(collided_[order_[i]])
                  .store(1, std::memory_order_relaxed);
          }
          store(*tile, stock_, r0, c0);
        }
      });
  for (const std::uint8_t hit : collided_) rapid_collisions_ += hit;
}

MillingSim::Precision MillingSim::precision(double largest_height_mm) const {
  constexpr double kHalfUlp = 0x1.0p-24;
  const double longest = 2.0 * (std::sqrt(2.0) * 0.5 * kTile * cell_mm_ + radius_mm_);
  // s and d: six roundings of lengths up to `longest`; rho^2, w^2 and the root: six of R^2,
  // which move the ball's wall by as many R / 2.
  return {6.0 * kHalfUlp * longest + 3.0 * kHalfUlp * radius_mm_ + 3.0 * kHalfUlp * radius_mm_,
          4.0 * kHalfUlp * (largest_height_mm + 2.0 * radius_mm_)};
}

}  // namespace maquette::cnc

// SPDX-License-Identifier: GPL-3.0-or-later

// The plane that lets blocks be skipped under a ball: a capsule is convex, so for every gradient
// g = (gs, gd) all of its underside lies above
//     A.z + R - R sqrt(1 + |g|^2) + gs s + gd d + min over its ends of (m - gs) t,
// whatever g is; g is taken from the sphere at the block's centre, where it is tight. A way
// within `sag` of its chord lies above that lowered by sag sqrt(1 + |g|^2).

#include "cnc/milling_sim.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <limits>
#include <memory>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

#include "cnc/swept_cutter.hpp"
#include "core/check.hpp"

namespace maquette::cnc {
namespace {

using swept::kBlock;
constexpr int kTile = 128;  // cells along a tile's side: 64 KiB of heights
constexpr int kBlocks = kTile / kBlock;
// The gradient of the supporting plane is taken inside this share of the ball's disc.
constexpr float kInnerDisc = 0.96F;
// More than single precision can err in a supporting plane below 1 m of height.
constexpr float kPlaneMargin_mm = 1e-3F;
constexpr float kNone = std::numeric_limits<float>::max();

struct Tile {
  alignas(64) std::array<float, kTile * kTile> z;  // row by row
  alignas(64) std::array<float, kBlocks * kBlocks> highest;
  double cell_mm;
  double x0_mm, y0_mm;      // of the whole grid
  std::ptrdiff_t row, col;  // of the first cell in the whole grid
  std::ptrdiff_t counted_from_row, counted_to_row;
  float highest_of_all;  // at least: it is not kept up with every cut

  // The same sums for a block whichever tile it is in.
  [[nodiscard]] double x_of(int bx) const {
    return x0_mm + static_cast<double>(col + bx * kBlock) * cell_mm;
  }
  [[nodiscard]] double y_of(int by) const {
    return y0_mm + static_cast<double>(row + by * kBlock) * cell_mm;
  }
  [[nodiscard]] bool counts(int by) const {
    const std::ptrdiff_t first = row + by * kBlock;
    return first >= counted_from_row && first < counted_to_row;
  }
  [[nodiscard]] float* block(int by, int bx) {
    return z.data() + by * kBlock * kTile + bx * kBlock;
  }
  [[nodiscard]] float& top(int by, int bx) {
    return highest[static_cast<std::size_t>(by * kBlocks + bx)];
  }
};

/// Blocks of a tile under a rectangle.
struct Blocks {
  int x1, x2, y1, y2;
  [[nodiscard]] bool empty() const { return x1 > x2 || y1 > y2; }
};
Blocks blocks_under(const Tile& tile, double left, double right, double south, double north) {
  const double pitch = tile.cell_mm * kBlock;
  const auto block_of = [&](double mm) {
    return static_cast<int>(std::min(std::max(std::floor(mm / pitch), -1.0), double{kBlocks}));
  };
  // A cell wider than needed, so that rounding never loses a block.
  const double x = tile.x_of(0), y = tile.y_of(0), wide = tile.cell_mm;
  return {std::max(0, block_of(left - x - wide)), std::min(kBlocks - 1, block_of(right - x + wide)),
          std::max(0, block_of(south - y - wide)),
          std::min(kBlocks - 1, block_of(north - y + wide))};
}

/// The piece of a chord that can reach a tile, seen from its point nearest the tile's
/// middle, so that all lengths are small.
struct LocalChord {
  double x, y, z;  // at t = 0
  double t1, t2;   // t1 <= 0 <= t2
};
LocalChord localise(const swept::Way& way, const Tile& tile) {
  const double half = 0.5 * (kTile - 1) * tile.cell_mm;
  const double reach =
      2.0 * (std::sqrt(2.0) * half + way.cutter.radius_mm) + way.sag + tile.cell_mm;
  const double cx = tile.x_of(0) + half - way.start.x, cy = tile.y_of(0) + half - way.start.y;
  const double t = swept::clamped(cx * way.ux + cy * way.uy, 0.0, way.length);
  return {way.start.x + t * way.ux, way.start.y + t * way.uy, way.start.z + t * way.rise,
          std::max(-t, -reach), std::min(way.length - t, reach)};
}

/// Lower bounds of the underside over a row of blocks.
class RowBound {
 public:
  RowBound(const swept::Way& way, const LocalChord& m, const Tile& tile)
      : ball_(way.cutter.is_ball()),
        ux_(static_cast<float>(way.ux)),
        uy_(static_cast<float>(way.uy)),
        rise_(static_cast<float>(way.rise)),
        k_(static_cast<float>(way.rise / std::sqrt(1.0 + way.rise * way.rise))),
        t1_(static_cast<float>(m.t1)),
        t2_(static_cast<float>(m.t2)),
        radius_(static_cast<float>(way.cutter.radius_mm)),
        half_(static_cast<float>(0.5 * (kBlock - 1) * tile.cell_mm)),
        sag_(static_cast<float>(way.sag)),
        base_(static_cast<float>(m.z) - kPlaneMargin_mm),
        pitch_(static_cast<float>(tile.cell_mm * kBlock)),
        first_x_(static_cast<float>(tile.x_of(0) + static_cast<double>(half_) - m.x)),
        first_y_(static_cast<float>(tile.y_of(0) + static_cast<double>(half_) - m.y)) {
    const float far = radius_ + sag_ + 1.4143F * half_;
    far2_ = far * far * 1.0001F;
  }

  void operator()(int by, const Blocks& blocks, std::array<float, kBlocks>& lowest) const {
    const float dy = first_y_ + static_cast<float>(by) * pitch_;
    if (ball_)
      for (int bx = blocks.x1; bx <= blocks.x2; ++bx)
        lowest[static_cast<std::size_t>(bx)] = ball(first_x_ + static_cast<float>(bx) * pitch_, dy);
    else
      for (int bx = blocks.x1; bx <= blocks.x2; ++bx)
        lowest[static_cast<std::size_t>(bx)] = any(first_x_ + static_cast<float>(bx) * pitch_, dy);
  }

 private:
  [[nodiscard]] float ball(float dx, float dy) const {
    const float r2 = radius_ * radius_, inner2 = kInnerDisc * r2;
    const float s = dx * ux_ + dy * uy_, d = dx * uy_ - dy * ux_;
    const float rho2 = r2 - d * d;
    const float rho = std::sqrt(rho2 > 0.0F ? rho2 : 0.0F);
    float t = s - k_ * rho;
    t = t > t1_ ? t : t1_;
    t = t < t2_ ? t : t2_;
    const float w = s - t;
    const float dist2 = w * w + d * d;
    const bool inside = dist2 <= inner2;
    const float scale = std::sqrt(inner2 / (inside ? inner2 : dist2));
    const float height = std::sqrt(r2 - (inside ? dist2 : inner2));
    const float gs = w * scale / height, gd = d * scale / height;
    const float at1 = (rise_ - gs) * t1_, at2 = (rise_ - gs) * t2_;
    const float gx = gs * ux_ + gd * uy_, gy = gs * uy_ - gd * ux_;
    // radius / height = sqrt(1 + |g|^2)
    const float plane = base_ + radius_ - (r2 + sag_ * radius_) / height + gs * s + gd * d +
                        (at1 < at2 ? at1 : at2) - half_ * (std::abs(gx) + std::abs(gy));
    return beyond(s, d) ? kNone : plane;
  }
  [[nodiscard]] float any(float dx, float dy) const {
    const float s = dx * ux_ + dy * uy_, d = dx * uy_ - dy * ux_;
    // The end plane of the cutter, on the part of the chord that reaches the block.
    const float out = radius_ + 1.4143F * half_;
    float lo = s - out > t1_ ? s - out : t1_, hi = s + out < t2_ ? s + out : t2_;
    lo = lo < t2_ ? lo : t2_;
    hi = hi > t1_ ? hi : t1_;
    const float a = rise_ * lo, b = rise_ * hi;
    return beyond(s, d) ? kNone : base_ + (a < b ? a : b);
  }
  [[nodiscard]] bool beyond(float s, float d) const {
    float near = s < t1_ ? t1_ : s;
    near = near > t2_ ? t2_ : near;
    return (s - near) * (s - near) + d * d > far2_;
  }

  bool ball_;
  float ux_, uy_, rise_, k_, t1_, t2_, radius_, half_, sag_, base_, pitch_, first_x_, first_y_;
  float far2_ = 0.0F;
};

struct TileCut {
  double deepest = 0.0;      // mm
  std::int64_t removed = 0;  // MoveEffects::kUnit_mm
};

TileCut sweep_tile(Tile& tile, const swept::Way& way) {
  const LocalChord m = localise(way, tile);
  const double out = way.cutter.radius_mm + way.sag;
  const Blocks blocks = blocks_under(tile, m.x + std::min(m.t1 * way.ux, m.t2 * way.ux) - out,
                                     m.x + std::max(m.t1 * way.ux, m.t2 * way.ux) + out,
                                     m.y + std::min(m.t1 * way.uy, m.t2 * way.uy) - out,
                                     m.y + std::max(m.t1 * way.uy, m.t2 * way.uy) + out);
  TileCut sum;
  if (blocks.empty()) return sum;
  const RowBound bound(way, m, tile);
  alignas(64) std::array<float, kBlocks> lowest{};
  for (int by = blocks.y1; by <= blocks.y2; ++by) {
    bound(by, blocks, lowest);
    for (int bx = blocks.x1; bx <= blocks.x2; ++bx) {
      if (lowest[static_cast<std::size_t>(bx)] >= tile.top(by, bx)) continue;
      const swept::BlockCut cut =
          way.cut(tile.block(by, bx), kTile, tile.x_of(bx), tile.y_of(by), tile.cell_mm);
      tile.top(by, bx) = cut.highest;
      sum.deepest = std::max(sum.deepest, cut.deepest);
      if (tile.counts(by)) sum.removed += std::llround(cut.removed / MoveEffects::kUnit_mm);
    }
  }
  return sum;
}

// ---- holder and shank --------------------------------------------------------

/// Underside of a part of the holder by squared distance from the axis.
struct ConeProfile {
  double bottom, bottom_radius, radius, rise;
  double operator()(double dist2) const {
    const double dist = std::sqrt(dist2);
    const double under = bottom + std::max(0.0, dist - bottom_radius) * rise;
    return dist < radius ? under : swept::kNothing<double>;
  }
};

bool part_touches(Tile& tile, const swept::Way& way, const HolderPart& part) {
  const Vec3 a = way.piece.from_mm, b = way.piece.to_mm;
  if (std::min(a.z, b.z) - way.sag + part.bottom_mm >= static_cast<double>(tile.highest_of_all))
    return false;
  const double radius = std::max(part.bottom_radius_mm, part.top_radius_mm) + way.sag;
  const double wider = part.top_radius_mm - part.bottom_radius_mm;
  const auto steps = static_cast<int>(
      std::max(1.0, std::min(1e5, std::ceil(std::abs(b.z - a.z) / kHolderStep_mm))));
  for (int i = 0; i < steps; ++i) {
    const Vec3 p = a + (static_cast<double>(i) / steps) * (b - a);
    const Vec3 q = a + (static_cast<double>(i + 1) / steps) * (b - a);
    const double bottom = std::min(p.z, q.z) - way.sag + part.bottom_mm;
    if (bottom >= static_cast<double>(tile.highest_of_all)) continue;
    const double dx = q.x - p.x, dy = q.y - p.y, length = std::sqrt(dx * dx + dy * dy);
    const double ux = length > 0.0 ? dx / length : 1.0, uy = length > 0.0 ? dy / length : 0.0;
    const ConeProfile profile{bottom, part.bottom_radius_mm + way.sag, radius,
                              wider > 0.0 ? part.height_mm / wider : 0.0};
    const swept::AlongLevelLine<double, ConeProfile> under{ux, uy, 0.0, length, profile};
    const Blocks blocks =
        blocks_under(tile, std::min(p.x, q.x) - radius, std::max(p.x, q.x) + radius,
                     std::min(p.y, q.y) - radius, std::max(p.y, q.y) + radius);
    for (int by = blocks.y1; by <= blocks.y2; ++by)
      for (int bx = blocks.x1; bx <= blocks.x2; ++bx)
        if (static_cast<double>(tile.top(by, bx)) > bottom &&
            swept::touches_block(tile.block(by, bx), kTile, tile.x_of(bx) - p.x,
                                 tile.y_of(by) - p.y, tile.cell_mm, under, kCollisionDepth_mm))
          return true;
  }
  return false;
}

bool holder_touches(Tile& tile, const swept::Way& way) {
  return std::any_of(way.cutter.holder.begin(), way.cutter.holder.end(),
                     [&](const HolderPart& part) { return part_touches(tile, way, part); });
}

// ---- tiles ---------------------------------------------------------------------

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
      float& highest = tile.top(r / kBlock, c / kBlock);
      highest = std::max(highest, tile.z[static_cast<std::size_t>(r * kTile + c)]);
    }
  tile.highest_of_all = *std::max_element(tile.highest.begin(), tile.highest.end());
}

void store(const Tile& tile, Grid<float>& stock, std::ptrdiff_t r0, std::ptrdiff_t c0) {
  const std::ptrdiff_t rows = std::min<std::ptrdiff_t>(kTile, stock.rows() - r0);
  const std::ptrdiff_t cols = std::min<std::ptrdiff_t>(kTile, stock.cols() - c0);
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    std::copy_n(tile.z.data() + r * kTile, cols, &stock(r0 + r, c0));
}

double widest_holder(const Cutter& cutter) {
  double radius = 0.0;
  for (const HolderPart& part : cutter.holder)
    radius = std::max(radius, std::max(part.bottom_radius_mm, part.top_radius_mm));
  return radius;
}
double lowest_holder(const Cutter& cutter) {
  double bottom = INFINITY;
  for (const HolderPart& part : cutter.holder) bottom = std::min(bottom, part.bottom_mm);
  return bottom;
}

}  // namespace

MillingSim::MillingSim(const SimGrid& grid, std::vector<Cutter> cutters, Grid<float> stock_mm)
    : grid_(grid),
      cutters_(std::move(cutters)),
      stock_(std::move(stock_mm)),
      top_mm_(-INFINITY),
      tile_rows_((stock_.rows() + kTile - 1) / kTile),
      tile_cols_((stock_.cols() + kTile - 1) / kTile) {
  MAQUETTE_CHECK(!stock_.empty() && grid.cell_mm > 0.0 && !cutters_.empty(),
                 "{} x {} cells of {} mm, {} cutters", stock_.rows(), stock_.cols(), grid.cell_mm,
                 cutters_.size());
  MAQUETTE_CHECK(grid.first_row % kBlock == 0 && grid.first_col % kBlock == 0,
                 "window from row {}, column {}", grid.first_row, grid.first_col);
  for (Cutter& c : cutters_) {
    MAQUETTE_CHECK(
        c.radius_mm > 0.0 && c.corner_radius_mm >= 0.0 && c.corner_radius_mm <= c.radius_mm,
        "cutter of radius {} mm, corner {} mm", c.radius_mm, c.corner_radius_mm);
    // Above its flutes a cutter without a known holder goes on as a shank.
    if (c.holder.empty() && c.flute_length_mm > 0.0)
      c.holder.push_back({c.flute_length_mm, 1e6, c.radius_mm, c.radius_mm});
    Cutter& thin = thinner_.emplace_back(c);
    thin.radius_mm = std::max(0.5 * c.radius_mm, c.radius_mm - kCollisionDepth_mm);
    thin.corner_radius_mm = std::min(c.corner_radius_mm, thin.radius_mm);
  }
  for (const float h : stock_.cells()) top_mm_ = std::max(top_mm_, static_cast<double>(h));
}

/// Calls visit(tile) for every tile that the move may touch: row of tiles by row of tiles,
/// the span in x of the part of the chord within reach of that row.
template <class Visit>
void MillingSim::for_each_tile(const ToolMove& move, Visit&& visit) const {
  const Vec3 a = move.piece.from_mm, b = move.piece.to_mm;
  const Cutter& cutter = cutters_[move.cutter];
  const double low = std::min(a.z, b.z);  // also of arcs, which end at quadrants
  if (low >= top_mm_) return;
  const bool holder = low + lowest_holder(cutter) < top_mm_;
  const double half_chord = 0.5 * norm(b - a);
  const double sag = move.piece.kind == PathPiece::Kind::line
                         ? 0.0
                         : std::min(half_chord, half_chord * half_chord / move.piece.radius_mm);
  const double pitch = grid_.cell_mm * kTile;
  const double margin =
      (holder ? std::max(cutter.radius_mm, widest_holder(cutter)) : cutter.radius_mm) + sag +
      2.0 * grid_.cell_mm;
  const double x0 = grid_.x0_mm + static_cast<double>(grid_.first_col) * grid_.cell_mm;
  const double y0 = grid_.y0_mm + static_cast<double>(grid_.first_row) * grid_.cell_mm;
  const auto tile_of = [&](double mm, std::ptrdiff_t count) {
    return static_cast<std::ptrdiff_t>(
        std::min(std::max(std::floor(mm / pitch), -1.0), static_cast<double>(count)));
  };
  const double lo_y = std::min(a.y, b.y) - y0 - margin;
  const double hi_y = std::max(a.y, b.y) - y0 + margin;
  const std::ptrdiff_t ty1 = std::max<std::ptrdiff_t>(0, tile_of(lo_y, tile_rows_));
  const std::ptrdiff_t ty2 = std::min(tile_rows_ - 1, tile_of(hi_y, tile_rows_));
  for (std::ptrdiff_t ty = ty1; ty <= ty2; ++ty) {
    double f1 = 0.0, f2 = 1.0;
    if (const double dy = b.y - a.y; std::abs(dy) > 1e-9) {
      const double p = (y0 + static_cast<double>(ty) * pitch - margin - a.y) / dy;
      const double q = (y0 + static_cast<double>(ty + 1) * pitch + margin - a.y) / dy;
      f1 = std::max(0.0, std::min(p, q));
      f2 = std::min(1.0, std::max(p, q));
      if (f1 > f2) continue;
    }
    const double x1 = a.x + f1 * (b.x - a.x), x2 = a.x + f2 * (b.x - a.x);
    const std::ptrdiff_t tx1 =
        std::max<std::ptrdiff_t>(0, tile_of(std::min(x1, x2) - x0 - margin, tile_cols_));
    const std::ptrdiff_t tx2 =
        std::min(tile_cols_ - 1, tile_of(std::max(x1, x2) - x0 + margin, tile_cols_));
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

void MillingSim::cut(std::span<const ToolMove> moves, MoveEffects& effects) {
  if (moves.empty()) return;
  bin(moves);
  std::vector<std::size_t> active;
  for (std::size_t i = 0; i + 1 < start_.size(); ++i)
    if (start_[i + 1] > start_[i]) active.push_back(i);
  const auto mark = [&](std::uint32_t motion, std::uint8_t bit) {
    std::atomic_ref<std::uint8_t>(effects.touched[motion]).fetch_or(bit, std::memory_order_relaxed);
  };
  tbb::parallel_for(
      tbb::blocked_range<std::size_t>(0, active.size(), 1),
      [&](const tbb::blocked_range<std::size_t>& range) {
        const auto tile = std::make_unique<Tile>();
        for (std::size_t a = range.begin(); a < range.end(); ++a) {
          const std::size_t index = active[a];
          const std::ptrdiff_t r0 = static_cast<std::ptrdiff_t>(index) / tile_cols_ * kTile;
          const std::ptrdiff_t c0 = static_cast<std::ptrdiff_t>(index) % tile_cols_ * kTile;
          tile->cell_mm = grid_.cell_mm;
          tile->x0_mm = grid_.x0_mm;
          tile->y0_mm = grid_.y0_mm;
          tile->row = grid_.first_row + r0;
          tile->col = grid_.first_col + c0;
          tile->counted_from_row = grid_.counted_from_row;
          tile->counted_to_row = grid_.counted_to_row;
          load(*tile, stock_, r0, c0);
          for (std::uint64_t i = start_[index]; i < start_[index + 1]; ++i) {
            const ToolMove& move = moves[order_[i]];
            const swept::Way way(move.piece, (move.rapid ? thinner_ : cutters_)[move.cutter]);
            if (!way.cutter.holder.empty()) {
              if ((i - start_[index]) % 1024 == 1023)
                tile->highest_of_all =
                    *std::max_element(tile->highest.begin(), tile->highest.end());
              if (holder_touches(*tile, way)) mark(move.motion, MoveEffects::kHolder);
            }
            const TileCut cut = sweep_tile(*tile, way);
            if (cut.removed > 0)
              std::atomic_ref<std::int64_t>(effects.removed[move.motion])
                  .fetch_add(cut.removed, std::memory_order_relaxed);
            if (move.rapid && cut.deepest > kCollisionDepth_mm)
              mark(move.motion, MoveEffects::kRapid);
          }
          store(*tile, stock_, r0, c0);
        }
      });
}

MillingSim::Precision MillingSim::precision(double largest_height_mm, double cutter_radius_mm,
                                            double cell_mm) {
  constexpr double kHalfUlp = 0x1.0p-24;
  const double longest = cutter_radius_mm + 2.0 * kBlock * cell_mm;
  // s and d: six roundings of lengths up to `longest`; rho^2, w^2 and the root: six of R^2,
  // which move the cutter's wall by as many R / 2. An arc's rise from its place near the block:
  // docs/derivations/verify_bound.md.
  return {6.0 * kHalfUlp * longest + 6.0 * kHalfUlp * cutter_radius_mm,
          4.0 * kHalfUlp * (largest_height_mm + 2.0 * cutter_radius_mm) +
              swept::kArcRoundings * kHalfUlp * longest};
}

}  // namespace maquette::cnc

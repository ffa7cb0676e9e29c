// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/field_tracer.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <limits>
#include <utility>
#include <vector>

#if defined(__AVX2__)
#include <immintrin.h>
#endif
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/check.hpp"
#include "heightmap/detail/field_walk.hpp"

namespace maquette::heightmap {
namespace {

constexpr std::ptrdiff_t kLeafCells = 4;  // side of a leaf, cells
constexpr std::ptrdiff_t kBranch = 4;     // side of a block, boxes
constexpr double kInf = std::numeric_limits<double>::infinity();
// Widening of boxes against rounding: a slab bound takes about five roundings, so
// 64 half-ulps of the largest coordinate involved leave a factor of ten.
constexpr double kSlack = 64.0 * 0x1.0p-53;
// Components below this are taken as zero: over any path that double precision can
// resolve they move the ray by less than the slack.
constexpr double kParallel = 1e-14;

/// Boxes of one level, stored in blocks of 4 x 4, so that a block is two cache lines
/// of heights. Boxes beyond the field are empty (low = +inf, high = -inf).
struct Level {
  std::ptrdiff_t rows = 0, cols = 0;  // boxes
  std::ptrdiff_t block_cols = 0;
  std::ptrdiff_t box_cells = 0;  // side of a box, cells
  std::vector<float> low, high;

  Level(std::ptrdiff_t r, std::ptrdiff_t c, std::ptrdiff_t cells)
      : rows(r), cols(c), block_cols((c + kBranch - 1) / kBranch), box_cells(cells) {
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

/// One horizontal coordinate of the ray in cells: position u + t du.
struct Axis {
  double u = 0.0, du = 0.0, inverse = 0.0, slack = 0.0;
  bool parallel = false;

  /// Distances at which the ray is surely not outside [lo, hi], cells.
  [[nodiscard]] std::pair<double, double> slab(double lo, double hi) const {
    if (parallel)
      return u >= lo - slack && u <= hi + slack ? std::pair{-kInf, kInf} : std::pair{kInf, -kInf};
    const double a = (lo - slack - u) * inverse;
    const double b = (hi + slack - u) * inverse;
    return a < b ? std::pair{a, b} : std::pair{b, a};
  }
};

Axis make_axis(double origin_mm, double direction, double first_mm, double spacing_mm,
               std::ptrdiff_t cells) {
  Axis a;
  a.u = (origin_mm - first_mm) / spacing_mm;
  a.du = direction / spacing_mm;
  a.parallel = std::abs(direction) < kParallel;
  a.inverse = a.parallel ? 0.0 : spacing_mm / direction;
  a.slack = kSlack * ((std::abs(origin_mm) + std::abs(first_mm)) / spacing_mm + std::abs(a.u) +
                      static_cast<double>(cells));
  if (a.parallel) a.slack *= 2.0;
  return a;
}

/// The ray as the watertight test wants it: axes permuted so that the third is the
/// longest, sheared so that the ray becomes that axis.
struct ShearedRay {
  std::array<double, 3> origin;
  std::size_t kx, ky, kz;
  double sx, sy, sz;

  ShearedRay(Vec3 o, Vec3 d) : origin{o.x, o.y, o.z} {
    const std::array<double, 3> dir{d.x, d.y, d.z};
    kz = 0;
    for (std::size_t i = 1; i < 3; ++i)
      if (std::abs(dir[i]) > std::abs(dir[kz])) kz = i;
    kx = (kz + 1) % 3;
    ky = (kz + 2) % 3;
    sx = dir[kx] / dir[kz];
    sy = dir[ky] / dir[kz];
    sz = 1.0 / dir[kz];
  }
  /// x, y across the ray, z = distance along it. A function of the vertex alone, so
  /// that all triangles around a vertex see the same rounded point.
  [[nodiscard]] Vec3 operator()(Vec3 p) const {
    const std::array<double, 3> a{p.x - origin[0], p.y - origin[1], p.z - origin[2]};
    return {a[kx] - sx * a[kz], a[ky] - sy * a[kz], sz * a[kz]};
  }
};

/// Distance along the ray, NaN for a miss. The sign of fl(ab) - fl(cd) is the sign of
/// ab - cd or zero, because rounding is monotonic, and swapping the two corners of an
/// edge negates it exactly; zero counts as inside on both sides: nothing slips
/// through. (Needs multiplications that are not fused with the subtraction.)
double sheared_triangle(Vec3 a, Vec3 b, Vec3 c) {
  const double u = c.x * b.y - c.y * b.x;
  const double v = a.x * c.y - a.y * c.x;
  const double w = b.x * a.y - b.y * a.x;
  if ((u < 0.0 || v < 0.0 || w < 0.0) && (u > 0.0 || v > 0.0 || w > 0.0)) return NAN;
  const double det = u + v + w;
  if (det == 0.0) return NAN;
  return (u * a.z + v * b.z + w * c.z) / det;
}

struct Best {
  double distance = kInf;
  std::ptrdiff_t row = -1, col = -1;
  bool lower_right = false;
};

struct Traversal {
  const ModelField& field;
  Axis x, y;
  ShearedRay sheared;
  double oz, dz, inverse_z, slack_z, from;
  double end = kInf;  // the ray leaves the field's box
  Best best;

  /// Can the ray between distances t0 and t1 be between heights low and high?
  [[nodiscard]] bool meets(double t0, double t1, double low, double high) const {
    const double z0 = oz + t0 * dz;
    const double z1 = oz + t1 * dz;
    return std::min(z0, z1) - slack_z <= high && std::max(z0, z1) + slack_z >= low;
  }

  void cell(std::ptrdiff_t r, std::ptrdiff_t c) {
    const double x0 = field.x_mm(c), x1 = field.x_mm(c + 1);
    const double y0 = field.y_mm(r), y1 = field.y_mm(r + 1);
    const Grid<float>& z = field.z_mm;
    const Vec3 a = sheared({x0, y0, static_cast<double>(z(r, c))});
    const Vec3 d = sheared({x1, y1, static_cast<double>(z(r + 1, c + 1))});
    const Vec3 b = sheared({x1, y0, static_cast<double>(z(r, c + 1))});
    const Vec3 e = sheared({x0, y1, static_cast<double>(z(r + 1, c))});
    // A corner that is not finite makes the distance NaN, and no comparison holds.
    const double right = sheared_triangle(a, b, d);
    if (right > from && right < best.distance) best = {right, r, c, true};
    const double left = sheared_triangle(a, d, e);
    if (left > from && left < best.distance) best = {left, r, c, false};
  }

  /// The cells of a leaf that the ray can meet between the leaf's least and greatest height.
  void leaf(const Level& leaves, std::ptrdiff_t leaf_row, std::ptrdiff_t leaf_col) {
    const Grid<float>& z = field.z_mm;
    const std::ptrdiff_t row0 = leaf_row * kLeafCells, col0 = leaf_col * kLeafCells;
    const std::ptrdiff_t row1 = std::min(row0 + kLeafCells, z.rows() - 1) - 1;
    const std::ptrdiff_t col1 = std::min(col0 + kLeafCells, z.cols() - 1) - 1;
    const auto [x_in, x_out] = x.slab(static_cast<double>(col0), static_cast<double>(col1 + 1));
    const auto [y_in, y_out] = y.slab(static_cast<double>(row0), static_cast<double>(row1 + 1));
    double t_in = std::max({from, x_in, y_in});
    double t_out = std::min({x_out, y_out, end, best.distance});
    const std::size_t box = leaves.box(leaf_row, leaf_col);
    const auto lowest = static_cast<double>(leaves.low[box]),
               highest = static_cast<double>(leaves.high[box]);
    if (std::abs(dz) >= kParallel) {
      const double a = (lowest - slack_z - oz) * inverse_z,
                   b = (highest + slack_z - oz) * inverse_z;
      t_in = std::max(t_in, std::min(a, b));
      t_out = std::min(t_out, std::max(a, b));
    } else if (!meets(0.0, 0.0, lowest, highest)) {
      return;
    }
    if (!(t_in <= t_out)) return;
    const auto between = [&](const Axis& a, std::ptrdiff_t first, std::ptrdiff_t last) {
      const double p = a.u + t_in * a.du, q = a.u + t_out * a.du;
      return std::pair{
          std::max(first, static_cast<std::ptrdiff_t>(std::floor(std::min(p, q) - 2.0 * a.slack))),
          std::min(last, static_cast<std::ptrdiff_t>(std::floor(std::max(p, q) + 2.0 * a.slack)))};
    };
    const auto [r0, r1] = between(y, row0, row1);
    const auto [c0, c1] = between(x, col0, col1);
    for (std::ptrdiff_t i = 0; i <= r1 - r0; ++i) {
      const std::ptrdiff_t r = y.du < 0.0 ? r1 - i : r0 + i;
      const auto [row_in, row_out] = y.slab(static_cast<double>(r), static_cast<double>(r + 1));
      const double ta = std::max(t_in, row_in);
      const double tb = std::min({t_out, row_out, best.distance});
      if (!(ta <= tb)) continue;
      const double ua = x.u + ta * x.du, ub = x.u + tb * x.du;
      const double first = std::floor(std::min(ua, ub) - 2.0 * x.slack);
      const double last = std::floor(std::max(ua, ub) + 2.0 * x.slack);
      if (!(last >= static_cast<double>(c0) && first <= static_cast<double>(c1))) continue;
      const auto ca = static_cast<std::ptrdiff_t>(std::max(first, static_cast<double>(c0)));
      const auto cb = static_cast<std::ptrdiff_t>(std::min(last, static_cast<double>(c1)));
      for (std::ptrdiff_t c = ca; c <= cb; ++c) {
        const auto [col_in, col_out] = x.slab(static_cast<double>(c), static_cast<double>(c + 1));
        const double t0 = std::max(ta, col_in), t1 = std::min(tb, col_out);
        if (!(t0 <= t1)) continue;
        const float* lower = &z(r, c);
        const float* upper = &z(r + 1, c);
        // std::min/max in this order step over NaN corners instead of keeping them.
        float low = INFINITY, high = -INFINITY;
        for (const float h : {lower[0], lower[1], upper[0], upper[1]}) {
          low = std::min(low, h);
          high = std::max(high, h);
        }
        if (meets(t0, t1, static_cast<double>(low), static_cast<double>(high))) cell(r, c);
      }
    }
  }
};

using Lane4 = std::array<double, 4>;

/// Distances at which the ray enters and leaves four neighbouring slabs that start at
/// cell `first` and are `width` cells wide.
inline void four_slabs(const Axis& a, double first, double width, Lane4& in, Lane4& out) {
  if (a.parallel) {
    for (std::size_t i = 0; i < 4; ++i) {
      const double lo = first + static_cast<double>(i) * width;
      const auto [t0, t1] = a.slab(lo, lo + width);
      in[i] = t0;
      out[i] = t1;
    }
    return;
  }
  const double near = a.inverse > 0.0 ? -a.slack : width + a.slack;
  const double far = a.inverse > 0.0 ? width + a.slack : -a.slack;
  for (std::size_t i = 0; i < 4; ++i) {
    const double lo = first + static_cast<double>(i) * width;
    in[i] = (lo + near - a.u) * a.inverse;
    out[i] = (lo + far - a.u) * a.inverse;
  }
}

/// Which of the four boxes of one row of a block the ray may meet; their entry and
/// exit distances.
inline unsigned meet_row(const Traversal& t, const Lane4& col_in, const Lane4& col_out, double in,
                         double out, const float* low, const float* high, double* entry,
                         double* exit) {
#if defined(__AVX2__)
  const __m256d t0 = _mm256_max_pd(_mm256_loadu_pd(col_in.data()), _mm256_set1_pd(in));
  const __m256d t1 = _mm256_min_pd(_mm256_loadu_pd(col_out.data()), _mm256_set1_pd(out));
  const __m256d oz = _mm256_set1_pd(t.oz), dz = _mm256_set1_pd(t.dz);
  const __m256d slack = _mm256_set1_pd(t.slack_z);
  const __m256d z0 = _mm256_add_pd(oz, _mm256_mul_pd(t0, dz));
  const __m256d z1 = _mm256_add_pd(oz, _mm256_mul_pd(t1, dz));
  const __m256d bottom = _mm256_sub_pd(_mm256_min_pd(z0, z1), slack);
  const __m256d top = _mm256_add_pd(_mm256_max_pd(z0, z1), slack);
  const __m256d lows = _mm256_cvtps_pd(_mm_loadu_ps(low));
  const __m256d highs = _mm256_cvtps_pd(_mm_loadu_ps(high));
  const __m256d hit = _mm256_and_pd(_mm256_cmp_pd(t0, t1, _CMP_LE_OQ),
                                    _mm256_and_pd(_mm256_cmp_pd(bottom, highs, _CMP_LE_OQ),
                                                  _mm256_cmp_pd(top, lows, _CMP_GE_OQ)));
  _mm256_storeu_pd(entry, t0);
  _mm256_storeu_pd(exit, t1);
  return static_cast<unsigned>(_mm256_movemask_pd(hit));
#else
  unsigned mask = 0;
  for (std::size_t i = 0; i < 4; ++i) {
    entry[i] = std::max(col_in[i], in);
    exit[i] = std::min(col_out[i], out);
    if (entry[i] <= exit[i] &&
        t.meets(entry[i], exit[i], static_cast<double>(low[i]), static_cast<double>(high[i])))
      mask |= 1U << i;
  }
  return mask;
#endif
}

struct Waiting {
  double t_in, t_out;
  std::int32_t level;  // of the block; -1: a leaf
  std::int32_t row, col;
};

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
                      (z.cols() - 1 + kLeafCells - 1) / kLeafCells, kLeafCells);
  fill_leaves(levels.back(), z);
  while (levels.back().rows > kBranch || levels.back().cols > kBranch) {
    const Level& lower = levels.back();
    Level upper((lower.rows + kBranch - 1) / kBranch, lower.block_cols, lower.box_cells * kBranch);
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

Traversal make_traversal(const ModelField& f, double low, double high, Vec3 origin, Vec3 direction,
                         double from_mm, double radius_mm) {
  const auto cells_x = f.z_mm.cols() - 1, cells_y = f.z_mm.rows() - 1;
  Traversal t{f,
              make_axis(origin.x, direction.x, f.x0.value(), f.spacing.value(), cells_x),
              make_axis(origin.y, direction.y, f.y0.value(), f.spacing.value(), cells_y),
              ShearedRay(origin, direction),
              origin.z,
              direction.z,
              1.0 / direction.z,  // not used where the ray is level
              0.0,
              from_mm,
              kInf,
              {}};
  // Clip to the field's box. Whatever is left is finite, because a unit direction
  // leaves the box along its longest axis.
  const double dx = std::abs(t.x.u) + static_cast<double>(cells_x);
  const double dy = std::abs(t.y.u) + static_cast<double>(cells_y);
  const double heights = std::abs(origin.z) + std::abs(low) + std::abs(high);
  const double reach = (dx + dy) * f.spacing.value() + heights + radius_mm;
  t.slack_z = kSlack * (heights + reach * std::abs(direction.z)) + radius_mm;
  t.x.slack += radius_mm / f.spacing.value();
  t.y.slack += radius_mm / f.spacing.value();
  const auto [x_in, x_out] = t.x.slab(0.0, static_cast<double>(cells_x));
  const auto [y_in, y_out] = t.y.slab(0.0, static_cast<double>(cells_y));
  t.from = std::max({from_mm, x_in, y_in});
  t.end = std::min({x_out, y_out, 4.0 * reach});
  if (std::abs(direction.z) < kParallel) {
    if (!t.meets(0.0, 0.0, low, high)) t.end = -kInf;
  } else {
    const double a = (low - t.slack_z - origin.z) / direction.z;
    const double b = (high + t.slack_z - origin.z) / direction.z;
    t.from = std::max(t.from, std::min(a, b));
    t.end = std::min(t.end, std::max(a, b));
  }
  return t;
}

/// Leaves that `t` meets, front to back, until they lie beyond limit().
template <class Visit, class Limit>
void walk(const std::vector<Level>& levels, const Traversal& t, bool mirror_x, bool mirror_y,
          const Visit& visit, const Limit& limit) {
  // At most seven boxes of a block lie on a ray (plus what the slack adds), so 16 per
  // level is ample; 16 levels of branching 4 are more nodes than can be addressed.
  std::array<Waiting, 256> stack;
  std::size_t waiting = 0;
  stack[waiting++] = {t.from, t.end, static_cast<std::int32_t>(levels.size()) - 1, 0, 0};
  while (waiting > 0) {
    const Waiting box = stack[--waiting];
    if (box.t_in > limit()) continue;
    if (box.level < 0) {
      visit(box.row, box.col);
      continue;
    }
    const Level& level = levels[static_cast<std::size_t>(box.level)];
    const auto width = static_cast<double>(level.box_cells);
    Lane4 col_in, col_out, row_in, row_out;
    four_slabs(t.x, static_cast<double>(box.col) * 4.0 * width, width, col_in, col_out);
    four_slabs(t.y, static_cast<double>(box.row) * 4.0 * width, width, row_in, row_out);
    const std::size_t block = level.block(box.row, box.col);
    const double nearest = std::min(box.t_out, limit());
    // The ray is monotonic in both directions, so going through rows and columns the
    // ray's way is front to back; the stack takes them back to front.
    for (std::size_t i = 0; i < 4; ++i) {
      const std::size_t r = mirror_y ? i : 3 - i;
      const double in = std::max(box.t_in, row_in[r]), out = std::min(nearest, row_out[r]);
      if (!(in <= out)) continue;
      std::array<double, 4> entry, exit;
      const unsigned mask = meet_row(t, col_in, col_out, in, out, &level.low[block + 4 * r],
                                     &level.high[block + 4 * r], entry.data(), exit.data());
      if (mask == 0) continue;
      for (std::size_t j = 0; j < 4; ++j) {
        const std::size_t c = mirror_x ? j : 3 - j;
        if ((mask >> c & 1U) != 0)
          stack[waiting++] = {entry[c], exit[c], box.level - 1,
                              box.row * 4 + static_cast<std::int32_t>(r),
                              box.col * 4 + static_cast<std::int32_t>(c)};
      }
    }
  }
}

FieldHit hit_at(const ModelField& f, const Best& best, Vec3 origin, Vec3 direction) {
  const std::ptrdiff_t r = best.row, c = best.col;
  const auto z = [&](std::ptrdiff_t i, std::ptrdiff_t j) {
    return static_cast<double>(f.z_mm(r + i, c + j));
  };
  const double rise_x = best.lower_right ? z(0, 1) - z(0, 0) : z(1, 1) - z(1, 0);
  const double rise_y = best.lower_right ? z(1, 1) - z(0, 1) : z(1, 0) - z(0, 0);
  return {best.distance, origin + best.distance * direction,
          normalized(Vec3{-rise_x, -rise_y, f.spacing.value()})};
}

std::optional<FieldHit> hit_of(const Traversal& t, Vec3 origin, Vec3 direction) {
  if (t.best.row < 0) return std::nullopt;
  return hit_at(t.field, t.best, origin, direction);
}

}  // namespace

namespace {

detail::WalkRay walk_ray(Vec3 o, Vec3 d, double from_mm, double to_mm) {
  return {{o.x, o.y, o.z}, {d.x, d.y, d.z}, from_mm, to_mm};
}

std::optional<FieldHit> hit_of(const ModelField& f, const detail::WalkHit& hit, Vec3 origin,
                               Vec3 direction) {
  if (hit.row < 0) return std::nullopt;
  return hit_at(f, {hit.distance_mm, hit.row, hit.col, hit.lower_right}, origin, direction);
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

void FieldTracer::trace_bundle(const Ray& axis, double radius_mm, std::span<const Ray> rays,
                               std::span<std::optional<FieldHit>> hits) const {
  MAQUETTE_CHECK(rays.size() == hits.size(), "{} rays, {} hits", rays.size(), hits.size());
  std::fill(hits.begin(), hits.end(), std::nullopt);
  const Pyramid& p = *pyramid_;
  if (!(p.low <= p.high)) return;
  // Distances along a ray and along the axis differ by the tilt's square only.
  constexpr double kTilt = 1.0 + 1e-4;
  const Traversal tube = make_traversal(*field_, p.low, p.high, axis.origin_mm, axis.direction, 0.0,
                                        1.001 * radius_mm);
  if (!(tube.from <= tube.end)) return;
  std::vector<Traversal> bundle;
  bundle.reserve(rays.size());
  for (const Ray& ray : rays)
    bundle.push_back(
        make_traversal(*field_, p.low, p.high, ray.origin_mm, ray.direction, 0.0, 0.0));
  double farthest = kInf;
  walk(
      p.levels, tube, axis.direction.x < 0.0, axis.direction.y < 0.0,
      [&](std::ptrdiff_t row, std::ptrdiff_t col) {
        double most = 0.0;
        for (Traversal& t : bundle) {
          t.leaf(p.levels.front(), row, col);
          most = std::max(most, t.best.distance);
        }
        farthest = kTilt * most + radius_mm;
      },
      [&] { return farthest; });
  for (std::size_t i = 0; i < rays.size(); ++i)
    hits[i] = hit_of(bundle[i], rays[i].origin_mm, rays[i].direction);
}

}  // namespace maquette::heightmap

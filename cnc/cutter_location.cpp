// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/cutter_location.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <cstring>
#include <variant>
#include <vector>

#ifdef __AVX2__
#include <immintrin.h>
#endif

#include "cnc/contact.hpp"
#include "core/check.hpp"

namespace maquette::cnc {
namespace {

constexpr int kLanes = 8;
constexpr float kOutOfReach = -1e30F;
constexpr float kNoBound = 4e30F;  // stays huge after adding kOutOfReach
constexpr int kLattice = 16;       // tables are kept for this many positions per cell and axis
/// A table serves positions this near to its own, so that coordinates rounded to 0.0001 mm
/// share it; the bounds in it are widened accordingly (two axes: sqrt(2) * 6e-5 < 1e-4).
constexpr double kTableReuse_mm = 6e-5;
constexpr double kTableSlack_mm = 1e-4;
/// What a contact must gain before it is looked at: far below the promised accuracy, far
/// above rounding, so that the many facets of one plane are not all worked out.
constexpr double kLeastGain_mm = 1e-11;

/// What depends on the position within a cell but not on the heights.
struct Window {
  bool ready = false;
  double fraction_y = 0.0;         // of windows whose row position is off the lattice
  std::vector<float> cap;          // node: underside below the reference point's height
  std::vector<float> chord;        // cell: kappa d^2 / 4
  std::vector<float> cap_nearest;  // cell: cap at its nearest point
};

/// Position along one axis as cell + fraction of a cell.
struct Place {
  std::ptrdiff_t cell;
  int lattice;      // -1: off the lattice
  double fraction;  // of a lattice place: exactly lattice / kLattice
};

Place place(double t, double spacing) {
  const double k = std::round(t * kLattice);
  if (std::abs(t * kLattice - k) * spacing <= kTableReuse_mm * kLattice) {
    const auto i = static_cast<std::ptrdiff_t>(k);
    const std::ptrdiff_t cell = i >= 0 ? i / kLattice : -((-i + kLattice - 1) / kLattice);
    const auto lattice = static_cast<int>(i - cell * kLattice);
    return {cell, lattice, static_cast<double>(lattice) / kLattice};
  }
  const double cell = std::floor(t);
  return {static_cast<std::ptrdiff_t>(cell), -1, t - cell};
}

using Shape = std::variant<BallShape, FlatShape, BullShape>;
Shape shape_of(const Cutter& tool) {
  if (tool.is_ball()) return BallShape(tool.radius_mm);
  if (tool.corner_radius_mm == 0.0) return FlatShape(tool.radius_mm);
  return BullShape(tool.radius_mm, tool.corner_radius_mm);
}

}  // namespace

/// Contacts are of a reference point `corner` above the tip (contact.hpp).
struct DropCutter::Surface {
  Surface(const heightmap::ModelField& field, const Cutter& tool);

  void fill(Window& window, double fraction_x, double fraction_y) const;
  [[nodiscard]] const float* node(std::ptrdiff_t row, std::ptrdiff_t col) const {
    return z.data() + (row + pad) * stride + col + pad;
  }

  double d, per_d, R, corner, x0, y0;
  Shape shape;
  std::ptrdiff_t rows, cols;
  std::ptrdiff_t reach;        // cells
  std::ptrdiff_t width;        // of a window row, padded to whole registers
  std::ptrdiff_t pad, stride;  // nodes of kOutOfReach around the field
  double rounding;             // of the single precision bounds
  std::vector<float> z;
};

DropCutter::Surface::Surface(const heightmap::ModelField& field, const Cutter& tool)
    : d(field.spacing.value()),
      per_d(1.0 / d),
      R(tool.radius_mm),
      corner(tool.corner_radius_mm),
      x0(field.x0.value()),
      y0(field.y0.value()),
      shape(shape_of(tool)),
      rows(field.z_mm.rows()),
      cols(field.z_mm.cols()) {
  MAQUETTE_CHECK(rows >= 2 && cols >= 2, "{} x {} nodes", rows, cols);
  MAQUETTE_CHECK(d > 0.0 && R > 0.0, "spacing {} mm, radius {} mm", d, R);
  MAQUETTE_CHECK(corner >= 0.0 && corner <= R, "corner {} mm of radius {} mm", corner, R);
  reach = static_cast<std::ptrdiff_t>(std::ceil((R + kTableSlack_mm) / d));
  width = (2 * reach + 2 + kLanes - 1) / kLanes * kLanes;
  pad = 2 * reach + 2;
  stride = cols + pad + width + reach + 2;
  z.assign(static_cast<std::size_t>((rows + 2 * pad) * stride), kOutOfReach);
  double highest = 0.0;
  for (std::ptrdiff_t r = 0; r < rows; ++r) {
    const auto from = field.z_mm.row(r);
    std::copy(from.begin(), from.end(), z.data() + (r + pad) * stride + pad);
    for (const float h : from) highest = std::max(highest, static_cast<double>(std::abs(h)));
  }
  // Three roundings to 24 bits and one of the threshold.
  rounding = 4.0 * 0x1p-23 * (highest + 4.0 * R);
}

void DropCutter::Surface::fill(Window& window, double fraction_x, double fraction_y) const {
  // Squared distances along one axis: of a node, and of a cell's nearest and farthest point.
  struct Squares {
    std::vector<float> node, nearest, farthest;
  };
  const auto squares = [&](double fraction) {
    const auto n = static_cast<std::size_t>(width);
    Squares q{std::vector<float>(n), std::vector<float>(n), std::vector<float>(n)};
    for (std::ptrdiff_t c = 0; c < width; ++c) {
      const auto i = static_cast<std::size_t>(c);
      const double from = (static_cast<double>(c - reach) - fraction) * d;
      const double near = std::max({0.0, from, -from - d});
      const double far = std::max(std::abs(from), std::abs(from + d));
      // Columns that only fill up the register are out of everyone's reach.
      const bool exists = c < 2 * reach + 2, is_cell = c < 2 * reach + 1;
      q.node[i] = exists ? static_cast<float>(from * from) : -kOutOfReach;
      q.nearest[i] = is_cell ? static_cast<float>(near * near) : -kOutOfReach;
      q.farthest[i] = is_cell ? static_cast<float>(far * far) : -kOutOfReach;
    }
    return q;
  };
  const Squares along_x = squares(fraction_x), along_y = squares(fraction_y);
  // A distance may be wrong by the slack and by a few units of 2^-24 R; both are taken to the
  // safe side. t is the distance beyond the flat part, where the corner's circle begins.
  const auto flat = static_cast<float>(R - corner), rc = static_cast<float>(corner);
  const auto slack = static_cast<float>(kTableSlack_mm + 1e-6 * R);
  const auto chord_scale = static_cast<float>(corner * corner * d * d / 4.0 * (1.0 + 1e-6));
  constexpr float kUp = 1.0F + 1e-6F;

  const auto nodes = static_cast<std::size_t>((2 * reach + 2) * width);
  window.cap.resize(nodes + kLanes, kOutOfReach);
  window.chord.resize(nodes);
  window.cap_nearest.resize(nodes);
  for (std::ptrdiff_t r = 0; r < 2 * reach + 2; ++r) {
    const auto row = static_cast<std::size_t>(r);
    const float node_y = along_y.node[row];
    const float near_y = along_y.nearest[row], far_y = along_y.farthest[row];
    const float* __restrict node_x = along_x.node.data();
    const float* __restrict near_x = along_x.nearest.data();
    const float* __restrict far_x = along_x.farthest.data();
    float* __restrict cap = window.cap.data() + r * width;
    float* __restrict chord = window.chord.data() + r * width;
    float* __restrict cap_nearest = window.cap_nearest.data() + r * width;
    for (std::ptrdiff_t c = 0; c < width; ++c) {
      const float g = std::max(0.0F, std::sqrt(node_x[c] + node_y) - flat - slack);
      cap[c] = g <= rc ? std::sqrt((rc - g) * (rc + g)) * kUp : kOutOfReach;
      const float n = std::max(0.0F, std::sqrt(near_x[c] + near_y) - flat - slack);
      cap_nearest[c] = n <= rc ? std::sqrt((rc - n) * (rc + n)) * kUp : kOutOfReach;
      const float t = std::max(0.0F, std::sqrt(far_x[c] + far_y) - flat + slack);
      const float f = (rc - t) * (rc + t);
      chord[c] = t >= rc ? (t > 0.0F ? kNoBound : 0.0F)
                         : (t > 0.0F ? chord_scale / (f * std::sqrt(f)) * kUp : 0.0F);
    }
  }
  window.ready = true;
  window.fraction_y = fraction_y;
}

struct DropCutter::Scratch {
  std::array<std::array<Window, kLattice>, kLattice> on_lattice;  // [y][x]
  std::array<Window, kLattice> on_row;  // x on the lattice, y not: of one fraction_y
  Window free;
  std::vector<float> bound;  // cell
};

DropCutter::DropCutter(const heightmap::ModelField& field, const Cutter& tool)
    : surface_(std::make_shared<const Surface>(field, tool)),
      scratch_(std::make_unique<Scratch>()) {}
DropCutter::DropCutter(const DropCutter& other)
    : surface_(other.surface_), scratch_(std::make_unique<Scratch>()) {}
DropCutter::~DropCutter() = default;

namespace {

/// One cell in its own coordinates: corner z00 at the origin, axis at (px, py).
template <class Shape>
struct ExactCell {
  const Shape& shape;
  double d, per_d, px, py;
  double z00, z10, z01, z11;  // first digit: along x
  Touch& best;

  void vertex(double vx, double vy, double vz) const {
    touch_vertex(shape, vx - px, vy - py, vz, best);
  }

  /// Edge from (ax, ay, az) along the unit vector (ex, ey). `along` and `beside` are where the
  /// axis stands.
  void edge(double ax, double ay, double ex, double ey, double length, double az, double rise,
            double along, double beside) const {
    const double h2 = beside * beside;
    if (!(h2 <= shape.reach2)) return;
    const double m = rise / length;
    const Peak peak = shape.on_line(h2, std::abs(m));
    const double s = along + (m < 0.0 ? -peak.away_mm : peak.away_mm);
    if (!(s > 0.0 && s < length)) return;  // then a vertex is higher
    const double z = az + m * s + peak.lift_mm;
    if (z > best.z_mm) best = {z, ax + s * ex - px, ay + s * ey - py};
  }

  void diagonal() const {
    constexpr double kHalf = 0.70710678118654752440;
    edge(0.0, 0.0, kHalf, kHalf, d / kHalf, z00, z11 - z00, (px + py) * kHalf, (py - px) * kHalf);
  }

  /// Peak over the plane, in the cell's coordinates; false: the whole plane is too low.
  bool peak_of_plane(double gx, double gy, double& lx, double& ly, double& z) const {
    const double under = z00 + gx * px + gy * py, g2 = gx * gx + gy * gy;
    z = under + shape.above_plane(g2);
    if (z < best.z_mm + kLeastGain_mm) return false;
    const double away = shape.on_plane(g2).away_mm;
    const double per_g = g2 > 0.0 ? away / std::sqrt(g2) : 0.0;
    lx = px + per_g * gx;
    ly = py + per_g * gy;
    return true;
  }
  void lower_right() const {
    double lx, ly, z;
    if (!peak_of_plane((z10 - z00) * per_d, (z11 - z10) * per_d, lx, ly, z)) return;
    if (ly >= 0.0 && lx <= d && ly <= lx) {
      best = {z, lx - px, ly - py};
      return;
    }
    if (ly < 0.0) edge(0.0, 0.0, 1.0, 0.0, d, z00, z10 - z00, px, py);
    if (lx > d) edge(d, 0.0, 0.0, 1.0, d, z10, z11 - z10, py, px - d);
    if (ly > lx) diagonal();
  }
  void upper_left() const {
    double lx, ly, z;
    if (!peak_of_plane((z11 - z01) * per_d, (z01 - z00) * per_d, lx, ly, z)) return;
    if (lx >= 0.0 && ly <= d && ly >= lx) {
      best = {z, lx - px, ly - py};
      return;
    }
    if (lx < 0.0) edge(0.0, 0.0, 0.0, 1.0, d, z00, z01 - z00, py, px);
    if (ly > d) edge(0.0, d, 1.0, 0.0, d, z01, z11 - z01, px, py - d);
    if (ly < lx) diagonal();
  }
};

// Eight floats at once in the compilers' own notation, which they lower to what the target has.
using Lanes = float __attribute__((vector_size(kLanes * sizeof(float))));
inline Lanes load(const float* from) {
  Lanes v;
  std::memcpy(&v, from, sizeof v);
  return v;
}
inline void store(float* to, Lanes v) {
  std::memcpy(to, &v, sizeof v);
}
inline Lanes larger(Lanes a, Lanes b) {
  return a > b ? a : b;
}
inline Lanes smaller(Lanes a, Lanes b) {
  return a < b ? a : b;
}
inline float largest(Lanes v) {
  float top = v[0];
  for (int k = 1; k < kLanes; ++k) top = v[k] > top ? v[k] : top;
  return top;
}

/// The nodes that a window lies over.
struct Region {
  const float* z;
  std::ptrdiff_t stride, rows, width;
};

/// Upper bound of the contact with each cell; returns the largest. `kColumns` registers
/// starting at `column` of every row.
template <std::size_t kColumns>
float cell_bounds(const Region& region, const Window& window, float* bound,
                  std::ptrdiff_t column = 0) {
  std::array<Lanes, kColumns> corners{},
      heights{};  // of the row below, larger of node and right one
  Lanes top = Lanes{} + kOutOfReach;
  const float* z = region.z + column;
  const float* cap = window.cap.data() + column;
  const float* chord = window.chord.data() + column;
  const float* nearest = window.cap_nearest.data() + column;
  float* u = bound + column;
  for (std::ptrdiff_t r = 0; r < region.rows; ++r, z += region.stride, cap += region.width) {
    for (std::size_t k = 0; k < kColumns; ++k) {
      const std::size_t at = kLanes * k;
      const Lanes left = load(z + at), right = load(z + at + 1);
      const Lanes corner = larger(left + load(cap + at), right + load(cap + at + 1));
      const Lanes height = larger(left, right);
      if (r > 0) {
        const Lanes by_corner = larger(corners[k], corner) + load(chord + at);
        const Lanes by_height = larger(heights[k], height) + load(nearest + at);
        const Lanes cell = smaller(by_corner, by_height);
        store(u + at, cell);
        top = larger(top, cell);
      }
      corners[k] = corner;
      heights[k] = height;
    }
    if (r > 0) chord += region.width, nearest += region.width, u += region.width;
  }
  return largest(top);
}

float cell_bounds_of_any_width(const Region& region, const Window& window, float* bound) {
  float top = kOutOfReach;
  for (std::ptrdiff_t column = 0; column < region.width; column += kLanes)
    top = std::max(top, cell_bounds<1>(region, window, bound, column));
  return top;
}

/// Index of the first element that equals `value`, which is there.
std::size_t first_equal(const std::vector<float>& bound, float value) {
  for (std::size_t i = 0;; i += kLanes) {
#ifdef __AVX2__
    const auto mask = static_cast<unsigned>(_mm256_movemask_ps(
        _mm256_cmp_ps(_mm256_loadu_ps(bound.data() + i), _mm256_set1_ps(value), _CMP_EQ_OQ)));
    if (mask != 0) return i + static_cast<std::size_t>(__builtin_ctz(mask));
#else
    for (std::size_t k = i; k < i + kLanes; ++k)
      if (bound[k] == value) return k;
#endif
  }
}

/// Calls visit(row, column) for each bound > threshold(); the threshold may rise meanwhile.
template <class Threshold, class Visit>
void for_each_above(const float* bound, std::ptrdiff_t rows, std::ptrdiff_t width,
                    Threshold&& threshold, Visit&& visit) {
  for (std::ptrdiff_t r = 0; r < rows; ++r, bound += width)
    for (std::ptrdiff_t c = 0; c < width; c += kLanes) {
#ifdef __AVX2__
      auto mask = static_cast<unsigned>(_mm256_movemask_ps(
          _mm256_cmp_ps(_mm256_loadu_ps(bound + c), _mm256_set1_ps(threshold()), _CMP_GT_OQ)));
      for (; mask != 0; mask &= mask - 1) {
        const std::ptrdiff_t k = c + __builtin_ctz(mask);
        if (bound[k] > threshold()) visit(r, k);
      }
#else
      for (std::ptrdiff_t k = c; k < c + kLanes; ++k)
        if (bound[k] > threshold()) visit(r, k);
#endif
    }
}

}  // namespace

CutterContact DropCutter::drop(double x_mm, double y_mm) {
  const Surface& s = *surface_;
  const double tx = (x_mm - s.x0) * s.per_d, ty = (y_mm - s.y0) * s.per_d;
  const auto beyond = [&](double t, std::ptrdiff_t nodes) {
    return !(t > -static_cast<double>(s.reach) - 0.5 &&
             t < static_cast<double>(nodes - 1 + s.reach) + 0.5);
  };
  if (beyond(tx, s.cols) || beyond(ty, s.rows)) return {};
  const Place at_x = place(tx, s.d), at_y = place(ty, s.d);

  Window* window = &scratch_->free;
  if (at_x.lattice >= 0 && at_y.lattice >= 0) {
    window = &scratch_->on_lattice[static_cast<std::size_t>(at_y.lattice)]
                                  [static_cast<std::size_t>(at_x.lattice)];
  } else if (at_x.lattice >= 0) {
    window = &scratch_->on_row[static_cast<std::size_t>(at_x.lattice)];
    if (window->fraction_y != at_y.fraction) window->ready = false;
  } else {
    window->ready = false;
  }
  if (!window->ready) s.fill(*window, at_x.fraction, at_y.fraction);

  const std::ptrdiff_t w = s.width, row0 = at_y.cell - s.reach, col0 = at_x.cell - s.reach;
  std::vector<float>& bound = scratch_->bound;
  bound.resize(static_cast<std::size_t>((2 * s.reach + 1) * w));
  const Region region{s.node(row0, col0), s.stride, 2 * s.reach + 2, w};
  const float top = w == kLanes       ? cell_bounds<1>(region, *window, bound.data())
                    : w == 2 * kLanes ? cell_bounds<2>(region, *window, bound.data())
                    : w == 3 * kLanes ? cell_bounds<3>(region, *window, bound.data())
                                      : cell_bounds_of_any_width(region, *window, bound.data());

  Touch best;
  float threshold = 0.5F * kOutOfReach;
  const auto work_out = [&](const auto& shape, std::ptrdiff_t r, std::ptrdiff_t c) {
    const std::ptrdiff_t row = row0 + r, col = col0 + c;
    if (row < 0 || col < 0 || row + 1 >= s.rows || col + 1 >= s.cols) return;
    const float* z0 = s.node(row, col);
    const float* z1 = z0 + s.stride;
    const ExactCell<std::decay_t<decltype(shape)>> cell{
        shape,
        s.d,
        s.per_d,
        x_mm - (s.x0 + s.d * static_cast<double>(col)),
        y_mm - (s.y0 + s.d * static_cast<double>(row)),
        static_cast<double>(z0[0]),
        static_cast<double>(z0[1]),
        static_cast<double>(z1[0]),
        static_cast<double>(z1[1]),
        best};
    const float* c0 = window->cap.data() + r * w + c;
    const float* c1 = c0 + w;
    if (z0[0] + c0[0] > threshold) cell.vertex(0.0, 0.0, cell.z00);
    if (z0[1] + c0[1] > threshold) cell.vertex(s.d, 0.0, cell.z10);
    if (z1[0] + c1[0] > threshold) cell.vertex(0.0, s.d, cell.z01);
    if (z1[1] + c1[1] > threshold) cell.vertex(s.d, s.d, cell.z11);
    cell.lower_right();
    cell.upper_left();
    threshold = std::max(threshold, static_cast<float>(best.z_mm - s.rounding));
  };

  // The most promising cell first, so that few others beat what it gives.
  if (top <= threshold) return {};
  const auto first = static_cast<std::ptrdiff_t>(first_equal(bound, top));
  std::visit(
      [&](const auto& shape) {
        work_out(shape, first / w, first % w);
        bound[static_cast<std::size_t>(first)] = kOutOfReach;
        for_each_above(
            bound.data(), 2 * s.reach + 1, w, [&] { return threshold; },
            [&](std::ptrdiff_t r, std::ptrdiff_t c) { work_out(shape, r, c); });
      },
      s.shape);
  if (best.z_mm == -INFINITY) return {};
  return {best.z_mm - s.corner, best.dx_mm, best.dy_mm};
}

}  // namespace maquette::cnc

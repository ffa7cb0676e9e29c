// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/reach_window.hpp"

#include <algorithm>
#include <cmath>

#include "core/check.hpp"

namespace maquette::cnc {
namespace {

constexpr float kNoBound = 4e30F;  // stays huge after adding kOutOfReach
/// Coordinates rounded to 0.0001 mm share the table of the place that they mean:
/// sqrt(2) * 6e-5 < 1e-4.
constexpr double kSamePlace_mm = 6e-5;
constexpr double kSameSlack_mm = 1e-4;
/// What the tables of all places may take together.
constexpr std::ptrdiff_t kTableBytes = 2 << 20;
// A row of a table holds, one after the other for all columns: how the underside stands to the
// tip at the node (upper bound, lower bound), kappa d^2 / 4 of the cell, and the upper bound at
// the cell's nearest point.
constexpr std::ptrdiff_t kParts = 4;

}  // namespace

ReachWindows::ReachWindows(const Cutter& tool, double spacing_mm, double furthest_mm)
    : tool_(tool),
      d_(spacing_mm),
      // Four roundings to 24 bits.
      rounding_(4.0 * 0x1p-23 * (furthest_mm + 4.0 * tool.radius_mm)) {
  std::ptrdiff_t bytes = 0;
  for (per_cell_ = 16;; per_cell_ /= 2) {
    slack_mm_ = {kSameSlack_mm,
                 d_ / static_cast<double>(per_cell_) / std::sqrt(2.0) * (1.0 + 1e-9)};
    std::ptrdiff_t most = 0;
    margin_ = 0;
    for (std::size_t set = 0; set < 2; ++set) {
      const double reach = (tool_.radius_mm + slack_mm_[set]) / d_;
      reach_ = std::max(reach_, reach);
      axis_[set].clear();
      for (std::ptrdiff_t k = 0; k < per_cell_; ++k) {
        const double at = static_cast<double>(k) / static_cast<double>(per_cell_);
        const auto first = static_cast<std::ptrdiff_t>(std::floor(at - reach));
        const auto last = static_cast<std::ptrdiff_t>(std::floor(at + reach));
        axis_[set].push_back({first, last - first + 1});
        most = std::max(most, last - first + 1);
        margin_ = std::max({margin_, -first, last + 1});
      }
    }
    rows_ = most + 1;  // of nodes
    width_ = (most + 1 + kLanes - 1) / kLanes * kLanes;
    bytes = 2 * per_cell_ * per_cell_ * rows_ * width_ * kParts *
            static_cast<std::ptrdiff_t>(sizeof(float));
    if (bytes <= kTableBytes || per_cell_ == 1) break;
  }
  MAQUETTE_CHECK(static_cast<std::size_t>(rows_ * width_) <= kMostCells, "{} x {} nodes", rows_,
                 width_);
  const std::ptrdiff_t one = rows_ * width_ * kParts;
  tables_.assign(static_cast<std::size_t>(2 * per_cell_ * per_cell_ * one), kOutOfReach);
  float* at = tables_.data();
  for (std::size_t set = 0; set < 2; ++set)
    for (std::ptrdiff_t ly = 0; ly < per_cell_; ++ly)
      for (std::ptrdiff_t lx = 0; lx < per_cell_; ++lx, at += one) fill(at, set, ly, lx);
}

void ReachWindows::fill(float* tables, std::size_t set, std::ptrdiff_t ly,
                        std::ptrdiff_t lx) const {
  const double R = tool_.radius_mm, rc = tool_.corner_radius_mm, flat = R - rc;
  const double slack = slack_mm_[set];
  const auto rise = [&](double t) {  // beyond the flat part
    if (t <= 0.0 || rc == 0.0) return 0.0;
    return t * t / (rc + std::sqrt(std::max(0.0, (rc - t) * (rc + t))));
  };
  // A float that is not less (up) or not more (down). 0 stays 0, so that a plateau under a flat
  // end has bounds of its own height and no more.
  const auto up = [&](double v) { return v == 0.0 ? 0.0F : static_cast<float>(v + rounding_); };
  const auto down = [&](double v) { return v == 0.0 ? 0.0F : static_cast<float>(v - rounding_); };
  const auto from = [&](std::ptrdiff_t i, std::ptrdiff_t place, std::ptrdiff_t first) {
    return (static_cast<double>(i + first) -
            static_cast<double>(place) / static_cast<double>(per_cell_)) *
           d_;
  };
  const Axis& along_x = axis_[set][static_cast<std::size_t>(lx)];
  const Axis& along_y = axis_[set][static_cast<std::size_t>(ly)];
  for (std::ptrdiff_t r = 0; r <= along_y.cells; ++r)
    for (std::ptrdiff_t c = 0; c <= along_x.cells; ++c) {
      float* node_up = tables + r * width_ * kParts + c;
      float* node_down = node_up + width_;
      float* chord = node_down + width_;
      float* cell_up = chord + width_;
      const double x = from(c, lx, along_x.first), y = from(r, ly, along_y.first);
      const double node = std::sqrt(x * x + y * y);
      if (node - slack <= R) *node_up = up(-rise(node - slack - flat));
      if (node + slack <= R) *node_down = down(-rise(node + slack - flat));
      if (c == along_x.cells || r == along_y.cells) continue;
      const double near_x = std::max({0.0, x, -x - d_}), near_y = std::max({0.0, y, -y - d_});
      const double far_x = std::max(-x, x + d_), far_y = std::max(-y, y + d_);
      const double nearest = std::sqrt(near_x * near_x + near_y * near_y) - slack;
      const double farthest = std::sqrt(far_x * far_x + far_y * far_y) + slack - flat;
      const double g = (rc - farthest) * (rc + farthest);
      *chord = farthest <= 0.0 ? 0.0F
               : farthest < rc ? up(rc * rc * d_ * d_ / 4.0 / (g * std::sqrt(g)))
                               : kNoBound;
      if (nearest <= R) *cell_up = up(-rise(nearest - flat));
    }
}

WindowPlace ReachWindows::at(double tx, double ty) const {
  const auto n = static_cast<double>(per_cell_);
  const double same = kSamePlace_mm * n / d_;
  const double kx = std::round(tx * n), ky = std::round(ty * n);
  const std::size_t set = std::abs(tx * n - kx) <= same && std::abs(ty * n - ky) <= same ? 0 : 1;
  const auto cell_x = static_cast<std::ptrdiff_t>(std::floor(kx / n));
  const auto cell_y = static_cast<std::ptrdiff_t>(std::floor(ky / n));
  const std::ptrdiff_t lx = static_cast<std::ptrdiff_t>(kx) - cell_x * per_cell_;
  const std::ptrdiff_t ly = static_cast<std::ptrdiff_t>(ky) - cell_y * per_cell_;
  const Axis& along_x = axis_[set][static_cast<std::size_t>(lx)];
  const Axis& along_y = axis_[set][static_cast<std::size_t>(ly)];
  const std::ptrdiff_t index = (static_cast<std::ptrdiff_t>(set) * per_cell_ + ly) * per_cell_ + lx;
  return {cell_y + along_y.first, cell_x + along_x.first,
          tables_.data() + index * (rows_ * width_ * kParts), along_y.cells};
}

namespace {

template <std::size_t kColumns>
Lanes columns(const float* z, std::ptrdiff_t stride, const float* table, std::ptrdiff_t width,
              std::ptrdiff_t rows, float* bound) {
  std::array<Lanes, kColumns> corners{}, heights{};  // of the row below, larger of node and right
  Lanes low = Lanes{} + ReachWindows::kOutOfReach;
  for (std::ptrdiff_t r = 0; r <= rows; ++r, z += stride, table += kParts * width) {
    const float* cells = table - (kParts - 2) * width;  // of the row below
    for (std::size_t k = 0; k < kColumns; ++k) {
      const auto at = static_cast<std::ptrdiff_t>(kLanes * k);
      const Lanes left = load(z + at), right = load(z + at + 1);
      // The last column's right neighbour is beyond the table: so is its cell.
      const Lanes corner = larger(left + load(table + at), right + load(table + at + 1));
      const Lanes height = larger(left, right);
      low = larger(low, left + load(table + width + at));
      if (r > 0) {
        const Lanes by_corner = larger(corners[k], corner) + load(cells + at);
        const Lanes by_height = larger(heights[k], height) + load(cells + width + at);
        store(bound + at, smaller(by_corner, by_height));
      }
      corners[k] = corner;
      heights[k] = height;
    }
    if (r > 0) bound += width;
  }
  return low;
}

}  // namespace

float ReachWindows::bounds(const WindowPlace& place, const float* z, std::ptrdiff_t stride,
                           float* bound) const {
  if (width_ == 2 * kLanes)
    return largest(columns<2>(z, stride, place.tables, width_, place.rows, bound));
  Lanes low = Lanes{} + kOutOfReach;
  for (std::ptrdiff_t c = 0; c < width_; c += kLanes)
    low = larger(low, columns<1>(z + c, stride, place.tables + c, width_, place.rows, bound + c));
  return largest(low);
}

std::size_t ReachWindows::collect(const WindowPlace& place, float low, float* bound,
                                  WindowCell* cells) const {
  std::size_t n = 0;
  const float* from = bound;
  for (std::ptrdiff_t r = 0; r < place.rows; ++r)
    for (std::ptrdiff_t c = 0; c < width_; c += kLanes, from += kLanes) {
      const Lanes v = load(from);
      for (unsigned mask = beats(v, low); mask != 0; mask &= mask - 1) {
        const int k = __builtin_ctz(mask);
        bound[n] = v[k];
        cells[n++] = {static_cast<std::int16_t>(r), static_cast<std::int16_t>(c + k)};
      }
    }
  return n;
}

}  // namespace maquette::cnc

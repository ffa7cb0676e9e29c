// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/piece_order.hpp"

#include <algorithm>
#include <cmath>
#include <cstdlib>

#include "core/check.hpp"

namespace maquette::cnc {

PieceOrder::PieceOrder(double x0, double y0, double x1, double y1, double bucket)
    : x0_(x0),
      y0_(y0),
      bucket_(bucket),
      rows_(static_cast<std::ptrdiff_t>(std::max(0.0, y1 - y0) / bucket) + 1),
      cols_(static_cast<std::ptrdiff_t>(std::max(0.0, x1 - x0) / bucket) + 1),
      buckets_(static_cast<std::size_t>(rows_ * cols_)) {}

// Places outside count to the nearest bucket: they are found later than need be, never missed,
// because the search goes on until every bucket within the best distance was seen.
std::ptrdiff_t PieceOrder::row_of(double y) const {
  return std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>((y - y0_) / bucket_), 0, rows_ - 1);
}
std::ptrdiff_t PieceOrder::col_of(double x) const {
  return std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>((x - x0_) / bucket_), 0, cols_ - 1);
}

void PieceOrder::add(double first_x, double first_y, double last_x, double last_y) {
  for (const Place place : {Place{first_x, first_y}, Place{last_x, last_y}}) {
    buckets_[static_cast<std::size_t>(row_of(place.y) * cols_ + col_of(place.x))].push_back(
        ends_.size());
    ends_.push_back(place);
  }
  ++left_;
}

void PieceOrder::remove(std::size_t end) {
  const Place place = ends_[end];
  auto& bucket = buckets_[static_cast<std::size_t>(row_of(place.y) * cols_ + col_of(place.x))];
  bucket.erase(std::find(bucket.begin(), bucket.end(), end));
}

PieceOrder::End PieceOrder::take_nearest(double x, double y) {
  MAQUETTE_CHECK(left_ > 0, "no piece is left");
  const std::ptrdiff_t row = row_of(y), col = col_of(x);
  double best2 = INFINITY;
  std::size_t best = 0;
  const auto look = [&](std::ptrdiff_t r, std::ptrdiff_t c) {
    if (r < 0 || c < 0 || r >= rows_ || c >= cols_) return;
    for (const std::size_t end : buckets_[static_cast<std::size_t>(r * cols_ + c)]) {
      const double dx = ends_[end].x - x, dy = ends_[end].y - y, d2 = dx * dx + dy * dy;
      if (d2 < best2 || (d2 == best2 && end < best)) best2 = d2, best = end;
    }
  };
  const std::ptrdiff_t rings = std::max(rows_, cols_);
  for (std::ptrdiff_t k = 0; k < rings; ++k) {
    // Everything in ring k is at least k - 1 whole buckets away.
    const double least = static_cast<double>(std::max<std::ptrdiff_t>(0, k - 1)) * bucket_;
    if (best2 < least * least) break;
    if (k == 0) look(row, col);
    for (std::ptrdiff_t i = -k; k > 0 && i < k; ++i) {
      look(row - k, col + i), look(row + i, col + k);
      look(row + k, col - i), look(row - i, col - k);
    }
  }
  const std::size_t piece = best / 2;
  remove(2 * piece), remove(2 * piece + 1);
  --left_;
  return {piece, best % 2 != 0};
}

}  // namespace maquette::cnc

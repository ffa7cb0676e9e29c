// SPDX-License-Identifier: GPL-3.0-or-later
#include <cmath>
#include <numeric>

#include "core/random.hpp"
#include "diagnosis/detail/sums.hpp"

namespace maquette::diagnosis::detail {

int Layout::block_of(double x, double y) const {
  const double side = cell_mm * static_cast<double>(block);
  const auto c = static_cast<std::ptrdiff_t>(std::floor((x - x0) / side));
  const auto r = static_cast<std::ptrdiff_t>(std::floor((y - y0) / side));
  const auto i = r * block_cols + c;
  return r < 0 || c < 0 || c >= block_cols || i >= static_cast<std::ptrdiff_t>(set_of_block.size())
             ? -1
             : static_cast<int>(i);
}

int Layout::set_of(double x, double y) const {
  const int b = block_of(x, y);
  if (b < 0) return -1;
  const int set = set_of_block[static_cast<std::size_t>(b)];
  for (const auto& [dx, dy] :
       {std::pair{buffer_mm, 0.0}, {-buffer_mm, 0.0}, {0.0, buffer_mm}, {0.0, -buffer_mm}}) {
    const int other = block_of(x + dx, y + dy);
    if (other >= 0 && set_of_block[static_cast<std::size_t>(other)] != set) return -1;
  }
  return set;
}

std::ptrdiff_t Layout::cell_of(double x, double y) const {
  return static_cast<std::ptrdiff_t>((y - y0) / cell_mm) * cols +
         static_cast<std::ptrdiff_t>((x - x0) / cell_mm);
}

Layout lay_out(const Box3& box, std::uint64_t seed, bool in_bands) {
  Layout l;
  const double wide = box.max.x - box.min.x, high = box.max.y - box.min.y;
  // Halves, thirds, quarters and fifths of a part are where bands meet. A cell that is left empty
  // before the part puts them inside blocks, so that all sets see both sides of a step there.
  const std::ptrdiff_t empty = in_bands ? 1 : 0;
  l.cell_mm = std::fmax(wide, high) / static_cast<double>(24 - empty);
  const auto cells = [&](double side) {
    return empty + static_cast<std::ptrdiff_t>(std::ceil(side / l.cell_mm - 1e-9));
  };
  l.x0 = box.min.x - static_cast<double>(empty) * l.cell_mm;
  l.y0 = box.min.y - static_cast<double>(empty) * l.cell_mm;
  l.cols = cells(wide);
  l.rows = cells(high);
  l.block = 4;
  l.buffer_mm = l.cell_mm / 8.0;
  l.block_cols = (l.cols + l.block - 1) / l.block;
  const std::ptrdiff_t block_rows = (l.rows + l.block - 1) / l.block;
  // Every row and column of blocks has all sets: (r + c) mod 3, its three names, rows and
  // columns drawn.
  const auto shuffled = [&](std::size_t n, std::uint64_t stream) {
    std::vector<std::size_t> order(n);
    std::iota(order.begin(), order.end(), std::size_t{0});
    for (std::size_t i = n; i > 1; --i)
      std::swap(order[i - 1], order[random_bits(mix64(seed) + stream, i) % i]);
    return order;
  };
  const auto rows = shuffled(static_cast<std::size_t>(block_rows), 1);
  const auto cols = shuffled(static_cast<std::size_t>(l.block_cols), 2);
  const auto names = shuffled(3, 3);
  for (const std::size_t r : rows)
    for (const std::size_t c : cols) l.set_of_block.push_back(static_cast<int>(names[(r + c) % 3]));
  return l;
}

}  // namespace maquette::diagnosis::detail

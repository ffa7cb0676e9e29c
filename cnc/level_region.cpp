// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/level_region.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>

#include <oneapi/tbb/parallel_for.h>

#include "cnc/cutter_location.hpp"
#include "cnc/cutter_shape.hpp"

namespace maquette::cnc {
namespace {

constexpr std::size_t kLongestPiece = 64;  // cells of a chain that one straight piece may stand for

float float_above(double v) {
  const auto f = static_cast<float>(v);
  return static_cast<double>(f) < v ? std::nextafter(f, INFINITY) : f;
}

// East, north, west, south.
constexpr std::array<int, 4> kRow{0, 1, 0, -1}, kCol{1, 0, -1, 0};

double distance(Cell p, Cell a, Cell b) {
  const double ur = b.row - a.row, uc = b.col - a.col;
  const double vr = p.row - a.row, vc = p.col - a.col;
  const double u2 = ur * ur + uc * uc;
  const double t = u2 > 0.0 ? std::clamp((vr * ur + vc * uc) / u2, 0.0, 1.0) : 0.0;
  return std::hypot(vr - t * ur, vc - t * uc);
}

}  // namespace

Grid<float> lowest_tips(const heightmap::ModelField& design, const Cutter& cutter,
                        double allowance_mm, const CellGrid& grid, const RunContext& run) {
  const DropCutter wide(
      design, moved_sideways(with_allowance(cutter, allowance_mm), grid.half_diagonal_mm()));
  Grid<float> tips(grid.rows, grid.cols);
  constexpr std::ptrdiff_t kRowsAtATime = 16;  // for which a copy of the cutter serves
  const std::ptrdiff_t tasks = (grid.rows + kRowsAtATime - 1) / kRowsAtATime;
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, tasks, [&](std::ptrdiff_t task) {
    DropCutter cutter_here = wide;
    const std::ptrdiff_t first = task * kRowsAtATime;
    for (std::ptrdiff_t r = first; r < std::min(grid.rows, first + kRowsAtATime); ++r) {
      if (run.stopped()) return;
      for (std::ptrdiff_t c = 0; c < grid.cols; ++c)
        tips(r, c) =
            float_above(cutter_here.drop(grid.x_mm(c), grid.y_mm(r)).tip_mm + allowance_mm);
    }
  });
  if (run.stopped()) return {};
  return tips;
}

bool LevelRegion::free(Cell from, Cell to) const {
  const std::int64_t dr = std::abs(to.row - from.row), dc = std::abs(to.col - from.col);
  const int sr = to.row > from.row ? 1 : -1, sc = to.col > from.col ? 1 : -1;
  std::ptrdiff_t r = from.row, c = from.col;
  if (!free(r, c)) return false;
  // The border to the next column is crossed at (2 i + 1) / (2 dc) of the way, to the next row
  // at (2 j + 1) / (2 dr); through a corner both at once: the corner belongs to both cells.
  for (std::int64_t i = 0, j = 0; i < dc || j < dr;) {
    const std::int64_t by_col = (2 * i + 1) * dr, by_row = (2 * j + 1) * dc;
    const bool col = j == dr || (i < dc && by_col <= by_row);
    const bool row = i == dc || (j < dr && by_row <= by_col);
    if (col) ++i, c += sc;
    if (row) ++j, r += sr;
    if (!free(r, c)) return false;
  }
  return true;
}

std::vector<std::vector<Cell>> LevelRegion::rims() const {
  const std::ptrdiff_t rows = tips_.rows(), cols = tips_.cols();
  Grid<std::uint8_t> walked(rows, cols, 0);  // a bit for each side
  std::vector<std::vector<Cell>> rims;
  for (std::ptrdiff_t r0 = 0; r0 < rows; ++r0)
    for (std::ptrdiff_t c0 = 0; c0 < cols; ++c0) {
      // Every rim has a cell whose eastern side is blocked.
      if (!free(r0, c0) || free(r0, c0 + 1) || (walked(r0, c0) & 1U) != 0) continue;
      std::vector<Cell> chain;
      std::ptrdiff_t r = r0, c = c0;
      std::size_t side = 0;
      do {
        walked(r, c) = static_cast<std::uint8_t>(walked(r, c) | (1U << side));
        const Cell here{static_cast<std::int32_t>(r), static_cast<std::int32_t>(c)};
        if (chain.empty() || !(chain.back() == here)) chain.push_back(here);
        const std::size_t left = (side + 1) % 4;
        const std::ptrdiff_t ar = r + kRow[left], ac = c + kCol[left];
        const std::ptrdiff_t br = ar + kRow[side], bc = ac + kCol[side];
        if (!free(ar, ac)) {
          side = left;
        } else if (!free(br, bc)) {
          r = ar, c = ac;
        } else {
          r = br, c = bc, side = (side + 3) % 4;
        }
      } while (r != r0 || c != c0 || side != 0);
      if (chain.size() > 1 && chain.front() == chain.back()) chain.pop_back();
      rims.push_back(std::move(chain));
    }
  return rims;
}

std::vector<Cell> LevelRegion::straightened(const std::vector<Cell>& chain,
                                            double within_cells) const {
  std::vector<Cell> vertices;
  for (std::size_t i = 0; i < chain.size();) {
    vertices.push_back(chain[i]);
    if (i + 1 == chain.size()) break;
    std::size_t next = i + 1;
    for (std::size_t j = i + 2; j < chain.size() && j - i <= kLongestPiece; ++j) {
      bool good = free(chain[i], chain[j]);
      for (std::size_t k = i + 1; k < j && good; ++k)
        good = distance(chain[k], chain[i], chain[j]) <= within_cells;
      if (!good) break;
      next = j;
    }
    i = next;
  }
  return vertices;
}

}  // namespace maquette::cnc

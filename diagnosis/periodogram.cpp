// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/periodogram.hpp"

#include <cmath>
#include <complex>
#include <numbers>
#include <vector>

#include <oneapi/tbb/parallel_for.h>

namespace maquette::diagnosis::detail {
namespace {

using Complex = std::complex<double>;

std::vector<Complex> turns(std::ptrdiff_t n) {
  std::vector<Complex> table;
  for (std::ptrdiff_t i = 0; i < n; ++i)
    table.push_back(
        std::polar(1.0, -2.0 * std::numbers::pi * static_cast<double>(i) / static_cast<double>(n)));
  return table;
}

}  // namespace

Grid<double> periodogram(const Grid<double>& map, std::ptrdiff_t rows, std::ptrdiff_t cols) {
  const auto along = turns(cols), down = turns(rows);
  Grid<Complex> partial(map.rows(), cols);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, map.rows(), [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t k = 0; k < cols; ++k) {
      Complex sum = 0.0;
      for (std::ptrdiff_t c = 0; c < map.cols(); ++c)
        if (!std::isnan(map(r, c)))
          sum += map(r, c) * along[static_cast<std::size_t>((k * c) % cols)];
      partial(r, k) = sum;
    }
  });
  Grid<double> power(rows, cols);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, cols, [&](std::ptrdiff_t k) {
    for (std::ptrdiff_t q = 0; q < rows; ++q) {
      Complex sum = 0.0;
      for (std::ptrdiff_t r = 0; r < map.rows(); ++r)
        sum += partial(r, k) * down[static_cast<std::size_t>((q * r) % rows)];
      power(q, k) = std::norm(sum);
    }
  });
  return power;
}

}  // namespace maquette::diagnosis::detail

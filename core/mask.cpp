// SPDX-License-Identifier: GPL-3.0-or-later
#include "core/mask.hpp"

#include <vector>

namespace maquette {

void widen(Grid<std::uint8_t>& g, std::ptrdiff_t reach) {
  const auto cols = static_cast<std::size_t>(g.cols());
  for (std::ptrdiff_t r = 0; r < g.rows(); ++r) {
    std::uint8_t* row = g.row(r).data();
    for (const bool forwards : {true, false}) {
      std::ptrdiff_t since = reach + 1;
      for (std::size_t k = 0; k < cols; ++k) {
        std::uint8_t& v = row[forwards ? k : cols - 1 - k];
        since = (v & 1U) != 0 ? 0 : since + 1;
        if (since <= reach) v |= 2U;
      }
    }
    for (std::size_t c = 0; c < cols; ++c) row[c] = row[c] != 0 ? 1 : 0;
  }
  for (const bool downwards : {true, false}) {
    std::vector<std::ptrdiff_t> since(cols, reach + 1);
    for (std::ptrdiff_t k = 0; k < g.rows(); ++k) {
      std::uint8_t* row = g.row(downwards ? k : g.rows() - 1 - k).data();
      for (std::size_t c = 0; c < cols; ++c) {
        since[c] = (row[c] & 1U) != 0 ? 0 : since[c] + 1;
        row[c] = static_cast<std::uint8_t>(row[c] | (since[c] <= reach ? 2 : 0));
      }
    }
  }
  for (std::uint8_t& v : g.cells()) v = v != 0 ? 1 : 0;
}

}  // namespace maquette

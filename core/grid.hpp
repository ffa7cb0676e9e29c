// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file grid.hpp
/// Row-major two-dimensional array. Row 0 is the southernmost row (smallest y)
/// in every field of this project; only raster files are north up.

#include <cstddef>
#include <span>
#include <vector>

#include "core/check.hpp"

namespace maquette {

template <class T>
class Grid {
 public:
  Grid() = default;
  Grid(std::ptrdiff_t rows, std::ptrdiff_t cols, T value = T{})
      : rows_(rows), cols_(cols), cells_(static_cast<std::size_t>(rows * cols), value) {}

  [[nodiscard]] std::ptrdiff_t rows() const { return rows_; }
  [[nodiscard]] std::ptrdiff_t cols() const { return cols_; }
  [[nodiscard]] bool empty() const { return cells_.empty(); }
  [[nodiscard]] bool contains(std::ptrdiff_t r, std::ptrdiff_t c) const {
    return r >= 0 && c >= 0 && r < rows_ && c < cols_;
  }

  /// @pre contains(r, c); not checked, this is the inner loop
  [[nodiscard]] T& operator()(std::ptrdiff_t r, std::ptrdiff_t c) {
    return cells_[static_cast<std::size_t>(r * cols_ + c)];
  }
  [[nodiscard]] const T& operator()(std::ptrdiff_t r, std::ptrdiff_t c) const {
    return cells_[static_cast<std::size_t>(r * cols_ + c)];
  }
  [[nodiscard]] std::span<T> row(std::ptrdiff_t r) {
    return {cells_.data() + r * cols_, static_cast<std::size_t>(cols_)};
  }
  [[nodiscard]] std::span<const T> row(std::ptrdiff_t r) const {
    return {cells_.data() + r * cols_, static_cast<std::size_t>(cols_)};
  }
  [[nodiscard]] std::span<T> cells() { return cells_; }
  [[nodiscard]] std::span<const T> cells() const { return cells_; }
  friend bool operator==(const Grid&, const Grid&) = default;

 private:
  std::ptrdiff_t rows_ = 0;
  std::ptrdiff_t cols_ = 0;
  std::vector<T> cells_;
};

}  // namespace maquette

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file piece_order.hpp
/// Which piece of path comes next: the one with an end nearest to where the cutter is.
///
/// Ends lie in square buckets that are searched outwards. Among ends equally far away the one
/// added first is taken, so that the order depends on nothing else.

#include <cstddef>
#include <cstdint>
#include <vector>

namespace maquette::cnc {

class PieceOrder {
 public:
  struct End {
    std::size_t piece = 0;
    bool last = false;  ///< the piece's last vertex, not its first
  };
  /// Places in any unit; `bucket` about the distance between neighbours.
  PieceOrder(double x0, double y0, double x1, double y1, double bucket);

  /// Pieces are numbered as they come.
  void add(double first_x, double first_y, double last_x, double last_y);
  [[nodiscard]] std::size_t left() const { return left_; }
  /// Takes the piece out. @pre left() > 0
  End take_nearest(double x, double y);

 private:
  struct Place {
    double x, y;
  };
  [[nodiscard]] std::ptrdiff_t row_of(double y) const;
  [[nodiscard]] std::ptrdiff_t col_of(double x) const;
  void remove(std::size_t end);

  double x0_, y0_, bucket_;
  std::ptrdiff_t rows_, cols_;
  std::vector<std::vector<std::size_t>> buckets_;  // ends: 2 piece + last
  std::vector<Place> ends_;
  std::size_t left_ = 0;
};

}  // namespace maquette::cnc

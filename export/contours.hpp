// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file contours.hpp
/// Lines of equal height on the triangulated surface, exact on its triangles.
///
/// Each cell is the two triangles of ModelField. A node at the level counts as above
/// it, so every triangle has none or two crossed edges and no case is ambiguous; the
/// crossing of an edge is worked out once, for the edge, so that neighbours meet to
/// the bit. Higher ground lies on the left of a line.

#include <array>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::exporting {

struct ContourLine {
  std::vector<std::array<double, 2>> points_mm;  ///< no two in a row alike
  bool closed = false;  ///< the last point is joined to the first, which is not repeated
};

class ContourTracer {
 public:
  /// @param surface  must outlive the tracer
  explicit ContourTracer(const heightmap::ModelField& surface);

  /// Open lines first, then closed ones, each kind in the order of its first cell
  /// edge. Lines end at the border and at triangles with a void corner. What shrinks
  /// to one point (a summit exactly at the level) is left out; along a ridge exactly at
  /// the level the line runs forth and back.
  [[nodiscard]] std::vector<ContourLine> trace(double level_mm) const;

 private:
  struct BlockRange {
    float min, max;
  };
  const heightmap::ModelField& surface_;
  Grid<BlockRange> blocks_;  ///< heights of kBlock x kBlock cells, to skip most of them
};

}  // namespace maquette::exporting

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file lod_pyramid.hpp
/// The heights of a field at half the resolution, a quarter, and so on, on one lattice.
///
/// Level 0 is the field. Nodes of level l stand on those nodes of the field whose row and column
/// are multiples of 2^l, and on the last row and column, whatever their number: nothing is padded,
/// and levels differ in which nodes they have, never in where these stand.
///
/// Heights   of a level are those of the level below, filtered with (-1 2 6 2 -1) / 8 along rows
///           and columns: the low pass that belongs to linear interpolation (Le Gall and Tabatabai
///           1988, doi:10.1109/ICASSP.1988.196696), which leaves no more of the finer waves than a
///           triangulated level can show. Within two nodes of the outline: the height itself.
/// Slopes    of a level are those of the full resolution (the mean of the triangles about a node),
///           averaged with (1 2 1) / 4 from level to level: normals show the mean slope of the
///           ground that a node stands for, not that of the coarse triangles.
/// Memory    a third of the heights more, and 8 bytes a node of the levels above 0
/// Same heights, same bits for any number of threads.

#include <array>
#include <vector>

#include "core/grid.hpp"
#include "core/result.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::exporting {

inline constexpr ErrorCode kHeightNotFinite{"EXPORT_HEIGHT_NOT_FINITE"};

enum class LodFilter {
  smooth,  ///< as above
  sample,  ///< every second height: larger errors, but each node lies on the surface
};

class LodPyramid {
 public:
  using Slope = std::array<float, 2>;  ///< dz/dx, dz/dy

  /// @param field  must outlive the pyramid
  /// @param levels  how many, level 0 counted; >= 1
  /// @return EXPORT_HEIGHT_NOT_FINITE with row and column of the first void
  [[nodiscard]] static Result<LodPyramid> create(const heightmap::ModelField& field, int levels,
                                                 LodFilter filter = LodFilter::smooth);

  [[nodiscard]] const heightmap::ModelField& field() const { return *field_; }
  [[nodiscard]] int levels() const { return static_cast<int>(upper_.size()) + 1; }
  [[nodiscard]] const Grid<float>& heights_mm(int level) const {
    return level == 0 ? field_->z_mm : upper_[static_cast<std::size_t>(level - 1)].z_mm;
  }
  [[nodiscard]] Slope slope(int level, std::ptrdiff_t row, std::ptrdiff_t col) const;

 private:
  struct Upper {
    Grid<float> z_mm;
    Grid<Slope> slope;
  };
  const heightmap::ModelField* field_ = nullptr;
  std::vector<Upper> upper_;
};

/// How many nodes a level has along a side of `nodes` nodes, and which of the field's its
/// `index`-th is.
[[nodiscard]] std::ptrdiff_t lod_nodes(std::ptrdiff_t nodes, int level);
[[nodiscard]] std::ptrdiff_t lod_node(std::ptrdiff_t nodes, int level, std::ptrdiff_t index);

}  // namespace maquette::exporting

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file bands.hpp
/// The surface is milled in bands: strips side by side along one axis, each over
/// the whole length of the other.

#include <cmath>
#include <cstddef>
#include <optional>
#include <vector>

#include "core/result.hpp"
#include "heightmap/height_field.hpp"
#include "meshing/grid_stream.hpp"

namespace maquette::meshing {

inline constexpr ErrorCode kBandsDegenerate{"MESHING_BANDS_DEGENERATE"};

enum class BandAxis { x, y };

/// Node columns (axis x) or rows (axis y) first..last, both included; neighbours
/// share their border node, so bands joined again are the whole.
struct Band {
  int number = 0;  ///< 1, 2, ...
  BandAxis axis = BandAxis::y;
  std::ptrdiff_t first = 0, last = 0;
};

/// Splits into bands not wider than `max_width`, as even as whole cells allow (widths
/// differ by one cell at most).
/// MESHING_BANDS_DEGENERATE: max_width below two cells or not a number, or a field of
/// fewer than 2 x 2 nodes.
[[nodiscard]] Result<std::vector<Band>> split_into_bands(const heightmap::ModelField& surface,
                                                         BandAxis axis, Millimetres max_width);

/// How to split: into `count` bands, or where that is 0 into as few as `max_width` allows; or at
/// `joints`, where these are known (band_joints.hpp), and then the other two say nothing.
struct BandSplit {
  BandAxis axis = BandAxis::y;
  Millimetres max_width{INFINITY};
  int count = 0;
  std::optional<std::vector<std::ptrdiff_t>> joints{};  ///< lines of nodes, ascending
};
/// The same; of a count, bands differ by one cell at most, too.
/// MESHING_BANDS_DEGENERATE: also a count that leaves a band less than two cells, with the largest
/// that does; joints that do not ascend within the surface. @pre count >= 0
[[nodiscard]] Result<std::vector<Band>> split_into_bands(const heightmap::ModelField& surface,
                                                         const BandSplit& split);

/// The band's nodes in the whole: GridSolidStream of this window is the band in the frame of the
/// whole, and neighbours have the same wall between them to the bit, whatever the spacing.
/// @pre the band belongs to this field
[[nodiscard]] NodeWindow band_window(const heightmap::ModelField& surface, const Band& band);

/// The part of the field that the band covers, heights unchanged (x0 and y0 are
/// those of the band's first node, from which the others are counted: where the spacing is no
/// power of two, coordinates may be the whole's but for their last bit), widened on both sides by
/// `margin`, rounded up to whole cells, where the field goes on (for the cutter's reach).
/// @pre the band belongs to this field; margin >= 0 and finite
[[nodiscard]] heightmap::ModelField band_field(const heightmap::ModelField& surface,
                                               const Band& band,
                                               Millimetres margin = Millimetres{0});

}  // namespace maquette::meshing

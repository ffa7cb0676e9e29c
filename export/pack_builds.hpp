// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file pack_builds.hpp
/// Which part stands where in which build volume of a sintering machine.
///
/// Takes   the parts' boxes, the machine's build volume, millimetres
/// Gives   a place for each box, none nearer to another than `spacing`; nothing is turned, for a
///         powder bed needs no supports, and a part's upright pose is the one it is numbered in
///
/// Method. Shelves: boxes by falling height; each stands in the first row of the first layer of the
/// first volume that has room for it, else opens a new row, layer or volume. Of boxes of one size
/// as many stand in a volume as a regular lattice has.

#include <cstddef>
#include <span>
#include <vector>

#include "core/result.hpp"
#include "core/vec.hpp"

namespace maquette::exporting {

inline constexpr ErrorCode kPartTooLarge{"EXPORT_PART_TOO_LARGE"};

struct BuildVolume {
  Vec3 size_mm{200.0, 200.0, 200.0};
  double spacing_mm = 3.0;  ///< between parts; at the walls, none
};

struct PackedBox {
  std::size_t volume = 0;  ///< 0, 1, ...
  Vec3 at_mm;              ///< the box's lower corner in the volume
};

/// In the order of the sizes. Same input, same places.
/// EXPORT_PART_TOO_LARGE with place in the list, size, and the volume's size.
/// @pre sizes and the volume's > 0, spacing >= 0
[[nodiscard]] Result<std::vector<PackedBox>> pack_builds(std::span<const Vec3> sizes_mm,
                                                         const BuildVolume& volume);

}  // namespace maquette::exporting

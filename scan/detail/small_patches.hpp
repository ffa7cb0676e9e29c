// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file small_patches.hpp
/// Patches that cells do not show, or show badly: by discs, and by the points in them.

#include <functional>
#include <span>
#include <vector>

#include "core/vec.hpp"
#include "scan/detail/disc_filter.hpp"
#include "scan/detail/disc_fit.hpp"
#include "scan/detail/patches.hpp"

namespace maquette::scan::detail {

/// Adds a patch to those that are kept and draws it on its map. Of patches that overlap the first
/// stays.
void keep(FoundPatch patch, CellMap& map, std::vector<FoundPatch>& kept);

/// Small patches by their points: those that cells show, where a disc explains more, and those that
/// lie across cells.
/// @param typical_variance  of one point
/// @param level_mm  of the part as a whole at a place
/// @param beam_diameter_mm  at the part, 1/e^2 of the intensity; 0: rays
/// @param maps      of the layers; what is found is drawn there
/// @param kept      what cells have shown; gets what discs show
void search_by_discs(std::span<const Layer> layers, double typical_variance,
                     const DiscSearch& discs, std::span<const Vec3> points_mm,
                     std::span<const float> deviation_mm,
                     const std::function<double(double, double)>& level_mm, double beam_diameter_mm,
                     std::vector<CellMap>& maps, std::vector<FoundPatch>& kept);

}  // namespace maquette::scan::detail

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file patch_pose.hpp
/// What a wrong pose makes of a patch's height.
///
/// A height is the mean deviation of the patch's inside minus that of its base. A small wrong pose
/// changes a deviation by J . t (register.hpp, pose_columns), so it changes the height by
/// c . t with c = mean J of the inside minus mean J of the base, scan by scan: what both have in
/// common, a level above all, cancels, and what the slopes of both differ by stays.

#include <span>
#include <vector>

#include "heightmap/height_field.hpp"
#include "scan/detail/patches.hpp"
#include "scan/joint_pose.hpp"

namespace maquette::scan::detail {

/// Adds it to the standard deviations of heights, volumes and diameters.
/// @param maps     that the patches were found in
/// @param surface  what the deviations are from
void add_pose(std::vector<FoundPatch>& patches, std::span<const CellMap> maps,
              std::span<const Vec3> points_mm, std::span<const float> deviation_mm,
              std::span<const ScanPose> scans, const heightmap::ModelField& surface);

}  // namespace maquette::scan::detail

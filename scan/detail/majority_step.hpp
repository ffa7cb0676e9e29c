// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file majority_step.hpp
/// The small step after which most cells of a scan lie where they should.

#include <span>

#include "core/vec.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::scan::detail {

/// Means of residuals and of their derivatives by pose over square cells, solved for six unknowns
/// by Tukey's biweight at 4.685 robust standard deviations of the cells' means, begun with Huber's:
/// what is small against the noise of a point but not against that of a cell has no weight.
/// @param points_mm  model frame, nearly right
/// @return identity where there are fewer than 100 cells with 10 points, or where they do not tell
///   all six directions
[[nodiscard]] RigidTransform majority_step(std::span<const Vec3> points_mm,
                                           const heightmap::ModelField& surface);

}  // namespace maquette::scan::detail

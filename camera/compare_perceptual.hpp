// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file compare_perceptual.hpp
/// Two measures of how different two pictures look.

#include <vector>

#include "core/grid.hpp"

namespace maquette::camera {

/// Structural similarity (Wang et al. 2004, doi:10.1109/TIP.2003.819861): windows of 11 x 11 with
/// Gaussian weights of 1.5 pixels, K1 = 0.01, K2 = 0.03, dynamic range 1; mean over the windows
/// that lie inside. 1: the same. Pictures smaller than a window: NaN.
[[nodiscard]] double structural_similarity(const Grid<float>& a, const Grid<float>& b);

/// LDR-FLIP (Andersson et al. 2020, doi:10.1145/3406183): the difference that is seen when two
/// pictures are shown in turn at `pixels_per_degree`. 0: the same, 1: as different as can be.
/// @param a, b  one (grey) or three bands, display values 0 to 1 (sRGB)
/// @return a value for each pixel
[[nodiscard]] Grid<float> flip(const std::vector<Grid<float>>& a, const std::vector<Grid<float>>& b,
                               double pixels_per_degree = 67.02);

}  // namespace maquette::camera

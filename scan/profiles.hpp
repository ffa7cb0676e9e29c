// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file profiles.hpp
/// Deviations along lines that a person draws over the part.
///
/// Takes    points and their deviations in the model frame, lines, the poses' covariance
/// Gives    means over stretches of the line, each with its standard deviation
/// Accuracy a stretch's sigma is that of its mean: scatter over the root of the points, times what
///          correlation makes of it (CellMap::inflation of the coarsest cells), and the pose.
///          Normalised errors on known surfaces have rms 1 (test).

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "core/vec.hpp"
#include "heightmap/height_field.hpp"
#include "scan/register.hpp"

namespace maquette::scan {

/// From one point to another, in the plan (z is not used).
struct ProfileLine {
  std::string name;
  Vec3 from_mm, to_mm;
  double width_mm = 2.0;  ///< points up to half of it to either side count
  double step_mm = 0.0;   ///< of a stretch; 0: as long as some 30 points need, at most 500 of them
};

/// One value a stretch; NaN where it has fewer than 3 points.
struct Profile {
  std::string name;
  double step_mm = 0.0;
  std::vector<Vec3> at_mm;       ///< middle of the stretch; z: the design's
  std::vector<double> along_mm;  ///< of the middle, from the line's beginning
  std::vector<double> mean_mm;   ///< deviation along the normal
  std::vector<double> sigma_mm;  ///< of the mean
  std::vector<std::size_t> points;
};

/// @param registration  whose covariance counts; null: the poses are known
/// @pre from and to differ, width_mm > 0, step_mm >= 0
[[nodiscard]] Profile profile_along(std::span<const Vec3> points_mm,
                                    std::span<const float> deviation_mm, const ProfileLine& line,
                                    const heightmap::ModelField& design, double inflation,
                                    const Registration* registration);

}  // namespace maquette::scan

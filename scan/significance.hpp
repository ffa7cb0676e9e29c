// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file significance.hpp
/// What of a deviation is more than noise, where it is and how large.
///
/// Mean      M3C2 (Lague, Brodu, Leroux 2013, doi:10.1016/j.isprsjprs.2013.04.009) with normals
///           from the model, which is known: the deviations along them are averaged over square
///           cells of several sizes, each twice the one before.
/// Level     of detection at 95 %, per cell: 1.96 sqrt(s^2 / n + sigma_pose^2), s the standard
///           deviation in the cell (roughness, noise; pooled with its surroundings where the cell
///           has few points), n the points in it, sigma_pose what the registration's whole
///           covariance makes there (M3C2-EP: Winiwarter et al. 2021,
///           doi:10.1016/j.isprsjprs.2021.06.011).
/// Correlation  s^2 / n holds for independent points. Whether it holds is asked of the data:
///           if the robust spread of mean / sigma over all cells of a size is f > 1, sigmas of
///           that size are multiplied by f (empirical null: Efron 2004,
///           doi:10.1198/016214504000000089).
/// Findings  Cells with a false discovery rate below 1 % (Benjamini and Hochberg 1995,
///           doi:10.1111/j.2517-6161.1995.tb02031.x) that touch and have one sign. Of findings of
///           several cell sizes that overlap, the most certain is kept.
/// Size      Heights are steps against the surroundings, so what the registration absorbed of
///           the whole does not enter them.

#include <cstdint>
#include <span>
#include <vector>

#include "core/grid.hpp"
#include "core/vec.hpp"
#include "scan/register.hpp"

namespace maquette::scan {

struct CellMap {
  double cell_mm = 0.0, x0_mm = 0.0, y0_mm = 0.0;  ///< lower left corner of cell (0, 0)
  double inflation = 1.0;          ///< what correlation between points makes of the sigmas
  Grid<float> mean_mm;             ///< NaN: fewer than 3 points
  Grid<float> sigma_mm;            ///< of the mean: noise, roughness, density, correlation
  Grid<float> lod_mm;              ///< 1.96 times sigma and pose together
  Grid<std::uint8_t> significant;  ///< 1: |mean| beyond the false discovery threshold
  double significant_share = 0.0;  ///< of the cells with points
};

/// A patch that is higher (or lower) than its surroundings.
struct Finding {
  Vec3 centre_mm;                                 ///< x, y: weighted by height; z: 0
  double height_mm = 0.0, sigma_height_mm = 0.0;  ///< of its inside against its surroundings
  double area_mm2 = 0.0, diameter_mm = 0.0;       ///< volume / height; of the equal circle
  double sigma_diameter_mm = 0.0;
  double length_mm = 0.0, width_mm = 0.0;  ///< along its principal axes, if a rectangle
  double volume_mm3 = 0.0, sigma_volume_mm3 = 0.0;
  double certainty = 0.0;  ///< volume over its standard deviation
  double cell_mm = 0.0;    ///< of the map in which it was found
  Vec3 min_mm, max_mm;     ///< bounding box, x and y
};

struct Significance {
  std::vector<CellMap> maps;      ///< finest first
  std::vector<Finding> findings;  ///< most certain first
};

/// @param points_mm     in the model frame
/// @param deviation_mm  per point; NaN: off the part
/// @param registration  whose covariance counts; null: the pose is known
/// @param finest_mm     side of the smallest cells; 0: some 6 points in each
/// Five sizes of cells, as long as there are at least 8 a side.
[[nodiscard]] Significance significance(std::span<const Vec3> points_mm,
                                        std::span<const float> deviation_mm,
                                        const Registration* registration, double finest_mm = 0.0);

}  // namespace maquette::scan

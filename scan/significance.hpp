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
///           doi:10.1198/016214504000000089). This needs most of the part to
///           be unchanged: the spread is that of the middle half of all cells. Where a fifth of
///           the part stands clearly off to one side f is 1.4 instead of 1, where a third does
///           2.1, and weak findings are lost; where half of it or more does, the change passes
///           for noise. `inflation` shows that, but the data cannot tell a change of most of the
///           part from noise that is correlated over it.
/// Findings  Cells with a false discovery rate below 0.5 % over all cell sizes together (Benjamini
///           and Hochberg 1995, doi:10.1111/j.2517-6161.1995.tb02031.x; each size has its equal
///           part of it) that touch and have one sign. Of findings of several cell sizes that
///           overlap, the most certain is kept. What lies across several cells is sought by round
///           means at every place (detail/disc_filter.hpp); each of both has half of the level. On
///           a part that is as expected one scan in a hundred has a finding by chance.
/// Whole     Where more than half of the part lies significantly to one side at some cell size, the
///           robust plane through its cells is the first finding, and patches are sought against
///           that plane, by noise alone: a step on a part that lies off is found as if it lay true.
/// Expected  Findings are of what is given: deviations from the design contain what was known
/// before
///           (scallops, creases that the ball does not reach), and these are found too. Deviations
///           from the expected surface (expected_surface.hpp) contain only what was not.
/// Size      Heights are steps against the surroundings, so what the registration absorbed of
///           the whole does not enter them (refit.hpp has the best fit follow the rest of the
///           part alone; what its pose leaves open is part of what is stated); along the normal, as
///           deviations are: what was moved by 0.6 mm along z on slopes of 13 degrees is 0.585 mm
///           high (`along_z_mm` has the 0.6). Patches of one height from 3 mm (1.7 mm cells) to
///           bands: normalised errors of 140 heights have rms 0.97, of diameters 1.06
///           (scan/detail/patches.hpp says how). Of a patch that is not of one height it is a mean.
///           Small patches that hardly stand out are cut out of the points as discs where that
///           explains more than cells do (scan/detail/disc_fit.hpp).

#include <cstdint>
#include <span>
#include <vector>

#include "core/grid.hpp"
#include "core/vec.hpp"
#include "heightmap/height_field.hpp"
#include "scan/joint_pose.hpp"

namespace maquette::scan {

struct CellMap {
  double cell_mm = 0.0, x0_mm = 0.0, y0_mm = 0.0;  ///< lower left corner of cell (0, 0)
  double inflation = 1.0;  ///< what correlation between points makes of the sigmas
  Grid<float> mean_mm;     ///< NaN: fewer than 3 points
  Grid<float> sigma_mm;    ///< of the mean: noise, roughness, density, correlation
  Grid<float> lod_mm;      ///< 1.96 times sigma and pose together
  /// 1: |mean| beyond the false discovery threshold, or in a finding that has no such cell
  Grid<std::uint8_t> significant;
  Grid<std::uint8_t> in_patch;     ///< 1: in or beside one that stands out of its surroundings
  double significant_share = 0.0;  ///< of the cells with points
};

/// A patch that is higher (or lower) than its surroundings.
struct Finding {
  Vec3 centre_mm;                                 ///< x, y: weighted by height; z: 0
  double height_mm = 0.0, sigma_height_mm = 0.0;  ///< of its inside against its surroundings
  double along_z_mm = 0.0;  ///< what is so high along the normal if it was moved along z
  double area_mm2 = 0.0, diameter_mm = 0.0;  ///< volume / height; of the equal circle
  double sigma_diameter_mm = 0.0;
  double length_mm = 0.0, width_mm = 0.0;  ///< along its principal axes, if a rectangle
  double volume_mm3 = 0.0, sigma_volume_mm3 = 0.0;
  /// Volume over the standard deviation of as much noise; or, if that is more, the mean over the
  /// disc that found it over its own.
  double certainty = 0.0;
  bool whole_part = false;  ///< no patch: the level of the part as a whole, against the design
  double cell_mm = 0.0;     ///< of the map in which it was found
  Vec3 min_mm, max_mm;      ///< bounding box, x and y
};

/// The lowest round patch that is found with a probability of 95 %, wherever it lies.
struct DetectionLimit {
  double width_mm = 0.0, height_mm = 0.0;
  double points = 0.0;  ///< in it
};

struct Significance {
  std::vector<CellMap> maps;      ///< finest first
  std::vector<Finding> findings;  ///< the part as a whole, if it lies off; then most certain first
  /// What these points can show at all: by width, up to half of the part, where they are as dense
  /// as in the middle of all cells. A width that is missing is not sure to be shown at any height.
  std::vector<DetectionLimit> limits;
};

/// @param points_mm     in the model frame
/// @param deviation_mm  per point; NaN: off the part
/// @param scans         poses whose covariances count, in the order of the points, as many as
///                      all of them together; none: the poses are known
/// @param finest_mm     side of the smallest cells; 0: some 6 points in each
/// @param slope_deg     of the design at each point; none, NaN: level
/// @param surface       what the deviations are from: with it a pose's error is part of what is
///                      stated of each patch's height
/// Five sizes of cells, as long as there are at least 8 a side.
[[nodiscard]] Significance significance(std::span<const Vec3> points_mm,
                                        std::span<const float> deviation_mm,
                                        std::span<const ScanPose> scans, double finest_mm = 0.0,
                                        std::span<const float> slope_deg = {},
                                        const heightmap::ModelField* surface = nullptr,
                                        double beam_diameter_mm = 0.0);

}  // namespace maquette::scan

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file photon_transfer.hpp
/// What a sensor is, from bright and dark frames: gain, noise, dark current, well, and how its
/// pixels differ. EMVA Standard 1288 release 4.0 (2021), linear model.
///
/// Takes   levels of light: at least two frames each, dark ones of the same exposure times
/// Method  variance of bright frames = that of dark ones + K (mean - mean in the dark): weighted
///         least squares of K = 1 / gain and of each dark level's variance together, so that what
///         levels share (a dark series) counts once in the uncertainty. Levels from the dark to 70
///         % of saturation. Rounding adds 1/12 DN^2 to both sides.
/// Gives   values with standard uncertainties (k = 1) from the frames' own scatter, widened by the
///         root of chi^2 per degree of freedom where the straight line does not hold
///
/// What frames do not show stays unknown (NaN), and a note says why.

#include <string>
#include <vector>

#include "camera/frame_series.hpp"
#include "core/result.hpp"

namespace maquette::camera {

inline constexpr ErrorCode kCalibrationFrames{"CAMERA_CALIBRATION_FRAMES"};

struct TransferPoint {
  double exposure_s = 0.0;
  int plane = 0;
  double signal_dn = 0.0;  ///< mean less dark mean
  Measured variance_dn2;   ///< less dark variance
  bool used = false;       ///< for the gain
  bool saturated = false;
};

struct SensorCalibration {
  Measured gain_e_per_dn, black_level_dn;
  Measured temporal_dark_noise_e;  ///< EMVA's: of a pixel, rows' share included
  Measured read_noise_e;           ///< of the pixel alone: without rows, dark charge, rounding
  Measured row_noise_e;
  Measured dark_current_e_s;
  Measured saturation_dn;     ///< where the variance is largest (EMVA's), black included
  Measured saturation_e;      ///< EMVA's saturation capacity
  Measured full_well_e;       ///< the charge at which all pixels stop; see notes
  double chi2_per_dof = 0.0;  ///< of the line
  std::vector<TransferPoint> points;
  std::vector<std::string> notes;
};

/// @param bright  one of each series and plane; @param dark  one of each series (plane -1)
/// @param largest_dn  of the converter
/// @return CAMERA_CALIBRATION_FRAMES: fewer than two dark or bright frames; bright levels without a
///         dark one of their exposure time; fewer than three levels below saturation; dark frames
///         cut at 0; no rise of the variance with light
[[nodiscard]] Result<SensorCalibration> photon_transfer(const std::vector<LevelStatistics>& bright,
                                                        const std::vector<LevelStatistics>& dark,
                                                        double largest_dn);

/// How pixels differ in the dark, in DN. Hot pixels (beyond six robust standard deviations of all)
/// are counted apart.
struct DarkPattern {
  Measured dsnu_dn;  ///< EMVA's DSNU: of all that stays, columns and rows included
  Measured pixel_dn, column_dn, row_dn;
  double hot_share = 0.0;  ///< of an exponential distribution of which those found are the tail
  double hot_mean_dn = 0.0;
  std::size_t hot_found = 0;
};
/// @pre a series of one plane
[[nodiscard]] DarkPattern dark_pattern(const FrameSeries& dark);

/// EMVA's PRNU: how pixels differ in their response, 1 = 100 %. A smooth surface (polynomial of
/// degree 6) is taken out of each plane first: lamp and lens are not the sensor.
/// @pre both of one size, dark of one plane, no pixel saturated
[[nodiscard]] Measured response_pattern(const FrameSeries& bright, const FrameSeries& dark);

}  // namespace maquette::camera

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file frame_series.hpp
/// Pictures of one and the same light, pixel by pixel: what all have in common, and how they
/// scatter. In numbers of the converter (DN), before demosaicing.
///
/// Frames are brought to one brightness first (their mean subtracted, colour by colour), so that a
/// lamp that drifts from picture to picture is no noise: EMVA 1288 release 4.0, section 6.6 (for
/// two frames its formula, 1/2 <(a - b)^2> - 1/2 (<a> - <b>)^2).
///
/// Memory: 8 bytes a pixel, for any number of frames.

#include <cstdint>
#include <vector>

#include "camera/effects/frame.hpp"
#include "core/grid.hpp"

namespace maquette::camera {

/// What has been measured, and its standard uncertainty. NaN: not measured.
struct Measured {
  double value = NAN, u = NAN;
  [[nodiscard]] bool known() const { return !std::isnan(value); }
};

struct FrameSeries {
  double exposure_s = 0.0;
  int frames = 0;
  int planes = 1;                     ///< 4 for a mosaic: pixels of (row & 1, col & 1)
  Grid<float> mean_dn;                ///< of each pixel
  Grid<float> square_sum_dn2;         ///< of each pixel's distances from its mean
  std::vector<double> frame_mean_dn;  ///< [frame][plane]
  std::vector<double> row_mean_dn;    ///< [frame][row][column parity], after alignment
  std::size_t at_zero = 0;            ///< values that are 0, over all frames
  std::vector<std::size_t> at_most;   ///< [plane]: values that are the converter's highest number
};

/// @param largest_dn  the converter's highest number
/// @pre frames of one size, at least 2 x 2 pixels
void add_frame(FrameSeries& series, const Grid<float>& frame_dn, double largest_dn);

/// One colour plane of a series (plane 2 (row & 1) + (col & 1); without a mosaic the whole), or all
/// planes together (-1).
struct LevelStatistics {
  double exposure_s = 0.0;
  int frames = 0, plane = -1;
  std::size_t pixels = 0;
  Measured mean_dn;
  Measured variance_dn2;      ///< of a pixel in time, rows' common noise included
  Measured row_variance_dn2;  ///< of what a row's pixels have in common in time; all planes: of the
                              ///< whole row
  double share_at_most = 0.0, share_at_zero = 0.0;
};
/// Uncertainties from the scatter between rows: whatever the noise's distribution, and with what
/// a row's pixels have in common.
/// @pre at least two frames
[[nodiscard]] LevelStatistics statistics_of(const FrameSeries& series, int plane);

}  // namespace maquette::camera

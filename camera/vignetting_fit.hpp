// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file vignetting_fit.hpp
/// The fall of light towards the corners (camera/effects/vignetting.hpp) from flats: pictures of an
/// evenly lit surface.
///
/// Method  means of blocks; least squares (Ceres) of brightness by plane, a slope of the surface's
///         light by flat (x and y: no lamp is even), and the law's parameters. The cosine power is
///         given, not estimated: polynomial and barrel would make up for it.
/// Gives   parameters with standard uncertainties from the scatter of the blocks. A surface that is
///         darker towards all sides is taken for the lens: nothing in flats tells the two apart.

#include <string>
#include <vector>

#include "camera/effects/vignetting.hpp"
#include "camera/photon_transfer.hpp"

namespace maquette::camera {

/// Mean of a block of one colour plane of one flat, black taken off.
struct FlatBlock {
  int flat = 0, plane = 0;
  Vec2 middle_px;
  double light_dn = 0.0;
};
/// Blocks of `side` x `side` pixels (of the picture, all planes apart), those at the edge smaller;
/// black of each pixel from the dark frames, if there are any, else `black_dn`.
/// @return CAMERA_CALIBRATION_FRAMES: saturated pixels (more than 0.1 %), no light over black
[[nodiscard]] Result<std::vector<FlatBlock>> flat_blocks(const FrameSeries& series,
                                                         const FrameSeries* dark, double black_dn,
                                                         int flat, std::ptrdiff_t side);

struct VignettingFit {
  Vignetting vignetting;
  std::vector<Measured> parameters;  ///< polynomial: a2, a4, a6; barrel: ratio, shift
  double rms = 0.0;                  ///< of the blocks about the law, 1 = 100 %
  std::vector<Vec2> slopes;          ///< of each flat's light, over the picture's width and height
  std::vector<double> off;           ///< of each block, relative
};

/// @param law  "polynomial" (a2, a4, a6 beside the cosine power) or "barrel"
/// @return CAMERA_CALIBRATION_FRAMES: fewer than 50 blocks; flats that do not decide the
/// parameters;
///         CAMERA_EFFECT_OUT_OF_RANGE: another law
[[nodiscard]] Result<VignettingFit> fit_vignetting(const std::vector<FlatBlock>& blocks,
                                                   const Shot& shot, const std::string& law,
                                                   double cosine_power);

}  // namespace maquette::camera

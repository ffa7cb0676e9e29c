// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file demosaic.hpp
/// One colour a pixel becomes three. Malvar, He, Cutler, "High-quality linear interpolation for
/// demosaicing of Bayer-patterned color images", ICASSP 2004, doi:10.1109/ICASSP.2004.1326587;
/// linear, exact where a colour changes linearly; or the plain bilinear mean of the neighbours. The
/// picture is mirrored at its edges.

#include <string>

#include "camera/effects/frame.hpp"

namespace maquette::camera {

struct Demosaic {
  std::string method = "malvar";  ///< malvar, bilinear

  static constexpr EffectInfo kInfo{
      "demosaic", Signal::dn, Signal::dn,
      "colours are interpolated between numbers that the converter gave"};
};

[[nodiscard]] Result<void> check(const Demosaic& e, const Shot& shot);
/// Without a mosaic nothing changes.
void apply(const Demosaic& e, const Shot& shot, Frame& frame);

}  // namespace maquette::camera

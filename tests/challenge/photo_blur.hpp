// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file photo_blur.hpp
/// Blurs that differ over a picture: a lens focused before or behind the part, a camera that turns
/// while the shutter is open.

#include "challenge/photo_sensor.hpp"

namespace challenge {

/// Diameter of the circle of confusion of a thin lens, pixels, of what lies `depth_mm` before it
/// along its axis: focal_px pupil |1 / depth - 1 / focus|.
double confusion_px(const Lens& lens, const PhotoCamera& camera, double depth_mm);
/// Margin that blur_by_place() needs; 0: it does nothing.
int place_margin_of(const Lens& lens, const PhotoCamera& camera, const Relief& relief);
/// Spreads each pixel over its circle of confusion, then along the way that its place goes through
/// the picture, and cuts the margin off.
/// @param picture  as rendered with `margin` and what the blurs after this one need more
void blur_by_place(const Lens& lens, const PhotoCamera& camera, const Relief& relief, int margin,
                   int more, Picture& picture);

}  // namespace challenge

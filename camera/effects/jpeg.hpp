// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file jpeg.hpp
/// What JPEG compression (ISO/IEC 10918-1) leaves of a picture: 8 bits, written and read back in
/// memory by the JPEG library of OpenImageIO.

#include "camera/effects/frame.hpp"

namespace maquette::camera {

struct Jpeg {
  int quality = 92;  ///< 1 to 100, of the Independent JPEG Group's tables

  static constexpr EffectInfo kInfo{"jpeg", Signal::display, Signal::display,
                                    "the file is written when the picture is finished"};
};

[[nodiscard]] Result<void> check(const Jpeg& e, const Shot& shot);
/// @return CAMERA_IMAGE_FORMAT if the library refuses (more than 65500 pixels a side)
[[nodiscard]] Result<void> apply(const Jpeg& e, const Shot& shot, Frame& frame);

}  // namespace maquette::camera

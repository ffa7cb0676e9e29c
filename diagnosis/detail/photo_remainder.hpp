// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// What a model of photographs leaves, and how it is shown.

#include "diagnosis/detail/photo_fit.hpp"
#include "diagnosis/diagnose.hpp"

namespace maquette::diagnosis::detail {

/// A kind of remainder: a fringe, or what readout makes of columns.
inline constexpr const char* kWaveInPicture = "a wave in a picture";

/// Looks at means of what is left, by places of the part, by squares of each picture and of all,
/// and by rows: one that stands far out of all others is no noise. Nor is what neighbours share:
/// a sensor's noise is each pixel's own, what a file was compressed to is not.
/// @param factor  of the declared noise's variance
/// @param smooth_255  what is alike in neighbouring places and larger is no noise, rms in 1/255
/// @param finer_255   the same of what is fixed to the part: unevenness finer than a map that is
/// known
[[nodiscard]] Remainder judge_photographs(const PhotoLinear& left, const PhotoViews& views,
                                          const Layout& layout, double factor,
                                          const PhotoScatter& scatter, double smooth_255,
                                          double finer_255);
/// Map over the part and dependences on image radius, incidence, phase angle, level and distance
/// from the lamp, in 1/255.
void show_photographs(const PhotoLinear& before, const std::vector<MeasuredPixel>& pixels_before,
                      const PhotoLinear& after, const PhotoViews& views, const Layout& layout,
                      Diagnosis& diagnosis);

}  // namespace maquette::diagnosis::detail

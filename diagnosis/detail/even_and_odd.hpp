// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// What pixels of even rows or columns show and those of odd ones do not: fields of an interlaced
// picture, greens of a mosaic with gains of their own, two amplifiers. Nothing in light, surface or
// lens knows a pixel's number.

#include "diagnosis/detail/photo_fit.hpp"

namespace maquette::diagnosis::detail {

/// Of rows, of columns, of both (a checkerboard), the clearest of any picture and channel.
struct EvenAndOdd {
  double level = 0.0;    ///< chi squared of offset, gain and shift that differ, four of them
  double rms_255 = 0.0;  ///< of these, beside what is alike
};
/// Least squares of what is left on offset, value and derivatives, with the sign of the parity;
/// scatter is the residuals' own (White 1980, doi:10.2307/1912934: edges scatter more).
/// @param left  of the whole lattice, whose steps are odd
/// @param clip  residuals beyond say little, of the declared noise
[[nodiscard]] EvenAndOdd even_and_odd(const PhotoLinear& left, const PhotoViews& views,
                                      double clip);

}  // namespace maquette::diagnosis::detail

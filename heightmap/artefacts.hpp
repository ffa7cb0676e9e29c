// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file artefacts.hpp
/// What an elevation product shows that the ground does not have: spikes, boxes of the stereo
/// matcher, seams of the camera's CCDs, ripples of its jitter, stripes of a laser's tracks.
///
/// Found in the product's own pixels, before it is laid on the site's nodes. Each kind is told by
/// what relief does not do:
///   spike   one pixel, or up to 2 x 2, ten local deviations off the median of those around, which
///           do not rise with it (stereo smears a boulder over its matching window)
///   box     a rectangle along rows and columns, 4 to 64 pixels wide, raised or lowered as a whole:
///           all four sides are steps of one height, and together 7.5 deviations clear; more
///           where steps are the ground's and not noise, for craters have walls on four sides too
///   seam    a straight step of two pixels at most, within 15 degrees of rows or columns, with one
///           sign: right through, 7 deviations clear, or in a quarter of it or more, 8 deviations;
///           or a row or column whose steps, of either sign, are 1.8 times those of rows around
///   waves   ripples and stripes: waves of one direction only, to the width of a ray in the
///           spectrum, far above those in the directions beside it. Dunes and ridges turn and end:
///           their rays are wide
///
/// Separable, and so removed where asked: spikes and boxes are replaced by relief like that around
/// (detail/void_fill.hpp), seams by moving what lies beyond them, waves by taking away the mean
/// along their crests, in the bands where they are seen and by their share there. Not separable are
/// seams whose step changes along them or that end, and waves that are not alike along their crests
/// or stand in one place only (a scarp does): these are only shown, and uncertainty is raised.
///
/// Accuracy (tests/heightmap/artefacts_test.cpp): 95 % of boxes of 0.5 m and more found at 0.1 m of
/// noise; clean ground, smooth or rough, changes by less than 2 % of its noise.

#include <cstdint>
#include <vector>

#include "core/grid.hpp"

namespace maquette::heightmap {

/// Bits of the mask; they add up.
enum Artefact : std::uint8_t {
  kSpike = 1,
  kBox = 2,
  kSeam = 4,
  kWaves = 8,
  kTakenAway = 16,  ///< of the kinds above, here; without it they are left as they were
};

/// What is done about them.
enum class Clean {
  off,     ///< they are not looked for
  detect,  ///< found, shown, uncertainty raised; heights stay
  remove,  ///< what is separable is taken away
};

/// A rectangle of the window's pixels.
struct BoxArtefact {
  std::ptrdiff_t row = 0, col = 0, rows = 0, cols = 0;
  double offset_m = 0.0;
};

/// Between neighbouring columns (or rows, if `level`) of the window: the step is at column
/// at + slant (row - middle row).
struct SeamArtefact {
  bool level = false;
  double at = 0.0, slant = 0.0;
  double from = 0.0, to = 1.0;  ///< share of its length where it shows
  double step_m = 0.0;          ///< beyond it less before it
  double sigma_m = 0.0;         ///< of the step
  bool separable = false;
};

struct WaveArtefact {
  double towards_deg = 0.0;  ///< across the crests, from the columns' direction to the rows'
  double shortest_pixels = 0.0, longest_pixels = 0.0;
  double rms_m = 0.0;
  double alike = 0.0;  ///< correlation of the quarters of their crests
  bool separable = false;
};

struct ArtefactReport {
  std::ptrdiff_t spikes = 0;
  std::vector<BoxArtefact> boxes;
  double box_limit_m = 0.0;  ///< lowest box of four pixels' side that noise lets be found
  std::vector<SeamArtefact> seams;
  std::vector<WaveArtefact> waves;
  double masked_share = 0.0;  ///< of the window
};

}  // namespace maquette::heightmap

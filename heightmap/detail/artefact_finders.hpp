// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file artefact_finders.hpp
/// The finders behind artefacts.hpp, and what they do together to a window of pixels.

#include <vector>

#include "core/grid.hpp"
#include "core/median.hpp"
#include "heightmap/artefacts.hpp"

namespace maquette::heightmap::detail {

inline constexpr auto kNormal = static_cast<float>(kMadToSigma);

/// Height steps between neighbouring pixels beyond what the slope on both sides makes of them:
/// d(0) - (d(-1) + d(1)) / 2. Element (r, c) stands between column c - 1 and c (row r - 1 and r);
/// zero where a pixel is missing. Limited to 8 local deviations.
struct Steps {
  Grid<float> across_columns, across_rows;
  Grid<float> scale_m;  ///< local deviation of both, one value per kTile x kTile pixels
  double alike = 1.0;   ///< by how much more than white a mean along a side varies
  static constexpr std::ptrdiff_t kTile = 64;
  [[nodiscard]] double scale_at(std::ptrdiff_t r, std::ptrdiff_t c) const {
    return static_cast<double>(scale_m(r / kTile, c / kTile));
  }
};
[[nodiscard]] Steps steps_of(const Grid<float>& h);

struct Spike {
  std::ptrdiff_t row = 0, col = 0;
  float off_m = 0.0F;
};
[[nodiscard]] std::vector<Spike> find_spikes(const Grid<float>& h);
/// @param limit_m  gets the lowest box of four pixels' side that is found nearly always
[[nodiscard]] std::vector<BoxArtefact> find_boxes(const Grid<float>& h, const Steps& steps,
                                                  double& limit_m);
[[nodiscard]] std::vector<SeamArtefact> find_seams(const Grid<float>& h, const Steps& steps);

/// Waves and, for each pixel, their height; only what separable ones have may be taken away.
struct FoundWaves {
  std::vector<WaveArtefact> waves;
  Grid<float> separable_m, left_m;  ///< empty: none
};
[[nodiscard]] FoundWaves find_waves(const Grid<float>& h);

struct Cleaned {
  Grid<std::uint8_t> mask;  ///< bits of Artefact; empty: nothing found
  Grid<float> doubt_m;      ///< standard uncertainty that it adds; same size, 0 where none
  Grid<std::uint8_t> made;  ///< 1 where heights were replaced by relief like that around
  ArtefactReport report;
};
/// Changes `h` where told to and separable; voids (NaN) stay voids.
[[nodiscard]] Cleaned clean(Grid<float>& h, Clean what);

}  // namespace maquette::heightmap::detail

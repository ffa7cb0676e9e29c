// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file bands.hpp
/// A grid of heights as a sum of bands of waves, three an octave, and each multiplied by a weight.
///
/// A pyramid (Burt and Adelson 1983, doi:10.1109/TCOM.1983.1095851) with more nodes than it needs:
/// level 0 and 1 have all nodes, level k every 2^(k-1)-th. With half as many, waves between two and
/// four of a level's nodes leave images in others, which show as a pattern of the level's nodes
/// wherever bands have different weights. A level's three bands are what (1 2 1) / 4 takes away,
/// what (1 4 6 4 1) / 16 takes away beyond that, and what coming back from the next level takes
/// away beyond that (by the latter filter in level 0, (1 8 28 56 70 56 28 8 1) / 256 in others);
/// the last band of all is what is left. Beyond the grid's edge slopes go on.

#include <vector>

#include "core/grid.hpp"

namespace maquette::heightmap::detail {

inline constexpr std::size_t kBandsPerLevel = 3;
[[nodiscard]] constexpr std::size_t bands_of(std::size_t levels) {
  return levels * kBandsPerLevel + 1;
}

/// Share of a wave in each of bands_of(levels) bands; they add up to one.
/// @param fx, fy  cycles per node
[[nodiscard]] std::vector<double> band_shares(double fx, double fy, std::size_t levels);

/// Every second node of what (1 4 6 4 1) / 16 leaves: (n + 1) / 2 rows and columns.
[[nodiscard]] Grid<float> halved(const Grid<float>& fine);
/// The same of weighted means; 0 where nothing weighs. `weight` becomes the mean weight.
void halve(Grid<float>& fine, Grid<float>& weight);
/// Back on rows x cols nodes by the same filter.
[[nodiscard]] Grid<float> doubled(const Grid<float>& coarse, std::ptrdiff_t rows,
                                  std::ptrdiff_t cols);

/// Weights of the bands, alike in all nodes of a class.
struct BandWeights {
  std::vector<std::vector<float>> of_class;  ///< [class][band]
  /// Class of each node; may be empty where there is one class only. Between classes weights are
  /// mixed as the level's filter sees them.
  const Grid<std::uint8_t>* classes = nullptr;
};

/// Same result for any number of threads. Rounding is relative to the largest height.
[[nodiscard]] Grid<float> weighted_bands(Grid<float> z, std::size_t levels,
                                         const BandWeights& weights);

}  // namespace maquette::heightmap::detail

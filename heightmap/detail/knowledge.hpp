// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file knowledge.hpp
/// What sources know of the waves of a relief, and the weights that make the best of two.
///
/// A surface that shows a wave of the relief by the share `kept` of its height, with noise of its
/// own, errs there by noise + (1 - kept)^2 relief. Weights of bands (bands.hpp) are those with the
/// least error over all waves: linear least squares, because a wave is in several bands.
///
/// A source's pixels are means over their area. Their noise is white as far as the source itself
/// shows white noise (roughness.hpp). What it is said to have beyond that is alike over many
/// pixels, as jitter and the bow of a stereo model are (a Gaussian spectrum of waves from 64 pixels
/// on). It counts where another source shows the same waves; no relief is smoothed for noise that
/// nobody can see. Between pixels the source is interpolated by Keys' cubic convolution, whose
/// images of the relief count as noise.

#include <vector>

#include "heightmap/detail/roughness.hpp"

namespace maquette::heightmap::detail {

/// The relief's waves as nodes show them, in samples of frequency: means over their cells, in which
/// waves shorter than two nodes look like longer ones.
struct WaveTable {
  struct Sample {
    double fx = 0.0, fy = 0.0;  ///< cycles per node
    double relief = 0.0;        ///< variance that this sample stands for, m^2
    double area = 0.0;  ///< of the plane of frequencies; of white noise of one node its share
    std::vector<double> shares;  ///< of the bands
  };
  std::vector<Sample> samples;
  std::size_t levels = 0;
  Roughness law;
  double spacing_m = 1.0, longest_m = 1.0;
};
/// Waves longer than `longest_m` are left out.
[[nodiscard]] WaveTable wave_table(const Roughness& law, double spacing_m, double longest_m,
                                   std::size_t levels);

struct Knowledge {
  std::vector<double> kept, noise;  ///< of each sample; noise as variance, m^2
  std::vector<double> unseen;       ///< noise beyond what the source itself shows, m^2
};
/// @param pixel_nodes   side of a pixel; up to 1: averaged to the nodes
/// @param white_m       noise of one pixel, or of a node where averaged
/// @param correlated_m  noise that neighbours have in common
[[nodiscard]] Knowledge knowledge_of(const WaveTable& waves, double pixel_nodes, double white_m,
                                     double correlated_m = 0.0);

/// The same with more noise, like the relief in its waves.
[[nodiscard]] Knowledge doubted(const WaveTable& waves, Knowledge of, double variance_m2);

/// Variance of the error of a node, m^2.
[[nodiscard]] double error_variance(const WaveTable& waves, const Knowledge& of);

/// How alike errors are of nodes that lie 0, 1, ... `nodes` apart; mean over directions.
[[nodiscard]] std::vector<double> correlation_of_errors(const WaveTable& waves, const Knowledge& of,
                                                        std::size_t nodes);

/// Weights w for there + w (other - there) with the least error, and what is known then.
[[nodiscard]] std::vector<double> best_weights(const WaveTable& waves, const Knowledge& there,
                                               const Knowledge& other);
[[nodiscard]] Knowledge combined(const WaveTable& waves, const Knowledge& there,
                                 const Knowledge& other, const std::vector<double>& weights);

/// Factors that make waves as strong as relief is: sqrt(relief / (kept^2 relief + noise)) where
/// noise is below four times the relief, Wiener's kept relief / (kept^2 relief + noise) where it is
/// above sixteen times: half as much error again in waves that have next to none.
[[nodiscard]] std::vector<double> restoring_weights(const WaveTable& waves, const Knowledge& of);
[[nodiscard]] Knowledge restored(const WaveTable& waves, const Knowledge& of,
                                 const std::vector<double>& weights);

}  // namespace maquette::heightmap::detail

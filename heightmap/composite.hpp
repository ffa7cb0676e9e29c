// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file composite.hpp
/// Relief of one body with detail of another: HiRISE detail on a lunar base, or the reverse.
///
/// Room    heightmap, beside fuse
/// Takes   two requests of fuse.hpp: the site's relief, and a place of another body whose short
///         waves are the detail
/// Gives   one surface in the site frame, what was done to the detail, which source is in which
/// band
///
/// Method. Each body's products are fused alone (fuse.hpp): nothing is aligned between bodies,
/// and a product of the wrong one is refused by its ellipsoid. Then waves shorter than the
/// crossover are the detail's, with one gain by which its slopes continue the relief's there
/// (detail/composite_bands.hpp: what that keeps, and how exactly).
///
/// Uncertainty. sigma_m says how far the ground of the site's body may be: the relief's own and the
/// root mean square of what was exchanged, for the ground there has nothing to do with the detail.
///
/// Both spectra should run alike around the crossover: `gain_longer` is the gain an octave of
/// longer waves would ask for. Far below `gain` it says that the detail's spectrum is flatter; far
/// above, that the relief shows less than the ground has at the crossover already: take a longer
/// one.

#include <optional>

#include "heightmap/fuse.hpp"

namespace maquette::heightmap {

inline constexpr ErrorCode kSameBody{"HEIGHTMAP_SAME_BODY"};
inline constexpr ErrorCode kCrossover{"HEIGHTMAP_CROSSOVER"};

/// How detail was fitted to relief.
struct CompositeMatch {
  double crossover_m = 0.0;  ///< wavelength at which both have half of the power
  double gain = 0.0;         ///< of the detail's heights
  double gain_sigma = 0.0;   ///< standard uncertainty, as for Gaussian relief of this area
  double gain_longer = 0.0;  ///< that slopes an octave of longer waves up would ask for
  /// Root mean square slopes of the octave around the crossover, metres per metre; of the detail
  /// before the gain.
  double relief_slope = 0.0, detail_slope = 0.0;
};

struct CompositeRequest {
  FuseRequest relief;        ///< of the site; no synthetic detail
  FuseRequest detail;        ///< of another body, on the same nodes around its own centre
  double crossover_m = 0.0;  ///< 0: four pixels of the finest relief source, or nodes if wider
  /// Of a surface that enlarges another: as its detail was fitted, and itself (without sources).
  std::optional<CompositeMatch> as_before{};
  Enlarged wider{};
};

struct CompositeSurface {
  /// `source` is that of the long waves; `sources`, `residuals` of the relief, then of the detail
  /// (in its own body's metres, before the gain).
  FusedSurface surface;
  /// Same nodes: index of the short waves' source among surface.sources, 255 filled.
  Grid<std::uint8_t> detail_source;
  CompositeMatch match;
};

/// @pre both requests have the same nodes; those of `fuse`
/// @return the surface, or fuse's errors, or
///   HEIGHTMAP_SAME_BODY  both are of one body: `fuse` aligns them
///   HEIGHTMAP_CROSSOVER  the crossover is shorter than what the relief, or not longer than what
///                        the detail shows, or too long for the site, or the detail is flat there;
///                        says what would do
[[nodiscard]] Result<CompositeSurface> composite(const CompositeRequest& request,
                                                 const RunContext& run = {});

}  // namespace maquette::heightmap

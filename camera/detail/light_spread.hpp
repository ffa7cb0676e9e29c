// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file light_spread.hpp
/// Light of a picture's pixels, each spread over its picture of the aperture, in layers: what
/// depth_of_field (camera/effects/depth_of_field.hpp) says.
///
/// Takes   bands of light and a signed radius in pixels for each pixel; a tile at a time
/// Gives   the tile's light with what lies before, around and behind each pixel
/// Method  Eight neighbouring pixels look at their surroundings together, offset by offset: how far
///         an offset is from the aperture's edges is worked out once for all. Where all radii
///         around a tile are nearly the same there are no layers to keep apart.
/// Holds   Each sum runs over rows, then columns, whatever is worked on together: one bit for all.
/// Cost    Radii of 5.6 pixels, three bands: 45 ns a pixel, 100 where there are layers.

#include <array>
#include <cstddef>
#include <vector>

#include "core/grid.hpp"

namespace maquette::camera::detail {

inline constexpr float kNoTraceRadius = 0.5F;      ///< pixels; up to it light stays in its pixel
inline constexpr float kSameLayerRadius = 1.0F;    ///< difference of radii, pixels
inline constexpr std::ptrdiff_t kSpreadTile = 16;  ///< pixels a side

/// The aperture's picture of unit area-equivalent radius.
class Aperture {
 public:
  /// @param blades  below 3: round
  Aperture(int blades, double rotation_deg);
  /// How far (dx, dy) lies from the middle, towards the side it is nearest to. Behind the focus the
  /// picture stands on its head: `side` is 1 or -1.
  [[nodiscard]] float distance(float dx, float dy, float side) const;
  /// Where a picture of this radius ends, a pixel's half beyond: as distance().
  [[nodiscard]] float edge(float radius) const { return apothem_ * radius + 0.5F; }
  /// Nothing is covered at this distance from the middle or beyond it by a picture of radius r or
  /// less.
  [[nodiscard]] float beyond(float r) const {
    constexpr float kClearly = 1e-3F;
    return (edge(r) + kClearly) * corner_;
  }

 private:
  float apothem_ = 1.0F;
  float corner_ = 1.0F;  ///< distance of a corner, in apothems
  std::vector<std::array<float, 2>> normals_;
};

/// A picture that is looked at and not changed.
class LightSpread {
 public:
  /// What one thread needs.
  struct Scratch {
    std::vector<float> radius, edge, inverse;
    std::array<std::vector<float>, 3> light;
    std::vector<std::ptrdiff_t> widths;
  };
  /// @param radius   signed, pixels, of each pixel
  /// @param largest  of all |radius|
  /// @pre one to three bands of radius's size; all of them outlive this
  LightSpread(const std::vector<Grid<float>>& sharp, const Grid<float>& radius, float largest,
              const Aperture& aperture);

  /// Pixels from which light of radius `most` or less may come, to each side.
  [[nodiscard]] std::ptrdiff_t reach(float most) const;
  /// Light in rows and columns from kSpreadTile i and kSpreadTile j on.
  /// @param most  largest |radius| of all pixels whose light may reach the tile
  void tile(std::ptrdiff_t i, std::ptrdiff_t j, float most, Scratch& scratch,
            std::vector<Grid<float>>& out) const;

 private:
  struct Window;
  /// One over the sum of a picture's coverage over all pixels, by its radius.
  [[nodiscard]] float inverse_area(float radius) const;
  void load(Window& w, Scratch& s) const;
  template <std::size_t kBands, bool kLayers>
  void rows(const Window& w, const Scratch& s, std::vector<Grid<float>>& out) const;

  const std::vector<Grid<float>>& sharp_;
  const Grid<float>& radius_;
  const Aperture& aperture_;
  std::vector<float> inverse_;           ///< areas by steps of the radius
  std::ptrdiff_t most_reach_;            ///< of all tiles
  std::array<Grid<float>, 2> distance_;  ///< of each offset; behind the focus, before it
};

}  // namespace maquette::camera::detail

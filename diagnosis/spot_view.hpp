// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file spot_view.hpp
/// What a scanner with a wide spot reads of a surface: the mean range over the beams of the spot.
///
/// Takes   the cut surface, the station
/// Gives   for a place on the surface and each of kSpotWidths_mm: mean range less the beam's own
///
/// Method. The ranges of the surface as a pinhole camera at the station would see them, one ray a
/// pixel of the surface's spacing, blurred by Gaussians of fixed angle; a spot of fixed width in
/// millimetres at the range of the place lies between two of them (linear in the square of the
/// width, which a mean range is to second order). Beams that miss the surface count for nothing.
/// Steep places, kinks and what hides behind an edge are as the rays find them.
/// Cost: 40 bytes and 3 us of one core a pixel; a look-up 0.1 us.

#include <array>
#include <cstdint>

#include "diagnosis/observation.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::heightmap {
class FieldTracer;
}

namespace maquette::diagnosis {

/// What is left out beside an end: two standard deviations of a wide spot, on small parts 1/40 of
/// their longer side.
inline constexpr double kEnd_mm = 4.0, kEndShare = 0.025;

class SpotView {
 public:
  /// @param tracer  of `surface`
  /// @param most_pixels  of a side; larger views are coarser
  SpotView(const heightmap::ModelField& surface, const heightmap::FieldTracer& tracer,
           const Box3& box, Vec3 station_mm, double most_pixels);
  /// 0 where the view does not reach.
  [[nodiscard]] std::array<float, kSpotWidths_mm.size()> further(Vec3 place_mm) const;
  [[nodiscard]] double end_mm() const { return end_mm_; }
  /// Does the surface end within end_mm of the place as seen from the station, or hide what is
  /// behind it? What a spot reads of both sides hangs on what is there, and which surface a beam
  /// meets on tenths of a millimetre.
  [[nodiscard]] bool at_an_end(Vec3 place_mm) const;
  [[nodiscard]] Vec3 station() const { return station_; }

 private:
  static constexpr std::size_t kImages = kSpotWidths_mm.size() + 2;
  Vec3 station_, axis_, across_, up_;
  double end_mm_ = kEnd_mm;
  double distance_mm_ = 1.0;                ///< to the middle: images are that far from the pinhole
  std::array<double, kImages> width_mm_{};  ///< of the images, at that distance
  std::array<heightmap::ModelField, kImages> mean_;
  Grid<std::uint8_t> ends_;

  /// Where it is seen in the images, mm; false: it is not.
  bool project(Vec3 place_mm, double& u_mm, double& v_mm) const;
};

}  // namespace maquette::diagnosis

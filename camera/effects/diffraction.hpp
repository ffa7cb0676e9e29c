// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file diffraction.hpp
/// Diffraction and flare of the aperture: a point's picture is the squared magnitude of the
/// two-dimensional Fourier transform of the aperture (Fraunhofer; Goodman, Introduction to Fourier
/// Optics, section 4.2). A round one gives Airy's disc with its first dark ring at 1.22 lambda F;
/// of straight blades each edge throws a ray across, so that an even number of blades gives as many
/// rays and an odd one twice as many.
///
/// The transform (FFTW) is taken on a raster eight times as fine as the pixels, integrated over
/// each pixel. Up to three pixels from the middle pictures are convolved with it pixel by pixel;
/// farther out, to `reach_px`, in blocks of four pixels by Fourier transform. What would go farther
/// stays in the middle, so that light is kept: below 1 / (reach F lambda) of it.

#include "camera/effects/frame.hpp"

namespace maquette::camera {

struct Diffraction {
  int blades = 0;  ///< 0: round; else 3 to 30
  double rotation_deg = 0.0;
  double reach_px = 31.0;  ///< rays of flare of bright lamps reach farther, at a price

  static constexpr EffectInfo kInfo{
      "diffraction", Signal::radiance, Signal::radiance,
      "the aperture's edge bends light into a figure that is the same all over the sensor, after "
      "the "
      "lens has put each point in its place and given it its share of light"};
};

/// Light of a point in each pixel around it, the point in the middle of the middle pixel; sum 1.
/// @return square with an odd number of pixels, 2 ceil(reach) + 1
[[nodiscard]] Grid<double> point_figure(const Diffraction& e, double f_number, double wavelength_nm,
                                        double pixel_pitch_um);
/// Irradiance on lines through the middle, not integrated over pixels, of the same transform:
/// samples `spacing_um` apart. For tests against Airy's formula.
struct FineFigure {
  double spacing_um = 0.0;
  Grid<double> irradiance;  ///< the middle at (rows / 2, cols / 2), 1 there
};
[[nodiscard]] FineFigure fine_figure(const Diffraction& e, double f_number, double wavelength_nm,
                                     double pixel_pitch_um);

[[nodiscard]] Result<void> check(const Diffraction& e, const Shot& shot);
void apply(const Diffraction& e, const Shot& shot, Frame& frame);

}  // namespace maquette::camera

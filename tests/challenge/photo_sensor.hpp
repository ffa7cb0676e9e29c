// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file photo_sensor.hpp
/// From the light that a pinhole would gather to the numbers of a file: blur of the lens and of a
/// movement, fall of light, veil, then electrons, their noise, gains, black level, response, ADC.

#include <array>
#include <cstdint>
#include <filesystem>

#include "challenge/photo_render.hpp"

namespace challenge {

struct Lens {
  double defocus_px = 0;                  ///< diameter of an even disc
  std::array<double, 2> motion_px{0, 0};  ///< an even line, x right, y down
  double focus_mm = 0, pupil_mm = 0;      ///< a thin lens (photo_blur.hpp); pupil 0: all is sharp
  Vec3 turning_rad;             ///< of the camera about its own axes while it is exposed, evenly
  double fall2 = 0, fall4 = 0;  ///< 1 + fall2 q^2 + fall4 q^4, q = 1 in the corner
  double veil = 0;              ///< share of all light that lies evenly over the picture
};

struct Sensor {
  double exposure = 1;                    ///< light
  std::array<double, 3> filter{1, 1, 1};  ///< light of each band
  double full_well_e = 50000, read_noise_e = 20;
  double pixels = 0;  ///< standard deviation of the pixels' sensitivities, fixed for all pictures
  std::array<double, 3> gain{1, 1, 1};  ///< of the numbers, after the noise
  double black = 0, gamma = 1;          ///< (value + black)^gamma
};

/// Weights of a blur by disc and line, odd by odd, sum 1.
struct Kernel {
  int reach = 0;
  std::vector<double> weight;
  /// Standard deviation along a unit direction.
  double spread_px(double x, double y) const;
};
Kernel kernel_of(const Lens& lens);
/// Catmull and Rom's weights of four pixels, the second of which lies t before the place.
std::array<double, 4> cubic_weights(double t);
/// Margin that render() needs for it.
int margin_of(const Lens& lens);

/// Blurs, cuts the margin off, dims, veils.
void pass(const Lens& lens, Picture& picture);
/// Noise keyed on seed, photograph, pixel and band; sensitivities on the seed alone.
void expose(const Sensor& sensor, Picture& picture, std::uint64_t seed, int photo);
/// The number that an amount of light becomes on the mean.
double expected(const Sensor& sensor, std::size_t band, double light);
/// What the numbers of an exposure scatter by at an expected value (before gains): sqrt of
/// electrons and read noise.
double noise_of(double full_well_e, double read_noise_e, double value);

/// EXR, 32 bit linear RGB. @throw std::runtime_error
void write_picture(const Picture& picture, const std::filesystem::path& file);

}  // namespace challenge

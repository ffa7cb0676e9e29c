// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file hot_pixels.hpp
/// Pixels with a defect, where heat frees many more electrons: the same ones in every shot of a
/// sensor, their charge in proportion to exposure and growing with temperature as the dark current.
/// Their growth is measured in Widenhorn et al. 2002, doi:10.1117/12.463446; that their rates
/// scatter as an exponential distribution about `mean_rate_e_s` is assumed. Where dark frames of
/// the sensor exist, take these instead (DarkLibrary).

#include "camera/effects/frame.hpp"

namespace maquette::camera {

struct HotPixels {
  double share = 1e-5;  ///< of all pixels
  double mean_rate_e_s = 2000.0;
  double reference_c = 20.0;  ///< temperature of that rate

  static constexpr EffectInfo kInfo{
      "hot_pixels", Signal::electrons, Signal::electrons,
      "a defect frees electrons in the well like the dark current, before they are counted"};
};

[[nodiscard]] Result<void> check(const HotPixels& e, const Shot& shot);
[[nodiscard]] RowFunction rows(const HotPixels& e, const Shot& shot, const Frame& frame);

/// Dark frames of the sensor itself, in electrons a second, in place of the model: between two
/// temperatures each pixel's logarithm is interpolated in 1 / T, beyond the ends the nearest pair
/// is continued by the law of DarkCurrent.
struct DarkLibrary {
  struct Entry {
    double temperature_c = 20.0;
    Grid<float> rate_e_s;
  };
  std::vector<Entry> frames;  ///< by rising temperature

  static constexpr EffectInfo kInfo{
      "dark_library", Signal::electrons, Signal::electrons,
      "measured dark frames stand for the electrons of heat, before they are counted"};
};
[[nodiscard]] Result<void> check(const DarkLibrary& e, const Shot& shot);
[[nodiscard]] RowFunction rows(const DarkLibrary& e, const Shot& shot, const Frame& frame);

}  // namespace maquette::camera

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file tool.hpp
/// Milling cutters as bodies of revolution about z. The programmed point is the tip: the
/// lowest point of the axis' cutting end (a flat cutter's is the centre of its end face).

#include <cmath>
#include <string>
#include <vector>

namespace maquette::cnc {

/// Frustum of the shank or the holder, from `bottom_mm` above the tip upwards.
struct HolderPart {
  double bottom_mm = 0.0, height_mm = 0.0;
  double bottom_radius_mm = 0.0, top_radius_mm = 0.0;  ///< equal: a cylinder
};

/// Underside at distance r from the axis, above the tip: 0 up to radius - corner_radius, then
/// the corner's quarter circle.
struct Cutter {
  double radius_mm = 3.0;            ///< > 0
  double corner_radius_mm = 3.0;     ///< = radius: ball nose; 0: flat; between: bull nose
  double flute_length_mm = 0.0;      ///< cuts up to this height above the tip; 0: not known
  std::vector<HolderPart> holder{};  ///< from the flutes' end upwards; must not touch anything

  [[nodiscard]] static Cutter ball(double radius_mm) { return {radius_mm, radius_mm}; }
  [[nodiscard]] static Cutter flat(double radius_mm) { return {radius_mm, 0.0}; }
  [[nodiscard]] static Cutter bull(double radius_mm, double corner_radius_mm) {
    return {radius_mm, corner_radius_mm};
  }
  [[nodiscard]] bool is_ball() const { return corner_radius_mm == radius_mm; }
};

/// A pocket of the machine's tool table.
struct Tool {
  int number = 1;  ///< T word, also the length offset's H word
  std::string name = "ball nose 6 mm";
  Cutter cutter{};
  int teeth = 2;
};

struct BallNose {
  double radius_mm = 3.0;  ///< > 0
  operator Cutter() const { return Cutter::ball(radius_mm); }
};

/// Ridge between two parallel passes on flat ground: R - sqrt(R^2 - (stepover / 2)^2).
/// @pre 0 <= stepover <= 2 R
[[nodiscard]] inline double scallop_mm(BallNose tool, double stepover_mm) {
  const double half = 0.5 * stepover_mm;
  // Written as a quotient: the difference would lose half its digits at small stepovers.
  return half * half / (tool.radius_mm + std::sqrt(tool.radius_mm * tool.radius_mm - half * half));
}

}  // namespace maquette::cnc

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file stones_seen.hpp
/// The stones of a case: the plan as the model has it, the ground they stand on, and what was
/// measured about them.

#include <optional>
#include <vector>

#include "diagnosis/observation.hpp"
#include "heightmap/height_field.hpp"
#include "meshing/stones.hpp"

namespace maquette::diagnosis {

/// How far from a stone's middle points say something of it, in radii of the ball that holds it:
/// its shadow is as long as that.
inline constexpr double kAboutStone = 5.0;

struct StonePlan {
  std::vector<meshing::PlacedStone> stones;
  /// Where each stone's seat is, as a mark that the machine has made; none: the program was not
  /// there.
  std::vector<std::optional<Observation>> seats;
};

struct StonesSeen {
  StonePlan plan;
  heightmap::ModelField ground;  ///< without stones; as cut, with the declared coat
  /// Points about the stones by set-up, each in the frame of its file.
  std::vector<std::vector<Vec3>> points_mm;
  std::vector<std::optional<Vec3>> stations_mm;  ///< by set-up, in that frame
  std::vector<double> beams_mm;                  ///< by set-up: width at the part; 0: a ray
  double coat_mm = 0.0;                          ///< as declared
};

}  // namespace maquette::diagnosis

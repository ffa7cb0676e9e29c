// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file exploded_view.hpp
/// Bands or tiles of a design moved apart, seen obliquely from above: which part is where, how
/// large it is, which stones stand on it.

#include <set>
#include <span>
#include <string>
#include <vector>

#include "core/units.hpp"
#include "heightmap/height_field.hpp"
#include "meshing/grid_stream.hpp"
#include "meshing/stones.hpp"
#include "tools/drawing.hpp"
#include "tools/joint_holes.hpp"

namespace maquette::tools {

struct ExplodedPart {
  std::string name;           ///< "band 2"
  int number = 0;             ///< as holes name it
  meshing::NodeWindow nodes;  ///< of the design
  int column = 0, row = 0;    ///< it is moved by as many gaps east and north
};

struct ExplodedView {
  std::string title;
  std::vector<ExplodedPart> parts{};
  Millimetres base_z{0.0};
  std::span<const meshing::PlacedStone> stones{};
  std::set<int> marked{};  ///< numbers of stones drawn red
  JointHoles holes{};      ///< drawn between the parts: dowels blue, magnets red
  std::vector<std::string> notes{};
};

/// Parallel projection, seen from the south-west at 35 degrees above the horizon, heights true to
/// scale; where slopes are gentle the shading takes them for steeper and a note says by how much.
/// Names and dimensions stand beside strips and on tiles. About `width_px` wide.
/// @pre at least one part; windows lie within the design
[[nodiscard]] Drawing exploded_drawing(const heightmap::ModelField& design,
                                       const ExplodedView& view, int width_px = 1600);

}  // namespace maquette::tools

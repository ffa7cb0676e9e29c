// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file joint_holes.hpp
/// Dowels and magnets in the joints of bands and tiles (meshing/dowels.hpp), both kinds at once.

#include <array>
#include <filesystem>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "meshing/dowels.hpp"

namespace maquette::tools {

/// What is asked for.
struct InJoints {
  std::optional<meshing::DowelOptions> dowels{};
  std::optional<meshing::DowelOptions> magnets{};  ///< between the dowels, if there are any
  [[nodiscard]] bool any() const { return dowels || magnets; }
};

struct HolesOfKind {
  bool wanted = false;
  meshing::DowelOptions options{};
  std::vector<meshing::Dowel> places{};
};
struct JointHoles {
  HolesOfKind dowels{}, magnets{};
};

/// Magnets are placed as dowels are, or between these where there are some.
/// MESHING_DOWEL_DOES_NOT_FIT
[[nodiscard]] Result<JointHoles> place_holes(const heightmap::ModelField& design,
                                             std::span<const meshing::Tile> tiles,
                                             Millimetres base_z, Millimetres base_thickness,
                                             const InJoints& in_joints);

/// Holes in a part's walls, and how deep they go into the southern, eastern, northern, western one.
struct Holes {
  std::vector<meshing::EngravedWall> walls{};
  std::array<Millimetres, 4> depth{Millimetres{0}, Millimetres{0}, Millimetres{0}, Millimetres{0}};
};
[[nodiscard]] Holes holes_of(const heightmap::ModelField& design, const meshing::Tile& tile,
                             Millimetres base_z, const JointHoles& holes);

/// `pins.3mf` in a folder: a pin for each dowel, standing in rows, numbered as they are. Nothing
/// where there are no dowels. @param outputs  gets the file
[[nodiscard]] Result<void> write_pins(const JointHoles& holes, const std::filesystem::path& folder,
                                      std::vector<std::filesystem::path>& outputs);

/// An object with "dowels" and "magnets": where they sit, and what their holes take.
[[nodiscard]] std::string to_json(const JointHoles& holes);

}  // namespace maquette::tools

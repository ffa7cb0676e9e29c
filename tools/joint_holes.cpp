// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/joint_holes.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/check.hpp"
#include "export/cad.hpp"
#include "meshing/mesh_checks.hpp"

namespace maquette::tools {
namespace {

using nlohmann::json;

/// Of pins that are printed together.
constexpr double kBetweenPins_mm = 2.0;

json holes_json(const HolesOfKind& holes) {
  const meshing::DowelOptions& o = holes.options;
  json list = json::array();
  for (const auto& d : holes.places)
    list.push_back({{"number", d.number},
                    {"tiles", d.tiles},
                    {"axis", d.along_x ? "x" : "y"},
                    {"centre_mm", {d.centre_mm.x, d.centre_mm.y, d.centre_mm.z}}});
  return {{"diameter_mm", o.diameter_mm},
          {"hole_diameter_mm", o.diameter_mm + o.play_mm},
          {"hole_depth_mm", o.depth_mm},
          {"hole_volume_mm3", meshing::hole_volume_mm3(o)},
          {"places", list}};
}

}  // namespace

Result<JointHoles> place_holes(const heightmap::ModelField& design,
                               std::span<const meshing::Tile> tiles, Millimetres base_z,
                               Millimetres base_thickness, const InJoints& in_joints) {
  JointHoles holes;
  holes.dowels.wanted = in_joints.dowels.has_value();
  holes.magnets.wanted = in_joints.magnets.has_value();
  if (in_joints.magnets) holes.magnets.options = *in_joints.magnets;
  if (in_joints.dowels) {
    holes.dowels.options = *in_joints.dowels;
    if (in_joints.magnets)
      holes.dowels.options.between_mm = room_along_mm(design, *in_joints.magnets);
    MAQUETTE_TRY(holes.dowels.places, meshing::place_dowels(design, tiles, base_z, base_thickness,
                                                            holes.dowels.options));
  }
  if (in_joints.magnets) {
    // Checks what they ask for, too.
    MAQUETTE_TRY(holes.magnets.places,
                 meshing::place_dowels(design, tiles, base_z, base_thickness, *in_joints.magnets));
    if (in_joints.dowels)
      holes.magnets.places =
          place_between(design, holes.dowels.places, holes.dowels.options, *in_joints.magnets);
  }
  return holes;
}

Holes holes_of(const heightmap::ModelField& design, const meshing::Tile& tile, Millimetres base_z,
               const JointHoles& holes) {
  Holes found;
  for (const HolesOfKind* kind : {&holes.dowels, &holes.magnets}) {
    for (auto& wall : bored_walls(design, tile, base_z, kind->places, kind->options))
      found.walls.push_back(std::move(wall));
    for (std::size_t side = 0; side < found.depth.size(); ++side)
      found.depth[side] = std::max(
          found.depth[side],
          bored_depth(tile, kind->places, static_cast<meshing::WallSide>(side), kind->options));
  }
  return found;
}

Result<void> write_pins(const JointHoles& holes, const std::filesystem::path& folder,
                        std::vector<std::filesystem::path>& outputs) {
  const auto& places = holes.dowels.places;
  if (places.empty()) return {};
  const meshing::DowelOptions& o = holes.dowels.options;
  const TriMesh pin = meshing::dowel_pin(o);
  MAQUETTE_TRY(const auto certificate, meshing::check_mesh(pin));
  MAQUETTE_CHECK(certificate.passed(), "a pin of {} mm is no solid", o.diameter_mm);
  const auto in_a_row =
      static_cast<std::size_t>(std::ceil(std::sqrt(static_cast<double>(places.size()))));
  const double apart_mm = o.diameter_mm + kBetweenPins_mm;
  std::vector<exporting::BuildItem> items;
  for (std::size_t i = 0; i < places.size(); ++i)
    items.push_back({0,
                     {apart_mm * static_cast<double>(i % in_a_row),
                      apart_mm * static_cast<double>(i / in_a_row), 0.0},
                     fmt::format("P{:03}", places[i].number)});
  outputs.push_back(folder / "pins.3mf");
  return exporting::write_3mf(
      {{fmt::format("pin {:g} x {:g} mm", o.diameter_mm, meshing::pin_length_mm(o)), "P", &pin}},
      items, outputs.back());
}

std::string to_json(const JointHoles& holes) {
  json said = json::object();
  if (holes.dowels.wanted) {
    said["dowels"] = holes_json(holes.dowels);
    said["dowels"]["pin_length_mm"] = meshing::pin_length_mm(holes.dowels.options);
  }
  if (holes.magnets.wanted) {
    said["magnets"] = holes_json(holes.magnets);
    // Whatever meets, attracts.
    said["magnets"]["north_pole_outwards"] = {"east", "north"};
  }
  return said.dump();
}

}  // namespace maquette::tools

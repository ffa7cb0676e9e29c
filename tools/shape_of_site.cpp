// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/shape_of_site.hpp"

#include <fmt/format.h>

namespace maquette::tools {
namespace {

meshing::WallSide side_named(const std::string& name) {
  if (name == "east") return meshing::WallSide::east;
  if (name == "north") return meshing::WallSide::north;
  if (name == "west") return meshing::WallSide::west;
  return meshing::WallSide::south;
}

std::string with_scale(std::string text, double scale) {
  constexpr std::string_view kScale = "{scale}";
  for (auto at = text.find(kScale); at != std::string::npos; at = text.find(kScale))
    text.replace(at, kScale.size(), fmt::format("1:{:g}", scale));
  return text;
}

}  // namespace

Shape shape_of(const Site& site, double scale) {
  Shape shape;
  if (site.hollow_mm > 0.0) {
    shape.hollow.emplace();
    shape.hollow->wall = Millimetres{site.hollow_mm};
    shape.hollow->rib = Millimetres{site.rib_mm};
    shape.hollow->pocket = Millimetres{site.pocket_mm};
    shape.hollow->step = Millimetres{site.ceiling_step_mm};
  }
  shape.label = with_scale(site.label, scale);
  if (site.scale_bar) shape.scale_denominator = scale;
  shape.engraving = {.side = side_named(site.label_side),
                     .letter = Millimetres{site.letter_mm},
                     .depth = Millimetres{site.engrave_depth_mm},
                     .stroke = Millimetres{site.stroke_mm}};
  return shape;
}

InJoints in_joints_of(const Site& site) {
  InJoints found;
  if (site.dowel_mm > 0.0)
    found.dowels = meshing::DowelOptions{.diameter_mm = site.dowel_mm,
                                         .play_mm = site.dowel_play_mm,
                                         .depth_mm = site.dowel_depth_mm,
                                         .wall_mm = site.dowel_wall_mm,
                                         .spacing_mm = site.dowel_spacing_mm};
  if (site.magnet_mm > 0.0)
    found.magnets = meshing::DowelOptions{.diameter_mm = site.magnet_mm,
                                          .play_mm = site.magnet_play_mm,
                                          .depth_mm = site.magnet_depth_mm,
                                          .wall_mm = site.magnet_wall_mm,
                                          .spacing_mm = site.magnet_spacing_mm};
  return found;
}

}  // namespace maquette::tools

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file lod_tileset.hpp
/// What says where the tiles of a set are: tileset.json, explicit and implicit, and subtrees.

#include <map>
#include <string>

#include "export/lod_set.hpp"

namespace maquette::exporting {

/// Of tile (x, y) at a depth below the coarsest level; relative to tileset.json.
[[nodiscard]] std::string lod_tile_uri(int depth, std::ptrdiff_t x, std::ptrdiff_t y);

[[nodiscard]] std::string explicit_tileset(const LodSetReport& report, const LodSetOptions& options,
                                           const heightmap::ModelField& field);
[[nodiscard]] std::string implicit_tileset(const LodSetReport& report, const LodSetOptions& options,
                                           const heightmap::ModelField& field);
/// Binary subtree files by their path relative to tileset_implicit.json: which tiles there are, and
/// of each its box and error, the same as in tileset.json.
[[nodiscard]] std::map<std::string, std::string> subtree_files(const LodSetReport& report,
                                                               const LodSetOptions& options,
                                                               const heightmap::ModelField& field);

/// To the body's fixed frame from the tileset's at full size: column-major, metres; rigid.
[[nodiscard]] std::array<double, 16> fixed_from_tileset(const LodPlace& place,
                                                        const heightmap::ModelField& field,
                                                        double scale_denominator);

}  // namespace maquette::exporting

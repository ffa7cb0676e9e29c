// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file patch_soundness.hpp
/// What makes a patch fit to be put into the solid.

#include <array>
#include <cstdint>
#include <string>
#include <unordered_map>
#include <vector>

#include "meshing/detail/shell.hpp"

namespace maquette::meshing::detail {

using Edge = std::array<std::uint32_t, 2>;
struct EdgeHash {
  std::size_t operator()(const Edge& e) const {
    return ((std::uint64_t{e[0]} << 32) | e[1]) * 0x9e3779b97f4a7c15ULL;
  }
};

/// Keeps what hangs together with the block's border by edges (the rest are pockets of
/// air), then proves: every edge has two triangles except the block's border, and the
/// triangles round every vertex are one fan. `goal`, one per vertex, is thinned alike.
/// @return empty, or what is wrong
[[nodiscard]] std::string keep_manifold_sheet(const heightmap::ModelField& field, Patch& patch,
                                              std::vector<Vec3>& goal);

/// Moves vertices from where the contour has them to `goal` as far as the mesh stays
/// sound: what turns over, collapses or cuts is drawn back by halves, then wholly.
/// @return empty, or what is wrong
[[nodiscard]] std::string settle(TriMesh& mesh, const std::vector<Vec3>& goal);

}  // namespace maquette::meshing::detail

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file draco_piece.hpp
/// Up to a million triangles of a large mesh, compressed by Draco on a position grid
/// that all pieces share: vertices on a seam get the same coordinates in both.

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "core/result.hpp"

namespace maquette::exporting {

using Float3 = std::array<float, 3>;
using Float2 = std::array<float, 2>;

/// Positions are rounded to origin + k range / (2^bits - 1) on each axis.
struct PositionGrid {
  Float3 origin{};
  float range = 0.0F;
  int bits = 16;
  [[nodiscard]] double step() const {
    return static_cast<double>(range) / static_cast<double>((std::uint32_t{1} << bits) - 1);
  }
};

struct DracoPiece {
  std::vector<char> bytes;
  std::uint32_t points = 0, faces = 0;  ///< as a decoder will find them
  std::uint32_t position_id = 0, normal_id = 0, texture_id = 0, tangent_id = 0;
  Float3 min{}, max{};  ///< of the positions, as a decoder will find them
  /// Triangles that the grid leaves without area, and those that it turns to the other side.
  std::uint32_t flat = 0, turned = 0;
};

inline constexpr int kNormalBits = 10;  ///< octahedral

struct DracoSettings {
  /// Draco's scale from 0 (smallest) to 10 (fastest). At 5 meshes of any kind take half the time of
  /// 0 for a few per cent more bytes. Below 5 connectivity goes by valence and normals are
  /// predicted from positions: a grid of heights takes half the bytes for a third more time.
  int speed = 5;
  int normal_bits = kNormalBits;
  bool normals_alike = false;  ///< one value for all: predicted from each other, at no cost
};

/// Texture coordinates, rounded to k range / (2^bits - 1); none: `values` is empty.
struct DracoTexture {
  std::span<const Float2> values;
  int bits = 12;
  float range = 1.0F;
  std::optional<std::array<float, 4>> tangent;  ///< the same for all vertices
};

/// EXPORT_LIBRARY_FAILED with Draco's reason.
/// @param positions, normals  of the whole mesh; triangles index into them; normals may be empty
[[nodiscard]] Result<DracoPiece> draco_piece(std::span<const Float3> positions,
                                             std::span<const Float3> normals,
                                             std::span<const std::array<std::uint32_t, 3>> piece,
                                             const PositionGrid& grid,
                                             const DracoSettings& settings = {},
                                             const DracoTexture& texture = {});

}  // namespace maquette::exporting

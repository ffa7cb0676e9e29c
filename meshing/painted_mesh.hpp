// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file painted_mesh.hpp
/// A mesh with the looks that its file gives it: materials and pictures, triangle by triangle, as
/// spacecraft come from their makers.

#include <array>
#include <cstdint>
#include <filesystem>
#include <string>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"

namespace maquette::meshing {

inline constexpr ErrorCode kNoPaint{"MESHING_NO_PAINT"};

/// What a picture shows beyond its edges.
enum class Beyond { repeats, edge, mirrored };

/// A material as the file has it; no law of reflectance.
struct Paint {
  std::string name;                       ///< as in the file; may be empty
  bool described = true;                  ///< false: named by triangles and nowhere else
  std::array<double, 3> colour{1, 1, 1};  ///< linear R, G, B: share of light given back
  double metallic = 0.0;                  ///< 0: like paint, 1: like bare metal
  double roughness = 1.0;                 ///< 0: a mirror; the square is GGX's alpha
  std::filesystem::path picture_file;     ///< empty: none, or its bytes are in the mesh's file
  std::string picture;                    ///< these bytes, of a PNG, JPEG, ...
  std::array<Beyond, 2> beyond{};         ///< across, down
  [[nodiscard]] bool has_picture() const { return !picture_file.empty() || !picture.empty(); }
};

struct PaintedMesh {
  TriMesh mesh;  ///< the same as read_mesh's
  std::vector<Paint> paints;
  std::vector<std::uint32_t> paint_of;  ///< by triangle
  /// By triangle, of its corners: where in the picture, whose upper left corner is (0, 0) and lower
  /// right one (1, 1). NaN where the file says nothing.
  std::vector<std::array<std::array<float, 2>, 3>> at_corner;
  std::vector<std::filesystem::path> files;  ///< others that were read or are named: pictures, too
};

/// OBJ with its .mtl (Kd, map_Kd; Pm, Pr) or glTF of version 2 (pbrMetallicRoughness: base colour,
/// its picture with KHR_texture_transform, factors of metal and roughness). Of looks nothing else
/// is read: no transparency, no pictures of metal, roughness or normals, no colours at vertices.
/// Materials of a .mtl that is not there have their names alone.
/// @return read_mesh's codes; MESHING_NO_PAINT: a file that names no material, a
///         picture without coordinates
[[nodiscard]] Result<PaintedMesh> read_painted_mesh(const std::filesystem::path& path,
                                                    const RunContext& run = {});

}  // namespace maquette::meshing

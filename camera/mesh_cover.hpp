// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file mesh_cover.hpp
/// Materials and pictures of a mesh, triangle by triangle: a spacecraft's foil, panels and marks.

#include <array>
#include <cstdint>
#include <memory>
#include <vector>

#include "camera/reflectance.hpp"
#include "core/grid.hpp"
#include "core/result.hpp"
#include "core/tri_mesh.hpp"
#include "core/vec.hpp"

namespace maquette::camera {

/// Factors of light given back, between pixels' centres linear. Its upper left corner is (0, 0),
/// its lower right one (1, 1).
struct MeshPicture {
  enum class Beyond { repeats, edge, mirrored };  ///< what it shows there

  std::array<Grid<float>, 3> factor;  ///< of one size; row 0 is the upper
  std::array<Beyond, 2> beyond{};     ///< across, down

  [[nodiscard]] Bands at(double u, double v) const;
};

struct MeshCover {
  std::vector<Material> materials;
  std::vector<std::shared_ptr<const MeshPicture>> pictures;  ///< by material; null: none
  std::vector<std::uint32_t> material_of;                    ///< by triangle
  /// By triangle, of its corners: where in the picture; of those that have none anything.
  std::vector<std::array<std::array<float, 2>, 3>> at_corner;
};

/// CAMERA_MATERIAL_OUT_OF_RANGE: a material that its law does not know, no material or coordinates
/// of a triangle, a picture without pixels
[[nodiscard]] Result<void> check_cover(const MeshCover& cover, const TriMesh& mesh);

/// Where a point of a triangle lies in the picture, linear between its corners.
/// @param point  in the mesh's frame; the nearest of the triangle's plane counts
[[nodiscard]] std::array<double, 2> place_in_picture(const MeshCover& cover, const TriMesh& mesh,
                                                     std::uint32_t triangle, Vec3 point);

}  // namespace maquette::camera

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file stone_cap.hpp
/// The part of the solid's surface that stones made: what a level set knows that a
/// height field does not.

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <string_view>
#include <vector>

#include "core/result.hpp"
#include "core/tri_mesh.hpp"
#include "heightmap/height_field.hpp"
#include "meshing/detail/shell.hpp"

namespace maquette::meshing::detail {

/// Stones whose surroundings touch, and the cells that they may change.
struct StoneCluster {
  std::vector<const TriMesh*> stones;
  CellBlock reach;
};

/// Where the level set's lattice lies: nodes at the reach's corner + (n + shift) voxel.
struct Lattice {
  double voxel_mm = 0.5;
  double shift = 0.0;
};

/// Stone surface, seam, and a collar of terrain two cells wide. Empty if all is buried.
struct StoneCap {
  std::vector<Vec3> contoured_mm;  ///< as the contouring left the vertices
  std::vector<Vec3> projected_mm;  ///< on the stone or, only z moved, on the terrain
  std::vector<std::array<std::uint32_t, 3>> triangles;
  std::vector<std::array<std::uint32_t, 2>> rim;  ///< border edges, directed as in `triangles`
};

/// Terrain and stones are united where their signed distances differ by less than
/// this many voxels with a fillet, so that no crevice is narrower than half of it.
inline constexpr double kFilletVoxels = 1.5;
/// Voxels round the stones that the level set covers.
inline constexpr double kMarginVoxels = 10.0;

inline constexpr std::string_view kHangsInTheAir =
    "a stone hangs in the air, so that terrain and stones are not one solid; sink it into the "
    "surface";

/// MESHING_NOT_A_SOLID: a stone hangs in the air. OpenVDB's exceptions come out as
/// the same code.
[[nodiscard]] Result<StoneCap> contour_stones(const heightmap::ModelField& surface,
                                              const StoneCluster& cluster, const Lattice& lattice);

/// Distances to a set of stones. Brute geometry behind CGAL's box tree.
class StoneDistance {
 public:
  explicit StoneDistance(std::span<const TriMesh* const> stones);
  ~StoneDistance();
  StoneDistance(const StoneDistance&) = delete;
  StoneDistance& operator=(const StoneDistance&) = delete;
  struct Nearest {
    Vec3 point_mm;
    double distance_mm = INFINITY;
    double second_distance_mm = INFINITY;  ///< to the nearest other stone
  };
  [[nodiscard]] Nearest nearest(Vec3 p_mm) const;

 private:
  struct Trees;
  std::unique_ptr<Trees> trees_;
};

/// Fits the cap into the terrain: the cells round it are triangulated anew (CGAL's
/// constrained Delaunay triangulation) between the cap's rim and the block's border,
/// vertices are moved to their projected places as far as no triangle flips and none
/// cuts another one.
/// MESHING_NOT_A_SOLID with the reason if no closed, manifold patch came out.
[[nodiscard]] Result<Patch> fit_cap(const heightmap::ModelField& surface, const StoneCap& cap,
                                    const CellBlock& reach, double voxel_mm);

}  // namespace maquette::meshing::detail

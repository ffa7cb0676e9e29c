// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file dual_mesh.hpp
/// The zero of a function on the nodes of a grid as a mesh whose vertices lie in the cells (surface
/// nets: Gibson 1998, doi:10.1007/BFb0056277), and which is a 2-manifold.
///
/// Vertices   One for each piece of surface in a cell, not one a cell (Nielson 2004,
///            doi:10.1109/VISUAL.2004.28): two sheets that pass through one cell do not touch.
///            Pieces are the cycles of crossed edges, joined over the cell's faces. On a face
///            whose four edges are crossed, both cells join them by the sign of the bilinear
///            function's saddle (Nielson and Hamann 1991, doi:10.1109/VISUAL.1991.175782), which
///            they compute from the same four numbers.
/// Faces      Each crossed edge of the grid joins the vertices of the four cells around it. Where
///            both cells at a face of four crossings have all of them in one piece, their
///            vertices would be joined twice, by an edge of four faces: the second time goes
///            over a vertex of its own on the face.

#include <array>
#include <cstdint>
#include <vector>

#include "core/tri_mesh.hpp"
#include "scan/cloud.hpp"
#include "scan/detail/surfels.hpp"

namespace maquette::scan::detail {

/// Corners by bits: x, y, z. Edges 0 to 3 along x, 4 to 7 along y, 8 to 11 along z.
[[nodiscard]] constexpr unsigned edge_of(unsigned axis, unsigned corner) {
  const unsigned u = axis == 0 ? 1 : 0, v = axis == 2 ? 1 : 2;
  return 4 * axis + (corner >> u & 1U) + 2 * (corner >> v & 1U);
}

/// The pieces of surface in a cell.
struct CellSurfaces {
  std::uint8_t below = 0;     ///< bit per corner: the function is negative there
  std::uint8_t count = 0;     ///< pieces, up to four
  std::uint32_t of_edge = 0;  ///< two bits an edge: the piece that crosses it
  [[nodiscard]] unsigned piece(unsigned edge) const { return of_edge >> (2 * edge) & 3U; }
  [[nodiscard]] bool crosses(unsigned edge) const;
};
/// @param f  at the eight corners, finite
[[nodiscard]] CellSurfaces surfaces_of(const std::array<float, 8>& f);

/// Where the function crosses an edge of a cell: the two corners and the share of the way.
struct Crossing {
  unsigned from, to;
  double share;
};
[[nodiscard]] Crossing crossing_of(const std::array<float, 8>& f, unsigned edge);

struct DualGrid {
  const VoxelGrid* grid = nullptr;
  std::vector<std::uint64_t> keys;                    ///< of cells: their lowest corner
  KeyMap cell_of{64};                                 ///< index by key
  std::vector<std::array<std::uint32_t, 8>> corners;  ///< of each cell, into values
  std::vector<float> values;
  std::vector<CellSurfaces> surfaces;  ///< of each cell
  std::vector<std::uint32_t> first;    ///< of each cell, into `vertex`
  std::vector<std::uint32_t> vertex;   ///< of each piece: the mesh's, or KeyMap::npos

  [[nodiscard]] std::array<float, 8> at_corners(std::size_t cell) const;
  [[nodiscard]] Vec3 corner_mm(std::size_t cell, unsigned corner) const;
};
/// Adds the triangles, and the vertices on faces. Outside is where the function is positive.
void join_cells(const DualGrid& cells, TriMesh& mesh, std::vector<Colour>& colours);

}  // namespace maquette::scan::detail

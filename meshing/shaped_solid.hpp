// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file shaped_solid.hpp
/// The solid of grid_solid with another underside (hollow.hpp) and other walls: engraved
/// (engraving.hpp), with holes (dowels.hpp). Streamed.
///
/// Takes   ModelField, height of the base; what is to be in the place of plain base and walls;
///         of a tile its window, too
/// Gives   MeshStream: nodes and triangles of the top as GridSolidStream has them, to the bit;
///         walls, and what replaces the base, from memory
/// Memory  what is replaced, and 72 bytes a node of the outline
///
/// The certificate is proven, as that of GridSolidStream is. Top and walls are those of a graph of
/// a height over the rectangle. A hollow underside is a graph, too, of a lower height: the base's
/// on frame and ribs, the ceilings' in pockets, with upright walls between; lines of its grid rise
/// strictly in x and y, all ceilings lie above the base, and below the top at the corners of all
/// cells that their triangles touch, hence everywhere. So the two meet in the walls' lower rim
/// only.

#include <span>
#include <vector>

#include "meshing/engraving.hpp"
#include "meshing/grid_stream.hpp"
#include "meshing/hollow.hpp"

namespace maquette::meshing {

/// What differs from the plain solid.
struct Shaping {
  Underside underside;                ///< hollow_underside() or plain_underside()
  std::vector<EngravedWall> walls{};  ///< of different edges
};

class ShapedSolid final : public MeshStream {
 public:
  /// MESHING_SURFACE_HAS_VOIDS, MESHING_BASE_TOO_THIN as grid_solid
  /// @param surface  must outlive the stream
  [[nodiscard]] static Result<ShapedSolid> create(const heightmap::ModelField& surface,
                                                  const SolidOptions& options,
                                                  const Shaping& shaping);
  /// The part over the window, in the frame of the whole, shaped as a part by itself: edges count
  /// from the window's south-western corner. Where walls are plain, neighbours have the same ones,
  /// to the bit.
  [[nodiscard]] static Result<ShapedSolid> create(const heightmap::ModelField& surface,
                                                  const NodeWindow& window,
                                                  const SolidOptions& options,
                                                  const Shaping& shaping);
  [[nodiscard]] std::uint64_t vertex_count() const override;
  [[nodiscard]] std::uint64_t triangle_count() const override;
  void vertices(std::uint64_t first, std::span<Vec3> out) const override;
  void triangles(std::uint64_t first, std::span<Triangle> out) const override;
  void corners(std::uint64_t first, std::span<Corners> out) const override;

  /// Of a file with coordinates as they are (PLY). CORE_CANCELLED
  [[nodiscard]] Result<MeshCertificate> certify(const RunContext& run = {}) const;

 private:
  ShapedSolid(GridSolidStream grid, std::uint64_t top_triangles, std::uint64_t shared_vertices)
      : grid_(grid), top_triangles_(top_triangles), shared_vertices_(shared_vertices) {}
  [[nodiscard]] Vec3 vertex(std::uint64_t i) const;

  GridSolidStream grid_;
  std::uint64_t top_triangles_ = 0, shared_vertices_ = 0;  ///< with grid_: nodes and lower rim
  std::vector<Vec3> own_vertices_;
  std::vector<Triangle> own_triangles_;
  double removed_mm3_ = 0.0;
};

/// Of a solid as grid_solid or volume_solid made it of this surface: triangles of the top. They are
/// the mesh's first ones, and so are their vertices.
[[nodiscard]] std::uint64_t top_triangles(const TriMesh& solid,
                                          const heightmap::ModelField& surface);

/// The same for a solid in memory, with stones; the top stays as it is. A hollow one keeps its wall
/// under stones, too: the top is nowhere below the terrain.
/// @pre the mesh is as grid_solid or volume_solid made it of this surface, or of the window's part
///      of it in the frame of the whole
[[nodiscard]] TriMesh shaped(TriMesh solid, const heightmap::ModelField& surface,
                             const Shaping& shaping);

}  // namespace maquette::meshing

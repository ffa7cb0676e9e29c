// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file grid_stream.hpp
/// The solid of grid_solid (solid.hpp) without the mesh in memory: vertices and triangles are
/// made from the heights when a writer asks for them, in the same order, to the same bits.
///
/// Takes   ModelField, millimetres, no voids; it must outlive the stream
/// Gives   MeshStream for write_ply, write_stl, write_obj; a certificate of what a file with
///         the given rounding of coordinates holds
/// Memory  none beside the heights; a writer's pieces are some 2 MB
///
/// The certificate is proven, not searched for. If the rounded columns rise strictly in x, the
/// rows in y and every rounded node lies above the base, then the top is the graph of a height
/// over the rectangle, the walls stand on the outline below it and the base under all of it: a
/// closed, oriented 2-manifold of one shell without degenerate or intersecting triangles. Volume
/// and area are sums over the rounded triangles. Rounding moves the top node by node, and every
/// point of a triangle at most as far as the farthest of its corners: that is the bound of the
/// Hausdorff distance to the field's surface, both ways.

#include "core/mesh_stream.hpp"
#include "meshing/coordinate_rounding.hpp"
#include "meshing/mesh_checks.hpp"
#include "meshing/solid.hpp"

namespace maquette::meshing {

inline constexpr ErrorCode kRoundingCollapses{"MESHING_ROUNDING_COLLAPSES"};

/// How far the rounding moves a vertex at most, mm.
[[nodiscard]] double rounding_displacement_mm(const MeshStream& mesh, CoordinateRounding rounding);

/// Nodes of a field, all four numbers included.
struct NodeWindow {
  std::ptrdiff_t row0 = 0, row1 = 0, col0 = 0, col1 = 0;
  [[nodiscard]] std::ptrdiff_t rows() const { return row1 - row0 + 1; }
  [[nodiscard]] std::ptrdiff_t cols() const { return col1 - col0 + 1; }
  friend bool operator==(const NodeWindow&, const NodeWindow&) = default;
};

[[nodiscard]] inline NodeWindow all_nodes(const heightmap::ModelField& surface) {
  return {0, surface.z_mm.rows() - 1, 0, surface.z_mm.cols() - 1};
}
/// The part over the window, heights as they are; coordinates are the whole's to rounding.
[[nodiscard]] heightmap::ModelField window_field(const heightmap::ModelField& surface,
                                                 const NodeWindow& window);

class GridSolidStream final : public MeshStream {
 public:
  /// MESHING_SURFACE_HAS_VOIDS, MESHING_BASE_TOO_THIN as grid_solid
  [[nodiscard]] static Result<GridSolidStream> create(const heightmap::ModelField& surface,
                                                      const SolidOptions& options = {});
  /// The part over the window, in the frame of the whole: coordinates are computed from the
  /// whole's rows and columns, so that neighbours have the same wall between them, triangle by
  /// triangle, to the bit. @pre two nodes in each direction at least
  [[nodiscard]] static Result<GridSolidStream> create(const heightmap::ModelField& surface,
                                                      const NodeWindow& window,
                                                      const SolidOptions& options = {});
  [[nodiscard]] std::uint64_t vertex_count() const override;
  [[nodiscard]] std::uint64_t triangle_count() const override;
  void vertices(std::uint64_t first, std::span<Vec3> out) const override;
  void triangles(std::uint64_t first, std::span<Triangle> out) const override;
  void corners(std::uint64_t first, std::span<Corners> out) const override;

  /// MESHING_ROUNDING_COLLAPSES: rounding makes two columns or rows one, or brings a node onto
  /// the base; names the place and what to do. CORE_CANCELLED.
  [[nodiscard]] Result<MeshCertificate> certify(CoordinateRounding rounding,
                                                const RunContext& run = {}) const;

 private:
  struct Node {
    std::ptrdiff_t row, col;
  };
  GridSolidStream(const heightmap::ModelField& surface, const NodeWindow& window, double base_z_mm)
      : surface_(&surface), window_(window), base_z_mm_(base_z_mm) {}
  // Rows and columns count from the window's first ones.
  [[nodiscard]] std::ptrdiff_t rows() const { return window_.rows(); }
  [[nodiscard]] std::ptrdiff_t cols() const { return window_.cols(); }
  [[nodiscard]] double x_at(std::ptrdiff_t c) const { return surface_->x_mm(window_.col0 + c); }
  [[nodiscard]] double y_at(std::ptrdiff_t r) const { return surface_->y_mm(window_.row0 + r); }
  [[nodiscard]] float z_at(std::ptrdiff_t r, std::ptrdiff_t c) const {
    return surface_->z_mm(window_.row0 + r, window_.col0 + c);
  }
  [[nodiscard]] std::uint64_t rim_count() const;
  [[nodiscard]] std::uint64_t top_count() const;  ///< triangles of the top
  [[nodiscard]] Node rim(std::uint64_t i) const;  ///< counter-clockwise seen from above
  [[nodiscard]] std::uint32_t node_index(Node n) const;
  [[nodiscard]] Vec3 vertex(std::uint64_t i) const;
  [[nodiscard]] Triangle wall_or_base(std::uint64_t i) const;

  const heightmap::ModelField* surface_;
  NodeWindow window_;
  double base_z_mm_;
};

}  // namespace maquette::meshing

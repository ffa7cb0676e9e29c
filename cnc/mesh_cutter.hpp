// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file mesh_cutter.hpp
/// Lowest gouge-free height of a cutter over any triangle mesh (terrain with stones, overhangs,
/// closed or not, triangles of any size), and over a height grid with stones on it.
///
/// Takes   TriMesh, in which triangles may face either way, overlap and be degenerate; only what
///         is highest below the cutter counts
/// Gives   as cutter_location.hpp
///
/// Method. The contacts of contact.hpp over a tree of boxes (triangle_tree.hpp), the most promising
/// first; a box can ask for no more than its top less the underside's rise at its nearest point.
/// Of each group of eight triangles that could beat the best so far, bounds in single precision
/// are found at once, under a ball from the contacts themselves.
///
/// Accuracy. Rounding in double: |error| < 1e-9 mm where the surface is not steeper than 1000 : 1
/// and coordinates stay below 1 m; steeper, as if the axis stood 1e-12 mm elsewhere.
/// Cost. O(log n) and what is in reach; about 7 bytes a triangle beside the mesh.

#include <memory>

#include "cnc/cutter_location.hpp"
#include "core/tri_mesh.hpp"

namespace maquette::cnc {

/// Immutable; threads may share one, copies share the tree. Keeps a reference to the mesh.
class MeshCutter {
 public:
  /// @pre the mesh outlives this and all copies; it has triangles, finite coordinates and indices
  /// in range; tool as for DropCutter
  MeshCutter(const TriMesh& mesh, const Cutter& tool);
  MeshCutter(const TriMesh&& mesh, const Cutter& tool) = delete;

  /// The same (x, y) gives the same bits whatever was asked before.
  [[nodiscard]] CutterContact drop(double x_mm, double y_mm) const { return drop(x_mm, y_mm, {}); }
  /// `so_far` if the mesh asks for no more.
  [[nodiscard]] CutterContact drop(double x_mm, double y_mm, CutterContact so_far) const;
  /// As DropCutter's.
  [[nodiscard]] CutterContact drop_holder(double x_mm, double y_mm) const {
    return drop_holder(x_mm, y_mm, {});
  }
  [[nodiscard]] CutterContact drop_holder(double x_mm, double y_mm, CutterContact so_far) const;

  /// Of what stands beside the mesh.
  [[nodiscard]] std::size_t bytes() const;

 private:
  struct State;
  std::shared_ptr<const State> state_;
};

/// Ground with stones on it: the higher of both contacts, at little more than the ground's cost.
class GroundAndStones {
 public:
  /// @pre as for DropCutter and MeshCutter
  GroundAndStones(const heightmap::ModelField& ground, const TriMesh& stones, const Cutter& tool)
      : ground_(ground, tool), stones_(stones, tool) {}
  GroundAndStones(const heightmap::ModelField&, const TriMesh&&, const Cutter&) = delete;

  [[nodiscard]] CutterContact drop(double x_mm, double y_mm) const {
    return stones_.drop(x_mm, y_mm, ground_.drop(x_mm, y_mm));
  }
  [[nodiscard]] CutterContact drop_holder(double x_mm, double y_mm) const {
    return stones_.drop_holder(x_mm, y_mm, ground_.drop_holder(x_mm, y_mm));
  }

 private:
  DropCutter ground_;
  MeshCutter stones_;
};

}  // namespace maquette::cnc

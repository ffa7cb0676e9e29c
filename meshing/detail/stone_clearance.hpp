// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file stone_clearance.hpp
/// How far a stone is above the ground, straight down.
///
/// Between two triangulated surfaces the least gap is at a vertex of their overlay seen from above:
/// a vertex of the stone, a node of the ground under a face that looks down, or where an edge of
/// the stone crosses one of the ground. All three are looked at, so the least gap is exact.

#include <array>
#include <cmath>
#include <cstdint>
#include <vector>

#include "core/tri_mesh.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::meshing::detail {

struct StoneContact {
  Vec3 at;  ///< model frame, of the stone
  double gap_mm = 0.0;
};

class StoneClearance {
 public:
  /// @param stone  closed, millimetres, in its own frame; both are kept by reference
  StoneClearance(const TriMesh& stone, const heightmap::ModelField& surface);

  /// Looks up what may touch, or may have touched, before any point of the stone has moved by more
  /// than `reach_mm` from `pose`; the two below look at nothing else.
  /// @return false: not all of it is over the surface, or there is a void under it
  [[nodiscard]] bool gather(const RigidTransform& pose, double reach_mm);

  /// Or any gap below `enough_mm`, if there is one. NaN: not all over the surface.
  [[nodiscard]] double least_gap_mm(const RigidTransform& pose, double enough_mm = -INFINITY);
  /// All that is not farther than `within_mm`.
  [[nodiscard]] std::vector<StoneContact> contacts(const RigidTransform& pose, double within_mm);

 private:
  template <class Visit>
  void for_each(const RigidTransform& pose, const bool& done, Visit&& visit);
  [[nodiscard]] double steepest_under(const Box3& box) const;

  const TriMesh& stone_;
  const heightmap::ModelField& surface_;
  std::vector<std::array<std::uint32_t, 2>> edges_;
  std::vector<double> length_mm_;  ///< of the edges
  double longest_edge_mm_ = 0.0;

  // What gather has found; indices go into used_.
  std::vector<std::uint32_t> used_, slot_, touching_;
  std::vector<std::array<std::uint32_t, 2>> near_edges_;
  std::vector<std::array<std::uint32_t, 3>> near_faces_;
  std::vector<double> gap_;
  std::vector<Vec3> posed_;
};

}  // namespace maquette::meshing::detail

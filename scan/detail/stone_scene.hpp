// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file stone_scene.hpp
/// Rays against stone meshes (Embree inside).

#include <memory>
#include <optional>
#include <span>

#include "core/result.hpp"
#include "core/tri_mesh.hpp"

namespace maquette::scan::detail {

struct StoneHit {
  double distance_mm = 0.0;
  Vec3 normal;  ///< unit, of the triangle as it is wound
};

/// Keeps a reference to the meshes. Thread-safe.
class StoneScene {
 public:
  [[nodiscard]] static Result<StoneScene> build(std::span<const TriMesh> stones);
  StoneScene(StoneScene&&) noexcept;
  StoneScene& operator=(StoneScene&&) noexcept;
  ~StoneScene();

  /// Nearest hit nearer than `limit_mm`. Which triangle is hit is decided in single
  /// precision about the stones' middle (steps of about 1e-4 mm at 1 m); where on its
  /// plane, in double.
  [[nodiscard]] std::optional<StoneHit> trace(Vec3 origin_mm, Vec3 direction,
                                              double limit_mm) const;
  [[nodiscard]] const Box3& bounds() const;

 private:
  struct State;
  explicit StoneScene(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

/// Is the point inside the closed mesh? By solid angle: van Oosterom and Strackee 1983,
/// doi:10.1109/TBME.1983.325207.
[[nodiscard]] bool inside_mesh(const TriMesh& mesh, Vec3 p);

}  // namespace maquette::scan::detail

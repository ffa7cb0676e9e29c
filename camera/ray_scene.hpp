// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file ray_scene.hpp
/// Rays against triangle meshes, by Embree in robust mode (Wald et al. 2014,
/// doi:10.1145/2601097.2601199; watertight at edges: Woop et al. 2013, JCGT 2(1)).
///
/// Embree works in float. Vertices therefore go in relative to the middle of the
/// scene's box, rays start where they enter that box, and what is found is computed
/// again in double on the triangle as it stands in the TriMesh.

#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"
#include "core/vec.hpp"

namespace maquette::camera {

struct RayHit {
  double distance_mm = 0.0;  ///< along the ray
  Vec3 point_mm;
  Vec3 normal;               ///< unit, outward; zero for a triangle without area
  std::uint32_t object = 0;  ///< number of the mesh, in the order given
  std::uint32_t triangle = 0;
  bool front = true;  ///< the ray comes from outside
};

class RayScene {
 public:
  /// @param meshes  not copied: they must outlive the scene; at least one triangle
  ///                in all, every index in range
  /// @return CORE_CANCELLED; throws std::bad_alloc when memory runs out
  [[nodiscard]] static Result<RayScene> build(const std::vector<const TriMesh*>& meshes,
                                              const RunContext& run = {});
  RayScene(RayScene&&) noexcept;
  RayScene& operator=(RayScene&&) noexcept;
  ~RayScene();

  /// The first triangle along the ray, front or back. Of triangles that Embree meets
  /// at the very same distance the one with the lowest number, so that the answer
  /// does not depend on the order inside its tree. Thread-safe.
  /// @param direction  unit vector
  [[nodiscard]] std::optional<RayHit> first_hit(Vec3 origin_mm, Vec3 direction) const;

  /// Something stands between a surface point and `to_mm`. The ray starts
  /// offset_mm() off the surface. Thread-safe.
  [[nodiscard]] bool blocked(Vec3 point_mm, Vec3 normal, Vec3 to_mm) const;

  /// The point lies inside a closed solid or on its surface: straight up or
  /// straight down the first face is seen from its back or touches the point.
  [[nodiscard]] bool inside(Vec3 point_mm) const;

  /// Some float steps at the size of the scene: what the rounding of vertices and
  /// of the ray's start may move a point through its own triangle.
  [[nodiscard]] double offset_mm() const;

 private:
  struct State;
  explicit RayScene(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace maquette::camera

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file ray_scene.hpp
/// Rays against terrain and triangle meshes. Terrain is traced on its height grid
/// (heightmap/field_tracer.hpp), meshes by Embree in robust mode (Wald et al. 2014,
/// doi:10.1145/2601097.2601199; watertight at edges: Woop et al. 2013, JCGT 2(1)), with one tree
/// for a mesh that stands in several places.
///
/// Embree works in float. Vertices therefore go in relative to the middle of the
/// scene's box, rays start where they enter that box, and what is found is computed
/// again in double on the triangle as it stands in the TriMesh.
///
/// Of rays that are asked together each sixteen go through a terrain as a packet, and come to
/// Embree only if one of them may meet a mesh's box (detail/box_tree.hpp).

#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"
#include "core/vec.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::camera {

/// A mesh in a pose, or a terrain. Nothing is copied: what is pointed at must outlive the scene
/// and not change.
struct RayObject {
  const TriMesh* mesh = nullptr;  ///< one of the two; null both: nothing
  const heightmap::ModelField* field = nullptr;
  /// Where the terrain's walls end and its underside lies; NaN: it has none.
  double base_mm = std::numeric_limits<double>::quiet_NaN();
  RigidTransform model_from_mesh{};  ///< of a mesh
  double scale = 1.0;                ///< of a mesh, before it is moved; positive
};

struct RayHit {
  double distance_mm = 0.0;  ///< along the ray
  Vec3 point_mm;
  Vec3 normal;                 ///< unit, outward; zero for a triangle without area
  std::uint32_t object = 0;    ///< in the order given
  std::uint32_t triangle = 0;  ///< of a mesh
  bool front = true;           ///< the ray comes from outside
};

class RayScene {
 public:
  struct Ray {
    Vec3 origin_mm, direction;  ///< unit
  };
  /// From a point of a surface towards a place.
  struct ShadowRay {
    Vec3 point_mm, normal, to_mm;
  };

  /// @pre at least one triangle in all, every index in range
  /// @return CORE_CANCELLED; throws std::bad_alloc when memory runs out
  [[nodiscard]] static Result<RayScene> build(const std::vector<RayObject>& objects,
                                              const RunContext& run = {});
  RayScene(RayScene&&) noexcept;
  RayScene& operator=(RayScene&&) noexcept;
  ~RayScene();

  /// The first triangle along the ray, front or back. Of triangles that Embree meets
  /// at the very same distance the one with the lowest number, so that the answer
  /// does not depend on the order inside its tree. Thread-safe.
  [[nodiscard]] std::optional<RayHit> first_hit(Vec3 origin_mm, Vec3 direction) const;
  /// The same for rays that stay close together, faster; the same answers.
  /// @pre hits is as long as rays
  void first_hits(std::span<const Ray> rays, std::span<std::optional<RayHit>> hits) const;

  /// Something stands between a surface point and `to_mm`. The ray starts
  /// offset_mm() off the surface, off terrain a millionth of that. Thread-safe.
  [[nodiscard]] bool blocked(const ShadowRay& ray) const;
  /// The same for rays that stay close together, faster; the same answers.
  /// @pre blocked is as long as rays
  void blocked(std::span<const ShadowRay> rays, std::span<bool> blocked) const;

  /// The point lies inside a closed solid or on its surface: straight up or
  /// straight down the first face is seen from its back or touches the point.
  [[nodiscard]] bool inside(Vec3 point_mm) const;

  /// Some float steps at the size of the scene: what the rounding of vertices and
  /// of the ray's start may move a point through its own triangle.
  [[nodiscard]] double offset_mm() const;
  /// Box of all that is in the scene.
  [[nodiscard]] Box3 bounds() const;

 private:
  struct State;
  explicit RayScene(std::unique_ptr<State> state);
  std::unique_ptr<State> state_;
};

}  // namespace maquette::camera

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file shader.hpp
/// Radiance that leaves a surface point towards the camera.

#include <cstdint>
#include <span>
#include <vector>

#include "camera/lamp.hpp"
#include "camera/ray_scene.hpp"
#include "camera/render.hpp"

namespace maquette::camera::detail {

/// What a camera ray meets, and a place of a lamp's lens.
struct Seen {
  const RayHit* hit = nullptr;
  Vec3 view;  ///< of the ray
  DiscPoint lens{};
};
/// Light of one lamp there.
struct Lit {
  Bands radiance{};
  bool arrives = false;  ///< whether or not it goes on to the camera
};

class Shader {
 public:
  /// @param objects  those of the scene, in its order
  Shader(const RayScene& scene, const std::vector<SceneObject>& objects, const Lighting& lighting,
         const RenderOptions& options);

  [[nodiscard]] const std::vector<Light>& lights() const { return lights_; }
  [[nodiscard]] bool gathers() const { return gathers_; }

  /// Light of one lamp.
  [[nodiscard]] Lit direct(const Seen& seen, const Light& light) const;
  /// The same for what is close together: faster, the same bits.
  /// @pre at most 16, lit is as long as seen
  void direct(std::span<const Seen> seen, const Light& light, std::span<Lit> lit) const;
  /// Mean over `directions` of light from the surroundings and other surfaces.
  /// @param stream  of random numbers for this point
  [[nodiscard]] Bands gathered(const RayHit& hit, Vec3 view,
                               const std::vector<DiscPoint>& directions,
                               std::uint64_t stream) const;
  /// Radiance of the surroundings along a ray that meets nothing.
  [[nodiscard]] Bands background(Vec3 origin_mm, Vec3 direction) const;

 private:
  /// The lamp is in front of the surface and shines there.
  [[nodiscard]] static bool faces(const Seen& seen, const Light::Arrival& arrival);
  [[nodiscard]] RayScene::ShadowRay shadow_ray(const RayHit& hit,
                                               const Light::Arrival& arrival) const;
  [[nodiscard]] Lit unshadowed(const Seen& seen, const Light& light,
                               const Light::Arrival& arrival) const;
  [[nodiscard]] const Material& material_at(const RayHit& hit) const;
  [[nodiscard]] Bands reflected(const RayHit& hit, const Angles& angles) const;
  [[nodiscard]] Bands incoming(const RayHit& from, Vec3 direction, std::uint64_t stream) const;

  const RayScene& scene_;
  const std::vector<SceneObject>& objects_;
  const Lighting& lighting_;
  const RenderOptions& options_;
  std::vector<Light> lights_;
  double far_mm_;
  bool gathers_;
};

/// Two unit vectors that make a right-handed frame with the unit vector n.
[[nodiscard]] std::array<Vec3, 2> across(Vec3 n);

}  // namespace maquette::camera::detail

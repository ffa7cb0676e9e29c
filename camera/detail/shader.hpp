// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file shader.hpp
/// Radiance that leaves a surface point towards the camera.

#include <cstdint>
#include <vector>

#include "camera/lamp.hpp"
#include "camera/ray_scene.hpp"
#include "camera/render.hpp"

namespace maquette::camera::detail {

/// A camera ray and what it meets.
struct Seen {
  Vec3 direction;
  const RayHit* hit = nullptr;  ///< null: background
};

class Shader {
 public:
  Shader(const RayScene& scene, const std::vector<Material>& materials, const Lighting& lighting,
         const RenderOptions& options);

  [[nodiscard]] const std::vector<Light>& lights() const { return lights_; }
  [[nodiscard]] bool gathers() const { return gathers_; }

  /// Light of one lamp at a point, from the place `p` of its lens.
  /// @param arrives  becomes true if light arrives, whether or not it goes on to the camera
  [[nodiscard]] Bands direct(const RayHit& hit, Vec3 view, const Light& light, DiscPoint p,
                             bool& arrives) const;
  /// Mean over `directions` of light from the surroundings and other surfaces.
  /// @param stream  of random numbers for this point
  [[nodiscard]] Bands gathered(const RayHit& hit, Vec3 view,
                               const std::vector<DiscPoint>& directions,
                               std::uint64_t stream) const;
  /// Radiance of the surroundings along a ray that meets nothing.
  [[nodiscard]] Bands background(Vec3 origin_mm, Vec3 direction) const;

 private:
  [[nodiscard]] Bands reflected(const RayHit& hit, const Angles& angles) const;
  [[nodiscard]] Bands incoming(const RayHit& from, Vec3 direction, std::uint64_t stream) const;

  const RayScene& scene_;
  const std::vector<Material>& materials_;
  const Lighting& lighting_;
  const RenderOptions& options_;
  std::vector<Light> lights_;
  double far_mm_;
  bool gathers_;
};

/// Two unit vectors that make a right-handed frame with the unit vector n.
[[nodiscard]] std::array<Vec3, 2> across(Vec3 n);

}  // namespace maquette::camera::detail

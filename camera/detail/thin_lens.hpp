// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file thin_lens.hpp
/// Rays through points of a lens instead of its middle: what depth_of_field
/// (camera/effects/depth_of_field.hpp) comes near to, with nothing left out.
///
/// Room    camera:  [thin_lens] -> render
/// Takes   a camera's opening, its pose, the ray through the lens' middle
/// Gives   the ray from a point of the opening through the point in focus on that middle ray (Cook,
///         Porter, Carpenter 1984, doi:10.1145/964965.808590)
/// Frame   model frame, mm
///
/// The picture keeps the camera matrix's scale. The opening is as wide as makes circles of
/// confusion those of circle_of_confusion_mm(): f / N times s / (s - f), with f the focal length, N
/// the f-number, s the distance in focus.

#include "camera/disc_samples.hpp"
#include "camera/ray_scene.hpp"
#include "camera/render.hpp"
#include "core/vec.hpp"

namespace maquette::camera::detail {

class ThinLens {
 public:
  /// A pinhole.
  ThinLens() = default;
  /// @param focus_mm  along the axis, infinite allowed
  /// @pre lens.f_number > 0; focal length < focus_mm
  ThinLens(const CameraModel& camera, const RigidTransform& model_from_camera, double focus_mm);

  [[nodiscard]] bool open() const { return radius_mm_ > 0.0; }
  /// Point of the opening for a point of the disc, areas kept.
  [[nodiscard]] Vec3 place(DiscPoint p) const;
  /// @param direction  of the ray through the middle, unit
  [[nodiscard]] RayScene::Ray through(DiscPoint p, Vec3 direction) const;

 private:
  Vec3 middle_mm_, right_, down_, ahead_;
  double radius_mm_ = 0.0;  ///< of the disc; of a polygon with the disc's area
  double focus_mm_ = 0.0;
  int blades_ = 0;
  double turn_rad_ = 0.0;
};

}  // namespace maquette::camera::detail

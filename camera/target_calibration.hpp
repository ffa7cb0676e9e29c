// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file target_calibration.hpp
/// Camera matrix, distortion and poses from points whose places are known, seen in several
/// pictures.
///
/// Takes   points X, Y, Z (mm, of the target) and their places in pictures (pixels, (0, 0) the
/// upper
///         left corner, pixel centres at halves)
/// Method  bundle adjustment by Ceres with exact derivatives; poses to start with from homographies
///         (plane targets; Zhang 2000, doi:10.1109/34.888718) or the direct linear transform
///         (Hartley and Zisserman 2004, ISBN 978-0521540513, 7.1), at several focal lengths. Points
///         farther off than six robust standard deviations are left out and named.
/// Gives   values with covariance, from the scatter of the residuals: no noise has to be stated
///
/// The camera frame of this header is that of the picture: x right, y down, z forward.

#include <string>
#include <vector>

#include "camera/effects/distortion.hpp"
#include "camera/frame_series.hpp"
#include "core/result.hpp"
#include "core/vec.hpp"

namespace maquette::camera {

inline constexpr ErrorCode kCalibrationTargets{"CAMERA_CALIBRATION_TARGETS"};

struct TargetPoint {
  Vec3 target_mm;
  Vec2 seen_px;
  int view = 0;  ///< which picture, from 0
};

struct TargetOptions {
  std::string distortion = "brown_conrady";  ///< or quotient
  int coefficients = 5;                      ///< 0 to 8, in the order of Distortion
  bool principal_point = true, aspect = false, skew = false;  ///< what is not estimated stays
};

struct TargetView {
  RigidTransform camera_from_target;
  std::size_t points = 0;
  double rms_px = 0.0;  ///< of u and v together
};
struct TargetResidual {
  std::size_t point = 0;  ///< index of the input
  Vec2 off_px;            ///< seen - computed
  bool left_out = false;
};

struct TargetCalibration {
  Intrinsics intrinsics;
  Distortion distortion;
  /// Of each parameter in the order of `names`; 0: not estimated.
  Measured focal_px, aspect, cx_px, cy_px, skew_px;
  std::vector<Measured> coefficients;
  std::vector<std::string> names;               ///< of those estimated
  std::vector<std::vector<double>> covariance;  ///< of those estimated, in that order
  double noise_px = 0.0;                        ///< of one coordinate of a point
  std::vector<TargetView> views;
  std::vector<TargetResidual> residuals;  ///< in the order of the input
};

/// @param start  size of the picture; focal length, principal point, aspect and skew to start with
///               (focal length within a factor of four)
/// @return CAMERA_CALIBRATION_TARGETS: points that are not finite; a picture with fewer than four
///         (not in one plane: six) or with all on one line; one picture of one plane; fewer
///         measurements than unknowns; pictures that leave a parameter open, which is named; no
///         solution. CAMERA_EFFECT_OUT_OF_RANGE: options
[[nodiscard]] Result<TargetCalibration> calibrate_targets(const std::vector<TargetPoint>& points,
                                                          const Intrinsics& start,
                                                          const TargetOptions& options);

}  // namespace maquette::camera

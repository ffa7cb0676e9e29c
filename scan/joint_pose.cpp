// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/joint_pose.hpp"

#include <algorithm>
#include <cmath>

#include <Eigen/Core>

#include "core/check.hpp"

namespace maquette::scan {

Registration joint_pose(std::span<const ScanPose> scans) {
  double all = 0.0;
  for (const ScanPose& s : scans) all += static_cast<double>(s.points);
  MAQUETTE_CHECK(all > 0.0, "{} scans without a point", scans.size());
  Registration joint =
      std::max_element(scans.begin(), scans.end(), [](const ScanPose& a, const ScanPose& b) {
        return a.points < b.points;
      })->registration;
  Vec3 centre;
  for (const ScanPose& s : scans)
    centre += (static_cast<double>(s.points) / all) * s.registration.centre_mm;
  using Matrix6 = Eigen::Matrix<double, 6, 6, Eigen::RowMajor>;
  Matrix6 sum = Matrix6::Zero();
  for (const ScanPose& s : scans) {
    // A rotation w about c_k moves c by w x (c - c_k) beside the translation of c_k.
    const Vec3 arm = centre - s.registration.centre_mm;
    Matrix6 carry = Matrix6::Identity();
    carry.block<3, 3>(0, 3) << 0.0, arm.z, -arm.y, -arm.z, 0.0, arm.x, arm.y, -arm.x, 0.0;
    const double weight = static_cast<double>(s.points) / all;
    sum += weight * weight * carry * Eigen::Map<const Matrix6>(s.registration.covariance.data()) *
           carry.transpose();
  }
  Eigen::Map<Matrix6>(joint.covariance.data()) = sum;
  joint.centre_mm = centre;
  joint.sigma_translation_mm = joint.sigma_rotation_rad = 0.0;
  for (Eigen::Index k = 0; k < 3; ++k) {
    joint.sigma_translation_mm = std::fmax(joint.sigma_translation_mm, std::sqrt(sum(k, k)));
    joint.sigma_rotation_rad = std::fmax(joint.sigma_rotation_rad, std::sqrt(sum(k + 3, k + 3)));
  }
  return joint;
}

}  // namespace maquette::scan

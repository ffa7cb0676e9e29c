// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file joint_pose.hpp
/// Several scans of one part, each registered for itself, compared together: what their poses do to
/// a mean over points of all of them.
///
/// The poses are independent (each scan has its own noise), so at a place where a share w_k of the
/// points comes from scan k the mean's variance is the sum of w_k^2 times the variance that pose k
/// makes there. For the part as a whole (joint_pose) w_k is the scan's share of all points, and
/// the covariances are carried to one centre first.

#include <cstddef>
#include <span>

#include "scan/register.hpp"

namespace maquette::scan {

/// One scan's pose and how many of the points that lie one after another are its own.
struct ScanPose {
  Registration registration;
  std::size_t points = 0;
};

/// A registration whose pose_sigma_mm() is that of a mean over all points; its centre is the mean
/// of the scans' centres, its other fields are those of the scan with the most points.
/// @pre at least one scan with points
[[nodiscard]] Registration joint_pose(std::span<const ScanPose> scans);

}  // namespace maquette::scan

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file find_spheres.hpp
/// Reference spheres in a cloud whose pose nobody knows, and the pose that they give.
///
/// Room     scan:  cloud, radii -> [find_spheres] -> [match_spheres] -> register_scan,
/// register_datums
///
/// Places   The cloud in voxels of a fifth of the radius, a normal each (surfels.hpp). Each votes
/// for
///          the centre that its normal points away from (both sides if no station is known); cells
///          of a quarter of the radius that collect votes of twelve voxels are places (a Hough
///          transform with gradients: Kimme, Ballard and Sklansky 1975, doi:10.1145/360666.360677).
/// Fit      Centre alone, the radius is known: Gauss-Newton with Tukey's weights on the distances
///          from the sphere.
/// Accepted if
///            - at least an eighth of the sphere is seen (of 96 cells of equal area);
///            - the means over these cells lie on the sphere to 1 % of the radius, beyond what
///            noise
///              does: a stone that is nearly round does not;
///            - a fit with free radius gives the known one to three standard deviations and 1 %.
/// Match    Three spheres whose mutual distances are those of three datums give a pose; the pose
///          that brings most spheres onto datums counts, by least squares with the centres'
///          covariances (Horn 1987, doi:10.1364/JOSAA.4.000629, then Gauss-Newton). Spheres that
///          are no datum and datums that were not seen are left out.

#include <array>
#include <span>
#include <string>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "scan/cloud.hpp"
#include "scan/datums.hpp"

namespace maquette::scan {

inline constexpr ErrorCode kSpheres{"SCAN_SPHERES"};

struct FoundSphere {
  Vec3 centre_mm;  ///< in the cloud's frame
  double radius_mm = 0.0;
  std::array<double, 9> covariance{};  ///< of the centre, mm^2
  double sigma_mm = 0.0;               ///< largest standard deviation of the centre
  double noise_mm = 0.0;               ///< of single points
  double form_mm = 0.0;                ///< of the means over cells, without noise
  double seen = 0.0;                   ///< share of the sphere that has points
  std::size_t points = 0;
};

/// Cost: some 0.4 us a point and radius, beside the voxels' normals.
/// @param radii_mm  of the spheres that may be there; each is looked for
/// @return the spheres, those seen best first; empty if there are none.
///   SCAN_SPHERES: a radius is not positive, or so small against the cloud that voxels of a fifth
///   of it do not fit into 2^21 an axis; CORE_CANCELLED
[[nodiscard]] Result<std::vector<FoundSphere>> find_spheres(const Cloud& cloud,
                                                            std::span<const double> radii_mm,
                                                            const RunContext& run = {});

struct SphereMatch {
  RigidTransform model_from_scan;
  Registration registration;         ///< pose and covariance about the matched centres' mean
  std::vector<std::string> matched;  ///< names of datums, in the order of `residual_mm`
  std::vector<double> residual_mm;   ///< distance of each sphere from its datum
  std::vector<std::string> missing;  ///< datums that no sphere was found for
};

/// @param datums  those of kind sphere count
/// @param match_mm  distances and centres agree to this and three standard deviations
/// @return the pose, or SCAN_SPHERES: fewer than three matched, all nearly on one line, or two
/// poses
///   that bring as many spheres onto datums (an arrangement with a symmetry): the message says
///   which
[[nodiscard]] Result<SphereMatch> match_spheres(std::span<const FoundSphere> found,
                                                std::span<const Datum> datums,
                                                double match_mm = 0.5);

}  // namespace maquette::scan

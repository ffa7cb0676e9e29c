// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file stone_fit.hpp
/// Pose of one stone from ranges: what a scanner would measure is computed, and the pose moved
/// until it is what was measured.
///
/// Which points count is decided by where their beams meet the stone at the pose, which does not
/// depend on their noise. Choosing points by where they came to lie (above the ground, nearest to
/// the stone) keeps noise to one side: at 0.2 mm it lifted a stone of 9 mm by 0.015 mm and tilted
/// it by a degree. Residuals along the line of sight, Tukey's weights; a beam's range is the mean
/// of its rays' ranges by energy and cosine, which is what phases say while they differ by little.
/// Beams that pass an edge are followed by more rays (sight.hpp): few err, and the same few say how
/// much a beam counts and how the pose moves it, so that stones came out low.
/// Covariance: sandwich, by angle of incidence.

#include <span>
#include <vector>

#include <Eigen/Core>

#include "heightmap/height_field.hpp"
#include "scan/detail/sight.hpp"
#include "scan/detail/stone_scene.hpp"
#include "scan/find_stones.hpp"

namespace maquette::scan::detail {

/// Measured ranges about a stone, and where the ground is along their rays: nothing of it depends
/// on the stone's pose.
struct StoneRanges {
  struct Ray {
    Vec3 from_mm, direction;
    BeamSample sample;       ///< place in the beam and share of its energy
    double ground_mm = 0.0;  ///< distance of the ground; infinite: none
    double ground_cos = 0.0;
  };
  struct Range {
    std::size_t point = 0;  ///< index in the list of points
    double range_mm = 0.0;
    std::size_t first = 0, rays = 0;
    std::size_t edge_rays = 0;  ///< after those: for where the beam passes an edge
  };
  std::vector<Ray> rays;
  std::vector<Range> ranges;
};

/// The pose's unknowns: translation of the middle, and rotation about it times `arm_mm`.
struct StoneFrame {
  Vec3 middle_mm;
  double arm_mm = 1.0;
};

struct StoneFit {
  RigidTransform actual_from_planned;
  Eigen::Matrix<double, 6, 6> covariance = Eigen::Matrix<double, 6, 6>::Zero();
  Eigen::MatrixXd kept;        ///< columns: directions that the points determine
  double noise_mm = INFINITY;  ///< robust, of ranges; infinite: did not come to rest
  std::vector<std::size_t> points;
};

struct StoneNoise {
  double range_mm = 0.1;  ///< of single points, roughly: what edges in a beam are compared with
  double seam_mm = 0.0;   ///< hits less than that above the ground do not count
};

/// @param stone  one mesh at its planned pose
[[nodiscard]] StoneFit fit_stone(const StoneRanges& seen, const StoneScene& stone,
                                 const heightmap::ModelField& ground, const StoneFrame& frame,
                                 const RigidTransform& start, const StoneNoise& noise);

/// What the ranges say of the stone's size with its pose left free, at the fit: by a share of all
/// lengths, and by a length that its surface stands farther out. A few steps are
/// needed: far from the size the rim, which says most of it, does not count.
[[nodiscard]] StoneSizeTerms size_terms(const StoneRanges& seen, const StoneScene& stone,
                                        const heightmap::ModelField& ground,
                                        const StoneFrame& frame, const StoneFit& fit,
                                        const StoneNoise& noise);

/// Probability that ranges pull as hard away from the plan as these do if the stone stands there:
/// score test (Rao 1948, doi:10.1017/S0305004100023987) with Huber's psi. Its distribution under
/// the plan does not depend on whether the fit is linear over its own uncertainty, which the pose
/// of a small stone under a wide beam is not.
/// @param scan_pose  covariance of the whole scan's pose in the unknowns of `frame`
[[nodiscard]] double chance_of_standing(const StoneRanges& seen, const StoneScene& stone,
                                        const heightmap::ModelField& ground,
                                        const StoneFrame& frame, const StoneFit& fit,
                                        const Eigen::Matrix<double, 6, 6>& scan_pose,
                                        const StoneNoise& noise);

}  // namespace maquette::scan::detail

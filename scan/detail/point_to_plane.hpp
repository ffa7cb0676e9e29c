// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file point_to_plane.hpp
/// Residuals of points against a height field and their normal equations.

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include <Eigen/Core>

#include "core/vec.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::scan::detail {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

/// Distance of a point from the plane of the triangle above or below it.
struct PlaneResidual {
  double e_mm;  ///< positive above; NaN: beside the field or over a void
  double n_x, n_y, n_z;
};
[[nodiscard]] PlaneResidual plane_residual(const heightmap::ModelField& field, Vec3 p);

/// The six unknowns are all in mm: translation, and rotation times `arm_mm`, about
/// `centre`, so that eigenvalues of the normal matrix compare with each other.
struct Frame6 {
  Vec3 centre_mm;
  double arm_mm = 1.0;
};

struct Sums {
  Matrix6 weighted = Matrix6::Zero();  ///< sum of w J J', w = psi(e) / e (Huber)
  Matrix6 bread = Matrix6::Zero();     ///< sum of psi'(e) J J'
  Matrix6 meat = Matrix6::Zero();      ///< sum of psi(e)^2 J J'
  Vector6 gradient = Vector6::Zero();  ///< sum of psi(e) J
  double weight = 0.0;                 ///< sum of w
  double square = 0.0;                 ///< sum of e^2
  std::size_t count = 0;               ///< points on the field
};

/// Over all points, in chunks of fixed size joined in order.
[[nodiscard]] Sums accumulate(std::span<const Vec3> points, const RigidTransform& pose,
                              const heightmap::ModelField& field, const Frame6& frame,
                              double huber_mm);

/// Mean and root mean square arm of the points that lie on the field, and how many do.
struct Spread {
  Frame6 frame;
  std::size_t count = 0;
};
[[nodiscard]] Spread spread_on(std::span<const Vec3> points, const RigidTransform& pose,
                               const heightmap::ModelField& field);

/// 1.4826 median |e| of the points on the field; NaN if there are none.
[[nodiscard]] double robust_scale(std::span<const Vec3> points, const RigidTransform& pose,
                                  const heightmap::ModelField& field);

/// Every 2^level-th node, each the [1 2 1] x [1 2 1] mean of the level below; voids are
/// left out of the mean. Node (0, 0) stays where it is.
[[nodiscard]] heightmap::ModelField coarser(const heightmap::ModelField& field);

/// Names of a null space: columns of `basis` (unknowns of Frame6).
[[nodiscard]] std::vector<std::string> name_directions(const Eigen::MatrixXd& basis);

}  // namespace maquette::scan::detail

// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/detail/target_poses.hpp"

#include <Eigen/Dense>

namespace maquette::camera::detail {
namespace {

/// Root mean square extents along the three principal axes, and the axes (columns, longest first).
struct Axes {
  Eigen::Vector3d middle, extent;
  Eigen::Matrix3d axes;
};
Axes axes_of(const std::vector<Vec3>& points) {
  const auto n = static_cast<double>(points.size());
  Axes a;
  a.middle.setZero();
  for (const Vec3& p : points) a.middle += Eigen::Vector3d(p.x, p.y, p.z) / n;
  Eigen::Matrix3d scatter = Eigen::Matrix3d::Zero();
  for (const Vec3& p : points) {
    const Eigen::Vector3d d = Eigen::Vector3d(p.x, p.y, p.z) - a.middle;
    scatter += d * d.transpose() / n;
  }
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver(scatter);
  for (int k = 0; k < 3; ++k) {
    a.extent(k) = std::sqrt(std::max(0.0, solver.eigenvalues()(2 - k)));
    a.axes.col(k) = solver.eigenvectors().col(2 - k);
  }
  if (a.axes.determinant() < 0.0) a.axes.col(2) *= -1.0;
  return a;
}

/// The vector that A maps to the least.
Eigen::VectorXd null_vector(const Eigen::MatrixXd& a) {
  const Eigen::SelfAdjointEigenSolver<Eigen::MatrixXd> solver(a.transpose() * a);
  return solver.eigenvectors().col(0);
}

/// The rotation nearest to a matrix.
Eigen::Matrix3d nearest_rotation(const Eigen::Matrix3d& m) {
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(m, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d u = svd.matrixU();
  if ((u * svd.matrixV().transpose()).determinant() < 0.0) u.col(2) *= -1.0;
  return u * svd.matrixV().transpose();
}

RigidTransform transform_of(const Eigen::Matrix3d& rotation, const Eigen::Vector3d& shift) {
  const Eigen::Quaterniond q(rotation);
  return {normalized(Quaternion{q.w(), q.x(), q.y(), q.z()}), {shift.x(), shift.y(), shift.z()}};
}

}  // namespace

Spread spread_of(const std::vector<Vec3>& points) {
  const Axes a = axes_of(points);
  constexpr double kThin = 0.01;  // of the width: a starting pose cannot use less depth
  if (!(a.extent(1) > 1e-4 * a.extent(0))) return Spread::line;
  return a.extent(2) > kThin * a.extent(0) ? Spread::space : Spread::plane;
}

std::optional<RigidTransform> pose_of(const std::vector<Vec3>& points,
                                      const std::vector<Vec2>& tangents, Spread spread) {
  const Axes a = axes_of(points);
  const double scale = 1.0 / a.extent(0);
  const bool plane = spread == Spread::plane;
  const Eigen::Index unknown = plane ? 9 : 12, width = plane ? 3 : 4;
  Eigen::MatrixXd equations =
      Eigen::MatrixXd::Zero(2 * static_cast<Eigen::Index>(points.size()), unknown);
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vec3& p = points[i];
    const Eigen::Vector3d local =
        scale * (a.axes.transpose() * (Eigen::Vector3d(p.x, p.y, p.z) - a.middle));
    Eigen::RowVectorXd h(width);
    if (plane)
      h << local.x(), local.y(), 1.0;
    else
      h << local.x(), local.y(), local.z(), 1.0;
    const auto row = 2 * static_cast<Eigen::Index>(i);
    equations.block(row, 0, 1, width) = h;
    equations.block(row, 2 * width, 1, width) = -tangents[i].x * h;
    equations.block(row + 1, width, 1, width) = h;
    equations.block(row + 1, 2 * width, 1, width) = -tangents[i].y * h;
  }
  const Eigen::VectorXd v = null_vector(equations);
  Eigen::Matrix<double, 3, Eigen::Dynamic> m(3, width);
  for (Eigen::Index r = 0; r < 3; ++r) m.row(r) = v.segment(r * width, width).transpose();
  Eigen::Matrix3d rotation;
  double length = 0.0;
  if (plane) {
    length = 0.5 * (m.col(0).norm() + m.col(1).norm());
    if (!(length > 1e-12)) return std::nullopt;
    if (m(2, 2) < 0.0) m = -m;  // the target's middle lies before the camera
    rotation.col(0) = m.col(0) / length, rotation.col(1) = m.col(1) / length;
    rotation.col(2) = rotation.col(0).cross(rotation.col(1));
  } else {
    if (m(2, 3) < 0.0) m = -m;
    rotation = m.leftCols(3);
    length = std::cbrt(std::abs(rotation.determinant()));
    if (!(length > 1e-12)) return std::nullopt;
    rotation /= length;
  }
  rotation = nearest_rotation(rotation);
  const Eigen::Vector3d shift = m.col(width - 1) / (length * scale);
  if (!rotation.allFinite() || !shift.allFinite() || !(shift.z() > 0.0)) return std::nullopt;
  // From the target's own axes and middle back to its frame.
  const Eigen::Matrix3d whole = rotation * a.axes.transpose();
  return transform_of(whole, shift - whole * a.middle);
}

}  // namespace maquette::camera::detail

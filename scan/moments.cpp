// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/moments.hpp"

#include <cmath>

#include <Eigen/Eigenvalues>

namespace maquette::scan::detail {

void Moments::add(const Moments& m, Vec3 o) {
  n += m.n;
  sum += m.sum + m.n * o;
  xx += m.xx + 2 * o.x * m.sum.x + m.n * o.x * o.x;
  xy += m.xy + o.x * m.sum.y + o.y * m.sum.x + m.n * o.x * o.y;
  xz += m.xz + o.x * m.sum.z + o.z * m.sum.x + m.n * o.x * o.z;
  yy += m.yy + 2 * o.y * m.sum.y + m.n * o.y * o.y;
  yz += m.yz + o.y * m.sum.z + o.z * m.sum.y + m.n * o.y * o.z;
  zz += m.zz + 2 * o.z * m.sum.z + m.n * o.z * o.z;
}

std::optional<Plane> plane_of(const Moments& m) {
  if (m.n < 6.0) return std::nullopt;
  const Vec3 mean = (1.0 / m.n) * m.sum;
  const double xy = m.xy / m.n - mean.x * mean.y, xz = m.xz / m.n - mean.x * mean.z,
               yz = m.yz / m.n - mean.y * mean.z;
  Eigen::Matrix3d scatter;
  scatter << m.xx / m.n - mean.x * mean.x, xy, xz, xy, m.yy / m.n - mean.y * mean.y, yz, xz, yz,
      m.zz / m.n - mean.z * mean.z;
  Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> solver;
  solver.computeDirect(scatter);
  const Eigen::Vector3d& spread = solver.eigenvalues();
  if (!(spread(1) > 4.0 * std::fmax(spread(0), 0.0)) || !(spread(1) > 0.02 * spread(2)))
    return std::nullopt;
  const Eigen::Vector3d least = solver.eigenvectors().col(0);
  return Plane{{least.x(), least.y(), least.z()}, std::sqrt(std::fmax(0.0, spread(0)))};
}

}  // namespace maquette::scan::detail

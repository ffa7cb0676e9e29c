// SPDX-License-Identifier: GPL-3.0-or-later

// What a null space of the pose means to a person: screws (a rotation about an axis, with or
// without a shift along it), shifts, and scale.

#include <algorithm>
#include <cmath>
#include <optional>

#include <fmt/format.h>
#include <Eigen/Dense>

#include "scan/detail/normal_equations.hpp"

namespace maquette::scan::detail {
namespace {

/// "translation x", or "translation along (0.71, 0.71, 0)" when no axis dominates.
std::string name_part(const char* kind, const char* link, Vec3 v, bool about = false) {
  const Vec3 d = (1.0 / norm(v)) * v;
  const auto tidy = [](double a) { return std::abs(a) < 0.005 ? 0.0 : a; };
  const auto axis = [&](const char* name) {
    return about ? fmt::format("{} {} {}", kind, link, name) : fmt::format("{} {}", kind, name);
  };
  if (std::abs(d.x) > 0.99) return axis("x");
  if (std::abs(d.y) > 0.99) return axis("y");
  if (std::abs(d.z) > 0.99) return axis("z");
  return fmt::format("{} {} ({:.2f}, {:.2f}, {:.2f})", kind, link, tidy(d.x), tidy(d.y), tidy(d.z));
}

std::string at_point(Vec3 p) {
  const auto tidy = [](double a) { return std::abs(a) < 0.05 ? 0.0 : a; };
  return fmt::format(" through ({:.1f}, {:.1f}, {:.1f})", tidy(p.x), tidy(p.y), tidy(p.z));
}

/// Three turns that all keep one point where it is: a sphere. Its centre from the centroid.
std::optional<Vec3> common_centre(const Eigen::MatrixXd& basis, double arm_mm) {
  if (basis.cols() != 3) return std::nullopt;
  Eigen::Matrix<double, 9, 3> cross_rows;
  Eigen::Matrix<double, 9, 1> right;
  for (Eigen::Index k = 0; k < 3; ++k) {
    const Eigen::Vector3d t = basis.block<3, 1>(0, k), w = basis.block<3, 1>(3, k) / arm_mm;
    if (w.norm() * arm_mm < 0.05) return std::nullopt;
    // The shift of point c + q is t + w x q.
    cross_rows.block<3, 3>(3 * k, 0) << 0, -w(2), w(1), w(2), 0, -w(0), -w(1), w(0), 0;
    right.segment<3>(3 * k) = -t;
  }
  const Eigen::JacobiSVD<Eigen::Matrix<double, 9, 3>> svd(
      cross_rows, Eigen::ComputeFullU | Eigen::ComputeFullV);
  if (svd.singularValues()(2) < 0.1 * svd.singularValues()(0)) return std::nullopt;
  const Eigen::Vector3d q = svd.solve(right);
  if ((cross_rows * q - right).norm() > 0.02 * std::sqrt(3.0)) return std::nullopt;
  return Vec3{q(0), q(1), q(2)};
}

}  // namespace

std::vector<std::string> name_directions(const Eigen::MatrixXd& basis, const Frame& frame) {
  if (basis.cols() == 0) return {};
  if (const auto centre = common_centre(basis, frame.arm_mm)) {
    const std::string where = at_point(frame.centre_mm + *centre);
    return {"rotation about x" + where, "rotation about y" + where, "rotation about z" + where};
  }
  // Any rotation of a basis spans the same space; reduced echelon form is the one that
  // people would write down: as few axes per direction as possible.
  Eigen::MatrixXd rows = basis.transpose();
  std::vector<std::pair<Eigen::Index, Eigen::Index>> order;  // pivot column, row
  for (Eigen::Index k = 0; k < rows.rows(); ++k) {
    Eigen::Index row = 0, column = 0;
    rows.bottomRows(rows.rows() - k).cwiseAbs().maxCoeff(&row, &column);
    rows.row(k).swap(rows.row(k + row));
    rows.row(k) /= rows(k, column);
    for (Eigen::Index i = 0; i < rows.rows(); ++i)
      if (i != k) rows.row(i) -= rows(i, column) * rows.row(k);
    order.emplace_back(column, k);
  }
  std::sort(order.begin(), order.end());
  std::vector<std::string> names;
  for (const auto& entry : order) {
    const auto v = rows.row(entry.second);
    const Vec3 shift{v(0), v(1), v(2)}, turn{v(3), v(4), v(5)};
    const double growth = v.size() > 6 ? std::abs(v(6)) : 0.0;
    constexpr double kShown = 0.05;
    const double whole = std::hypot(norm(shift), norm(turn), growth);
    const bool turns = norm(turn) > kShown * whole, grows = growth > kShown * whole;
    std::string name;
    if (turns && !grows) {
      const Vec3 axis = normalized(turn);
      const double pitch = dot(shift, axis);
      const Vec3 off = (frame.arm_mm / norm(turn)) * cross(axis, shift);
      const bool aside = norm(off) > kShown * frame.arm_mm;
      name = name_part("rotation", "about", turn, aside);
      if (aside) name += at_point(frame.centre_mm + off);
      if (std::abs(pitch) > kShown * whole) name += " with translation along it";
    } else {
      if (norm(shift) > kShown * whole) name = name_part("translation", "along", shift);
      if (turns) name += (name.empty() ? "" : " with ") + name_part("rotation", "about", turn);
      if (grows) name += name.empty() ? "scale" : " with scale";
    }
    names.push_back(name);
  }
  return names;
}

}  // namespace maquette::scan::detail

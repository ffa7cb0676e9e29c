// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/majority_step.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include <Eigen/Dense>

#include "core/median.hpp"
#include "scan/detail/normal_equations.hpp"
#include "scan/register.hpp"

namespace maquette::scan::detail {
namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

constexpr double kCellsASide = 48.0;
constexpr double kLeastPoints = 10.0;
constexpr std::size_t kLeastCells = 100;
constexpr double kTukey = 4.685, kHuber = 1.345;
constexpr int kHuberRounds = 10, kRounds = 60;

struct CellSum {
  double n = 0.0, e = 0.0;
  Vector6 j = Vector6::Zero();
};

std::vector<CellSum> cells_of(std::span<const Vec3> points, const heightmap::ModelField& surface,
                              Vec3 centre, double arm) {
  Box3 box;
  for (const Vec3& p : points) box.add(p);
  const double side =
      std::fmax(1e-9, std::fmax(box.max.x - box.min.x, box.max.y - box.min.y)) / kCellsASide;
  const auto cols = static_cast<std::ptrdiff_t>((box.max.x - box.min.x) / side) + 1;
  const auto rows = static_cast<std::ptrdiff_t>((box.max.y - box.min.y) / side) + 1;
  std::vector<CellSum> cells(static_cast<std::size_t>(rows * cols));
  const FieldSurface field(surface);
  for (const Vec3& p : points) {
    Foot foot;
    field.feet({&p, 1}, {&foot, 1});
    if (std::isnan(foot.e_mm)) continue;
    const auto c = static_cast<std::ptrdiff_t>((p.x - box.min.x) / side),
               r = static_cast<std::ptrdiff_t>((p.y - box.min.y) / side);
    CellSum& cell = cells[static_cast<std::size_t>(r * cols + c)];
    const auto j = pose_columns(p, foot.normal, centre);
    cell.n += 1.0;
    cell.e += foot.e_mm;
    for (std::size_t a = 0; a < 6; ++a)
      cell.j(static_cast<Eigen::Index>(a)) += a < 3 ? j[a] : j[a] / arm;
  }
  std::erase_if(cells, [](const CellSum& c) { return c.n < kLeastPoints; });
  for (CellSum& c : cells) c.e /= c.n, c.j /= c.n;
  return cells;
}

}  // namespace

RigidTransform majority_step(std::span<const Vec3> points, const heightmap::ModelField& surface) {
  Box3 box;
  for (const Vec3& p : points) box.add(p);
  const Vec3 centre = 0.5 * (box.min + box.max);
  const double arm = std::fmax(1e-9, 0.5 * norm(box.max - box.min));
  const std::vector<CellSum> cells = cells_of(points, surface, centre, arm);
  if (cells.size() < kLeastCells) return {};
  Vector6 t = Vector6::Zero();
  std::vector<double> scores(cells.size());
  for (int round = 0; round < kRounds; ++round) {
    for (std::size_t i = 0; i < cells.size(); ++i)
      scores[i] = (cells[i].e + cells[i].j.dot(t)) * std::sqrt(cells[i].n);
    const double scale = std::fmax(1e-9, nmad(scores));
    Matrix6 normal = Matrix6::Zero();
    Vector6 right = Vector6::Zero();
    for (std::size_t i = 0; i < cells.size(); ++i) {
      const double u = std::abs(scores[i]) / scale, v = u / kTukey;
      const double weight = round < kHuberRounds ? (u <= kHuber ? 1.0 : kHuber / u)
                                                 : (v < 1.0 ? (1.0 - v * v) * (1.0 - v * v) : 0.0);
      normal += weight * cells[i].n * cells[i].j * cells[i].j.transpose();
      right -= weight * cells[i].n * cells[i].e * cells[i].j;
    }
    const Eigen::SelfAdjointEigenSolver<Matrix6> eigen(normal);
    // A shape that leaves a direction free is the registration's to judge.
    if (eigen.eigenvalues()(0) < 1e-6 * eigen.eigenvalues()(5)) return {};
    const Vector6 next = eigen.eigenvectors() * (eigen.eigenvalues().cwiseInverse().asDiagonal() *
                                                 (eigen.eigenvectors().transpose() * right));
    const double moved = (next - t).norm();
    t = next;
    if (round >= kHuberRounds && moved < 1e-6) break;
  }
  const Vec3 turn = (1.0 / arm) * Vec3{t(3), t(4), t(5)};
  RigidTransform step;
  if (const double angle = norm(turn); angle > 0.0)
    step.rotation = rotation_about((1.0 / angle) * turn, angle);
  step.translation_mm = centre - rotate(step.rotation, centre) + Vec3{t(0), t(1), t(2)};
  return step;
}

}  // namespace maquette::scan::detail

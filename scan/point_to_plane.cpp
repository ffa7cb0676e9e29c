// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/point_to_plane.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

namespace maquette::scan::detail {

using heightmap::ModelField;

namespace {
constexpr std::size_t kChunk = 8192;
}

PlaneResidual plane_residual(const ModelField& f, Vec3 p) {
  const double s = f.spacing.value();
  const double u = (p.x - f.x0.value()) / s, v = (p.y - f.y0.value()) / s;
  const std::ptrdiff_t cols = f.z_mm.cols(), rows = f.z_mm.rows();
  if (!(u >= 0.0 && v >= 0.0 && u <= static_cast<double>(cols - 1) &&
        v <= static_cast<double>(rows - 1)))
    return {NAN, 0.0, 0.0, 1.0};
  const auto c = std::min(static_cast<std::ptrdiff_t>(u), cols - 2);
  const auto r = std::min(static_cast<std::ptrdiff_t>(v), rows - 2);
  const double du = u - static_cast<double>(c), dv = v - static_cast<double>(r);
  const auto z00 = static_cast<double>(f.z_mm(r, c));
  const auto z11 = static_cast<double>(f.z_mm(r + 1, c + 1));
  double rise_x, rise_y;
  if (du >= dv) {
    const auto z10 = static_cast<double>(f.z_mm(r, c + 1));
    rise_x = z10 - z00;
    rise_y = z11 - z10;
  } else {
    const auto z01 = static_cast<double>(f.z_mm(r + 1, c));
    rise_x = z11 - z01;
    rise_y = z01 - z00;
  }
  const double h = z00 + du * rise_x + dv * rise_y;
  const double n_z = s / std::sqrt(rise_x * rise_x + rise_y * rise_y + s * s);
  return {(p.z - h) * n_z, -rise_x / s * n_z, -rise_y / s * n_z, n_z};
}

Sums accumulate(std::span<const Vec3> points, const RigidTransform& pose, const ModelField& field,
                const Frame6& frame, double huber_mm) {
  const std::size_t chunks = (points.size() + kChunk - 1) / kChunk;
  std::vector<Sums> parts(chunks);
  oneapi::tbb::parallel_for(std::size_t{0}, chunks, [&](std::size_t k) {
    Sums s;
    const std::size_t end = std::min(points.size(), (k + 1) * kChunk);
    for (std::size_t i = k * kChunk; i < end; ++i) {
      const Vec3 p = pose.point(points[i]);
      const PlaneResidual r = plane_residual(field, p);
      if (std::isnan(r.e_mm)) continue;
      const Vec3 n{r.n_x, r.n_y, r.n_z};
      const Vec3 turn = (1.0 / frame.arm_mm) * cross(p - frame.centre_mm, n);
      Vector6 j;
      j << n.x, n.y, n.z, turn.x, turn.y, turn.z;
      const bool inside = std::abs(r.e_mm) <= huber_mm;
      const double psi = inside ? r.e_mm : std::copysign(huber_mm, r.e_mm);
      const double w = inside ? 1.0 : huber_mm / std::abs(r.e_mm);
      const Matrix6 jj = j * j.transpose();
      s.weighted += w * jj;
      if (inside) s.bread += jj;
      s.meat += psi * psi * jj;
      s.gradient += psi * j;
      s.weight += w;
      s.square += r.e_mm * r.e_mm;
      ++s.count;
    }
    parts[k] = s;
  });
  Sums all;
  for (const Sums& s : parts) {
    all.weighted += s.weighted;
    all.bread += s.bread;
    all.meat += s.meat;
    all.gradient += s.gradient;
    all.weight += s.weight;
    all.square += s.square;
    all.count += s.count;
  }
  return all;
}

Spread spread_on(std::span<const Vec3> points, const RigidTransform& pose,
                 const ModelField& field) {
  Spread s;
  Vec3 sum;
  const auto on_field = [&](Vec3 p) { return !std::isnan(plane_residual(field, p).e_mm); };
  for (const Vec3& q : points)
    if (const Vec3 p = pose.point(q); on_field(p)) {
      sum += p;
      ++s.count;
    }
  if (s.count == 0) return s;
  s.frame.centre_mm = (1.0 / static_cast<double>(s.count)) * sum;
  double square = 0.0;
  for (const Vec3& q : points)
    if (const Vec3 p = pose.point(q); on_field(p)) {
      const Vec3 arm = p - s.frame.centre_mm;
      square += dot(arm, arm);
    }
  s.frame.arm_mm = std::fmax(1e-3, std::sqrt(square / static_cast<double>(s.count)));
  return s;
}

double robust_scale(std::span<const Vec3> points, const RigidTransform& pose,
                    const ModelField& field) {
  std::vector<double> e;
  e.reserve(points.size());
  for (const Vec3& q : points)
    if (const double r = plane_residual(field, pose.point(q)).e_mm; !std::isnan(r))
      e.push_back(std::abs(r));
  if (e.empty()) return NAN;
  const auto middle = e.begin() + static_cast<std::ptrdiff_t>(e.size() / 2);
  std::nth_element(e.begin(), middle, e.end());
  return 1.4826 * *middle;
}

ModelField coarser(const ModelField& f) {
  const std::ptrdiff_t rows = (f.z_mm.rows() - 1) / 2 + 1, cols = (f.z_mm.cols() - 1) / 2 + 1;
  ModelField out{Grid<float>(rows, cols), 2.0 * f.spacing, f.x0, f.y0};
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      double sum = 0.0, weight = 0.0;
      // At the border the mirror image is taken, so that a slope keeps its height there.
      for (std::ptrdiff_t i = -1; i <= 1; ++i)
        for (std::ptrdiff_t j = -1; j <= 1; ++j) {
          if (!f.z_mm.contains(2 * r + i, 2 * c + j) || !f.z_mm.contains(2 * r - i, 2 * c - j))
            continue;
          const auto h = static_cast<double>(f.z_mm(2 * r + i, 2 * c + j));
          if (std::isnan(h)) continue;
          const double w = (i == 0 ? 2.0 : 1.0) * (j == 0 ? 2.0 : 1.0);
          sum += w * h;
          weight += w;
        }
      out.z_mm(r, c) = weight > 0.0 ? static_cast<float>(sum / weight) : NAN;
    }
  });
  return out;
}

namespace {

/// "translation x", or "translation along (0.71, 0.71, 0)" when no axis dominates.
std::string name_part(const char* kind, const char* link, Vec3 v) {
  const double length = norm(v);
  const Vec3 d = (1.0 / length) * v;
  const auto tidy = [](double a) { return std::abs(a) < 0.005 ? 0.0 : a; };
  if (std::abs(d.x) > 0.99) return fmt::format("{} x", kind);
  if (std::abs(d.y) > 0.99) return fmt::format("{} y", kind);
  if (std::abs(d.z) > 0.99) return fmt::format("{} z", kind);
  return fmt::format("{} {} ({:.2f}, {:.2f}, {:.2f})", kind, link, tidy(d.x), tidy(d.y), tidy(d.z));
}

}  // namespace

std::vector<std::string> name_directions(const Eigen::MatrixXd& basis) {
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
    constexpr double kShown = 0.05;
    const double whole = std::hypot(norm(shift), norm(turn));
    std::string name;
    if (norm(shift) > kShown * whole) name = name_part("translation", "along", shift);
    if (norm(turn) > kShown * whole)
      name += (name.empty() ? "" : " with ") + name_part("rotation", "about", turn);
    names.push_back(name);
  }
  return names;
}

}  // namespace maquette::scan::detail

// SPDX-License-Identifier: GPL-3.0-or-later

// Spheres of a cloud onto the datums that they are.

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <Eigen/Dense>

#include "scan/find_spheres.hpp"

namespace maquette::scan {
namespace {

using Vector6 = Eigen::Matrix<double, 6, 1>;
using Matrix6 = Eigen::Matrix<double, 6, 6>;

constexpr double kLeastHeight = 0.05;  // of a triangle, by its longest side: else nearly a line

struct Pair {
  std::size_t found, datum;
  friend bool operator==(const Pair&, const Pair&) = default;
};

Eigen::Vector3d eigen_of(Vec3 p) {
  return {p.x, p.y, p.z};
}

/// Rotation and translation of least squares (Horn; by singular values: Arun et al. 1987).
RigidTransform pose_of(std::span<const FoundSphere> found, const std::vector<const Datum*>& datums,
                       const std::vector<Pair>& pairs) {
  Eigen::Vector3d from = Eigen::Vector3d::Zero(), to = from;
  for (const Pair& p : pairs) {
    from += eigen_of(found[p.found].centre_mm) / static_cast<double>(pairs.size());
    to += eigen_of(datums[p.datum]->at_mm) / static_cast<double>(pairs.size());
  }
  Eigen::Matrix3d moment = Eigen::Matrix3d::Zero();
  for (const Pair& p : pairs)
    moment += (eigen_of(found[p.found].centre_mm) - from) *
              (eigen_of(datums[p.datum]->at_mm) - to).transpose();
  const Eigen::JacobiSVD<Eigen::Matrix3d> svd(moment, Eigen::ComputeFullU | Eigen::ComputeFullV);
  Eigen::Matrix3d proper = Eigen::Matrix3d::Identity();
  proper(2, 2) = (svd.matrixV() * svd.matrixU().transpose()).determinant() < 0.0 ? -1.0 : 1.0;
  const Eigen::Matrix3d turn = svd.matrixV() * proper * svd.matrixU().transpose();
  const Eigen::Quaterniond q(turn);
  const Eigen::Vector3d t = to - turn * from;
  return {normalized(Quaternion{q.w(), q.x(), q.y(), q.z()}), {t(0), t(1), t(2)}};
}

/// Height of a triangle over its longest side, as a share of it.
double slimness(Vec3 a, Vec3 b, Vec3 c) {
  const double longest = std::max({norm(b - a), norm(c - b), norm(a - c)});
  return longest > 0.0 ? norm(cross(b - a, c - a)) / (longest * longest) : 0.0;
}

class Matcher {
 public:
  Matcher(std::span<const FoundSphere> found, const std::vector<const Datum*>& datums,
          double match_mm)
      : found_(found), datums_(datums), match_(match_mm) {}

  /// All spheres that a pose brings onto datums of their radius, each datum once.
  [[nodiscard]] std::vector<Pair> matched_by(const RigidTransform& pose) const {
    std::vector<Pair> pairs;
    for (std::size_t d = 0; d < datums_.size(); ++d) {
      std::size_t which = found_.size();
      double nearest = INFINITY;
      for (std::size_t f = 0; f < found_.size(); ++f) {
        const double off = norm(pose.point(found_[f].centre_mm) - datums_[d]->at_mm);
        if (alike(f, d) && off <= match_ + 3.0 * found_[f].sigma_mm && off < nearest)
          nearest = off, which = f;
      }
      if (which < found_.size()) pairs.push_back({which, d});
    }
    return pairs;
  }

  /// Poses by triples, the best and the best that is another.
  void search() {
    for (std::size_t a = 0; a < datums_.size(); ++a)
      for (std::size_t b = a + 1; b < datums_.size(); ++b)
        for (std::size_t i = 0; i < found_.size(); ++i)
          for (std::size_t j = 0; j < found_.size(); ++j)
            if (i != j && alike(i, a) && alike(j, b) && as_far(i, j, a, b)) third(a, b, i, j);
  }
  std::vector<Pair> best, other;
  double best_square = INFINITY, other_square = INFINITY;

 private:
  [[nodiscard]] bool alike(std::size_t f, std::size_t d) const {
    return std::abs(found_[f].radius_mm - datums_[d]->radius_mm) < 1e-6 * datums_[d]->radius_mm;
  }
  [[nodiscard]] bool as_far(std::size_t i, std::size_t j, std::size_t a, std::size_t b) const {
    const double off = norm(found_[i].centre_mm - found_[j].centre_mm) -
                       norm(datums_[a]->at_mm - datums_[b]->at_mm);
    return std::abs(off) <= match_ + 3.0 * std::hypot(found_[i].sigma_mm, found_[j].sigma_mm);
  }
  void third(std::size_t a, std::size_t b, std::size_t i, std::size_t j) {
    for (std::size_t c = b + 1; c < datums_.size(); ++c)
      for (std::size_t k = 0; k < found_.size(); ++k) {
        if (k == i || k == j || !alike(k, c) || !as_far(i, k, a, c) || !as_far(j, k, b, c))
          continue;
        if (slimness(datums_[a]->at_mm, datums_[b]->at_mm, datums_[c]->at_mm) < kLeastHeight)
          continue;
        const std::vector<Pair> pairs =
            matched_by(pose_of(found_, datums_, {{i, a}, {j, b}, {k, c}}));
        if (pairs.size() >= 3) offer(pairs);
      }
  }
  void offer(const std::vector<Pair>& pairs) {
    const RigidTransform pose = pose_of(found_, datums_, pairs);
    double square = 0.0;
    for (const Pair& p : pairs) {
      const Vec3 off = pose.point(found_[p.found].centre_mm) - datums_[p.datum]->at_mm;
      square += dot(off, off);
    }
    if (pairs == best || pairs == other) return;
    const auto better = [&](const std::vector<Pair>& than, double of_it) {
      return pairs.size() != than.size() ? pairs.size() > than.size() : square < of_it;
    };
    if (better(best, best_square)) {
      other = std::move(best), other_square = best_square;
      best = pairs, best_square = square;
    } else if (better(other, other_square)) {
      other = pairs, other_square = square;
    }
  }

  std::span<const FoundSphere> found_;
  const std::vector<const Datum*>& datums_;
  double match_;
};

/// Gauss-Newton with the centres' covariances.
void refine(SphereMatch& m, std::span<const FoundSphere> found,
            const std::vector<const Datum*>& datums, const std::vector<Pair>& pairs,
            double excess_mm) {
  Vec3 centre;
  for (const Pair& p : pairs)
    centre += (1.0 / static_cast<double>(pairs.size())) * datums[p.datum]->at_mm;
  Matrix6 normal;
  for (int i = 0; i < 10; ++i) {
    normal.setZero();
    Vector6 right = Vector6::Zero();
    const Eigen::Quaterniond q(m.model_from_scan.rotation.w, m.model_from_scan.rotation.x,
                               m.model_from_scan.rotation.y, m.model_from_scan.rotation.z);
    for (const Pair& p : pairs) {
      const Vec3 at = m.model_from_scan.point(found[p.found].centre_mm);
      Eigen::Matrix<double, 3, 6> j = Eigen::Matrix<double, 3, 6>::Zero();
      j.leftCols<3>().setIdentity();
      const Vec3 arm = at - centre;
      j.rightCols<3>() << 0.0, arm.z, -arm.y, -arm.z, 0.0, arm.x, arm.y, -arm.x, 0.0;
      const Eigen::Matrix3d turn = q.toRotationMatrix();
      const Eigen::Matrix3d c =
          turn * Eigen::Map<const Eigen::Matrix3d>(found[p.found].covariance.data()) *
              turn.transpose() +
          excess_mm * excess_mm * Eigen::Matrix3d::Identity();
      const Eigen::Matrix3d weight = c.inverse();
      normal += j.transpose() * weight * j;
      right += j.transpose() * weight * eigen_of(datums[p.datum]->at_mm - at);
    }
    const Vector6 step = normal.ldlt().solve(right);
    const Vec3 turn{step(3), step(4), step(5)};
    const double angle = norm(turn);
    Quaternion rotation;
    if (angle > 0.0) rotation = rotation_about((1.0 / angle) * turn, angle);
    RigidTransform& t = m.model_from_scan;
    t.translation_mm =
        centre + rotate(rotation, t.translation_mm - centre) + Vec3{step(0), step(1), step(2)};
    t.rotation = normalized(rotation * t.rotation);
    if (step.norm() < 1e-9) break;
  }
  const Matrix6 c = normal.inverse();
  Registration& r = m.registration;
  for (Eigen::Index i = 0; i < 6; ++i)
    for (Eigen::Index j = 0; j < 6; ++j)
      r.covariance[static_cast<std::size_t>(6 * i + j)] = c(i, j);
  r.centre_mm = centre;
  r.model_from_scan = m.model_from_scan;
  const auto largest = [](const Eigen::Matrix3d& part) {
    return std::sqrt(Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(part).eigenvalues()(2));
  };
  r.sigma_translation_mm = largest(c.topLeftCorner<3, 3>());
  r.sigma_rotation_rad = largest(c.bottomRightCorner<3, 3>());
}

}  // namespace

Result<SphereMatch> match_spheres(std::span<const FoundSphere> found, std::span<const Datum> all,
                                  double match_mm) {
  std::vector<const Datum*> datums;
  for (const Datum& d : all)
    if (d.kind == Datum::Kind::sphere) datums.push_back(&d);
  if (datums.size() < 3)
    return fail(kSpheres, fmt::format("{} spheres among the datums, at least three are needed to "
                                      "give a pose",
                                      datums.size()));
  Matcher matcher(found, datums, match_mm);
  matcher.search();
  if (matcher.best.empty())
    return fail(kSpheres,
                fmt::format("of {} spheres found none three stand as three of the {} datums do "
                            "(within {} mm, not on one line): are the radii right, were enough of "
                            "them scanned?",
                            found.size(), datums.size(), match_mm));
  if (matcher.other.size() == matcher.best.size() &&
      matcher.other_square < 9.0 * std::fmax(matcher.best_square, 0.01 * match_mm * match_mm))
    return fail(kSpheres,
                fmt::format("two poses bring {} spheres onto datums: their arrangement has a "
                            "symmetry; move one datum, or scan more of them",
                            matcher.best.size()));
  SphereMatch m;
  m.model_from_scan = pose_of(found, datums, matcher.best);
  // What the centres are off by beyond their own covariances belongs to each of them.
  const double n = static_cast<double>(matcher.best.size());
  double own = 0.0;
  for (const Pair& p : matcher.best)
    own +=
        found[p.found].covariance[0] + found[p.found].covariance[4] + found[p.found].covariance[8];
  const double freedom = 3.0 * n - 6.0;
  const double excess = std::sqrt(std::fmax(0.0, matcher.best_square / freedom - own / (3.0 * n)));
  refine(m, found, datums, matcher.best, excess);
  std::vector<bool> seen(datums.size(), false);
  double square = 0.0;
  for (const Pair& p : matcher.best) {
    seen[p.datum] = true;
    m.matched.push_back(datums[p.datum]->name);
    m.residual_mm.push_back(
        norm(m.model_from_scan.point(found[p.found].centre_mm) - datums[p.datum]->at_mm));
    square += m.residual_mm.back() * m.residual_mm.back();
  }
  for (std::size_t d = 0; d < datums.size(); ++d)
    if (!seen[d]) m.missing.push_back(datums[d]->name);
  m.registration.rms_after_mm = std::sqrt(square / n);
  m.registration.noise_mm = m.registration.rms_after_mm;
  m.registration.overlap = n / static_cast<double>(datums.size());
  m.registration.likeness = 1.0;
  m.registration.effective_points = n;
  return m;
}

}  // namespace maquette::scan

// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/find_stones.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <Eigen/Dense>

#include "scan/detail/mesh_surface.hpp"
#include "scan/detail/registration_steps.hpp"

namespace maquette::scan {
namespace {

using detail::Pose;

constexpr std::size_t kLeastOnStone = 25;
constexpr std::size_t kSample = 1'500;
constexpr std::size_t kFewer = 120;  // to find the heading
constexpr int kHeadings = 16;

struct Shape {
  TriMesh mesh;
  Vec3 middle;
  double radius_mm = 0.0;  ///< about the vertical through the middle
  Box3 box;
};

Shape shape_of(const meshing::PlacedStone& stone) {
  Shape s;
  s.mesh = meshing::stone_mesh(stone);
  s.box = s.mesh.bounds();
  s.middle = 0.5 * (s.box.min + s.box.max);
  for (const Vec3& v : s.mesh.vertices_mm)
    s.radius_mm = std::fmax(s.radius_mm, std::hypot(v.x - s.middle.x, v.y - s.middle.y));
  return s;
}

struct Match {
  Pose pose;  // plan from actual
  double noise_mm = INFINITY;
  detail::Solution solution;
  detail::Frame frame;
};

/// The points on one mesh, from one heading.
Match match(const std::vector<Vec3>& points, const MeshDistance& mesh, const Pose& start,
            double reach_mm, int rounds) {
  const detail::MeshSurface surface(mesh, reach_mm);
  // The search for a heading need not come to rest.
  const detail::Level level{&surface, (rounds > 1 ? 0.05 : 1.0) * reach_mm,
                            static_cast<double>(points.size()), 1e-8};
  Match m;
  m.pose = start;
  for (int i = 0; i < rounds; ++i) m.pose = detail::settle(points, m.pose, level);
  const detail::Met met = detail::meet(points, m.pose, surface);
  const auto spread = detail::spread_of(met);
  // What is out of reach has no residual: a fit that leaves out half of the points is none.
  if (2 * spread.count < points.size() || spread.count < kLeastOnStone) return m;
  m.frame = spread.frame;
  m.noise_mm = std::fmax(detail::kLeastScaleMm, detail::robust_scale(met));
  const auto sums =
      detail::accumulate(met, m.frame, {detail::Loss::Kind::huber, detail::kHuber * m.noise_mm});
  m.solution = detail::solve(sums, {m.noise_mm, 1e-8, reach_mm, static_cast<double>(spread.count)});
  return m;
}

Pose turned_about(Vec3 centre, double angle, Vec3 shift) {
  Pose pose;
  pose.rigid.rotation = rotation_about({0.0, 0.0, 1.0}, angle);
  pose.rigid.translation_mm = centre - rotate(pose.rigid.rotation, centre) + shift;
  return pose;
}

Match best_heading(const std::vector<Vec3>& points, const MeshDistance& mesh, Vec3 from, Vec3 to,
                   double reach_mm) {
  const std::vector<Vec3> fewer = detail::sample(points, kFewer);
  Match best;
  for (int k = 0; k < kHeadings; ++k) {
    const Match m =
        match(fewer, mesh, turned_about(from, 2.0 * std::numbers::pi * k / kHeadings, to - from),
              reach_mm, 1);
    if (m.noise_mm < best.noise_mm) best = m;
  }
  return best.noise_mm < INFINITY ? match(points, mesh, best.pose, reach_mm, 3) : best;
}

void state_pose(StoneFinding& f, const Match& m, const Shape& shape,
                const Registration* registration) {
  f.actual_from_planned = m.pose.rigid.inverse();
  f.shift_mm = f.actual_from_planned.point(shape.middle) - shape.middle;
  const Quaternion q = f.actual_from_planned.rotation;
  f.turn_rad = 2.0 * std::atan2(q.z, q.w);
  if (f.turn_rad > std::numbers::pi) f.turn_rad -= 2.0 * std::numbers::pi;
  if (f.turn_rad < -std::numbers::pi) f.turn_rad += 2.0 * std::numbers::pi;
  f.tilt_rad = 2.0 * std::asin(std::fmin(1.0, std::hypot(q.x, q.y)));
  f.noise_mm = m.noise_mm;
  // Covariance at the middle: translation of the frame's centre and what rotation adds there.
  const Vec3 arm = shape.middle - m.frame.centre_mm;
  Eigen::Matrix<double, 3, 7> at = Eigen::Matrix<double, 3, 7>::Zero();
  at.leftCols<3>().setIdentity();
  at.block<3, 3>(0, 3) << 0.0, arm.z, -arm.y, -arm.z, 0.0, arm.x, arm.y, -arm.x, 0.0;
  at.block<3, 3>(0, 3) /= m.frame.arm_mm;
  const Eigen::Matrix3d c = at * m.solution.covariance * at.transpose();
  Vec3 pose;
  if (registration != nullptr)
    pose = {pose_sigma_mm(*registration, shape.middle, {1, 0, 0}),
            pose_sigma_mm(*registration, shape.middle, {0, 1, 0}),
            pose_sigma_mm(*registration, shape.middle, {0, 0, 1})};
  f.sigma_shift_mm = {std::sqrt(c(0, 0) + pose.x * pose.x), std::sqrt(c(1, 1) + pose.y * pose.y),
                      std::sqrt(c(2, 2) + pose.z * pose.z)};
  f.sigma_turn_rad = std::sqrt(m.solution.covariance(5, 5)) / m.frame.arm_mm;
  if (registration != nullptr)
    f.sigma_turn_rad = std::hypot(f.sigma_turn_rad, std::sqrt(registration->covariance[35]));
}

/// Beyond 99 % of chi-squared with four degrees of freedom.
bool beyond_doubt_moved(const StoneFinding& f) {
  const auto square = [](double v, double s) { return s > 0.0 ? v * v / (s * s) : 0.0; };
  return square(f.shift_mm.x, f.sigma_shift_mm.x) + square(f.shift_mm.y, f.sigma_shift_mm.y) +
             square(f.shift_mm.z, f.sigma_shift_mm.z) + square(f.turn_rad, f.sigma_turn_rad) >
         13.28;
}

}  // namespace

std::string_view name_of(StoneState state) {
  switch (state) {
    case StoneState::as_planned:
      return "as planned";
    case StoneState::moved:
      return "moved";
    case StoneState::missing:
      return "missing";
    case StoneState::swapped:
      return "swapped";
    case StoneState::unclear:
      return "unclear";
    case StoneState::present:
      return "present";
    default:
      return "unseen";
  }
}

std::vector<StoneFinding> find_stones(std::span<const Vec3> points,
                                      const heightmap::ModelField& ground,
                                      std::span<const meshing::PlacedStone> plan, double noise_mm,
                                      const Registration* registration) {
  std::vector<Shape> shapes;
  std::vector<MeshDistance> meshes;
  shapes.reserve(plan.size());
  meshes.reserve(plan.size());
  for (const auto& stone : plan) {
    shapes.push_back(shape_of(stone));
    meshes.emplace_back(shapes.back().mesh);
  }
  const double lift = std::fmax(5.0 * noise_mm, 0.05 * ground.spacing.value());
  std::vector<StoneFinding> findings;
  for (std::size_t k = 0; k < plan.size(); ++k) {
    const Shape& shape = shapes[k];
    StoneFinding f;
    f.number = plan[k].number;
    const double margin = 0.25 * shape.radius_mm;
    std::vector<Vec3> on;
    std::size_t over = 0;
    double high = 0.0, planned = 0.0;
    for (const Vec3& p : points) {
      const double out = std::hypot(p.x - shape.middle.x, p.y - shape.middle.y);
      if (out > shape.radius_mm + margin) continue;
      const double h = heightmap::height_at(ground, p.x, p.y);
      if (std::isnan(h)) continue;
      if (out < 0.3 * shape.radius_mm) {
        ++over;
        high += p.z - h;
        planned += shape.box.max.z - h;
      }
      if (p.z - h > lift) on.push_back(p);
    }
    f.points = on.size();
    f.height_share = planned > 0.0 ? high / planned : 0.0;
    const double sigma_share =
        planned > 0.0 ? noise_mm * std::sqrt(static_cast<double>(over)) / planned : INFINITY;
    if (over >= 5 && f.height_share < 0.25 && f.height_share < 0.5 - 3.0 * sigma_share) {
      f.state = StoneState::missing;
    } else if (on.size() >= kLeastOnStone) {
      const std::vector<Vec3> some = detail::sample(on, kSample);
      const double reach = 0.5 * shape.radius_mm;
      Match own = match(some, meshes[k], {}, reach, 3);
      // Facets and glue aside, a stone fits as well as the scan is noisy.
      const double fits = std::fmax(3.0 * noise_mm, 0.01 * shape.radius_mm);
      if (own.noise_mm > fits)
        if (const Match turned = best_heading(some, meshes[k], shape.middle, shape.middle, reach);
            turned.noise_mm < own.noise_mm)
          own = turned;
      Match other;
      std::size_t which = k;
      if (own.noise_mm > fits)
        for (std::size_t j = 0; j < plan.size(); ++j) {
          if (j == k) continue;
          const Vec3 there{shapes[j].middle.x, shapes[j].middle.y,
                           shapes[j].box.max.z - shape.box.max.z + shape.middle.z};
          const Match m =
              best_heading(some, meshes[j], shape.middle, there, 0.5 * shapes[j].radius_mm);
          if (m.noise_mm < other.noise_mm) other = m, which = j;
        }
      if (which != k && other.noise_mm < 0.5 * own.noise_mm && other.noise_mm <= 2.0 * fits) {
        f.state = StoneState::swapped;
        f.carries = plan[which].number;
        f.noise_mm = other.noise_mm;
      } else if (own.noise_mm <= 3.0 * fits) {
        state_pose(f, own, shape, registration);
        f.state = beyond_doubt_moved(f) ? StoneState::moved : StoneState::as_planned;
      } else {
        f.state = StoneState::unclear;
        f.noise_mm = own.noise_mm;
      }
    }
    if (f.state == StoneState::unseen && over >= 5)
      f.state = f.height_share > 0.5 ? StoneState::present : StoneState::unclear;
    findings.push_back(f);
  }
  return findings;
}

}  // namespace maquette::scan

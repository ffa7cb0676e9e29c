// SPDX-License-Identifier: GPL-3.0-or-later

// The same points, design, start, loss and solver: what differs is how a residual counts. From
// plane to plane each point has the covariance of a disc through its neighbours in the scan, thin
// along their normal; the model's disc has no noise but that thickness. As the model's planes are
// met along their own normal n, a residual's variance is n' (C_model + R C_point R') n.

#include "bench/scan_planes.hpp"

#include <cmath>
#include <cstdint>
#include <optional>
#include <vector>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>
#include <Eigen/Dense>
#include <nanoflann.hpp>

#include "scan/detail/registration_steps.hpp"
#include "support/bench_times.hpp"
#include "support/scan_terrain.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;
using namespace testing_support;

constexpr std::size_t kNeighbours = 20;  // as in the paper
constexpr double kThin = 1e-3;           // variance along a disc's normal over that in its plane

struct Points {
  const std::vector<Vec3>& at;
  [[nodiscard]] std::size_t kdtree_get_point_count() const { return at.size(); }
  [[nodiscard]] double kdtree_get_pt(std::size_t i, std::size_t k) const {
    return k == 0 ? at[i].x : k == 1 ? at[i].y : at[i].z;
  }
  template <class Box>
  bool kdtree_get_bbox(Box&) const {
    return false;
  }
};

std::vector<Vec3> normals_of(const std::vector<Vec3>& points) {
  using Tree = nanoflann::KDTreeSingleIndexAdaptor<nanoflann::L2_Simple_Adaptor<double, Points>,
                                                   Points, 3, std::uint32_t>;
  const Points adapted{points};
  Tree tree(3, adapted, nanoflann::KDTreeSingleIndexAdaptorParams(12));
  tree.buildIndex();
  std::vector<Vec3> normals(points.size());
  oneapi::tbb::parallel_for(std::size_t{0}, points.size(), [&](std::size_t i) {
    const double query[3] = {points[i].x, points[i].y, points[i].z};
    std::uint32_t near[kNeighbours];
    double squares[kNeighbours];
    const std::size_t n = tree.knnSearch(query, kNeighbours, near, squares);
    Eigen::Matrix<double, Eigen::Dynamic, 3, 0, kNeighbours, 3> around(n, 3);
    for (std::size_t k = 0; k < n; ++k) {
      const Vec3 off = points[near[k]] - points[i];
      around.row(static_cast<Eigen::Index>(k)) = Eigen::RowVector3d(off.x, off.y, off.z);
    }
    const Eigen::RowVector3d mean = around.colwise().mean();
    around.rowwise() -= mean;
    const Eigen::Matrix3d scatter = around.transpose() * around;
    Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes;
    axes.computeDirect(scatter);
    const Eigen::Vector3d normal = axes.eigenvectors().col(0);
    normals[i] = {normal.x(), normal.y(), normal.z()};
  });
  return normals;
}

RigidTransform plane_to_plane(const Cloud& cloud, const ModelField& part) {
  const std::vector<Vec3> normals = normals_of(cloud.points_mm);
  const detail::SmoothFieldSurface surface(part);
  detail::Pose pose;
  for (int i = 0; i < 50; ++i) {
    detail::Met met = detail::meet(cloud.points_mm, pose, surface);
    for (std::size_t k = 0; k < met.feet.size(); ++k) {
      const double along = dot(met.feet[k].normal, pose.rigid.direction(normals[k]));
      const double variance = 2.0 * kThin + (1.0 - kThin) * (1.0 - along * along);
      met.feet[k].sigma = std::sqrt(variance / (2.0 * kThin));
    }
    const detail::Frame frame = detail::spread_of(met).frame;
    const double noise = std::fmax(detail::kLeastScaleMm, detail::robust_scale(met));
    const detail::Sums sums =
        detail::accumulate(met, frame, {detail::Loss::Kind::tukey, detail::kTukey * noise});
    const detail::Solution solved = detail::solve(
        sums, {noise, 1e-8, part.spacing.value(), static_cast<double>(sums.count), false, nullptr});
    pose = detail::moved(pose, frame, solved.step);
    if (solved.step.norm() < 1e-6 || solved.step_sigmas < 0.01) break;
  }
  return pose.rigid;
}

double square_off(const Cloud& truth, const Cloud& seen, const RigidTransform& pose) {
  double square = 0.0, n = 0.0;
  for (std::size_t i = 0; i < truth.points_mm.size(); i += 97, n += 1.0) {
    const Vec3 e = pose.point(seen.points_mm[i]) - truth.points_mm[i];
    square += dot(e, e);
  }
  return square / n;
}

struct Way {
  double square = 0.0, seconds = 0.0;
  int refused = 0;
  template <class Registered>
  void add(const Cloud& truth, const Cloud& seen, const Registered& registered) {
    const double before = cpu_seconds();
    const std::optional<RigidTransform> pose = registered(seen);
    seconds += cpu_seconds() - before;
    if (pose)
      square += square_off(truth, seen, *pose);
    else
      ++refused;
  }
  void print(const char* name, int runs) const {
    fmt::print("  {:<44}{:>10.5f} mm{:>9.2f} CPU s{}\n", name, std::sqrt(square / (runs - refused)),
               seconds / runs, refused > 0 ? fmt::format("  {} refused", refused) : "");
  }
};

/// Along z, as large as range over `typical_mm` squared and incidence make it.
Cloud noisy(const ModelField& part, std::size_t n, std::uint64_t seed, double sigma_mm,
            const Vec3* station, double typical_mm) {
  Cloud cloud = points_on(part, n, seed, station == nullptr ? sigma_mm : 0.0);
  if (station == nullptr) return cloud;
  cloud.station_mm = *station;
  for (std::size_t i = 0; i < cloud.points_mm.size(); ++i) {
    Vec3& p = cloud.points_mm[i];
    p.z += sigma_mm * std::pow(norm(*station - p) / typical_mm, 2.0) * random_normal(seed + 9, i);
  }
  return cloud;
}

void compare(const char* what, int runs, std::ptrdiff_t nodes, double spacing_mm,
             std::size_t points, double sigma_mm, bool low_scanner) {
  const double side = spacing_mm * static_cast<double>(nodes - 1);
  const Vec3 station{0.5 * side, -0.3 * side, 0.3 * side};
  Way alike, weighted, planes;
  for (int k = 0; k < runs; ++k) {
    const auto seed = static_cast<std::uint64_t>(1000 + k);
    const ModelField part = rough_part(seed, nodes, nodes, spacing_mm);
    const Cloud truth =
        noisy(part, points, seed, sigma_mm, low_scanner ? &station : nullptr, 0.8 * side);
    Cloud seen = seen_from(truth, random_pose(seed, {0.5 * side, 0.5 * side, 10.0}, 1e-3, 2.0));
    const auto registered = [&](const Cloud& cloud) -> std::optional<RigidTransform> {
      RegisterOptions near;
      near.anywhere = false;
      const auto found = register_scan(cloud, part, near);
      if (!found) return std::nullopt;
      return found->model_from_scan;
    };
    if (low_scanner) weighted.add(truth, seen, registered);
    seen.station_mm.reset();
    alike.add(truth, seen, registered);
    planes.add(truth, seen, [&](const Cloud& cloud) -> std::optional<RigidTransform> {
      return plane_to_plane(cloud, part);
    });
  }
  fmt::print("{}: {} runs of {} points on {} x {} nodes of {} mm\n", what, runs, points, nodes,
             nodes, spacing_mm);
  alike.print("point to plane", runs);
  if (low_scanner) weighted.print("point to plane, noise by range and incidence", runs);
  planes.print("plane to plane", runs);
}

}  // namespace

void beside_plane_to_plane(int runs, std::size_t points) {
  compare("noise alike, 0.05 mm", runs, 401, 1.0, 160'000, 0.05, false);
  compare("noise by range and incidence, 0.05 mm in the middle", runs, 401, 1.0, 160'000, 0.05,
          true);
  compare("noise alike, 0.3 mm", 1, 1415, 2000.0 / 1414.0, points, 0.3, false);
}

}  // namespace maquette::scan

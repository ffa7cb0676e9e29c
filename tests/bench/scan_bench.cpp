// SPDX-License-Identifier: GPL-3.0-or-later

// Registration and deviation at full size, and how true the stated covariance is.
//
//   scan_bench [peer [NODES POINTS [SAMPLED]]]
//                                    5 M points of 0.3 mm against 4 M triangles beside CloudCompare
//                                    where it is: CPU seconds, pose error, ratios; SAMPLED: its
//                                    ICP alone, by so many points an iteration
//   scan_bench full [NODES POINTS]   4001 nodes a side of 0.5 mm, 5 M points, 0.3 mm noise, 20 mm
//                                    and 2 degrees off: CPU seconds and error of the true pose;
//                                    then signed distances of all points
//   scan_bench mesh [NODES POINTS]   the same part as triangles (1415 nodes: 4 M), 5 M points
//                                    0.3 mm off: CPU seconds; sign and distance against the grid's
//   scan_bench grid [NODES POINTS]   deviation on the height grid alone, with map: the least and
//   the
//                                    most CPU seconds of seven
//   scan_bench clean [POINTS]        a file of 20 M points thinned to 0.5 mm: CPU seconds, memory
//                                    in all and a point
//   scan_bench poses [RUNS [SEED]]   1000 parts and poses in sets of 200: within 3 sigma, share of
//                                    the spacing
//   scan_bench planes [RUNS [POINTS]]
//                                    beside generalised ICP from plane to plane: errors and CPU
//                                    seconds of 20 parts, noise alike and by range; then once with
//                                    5 M points on 4 M triangles

#include <cmath>
#include <cstdlib>
#include <cstring>
#include <ctime>
#include <optional>
#include <string>

#include <fmt/format.h>
#include <Eigen/Dense>

#include "bench/scan_peer.hpp"
#include "bench/scan_planes.hpp"
#include "scan/clean.hpp"
#include "scan/deviate.hpp"
#include "scan/mesh_distance.hpp"
#include "scan/register.hpp"
#include "scan/scanner_sim.hpp"
#include "scan/surface_distance.hpp"
#include "support/bench_times.hpp"
#include "support/field_mesh.hpp"
#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;
using testing_support::mesh_of;
using namespace testing_support;

constexpr double kDegree = 0.017453292519943295;

/// Waves down to a few nodes, in parallel; the pose is drawn about the middle.
void full(std::ptrdiff_t nodes, std::size_t points) {
  const ModelField part = rough_part(1, nodes, nodes, 0.5);
  const double half = 0.25 * static_cast<double>(nodes - 1);
  const Cloud truth = points_on(part, points, 2, 0.3);
  const RigidTransform pose = random_pose(3, {half, half, 10.0}, 2.0 * kDegree, 20.0);
  const Cloud seen = seen_from(truth, pose);
  double before = cpu_seconds();
  const auto found = register_scan(seen, part);
  fmt::print("register_scan: {:.2f} CPU s\n", cpu_seconds() - before);
  if (!found) {
    fmt::print("{}: {}\n", found.error().code.name, found.error().message);
    return;
  }
  double square = 0.0;
  for (std::size_t i = 0; i < truth.points_mm.size(); i += 97) {
    const Vec3 e = found->model_from_scan.point(seen.points_mm[i]) - truth.points_mm[i];
    square += dot(e, e);
  }
  fmt::print(
      "rms distance from the true pose: {:.6f} mm; {} iterations, noise {:.4f} mm, sigma {:.6f} "
      "mm, effective points {:.0f}\n",
      std::sqrt(square * 97.0 / static_cast<double>(truth.points_mm.size())), found->iterations,
      found->noise_mm, found->sigma_translation_mm, found->effective_points);
  before = cpu_seconds();
  RegisterOptions far;
  far.model_from_scan = random_pose(5, {half, half, 10.0}, 2.5, 3000.0);
  const auto anywhere = register_scan(seen, part, far);
  fmt::print("from anywhere: {:.2f} CPU s, {}\n", cpu_seconds() - before,
             anywhere ? fmt::format("{:.6f} mm from the first",
                                    norm(anywhere->model_from_scan.translation_mm -
                                         found->model_from_scan.translation_mm))
                      : anywhere.error().message);
  before = cpu_seconds();
  const auto d = deviate(seen, found->model_from_scan, part);
  fmt::print("deviate: {:.2f} CPU s, rms {:.4f} mm over {} points\n", cpu_seconds() - before,
             d->statistics.rms_mm, d->statistics.points);
}

void mesh(std::ptrdiff_t nodes, std::size_t points) {
  const ModelField part = rough_part(1, nodes, nodes, 2000.0 / static_cast<double>(nodes - 1));
  const TriMesh triangles = mesh_of(part);
  const Cloud cloud = points_on(part, points, 2, 0.3);
  double before = cpu_seconds();
  const MeshDistance tree(triangles);
  const double build = cpu_seconds() - before;
  before = cpu_seconds();
  const auto d = signed_distances_mm(cloud.points_mm, {}, tree, 5.0);
  const double query = cpu_seconds() - before;
  double worst = 0.0;
  std::size_t flips = 0, compared = 0;
  for (std::size_t i = 0; i < points; i += 7) {
    const double grid = signed_distance_mm(part, cloud.points_mm[i], 5.0);
    if (std::isnan(grid) || std::isnan(d[i])) continue;
    ++compared;
    worst = std::fmax(worst, std::abs(std::abs(grid) - std::abs(static_cast<double>(d[i]))));
    flips += (grid < 0.0) != (d[i] < 0.0F) ? 1U : 0U;
  }
  fmt::print(
      "{} triangles: tree {:.2f} CPU s, {} distances {:.2f} CPU s, together {:.2f}; of {} compared "
      "with the grid: {} signs differ, largest difference {:.2g} mm\n",
      triangles.triangles.size(), build, points, query, build + query, compared, flips, worst);
}

/// Another's load takes the caches, not the work: the least of several is the program's own.
void grid(std::ptrdiff_t nodes, std::size_t points) {
  const ModelField part = rough_part(1, nodes, nodes, 2000.0 / static_cast<double>(nodes - 1));
  const Cloud cloud = points_on(part, points, 2, 0.3);
  double least = INFINITY, most = 0.0, rms = 0.0;
  for (int i = 0; i < 7; ++i) {
    const double before = cpu_seconds();
    const auto d = deviate(cloud, {}, part, Millimetres{20.0});
    const double taken = cpu_seconds() - before;
    if (!d) {
      fmt::print("{}\n", d.error().message);
      return;
    }
    rms = d->statistics.rms_mm;
    least = std::fmin(least, taken);
    most = std::fmax(most, taken);
  }
  fmt::print("{} points on {} triangles: {:.2f} to {:.2f} CPU s of seven, rms {:.6f} mm\n", points,
             2 * (nodes - 1) * (nodes - 1), least, most, rms);
}

int clean(std::size_t points) {
  const ModelField part = rough_part(1, 4001, 4001, 0.5);
  const ScratchFolder folder;
  ScanOptions o;
  o.scanner = *assets::find_preset(assets::scanner_presets(), "zf5006h");
  o.scanner.lines_per_turn = 1e6;  // as fine as max_points lets it be
  o.station_mm = {1000.0, -900.0, 1500.0};
  o.footprint_rays = 1;
  o.max_points = points * 3 / 2;  // a third passes the part
  const auto writer = create_cloud(folder / "scan.e57");
  if (!writer) return 1;
  if (const auto seen = simulate_scan(part, {}, o, **writer); !seen || !(*writer)->finish()) {
    fmt::print("{}\n", seen ? "the file could not be written" : seen.error().message);
    return 1;
  }
  CleanOptions c;
  c.thin_mm = 0.5;
  const double before = cpu_seconds();
  const auto figures = clean_cloud(folder / "scan.e57", folder / "clean.ply", c);
  if (!figures) {
    fmt::print("{}\n", figures.error().message);
    return 1;
  }
  const double bytes = 1048576.0 * peak_mib();
  fmt::print(
      "clean: {} points to {} in {:.1f} CPU s; most memory {:.2f} GiB, part included: {:.1f} "
      "bytes a point\n",
      figures->points, figures->written, cpu_seconds() - before, bytes / 1073741824.0,
      bytes / static_cast<double>(figures->points));
  return 0;
}

/// Error of one pose against what is stated.
struct PoseCheck {
  double chi2 = 0.0;              ///< squared error in stated covariances, six unknowns
  double share_of_spacing = 0.0;  ///< rms error of all points over their spacing
};

std::optional<PoseCheck> check_pose(std::uint64_t seed) {
  const ModelField part = rough_part(seed, 401, 401, 1.0);
  const Cloud truth = points_on(part, 160'000, seed, 0.05);  // a point per mm^2
  const RigidTransform pose = random_pose(seed, {200.0, 200.0, 10.0}, 5.0 * kDegree, 20.0);
  const auto found = register_scan(seen_from(truth, pose), part);
  if (!found) return std::nullopt;
  const RigidTransform error = found->model_from_scan * pose;
  const Vec3 shift = error.point(found->centre_mm) - found->centre_mm;
  Eigen::Matrix<double, 6, 1> e;
  e << shift.x, shift.y, shift.z, 2.0 * error.rotation.x, 2.0 * error.rotation.y,
      2.0 * error.rotation.z;
  const Eigen::Matrix<double, 6, 6> c =
      Eigen::Map<const Eigen::Matrix<double, 6, 6>>(found->covariance.data());
  PoseCheck check{e.dot(c.ldlt().solve(e))};
  double square = 0.0, n = 0.0;
  for (std::size_t i = 0; i < truth.points_mm.size(); i += 101, n += 1.0) {
    const Vec3 off = error.point(truth.points_mm[i]) - truth.points_mm[i];
    square += dot(off, off);
  }
  check.share_of_spacing = std::sqrt(square / n);
  return check;
}

/// Three standard deviations of six unknowns together: 99.73 % of the errors of an honest
/// covariance have a chi-square below 20.06. (Six checks of 99.73 %, one an unknown, would pass
/// only 98.4 % of them.) Of 200 such errors 0.54 lie beyond; two sets in a hundred have three or
/// more, so that no single set of 200 decides between honest and not: all sets together do.
void poses(int runs, int first) {
  constexpr int kSet = 200;
  constexpr double kWithin = 20.06, kShare = 0.9973;
  int refused = 0, within = 0;
  double chi2 = 0.0, worst = 0.0;
  for (int set = 0; set < runs; set += kSet) {
    const int n = std::min(kSet, runs - set);
    int within_set = 0;
    std::string beyond;
    for (int k = 0; k < n; ++k) {
      const int seed = first + set + k;
      const auto check = check_pose(static_cast<std::uint64_t>(seed));
      if (!check) {
        ++refused;
        beyond += fmt::format(" {} (refused)", seed);
        continue;
      }
      chi2 += check->chi2;
      worst = std::fmax(worst, check->share_of_spacing);
      if (check->chi2 <= kWithin)
        ++within_set;
      else
        beyond += fmt::format(" {} ({:.1f})", seed, check->chi2);
    }
    within += within_set;
    fmt::print("seeds {} to {}: {} of {} within 3 sigma{}{}\n", first + set, first + set + n - 1,
               within_set, n, beyond.empty() ? "" : "; beyond:", beyond);
  }
  const int found = std::max(1, runs - refused);
  fmt::print(
      "{} of {} ({:.2f} %) within 3 sigma; an honest covariance: {:.1f} +- {:.1f}\n"
      "mean chi-square {:.2f} (6 +- {:.2f}), {} refused, worst pose error {:.4f} of the spacing\n",
      within, runs, 100.0 * within / runs, kShare * runs, std::sqrt(kShare * (1.0 - kShare) * runs),
      chi2 / found, std::sqrt(12.0 / found), refused, worst);
}

}  // namespace
}  // namespace maquette::scan

int main(int argc, char** argv) {
  const auto number = [&](int at, long otherwise) {
    return argc > at ? std::strtol(argv[at], nullptr, 10) : otherwise;
  };
  const std::string what = argc > 1 ? argv[1] : "peer";
  if (what == "full")
    maquette::scan::full(number(2, 4001), static_cast<std::size_t>(number(3, 5'000'000)));
  else if (what == "mesh")
    maquette::scan::mesh(number(2, 1415), static_cast<std::size_t>(number(3, 5'000'000)));
  else if (what == "grid")
    maquette::scan::grid(number(2, 1415), static_cast<std::size_t>(number(3, 5'000'000)));
  else if (what == "peer")
    maquette::scan::beside_cloudcompare(number(2, 1415),
                                        static_cast<std::size_t>(number(3, 5'000'000)),
                                        static_cast<std::size_t>(number(4, 0)));
  else if (what == "clean")
    return maquette::scan::clean(static_cast<std::size_t>(number(2, 20'000'000)));
  else if (what == "poses")
    maquette::scan::poses(static_cast<int>(number(2, 1000)), static_cast<int>(number(3, 1000)));
  else if (what == "planes")
    maquette::scan::beside_plane_to_plane(static_cast<int>(number(2, 20)),
                                          static_cast<std::size_t>(number(3, 5'000'000)));
  else {
    fmt::print("scan_bench full | mesh | grid | peer | clean | poses | planes\n");
    return 2;
  }
  return 0;
}

// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/check_stations.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <unordered_map>
#include <vector>

#include <fmt/format.h>
#include <Eigen/Dense>

#include "scan/detail/check_each_place.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;

constexpr std::size_t kSample = 200'000;
constexpr std::size_t kSampleOnMesh = 20'000;  // the nearest triangle takes longer to find
constexpr double kOfDiagonal = 0.02;           // farther points are not of the part
constexpr std::size_t kLeastPoints = 1'000;
constexpr double kSigmas = 5.0, kOfNoise = 0.25;
constexpr std::size_t kColumns = 200, kLeastColumns = 10;  // of a grid, each of so many points:
constexpr std::size_t kInColumn = 100, kLeastInColumn = 20;
constexpr int kMostSteps = 50;
constexpr double kOfRange = 0.01;
// What circles and rounded coordinates leave at random, and what an instrument in order may have
// beside (20 arc seconds).
constexpr double kCirclesRad = 2e-5, kInOrderRad = 1e-4;

/// Does a scanner at `from` see the side of the surface that is up? Nothing beside the part.
std::optional<bool> from_behind(Vec3 p, Vec3 from, const ModelField& design) {
  const double s = design.spacing.value(), h = heightmap::height_at(design, p.x, p.y);
  const double rise_x = heightmap::height_at(design, p.x + s, p.y) - h;
  const double rise_y = heightmap::height_at(design, p.x, p.y + s) - h;
  const Vec3 look = from - p;
  const double facing = look.z - (rise_x / s) * look.x - (rise_y / s) * look.y;
  if (std::isnan(facing)) return std::nullopt;
  return facing <= 0.0;
}

/// Does a scanner at `from` see the outside of the triangle that is nearest? Nothing beside the
/// mesh.
std::optional<bool> from_behind(Vec3 p, Vec3 from, const MeshDistance& mesh, double reach_mm) {
  const auto near = mesh.nearest(p, reach_mm);
  if (!near || near->border) return std::nullopt;
  return dot(from - p, near->normal) <= 0.0;
}

/// Points [first, first + n) of a cloud, evenly thinned, in the model frame.
Cloud part_of(const Cloud& cloud, std::size_t first, std::size_t n, const RigidTransform& pose) {
  Cloud some;
  const std::size_t step = 1 + n / kSample;
  for (std::size_t i = first; i < first + n; i += step)
    some.points_mm.push_back(pose.point(cloud.points_mm[i]));
  return some;
}

std::string name_of(const ScanStation& s, std::size_t number) {
  return s.name.empty() ? fmt::format("station {}", number) : s.name;
}

/// Some points of some columns.
using Columns = std::vector<std::vector<Vec3>>;

Columns columns_of(const Cloud& cloud, std::size_t first, std::size_t n) {
  const auto& grid = cloud.grid;
  // A column is looked up once a run of its points: files go down columns or along rows.
  std::unordered_map<std::uint32_t, std::size_t> points_of;
  for (std::size_t i = first, end = first; i < first + n; i = end) {
    while (end < first + n && grid[end].column == grid[i].column) ++end;
    points_of[grid[i].column] += end - i;
  }
  std::vector<std::uint32_t> filled;
  for (const auto& [column, points] : points_of)
    if (points >= kLeastInColumn) filled.push_back(column);
  std::sort(filled.begin(), filled.end());
  struct Taken {
    std::size_t place, step, seen = 0;
  };
  std::unordered_map<std::uint32_t, Taken> taken;
  for (std::size_t k = 0; k < filled.size(); k += 1 + filled.size() / kColumns)
    taken.emplace(filled[k], Taken{taken.size(), 1 + points_of[filled[k]] / kInColumn});
  Columns columns(taken.size());
  for (std::size_t i = first, end = first; i < first + n; i = end) {
    while (end < first + n && grid[end].column == grid[i].column) ++end;
    const auto found = taken.find(grid[i].column);
    if (found == taken.end()) continue;
    auto& [place, step, seen] = found->second;
    for (std::size_t k = i; k < end; ++k)
      if (seen++ % step == 0) columns[place].push_back(cloud.points_mm[k]);
  }
  return columns;
}

/// How columns lie about planes through one place: by distance, for angles vanish as a place goes
/// far away.
struct Fan {
  Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();  ///< of the place, planes refitted
  Eigen::Vector3d gradient = Eigen::Vector3d::Zero();
  double squares_mm2 = 0.0, freedom = -3.0;
  double range_mm = 0.0;  ///< mean
  [[nodiscard]] double rms_mm() const { return std::sqrt(squares_mm2 / freedom); }
};

Fan fan_from(const Columns& columns, const Eigen::Vector3d& from) {
  Fan fan;
  double points = 0.0;
  for (const std::vector<Vec3>& column : columns) {
    const auto n = static_cast<Eigen::Index>(column.size());
    Eigen::MatrixX3d beam(n, 3);
    for (Eigen::Index i = 0; i < n; ++i) {
      const Vec3 p = column[static_cast<std::size_t>(i)];
      beam.row(i) = (Eigen::Vector3d(p.x, p.y, p.z) - from).transpose();
    }
    const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(beam.transpose() * beam);
    const Eigen::Vector3d across = axes.eigenvectors().col(0);
    const Eigen::VectorXd off = beam * across;
    // The plane turns about the place as the place moves: what that takes out is no evidence.
    const Eigen::MatrixX2d turns = beam * axes.eigenvectors().rightCols<2>();
    const Eigen::VectorXd ones = Eigen::VectorXd::Ones(n);
    const Eigen::VectorXd moves =
        turns * (turns.transpose() * turns).ldlt().solve(turns.transpose() * ones) - ones;
    fan.normal += moves.squaredNorm() * across * across.transpose();
    fan.gradient += moves.dot(off) * across;
    fan.squares_mm2 += off.squaredNorm();
    fan.range_mm += beam.rowwise().norm().sum();
    fan.freedom += static_cast<double>(n) - 2.0;
    points += static_cast<double>(n);
  }
  fan.range_mm /= points;
  return fan;
}

Result<void> check_columns(const Columns& columns, Vec3 stated) {
  if (columns.size() < kLeastColumns) return {};
  const Eigen::Vector3d start(stated.x, stated.y, stated.z);
  const Fan at_stated = fan_from(columns, start);
  Eigen::Vector3d place = start;
  Fan best = at_stated;
  double damping = 1e-3;
  for (int i = 0; i < kMostSteps && damping < 1e6; ++i) {
    Eigen::Matrix3d damped = best.normal;
    damped.diagonal().array() += damping * best.normal.trace() / 3.0;
    const Eigen::Vector3d step = -damped.ldlt().solve(best.gradient);
    const Fan there = fan_from(columns, place + step);
    const bool better = there.squares_mm2 < best.squares_mm2;
    damping *= better ? 0.1 : 10.0;
    if (!better) continue;
    const bool at_rest = best.squares_mm2 - there.squares_mm2 < 1e-6 * best.squares_mm2;
    place += step;
    best = there;
    if (at_rest) break;
  }
  // Columns of most scanners share an axis, along which their place stays open.
  const double noise_mm = std::fmax(kCirclesRad * at_stated.range_mm, best.rms_mm());
  const Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d> axes(best.normal);
  const Eigen::Vector3d along = axes.eigenvectors().transpose() * (place - start);
  Eigen::Vector3d off = Eigen::Vector3d::Zero();
  double sigmas = 0.0;
  for (Eigen::Index k = 0; k < 3; ++k) {
    const double by =
        std::abs(along(k)) * std::sqrt(std::fmax(0.0, axes.eigenvalues()(k))) / noise_mm;
    if (!(by > kSigmas)) continue;
    off += along(k) * axes.eigenvectors().col(k);
    sigmas = std::hypot(sigmas, by);
  }
  const bool elsewhere =
      at_stated.rms_mm() > std::fmax(kInOrderRad * at_stated.range_mm, 2.0 * noise_mm) &&
      off.norm() > kOfRange * at_stated.range_mm;
  if (!elsewhere) return {};
  return fail(kStationPose,
              fmt::format("columns of the scan meet at x {:.1f}, y {:.1f}, z {:.1f} mm of the "
                          "cloud's frame, {:.1f} mm ({:.0f} standard deviations) from the scanner "
                          "at x {:.1f}, y {:.1f}, z {:.1f} mm; give its place, or none",
                          stated.x + off.x(), stated.y + off.y(), stated.z + off.z(), off.norm(),
                          sigmas, stated.x, stated.y, stated.z));
}

/// Each place of a scanner that is known against the points that it is said to have seen.
/// @param behind  (point, place), model frame: is it seen from behind, if that can be told?
template <class Behind>
Result<void> check_each(const Cloud& cloud, const RigidTransform& model_from_scan,
                        std::size_t sample, const Behind& behind) {
  const auto check = [&](Vec3 place, std::size_t first, std::size_t n) -> Result<void> {
    const Vec3 from = model_from_scan.point(place);
    std::size_t wrong = 0, judged = 0;
    for (std::size_t i = first; i < first + n; i += 1 + n / sample)
      if (const auto b = behind(model_from_scan.point(cloud.points_mm[i]), from)) {
        ++judged;
        wrong += *b ? 1U : 0U;
      }
    const double share = static_cast<double>(wrong) / static_cast<double>(judged);
    if (judged == 0 || share <= kMostFromBehind) return {};
    return fail(kStationPose,
                fmt::format("a scanner at x {:.1f}, y {:.1f}, z {:.1f} mm of the model frame would "
                            "see {:.0f} % of its points from behind; give its place in the frame "
                            "of the cloud, or none",
                            from.x, from.y, from.z, 100.0 * share));
  };
  return check_each_place(cloud, check);
}

}  // namespace

Result<void> check_sight_planes(const Cloud& cloud) {
  if (cloud.grid.empty()) return {};
  return check_each_place(cloud, [&](Vec3 place, std::size_t first, std::size_t n) {
    return check_columns(columns_of(cloud, first, n), place);
  });
}

Result<void> check_viewpoints(const Cloud& cloud, const RigidTransform& model_from_scan,
                              const ModelField& design) {
  return check_each(cloud, model_from_scan, kSample,
                    [&](Vec3 p, Vec3 from) { return from_behind(p, from, design); });
}

Result<void> check_viewpoints(const Cloud& cloud, const RigidTransform& model_from_scan,
                              const MeshDistance& mesh) {
  const Box3 box = mesh.mesh().bounds();
  const double reach = kOfDiagonal * norm(box.max - box.min);
  return check_each(cloud, model_from_scan, kSampleOnMesh,
                    [&](Vec3 p, Vec3 from) { return from_behind(p, from, mesh, reach); });
}

std::vector<StrayStation> stray_stations(const Cloud& cloud, const Registration& together,
                                         const ModelField& design, const RunContext& run) {
  std::vector<StrayStation> stray;
  if (cloud.stations.size() < 2) return stray;
  std::size_t first = 0;
  for (std::size_t k = 0; k < cloud.stations.size(); first += cloud.stations[k++].points) {
    const ScanStation& station = cloud.stations[k];
    if (station.points < kLeastPoints) continue;
    const Cloud own = part_of(cloud, first, station.points, together.model_from_scan);
    RegisterOptions near;
    near.anywhere = false;
    const auto alone = register_scan(own, design, near, run);
    if (!alone) {
      if (alone.error().code == kCancelled) return stray;
      if (alone.error().code != kUnderDetermined)
        stray.push_back({name_of(station, k + 1), NAN, NAN});
      continue;
    }
    double square = 0.0, n = 0.0;
    for (std::size_t i = 0; i < own.points_mm.size(); i += 101, n += 1.0) {
      const Vec3 off = alone->model_from_scan.point(own.points_mm[i]) - own.points_mm[i];
      square += dot(off, off);
    }
    const double off = std::sqrt(square / n);
    const double sigma = std::hypot(alone->sigma_translation_mm, together.sigma_translation_mm);
    if (off > kSigmas * sigma && off > kOfNoise * alone->noise_mm)
      stray.push_back({name_of(station, k + 1), off, sigma});
  }
  return stray;
}

}  // namespace maquette::scan

// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/find_spheres.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <fmt/format.h>
#include <Eigen/Dense>

#include "core/median.hpp"
#include "scan/detail/surfels.hpp"

namespace maquette::scan {
namespace {

using detail::KeyMap;
using detail::Surfel;
using detail::VoxelGrid;

constexpr double kVoxelsPerRadius = 5.0;
constexpr double kVoteCells = 4.0;  // per radius
constexpr std::size_t kLeastVotes = 12;
constexpr std::size_t kMostPlaces = 256;
constexpr double kGather = 1.25;  // radii
constexpr double kLeastSeen = 0.125;
constexpr double kForm = 0.01;  // of the radius
constexpr int kBands = 8, kSectors = 12;
constexpr double kTukey = 4.685;

struct Place {
  Vec3 centre;
  std::size_t votes = 0;
  std::vector<Vec3> points;
};

/// Where votes gather: cells with the most of their 27 neighbours, the votes' mean.
std::vector<Place> places_of(const std::vector<Surfel>& surfels, bool station_known,
                             const Box3& box, double radius) {
  VoxelGrid grid;
  Box3 wide = box;
  wide.add(box.min - Vec3{radius, radius, radius});
  wide.add(box.max + Vec3{radius, radius, radius});
  if (!make_voxel_grid(wide, radius / kVoteCells, grid)) return {};
  struct Votes {
    std::uint64_t key = 0;
    Vec3 sum;
    double n = 0.0;
  };
  std::vector<Votes> cells;
  KeyMap index(surfels.size());
  const auto vote = [&](Vec3 at) {
    const std::uint64_t key = grid.key_of(at);
    const std::uint32_t i = index.insert(key, static_cast<std::uint32_t>(cells.size()));
    if (i == cells.size()) cells.push_back({key, {}, 0.0});
    cells[i].sum += at;
    cells[i].n += 1.0;
  };
  for (const Surfel& s : surfels) {
    if (s.normal == Vec3{}) continue;
    vote(s.centre_mm - radius * s.normal);
    if (!station_known) vote(s.centre_mm + radius * s.normal);
  }
  std::vector<Place> places;
  for (const Votes& cell : cells) {
    Vec3 sum;
    double n = 0.0;
    bool peak = true;
    for (std::int64_t x = -1; x <= 1; ++x)
      for (std::int64_t y = -1; y <= 1; ++y)
        for (std::int64_t z = -1; z <= 1; ++z) {
          const std::uint64_t key =
              VoxelGrid::key(VoxelGrid::x_of(cell.key) + x, VoxelGrid::y_of(cell.key) + y,
                             VoxelGrid::z_of(cell.key) + z);
          const std::uint32_t i = index.find(key);
          if (i == KeyMap::npos) continue;
          sum += cells[i].sum;
          n += cells[i].n;
          peak = peak && (cells[i].n < cell.n || (cells[i].n == cell.n && key >= cell.key));
        }
    if (peak && n >= static_cast<double>(kLeastVotes))
      places.push_back({(1.0 / n) * sum, static_cast<std::size_t>(n), {}});
  }
  std::sort(places.begin(), places.end(),
            [](const Place& a, const Place& b) { return a.votes > b.votes; });
  if (places.size() > kMostPlaces) places.resize(kMostPlaces);
  return places;
}

/// Each place gets the points round it.
void gather(std::span<const Vec3> points, double radius, std::vector<Place>& places) {
  VoxelGrid grid;
  Box3 box;
  for (const Place& p : places) box.add(p.centre);
  const double reach = kGather * radius;
  if (!make_voxel_grid(box, reach, grid)) return;
  std::vector<std::vector<std::size_t>> of_cell;
  KeyMap index(27 * places.size());
  for (std::size_t k = 0; k < places.size(); ++k) {
    const std::uint64_t at = grid.key_of(places[k].centre);
    for (std::int64_t x = -1; x <= 1; ++x)
      for (std::int64_t y = -1; y <= 1; ++y)
        for (std::int64_t z = -1; z <= 1; ++z) {
          const std::uint32_t i =
              index.insert(VoxelGrid::key(VoxelGrid::x_of(at) + x, VoxelGrid::y_of(at) + y,
                                          VoxelGrid::z_of(at) + z),
                           static_cast<std::uint32_t>(of_cell.size()));
          if (i == of_cell.size()) of_cell.emplace_back();
          of_cell[i].push_back(k);
        }
  }
  Box3 reached = box;
  reached.add(box.min - Vec3{reach, reach, reach});
  reached.add(box.max + Vec3{reach, reach, reach});
  for (const Vec3& p : points) {
    if (p.x < reached.min.x || p.y < reached.min.y || p.z < reached.min.z || p.x > reached.max.x ||
        p.y > reached.max.y || p.z > reached.max.z)
      continue;
    const std::uint32_t i = index.find(grid.key_of(p));
    if (i == KeyMap::npos) continue;
    for (const std::size_t k : of_cell[i])
      if (norm(p - places[k].centre) <= reach) places[k].points.push_back(p);
  }
}

/// Centre (and radius, where it is free) by weighted least squares.
struct Fit {
  Vec3 centre;
  double radius = 0.0, noise = 0.0;
  Eigen::Matrix4d normal = Eigen::Matrix4d::Zero();  // weighted sum of j j'; last: radius
};

Fit fit(const std::vector<Vec3>& points, Vec3 start, double radius, bool free_radius) {
  Fit f{start, radius};
  double limit = 0.15 * radius;  // before the noise is known
  for (int i = 0; i < 30; ++i) {
    std::vector<double> off;
    Eigen::Vector4d right = Eigen::Vector4d::Zero();
    f.normal.setZero();
    for (const Vec3& p : points) {
      const Vec3 arm = p - f.centre;
      const double d = norm(arm), e = d - f.radius;
      if (!(d > 0.0) || std::abs(e) >= limit) continue;
      off.push_back(std::abs(e));
      const double u = e / limit, w = (1.0 - u * u) * (1.0 - u * u);
      const Eigen::Vector4d j(arm.x / d, arm.y / d, arm.z / d, 1.0);
      f.normal += w * j * j.transpose();
      right += w * e * j;
    }
    if (off.size() < 30) return {f.centre, f.radius, INFINITY};
    const Eigen::Index unknowns = free_radius ? 4 : 3;
    const Eigen::VectorXd step =
        f.normal.topLeftCorner(unknowns, unknowns).ldlt().solve(right.head(unknowns));
    f.centre += Vec3{step(0), step(1), step(2)};
    if (free_radius) f.radius += step(3);
    f.noise = 1.4826 * median(off);
    // The limit closes in on the noise and stays there.
    const double next = std::fmax(kTukey * f.noise, 1e-4 * radius);
    const bool rest = step.norm() < 1e-7 * radius && std::abs(next - limit) < 1e-3 * limit;
    limit = std::fmin(limit, i < 3 ? std::fmax(next, 0.05 * radius) : next);
    if (rest) break;
  }
  return f;
}

/// Means of the residuals over cells of equal area.
struct Form {
  double seen = 0.0, form = 0.0, used = 0.0;
};
Form form_of(const std::vector<Vec3>& points, const Fit& f) {
  struct Cell {
    double n = 0.0, sum = 0.0;
  };
  std::vector<Cell> cells(kBands * kSectors);
  for (const Vec3& p : points) {
    const Vec3 arm = p - f.centre;
    const double d = norm(arm), e = d - f.radius;
    if (!(std::abs(e) <= std::fmax(5.0 * f.noise, 0.02 * f.radius))) continue;
    const int band = std::clamp(static_cast<int>((arm.z / d + 1.0) * 0.5 * kBands), 0, kBands - 1);
    const int sector = std::clamp(
        static_cast<int>((std::atan2(arm.y, arm.x) / (2.0 * std::numbers::pi) + 0.5) * kSectors), 0,
        kSectors - 1);
    Cell& c = cells[static_cast<std::size_t>(band * kSectors + sector)];
    c.n += 1.0;
    c.sum += e;
  }
  Form form;
  double square = 0.0, chance = 0.0;
  for (const Cell& c : cells) {
    if (c.n < 5.0) continue;
    form.used += 1.0;
    square += (c.sum / c.n) * (c.sum / c.n);
    chance += f.noise * f.noise / c.n;
  }
  form.seen = form.used / static_cast<double>(kBands * kSectors);
  if (form.used > 0.0) form.form = std::sqrt(std::fmax(0.0, square - chance) / form.used);
  return form;
}

bool accepted(const std::vector<Vec3>& points, const Fit& f, const Form& form) {
  if (!(f.noise < 0.1 * f.radius) || form.seen < kLeastSeen || form.form > kForm * f.radius)
    return false;
  const Fit free = fit(points, f.centre, f.radius, true);
  if (!(free.noise < INFINITY)) return false;
  const Eigen::Matrix4d inverse = free.normal.ldlt().solve(Eigen::Matrix4d::Identity());
  const double sigma = std::hypot(free.noise, form.form) * std::sqrt(std::fmax(0.0, inverse(3, 3)));
  return std::abs(free.radius - f.radius) <= 3.0 * sigma + kForm * f.radius;
}

FoundSphere state(const Fit& f, const Form& form) {
  FoundSphere s;
  s.centre_mm = f.centre;
  s.radius_mm = f.radius;
  s.noise_mm = f.noise;
  s.form_mm = form.form;
  s.seen = form.seen;
  const Eigen::Matrix3d a = f.normal.topLeftCorner<3, 3>();
  s.points = static_cast<std::size_t>(a.trace());  // each counts by its weight
  // What is common to a cell does not average out within it.
  const double variance =
      f.noise * f.noise + form.form * form.form * a.trace() / std::fmax(1.0, form.used);
  const Eigen::Matrix3d c = variance * a.inverse();
  for (Eigen::Index i = 0; i < 3; ++i)
    for (Eigen::Index j = 0; j < 3; ++j)
      s.covariance[static_cast<std::size_t>(3 * i + j)] = c(i, j);
  s.sigma_mm =
      std::sqrt(std::fmax(0.0, Eigen::SelfAdjointEigenSolver<Eigen::Matrix3d>(c).eigenvalues()(2)));
  return s;
}

}  // namespace

Result<std::vector<FoundSphere>> find_spheres(const Cloud& cloud, std::span<const double> radii,
                                              const RunContext& run) {
  Box3 box;
  for (const Vec3& p : cloud.points_mm) box.add(p);
  const bool station_known =
      cloud.station_mm.has_value() ||
      (!cloud.stations.empty() && std::all_of(cloud.stations.begin(), cloud.stations.end(),
                                              [](const ScanStation& s) { return s.position_mm; }));
  std::vector<double> sizes(radii.begin(), radii.end());
  std::sort(sizes.begin(), sizes.end());
  sizes.erase(std::unique(sizes.begin(), sizes.end()), sizes.end());
  std::vector<FoundSphere> found;
  for (const double radius : sizes) {
    if (!(radius > 0.0))
      return fail(kSpheres, fmt::format("a sphere's radius must be above 0 mm, is {}", radius));
    if (run.stopped()) return fail(kCancelled, "the search for spheres was cancelled");
    if (cloud.points_mm.empty()) continue;
    VoxelGrid grid;
    if (!make_voxel_grid(box, radius / kVoxelsPerRadius, grid))
      return fail(kSpheres,
                  fmt::format("spheres of {} mm are too small for a cloud of this extent; "
                              "cut it to the part and its spheres",
                              radius));
    auto places = places_of(make_surfels(cloud, grid), station_known, box, radius);
    if (places.empty()) continue;
    gather(cloud.points_mm, radius, places);
    for (const Place& place : places) {
      const Fit f = fit(place.points, place.centre, radius, false);
      if (!(f.noise < INFINITY)) continue;
      const Form form = form_of(place.points, f);
      if (!accepted(place.points, f, form)) continue;
      const FoundSphere s = state(f, form);
      // Several places may lead to one sphere; a larger radius may lie round a smaller one.
      const auto same = std::find_if(found.begin(), found.end(), [&](const FoundSphere& o) {
        return norm(o.centre_mm - s.centre_mm) < 0.5 * std::max(o.radius_mm, s.radius_mm);
      });
      if (same == found.end())
        found.push_back(s);
      else if (s.form_mm / s.radius_mm < same->form_mm / same->radius_mm)
        *same = s;
    }
  }
  std::stable_sort(found.begin(), found.end(),
                   [](const FoundSphere& a, const FoundSphere& b) { return a.seen > b.seen; });
  return found;
}

}  // namespace maquette::scan

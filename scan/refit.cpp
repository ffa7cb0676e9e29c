// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/refit.hpp"

#include <algorithm>

#include "core/check.hpp"
#include "scan/detail/majority_step.hpp"

namespace maquette::scan {
namespace {

// Of a part most of which differs nobody knows which rest is right.
constexpr double kMostInPatches = 0.5;
constexpr int kRounds = 3;
constexpr double kAtRestSigmas = 0.2;

bool in_patch(Vec3 p, const Significance& found) {
  return std::any_of(found.maps.begin(), found.maps.end(), [&](const CellMap& m) {
    const auto r = static_cast<std::ptrdiff_t>((p.y - m.y0_mm) / m.cell_mm);
    const auto c = static_cast<std::ptrdiff_t>((p.x - m.x0_mm) / m.cell_mm);
    return m.in_patch.contains(r, c) && m.in_patch(r, c) != 0;
  });
}

void move(std::span<Vec3> points, const RigidTransform& by) {
  for (Vec3& p : points) p = by.point(p);
}

/// What a fit to some of the points says of all.
void take_over(Registration& pose, const Registration& again) {
  pose.covariance = again.covariance;
  pose.centre_mm = again.centre_mm;
  pose.sigma_translation_mm = again.sigma_translation_mm;
  pose.sigma_rotation_rad = again.sigma_rotation_rad;
  pose.effective_points = again.effective_points;
  pose.noise_mm = again.noise_mm;
  pose.free_directions = again.free_directions;
}

/// One scan on its way: nothing is final before a registration says so.
struct Way {
  std::span<Vec3> points;
  RigidTransform step;  ///< of the points so far
  std::optional<Registration> fit;
  bool at_rest = false;
};

/// The scan's fit without patches. @return CORE_CANCELLED
Result<void> fit_rest(Way& way, std::optional<Vec3> station, const Significance& found,
                      const heightmap::ModelField& surface, const RunContext& run) {
  Cloud rest;
  for (const Vec3& p : way.points)
    if (!in_patch(p, found)) rest.points_mm.push_back(p);
  way.at_rest = true;
  if (static_cast<double>(rest.points_mm.size()) <
      (1.0 - kMostInPatches) * static_cast<double>(way.points.size()))
    return {};
  if (station) rest.station_mm = way.step.point(*station);
  RegisterOptions near;
  near.anywhere = false;
  auto again = register_scan(rest, surface, near, run);
  if (!again && again.error().code == kCancelled) return tl::unexpected(again.error());
  if (!again) return {};
  const Vec3 moved = again->model_from_scan.point(again->centre_mm) - again->centre_mm;
  way.at_rest = norm(moved) < kAtRestSigmas * again->sigma_translation_mm;
  move(way.points, again->model_from_scan);
  way.step = again->model_from_scan * way.step;
  way.fit = *std::move(again);
  return {};
}

std::vector<Way> ways_of(std::span<Vec3> points, std::span<const ScanPose> scans) {
  std::vector<Way> ways;
  std::size_t first = 0;
  for (const ScanPose& s : scans) {
    ways.push_back({points.subspan(first, s.points), {}, {}});
    first += s.points;
  }
  return ways;
}

/// Poses follow where there is a fit; elsewhere points go back.
std::vector<RigidTransform> finish(std::span<Way> ways, std::span<ScanPose> scans) {
  std::vector<RigidTransform> steps(scans.size());
  for (std::size_t k = 0; k < ways.size(); ++k) {
    if (!ways[k].fit) {
      move(ways[k].points, ways[k].step.inverse());
      continue;
    }
    steps[k] = ways[k].step;
    Registration& pose = scans[k].registration;
    pose.model_from_scan = steps[k] * pose.model_from_scan;
    take_over(pose, *ways[k].fit);
  }
  return steps;
}

}  // namespace

Result<std::vector<RigidTransform>> refit_corrected(std::span<Vec3> points,
                                                    std::span<ScanPose> scans,
                                                    std::span<const std::optional<Vec3>> stations,
                                                    const heightmap::ModelField& surface,
                                                    const RunContext& run) {
  MAQUETTE_CHECK(stations.size() == scans.size(), "{} scans, {} stations", scans.size(),
                 stations.size());
  std::vector<Way> ways = ways_of(points, scans);
  for (std::size_t k = 0; k < ways.size(); ++k)
    MAQUETTE_TRY_VOID(fit_rest(ways[k], stations[k], {}, surface, run));
  return finish(ways, scans);
}

Result<std::vector<RigidTransform>> refit(std::span<Vec3> points, std::span<ScanPose> scans,
                                          std::span<const std::optional<Vec3>> stations,
                                          const heightmap::ModelField& surface,
                                          const Significance& found, const Search& search,
                                          const RunContext& run) {
  MAQUETTE_CHECK(stations.size() == scans.size(), "{} scans, {} stations", scans.size(),
                 stations.size());
  if (found.findings.empty()) return std::vector<RigidTransform>(scans.size());
  std::vector<Way> ways = ways_of(points, scans);
  for (Way& way : ways) {
    way.step = detail::majority_step(way.points, surface);
    move(way.points, way.step);
  }
  for (int round = 0; round < kRounds; ++round) {
    if (std::all_of(ways.begin(), ways.end(), [](const Way& w) { return w.at_rest; })) break;
    MAQUETTE_TRY(const Significance now, search());
    for (std::size_t k = 0; k < ways.size(); ++k)
      if (!ways[k].at_rest) MAQUETTE_TRY_VOID(fit_rest(ways[k], stations[k], now, surface, run));
  }
  return finish(ways, scans);
}

}  // namespace maquette::scan

// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/check_stations.hpp"

#include <cmath>
#include <optional>

#include <fmt/format.h>

namespace maquette::scan {
namespace {

using heightmap::ModelField;

constexpr std::size_t kSample = 200'000;
constexpr std::size_t kLeastPoints = 1'000;
constexpr double kSigmas = 5.0, kOfNoise = 0.25;

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

}  // namespace

Result<void> check_viewpoints(const Cloud& cloud, const RigidTransform& model_from_scan,
                              const ModelField& design) {
  const auto check = [&](Vec3 place, std::size_t first, std::size_t n) -> Result<void> {
    const Vec3 from = model_from_scan.point(place);
    std::size_t behind = 0, judged = 0;
    for (std::size_t i = first; i < first + n; i += 1 + n / kSample)
      if (const auto b = from_behind(model_from_scan.point(cloud.points_mm[i]), from, design)) {
        ++judged;
        behind += *b ? 1U : 0U;
      }
    const double share = static_cast<double>(behind) / static_cast<double>(judged);
    if (judged == 0 || share <= kMostFromBehind) return {};
    return fail(kStationPose,
                fmt::format("a scanner at x {:.1f}, y {:.1f}, z {:.1f} mm of the model frame would "
                            "see {:.0f} % of its points from behind; give its place in the frame "
                            "of the cloud, or none",
                            from.x, from.y, from.z, 100.0 * share));
  };
  if (cloud.station_mm) return check(*cloud.station_mm, 0, cloud.points_mm.size());
  std::size_t first = 0;
  for (const ScanStation& s : cloud.stations) {
    if (s.position_mm) {
      MAQUETTE_TRY_VOID(check(*s.position_mm, first, s.points));
    }
    first += s.points;
  }
  return {};
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

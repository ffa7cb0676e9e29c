// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/patch_pose.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include "scan/detail/normal_equations.hpp"

namespace maquette::scan::detail {
namespace {

using Columns = std::array<double, 6>;

/// Mean of the columns over points inside and around, as they are read.
struct Difference {
  struct Sum {
    std::vector<Columns> of_scan;
    double points = 0.0;
  };
  Sum inside, around;
};

/// The window of one patch on the grid of its map: 1 inside, 2 around.
struct Roles {
  const CellMap* map = nullptr;
  std::ptrdiff_t top = 0, left = 0;
  Grid<std::uint8_t> role;

  Roles(const CellMap& of, const FoundPatch& patch) : map(&of) {
    std::ptrdiff_t bottom = 0, right = 0;
    top = of.mean_mm.rows(), left = of.mean_mm.cols();
    for (const auto* cells : {&patch.inside, &patch.around})
      for (const auto& [r, c] : *cells) {
        top = std::min(top, r), bottom = std::max(bottom, r);
        left = std::min(left, c), right = std::max(right, c);
      }
    if (bottom < top || right < left) return;
    role = Grid<std::uint8_t>(bottom - top + 1, right - left + 1, 0);
    for (const auto& [r, c] : patch.around) role(r - top, c - left) = 2;
    for (const auto& [r, c] : patch.inside) role(r - top, c - left) = 1;
  }
  [[nodiscard]] std::uint8_t of(Vec3 p) const {
    const auto r = static_cast<std::ptrdiff_t>((p.y - map->y0_mm) / map->cell_mm) - top;
    const auto c = static_cast<std::ptrdiff_t>((p.x - map->x0_mm) / map->cell_mm) - left;
    return role.contains(r, c) ? role(r, c) : std::uint8_t{0};
  }
};

const CellMap& map_of(const Finding& f, std::span<const CellMap> maps) {
  return *std::min_element(maps.begin(), maps.end(), [&](const CellMap& a, const CellMap& b) {
    return std::abs(a.cell_mm - f.cell_mm) < std::abs(b.cell_mm - f.cell_mm);
  });
}

double variance_of(const Difference& d, std::span<const ScanPose> scans) {
  if (d.inside.points == 0.0 || d.around.points == 0.0) return 0.0;
  double variance = 0.0;
  for (std::size_t k = 0; k < scans.size(); ++k) {
    const auto& covariance = scans[k].registration.covariance;
    Columns c;
    for (std::size_t a = 0; a < 6; ++a)
      c[a] = d.inside.of_scan[k][a] / d.inside.points - d.around.of_scan[k][a] / d.around.points;
    for (std::size_t a = 0; a < 6; ++a)
      for (std::size_t b = 0; b < 6; ++b) variance += c[a] * covariance[6 * a + b] * c[b];
  }
  return std::fmax(0.0, variance);
}

}  // namespace

void add_pose(std::vector<FoundPatch>& patches, std::span<const CellMap> maps,
              std::span<const Vec3> points, std::span<const float> deviation,
              std::span<const ScanPose> scans, const heightmap::ModelField& surface) {
  if (patches.empty() || scans.empty()) return;
  std::vector<Roles> roles;
  for (const FoundPatch& p : patches) roles.emplace_back(map_of(p.finding, maps), p);
  const Columns zero{};
  const Difference::Sum none{std::vector<Columns>(scans.size(), zero)};
  std::vector<Difference> differences(patches.size(), {none, none});
  const FieldSurface field(surface);
  std::size_t scan = 0, end = scans[0].points;
  for (std::size_t i = 0; i < points.size(); ++i) {
    while (i >= end) end += scans[++scan].points;
    if (std::isnan(deviation[i])) continue;
    Foot foot;
    bool met = false;
    for (std::size_t k = 0; k < roles.size(); ++k) {
      const std::uint8_t role = roles[k].of(points[i]);
      if (role == 0) continue;
      if (!met) {
        field.feet({&points[i], 1}, {&foot, 1});
        met = true;
      }
      if (std::isnan(foot.e_mm)) break;
      const auto j = pose_columns(points[i], foot.normal, scans[scan].registration.centre_mm);
      Difference::Sum& sum = role == 1 ? differences[k].inside : differences[k].around;
      sum.points += 1.0;
      for (std::size_t a = 0; a < 6; ++a) sum.of_scan[scan][a] += j[a];
    }
  }
  for (std::size_t k = 0; k < patches.size(); ++k) {
    Finding& f = patches[k].finding;
    const double pose = std::sqrt(variance_of(differences[k], scans));
    f.sigma_height_mm = std::hypot(f.sigma_height_mm, pose);
    f.sigma_volume_mm3 = std::hypot(f.sigma_volume_mm3, f.area_mm2 * pose);
  }
}

}  // namespace maquette::scan::detail

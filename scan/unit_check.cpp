// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>

#include "scan/register.hpp"

namespace maquette::scan {
namespace {

/// Largest of the three extents without the outermost 0.5 % at each end: one stray point
/// must not stretch the cloud.
double robust_extent(const std::vector<Vec3>& points) {
  constexpr std::size_t kSample = 20'000;
  const std::size_t n = points.size(), m = std::min(n, kSample);
  std::array<std::vector<double>, 3> axes;
  for (std::size_t k = 0; k < m; ++k) {
    const Vec3 p = points[k * n / m];
    axes[0].push_back(p.x);
    axes[1].push_back(p.y);
    axes[2].push_back(p.z);
  }
  double extent = 0.0;
  for (auto& v : axes) {
    std::sort(v.begin(), v.end());
    const std::size_t cut = m / 200;
    extent = std::fmax(extent, v[m - 1 - cut] - v[cut]);
  }
  return extent;
}

struct Unit {
  const char* name;
  double mm;         ///< of one
  double tolerance;  ///< factor by which the extents may differ and it is still believed
};
// An inch is only 25 times a millimetre, and a scan of a twenty-fifth of a part is
// conceivable: a narrower window than for the factors of a thousand.
constexpr std::array kUnits{Unit{"metres", 1000.0, 4.0}, Unit{"inches", 25.4, 1.6},
                            Unit{"micrometres", 0.001, 4.0}};

}  // namespace

Result<void> check_unit(const Cloud& cloud, const heightmap::ModelField& design) {
  if (cloud.points_mm.size() < 30) return {};  // too few to have an extent
  const double wide = design.x_mm(design.z_mm.cols() - 1) - design.x0.value();
  const double deep = design.y_mm(design.z_mm.rows() - 1) - design.y0.value();
  const double part = std::fmax(wide, deep);
  const double extent = robust_extent(cloud.points_mm);
  for (const Unit& unit : kUnits) {
    const double ratio = extent * unit.mm / part;
    if (ratio < 1.0 / unit.tolerance || ratio > unit.tolerance) continue;
    return fail(
        kUnitSlip,
        fmt::format("the cloud extends over {:.4g}, the design over {:.4g} mm: that fits if "
                    "the cloud is in {}; multiply its coordinates by {} and try again",
                    extent, part, unit.name, unit.mm));
  }
  return {};
}

}  // namespace maquette::scan

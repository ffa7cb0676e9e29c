// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/upper_envelope.hpp"

#include <algorithm>
#include <cmath>

namespace maquette::scan {
namespace {

constexpr double kMostCells = 4096.0;
constexpr double kSlack = 1e-6;  // of a spacing: nodes on edges belong to the triangle

/// Twice the area of the projection, positive where the triangle faces up.
double twice_area(Vec3 a, Vec3 b, Vec3 c) {
  return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x);
}

void raise(heightmap::ModelField& f, Vec3 a, Vec3 b, Vec3 c) {
  const double whole = twice_area(a, b, c), s = f.spacing.value();
  if (!(std::abs(whole) > 1e-12 * s * s)) return;  // stands upright
  const auto span = [&](double u, double v, double w, double origin, std::ptrdiff_t n) {
    return std::pair{
        std::max<std::ptrdiff_t>(
            0, std::lround(std::ceil((std::min({u, v, w}) - origin) / s - kSlack))),
        std::min<std::ptrdiff_t>(
            n - 1, std::lround(std::floor((std::max({u, v, w}) - origin) / s + kSlack)))};
  };
  const auto [c0, c1] = span(a.x, b.x, c.x, f.x0.value(), f.z_mm.cols());
  const auto [r0, r1] = span(a.y, b.y, c.y, f.y0.value(), f.z_mm.rows());
  for (std::ptrdiff_t row = r0; row <= r1; ++row)
    for (std::ptrdiff_t col = c0; col <= c1; ++col) {
      const Vec3 p{f.x_mm(col), f.y_mm(row), 0.0};
      const double u = twice_area(p, b, c) / whole, v = twice_area(a, p, c) / whole;
      const double w = 1.0 - u - v;
      if (std::min({u, v, w}) < -kSlack) continue;
      // Within the triangle's own heights, whatever the slack makes of a steep one.
      const double z = std::clamp(u * a.z + v * b.z + w * c.z, std::min({a.z, b.z, c.z}),
                                  std::max({a.z, b.z, c.z}));
      float& at = f.z_mm(row, col);
      if (!(static_cast<double>(at) >= z)) at = static_cast<float>(z);
    }
}

}  // namespace

Result<heightmap::ModelField> upper_envelope(const TriMesh& mesh) {
  const auto& v = mesh.vertices_mm;
  double area = 0.0, up = 0.0;
  Box3 box;
  for (const auto& t : mesh.triangles) {
    for (const std::uint32_t corner : t) box.add(v[corner]);
    if (const double twice = twice_area(v[t[0]], v[t[1]], v[t[2]]); twice > 0.0)
      area += 0.5 * twice, up += 1.0;
  }
  const double wide = box.max.x - box.min.x, deep = box.max.y - box.min.y;
  if (!(up > 0.0 && wide > 0.0 && deep > 0.0))
    return fail(kNoUpperSide,
                "no triangle of the mesh faces up: is its z axis vertical, and is it turned inside "
                "out?");
  const double leg = std::sqrt(2.0 * area / up);
  const double longest = std::fmax(wide, deep);
  // A whole number of cells along the longest side, at least eight.
  const double cells = std::clamp(std::round(longest / leg), 8.0, kMostCells);
  const double spacing = longest / cells;
  const auto count = [&](double length) {
    return std::max<std::ptrdiff_t>(
        2, static_cast<std::ptrdiff_t>(std::floor(length / spacing + kSlack)) + 1);
  };
  heightmap::ModelField f{Grid<float>(count(deep), count(wide), NAN), Millimetres{spacing},
                          Millimetres{box.min.x}, Millimetres{box.min.y}};
  for (const auto& t : mesh.triangles) raise(f, v[t[0]], v[t[1]], v[t[2]]);
  return f;
}

}  // namespace maquette::scan

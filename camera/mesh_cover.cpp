// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/mesh_cover.hpp"

#include <cmath>
#include <cstddef>

#include <fmt/format.h>

namespace maquette::camera {
namespace {

/// Which of n pixels a whole number beyond them shows.
std::ptrdiff_t shown_at(std::ptrdiff_t i, std::ptrdiff_t n, MeshPicture::Beyond beyond) {
  using Beyond = MeshPicture::Beyond;
  if (i >= 0 && i < n) return i;
  if (beyond == Beyond::edge) return i < 0 ? 0 : n - 1;
  const std::ptrdiff_t period = beyond == Beyond::mirrored ? 2 * n : n;
  const std::ptrdiff_t in = ((i % period) + period) % period;
  return in < n ? in : period - 1 - in;
}

}  // namespace

Bands MeshPicture::at(double u, double v) const {
  const std::ptrdiff_t rows = factor[0].rows(), cols = factor[0].cols();
  // Far outside whole numbers end; a NaN, too, shows the corner.
  const auto inside = [](double x) { return std::abs(x) < 1e6 ? x : 0.0; };
  const double x = inside(u) * static_cast<double>(cols) - 0.5,
               y = inside(v) * static_cast<double>(rows) - 0.5;
  const double left = std::floor(x), top = std::floor(y);
  const double a = x - left, b = y - top;
  const auto col = [&](std::ptrdiff_t by) {
    return shown_at(static_cast<std::ptrdiff_t>(left) + by, cols, beyond[0]);
  };
  const auto row = [&](std::ptrdiff_t by) {
    return shown_at(static_cast<std::ptrdiff_t>(top) + by, rows, beyond[1]);
  };
  const std::array<std::ptrdiff_t, 2> c{col(0), col(1)}, r{row(0), row(1)};
  Bands out{};
  for (std::size_t band = 0; band < 3; ++band) {
    const auto z = [&](std::size_t i, std::size_t j) {
      return static_cast<double>(factor[band](r[i], c[j]));
    };
    out[band] = (1 - b) * ((1 - a) * z(0, 0) + a * z(0, 1)) + b * ((1 - a) * z(1, 0) + a * z(1, 1));
  }
  return out;
}

Result<void> check_cover(const MeshCover& cover, const TriMesh& mesh) {
  const auto wrong = [](std::string what) { return fail(kMaterialOutOfRange, std::move(what)); };
  if (cover.pictures.size() != cover.materials.size() ||
      cover.material_of.size() != mesh.triangles.size() ||
      cover.at_corner.size() != mesh.triangles.size())
    return wrong(
        fmt::format("a mesh of {} triangles is covered by {} materials with {} pictures, "
                    "named by {} triangles, {} of them with coordinates",
                    mesh.triangles.size(), cover.materials.size(), cover.pictures.size(),
                    cover.material_of.size(), cover.at_corner.size()));
  for (std::size_t i = 0; i < cover.materials.size(); ++i) {
    MAQUETTE_TRY_VOID(check_material(cover.materials[i]));
    if (cover.pictures[i] != nullptr && !of_one_size(cover.pictures[i]->factor))
      return wrong(fmt::format("material {}: its picture has bands of different sizes or none",
                               cover.materials[i].name));
  }
  for (std::size_t t = 0; t < mesh.triangles.size(); ++t) {
    if (cover.material_of[t] >= cover.materials.size())
      return wrong(fmt::format("triangle {}: material {} of {}", t, cover.material_of[t],
                               cover.materials.size()));
    if (cover.pictures[cover.material_of[t]] == nullptr) continue;
    for (const auto& corner : cover.at_corner[t])
      if (!std::isfinite(corner[0]) || !std::isfinite(corner[1]))
        return wrong(
            fmt::format("triangle {} of material {}: it has a picture, but the corners "
                        "have no places in it",
                        t, cover.materials[cover.material_of[t]].name));
  }
  return {};
}

std::array<double, 2> place_in_picture(const MeshCover& cover, const TriMesh& mesh,
                                       std::uint32_t triangle, Vec3 point) {
  const auto& corners = mesh.triangles[triangle];
  const Vec3 a = mesh.vertices_mm[corners[0]], ab = mesh.vertices_mm[corners[1]] - a,
             ac = mesh.vertices_mm[corners[2]] - a, ap = point - a;
  const Vec3 n = cross(ab, ac);
  const double area = dot(n, n);
  const double to_b = area > 0.0 ? dot(cross(ap, ac), n) / area : 0.0;
  const double to_c = area > 0.0 ? dot(cross(ab, ap), n) / area : 0.0;
  const auto& at = cover.at_corner[triangle];
  const auto of = [&](std::size_t k) {
    return (1.0 - to_b - to_c) * static_cast<double>(at[0][k]) +
           to_b * static_cast<double>(at[1][k]) + to_c * static_cast<double>(at[2][k]);
  };
  return {of(0), of(1)};
}

}  // namespace maquette::camera

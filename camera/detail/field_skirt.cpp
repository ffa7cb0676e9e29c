// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/detail/field_skirt.hpp"

#include <utility>

namespace maquette::camera::detail {

TriMesh field_skirt(const heightmap::ModelField& field, double base_mm) {
  TriMesh mesh;
  const std::ptrdiff_t rows = field.z_mm.rows(), cols = field.z_mm.cols();
  // Counter-clockwise around the block, seen from above.
  std::vector<std::pair<std::ptrdiff_t, std::ptrdiff_t>> border;
  for (std::ptrdiff_t c = 0; c + 1 < cols; ++c) border.emplace_back(0, c);
  for (std::ptrdiff_t r = 0; r + 1 < rows; ++r) border.emplace_back(r, cols - 1);
  for (std::ptrdiff_t c = cols - 1; c > 0; --c) border.emplace_back(rows - 1, c);
  for (std::ptrdiff_t r = rows - 1; r > 0; --r) border.emplace_back(r, 0);
  for (const auto& [r, c] : border) {
    const double x = field.x_mm(c), y = field.y_mm(r);
    mesh.vertices_mm.push_back({x, y, static_cast<double>(field.z_mm(r, c))});
    mesh.vertices_mm.push_back({x, y, base_mm});
  }
  const auto count = static_cast<std::uint32_t>(border.size());
  for (std::uint32_t i = 0; i < count; ++i) {
    const std::uint32_t top = 2 * i, next = 2 * ((i + 1) % count);
    if (!std::isfinite(mesh.vertices_mm[top].z) || !std::isfinite(mesh.vertices_mm[next].z))
      continue;
    mesh.triangles.push_back({top, top + 1, next + 1});
    mesh.triangles.push_back({top, next + 1, next});
  }
  // A void would make the box of the mesh endless.
  for (Vec3& v : mesh.vertices_mm)
    if (!std::isfinite(v.z)) v.z = base_mm;
  const auto corner = [&](std::ptrdiff_t k) { return static_cast<std::uint32_t>(2 * k + 1); };
  const std::uint32_t a = corner(0), b = corner(cols - 1), c = corner(cols + rows - 2),
                      d = corner(2 * cols + rows - 3);
  mesh.triangles.push_back({a, c, b});
  mesh.triangles.push_back({a, d, c});
  return mesh;
}

}  // namespace maquette::camera::detail

// SPDX-License-Identifier: GPL-3.0-or-later
#include <array>
#include <bit>
#include <cstring>
#include <vector>

#include "core/files.hpp"
#include "export/cad.hpp"
#include "export/limits.hpp"
#include "export/text_lines.hpp"

namespace maquette::exporting {
namespace {

static_assert(std::endian::native == std::endian::little, "STL is little-endian");

constexpr std::size_t kRecord = 50;  ///< normal, three corners, attribute count

void put(char*& at, Vec3 v) {
  const std::array<float, 3> xyz{static_cast<float>(v.x), static_cast<float>(v.y),
                                 static_cast<float>(v.z)};
  std::memcpy(at, xyz.data(), sizeof xyz);
  at += sizeof xyz;
}

}  // namespace

Result<void> write_stl(const TriMesh& mesh, const std::filesystem::path& path,
                       const RunContext& run) {
  MAQUETTE_TRY_VOID(check_mesh_for_export(mesh, path));
  return write_stl(TriMeshStream(mesh), path, run);
}

Result<void> write_stl(const MeshStream& mesh, const std::filesystem::path& path,
                       const RunContext& run) {
  MAQUETTE_TRY_VOID(
      within_limit(mesh.triangle_count(), kStlTriangleLimit, "triangles", "binary STL", path));
  MAQUETTE_TRY(auto file, AtomicFile::create(path));
  // Must not start with "solid": readers take that for the text form.
  std::array<char, 84> header{};
  std::strncpy(header.data(), "maquette; model frame x east y north z up; UNITS=mm", 80);
  const auto count = static_cast<std::uint32_t>(mesh.triangle_count());
  std::memcpy(header.data() + 80, &count, sizeof count);
  file.write(header.data(), header.size());

  const auto append = [&mesh](fmt::memory_buffer& out, std::size_t first, std::size_t last) {
    out.resize((last - first) * kRecord);
    char* at = out.data();
    std::vector<MeshStream::Corners> corners(last - first);
    mesh.corners(first, corners);
    for (const auto& [a, b, c] : corners) {
      const Vec3 normal = cross(b - a, c - a);
      const double length = norm(normal);
      put(at, length > 0.0 ? (1.0 / length) * normal : Vec3{});
      put(at, a);
      put(at, b);
      put(at, c);
      std::memset(at, 0, 2);
      at += 2;
    }
  };
  if (!write_pieces(file, mesh.triangle_count(), append, run, 0.0, 1.0))
    return fail(kCancelled, fmt::format("{}: stopped while it was written", path.string()));
  return file.commit();
}

}  // namespace maquette::exporting

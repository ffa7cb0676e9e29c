// SPDX-License-Identifier: GPL-3.0-or-later
#include "export/glb_file.hpp"

#include <fstream>

#include "export/limits.hpp"

namespace maquette::exporting {
namespace {

constexpr std::uint32_t kMagic = 0x46546C67;  ///< "glTF"
constexpr std::uint32_t kVersion = 2;

}  // namespace

Result<std::uint64_t> write_glb_head(AtomicFile& file, std::string json, std::uint64_t binary_bytes,
                                     const std::filesystem::path& path) {
  json.resize(glb_padded(json.size()), ' ');
  const std::uint64_t total = 12 + 8 + json.size() + 8 + binary_bytes;
  MAQUETTE_TRY_VOID(within_limit(total, kGlbByteLimit, "bytes", "glb", path));
  const auto put = [&file](std::uint64_t value) {
    const auto word = static_cast<std::uint32_t>(value);
    file.write(&word, sizeof word);
  };
  put(kMagic);
  put(kVersion);
  put(total);
  put(json.size());
  put(0x4E4F534A);  // "JSON"
  file.write(json);
  put(binary_bytes);
  put(0x004E4942);  // "BIN"
  return total;
}

std::optional<std::uint64_t> whole_glb_bytes(const std::filesystem::path& path) {
  std::error_code ec;
  const auto size = std::filesystem::file_size(path, ec);
  std::array<unsigned char, 12> head{};
  std::ifstream file(path, std::ios::binary);
  if (ec || !file.read(reinterpret_cast<char*>(head.data()), head.size())) return std::nullopt;
  const auto word = [&](std::size_t i) {
    std::uint32_t value = 0;
    for (std::size_t k = 4; k-- > 0;) value = value << 8 | head[4 * i + k];
    return value;
  };
  if (word(0) != kMagic || word(1) != kVersion || word(2) != size) return std::nullopt;
  return size;
}

std::vector<Float3> gltf_normals(const TriMesh& mesh) {
  std::vector<Float3> normals(mesh.vertices_mm.size(), Float3{});
  for (const auto& t : mesh.triangles) {
    const Vec3 a = mesh.vertices_mm[t[0]];
    // The cross product's length is twice the area.
    const Vec3 n = gltf_axes(cross(mesh.vertices_mm[t[1]] - a, mesh.vertices_mm[t[2]] - a));
    const Float3 turned{static_cast<float>(n.x), static_cast<float>(n.y), static_cast<float>(n.z)};
    for (const std::uint32_t v : t)
      for (std::size_t k = 0; k < 3; ++k) normals[v][k] += turned[k];
  }
  for (Float3& n : normals) {
    const double length =
        std::hypot(static_cast<double>(n[0]), static_cast<double>(n[1]), static_cast<double>(n[2]));
    if (length > 0.0)
      for (float& x : n) x = static_cast<float>(static_cast<double>(x) / length);
    else
      n = {0.0F, 1.0F, 0.0F};
  }
  return normals;
}

}  // namespace maquette::exporting

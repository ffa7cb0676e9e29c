// SPDX-License-Identifier: GPL-3.0-or-later
#include <vector>

#include "core/files.hpp"
#include "export/cad.hpp"
#include "export/limits.hpp"
#include "export/text_lines.hpp"

namespace maquette::exporting {

Result<void> write_obj(const TriMesh& mesh, const std::filesystem::path& path,
                       const RunContext& run) {
  MAQUETTE_TRY_VOID(check_mesh_for_export(mesh, path));
  return write_obj(TriMeshStream(mesh), path, run);
}

Result<void> write_obj(const MeshStream& mesh, const std::filesystem::path& path,
                       const RunContext& run) {
  MAQUETTE_TRY(auto file, AtomicFile::create(path));
  const std::size_t vertices = mesh.vertex_count(), triangles = mesh.triangle_count();
  file.write(
      fmt::format("# maquette\n# frame: model, x east, y north, z up\n# unit: mm\n"
                  "# {} vertices, {} triangles\n",
                  vertices, triangles));
  const auto vertex_lines = [&mesh](fmt::memory_buffer& out, std::size_t first, std::size_t last) {
    std::vector<Vec3> piece(last - first);
    mesh.vertices(first, piece);
    for (const Vec3& v : piece) {
      append_text(out, "v ");
      append_micro(out, v.x);
      out.push_back(' ');
      append_micro(out, v.y);
      out.push_back(' ');
      append_micro(out, v.z);
      out.push_back('\n');
    }
  };
  const auto face_lines = [&mesh](fmt::memory_buffer& out, std::size_t first, std::size_t last) {
    std::vector<MeshStream::Triangle> piece(last - first);
    mesh.triangles(first, piece);
    for (const MeshStream::Triangle& t : piece) {
      out.push_back('f');
      for (const std::uint32_t corner : t) {
        out.push_back(' ');
        append_integer(out, std::uint64_t{corner} + 1);
      }
      out.push_back('\n');
    }
  };
  if (!write_pieces(file, vertices, vertex_lines, run, 0.0, 0.4) ||
      !write_pieces(file, triangles, face_lines, run, 0.4, 1.0))
    return fail(kCancelled, fmt::format("{}: stopped while it was written", path.string()));
  return file.commit();
}

}  // namespace maquette::exporting

// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <vector>

#include "core/files.hpp"
#include "export/cad.hpp"
#include "export/limits.hpp"
#include "export/text_lines.hpp"

namespace maquette::exporting {
namespace {

/// Prims are named by identifiers: letters, digits and _, no digit first.
std::string identifier(std::string_view name) {
  std::string id;
  for (const char c : name)
    id += (c >= 'a' && c <= 'z') || (c >= 'A' && c <= 'Z') || (c >= '0' && c <= '9') ? c : '_';
  return id.empty() || (id[0] >= '0' && id[0] <= '9') ? "_" + id : id;
}

void append_point(fmt::memory_buffer& out, Vec3 v) {
  // The shortest text that is this float again.
  fmt::format_to(fmt::appender(out), "({}, {}, {})", static_cast<float>(v.x),
                 static_cast<float>(v.y), static_cast<float>(v.z));
}

/// Matt paint, as lod_asset.hpp has it in glTF.
constexpr std::string_view kMaterial = R"(
    def Material "paint"
    {{
        token outputs:surface.connect = </{0}/paint/shader.outputs:surface>

        def Shader "shader"
        {{
            uniform token info:id = "UsdPreviewSurface"
            color3f inputs:diffuseColor = (0.36, 0.35, 0.33)
            float inputs:metallic = 0
            float inputs:roughness = 1
            token outputs:surface
        }}
    }}
}}
)";

}  // namespace

Result<void> write_usda(const TriMesh& mesh, std::string_view name,
                        const std::filesystem::path& path, const RunContext& run) {
  MAQUETTE_TRY_VOID(check_mesh_for_export(mesh, path));
  return write_usda(TriMeshStream(mesh), name, path, run);
}

Result<void> write_usda(const MeshStream& mesh, std::string_view name,
                        const std::filesystem::path& path, const RunContext& run) {
  const std::size_t vertices = mesh.vertex_count(), triangles = mesh.triangle_count();
  MAQUETTE_TRY_VOID(within_limit(vertices, kUsdVertexLimit, "vertices", "USD", path));
  MAQUETTE_TRY(auto file, AtomicFile::create(path));
  Box3 box;
  constexpr std::size_t kPiece = 1 << 16;
  std::vector<Vec3> piece;
  for (std::size_t first = 0; first < vertices; first += kPiece) {
    piece.resize(std::min(kPiece, vertices - first));
    mesh.vertices(first, piece);
    for (const Vec3& v : piece) box.add(v);
  }
  const std::string id = identifier(name);
  fmt::memory_buffer head;
  fmt::format_to(fmt::appender(head),
                 "#usda 1.0\n(\n    defaultPrim = \"{0}\"\n"
                 "    doc = \"maquette; model frame: x east, y north, z up; unit mm\"\n"
                 "    metersPerUnit = 0.001\n    upAxis = \"Z\"\n)\n\n"
                 "def Xform \"{0}\" (\n    kind = \"component\"\n)\n{{\n"
                 "    def Mesh \"surface\" (\n"
                 "        prepend apiSchemas = [\"MaterialBindingAPI\"]\n    )\n    {{\n"
                 "        float3[] extent = [",
                 id);
  append_point(head, box.min);
  append_text(head, ", ");
  append_point(head, box.max);
  append_text(head, "]\n        int[] faceVertexCounts = [");
  file.write({head.data(), head.size()});
  const auto counts = [](fmt::memory_buffer& out, std::size_t first, std::size_t last) {
    for (std::size_t i = first; i < last; ++i) append_text(out, i == 0 ? "3" : ", 3");
  };
  const auto corners = [&mesh](fmt::memory_buffer& out, std::size_t first, std::size_t last) {
    std::vector<MeshStream::Triangle> some(last - first);
    mesh.triangles(first, some);
    for (std::size_t i = 0; i < some.size(); ++i)
      for (std::size_t k = 0; k < 3; ++k) {
        if (first + i + k > 0) append_text(out, ", ");
        append_integer(out, some[i][k]);
      }
  };
  const auto points = [&mesh](fmt::memory_buffer& out, std::size_t first, std::size_t last) {
    std::vector<Vec3> some(last - first);
    mesh.vertices(first, some);
    for (std::size_t i = 0; i < some.size(); ++i) {
      if (first + i > 0) append_text(out, ", ");
      append_point(out, some[i]);
    }
  };
  bool whole = write_pieces(file, triangles, counts, run, 0.0, 0.1);
  file.write("]\n        int[] faceVertexIndices = [");
  whole = whole && write_pieces(file, triangles, corners, run, 0.1, 0.5);
  file.write("]\n        point3f[] points = [");
  whole = whole && write_pieces(file, vertices, points, run, 0.5, 1.0);
  if (!whole)
    return fail(kCancelled, fmt::format("{}: stopped while it was written", path.string()));
  file.write(
      fmt::format("]\n        uniform token subdivisionScheme = \"none\"\n"
                  "        rel material:binding = </{}/paint>\n    }}\n",
                  id));
  file.write(fmt::format(kMaterial, id));
  return file.commit();
}

}  // namespace maquette::exporting

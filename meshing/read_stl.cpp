// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <vector>

#include <fmt/format.h>

#include "meshing/detail/mesh_readers.hpp"
#include "meshing/mesh_io.hpp"

namespace maquette::meshing::detail {
namespace {

bool finite(Vec3 v) {
  return std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z);
}

bool same_word(std::string_view token, std::string_view word) {
  return token.size() == word.size() &&
         std::equal(token.begin(), token.end(), word.begin(), [](char a, char b) {
           return a == b || (a >= 'A' && a <= 'Z' && (a | 0x20) == b);
         });
}

}  // namespace

Result<TriMesh> read_binary_stl(std::string_view bytes, const RunContext& run) {
  std::uint32_t count = 0;
  std::memcpy(&count, bytes.data() + 80, sizeof count);
  if (bytes.size() != 84 + 50 * std::size_t{count})
    return fail(kMeshFormat,
                fmt::format("taken for a binary STL: its header at byte 80 announces {} triangles, "
                            "that is {} bytes, but the file has {}; it is cut off or no mesh",
                            count, 84 + 50 * std::size_t{count}, bytes.size()));
  TriMesh mesh;
  mesh.triangles.reserve(count);
  mesh.vertices_mm.reserve(count / 2 + 2);  // closed surfaces have half as many vertices
  Welder weld(mesh.vertices_mm);
  for (std::size_t i = 0; i < count; ++i) {
    if (i % kItemsPerPoll == 0) {
      if (run.stopped()) return fail(kCancelled, "stopped while reading");
      run.progress(static_cast<double>(i) / count);
    }
    float xyz[9];
    const std::size_t at = 84 + 50 * i + 12;  // behind the normal
    std::memcpy(xyz, bytes.data() + at, sizeof xyz);
    std::array<std::uint32_t, 3> triangle{};
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3 corner{xyz[3 * k], xyz[3 * k + 1], xyz[3 * k + 2]};
      if (!finite(corner))
        return fail(kMeshFormat, fmt::format("byte {}: corner {} of triangle {} is not finite",
                                             at + 12 * k, k + 1, i + 1));
      if (mesh.vertices_mm.size() >= kMostVertices)
        return fail(kMeshFormat, fmt::format("byte {}: more than {} vertices", at, kMostVertices));
      triangle[k] = weld.number_of(corner);
    }
    mesh.triangles.push_back(triangle);
  }
  return mesh;
}

Result<TriMesh> read_ascii_stl(std::string_view bytes, const RunContext& run) {
  Tokens in(bytes);
  TriMesh mesh;
  Welder weld(mesh.vertices_mm);
  std::string_view token;
  const auto bad = [&](std::string_view expected) {
    const std::string found =
        token.empty() ? "the end of the line or file" : fmt::format("'{}'", shown(token));
    return fail(kMeshFormat,
                fmt::format("line {}: {} expected, found {}", in.line(), expected, found));
  };
  const auto expect = [&](std::string_view word) {
    token = in.next();
    return same_word(token, word);
  };
  if (!expect("solid")) return bad("solid");
  in.next_line();  // the solid's name may be any words
  for (;;) {
    if (mesh.triangles.size() % kItemsPerPoll == 0) {
      if (run.stopped()) return fail(kCancelled, "stopped while reading");
      run.progress(1.0 - static_cast<double>(in.bytes_left()) / static_cast<double>(bytes.size()));
    }
    token = in.next();
    if (same_word(token, "endsolid")) {  // several solids in one file are read as one mesh
      in.next_line();
      token = in.next();
      if (token.empty()) return mesh;
      if (!same_word(token, "solid")) return bad("solid or the end of the file");
      in.next_line();
      continue;
    }
    if (!same_word(token, "facet")) return bad("facet or endsolid");
    in.next_line();  // the normal is ignored
    if (!expect("outer")) return bad("outer loop");
    if (!expect("loop")) return bad("loop");
    std::array<std::uint32_t, 3> triangle{};
    for (std::uint32_t& corner : triangle) {
      if (!expect("vertex")) return bad("vertex");
      std::array<double, 3> xyz{};
      for (double& x : xyz) {
        token = in.next_in_line();
        const auto value = parse_double(token);
        if (!value || !std::isfinite(*value)) return bad("finite number");
        x = *value;
      }
      if (mesh.vertices_mm.size() >= kMostVertices) return bad("no further vertex");
      corner = weld.number_of({xyz[0], xyz[1], xyz[2]});
    }
    if (!expect("endloop")) return bad("endloop");
    if (!expect("endfacet")) return bad("endfacet");
    mesh.triangles.push_back(triangle);
  }
}

}  // namespace maquette::meshing::detail

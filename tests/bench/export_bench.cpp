// SPDX-License-Identifier: GPL-3.0-or-later

// Levels of detail beside other people's encoders, on the same fractal terrain:
//
//   export_bench [NODES]    4001 x 4001 unless given: bytes a triangle, seconds, memory of the
//   whole
//                           chain of levels at 16 and 20 bits, with and without normals, each case
//                           in a process of its own; then the full resolution alone through
//                           draco_encoder (Debian's draco) and gltfpack (npm) where they are found;
//                           both get positions without normals. The same heights as floats in a PLY
//                           or OBJ file are their input.

#include <unistd.h>

#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <string>

#include <fmt/format.h>

#include "export/gltf.hpp"
#include "export/lod_set.hpp"
#include "support/bench_times.hpp"
#include "support/terrain.hpp"

namespace maquette::exporting {
namespace {

namespace fs = std::filesystem;
using heightmap::ModelField;
using namespace testing_support;

void chain(const ModelField& field, LodCompression compression, int bits, bool normals,
           const fs::path& folder) {
  LodSetOptions options;
  options.position_bits = bits;
  options.asset.compression = compression;
  options.asset.normals = normals;
  const Times before = now();
  const auto report = write_lod_set(field, {}, options, folder);
  const Times after = now();
  if (!report) {
    fmt::print("{}\n", report.error().message);
    std::exit(1);
  }
  std::uint64_t bytes = 0, triangles = 0;
  for (const LodLevelReport& level : report->levels) {
    bytes += level.bytes;
    triangles += level.triangles;
  }
  const LodLevelReport& finest = report->levels[0];
  fmt::print(
      "{:>8} {} bits{}: {:.3f} bytes a triangle ({:.3f} of the finest level), {:.1f} M triangles "
      "in "
      "{} tiles, {:.1f} s, {:.1f} CPU s, peak {:.0f} MiB, error {:.4f} mm\n",
      name(compression), bits, normals ? " and normals" : "",
      static_cast<double>(bytes) / static_cast<double>(triangles),
      static_cast<double>(finest.bytes) / static_cast<double>(finest.triangles),
      1e-6 * static_cast<double>(triangles), report->tiles.size(), after.wall - before.wall,
      after.cpu - before.cpu, peak_mib(), finest.error.vertical_mm);
}

TriMesh full_mesh(const ModelField& field) {
  TriMesh mesh;
  const auto cols = static_cast<std::uint32_t>(field.z_mm.cols());
  for (std::ptrdiff_t r = 0; r < field.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < field.z_mm.cols(); ++c)
      mesh.vertices_mm.push_back(
          {field.x_mm(c), field.y_mm(r), static_cast<double>(field.z_mm(r, c))});
  for (std::uint32_t r = 0; r + 1 < static_cast<std::uint32_t>(field.z_mm.rows()); ++r)
    for (std::uint32_t c = 0; c + 1 < cols; ++c) {
      const std::uint32_t a = r * cols + c;
      mesh.triangles.push_back({a, a + 1, a + cols + 1});
      mesh.triangles.push_back({a, a + cols + 1, a + cols});
    }
  return mesh;
}

/// Binary PLY of floats: what draco_encoder reads.
void write_float_ply(const TriMesh& mesh, const fs::path& path) {
  std::FILE* file = std::fopen(path.c_str(), "wb");
  fmt::print(file,
             "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty "
             "float y\nproperty float z\nelement face {}\nproperty list uchar int "
             "vertex_indices\nend_header\n",
             mesh.vertices_mm.size(), mesh.triangles.size());
  for (const Vec3& v : mesh.vertices_mm) {
    const std::array<float, 3> p{static_cast<float>(v.x), static_cast<float>(v.y),
                                 static_cast<float>(v.z)};
    std::fwrite(p.data(), sizeof p, 1, file);
  }
  for (const auto& t : mesh.triangles) {
    std::fputc(3, file);
    std::fwrite(t.data(), sizeof t, 1, file);
  }
  std::fclose(file);
}

void peer(const std::string& what, const std::string& command, const fs::path& made,
          std::size_t triangles) {
  const Outside o = run_outside(command);
  std::error_code ec;
  const auto bytes = fs::file_size(made, ec);
  if (o.status != 0 || ec) {
    fmt::print("{:>8}: not there, or it failed\n", what);
    return;
  }
  fmt::print("{:>8}: {:.3f} bytes a triangle, {:.1f} s, {:.1f} CPU s\n", what,
             static_cast<double>(bytes) / static_cast<double>(triangles), o.times.wall,
             o.times.cpu);
}

int bench(std::ptrdiff_t nodes) {
  std::string name = (fs::temp_directory_path() / "maquette-bench-XXXXXX").string();
  const fs::path folder = ::mkdtemp(name.data());
  const ModelField field = fractal(nodes);
  fmt::print("{0} x {0} nodes\n", nodes);
  for (const int bits : {16, 20})
    for (const bool normals : {false, true})
      in_its_own_process(
          [&] { chain(field, LodCompression::draco, bits, normals, folder / "set"); });
  in_its_own_process([&] { chain(field, LodCompression::meshopt, 16, true, folder / "set"); });
  const TriMesh mesh = full_mesh(field);
  write_float_ply(mesh, folder / "full.ply");
  for (const int bits : {16, 20})
    peer(fmt::format("draco {}", bits),
         fmt::format("draco_encoder -i {0}/full.ply -o {0}/full.drc -qp {1} >/dev/null 2>&1",
                     folder.string(), bits),
         folder / "full.drc", mesh.triangles.size());
  const auto plain = write_glb(mesh, {.draco = false}, folder / "full.glb");
  if (!plain) fmt::print("{}\n", plain.error().message);
  peer("gltfpack",
       fmt::format("node {0} -i {1}/full.glb -o {1}/packed.glb -c -vp 16 >/dev/null 2>&1",
                   MAQUETTE_SOURCE_DIR "/tests/web/node_modules/gltfpack/cli.js", folder.string()),
       folder / "packed.glb", mesh.triangles.size());
  fs::remove_all(folder);
  return 0;
}

}  // namespace
}  // namespace maquette::exporting

int main(int argc, char** argv) {
  return maquette::exporting::bench(argc > 1 ? std::atol(argv[1]) : 4001);
}

// SPDX-License-Identifier: GPL-3.0-or-later

// Levels of detail beside other people's encoders, on the same fractal terrain, as one table:
//
//   export_bench [NODES]    4001 x 4001 unless given. Ours is the whole chain, levels and tiles and
//                           their measured errors, at 16 and 20 bits, with and without normals,
//                           with skirts and with pictures of 512 texels (their bytes counted in).
//                           draco_encoder (Debian's draco) and gltfpack (npm), where they are
//                           found, get the full resolution alone, as floats in a PLY or glTF file;
//                           at Draco's default and at its smallest (-cl 10). Each case is a process
//                           of its own, with its own peak of memory. Last, what no coder of the
//                           residuals can go below: entropy of the heights on our lattice, each
//                           predicted by a parallelogram and by the mean of two.

#include <sys/resource.h>
#include <sys/wait.h>
#include <unistd.h>

#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <filesystem>
#include <map>
#include <string>

#include <fmt/format.h>

#include "export/glb_file.hpp"
#include "export/gltf.hpp"
#include "export/lod_set.hpp"
#include "support/bench_times.hpp"
#include "support/folders.hpp"
#include "support/terrain.hpp"

namespace maquette::exporting {
namespace {

namespace fs = std::filesystem;
using heightmap::ModelField;
using namespace testing_support;

/// One line; bytes a triangle of all that was written and of the full resolution.
struct Row {
  std::string what, bits, normals;
  double bytes = NAN, finest = NAN, triangles = NAN, wall = NAN, cpu = NAN, mib = NAN;
};
void print_head() {
  fmt::print("{:<32} {:>4} {:>7} {:>8} {:>8} {:>7} {:>7} {:>7} {:>7}\n", "", "bits", "normals",
             "B/tri", "finest", "M tri", "s", "CPU s", "MiB");
}
void print(const Row& r) {
  const auto number = [](double x, int decimals) {
    return std::isnan(x) ? std::string("-") : fmt::format("{:.{}f}", x, decimals);
  };
  fmt::print("{:<32} {:>4} {:>7} {:>8} {:>8} {:>7} {:>7} {:>7} {:>7}\n", r.what, r.bits, r.normals,
             number(r.bytes, 3), number(r.finest, 3), number(1e-6 * r.triangles, 1),
             number(r.wall, 1), number(r.cpu, 1), number(r.mib, 0));
  std::fflush(stdout);
}

void chain(const ModelField& field, const LodSetOptions& options, const std::string& also,
           const fs::path& folder) {
  const LodCompression compression = options.asset.compression;
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
  const std::string normal_bits =
      compression == LodCompression::draco ? fmt::format("{}", options.asset.normal_bits) : "8";
  print({.what = fmt::format("maquette lod, {}{}", name(compression), also),
         .bits = fmt::format("{}", options.position_bits),
         .normals = options.asset.normals ? normal_bits : "none",
         .bytes = static_cast<double>(bytes) / static_cast<double>(triangles),
         .finest = static_cast<double>(finest.bytes) / static_cast<double>(finest.triangles),
         .triangles = static_cast<double>(triangles),
         .wall = after.wall - before.wall,
         .cpu = after.cpu - before.cpu,
         .mib = peak_mib()});
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
void write_float_ply(const TriMesh& mesh, bool with_normals, const fs::path& path) {
  std::FILE* file = std::fopen(path.c_str(), "wb");
  fmt::print(file,
             "ply\nformat binary_little_endian 1.0\nelement vertex {}\nproperty float x\nproperty "
             "float y\nproperty float z\n{}element face {}\nproperty list uchar int "
             "vertex_indices\nend_header\n",
             mesh.vertices_mm.size(),
             with_normals ? "property float nx\nproperty float ny\nproperty float nz\n" : "",
             mesh.triangles.size());
  const auto normals = with_normals ? gltf_normals(mesh) : std::vector<Float3>{};
  for (std::size_t i = 0; i < mesh.vertices_mm.size(); ++i) {
    const Vec3& v = mesh.vertices_mm[i];
    const Float3 p{static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z)};
    std::fwrite(p.data(), sizeof p, 1, file);
    if (!with_normals) continue;
    const Float3 n{normals[i][0], -normals[i][2], normals[i][1]};  // z up again
    std::fwrite(n.data(), sizeof n, 1, file);
  }
  for (const auto& t : mesh.triangles) {
    std::fputc(3, file);
    std::fwrite(t.data(), sizeof t, 1, file);
  }
  std::fclose(file);
}

/// Runs a program; its own peak of memory and that of what it starts.
void peer(Row row, const std::string& command, const fs::path& made, std::size_t triangles) {
  std::error_code ec;
  fs::remove(made, ec);
  const double before = now().wall;
  const pid_t child = ::fork();
  if (child == 0) {
    ::execl("/bin/sh", "sh", "-c", ("exec " + command + " >/dev/null 2>&1").c_str(), nullptr);
    ::_exit(127);
  }
  int status = 0;
  rusage used{};
  if (child < 0 || ::wait4(child, &status, 0, &used) != child) status = -1;
  row.wall = now().wall - before;
  row.cpu = static_cast<double>(used.ru_utime.tv_sec + used.ru_stime.tv_sec) +
            1e-6 * static_cast<double>(used.ru_utime.tv_usec + used.ru_stime.tv_usec);
  row.mib = static_cast<double>(used.ru_maxrss) / 1024.0;
  row.triangles = static_cast<double>(triangles);
  const auto bytes = fs::file_size(made, ec);
  if (status == 0 && !ec)
    row.bytes = row.finest = static_cast<double>(bytes) / row.triangles;
  else
    row.what += WIFEXITED(status) && WEXITSTATUS(status) == 127 ? ": not there" : ": failed";
  print(row);
}

double entropy_bits(const std::map<std::int64_t, std::int64_t>& counts) {
  double all = 0.0, bits = 0.0;
  for (const auto& [value, count] : counts) all += static_cast<double>(count);
  for (const auto& [value, count] : counts)
    bits -= static_cast<double>(count) / all * std::log2(static_cast<double>(count) / all);
  return bits;
}

/// Of the full resolution's heights in steps of the lattice; two triangles a height.
void bound(const ModelField& field, int bits) {
  LodSetOptions options;
  options.position_bits = bits;
  const auto lattice = lod_lattice(field, options);
  const auto at = [&](std::ptrdiff_t r, std::ptrdiff_t c) {
    return std::llround(static_cast<double>(field.z_mm(r, c)) / lattice->step_mm);
  };
  std::map<std::int64_t, std::int64_t> one, two;
  for (std::ptrdiff_t r = 1; r < field.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 1; c + 1 < field.z_mm.cols(); ++c) {
      const auto west = at(r, c - 1) + at(r - 1, c) - at(r - 1, c - 1);
      const auto other = at(r, c - 1) + at(r - 1, c + 1) - at(r - 1, c);
      ++one[at(r, c) - west];
      ++two[at(r, c) - (west + other) / 2];
    }
  for (const auto& [what, counts] :
       {std::pair{"entropy, parallelogram", &one}, {"entropy, two of them", &two}}) {
    const double bytes = entropy_bits(*counts) / 16.0;
    print({.what = what,
           .bits = fmt::format("{}", bits),
           .normals = "none",
           .bytes = bytes,
           .finest = bytes});
  }
}

int bench(std::ptrdiff_t nodes) {
  std::string name = (fs::temp_directory_path() / "maquette-bench-XXXXXX").string();
  const fs::path folder = ::mkdtemp(name.data());
  const ModelField field = fractal(nodes);
  fmt::print("{0} x {0} nodes\n", nodes);
  print_head();
  const auto ours = [&](const LodSetOptions& options, const std::string& also = "") {
    in_its_own_process([&] { chain(field, options, also, folder / "set"); });
    fs::remove_all(folder / "set");
  };
  LodSetOptions options;
  for (const int bits : {16, 20})
    for (const bool normals : {true, false}) {
      options.position_bits = bits;
      options.asset.normals = normals;
      ours(options);
    }
  options = {};
  options.asset.compression = LodCompression::meshopt;
  ours(options);
  options = {};
  options.skirts = true;
  ours(options, ", skirts");
  options = {};
  options.texels = 512;
  ours(options, ", 512 texels");
  // In processes of their own, so that their memory is not that of the peers' parent.
  const std::size_t triangles =
      2 * static_cast<std::size_t>(nodes - 1) * static_cast<std::size_t>(nodes - 1);
  for (const bool normals : {true, false}) {
    in_its_own_process([&] { write_float_ply(full_mesh(field), normals, folder / "full.ply"); });
    for (const int bits : {16, 20})
      for (const int level : {7, 10})
        peer({.what = fmt::format("draco_encoder -cl {}", level),
              .bits = fmt::format("{}", bits),
              .normals = normals ? "7" : "none"},
             fmt::format("draco_encoder -i {0}/full.ply -o {0}/full.drc -cl {1} -qp {2} -qn 7",
                         folder.string(), level, bits),
             folder / "full.drc", triangles);
  }
  in_its_own_process([&] {
    const auto plain = write_glb(full_mesh(field), {.draco = false}, folder / "full.glb");
    if (!plain) fmt::print("{}\n", plain.error().message);
  });
  peer({.what = "gltfpack -c", .bits = "16", .normals = "8"},
       fmt::format(
           "node {0} -i {1}/full.glb -o {1}/packed.glb -c -vp 16",
           (testing_support::source_folder() / "tests/web/node_modules/gltfpack/cli.js").string(),
           folder.string()),
       folder / "packed.glb", triangles);
  for (const int bits : {16, 20}) bound(field, bits);
  fs::remove_all(folder);
  return 0;
}

}  // namespace
}  // namespace maquette::exporting

int main(int argc, char** argv) {
  return maquette::exporting::bench(argc > 1 ? std::atol(argv[1]) : 4001);
}

// SPDX-License-Identifier: GPL-3.0-or-later

// Meshing at full scale, each case in a process of its own (peak memory is one per process), what
// issue 7 asks for beside each figure:
//
//   meshing_bench                    all of what follows
//   meshing_bench solid [FOLDER]     grid solids of 1, 4, 16 and 64 M quads (64 M in four bands):
//                                    triangles a second made, proven and written as STL into
//                                    FOLDER (here unless given), beside as many plain bytes
//                                    written there; memory beside the heights
//   meshing_bench shaped [NODES]     a NODES x NODES fractal terrain (4001) hollow and engraved
//   meshing_bench decimate [NODES [TRIANGLES [HMM]]]   fractal terrain of NODES x NODES (1001 and
//                                    4001; a sixteenth as many triangles) beside plain greedy
//                                    insertion, OpenMesh's quadrics (to 1001) and, where HMM is
//                                    the path of that program, hmm, with as many triangles
//   meshing_bench level-set [NODES]  narrow band of a NODES x NODES fractal terrain (4001) straight
//                                    from its grid, beside OpenVDB's meshToLevelSet on 501 nodes
//   meshing_bench settle [STONES [NODES]]   500 stones of 1.5 to 5 mm on 4001 x 4001 nodes, fitted
//                                      and settled: time, memory
//   meshing_bench volume [STONES [NODES]]   500 stones united with 4001 x 4001 nodes: time, memory,
//                                    errors
//
// CPU seconds are those of all threads, user and system; where nothing is said they are meant.

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include "cnc/ball_offset.hpp"
#include "core/files.hpp"
#include "export/cad.hpp"
#include "meshing/bands.hpp"
#include "meshing/grid_stream.hpp"
#include "meshing/mesh_io.hpp"
#include "meshing/shaped_solid.hpp"
#include "meshing_decimation.hpp"
#include "meshing_table.hpp"
#include "meshing_volume.hpp"
#include "support/bench_times.hpp"
#include "support/figures_of_a_process.hpp"
#include "support/terrain.hpp"

namespace maquette::meshing {
namespace {

namespace fs = std::filesystem;
using heightmap::ModelField;
using namespace testing_support;

/// Cheap, and not level.
ModelField waves(std::ptrdiff_t n) {
  ModelField f{Grid<float>(n, n), Millimetres{0.5}, Millimetres{0}, Millimetres{0}};
  for (std::ptrdiff_t r = 0; r < n; ++r)
    for (std::ptrdiff_t c = 0; c < n; ++c)
      f.z_mm(r, c) = static_cast<float>((r * 37 + c * 91) % 64) * 0.01F;
  return f;
}

double million(std::uint64_t n) {
  return 1e-6 * static_cast<double>(n);
}

/// All triangles made and looked at once, by all threads.
double stream_through(const GridSolidStream& solid) {
  constexpr std::uint64_t kPiece = 4096;
  const std::uint64_t pieces = (solid.triangle_count() + kPiece - 1) / kPiece;
  std::vector<double> sums(pieces);
  oneapi::tbb::parallel_for(std::uint64_t{0}, pieces, [&](std::uint64_t p) {
    std::vector<MeshStream::Corners> corners(std::min(kPiece, solid.triangle_count() - p * kPiece));
    solid.corners(p * kPiece, corners);
    for (const auto& c : corners) sums[p] += c[0].z + c[1].z + c[2].z;
  });
  double sum = 0.0;
  for (const double s : sums) sum += s;
  return sum;
}

void write_plain(std::uint64_t bytes, const fs::path& path) {
  auto file = AtomicFile::create(path);
  if (!file) return;
  const std::string piece(std::size_t{1} << 20, 'x');
  for (std::uint64_t at = 0; at < bytes; at += piece.size())
    file->write(piece.data(), std::min<std::uint64_t>(piece.size(), bytes - at));
  (void)!file->commit();
}

/// CPU nanoseconds a triangle made and proven.
std::array<double, 1> solid_case(std::ptrdiff_t cells, int bands, const fs::path& folder) {
  const ModelField field = waves(cells + 1);
  const double held = peak_mib();
  std::uint64_t triangles = 0;
  double make = 0.0, make_cpu = 0.0, prove_cpu = 0.0, write = 0.0, plain = 0.0;
  const auto parts =
      split_into_bands(field, BandAxis::y, Millimetres{0.5 * static_cast<double>(cells / bands)});
  for (const Band& band : *parts) {
    const ModelField part = bands == 1 ? ModelField{} : band_field(field, band);
    const auto solid = GridSolidStream::create(bands == 1 ? field : part);
    if (!solid) return {NAN};
    triangles += solid->triangle_count();
    Times start = now();
    volatile double keep = stream_through(*solid);
    (void)keep;
    make += now().wall - start.wall;
    make_cpu += now().cpu - start.cpu;
    start = now();
    if (!solid->certify(CoordinateRounding::float32)) return {NAN};
    prove_cpu += now().cpu - start.cpu;
    if (bands > 1) continue;
    start = now();
    if (!exporting::write_stl(*solid, folder / "meshing_bench.stl")) return {NAN};
    write += now().wall - start.wall;
    fs::remove(folder / "meshing_bench.stl");
  }
  const double beside = peak_mib() - held, m = million(triangles);
  const std::string name = fmt::format(
      "{:.0f} M quads{}, {:.2f} M triangles: ", million(static_cast<std::uint64_t>(cells * cells)),
      bands > 1 ? fmt::format(" in {} bands", bands) : "", m);
  row(name + "made", m / make, "M/s by the clock", at_least(10.0));
  row(name + "made", m / make_cpu, "M per CPU s");
  row(name + "proven", m / prove_cpu, "M per CPU s");
  row(name + "beside the heights", beside / m, "MiB per M", at_most(1.0));
  if (bands == 1) {
    const Times start = now();
    write_plain(84 + 50 * triangles, folder / "meshing_bench.raw");
    plain = now().wall - start.wall;
    fs::remove(folder / "meshing_bench.raw");
    row(name + "STL", 50.0 * m / write, "MB/s");
    row(name + "plain bytes to the same disk", 50.0 * m / plain, "MB/s");
    row(name + "STL of plain bytes", 100.0 * plain / write, "%", at_least(50.0));
  }
  return {1e3 * (make_cpu + prove_cpu) / m};
}

void solid_cases(const fs::path& folder) {
  fmt::print("grid solids, walls and base with them\n");
  std::vector<double> cost;
  for (const std::ptrdiff_t cells : {1000, 2000, 4000, 8000})
    cost.push_back(figures_of_its_own_process<1>(
        [&] { return solid_case(cells, cells == 8000 ? 4 : 1, folder); })[0]);
  for (std::size_t i = 1; i < cost.size(); ++i)
    row(fmt::format("a triangle's CPU time at {} M quads, of that at 1 M", i == 1   ? 4
                                                                           : i == 2 ? 16
                                                                                    : 64),
        cost[i] / cost[0], "times", at_most(1.25));
}

/// Hollow with a label, proven and written.
void shaped_case(const ModelField& field, const fs::path& folder) {
  const double held = peak_mib();
  const Times start = now();
  const double low = static_cast<double>(heightmap::height_range(field.z_mm).min);
  const SolidOptions options{.base_z = Millimetres{low - 12.0}};
  HollowOptions hollow;
  EngravingStyle style;
  hollow.cut[0] = style.depth;
  const auto roof = cnc::offset_surface(field, Millimetres{-hollow.wall.value()});
  if (!roof) return;
  const Times offset = now();
  Shaping shaping;
  auto underside = hollow_underside(field, *roof, options.base_z, hollow);
  const auto mark = text_mark("Apollo 15, 1:1000", style);
  if (!underside || !mark) return;
  shaping.underside = std::move(*underside);
  auto walls = engrave_wall(field, options.base_z, {*mark}, style);
  if (!walls) return;
  shaping.walls = std::move(*walls);
  const auto solid = ShapedSolid::create(field, options, shaping);
  if (!solid) return;
  const auto proven = solid->certify();
  if (!proven) return;
  const Times made = now();
  const fs::path file = folder / "meshing_bench.ply";
  if (!write_ply(*solid, file)) return;
  fs::remove(file);
  const Times end = now();
  const std::string name = fmt::format("{} x {} nodes, {:.1f} M triangles: ", field.z_mm.cols(),
                                       field.z_mm.rows(), million(solid->triangle_count()));
  row(name + "the wall's offset", offset.cpu - start.cpu, "CPU s");
  row(name + "hollowed, engraved, proven", made.cpu - offset.cpu, "CPU s");
  row(name + "written as PLY", end.cpu - made.cpu, "CPU s");
  row(name + "all", end.wall - start.wall, "s by the clock");
  row(name + "beside the heights", (peak_mib() - held) / 1024.0, "GiB");
  row(name + "hollow share of the plain solid",
      100.0 * shaping.underside.volume_mm3 / (shaping.underside.volume_mm3 + proven->volume_mm3),
      "%");
}

}  // namespace
}  // namespace maquette::meshing

int main(int argc, char** argv) {
  using namespace maquette::meshing;
  const std::string what = argc > 1 ? argv[1] : "";
  const auto number = [&](int i, long otherwise) {
    return argc > i && !what.empty() ? std::stol(argv[i]) : otherwise;
  };
  const auto argument = [&](int i) {
    return argc > i && !what.empty() ? std::string(argv[i]) : std::string();
  };
  if (what.empty() || what == "solid")
    solid_cases(argument(2).empty() ? fs::path(".") : fs::path(argument(2)));
  if (what.empty() || what == "shaped") {
    fmt::print("hollow, engraved\n");
    in_its_own_process([&] { shaped_case(fractal(number(2, 4001)), "."); });
  }
  if (what.empty() || what == "decimate")
    for (const long nodes :
         argument(2).empty() ? std::vector{1001L, 4001L} : std::vector{number(2, 0)})
      decimate_case(nodes, static_cast<std::uint64_t>(number(3, nodes * nodes / 16)), argument(4),
                    ".");
  if (what.empty() || what == "level-set") {
    fmt::print("level sets\n");
    in_its_own_process([] { level_set_case(fractal(501), 0.5, true); });
    in_its_own_process([&] { level_set_case(fractal(number(2, 4001)), 0.5, false); });
  }
  if (what.empty() || what == "settle") {
    fmt::print("stones at rest\n");
    in_its_own_process(
        [&] { settle_case(fractal(number(3, 4001)), static_cast<int>(number(2, 500))); });
  }
  if (what.empty() || what == "volume") {
    fmt::print("stones on terrain\n");
    in_its_own_process(
        [&] { volume_case(fractal(number(3, 4001)), static_cast<int>(number(2, 500))); });
  }
}

// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing_decimation.hpp"

#include <cstring>
#include <filesystem>
#include <fstream>
#include <functional>
#include <iterator>

#include <fmt/format.h>
#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>
#include <OpenMesh/Tools/Decimater/DecimaterT.hh>
#include <OpenMesh/Tools/Decimater/ModQuadricT.hh>

#include "camera/image_io.hpp"
#include "meshing/decimate.hpp"
#include "meshing_table.hpp"
#include "plain_greedy.hpp"
#include "support/bench_times.hpp"
#include "support/figures_of_a_process.hpp"
#include "support/terrain.hpp"

namespace maquette::meshing {
namespace {

namespace fs = std::filesystem;
using heightmap::ModelField;
using namespace testing_support;
using Corners = std::vector<std::array<GridCorner, 3>>;

/// What a process holds that has the heights and nothing else.
double touched_mib(const ModelField& field) {
  volatile double sum = 0.0;
  for (const float z : field.z_mm.cells()) sum = sum + static_cast<double>(z);
  return peak_mib();
}

/// A side; minutes and gigabytes for those who take more.
constexpr std::ptrdiff_t kMostNodesOfQuadrics = 1001;

struct Outcome {
  double triangles = 0.0, most_mm = 0.0, rms_mm = 0.0, cpu_s = 0.0, mib = 0.0;
  double turned_over = 0.0;  ///< triangles seen from below, or upright
};

/// Errors of a mesh: of a node under several triangles the worst.
void measure(const ModelField& field, Corners mesh, Outcome& out) {
  Grid<float> off(field.z_mm.rows(), field.z_mm.cols(), 0.0F);
  std::size_t below = 0;
  for (auto& t : mesh) {
    const auto& [a, b, c] = t;
    const double area = (b.col - a.col) * (c.row - a.row) - (b.row - a.row) * (c.col - a.col);
    if (area <= 0) ++below;
    if (area == 0) continue;
    if (area < 0) std::swap(t[1], t[2]);
    each_node_under(t, [&](int r, int k, double z) {
      const auto here = static_cast<float>(std::abs(z - static_cast<double>(field.z_mm(r, k))));
      off(r, k) = std::max(off(r, k), here);
    });
  }
  double squares = 0.0;
  for (const float here : off.cells()) {
    const double d = static_cast<double>(here);
    out.most_mm = std::fmax(out.most_mm, d);
    squares += d * d;
  }
  out.rms_mm = std::sqrt(squares / static_cast<double>(off.cells().size()));
  out.triangles = static_cast<double>(mesh.size());
  out.turned_over = static_cast<double>(below);
}

Outcome ours(const ModelField& field, std::uint64_t triangles) {
  Outcome out;
  const double held = touched_mib(field);
  const Times start = now();
  const auto mesh = decimate_surface(field, {.most_triangles = triangles});
  if (!mesh) return out;
  out.cpu_s = now().cpu - start.cpu;
  out.mib = peak_mib() - held;
  const double d = field.spacing.value();
  Corners corners;
  for (const auto& t : mesh->mesh.triangles) {
    auto& to = corners.emplace_back();
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3 v = mesh->mesh.vertices_mm[t[k]];
      // Multiples of a sixteenth: what multiplying by the spacing has rounded is undone.
      const auto place = [&](double at) { return std::round(16.0 * at / d) / 16.0; };
      to[k] = {place(v.y - field.y0.value()), place(v.x - field.x0.value()), v.z};
    }
  }
  measure(field, std::move(corners), out);
  return out;
}

Outcome plain(const ModelField& field, std::uint64_t triangles) {
  Outcome out;
  const double held = touched_mib(field);
  const Times start = now();
  PlainGreedy greedy(field.z_mm);
  greedy.refine(triangles);
  out.cpu_s = now().cpu - start.cpu;
  out.mib = peak_mib() - held;
  measure(field, greedy.triangles(), out);
  return out;
}

/// Half edges collapsed by the error of their quadrics, borders kept.
Outcome quadrics(const ModelField& field, std::uint64_t triangles) {
  using Mesh = OpenMesh::TriMesh_ArrayKernelT<>;
  Outcome out;
  const double held = touched_mib(field);
  const Times start = now();
  Mesh mesh;
  mesh.request_vertex_status();
  mesh.request_edge_status();
  mesh.request_halfedge_status();
  mesh.request_face_status();
  mesh.request_face_normals();
  const auto rows = static_cast<int>(field.z_mm.rows()), cols = static_cast<int>(field.z_mm.cols());
  for (int r = 0; r < rows; ++r)
    for (int c = 0; c < cols; ++c)
      mesh.add_vertex({static_cast<float>(c), static_cast<float>(r),
                       field.z_mm(r, c) / static_cast<float>(field.spacing.value())});
  for (int r = 0; r + 1 < rows; ++r)
    for (int c = 0; c + 1 < cols; ++c) {
      const auto at = [&](int i, int k) { return Mesh::VertexHandle(i * cols + k); };
      mesh.add_face(at(r, c), at(r, c + 1), at(r + 1, c + 1));
      mesh.add_face(at(r, c), at(r + 1, c + 1), at(r + 1, c));
    }
  for (const auto v : mesh.vertices()) mesh.status(v).set_locked(mesh.is_boundary(v));
  mesh.update_face_normals();
  OpenMesh::Decimater::DecimaterT<Mesh> decimater(mesh);
  OpenMesh::Decimater::ModQuadricT<Mesh>::Handle quadric;
  decimater.add(quadric);
  decimater.module(quadric).unset_max_err();
  if (!decimater.initialize()) return out;
  decimater.decimate_to_faces(0, triangles);
  mesh.garbage_collection();
  out.cpu_s = now().cpu - start.cpu;
  out.mib = peak_mib() - held;
  Corners corners;
  for (const auto f : mesh.faces()) {
    auto& to = corners.emplace_back();
    std::size_t k = 0;
    for (const auto v : mesh.fv_range(f)) {
      const auto p = mesh.point(v);
      const int r = static_cast<int>(std::lround(p[1])), c = static_cast<int>(std::lround(p[0]));
      to[k++] = {static_cast<double>(r), static_cast<double>(c),
                 static_cast<double>(field.z_mm(r, c))};
    }
  }
  measure(field, std::move(corners), out);
  return out;
}

/// The program reads 16 bits a node and says itself how long it triangulates. Its triangles get
/// the field's heights.
Outcome hmm_program(const ModelField& field, std::uint64_t triangles, const std::string& program,
                    const fs::path& folder) {
  Outcome out;
  const fs::path in = folder / "hmm_in.png", stl = folder / "hmm_out.stl",
                 said = folder / "hmm_said.txt";
  const auto range = heightmap::height_range(field.z_mm);
  Grid<float> shares(field.z_mm.rows(), field.z_mm.cols());
  std::transform(field.z_mm.cells().begin(), field.z_mm.cells().end(), shares.cells().begin(),
                 [&](float z) { return (z - range.min) / (range.max - range.min); });
  if (!camera::write_whole_numbers({{"Y", &shares}}, 1.0, 16, in)) return out;
  const auto run = run_outside(fmt::format("'{}' -z 1 -e 0 -t {} '{}' '{}' > '{}'", program,
                                           triangles, in.string(), stl.string(), said.string()));
  if (run.status != 0) return out;
  std::ifstream lines(said);
  for (std::string line; std::getline(lines, line);)
    if (std::sscanf(line.c_str(), "triangulating... %lfs", &out.cpu_s) == 1) break;
  out.mib = static_cast<double>(used_so_far(RUSAGE_CHILDREN).ru_maxrss) / 1024.0 -
            4.0 * static_cast<double>(field.z_mm.cells().size()) / 1048576.0;
  std::ifstream file(stl, std::ios::binary);
  const std::string bytes{std::istreambuf_iterator<char>(file), {}};
  Corners corners;
  const int last = static_cast<int>(field.z_mm.rows() - 1);
  for (std::size_t at = 84; at + 50 <= bytes.size(); at += 50) {
    std::array<float, 12> n{};
    std::memcpy(n.data(), bytes.data() + at, 48);
    auto& to = corners.emplace_back();
    for (std::size_t k = 0; k < 3; ++k) {
      // Seen from above its y goes up, rows of the picture down: turned over and back.
      const int r = last - static_cast<int>(std::lround(n[3 * k + 4])),
                c = static_cast<int>(std::lround(n[3 * k + 3]));
      to[2 - k] = {static_cast<double>(r), static_cast<double>(c),
                   static_cast<double>(field.z_mm(r, c))};
    }
  }
  for (const auto& path : {in, stl, said}) fs::remove(path);
  measure(field, std::move(corners), out);
  return out;
}

std::string described(const Outcome& o) {
  return fmt::format(
      "{:9.0f} triangles, max {:.5f} mm, rms {:.5f} mm, {:.3f} M/s, {:5.0f} MiB per M{}",
      o.triangles, o.most_mm, o.rms_mm, 1e-6 * o.triangles / o.cpu_s, o.mib / (1e-6 * o.triangles),
      o.turned_over > 0.0 ? fmt::format(", {:.0f} turned over", o.turned_over) : "");
}

}  // namespace

void decimate_case(std::ptrdiff_t nodes, std::uint64_t triangles, const std::string& hmm,
                   const std::string& folder) {
  const ModelField field = fractal(nodes);
  fmt::print("decimation of {} x {} nodes\n", nodes, nodes);
  const auto of = [](const std::function<Outcome()>& work) {
    const auto f = figures_of_its_own_process<6>([&] {
      const Outcome o = work();
      return std::array{o.triangles, o.most_mm, o.rms_mm, o.cpu_s, o.mib, o.turned_over};
    });
    return Outcome{f[0], f[1], f[2], f[3], f[4], f[5]};
  };
  const Outcome mine = of([&] { return ours(field, triangles); });
  fmt::print("    decimate_surface    {}\n", described(mine));
  Outcome best = of([&] { return plain(field, triangles); });
  fmt::print("    plain greedy        {}\n", described(best));
  std::string beside = "plain greedy's";
  if (!hmm.empty()) {
    best = of([&] { return hmm_program(field, triangles, hmm, folder); });
    fmt::print("    hmm (16 bits)       {}\n", described(best));
    beside = "hmm's";
  }
  if (nodes <= kMostNodesOfQuadrics)
    fmt::print("    OpenMesh's quadrics {}\n",
               described(of([&] { return quadrics(field, triangles); })));
  row("largest error over " + beside, mine.most_mm / best.most_mm, "", at_most(1.0));
  row("rms over " + beside, mine.rms_mm / best.rms_mm, "", at_most(0.65));
  row("speed, one core", 1e-6 * mine.triangles / mine.cpu_s, "M triangles/s", at_least(1.0));
  row("memory beside the heights", mine.mib / (1e-6 * mine.triangles), "MiB per M", at_most(60.0));
}

}  // namespace maquette::meshing

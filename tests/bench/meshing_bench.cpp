// SPDX-License-Identifier: GPL-3.0-or-later

// Meshing at full scale, each case in a process of its own (peak memory is one per process):
//
//   meshing_bench                    all of what follows
//   meshing_bench solid [FOLDER]     grid solids of 1, 4, 16 and 64 M quads (64 M in four bands):
//                                    triangles a second made, proven and written as STL into
//                                    FOLDER (here unless given), beside as many plain bytes
//                                    written there; memory beside the heights
//   meshing_bench decimate [NODES [TRIANGLES]]   fractal terrain of NODES x NODES (2001) beside
//                                    plain greedy insertion (Garland and Heckbert 1995: a heap,
//                                    two triangles to start with) of as many triangles

//   meshing_bench level-set [NODES]  narrow band of a NODES x NODES fractal terrain (4001) straight
//                                    from its grid, beside OpenVDB's meshToLevelSet on 501 nodes
//   meshing_bench settle [STONES [NODES]]   500 stones of 1.5 to 5 mm on 4001 x 4001 nodes, fitted
//                                      and settled: time, memory
//   meshing_bench volume [STONES [NODES]]   500 stones united with 4001 x 4001 nodes: time, memory,
//                                    errors

#include <chrono>
#include <cstdio>
#include <filesystem>
#include <queue>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/files.hpp"
#include "export/cad.hpp"
#include "meshing/bands.hpp"
#include "meshing/decimate.hpp"
#include "meshing/grid_stream.hpp"
#include "meshing_volume.hpp"
#include "support/bench_times.hpp"
#include "support/terrain.hpp"

namespace maquette::meshing {
namespace {

namespace fs = std::filesystem;
using heightmap::ModelField;
using namespace testing_support;

/// What a process holds that has the heights and nothing else.
double touched_mib(const ModelField& field) {
  volatile double sum = 0.0;
  for (const float z : field.z_mm.cells()) sum = sum + static_cast<double>(z);
  return peak_mib();
}

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

void solid_case(std::ptrdiff_t cells, int bands, const fs::path& folder) {
  const ModelField field = waves(cells + 1);
  const double held = peak_mib();
  std::uint64_t triangles = 0;
  double make = 0.0, make_cpu = 0.0, prove_cpu = 0.0, write = 0.0, plain = 0.0;
  const auto parts =
      split_into_bands(field, BandAxis::y, Millimetres{0.5 * static_cast<double>(cells / bands)});
  for (const Band& band : *parts) {
    const ModelField part = bands == 1 ? ModelField{} : band_field(field, band);
    const auto solid = GridSolidStream::create(bands == 1 ? field : part);
    if (!solid) return;
    triangles += solid->triangle_count();
    Times start = now();
    volatile double keep = stream_through(*solid);
    (void)keep;
    make += now().wall - start.wall;
    make_cpu += now().cpu - start.cpu;
    start = now();
    if (!solid->certify(CoordinateRounding::float32)) return;
    prove_cpu += now().cpu - start.cpu;
    if (bands > 1) continue;
    start = now();
    if (!exporting::write_stl(*solid, folder / "meshing_bench.stl")) return;
    write += now().wall - start.wall;
    fs::remove(folder / "meshing_bench.stl");
  }
  const double beside = peak_mib() - held;
  if (bands == 1) {
    const Times start = now();
    write_plain(84 + 50 * triangles, folder / "meshing_bench.raw");
    plain = now().wall - start.wall;
    fs::remove(folder / "meshing_bench.raw");
  }
  const double m = million(triangles);
  fmt::print(
      "{:6.1f} M quads, {:6.2f} M triangles: made {:6.1f} M/s ({:.1f} M per CPU s), proven "
      "{:.1f} M per CPU s, {:5.2f} MiB per M beside the heights",
      million(static_cast<std::uint64_t>(cells * cells)), m, m / make, m / make_cpu, m / prove_cpu,
      beside / m);
  if (bands == 1)
    fmt::print(", STL {:.1f} M/s = {:.0f} MB/s, plain bytes {:.0f} MB/s", m / write,
               50.0 * m / write, 50.0 * m / plain);
  fmt::print("\n");
}

/// The textbook's way, for comparison: triangles in a heap by their worst node, each new node
/// splits its triangle, edges are turned until all circles are empty.
class PlainGreedy {
 public:
  explicit PlainGreedy(const Grid<float>& z) : z_(z) {
    const auto r = static_cast<int>(z.rows() - 1), c = static_cast<int>(z.cols() - 1);
    at_ = {{0, 0}, {0, c}, {r, c}, {r, 0}};
    add({0, 1, 2}, {-1, 1, -1});
    add({0, 2, 3}, {-1, -1, 0});
    rate(0);
    rate(1);
  }
  void refine(std::size_t triangles) {
    while (t_.size() + 2 <= triangles && !heap_.empty()) {
      const auto [error, t, age] = heap_.top();
      heap_.pop();
      if (t_[t].age != age || error <= 0.0) continue;
      insert(t);
    }
  }
  [[nodiscard]] std::size_t size() const { return t_.size(); }
  /// @return largest error, and rms through `rms`
  double errors(double& rms) const {
    double most = 0.0, sum = 0.0;
    Grid<char> seen(z_.rows(), z_.cols(), 0);
    for (std::size_t t = 0; t < t_.size(); ++t)
      each_node(t, [&](int r, int c, double off) {
        if (seen(r, c)) return;  // nodes on edges are of two triangles
        seen(r, c) = 1;
        most = std::fmax(most, off);
        sum += off * off;
      });
    rms = std::sqrt(sum / static_cast<double>(z_.cells().size()));
    return most;
  }

 private:
  struct Node {
    int r, c;
  };
  struct Tri {
    std::array<int, 3> v, n;
    Node worst{0, 0};
    std::uint32_t age = 0;
  };
  struct Entry {
    double error;
    std::size_t t;
    std::uint32_t age;
    bool operator<(const Entry& o) const { return error < o.error; }
  };
  [[nodiscard]] double area(Node a, Node b, Node c) const {
    return static_cast<double>(b.c - a.c) * (c.r - a.r) -
           static_cast<double>(b.r - a.r) * (c.c - a.c);
  }
  std::size_t add(std::array<int, 3> v, std::array<int, 3> n) {
    t_.push_back({v, n});
    return t_.size() - 1;
  }
  template <class Visit>
  void each_node(std::size_t t, Visit visit) const {
    const Node a = at_[static_cast<std::size_t>(t_[t].v[0])],
               b = at_[static_cast<std::size_t>(t_[t].v[1])],
               c = at_[static_cast<std::size_t>(t_[t].v[2])];
    const double whole = area(a, b, c);
    const double za = static_cast<double>(z_(a.r, a.c)), zb = static_cast<double>(z_(b.r, b.c)),
                 zc = static_cast<double>(z_(c.r, c.c));
    for (int r = std::min({a.r, b.r, c.r}); r <= std::max({a.r, b.r, c.r}); ++r) {
      // Along a row the three weights are linear: where none is negative.
      double from = std::min({a.c, b.c, c.c}), to = std::max({a.c, b.c, c.c});
      for (const auto& [p, q] : {std::pair{a, b}, std::pair{b, c}, std::pair{c, a}}) {
        const double rate = -(q.r - p.r), start = area(p, q, {r, 0});
        if (rate > 0) from = std::fmax(from, std::ceil(-start / rate - 1e-7));
        if (rate < 0) to = std::fmin(to, std::floor(-start / rate + 1e-7));
      }
      for (int k = static_cast<int>(from); k <= static_cast<int>(to); ++k) {
        const double wa = area({r, k}, b, c) / whole, wb = area(a, {r, k}, c) / whole;
        visit(r, k,
              std::abs(wa * za + wb * zb + (1.0 - wa - wb) * zc - static_cast<double>(z_(r, k))));
      }
    }
  }
  void rate(std::size_t t) {
    double worst = 1e-9;
    Node at{-1, -1};
    each_node(t, [&](int r, int c, double off) {
      if (off > worst) {
        worst = off;
        at = {r, c};
      }
    });
    t_[t].worst = at;
    ++t_[t].age;
    if (at.r >= 0) heap_.push({worst, t, t_[t].age});
  }
  void relink(int of, int from, int to) {
    if (of < 0) return;
    for (int& n : t_[static_cast<std::size_t>(of)].n)
      if (n == from) {
        n = to;
        return;
      }
  }
  void insert(std::size_t t) {
    const Node node = t_[t].worst;
    at_.push_back(node);
    const int p = static_cast<int>(at_.size() - 1);
    for (std::size_t i = 0; i < 3; ++i)
      if (area(at_[static_cast<std::size_t>(t_[t].v[(i + 1) % 3])],
               at_[static_cast<std::size_t>(t_[t].v[(i + 2) % 3])], node) == 0) {
        split_edge(t, i, p);
        return settle();
      }
    const auto [a, b, c] = t_[t].v;
    const auto [na, nb, nc] = t_[t].n;
    const int me = static_cast<int>(t);
    const int t1 = static_cast<int>(add({p, c, a}, {nb, me + 0, me}));
    const int t2 = static_cast<int>(add({p, a, b}, {nc, me, t1}));
    t_[t].v = {p, b, c};
    t_[t].n = {na, t1, t2};
    t_[static_cast<std::size_t>(t1)].n = {nb, t2, me};
    relink(nb, me, t1);
    relink(nc, me, t2);
    todo_ = {me, t1, t2};
    settle();
  }
  void split_edge(std::size_t t, std::size_t i, int p) {
    const int a = t_[t].v[i], b = t_[t].v[(i + 1) % 3], c = t_[t].v[(i + 2) % 3];
    const int u = t_[t].n[i], nb = t_[t].n[(i + 1) % 3], nc = t_[t].n[(i + 2) % 3];
    const int me = static_cast<int>(t);
    const int t1 = static_cast<int>(add({p, a, b}, {nc, -1, me}));
    t_[t].v = {p, c, a};
    t_[t].n = {nb, t1, -1};
    relink(nc, me, t1);
    todo_ = {me, t1};
    if (u < 0) return;
    auto& other = t_[static_cast<std::size_t>(u)];
    std::size_t j = 0;
    while (other.n[j] != me) ++j;
    const int d = other.v[j], to_b = other.n[(j + 1) % 3], to_c = other.n[(j + 2) % 3];
    const int u1 = static_cast<int>(add({p, b, d}, {to_b, u, t1}));
    auto& far = t_[static_cast<std::size_t>(u)];
    far.v = {p, d, c};
    far.n = {to_c, me, u1};
    t_[t].n[2] = u;
    t_[static_cast<std::size_t>(t1)].n[1] = u1;
    relink(to_b, u, u1);
    todo_.insert(todo_.end(), {u, u1});
  }
  void settle() {
    std::vector<int> changed = todo_;
    while (!todo_.empty()) {
      const int t = todo_.back();
      todo_.pop_back();
      auto& near = t_[static_cast<std::size_t>(t)];
      const int u = near.n[0];
      if (u < 0) continue;
      auto& far = t_[static_cast<std::size_t>(u)];
      std::size_t j = 0;
      while (far.n[j] != t) ++j;
      if (!in_circle(near, at_[static_cast<std::size_t>(far.v[j])])) continue;
      const int p = near.v[0], b = near.v[1], c = near.v[2], q = far.v[j];
      const int past_b = far.n[(j + 1) % 3], past_c = far.n[(j + 2) % 3];
      const int before_c = near.n[1], before_b = near.n[2];
      near.v = {p, b, q};
      near.n = {past_b, u, before_b};
      far.v = {p, q, c};
      far.n = {past_c, before_c, t};
      relink(past_b, u, t);
      relink(before_c, t, u);
      todo_.insert(todo_.end(), {t, u});
      changed.insert(changed.end(), {t, u});
    }
    std::sort(changed.begin(), changed.end());
    changed.erase(std::unique(changed.begin(), changed.end()), changed.end());
    for (const int t : changed) rate(static_cast<std::size_t>(t));
  }
  [[nodiscard]] bool in_circle(const Tri& t, Node q) const {
    const auto from = [&](int v) {
      const Node n = at_[static_cast<std::size_t>(v)];
      const double x = n.c - q.c, y = n.r - q.r;
      return std::array{x, y, x * x + y * y};
    };
    const auto a = from(t.v[0]), b = from(t.v[1]), c = from(t.v[2]);
    const auto minor = [](const auto& s, const auto& w) { return s[0] * w[1] - s[1] * w[0]; };
    return a[2] * minor(b, c) + b[2] * minor(c, a) + c[2] * minor(a, b) > 0;
  }
  const Grid<float>& z_;
  std::vector<Node> at_;
  std::vector<Tri> t_;
  std::vector<int> todo_;
  std::priority_queue<Entry> heap_;
};

void decimate_case(std::ptrdiff_t nodes, std::uint64_t triangles) {
  const ModelField field = fractal(nodes);
  fmt::print("decimation of {} x {} nodes\n", nodes, nodes);
  in_its_own_process([&] {
    const double held = touched_mib(field);
    const Times start = now();
    PlainGreedy plain(field.z_mm);
    plain.refine(triangles);
    const double cpu = now().cpu - start.cpu, memory = peak_mib() - held;
    double rms = 0.0;
    const double worst = plain.errors(rms);
    fmt::print(
        "  plain greedy {:9} triangles, max {:.5f} mm, rms {:.5f} mm, {:.2f} M/s, {:.0f} "
        "MiB per M\n",
        plain.size(), worst, rms, million(plain.size()) / cpu, memory / million(plain.size()));
  });
  in_its_own_process([&] {
    const double held = touched_mib(field);
    const Times start = now();
    const auto mesh = decimate_surface(field, {.most_triangles = triangles});
    if (!mesh) return;
    const double cpu = now().cpu - start.cpu;
    const std::uint64_t count = mesh->mesh.triangles.size();
    fmt::print(
        "  decimate     {:9} triangles, max {:.5f} mm, rms {:.5f} mm, {:.2f} M/s, {:.0f} "
        "MiB per M\n",
        count, mesh->max_vertical_error_mm, mesh->rms_vertical_error_mm, million(count) / cpu,
        (peak_mib() - held) / million(count));
  });
}

}  // namespace
}  // namespace maquette::meshing

int main(int argc, char** argv) {
  using namespace maquette::meshing;
  const std::string what = argc > 1 ? argv[1] : "";
  if (what.empty() || what == "solid") {
    const fs::path folder = argc > 2 ? argv[2] : ".";
    for (const std::ptrdiff_t cells : {1000, 2000, 4000})
      in_its_own_process([&] { solid_case(cells, 1, folder); });
    in_its_own_process([&] { solid_case(8000, 4, folder); });
  }
  if (what.empty() || what == "decimate") {
    const auto nodes = argc > 2 && !what.empty() ? std::stol(argv[2]) : 2001L;
    const auto triangles =
        argc > 3 ? std::stoull(argv[3]) : static_cast<unsigned long long>(nodes * nodes / 16);
    decimate_case(nodes, triangles);
  }
  const auto number = [&](int i, long otherwise) {
    return argc > i && !what.empty() ? std::stol(argv[i]) : otherwise;
  };
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

// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <cstdlib>
#include <queue>
#include <vector>

#include "meshing/detail/terrain_fit.hpp"

namespace maquette::meshing::detail {
namespace {

using Vertex = TerrainMesh::Vertex;
using Triangle = TerrainMesh::Triangle;
constexpr std::uint32_t kNone = TerrainMesh::kNone;
constexpr int kParts = TerrainMesh::kParts;

class Bisection {
 public:
  Bisection(TerrainMesh& mesh, std::uint64_t triangles, const RunContext& run)
      : mesh_(mesh), most_(triangles), run_(run) {}

  void go() {
    // Half as many vertices as triangles, and half of the border's.
    mesh_.vertices().reserve(static_cast<std::size_t>(
        0.52 * static_cast<double>(most_) + 2.0 * std::sqrt(static_cast<double>(most_)) + 100.0));
    add_roots();
    // Halving of neighbours adds a sixth, more on uneven ground.
    constexpr double kFirst = 0.75, kEnough = 0.99, kSlope = 1.5;
    float limit = limit_for(kFirst * static_cast<double>(most_));
    // Against a limit the count goes as its power -0.5 to -0.9: less than the step is safe.
    for (int sweep = 0; sweep < 30; ++sweep) {
      halve_above(limit);
      const auto share = static_cast<double>(mesh_.triangles().size()) / static_cast<double>(most_);
      if (share >= kEnough || run_.stopped()) return;
      limit *= static_cast<float>(std::clamp(std::pow(share, kSlope), 0.1, 0.99));
    }
  }

 private:
  static constexpr int kTile = 8;  ///< roots a side whose descendants lie together

  /// A grid of squares, each of two triangles; diagonals alternate.
  void add_roots() {
    constexpr double kRootTriangles = 1.0 / 16.0;
    const Grid<float>& z = mesh_.field().z_mm;
    const double cell = std::sqrt(2.0 * static_cast<double>(z.rows() * z.cols()) /
                                  std::fmax(kRootTriangles * static_cast<double>(most_), 2.0));
    const auto count = [&](std::ptrdiff_t nodes) {
      return std::max(1, static_cast<int>(static_cast<double>(nodes - 1) / cell));
    };
    // Of a narrow field the squares are long instead.
    const auto most = static_cast<int>(std::clamp<std::uint64_t>(most_ / 8, 1, 1U << 28U));
    rows_ = std::min(count(z.rows()), most);
    cols_ = std::clamp(count(z.cols()), 1, most / rows_);
    const auto place = [](int i, int n, std::ptrdiff_t nodes) {
      return static_cast<std::int32_t>((nodes - 1) * i / n) * kParts;
    };
    for (int r = 0; r <= rows_; ++r)
      for (int c = 0; c <= cols_; ++c)
        mesh_.add_vertex(place(r, rows_, z.rows()), place(c, cols_, z.cols()));
    for (int r = 0; r < rows_; ++r)
      for (int c = 0; c < cols_; ++c) {
        const std::uint32_t a = corner(r, c), b = corner(r, c + 1), d = corner(r + 1, c + 1),
                            e = corner(r + 1, c), me = 2U * cell_at(r, c);
        const std::uint32_t south = root_at(r - 1, c, Side::north),
                            east = root_at(r, c + 1, Side::west),
                            north = root_at(r + 1, c, Side::south),
                            west = root_at(r, c - 1, Side::east);
        if (even(r, c)) {
          add({b, d, a}, {me + 1, south, east});
          add({e, a, d}, {me, north, west});
        } else {
          add({a, b, e}, {me + 1, west, south});
          add({d, e, b}, {me, east, north});
        }
      }
  }

  enum class Side { south, east, north, west };
  static bool even(int r, int c) { return (r + c) % 2 == 0; }
  [[nodiscard]] std::uint32_t cell_at(int r, int c) const {
    return static_cast<std::uint32_t>(r * cols_ + c);
  }
  [[nodiscard]] std::uint32_t corner(int r, int c) const {
    return static_cast<std::uint32_t>(r * (cols_ + 1) + c);
  }
  /// The triangle of a square that has this side.
  [[nodiscard]] std::uint32_t root_at(int r, int c, Side side) const {
    if (r < 0 || c < 0 || r >= rows_ || c >= cols_) return kNone;
    const bool first = side == Side::south || side == (even(r, c) ? Side::east : Side::west);
    return 2U * cell_at(r, c) + (first ? 0U : 1U);
  }

  void add(std::array<std::uint32_t, 3> v, std::array<std::uint32_t, 3> n) {
    Triangle t;
    t.v = v;
    t.n = n;
    rate(t);
    mesh_.triangles().push(t);
  }

  /// While halving goes on `squares` holds what the best plane leaves.
  void rate(Triangle& t) const {
    mesh_.measure(t);
    t.squares = mesh_.fitted_squares(t);
  }

  [[nodiscard]] bool can_halve(const Vertex& a, const Vertex& b) const {
    return std::max(std::abs(a.row - b.row), std::abs(a.col - b.col)) >= 2 * kParts;
  }

  /// On a node if both ends are on one side of the border.
  [[nodiscard]] Vertex middle(const Vertex& a, const Vertex& b) const {
    Vertex m{(a.row + b.row) / 2, (a.col + b.col) / 2, 0.0F, kNone};
    if (!mesh_.on_border(m)) return m;
    if (a.row == b.row) m.col -= m.col % kParts;
    if (a.col == b.col) m.row -= m.row % kParts;
    return m;
  }

  /// Triangle i becomes (m, v0, v1). @return the other half, (m, v2, v0)
  std::uint32_t halve_at(std::uint32_t i, std::uint32_t m) {
    const Triangle whole = mesh_.triangles()[i];
    Triangle other, left;
    const std::uint32_t j = mesh_.triangles().size();
    left.v = {m, whole.v[0], whole.v[1]};
    left.n = {whole.n[2], kNone, j};
    other.v = {m, whole.v[2], whole.v[0]};
    other.n = {whole.n[1], i, kNone};
    rate(left);
    rate(other);
    mesh_.triangles()[i] = left;
    mesh_.triangles().push(other);
    mesh_.relink(whole.n[1], i, j);
    return j;
  }

  /// Halves a triangle, and the one across its longest side; new ones go to `open_`.
  bool halve(std::uint32_t i) {
    const auto& t = mesh_.triangles();
    const Vertex a = mesh_.vertices()[t[i].v[1]], b = mesh_.vertices()[t[i].v[2]];
    if (!can_halve(a, b) || t.size() + 2 > most_) return false;
    if (t[i].n[0] != kNone && t[t[i].n[0]].n[0] != i && !halve(t[i].n[0])) return false;
    const std::uint32_t across = t[i].n[0];
    if (across != kNone && t[across].n[0] != i) return false;
    if (t.size() + 2 > most_) return false;
    const Vertex at = middle(a, b);
    const std::uint32_t m = mesh_.add_vertex(at.row, at.col);
    const std::uint32_t j = halve_at(i, m);
    open_.insert(open_.end(), {i, j});
    if (across == kNone) return true;
    const std::uint32_t k = halve_at(across, m);
    mesh_.triangles()[i].n[1] = k;
    mesh_.triangles()[k].n[2] = i;
    mesh_.triangles()[j].n[2] = across;
    mesh_.triangles()[across].n[1] = j;
    open_.insert(open_.end(), {across, k});
    return true;
  }

  void halve_from(std::uint32_t i, float limit) {
    open_.push_back(i);
    while (!open_.empty()) {
      const std::uint32_t t = open_.back();
      open_.pop_back();
      if (mesh_.triangles()[t].squares > limit) halve(t);
    }
  }

  /// Roots tile by tile, so that what is near on the ground is near in memory.
  void halve_above(float limit) {
    const std::uint32_t before = mesh_.triangles().size();
    for (int r0 = 0; r0 < rows_ && !run_.stopped(); r0 += kTile)
      for (int c0 = 0; c0 < cols_; c0 += kTile)
        for (int r = r0; r < std::min(r0 + kTile, rows_); ++r)
          for (int c = c0; c < std::min(c0 + kTile, cols_); ++c)
            for (const std::uint32_t side : {0U, 1U}) halve_from(2 * cell_at(r, c) + side, limit);
    for (std::uint32_t t = 2 * cell_at(rows_, 0); t < before; ++t) halve_from(t, limit);
  }

  /// What the worst triangle of so many would leave, had some of the roots been halved without
  /// their neighbours.
  float limit_for(double triangles) {
    const std::uint32_t roots = mesh_.triangles().size();
    constexpr std::uint32_t kLeast = 512, kShare = 16;
    const std::uint32_t step = std::clamp(roots / kLeast, 1U, kShare);
    std::priority_queue<std::pair<float, std::uint32_t>> queue;
    TerrainMesh sample(mesh_.field());
    for (std::uint32_t i = 0; i < roots; i += step) {
      Triangle t = mesh_.triangles()[i];
      for (std::uint32_t& v : t.v) {
        const Vertex at = mesh_.vertices()[v];
        v = sample.add_vertex(at.row, at.col);
      }
      queue.emplace(t.squares, sample.triangles().push(t));
    }
    const double wanted = triangles * sample.triangles().size() / roots;
    float limit = queue.top().first;
    Bisection halving(sample, most_, run_);
    while (sample.triangles().size() < wanted && !queue.empty()) {
      const auto [squares, i] = queue.top();
      queue.pop();
      limit = squares;
      if (!(squares > 0.0F)) break;
      const Vertex a = sample.vertices()[sample.triangles()[i].v[1]],
                   b = sample.vertices()[sample.triangles()[i].v[2]];
      if (!can_halve(a, b)) continue;
      sample.triangles()[i].n = {kNone, kNone, kNone};
      const Vertex at = middle(a, b);
      const std::uint32_t j = halving.halve_at(i, sample.add_vertex(at.row, at.col));
      for (const std::uint32_t k : {i, j}) queue.emplace(sample.triangles()[k].squares, k);
    }
    return limit;
  }

  TerrainMesh& mesh_;
  std::uint64_t most_;
  const RunContext& run_;
  int rows_ = 0, cols_ = 0;
  std::vector<std::uint32_t> open_;
};

}  // namespace

void bisect_terrain(TerrainMesh& mesh, std::uint64_t triangles, const RunContext& run) {
  Bisection(mesh, triangles, run).go();
  // About a hundred triangles a square.
  const double nodes_each = static_cast<double>(mesh.field().z_mm.cells().size()) /
                            static_cast<double>(mesh.triangles().size());
  mesh.sort_by_place(static_cast<std::int32_t>(std::ceil(8.0 * std::sqrt(nodes_each))));
}

}  // namespace maquette::meshing::detail

// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/level_curves.hpp"

#include <algorithm>
#include <cmath>

#include <oneapi/tbb/parallel_for.h>

#include "core/check.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;

/// The cell at (row, col) is cut from its lower right to its upper left node.
bool falls(const Grid<float>& z, std::ptrdiff_t row, std::ptrdiff_t col) {
  return z(row, col + 1) + z(row + 1, col) > z(row, col) + z(row + 1, col + 1);
}

/// Edges of one level are named 3 node + direction: from the node to the right, up, or the
/// diagonal of the cell to its upper right.
struct Edge {
  std::ptrdiff_t row, col;
  std::uint32_t direction;
};
/// Half 0 of a cell has its lower edge, half 1 its upper one.
struct Half {
  std::ptrdiff_t row, col;
  std::uint32_t half;
};
struct Place {
  double x, y;
};

class LevelTracer {
 public:
  LevelTracer(const ModelField& field, double level, std::uint32_t index,
              const std::vector<std::uint32_t>& edges, double tolerance_mm, double least_mm)
      : z_(field.z_mm),
        x0_(field.x0.value()),
        y0_(field.y0.value()),
        d_(field.spacing.value()),
        level_(level),
        index_(index),
        edges_(edges),
        seen_(edges.size(), false),
        tolerance_mm_(tolerance_mm),
        least_mm_(least_mm) {}

  std::vector<LevelCurve> run() {
    std::vector<LevelCurve> curves;
    for (std::size_t i = 0; i < edges_.size(); ++i) {
      if (seen_[i]) continue;
      const Edge start = edge(edges_[i]);
      seen_[i] = true;
      const std::array<Half, 2> sides = halves(start);
      line_.assign({at(start)});
      const bool closed = follow(start, sides[0]);
      if (!closed) {
        std::reverse(line_.begin(), line_.end());
        follow(start, sides[1]);
      }
      add(curves, closed, start);
    }
    return curves;
  }

 private:
  [[nodiscard]] bool low(std::ptrdiff_t r, std::ptrdiff_t c) const {
    return static_cast<double>(z_(r, c)) <= level_;
  }
  [[nodiscard]] Edge edge(std::uint32_t name) const {
    const auto node = static_cast<std::ptrdiff_t>(name / 3);
    return {node / z_.cols(), node % z_.cols(), name % 3};
  }
  [[nodiscard]] std::uint32_t name(const Edge& e) const {
    return 3 * static_cast<std::uint32_t>(e.row * z_.cols() + e.col) + e.direction;
  }
  struct Ends {
    std::ptrdiff_t row0, col0, row1, col1;
  };
  [[nodiscard]] Ends ends(const Edge& e) const {
    if (e.direction == 0) return {e.row, e.col, e.row, e.col + 1};
    if (e.direction == 1) return {e.row, e.col, e.row + 1, e.col};
    if (falls(z_, e.row, e.col)) return {e.row, e.col + 1, e.row + 1, e.col};
    return {e.row, e.col, e.row + 1, e.col + 1};
  }
  [[nodiscard]] bool crossed(const Edge& e) const {
    const Ends n = ends(e);
    return low(n.row0, n.col0) != low(n.row1, n.col1);
  }
  [[nodiscard]] Place at(const Edge& e) const {
    const Ends n = ends(e);
    const auto a = static_cast<double>(z_(n.row0, n.col0));
    const auto b = static_cast<double>(z_(n.row1, n.col1));
    double t = (level_ - a) / (b - a);
    if (!(t >= 0.0 && t <= 1.0)) t = std::isinf(a) ? 1.0 : 0.0;
    return {x0_ + d_ * (static_cast<double>(n.col0) + t * static_cast<double>(n.col1 - n.col0)),
            y0_ + d_ * (static_cast<double>(n.row0) + t * static_cast<double>(n.row1 - n.row0))};
  }
  /// On both sides of an edge; may lie off the grid.
  [[nodiscard]] std::array<Half, 2> halves(const Edge& e) const {
    switch (e.direction) {
      case 0:
        return {Half{e.row, e.col, 0}, Half{e.row - 1, e.col, 1}};
      case 1:
        return {Half{e.row, e.col, half_with_side(e.row, e.col, false)},
                Half{e.row, e.col - 1, half_with_side(e.row, e.col - 1, true)}};
      default:
        return {Half{e.row, e.col, 0}, Half{e.row, e.col, 1}};
    }
  }

  /// Which half has the cell's left or right side.
  [[nodiscard]] std::uint32_t half_with_side(std::ptrdiff_t row, std::ptrdiff_t col,
                                             bool right) const {
    if (row < 0 || col < 0 || row >= z_.rows() - 1 || col >= z_.cols() - 1) return 0;
    return falls(z_, row, col) == right ? 1 : 0;
  }

  /// Adds places from the edge through the half on, until the rim (false) or the start (true).
  bool follow(Edge from, Half half) {
    for (;;) {
      if (half.row < 0 || half.col < 0 || half.row >= z_.rows() - 1 || half.col >= z_.cols() - 1)
        return false;
      const bool right = half_with_side(half.row, half.col, true) == half.half;
      const std::array<Edge, 3> rim{
          Edge{half.row + static_cast<std::ptrdiff_t>(half.half), half.col, 0},
          Edge{half.row, half.col + (right ? 1 : 0), 1}, Edge{half.row, half.col, 2}};
      const std::uint32_t came = name(from);
      const Edge* next = nullptr;
      for (const Edge& e : rim)
        if (name(e) != came && crossed(e)) next = &e;
      MAQUETTE_CHECK(next != nullptr, "level line ends in a triangle at {}, {}", half.row,
                     half.col);
      const auto found = std::lower_bound(edges_.begin(), edges_.end(), name(*next));
      const auto i = static_cast<std::size_t>(found - edges_.begin());
      if (seen_[i]) return true;
      seen_[i] = true;
      line_.push_back(at(*next));
      const std::array<Half, 2> sides = halves(*next);
      const bool first =
          sides[0].row == half.row && sides[0].col == half.col && sides[0].half == half.half;
      from = *next;
      half = first ? sides[1] : sides[0];
    }
  }

  void add(std::vector<LevelCurve>& curves, bool closed, const Edge& start) {
    if (line_.size() < 2) return;
    double length = 0.0;
    for (std::size_t i = 1; i < line_.size(); ++i)
      length += std::hypot(line_[i].x - line_[i - 1].x, line_[i].y - line_[i - 1].y);
    if (length < least_mm_) return;
    // The start's higher node must lie to the left of where the curve goes from there.
    const Place here = at(start);
    std::size_t i = 0;
    while (i + 1 < line_.size() && !(line_[i].x == here.x && line_[i].y == here.y)) ++i;
    const std::size_t j = i + 1 < line_.size() ? i + 1 : i;
    const Place from = line_[j == i ? i - 1 : i], to = line_[j];
    const Ends n = ends(start);
    const double up = low(n.row0, n.col0) ? 1.0 : -1.0;
    const double ux = up * static_cast<double>(n.col1 - n.col0);
    const double uy = up * static_cast<double>(n.row1 - n.row0);
    if ((to.x - from.x) * uy - (to.y - from.y) * ux < 0.0) std::reverse(line_.begin(), line_.end());
    LevelCurve curve{index_, closed, {}};
    if (closed) line_.push_back(line_.front());
    curve.places.reserve(line_.size());
    for (const Place& p : line_)
      curve.places.push_back({static_cast<std::int32_t>(std::lround(p.x * 1000.0)),
                              static_cast<std::int32_t>(std::lround(p.y * 1000.0))});
    reduce_to_chords(curve.places, tolerance_mm_);
    if (closed) curve.places.pop_back();
    if (curve.places.size() < (closed ? 3U : 2U)) return;
    curve.places.shrink_to_fit();
    curves.push_back(std::move(curve));
  }

  const Grid<float>& z_;
  double x0_, y0_, d_, level_;
  std::uint32_t index_;
  const std::vector<std::uint32_t>& edges_;
  std::vector<bool> seen_;
  double tolerance_mm_, least_mm_;
  std::vector<Place> line_;
};

/// Calls f(level, edge) for each edge and level between its ends, in order of edges.
template <class F>
void for_each_crossing(const Grid<float>& z, double first, double step, std::int64_t from,
                       std::int64_t to, F&& f) {
  const auto level_of = [&](float v) {  // the lowest level that is not below v
    return std::isfinite(v)
               ? static_cast<std::int64_t>(std::ceil((static_cast<double>(v) - first) / step))
               : to;
  };
  const auto edge = [&](float a, float b, std::uint32_t name) {
    if (a == b) return;
    const float low = std::min(a, b), high = std::max(a, b);
    if (!std::isfinite(low)) return;
    // Exactly the levels for which low <= level < high, in spite of rounding.
    std::int64_t k = std::max(from, level_of(low) - 1);
    for (; k < to; ++k) {
      const double level = first + step * static_cast<double>(k);
      if (static_cast<double>(low) > level) continue;
      if (static_cast<double>(high) <= level) break;
      f(k, name);
    }
  };
  std::uint32_t node = 0;
  for (std::ptrdiff_t r = 0; r < z.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < z.cols(); ++c, ++node) {
      const float a = z(r, c);
      const bool right = c + 1 < z.cols(), up = r + 1 < z.rows();
      if (right) edge(a, z(r, c + 1), 3 * node);
      if (up) edge(a, z(r + 1, c), 3 * node + 1);
      if (!right || !up) continue;
      if (falls(z, r, c))
        edge(z(r, c + 1), z(r + 1, c), 3 * node + 2);
      else
        edge(a, z(r + 1, c + 1), 3 * node + 2);
    }
}

}  // namespace

std::vector<LevelCurve> level_curves(const ModelField& value, double first, double step,
                                     double tolerance_mm, double least_mm, const RunContext& run) {
  const Grid<float>& z = value.z_mm;
  MAQUETTE_CHECK(step > 0.0 && z.cells().size() < (std::size_t{1} << 30), "step {}, {} nodes", step,
                 z.cells().size());
  double highest = -INFINITY;
  for (const float v : z.cells())
    if (std::isfinite(v)) highest = std::max(highest, static_cast<double>(v));
  if (!(highest > first)) return {};
  const auto levels = static_cast<std::int64_t>(std::ceil((highest - first) / step)) + 1;
  std::vector<std::uint64_t> crossings(static_cast<std::size_t>(levels), 0);
  for_each_crossing(z, first, step, 0, levels, [&](std::int64_t k, std::uint32_t) {
    ++crossings[static_cast<std::size_t>(k)];
  });

  constexpr std::uint64_t kCrossingsAtATime = std::uint64_t{1} << 23;
  std::vector<LevelCurve> curves;
  for (std::int64_t from = 0; from < levels && !run.stopped();) {
    std::int64_t to = from;
    std::uint64_t size = 0;
    do size += crossings[static_cast<std::size_t>(to++)];
    while (to < levels && size + crossings[static_cast<std::size_t>(to)] <= kCrossingsAtATime);
    const auto count = static_cast<std::size_t>(to - from);
    std::vector<std::vector<std::uint32_t>> edges(count);
    for (std::size_t i = 0; i < count; ++i)
      edges[i].reserve(crossings[static_cast<std::size_t>(from) + i]);
    for_each_crossing(z, first, step, from, to, [&](std::int64_t k, std::uint32_t name) {
      edges[static_cast<std::size_t>(k - from)].push_back(name);
    });
    std::vector<std::vector<LevelCurve>> found(count);
    oneapi::tbb::parallel_for(std::size_t{0}, count, [&](std::size_t i) {
      const std::int64_t k = from + static_cast<std::int64_t>(i);
      found[i] = LevelTracer(value, first + step * static_cast<double>(k),
                             static_cast<std::uint32_t>(k), edges[i], tolerance_mm, least_mm)
                     .run();
    });
    for (auto& some : found) std::move(some.begin(), some.end(), std::back_inserter(curves));
    from = to;
  }
  return curves;
}

void reduce_to_chords(std::vector<PlanPlace>& places, double tolerance_mm) {
  if (places.size() < 3) return;
  const double tolerance = 1000.0 * tolerance_mm;
  std::vector<bool> stays(places.size(), false);
  stays.front() = stays.back() = true;
  std::vector<std::pair<std::size_t, std::size_t>> open{{0, places.size() - 1}};
  while (!open.empty()) {
    const auto [i, j] = open.back();
    open.pop_back();
    const double ax = places[i].x, ay = places[i].y;
    const double ux = places[j].x - ax, uy = places[j].y - ay, length2 = ux * ux + uy * uy;
    double worst = -1.0;
    std::size_t at = i;
    for (std::size_t k = i + 1; k < j; ++k) {
      const double vx = places[k].x - ax, vy = places[k].y - ay;
      const double t = length2 > 0.0 ? std::clamp((ux * vx + uy * vy) / length2, 0.0, 1.0) : 0.0;
      const double off = std::hypot(vx - t * ux, vy - t * uy);
      if (off > worst) {
        worst = off;
        at = k;
      }
    }
    if (!(worst > tolerance)) continue;
    stays[at] = true;
    open.emplace_back(i, at);
    open.emplace_back(at, j);
  }
  std::size_t size = 0;
  for (std::size_t k = 0; k < places.size(); ++k)
    if (stays[k] && (size == 0 || !(places[k] == places[size - 1]))) places[size++] = places[k];
  places.resize(size);
}

}  // namespace maquette::cnc

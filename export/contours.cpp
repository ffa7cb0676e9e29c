// SPDX-License-Identifier: GPL-3.0-or-later
#include "export/contours.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include <tbb/parallel_for.h>
#include <tbb/parallel_sort.h>

namespace maquette::exporting {
namespace {

constexpr std::ptrdiff_t kBlock = 64;  ///< cells along one side

/// Edges are numbered 3 node + direction: 0 to the right, 1 up, 2 along the diagonal.
using EdgeKey = std::uint64_t;

/// A piece of a line inside one triangle, from one crossed edge to the other.
struct Segment {
  EdgeKey from, to;
};

struct Corner {
  float z;
  std::ptrdiff_t node;
};

/// Edge between two nodes of a cell, whichever comes first.
EdgeKey edge_key(std::ptrdiff_t a, std::ptrdiff_t b, std::ptrdiff_t cols) {
  const std::ptrdiff_t first = std::min(a, b), step = std::max(a, b) - first;
  const std::ptrdiff_t direction = step == 1 ? 0 : step == cols ? 1 : 2;
  return static_cast<EdgeKey>(3 * first + direction);
}

/// Corners counter-clockwise. Going round, the line leaves by the edge that climbs
/// through the level and comes in by the one that falls: higher ground on the left.
void add_segment(const std::array<Corner, 3>& t, float level, std::ptrdiff_t cols,
                 std::vector<Segment>& out) {
  if (std::isnan(t[0].z) || std::isnan(t[1].z) || std::isnan(t[2].z)) return;
  const std::array<bool, 3> above{t[0].z >= level, t[1].z >= level, t[2].z >= level};
  if (above[0] == above[1] && above[1] == above[2]) return;
  Segment s{};
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t next = (k + 1) % 3;
    if (above[k] && !above[next]) s.from = edge_key(t[k].node, t[next].node, cols);
    if (!above[k] && above[next]) s.to = edge_key(t[k].node, t[next].node, cols);
  }
  out.push_back(s);
}

std::array<double, 2> crossing(const heightmap::ModelField& f, EdgeKey key, double level) {
  const auto node = static_cast<std::ptrdiff_t>(key / 3);
  const auto direction = static_cast<int>(key % 3);
  const std::ptrdiff_t r = node / f.z_mm.cols(), c = node % f.z_mm.cols();
  const std::ptrdiff_t r1 = r + (direction != 0 ? 1 : 0), c1 = c + (direction != 1 ? 1 : 0);
  const auto a = static_cast<double>(f.z_mm(r, c)), b = static_cast<double>(f.z_mm(r1, c1));
  const double t = (level - a) / (b - a);
  const double dx = c1 != c ? t : 0.0, dy = r1 != r ? t : 0.0;
  return {f.x_mm(c) + f.spacing.value() * dx, f.y_mm(r) + f.spacing.value() * dy};
}

void add_point(ContourLine& line, std::array<double, 2> point) {
  if (line.points_mm.empty() || line.points_mm.back() != point) line.points_mm.push_back(point);
}

}  // namespace

ContourTracer::ContourTracer(const heightmap::ModelField& surface) : surface_(surface) {
  const std::ptrdiff_t rows = surface.z_mm.rows() - 1, cols = surface.z_mm.cols() - 1;
  if (rows < 1 || cols < 1) return;
  constexpr float kInf = std::numeric_limits<float>::infinity();
  blocks_ = Grid<BlockRange>((rows + kBlock - 1) / kBlock, (cols + kBlock - 1) / kBlock,
                             BlockRange{kInf, -kInf});
  tbb::parallel_for(std::ptrdiff_t{0}, blocks_.rows(), [&](std::ptrdiff_t br) {
    for (std::ptrdiff_t r = br * kBlock; r <= std::min(rows, (br + 1) * kBlock); ++r)
      for (std::ptrdiff_t bc = 0; bc < blocks_.cols(); ++bc) {
        BlockRange& range = blocks_(br, bc);
        for (std::ptrdiff_t c = bc * kBlock; c <= std::min(cols, (bc + 1) * kBlock); ++c) {
          const float z = surface.z_mm(r, c);
          if (z < range.min) range.min = z;
          if (z > range.max) range.max = z;
        }
      }
  });
}

std::vector<ContourLine> ContourTracer::trace(double level_mm) const {
  const Grid<float>& z = surface_.z_mm;
  const std::ptrdiff_t rows = z.rows() - 1, cols = z.cols() - 1;
  // z >= level in double is z >= the first float at or above the level.
  auto level = static_cast<float>(level_mm);
  if (static_cast<double>(level) < level_mm)
    level = std::nextafter(level, std::numeric_limits<float>::infinity());

  std::vector<std::vector<Segment>> bands(static_cast<std::size_t>(blocks_.rows()));
  tbb::parallel_for(std::ptrdiff_t{0}, blocks_.rows(), [&](std::ptrdiff_t br) {
    auto& out = bands[static_cast<std::size_t>(br)];
    for (std::ptrdiff_t bc = 0; bc < blocks_.cols(); ++bc) {
      const BlockRange range = blocks_(br, bc);
      if (!(range.min < level && range.max >= level)) continue;
      for (std::ptrdiff_t r = br * kBlock; r < std::min(rows, (br + 1) * kBlock); ++r)
        for (std::ptrdiff_t c = bc * kBlock; c < std::min(cols, (bc + 1) * kBlock); ++c) {
          const std::ptrdiff_t node = r * z.cols() + c;
          const Corner a{z(r, c), node}, b{z(r, c + 1), node + 1}, d{z(r + 1, c), node + z.cols()},
              e{z(r + 1, c + 1), node + z.cols() + 1};
          add_segment({a, b, e}, level, z.cols(), out);
          add_segment({a, e, d}, level, z.cols(), out);
        }
    }
  });

  std::vector<Segment> segments;
  for (auto& band : bands) {
    segments.insert(segments.end(), band.begin(), band.end());
    std::vector<Segment>().swap(band);
  }
  // An edge is left by one triangle at most: `from` is unique and orders completely.
  tbb::parallel_sort(segments.begin(), segments.end(),
                     [](const Segment& a, const Segment& b) { return a.from < b.from; });
  constexpr std::size_t kNone = ~std::size_t{0};
  std::vector<std::size_t> next(segments.size(), kNone);
  tbb::parallel_for(std::size_t{0}, segments.size(), [&](std::size_t i) {
    const auto at = std::lower_bound(segments.begin(), segments.end(), segments[i].to,
                                     [](const Segment& s, EdgeKey key) { return s.from < key; });
    if (at != segments.end() && at->from == segments[i].to)
      next[i] = static_cast<std::size_t>(at - segments.begin());
  });
  std::vector<bool> begun(segments.size(), false), follows(segments.size(), false);
  for (const std::size_t n : next)
    if (n != kNone) follows[n] = true;

  std::vector<ContourLine> lines;
  const auto walk = [&](std::size_t start, bool closed) {
    ContourLine line;
    line.closed = closed;
    std::size_t i = start, last = start;
    for (; i != kNone && !begun[i]; i = next[i]) {
      begun[i] = true;
      last = i;
      add_point(line, crossing(surface_, segments[i].from, level_mm));
    }
    if (!closed) add_point(line, crossing(surface_, segments[last].to, level_mm));
    if (closed && line.points_mm.size() > 1 && line.points_mm.front() == line.points_mm.back())
      line.points_mm.pop_back();
    if (line.points_mm.size() >= 2) lines.push_back(std::move(line));
  };
  for (std::size_t i = 0; i < segments.size(); ++i)
    if (!follows[i]) walk(i, false);
  for (std::size_t i = 0; i < segments.size(); ++i)
    if (!begun[i]) walk(i, true);
  return lines;
}

}  // namespace maquette::exporting

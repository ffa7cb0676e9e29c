// SPDX-License-Identifier: GPL-3.0-or-later

// How far a tile is from the full surface: see lod_tile.hpp.

#include <algorithm>
#include <cmath>

#include "core/triangle_distance.hpp"
#include "export/lod_tile.hpp"

namespace maquette::exporting {
namespace {

/// In units of nodes across and millimetres up.
struct Point {
  double col = 0.0, row = 0.0, z = 0.0;
};

class Comparison {
 public:
  Comparison(const heightmap::ModelField& field, const LodLattice& lattice, const LodTileMesh& tile)
      : field_(field), step_mm_(lattice.step_mm), tile_(tile) {}

  LodTileError measure() {
    const std::size_t across = tile_.cols.size() - 1, up = tile_.rows.size() - 1;
    for (std::size_t r = 0; r < up; ++r)
      for (std::size_t c = 0; c < across; ++c) compare_cell(r, c);
    error_.rms_mm = std::sqrt(squares_ / static_cast<double>(counted_));
    // Where heights are right at the nodes, or nowhere wrong by more than half a step, distance
    // has nothing to add.
    if (tile_.key.level == 0)
      error_.hausdorff_mm = error_.vertical_mm;
    else
      find_hausdorff();
    return error_;
  }

 private:
  [[nodiscard]] double field_z(std::ptrdiff_t row, std::ptrdiff_t col) const {
    return static_cast<double>(field_.z_mm(row, col));
  }
  [[nodiscard]] Point at(std::uint32_t vertex) const {
    const LodVertex& v = tile_.vertices[vertex];
    return {static_cast<double>(v.col), static_cast<double>(v.row), step_mm_ * v.height};
  }
  /// The full surface between nodes.
  [[nodiscard]] double surface_z(double row, double col) const {
    const auto r = std::min(static_cast<std::ptrdiff_t>(row), field_.z_mm.rows() - 2);
    const auto c = std::min(static_cast<std::ptrdiff_t>(col), field_.z_mm.cols() - 2);
    const double u = col - static_cast<double>(c), v = row - static_cast<double>(r);
    const double a = field_z(r, c), d = field_z(r + 1, c + 1);
    return u >= v ? a + u * (field_z(r, c + 1) - a) + v * (d - field_z(r, c + 1))
                  : a + v * (field_z(r + 1, c) - a) + u * (d - field_z(r + 1, c));
  }

  void differs(double by) { error_.vertical_mm = std::max(error_.vertical_mm, std::fabs(by)); }
  /// @param z  of the tile over a node
  void compare_node(std::ptrdiff_t row, std::ptrdiff_t col, double z, bool counts) {
    const double by = z - field_z(row, col);
    differs(by);
    if (!counts) return;
    squares_ += by * by;
    ++counted_;
  }

  [[nodiscard]] bool is_plain(std::size_t r, std::size_t c) const {
    const std::uint32_t first = tile_.first_of_cell[r * (tile_.cols.size() - 1) + c];
    const std::uint32_t last = tile_.first_of_cell[r * (tile_.cols.size() - 1) + c + 1];
    return last - first == 2 &&
           tile_.cols[c + 1] - tile_.cols[c] == tile_.rows[r + 1] - tile_.rows[r];
  }

  /// A square cell of two triangles: its edges lie on edges of the full surface.
  void compare_plain(std::size_t r, std::size_t c) {
    const std::ptrdiff_t row0 = tile_.rows[r], col0 = tile_.cols[c];
    const std::ptrdiff_t gap = tile_.cols[c + 1] - col0;
    const auto width = static_cast<std::uint32_t>(tile_.cols.size());
    const auto first = static_cast<std::uint32_t>(r) * width + static_cast<std::uint32_t>(c);
    const double sw = at(first).z, se = at(first + 1).z;
    const double nw = at(first + width).z, ne = at(first + width + 1).z;
    const double per_gap = 1.0 / static_cast<double>(gap);
    for (std::ptrdiff_t i = 0; i <= gap; ++i)
      for (std::ptrdiff_t j = 0; j <= gap; ++j) {
        const double u = static_cast<double>(j) * per_gap, v = static_cast<double>(i) * per_gap;
        const double z =
            j >= i ? sw + u * (se - sw) + v * (ne - se) : sw + v * (nw - sw) + u * (ne - nw);
        compare_node(row0 + i, col0 + j, z, counts(r, c, row0 + i, col0 + j));
      }
  }

  /// Each node counts in one cell only.
  [[nodiscard]] bool counts(std::size_t r, std::size_t c, std::ptrdiff_t row,
                            std::ptrdiff_t col) const {
    return (row < tile_.rows[r + 1] || r + 2 == tile_.rows.size()) &&
           (col < tile_.cols[c + 1] || c + 2 == tile_.cols.size());
  }

  void compare_cell(std::size_t r, std::size_t c) {
    if (is_plain(r, c)) {
      compare_plain(r, c);
      return;
    }
    const std::ptrdiff_t width = tile_.cols[c + 1] - tile_.cols[c] + 1;
    seen_.assign(static_cast<std::size_t>(width * (tile_.rows[r + 1] - tile_.rows[r] + 1)), false);
    const std::size_t cell = r * (tile_.cols.size() - 1) + c;
    for (std::uint32_t t = tile_.first_of_cell[cell]; t < tile_.first_of_cell[cell + 1]; ++t) {
      const std::array<Point, 3> p{at(tile_.triangles[t][0]), at(tile_.triangles[t][1]),
                                   at(tile_.triangles[t][2])};
      for (std::size_t k = 0; k < 3; ++k) compare_edge(p[k], p[(k + 1) % 3]);
      compare_nodes_under(p, r, c, width);
    }
  }

  void compare_nodes_under(const std::array<Point, 3>& p, std::size_t r, std::size_t c,
                           std::ptrdiff_t width) {
    const double ax = p[1].col - p[0].col, ay = p[1].row - p[0].row;
    const double bx = p[2].col - p[0].col, by = p[2].row - p[0].row;
    const double area = ax * by - ay * bx;
    const auto [low, high] = std::minmax({p[0].row, p[1].row, p[2].row});
    const auto [west, east] = std::minmax({p[0].col, p[1].col, p[2].col});
    for (auto row = static_cast<std::ptrdiff_t>(low); row <= static_cast<std::ptrdiff_t>(high);
         ++row) {
      // Where the row's line is inside: between its crossings with the edges.
      double from = east, to = west;
      for (std::size_t k = 0; k < 3; ++k) {
        const Point &a = p[k], &b = p[(k + 1) % 3];
        const auto y = static_cast<double>(row);
        if (y < std::min(a.row, b.row) || y > std::max(a.row, b.row)) continue;
        if (a.row == b.row) {
          from = std::min({from, a.col, b.col});
          to = std::max({to, a.col, b.col});
          continue;
        }
        const double x = a.col + (y - a.row) / (b.row - a.row) * (b.col - a.col);
        from = std::min(from, x);
        to = std::max(to, x);
      }
      // A node on an edge may count to both sides, for both have the same height there.
      constexpr double kOnEdge = 1e-9;
      for (auto col = static_cast<std::ptrdiff_t>(std::ceil(from - kOnEdge));
           static_cast<double>(col) <= to + kOnEdge; ++col) {
        const double x = static_cast<double>(col) - p[0].col;
        const double y = static_cast<double>(row) - p[0].row;
        const double s = (x * by - y * bx) / area, t = (ax * y - ay * x) / area;
        const double z = p[0].z + s * (p[1].z - p[0].z) + t * (p[2].z - p[0].z);
        const auto mark =
            static_cast<std::size_t>((row - tile_.rows[r]) * width + col - tile_.cols[c]);
        compare_node(row, col, z, !seen_[mark] && counts(r, c, row, col));
        seen_[mark] = true;
      }
    }
  }

  /// Where an edge of the tile crosses columns, rows and diagonals of the field.
  void compare_edge(Point a, Point b) {
    const double dx = b.col - a.col, dy = b.row - a.row;
    const auto cross_lines = [&](double from,
                                 double to) {  // of a coordinate that lines are whole in
      if (from == to) return;
      const double low = std::min(from, to), high = std::max(from, to);
      for (double line = std::ceil(low); line <= high; line += 1.0) {
        const double t = (line - from) / (to - from);
        const double z = a.z + t * (b.z - a.z);
        differs(z - surface_z(a.row + t * dy, a.col + t * dx));
      }
    };
    cross_lines(a.col, b.col);
    cross_lines(a.row, b.row);
    cross_lines(a.col - a.row, b.col - b.row);
  }

  [[nodiscard]] Vec3 model(Point p) const {
    const double h = field_.spacing.value();
    return {h * p.col, h * p.row, p.z};
  }

  /// Both ways over all nodes; what cannot be farther than the farthest so far is passed over.
  void find_hausdorff() {
    const std::size_t across = tile_.cols.size() - 1, up = tile_.rows.size() - 1;
    for (std::size_t r = 0; r < up; ++r)
      for (std::size_t c = 0; c < across; ++c) {
        const std::size_t cell = r * across + c;
        for (std::ptrdiff_t row = tile_.rows[r]; row <= tile_.rows[r + 1]; ++row)
          for (std::ptrdiff_t col = tile_.cols[c]; col <= tile_.cols[c + 1]; ++col) {
            const double z = tile_z(cell, row, col), full = field_z(row, col);
            const double off = std::fabs(z - full);
            if (off <= error_.hausdorff_mm) continue;
            const Point on_field{static_cast<double>(col), static_cast<double>(row), full};
            farther(to_tile(model(on_field), r, c, off));
            if (off <= error_.hausdorff_mm) continue;
            farther(to_field(model({on_field.col, on_field.row, z}), row, col, off));
          }
      }
  }
  void farther(double distance) { error_.hausdorff_mm = std::max(error_.hausdorff_mm, distance); }

  /// Height of the cell's triangles over a node that lies in it.
  [[nodiscard]] double tile_z(std::size_t cell, std::ptrdiff_t row, std::ptrdiff_t col) const {
    const auto x = static_cast<double>(col), y = static_cast<double>(row);
    double best = -INFINITY, z = 0.0;
    for (std::uint32_t t = tile_.first_of_cell[cell]; t < tile_.first_of_cell[cell + 1]; ++t) {
      const Point a = at(tile_.triangles[t][0]), b = at(tile_.triangles[t][1]),
                  c = at(tile_.triangles[t][2]);
      const double area = (b.col - a.col) * (c.row - a.row) - (b.row - a.row) * (c.col - a.col);
      const double s = ((x - a.col) * (c.row - a.row) - (y - a.row) * (c.col - a.col)) / area;
      const double u = ((b.col - a.col) * (y - a.row) - (b.row - a.row) * (x - a.col)) / area;
      const double inside = std::min({s, u, 1.0 - s - u});
      if (inside <= best) continue;
      best = inside;
      z = a.z + s * (b.z - a.z) + u * (c.z - a.z);
    }
    return z;
  }

  /// To the tile's triangles round cell (r, c), none farther than `most`; may end early where the
  /// distance is seen not to matter.
  [[nodiscard]] double to_tile(Vec3 p, std::size_t r, std::size_t c, double most) const {
    double best = most;
    const auto cells = static_cast<std::ptrdiff_t>(
        most /
            (field_.spacing.value() * static_cast<double>(std::ptrdiff_t{1} << tile_.key.level)) +
        1.0);
    const auto across = static_cast<std::ptrdiff_t>(tile_.cols.size()) - 1;
    const auto up = static_cast<std::ptrdiff_t>(tile_.rows.size()) - 1;
    const auto r0 = static_cast<std::ptrdiff_t>(r), c0 = static_cast<std::ptrdiff_t>(c);
    for (std::ptrdiff_t ring = 0; ring <= cells; ++ring)
      for (std::ptrdiff_t i = std::max<std::ptrdiff_t>(r0 - ring, 0);
           i <= std::min(r0 + ring, up - 1); ++i)
        for (std::ptrdiff_t j = std::max<std::ptrdiff_t>(c0 - ring, 0);
             j <= std::min(c0 + ring, across - 1); ++j) {
          if (std::max(std::abs(i - r0), std::abs(j - c0)) != ring) continue;
          const auto cell = static_cast<std::size_t>(i * across + j);
          for (std::uint32_t t = tile_.first_of_cell[cell]; t < tile_.first_of_cell[cell + 1];
               ++t) {
            const auto& v = tile_.triangles[t];
            best = std::min(best, std::sqrt(triangle_distance2(p, model(at(v[0])), model(at(v[1])),
                                                               model(at(v[2])))));
            if (best <= error_.hausdorff_mm) return best;
          }
        }
    return best;
  }

  /// The same to the full surface over the tile.
  [[nodiscard]] double to_field(Vec3 p, std::ptrdiff_t row, std::ptrdiff_t col, double most) const {
    double best = most;
    const auto quads = static_cast<std::ptrdiff_t>(most / field_.spacing.value() + 1.0);
    const auto node = [&](std::ptrdiff_t r, std::ptrdiff_t c) {
      return model({static_cast<double>(c), static_cast<double>(r), field_z(r, c)});
    };
    for (std::ptrdiff_t ring = 0; ring <= quads; ++ring)
      for (std::ptrdiff_t r = std::max(row - 1 - ring, tile_.rows.front());
           r <= std::min(row + ring, tile_.rows.back() - 1); ++r)
        for (std::ptrdiff_t c = std::max(col - 1 - ring, tile_.cols.front());
             c <= std::min(col + ring, tile_.cols.back() - 1); ++c) {
          if (ring > 0 && r != row - 1 - ring && r != row + ring && c != col - 1 - ring &&
              c != col + ring)
            continue;
          const Vec3 sw = node(r, c), ne = node(r + 1, c + 1);
          best = std::min(best, std::sqrt(std::min(triangle_distance2(p, sw, node(r, c + 1), ne),
                                                   triangle_distance2(p, sw, ne, node(r + 1, c)))));
          if (best <= error_.hausdorff_mm) return best;
        }
    return best;
  }

  const heightmap::ModelField& field_;
  double step_mm_;
  const LodTileMesh& tile_;
  LodTileError error_;
  double squares_ = 0.0;
  std::uint64_t counted_ = 0;
  std::vector<bool> seen_;  ///< nodes of the cell in hand
};

}  // namespace

LodTileError measure_lod_tile(const heightmap::ModelField& field, const LodLattice& lattice,
                              const LodTileMesh& tile) {
  return Comparison(field, lattice, tile).measure();
}

}  // namespace maquette::exporting

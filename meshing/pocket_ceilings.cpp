// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/detail/pocket_ceilings.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>

#include <oneapi/tbb/parallel_for.h>

namespace maquette::meshing::detail {
namespace {

using heightmap::ModelField;
using std::ptrdiff_t;

std::size_t at(ptrdiff_t i) {
  return static_cast<std::size_t>(i);
}

/// What the roof may lie lower between nodes than its facets, from the surface's hollow edges.
class Dips {
 public:
  Dips(const ModelField& surface, double reach_mm)
      : z_(surface.z_mm),
        reach_(static_cast<ptrdiff_t>(std::ceil(reach_mm / surface.spacing.value())) + 2) {
    const ptrdiff_t rows = (z_.rows() + kBlock - 1) / kBlock,
                    cols = (z_.cols() + kBlock - 1) / kBlock;
    blocks_ = Grid<Edges>(rows, cols);
    oneapi::tbb::parallel_for(ptrdiff_t{0}, rows, [&](ptrdiff_t br) {
      for (ptrdiff_t r = br * kBlock; r < std::min((br + 1) * kBlock, z_.rows() - 1); ++r)
        for (ptrdiff_t c = 0; c + 1 < z_.cols(); ++c) add(r, c, blocks_(br, c / kBlock));
    });
  }

  /// Over all cells within reach of the cells row0 .. row1, col0 .. col1.
  [[nodiscard]] double within(ptrdiff_t row0, ptrdiff_t row1, ptrdiff_t col0,
                              ptrdiff_t col1) const {
    const auto block = [](ptrdiff_t i, ptrdiff_t count) {
      return std::clamp<ptrdiff_t>(i, 0, count - 1) / kBlock;
    };
    Edges most{};
    for (ptrdiff_t r = block(row0 - reach_, z_.rows()); r <= block(row1 + reach_, z_.rows()); ++r)
      for (ptrdiff_t c = block(col0 - reach_, z_.cols()); c <= block(col1 + reach_, z_.cols()); ++c)
        for (std::size_t k = 0; k < 3; ++k) most[k] = std::fmax(most[k], blocks_(r, c)[k]);
    return 0.25 * (static_cast<double>(most[0]) + static_cast<double>(most[1]) +
                   static_cast<double>(most[2]));
  }

 private:
  static constexpr ptrdiff_t kBlock = 4;
  using Edges = std::array<float, 3>;  ///< change of slope times spacing: along x, along y, across

  /// The edges that start at node (r, c): along x, along y, across.
  void add(ptrdiff_t r, ptrdiff_t c, Edges& most) const {
    const auto z = [&](ptrdiff_t i, ptrdiff_t j) { return static_cast<double>(z_(i, j)); };
    const double here = z(r, c), east = z(r, c + 1), north = z(r + 1, c), far = z(r + 1, c + 1);
    std::array<double, 3> turns{r > 0 ? far + z(r - 1, c) - here - east : 0.0,
                                c > 0 ? far + z(r, c - 1) - here - north : 0.0,
                                east + north - here - far};
    // Beyond the outline the roof was made with slopes that go on as they were: whatever way the
    // last edges turn, those out there turn three times as much at most.
    if (r < 2 || c < 2 || r + 3 >= z_.rows() || c + 3 >= z_.cols()) {
      double any = 0.0;
      for (const double turn : turns) any = std::fmax(any, std::abs(turn));
      turns.fill(3.0 * any);
    }
    for (std::size_t k = 0; k < 3; ++k) most[k] = std::fmax(most[k], static_cast<float>(turns[k]));
  }

  const Grid<float>& z_;
  ptrdiff_t reach_;
  Grid<Edges> blocks_;
};

/// Nodes of the field at the corners of all cells that lie over a stretch.
struct NodeRange {
  ptrdiff_t first, last;
};
NodeRange nodes_over(double from, double to, double origin, double spacing, ptrdiff_t count) {
  // A stretch that begins on a line of nodes but for rounding takes one cell more, no harm.
  const auto line = [&](double mm) { return std::floor((mm - origin) / spacing); };
  return {std::clamp<ptrdiff_t>(static_cast<ptrdiff_t>(line(from)), 0, count - 1),
          std::clamp<ptrdiff_t>(static_cast<ptrdiff_t>(line(to)) + 1, 0, count - 1)};
}

/// Heights of the ceilings' nodes.
class Ceiling {
 public:
  Ceiling(const ModelField& surface, const ModelField& roof, const PocketLines& lines)
      : surface_(surface),
        roof_(roof),
        lines_(lines),
        x_(lines.x),
        y_(lines.y),
        z_(lines.y.count(), lines.x.count()) {
    const auto range = heightmap::height_range(roof.z_mm);
    // Half a unit in the last place of the roof's float, and some to spare.
    rounding_mm_ = 1.2e-7 * std::fmax(std::abs(range.min), std::abs(range.max));
  }

  /// @return false if it was stopped
  /// @param least_mm  what the surface is above the ceilings at least, upright
  bool fit(double wall_mm, double& least_mm, const RunContext& run) {
    for (ptrdiff_t j = 0; j < y_.count(); ++j)
      for (ptrdiff_t i = 0; i < x_.count(); ++i)
        z_(j, i) = heightmap::height_at(roof_, x_.mm[at(i)], y_.mm[at(j)]);
    const Dips dips(surface_, wall_mm);
    struct Triangle {
      double too_high = 0.0, below = INFINITY;  // the roof, and the surface, before it is lowered
    };
    struct Lower {
      Triangle east, north;  // at the lower right, at the upper left
      double dip = 0.0;
    };
    Grid<Lower> lower(y_.count(), x_.count());
    for_cells(run, [&](ptrdiff_t j, ptrdiff_t i) {
      const auto [rows, cols] = over(j, i);
      Lower& l = lower(j, i);
      l.dip = dips.within(rows.first, rows.last, cols.first, cols.last) + rounding_mm_;
      for_nodes(j, i, [&](ptrdiff_t r, ptrdiff_t c, double ceiling, bool east) {
        Triangle& t = east ? l.east : l.north;
        t.too_high = std::fmax(t.too_high, ceiling - static_cast<double>(roof_.z_mm(r, c)));
        t.below = std::fmin(t.below, static_cast<double>(surface_.z_mm(r, c)) - ceiling);
      });
    });
    if (run.stopped()) return false;
    Grid<double> fitted = z_;
    for (ptrdiff_t j = 0; j < y_.count(); ++j)
      for (ptrdiff_t i = 0; i < x_.count(); ++i) {
        double worst = 0.0, dip = 0.0;
        const auto look = [&](ptrdiff_t r, ptrdiff_t c, bool east, bool north) {
          if (r < 0 || c < 0 || !lines_.is_pocket(r, c)) return;
          if (east) worst = std::fmax(worst, lower(r, c).east.too_high);
          if (north) worst = std::fmax(worst, lower(r, c).north.too_high);
          dip = std::fmax(dip, lower(r, c).dip);
        };
        look(j, i, true, true);
        look(j, i - 1, true, false);
        look(j - 1, i, false, true);
        look(j - 1, i - 1, true, true);
        fitted(j, i) -= worst + dip;
      }
    z_ = std::move(fitted);
    least_mm = INFINITY;
    for (ptrdiff_t j = 0; j + 1 < y_.count(); ++j)
      for (ptrdiff_t i = 0; i + 1 < x_.count(); ++i)
        if (lines_.is_pocket(j, i))
          for (const Triangle& t : {lower(j, i).east, lower(j, i).north})
            least_mm = std::fmin(least_mm, t.below + t.too_high + lower(j, i).dip);
    return true;
  }

  /// Figures of what fit() found. @return false if it was stopped
  bool measure(double base_mm, Ceilings& u, const RunContext& run) const {
    struct Row {
      double volume = 0.0, excess = 0.0, most = 0.0, nodes = 0.0;
    };
    std::vector<Row> rows(at(y_.count()));
    for_cells(run, [&](ptrdiff_t j, ptrdiff_t i) {
      Row& row = rows[at(j)];
      const double area = (x_.mm[at(i + 1)] - x_.mm[at(i)]) * (y_.mm[at(j + 1)] - y_.mm[at(j)]);
      row.volume +=
          area *
          ((2.0 * z_(j, i) + z_(j, i + 1) + z_(j + 1, i) + 2.0 * z_(j + 1, i + 1)) / 6.0 - base_mm);
      for_nodes(j, i, [&](ptrdiff_t r, ptrdiff_t c, double ceiling, bool east) {
        if (!inside(j, i, r, c, east)) return;
        const double below = static_cast<double>(roof_.z_mm(r, c)) - ceiling;
        row.excess += below;
        row.nodes += 1.0;
        row.most = std::fmax(row.most, below);
      });
    });
    double excess = 0.0, nodes = 0.0;
    for (const Row& row : rows) {
      u.volume_mm3 += row.volume;
      excess += row.excess;
      nodes += row.nodes;
      u.most_excess_mm = std::fmax(u.most_excess_mm, row.most);
    }
    u.mean_excess_mm = nodes > 0.0 ? excess / nodes : 0.0;
    const auto [low, high] = std::minmax_element(z_.cells().begin(), z_.cells().end());
    u.lowest_mm = *low;
    u.highest_mm = *high;
    return !run.stopped();
  }

  [[nodiscard]] Grid<double> take() { return std::move(z_); }

 private:
  template <class Work>  // (row, column) of each cell of a pocket
  void for_cells(const RunContext& run, Work&& work) const {
    oneapi::tbb::parallel_for(ptrdiff_t{0}, y_.count() - 1, [&](ptrdiff_t j) {
      if (run.stopped()) return;
      for (ptrdiff_t i = 0; i + 1 < x_.count(); ++i)
        if (lines_.is_pocket(j, i)) work(j, i);
    });
  }
  [[nodiscard]] std::pair<NodeRange, NodeRange> over(ptrdiff_t j, ptrdiff_t i) const {
    const double d = surface_.spacing.value();
    return {
        nodes_over(y_.mm[at(j)], y_.mm[at(j + 1)], surface_.y0.value(), d, surface_.z_mm.rows()),
        nodes_over(x_.mm[at(i)], x_.mm[at(i + 1)], surface_.x0.value(), d, surface_.z_mm.cols())};
  }
  /// Calls visit(row, column, height of the triangle's plane there, whether it is the one at the
  /// lower right) for each node of each cell that the triangle may touch.
  template <class Visit>
  void for_nodes(ptrdiff_t j, ptrdiff_t i, Visit&& visit) const {
    const auto [rows, cols] = over(j, i);
    const double x0 = x_.mm[at(i)], dx = x_.mm[at(i + 1)] - x0;
    const double y0 = y_.mm[at(j)], dy = y_.mm[at(j + 1)] - y0;
    const double z00 = z_(j, i), z10 = z_(j, i + 1), z01 = z_(j + 1, i), z11 = z_(j + 1, i + 1);
    // A node belongs to a cell that touches a triangle if one of its neighbours may lie in it.
    const double near = 1.001 * surface_.spacing.value() * (1.0 / dx + 1.0 / dy);
    for (ptrdiff_t r = rows.first; r <= rows.last; ++r) {
      const double v = (surface_.y_mm(r) - y0) / dy;
      for (ptrdiff_t c = cols.first; c <= cols.last; ++c) {
        const double u = (surface_.x_mm(c) - x0) / dx;
        if (u - v >= -near) visit(r, c, z00 + u * (z10 - z00) + v * (z11 - z10), true);
        if (u - v <= near) visit(r, c, z00 + v * (z01 - z00) + u * (z11 - z01), false);
      }
    }
  }

  [[nodiscard]] bool inside(ptrdiff_t j, ptrdiff_t i, ptrdiff_t r, ptrdiff_t c, bool east) const {
    const double x = surface_.x_mm(c) - x_.mm[at(i)], dx = x_.mm[at(i + 1)] - x_.mm[at(i)];
    const double y = surface_.y_mm(r) - y_.mm[at(j)], dy = y_.mm[at(j + 1)] - y_.mm[at(j)];
    return x >= 0.0 && y >= 0.0 && x <= dx && y <= dy && (x * dy > y * dx) == east;
  }

  const ModelField &surface_, &roof_;
  const PocketLines& lines_;
  const Lines &x_, &y_;
  Grid<double> z_;
  double rounding_mm_;
};

}  // namespace

std::optional<Ceilings> fit_ceilings(const ModelField& surface, const ModelField& roof,
                                     const PocketLines& lines, double wall_mm, double base_mm,
                                     const RunContext& run) {
  Ceiling ceiling(surface, roof, lines);
  Ceilings fitted;
  if (!ceiling.fit(wall_mm, fitted.least_height_mm, run)) return std::nullopt;
  run.progress(0.6);
  if (!ceiling.measure(base_mm, fitted, run)) return std::nullopt;
  fitted.z_mm = ceiling.take();
  run.progress(1.0);
  return fitted;
}

}  // namespace maquette::meshing::detail

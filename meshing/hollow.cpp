// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/hollow.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/check.hpp"

namespace maquette::meshing {
namespace {

using heightmap::ModelField;
using std::ptrdiff_t;

std::size_t at(ptrdiff_t i) {
  return static_cast<std::size_t>(i);
}

/// Lines of the ceilings' grid along one axis: pockets one after the other, ribs between.
struct Lines {
  std::vector<double> mm{};
  int pockets = 0;
  ptrdiff_t steps = 0;  ///< of each pocket: lines k (steps + 1) .. k (steps + 1) + steps bound it
  double pocket_mm = 0.0;
  [[nodiscard]] ptrdiff_t count() const { return static_cast<ptrdiff_t>(mm.size()); }
  /// Between line i and the next one: a pocket, or a rib.
  [[nodiscard]] bool in_pocket(ptrdiff_t i) const { return i % (steps + 1) != steps; }
  [[nodiscard]] bool first_of_pocket(ptrdiff_t i) const { return i % (steps + 1) == 0; }
  [[nodiscard]] bool border(ptrdiff_t i) const { return first_of_pocket(i) || !in_pocket(i); }
};

Result<Lines> lay_out(char axis, double from, double to, double rib, double widest, double step) {
  const double inner = to - from;
  if (!(inner >= kLeastPocketDepth_mm))
    return fail(kHollowDoesNotFit,
                fmt::format("between the side walls {:g} mm are left in {}; a pocket is at least "
                            "{:g} mm wide: thinner walls would do",
                            inner, axis, kLeastPocketDepth_mm));
  // A width that fits but for rounding fits.
  const double count = std::max(1.0, std::ceil((inner + rib) / (widest + rib) - 1e-9));
  Lines lines{.pockets = static_cast<int>(count),
              .pocket_mm = (inner - (count - 1.0) * rib) / count};
  if (!(lines.pocket_mm >= kLeastPocketDepth_mm))
    return fail(kHollowDoesNotFit,
                fmt::format("{:g} pockets in {} would be {:g} mm wide between ribs of {:g} mm; "
                            "wider pockets or thinner ribs would do",
                            count, axis, lines.pocket_mm, rib));
  lines.steps = static_cast<ptrdiff_t>(std::max(1.0, std::ceil(lines.pocket_mm / step - 1e-9)));
  for (int p = 0; p < lines.pockets; ++p)
    for (ptrdiff_t k = 0; k <= lines.steps; ++k)
      lines.mm.push_back(from + p * (lines.pocket_mm + rib) +
                         lines.pocket_mm * static_cast<double>(k) /
                             static_cast<double>(lines.steps));
  return lines;
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
  Ceiling(const ModelField& surface, const ModelField& roof, const Lines& x, const Lines& y)
      : surface_(surface), roof_(roof), x_(x), y_(y), z_(y.count(), x.count()) {
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
          if (r < 0 || c < 0 || !is_pocket(r, c)) return;
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
        if (is_pocket(j, i))
          for (const Triangle& t : {lower(j, i).east, lower(j, i).north})
            least_mm = std::fmin(least_mm, t.below + t.too_high + lower(j, i).dip);
    return true;
  }

  /// Figures of what fit() found. @return false if it was stopped
  bool measure(double base_mm, Underside& u, const RunContext& run) const {
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
    u.lowest_ceiling_mm = *low;
    u.highest_ceiling_mm = *high;
    return !run.stopped();
  }

  [[nodiscard]] bool is_pocket(ptrdiff_t j, ptrdiff_t i) const {
    return i + 1 < x_.count() && j + 1 < y_.count() && x_.in_pocket(i) && y_.in_pocket(j);
  }
  [[nodiscard]] double operator()(ptrdiff_t j, ptrdiff_t i) const { return z_(j, i); }
  [[nodiscard]] double lowest() const {
    return *std::min_element(z_.cells().begin(), z_.cells().end());
  }

 private:
  template <class Work>  // (row, column) of each cell of a pocket
  void for_cells(const RunContext& run, Work&& work) const {
    oneapi::tbb::parallel_for(ptrdiff_t{0}, y_.count() - 1, [&](ptrdiff_t j) {
      if (run.stopped()) return;
      for (ptrdiff_t i = 0; i + 1 < x_.count(); ++i)
        if (is_pocket(j, i)) work(j, i);
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
  const Lines &x_, &y_;
  Grid<double> z_;
  double rounding_mm_;
};

void add_rim(const ModelField& surface, double base_mm, TriMesh& mesh) {
  const ptrdiff_t rows = surface.z_mm.rows(), cols = surface.z_mm.cols();
  const auto add = [&](ptrdiff_t r, ptrdiff_t c) {
    mesh.vertices_mm.push_back({surface.x_mm(c), surface.y_mm(r), base_mm});
  };
  for (ptrdiff_t c = 0; c + 1 < cols; ++c) add(0, c);
  for (ptrdiff_t r = 0; r + 1 < rows; ++r) add(r, cols - 1);
  for (ptrdiff_t c = cols - 1; c > 0; --c) add(rows - 1, c);
  for (ptrdiff_t r = rows - 1; r > 0; --r) add(r, 0);
}

/// Rim, frame, ribs, walls and ceilings as triangles.
class UndersideBuilder {
 public:
  UndersideBuilder(const ModelField& surface, double base_mm, const Lines& x, const Lines& y,
                   const Ceiling& ceiling)
      : surface_(surface), base_mm_(base_mm), x_(x), y_(y), ceiling_(ceiling) {}

  TriMesh build() {
    add_vertices();
    for (ptrdiff_t j = 0; j + 1 < y_.count(); ++j)
      for (ptrdiff_t i = 0; i + 1 < x_.count(); ++i)
        if (ceiling_.is_pocket(j, i))
          add_pocket_cell(j, i);
        else
          face(low_(j, i), low_(j + 1, i), low_(j + 1, i + 1), low_(j, i + 1));
    add_frame();
    return std::move(mesh_);
  }

 private:
  void add_vertices() {
    add_rim(surface_, base_mm_, mesh_);
    low_ = Grid<std::uint32_t>(y_.count(), x_.count());
    high_ = low_;
    for (ptrdiff_t j = 0; j < y_.count(); ++j)
      for (ptrdiff_t i = 0; i < x_.count(); ++i) {
        if (x_.border(i) || y_.border(j))
          low_(j, i) = add_vertex(x_.mm[at(i)], y_.mm[at(j)], base_mm_);
        high_(j, i) = add_vertex(x_.mm[at(i)], y_.mm[at(j)], ceiling_(j, i));
      }
  }
  std::uint32_t add_vertex(double x, double y, double z) {
    mesh_.vertices_mm.push_back({x, y, z});
    return static_cast<std::uint32_t>(mesh_.vertices_mm.size() - 1);
  }
  /// Corners as they follow each other seen from outside, cut from the first to the third.
  void face(std::uint32_t a, std::uint32_t b, std::uint32_t c, std::uint32_t d) {
    mesh_.triangles.push_back({a, b, c});
    mesh_.triangles.push_back({a, c, d});
  }
  /// The ceiling, and walls where the pocket ends.
  void add_pocket_cell(ptrdiff_t j, ptrdiff_t i) {
    face(high_(j, i), high_(j + 1, i), high_(j + 1, i + 1), high_(j, i + 1));
    if (x_.first_of_pocket(i)) wall(j, i, j + 1, i);
    if (!x_.in_pocket(i + 1)) wall(j + 1, i + 1, j, i + 1);
    if (y_.first_of_pocket(j)) wall(j, i + 1, j, i);
    if (!y_.in_pocket(j + 1)) wall(j + 1, i, j + 1, i + 1);
  }
  /// From left to right seen from the pocket.
  void wall(ptrdiff_t j0, ptrdiff_t i0, ptrdiff_t j1, ptrdiff_t i1) {
    face(low_(j0, i0), low_(j1, i1), high_(j1, i1), high_(j0, i0));
  }

  /// Between the rim and the outermost lines, in four pieces that are cut at the corners.
  void add_frame() {
    const ptrdiff_t rows = surface_.z_mm.rows() - 1, cols = surface_.z_mm.cols() - 1;
    const ptrdiff_t nx = x_.count(), ny = y_.count();
    std::vector<std::uint32_t> south, east, north, west;
    for (ptrdiff_t i = 0; i < nx; ++i) {
      south.push_back(low_(0, i));
      north.push_back(low_(ny - 1, nx - 1 - i));
    }
    for (ptrdiff_t j = 0; j < ny; ++j) {
      east.push_back(low_(j, nx - 1));
      west.push_back(low_(ny - 1 - j, 0));
    }
    strip(0, cols, south);
    strip(cols, rows, east);
    strip(cols + rows, cols, north);
    strip(2 * cols + rows, rows, west);
  }
  /// Outside of it the rim from vertex `first` over `count` edges, inside another line beside it.
  void strip(ptrdiff_t first, ptrdiff_t count, const std::vector<std::uint32_t>& inner) {
    const ptrdiff_t all = 2 * (surface_.z_mm.rows() + surface_.z_mm.cols() - 2);
    const auto outer = [&](ptrdiff_t k) { return static_cast<std::uint32_t>((first + k) % all); };
    const Vec3 from = mesh_.vertices_mm[outer(0)], along = mesh_.vertices_mm[outer(count)] - from;
    const auto place = [&](std::uint32_t v) { return dot(mesh_.vertices_mm[v] - from, along); };
    ptrdiff_t o = 0;
    std::size_t i = 0;
    while (o < count || i + 1 < inner.size()) {
      const bool outwards =
          i + 1 == inner.size() || (o < count && place(outer(o + 1)) <= place(inner[i + 1]));
      if (outwards) {
        mesh_.triangles.push_back({outer(o), inner[i], outer(o + 1)});
        ++o;
      } else {
        mesh_.triangles.push_back({outer(o), inner[i], inner[i + 1]});
        ++i;
      }
    }
  }

  const ModelField& surface_;
  double base_mm_;
  const Lines &x_, &y_;
  const Ceiling& ceiling_;
  Grid<std::uint32_t> low_, high_;
  TriMesh mesh_;
};

Result<void> check_options(const HollowOptions& o) {
  for (const auto& [name, value, least] :
       {std::tuple{"wall", o.wall.value(), 0.1}, std::tuple{"rib", o.rib.value(), 0.1},
        std::tuple{"pocket", o.pocket.value(), kLeastPocketDepth_mm},
        std::tuple{"step", o.step.value() == 0.0 ? 1.0 : o.step.value(), 0.01}})
    if (!(value >= least && value <= 1e4))
      return fail(kHollowDoesNotFit,
                  fmt::format("a {} of {} mm; {} to 10000 mm expected", name, value, least));
  return {};
}

}  // namespace

Underside plain_underside(const ModelField& surface, Millimetres base_z) {
  Underside under;
  add_rim(surface, base_z.value(), under.mesh);
  under.rim_vertices = under.mesh.vertices_mm.size();
  const auto rim = static_cast<std::uint32_t>(under.rim_vertices);
  const Vec3 from = under.mesh.vertices_mm.front();
  const Vec3 to =
      under.mesh
          .vertices_mm[static_cast<std::size_t>(surface.z_mm.rows() - 1 + surface.z_mm.cols() - 1)];
  under.mesh.vertices_mm.push_back(0.5 * (from + to));
  for (std::uint32_t k = 0; k < rim; ++k) under.mesh.triangles.push_back({rim, (k + 1) % rim, k});
  return under;
}

Result<Underside> hollow_underside(const ModelField& surface, const ModelField& roof,
                                   Millimetres base_z, const HollowOptions& options,
                                   const RunContext& run) {
  MAQUETTE_CHECK(roof.z_mm.rows() == surface.z_mm.rows() &&
                     roof.z_mm.cols() == surface.z_mm.cols() && surface.z_mm.rows() >= 2 &&
                     surface.z_mm.cols() >= 2,
                 "roof of {} x {} nodes", roof.z_mm.rows(), roof.z_mm.cols());
  MAQUETTE_TRY_VOID(check_options(options));
  const double wall = options.wall.value(), base = base_z.value();
  const double step =
      options.step.value() > 0.0 ? options.step.value() : 4.0 * surface.spacing.value();
  const auto thick = [&](std::size_t side) { return wall + options.engraved[side].value(); };
  MAQUETTE_TRY(const Lines x, lay_out('x', surface.x_mm(0) + thick(3),
                                      surface.x_mm(surface.z_mm.cols() - 1) - thick(1),
                                      options.rib.value(), options.pocket.value(), step));
  MAQUETTE_TRY(const Lines y, lay_out('y', surface.y_mm(0) + thick(0),
                                      surface.y_mm(surface.z_mm.rows() - 1) - thick(2),
                                      options.rib.value(), options.pocket.value(), step));
  Ceiling ceiling(surface, roof, x, y);
  Underside under;
  if (!ceiling.fit(wall, under.least_height_mm, run))
    return fail(kCancelled, "hollowing was stopped");
  run.progress(0.6);
  if (const double missing = base + kLeastPocketDepth_mm - ceiling.lowest(); missing > 0.0) {
    const auto lowest = static_cast<double>(heightmap::height_range(surface.z_mm).min);
    return fail(kHollowDoesNotFit,
                fmt::format("walls of {:g} mm leave pockets of less than {:g} mm in a base of {:g} "
                            "mm; a base of {:.1f} mm or thinner walls would do",
                            wall, kLeastPocketDepth_mm, lowest - base,
                            std::ceil(10.0 * (lowest - base + missing)) / 10.0));
  }
  if (!ceiling.measure(base, under, run)) return fail(kCancelled, "hollowing was stopped");
  MAQUETTE_CHECK(under.least_height_mm >= wall, "{} mm above a ceiling: whose roof is it?",
                 under.least_height_mm);
  under.rim_vertices =
      2 * static_cast<std::uint64_t>(surface.z_mm.rows() + surface.z_mm.cols() - 2);
  under.pockets_x = x.pockets;
  under.pockets_y = y.pockets;
  under.pocket_x_mm = x.pocket_mm;
  under.pocket_y_mm = y.pocket_mm;
  run.progress(0.9);
  under.mesh = UndersideBuilder(surface, base, x, y, ceiling).build();
  run.progress(1.0);
  return under;
}

}  // namespace maquette::meshing

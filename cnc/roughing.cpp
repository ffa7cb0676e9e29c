// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/roughing.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include "cnc/level_region.hpp"
#include "cnc/mill.hpp"
#include "cnc/pass_sampler.hpp"
#include "cnc/piece_order.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;

constexpr double kMostCells = 268435456.0;
constexpr int kClearCells = 5;  // from "takes nothing" to "certainly stands free": see extended()

using Piece = std::vector<Cell>;

Result<void> check_options(const RoughingOptions& o) {
  const auto check = [](const char* name, double value, double least, double most,
                        const char* unit) -> Result<void> {
    if (value >= least && value <= most) return {};
    return fail(kRoughingOptionOutOfRange, fmt::format("{} is {} {}; it must be from {} to {}",
                                                       name, value, unit, least, most));
  };
  const double R = o.cutter.radius_mm;
  MAQUETTE_TRY_VOID(check("cutter radius", R, 0.1, 200.0, "mm"));
  MAQUETTE_TRY_VOID(check("cutter corner radius", o.cutter.corner_radius_mm, 0.0, R, "mm"));
  MAQUETTE_TRY_VOID(check("allowance", o.allowance_mm, 0.0, 50.0, "mm"));
  MAQUETTE_TRY_VOID(check("step_down", o.step_down_mm, 0.01, 1000.0, "mm"));
  MAQUETTE_TRY_VOID(check("cell", o.cell_mm, 0.01, 0.25 * R, "mm"));
  MAQUETTE_TRY_VOID(check("stepover", o.stepover_mm, o.cell_mm, 1.8 * R, "mm"));
  MAQUETTE_TRY_VOID(check("ramp_angle", o.ramp_angle_deg, 0.5, 45.0, "degrees"));
  MAQUETTE_TRY_VOID(check("feed", o.feed_mm_min, 0.01, 1e6, "mm/min"));
  MAQUETTE_TRY_VOID(check("plunge_feed", o.plunge_feed_mm_min, 0.01, 1e6, "mm/min"));
  MAQUETTE_TRY_VOID(check("clearance", o.clearance_mm, 0.0, 1e4, "mm"));
  if (!std::isnan(o.overhang_mm))
    MAQUETTE_TRY_VOID(check("overhang", o.overhang_mm, 0.0, 1e4, "mm"));
  return {};
}

Result<void> check_heights(const ModelField& design) {
  for (std::ptrdiff_t r = 0; r < design.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < design.z_mm.cols(); ++c)
      if (!std::isfinite(design.z_mm(r, c)))
        return fail(kHeightNotFinite,
                    fmt::format("height is {} at row {}, column {} (x = {} mm, y = {} mm); fill "
                                "voids before milling",
                                design.z_mm(r, c), r, c, design.x_mm(c), design.y_mm(r)));
  return {};
}

/// Cells over the stock, its lower left corner on a cell's corner, and over the overhang.
Result<CellGrid> cells_over(double x0, double y0, double x1, double y1, const RoughingOptions& o) {
  if (!(x0 < x1 && y0 < y1 && std::isfinite(x1 - x0) && std::isfinite(y1 - y0)))
    return fail(kRoughingOptionOutOfRange,
                fmt::format("the stock spans x {} .. {}, y {} .. {} mm; it must have a size", x0,
                            x1, y0, y1));
  CellGrid grid;
  constexpr double kUnit_mm = kTick_mm * kResolution;  // centres and corners on multiples of it
  grid.side = 2 * kResolution * std::llround(0.5 * o.cell_mm / kUnit_mm);
  const double side = grid.side_mm();
  const double overhang =
      std::isnan(o.overhang_mm) ? o.cutter.radius_mm + kClearCells * side : o.overhang_mm;
  const auto beyond = static_cast<std::ptrdiff_t>(overhang / side);
  const double cols = std::ceil((x1 - x0) / side - 1e-9), rows = std::ceil((y1 - y0) / side - 1e-9);
  const double more = 2.0 * static_cast<double>(beyond);
  if ((cols + more) * (rows + more) > kMostCells)
    return fail(kRoughingOptionOutOfRange,
                fmt::format("cell is {} mm: {:.0f} x {:.0f} cells are too many; take larger ones",
                            o.cell_mm, cols, rows));
  grid.cols = static_cast<std::ptrdiff_t>(cols) + 2 * beyond;
  grid.rows = static_cast<std::ptrdiff_t>(rows) + 2 * beyond;
  const auto tick = [](double mm) { return kResolution * std::llround(mm / kUnit_mm); };
  grid.x0 = tick(x0) + grid.side / 2 - beyond * grid.side;
  grid.y0 = tick(y0) + grid.side / 2 - beyond * grid.side;
  return grid;
}

std::int64_t tick_above(double mm) {
  return kResolution * static_cast<std::int64_t>(std::ceil(mm / (kTick_mm * kResolution) - 1e-9));
}

class Operation {
 public:
  Operation(const CellGrid& grid, StockGrid& stock, Grid<float> tips, const RoughingOptions& o)
      : grid_(grid),
        stock_(stock),
        tips_(std::move(tips)),
        options_(o),
        surface_(stock.link_surface()),
        rows_apart_(std::max(1, static_cast<int>(o.stepover_mm / grid.side_mm() + 1e-9))) {}

  [[nodiscard]] const Grid<float>& tips() const { return tips_; }

  void cut_level(std::int64_t z, Toolpath& path, RoughingReport& report) {
    z_ = z;
    const LevelRegion region(tips_, mm_of_ticks(z));
    const std::uint64_t before = report.pieces;
    cut(rows(region), region, path, report);
    cut(rims(region), region, path, report);
    if (report.pieces > before) ++report.levels, report.lowest_tip_mm = mm_of_ticks(z);
  }

 private:
  [[nodiscard]] bool engaged(Cell at) const {
    return stock_.engaged(at, mm_of_ticks(z_), kLeastCut_mm);
  }
  [[nodiscard]] bool stands_free(Cell at) const {
    return stock_.clear_height(grid_.x_mm(at.col), grid_.y_mm(at.row)) <= mm_of_ticks(z_);
  }

  /// Cells `first` to `last` of a chain and, where that leads to where the cutter stands free,
  /// a few more. Taking something ends radius - half diagonal - kWithinCells from the stock,
  /// standing free begins at radius + two half diagonals + half a side: 3.3 cells more.
  [[nodiscard]] Piece extended(const Piece& chain, std::size_t first, std::size_t last) const {
    const auto more = [&](std::size_t from, std::size_t room, int step) {
      std::size_t at = from;
      for (int k = 0; k <= kClearCells && static_cast<std::size_t>(k) <= room; ++k) {
        if (stands_free(chain[at])) return at;
        at = step > 0 ? at + 1 : at - 1;
      }
      return from;
    };
    const std::size_t a = more(first, first, -1), b = more(last, chain.size() - 1 - last, 1);
    return {chain.begin() + static_cast<std::ptrdiff_t>(a),
            chain.begin() + static_cast<std::ptrdiff_t>(b) + 1};
  }

  /// The parts of a chain on which the cutter takes something; short ways between them belong to
  /// them, for lifting and coming back takes longer.
  void split(const Piece& chain, std::vector<Piece>& pieces) const {
    const auto gap = static_cast<std::size_t>(4.0 * options_.cutter.radius_mm / grid_.side_mm());
    constexpr std::size_t kNone = static_cast<std::size_t>(-1);
    std::size_t first = kNone, last = 0;
    for (std::size_t i = 0; i < chain.size(); ++i) {
      if (!engaged(chain[i])) continue;
      if (first != kNone && i - last > gap) {
        pieces.push_back(extended(chain, first, last));
        first = kNone;
      }
      if (first == kNone) first = i;
      last = i;
    }
    if (first != kNone) pieces.push_back(extended(chain, first, last));
  }

  [[nodiscard]] std::vector<Piece> rows(const LevelRegion& region) const {
    const std::ptrdiff_t count = (grid_.rows + rows_apart_ - 1) / rows_apart_;
    std::vector<std::vector<Piece>> of_row(static_cast<std::size_t>(count));
    oneapi::tbb::parallel_for(std::ptrdiff_t{0}, count, [&](std::ptrdiff_t k) {
      const auto row = static_cast<std::int32_t>(k * rows_apart_);
      auto& pieces = of_row[static_cast<std::size_t>(k)];
      Piece run;
      for (std::int32_t c = 0; c <= grid_.cols; ++c) {
        if (region.free(row, c)) {
          run.push_back({row, c});
        } else if (!run.empty()) {
          split(run, pieces);
          run.clear();
        }
      }
      for (Piece& piece : pieces)
        if (piece.size() > 2) piece = {piece.front(), piece.back()};
    });
    std::vector<Piece> all;
    for (auto& pieces : of_row)
      for (Piece& piece : pieces) all.push_back(std::move(piece));
    return all;
  }

  [[nodiscard]] std::vector<Piece> rims(const LevelRegion& region) const {
    std::vector<Piece> chains = region.rims();
    std::vector<std::vector<Piece>> of_chain(chains.size());
    oneapi::tbb::parallel_for(std::size_t{0}, chains.size(), [&](std::size_t k) {
      Piece& chain = chains[k];
      // Where there is a place to begin a closed walk with nothing to cut, begin there.
      const auto idle =
          std::find_if(chain.begin(), chain.end(), [&](Cell c) { return !engaged(c); });
      if (idle != chain.end()) std::rotate(chain.begin(), idle, chain.end());
      if (chain.size() > 1) chain.push_back(chain.front());
      split(chain, of_chain[k]);
    });
    std::vector<Piece> all;
    for (auto& pieces : of_chain)
      for (const Piece& piece : pieces) all.push_back(region.straightened(piece, kWithinCells));
    return all;
  }

  void cut(std::vector<Piece> pieces, const LevelRegion& region, Toolpath& path,
           RoughingReport& report) {
    PieceOrder order(0.0, 0.0, static_cast<double>(grid_.cols), static_cast<double>(grid_.rows),
                     4.0 * rows_apart_);
    for (const Piece& p : pieces)
      order.add(p.front().col, p.front().row, p.back().col, p.back().row);
    while (order.left() > 0) {
      const PieceOrder::End end = order.take_nearest(at_.col, at_.row);
      Piece& piece = pieces[end.piece];
      if (end.last) std::reverse(piece.begin(), piece.end());
      enter(piece, region, path, report);
      for (std::size_t i = 1; i < piece.size(); ++i) go(piece[i - 1], piece[i], path);
      if (piece.size() == 1) stock_.cut(piece[0], piece[0], mm_of_ticks(z_));
      at_ = piece.back();
      ++report.pieces;
    }
  }

  /// To the beginning of the piece, at depth. May turn the piece round.
  void enter(Piece& piece, const LevelRegion& region, Toolpath& path, RoughingReport& report) {
    const bool at_depth = !path.moves.empty() && path.moves.back().to.z == z_;
    if (at_depth && distance_in_cells(at_, piece.front()) <= 2.5 * rows_apart_ &&
        region.free(at_, piece.front())) {
      go(at_, piece.front(), path);
      return;
    }
    const bool free = stands_free(piece.front());
    if (!free && stands_free(piece.back())) std::reverse(piece.begin(), piece.end());
    const bool from_side = free || stands_free(piece.front());
    const ToolPosition begin{grid_.x(piece.front().col), grid_.y(piece.front().row), z_};
    if (path.moves.empty()) {
      path.start = {begin.x, begin.y, start_z_};
    }
    const LinkOptions link{options_.clearance_mm, 1.0, options_.plunge_feed_mm_min};
    if (from_side) {
      append_link(path, begin, surface_, link);
      ++report.side_entries;
      return;
    }
    ToolPosition above = begin;
    above.z =
        std::max(z_, tick_above(stock_.clear_height(mm_of_ticks(begin.x), mm_of_ticks(begin.y))));
    append_link(path, above, surface_, link);
    ramp(piece, above.z, path);
    ++report.ramps;
  }

  /// From `top` above the piece's beginning down to the level, to and fro along its first stretch.
  void ramp(const Piece& piece, std::int64_t top, Toolpath& path) const {
    const double angle = options_.ramp_angle_deg * std::numbers::pi / 180.0;
    const double depth = mm_of_ticks(top - z_), needed = depth / std::tan(angle);
    struct Place {
      std::int64_t x, y;
      double along;
    };
    std::vector<Place> way{{grid_.x(piece[0].col), grid_.y(piece[0].row), 0.0}};
    for (std::size_t i = 1; i < piece.size() && 2.0 * way.back().along < needed; ++i) {
      Place next{grid_.x(piece[i].col), grid_.y(piece[i].row), 0.0};
      const Place& last = way.back();
      // On a row any place is exact; else whole pieces.
      const double missing = 0.5 * needed - last.along;
      if (next.y == last.y && mm_of_ticks(std::abs(next.x - last.x)) > missing)
        next.x = last.x + (next.x > last.x ? 1 : -1) * tick_above(missing);
      next.along =
          last.along + std::hypot(mm_of_ticks(next.x - last.x), mm_of_ticks(next.y - last.y));
      way.push_back(next);
    }
    // A single cell: its own width is free.
    if (way.size() == 1)
      way.push_back({way[0].x + grid_.side / 2, way[0].y, 0.5 * grid_.side_mm()});
    const double length = way.back().along;
    const auto rounds = static_cast<int>(std::max(1.0, std::ceil(needed / (2.0 * length) - 1e-9)));
    const double fall = depth / (2.0 * rounds * length);
    const double feed =
        std::min(options_.feed_mm_min, options_.plunge_feed_mm_min / std::sin(std::atan(fall)));
    const auto go_down = [&](const Place& to, double flown) {
      PathMove move;
      move.to = {to.x, to.y,
                 std::max(z_, top - static_cast<std::int64_t>(fall * flown / kTick_mm))};
      move.feed_mm_min = feed;
      path.moves.push_back(move);
    };
    for (int k = 0; k < rounds; ++k) {
      const double flown = 2.0 * k * length;
      for (std::size_t i = 1; i < way.size(); ++i) go_down(way[i], flown + way[i].along);
      for (std::size_t i = way.size() - 1; i-- > 0;)
        go_down(way[i], flown + 2.0 * length - way[i].along);
    }
    path.moves.back().to.z = z_;
  }

  void go(Cell from, Cell to, Toolpath& path) {
    if (from == to) return;
    PathMove move;
    move.to = {grid_.x(to.col), grid_.y(to.row), z_};
    move.feed_mm_min = options_.feed_mm_min;
    path.moves.push_back(move);
    stock_.cut(from, to, mm_of_ticks(z_));
  }

 public:
  std::int64_t start_z_ = 0;

 private:
  CellGrid grid_;
  StockGrid& stock_;
  Grid<float> tips_;
  const RoughingOptions& options_;
  LinkSurface surface_;
  int rows_apart_;
  std::int64_t z_ = 0;
  Cell at_;
};

/// By how much the design stands above the stock, at its nodes.
double lacking(const ModelField& design, const CellGrid& grid, const Grid<float>& top) {
  double most = 0.0;
  for (std::ptrdiff_t r = 0; r < design.z_mm.rows(); ++r) {
    const auto row = std::llround((design.y_mm(r) - grid.y_mm(0)) / grid.side_mm());
    for (std::ptrdiff_t c = 0; c < design.z_mm.cols(); ++c) {
      const auto col = std::llround((design.x_mm(c) - grid.x_mm(0)) / grid.side_mm());
      if (!grid.contains(row, col) || std::isinf(top(row, col))) continue;
      most = std::max(most, static_cast<double>(design.z_mm(r, c) - top(row, col)));
    }
  }
  return most;
}

double volume(const Grid<float>& top, const Grid<float>& floor, double side) {
  double sum = 0.0;
  for (std::size_t i = 0; i < top.cells().size(); ++i)
    if (!std::isinf(top.cells()[i]))
      sum += static_cast<double>(top.cells()[i]) - static_cast<double>(floor.cells()[i]);
  return sum * side * side;
}

void measure(const Toolpath& path, RoughingReport& report) {
  ToolPosition at = path.start;
  for (const PathMove& m : path.moves) {
    const double length = std::hypot(mm_of_ticks(m.to.x - at.x), mm_of_ticks(m.to.y - at.y),
                                     mm_of_ticks(m.to.z - at.z));
    (m.kind == PathMove::Kind::rapid ? report.rapid_length_mm : report.cutting_length_mm) += length;
    at = m.to;
  }
}

Result<Roughing> run_levels(const ModelField& design, const CellGrid& grid, StockGrid stock,
                            const RoughingOptions& options, const RunContext& run) {
  Roughing result;
  result.report.lacking_mm = lacking(design, grid, stock.top_mm());
  if (result.report.lacking_mm > 0.0)
    run.warn(fmt::format("the design stands up to {:.3f} mm above the stock; take a higher block",
                         result.report.lacking_mm));
  Operation operation(
      grid, stock, lowest_tips(design, options.cutter, options.allowance_mm, grid, run), options);
  if (run.stopped()) return fail(kCancelled, "stopped while roughing");
  const Grid<float> before = stock.top_mm();
  double top = -INFINITY, bottom = INFINITY;
  for (std::size_t i = 0; i < before.cells().size(); ++i) {
    const float stands = before.cells()[i], tip = operation.tips().cells()[i];
    if (std::isinf(stands)) continue;
    top = std::max(top, static_cast<double>(stands));
    if (std::isfinite(tip)) bottom = std::min(bottom, static_cast<double>(tip));
  }
  if (bottom < top) {
    const double levels = std::ceil((top - bottom) / options.step_down_mm - 1e-9);
    operation.start_z_ = tick_above(top + options.clearance_mm);
    for (double k = 1.0; k <= levels; k += 1.0) {
      operation.cut_level(tick_above(bottom + (levels - k) * options.step_down_mm), result.path,
                          result.report);
      if (run.stopped()) return fail(kCancelled, "stopped while roughing");
      run.progress(k / levels);
    }
    if (!result.path.moves.empty()) {
      PathMove up;
      up.kind = PathMove::Kind::rapid;
      up.to = end_of(result.path);
      up.to.z = operation.start_z_;
      result.path.moves.push_back(up);
    }
  }
  measure(result.path, result.report);
  result.report.removed_mm3 = volume(before, stock.top_mm(), grid.side_mm());
  result.stock = stock.field();
  return result;
}

}  // namespace

Result<Roughing> rough(const ModelField& design, const StockBox& box,
                       const RoughingOptions& options, const RunContext& run) {
  MAQUETTE_TRY_VOID(check_options(options));
  MAQUETTE_TRY_VOID(check_heights(design));
  MAQUETTE_TRY(const CellGrid grid,
               cells_over(box.x0_mm, box.y0_mm, box.x1_mm, box.y1_mm, options));
  StockGrid stock(grid, options.cutter);
  stock.add(box);
  return run_levels(design, grid, std::move(stock), options, run);
}

Result<Roughing> rough(const ModelField& design, const ModelField& left,
                       const RoughingOptions& options, const RunContext& run) {
  MAQUETTE_TRY_VOID(check_options(options));
  MAQUETTE_TRY_VOID(check_heights(design));
  const double half = 0.5 * left.spacing.value();
  MAQUETTE_TRY(const CellGrid grid, cells_over(left.x0.value() - half, left.y0.value() - half,
                                               left.x_mm(left.z_mm.cols() - 1) + half,
                                               left.y_mm(left.z_mm.rows() - 1) + half, options));
  StockGrid stock(grid, options.cutter);
  stock.add(left);
  return run_levels(design, grid, std::move(stock), options, run);
}

}  // namespace maquette::cnc

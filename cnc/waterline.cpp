// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/waterline.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>
#include <vector>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include "cnc/cutter_location.hpp"
#include "cnc/level_contours.hpp"
#include "cnc/linking.hpp"
#include "cnc/pass_sampler.hpp"
#include "cnc/piece_order.hpp"
#include "cnc/steepness.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;

constexpr double kShortestChord_mm = 0.01;
constexpr double kCandidate = 0.6;  // of the slope's tangent, at the nodes, for a cell to count
constexpr std::size_t kLevelsAtATime = 16;

Result<void> check(const ModelField& design, const WaterlineOptions& o) {
  const auto range = [](const char* name, double value, double least, double most,
                        const char* unit) -> Result<void> {
    if (value >= least && value <= most) return {};
    return fail(kWaterlineOptionOutOfRange, fmt::format("{} is {} {}; it must be from {} to {}",
                                                        name, value, unit, least, most));
  };
  MAQUETTE_TRY_VOID(range("ball_radius", o.ball_radius_mm, 0.05, 100.0, "mm"));
  MAQUETTE_TRY_VOID(range("allowance", o.allowance_mm, 0.0, 50.0, "mm"));
  MAQUETTE_TRY_VOID(range("step", o.step_mm, 0.001, 1000.0, "mm"));
  MAQUETTE_TRY_VOID(range("least_slope", o.least_slope_deg, 5.0, 89.9, "degrees"));
  MAQUETTE_TRY_VOID(range("overlap", o.overlap_mm, 0.0, 1000.0, "mm"));
  MAQUETTE_TRY_VOID(range("tolerance", o.tolerance_mm, 0.0005, 1.0, "mm"));
  MAQUETTE_TRY_VOID(range("feed", o.feed_mm_min, 0.01, 1e6, "mm/min"));
  MAQUETTE_TRY_VOID(range("plunge_feed", o.plunge_feed_mm_min, 0.01, 1e6, "mm/min"));
  MAQUETTE_TRY_VOID(range("clearance", o.clearance_mm, 0.0, 1e4, "mm"));
  for (const ModelField* f : {&design, o.stock})
    for (std::ptrdiff_t r = 0; f != nullptr && r < f->z_mm.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < f->z_mm.cols(); ++c)
        if (!std::isfinite(f->z_mm(r, c)))
          return fail(kHeightNotFinite,
                      fmt::format("height is {} at row {}, column {} (x = {} mm, y = {} mm); fill "
                                  "voids before milling",
                                  f->z_mm(r, c), r, c, f->x_mm(c), f->y_mm(r)));
  return {};
}

/// Multiples of kResolution, ticks.
struct Place {
  std::int64_t x, y;
};
double distance_mm(Place a, Place b) {
  return std::hypot(mm_of_ticks(b.x - a.x), mm_of_ticks(b.y - a.y));
}
std::int64_t on_lattice(double mm) {
  return std::llround(mm / (kTick_mm * kResolution)) * kResolution;
}

struct Bounds {
  double gouge_mm = 0.0, normal_mm = 0.0;
};

/// Contours of one level of the cutter location of a ball.
class Tracer {
 public:
  Tracer(const ModelField& design, const DropCutter& cutter, const SteepnessTiles& tiles,
         double radius_mm, double level_mm, const WaterlineOptions& o)
      : design_(design), cutter_(cutter), tiles_(tiles), R_(radius_mm), level_(level_mm), o_(o) {}

  std::vector<std::vector<Place>> trace(const Grid<float>& tips, Bounds& bounds) {
    const double steep =
        kCandidate * std::tan(o_.least_slope_deg * std::numbers::pi / 180.0) * spacing();
    const auto wanted = [&](std::ptrdiff_t r, std::ptrdiff_t c) {
      const auto differ = [](float a, float b) { return std::abs(static_cast<double>(a - b)); };
      return std::hypot(std::max(differ(tips(r, c), tips(r, c + 1)),
                                 differ(tips(r + 1, c), tips(r + 1, c + 1))),
                        std::max(differ(tips(r, c), tips(r + 1, c)),
                                 differ(tips(r, c + 1), tips(r + 1, c + 1)))) >= steep;
    };
    std::vector<std::vector<Place>> pieces;
    for (const LevelContour& contour : level_contours(tips, level_, wanted))
      follow(contour, tips, pieces, bounds);
    return pieces;
  }

 private:
  struct Vertex {
    Place at;
    bool steep;
  };
  [[nodiscard]] double spacing() const { return design_.spacing.value(); }
  [[nodiscard]] CutterContact drop(Place p) {
    return cutter_.drop(mm_of_ticks(p.x), mm_of_ticks(p.y));
  }
  [[nodiscard]] bool free(Place p) { return drop(p).tip_mm <= level_; }

  /// From a free place towards one that is not, as far as it stays free.
  [[nodiscard]] Place last_free(Place from, Place to) {
    const std::int64_t steps =
        std::max(std::abs(to.x - from.x), std::abs(to.y - from.y)) / kResolution;
    const auto place = [&](std::int64_t k) {
      const double t = static_cast<double>(k) / static_cast<double>(steps);
      const auto between = [t](std::int64_t a, std::int64_t b) {
        return a + std::llround(t * static_cast<double>(b - a) / kResolution) * kResolution;
      };
      return Place{between(from.x, to.x), between(from.y, to.y)};
    };
    std::int64_t good = 0, bad = steps;
    double below = level_ - drop(from).tip_mm, above = drop(to).tip_mm - level_;
    for (int turn = 0; bad - good > 1; ++turn) {
      // By the secant; every third time the middle, for kinks.
      const double share = turn % 3 == 2 ? 0.5 : below / (below + above);
      const std::int64_t k = std::clamp<std::int64_t>(
          good + std::llround(share * static_cast<double>(bad - good)), good + 1, bad - 1);
      const double over = drop(place(k)).tip_mm - level_;
      if (over <= 0.0) {
        good = k, below = -over;
      } else {
        bad = k, above = over;
      }
    }
    return place(good);
  }

  /// Where the contour passes an edge of the grid; nothing where rounding to the lattice hides it.
  [[nodiscard]] std::optional<Place> crossing(const GridEdge& edge, const Grid<float>& tips) {
    const std::ptrdiff_t r1 = edge.row + (edge.along_x ? 0 : 1);
    const std::ptrdiff_t c1 = edge.col + (edge.along_x ? 1 : 0);
    Place a{on_lattice(design_.x_mm(edge.col)), on_lattice(design_.y_mm(edge.row))};
    Place b{on_lattice(design_.x_mm(c1)), on_lattice(design_.y_mm(r1))};
    if (static_cast<double>(tips(edge.row, edge.col)) > level_) std::swap(a, b);
    if (!free(a)) return std::nullopt;
    if (free(b)) return b;
    return last_free(a, b);
  }

  [[nodiscard]] bool is_steep(Place p) {
    const CutterContact c = drop(p);
    return std::hypot(c.dx_mm, c.dy_mm) >=
           R_ * std::sin(o_.least_slope_deg * std::numbers::pi / 180.0);
  }

  void follow(const LevelContour& contour, const Grid<float>& tips,
              std::vector<std::vector<Place>>& pieces, Bounds& bounds) {
    std::vector<Vertex> chain;
    const auto flush = [&](bool closed) {
      keep_steep(chain, closed, pieces, bounds);
      chain.clear();
    };
    bool whole = contour.closed;
    for (const GridEdge& edge : contour.edges) {
      const std::optional<Place> p = crossing(edge, tips);
      if (p) {
        chain.push_back({*p, is_steep(*p)});
      } else {
        whole = false;
        flush(false);
      }
    }
    flush(whole);
  }

  /// Parts of a chain that are steep, `overlap` longer at both ends.
  void keep_steep(std::vector<Vertex> chain, bool closed, std::vector<std::vector<Place>>& pieces,
                  Bounds& bounds) {
    if (chain.size() < 2) return;
    if (closed) {
      const auto shallow =
          std::find_if(chain.begin(), chain.end(), [](const Vertex& v) { return !v.steep; });
      if (shallow != chain.end()) std::rotate(chain.begin(), shallow, chain.end());
      chain.push_back(chain.front());
    }
    const std::size_t n = chain.size();
    std::vector<double> behind(n, INFINITY), ahead(n, INFINITY);  // way to something steep
    for (std::size_t i = 0; i < n; ++i)
      behind[i] = chain[i].steep ? 0.0
                  : i > 0        ? behind[i - 1] + distance_mm(chain[i - 1].at, chain[i].at)
                                 : INFINITY;
    for (std::size_t i = n; i-- > 0;)
      ahead[i] = chain[i].steep ? 0.0
                 : i + 1 < n    ? ahead[i + 1] + distance_mm(chain[i + 1].at, chain[i].at)
                                : INFINITY;
    std::vector<Place> piece;
    const auto end_piece = [&] {
      if (piece.size() > 1) pieces.push_back(piece);
      piece.clear();
    };
    for (std::size_t i = 0; i < n; ++i) {
      if (std::min(behind[i], ahead[i]) > o_.overlap_mm) {
        end_piece();
      } else if (piece.empty()) {
        piece.push_back(chain[i].at);
      } else if (!refine(piece.back(), chain[i].at, piece, bounds)) {
        end_piece();
        piece.push_back(chain[i].at);
      }
    }
    end_piece();
  }

  /// Least depth of a contact while the axis is on the chord.
  [[nodiscard]] double least_depth(Place a, Place b) const {
    const auto inside = [](double v, double from, double to) { return std::clamp(v, from, to); };
    const double x0 = design_.x0.value(), x1 = design_.x_mm(design_.z_mm.cols() - 1);
    const double y0 = design_.y0.value(), y1 = design_.y_mm(design_.z_mm.rows() - 1);
    return tiles_
        .bound(inside(mm_of_ticks(std::min(a.x, b.x)), x0, x1),
               inside(mm_of_ticks(std::max(a.x, b.x)), x0, x1),
               inside(mm_of_ticks(std::min(a.y, b.y)), y0, y1),
               inside(mm_of_ticks(std::max(a.y, b.y)), y0, y1), -INFINITY)
        .least_depth_mm;
  }

  /// Appends the contour from a, which is there, to b. False if it cannot be followed.
  bool refine(Place a, Place b, std::vector<Place>& piece, Bounds& bounds) {
    const double h = distance_mm(a, b);
    if (h == 0.0) return true;
    const double w = least_depth(a, b), square = w * w - 0.25 * h * h;
    const double gouge = square > 0.0 ? w - std::sqrt(square) : INFINITY;
    const bool shortest = h <= kShortestChord_mm;
    if (gouge <= o_.tolerance_mm || shortest) {
      Place middle{};
      if (shortest || !turns_away(a, b, middle)) {
        bounds.gouge_mm = std::max(bounds.gouge_mm, gouge);
        bounds.normal_mm =
            std::max(bounds.normal_mm, R_ - std::sqrt(std::max(0.0, R_ * R_ - 0.25 * h * h)));
        piece.push_back(b);
        return true;
      }
      return refine(a, middle, piece, bounds) && refine(middle, b, piece, bounds);
    }
    Place middle{};
    if (!on_contour(a, b, middle)) return false;
    return refine(a, middle, piece, bounds) && refine(middle, b, piece, bounds);
  }

  /// `away` to the left of the middle of the chord, where it is free.
  [[nodiscard]] Place beside(Place a, Place b, double away_mm) const {
    const double dx = mm_of_ticks(b.x - a.x), dy = mm_of_ticks(b.y - a.y), h = std::hypot(dx, dy);
    return {on_lattice(0.5 * mm_of_ticks(a.x + b.x) - away_mm * dy / h),
            on_lattice(0.5 * mm_of_ticks(a.y + b.y) + away_mm * dx / h)};
  }

  /// Whether the contour lies farther to the right of the chord's middle than the tolerance;
  /// then its place there.
  bool turns_away(Place a, Place b, Place& middle) {
    if (!free(beside(a, b, -o_.tolerance_mm))) return false;
    return on_contour(a, b, middle);
  }

  bool on_contour(Place a, Place b, Place& middle) {
    const double h = distance_mm(a, b);
    const Place m = beside(a, b, 0.0);
    if (free(m)) {
      // Nothing to the right within the chord's length: a wide turn, halved as it is.
      middle = m;
      for (double away = 0.002; away <= 2.0 * h; away *= 2.0) {
        const Place p = beside(a, b, -away);
        if (!free(p)) {
          middle = last_free(m, p);
          break;
        }
      }
    } else {
      bool found = false;
      for (double away = 0.002; away <= 2.0 * h && !found; away *= 2.0) {
        const Place p = beside(a, b, away);
        if (!free(p)) continue;
        middle = last_free(p, m);
        found = true;
      }
      if (!found) return false;
    }
    // Nearer to both ends than they are to each other, or halving does not end.
    return distance_mm(a, middle) < 0.95 * h && distance_mm(middle, b) < 0.95 * h;
  }

  const ModelField& design_;
  DropCutter cutter_;
  const SteepnessTiles& tiles_;
  double R_, level_;
  const WaterlineOptions& o_;
};

Grid<float> tips_at_nodes(const ModelField& design, const DropCutter& cutter,
                          const RunContext& run) {
  Grid<float> tips(design.z_mm.rows(), design.z_mm.cols());
  constexpr std::ptrdiff_t kRowsAtATime = 16;  // for which a copy of the cutter serves
  const std::ptrdiff_t tasks = (tips.rows() + kRowsAtATime - 1) / kRowsAtATime;
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, tasks, [&](std::ptrdiff_t task) {
    DropCutter here = cutter;
    const std::ptrdiff_t first = task * kRowsAtATime;
    for (std::ptrdiff_t r = first; r < std::min(tips.rows(), first + kRowsAtATime); ++r) {
      if (run.stopped()) return;
      for (std::ptrdiff_t c = 0; c < tips.cols(); ++c)
        tips(r, c) = static_cast<float>(here.drop(design.x_mm(c), design.y_mm(r)).tip_mm);
    }
  });
  return tips;
}

/// Rapids over the design with the allowance, or over the stock.
LinkSurface flying(const ModelField& design, const WaterlineOptions& o) {
  if (o.stock != nullptr)
    return stock_clearance(*o.stock, design, Cutter::ball(o.ball_radius_mm)).for_thread();
  LinkSurface over =
      CutterClearance(design, Cutter::ball(o.ball_radius_mm + o.allowance_mm)).for_thread();
  return {over.step_mm,
          [over, a = o.allowance_mm](double x, double y) { return over.tip_mm(x, y) + a; }};
}

class Emitter {
 public:
  Emitter(const ModelField& design, const WaterlineOptions& o)
      : design_(design), o_(o), surface_(flying(design, o)) {}

  [[nodiscard]] Toolpath level(std::vector<std::vector<Place>> pieces, std::int64_t z,
                               std::int64_t top, WaterlineReport& report) {
    PieceOrder order(design_.x0.value(), design_.y0.value(), design_.x_mm(design_.z_mm.cols() - 1),
                     design_.y_mm(design_.z_mm.rows() - 1), 10.0);
    for (const auto& p : pieces) {
      // Only from the first vertex: the surface stays to the right.
      const double x = mm_of_ticks(p.front().x), y = mm_of_ticks(p.front().y);
      order.add(x, y, x, y);
    }
    Toolpath path;
    path.start = at_;
    while (order.left() > 0) {
      const bool first = at_.x == ToolPosition::kUnknown;
      const auto next = order.take_nearest(first ? design_.x0.value() : mm_of_ticks(at_.x),
                                           first ? design_.y0.value() : mm_of_ticks(at_.y));
      const auto& piece = pieces[next.piece];
      if (first) path.start = {piece.front().x, piece.front().y, top};
      append_link(path, {piece.front().x, piece.front().y, z}, surface_,
                  {o_.clearance_mm, 1.0, o_.plunge_feed_mm_min});
      for (std::size_t i = 1; i < piece.size(); ++i) {
        PathMove move;
        move.to = {piece[i].x, piece[i].y, z};
        move.feed_mm_min = o_.feed_mm_min;
        path.moves.push_back(move);
        report.cutting_length_mm += distance_mm(piece[i - 1], piece[i]);
      }
      report.points += piece.size();
      ++report.contours;
      at_ = end_of(path);
    }
    ++report.levels;
    return path;
  }
  [[nodiscard]] Toolpath retreat(std::int64_t top) const {
    Toolpath path;
    path.start = at_;
    PathMove up;
    up.kind = PathMove::Kind::rapid;
    up.to = {at_.x, at_.y, std::max(top, at_.z)};
    path.moves.push_back(up);
    return path;
  }
  [[nodiscard]] bool began() const { return at_.x != ToolPosition::kUnknown; }

 private:
  const ModelField& design_;
  const WaterlineOptions& o_;
  LinkSurface surface_;
  ToolPosition at_;
};

}  // namespace

Result<WaterlineReport> waterline(const ModelField& design, const WaterlineOptions& options,
                                  const ToolpathSink& sink, const RunContext& run) {
  MAQUETTE_TRY_VOID(check(design, options));
  // The larger ball, raised: keeps the allowance in space (cutter_shape.hpp).
  const double a = options.allowance_mm, R = options.ball_radius_mm + a;
  const DropCutter cutter(design, Cutter::ball(R));
  const SteepnessTiles tiles(design, BallNose{R});
  const Grid<float> tips = tips_at_nodes(design, cutter, run);
  if (run.stopped()) return fail(kCancelled, "stopped while looking for steep parts");
  const auto [lowest, highest] = std::minmax_element(tips.cells().begin(), tips.cells().end());
  double over = static_cast<double>(*highest) + a;
  if (options.stock != nullptr)
    for (const float z : options.stock->z_mm.cells()) over = std::max(over, static_cast<double>(z));
  const std::int64_t top = on_lattice(over + options.clearance_mm) + kResolution;

  std::vector<std::int64_t> levels;  // ticks, of the programmed tip
  const double span = static_cast<double>(*highest) - static_cast<double>(*lowest);
  for (double k = std::ceil(span / options.step_mm) - 1.0; k > 0.0; k -= 1.0)
    levels.push_back(on_lattice(static_cast<double>(*lowest) + a + k * options.step_mm));
  WaterlineReport report;
  Bounds worst;
  Emitter emitter(design, options);
  for (std::size_t first = 0; first < levels.size(); first += kLevelsAtATime) {
    const std::size_t count = std::min(kLevelsAtATime, levels.size() - first);
    std::vector<std::vector<std::vector<Place>>> traced(count);
    std::vector<Bounds> bounds(count);
    oneapi::tbb::parallel_for(std::size_t{0}, count, [&](std::size_t i) {
      if (run.stopped()) return;
      traced[i] = Tracer(design, cutter, tiles, R, mm_of_ticks(levels[first + i]) - a, options)
                      .trace(tips, bounds[i]);
    });
    if (run.stopped()) return fail(kCancelled, "stopped while following contours");
    for (std::size_t i = 0; i < count; ++i) {
      worst.gouge_mm = std::max(worst.gouge_mm, bounds[i].gouge_mm);
      worst.normal_mm = std::max(worst.normal_mm, bounds[i].normal_mm);
      if (traced[i].empty()) continue;
      MAQUETTE_TRY_VOID(sink(emitter.level(std::move(traced[i]), levels[first + i], top, report)));
    }
    run.progress(static_cast<double>(first + count) / static_cast<double>(levels.size()));
  }
  if (emitter.began()) MAQUETTE_TRY_VOID(sink(emitter.retreat(top)));
  report.certified_gouge_mm = worst.gouge_mm;
  report.certified_normal_gouge_mm = worst.normal_mm;
  return report;
}

}  // namespace maquette::cnc

// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/cover_gaps.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <iterator>
#include <numbers>
#include <utility>

#include <oneapi/tbb/parallel_for.h>

#include "cnc/aimed_line.hpp"
#include "core/vec.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;

constexpr double kTile_mm = 16.0;
constexpr std::ptrdiff_t kBlocks = 8;  // of a tile, along each side, in the map of ridges
constexpr int kDirections = 16;
constexpr double kFarthestSeen = 2.0;  // of the distance allowed; all that is farther is alike

struct Piece {
  std::uint32_t curve, place;
};

Vec3 on_surface(const ModelField& tips, double x, double y) {
  // A path may run a rounding outside the outline.
  const double cx = std::clamp(x, tips.x0.value(), tips.x_mm(tips.z_mm.cols() - 1));
  const double cy = std::clamp(y, tips.y0.value(), tips.y_mm(tips.z_mm.rows() - 1));
  return {x, y, heightmap::height_at(tips, cx, cy)};
}

/// Samples of one tile and a margin around it.
class Tile {
 public:
  Tile(const ModelField& tips, BallNose tool, const GapLimits& limits, double x0, double y0)
      : tips_(tips),
        tool_(tool),
        limits_(limits),
        cap_(1.05 * limits.distance_mm),
        margin_(static_cast<std::ptrdiff_t>(std::ceil(cap_ / limits.sampling_mm))),
        x0_(x0),
        y0_(y0),
        box_(box_within(tips)) {
    const double right = std::min(x0 + kTile_mm, tips.x_mm(tips.z_mm.cols() - 1));
    const double top = std::min(y0 + kTile_mm, tips.y_mm(tips.z_mm.rows() - 1));
    const auto count = [&](double length) {
      return static_cast<std::ptrdiff_t>(std::floor(length / limits.sampling_mm + 1e-9)) + 1;
    };
    cols_ = count(right - x0);
    rows_ = count(top - y0);
    z_ = Grid<float>(rows_ + 2 * margin_, cols_ + 2 * margin_);
    distance2_ = Grid<float>(z_.rows(), z_.cols(), static_cast<float>(cap_ * cap_));
    for (std::ptrdiff_t r = 0; r < z_.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < z_.cols(); ++c)
        z_(r, c) = static_cast<float>(on_surface(tips, x(c), y(r)).z);
    first_row_ = node_row(0);
    first_col_ = node_col(0);
    hollow_ = Grid<float>(node_row(z_.rows() - 1) - first_row_ + 1,
                          node_col(z_.cols() - 1) - first_col_ + 1);
    for (std::ptrdiff_t r = 0; r < hollow_.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < hollow_.cols(); ++c)
        hollow_(r, c) =
            static_cast<float>(hollow_factor(tips, first_row_ + r, first_col_ + c, tool.radius_mm));
  }

  [[nodiscard]] double x(std::ptrdiff_t c) const {
    return x0_ + limits_.sampling_mm * static_cast<double>(c - margin_);
  }
  [[nodiscard]] double y(std::ptrdiff_t r) const {
    return y0_ + limits_.sampling_mm * static_cast<double>(r - margin_);
  }

  /// A straight piece of path in plan, followed over the surface.
  void add(double ax, double ay, double bx, double by) {
    const double longest = tips_.spacing.value();
    const auto pieces =
        std::max(1, static_cast<int>(std::ceil(std::hypot(bx - ax, by - ay) / longest)));
    Vec3 from = on_surface(tips_, ax, ay);
    for (int k = 1; k <= pieces; ++k) {
      const double t = static_cast<double>(k) / pieces;
      const Vec3 to = on_surface(tips_, ax + t * (bx - ax), ay + t * (by - ay));
      add(from, to);
      from = to;
    }
  }

  /// Cuts until nothing in the tile itself is too far away.
  void cover(std::vector<PlanCurve>& strokes, std::span<const PlanCurve> path,
             const std::vector<Piece>& pieces) {
    std::vector<std::array<std::ptrdiff_t, 2>> open;
    for (std::ptrdiff_t r = margin_; r < margin_ + rows_; ++r)
      for (std::ptrdiff_t c = margin_; c < margin_ + cols_; ++c)
        if (too_far(r, c)) open.push_back({r, c});
    if (open.empty()) return;
    // How far it is from what is too far matters now; the rest is done with.
    cap_ = kFarthestSeen * limits_.distance_mm;
    for (const auto& [r, c] : open) distance2_(r, c) = static_cast<float>(cap_ * cap_);
    for (const Piece& p : pieces) {
      const PlanCurve& curve = path[p.curve];
      const PlanPlace a = curve.places[p.place], b = curve.places[p.place + 1];
      add(1e-3 * a.x, 1e-3 * a.y, 1e-3 * b.x, 1e-3 * b.y);
    }
    while (!open.empty()) {
      std::array<std::ptrdiff_t, 2> farthest = open.front();
      for (const auto& [r, c] : open)
        if (distance2_(r, c) > distance2_(farthest[0], farthest[1])) farthest = {r, c};
      PlanCurve stroke = stroke_through(farthest);
      const PlanPlace a = stroke.places.front(), b = stroke.places.back();
      add(1e-3 * a.x, 1e-3 * a.y, 1e-3 * b.x, 1e-3 * b.y);
      distance2_(farthest[0], farthest[1]) = 0.0F;  // whatever the rounding
      std::erase_if(open, [&](const auto& p) { return !too_far(p[0], p[1]); });
      strokes.push_back(std::move(stroke));
    }
  }

  struct Block {
    double highest = 0.0, sum = 0.0;
    std::uint32_t samples = 0, above = 0;
  };
  /// Ridges of the tile itself.
  [[nodiscard]] std::array<Block, kBlocks * kBlocks> blocks() const {
    std::array<Block, kBlocks * kBlocks> found{};
    const double half = 0.5 * limits_.sampling_mm;
    const auto share = [](double offset) {
      return std::min(kBlocks - 1, static_cast<std::ptrdiff_t>(offset / kTile_mm * kBlocks));
    };
    std::vector<std::ptrdiff_t> node(static_cast<std::size_t>(cols_)), block(node.size());
    for (std::ptrdiff_t c = 0; c < cols_; ++c) {
      node[static_cast<std::size_t>(c)] = node_col(c + margin_) - first_col_;
      block[static_cast<std::size_t>(c)] = share(x(c + margin_) - x0_);
    }
    for (std::ptrdiff_t r = 0; r < rows_; ++r) {
      const std::ptrdiff_t row = r + margin_;
      const std::span<const float> hollow = hollow_.row(node_row(row) - first_row_);
      const std::ptrdiff_t blocks = share(y(row) - y0_) * kBlocks;
      for (std::ptrdiff_t c = 0; c < cols_; ++c) {
        const auto at = static_cast<std::size_t>(c);
        const double v = distance(row, c + margin_) + half;
        const double ridge = std::min(
            tool_.radius_mm, ridge_mm(tool_, 2.0 * v) *
                                 static_cast<double>(hollow[static_cast<std::size_t>(node[at])]));
        Block& b = found[static_cast<std::size_t>(blocks + block[at])];
        b.highest = std::max(b.highest, ridge);
        b.sum += ridge;
        ++b.samples;
        b.above += ridge > limits_.ridge_mm * (1.0 + 1e-9);
      }
    }
    return found;
  }

 private:
  [[nodiscard]] double distance(std::ptrdiff_t r, std::ptrdiff_t c) const {
    return std::sqrt(static_cast<double>(distance2_(r, c)));
  }
  /// Node of the tips nearest to a sample.
  [[nodiscard]] std::ptrdiff_t node_row(std::ptrdiff_t r) const {
    return nearest_node(y(r) - tips_.y0.value(), tips_.z_mm.rows());
  }
  [[nodiscard]] std::ptrdiff_t node_col(std::ptrdiff_t c) const {
    return nearest_node(x(c) - tips_.x0.value(), tips_.z_mm.cols());
  }
  [[nodiscard]] std::ptrdiff_t nearest_node(double mm, std::ptrdiff_t count) const {
    return std::clamp<std::ptrdiff_t>(
        static_cast<std::ptrdiff_t>(std::lround(mm / tips_.spacing.value())), 0, count - 1);
  }
  [[nodiscard]] double hollow(std::ptrdiff_t r, std::ptrdiff_t c) const {
    return static_cast<double>(hollow_(node_row(r) - first_row_, node_col(c) - first_col_));
  }
  [[nodiscard]] bool too_far(std::ptrdiff_t r, std::ptrdiff_t c) const {
    const double half = 0.5 * limits_.sampling_mm;
    const double v = distance(r, c) + half;
    const double allowed = limits_.distance_mm + half;
    if (v > allowed) return true;
    if (!limits_.hollows_count || v * v * limits_.most_hollow <= allowed * allowed) return false;
    return v * v * std::min(limits_.most_hollow, hollow(r, c)) > allowed * allowed;
  }

  /// Single precision, relative to the piece's start: within 1e-6 mm.
  void add(Vec3 a, Vec3 b) {
    const double per = 1.0 / limits_.sampling_mm;
    const auto first = [&](double low, double origin) {
      return std::max<std::ptrdiff_t>(
          0, static_cast<std::ptrdiff_t>(std::ceil((low - cap_ - origin) * per)) + margin_);
    };
    const auto last = [&](double high, double origin, std::ptrdiff_t count) {
      return std::min(
          count - 1,
          static_cast<std::ptrdiff_t>(std::floor((high + cap_ - origin) * per)) + margin_);
    };
    const std::ptrdiff_t r1 = last(std::max(a.y, b.y), y0_, z_.rows());
    const std::ptrdiff_t c0 = first(std::min(a.x, b.x), x0_);
    const std::ptrdiff_t count = last(std::max(a.x, b.x), x0_, z_.cols()) - c0 + 1;
    if (count <= 0) return;
    const Vec3 u = b - a;
    const double length2 = dot(u, u);
    const double per_length2 = length2 > 0.0 ? 1.0 / length2 : 0.0;
    const auto ux = static_cast<float>(u.x), uy = static_cast<float>(u.y),
               uz = static_cast<float>(u.z), scale = static_cast<float>(per_length2),
               start = static_cast<float>(x(c0) - a.x), up = static_cast<float>(a.z),
               step = static_cast<float>(limits_.sampling_mm);
    for (std::ptrdiff_t r = first(std::min(a.y, b.y), y0_); r <= r1; ++r) {
      const auto dy = static_cast<float>(y(r) - a.y);
      const float* __restrict z = z_.row(r).data() + c0;
      float* __restrict nearest = distance2_.row(r).data() + c0;
      for (std::ptrdiff_t c = 0; c < count; ++c) {
        const float dx = start + step * static_cast<float>(static_cast<std::int32_t>(c));
        const float dz = z[c] - up;
        float t = (ux * dx + uy * dy + uz * dz) * scale;
        t = t < 0.0F ? 0.0F : t;
        t = t > 1.0F ? 1.0F : t;
        const float ox = dx - t * ux, oy = dy - t * uy, oz = dz - t * uz;
        const float d2 = ox * ox + oy * oy + oz * oz;
        nearest[c] = d2 < nearest[c] ? d2 : nearest[c];
      }
    }
  }

  [[nodiscard]] PlanCurve stroke_through(std::array<std::ptrdiff_t, 2> middle) const {
    const double mx = x(middle[1]), my = y(middle[0]);
    const auto open_for = [&](double ux, double uy) {
      const double step = limits_.sampling_mm;
      double length = 0.0;
      for (double t = step;; t += step) {
        const auto r =
            static_cast<std::ptrdiff_t>(std::lround((my + t * uy - y0_) / step)) + margin_;
        const auto c =
            static_cast<std::ptrdiff_t>(std::lround((mx + t * ux - x0_) / step)) + margin_;
        if (r < margin_ || c < margin_ || r >= margin_ + rows_ || c >= margin_ + cols_ ||
            !too_far(r, c))
          return length;
        length = t;
      }
    };
    double ux = 1.0, uy = 0.0, forwards = 0.0, back = 0.0;
    for (int k = 0; k < kDirections; ++k) {
      const double angle = std::numbers::pi * k / kDirections;
      const double vx = std::cos(angle), vy = std::sin(angle);
      const double f = open_for(vx, vy), b = open_for(-vx, -vy);
      if (f + b > forwards + back + 1e-9) {
        ux = vx;
        uy = vy;
        forwards = f;
        back = b;
      }
    }
    forwards += limits_.sampling_mm;
    back += limits_.sampling_mm;
    const auto place = [&](double t) {
      return PlanPlace{static_cast<std::int32_t>(std::lround(1e3 * (mx + t * ux))),
                       static_cast<std::int32_t>(std::lround(1e3 * (my + t * uy)))};
    };
    const AimedLine line = aim(place(-back), place(forwards), box_);
    return {{place(-back), line.end()}, 1};
  }

  const ModelField& tips_;
  BallNose tool_;
  GapLimits limits_;
  double cap_;
  std::ptrdiff_t margin_;
  double x0_, y0_;
  PlanBox box_;
  std::ptrdiff_t rows_ = 0, cols_ = 0;
  Grid<float> z_, distance2_;  // squares
  std::ptrdiff_t first_row_ = 0, first_col_ = 0;
  Grid<float> hollow_;  // at nodes of the tips
};

}  // namespace

double hollow_factor(const ModelField& tips, std::ptrdiff_t row, std::ptrdiff_t col,
                     double radius_mm) {
  const Grid<float>& z = tips.z_mm;
  const double d = tips.spacing.value(), here = static_cast<double>(z(row, col));
  const auto at = [&](std::ptrdiff_t r, std::ptrdiff_t c) { return static_cast<double>(z(r, c)); };
  const bool has_x = col > 0 && col + 1 < z.cols(), has_y = row > 0 && row + 1 < z.rows();
  const double gx = has_x ? (at(row, col + 1) - at(row, col - 1)) / (2.0 * d) : 0.0;
  const double gy = has_y ? (at(row + 1, col) - at(row - 1, col)) / (2.0 * d) : 0.0;
  const double up = 1.0 / std::sqrt(1.0 + gx * gx + gy * gy);
  double most = 0.0;
  const auto along = [&](double before, double after, double run) {
    const double slope = (after - before) / (2.0 * run);
    const double bend = (before + after - 2.0 * here) / (run * run);
    most = std::max(most, bend * up / (1.0 + slope * slope));
  };
  if (has_x) along(at(row, col - 1), at(row, col + 1), d);
  if (has_y) along(at(row - 1, col), at(row + 1, col), d);
  if (has_x && has_y) {
    along(at(row - 1, col - 1), at(row + 1, col + 1), d * std::numbers::sqrt2);
    along(at(row - 1, col + 1), at(row + 1, col - 1), d * std::numbers::sqrt2);
  }
  return 1.0 + radius_mm * most;
}

GapReport cover_gaps(const ModelField& tips, BallNose tool, std::span<const PlanCurve> path,
                     const GapLimits& limits, const RunContext& run) {
  const double x0 = tips.x0.value(), y0 = tips.y0.value();
  const auto tiles = [](double length) {
    return std::max<std::ptrdiff_t>(
        1, static_cast<std::ptrdiff_t>(std::ceil(length / kTile_mm - 1e-9)));
  };
  const std::ptrdiff_t cols = tiles(tips.x_mm(tips.z_mm.cols() - 1) - x0);
  const std::ptrdiff_t rows = tiles(tips.y_mm(tips.z_mm.rows() - 1) - y0);
  std::vector<std::vector<Piece>> pieces(static_cast<std::size_t>(rows * cols));
  const double reach = kFarthestSeen * limits.distance_mm + 2.0 * limits.sampling_mm;
  for (std::uint32_t k = 0; k < path.size(); ++k) {
    const std::vector<PlanPlace>& places = path[k].places;
    for (std::uint32_t i = 0; i + 1 < places.size(); ++i) {
      const auto range = [&](std::int32_t a, std::int32_t b, double origin, std::ptrdiff_t count) {
        const auto tile = [&](double mm) {
          return std::clamp<std::ptrdiff_t>(
              static_cast<std::ptrdiff_t>(std::floor((mm - origin) / kTile_mm)), 0, count - 1);
        };
        return std::pair{tile(1e-3 * std::min(a, b) - reach), tile(1e-3 * std::max(a, b) + reach)};
      };
      const auto [c0, c1] = range(places[i].x, places[i + 1].x, x0, cols);
      const auto [r0, r1] = range(places[i].y, places[i + 1].y, y0, rows);
      for (std::ptrdiff_t r = r0; r <= r1; ++r)
        for (std::ptrdiff_t c = c0; c <= c1; ++c)
          pieces[static_cast<std::size_t>(r * cols + c)].push_back({k, i});
    }
  }

  struct Done {
    std::vector<PlanCurve> strokes;
    std::array<Tile::Block, kBlocks * kBlocks> blocks{};
  };
  std::vector<Done> done(pieces.size());
  oneapi::tbb::parallel_for(std::size_t{0}, pieces.size(), [&](std::size_t t) {
    if (run.stopped()) return;
    const auto r = static_cast<std::ptrdiff_t>(t) / cols, c = static_cast<std::ptrdiff_t>(t) % cols;
    Tile tile(tips, tool, limits, x0 + kTile_mm * static_cast<double>(c),
              y0 + kTile_mm * static_cast<double>(r));
    for (const Piece& p : pieces[t]) {
      const PlanPlace a = path[p.curve].places[p.place], b = path[p.curve].places[p.place + 1];
      tile.add(1e-3 * a.x, 1e-3 * a.y, 1e-3 * b.x, 1e-3 * b.y);
    }
    tile.cover(done[t].strokes, path, pieces[t]);
    done[t].blocks = tile.blocks();
  });

  GapReport report;
  ModelField& map = report.scallop.predicted_mm;
  map.spacing = Millimetres{kTile_mm / kBlocks};
  map.x0 = Millimetres{x0 + 0.5 * map.spacing.value()};
  map.y0 = Millimetres{y0 + 0.5 * map.spacing.value()};
  map.z_mm = Grid<float>(rows * kBlocks, cols * kBlocks, NAN);
  double sum = 0.0;
  std::uint64_t samples = 0, above = 0;
  for (std::size_t t = 0; t < done.size(); ++t) {
    std::move(done[t].strokes.begin(), done[t].strokes.end(), std::back_inserter(report.strokes));
    for (std::size_t i = 0; i < done[t].blocks.size(); ++i) {
      const Tile::Block& b = done[t].blocks[i];
      if (b.samples == 0) continue;
      const auto tile = static_cast<std::ptrdiff_t>(t), block = static_cast<std::ptrdiff_t>(i);
      map.z_mm(tile / cols * kBlocks + block / kBlocks, tile % cols * kBlocks + block % kBlocks) =
          static_cast<float>(b.highest);
      report.scallop.highest_mm = std::max(report.scallop.highest_mm, b.highest);
      sum += b.sum;
      samples += b.samples;
      above += b.above;
    }
  }
  if (samples > 0) {
    report.scallop.mean_mm = sum / static_cast<double>(samples);
    report.scallop.share_above_limit = static_cast<double>(above) / static_cast<double>(samples);
  }
  return report;
}

}  // namespace maquette::cnc

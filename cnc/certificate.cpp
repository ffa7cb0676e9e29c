// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/certificate.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include <tbb/parallel_for.h>

#include "cnc/scallop.hpp"

namespace maquette::cnc {
namespace {

constexpr std::size_t kWorstPlaces = 10;
constexpr std::array<double, 6> kClassEdges_deg{0.0, 15.0, 30.0, 45.0, 60.0, 90.0};
constexpr std::size_t kClasses = kClassEdges_deg.size() - 1;
// Histogram of heights over the design: what lies beyond counts in the last bin.
constexpr double kBin_mm = 0.0002, kFirstBin_mm = -0.04;
constexpr std::size_t kBins = 1200;
// Of the nodes sampled that stand above the scallop, the share that is compared with the closing.
constexpr std::ptrdiff_t kClosingEvery = 4;

std::size_t class_of(double slope) {
  const double deg = std::atan(slope) * 180.0 / std::numbers::pi;
  std::size_t k = 0;
  while (k + 1 < kClasses && deg >= kClassEdges_deg[k + 1]) ++k;
  return k;
}

/// How much higher than at a node the as-milled surface may be between the nodes: a ball that
/// stands `excess` over a facet at a node and cuts it by at most `gouge` is so steep there.
double excess_between_nodes(double excess, double slope, double gouge, double cell, double radius) {
  const double steep = std::sqrt(1.0 + slope * slope);
  const double over = std::fmin(radius, std::fmax(0.0, excess) / steep + gouge);
  const double from = std::sqrt(over * (2.0 * radius - over));
  const double to = from + cell / std::numbers::sqrt2 * steep;
  if (!(to < radius)) return INFINITY;
  return (std::sqrt(radius * radius - from * from) - std::sqrt(radius * radius - to * to)) * steep;
}

double quantile(const std::uint64_t* bins, double share) {
  std::uint64_t all = 0;
  for (std::size_t i = 0; i < kBins; ++i) all += bins[i];
  const auto wanted = static_cast<std::uint64_t>(std::ceil(share * static_cast<double>(all)));
  std::uint64_t sum = 0;
  for (std::size_t i = 0; i < kBins; ++i) {
    sum += bins[i];
    if (sum >= wanted && sum > 0) return kFirstBin_mm + kBin_mm * (static_cast<double>(i) + 0.5);
  }
  return 0.0;
}

/// Where the cutter is at most as steep as `slope`, and no farther than a cell's diagonal from
/// there: how far from the start of the corner's circle; infinite beyond the rim.
double corner_reach(double slope, double cell, const Cutter& cutter) {
  const double e =
      cutter.corner_radius_mm * slope / std::sqrt(1.0 + slope * slope) + std::numbers::sqrt2 * cell;
  return e < cutter.corner_radius_mm ? e : INFINITY;
}

/// What the curvature of the corner's circle hides from a cell, up to `e` from the circle's axis.
double bend_mm(double e, double cell, const Cutter& cutter) {
  if (e <= 0.0 && cutter.corner_radius_mm < cutter.radius_mm) return 0.0;
  const double r = cutter.corner_radius_mm, h2 = r * r - e * e;
  return h2 > 0.0 ? 0.25 * cell * cell * r * r / (h2 * std::sqrt(h2)) : INFINITY;
}

/// Corners of cells around a place that is right below the cutter's axis, give or take half a
/// cell's diagonal: how far from the start of the corner's circle.
double reach_at_axis(double cell, const Cutter& cutter) {
  const double flat = cutter.radius_mm - cutter.corner_radius_mm;
  return std::fmax(0.0, 1.5 * std::numbers::sqrt2 * cell - flat);
}

/// Of the corner's circle at `e` from its axis: length of the normal that rises by one.
double normal_length(double e, const Cutter& cutter) {
  const double r = cutter.corner_radius_mm;
  return e <= 0.0 ? 1.0 : e < r ? r / std::sqrt(r * r - e * e) : INFINITY;
}

}  // namespace

double gouge_between_nodes_mm(double slope, double cell_mm, const Cutter& cutter) {
  return bend_mm(corner_reach(slope, cell_mm, cutter), cell_mm, cutter);
}

struct Comparison::Strip {
  double sum = 0.0, sum_of_squares = 0.0;
  double max_gouge = 0.0, max_excess = 0.0, proven = 0.0;
  std::uint64_t gouged = 0;
  double max_over_scallop = -INFINITY;  // where there is room
  std::uint64_t tight = 0, unreached = 0;
  double max_over_closing = -INFINITY;
  std::uint64_t over_closing = 0;
  std::vector<Gouge> gouges;                       // the deepest of each block
  std::vector<std::uint64_t> bins;                 // kClasses x kBins
  std::array<std::vector<float>, kReaches> reach;  // per block
};

Comparison::Comparison(const heightmap::ModelField& design, ComparisonOptions options)
    : design_(design),
      options_(std::move(options)),
      divided_(design, options_.per_spacing),
      quads_(std::max<std::ptrdiff_t>(1, 64 / options_.per_spacing)),
      block_nodes_(quads_ * options_.per_spacing),
      block_rows_((design.z_mm.rows() - 2 + quads_) / quads_),
      block_cols_((design.z_mm.cols() - 2 + quads_) / quads_),
      border_nodes_(static_cast<std::ptrdiff_t>(std::ceil(options_.border_mm / options_.cell_mm))),
      // Not a divisor, so that all places within a cell of the design have their turn.
      sampling_(options_.per_spacing % 3 != 0   ? 3
                : options_.per_spacing % 5 != 0 ? 5
                                                : 7),
      strips_(static_cast<std::size_t>(block_rows_) + 1),
      reach_(design, options_.per_spacing, options_.reach_radius_mm) {
  strips_.back().bins.assign(kClasses * kBins, 0);  // the sum of all
  best_[over_scallop] = -INFINITY;
}
Comparison::~Comparison() = default;

double Comparison::slope_of(std::ptrdiff_t qr, std::ptrdiff_t qc) const {
  const Grid<float>& z = design_.z_mm;
  const double z00 = z(qr, qc), z10 = z(qr, qc + 1), z01 = z(qr + 1, qc), z11 = z(qr + 1, qc + 1);
  const double a = (z10 - z00) * (z10 - z00) + (z11 - z10) * (z11 - z10);
  const double b = (z11 - z01) * (z11 - z01) + (z01 - z00) * (z01 - z00);
  return std::sqrt(std::fmax(a, b)) / design_.spacing.value();
}

/// The steepest facet of the design's cells that hold the node.
double Comparison::slope_at_node(std::ptrdiff_t row, std::ptrdiff_t col) const {
  const std::ptrdiff_t k = options_.per_spacing;
  const std::ptrdiff_t last_r = design_.z_mm.rows() - 2, last_c = design_.z_mm.cols() - 2;
  double slope = 0.0;
  for (std::ptrdiff_t r = std::max<std::ptrdiff_t>(0, (row + k - 1) / k - 1);
       r <= std::min(last_r, row / k); ++r)
    for (std::ptrdiff_t c = std::max<std::ptrdiff_t>(0, (col + k - 1) / k - 1);
         c <= std::min(last_c, col / k); ++c)
      slope = std::fmax(slope, slope_of(r, c));
  return slope;
}

bool Comparison::is_border(std::ptrdiff_t row, std::ptrdiff_t col) const {
  return row < border_nodes_ || col < border_nodes_ || row >= divided_.rows() - border_nodes_ ||
         col >= divided_.cols() - border_nodes_;
}

double Comparison::value(Reach kind, std::ptrdiff_t row, std::ptrdiff_t col, double excess,
                         double slope) const {
  const bool at_border = is_border(row, col);
  const double R = options_.reach_radius_mm;
  switch (kind) {
    case inside:
      return at_border ? -INFINITY : excess;
    case border:
      return at_border ? excess : -INFINITY;
    case with_bound:
      if (at_border) return -INFINITY;
      return excess +
             excess_between_nodes(excess, slope, options_.deepest_gouge_mm, options_.cell_mm, R);
    default:
      return at_border ? -INFINITY : excess - stated_scallop_mm({R}, options_.stepover_mm, slope);
  }
}

double Comparison::proven_quad(const MilledBand& band, std::ptrdiff_t qr, std::ptrdiff_t qc,
                               double slope, double quad_gouge, const Cutter& cutter) const {
  const double cell = options_.cell_mm, between = gouge_between_nodes_mm(slope, cell, cutter);
  const CutterError& error = options_.error;
  double by_curvature = INFINITY;
  if (std::isfinite(between)) {
    // At the nodes around, the cutter may be steeper than the facet: its slope there.
    const double steepest = normal_length(corner_reach(slope, cell, cutter), cutter);
    by_curvature = quad_gouge + between + error.vertical_mm + steepest * error.sideways_mm;
  }
  // Curvature says little where the cutter is nearly vertical.
  const double e = reach_at_axis(cell, cutter), at_axis = bend_mm(e, cell, cutter);
  if (between <= std::fmax(at_axis, std::numbers::sqrt2 * cell * slope)) return by_curvature;
  // Off the axis, a node within a cell's diagonal is gouged too, less by the rise to it.
  const std::ptrdiff_t k = options_.per_spacing, rings = k >= 2 ? 1 : 2;
  double around = 0.0, gouge = -INFINITY;
  for (std::ptrdiff_t r = std::max<std::ptrdiff_t>(0, qr - rings);
       r <= std::min(design_.z_mm.rows() - 2, qr + rings); ++r)
    for (std::ptrdiff_t c = std::max<std::ptrdiff_t>(0, qc - rings);
         c <= std::min(design_.z_mm.cols() - 2, qc + rings); ++c)
      around = std::fmax(around, slope_of(r, c));
  for (std::ptrdiff_t row = std::max<std::ptrdiff_t>(0, qr * k - kMargin);
       row <= std::min(divided_.rows() - 1, (qr + 1) * k + kMargin); ++row)
    for (std::ptrdiff_t col = std::max<std::ptrdiff_t>(0, qc * k - kMargin);
         col <= std::min(divided_.cols() - 1, (qc + 1) * k + kMargin); ++col)
      gouge = std::fmax(gouge, divided_.at(row, col) - band.at(row, col));
  const double off_axis = gouge + around * (std::numbers::sqrt2 * cell + error.sideways_mm) +
                          error.vertical_mm + error.sideways_mm;
  const double on_axis =
      quad_gouge + at_axis + error.vertical_mm + normal_length(e, cutter) * error.sideways_mm;
  return std::fmin(by_curvature, std::fmax(off_axis, on_axis));
}

void Comparison::add_quad(const MilledBand& band, std::ptrdiff_t qr, std::ptrdiff_t qc,
                          Strip& strip, Gouge& deepest, std::array<float, kReaches>& reach) const {
  const std::ptrdiff_t k = options_.per_spacing;
  const bool last_row = qr + 2 == design_.z_mm.rows(), last_col = qc + 2 == design_.z_mm.cols();
  const double slope = slope_of(qr, qc), cosine = 1.0 / std::sqrt(1.0 + slope * slope);
  const bool counts = !is_border(qr * k, qc * k) && !is_border((qr + 1) * k, (qc + 1) * k);
  std::uint64_t* bins = strip.bins.data() + class_of(slope) * kBins;
  double quad_gouge = -INFINITY, excess = -INFINITY, excess_inside = -INFINITY,
         excess_border = -INFINITY;  // gouge of the closed design cell, excess of its own nodes
  for (std::ptrdiff_t i = 0; i <= k; ++i)
    for (std::ptrdiff_t j = 0; j <= k; ++j) {
      const std::ptrdiff_t row = qr * k + i, col = qc * k + j;
      const double over = band.at(row, col) - divided_.at(row, col);
      quad_gouge = std::max(quad_gouge, -over);
      // A node between two design cells belongs to the later one.
      if ((i == k && !last_row) || (j == k && !last_col)) continue;
      strip.sum += over;
      strip.sum_of_squares += over * over;
      excess = std::max(excess, over);
      if (counts) {
        const double bin = std::floor((over * cosine - kFirstBin_mm) / kBin_mm);
        ++bins[static_cast<std::size_t>(std::min(std::max(bin, 0.0), double{kBins - 1}))];
        excess_inside = excess;
      } else if (is_border(row, col)) {
        excess_border = std::max(excess_border, over);
      } else {
        excess_inside = std::max(excess_inside, over);
      }
      if (-over > kGougeListed_mm) ++strip.gouged;
      if (-over > static_cast<double>(deepest.depth_mm))
        deepest = {static_cast<float>(-over), static_cast<std::int32_t>(row),
                   static_cast<std::int32_t>(col)};
    }
  strip.max_gouge = std::max(strip.max_gouge, quad_gouge);
  strip.max_excess = std::max(strip.max_excess, excess);
  for (const Cutter& cutter : options_.cutters)
    strip.proven = std::max(strip.proven, proven_quad(band, qr, qc, slope, quad_gouge, cutter));

  const auto raise = [&](Reach kind, double v) {
    const float up = std::nextafter(static_cast<float>(v), std::numeric_limits<float>::infinity());
    reach[kind] = std::max(reach[kind], up);
  };
  raise(inside, excess_inside);
  raise(border, excess_border);
  // At a node between cells the steepest cell counts; here only an upper bound is asked for.
  double around = slope;
  for (std::ptrdiff_t r = std::max<std::ptrdiff_t>(0, qr - 1); r <= qr; ++r)
    for (std::ptrdiff_t c = std::max<std::ptrdiff_t>(0, qc - 1); c <= qc; ++c)
      around = std::fmax(around, slope_of(r, c));
  raise(with_bound,
        excess_inside + excess_between_nodes(excess_inside, around, options_.deepest_gouge_mm,
                                             options_.cell_mm, options_.reach_radius_mm));
  if (!std::isnan(options_.stepover_mm))
    raise(over_scallop, excess_inside - stated_scallop_mm({options_.reach_radius_mm},
                                                          options_.stepover_mm, slope));
}

void Comparison::add_over_scallop(const MilledBand& band, std::ptrdiff_t block_row,
                                  Strip& strip) const {
  const auto sampled_from = [this](std::ptrdiff_t node) {
    return (node + sampling_ - 1) / sampling_ * sampling_;
  };
  const std::ptrdiff_t k = options_.per_spacing, cols = divided_.cols() - border_nodes_;
  const std::ptrdiff_t end =
      std::min((block_row + 1) * block_nodes_, divided_.rows() - border_nodes_);
  const double room = 0.5 * options_.stepover_mm;
  for (std::ptrdiff_t row = sampled_from(std::max(block_row * block_nodes_, border_nodes_));
       row < end; row += sampling_)
    for (std::ptrdiff_t col = sampled_from(border_nodes_); col < cols; col += sampling_) {
      const double slope = slope_of(std::min(row / k, design_.z_mm.rows() - 2),
                                    std::min(col / k, design_.z_mm.cols() - 2));
      const double excess = band.at(row, col) - divided_.at(row, col);
      const double over = value(over_scallop, row, col, excess, slope);
      const bool counts = over > kOverScallop_mm;
      if (!counts && over <= strip.max_over_scallop) continue;
      if (counts && (row / sampling_ + col / sampling_) % kClosingEvery == 0) {
        const double by_path = over - reach_.closing_mm(row, col);
        strip.max_over_closing = std::max(strip.max_over_closing, by_path);
        strip.over_closing += by_path > kOverScallop_mm;
      }
      const BallReach reach = reach_.at(row, col, room);
      if (reach == BallReach::roomy)
        strip.max_over_scallop = std::fmax(strip.max_over_scallop, over);
      else if (counts)
        ++(reach == BallReach::tight ? strip.tight : strip.unreached);
    }
}

Result<void> Comparison::add(const MilledBand& band, std::ptrdiff_t first_block_row,
                             std::ptrdiff_t end_block_row, const RunContext& run) {
  const std::ptrdiff_t quad_rows = design_.z_mm.rows() - 1, quad_cols = design_.z_mm.cols() - 1;
  tbb::parallel_for(first_block_row, end_block_row, [&](std::ptrdiff_t br) {
    if (run.stopped()) return;
    Strip& strip = strips_[static_cast<std::size_t>(br)];
    strip.bins.assign(kClasses * kBins, 0);
    for (auto& values : strip.reach)
      values.assign(static_cast<std::size_t>(block_cols_), -INFINITY);
    for (std::ptrdiff_t bc = 0; bc < block_cols_; ++bc) {
      Gouge deepest{0.0F, 0, 0};
      std::array<float, kReaches> reach;
      reach.fill(-INFINITY);
      for (std::ptrdiff_t qr = br * quads_; qr < std::min(quad_rows, (br + 1) * quads_); ++qr)
        for (std::ptrdiff_t qc = bc * quads_; qc < std::min(quad_cols, (bc + 1) * quads_); ++qc)
          add_quad(band, qr, qc, strip, deepest, reach);
      if (static_cast<double>(deepest.depth_mm) > kGougeListed_mm) strip.gouges.push_back(deepest);
      for (std::size_t i = 0; i < kReaches; ++i)
        strip.reach[i][static_cast<std::size_t>(bc)] = reach[i];
    }
    if (!std::isnan(options_.stepover_mm)) add_over_scallop(band, br, strip);
  });
  if (run.stopped()) return fail(kCancelled, "comparing the cut with the design was stopped");

  Strip& all = strips_.back();
  std::array<std::vector<ReachBlock>, kReaches> blocks;
  for (std::ptrdiff_t br = first_block_row; br < end_block_row; ++br) {
    Strip& strip = strips_[static_cast<std::size_t>(br)];
    for (std::size_t i = 0; i < all.bins.size(); ++i) all.bins[i] += strip.bins[i];
    for (std::size_t kind = 0; kind < kReaches; ++kind)
      for (std::ptrdiff_t bc = 0; bc < block_cols_; ++bc) {
        const float v = strip.reach[kind][static_cast<std::size_t>(bc)];
        if (!(static_cast<double>(v) > best_[kind])) continue;
        // The last blocks have the outline's nodes too.
        blocks[kind].push_back({v, br * block_nodes_,
                                br + 1 == block_rows_ ? divided_.rows() : (br + 1) * block_nodes_,
                                bc * block_nodes_,
                                bc + 1 == block_cols_ ? divided_.cols() : (bc + 1) * block_nodes_});
      }
    strip.bins = {};
    strip.reach = {};
  }
  for (std::size_t kind = 0; kind < kReaches; ++kind) {
    const auto at_node = [&](std::ptrdiff_t row, std::ptrdiff_t col) {
      const std::ptrdiff_t k = options_.per_spacing;
      const double slope = kind == with_bound ? slope_at_node(row, col)
                           : kind == over_scallop
                               ? slope_of(std::min(row / k, design_.z_mm.rows() - 2),
                                          std::min(col / k, design_.z_mm.cols() - 2))
                               : 0.0;
      return value(static_cast<Reach>(kind), row, col, band.at(row, col) - divided_.at(row, col),
                   slope);
    };
    MAQUETTE_TRY(best_[kind], reach_.raise(std::move(blocks[kind]), at_node, best_[kind], run));
  }
  return {};
}

double Comparison::proven_gouge_mm(const MilledBand& band, std::ptrdiff_t first_block_row,
                                   std::ptrdiff_t end_block_row, const Cutter& cutter) const {
  const std::ptrdiff_t k = options_.per_spacing;
  const std::ptrdiff_t q0 = first_block_row * quads_;
  const std::ptrdiff_t q1 = std::min(design_.z_mm.rows() - 1, end_block_row * quads_);
  std::vector<double> proven(static_cast<std::size_t>(q1 - q0), 0.0);
  tbb::parallel_for(q0, q1, [&](std::ptrdiff_t qr) {
    double& most = proven[static_cast<std::size_t>(qr - q0)];
    for (std::ptrdiff_t qc = 0; qc + 1 < design_.z_mm.cols(); ++qc) {
      double gouge = -INFINITY;
      for (std::ptrdiff_t i = 0; i <= k; ++i)
        for (std::ptrdiff_t j = 0; j <= k; ++j)
          gouge = std::fmax(gouge,
                            divided_.at(qr * k + i, qc * k + j) - band.at(qr * k + i, qc * k + j));
      most = std::fmax(most, proven_quad(band, qr, qc, slope_of(qr, qc), gouge, cutter));
    }
  });
  return *std::max_element(proven.begin(), proven.end());
}

void Comparison::finish(Certificate& c) {
  Strip all;
  std::vector<Gouge> gouges;
  for (std::size_t i = 0; i + 1 < strips_.size(); ++i) {
    const Strip& strip = strips_[i];
    all.sum += strip.sum;
    all.sum_of_squares += strip.sum_of_squares;
    all.max_gouge = std::fmax(all.max_gouge, strip.max_gouge);
    all.max_excess = std::fmax(all.max_excess, strip.max_excess);
    all.proven = std::fmax(all.proven, strip.proven);
    all.gouged += strip.gouged;
    all.max_over_scallop = std::fmax(all.max_over_scallop, strip.max_over_scallop);
    all.tight += strip.tight;
    all.unreached += strip.unreached;
    all.max_over_closing = std::max(all.max_over_closing, strip.max_over_closing);
    all.over_closing += strip.over_closing;
    gouges.insert(gouges.end(), strip.gouges.begin(), strip.gouges.end());
  }
  const double cell = options_.cell_mm;
  const double nodes = static_cast<double>(divided_.rows()) * static_cast<double>(divided_.cols());
  c.cell_gouge_mm = all.max_gouge;
  c.cell_bound_mm = std::fmax(0.0, all.proven - all.max_gouge);
  c.max_excess_anywhere_mm = all.max_excess;
  c.max_excess_inside_mm = best_[inside];
  c.max_excess_border_mm = best_[border];
  c.max_excess_mm = std::fmax(best_[inside], best_[border]);
  c.excess_bound_mm = std::fmax(0.0, best_[with_bound] - c.max_excess_inside_mm);
  if (!std::isnan(options_.stepover_mm)) {
    const double sample = std::pow(static_cast<double>(sampling_) * cell, 2);
    c.max_excess_over_scallop_mm = all.max_over_scallop;
    c.max_tight_over_scallop_mm = best_[over_scallop];
    c.tight_area_mm2 = static_cast<double>(all.tight) * sample;
    c.unreached_area_mm2 = static_cast<double>(all.unreached) * sample;
    c.max_over_closing_mm = all.max_over_closing;
    c.over_closing_area_mm2 = static_cast<double>(all.over_closing) * sample * kClosingEvery;
  }
  c.mean_excess_mm = all.sum / nodes;
  c.rms_excess_mm = std::sqrt(all.sum_of_squares / nodes);
  c.gouged_area_mm2 = static_cast<double>(all.gouged) * cell * cell;

  // Deepest first, at least a cutter's radius apart.
  double apart = 0.0;
  for (const Cutter& cutter : options_.cutters) apart = std::fmax(apart, cutter.radius_mm);
  std::sort(gouges.begin(), gouges.end(), [](const Gouge& a, const Gouge& b) {
    if (a.depth_mm != b.depth_mm) return a.depth_mm > b.depth_mm;
    return a.row != b.row ? a.row < b.row : a.col < b.col;
  });
  for (const Gouge& gouge : gouges) {
    if (c.worst_gouges.size() == kWorstPlaces) break;
    const Place place{design_.x0.value() + cell * gouge.col, design_.y0.value() + cell * gouge.row,
                      static_cast<double>(gouge.depth_mm)};
    const bool close =
        std::any_of(c.worst_gouges.begin(), c.worst_gouges.end(), [&](const Place& p) {
          return std::hypot(p.x_mm - place.x_mm, p.y_mm - place.y_mm) < apart;
        });
    if (!close) c.worst_gouges.push_back(place);
  }

  for (std::size_t k = 0; k < kClasses; ++k) {
    const std::uint64_t* bins = strips_.back().bins.data() + k * kBins;
    std::uint64_t count = 0;
    for (std::size_t i = 0; i < kBins; ++i) count += bins[i];
    if (count == 0) continue;
    const double steep = std::tan(kClassEdges_deg[k + 1] * std::numbers::pi / 180.0);
    ScallopClass s{
        kClassEdges_deg[k],  kClassEdges_deg[k + 1], static_cast<double>(count) * cell * cell,
        quantile(bins, 0.5), quantile(bins, 0.95),   quantile(bins, 0.99)};
    if (!std::isnan(options_.stepover_mm) && k + 1 < kClasses)
      s.stated_mm = stated_scallop_mm({options_.reach_radius_mm}, options_.stepover_mm, steep) /
                    std::sqrt(1.0 + steep * steep);
    c.scallops.push_back(s);
  }
}

}  // namespace maquette::cnc

// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/disc_filter.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>

#include "core/median.hpp"
#include "core/normal_quantile.hpp"

namespace maquette::scan::detail {
namespace {

constexpr double kLeastPoints = 20.0;  // a mean of fewer need not be normal so far out
constexpr double kSurely = 1.645;      // 95 %, one-sided
constexpr double kPrior = 20.0;        // points that scatter as is typical, beside a disc's own

/// Cells whose middle lies in a disc about a cell's middle (odd widths) or corner (even ones).
struct Mask {
  std::ptrdiff_t across = 0;
  std::vector<std::array<std::ptrdiff_t, 3>>
      runs;  ///< row, first column, end; from the disc's cell
  double cells = 0.0;
  double middle = 0.5;  ///< of the disc from the lower left corner of its cell

  explicit Mask(std::ptrdiff_t width) : across(width) {
    const bool odd = width % 2 != 0;
    middle = odd ? 0.5 : 0.0;
    const double radius = 0.5 * static_cast<double>(width);
    for (std::ptrdiff_t r = -width; r <= width; ++r) {
      const double y = static_cast<double>(r) + 0.5 - middle;
      if (std::abs(y) >= radius) continue;
      const double half = std::sqrt(radius * radius - y * y);
      // Middles at c + 0.5 - middle within half.
      const auto first = static_cast<std::ptrdiff_t>(std::ceil(-half - 0.5 + middle - 1e-9));
      const auto last = static_cast<std::ptrdiff_t>(std::floor(half - 0.5 + middle + 1e-9));
      if (last < first) continue;
      runs.push_back({r, first, last + 1});
      cells += static_cast<double>(last + 1 - first);
    }
  }
  /// What it has in common with a round patch.
  struct Common {
    double cells = 0.0;  ///< area in cells
    double mixed = 0.0;  ///< mean of f (1 - f), f: share of a cell that is in the patch
  };
  /// @param dx, dy  from the disc's middle to the patch's, in cells
  [[nodiscard]] Common with(double patch_width_cells, double dx, double dy) const {
    constexpr int kFine = 8;
    const double radius = 0.5 * patch_width_cells;
    Common all;
    for (const auto& [r, first, end] : runs)
      for (std::ptrdiff_t c = first; c < end; ++c) {
        double share = 0.0;
        for (int i = 0; i < kFine; ++i)
          for (int j = 0; j < kFine; ++j) {
            const double x = static_cast<double>(c) + (j + 0.5) / kFine - middle - dx;
            const double y = static_cast<double>(r) + (i + 0.5) / kFine - middle - dy;
            if (x * x + y * y < radius * radius) share += 1.0 / (kFine * kFine);
          }
        all.cells += share;
        all.mixed += share * (1.0 - share) / cells;
      }
    return all;
  }
};

/// Sums along each row up to a column: of a run two look-ups are enough.
struct RowSums {
  struct Sum {
    double n = 0.0, sum = 0.0;
    double scatter = 0.0, freedom = 0.0;  ///< within cells: a patch's height is not in it
  };
  Grid<double> n, sum, scatter, freedom;
  explicit RowSums(const Grid<Cell>& cells)
      : n(cells.rows(), cells.cols() + 1, 0.0), sum(n), scatter(n), freedom(n) {
    for (std::ptrdiff_t r = 0; r < cells.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < cells.cols(); ++c) {
        const Cell& cell = cells(r, c);
        n(r, c + 1) = n(r, c) + cell.n;
        sum(r, c + 1) = sum(r, c) + cell.sum;
        const double own =
            cell.n > 0.0 ? std::fmax(0.0, cell.square - cell.sum * cell.sum / cell.n) : 0.0;
        scatter(r, c + 1) = scatter(r, c) + own;
        freedom(r, c + 1) = freedom(r, c) + std::fmax(0.0, cell.n - 1.0);
      }
  }
  [[nodiscard]] Sum of(const Mask& mask, std::ptrdiff_t row, std::ptrdiff_t col) const {
    Sum all;
    for (const auto& [r, first, end] : mask.runs) {
      const std::ptrdiff_t at = row + r;
      if (at < 0 || at >= n.rows()) continue;
      const std::ptrdiff_t a = std::clamp<std::ptrdiff_t>(col + first, 0, n.cols() - 1);
      const std::ptrdiff_t b = std::clamp<std::ptrdiff_t>(col + end, 0, n.cols() - 1);
      all.n += n(at, b) - n(at, a);
      all.sum += sum(at, b) - sum(at, a);
      all.scatter += scatter(at, b) - scatter(at, a);
      all.freedom += freedom(at, b) - freedom(at, a);
    }
    return all;
  }
};

/// One mask at every cell of one layer.
class Pass {
 public:
  Pass(const Layer& layer, std::ptrdiff_t across, double typical, bool pose)
      : layer_(&layer), mask_(across), typical_(typical), pose_(pose) {}

  /// @return how many discs there were
  double run(const RowSums& sums, std::vector<Disc>& candidates) {
    constexpr double kWorthAThought = 4.0;  // no threshold is lower
    const CellMap& map = layer_->map;
    const std::ptrdiff_t rows = map.mean_mm.rows(), cols = map.mean_mm.cols();
    Grid<float> scores(rows, cols, NAN), sigmas(rows, cols, NAN);
    std::vector<double> all_scores;
    for (std::ptrdiff_t r = 0; r < rows; ++r)
      for (std::ptrdiff_t c = 0; c < cols; ++c) {
        const RowSums::Sum all = sums.of(mask_, r, c);
        if (all.n < kLeastPoints) continue;
        const double mean = all.sum / all.n - static_cast<double>(layer_->background_mm(r, c));
        const double sigma =
            std::sqrt((all.scatter + kPrior * typical_) / (all.freedom + kPrior) / all.n);
        scores(r, c) = static_cast<float>(mean / sigma);
        sigmas(r, c) = static_cast<float>(sigma);
        all_scores.push_back(mean / sigma);
      }
    const auto discs = static_cast<double>(all_scores.size());
    if (all_scores.empty()) return 0.0;
    inflation_ = std::fmax(1.0, nmad(std::move(all_scores)));
    for (std::ptrdiff_t r = 0; r < rows; ++r)
      for (std::ptrdiff_t c = 0; c < cols; ++c) {
        const double sigma = static_cast<double>(sigmas(r, c));
        const double pose2 = pose_ ? pose_variance(map, r, c) : 0.0;
        const double z = static_cast<double>(scores(r, c)) /
                         std::sqrt(inflation_ * inflation_ + pose2 / (sigma * sigma));
        if (!(std::abs(z) > kWorthAThought)) continue;
        candidates.push_back({map.x0_mm + map.cell_mm * (static_cast<double>(c) + mask_.middle),
                              map.y0_mm + map.cell_mm * (static_cast<double>(r) + mask_.middle),
                              width_mm(), z, inflation_});
      }
    return discs;
  }
  /// The lowest patch that it shows, where cells and patch lie worst.
  [[nodiscard]] double limit_mm(double width, double per_mm2, double threshold) const {
    const double cell = layer_->map.cell_mm;
    if (per_mm2 * mask_.cells * cell * cell < kLeastPoints) return INFINITY;
    double most = 0.0;
    for (const auto& [dx, dy] : {std::pair{0.0, 0.0}, {0.5, 0.0}, {0.5, 0.5}})
      most = std::fmax(
          most, limit_mm(mask_.with(width / cell, dx, dy), per_mm2 * cell * cell, threshold));
    return most;
  }
  [[nodiscard]] double width_mm() const {
    return 2.0 * layer_->map.cell_mm * std::sqrt(mask_.cells / std::numbers::pi);
  }

 private:
  /// Beside the noise of its mean, the points that happen to lie in the patch count, and the edge
  /// of the patch, which looks like noise within cells.
  [[nodiscard]] double limit_mm(const Mask::Common& common, double per_cell,
                                double threshold) const {
    if (common.cells <= 0.0) return INFINITY;
    double pose2 = 0.0;
    if (pose_) {
      const CellMap& m = layer_->map;
      pose2 = pose_variance(m, m.mean_mm.rows() / 2, m.mean_mm.cols() / 2);
    }
    const double n = per_cell * mask_.cells, freedom = std::fmax(0.0, n - mask_.cells);
    const auto shows = [&](double h) {
      const double mean = h * common.cells / mask_.cells;
      const double own = freedom * (typical_ + h * h * common.mixed) + kPrior * typical_;
      const double stated = inflation_ * inflation_ * own / (freedom + kPrior) / n + pose2;
      const double spread =
          inflation_ * inflation_ * typical_ / n + pose2 + mean * mean / (per_cell * common.cells);
      return mean > threshold * std::sqrt(stated) + kSurely * std::sqrt(spread);
    };
    double low = 0.0, high = 1e4 * std::sqrt(typical_);
    if (!shows(high)) return INFINITY;
    for (int i = 0; i < 60; ++i) {
      const double middle = 0.5 * (low + high);
      (shows(middle) ? high : low) = middle;
    }
    return high;
  }

  const Layer* layer_;
  Mask mask_;
  double typical_;
  bool pose_;
  double inflation_ = 1.0;  ///< what correlation between points makes of the sigmas
};

double points_per_mm2(const Layer& layer) {
  std::vector<double> counts;
  for (const Cell& c : layer.cells.cells())
    if (c.n > 0.0) counts.push_back(c.n);
  if (counts.empty()) return 0.0;
  return median(std::move(counts)) / (layer.map.cell_mm * layer.map.cell_mm);
}

std::vector<DetectionLimit> limits_of(const std::vector<Pass>& passes, const Layer& counted,
                                      double threshold, double widest_mm) {
  const double per_mm2 = points_per_mm2(counted);
  std::vector<DetectionLimit> limits;
  for (const double width : {3.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0, 1000.0}) {
    if (width > widest_mm) break;
    double least = INFINITY;
    for (const Pass& p : passes) least = std::fmin(least, p.limit_mm(width, per_mm2, threshold));
    if (std::isfinite(least))
      limits.push_back({width, least, per_mm2 * 0.25 * std::numbers::pi * width * width});
  }
  return limits;
}

}  // namespace

DiscSearch search_discs(std::span<const Layer> layers, double typical, double level, bool pose) {
  DiscSearch result;
  if (layers.empty()) return result;
  std::vector<Pass> passes;
  std::vector<Disc> candidates;
  double discs = 0.0;
  for (std::size_t size = 0; size < layers.size(); ++size) {
    const auto& cells = layers[size].cells;
    const RowSums sums(cells);
    for (const std::ptrdiff_t across : {2, 3, 4, 6, 8, 11}) {
      if ((size > 0 && across < 8) || 2 * across > std::min(cells.rows(), cells.cols())) continue;
      passes.emplace_back(layers[size], across, typical, pose);
      discs += passes.back().run(sums, candidates);
    }
  }
  if (discs == 0.0) return result;
  result.threshold = two_sided_normal_quantile(level / discs);
  std::erase_if(candidates, [&](const Disc& d) { return std::abs(d.z) < result.threshold; });
  std::stable_sort(candidates.begin(), candidates.end(),
                   [](const Disc& a, const Disc& b) { return std::abs(a.z) > std::abs(b.z); });
  result.found = std::move(candidates);
  const CellMap& map = layers.front().map;
  const double side =
      map.cell_mm * static_cast<double>(std::min(map.mean_mm.rows(), map.mean_mm.cols()));
  result.limits = limits_of(passes, layers[std::min<std::size_t>(2, layers.size() - 1)],
                            result.threshold, 0.5 * side);
  return result;
}

}  // namespace maquette::scan::detail

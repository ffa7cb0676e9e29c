// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/significance.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "core/check.hpp"
#include "core/median.hpp"

namespace maquette::scan {
namespace {

constexpr int kSizes = 5;
constexpr double kFalseDiscoveries = 0.01;  // over all sizes
constexpr double kLevelOfDetection = 1.96;  // 95 %, two-sided

struct Cell {
  double n = 0.0, sum = 0.0, square = 0.0;
};

/// Two-sided probability of a standard normal beyond |z|.
double tail(double z) {
  return std::erfc(std::abs(z) / std::numbers::sqrt2);
}

/// @param shares  points of each scan per cell
/// @param rate    of false discoveries
CellMap map_of(const Grid<Cell>& cells, double cell_mm, double x0, double y0,
               std::span<const ScanPose> scans, std::span<const Grid<float>> shares, double rate) {
  const std::ptrdiff_t rows = cells.rows(), cols = cells.cols();
  CellMap map{cell_mm,
              x0,
              y0,
              1.0,
              Grid<float>(rows, cols, NAN),
              Grid<float>(rows, cols, NAN),
              Grid<float>(rows, cols, NAN),
              Grid<std::uint8_t>(rows, cols, 0),
              0.0};
  // Scatter of single points: pooled robustly, the typical cell; a cell with many points that
  // scatters more has its own.
  std::vector<double> variances;
  for (const Cell& c : cells.cells())
    if (c.n >= 3.0)
      variances.push_back(std::fmax(0.0, (c.square - c.sum * c.sum / c.n) / (c.n - 1.0)));
  if (variances.empty()) return map;
  // The median of s^2 with few degrees of freedom lies below its mean: Wilson and Hilferty.
  std::vector<double> counts;
  for (const Cell& c : cells.cells())
    if (c.n >= 3.0) counts.push_back(c.n);
  const double freedom = std::fmax(2.0, median(counts) - 1.0);
  const double to_mean = 1.0 / std::pow(1.0 - 2.0 / (9.0 * freedom), 3.0);
  const double typical = std::fmax(1e-12, to_mean * median(variances));

  std::vector<double> scores;
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      const Cell& cell = cells(r, c);
      if (cell.n < 3.0) continue;
      const double mean = cell.sum / cell.n;
      const double own = std::fmax(0.0, cell.square - cell.sum * mean);
      // As if the typical scatter had been seen in 20 more points.
      const double variance = (own + 20.0 * typical) / (cell.n - 1.0 + 20.0);
      map.mean_mm(r, c) = static_cast<float>(mean);
      map.sigma_mm(r, c) = static_cast<float>(std::sqrt(variance / cell.n));
      scores.push_back(mean / std::sqrt(variance / cell.n));
    }
  map.inflation = std::fmax(1.0, nmad(scores));

  // Benjamini and Hochberg over all cells, with the pose's part in each.
  struct Test {
    double p;
    std::ptrdiff_t row, col;
  };
  std::vector<Test> tests;
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      if (std::isnan(map.mean_mm(r, c))) continue;
      map.sigma_mm(r, c) *= static_cast<float>(map.inflation);
      double pose2 = 0.0;
      for (std::size_t k = 0; k < scans.size(); ++k) {
        const Vec3 at{x0 + cell_mm * (static_cast<double>(c) + 0.5),
                      y0 + cell_mm * (static_cast<double>(r) + 0.5),
                      scans[k].registration.centre_mm.z};
        const double part = static_cast<double>(shares[k](r, c)) / cells(r, c).n *
                            pose_sigma_mm(scans[k].registration, at, {0.0, 0.0, 1.0});
        pose2 += part * part;
      }
      const double sigma = std::hypot(static_cast<double>(map.sigma_mm(r, c)), std::sqrt(pose2));
      map.lod_mm(r, c) = static_cast<float>(kLevelOfDetection * sigma);
      tests.push_back({tail(static_cast<double>(map.mean_mm(r, c)) / sigma), r, c});
    }
  std::sort(tests.begin(), tests.end(), [](const Test& a, const Test& b) {
    return a.p != b.p ? a.p < b.p : a.row != b.row ? a.row < b.row : a.col < b.col;
  });
  std::size_t accepted = 0;
  for (std::size_t i = 0; i < tests.size(); ++i)
    if (tests[i].p <= rate * static_cast<double>(i + 1) / static_cast<double>(tests.size()))
      accepted = i + 1;
  for (std::size_t i = 0; i < accepted; ++i) map.significant(tests[i].row, tests[i].col) = 1;
  map.significant_share = static_cast<double>(accepted) / static_cast<double>(tests.size());
  return map;
}

struct Patch {
  std::vector<std::pair<std::ptrdiff_t, std::ptrdiff_t>> cells;
};

/// Cells that touch, corners included, of one sign.
std::vector<Patch> patches_of(const CellMap& map) {
  const std::ptrdiff_t rows = map.mean_mm.rows(), cols = map.mean_mm.cols();
  Grid<std::uint8_t> seen(rows, cols, 0);
  std::vector<Patch> patches;
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      if (map.significant(r, c) == 0 || seen(r, c) != 0) continue;
      const bool up = map.mean_mm(r, c) > 0.0F;
      Patch patch;
      patch.cells.emplace_back(r, c);
      seen(r, c) = 1;
      for (std::size_t i = 0; i < patch.cells.size(); ++i)
        for (std::ptrdiff_t a = -1; a <= 1; ++a)
          for (std::ptrdiff_t b = -1; b <= 1; ++b) {
            const std::ptrdiff_t y = patch.cells[i].first + a, x = patch.cells[i].second + b;
            if (!map.mean_mm.contains(y, x) || seen(y, x) != 0 || map.significant(y, x) == 0 ||
                (map.mean_mm(y, x) > 0.0F) != up)
              continue;
            seen(y, x) = 1;
            patch.cells.emplace_back(y, x);
          }
      patches.push_back(std::move(patch));
    }
  return patches;
}

/// Weighted mean with the standard deviation that the cells state.
struct Mean {
  double sum = 0.0, weight = 0.0;
  void add(double value, double sigma) {
    sum += value / (sigma * sigma);
    weight += 1.0 / (sigma * sigma);
  }
  [[nodiscard]] double value() const { return sum / weight; }
  [[nodiscard]] double sigma() const { return 1.0 / std::sqrt(weight); }
};

/// A window of the map round a patch, where its extent is found anew: a cell belongs to it if the
/// mean over its neighbours is nearer to the patch's height than to its surroundings. Cells that
/// were not significant by chance come in so, and those that were by chance go.
class Window {
 public:
  static constexpr std::ptrdiff_t kAround = 6;
  Window(const CellMap& map, const Patch& patch) : map_(&map) {
    std::ptrdiff_t r0 = map.mean_mm.rows(), r1 = 0, c0 = map.mean_mm.cols(), c1 = 0;
    for (const auto& [r, c] : patch.cells) {
      r0 = std::min(r0, r), r1 = std::max(r1, r);
      c0 = std::min(c0, c), c1 = std::max(c1, c);
    }
    top_ = std::max<std::ptrdiff_t>(0, r0 - kAround);
    left_ = std::max<std::ptrdiff_t>(0, c0 - kAround);
    in_ = Grid<std::uint8_t>(std::min(map.mean_mm.rows() - 1, r1 + kAround) - top_ + 1,
                             std::min(map.mean_mm.cols() - 1, c1 + kAround) - left_ + 1, 0);
    for (const auto& [r, c] : patch.cells) in_(r - top_, c - left_) = 1;
    measure();
    for (int i = 0; i < 4; ++i) {
      refine();
      measure();
    }
  }

  [[nodiscard]] std::ptrdiff_t rows() const { return in_.rows(); }
  [[nodiscard]] std::ptrdiff_t cols() const { return in_.cols(); }
  [[nodiscard]] bool seen(std::ptrdiff_t i, std::ptrdiff_t j) const {
    return in_.contains(i, j) && !std::isnan(map_->mean_mm(top_ + i, left_ + j));
  }
  [[nodiscard]] double mean(std::ptrdiff_t i, std::ptrdiff_t j) const {
    return static_cast<double>(map_->mean_mm(top_ + i, left_ + j));
  }
  [[nodiscard]] double sigma(std::ptrdiff_t i, std::ptrdiff_t j) const {
    return static_cast<double>(map_->sigma_mm(top_ + i, left_ + j));
  }
  [[nodiscard]] bool in(std::ptrdiff_t i, std::ptrdiff_t j) const {
    return in_.contains(i, j) && in_(i, j) != 0;
  }
  /// Is a cell of the patch within so many steps, diagonals included?
  [[nodiscard]] bool near(std::ptrdiff_t i, std::ptrdiff_t j, int most) const {
    return steps_(i, j) <= most;
  }
  [[nodiscard]] Patch patch() const {
    Patch p;
    for (std::ptrdiff_t i = 0; i < rows(); ++i)
      for (std::ptrdiff_t j = 0; j < cols(); ++j)
        if (in(i, j)) p.cells.emplace_back(top_ + i, left_ + j);
    return p;
  }
  [[nodiscard]] Vec3 middle(std::ptrdiff_t i, std::ptrdiff_t j) const {
    return {map_->x0_mm + map_->cell_mm * (static_cast<double>(left_ + j) + 0.5),
            map_->y0_mm + map_->cell_mm * (static_cast<double>(top_ + i) + 0.5), 0.0};
  }
  Mean around, inside, all;  ///< surroundings, cells with all neighbours in the patch, the patch
  double base = 0.0, sigma_base = 0.0, height = 0.0, sigma_height = 0.0;

 private:
  /// Two passes: exact for steps of a king.
  void count_steps() {
    steps_ = Grid<int>(rows(), cols(), 1'000'000);
    const auto pass = [&](std::ptrdiff_t i, std::ptrdiff_t j, std::ptrdiff_t way) {
      int least = in(i, j) ? 0 : steps_(i, j);
      for (const auto& [a, b] :
           {std::pair<std::ptrdiff_t, std::ptrdiff_t>{-way, -1}, {-way, 0}, {-way, 1}, {0, -way}})
        if (steps_.contains(i + a, j + b)) least = std::min(least, steps_(i + a, j + b) + 1);
      steps_(i, j) = least;
    };
    for (std::ptrdiff_t i = 0; i < rows(); ++i)
      for (std::ptrdiff_t j = 0; j < cols(); ++j) pass(i, j, 1);
    for (std::ptrdiff_t i = rows(); i-- > 0;)
      for (std::ptrdiff_t j = cols(); j-- > 0;) pass(i, j, -1);
  }

  void measure() {
    count_steps();
    around = inside = all = {};
    double first = 0.0, second = 0.0;
    for (std::ptrdiff_t i = 0; i < rows(); ++i)
      for (std::ptrdiff_t j = 0; j < cols(); ++j) {
        if (!seen(i, j)) continue;
        if (!in(i, j)) {
          if (near(i, j, kAround) && !near(i, j, 2)) around.add(mean(i, j), sigma(i, j));
          continue;
        }
        all.add(mean(i, j), sigma(i, j));
        if (in(i - 1, j) && in(i + 1, j) && in(i, j - 1) && in(i, j + 1))
          inside.add(mean(i, j), sigma(i, j));
      }
    base = around.weight > 0.0 ? around.value() : 0.0;
    sigma_base = around.weight > 0.0 ? around.sigma() : 0.0;
    if (inside.weight > 0.0) {
      height = inside.value() - base;
      sigma_height = std::hypot(inside.sigma(), sigma_base);
      return;
    }
    if (!(all.weight > 0.0)) return;
    // No cell is surely full: weighted by itself, and as uncertain as that differs from the mean.
    for (std::ptrdiff_t i = 0; i < rows(); ++i)
      for (std::ptrdiff_t j = 0; j < cols(); ++j)
        if (seen(i, j) && in(i, j)) {
          const double step = mean(i, j) - base;
          first += step;
          second += step * step - sigma(i, j) * sigma(i, j);
        }
    const double plain = all.value() - base;
    height = std::abs(second) > std::abs(first * plain) ? second / first : plain;
    sigma_height = std::hypot(all.sigma(), sigma_base, 0.5 * (height - plain));
  }

  void refine() {
    Grid<std::uint8_t> next(rows(), cols(), 0);
    for (std::ptrdiff_t i = 0; i < rows(); ++i)
      for (std::ptrdiff_t j = 0; j < cols(); ++j) {
        if (!near(i, j, 2)) continue;
        Mean here;
        // A cell that is certain by itself needs no neighbours.
        const bool alone = seen(i, j) && std::abs(height) > 6.0 * sigma(i, j);
        const std::ptrdiff_t reach = alone ? 0 : 1;
        for (std::ptrdiff_t a = -reach; a <= reach; ++a)
          for (std::ptrdiff_t b = -reach; b <= reach; ++b)
            if (seen(i + a, j + b)) here.add(mean(i + a, j + b), sigma(i + a, j + b));
        if (here.weight > 0.0 && (here.value() - base) * height > 0.5 * height * height)
          next(i, j) = 1;
      }
    if (std::any_of(next.cells().begin(), next.cells().end(), [](auto v) { return v != 0; }))
      in_ = std::move(next);
  }

  const CellMap* map_;
  std::ptrdiff_t top_ = 0, left_ = 0;
  Grid<std::uint8_t> in_;
  Grid<int> steps_;
};

/// Its window grows with the patch until that is whole. A patch beside a large step that grew over
/// most of the part would be all that is not the step, and its height the step's with the wrong
/// sign: such a one stays as it was met.
Window whole_patch(const CellMap& map, Patch patch) {
  const auto cells = map.mean_mm.cells();
  const auto seen = static_cast<std::size_t>(
      std::count_if(cells.begin(), cells.end(), [](float v) { return !std::isnan(v); }));
  Window w(map, patch);
  if (2 * patch.cells.size() > seen) return w;
  const Window met = w;
  for (int i = 0; i < 60; ++i) {
    Patch now = w.patch();
    if (now.cells == patch.cells) break;
    if (2 * now.cells.size() > seen) return met;
    patch = std::move(now);
    w = Window(map, patch);
  }
  return w;
}

Finding describe(const CellMap& map, const Patch& patch) {
  const Window w = whole_patch(map, patch);
  const double side = map.cell_mm, area = side * side;
  Finding f;
  f.cell_mm = side;
  f.height_mm = w.height;
  f.sigma_height_mm = w.sigma_height;
  f.min_mm = {INFINITY, INFINITY, 0.0};
  f.max_mm = {-INFINITY, -INFINITY, 0.0};
  Vec3 first;
  double variance = 0.0, used = 0.0;
  const auto each = [&](const auto& visit) {
    for (std::ptrdiff_t i = 0; i < w.rows(); ++i)
      for (std::ptrdiff_t j = 0; j < w.cols(); ++j)
        if (w.seen(i, j) && w.near(i, j, 1)) visit(i, j, (w.mean(i, j) - w.base) * area);
  };
  each([&](std::ptrdiff_t i, std::ptrdiff_t j, double volume) {
    f.volume_mm3 += volume;
    variance += w.sigma(i, j) * w.sigma(i, j) * area * area;
    used += area;
    first += volume * w.middle(i, j);
    if (!w.in(i, j)) return;
    const Vec3 at = w.middle(i, j);
    f.min_mm = {std::fmin(f.min_mm.x, at.x - 0.5 * side), std::fmin(f.min_mm.y, at.y - 0.5 * side),
                0.0};
    f.max_mm = {std::fmax(f.max_mm.x, at.x + 0.5 * side), std::fmax(f.max_mm.y, at.y + 0.5 * side),
                0.0};
  });
  f.sigma_volume_mm3 = std::hypot(std::sqrt(variance), used * w.sigma_base);
  if (f.volume_mm3 == 0.0 || f.height_mm == 0.0) return f;
  f.certainty = std::abs(f.volume_mm3) / f.sigma_volume_mm3;
  f.centre_mm = (1.0 / f.volume_mm3) * first;
  f.area_mm2 = std::fmax(0.0, f.volume_mm3 / f.height_mm);
  f.diameter_mm = 2.0 * std::sqrt(f.area_mm2 / std::numbers::pi);
  f.sigma_diameter_mm =
      0.5 * f.diameter_mm *
      std::hypot(f.sigma_volume_mm3 / f.volume_mm3, f.sigma_height_mm / f.height_mm);
  // A rectangle of sides a and b has second moments a^2 / 12 and b^2 / 12. Of the cells of the
  // patch alone: far rims would weigh noise by the square of their distance.
  double xx = 0.0, xy = 0.0, yy = 0.0, n = 0.0;
  Vec3 sum;
  each([&](std::ptrdiff_t i, std::ptrdiff_t j, double) {
    if (w.in(i, j)) sum += w.middle(i, j), n += 1.0;
  });
  const Vec3 middle = (1.0 / n) * sum;
  each([&](std::ptrdiff_t i, std::ptrdiff_t j, double) {
    if (!w.in(i, j)) return;
    const Vec3 off = w.middle(i, j) - middle;
    xx += off.x * off.x / n, xy += off.x * off.y / n, yy += off.y * off.y / n;
  });
  const double half = 0.5 * (xx + yy), root = std::hypot(0.5 * (xx - yy), xy);
  f.length_mm = std::sqrt(12.0 * std::fmax(0.0, half + root) + area);
  f.width_mm = std::sqrt(12.0 * std::fmax(0.0, half - root) + area);
  return f;
}

bool overlap(const Finding& a, const Finding& b) {
  return a.min_mm.x < b.max_mm.x && b.min_mm.x < a.max_mm.x && a.min_mm.y < b.max_mm.y &&
         b.min_mm.y < a.max_mm.y;
}

}  // namespace

Significance significance(std::span<const Vec3> points, std::span<const float> deviation,
                          std::span<const ScanPose> scans, double finest_mm) {
  MAQUETTE_CHECK(points.size() == deviation.size(), "{} points, {} deviations", points.size(),
                 deviation.size());
  std::size_t of_scans = 0;
  for (const ScanPose& s : scans) of_scans += s.points;
  MAQUETTE_CHECK(scans.empty() || of_scans == points.size(), "{} points, {} in the scans",
                 points.size(), of_scans);
  Box3 box;
  std::size_t used = 0;
  for (std::size_t i = 0; i < points.size(); ++i)
    if (!std::isnan(deviation[i])) {
      box.add(points[i]);
      ++used;
    }
  Significance result;
  if (used < 100) return result;
  const double wide = std::fmax(1e-6, box.max.x - box.min.x);
  const double deep = std::fmax(1e-6, box.max.y - box.min.y);
  double cell =
      finest_mm > 0.0 ? finest_mm : std::sqrt(6.0 * wide * deep / static_cast<double>(used));
  // Not more than 16 million cells, whatever is asked for.
  cell = std::fmax(cell, std::sqrt(wide * deep / 16e6));
  const auto count = [&](double length) {
    return static_cast<std::ptrdiff_t>(std::floor(length / cell)) + 1;
  };
  Grid<Cell> cells(count(deep), count(wide));
  std::vector<Grid<float>> shares(scans.size(), Grid<float>(cells.rows(), cells.cols(), 0.0F));
  std::size_t scan = 0, end_of_scan = scans.empty() ? points.size() : scans[0].points;
  for (std::size_t i = 0; i < points.size(); ++i) {
    while (i >= end_of_scan) end_of_scan += scans[++scan].points;
    if (std::isnan(deviation[i])) continue;
    const auto row = static_cast<std::ptrdiff_t>((points[i].y - box.min.y) / cell);
    const auto col = static_cast<std::ptrdiff_t>((points[i].x - box.min.x) / cell);
    if (!scans.empty()) shares[scan](row, col) += 1.0F;
    Cell& c = cells(row, col);
    const auto d = static_cast<double>(deviation[i]);
    c.n += 1.0;
    c.sum += d;
    c.square += d * d;
  }
  std::vector<Finding> all;
  int sizes = 0;
  for (auto side = std::min(cells.rows(), cells.cols()); sizes < kSizes && side >= 8; ++sizes)
    side = (side + 1) / 2;
  for (int size = 0; size < sizes; ++size) {
    result.maps.push_back(map_of(cells, cell, box.min.x, box.min.y, scans, shares,
                                 kFalseDiscoveries / static_cast<double>(sizes)));
    for (const Patch& patch : patches_of(result.maps.back()))
      all.push_back(describe(result.maps.back(), patch));
    Grid<Cell> coarse((cells.rows() + 1) / 2, (cells.cols() + 1) / 2);
    for (std::ptrdiff_t r = 0; r < cells.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < cells.cols(); ++c) {
        Cell& to = coarse(r / 2, c / 2);
        to.n += cells(r, c).n;
        to.sum += cells(r, c).sum;
        to.square += cells(r, c).square;
      }
    for (Grid<float>& share : shares) {
      Grid<float> sum(coarse.rows(), coarse.cols(), 0.0F);
      for (std::ptrdiff_t r = 0; r < cells.rows(); ++r)
        for (std::ptrdiff_t c = 0; c < cells.cols(); ++c) sum(r / 2, c / 2) += share(r, c);
      share = std::move(sum);
    }
    cells = std::move(coarse);
    cell *= 2.0;
  }
  std::stable_sort(all.begin(), all.end(),
                   [](const Finding& a, const Finding& b) { return a.certainty > b.certainty; });
  for (const Finding& f : all)
    if (f.certainty > 3.0 && std::none_of(result.findings.begin(), result.findings.end(),
                                          [&](const Finding& g) { return overlap(f, g); }))
      result.findings.push_back(f);
  return result;
}

}  // namespace maquette::scan

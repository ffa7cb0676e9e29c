// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/significance.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <optional>

#include <Eigen/Dense>

#include "core/check.hpp"
#include "core/median.hpp"
#include "scan/detail/disc_filter.hpp"
#include "scan/detail/disc_fit.hpp"
#include "scan/detail/patch_pose.hpp"
#include "scan/detail/patches.hpp"

namespace maquette::scan {
namespace {

constexpr int kSizes = 5;
constexpr double kFalseDiscoveries = 0.005;  // of cells, over all sizes
constexpr double kFalseDisc = 0.005;         // that any disc is found by chance
constexpr double kCertain = 3.0;             // standard deviations of a finding's volume
constexpr double kFitCells =
    16;  // discs as wide as so many of the finest cells are cut out of points
// A patch that stands out by less has no shape but round.
constexpr double kShapeless = 16.0;  // standard deviations
constexpr double kDegree = std::numbers::pi / 180.0;

using detail::Cell;

/// Two-sided probability of a standard normal beyond |z|.
double tail(double z) {
  return std::erfc(std::abs(z) / std::numbers::sqrt2);
}

/// Scatter of single points: pooled robustly, the typical cell. A cell with many points that
/// scatters more has its own.
double typical_variance(const Grid<Cell>& cells) {
  std::vector<double> variances, counts;
  for (const Cell& c : cells.cells())
    if (c.n >= 3.0) {
      variances.push_back(std::fmax(0.0, (c.square - c.sum * c.sum / c.n) / (c.n - 1.0)));
      counts.push_back(c.n);
    }
  if (variances.empty()) return 0.0;
  // The median of s^2 with few degrees of freedom lies below its mean: Wilson and Hilferty.
  const double freedom = std::fmax(2.0, median(std::move(counts)) - 1.0);
  const double to_mean = 1.0 / std::pow(1.0 - 2.0 / (9.0 * freedom), 3.0);
  return std::fmax(1e-12, to_mean * median(std::move(variances)));
}

/// Of a cell's mean, as if the typical scatter had been seen in 20 more points.
double sigma_of(const Cell& c, double typical) {
  const double own = std::fmax(0.0, c.square - c.sum * c.sum / c.n);
  return std::sqrt((own + 20.0 * typical) / (c.n - 1.0 + 20.0) / c.n);
}

/// Benjamini and Hochberg over all cells.
class Discoveries {
 public:
  void add(double z, std::ptrdiff_t row, std::ptrdiff_t col) {
    tests_.push_back({tail(z), row, col});
  }
  /// Marks what is discovered. @return its share of all
  double mark(double rate, Grid<std::uint8_t>& marked) {
    std::sort(tests_.begin(), tests_.end(), [](const Test& a, const Test& b) {
      return a.p != b.p ? a.p < b.p : a.row != b.row ? a.row < b.row : a.col < b.col;
    });
    const auto all = static_cast<double>(tests_.size());
    std::size_t accepted = 0;
    for (std::size_t i = 0; i < tests_.size(); ++i)
      if (tests_[i].p <= rate * static_cast<double>(i + 1) / all) accepted = i + 1;
    for (std::size_t i = 0; i < accepted; ++i) marked(tests_[i].row, tests_[i].col) = 1;
    return tests_.empty() ? 0.0 : static_cast<double>(accepted) / all;
  }

 private:
  struct Test {
    double p;
    std::ptrdiff_t row, col;
  };
  std::vector<Test> tests_;
};

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
              Grid<std::uint8_t>(rows, cols, 0),
              0.0};
  const double typical = typical_variance(cells);
  std::vector<double> scores;
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      const Cell& cell = cells(r, c);
      if (cell.n < 3.0) continue;
      const double mean = cell.sum / cell.n, sigma = sigma_of(cell, typical);
      map.mean_mm(r, c) = static_cast<float>(mean);
      map.sigma_mm(r, c) = static_cast<float>(sigma);
      scores.push_back(mean / sigma);
    }
  if (scores.empty()) return map;
  map.inflation = std::fmax(1.0, nmad(std::move(scores)));

  Discoveries discoveries;
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
      map.lod_mm(r, c) = static_cast<float>(detail::kLevelOfDetection * sigma);
      discoveries.add(static_cast<double>(map.mean_mm(r, c)) / sigma, r, c);
    }
  map.significant_share = discoveries.mark(rate, map.significant);
  return map;
}

/// Where the part lies as a whole: a plane.
struct Background {
  bool there = false;
  Vec3 middle_mm;
  double level_mm = 0.0, slope_x = 0.0, slope_y = 0.0;
  double sigma_level_mm = 0.0;  ///< of noise, without the pose
  [[nodiscard]] double at(double x, double y) const {
    return level_mm + slope_x * (x - middle_mm.x) + slope_y * (y - middle_mm.y);
  }
};

/// Does more than half of the part lie significantly to one side?
bool lies_off(const CellMap& map) {
  std::size_t seen = 0, above = 0, below = 0;
  for (std::size_t i = 0; i < map.mean_mm.cells().size(); ++i) {
    const float mean = map.mean_mm.cells()[i];
    if (std::isnan(mean)) continue;
    ++seen;
    if (map.significant.cells()[i] != 0) ++(mean > 0.0F ? above : below);
  }
  return 2 * std::max(above, below) > seen;
}

/// The plane through most of the cells: Tukey's biweight, from their median.
Background background_of(const CellMap& map) {
  struct Sample {
    double x, y, mean, sigma;
  };
  std::vector<Sample> samples;
  std::vector<double> means;
  Background b;
  for (std::ptrdiff_t r = 0; r < map.mean_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < map.mean_mm.cols(); ++c) {
      if (std::isnan(map.mean_mm(r, c))) continue;
      samples.push_back({map.x0_mm + map.cell_mm * (static_cast<double>(c) + 0.5),
                         map.y0_mm + map.cell_mm * (static_cast<double>(r) + 0.5),
                         static_cast<double>(map.mean_mm(r, c)),
                         static_cast<double>(map.sigma_mm(r, c))});
      means.push_back(samples.back().mean);
      b.middle_mm += Vec3{samples.back().x, samples.back().y, 0.0};
    }
  b.there = true;
  b.middle_mm = (1.0 / static_cast<double>(samples.size())) * b.middle_mm;
  b.level_mm = median(std::move(means));
  constexpr int kRounds = 30;
  constexpr double kTukey = 4.685;
  for (int round = 0; round < kRounds; ++round) {
    std::vector<double> scores;
    for (const Sample& s : samples) scores.push_back((s.mean - b.at(s.x, s.y)) / s.sigma);
    const double limit = kTukey * std::fmax(1.0, nmad(scores));
    Eigen::Matrix3d normal = Eigen::Matrix3d::Zero();
    Eigen::Vector3d right = Eigen::Vector3d::Zero();
    for (std::size_t i = 0; i < samples.size(); ++i) {
      const double u = scores[i] / limit;
      if (!(std::abs(u) < 1.0)) continue;
      const Sample& s = samples[i];
      const double weight = std::pow((1.0 - u * u) / s.sigma, 2);
      const Eigen::Vector3d row{1.0, s.x - b.middle_mm.x, s.y - b.middle_mm.y};
      normal += weight * row * row.transpose();
      right += weight * s.mean * row;
    }
    const Eigen::Vector3d plane = normal.ldlt().solve(right);
    const double moved = std::abs(plane(0) - b.level_mm);
    b.level_mm = plane(0), b.slope_x = plane(1), b.slope_y = plane(2);
    b.sigma_level_mm = limit / kTukey / std::sqrt(normal(0, 0));
    if (moved < 1e-3 * b.sigma_level_mm) break;
  }
  return b;
}

/// The part's own level as a finding.
Finding whole_part(const Background& b, const CellMap& map) {
  Finding f;
  f.whole_part = true;
  f.centre_mm = b.middle_mm;
  f.cell_mm = map.cell_mm;
  f.height_mm = f.along_z_mm = b.level_mm;
  // The pose's part as the cell in the middle has it.
  double pose2 = 0.0, nearest = INFINITY;
  f.min_mm = {INFINITY, INFINITY, 0.0};
  f.max_mm = {-INFINITY, -INFINITY, 0.0};
  for (std::ptrdiff_t r = 0; r < map.mean_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < map.mean_mm.cols(); ++c) {
      if (std::isnan(map.mean_mm(r, c))) continue;
      const double x = map.x0_mm + map.cell_mm * static_cast<double>(c),
                   y = map.y0_mm + map.cell_mm * static_cast<double>(r);
      f.area_mm2 += map.cell_mm * map.cell_mm;
      f.min_mm = {std::fmin(f.min_mm.x, x), std::fmin(f.min_mm.y, y), 0.0};
      f.max_mm = {std::fmax(f.max_mm.x, x + map.cell_mm), std::fmax(f.max_mm.y, y + map.cell_mm),
                  0.0};
      const double off = std::hypot(x - b.middle_mm.x, y - b.middle_mm.y);
      if (!(off < nearest)) continue;
      nearest = off;
      pose2 = detail::pose_variance(map, r, c);
    }
  f.sigma_height_mm = std::hypot(b.sigma_level_mm, std::sqrt(pose2));
  f.length_mm = std::fmax(f.max_mm.x - f.min_mm.x, f.max_mm.y - f.min_mm.y);
  f.width_mm = std::fmin(f.max_mm.x - f.min_mm.x, f.max_mm.y - f.min_mm.y);
  f.diameter_mm = 2.0 * std::sqrt(f.area_mm2 / std::numbers::pi);
  f.volume_mm3 = f.area_mm2 * f.height_mm;
  f.sigma_volume_mm3 = f.area_mm2 * f.sigma_height_mm;
  f.certainty = std::abs(f.height_mm) / f.sigma_height_mm;
  return f;
}

/// What patches are sought in: the map as it is, or against the part as a whole.
detail::Layer layer_of(const CellMap& map, const Grid<Cell>& cells, const Background& background,
                       double rate) {
  const std::ptrdiff_t rows = cells.rows(), cols = cells.cols();
  detail::Layer layer{map, cells, Grid<float>(rows, cols, 0.0F), Grid<float>(rows, cols, NAN),
                      map.significant};
  const double typical = typical_variance(cells);
  Discoveries discoveries;
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      // Also where there are no points: discs reach over such cells.
      const double level =
          background.there ? background.at(map.x0_mm + map.cell_mm * (static_cast<double>(c) + 0.5),
                                           map.y0_mm + map.cell_mm * (static_cast<double>(r) + 0.5))
                           : 0.0;
      layer.background_mm(r, c) = static_cast<float>(level);
      if (cells(r, c).n < 1.0) continue;
      const double sigma = map.inflation * sigma_of(cells(r, c), typical);
      layer.sigma_mm(r, c) = static_cast<float>(sigma);
      if (!background.there) continue;
      // Where the part lies is no longer in question, so the pose's error is none of a step.
      if (!std::isnan(map.mean_mm(r, c)))
        discoveries.add((static_cast<double>(map.mean_mm(r, c)) - level) / sigma, r, c);
    }
  if (background.there) {
    layer.marked = Grid<std::uint8_t>(rows, cols, 0);
    discoveries.mark(rate, layer.marked);
  }
  return layer;
}

/// Two by two cells are one of the next size.
Grid<Cell> coarser(const Grid<Cell>& cells) {
  Grid<Cell> coarse((cells.rows() + 1) / 2, (cells.cols() + 1) / 2);
  for (std::ptrdiff_t r = 0; r < cells.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < cells.cols(); ++c) {
      Cell& to = coarse(r / 2, c / 2);
      to.n += cells(r, c).n;
      to.sum += cells(r, c).sum;
      to.square += cells(r, c).square;
      to.level += cells(r, c).level;
    }
  return coarse;
}

Grid<float> coarser(const Grid<float>& share) {
  Grid<float> sum((share.rows() + 1) / 2, (share.cols() + 1) / 2, 0.0F);
  for (std::ptrdiff_t r = 0; r < share.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < share.cols(); ++c) sum(r / 2, c / 2) += share(r, c);
  return sum;
}

/// Cells and their neighbours: what lies across the edge of a patch is neither.
void mark_with_rim(const detail::FoundPatch::Cells& cells, Grid<std::uint8_t>& marked) {
  for (const auto& [r, c] : cells)
    for (std::ptrdiff_t a = -1; a <= 1; ++a)
      for (std::ptrdiff_t b = -1; b <= 1; ++b)
        if (marked.contains(r + a, c + b)) marked(r + a, c + b) = 1;
}

bool overlap(const Finding& a, const Finding& b) {
  return a.min_mm.x < b.max_mm.x && b.min_mm.x < a.max_mm.x && a.min_mm.y < b.max_mm.y &&
         b.min_mm.y < a.max_mm.y;
}

/// What a disc has found, or what has grown away from the cell that began it, is drawn all the
/// same.
void draw(const detail::FoundPatch& patch, CellMap& map) {
  mark_with_rim(patch.all, map.in_patch);
  if (std::none_of(patch.all.begin(), patch.all.end(),
                   [&](const auto& cell) { return map.significant(cell.first, cell.second) != 0; }))
    for (const auto& [r, c] : patch.all) map.significant(r, c) = 1;
}

/// Of patches that overlap the first stays.
void keep(detail::FoundPatch patch, CellMap& map, std::vector<detail::FoundPatch>& kept) {
  if (std::any_of(kept.begin(), kept.end(),
                  [&](const detail::FoundPatch& g) { return overlap(patch.finding, g.finding); }))
    return;
  draw(patch, map);
  kept.push_back(std::move(patch));
}

/// The layer in which a disc has some four cells across: fewer have no inside, of more each is mere
/// noise.
std::size_t size_for(double width_mm, std::span<const detail::Layer> layers) {
  std::size_t size = 0;
  while (size + 1 < layers.size() && layers[size + 1].map.cell_mm < width_mm / 3.5) ++size;
  return size;
}

bool touch(const detail::Disc& d, const Finding& f) {
  const double r = 0.5 * d.width_mm;
  return d.x_mm > f.min_mm.x - r && d.x_mm < f.max_mm.x + r && d.y_mm > f.min_mm.y - r &&
         d.y_mm < f.max_mm.y + r;
}

/// Discs that touch none of those that cells have shown, and none that stands out more.
std::vector<detail::Disc> alone(std::span<const detail::Disc> discs,
                                std::span<const detail::FoundPatch> known) {
  constexpr std::size_t kMost = 200;
  std::vector<detail::Disc> found;
  for (const detail::Disc& d : discs) {
    if (std::any_of(known.begin(), known.end(),
                    [&](const auto& g) { return touch(d, g.finding); }) ||
        std::any_of(found.begin(), found.end(), [&](const detail::Disc& o) {
          return std::hypot(d.x_mm - o.x_mm, d.y_mm - o.y_mm) < 0.5 * (d.width_mm + o.width_mm);
        }))
      continue;
    found.push_back(d);
    if (found.size() == kMost) break;
  }
  return found;
}

/// The points about each disc, less the part as a whole.
std::vector<std::vector<detail::Sample>> samples_about(std::span<const detail::Disc> discs,
                                                       std::span<const Vec3> points,
                                                       std::span<const float> deviation,
                                                       const Background& background,
                                                       const CellMap& map) {
  std::vector<std::vector<detail::Sample>> samples(discs.size());
  Grid<std::uint8_t> near(map.mean_mm.rows(), map.mean_mm.cols(), 0);
  const auto cell = [&](double at, double zero) {
    return static_cast<std::ptrdiff_t>((at - zero) / map.cell_mm);
  };
  for (const detail::Disc& d : discs) {
    const double reach = detail::kDiscWindow * d.width_mm;
    for (auto r = std::max<std::ptrdiff_t>(0, cell(d.y_mm - reach, map.y0_mm));
         r < near.rows() && r <= cell(d.y_mm + reach, map.y0_mm); ++r)
      for (auto c = std::max<std::ptrdiff_t>(0, cell(d.x_mm - reach, map.x0_mm));
           c < near.cols() && c <= cell(d.x_mm + reach, map.x0_mm); ++c)
        near(r, c) = 1;
  }
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vec3 p = points[i];
    if (std::isnan(deviation[i]) || near(cell(p.y, map.y0_mm), cell(p.x, map.x0_mm)) == 0) continue;
    const double level = background.there ? background.at(p.x, p.y) : 0.0;
    for (std::size_t k = 0; k < discs.size(); ++k)
      if (std::hypot(p.x - discs[k].x_mm, p.y - discs[k].y_mm) <
          detail::kDiscWindow * discs[k].width_mm)
        samples[k].push_back({p.x, p.y, static_cast<double>(deviation[i]) - level});
  }
  return samples;
}

/// A disc as a patch of a layer.
detail::FoundPatch patch_of(const detail::DiscFit& fit, const detail::Layer& layer) {
  const CellMap& map = layer.map;
  const double r = 0.5 * fit.diameter_mm;
  detail::FoundPatch patch;
  const auto row = static_cast<std::ptrdiff_t>((fit.y_mm - map.y0_mm) / map.cell_mm);
  const auto col = static_cast<std::ptrdiff_t>((fit.x_mm - map.x0_mm) / map.cell_mm);
  const auto reach = static_cast<std::ptrdiff_t>(4.0 * r / map.cell_mm) + 1;
  double level = 0.0, points = 0.0;
  for (std::ptrdiff_t i = row - reach; i <= row + reach; ++i)
    for (std::ptrdiff_t j = col - reach; j <= col + reach; ++j) {
      if (!map.mean_mm.contains(i, j)) continue;
      const double off =
          std::hypot(map.x0_mm + map.cell_mm * (static_cast<double>(j) + 0.5) - fit.x_mm,
                     map.y0_mm + map.cell_mm * (static_cast<double>(i) + 0.5) - fit.y_mm);
      if (off < r || (i == row && j == col)) {
        patch.all.emplace_back(i, j);
        level += layer.cells(i, j).level, points += layer.cells(i, j).n;
      } else if (off > 1.6 * r && off < 4.0 * r) {
        patch.around.emplace_back(i, j);
      }
    }
  patch.inside = patch.all;
  Finding& f = patch.finding;
  f.cell_mm = map.cell_mm;
  f.centre_mm = {fit.x_mm, fit.y_mm, 0.0};
  f.height_mm = fit.height_mm, f.sigma_height_mm = fit.sigma_height_mm;
  f.along_z_mm = points > 0.0 ? fit.height_mm * points / level : fit.height_mm;
  f.area_mm2 = fit.area_mm2;
  f.diameter_mm = fit.diameter_mm, f.sigma_diameter_mm = fit.sigma_diameter_mm;
  f.length_mm = f.width_mm = 0.5 * std::sqrt(3.0) * fit.diameter_mm;  // equal second moments
  f.volume_mm3 = fit.volume_mm3, f.sigma_volume_mm3 = fit.sigma_volume_mm3;
  f.min_mm = {fit.x_mm - r, fit.y_mm - r, 0.0};
  f.max_mm = {fit.x_mm + r, fit.y_mm + r, 0.0};
  return patch;
}

/// The patch that cells show at a disc.
std::optional<detail::FoundPatch> patch_by_cells(const detail::Disc& d,
                                                 const detail::Layer& layer) {
  const CellMap& map = layer.map;
  const auto row = static_cast<std::ptrdiff_t>((d.y_mm - map.y0_mm) / map.cell_mm);
  const auto col = static_cast<std::ptrdiff_t>((d.x_mm - map.x0_mm) / map.cell_mm);
  detail::FoundPatch::Cells cells;
  for (std::ptrdiff_t r = row - 2; r <= row + 2; ++r)
    for (std::ptrdiff_t c = col - 2; c <= col + 2; ++c) {
      const double x = map.x0_mm + map.cell_mm * (static_cast<double>(c) + 0.5) - d.x_mm,
                   y = map.y0_mm + map.cell_mm * (static_cast<double>(r) + 0.5) - d.y_mm;
      const bool inside = std::hypot(x, y) < 0.35 * d.width_mm || (r == row && c == col);
      if (inside && map.mean_mm.contains(r, c)) cells.emplace_back(r, c);
    }
  return detail::patch_at(layer, std::move(cells));
}

/// The gain of a patch as its cells have it: of all its points, on the base of the disc.
double gain_of(const detail::FoundPatch& patch, const detail::DiscFit& fit,
               std::span<const detail::Layer> layers) {
  const auto layer =
      std::min_element(layers.begin(), layers.end(), [&](const auto& a, const auto& b) {
        return std::abs(a.map.cell_mm - patch.finding.cell_mm) <
               std::abs(b.map.cell_mm - patch.finding.cell_mm);
      });
  double n = 0.0, sum = 0.0;
  for (const auto& [r, c] : patch.all) {
    const detail::Cell& cell = layer->cells(r, c);
    n += cell.n;
    sum += cell.sum - cell.n * (fit.base_mm + static_cast<double>(layer->background_mm(r, c)));
  }
  return n > 0.0 ? sum * sum / n / fit.variance : 0.0;
}

/// Small patches by their points: those that cells show, where a disc explains more, and those that
/// lie across cells. Adds to `kept`.
void search_by_discs(std::span<const detail::Layer> layers, const detail::DiscSearch& discs,
                     std::span<const Vec3> points, std::span<const float> deviation,
                     const Background& background, double beam_diameter_mm,
                     std::vector<CellMap>& maps, std::vector<detail::FoundPatch>& kept) {
  const double typical = typical_variance(layers.front().cells);
  const double widest = kFitCells * layers.front().map.cell_mm;
  struct Seed {
    detail::Disc disc;
    std::ptrdiff_t of_kept = -1;
  };
  std::vector<Seed> seeds;
  for (std::size_t k = 0; k < kept.size(); ++k) {
    const Finding& f = kept[k].finding;
    if (f.certainty > kShapeless) continue;
    const auto d = std::find_if(discs.found.begin(), discs.found.end(), [&](const auto& o) {
      return (o.z > 0.0) == (f.height_mm > 0.0) && o.width_mm < widest && touch(o, f);
    });
    if (d != discs.found.end()) seeds.push_back({*d, static_cast<std::ptrdiff_t>(k)});
  }
  for (const detail::Disc& d : alone(discs.found, kept)) seeds.push_back({d, -1});

  std::vector<detail::Disc> narrow;
  std::vector<std::size_t> seed_of;
  for (std::size_t k = 0; k < seeds.size(); ++k)
    if (seeds[k].disc.width_mm < widest) {
      narrow.push_back(seeds[k].disc);
      seed_of.push_back(k);
    }
  std::vector<std::optional<detail::DiscFit>> fits(seeds.size());
  const auto samples = samples_about(narrow, points, deviation, background, layers.front().map);
  for (std::size_t k = 0; k < narrow.size(); ++k)
    if (auto fit = detail::fit_disc(narrow[k], samples[k], typical, beam_diameter_mm);
        fit && fit->gain < kShapeless * kShapeless)
      fits[seed_of[k]] = *fit;

  std::vector<std::pair<detail::FoundPatch, std::size_t>> found;
  for (std::size_t k = 0; k < seeds.size(); ++k) {
    const detail::Disc& d = seeds[k].disc;
    const auto& fit = fits[k];
    const std::size_t size = size_for(fit ? fit->diameter_mm : d.width_mm, layers);
    const auto by_disc = [&](double certainty) {
      detail::FoundPatch patch = patch_of(*fit, layers[size]);
      patch.finding.certainty = std::fmax(certainty, std::abs(d.z));
      return patch;
    };
    if (seeds[k].of_kept >= 0) {
      const auto of = static_cast<std::size_t>(seeds[k].of_kept);
      const double certainty = kept[of].finding.certainty;
      if (!fit || fit->gain < gain_of(kept[of], *fit, layers)) continue;
      kept[of] = by_disc(certainty);
      draw(kept[of], maps[size]);
      continue;
    }
    auto patch = patch_by_cells(d, layers[size]);
    if (patch) patch->finding.certainty = std::fmax(patch->finding.certainty, std::abs(d.z));
    if (fit && (!patch || fit->gain >= gain_of(*patch, *fit, layers))) patch = by_disc(0.0);
    if (patch) found.emplace_back(*std::move(patch), size);
  }
  // Of cells of several sizes two may have met one patch.
  for (std::size_t k = 0; k < kept.size(); ++k)
    kept.erase(std::remove_if(kept.begin() + static_cast<std::ptrdiff_t>(k) + 1, kept.end(),
                              [&](const auto& g) {
                                return overlap(kept[k].finding, g.finding) &&
                                       kept[k].finding.height_mm * g.finding.height_mm > 0.0;
                              }),
               kept.end());
  for (auto& [patch, size] : found) keep(std::move(patch), maps[size], kept);
}

}  // namespace

Significance significance(std::span<const Vec3> points, std::span<const float> deviation,
                          std::span<const ScanPose> scans, double finest_mm,
                          std::span<const float> slope_deg, const heightmap::ModelField* surface,
                          double beam_diameter_mm) {
  MAQUETTE_CHECK(points.size() == deviation.size(), "{} points, {} deviations", points.size(),
                 deviation.size());
  MAQUETTE_CHECK(slope_deg.empty() || slope_deg.size() == points.size(), "{} points, {} slopes",
                 points.size(), slope_deg.size());
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
    const double slope = slope_deg.empty() ? 0.0 : static_cast<double>(slope_deg[i]);
    c.level += std::isnan(slope) ? 1.0 : std::cos(kDegree * slope);
  }
  int sizes = 0;
  for (auto side = std::min(cells.rows(), cells.cols()); sizes < kSizes && side >= 8; ++sizes)
    side = (side + 1) / 2;
  const double rate = kFalseDiscoveries / std::fmax(1.0, sizes);
  std::vector<Grid<Cell>> layers;
  bool off = false;
  for (int size = 0; size < sizes; ++size) {
    layers.push_back(size == 0 ? std::move(cells) : coarser(layers.back()));
    if (size > 0)
      for (Grid<float>& share : shares) share = coarser(share);
    result.maps.push_back(map_of(layers.back(), cell, box.min.x, box.min.y, scans, shares, rate));
    off = off || lies_off(result.maps.back());
    cell *= 2.0;
  }
  Background background;
  if (off) {
    background = background_of(result.maps.front());
    result.findings.push_back(
        whole_part(background, result.maps[std::min<std::size_t>(1, result.maps.size() - 1)]));
  }
  if (layers.empty()) return result;
  std::vector<detail::Layer> patch_layers;
  std::vector<std::pair<detail::FoundPatch, std::size_t>> all;
  for (std::size_t k = 0; k < layers.size(); ++k)
    patch_layers.push_back(layer_of(result.maps[k], layers[k], background, rate));
  for (std::size_t k = 0; k < layers.size(); ++k)
    for (auto& f : detail::find_patches(patch_layers[k]))
      if (f.finding.certainty > kCertain) all.push_back({std::move(f), k});
  std::stable_sort(all.begin(), all.end(), [](const auto& a, const auto& b) {
    return a.first.finding.certainty > b.first.finding.certainty;
  });
  std::vector<detail::FoundPatch> kept;
  for (auto& [f, size] : all) keep(std::move(f), result.maps[size], kept);
  const auto discs = detail::search_discs(patch_layers, typical_variance(layers.front()),
                                          kFalseDisc, !background.there);
  result.limits = discs.limits;
  search_by_discs(patch_layers, discs, points, deviation, background, beam_diameter_mm, result.maps,
                  kept);
  std::stable_sort(kept.begin(), kept.end(), [](const auto& f, const auto& g) {
    return f.finding.certainty > g.finding.certainty;
  });
  if (surface != nullptr) detail::add_pose(kept, result.maps, points, deviation, scans, *surface);
  for (auto& f : kept) result.findings.push_back(std::move(f.finding));
  return result;
}

}  // namespace maquette::scan

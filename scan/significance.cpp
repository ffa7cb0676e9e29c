// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/significance.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include <Eigen/Dense>

#include "core/check.hpp"
#include "core/median.hpp"
#include "scan/detail/disc_filter.hpp"
#include "scan/detail/patch_pose.hpp"
#include "scan/detail/patches.hpp"
#include "scan/detail/small_patches.hpp"

namespace maquette::scan {
namespace {

constexpr int kSizes = 5;
constexpr double kFalseDiscoveries = 0.005;  // of cells, over all sizes
constexpr double kFalseDisc = 0.005;         // that any disc is found by chance
constexpr double kCertain = 3.0;             // standard deviations of a finding's volume
constexpr double kDegree = std::numbers::pi / 180.0;

using detail::Cell;

/// Two-sided probability of a standard normal beyond |z|.
double tail(double z) {
  return std::erfc(std::abs(z) / std::numbers::sqrt2);
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
  const double typical = detail::typical_variance(cells);
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
  const double typical = detail::typical_variance(cells);
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
  for (auto& [f, size] : all) detail::keep(std::move(f), result.maps[size], kept);
  const double typical = detail::typical_variance(layers.front());
  const auto discs = detail::search_discs(patch_layers, typical, kFalseDisc, !background.there);
  result.limits = discs.limits;
  detail::search_by_discs(
      patch_layers, typical, discs, points, deviation,
      [&](double x, double y) { return background.there ? background.at(x, y) : 0.0; },
      beam_diameter_mm, result.maps, kept);
  std::stable_sort(kept.begin(), kept.end(), [](const auto& f, const auto& g) {
    return f.finding.certainty > g.finding.certainty;
  });
  if (surface != nullptr) detail::add_pose(kept, result.maps, points, deviation, scans, *surface);
  for (auto& f : kept) result.findings.push_back(std::move(f.finding));
  return result;
}

}  // namespace maquette::scan

// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/void_fill.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <utility>
#include <vector>

#include <oneapi/tbb/parallel_for.h>

namespace maquette::heightmap::detail {
namespace {

using Node = std::pair<std::ptrdiff_t, std::ptrdiff_t>;  // row, column

constexpr std::ptrdiff_t kMargin = 2;  // known nodes around a hole that the work needs
constexpr std::size_t kPlaces = 6;     // of which uncertainty is measured
constexpr std::array<double, 13> kBins{1.2, 1.6, 2.3, 3.2, 4.5, 6.4, 9.1, 13, 18, 26, 36, 51, 72};

/// Void nodes that touch each other, corners included, in the order of rows.
struct Hole {
  std::vector<Node> nodes;
  std::ptrdiff_t top = 0, left = 0, rows = 0, cols = 0;  ///< with the margin, within the grid
  double across = 1.0;                                   ///< shorter side, without the margin
};

std::vector<Hole> holes_of(const Grid<float>& z) {
  Grid<std::uint8_t> seen(z.rows(), z.cols(), 0);
  std::vector<Hole> holes;
  for (std::ptrdiff_t r = 0; r < z.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < z.cols(); ++c) {
      if (seen(r, c) != 0 || !std::isnan(z(r, c))) continue;
      Hole hole;
      hole.nodes.emplace_back(r, c);
      seen(r, c) = 1;
      for (std::size_t k = 0; k < hole.nodes.size(); ++k) {
        const auto [y, x] = hole.nodes[k];
        for (std::ptrdiff_t i = std::max<std::ptrdiff_t>(0, y - 1); i < std::min(z.rows(), y + 2);
             ++i)
          for (std::ptrdiff_t j = std::max<std::ptrdiff_t>(0, x - 1); j < std::min(z.cols(), x + 2);
               ++j)
            if (seen(i, j) == 0 && std::isnan(z(i, j))) {
              seen(i, j) = 1;
              hole.nodes.emplace_back(i, j);
            }
      }
      std::sort(hole.nodes.begin(), hole.nodes.end());
      std::ptrdiff_t bottom = 0, right = 0;
      hole.top = z.rows();
      hole.left = z.cols();
      for (const auto& [y, x] : hole.nodes) {
        hole.top = std::min(hole.top, y);
        bottom = std::max(bottom, y);
        hole.left = std::min(hole.left, x);
        right = std::max(right, x);
      }
      hole.across = static_cast<double>(std::min(bottom - hole.top, right - hole.left) + 1);
      hole.top = std::max<std::ptrdiff_t>(0, hole.top - kMargin);
      hole.left = std::max<std::ptrdiff_t>(0, hole.left - kMargin);
      hole.rows = std::min(z.rows(), bottom + kMargin + 1) - hole.top;
      hole.cols = std::min(z.cols(), right + kMargin + 1) - hole.left;
      holes.push_back(std::move(hole));
    }
  return holes;
}

/// The relief of a hole's window, moved by (dr, dc).
Grid<double> window(const Grid<float>& z, const Hole& hole, std::ptrdiff_t dr, std::ptrdiff_t dc) {
  Grid<double> out(hole.rows, hole.cols);
  for (std::ptrdiff_t r = 0; r < hole.rows; ++r)
    for (std::ptrdiff_t c = 0; c < hole.cols; ++c)
      out(r, c) = static_cast<double>(z(hole.top + dr + r, hole.left + dc + c));
  return out;
}

/// Solves Laplace's equation at the hole's nodes, the others of the window being given; at the
/// grid's edge the normal slope is zero. Other voids of the window count as not there. Successive
/// over-relaxation, in the order of the nodes.
void stretch(Grid<double>& h, const Hole& hole) {
  double sum = 0.0, n = 0.0;
  Grid<std::uint8_t> own(h.rows(), h.cols(), 0);
  for (const auto& [r, c] : hole.nodes) own(r - hole.top, c - hole.left) = 1;
  double low = INFINITY, high = -INFINITY;
  for (std::size_t k = 0; k < h.cells().size(); ++k)
    if (own.cells()[k] == 0 && !std::isnan(h.cells()[k])) {
      sum += h.cells()[k];
      n += 1.0;
      low = std::min(low, h.cells()[k]);
      high = std::max(high, h.cells()[k]);
    }
  const double middle = n > 0.0 ? sum / n : 0.0;
  for (const auto& [r, c] : hole.nodes) h(r - hole.top, c - hole.left) = middle;
  const double relax = 2.0 / (1.0 + std::sin(std::numbers::pi / (hole.across + 1.0)));
  const double enough = 1e-7 * (high - low);
  for (int round = 0; round < 20'000; ++round) {
    double most = 0.0;
    for (const auto& [y, x] : hole.nodes) {
      const std::ptrdiff_t r = y - hole.top, c = x - hole.left;
      double around = 0.0;
      int count = 0;
      for (const auto& [i, j] : {Node{r - 1, c}, {r + 1, c}, {r, c - 1}, {r, c + 1}}) {
        if (i < 0 || j < 0 || i >= h.rows() || j >= h.cols() || std::isnan(h(i, j))) continue;
        around += h(i, j);
        ++count;
      }
      if (count == 0) continue;
      const double step = relax * (around / count - h(r, c));
      h(r, c) += step;
      most = std::max(most, std::abs(step));
    }
    if (most <= enough) return;
  }
}

double laplacian(const Grid<float>& z, std::ptrdiff_t r, std::ptrdiff_t c) {
  if (r < 1 || c < 1 || r + 1 >= z.rows() || c + 1 >= z.cols()) return NAN;
  return static_cast<double>(z(r - 1, c)) + static_cast<double>(z(r + 1, c)) +
         static_cast<double>(z(r, c - 1)) + static_cast<double>(z(r, c + 1)) -
         4.0 * static_cast<double>(z(r, c));
}

/// Mean square of the Laplacian around a hole, from at least some hundred nodes.
double roughness_around(const Grid<float>& z, const Hole& hole) {
  const std::ptrdiff_t wide = std::max<std::ptrdiff_t>(8, std::max(hole.rows, hole.cols) / 3);
  double sum = 0.0, n = 0.0;
  for (std::ptrdiff_t r = hole.top - wide; r < hole.top + hole.rows + wide; ++r)
    for (std::ptrdiff_t c = hole.left - wide; c < hole.left + hole.cols + wide; ++c)
      if (const double l = laplacian(z, r, c); !std::isnan(l)) {
        sum += l * l;
        n += 1.0;
      }
  return n > 0.0 ? sum / n : NAN;
}

/// A place nearby of the hole's shape.
struct Place {
  std::ptrdiff_t dr = 0, dc = 0;
  double off = INFINITY;  ///< log ratio of its roughness to that around the hole
};

std::optional<double> roughness_at(const Grid<float>& z, const Hole& hole, std::ptrdiff_t dr,
                                   std::ptrdiff_t dc) {
  if (hole.top + dr < 0 || hole.left + dc < 0 || hole.top + dr + hole.rows > z.rows() ||
      hole.left + dc + hole.cols > z.cols())
    return std::nullopt;
  double sum = 0.0, n = 0.0;
  for (const auto& [r, c] : hole.nodes) {
    const double l = laplacian(z, r + dr, c + dc);
    if (std::isnan(l)) {
      // At the grid's edge there is no Laplacian; elsewhere a neighbour is missing.
      const std::ptrdiff_t y = r + dr, x = c + dc;
      const bool at_edge = y == 0 || x == 0 || y + 1 == z.rows() || x + 1 == z.cols();
      if (!at_edge || std::isnan(z(y, x))) return std::nullopt;
      continue;
    }
    sum += l * l;
    n += 1.0;
  }
  return n > 0.0 ? std::optional(sum / n) : std::nullopt;
}

/// Nearest in roughness first.
std::vector<Place> places_for(const Grid<float>& z, const Hole& hole) {
  const double around = roughness_around(z, hole);
  std::vector<Place> found;
  constexpr int kWays = 16;
  for (const double far : {1.1, 1.7, 2.6, 4.0})
    for (int way = 0; way < kWays; ++way) {
      const double angle = 2.0 * std::numbers::pi * (way + 0.37) / kWays;
      const Place p{std::lround(far * static_cast<double>(hole.rows) * std::sin(angle)),
                    std::lround(far * static_cast<double>(hole.cols) * std::cos(angle))};
      if (const auto rough = roughness_at(z, hole, p.dr, p.dc))
        found.push_back(
            {p.dr, p.dc, std::abs(std::log(std::max(*rough, 1e-30) / std::max(around, 1e-30)))});
    }
  std::stable_sort(found.begin(), found.end(),
                   [](const Place& a, const Place& b) { return a.off < b.off; });
  return found;
}

/// Distance of each of the hole's nodes from its edge.
std::vector<double> depths(const Hole& hole) {
  Grid<float> own(hole.rows, hole.cols, 0.0F);
  for (const auto& [r, c] : hole.nodes) own(r - hole.top, c - hole.left) = NAN;
  const Grid<float> distance = distance_to(own, false);
  std::vector<double> out;
  for (const auto& [r, c] : hole.nodes)
    out.push_back(static_cast<double>(distance(r - hole.top, c - hole.left)));
  return out;
}

std::size_t bin_of(double depth) {
  return static_cast<std::size_t>(std::upper_bound(kBins.begin(), kBins.end(), depth) -
                                  kBins.begin());
}

struct Filled {
  std::vector<double> height, sigma;
  bool relief = false;
};

Filled fill(const Grid<float>& z, const Hole& hole, double slope) {
  const std::vector<double> depth = depths(hole);
  Grid<double> membrane = window(z, hole, 0, 0);
  stretch(membrane, hole);
  Filled out;
  for (const auto& [r, c] : hole.nodes) out.height.push_back(membrane(r - hole.top, c - hole.left));
  const std::vector<Place> places = places_for(z, hole);
  if (places.empty()) {
    for (const double d : depth) out.sigma.push_back(slope * d);
    return out;
  }
  std::array<double, kBins.size() + 1> square{}, count{};
  for (std::size_t p = 0; p < std::min(places.size(), kPlaces); ++p) {
    const Grid<double> relief = window(z, hole, places[p].dr, places[p].dc);
    Grid<double> smooth = relief;
    stretch(smooth, hole);
    for (std::size_t k = 0; k < hole.nodes.size(); ++k) {
      const auto r = hole.nodes[k].first - hole.top, c = hole.nodes[k].second - hole.left;
      const double missed = relief(r, c) - smooth(r, c);
      if (p == 0) out.height[k] += missed;
      square[bin_of(depth[k])] += missed * missed;
      count[bin_of(depth[k])] += 1.0;
    }
  }
  // Deeper nodes are not better known: few of them may look so.
  double most = 0.0;
  for (std::size_t b = 0; b < square.size(); ++b) {
    if (count[b] > 0.0) most = std::max(most, square[b] / count[b]);
    square[b] = most;
  }
  for (const double d : depth) out.sigma.push_back(std::sqrt(2.0 * square[bin_of(d)]));
  out.relief = true;
  return out;
}

}  // namespace

Grid<float> distance_to(const Grid<float>& z, bool to_voids) {
  constexpr float kDiagonal = std::numbers::sqrt2_v<float>;
  Grid<float> d(z.rows(), z.cols(), INFINITY);
  for (std::size_t i = 0; i < d.cells().size(); ++i)
    if (std::isnan(z.cells()[i]) == to_voids) d.cells()[i] = 0.0F;
  const auto relax = [&](std::ptrdiff_t r, std::ptrdiff_t c, std::ptrdiff_t dr) {
    float best = d(r, c);
    if (c + dr >= 0 && c + dr < d.cols()) best = std::min(best, d(r, c + dr) + 1.0F);
    if (r + dr >= 0 && r + dr < d.rows()) {
      best = std::min(best, d(r + dr, c) + 1.0F);
      if (c > 0) best = std::min(best, d(r + dr, c - 1) + kDiagonal);
      if (c + 1 < d.cols()) best = std::min(best, d(r + dr, c + 1) + kDiagonal);
    }
    d(r, c) = best;
  };
  for (std::ptrdiff_t r = 0; r < d.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < d.cols(); ++c) relax(r, c, -1);
  for (std::ptrdiff_t r = d.rows() - 1; r >= 0; --r)
    for (std::ptrdiff_t c = d.cols() - 1; c >= 0; --c) relax(r, c, 1);
  return d;
}

Grid<std::uint8_t> narrow_voids(const Grid<float>& z, double widest) {
  Grid<std::uint8_t> out;
  if (widest < 1.0) return out;
  for (const Hole& hole : holes_of(z)) {
    const bool at_edge = std::any_of(hole.nodes.begin(), hole.nodes.end(), [&](const Node& n) {
      return n.first == 0 || n.second == 0 || n.first + 1 == z.rows() || n.second + 1 == z.cols();
    });
    if (at_edge || hole.across > widest) continue;
    if (out.empty()) out = Grid<std::uint8_t>(z.rows(), z.cols(), 0);
    for (const auto& [r, c] : hole.nodes) out(r, c) = 1;
  }
  return out;
}

VoidFill fill_voids(Grid<float>& z, const Grid<std::uint8_t>* only) {
  VoidFill out;
  std::vector<Hole> holes = holes_of(z);
  if (only != nullptr)
    std::erase_if(holes, [&](const Hole& hole) {
      return std::any_of(hole.nodes.begin(), hole.nodes.end(),
                         [&](const Node& n) { return (*only)(n.first, n.second) == 0; });
    });
  if (holes.empty()) return out;
  MAQUETTE_CHECK(static_cast<std::ptrdiff_t>(holes[0].nodes.size()) < z.rows() * z.cols(),
                 "nothing to fill from");
  out.sigma = Grid<float>(z.rows(), z.cols(), NAN);
  double sum = 0.0, n = 0.0;
  for (std::ptrdiff_t r = 0; r < z.rows(); ++r)
    for (std::ptrdiff_t c = 1; c < z.cols(); ++c)
      if (const double d = static_cast<double>(z(r, c)) - static_cast<double>(z(r, c - 1));
          !std::isnan(d)) {
        sum += d * d;
        n += 1.0;
      }
  const double slope = n > 0.0 ? std::sqrt(sum / n) : 0.0;
  std::vector<Filled> filled(holes.size());
  oneapi::tbb::parallel_for(std::size_t{0}, holes.size(),
                            [&](std::size_t k) { filled[k] = fill(z, holes[k], slope); });
  for (std::size_t k = 0; k < holes.size(); ++k) {
    const auto& nodes = holes[k].nodes;
    out.filled += static_cast<std::ptrdiff_t>(nodes.size());
    if (!filled[k].relief) out.smooth += static_cast<std::ptrdiff_t>(nodes.size());
    for (std::size_t i = 0; i < nodes.size(); ++i) {
      z(nodes[i].first, nodes[i].second) = static_cast<float>(filled[k].height[i]);
      out.sigma(nodes[i].first, nodes[i].second) = static_cast<float>(filled[k].sigma[i]);
    }
  }
  return out;
}

}  // namespace maquette::heightmap::detail

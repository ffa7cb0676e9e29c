// SPDX-License-Identifier: GPL-3.0-or-later
#include "export/sky_view.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>
#include <vector>

#include <tbb/parallel_for.h>

namespace maquette::exporting {
namespace {

/// Rows and columns from node to node along an azimuth.
struct Step {
  std::ptrdiff_t rows, cols;
};
/// In the order of their azimuths, from east over north.
constexpr std::array<Step, 16> kSteps{{{0, 1},
                                       {1, 2},
                                       {1, 1},
                                       {2, 1},
                                       {1, 0},
                                       {2, -1},
                                       {1, -1},
                                       {1, -2},
                                       {0, -1},
                                       {-1, -2},
                                       {-1, -1},
                                       {-2, -1},
                                       {-1, 0},
                                       {-2, 1},
                                       {-1, 1},
                                       {-1, 2}}};

struct Azimuth {
  Step step;
  double x, y;    ///< unit
  double length;  ///< nodes
  double width;   ///< radians that it stands for: to the middles of its neighbours
};

std::array<Azimuth, kSteps.size()> azimuths() {
  std::array<Azimuth, kSteps.size()> all{};
  const auto angle = [](std::size_t k) {
    const Step s = kSteps[k % kSteps.size()];
    return std::atan2(static_cast<double>(s.rows), static_cast<double>(s.cols));
  };
  for (std::size_t k = 0; k < kSteps.size(); ++k) {
    const Step s = kSteps[k];
    const double length = std::hypot(static_cast<double>(s.rows), static_cast<double>(s.cols));
    const double round =
        std::remainder(angle(k + 1) - angle(k + kSteps.size() - 1), 2.0 * std::numbers::pi);
    all[k] = {s, static_cast<double>(s.cols) / length, static_cast<double>(s.rows) / length, length,
              0.5 * round};
  }
  return all;
}

/// What is seen over one azimuth down to `t` from the zenith.
double seen(double up, double along, double t) {
  const double s = std::sin(t), c = std::cos(t);
  return 0.5 * (up * s * s + along * (t - s * c));
}

struct Sums {
  Grid<float> sky, all;  ///< with the horizon, and down to the ground's own plane
};

/// One row of nodes along an azimuth, from where nothing is in front.
void add_row(const Grid<float>& z, double spacing_mm, const SlopeAt& slope, const Azimuth& a,
             std::ptrdiff_t r, std::ptrdiff_t c, std::vector<std::pair<double, double>>& hull,
             Sums& sums) {
  hull.clear();
  for (double way = 0.0; r >= 0 && c >= 0 && r < z.rows() && c < z.cols();
       r -= a.step.rows, c -= a.step.cols, way -= a.length * spacing_mm) {
    const double height = static_cast<double>(z(r, c));
    const auto rise = [&](const std::pair<double, double>& p) {
      return (p.second - height) / (p.first - way);
    };
    while (hull.size() > 1 && rise(hull.back()) <= rise(hull[hull.size() - 2])) hull.pop_back();
    const auto [dx, dy] = slope(r, c);
    const double up = 1.0 / std::sqrt(1.0 + static_cast<double>(dx) * static_cast<double>(dx) +
                                      static_cast<double>(dy) * static_cast<double>(dy));
    const double along = -up * (a.x * static_cast<double>(dx) + a.y * static_cast<double>(dy));
    const double own = 0.5 * std::numbers::pi + std::atan2(along, up);
    double t = own;
    if (!hull.empty()) t = std::min(t, 0.5 * std::numbers::pi - std::atan(rise(hull.back())));
    sums.sky(r, c) += static_cast<float>(a.width * seen(up, along, t));
    sums.all(r, c) += static_cast<float>(a.width * seen(up, along, own));
    hull.emplace_back(way, height);
  }
}

}  // namespace

Grid<float> sky_view(const Grid<float>& z_mm, double spacing_mm, const SlopeAt& slope) {
  const std::ptrdiff_t rows = z_mm.rows(), cols = z_mm.cols();
  Sums sums{Grid<float>(rows, cols, 0.0F), Grid<float>(rows, cols, 0.0F)};
  for (const Azimuth& a : azimuths()) {
    // A row begins at the nodes from which the next step leaves the grid: no two have a node in
    // common, so that threads do not meet.
    std::vector<std::pair<std::ptrdiff_t, std::ptrdiff_t>> first;
    const auto begins = [&](std::ptrdiff_t r, std::ptrdiff_t c) {
      const std::ptrdiff_t nr = r + a.step.rows, nc = c + a.step.cols;
      return nr < 0 || nc < 0 || nr >= rows || nc >= cols;
    };
    const std::ptrdiff_t edge = 2;  // the longest step
    for (std::ptrdiff_t r = 0; r < rows; ++r)
      for (std::ptrdiff_t c = 0; c < cols; ++c) {
        if (r >= edge && r < rows - edge && c == edge) c = std::max(c, cols - edge);
        if (c < cols && begins(r, c)) first.emplace_back(r, c);
      }
    constexpr std::size_t kRowsAtATime = 64;
    tbb::parallel_for(
        std::size_t{0}, (first.size() + kRowsAtATime - 1) / kRowsAtATime, [&](std::size_t part) {
          std::vector<std::pair<double, double>> hull;
          const std::size_t end = std::min(first.size(), (part + 1) * kRowsAtATime);
          for (std::size_t k = part * kRowsAtATime; k < end; ++k)
            add_row(z_mm, spacing_mm, slope, a, first[k].first, first[k].second, hull, sums);
        });
  }
  tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < cols; ++c)
      sums.sky(r, c) = std::clamp(sums.sky(r, c) / sums.all(r, c), 0.0F, 1.0F);
  });
  return std::move(sums.sky);
}

}  // namespace maquette::exporting

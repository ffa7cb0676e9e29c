// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <fmt/format.h>
#include <oneapi/tbb/enumerable_thread_specific.h>
#include <oneapi/tbb/parallel_for.h>

#include "cnc/cutter_location.hpp"
#include "cnc/rest.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;

constexpr double kFinestStep = 1.0 / 16.0;  // of the spacing
constexpr std::ptrdiff_t kRowsAtATime = 16;
/// Sixteen ways: where the ball touches two sides, what it leaves falls only along the valley.
constexpr std::array<std::pair<double, double>, 16> kRose{{{1.0, 0.0},
                                                           {0.0, 1.0},
                                                           {-1.0, 0.0},
                                                           {0.0, -1.0},
                                                           {1.0, 1.0},
                                                           {-1.0, 1.0},
                                                           {-1.0, -1.0},
                                                           {1.0, -1.0},
                                                           {1.0, 0.5},
                                                           {0.5, 1.0},
                                                           {-0.5, 1.0},
                                                           {-1.0, 0.5},
                                                           {-1.0, -0.5},
                                                           {-0.5, -1.0},
                                                           {0.5, -1.0},
                                                           {1.0, -0.5}}};

template <class Work>  // (row, cutter)
void for_rows(std::ptrdiff_t rows, const DropCutter& cutter, const RunContext& run, Work&& work) {
  oneapi::tbb::enumerable_thread_specific<DropCutter> cutters([&] { return DropCutter(cutter); });
  oneapi::tbb::parallel_for(
      oneapi::tbb::blocked_range<std::ptrdiff_t>(0, rows, kRowsAtATime), [&](const auto& block) {
        DropCutter& here = cutters.local();
        for (std::ptrdiff_t r = block.begin(); r < block.end() && !run.stopped(); ++r)
          work(r, here);
      });
}

/// Least of tip + underside over nodes within the radius.
void close_row(const Grid<float>& tips, std::ptrdiff_t row, double d, double R,
               std::span<float> closing) {
  const auto n = static_cast<std::ptrdiff_t>(R / d);
  const std::ptrdiff_t cols = tips.cols();
  std::fill(closing.begin(), closing.end(), INFINITY);
  for (std::ptrdiff_t i = std::max(-n, -row); i <= std::min(n, tips.rows() - 1 - row); ++i)
    for (std::ptrdiff_t j = -n; j <= n; ++j) {
      const double q = R * R - d * d * static_cast<double>(i * i + j * j);
      if (q < 0.0) continue;
      const auto cap = static_cast<float>(R - std::sqrt(q));
      const float* tip = tips.row(row + i).data();
      for (std::ptrdiff_t c = std::max<std::ptrdiff_t>(0, -j); c < std::min(cols, cols - j); ++c)
        closing[static_cast<std::size_t>(c)] =
            std::min(closing[static_cast<std::size_t>(c)], tip[c + j] + cap);
    }
}

/// Improves on the best node around (x, y).
class Compass {
 public:
  Compass(const ModelField& design, DropCutter& cutter, double R)
      : cutter_(cutter),
        R_(R),
        x0_(design.x0.value()),
        x1_(design.x_mm(design.z_mm.cols() - 1)),
        y0_(design.y0.value()),
        y1_(design.y_mm(design.z_mm.rows() - 1)) {}

  /// Stops as soon as what is left is not above `enough`.
  [[nodiscard]] double least(double x, double y, double from_x, double from_y, double spacing,
                             double enough) {
    double px = from_x, py = from_y, best = closing(x, y, px, py);
    for (double step = 0.5 * spacing; step >= kFinestStep * spacing && best > enough;) {
      bool better = false;
      for (const auto& [dx, dy] : kRose) {
        const double qx = std::clamp(px + dx * step, x0_, x1_);
        const double qy = std::clamp(py + dy * step, y0_, y1_);
        const double here = closing(x, y, qx, qy);
        if (here >= best) continue;
        best = here, px = qx, py = qy;
        better = true;
        break;
      }
      if (!better) step *= 0.5;
    }
    return best;
  }

 private:
  [[nodiscard]] double closing(double x, double y, double px, double py) {
    const double q = R_ * R_ - (px - x) * (px - x) - (py - y) * (py - y);
    return q < 0.0 ? INFINITY : cutter_.drop(px, py).tip_mm + R_ - std::sqrt(q);
  }
  DropCutter& cutter_;
  double R_, x0_, x1_, y0_, y1_;
};

}  // namespace

Result<RestMap> map_rest(const ModelField& design, BallNose ball, Millimetres threshold,
                         const RunContext& run) {
  const double R = ball.radius_mm, d = design.spacing.value();
  if (!(R >= 0.05 && R <= 100.0))
    return fail(kRestOptionOutOfRange,
                fmt::format("ball_radius is {} mm; it must be from 0.05 to 100 mm", R));
  if (!(threshold.value() > 0.0 && threshold.value() <= 100.0))
    return fail(kRestOptionOutOfRange,
                fmt::format("threshold is {} mm; it must be above 0 and at most 100 mm",
                            threshold.value()));
  for (std::ptrdiff_t r = 0; r < design.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < design.z_mm.cols(); ++c)
      if (!std::isfinite(design.z_mm(r, c)))
        return fail(kHeightNotFinite,
                    fmt::format("height is {} at row {}, column {} (x = {} mm, y = {} mm); fill "
                                "voids before milling",
                                design.z_mm(r, c), r, c, design.x_mm(c), design.y_mm(r)));
  const DropCutter cutter(design, Cutter::ball(R));
  const std::ptrdiff_t rows = design.z_mm.rows(), cols = design.z_mm.cols();
  Grid<float> tips(rows, cols);
  for_rows(rows, cutter, run, [&](std::ptrdiff_t r, DropCutter& here) {
    for (std::ptrdiff_t c = 0; c < cols; ++c)
      tips(r, c) = static_cast<float>(here.drop(design.x_mm(c), design.y_mm(r)).tip_mm);
  });
  if (run.stopped()) return fail(kCancelled, "stopped while mapping what stays");
  run.progress(0.3);

  RestMap map;
  map.threshold_mm = threshold.value();
  map.remaining = design;
  const auto n = static_cast<std::ptrdiff_t>(R / d);
  for_rows(rows, cutter, run, [&](std::ptrdiff_t r, DropCutter& here) {
    const std::span<float> row = map.remaining.z_mm.row(r);
    close_row(tips, r, d, R, row);
    Compass compass(design, here, R);
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      const double h = static_cast<double>(design.z_mm(r, c));
      double closing = static_cast<double>(row[static_cast<std::size_t>(c)]);
      if (closing - h > threshold.value()) {
        double best = INFINITY;
        std::ptrdiff_t at_r = r, at_c = c;
        for (std::ptrdiff_t i = std::max<std::ptrdiff_t>(0, r - n); i <= std::min(rows - 1, r + n);
             ++i)
          for (std::ptrdiff_t j = std::max<std::ptrdiff_t>(0, c - n);
               j <= std::min(cols - 1, c + n); ++j) {
            const double q =
                R * R - d * d * static_cast<double>((i - r) * (i - r) + (j - c) * (j - c));
            if (q < 0.0) continue;
            const double here_mm = static_cast<double>(tips(i, j)) + R - std::sqrt(q);
            if (here_mm < best) best = here_mm, at_r = i, at_c = j;
          }
        closing = compass.least(design.x_mm(c), design.y_mm(r), design.x_mm(at_c),
                                design.y_mm(at_r), d, h + 0.2 * threshold.value());
      }
      row[static_cast<std::size_t>(c)] = static_cast<float>(std::max(0.0, closing - h));
    }
  });
  if (run.stopped()) return fail(kCancelled, "stopped while mapping what stays");
  for (const float z : map.remaining.z_mm.cells()) {
    const auto left = static_cast<double>(z);
    map.highest_mm = std::max(map.highest_mm, left);
    if (left <= map.threshold_mm) continue;
    map.area_mm2 += d * d;
    map.volume_mm3 += d * d * left;
  }
  run.progress(1.0);
  return map;
}

}  // namespace maquette::cnc

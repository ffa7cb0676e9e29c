// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file milled_stock.hpp
/// The slow way to mill: points of stock, and a cutter put down on them every few hundredths
/// of a millimetre along every move. Shares no code with what it judges.

#include <algorithm>
#include <cmath>
#include <functional>

#include "cnc/tool.hpp"
#include "cnc/toolpath.hpp"
#include "core/grid.hpp"

namespace maquette::testing_support {

class MilledStock {
 public:
  /// Points at x0 + c step, y0 + r step. -INFINITY: no stock there.
  MilledStock(double x0, double y0, double step, std::ptrdiff_t rows, std::ptrdiff_t cols,
              const std::function<double(double, double)>& top)
      : x0_(x0), y0_(y0), step_(step), z_(rows, cols) {
    for (std::ptrdiff_t r = 0; r < rows; ++r)
      for (std::ptrdiff_t c = 0; c < cols; ++c) z_(r, c) = top(x(c), y(r));
  }
  [[nodiscard]] double x(std::ptrdiff_t c) const { return x0_ + step_ * static_cast<double>(c); }
  [[nodiscard]] double y(std::ptrdiff_t r) const { return y0_ + step_ * static_cast<double>(r); }
  [[nodiscard]] const Grid<double>& z() const { return z_; }

  /// What was seen on the way.
  double deepest_rapid = 0.0;       ///< mm taken off by rapids
  double steepest_entry_deg = 0.0;  ///< of moves that go down and take something

  double cut_length = 0.0, air_length = 0.0;

  /// Lines and rapids only.
  void mill(const cnc::Toolpath& path, const cnc::Cutter& cutter, double along = 0.1) {
    cnc::ToolPosition at = path.start;
    for (const cnc::PathMove& m : path.moves) {
      const double ax = tick(at.x), ay = tick(at.y), az = tick(at.z);
      const double bx = tick(m.to.x), by = tick(m.to.y), bz = tick(m.to.z);
      const double flat = std::hypot(bx - ax, by - ay), length = std::hypot(flat, bz - az);
      const int n = std::max(1, static_cast<int>(std::ceil(length / along)));
      double taken = 0.0;
      for (int k = 0; k <= n; ++k) {
        const double t = static_cast<double>(k) / n;
        const double here = put(ax + t * (bx - ax), ay + t * (by - ay), az + t * (bz - az), cutter);
        taken = std::max(taken, here);
        (here > 1e-9 ? cut_length : air_length) += length / (n + 1);
      }
      if (m.kind == cnc::PathMove::Kind::rapid) {
        deepest_rapid = std::max(deepest_rapid, taken);
      } else if (bz < az && taken > 1e-6) {
        steepest_entry_deg =
            std::max(steepest_entry_deg, std::atan2(az - bz, flat) * 57.29577951308232);
      }
      at = m.to;
    }
  }

 private:
  static double tick(std::int64_t v) { return static_cast<double>(v) * 1e-4; }

  /// Most that it takes off somewhere.
  double put(double px, double py, double pz, const cnc::Cutter& cutter) {
    const double R = cutter.radius_mm, r = cutter.corner_radius_mm;
    const auto span = [&](double v, double v0, std::ptrdiff_t n) {
      const auto from = static_cast<std::ptrdiff_t>(std::ceil((v - R - v0) / step_));
      const auto to = static_cast<std::ptrdiff_t>(std::floor((v + R - v0) / step_));
      return std::pair{std::max<std::ptrdiff_t>(0, from), std::min(n - 1, to)};
    };
    const auto [r0, r1] = span(py, y0_, z_.rows());
    const auto [c0, c1] = span(px, x0_, z_.cols());
    double most = 0.0;
    for (std::ptrdiff_t i = r0; i <= r1; ++i)
      for (std::ptrdiff_t j = c0; j <= c1; ++j) {
        const double d = std::hypot(x(j) - px, y(i) - py);
        if (d > R) continue;
        const double out = std::max(0.0, d - (R - r));
        const double under = pz + r - std::sqrt(std::max(0.0, r * r - out * out));
        if (z_(i, j) <= under) continue;
        most = std::max(most, z_(i, j) - under);
        z_(i, j) = under;
      }
    return most;
  }

  double x0_, y0_, step_;
  Grid<double> z_;
};

}  // namespace maquette::testing_support

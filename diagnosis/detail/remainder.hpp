// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// Is what a model leaves a stationary Gaussian process, or is there more to it?

#include <vector>

#include "diagnosis/detail/sums.hpp"
#include "diagnosis/diagnose.hpp"

namespace maquette::diagnosis::detail {

/// Squares of the plan that are out of line.
struct Squares {
  double x0 = 0.0, y0 = 0.0, side = 1.0;
  Grid<std::uint8_t> in;
  [[nodiscard]] bool holds(double x, double y) const {
    const auto c = static_cast<std::ptrdiff_t>(std::floor((x - x0) / side)),
               r = static_cast<std::ptrdiff_t>(std::floor((y - y0) / side));
    return in.contains(r, c) && in(r, c) != 0;
  }
  [[nodiscard]] std::size_t count() const {
    std::size_t n = 0;
    for (const auto v : in.cells()) n += v;
    return n;
  }
};

/// Four looks at the map of mean residuals in squares of a quarter and half a cell, each against
/// what a stationary Gaussian process gives less than once in ten thousand cases:
///   lonely places  largest value over the robust spread
///   edges          largest steps between neighbours over their robust spread
///   a wave         largest line of the periodogram over its ring, of more than ridges leave
///   rings          a ring of the periodogram above its neighbours, the same
/// and two at the process itself:
///   more unevenness than blocks have
///   scans that differ by something smooth
/// A place, or a step to its neighbour, that hangs on one point is none.
[[nodiscard]] Remainder judge(const std::vector<Observation>& all,
                              const std::vector<double>& residual, const Layout& layout,
                              const Bank& bank, const Fit& fit, Squares& odd);

}  // namespace maquette::diagnosis::detail

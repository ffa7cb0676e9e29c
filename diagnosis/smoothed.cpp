// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/smoothed.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include <oneapi/tbb/parallel_for.h>

namespace maquette::diagnosis::detail {

Grid<float> smoothed(const Grid<float>& z, double sigma_nodes) {
  const auto reach = static_cast<std::ptrdiff_t>(std::ceil(3.5 * sigma_nodes));
  std::vector<double> kernel(static_cast<std::size_t>(2 * reach + 1));
  for (std::ptrdiff_t i = -reach; i <= reach; ++i) {
    const double u = static_cast<double>(i) / std::fmax(sigma_nodes, 1e-3);
    kernel[static_cast<std::size_t>(i + reach)] = std::exp(-0.5 * u * u);
  }
  // Kernel outside, nodes inside: the compiler takes eight nodes at once.
  const auto pass = [&](const Grid<float>& in, bool along_rows) {
    Grid<float> out(in.rows(), in.cols(), NAN);
    const std::ptrdiff_t cols = in.cols();
    oneapi::tbb::parallel_for(std::ptrdiff_t{0}, in.rows(), [&](std::ptrdiff_t r) {
      std::vector<double> sum(static_cast<std::size_t>(cols), 0.0), weight = sum;
      for (std::ptrdiff_t k = -reach; k <= reach; ++k) {
        const std::ptrdiff_t rr = along_rows ? r : r + k, shift = along_rows ? k : 0;
        if (rr < 0 || rr >= in.rows()) continue;
        const std::ptrdiff_t first = std::max<std::ptrdiff_t>(0, -shift),
                             end = std::min(cols, cols - shift);
        if (first >= end) continue;
        const double w = kernel[static_cast<std::size_t>(k + reach)];
        const float* v = &in(rr, first + shift);
        double *s = &sum[static_cast<std::size_t>(first)],
               *of = &weight[static_cast<std::size_t>(first)];
        for (std::ptrdiff_t c = 0; c < end - first; ++c) {
          const bool known = !std::isnan(v[c]);
          s[c] += w * (known ? static_cast<double>(v[c]) : 0.0);
          of[c] += known ? w : 0.0;
        }
      }
      for (std::ptrdiff_t c = 0; c < cols; ++c) {
        const auto i = static_cast<std::size_t>(c);
        if (weight[i] > 0.0) out(r, c) = static_cast<float>(sum[i] / weight[i]);
      }
    });
    return out;
  };
  return pass(pass(z, true), false);
}

}  // namespace maquette::diagnosis::detail

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
  const auto pass = [&](const Grid<float>& in, bool along_rows) {
    Grid<float> out(in.rows(), in.cols(), NAN);
    oneapi::tbb::parallel_for(std::ptrdiff_t{0}, in.rows(), [&](std::ptrdiff_t r) {
      for (std::ptrdiff_t c = 0; c < in.cols(); ++c) {
        double sum = 0.0, weight = 0.0;
        for (std::ptrdiff_t k = -reach; k <= reach; ++k) {
          const std::ptrdiff_t rr = along_rows ? r : r + k, cc = along_rows ? c + k : c;
          if (!in.contains(rr, cc)) continue;
          const float v = in(rr, cc);
          if (std::isnan(v)) continue;
          sum += kernel[static_cast<std::size_t>(k + reach)] * static_cast<double>(v);
          weight += kernel[static_cast<std::size_t>(k + reach)];
        }
        if (weight > 0.0) out(r, c) = static_cast<float>(sum / weight);
      }
    });
    return out;
  };
  return pass(pass(z, true), false);
}

}  // namespace maquette::diagnosis::detail

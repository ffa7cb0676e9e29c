// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/smoothed.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <oneapi/tbb/parallel_for.h>

namespace maquette::diagnosis::detail {
namespace {

/// Nodes whose sums stay in registers while the kernel passes over them.
constexpr std::ptrdiff_t kAtOnce = 32;

/// Heights, 0 where none is known, and whether one is, with as many empty nodes beside each row as
/// the kernel and the last nodes at once may reach.
struct Known {
  std::ptrdiff_t rows = 0, cols = 0, reach = 0, stride = 0;
  std::vector<float> value, is_known;
  [[nodiscard]] std::ptrdiff_t at(std::ptrdiff_t r, std::ptrdiff_t c) const {
    return r * stride + reach + c;
  }
};

Known empty(std::ptrdiff_t rows, std::ptrdiff_t cols, std::ptrdiff_t reach) {
  Known k{rows, cols, reach, 2 * reach + (cols + kAtOnce - 1) / kAtOnce * kAtOnce, {}, {}};
  k.value.resize(static_cast<std::size_t>(rows * k.stride), 0.0F);
  k.is_known = k.value;
  return k;
}

/// Weighted means along rows or columns; not known where nothing known is within reach of the
/// kernel.
void average(const Known& in, const std::vector<float>& kernel, bool along_rows, Known& out) {
  const auto reach = static_cast<std::ptrdiff_t>(kernel.size() / 2);
  const std::ptrdiff_t step = along_rows ? 1 : in.stride;
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, in.rows, [&](std::ptrdiff_t r) {
    const std::ptrdiff_t first = along_rows ? -reach : std::max(-reach, -r),
                         last = along_rows ? reach : std::min(reach, in.rows - 1 - r);
    for (std::ptrdiff_t c = 0; c < in.cols; c += kAtOnce) {
      std::array<float, kAtOnce> sum{}, weight{};
      for (std::ptrdiff_t k = first; k <= last; ++k) {
        const float w = kernel[static_cast<std::size_t>(k + reach)];
        const float *v = in.value.data() + in.at(r, c) + k * step,
                    *known = in.is_known.data() + in.at(r, c) + k * step;
        for (std::size_t i = 0; i < kAtOnce; ++i) {
          sum[i] += w * v[i];
          weight[i] += w * known[i];
        }
      }
      const auto n = static_cast<std::size_t>(std::min(kAtOnce, in.cols - c));
      for (std::size_t i = 0; i < n; ++i) {
        const auto to = static_cast<std::size_t>(out.at(r, c)) + i;
        out.is_known[to] = weight[i] > 0.0F ? 1.0F : 0.0F;
        out.value[to] = weight[i] > 0.0F ? sum[i] / weight[i] : 0.0F;
      }
    }
  });
}

}  // namespace

std::vector<Grid<float>> smoothed(const Grid<float>& z, std::span<const double> sigmas_nodes) {
  const auto reach_of = [](double sigma) {
    return static_cast<std::ptrdiff_t>(std::ceil(3.5 * sigma));
  };
  const double widest = std::ranges::max(sigmas_nodes);
  Known of = empty(z.rows(), z.cols(), reach_of(widest)), along_rows = of, both = of;
  for (std::ptrdiff_t r = 0; r < z.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < z.cols(); ++c)
      if (const auto to = static_cast<std::size_t>(of.at(r, c)); !std::isnan(z(r, c))) {
        of.value[to] = z(r, c);
        of.is_known[to] = 1.0F;
      }
  std::vector<Grid<float>> all;
  for (const double sigma : sigmas_nodes) {
    const std::ptrdiff_t reach = reach_of(sigma);
    std::vector<float> kernel;
    for (std::ptrdiff_t i = -reach; i <= reach; ++i) {
      const double u = static_cast<double>(i) / std::fmax(sigma, 1e-3);
      kernel.push_back(static_cast<float>(std::exp(-0.5 * u * u)));
    }
    average(of, kernel, true, along_rows);
    average(along_rows, kernel, false, both);
    Grid<float>& out = all.emplace_back(z.rows(), z.cols(), NAN);
    for (std::ptrdiff_t r = 0; r < z.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < z.cols(); ++c)
        if (const auto from = static_cast<std::size_t>(both.at(r, c)); both.is_known[from] > 0.0F)
          out(r, c) = both.value[from];
  }
  return all;
}

}  // namespace maquette::diagnosis::detail

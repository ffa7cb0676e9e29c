// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/fourier.hpp"

#include <algorithm>

#include <oneapi/tbb/parallel_for.h>
#include <unsupported/Eigen/FFT>

namespace maquette::heightmap::detail {
namespace {

constexpr std::ptrdiff_t kAtOnce = 16;  // columns: neighbours share a line of the cache

void line(std::vector<std::complex<float>>& values, bool forward) {
  thread_local Eigen::FFT<float> fft;
  thread_local std::vector<std::complex<float>> out;
  if (forward)
    fft.fwd(out, values);
  else
    fft.inv(out, values);
  values.swap(out);
}

}  // namespace

void fourier(std::vector<std::complex<float>>& a, std::ptrdiff_t n, bool forward) {
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, n, [&](std::ptrdiff_t r) {
    thread_local std::vector<std::complex<float>> row;
    row.assign(a.begin() + r * n, a.begin() + (r + 1) * n);
    line(row, forward);
    std::copy(row.begin(), row.end(), a.begin() + r * n);
  });
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, (n + kAtOnce - 1) / kAtOnce, [&](std::ptrdiff_t b) {
    const std::ptrdiff_t first = b * kAtOnce, many = std::min(kAtOnce, n - first);
    thread_local std::vector<std::vector<std::complex<float>>> columns(kAtOnce);
    for (auto& column : columns) column.resize(static_cast<std::size_t>(n));
    for (std::ptrdiff_t r = 0; r < n; ++r)
      for (std::ptrdiff_t k = 0; k < many; ++k)
        columns[static_cast<std::size_t>(k)][static_cast<std::size_t>(r)] =
            a[static_cast<std::size_t>(r * n + first + k)];
    for (std::ptrdiff_t k = 0; k < many; ++k) line(columns[static_cast<std::size_t>(k)], forward);
    for (std::ptrdiff_t r = 0; r < n; ++r)
      for (std::ptrdiff_t k = 0; k < many; ++k)
        a[static_cast<std::size_t>(r * n + first + k)] =
            columns[static_cast<std::size_t>(k)][static_cast<std::size_t>(r)];
  });
}

std::ptrdiff_t smooth_size(std::ptrdiff_t n) {
  for (;; ++n) {
    std::ptrdiff_t left = n;
    for (const std::ptrdiff_t p : {2, 3, 5})
      while (left % p == 0) left /= p;
    if (left == 1) return n;
  }
}

}  // namespace maquette::heightmap::detail

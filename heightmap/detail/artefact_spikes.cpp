// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <array>
#include <cmath>

#include <oneapi/tbb/parallel_for.h>

#include "heightmap/detail/artefact_finders.hpp"

namespace maquette::heightmap::detail {
namespace {

constexpr std::ptrdiff_t kTile = 32;
constexpr float kClear = 10.0F;   // deviations
constexpr float kShared = 0.35F;  // of its height that neighbours may have of a spike

/// Height less the median of the pixels at most two away; NaN where fewer than twelve are there.
Grid<float> off_median(const Grid<float>& h) {
  Grid<float> off(h.rows(), h.cols(), NAN);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, h.rows(), [&](std::ptrdiff_t r) {
    std::vector<float> around;
    for (std::ptrdiff_t c = 0; c < h.cols(); ++c) {
      if (std::isnan(h(r, c))) continue;
      around.clear();
      for (std::ptrdiff_t i = std::max<std::ptrdiff_t>(0, r - 2); i < std::min(h.rows(), r + 3);
           ++i)
        for (std::ptrdiff_t j = std::max<std::ptrdiff_t>(0, c - 2); j < std::min(h.cols(), c + 3);
             ++j)
          if ((i != r || j != c) && !std::isnan(h(i, j))) around.push_back(h(i, j));
      if (around.size() >= 12) off(r, c) = h(r, c) - median_of(around);
    }
  });
  return off;
}

/// Deviation of `off` in a tile and the half tile around it.
Grid<float> deviations(const Grid<float>& off) {
  Grid<float> out((off.rows() + kTile - 1) / kTile, (off.cols() + kTile - 1) / kTile);
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, out.rows(), [&](std::ptrdiff_t tr) {
    std::vector<float> size;
    for (std::ptrdiff_t tc = 0; tc < out.cols(); ++tc) {
      size.clear();
      const std::ptrdiff_t r0 = tr * kTile - kTile / 2, c0 = tc * kTile - kTile / 2;
      for (std::ptrdiff_t r = std::max<std::ptrdiff_t>(0, r0);
           r < std::min(off.rows(), r0 + 2 * kTile); ++r)
        for (std::ptrdiff_t c = std::max<std::ptrdiff_t>(0, c0);
             c < std::min(off.cols(), c0 + 2 * kTile); ++c)
          if (!std::isnan(off(r, c))) size.push_back(std::abs(off(r, c)));
      out(tr, tc) = size.size() < 50 ? INFINITY : kNormal * median_of(size);
    }
  });
  return out;
}

}  // namespace

std::vector<Spike> find_spikes(const Grid<float>& h) {
  const Grid<float> off = off_median(h);
  const Grid<float> deviation = deviations(off);
  const auto clear = [&](std::ptrdiff_t r, std::ptrdiff_t c) {
    return off.contains(r, c) &&
           std::abs(off(r, c)) > kClear * deviation(r / kTile, c / kTile) + 1e-6F;
  };
  std::vector<Spike> found;
  for (std::ptrdiff_t r = 0; r < h.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < h.cols(); ++c) {
      if (!clear(r, c)) continue;
      // Of the pixels next to it those of the same spike are few, and the others do not rise.
      int many = 0, rising = 0;
      for (std::ptrdiff_t i = -2; i <= 2; ++i)
        for (std::ptrdiff_t j = -2; j <= 2; ++j) {
          if ((i == 0 && j == 0) || !off.contains(r + i, c + j)) continue;
          if (clear(r + i, c + j))
            ++many;
          else if (off(r + i, c + j) / off(r, c) > kShared)
            ++rising;
        }
      if (many <= 3 && rising <= 1) found.push_back({r, c, off(r, c)});
    }
  return found;
}

}  // namespace maquette::heightmap::detail

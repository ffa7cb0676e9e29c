// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <vector>

#include <oneapi/tbb/parallel_for.h>

#include "heightmap/detail/artefact_finders.hpp"

namespace maquette::heightmap::detail {
namespace {

constexpr float kMost = 8.0F;         // deviations
constexpr std::ptrdiff_t kSide = 16;  // pixels, where means along a side are compared with white

float step(float before2, float before, float here, float after) {
  return 1.5F * (here - before) + 0.5F * (before2 - after);
}

float deviation_of(std::vector<float>& v) {
  if (v.empty()) return 0.0F;
  for (float& x : v) x = std::abs(x);
  return kNormal * median_of(v);
}

/// Deviation of means of `side` steps along rows (or columns) over the whole, in units of one's.
double alike_of(const Steps& s) {
  std::vector<float> one, many;
  const auto add = [&](const Grid<float>& g, bool along_columns) {
    const std::ptrdiff_t lines = along_columns ? g.cols() : g.rows();
    const std::ptrdiff_t length = along_columns ? g.rows() : g.cols();
    for (std::ptrdiff_t l = 0; l < lines; l += 3)
      for (std::ptrdiff_t k = 0; k + kSide <= length; k += kSide) {
        float sum = 0.0F;
        int count = 0;
        for (std::ptrdiff_t i = k; i < k + kSide; ++i) {
          const std::ptrdiff_t r = along_columns ? i : l, c = along_columns ? l : i;
          const float v = g(r, c) / std::max(1e-9F, static_cast<float>(s.scale_at(r, c)));
          if (v == 0.0F) continue;
          sum += v;
          ++count;
          one.push_back(v);
        }
        if (count == kSide) many.push_back(sum / static_cast<float>(kSide));
      }
  };
  add(s.across_columns, true);
  add(s.across_rows, false);
  if (many.size() < 50) return 1.0;
  return std::max(1.0, 4.0 * static_cast<double>(deviation_of(many)) /
                           std::max(1e-9, static_cast<double>(deviation_of(one))));
}

}  // namespace

Steps steps_of(const Grid<float>& h) {
  Steps s{Grid<float>(h.rows(), h.cols(), 0.0F), Grid<float>(h.rows(), h.cols(), 0.0F),
          Grid<float>((h.rows() + Steps::kTile - 1) / Steps::kTile,
                      (h.cols() + Steps::kTile - 1) / Steps::kTile, 0.0F),
          1.0};
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, h.rows(), [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < h.cols(); ++c) {
      if (c >= 2 && c + 1 < h.cols()) {
        const float v = step(h(r, c - 2), h(r, c - 1), h(r, c), h(r, c + 1));
        if (!std::isnan(v)) s.across_columns(r, c) = v;
      }
      if (r >= 2 && r + 1 < h.rows()) {
        const float v = step(h(r - 2, c), h(r - 1, c), h(r, c), h(r + 1, c));
        if (!std::isnan(v)) s.across_rows(r, c) = v;
      }
    }
  });
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, s.scale_m.rows(), [&](std::ptrdiff_t tr) {
    std::vector<float> in;
    for (std::ptrdiff_t tc = 0; tc < s.scale_m.cols(); ++tc) {
      const std::ptrdiff_t r0 = tr * Steps::kTile, c0 = tc * Steps::kTile;
      in.clear();
      // The tile and half of its neighbours.
      for (std::ptrdiff_t r = std::max<std::ptrdiff_t>(0, r0 - Steps::kTile / 2);
           r < std::min(h.rows(), r0 + 3 * Steps::kTile / 2); ++r)
        for (std::ptrdiff_t c = std::max<std::ptrdiff_t>(0, c0 - Steps::kTile / 2);
             c < std::min(h.cols(), c0 + 3 * Steps::kTile / 2); ++c)
          for (const float v : {s.across_columns(r, c), s.across_rows(r, c)})
            if (v != 0.0F) in.push_back(v);
      s.scale_m(tr, tc) = std::max(1e-6F, deviation_of(in));
    }
  });
  for (std::ptrdiff_t r = 0; r < h.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < h.cols(); ++c) {
      const float most = kMost * static_cast<float>(s.scale_at(r, c));
      s.across_columns(r, c) = std::clamp(s.across_columns(r, c), -most, most);
      s.across_rows(r, c) = std::clamp(s.across_rows(r, c), -most, most);
    }
  s.alike = alike_of(s);
  return s;
}

}  // namespace maquette::heightmap::detail

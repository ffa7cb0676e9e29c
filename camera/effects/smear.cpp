// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/smear.hpp"

#include <tbb/parallel_for.h>

namespace maquette::camera {

Result<void> check(const Smear& e, const Shot&) {
  return in_range("smear", "row_shift_s", e.row_shift_s, 0.0, 1.0);
}

void apply(const Smear& e, const Shot& shot, Frame& frame) {
  const double share = e.row_shift_s / shot.exposure_s;
  if (share <= 0.0) return;
  constexpr std::ptrdiff_t kStrip = 64;  // columns; their sums in the order of the rows
  for (Grid<float>& band : frame.bands)
    tbb::parallel_for(std::ptrdiff_t{0}, (band.cols() + kStrip - 1) / kStrip, [&](auto strip) {
      const std::ptrdiff_t from = strip * kStrip, to = std::min(from + kStrip, band.cols());
      std::array<double, kStrip> sum{};
      for (std::ptrdiff_t r = 0; r < band.rows(); ++r)
        for (std::ptrdiff_t c = from; c < to; ++c)
          sum[static_cast<std::size_t>(c - from)] += static_cast<double>(band(r, c));
      for (std::ptrdiff_t r = 0; r < band.rows(); ++r)
        for (std::ptrdiff_t c = from; c < to; ++c) {
          const double own = static_cast<double>(band(r, c));
          band(r, c) =
              static_cast<float>(own + share * (sum[static_cast<std::size_t>(c - from)] - own));
        }
    });
}

}  // namespace maquette::camera

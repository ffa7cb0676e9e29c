// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/full_well.hpp"

#include <algorithm>

#include <tbb/parallel_for.h>

namespace maquette::camera {
namespace {

/// Charge of `flow` pixels goes one way until wells have room. `flow[i]`: what overflows at i.
/// @return what leaves at the end
double pour(std::span<double> column, std::span<const double> flow, double well, bool upwards) {
  double carried = 0.0;
  const std::size_t n = column.size();
  for (std::size_t k = 0; k < n; ++k) {
    const std::size_t i = upwards ? n - 1 - k : k;
    if (carried > 0.0) {
      const double taken = std::min(carried, std::max(0.0, well - column[i]));
      column[i] += taken;
      carried -= taken;
    }
    carried += flow[i];
  }
  return carried;
}

}  // namespace

LostCharge spill(std::span<double> column, double full_well_e, double blooming_share) {
  LostCharge lost;
  std::vector<double> half(column.size(), 0.0);
  bool any = false;
  for (std::size_t i = 0; i < column.size(); ++i) {
    const double excess = column[i] - full_well_e;
    if (!(excess > 0.0)) continue;
    column[i] = full_well_e;
    half[i] = 0.5 * blooming_share * excess;
    lost.drained_e += (1.0 - blooming_share) * excess;
    any = true;
  }
  if (!any || blooming_share <= 0.0) return lost;
  lost.ends_e += pour(column, half, full_well_e, false);
  lost.ends_e += pour(column, half, full_well_e, true);
  return lost;
}

Result<void> check(const FullWell& e, const Shot&) {
  return in_range("full_well", "blooming_share", e.blooming_share, 0.0, 1.0);
}

void apply(const FullWell& e, const Shot& shot, Frame& frame) {
  const auto well = static_cast<float>(shot.full_well_e);
  for (Grid<float>& band : frame.bands) {
    if (e.blooming_share <= 0.0) {
      tbb::parallel_for(std::ptrdiff_t{0}, band.rows(), [&](std::ptrdiff_t r) {
        for (float& v : band.row(r)) v = std::min(v, well);
      });
      continue;
    }
    constexpr std::ptrdiff_t kStrip = 64;  // columns that are looked at together: cache lines
    tbb::parallel_for(std::ptrdiff_t{0}, (band.cols() + kStrip - 1) / kStrip, [&](auto strip) {
      const std::ptrdiff_t from = strip * kStrip, to = std::min(from + kStrip, band.cols());
      std::array<bool, kStrip> over{};
      for (std::ptrdiff_t r = 0; r < band.rows(); ++r)
        for (std::ptrdiff_t c = from; c < to; ++c)
          over[static_cast<std::size_t>(c - from)] |= band(r, c) > well;
      std::vector<double> column(static_cast<std::size_t>(band.rows()));
      for (std::ptrdiff_t c = from; c < to; ++c) {
        if (!over[static_cast<std::size_t>(c - from)]) continue;
        for (std::size_t r = 0; r < column.size(); ++r)
          column[r] = static_cast<double>(band(static_cast<std::ptrdiff_t>(r), c));
        (void)spill(column, shot.full_well_e, e.blooming_share);
        for (std::size_t r = 0; r < column.size(); ++r)
          band(static_cast<std::ptrdiff_t>(r), c) = static_cast<float>(column[r]);
      }
    });
  }
}

}  // namespace maquette::camera

// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/effects/veiling_glare.hpp"

#include <tbb/parallel_for.h>

namespace maquette::camera {

Result<void> check(const VeilingGlare& e, const Shot&) {
  return in_range("veiling_glare", "share", e.share, 0.0, 1.0);
}

void apply(const VeilingGlare& e, const Shot&, Frame& frame) {
  if (e.share <= 0.0) return;
  const auto stays = static_cast<float>(1.0 - e.share);
  for (Grid<float>& band : frame.bands) {
    // Row by row in a fixed order: the same sum for any number of threads.
    std::vector<double> sums(static_cast<std::size_t>(band.rows()));
    tbb::parallel_for(std::ptrdiff_t{0}, band.rows(), [&](std::ptrdiff_t r) {
      std::array<double, 8> part{};
      const auto row = band.row(r);
      for (std::size_t c = 0; c < row.size(); ++c) part[c & 7] += static_cast<double>(row[c]);
      for (const double p : part) sums[static_cast<std::size_t>(r)] += p;
    });
    double sum = 0.0;
    for (const double s : sums) sum += s;
    const auto veil = static_cast<float>(e.share * sum / static_cast<double>(band.cells().size()));
    tbb::parallel_for(std::ptrdiff_t{0}, band.rows(), [&](std::ptrdiff_t r) {
      for (float& v : band.row(r)) v = stays * v + veil;
    });
  }
}

}  // namespace maquette::camera

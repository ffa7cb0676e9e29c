// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/expected_surface.hpp"

#include <algorithm>
#include <cmath>

#include <oneapi/tbb/parallel_for.h>

#include "core/check.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;

/// First and last node of a row or column of `n` nodes that lie within half of `reach` of `at`.
struct Range {
  std::ptrdiff_t first, last;
};
Range nodes_within(double at, double reach, double begin, double spacing, std::ptrdiff_t n) {
  constexpr double kSlack = 1e-6;  // of a spacing: nodes of both grids may coincide
  const double low = (at - 0.5 * reach - begin) / spacing;
  const double high = (at + 0.5 * reach - begin) / spacing;
  return {std::max<std::ptrdiff_t>(0, std::lround(std::ceil(low - kSlack))),
          std::min<std::ptrdiff_t>(n - 1, std::lround(std::floor(high + kSlack)))};
}

double excess_at(const ModelField& cut, const ModelField& ground, double x, double y) {
  const double s = ground.spacing.value(), fine = cut.spacing.value();
  const Range c = nodes_within(x, s, cut.x0.value(), fine, cut.z_mm.cols());
  const Range r = nodes_within(y, s, cut.y0.value(), fine, cut.z_mm.rows());
  double sum = 0.0, n = 0.0;
  for (std::ptrdiff_t i = r.first; i <= r.last; ++i)
    for (std::ptrdiff_t j = c.first; j <= c.last; ++j) {
      const double excess = static_cast<double>(cut.z_mm(i, j)) -
                            heightmap::height_at(ground, cut.x_mm(j), cut.y_mm(i));
      if (std::isnan(excess)) continue;
      sum += excess;
      n += 1.0;
    }
  if (n > 0.0) return sum / n;
  // Coarser than the design, or a void: what is straight above.
  const double excess = heightmap::height_at(cut, x, y) - heightmap::height_at(ground, x, y);
  return std::isnan(excess) ? 0.0 : excess;
}

/// 1 / n_z by differences to the neighbours that are there.
double lengthening(const Grid<float>& z, std::ptrdiff_t r, std::ptrdiff_t c, double spacing) {
  const auto slope = [&](std::ptrdiff_t dr, std::ptrdiff_t dc) {
    const auto h = [&](std::ptrdiff_t k) {
      return z.contains(r + k * dr, c + k * dc) ? static_cast<double>(z(r + k * dr, c + k * dc))
                                                : NAN;
    };
    const double back = h(-1), here = h(0), ahead = h(1);
    if (!std::isnan(back) && !std::isnan(ahead)) return 0.5 * (ahead - back) / spacing;
    if (!std::isnan(ahead)) return (ahead - here) / spacing;
    return std::isnan(back) ? 0.0 : (here - back) / spacing;
  };
  return std::hypot(1.0, slope(0, 1), slope(1, 0));
}

}  // namespace

ModelField expected_surface(const ModelField& design, const ModelField& ground,
                            const ModelField* as_milled, Millimetres coat) {
  const std::ptrdiff_t rows = design.z_mm.rows(), cols = design.z_mm.cols();
  MAQUETTE_CHECK(
      ground.z_mm.rows() == rows && ground.z_mm.cols() == cols && ground.spacing == design.spacing,
      "ground of {} x {} nodes, design of {} x {}", ground.z_mm.rows(), ground.z_mm.cols(), rows,
      cols);
  ModelField bare = design;
  if (as_milled != nullptr)
    oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
      for (std::ptrdiff_t c = 0; c < cols; ++c)
        if (design.z_mm(r, c) == ground.z_mm(r, c))  // no stone; false for a void
          bare.z_mm(r, c) +=
              static_cast<float>(excess_at(*as_milled, ground, design.x_mm(c), design.y_mm(r)));
    });
  if (coat.value() == 0.0) return bare;
  ModelField coated = bare;
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows, [&](std::ptrdiff_t r) {
    for (std::ptrdiff_t c = 0; c < cols; ++c)
      coated.z_mm(r, c) +=
          static_cast<float>(coat.value() * lengthening(bare.z_mm, r, c, design.spacing.value()));
  });
  return coated;
}

}  // namespace maquette::scan

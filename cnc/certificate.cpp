// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/certificate.hpp"

#include <cmath>
#include <limits>

#include <tbb/blocked_range.h>
#include <tbb/parallel_for.h>

namespace maquette::cnc {
namespace {

constexpr std::size_t kWorstPlaces = 10;

struct Gouge {
  float depth_mm;
  std::int32_t row, col;
};

/// Figures of one band of nodes; added up in the order of the bands.
struct Band {
  double sum = 0.0, sum_of_squares = 0.0;
  double max_gouge = 0.0, max_excess = 0.0, max_with_bound = 0.0, max_fallback = 0.0;
  std::uint64_t gouged = 0;
  std::vector<Gouge> gouges;  // the deepest of each block
};

/// Steepest of the two facets of a design cell.
double steepest_facet(const Grid<float>& z, std::ptrdiff_t r, std::ptrdiff_t c, double spacing) {
  const double z00 = z(r, c), z10 = z(r, c + 1), z01 = z(r + 1, c), z11 = z(r + 1, c + 1);
  return std::fmax(std::hypot(z10 - z00, z11 - z10), std::hypot(z11 - z01, z01 - z00)) / spacing;
}

/// Deepest first, at least a ball's radius apart.
std::vector<Place> worst_places(const heightmap::ModelField& field, std::vector<Gouge> gouges,
                                double apart_mm) {
  std::sort(gouges.begin(), gouges.end(), [](const Gouge& a, const Gouge& b) {
    if (a.depth_mm != b.depth_mm) return a.depth_mm > b.depth_mm;
    return a.row != b.row ? a.row < b.row : a.col < b.col;
  });
  std::vector<Place> worst;
  for (const Gouge& gouge : gouges) {
    if (worst.size() == kWorstPlaces) break;
    const Place place{field.x_mm(gouge.col), field.y_mm(gouge.row),
                      static_cast<double>(gouge.depth_mm)};
    const bool close = std::any_of(worst.begin(), worst.end(), [&](const Place& p) {
      return std::hypot(p.x_mm - place.x_mm, p.y_mm - place.y_mm) < apart_mm;
    });
    if (!close) worst.push_back(place);
  }
  return worst;
}

}  // namespace

double gouge_between_nodes_mm(double slope, double cell_mm, double ball_radius_mm) {
  const double contact = ball_radius_mm * slope / std::sqrt(1.0 + slope * slope);
  const double farthest = contact + std::sqrt(2.0) * cell_mm;
  const double h2 = ball_radius_mm * ball_radius_mm - farthest * farthest;
  if (!(h2 > 0.0)) return INFINITY;
  const double curvature = ball_radius_mm * ball_radius_mm / (h2 * std::sqrt(h2));
  return 0.25 * curvature * cell_mm * cell_mm;
}

Result<void> compare(const heightmap::ModelField& design, const heightmap::ModelField& as_milled,
                     std::ptrdiff_t per_spacing, double ball_radius_mm, CutterError error,
                     Certificate& certificate, const RunContext& run) {
  const DividedDesign divided(design, per_spacing);
  const Grid<float>& z = design.z_mm;
  const Grid<float>& cut = as_milled.z_mm;
  const double spacing = design.spacing.value(), cell = as_milled.spacing.value();
  const std::ptrdiff_t k = per_spacing;
  const std::ptrdiff_t quad_rows = z.rows() - 1, quad_cols = z.cols() - 1;
  // A block is a whole number of design cells, about 64 nodes wide; a band is a row of them.
  const std::ptrdiff_t quads = std::max<std::ptrdiff_t>(1, 64 / k), block = quads * k;
  const std::ptrdiff_t block_rows = (quad_rows + quads - 1) / quads;
  const std::ptrdiff_t block_cols = (quad_cols + quads - 1) / quads;
  Grid<float> block_excess(block_rows, block_cols, 0.0F);
  std::vector<Band> bands(static_cast<std::size_t>(block_rows));

  tbb::parallel_for(std::ptrdiff_t{0}, block_rows, [&](std::ptrdiff_t br) {
    if (run.stopped()) return;
    Band& band = bands[static_cast<std::size_t>(br)];
    for (std::ptrdiff_t bc = 0; bc < block_cols; ++bc) {
      Gouge deepest{0.0F, 0, 0};
      double excess = 0.0;
      const std::ptrdiff_t r_end = std::min(quad_rows, (br + 1) * quads);
      const std::ptrdiff_t c_end = std::min(quad_cols, (bc + 1) * quads);
      for (std::ptrdiff_t qr = br * quads; qr < r_end; ++qr)
        for (std::ptrdiff_t qc = bc * quads; qc < c_end; ++qc) {
          double quad_gouge = -INFINITY;  // of the closed design cell
          for (std::ptrdiff_t i = 0; i <= k; ++i)
            for (std::ptrdiff_t j = 0; j <= k; ++j) {
              const std::ptrdiff_t row = qr * k + i, col = qc * k + j;
              const double over = static_cast<double>(cut(row, col)) - divided.at(row, col);
              quad_gouge = std::fmax(quad_gouge, -over);
              // A node between two design cells belongs to the later one.
              if ((i == k && qr + 1 < quad_rows) || (j == k && qc + 1 < quad_cols)) continue;
              band.sum += over;
              band.sum_of_squares += over * over;
              excess = std::fmax(excess, over);
              if (-over > kGougeListed_mm) ++band.gouged;
              if (-over > static_cast<double>(deepest.depth_mm))
                deepest = {static_cast<float>(-over), static_cast<std::int32_t>(row),
                           static_cast<std::int32_t>(col)};
              band.max_gouge = std::fmax(band.max_gouge, -over);
            }
          const double slope = steepest_facet(z, qr, qc, spacing);
          const double between = gouge_between_nodes_mm(slope, cell, ball_radius_mm);
          if (std::isfinite(between)) {
            // At the nodes around, the ball may be steeper than the facet: its slope there.
            const double contact =
                ball_radius_mm * slope / std::sqrt(1.0 + slope * slope) + std::sqrt(2.0) * cell;
            const double normal_length =
                ball_radius_mm / std::sqrt(ball_radius_mm * ball_radius_mm - contact * contact);
            band.max_with_bound =
                std::fmax(band.max_with_bound, quad_gouge + between + error.vertical_mm +
                                                   normal_length * error.sideways_mm);
          } else {
            // The steepest facet around, for the node that is asked may lie next door.
            double around = slope;
            for (std::ptrdiff_t i = std::max<std::ptrdiff_t>(0, qr - 1);
                 i <= std::min(quad_rows - 1, qr + 1); ++i)
              for (std::ptrdiff_t j = std::max<std::ptrdiff_t>(0, qc - 1);
                   j <= std::min(quad_cols - 1, qc + 1); ++j)
                around = std::fmax(around, steepest_facet(z, i, j, spacing));
            const double reach = std::sqrt(2.0) * cell + error.sideways_mm;
            // One cell beyond the design cell lies within it or a neighbour only if k >= 2;
            // the deepest gouge of all is on the safe side in any case.
            band.max_fallback = std::fmax(band.max_fallback,
                                          around * reach + error.vertical_mm + error.sideways_mm);
          }
        }
      if (static_cast<double>(deepest.depth_mm) > kGougeListed_mm) band.gouges.push_back(deepest);
      block_excess(br, bc) =
          std::nextafter(static_cast<float>(excess), std::numeric_limits<float>::infinity());
      band.max_excess = std::fmax(band.max_excess, excess);
    }
  });
  if (run.stopped()) return fail(kCancelled, "comparing the cut with the design was stopped");

  Band all;
  for (Band& band : bands) {
    all.sum += band.sum;
    all.sum_of_squares += band.sum_of_squares;
    all.max_gouge = std::fmax(all.max_gouge, band.max_gouge);
    all.max_excess = std::fmax(all.max_excess, band.max_excess);
    all.max_with_bound = std::fmax(all.max_with_bound, band.max_with_bound);
    all.max_fallback = std::fmax(all.max_fallback, band.max_fallback);
    all.gouged += band.gouged;
    all.gouges.insert(all.gouges.end(), band.gouges.begin(), band.gouges.end());
  }
  const double nodes = static_cast<double>(cut.rows()) * static_cast<double>(cut.cols());
  certificate.max_gouge_mm = all.max_gouge;
  certificate.max_excess_anywhere_mm = all.max_excess;
  certificate.mean_excess_mm = all.sum / nodes;
  certificate.rms_excess_mm = std::sqrt(all.sum_of_squares / nodes);
  certificate.gouged_area_mm2 = static_cast<double>(all.gouged) * cell * cell;
  certificate.bound_mm =
      std::fmax(std::fmax(all.max_with_bound - all.max_gouge, all.max_fallback), 0.0);
  certificate.worst_gouges = worst_places(as_milled, std::move(all.gouges), ball_radius_mm);
  MAQUETTE_TRY(certificate.max_excess_mm,
               reachable_excess(divided, cut, cell, ball_radius_mm, block_excess, block, run));
  return {};
}

}  // namespace maquette::cnc

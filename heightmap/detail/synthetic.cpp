// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/synthetic.hpp"

#include <algorithm>
#include <cmath>

#include "heightmap/detail/craters.hpp"
#include "heightmap/detail/small_relief.hpp"

namespace maquette::heightmap::detail {
namespace {

constexpr double kSmallest = 1.0 / 32.0;  // of a pixel, where variances are compared
constexpr double kLeastRelief = 0.1;      // of the law's variance: ground between craters is rough

/// By how much relief is lowered, because craters are a part of it.
double beside_craters(const CraterField& craters, const Roughness& roughness, double pixel_m) {
  if (roughness.coefficient <= 0.0) return 1.0;
  CraterField all = craters;
  all.smallest_m = kSmallest * pixel_m;
  const double law = relief_variance_m2(roughness, 0.5 / pixel_m, 0.5 / (kSmallest * pixel_m));
  return std::sqrt(std::max(kLeastRelief, 1.0 - crater_variance_m2(all) / law));
}

}  // namespace

Result<void> add_synthetic(FusedSurface& surface, const FuseRequest& request, const NodeGrid& nodes,
                           const Roughness& roughness, double pixel_m, const RunContext& run) {
  surface.synthetic = Grid<std::uint8_t>(nodes.rows, nodes.cols, 0);
  if (request.synthetic_detail <= 0.0) return {};
  const CraterField craters{request.body, request.crater_age_gyr, nodes.spacing_m, pixel_m,
                            request.seed};
  const double strength = request.synthetic_detail * beside_craters(craters, roughness, pixel_m);
  Grid<float> made(nodes.rows, nodes.cols, 0.0F);
  MAQUETTE_TRY(const double relief_m,
               add_small_relief(made, nodes, roughness, pixel_m, strength, request.seed, run));
  MAQUETTE_TRY(surface.craters, add_craters(made, nodes, craters, run));
  if (relief_m == 0.0 && surface.craters == 0)
    run.warn(
        "no synthetic detail: nodes are not finer than the finest source, or it has too few "
        "pixels to measure its roughness");
  const double sigma_m = std::hypot(relief_m, std::sqrt(crater_variance_m2(craters)));
  surface.synthetic_m = sigma_m;
  for (std::size_t i = 0; i < made.cells().size(); ++i) {
    float& s = surface.sigma_m.cells()[i];
    surface.synthetic.cells()[i] = relief_m > 0.0 || made.cells()[i] != 0.0F ? 1 : 0;
    surface.field.z_m.cells()[i] += made.cells()[i];
    s = static_cast<float>(std::hypot(static_cast<double>(s), sigma_m));
  }
  return {};
}

}  // namespace maquette::heightmap::detail

// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/residual_map.hpp"

#include <algorithm>
#include <vector>

#include "heightmap/detail/surface_pair.hpp"

namespace maquette::heightmap::detail {

ResidualMap residual_map(const Grid<float>& lower, const Grid<float>& upper, const NodeGrid& nodes,
                         double lower_pixel_m, double upper_pixel_m, std::size_t source) {
  // What is finer than nodes was averaged to them.
  const double lower_m = std::max(lower_pixel_m, nodes.spacing_m),
               upper_m = std::max(upper_pixel_m, nodes.spacing_m);
  SurfacePair pair = cells_of(lower, upper, nodes.spacing_m, std::max(lower_m, upper_m));
  if (pair.resolved) bring_to_one_resolution(pair, lower_m, upper_m);
  ResidualMap out;
  out.source = source;
  out.spacing = Metres{pair.cell_m};
  const double middle_m = 0.5 * (pair.cell_m - nodes.spacing_m);
  out.x0 = Metres{nodes.x0_m + middle_m};
  out.y0 = Metres{nodes.y0_m + middle_m};
  out.residual_m = Grid<float>(pair.lower.rows(), pair.lower.cols());
  std::vector<double> known;
  for (std::size_t i = 0; i < out.residual_m.cells().size(); ++i) {
    const float off = pair.lower.cells()[i] - pair.upper.cells()[i];
    out.residual_m.cells()[i] = off;
    known.push_back(static_cast<double>(off));
  }
  const Spread spread = spread_of(known);
  out.median_m = spread.median;
  out.nmad_m = spread.nmad;
  return out;
}

}  // namespace maquette::heightmap::detail

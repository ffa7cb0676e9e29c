// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/fillet.hpp"

#include <cmath>

#include "cnc/ball_offset.hpp"
#include "cnc/rest.hpp"

namespace maquette::cnc {

using heightmap::ModelField;

Result<Fillet> fillet_surface(const ModelField& design, Millimetres radius, Millimetres tolerance,
                              const RunContext& run) {
  MAQUETTE_TRY_VOID(detail::check_heights(design));
  const double d = design.spacing.value(), R = radius.value();
  // A radius that is none is refused below.
  const auto more =
      R > 0.0 && R <= 1e3 ? static_cast<std::ptrdiff_t>(std::ceil(R / d)) + 1 : std::ptrdiff_t{1};
  MAQUETTE_TRY(const RestMap rest,
               map_rest(detail::continued(design, more), BallNose{R}, tolerance, run));
  Fillet fillet{.surface = design};
  for (std::ptrdiff_t r = 0; r < design.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < design.z_mm.cols(); ++c) {
      const auto left = static_cast<double>(rest.remaining.z_mm(r + more, c + more));
      if (!(left > tolerance.value())) continue;
      fillet.surface.z_mm(r, c) = static_cast<float>(static_cast<double>(design.z_mm(r, c)) + left);
      fillet.area_mm2 += d * d;
      fillet.volume_mm3 += d * d * left;
      fillet.highest_mm = std::fmax(fillet.highest_mm, left);
    }
  return fillet;
}

}  // namespace maquette::cnc

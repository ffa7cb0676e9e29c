// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/undercoat.hpp"

#include <cmath>

#include <fmt/format.h>

#include "cnc/ball_offset.hpp"

namespace maquette::cnc {

using heightmap::ModelField;

Result<Undercoat> undercoat(const ModelField& design, Millimetres thickness,
                            const RunContext& run) {
  constexpr double kMostCells = 24.0;  // DropCutter's own way for balls
  const double t = thickness.value(), most = kMostCells * design.spacing.value();
  if (!(t > 0.0 && t <= most))
    return fail(
        kCoatThickness,
        fmt::format("coat of {} mm: must be above 0 and at most {} mm at a spacing of {} mm", t,
                    most, design.spacing.value()));
  MAQUETTE_TRY_VOID(detail::check_heights(design));
  // Twice the ball's reach: the undercoat must be right where the coat is put back on.
  const auto more = 2 * static_cast<std::ptrdiff_t>(std::ceil(t / design.spacing.value()) + 1.0);
  const ModelField wider = detail::upside_down(
      detail::rolled(detail::upside_down(detail::continued(design, more)), t, run));
  Undercoat under;
  under.surface = detail::cropped(wider, design, more);
  run.progress(0.5);
  if (run.stopped()) return fail(kCancelled, "the undercoat was stopped");
  const ModelField coated = detail::cropped(detail::rolled(wider, t, run), design, more);
  if (run.stopped()) return fail(kCancelled, "the undercoat was stopped");
  double sum = 0.0;
  for (std::ptrdiff_t r = 0; r < design.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < design.z_mm.cols(); ++c) {
      const double missing =
          static_cast<double>(design.z_mm(r, c)) - static_cast<double>(coated.z_mm(r, c));
      under.max_missing_mm = std::fmax(under.max_missing_mm, missing);
      under.max_excess_mm = std::fmax(under.max_excess_mm, -missing);
      sum += std::pow(std::fmax(missing, 0.0), 2);
    }
  under.rms_missing_mm = std::sqrt(sum / static_cast<double>(design.z_mm.cells().size()));
  run.progress(1.0);
  return under;
}

}  // namespace maquette::cnc

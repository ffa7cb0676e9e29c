// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/undercoat.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include <fmt/format.h>
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include "cnc/cutter_location.hpp"
#include "cnc/mill.hpp"

namespace maquette::cnc {
namespace {

using heightmap::ModelField;

/// Lowest centre of a ball of this radius above the surface, at every node.
ModelField rolled(const ModelField& surface, double radius_mm, const RunContext& run) {
  const DropCutter cutter(surface, Cutter::ball(radius_mm));
  ModelField centres = surface;
  oneapi::tbb::parallel_for(
      oneapi::tbb::blocked_range<std::ptrdiff_t>(0, surface.z_mm.rows(), 16),
      [&](const oneapi::tbb::blocked_range<std::ptrdiff_t>& rows) {
        if (run.stopped()) return;
        for (std::ptrdiff_t r = rows.begin(); r != rows.end(); ++r)
          for (std::ptrdiff_t c = 0; c < surface.z_mm.cols(); ++c)
            centres.z_mm(r, c) = static_cast<float>(
                cutter.drop(surface.x_mm(c), surface.y_mm(r)).tip_mm + radius_mm);
      });
  return centres;
}

/// With `more` nodes around it that continue the slopes of the last cells, so that the ball finds
/// at the outline what it would find inside.
ModelField continued(const ModelField& field, std::ptrdiff_t more) {
  const Grid<float>& z = field.z_mm;
  ModelField wider{.z_mm = Grid<float>(z.rows() + 2 * more, z.cols() + 2 * more),
                   .spacing = field.spacing,
                   .x0 = Millimetres{field.x_mm(-more)},
                   .y0 = Millimetres{field.y_mm(-more)}};
  for (std::ptrdiff_t r = 0; r < wider.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < wider.z_mm.cols(); ++c) {
      const std::ptrdiff_t i = std::clamp<std::ptrdiff_t>(r - more, 0, z.rows() - 1);
      const std::ptrdiff_t j = std::clamp<std::ptrdiff_t>(c - more, 0, z.cols() - 1);
      // Steps beyond the outline, each as high as the last one inside.
      const auto here = static_cast<double>(z(i, j));
      const std::ptrdiff_t di = r - more - i, dj = c - more - j;
      double height = here;
      if (di != 0)
        height += static_cast<double>(std::abs(di)) *
                  (here - static_cast<double>(z(i + (di > 0 ? -1 : 1), j)));
      if (dj != 0)
        height += static_cast<double>(std::abs(dj)) *
                  (here - static_cast<double>(z(i, j + (dj > 0 ? -1 : 1))));
      wider.z_mm(r, c) = static_cast<float>(height);
    }
  return wider;
}

/// The nodes that `field` has.
ModelField cropped(const ModelField& wider, const ModelField& field, std::ptrdiff_t more) {
  ModelField inner = field;
  for (std::ptrdiff_t r = 0; r < field.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < field.z_mm.cols(); ++c)
      inner.z_mm(r, c) = wider.z_mm(r + more, c + more);
  return inner;
}

ModelField upside_down(ModelField field) {
  for (float& z : field.z_mm.cells()) z = -z;
  return field;
}

}  // namespace

Result<Undercoat> undercoat(const ModelField& design, Millimetres thickness,
                            const RunContext& run) {
  constexpr double kMostCells = 24.0;  // DropCutter's own way for balls
  const double t = thickness.value(), most = kMostCells * design.spacing.value();
  if (!(t > 0.0 && t <= most))
    return fail(
        kCoatThickness,
        fmt::format("coat of {} mm: must be above 0 and at most {} mm at a spacing of {} mm", t,
                    most, design.spacing.value()));
  for (std::ptrdiff_t r = 0; r < design.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < design.z_mm.cols(); ++c)
      if (!std::isfinite(design.z_mm(r, c)))
        return fail(
            kHeightNotFinite,
            fmt::format("the design has a void at row {}, column {} (x = {} mm, y = {} mm); "
                        "fill voids first",
                        r, c, design.x_mm(c), design.y_mm(r)));
  // Twice the ball's reach: the undercoat must be right where the coat is put back on.
  const auto more = 2 * static_cast<std::ptrdiff_t>(std::ceil(t / design.spacing.value()) + 1.0);
  const ModelField wider = upside_down(rolled(upside_down(continued(design, more)), t, run));
  Undercoat under;
  under.surface = cropped(wider, design, more);
  run.progress(0.5);
  if (run.stopped()) return fail(kCancelled, "the undercoat was stopped");
  const ModelField coated = cropped(rolled(wider, t, run), design, more);
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

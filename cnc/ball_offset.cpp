// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/ball_offset.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>

#include "cnc/cutter_location.hpp"
#include "cnc/mill.hpp"

namespace maquette::cnc {

using heightmap::ModelField;

namespace detail {

Result<void> check_heights(const ModelField& surface) {
  for (std::ptrdiff_t r = 0; r < surface.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < surface.z_mm.cols(); ++c)
      if (!std::isfinite(surface.z_mm(r, c)))
        return fail(
            kHeightNotFinite,
            fmt::format("the design has a void at row {}, column {} (x = {} mm, y = {} mm); "
                        "fill voids first",
                        r, c, surface.x_mm(c), surface.y_mm(r)));
  return {};
}

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

}  // namespace detail

Result<ModelField> offset_surface(const ModelField& surface, Millimetres distance,
                                  const RunContext& run) {
  constexpr double kMostCells = 100.0;
  const double t = distance.value(), most = kMostCells * surface.spacing.value();
  if (!(std::abs(t) <= most))
    return fail(kOffsetDistance, fmt::format("offset of {} mm: at most {} mm either way at a "
                                             "spacing of {} mm",
                                             t, most, surface.spacing.value()));
  MAQUETTE_TRY_VOID(detail::check_heights(surface));
  if (t == 0.0) return surface;
  const auto more =
      static_cast<std::ptrdiff_t>(std::ceil(std::abs(t) / surface.spacing.value())) + 1;
  ModelField wider = detail::continued(surface, more);
  if (t < 0.0) wider = detail::upside_down(std::move(wider));
  wider = detail::rolled(wider, std::abs(t), run);
  if (run.stopped()) return fail(kCancelled, "the offset was stopped");
  if (t < 0.0) wider = detail::upside_down(std::move(wider));
  run.progress(1.0);
  return detail::cropped(wider, surface, more);
}

}  // namespace maquette::cnc

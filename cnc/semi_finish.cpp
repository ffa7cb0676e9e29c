// SPDX-License-Identifier: GPL-3.0-or-later
#include "cnc/semi_finish.hpp"

#include <cmath>

#include <fmt/format.h>

#include "cnc/pass_sampler.hpp"
#include "cnc/tool.hpp"

namespace maquette::cnc {

Result<MillReport> semi_finish(const heightmap::ModelField& design, const MillOptions& options,
                               Millimetres allowance, const ToolpathSink& sink,
                               const RunContext& run) {
  if (!(allowance.value() >= 0.0 && allowance.value() <= 50.0))
    return fail(kMillOptionOutOfRange,
                fmt::format("allowance is {} mm; it must be from 0 to 50 mm", allowance.value()));
  MAQUETTE_TRY_VOID(check_mill(design, options));
  // Rounded up to what can be written, so that raising is exact.
  const auto raise =
      kResolution *
      static_cast<std::int64_t>(std::ceil(allowance.value() / (kTick_mm * kResolution) - 1e-9));
  const double a = mm_of_ticks(raise), diameter = options.ball_diameter.value();
  MillOptions larger = options;
  larger.ball_diameter = Millimetres{diameter + 2.0 * a};
  // A ridge between given passes is the higher the smaller the ball: s^2 / 8 R.
  larger.scallop_limit =
      Millimetres{options.scallop_limit.value() * diameter / larger.ball_diameter.value()};
  heightmap::ModelField lowered;
  if (options.stock != nullptr) {
    lowered = *options.stock;
    for (float& z : lowered.z_mm.cells()) z -= static_cast<float>(a);
    larger.stock = &lowered;
  }
  Toolpath raised;
  auto report = mill_passes(
      design, larger,
      [&](const Toolpath& piece) {
        raised = piece;
        raised.start.z += raise;
        for (PathMove& move : raised.moves) move.to.z += raise;
        return sink(raised);
      },
      run);
  if (!report) return report;
  report->lowest_tip_mm += a;
  report->highest_tip_mm += a;
  const double higher = larger.ball_diameter.value() / diameter;
  report->scallop.highest_mm *= higher;
  report->scallop.mean_mm *= higher;
  for (float& z : report->scallop.predicted_mm.z_mm.cells()) z *= static_cast<float>(higher);
  report->scallop_flat_mm = scallop_mm({0.5 * diameter}, options.stepover.value());
  return report;
}

}  // namespace maquette::cnc

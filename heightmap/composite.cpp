// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/composite.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include <fmt/format.h>

#include "heightmap/detail/blend.hpp"
#include "heightmap/detail/composite_bands.hpp"

namespace maquette::heightmap {
namespace {

constexpr double kCrossoverPixels = 4.0;  // of the relief, if nobody says
constexpr double kWavesAcross = 8.0;      // of the crossover over the site: gain to 6 %
constexpr double kSpectraAlike = 1.5;

double finest_pixel_m(const FusedSurface& surface) {
  double finest = INFINITY;
  for (const SourceReport& s : surface.sources) finest = std::min(finest, s.pixel_m);
  return finest;
}

/// The crossover that is asked for, or that the relief's pixel suggests.
Result<double> crossover_of(const CompositeRequest& request, const FusedSurface& relief,
                            const FusedSurface& detail) {
  const double spacing_m = request.relief.spacing.value(),
               site_m = 2.0 * request.relief.half_width.value();
  const double relief_m = std::max(finest_pixel_m(relief), spacing_m),
               detail_m = std::max(finest_pixel_m(detail), spacing_m);
  const double asked_m =
      request.crossover_m > 0.0 ? request.crossover_m : kCrossoverPixels * relief_m;
  // All of the octave around the crossover is seen by both: two pixels are its shortest wave.
  const double least = 2.0 * std::numbers::sqrt2;
  if (asked_m < least * relief_m)
    return fail(
        kCrossover,
        fmt::format("crossover of {:g} m: the relief's pixels of {:g} m show nothing there; "
                    "at least {:.3g} m expected",
                    asked_m, relief_m, least * relief_m));
  if (asked_m < least * detail_m)
    return fail(kCrossover,
                fmt::format("crossover of {:g} m: the detail's pixels of {:g} m show nothing "
                            "shorter; take finer detail, or at least {:.3g} m",
                            asked_m, detail_m, least * detail_m));
  if (asked_m * kWavesAcross > site_m)
    return fail(kCrossover,
                fmt::format("crossover of {:g} m: a site of {:g} m has less than {:g} such waves "
                            "across, too few to fit the detail's slopes; at most {:.3g} m expected "
                            "(relief of finer pixels, or a larger site)",
                            asked_m, site_m, kWavesAcross, site_m / kWavesAcross));
  return asked_m;
}

Result<CompositeMatch> match_of(const CompositeRequest& request, const FusedSurface& relief,
                                const FusedSurface& detail, const RunContext& run) {
  if (request.as_before) return *request.as_before;
  MAQUETTE_TRY(const double crossover_m, crossover_of(request, relief, detail));
  const CompositeMatch match = detail::match_slopes(relief.field.z_m, detail.field.z_m,
                                                    request.relief.spacing.value(), crossover_m);
  if (!(match.gain > 0.0))
    return fail(kCrossover,
                fmt::format("crossover of {:g} m: {} has no slopes there that could be "
                            "fitted; choose another place or crossover",
                            crossover_m,
                            match.detail_slope > match.relief_slope ? "the relief" : "the detail"));
  const double alike = match.gain_longer / match.gain;
  if (alike > kSpectraAlike || alike < 1.0 / kSpectraAlike)
    run.warn(fmt::format(
        "composite: detail is multiplied by {:.3g} at the crossover of {:g} m, waves twice as long "
        "would ask for {:.3g}: {}",
        match.gain, crossover_m, match.gain_longer,
        alike > 1.0
            ? "the relief shows less there than further up; a longer crossover may fit better"
            : "the detail falls off more steeply than the relief does"));
  return match;
}

void append_reports(FusedSurface& surface, FusedSurface& detail) {
  const std::size_t before = surface.sources.size();
  std::move(detail.sources.begin(), detail.sources.end(), std::back_inserter(surface.sources));
  for (ResidualMap& r : detail.residuals) {
    r.source += before;
    surface.residuals.push_back(std::move(r));
  }
  std::move(detail.images.begin(), detail.images.end(), std::back_inserter(surface.images));
}

/// Puts the detail's waves in and says what that does to the uncertainty.
void exchange(CompositeSurface& out, const FusedSurface& detail, double spacing_m) {
  FusedSurface& surface = out.surface;
  const Grid<float> change =
      detail::exchanged_waves(surface.field.z_m, detail.field.z_m, spacing_m, out.match);
  double square = 0.0;
  for (const float c : change.cells()) square += static_cast<double>(c) * static_cast<double>(c);
  const double rms_m = std::sqrt(square / static_cast<double>(change.cells().size()));
  out.detail_source = Grid<std::uint8_t>(change.rows(), change.cols());
  const auto relief_sources = static_cast<std::uint8_t>(surface.sources.size());
  for (std::size_t i = 0; i < change.cells().size(); ++i) {
    surface.field.z_m.cells()[i] += change.cells()[i];
    float& sigma = surface.sigma_m.cells()[i];
    sigma = static_cast<float>(std::hypot(static_cast<double>(sigma), rms_m));
    surface.artefacts.cells()[i] =
        static_cast<std::uint8_t>(surface.artefacts.cells()[i] | detail.artefacts.cells()[i]);
    const std::uint8_t of = detail.source.cells()[i];
    out.detail_source.cells()[i] =
        of == detail::Blend::kFilled ? of : static_cast<std::uint8_t>(of + relief_sources);
  }
}

}  // namespace

Result<CompositeSurface> composite(const CompositeRequest& request, const RunContext& run) {
  MAQUETTE_CHECK(request.relief.half_width.value() == request.detail.half_width.value() &&
                     request.relief.spacing.value() == request.detail.spacing.value(),
                 "relief and detail on different nodes");
  if (request.relief.body.name == request.detail.body.name)
    return fail(kSameBody, fmt::format("relief and detail are both of {}; a composite is of two "
                                       "bodies: sources of one are aligned and fused by "
                                       "`combine = \"same_body\"`",
                                       request.relief.body.name));
  RunContext half = run;
  half.progress = [&run](double share) { run.progress(0.45 * share); };
  CompositeSurface out;
  MAQUETTE_TRY(out.surface, fuse(request.relief, half));
  half.progress = [&run](double share) { run.progress(0.45 + 0.45 * share); };
  MAQUETTE_TRY(FusedSurface detail, fuse(request.detail, half));
  MAQUETTE_TRY(out.match, match_of(request, out.surface, detail, run));
  if (run.stopped()) return fail(kCancelled, "the composite was stopped");
  exchange(out, detail, request.relief.spacing.value());
  out.surface.synthetic = std::move(detail.synthetic);
  out.surface.synthetic_m = out.match.gain * detail.synthetic_m;
  out.surface.craters = detail.craters;
  append_reports(out.surface, detail);
  if (!request.wider.field.z_m.empty()) enlarge(out.surface, request.wider);
  run.progress(1.0);
  return out;
}

}  // namespace maquette::heightmap

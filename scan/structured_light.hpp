// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file structured_light.hpp
/// A fringe projection head looks at the part: a camera, and at its right a projector whose
/// stripes say, pixel by pixel, in which plane of light a point lies.
///
/// Frame     The station is the camera: x right, y up, looking along -z; the projector stands at
///           (baseline, 0, 0), turned so that both axes meet at the working distance.
/// Point     The camera's ray through the middle of the pixel, cut with the stripe's plane (which
///           holds the projector and its vertical): with t the tangent of the ray and p that of
///           the plane, depth = baseline / (t + p).
/// Seen      What the ray meets first, if the projector sees it too and lights it: no point in the
///           shadow of either, beyond the stripes, steeper than steepest_deg, too dark
///           (below least_value) or saturated (above 1).
/// Value     exposure reflectance cos(incidence of the light) (working distance / distance)^2,
///           plus gloss (n . h)^gloss_exponent with h between light and view (Blinn 1977,
///           doi:10.1145/563858.563893).
/// Noise     The place of the stripe, stripe_sigma_px camera pixels at the value of a white surface
///           that faces the projector at the working distance; it goes with
///           value^-noise_exponent (without gloss). Depth noise follows from the geometry:
///           sigma = depth^2 / baseline (1 + p^2) stripe_sigma_px / focal_length_px.
/// Kept      Row (from above) and column of the pixel, value as intensity, colour.

#include "scan/scanner_sim.hpp"

namespace maquette::scan {

struct StructuredLightOptions {
  assets::StructuredLightPreset scanner;
  RigidTransform model_from_station;
  SurfacePaint paint;  ///< empty: 50 % grey
  bool colour = false;
  std::string name;
  std::uint64_t max_points = 20'000'000;  ///< pixels are thinned evenly, 1 of n x n, to stay below
  std::uint64_t seed = 1;
};

/// The camera at `eye_mm` looks at `target_mm`, its x axis level (along x if it looks straight
/// up or down).
[[nodiscard]] RigidTransform look_at(Vec3 eye_mm, Vec3 target_mm);

/// Standard deviation of the depth (along the camera's axis) of a point in the station's frame.
[[nodiscard]] double depth_sigma_mm(const assets::StructuredLightPreset& scanner, Vec3 point_mm,
                                    double value);

/// @return the cloud in the model frame, or as simulate_scan of a phase-shift scanner:
///   SCAN_OPTIONS, SCAN_STATION_UNDER_SURFACE (camera or projector), SCAN_NOTHING_HIT,
///   CORE_CANCELLED
[[nodiscard]] Result<Cloud> simulate_structured_light(const heightmap::ModelField& surface,
                                                      std::span<const TriMesh> stones,
                                                      const StructuredLightOptions& options,
                                                      const RunContext& run = {});
[[nodiscard]] Result<ScanFigures> simulate_structured_light(const heightmap::ModelField& surface,
                                                            std::span<const TriMesh> stones,
                                                            const StructuredLightOptions& options,
                                                            CloudWriter& writer,
                                                            const RunContext& run = {});

}  // namespace maquette::scan

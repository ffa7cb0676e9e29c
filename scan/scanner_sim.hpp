// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file scanner_sim.hpp
/// A terrestrial phase-shift scanner looks at the part.
///
/// Directions  A grid of azimuth about the vertical through the station and of zenith
///             angle, both in steps of 360 degrees / lines_per_turn, limited to those
///             that can reach the bounding box of surface and stones. Steps are whole
///             multiples counted from azimuth 0 (east) and the zenith, so that two
///             scans of one station share their directions.
/// Range       To the nearest hit on terrain (FieldTracer) or stones (Embree in robust
///             mode, the hit refined in double precision), plus noise, then rounded to
///             range_resolution_mm. What lies behind one of the part's four walls is
///             hidden by it, and hits on walls are left out.
/// Noise       Normal, standard deviation range_sigma(): shot noise of an amplitude
///             that falls with the square of the range and the cosine of incidence.
///             Keyed on (seed, direction), so threads do not matter.
/// Not here    the width of the beam (mixed pixels, edge blur), albedo of the paint,
///             encoder and range errors that are systematic.
/// Sources     Wujanz, Burger, Mettenleiter, Neitzel, "An intensity-based stochastic
///             model for terrestrial laser scanners", ISPRS J. 125, 2017,
///             doi:10.1016/j.isprsjprs.2016.12.006 (precision as a power of the signal;
///             the power -1/2 of pure shot noise is taken here)

#include <cstdint>
#include <span>

#include "assets/devices.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"
#include "core/vec.hpp"
#include "heightmap/height_field.hpp"
#include "scan/cloud.hpp"

namespace maquette::scan {

inline constexpr ErrorCode kStationUnderSurface{"SCAN_STATION_UNDER_SURFACE"};
inline constexpr ErrorCode kNothingHit{"SCAN_NOTHING_HIT"};
inline constexpr ErrorCode kScanOptions{"SCAN_OPTIONS"};

struct ScanOptions {
  assets::ScannerPreset scanner;
  Vec3 station_mm{0.0, -1500.0, 1500.0};
  std::uint64_t max_points = 20'000'000;  ///< angular steps are widened evenly to stay below
  std::uint64_t seed = 1;
};

/// Standard deviation of one range in mm: the preset's range_sigma_mm holds at 3 m and
/// perpendicular incidence; proportional to range / 3 m and to cos(incidence)^(-1/2).
/// The cosine counts as at least 0.01, where a real instrument loses the point.
[[nodiscard]] double range_sigma_mm(const assets::ScannerPreset& scanner, double range_mm,
                                    double cos_incidence);

/// Points in the model frame (the true pose is known to the simulation), order by
/// column (azimuth) then row (zenith angle), with intensity (cos of incidence) and
/// station. `max_points` bounds the directions, so it surely bounds the points.
/// @param stones  closed meshes
/// @return the cloud, or
///   SCAN_OPTIONS                lines_per_turn, max_points, sigma or station out of range
///   SCAN_STATION_UNDER_SURFACE  the station is inside the part or inside a stone
///   SCAN_NOTHING_HIT            no direction reaches the surface or a stone
///   CORE_CANCELLED
[[nodiscard]] Result<Cloud> simulate_scan(const heightmap::ModelField& surface,
                                          std::span<const TriMesh> stones,
                                          const ScanOptions& options, const RunContext& run = {});

}  // namespace maquette::scan

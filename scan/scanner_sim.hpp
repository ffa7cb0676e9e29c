// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file scanner_sim.hpp
/// A terrestrial phase-shift scanner looks at the part. (A camera with a projector of stripes:
/// scan/structured_light.hpp.)
///
/// Directions  A grid of azimuth about the station's vertical and of zenith angle, both in
///             steps of 360 degrees / lines_per_turn, limited to those that can reach the
///             bounding box of surface and stones. Steps are whole multiples counted from
///             azimuth 0 (the station's x axis) and the zenith, so that two scans of one
///             station share their directions.
/// Beam        Gaussian, with its waist (beam_diameter_mm) at the exit and the stated full
///             divergence: radius^2 = waist^2 + (divergence / 2 range)^2. It is sampled by
///             `footprint_rays` skew rays, which lie on the hyperboloids of such a beam at any
///             range; 7 rays are the quadrature of degree 5 of the Gaussian plane (Stroud
///             1971, E2r2 5-1), 1 is a beam without width, any other number lies on a
///             spiral with the beam's second moments. The pattern is turned at random
///             from point to point. Each ray answers with reflectance cos(incidence) / range^2.
/// Edges       Where the depth in a beam, beyond a plane's, is more than the noise (or a part of it
///             meets nothing), `edge_rays` stand for the beam: seven let its points lie too near by
///             0.01 to 0.025 mm beside stones, which scans of 50 points a mm^2 show. Beside stones,
///             and where another beam of the same walk has found an edge, six more rays at 1.5
///             radii look for one: farther out is 0.1 % of a beam (behind edges of the terrain
///             that nobody has found yet 2 to 4 %). Of 61 rays a range at an edge is that of very
///             many to a fiftieth of a step in the beam (0.05 of its depth, rms; of 7 rays 0.22),
///             without a sign.
/// Range       phase_range() of these answers: mixed pixels at edges. Then systematic errors,
///             then noise, then rounding to range_resolution_mm.
/// Signal      Amplitude of the sum, 1 for a white surface that faces the scanner at 3 m;
///             it is the intensity of the point. Below least_signal there is no point.
/// Noise       Normal, range_sigma_mm(): a power of the signal, -1/2 for the shot noise of the
///             amplitude. Keyed on (seed, direction), so threads do not matter.
/// Angles      A point is written with the angles that the circles show; the beam looks
///             elsewhere, by AngularErrors (all 0 unless given).
/// Walls       What lies behind one of the part's four walls is hidden by it; hits on walls
///             are left out.
/// Cost        Of one ray a point some 0.2 us of CPU each on terrain without voids (a column of
///             directions is one walk along the terrain's profile), else 0.5; of seven 0.3 each
///             (tests/bench/scan_sim_bench), edges of smooth ground, 1 % of the points, included.
/// Kept        Row (zenith angle) and column (azimuth) of the station's grid, time, intensity,
///             colour where the scene has it.
/// Sources     Wujanz, Burger, Mettenleiter, Neitzel, "An intensity-based stochastic
///             model for terrestrial laser scanners", ISPRS J. 125, 2017,
///             doi:10.1016/j.isprsjprs.2016.12.006 (noise as a power of the signal);
///             Lichti, "Error modelling, calibration and analysis of an AM-CW terrestrial
///             laser scanner system", ISPRS J. 61, 2007, doi:10.1016/j.isprsjprs.2006.10.004
///             (angular and range errors)

#include <cstdint>
#include <functional>
#include <span>

#include "assets/devices.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"
#include "core/vec.hpp"
#include "heightmap/height_field.hpp"
#include "scan/cloud_stream.hpp"

namespace maquette::scan {

inline constexpr ErrorCode kStationUnderSurface{"SCAN_STATION_UNDER_SURFACE"};
inline constexpr ErrorCode kNothingHit{"SCAN_NOTHING_HIT"};
inline constexpr ErrorCode kScanOptions{"SCAN_OPTIONS"};

/// Where the beam looks beside what the circles show, radians. With zenith angle v and azimuth h
/// (second face: -v and h + pi, as the instrument stands then):
///   dh = collimation / sin v + trunnion cot v + eccentricity_h cos(h - eccentricity_h_phase)
///   dv = vertical_index + eccentricity_v cos(v - eccentricity_v_phase)
/// and normal noise of both circles.
struct AngularErrors {
  double encoder_noise_rad = 0.0;
  double vertical_index_rad = 0.0, collimation_rad = 0.0, trunnion_rad = 0.0;
  double eccentricity_h_rad = 0.0, eccentricity_h_phase_rad = 0.0;
  double eccentricity_v_rad = 0.0, eccentricity_v_phase_rad = 0.0;
};

/// range = r + offset + scale r + cyclic sin(2 pi r / U + phase) + incidence tan^2(i), U the finest
/// unambiguous interval; tan^2 counts up to 100.
struct RangeErrors {
  double offset_mm = 0.0, scale_ppm = 0.0;
  double cyclic_mm = 0.0, cyclic_phase_rad = 0.0;
  double incidence_mm = 0.0;
};

/// What the surface is at a point (model frame).
struct SurfaceLook {
  double reflectance = 0.5;  ///< Lambert
  Colour colour;
};
/// @param stone  the point is on a stone
using SurfacePaint = std::function<SurfaceLook(Vec3 point_mm, bool stone)>;

struct ScanOptions {
  assets::ScannerPreset scanner;
  Vec3 station_mm{0.0, -1500.0, 1500.0};
  Quaternion station_rotation;  ///< model_from_station; unit
  bool second_face = false;
  AngularErrors angular;
  RangeErrors range;
  int footprint_rays = 7;
  int edge_rays = 61;   ///< where an edge cuts the beam; no more than footprint_rays: as elsewhere
  SurfacePaint paint;   ///< empty: 50 % grey
  bool colour = false;  ///< keep the paint's colour
  std::string name;     ///< of the station
  std::uint64_t max_points = 20'000'000;  ///< angular steps are widened evenly to stay below
  std::uint64_t seed = 1;
};

/// Standard deviation of one range in mm: the preset's range_sigma_mm holds at 3 m,
/// perpendicular on 50 % grey; it goes with (signal / 0.5)^-noise_exponent, signal =
/// reflectance cos(incidence) (3 m / range)^2, which counts as at least 0.005.
[[nodiscard]] double range_sigma_mm(const assets::ScannerPreset& scanner, double range_mm,
                                    double cos_incidence, double reflectance = 0.5);

struct ScanFigures {
  std::uint64_t directions = 0, points = 0;
  std::uint64_t lost = 0;  ///< something was met, but the signal was too weak
  double widened = 1.0;    ///< angular step by the preset's
};

/// Points in the model frame (the true pose is known to the simulation), order by
/// column (azimuth) then row (zenith angle), with intensity, grid and station. `max_points`
/// bounds the directions, so it surely bounds the points.
/// @param stones  closed meshes
/// @return the cloud, or
///   SCAN_OPTIONS                a value out of range, with the range
///   SCAN_STATION_UNDER_SURFACE  the station is inside the part or inside a stone
///   SCAN_NOTHING_HIT            no direction reaches the surface or a stone
///   CORE_CANCELLED
[[nodiscard]] Result<Cloud> simulate_scan(const heightmap::ModelField& surface,
                                          std::span<const TriMesh> stones,
                                          const ScanOptions& options, const RunContext& run = {});

/// The same points into a file, one station more, in constant memory (some 35 to 50 MiB beside the
/// surface: tests/bench/scan_sim_bench); with time. The caller finishes the file.
/// @return also the writer's errors
[[nodiscard]] Result<ScanFigures> simulate_scan(const heightmap::ModelField& surface,
                                                std::span<const TriMesh> stones,
                                                const ScanOptions& options, CloudWriter& writer,
                                                const RunContext& run = {});

}  // namespace maquette::scan

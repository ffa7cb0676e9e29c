// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file deviate.hpp
/// Scan against design: registration, then signed deviation with its statistics.
///
/// Room    scan:  cloud -> align -> [deviate] -> report
/// Takes   design ModelField (stones included where they are glued on), cloud(s), mm
/// Gives   signed deviation per point (positive: measured above the design, along
///         the design's normal), map on the design's nodes, statistics
///
/// Registration: point-to-plane ICP (Chen and Medioni 1992, doi:10.1016/0262-8856(92)90066-C)
/// with Huber weights, straight on the height field, from the pose in the file;
/// coarse to fine over a pyramid of the design. Refused when it has not converged.
/// Directions that the relief does not determine are held and named.
///
/// What a best-fit registration hides: a constant offset of the whole surface (a
/// coating, a wrong tool length) and a tilt go into the pose, and the deviation does
/// not show them. Compare without registration, or on surfaces that tie the pose
/// (walls, reference marks), to see those.

#include <array>
#include <filesystem>
#include <optional>
#include <string>
#include <vector>

#include "core/grid.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/vec.hpp"
#include "heightmap/height_field.hpp"
#include "scan/cloud.hpp"

namespace maquette::scan {

inline constexpr ErrorCode kNotConverged{"SCAN_NOT_CONVERGED"};
inline constexpr ErrorCode kUnderDetermined{"SCAN_UNDER_DETERMINED"};
inline constexpr ErrorCode kTooFewPoints{"SCAN_TOO_FEW_POINTS"};
inline constexpr ErrorCode kUnitSlip{"SCAN_UNIT_SLIP"};
inline constexpr ErrorCode kReach{"SCAN_REACH"};

struct Alignment {
  RigidTransform model_from_scan;
  double rms_before_mm = 0.0, rms_after_mm = 0.0;  ///< of all points on the design
  int iterations = 0;                              ///< with all points
  bool converged = false;
  double sigma_translation_mm = 0.0, sigma_rotation_rad = 0.0;  ///< largest of the covariance
  std::vector<std::string> free_directions;  ///< that the relief does not determine

  /// Of the translation of `centre_mm` (x, y, z in mm) and the rotation about it (x, y, z
  /// in rad), model axes, row by row. Noise is taken from the residuals (Huber's sandwich);
  /// they are taken as independent, so with correlated residuals (form errors of the part,
  /// scanner systematics) the truth is larger. Zero along directions that were held.
  std::array<double, 36> covariance{};
  Vec3 centre_mm;         ///< mean of the points that lie on the design, model frame
  double noise_mm = 0.0;  ///< robust standard deviation (NMAD) of the residuals
};

/// Converged means: the last full update moves no point by more than about 1e-6 mm, or,
/// where points hop between triangles so that updates alternate, updates have been
/// halved down to that and the full one is below a quarter of its standard deviation.
/// Captures some 5 mm and 2 degrees on rough relief; beyond, give a better pose.
/// @return the pose, or
///   SCAN_TOO_FEW_POINTS    fewer than 30 points on the design
///   SCAN_UNIT_SLIP         the cloud's extent fits only as metres, inches or micrometres
///   SCAN_UNDER_DETERMINED  fewer than three directions are determined (points on a line)
///   SCAN_NOT_CONVERGED     no rest within the iterations, or at rest where the cloud's
///                          relief does not follow the design's
///   CORE_CANCELLED
[[nodiscard]] Result<Alignment> align(const Cloud& cloud, const heightmap::ModelField& design,
                                      const RunContext& run = {});

/// Is the cloud in millimetres? Compares its extent (without the outermost 0.5 %) with
/// the design's. SCAN_UNIT_SLIP says which unit would fit.
[[nodiscard]] Result<void> check_unit(const Cloud& cloud, const heightmap::ModelField& design);

struct DeviationStatistics {
  std::uint64_t points = 0;    ///< that fall onto the design
  std::uint64_t off_part = 0;  ///< that do not, or farther than `reach`
  double mean_mm = 0.0, rms_mm = 0.0, sigma_mm = 0.0, median_mm = 0.0, nmad_mm = 0.0;
  double p05_mm = 0.0, p95_mm = 0.0;  ///< of the signed deviation
  double abs_p95_mm = 0.0, min_mm = 0.0, max_mm = 0.0;
  double coverage = 0.0;  ///< share of the design's nodes with a point within a spacing
};

struct Deviation {
  std::vector<float> per_point_mm;  ///< NaN: off the part
  Grid<float> map_mm;               ///< mean per node of the design; NaN: none
  DeviationStatistics statistics;
  std::vector<std::uint64_t> histogram;  ///< 101 bins over +- histogram_limit; what lies
                                         ///< beyond counts in the outermost bins
  double histogram_limit_mm = 0.0;       ///< 1, 2 or 5 times a power of ten
};

/// Exact distance to the triangulated design (surface_distance.hpp), each point for
/// itself; a point beside the outline, over a void, nearer to one of the part's walls
/// than to its surface, or farther than `reach` is off the part.
/// Memory beside cloud and design: 13 bytes per node, 8 per point.
/// @param reach  points farther from the design count as off the part; 0 < reach <= 1 m
/// @return the deviation, or
///   SCAN_CLOUD_EMPTY, SCAN_REACH (out of range)
///   SCAN_TOO_FEW_POINTS  no point at all is on the part
///   CORE_CANCELLED
[[nodiscard]] Result<Deviation> deviate(const Cloud& cloud, const RigidTransform& model_from_scan,
                                        const heightmap::ModelField& design,
                                        Millimetres reach = Millimetres{5.0},
                                        const RunContext& run = {});

/// summary.json: statistics and alignment, flat keys (mean_mm, rms_mm, p95_mm, ...); with
/// an alignment also `registration` with what it hides.
[[nodiscard]] std::string to_json(const DeviationStatistics& statistics,
                                  const Alignment* alignment);

/// The cloud in the model frame with its deviation as scalar field `deviation_mm` (NaN:
/// off the part), binary PLY.
[[nodiscard]] Result<void> write_deviation_ply(const Cloud& cloud,
                                               const RigidTransform& model_from_scan,
                                               const Deviation& deviation,
                                               const std::filesystem::path& path);

}  // namespace maquette::scan

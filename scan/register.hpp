// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file register.hpp
/// Where a scan lies on its design: pose, its covariance, what the shape leaves free; or a
/// refusal that says why.
///
/// Room     scan:  cloud -> [register_scan] -> deviate -> report
/// Takes    cloud in millimetres in any right-handed frame; design as ModelField
/// Gives    model_from_scan, 6 x 6 covariance, noise, overlap, names of free directions
///
/// Fine     Point to plane (Chen and Medioni 1992, doi:10.1016/0262-8856(92)90066-C), iterated
///          least squares with Tukey's biweight (Beaton and Tukey 1974,
///          doi:10.1080/00401706.1974.10489171) at 4.685 robust standard deviations of the
///          residuals: what is farther has no weight at all, so overlap is trimmed by the
///          noise that the data show. On height fields the plane is that of the triangle
///          above or below the point; a pyramid of the design widens the capture.
/// Weights  Where the scanner's place is known, each residual counts by its own standard deviation,
///          as range and incidence make it (generalised ICP with the noise that the residuals show:
///          detail/noise_model.hpp), if that differs by more than half over the scan.
/// Coarse   From nothing: the cloud's plane of least scatter gives up and down, then heights
///          over that plane are correlated with the design's at every shift and azimuth
///          (masked normalised correlation by FFT: Padfield 2012,
///          doi:10.1109/TIP.2011.2181402); the best places are registered finely on a
///          sample, the best of these counts.
/// Noise    Robust standard deviation of the residuals. Covariance: the sandwich of M-estimators
///          (Huber and Ronchetti 2009, section 7.6) with residuals summed over square blocks
///          before they are squared (cluster-robust: Liang and Zeger 1986,
///          doi:10.1093/biomet/73.1.13), so roughness, form errors and scanner effects that
///          are correlated over up to a sixteenth of the part count as the fewer
///          observations that they are. Effects correlated over more than that, and a
///          constant offset of the whole surface, are not in it: they go into the pose.
/// Done     when the next step is below a hundredth of its standard deviation (or moves
///          nothing by 1e-6 mm). Anything else is refused.

#include <array>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/vec.hpp"
#include "heightmap/height_field.hpp"
#include "scan/cloud.hpp"

namespace maquette::scan {

inline constexpr ErrorCode kNotConverged{"SCAN_NOT_CONVERGED"};
inline constexpr ErrorCode kPoorFit{"SCAN_POOR_FIT"};
inline constexpr ErrorCode kMirrored{"SCAN_MIRRORED"};
inline constexpr ErrorCode kUnderDetermined{"SCAN_UNDER_DETERMINED"};
inline constexpr ErrorCode kTooFewPoints{"SCAN_TOO_FEW_POINTS"};
inline constexpr ErrorCode kUnitSlip{"SCAN_UNIT_SLIP"};

struct RegisterOptions {
  RigidTransform model_from_scan;  ///< where to begin
  /// If the pose above does not lead to the part, look everywhere.
  bool anywhere = true;
  bool scale = false;           ///< estimate the scan's scale too
  double least_overlap = 0.30;  ///< share of the points that must lie on the design's surface
  int most_iterations = 100;    ///< with all points; then it is refused
};

struct Registration {
  RigidTransform model_from_scan;  ///< of the scaled cloud: p = R (scale q) + t
  double scale = 1.0, sigma_scale = 0.0;
  bool found_anywhere = false;    ///< the pose to begin with was of no use
  double rms_before_mm = 0.0;     ///< of the points on the design at the pose to begin with
  double rms_after_mm = 0.0;      ///< of all points over the design, outliers included
  double noise_mm = 0.0;          ///< robust standard deviation (NMAD) of the residuals
  double overlap = 0.0;           ///< share of all points within 5 noise_mm of the design
  double likeness = 0.0;          ///< share of the design's relief that the cloud shows, 1: all
  int iterations = 0;             ///< with all points
  double last_step_sigmas = 0.0;  ///< the step that was still left, in standard deviations

  /// Of the translation of `centre_mm` (x, y, z in mm) and the rotation about it (x, y, z
  /// in rad), model axes, row by row. Zero along directions that were held.
  std::array<double, 36> covariance{};
  Vec3 centre_mm;  ///< mean of the points that lie on the design, model frame
  double sigma_translation_mm = 0.0, sigma_rotation_rad = 0.0;  ///< largest of the covariance
  /// How many independent observations the points are worth: their number times the ratio of
  /// the variances that independence would give to those stated.
  double effective_points = 0.0;
  std::vector<std::string> free_directions;  ///< that the shape does not determine; held
};

/// Accuracy on simulated scans (tests and bench): covariance true to chi-squared; pose error
/// below 1/50 of the point spacing. Captures 20 mm and 5 degrees on 1 m of rough relief from
/// the pose given, any pose if `anywhere`.
/// Cost: 5 M points against 4000 x 4000 nodes some 6 s of CPU, against 1415 x 1415 3; half a second
/// more if it must look everywhere.
/// @return the pose, or
///   SCAN_TOO_FEW_POINTS    fewer than 30 points on the design
///   SCAN_UNIT_SLIP         the cloud's extent fits only as metres, inches or micrometres
///   SCAN_UNDER_DETERMINED  fewer than three directions are determined (points on a line)
///   SCAN_NOT_CONVERGED     no rest within the iterations
///   SCAN_POOR_FIT          at rest where the cloud's relief does not follow the design's or too
///                          few points lie on it: another part, or a wrong place
///   SCAN_MIRRORED          the cloud fits only as its mirror image (left-handed frame)
///   CORE_CANCELLED
[[nodiscard]] Result<Registration> register_scan(const Cloud& cloud,
                                                 const heightmap::ModelField& design,
                                                 const RegisterOptions& options = {},
                                                 const RunContext& run = {});

/// Is the cloud in millimetres? Compares its extent (without the outermost 0.5 %) with
/// the design's. SCAN_UNIT_SLIP says which unit would fit.
[[nodiscard]] Result<void> check_unit(const Cloud& cloud, const heightmap::ModelField& design);

/// What a small wrong pose does to a deviation: d(deviation) / d(unknown) at a point, for
/// translation x, y, z (mm per mm), rotation about `centre` x, y, z (mm per rad) and scale (mm
/// per 1). The columns by which pose is a nuisance parameter in any linear model of deviations.
/// @param normal  unit, of the design at the point
[[nodiscard]] constexpr std::array<double, 7> pose_columns(Vec3 point_mm, Vec3 normal,
                                                           Vec3 centre_mm) {
  const Vec3 arm = point_mm - centre_mm, turn = cross(arm, normal);
  return {normal.x, normal.y, normal.z, turn.x, turn.y, turn.z, dot(arm, normal)};
}

/// Standard deviation of the deviation at a point that comes from the pose alone.
[[nodiscard]] double pose_sigma_mm(const Registration& registration, Vec3 point_mm, Vec3 normal);

}  // namespace maquette::scan

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file datums.hpp
/// Registration on features that a coat, a form error or a worn cutter has not changed: bare
/// pads, spheres, dowels. Beside it the best fit, and what that absorbed.
///
/// A best fit moves the scan until deviations are small, so an even coat, a wrong tool length or a
/// tilt of the table disappear in the pose. On datums they stay in the deviation.

#include <span>
#include <string>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "heightmap/height_field.hpp"
#include "scan/register.hpp"

namespace maquette::scan {

inline constexpr ErrorCode kDatums{"SCAN_DATUMS"};

struct Datum {
  enum class Kind { pad, sphere, dowel } kind = Kind::pad;
  std::string name;
  Vec3 at_mm;              ///< middle of the pad (z is ignored: the design's), centre of the
                           ///< sphere, end of the dowel
  double radius_mm = 0.0;  ///< sphere, dowel
  double half_x_mm = 0.0, half_y_mm = 0.0;  ///< pad: a rectangle along x and y
  Vec3 axis{0.0, 0.0, 1.0};                 ///< dowel: unit, from its end
  double length_mm = 0.0;                   ///< dowel
};

struct DatumFit {
  std::string name;
  std::size_t points = 0;
  double mean_mm = 0.0, noise_mm = 0.0;  ///< of the residuals after the registration on datums
};

struct DatumRegistration {
  Registration registration;
  std::vector<DatumFit> datums;
};

/// @param best_fit  where to begin: it must bring each datum to within `reach_mm`
/// @return as register_scan, but without its checks of relief, or SCAN_DATUMS: no datum, an
///   impossible one, or one that fewer than 10 points lie on (the message names it)
[[nodiscard]] Result<DatumRegistration> register_datums(
    const Cloud& cloud, const heightmap::ModelField& design, std::span<const Datum> datums,
    const RigidTransform& best_fit, double reach_mm = 2.0, const RunContext& run = {});

/// Deviations at the datum pose minus those at the best fit, over all of the design: what the best
/// fit took away, along the normal.
struct Absorbed {
  double mean_mm = 0.0, rms_mm = 0.0, min_mm = 0.0, max_mm = 0.0;
  double sigma_mm = 0.0;  ///< of the mean, from both covariances
};
[[nodiscard]] Absorbed absorbed_by(const Registration& best_fit, const Registration& datums,
                                   const heightmap::ModelField& design);

}  // namespace maquette::scan

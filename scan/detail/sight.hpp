// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file sight.hpp
/// The beam that has measured a point, as parallel rays: over the depth of a part it keeps its
/// width.

#include <cstdint>
#include <span>
#include <vector>

#include "scan/detail/beam.hpp"
#include "scan/viewpoint.hpp"

namespace maquette::scan::detail {

/// How well the beam's shape is known, and few rays stand for it: that much of the depth within a
/// beam is uncertain.
inline constexpr double kBeamShape = 0.1;

/// The line from the scanner to a point.
struct Sight {
  Vec3 from_mm, direction;  ///< unit
  double range_mm = 0.0;
};
[[nodiscard]] Sight sight_of(const Viewpoint& view, Vec3 point_mm);

/// Shares of energy of a viewpoint's rays: one, or 19.
[[nodiscard]] std::vector<BeamSample> rays_of(const Viewpoint& view);

/// One ray for each sample. The pattern is turned by an angle that belongs to the point.
void spread(const Sight& sight, const Viewpoint& view, std::span<const BeamSample> samples,
            std::uint64_t point, std::span<Ray> rays);

}  // namespace maquette::scan::detail

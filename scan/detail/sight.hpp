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

/// Of beams that pass an edge. What part of the energy goes by is known to a twelfth by 19 rays,
/// differently for each beam; and whoever then chooses by them the beams that count, or weighs by
/// them, chooses those whose error has one sign. 48 know it to a fiftieth. None for single rays.
[[nodiscard]] std::vector<BeamSample> edge_rays_of(const Viewpoint& view);

/// Depth within a beam, each of its rays the same: also where only the outermost pass an edge. To
/// be counted from near the beam's middle, for it is squared.
class BeamDepth {
 public:
  void add(double depth_mm, double x, double y);
  [[nodiscard]] double whole_mm() const;
  /// What a plane does not explain. Rays that know means of smooth surfaces do not know those of
  /// what remains, if it is large.
  [[nodiscard]] double beyond_plane_mm() const;

 private:
  double met_ = 0.0, sum_ = 0.0, square_ = 0.0, along_x_ = 0.0, along_y_ = 0.0;
  double x_ = 0.0, y_ = 0.0, xx_ = 0.0, xy_ = 0.0, yy_ = 0.0;
};

/// More of the noise than that beyond a plane is an edge.
inline constexpr double kEdgeOfNoise = 0.25;

/// One ray for each sample. The pattern is turned by an angle that belongs to the point.
void spread(const Sight& sight, const Viewpoint& view, std::span<const BeamSample> samples,
            std::uint64_t point, std::span<Ray> rays);

}  // namespace maquette::scan::detail

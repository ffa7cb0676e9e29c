// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file probing.hpp
/// Blocks that touch the work with a probe (G38.2): to set the work offset on the block's
/// corner, and to measure reference spheres that later tie scans to the machine. And the seats of
/// those spheres.
///
/// The blocks are text for ProgramWriter::lines(), in the model frame of an offset that is already
/// right to within `search`. They need a probe in the spindle as the current tool: z is
/// the probe ball's lowest point. They leave modes as they found them (G21 G90, no G91).
///
/// Each face is touched twice: fast, back by `retract`, slowly. Where the control keeps the place
/// of contact (LinuxCNC: #5061 to #5063, in the current offset), the new offset is the old one plus
/// what the contact is off its nominal place; how far the axis ran on while braking does not enter.
/// GRBL does not let a program see the contact: there the place where it stopped is set,
/// off by the way of braking, v^2 / 2 a (0.02 um at 10 mm/min and 300 mm/s^2 is far below what the
/// probe repeats).
/// Sources: LinuxCNC 2.9, "G Codes": G10 L2, G10 L20, G38.n, "Overview": PROBEOPEN, numbered
/// parameters 5061 and 5220 ff.; Grbl 1.1, "Commands".

#include <cmath>
#include <span>
#include <string>

#include "cnc/toolpath.hpp"
#include "core/result.hpp"
#include "core/vec.hpp"

namespace maquette::cnc {

inline constexpr ErrorCode kProbingOptionOutOfRange{"CNC_PROBING_OPTION_OUT_OF_RANGE"};
inline constexpr ErrorCode kProbingNotPossible{"CNC_PROBING_NOT_POSSIBLE"};

struct ProbingOptions {
  std::string post = "linuxcnc";  ///< or "grbl"
  int work_offset = 54;           ///< 54 .. 59; on LinuxCNC also 591 .. 593
  double ball_radius_mm = 1.0;    ///< of the probe
  double search_mm = 10.0;        ///< how far off a face may be; rapids keep this distance
  double retract_mm = 1.0;        ///< less than search
  double fast_feed_mm_min = 200.0, slow_feed_mm_min = 10.0;
  double over_mm = -INFINITY;  ///< probe_spheres: rapids between touches are at least as high
};

/// The corner with the smallest x and y of a block whose top is level.
struct BlockCorner {
  double x_mm = 0.0, y_mm = 0.0, top_mm = 0.0;
  double inset_mm = 10.0;  ///< from the corner to where the faces are touched, along the other axis
  double depth_mm = 5.0;   ///< of the probe's tip below the top when it touches a side
};

/// Sets z on the top, then x and y on the two sides. Ends above the corner.
/// @return CNC_PROBING_OPTION_OUT_OF_RANGE with option, value and range; CNC_PROBING_NOT_POSSIBLE
///         for a control without G38.2, with what to do
[[nodiscard]] Result<std::string> probe_block_corner(const BlockCorner& corner,
                                                     const ProbingOptions& options);

/// Five touches a sphere: on top, and from -x, +x, -y, +y at the height of the centre. LinuxCNC
/// writes them to `log_name` (PROBEOPEN), a line for the fast and one for the slow touch, in this
/// order: x y z of the probe's tip (probed_spheres.hpp reads them); the probe's centre is a ball
/// radius above, and lies sphere radius + ball radius from the sphere's centre. LinuxCNC only.
/// @param centres_mm  as planned; right to within `search`
/// @pre log name without parenthesis or line end
/// @return as probe_block_corner
[[nodiscard]] Result<std::string> probe_spheres(std::span<const Vec3> centres_mm,
                                                double sphere_radius_mm,
                                                const std::string& log_name,
                                                const ProbingOptions& options);

/// A round hole on whose rim a reference sphere rests, its centre `sqrt(R^2 - r^2)` above the rim.
struct SphereSeat {
  double x_mm = 0.0, y_mm = 0.0;
  double rim_mm = 0.0;  ///< level surface around it
  double hole_radius_mm = 5.0;
  double sphere_radius_mm = 10.0;
  double below_mm = 0.5;  ///< room between the sphere's lowest point and the floor
};

[[nodiscard]] double seated_centre_z_mm(const SphereSeat& seat);

struct BoreOptions {
  double cutter_radius_mm = 3.0;  ///< flat end; cuts over its centre
  double ramp_angle_deg = 3.0;    ///< of the helix, 0.5 .. 30
  double feed_mm_min = 1000.0;
  double clearance_mm = 2.0;
};

/// Down a helix along the wall, once round on the floor, and from there to the middle and up.
/// Starts and ends `clearance` above the rim. Leaves no core: hole radius <= 2 cutter radii.
/// @return CNC_PROBING_OPTION_OUT_OF_RANGE with option, value and range
[[nodiscard]] Result<Toolpath> bore_sphere_seat(const SphereSeat& seat, const BoreOptions& options);

}  // namespace maquette::cnc

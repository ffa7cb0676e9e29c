// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file probed_spheres.hpp
/// What a probe has touched of reference spheres -> where their centres are.
///
/// Takes   the file that a program of probe_spheres() has had written: one line a touch, the place
///         of the probe's tip in the work offset, x y z first (LinuxCNC: nine numbers). Ten a
///         sphere: five places, each touched fast and then slowly; the slow one counts.
/// Gives   the centres by least squares of |tip + ball radius - centre| = sphere radius + ball
///         radius, the radii being known. Five places and three unknowns: two equations are left
///         to show a wrong radius, a chip on the sphere, or a touch of something else.
/// Accuracy  exact for exact touches (1e-9 mm). Of a touch's error s the centre gets s / sqrt 2 in
///         x and y and 0.9 s in z. With a ball radius wrong by d, and a plan right to a quarter of
///         the two radii, the centre is off by at most 1.2 d, and the residual is 0.6 d and more.

#include <filesystem>
#include <span>
#include <string>
#include <vector>

#include "core/result.hpp"
#include "core/vec.hpp"

namespace maquette::cnc {

inline constexpr ErrorCode kProbedContacts{"CNC_PROBED_CONTACTS"};

/// A touch farther than this off the sphere that fits best is not that of a sphere.
inline constexpr double kContactResidual_mm = 0.05;
/// Touches of one sphere, fast and slow ones.
inline constexpr std::size_t kTouchesPerSphere = 10;

struct ProbedSphere {
  Vec3 centre_mm;
  double residual_mm = 0.0;  ///< of the slow touches, the largest
};

/// @return the tips; CNC_PROBED_CONTACTS with file and line where a line has not three numbers;
///         CORE_FILE_*
[[nodiscard]] Result<std::vector<Vec3>> read_contacts(const std::filesystem::path& file);

/// @param tips     in the order of the program, kTouchesPerSphere for each planned centre
/// @param farthest_mm  that a centre may be off its plan
/// @return one a planned centre; CNC_PROBED_CONTACTS with the number of the sphere, counted from 1,
///         and what does not fit
[[nodiscard]] Result<std::vector<ProbedSphere>> spheres_of_contacts(
    std::span<const Vec3> tips, std::span<const Vec3> planned_mm, double sphere_radius_mm,
    double ball_radius_mm, double farthest_mm);

}  // namespace maquette::cnc

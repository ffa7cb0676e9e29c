// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// Causes that only the poses of the measurements show, since registration takes all of them:
// a height that is the same in all scans (tool length), a shift along each scan's own beam (range
// bias), one scan that stands apart (registration).
//
// Every pose is also wrong by itself, by amounts nobody has declared: one for shifts, one for
// turns, for good turns say nothing about shifts. It is taken from the shifts' own other
// components, beside what the fit does not know of them: a pattern counts if it is out of all
// proportion to them (Student's t with as many degrees of freedom as shifts are left). With one
// scan there are two, so only gross patterns count. Shifts that the causes found bring along are no
// finding. Where all scans lean the same way it is the part that does: then a pattern of shifts
// alone is no answer, and what makes both (wear, growth along the program) is named, or nothing.
// Causes that registration takes almost whole (an even coat) are weighed by poses and residuals
// together: equivalent, or named instead.

#include "diagnosis/detail/model_search.hpp"
#include "diagnosis/diagnose.hpp"

namespace maquette::diagnosis::detail {

/// Whether one of `causes`, or of those that may stand in their place, shifts the whole part along
/// an axis ('x', 'y', 'z', or 'r': each scan along its beam) by an amount that nobody knows.
[[nodiscard]] bool shift_unknown(const std::vector<Cause>& causes, char axis);

/// How far the pose of a file, as it was found, leaves a point of it off, in the model frame.
[[nodiscard]] Vec3 pose_error(Vec3 point, const PoseEstimate& pose, const SetUp& set_up);

void add_pose_causes(const Measurements& measurements, const Bank& bank,
                     const std::vector<Member>& members, const std::vector<Candidate>& candidates,
                     const Fit& fit, Diagnosis& diagnosis);

}  // namespace maquette::diagnosis::detail

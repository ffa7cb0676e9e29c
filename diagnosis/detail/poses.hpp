// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// Causes that only the poses of the measurements show, since registration takes all of them:
// a height that is the same in all scans (tool length), a shift along each scan's own beam (range
// bias), one scan that stands apart (registration).
//
// Every pose is also wrong by itself, by an amount nobody has declared. It is taken from the
// poses' own other components: a pattern counts if it is out of all proportion to them (Student's
// t with as many degrees of freedom as components are left). With one scan there are five, so
// only gross patterns count, and all look-alikes are named together.

#include "diagnosis/diagnose.hpp"

namespace maquette::diagnosis::detail {

void add_pose_causes(const Measurements& measurements, Diagnosis& diagnosis);

}  // namespace maquette::diagnosis::detail

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file scan_planes.hpp
/// Registration beside generalised ICP from plane to plane (Segal, Haehnel and Thrun 2009,
/// doi:10.15607/RSS.2009.V.021).

#include <cstddef>

namespace maquette::scan {

/// Prints errors (rms over points and runs) and CPU seconds, for noise that is alike everywhere and
/// for noise that grows with range and incidence; then once with `points` on a part of 2 m x 2 m.
void beside_plane_to_plane(int runs, std::size_t points);

}  // namespace maquette::scan

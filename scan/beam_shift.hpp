// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file beam_shift.hpp
/// What a beam's width does to ranges, taken out again.
///
/// A beam does not measure the surface at its middle but a mean over its width: tops of stones come
/// out lower, pits higher (by w^2 / (4 R) where the surface has radius R and the beam 1/e^2 radius
/// w). That is no deviation of the part. The beam's rays are followed to the surface that is
/// expected, and each point is moved along its line of sight by the difference between their mean
/// (by energy, cosine and distance) and the ray in the middle.
///
/// Stones    are followed as meshes. Under the overhang of one a beam goes on to where an upper
///           envelope has a wall: the ground at its foot would come out low, by a tenth of what the
///           stone recedes there.
/// Accuracy  The surface must be known: where the part differs from it, the correction is that of
///           the wrong surface. On waves of two beams' width what is left is below a tenth
///           (tests/scan/scan_beam_test). Where a beam passes an edge (more depth beyond a
///           plane than the noise), 48 rays stand for it instead of 19; where a tenth of the depth
///           in it, beyond a plane's, is more than the noise, the point is given up, for nobody
///           knows a beam's shape better.

#include <cstddef>
#include <span>
#include <vector>

#include "core/result.hpp"
#include "core/run_context.hpp"
#include "core/tri_mesh.hpp"
#include "core/vec.hpp"
#include "heightmap/height_field.hpp"
#include "scan/viewpoint.hpp"

namespace maquette::scan {

/// How far along its line of sight each point must be moved back towards the scanner (mm; negative:
/// away), NaN for one that is given up: also where the middle meets nothing but another part of the
/// beam does. Zero for rays and where the whole beam meets nothing.
/// @param points_mm  in the surface's frame
/// @param views      of the points in their order
/// @param surface    what is expected, without those stones that are given as meshes
/// @param stones     closed, where they are expected
/// @param noise_mm   of single points
/// @return the shifts, or CORE_CANCELLED, SCAN_EMBREE_FAILED
[[nodiscard]] Result<std::vector<float>> beam_shifts_mm(std::span<const Vec3> points_mm,
                                                        std::span<const Viewpoint> views,
                                                        const heightmap::ModelField& surface,
                                                        std::span<const TriMesh> stones,
                                                        double noise_mm,
                                                        const RunContext& run = {});

}  // namespace maquette::scan

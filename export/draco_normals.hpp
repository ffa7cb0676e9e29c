// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file draco_normals.hpp
/// Normals rounded so that Draco stores them in few bytes.
///
/// Draco (speeds below 4) predicts a vertex's normal from the positions that the decoder has: the
/// sum of its triangles' cross products, cut off to an octahedral grid of whole numbers. What it
/// stores is the difference to the normal that it was given, rounded to the same grid. Rounding
/// both makes differences even where they agree. Here the grid is eight times as fine as what is
/// asked for, and each normal moves to the prediction plus a multiple of eight: most differences
/// are then zero.
///
/// Accuracy: each octahedral coordinate within 0.6 of a step of the grid that was asked for,
///           1.2 / (2^bits - 2); with 7 bits 2.4 degrees at most (0.5 rms, 1.6 the most
///           seen on fractal ground).
///
/// Octahedral coordinates: y and z of the normal whose |x| + |y| + |z| is one. Where x is positive
/// Draco uses them as they are; elsewhere they are folded, so up must be x.
/// Deering 1995, doi:10.1145/218380.218391 (prediction and rounding); Meyer et al. 2010,
/// doi:10.1111/j.1467-8659.2010.01737.x (octahedron).

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "export/draco_piece.hpp"

namespace maquette::exporting {

struct DracoNormals {
  std::vector<Float3> values;  ///< not of length one: Draco takes directions
  int bits = 0;                ///< DracoSettings::normal_bits for these
};

/// @param positions  whole numbers below 2^24, quantised by Draco with a step of 1
/// @param normals  of the same length, x > 0
/// @param shared  vertices that other meshes have, too: rounded on the coarse grid, so that they
/// get
///     the same normal in each
/// @param bits  of the grid that is asked for, 4 to 16
[[nodiscard]] DracoNormals draco_normals(std::span<const Float3> positions,
                                         std::span<const Float3> normals,
                                         std::span<const std::array<std::uint32_t, 3>> triangles,
                                         const std::vector<bool>& shared, int bits);

}  // namespace maquette::exporting

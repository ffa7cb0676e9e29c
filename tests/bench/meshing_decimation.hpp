// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

#include <cstddef>
#include <cstdint>
#include <string>

namespace maquette::meshing {

/// Fractal terrain to so many triangles by decimate_surface, plain greedy insertion, OpenMesh's
/// quadrics (up to 1001 nodes a side) and, where its program is given, hmm: errors at every node,
/// found by one and the same scan of each mesh, speed, memory.
/// @param hmm     the program (github.com/fogleman/hmm); empty: without
/// @param folder  for its files
void decimate_case(std::ptrdiff_t nodes, std::uint64_t triangles, const std::string& hmm,
                   const std::string& folder);

}  // namespace maquette::meshing

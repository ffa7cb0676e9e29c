// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file path_certificate.hpp
/// How deep a program of a ball nose cuts below a surface, proven without a grid of cells.
///
/// Takes   motions (gcode_reader.hpp) in program order, in pieces of any size
/// Gives   the deepest gouge found, and a depth that is nowhere exceeded
///
/// Method. A ball with its tip at (p, z) cuts below the surface point q by
/// h(q) + sqrt(R^2 - |p - q|^2) - R - z; the largest over q is f(p) - z, f being the exact cutter
/// location (cutter_location.hpp). So the gouge of a program, measured vertically, is the
/// supremum of f - z along its path: facts about a curve, exact in principle. f - z is taken at the
/// ends of each motion; between two places h apart
///   f - z <= the larger of both ends, raised by the parabola of second derivative -C that
///            joins them,  C = R^2 / w^3 + what the path's own curvature adds
///   f - z <= the tent of slope L = sqrt(R^2 / w^2 - 1) over the ends
///   f - z <= highest surface in reach - lowest tip
/// with w the least depth of a contact below the ball's centre (steepness.hpp). Intervals whose
/// bound is above what matters are halved. Derivation: docs/derivations/path_proof.md
///
/// Accuracy. max_gouge is reached at a place of the path (within 1e-9 mm); proven is an upper
/// bound for the continuous path over the continuous surface, arcs included. Beyond the outline
/// contacts are bounded by height alone. The path is the written one: what the control may leave
/// it by (G64 P) comes on top, see share_tolerance (mill.hpp). A gouge deeper than `limit` is found
/// wherever it is, unless `undecided` says how many intervals were given up. Cost. About four drops
/// for each block of a finishing pass; 100 bytes a motion of a batch.

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "cnc/gcode_reader.hpp"
#include "cnc/tool.hpp"
#include "core/result.hpp"
#include "core/run_context.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::cnc {

struct PathProofOptions {
  /// Motions that gouge deeper are counted and their places listed. Where nothing does, the
  /// proof only goes as far as showing that.
  double limit_mm = 0.005;
  /// Beyond the limit, the deepest gouge is pinned down to this.
  double resolution_mm = 0.0002;
  std::size_t most_places = 1000;  ///< listed
};

struct PathGouge {
  double x_mm = 0.0, y_mm = 0.0;  ///< on the surface, where the ball cuts deepest
  double depth_mm = 0.0;
  std::size_t program = 0;
  std::uint64_t line = 0;  ///< of the program
};

struct PathCertificate {
  double max_gouge_mm = 0.0;  ///< >= 0
  double proven_mm = 0.0;     ///< >= max_gouge; no place of the path cuts deeper
  std::uint64_t motions = 0, drops = 0;
  std::uint64_t gouging_motions = 0;  ///< deeper than the limit
  std::uint64_t undecided = 0;        ///< intervals given up; contained in `proven`
  /// Deeper than the limit, deepest first, at least a ball's radius apart.
  std::vector<PathGouge> places;
};

/// Same motions in the same order, same result, for any number of threads and however they are
/// portioned.
class PathProof {
 public:
  /// @pre surface has at least 2 x 2 nodes, all finite, and outlives this; radius > 0
  PathProof(const heightmap::ModelField& surface, BallNose tool, PathProofOptions options = {});
  PathProof(const PathProof&) = delete;
  PathProof& operator=(const PathProof&) = delete;
  ~PathProof();

  /// @param program  its number, where there are several
  void add(std::span<const Motion> motions, std::size_t program = 0);
  /// Call once, after the last add.
  [[nodiscard]] PathCertificate finish();

 private:
  struct State;
  std::unique_ptr<State> state_;
};

}  // namespace maquette::cnc

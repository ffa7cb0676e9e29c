// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file cutter_proof.hpp
/// A depth below a surface that a program of any cutter nowhere exceeds, proven without a grid of
/// cells. Made for roughing, whose allowance makes coarse steps do; of balls path_certificate.hpp
/// knows more.
///
/// Takes   motions (gcode_reader.hpp), in pieces of any size
/// Gives   the bound, measured vertically
///
/// Method. Wherever the cutter stands on a piece of path that reaches a to both sides of its middle
/// in plan, it lies within the cutter widened sideways by a (cutter_shape.hpp) that stands at the
/// middle, tip at the piece's lowest. So the exact cutter location of the wide one there, less that
/// tip, bounds the gouge of the whole piece. Pieces whose bound is above the limit are parted, down
/// to kFinestHalf_mm; what cannot be decided there goes into the bound as it is.
/// Accuracy. Above the true gouge by up to 2 kFinestHalf_mm times the slope of path or surface; not
/// above the limit wherever the cutter keeps a distance of kFinestHalf_mm sideways.
/// Cost. One to four drops a millimetre of roughing path; up to four copies of the surface.

#include <array>
#include <memory>
#include <optional>
#include <span>

#include "cnc/cutter_location.hpp"
#include "cnc/gcode_reader.hpp"

namespace maquette::cnc {

inline constexpr double kFinestHalf_mm = 1.0 / 64.0;

class CutterProof {
 public:
  /// @pre surface has at least 2 x 2 nodes, all finite, and outlives this
  CutterProof(const heightmap::ModelField& surface, const Cutter& cutter, double limit_mm);

  void add(std::span<const Motion> motions);
  /// Of what was added, >= 0.
  [[nodiscard]] double proven_mm() const { return proven_mm_; }

 private:
  static constexpr int kLevels = 4;  // halves of 1, 1/4, 1/16, 1/64 mm
  [[nodiscard]] const DropCutter& at_level(int level);
  [[nodiscard]] double bound(Vec3 from, Vec3 to, int level) const;

  const heightmap::ModelField& surface_;
  Cutter cutter_;
  double limit_mm_, proven_mm_ = 0.0;
  std::array<std::optional<DropCutter>, kLevels> wide_;  // made when first needed
};

}  // namespace maquette::cnc

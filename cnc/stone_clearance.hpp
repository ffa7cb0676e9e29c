// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file stone_clearance.hpp
/// Whether a program meets stones that stand on the part while it is milled: cutters, and what is
/// above their flutes.
///
/// Takes   the design, the design with its stones, cutters, motions in program order
/// Gives   how many motions meet a stone, and the first of them with place and line
///
/// Method. Balls go by their exact cutter location on the design with stones (path_certificate.hpp)
/// and may be as deep in it as kStoneDepth_mm. Other cutters, shanks and holders are swept over
/// the heights of the stones at the design's nodes (milling_sim.hpp): what meets a stone
/// between nodes only is not seen, so allow them a node's distance. A cutter that has hit a
/// stone takes it away there; what follows meets what is left of it.

#include <map>
#include <memory>
#include <span>
#include <vector>

#include "cnc/milling_sim.hpp"
#include "cnc/path_certificate.hpp"
#include "cnc/verify.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::cnc {

struct StoneMeetings {
  std::uint64_t cutters = 0, holders = 0;  ///< motions that meet stones
  /// The first of each, at most 10: of a ball where it is deepest in a stone, else where the
  /// motion ends.
  std::vector<MotionPlace> first_cutters{}, first_holders{};
};

class StoneClearance {
 public:
  /// @pre fields with the same nodes, which outlive this; at least one cutter
  StoneClearance(const heightmap::ModelField& design, const heightmap::ModelField& with_stones,
                 std::vector<Cutter> cutters);
  StoneClearance(const StoneClearance&) = delete;
  StoneClearance& operator=(const StoneClearance&) = delete;

  void add(std::span<const Motion> motions, std::uint16_t cutter, std::size_t program);
  /// Call once, after the last add.
  [[nodiscard]] StoneMeetings finish();

 private:
  void sweep(std::span<const Motion> motions, std::uint16_t cutter, std::size_t program);

  const heightmap::ModelField& with_stones_;
  std::vector<Cutter> cutters_;
  MillingSim stones_;
  std::map<std::uint16_t, std::unique_ptr<PathProof>> balls_;
  StoneMeetings found_;
};

}  // namespace maquette::cnc

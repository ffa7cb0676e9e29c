// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file motion_store.hpp
/// Motions of whole programs, packed, to be gone through again band by band.
///
/// Cost: 40 bytes a motion, 24 more an arc; 16 M moves in 640 MB. Going through a strip of y skips
/// chunks of 4096 motions that do not touch it.

#include <cstdint>
#include <deque>
#include <functional>
#include <vector>

#include "cnc/gcode_reader.hpp"

namespace maquette::cnc {

class MotionStore {
 public:
  /// @param cutter  what makes the motion, a number of the caller's
  void add(const Motion& motion, std::uint16_t cutter);
  [[nodiscard]] std::size_t size() const { return size_; }

  /// A motion, bit for bit as it was added but for its feed (single precision), with its index.
  struct Stored {
    Motion motion;
    std::uint32_t index;
    std::uint16_t cutter;
  };
  /// Motions in chunks that come nearer than `reach_mm` to y_min .. y_max, in program order.
  void for_each(double y_min, double y_max, double reach_mm,
                const std::function<void(const Stored&)>& visit) const;

 private:
  struct Packed {
    Vec3 to;
    float feed;
    std::uint32_t line, arc;
    std::uint8_t kind, plane;
    std::uint16_t cutter;
  };
  struct Arc {
    double first, second, sweep;  // centre in the plane's own axes
  };
  struct Chunk {
    Vec3 start;
    double y_min, y_max;
    std::uint32_t first_index;
    std::vector<Packed> motions;
  };
  Chunk& open_chunk(Vec3 from);

  std::deque<Chunk> chunks_;
  std::deque<Arc> arcs_;
  std::size_t size_ = 0;
  Vec3 at_{};
};

}  // namespace maquette::cnc

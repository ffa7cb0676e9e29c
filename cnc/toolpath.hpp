// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file toolpath.hpp
/// What strategies give and programs are written from: moves of the tip in the model frame,
/// in ticks of 0.0001 mm, so that what is certified is what is written.

#include <cstdint>
#include <limits>
#include <vector>

namespace maquette::cnc {

inline constexpr double kTick_mm = 1e-4;
[[nodiscard]] inline double mm_of_ticks(std::int64_t ticks) {
  return static_cast<double>(ticks) / 10000.0;  // the double that reading the decimal gives
}

enum class ArcPlane : std::uint8_t { xy, zx, yz };  ///< G17, G18, G19

/// Coordinates in ticks.
struct ToolPosition {
  static constexpr std::int64_t kUnknown = std::numeric_limits<std::int64_t>::min();
  std::int64_t x = kUnknown, y = kUnknown, z = kUnknown;
  friend bool operator==(const ToolPosition&, const ToolPosition&) = default;
};

struct PathMove {
  enum class Kind : std::uint8_t { rapid, line, arc };
  Kind kind = Kind::line;
  ArcPlane plane = ArcPlane::xy;
  bool counter_clockwise = false;  ///< arcs: G3, seen from the positive end of the plane's normal
  ToolPosition to;                 ///< all known
  /// Arcs of less than one turn: centre minus the start of the move, ticks (I, J, K). The one
  /// along the plane's normal is 0. Start and end need not lie on one circle to better than
  /// a tick; the move is helical where the normal's coordinate changes.
  std::int64_t i = 0, j = 0, k = 0;
  double feed_mm_min = 0.0;  ///< lines and arcs
  /// Ticks, > 0: instead of a centre, of an arc of less than half a turn (R). It passes through
  /// both its ends exactly, and a third of its bytes are saved. arc_geometry.hpp has its centre.
  std::int64_t radius = 0;
};

/// How a control goes round corners.
struct PathControl {
  enum class Mode {
    exact_stop,  ///< G61.1: every move ends at rest
    exact_path,  ///< G61: at rest unless the next move goes on in the same direction
    blend,       ///< G64 P
  };
  Mode mode = Mode::blend;
  double tolerance_mm = 0.0005;  ///< P; 0: a quarter of the shorter move
  bool stated = true;            ///< blend: false where the tolerance is assumed (G5.1 Q1)
};

/// Unbroken: each move starts where the one before ended.
struct Toolpath {
  ToolPosition start;
  std::vector<PathMove> moves;
};

}  // namespace maquette::cnc

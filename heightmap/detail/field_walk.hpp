// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file field_walk.hpp
/// The walk of a ray through the pyramid of a height field, compiled once for each instruction set.
/// Plain data only: a file that is compiled for a newer processor may not share inline functions
/// with the rest of the program.

#include <cstddef>
#include <cstdint>

namespace maquette::heightmap::detail {

/// Least and greatest heights of one level, in blocks of 4 x 4 boxes.
struct WalkLevel {
  const float* low;
  const float* high;
  std::int64_t block_cols;
};
struct WalkField {
  const float* z_mm;
  std::int64_t rows, cols;  ///< nodes
  double x0_mm, y0_mm, spacing_mm;
  const WalkLevel* levels;  ///< leaves of 4 x 4 cells first, the last is one block
  std::int32_t level_count;
  double low_mm, high_mm;
  // The field's box, a millionth of its size larger than need be, and what follows from it.
  double low[3], high[3];
  double size_mm;
  double per_mm;           ///< cells
  double height_slack_mm;  ///< rounding of heights in single precision
};
/// From `from_mm` to `to_mm` along a unit direction, both excluded.
struct WalkRay {
  double origin_mm[3], direction[3];
  double from_mm, to_mm;
};
struct WalkHit {
  double distance_mm;
  std::int64_t row, col;  ///< cell; row < 0: nothing
  bool lower_right;
};

/// The first hit; any hit ends the walk if `any`.
/// Method: boxes are met in single precision, sixteen at a time and widened by what rounding can
/// do; the cells of a leaf are sieved the same way; what passes the sieve meets the watertight
/// test in double precision that field_tracer.hpp describes. So the answer is that of the test in
/// double over all triangles.
using Walk = void (*)(const WalkField& field, const WalkRay& ray, bool any, WalkHit& hit);
void walk_common(const WalkField& field, const WalkRay& ray, bool any, WalkHit& hit);
void walk_avx512(const WalkField& field, const WalkRay& ray, bool any, WalkHit& hit);

/// The same of many rays. Sixteen at a time go together where they are close: what holds them all
/// walks down to blocks of 16 leaves, so that the levels above are looked at once for all.
using WalkMany = void (*)(const WalkField& field, const WalkRay* rays, std::int64_t count, bool any,
                          WalkHit* hits);
void walk_many_common(const WalkField& field, const WalkRay* rays, std::int64_t count, bool any,
                      WalkHit* hits);
void walk_many_avx512(const WalkField& field, const WalkRay* rays, std::int64_t count, bool any,
                      WalkHit* hits);

struct Walks {
  Walk one;
  WalkMany many;
};
/// The fastest that this processor can run.
[[nodiscard]] Walks best_walks();
/// What the rest of the program is compiled for.
[[nodiscard]] Walks common_walks();

}  // namespace maquette::heightmap::detail

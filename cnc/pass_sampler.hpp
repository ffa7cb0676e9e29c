// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file pass_sampler.hpp
/// The exact cutter location along a line, sampled so densely that what happens between
/// two samples is bounded.
///
/// Between neighbouring samples a and b, h apart, the straight path lies nowhere deeper
/// below the exact cutter location than `gouge`, and nowhere higher above it than `dip`:
///   gouge <= min(K h^2 / 8, (L^2 - m^2) h / (2 L), highest - lower end)
///            K = R^2 / w^3, L = sqrt(R^2 / w^2 - 1), w: least contact depth
///            (steepness.hpp), m: slope from a to b
///   dip   <= A B / (A + B), A and B: how far the ball, rolling on over the contact of
///            one end, would be below the other end
/// Intervals where a bound is above its limit are halved, or cut where the two arcs meet.
/// Derivation: docs/derivations/path_between_samples.md

#include <cmath>
#include <cstdint>
#include <vector>

#include "cnc/cutter_location.hpp"
#include "cnc/steepness.hpp"
#include "cnc/toolpath.hpp"

namespace maquette::cnc {

/// Coordinates of what the strategies write are multiples of this: a resolution that every
/// control keeps, so that the same path is written for all.
inline constexpr std::int64_t kResolution = 10;  // ticks: 0.001 mm

/// Places on a straight line, all exactly on it and exactly representable: place k is at
/// (x + k dx, y + k dy) ticks. A line at another angle than the axes' has the nearest rational
/// direction instead of rounded places.
struct LatticeLine {
  std::int64_t x = 0, y = 0, dx = kResolution, dy = 0;  ///< multiples of kResolution

  [[nodiscard]] double x_mm(std::int64_t k) const { return mm_of_ticks(x + k * dx); }
  [[nodiscard]] double y_mm(std::int64_t k) const { return mm_of_ticks(y + k * dy); }
  [[nodiscard]] double step_mm() const {
    return kTick_mm * std::hypot(static_cast<double>(dx), static_cast<double>(dy));
  }
};

struct PathSample {
  std::int64_t place = 0;  ///< along the line
  double tip_mm = 0.0;     ///< to be aimed at: exact cutter location plus `lift`
  double lift_mm = 0.0;    ///< > 0 only beside walls that no step resolves; see sample_line
  double gouge_mm = 0.0;   ///< between this sample and the next, below the joined tips
  double dip_mm = 0.0;     ///< between this sample and the next, above
  bool stop = false;       ///< a move must end here, at whatever height (for fit_moves)
};

struct SamplingLimits {
  double gouge_mm = 0.0018;
  double dip_mm = 0.002;
};

/// Samples from place `from` to place `to` (ends included, from < to). The line lies inside
/// the outline. Where the shortest interval (2 um, or a step) still breaks the gouge limit (walls
/// steeper than about 75 : 1 along an axis), both its ends are lifted until it does not: the path
/// then leaves material rather than cutting too deep.
void sample_line(DropCutter& cutter, const SteepnessTiles& tiles,
                 const heightmap::ModelField& field, BallNose tool, const LatticeLine& line,
                 std::int64_t from, std::int64_t to, const SamplingLimits& limits,
                 std::vector<PathSample>& samples);

}  // namespace maquette::cnc

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file random_path.hpp
/// Toolpaths of all kinds of moves, for tests that write and read programs.

#include <cmath>
#include <numbers>
#include <vector>

#include "cnc/toolpath.hpp"
#include "core/random.hpp"

namespace maquette::cnc::testing_support {

struct RandomPath {
  std::vector<PathMove> moves;    ///< the first is a rapid
  std::vector<double> sweep_rad;  ///< of the arcs, > 0, as they were drawn; else 0
};

/// Rapids, lines of a tick to a metre, arcs in three planes of hundredths of a degree to almost
/// a turn and radii of ticks to metres, half of them helices.
inline RandomPath random_path(std::uint64_t seed, int moves) {
  std::uint64_t draw = 0;
  const auto uniform = [&](double low, double high) {
    return low + (high - low) * random_uniform(seed, draw++);
  };
  // From small to large, each size as often.
  const auto size = [&](double low, double high) {
    return std::exp(uniform(std::log(low), std::log(high)));
  };
  const auto sign = [&] { return random_bits(seed, draw++) % 2 != 0 ? 1.0 : -1.0; };
  constexpr double kReach = 1e7;  // ticks: one metre
  RandomPath path;
  std::array<std::int64_t, 3> at{0, 0, 500000};
  PathMove first;
  first.kind = PathMove::Kind::rapid;
  first.to = {at[0], at[1], at[2]};
  path.moves.push_back(first);
  path.sweep_rad.push_back(0.0);
  double feed = 1000.0;
  while (static_cast<int>(path.moves.size()) < moves) {
    PathMove m;
    double sweep = 0.0;
    std::array<std::int64_t, 3> to = at;
    if (uniform(0.0, 1.0) < 0.2) feed = std::round(size(1.0, 20000.0) * 100.0) / 100.0;
    m.feed_mm_min = feed;
    const double what = uniform(0.0, 1.0);
    if (what < 0.1) {
      m.kind = PathMove::Kind::rapid;
      m.feed_mm_min = 0.0;
      for (auto& c : to)
        if (uniform(0.0, 1.0) < 0.5) c = std::llround(uniform(-kReach, kReach));
      if (uniform(0.0, 1.0) < 0.5) to[2] = std::llround(uniform(200000.0, 600000.0));
    } else if (what < 0.55) {
      m.kind = PathMove::Kind::line;
      for (auto& c : to)
        if (uniform(0.0, 1.0) < 0.6) c += std::llround(sign() * size(0.5, 1e6));
    } else {
      m.kind = PathMove::Kind::arc;
      m.plane = static_cast<ArcPlane>(random_bits(seed, draw++) % 3);
      m.counter_clockwise = sign() > 0.0;
      const std::size_t third = m.plane == ArcPlane::xy ? 2 : m.plane == ArcPlane::zx ? 1 : 0;
      const std::size_t u = (third + 1) % 3, v = (third + 2) % 3;
      const double radius = size(20.0, 3e7), towards = uniform(0.0, 2.0 * std::numbers::pi);
      std::array<std::int64_t, 3> arm{};
      arm[u] = std::llround(radius * std::cos(towards));
      arm[v] = std::llround(radius * std::sin(towards));
      sweep = uniform(0.0, 1.0) < 0.3 ? uniform(0.1, 6.2) : size(1e-4, 6.2);
      const double turn = m.counter_clockwise ? sweep : -sweep;
      const double c = std::cos(turn), s = std::sin(turn);
      const auto du = static_cast<double>(-arm[u]), dv = static_cast<double>(-arm[v]);
      to[u] = at[u] + arm[u] + std::llround(c * du - s * dv);
      to[v] = at[v] + arm[v] + std::llround(s * du + c * dv);
      if (sign() > 0.0) to[third] += std::llround(sign() * size(1.0, 1e5));
      // Nearer than rounding can tell a short way from a whole turn: no arc as PathMove has it.
      if (std::hypot(static_cast<double>(to[u] - at[u]), static_cast<double>(to[v] - at[v])) < 4.0)
        continue;
      m.i = arm[0];
      m.j = arm[1];
      m.k = arm[2];
    }
    for (const auto c : to)
      if (std::abs(static_cast<double>(c)) > 2.0 * kReach) sweep = NAN;
    if (to == at || std::isnan(sweep)) continue;
    m.to = {to[0], to[1], to[2]};
    at = to;
    path.moves.push_back(m);
    path.sweep_rad.push_back(sweep);
  }
  return path;
}

}  // namespace maquette::cnc::testing_support

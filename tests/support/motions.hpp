// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file motions.hpp
/// Motions of programs for tests: from text, at random, and where they are at any moment.

#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <string>
#include <vector>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "cnc/gcode_reader.hpp"
#include "core/random.hpp"
#include "support/matchers.hpp"

namespace maquette::testing_support {

inline std::vector<cnc::Motion> motions_of(const std::string& text) {
  std::vector<cnc::Motion> all;
  const cnc::MotionSink sink = [&](std::span<const cnc::Motion> some) -> Result<void> {
    all.insert(all.end(), some.begin(), some.end());
    return {};
  };
  EXPECT_THAT(cnc::read_gcode_text(text, "test", sink), Succeeds());
  return all;
}

inline std::vector<cnc::Motion> motions_of_file(const std::filesystem::path& path) {
  std::vector<cnc::Motion> all;
  const cnc::MotionSink sink = [&](std::span<const cnc::Motion> some) -> Result<void> {
    all.insert(all.end(), some.begin(), some.end());
    return {};
  };
  EXPECT_THAT(cnc::read_gcode(path, sink), Succeeds());
  return all;
}

/// Place of a motion at a share of its way; arcs as the reader defines them.
inline Vec3 place_at(const cnc::Motion& m, double share) {
  if (m.kind != cnc::Motion::Kind::arc) return m.from_mm + share * (m.to_mm - m.from_mm);
  const std::size_t third = m.plane == cnc::ArcPlane::xy ? 2 : m.plane == cnc::ArcPlane::zx ? 1 : 0;
  const std::size_t first = (third + 1) % 3, second = (third + 2) % 3;
  const auto list = [](Vec3 v) { return std::array<double, 3>{v.x, v.y, v.z}; };
  const auto a = list(m.from_mm), b = list(m.to_mm), c = list(m.centre_mm);
  const double r0 = std::hypot(a[first] - c[first], a[second] - c[second]);
  const double r1 = std::hypot(b[first] - c[first], b[second] - c[second]);
  const double r = r0 + share * (r1 - r0);
  const double phi = std::atan2(a[second] - c[second], a[first] - c[first]) + share * m.sweep_rad;
  std::array<double, 3> p{};
  p[first] = c[first] + r * std::cos(phi);
  p[second] = c[second] + r * std::sin(phi);
  p[third] = a[third] + share * (b[third] - a[third]);
  return {p[0], p[1], p[2]};
}

/// Random numbers of a seed, one after the other.
class Draws {
 public:
  explicit Draws(std::uint64_t seed) : seed_(seed) {}
  double operator()(double lo, double hi) { return lo + (hi - lo) * random_uniform(seed_, n_++); }
  int pick(int count) { return static_cast<int>((*this)(0.0, count)); }

 private:
  std::uint64_t seed_, n_ = 0;
};

/// An arc that starts at `from`, in a random plane, of a random sweep from a thousandth to a
/// whole turn; `radius_error` and `helix` may be 0.
inline cnc::Motion random_arc(Draws& draw, Vec3 from, double radius, double radius_error,
                              double helix) {
  using cnc::ArcPlane;
  cnc::Motion m;
  m.kind = cnc::Motion::Kind::arc;
  m.plane = static_cast<ArcPlane>(draw.pick(3));
  m.from_mm = from;
  const double begin = draw(-std::numbers::pi, std::numbers::pi);
  m.sweep_rad = (draw(0.0, 1.0) < 0.5 ? 1.0 : -1.0) * std::pow(10.0, draw(-3.0, 0.79));
  const double end = begin + m.sweep_rad, r1 = radius + radius_error;
  const auto in_plane = [&](double u, double v, double w) {
    return m.plane == ArcPlane::xy   ? Vec3{u, v, w}
           : m.plane == ArcPlane::zx ? Vec3{v, w, u}
                                     : Vec3{w, u, v};
  };
  m.centre_mm = from - in_plane(radius * std::cos(begin), radius * std::sin(begin), 0.0);
  m.to_mm = m.centre_mm + in_plane(r1 * std::cos(end), r1 * std::sin(end), helix);
  if (helix == 0.0) {  // to the last bit, as the reader gives it
    if (m.plane == ArcPlane::xy) m.to_mm.z = from.z;
    if (m.plane == ArcPlane::zx) m.to_mm.y = from.y;
    if (m.plane == ArcPlane::yz) m.to_mm.x = from.x;
  }
  m.feed_mm_min = 100.0;
  return m;
}

}  // namespace maquette::testing_support

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// A zigzag over waves, and a part whose surface is the least of dense samples of the balls wherever
// a test has displaced their tips (shares no code with path_contact.hpp but to read the program).

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <filesystem>
#include <fstream>
#include <memory>
#include <optional>
#include <string>
#include <vector>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "core/random.hpp"
#include "diagnosis/diagnose.hpp"
#include "diagnosis/effect.hpp"
#include "diagnosis/path_contact.hpp"
#include "diagnosis/surface.hpp"
#include "support/matchers.hpp"

namespace maquette::diagnosis::zigzag_part {

inline constexpr double kRadius_mm = 3.0, kStepover_mm = 0.5, kSide_mm = 60.0, kSample_mm = 0.05;

/// @param stretch  of waves along all three axes: slopes stay as steep
inline double ground_mm(double x, double y, double stretch = 1.0) {
  x /= stretch, y /= stretch;
  return 10.0 + stretch * (1.6 * std::sin(x / 3.1 + 0.3 * std::sin(y / 5.0)) +
                           0.8 * std::cos(y / 4.3) + 0.5 * std::sin(0.7 * x - 0.4 * y));
}

inline Vec3 slope_normal(double x, double y, double stretch = 1.0) {
  constexpr double h = 1e-4;
  const auto z = [&](double dx, double dy) { return ground_mm(x + dx, y + dy, stretch); };
  return normalized(
      Vec3{-(z(h, 0.0) - z(-h, 0.0)) / (2.0 * h), -(z(0.0, h) - z(0.0, -h)) / (2.0 * h), 1.0});
}

/// Along xx, xy, yy.
inline std::array<float, 3> curvature_per_mm(double x, double y, double stretch = 1.0) {
  constexpr double h = 1e-3;
  const auto z = [&](double dx, double dy) { return ground_mm(x + dx, y + dy, stretch); };
  const double middle = z(0.0, 0.0);
  return {static_cast<float>((z(h, 0.0) - 2.0 * middle + z(-h, 0.0)) / (h * h)),
          static_cast<float>((z(h, h) - z(h, -h) - z(-h, h) + z(-h, -h)) / (4.0 * h * h)),
          static_cast<float>((z(0.0, h) - 2.0 * middle + z(0.0, -h)) / (h * h))};
}

using Passes = std::vector<std::vector<Vec3>>;  ///< tips

/// Tips along the zigzag, pass by pass.
inline Passes command(double stretch = 1.0) {
  Passes passes;
  const int count = static_cast<int>(kSide_mm / kSample_mm);
  for (double y = 0.0; y < kSide_mm + 1e-9; y += kStepover_mm) {
    std::vector<Vec3> pass;
    for (int i = 0; i <= count; ++i) {
      const double x = kSample_mm * (passes.size() % 2 == 0 ? i : count - i);
      const Vec3 n = slope_normal(x, y, stretch);
      pass.push_back(Vec3{x, y, ground_mm(x, y, stretch)} + kRadius_mm * n -
                     Vec3{0.0, 0.0, kRadius_mm});
    }
    passes.push_back(std::move(pass));
  }
  return passes;
}

inline double lowest_mm(const Passes& passes, double x, double y) {
  double low = INFINITY;
  for (const auto& pass : passes) {
    if (!(std::abs(y - pass.front().y) < kRadius_mm)) continue;
    for (const Vec3& t : pass) {
      const double q = kRadius_mm * kRadius_mm - (x - t.x) * (x - t.x) - (y - t.y) * (y - t.y);
      if (q > 0.0 && t.z < low) low = std::min(low, t.z + kRadius_mm - std::sqrt(q));
    }
  }
  return low;
}

/// Of a scanner beside the part; without, the surface is measured upright.
using Station_mm = std::optional<Vec3>;
inline const Station_mm kAside{{-800.0, 450.0, 750.0}};

/// @return false where no beam comes to the place
inline bool look(Observation& o, const Station_mm& station) {
  if (!station) return true;
  o.has_station = true;
  o.range_mm = norm(o.place - *station);
  o.beam = (1.0 / o.range_mm) * (o.place - *station);
  constexpr double kLeastCosine = 0.35;
  return dot(o.beam, o.slope_normal) < -kLeastCosine;
}

/// From the place to the cut surface along what it is measured by, along the normal.
inline double residual_mm(const Observation& o, const Passes& cut) {
  const Vec3 back = o.has_station ? -1.0 * o.beam : Vec3{0.0, 0.0, 1.0};
  const auto above = [&](double far) {
    const Vec3 q = o.place + far * back;
    return q.z - lowest_mm(cut, q.x, q.y);
  };
  double near = 0.0, at_near = above(0.0), far = -at_near, at_far = above(far);
  for (int k = 0; k < 8 && std::abs(at_far) > 1e-6; ++k) {
    const double next = far - at_far * (far - near) / (at_far - at_near);
    near = far;
    at_near = at_far;
    far = next;
    at_far = above(far);
  }
  return far * dot(back, o.normal);
}

inline Measurements part(const CutPath& path, const Passes& cut, const Station_mm& station,
                         double white_mm, std::uint64_t seed, double stretch = 1.0) {
  Measurements m;
  heightmap::ModelField corners;
  corners.spacing = Millimetres{kSide_mm};
  corners.z_mm = Grid<float>(2, 2, static_cast<float>(10.0 - 3.0 * stretch));
  corners.z_mm(1, 1) = static_cast<float>(10.0 + 3.0 * stretch);
  m.scene = scene_of(corners, &path, kRadius_mm);
  m.scene.has_station = {station.has_value()};
  m.scene.stations = {station.value_or(Vec3{})};
  m.set_ups.emplace_back();
  m.set_ups[0].name = "scan";
  m.set_ups[0].centre_mm = {0.5 * kSide_mm, 0.5 * kSide_mm, 10.0};
  for (std::uint64_t i = 0; i < 12'000; ++i) {
    const double x = 4.0 + (kSide_mm - 8.0) * random_uniform(seed, 2 * i),
                 y = 4.0 + (kSide_mm - 8.0) * random_uniform(seed, 2 * i + 1);
    std::vector<Rival> rivals;
    const auto contact = path.at(x, y, &rivals);
    Observation o;
    static_cast<CutState&>(o) = *contact;
    o.place = {x, y, contact->height_mm};
    o.normal = o.along = contact->normal;
    o.slope_normal = slope_normal(x, y, stretch);
    o.curvature_per_mm = curvature_per_mm(x, y, stretch);
    o.level_tip = o.place + kRadius_mm * (o.slope_normal - Vec3{0.0, 0.0, 1.0});
    o.rivals = std::make_shared<std::vector<Rival>>(std::move(rivals));
    o.pass = path.pass();
    if (!look(o, station)) continue;
    o.residual_mm = residual_mm(o, cut) + white_mm * random_normal(seed + 1, i);
    m.observations.push_back(std::move(o));
  }
  return m;
}

/// The program as it is written, every sample; the tool is changed before some passes.
inline CutPath written(const Passes& passes, const std::vector<std::size_t>& changes = {}) {
  const testing_support::ScratchFolder scratch;
  std::string text = "G21 G90 F2000\n";
  for (std::size_t k = 0; k < passes.size(); ++k) {
    if (std::find(changes.begin(), changes.end(), k) != changes.end()) {
      const Vec3& p = passes[k].front();
      text += fmt::format("G0 Z60\nT2 M6\nG0 X{:.5f} Y{:.5f}\n", p.x, p.y);
    }
    for (const Vec3& p : passes[k])
      text += fmt::format("G1 X{:.5f} Y{:.5f} Z{:.5f}\n", p.x, p.y, p.z);
  }
  std::ofstream(scratch / "part.ngc") << text << "M30\n";
  const std::vector<std::filesystem::path> files{scratch / "part.ngc"};
  return CutPath::read(files, kRadius_mm, {}).value();
}

/// The one cause that explains all of a part of these passes; none is a failure.
inline std::optional<Cause> only_cause(const Passes& passes, const Passes& cut, double white_mm,
                                       std::uint64_t seed, double stretch = 1.0) {
  const auto d = diagnose(part(written(passes), cut, std::nullopt, white_mm, seed, stretch), 1);
  EXPECT_TRUE(d.has_value());
  if (!d) return std::nullopt;
  EXPECT_EQ(d->verdict, "explained");
  EXPECT_EQ(d->causes.size(), 1U) << "seed " << seed;
  return d->causes.size() == 1 ? std::optional(d->causes[0]) : std::nullopt;
}

}  // namespace maquette::diagnosis::zigzag_part

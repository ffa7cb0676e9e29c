// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file challenge_world.hpp
/// What a case is made of, drawn from its seed: design, program, hidden effects, stations, noise.

#include <array>
#include <cmath>
#include <cstdint>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "challenge/challenge_case.hpp"
#include "core/vec.hpp"

namespace challenge {

using maquette::Vec3;
inline constexpr double kPi = 3.14159265358979323846;
inline constexpr double kSide = 160.0, kStep = 0.5;  // design
inline constexpr double kCell = 0.1;                 // cut surface, where it is looked for
inline constexpr double kBall = 3.0;
inline constexpr double kFeed = 3000.0;

struct Draw {
  std::mt19937_64 bits;
  double uniform(double a, double b) {
    return a + (b - a) * std::generate_canonical<double, 53>(bits);
  }
  double normal() { return std::normal_distribution<double>()(bits); }
  double sign() { return uniform(0, 1) < 0.5 ? -1.0 : 1.0; }
  double size(double a, double b) { return sign() * uniform(a, b); }
};

struct Field {
  int n = 0;
  double step = 1.0;
  std::vector<double> z;
  double& at(int r, int c) {
    return z[static_cast<std::size_t>(r) * static_cast<std::size_t>(n) +
             static_cast<std::size_t>(c)];
  }
  double at(int r, int c) const {
    return z[static_cast<std::size_t>(r) * static_cast<std::size_t>(n) +
             static_cast<std::size_t>(c)];
  }
  double height(double x, double y) const {
    const double u = std::clamp(x / step, 0.0, n - 1.000001),
                 v = std::clamp(y / step, 0.0, n - 1.000001);
    const int c = static_cast<int>(u), r = static_cast<int>(v);
    const double a = u - c, b = v - r;
    return (1 - b) * ((1 - a) * at(r, c) + a * at(r, c + 1)) +
           b * ((1 - a) * at(r + 1, c) + a * at(r + 1, c + 1));
  }
  Vec3 normal(double x, double y, double h) const {
    const double gx = (height(x + h, y) - height(x - h, y)) / (2 * h),
                 gy = (height(x, y + h) - height(x, y - h)) / (2 * h);
    return maquette::normalized(Vec3{-gx, -gy, 1.0});
  }
};

Field make_field(int n, double step);
/// A design: waves and craters, 160 mm a side.
Field draw_terrain(Draw& d);
/// Gaussian smoothing of a square field, reflected at the border.
Field smooth(const Field& f, double sigma_mm);
struct Sample {
  Vec3 p;
  double time, length;
  bool rapid = false;
  int pass = 0;
};

/// Tip of the ball that rests on a field of heights.
double drop(const Field& f, double x, double y);

struct Hidden {
  std::function<void(std::vector<Sample>&)> machine;     // moves the tip
  std::function<double(const Sample&)> radius;           // of the ball, tip held
  double radial = 0.0;                                   // runout
  std::function<Vec3(const Sample&, Vec3 normal)> bend;  // by the surface's normal
  std::function<void(Field&)> surface;                   // after the cut: heights
  std::function<Vec3(Vec3)> block;                       // of a measured place
  std::function<void(int scan, double& range, double& azimuth, double& elevation, double incidence)>
      scanner;
  double spot = 0.0;
  double size = 0.0;  ///< amplitude, mm or a ratio
};

/// Rough coat and smooth random part of the block; noise of ranges, mm.
struct Noise {
  double rough = 0, rough_length = 1, wavy = 0, wavy_length = 10, sigma = 0;
};

struct World {
  Field design;
  bool along_x = true;
  int bands = 1, passes = 0;
  std::string program;
  std::vector<Sample> path;
  double total_time = 0, total_length = 0;
  std::array<Vec3, 2> station, shift, rotation;  ///< of the scans
  std::vector<Hidden> hidden;                    ///< one for each effect
  std::string summary;
  Noise noise;
};
World draw_world(const Options& options, Draw& d);
/// One effect; draws the same numbers whatever its size.
Hidden hide(const std::string& effect, double size, const World& world, Draw& d,
            std::string& summary);

/// The surface that a scanner meets. On a grid, where rays look for it; where they have found it,
/// the balls themselves: on a grid of 0.1 mm the ridges between passes are so flat that 0.2 mm of
/// lost motion is found 1 to 2 % too small, on one of 0.2 mm 15 %.
struct Cut {
  struct Ball {
    Vec3 tip;
    double radius = 0.0;
    bool joined = false;  ///< came from the place of the one before
  };
  Field surface;                    ///< as measured
  Field bare;                       ///< as the balls left it
  std::vector<Ball> balls;          ///< in their order
  std::vector<std::uint32_t> made;  ///< by which ball each height of `bare` is
  double radial = 0.0;              ///< runout
  /// The lowest of the balls that made the heights about (x, y), carried along their way in steps
  /// of a fifth of what is between them (0.05 mm: 0.1 um), and what has come on since.
  double height(double x, double y) const;
};
/// Without random parts.
Cut cut_of(const World& world, const std::vector<Hidden>& hidden);

/// A height that nothing of the surface reaches.
double above(const Field& surface);

/// Where a scan's rays go: an even grid of angles.
struct Rays {
  Vec3 from;
  double az0 = 0, el0 = 0, half = 0, step = 0;
  template <class Ray>
  void each(const Ray& ray) const {
    for (double el = el0 - half; el < el0 + half; el += step)
      for (double da = -half / std::cos(el); da < half / std::cos(el); da += step / std::cos(el))
        ray(az0 + da, el);
  }
};
inline constexpr Vec3 kMiddle{kSide / 2, kSide / 2, 20};
Rays rays_of(const World& world, int scan, int points);

struct Echo {
  bool met = false;
  double range = 0, azimuth = 0, elevation = 0;  ///< as the scanner tells
  Vec3 normal, beam;                             ///< of the place it met
};
/// @param top  above(cut.surface)
Echo echo(const Cut& cut, double top, const std::vector<Hidden>& hidden, int scan, Vec3 from,
          double azimuth, double elevation);
inline Vec3 direction(double azimuth, double elevation) {
  return {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth),
          std::sin(elevation)};
}

}  // namespace challenge

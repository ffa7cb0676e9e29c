// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file observation.hpp
/// One measured coordinate and everything that a cause may act through.
///
/// A cause moves material (or the point) by a small vector d; the residual then changes by
/// along . d. Scanned points: along = outward normal of the simulated surface. Probed marks:
/// one observation for each coordinate, along = its axis.
///
/// Frame: model frame, millimetres. Time and order are those of the program; where there is no
/// program `feed` is zero and `path_share` NaN.

#include <array>
#include <cmath>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "core/vec.hpp"

namespace maquette::diagnosis {

/// Scales at which the surface's curvature is taken, mm (standard deviation of the Gaussian).
inline constexpr std::array<double, 4> kCurvatureScales_mm{0.5, 1.0, 2.0, 4.0};
/// Widths of lost motion for which the play of the axes is followed, mm: small play is taken up
/// at once, wide play eats short moves.
inline constexpr std::array<double, 5> kPlayWidths_mm{0.02, 0.05, 0.1, 0.2, 0.4};
/// Distances by which the machine trails the command, mm.
inline constexpr std::array<double, 3> kLagLengths_mm{0.3, 1.0, 2.5};

/// Passes that are higher by more than this are taken to stay out of the surface.
inline constexpr double kRivalHeight_mm = 0.2;

struct Curvature {
  float xx = 0.0F, xy = 0.0F, yy = 0.0F;  ///< second derivatives of height, 1/mm
};

/// What the machine did at a place of the program.
struct CutState {
  struct Small {  ///< a Vec3 in half the memory: there are many
    float x = 0.0F, y = 0.0F, z = 0.0F;
    Small() = default;
    Small(Vec3 v)
        : x(static_cast<float>(v.x)), y(static_cast<float>(v.y)), z(static_cast<float>(v.z)) {}
    operator Vec3() const {
      return {static_cast<double>(x), static_cast<double>(y), static_cast<double>(z)};
    }
  };
  Vec3 tip;                  ///< of the cutter
  Vec3 feed;                 ///< unit direction of motion, or zero
  double path_share = NAN;   ///< of the program's time, 0 to 1
  double cut_share = NAN;    ///< of its cutting length
  double path_mm = NAN;      ///< cutting length so far
  std::int32_t section = 0;  ///< tool, program or band
  std::array<Small, kPlayWidths_mm.size()>
      play;  ///< by axis, -1 .. 1: side of the slack, less its mean
  std::array<Small, kLagLengths_mm.size()> lag;  ///< off the path by a first-order lag, mm
};

/// A pass that runs by a place, a little above the one that made it: if passes are displaced
/// against each other, another one makes the surface.
struct Rival {
  CutState state;
  Vec3 normal;            ///< of its ball there
  double above_mm = 0.0;  ///< its underside over the surface
};

struct Observation : CutState {
  Vec3 place;   ///< on the simulated surface
  Vec3 normal;  ///< outward
  Vec3 along;   ///< direction of the residual
  double residual_mm = 0.0;
  double sigma_mm = 0.05;               ///< as declared
  std::uint32_t set_up = 0;             ///< scan or probe list it belongs to
  bool on_surface = true;               ///< false: a mark, which coats and cutters do not move
  double milled_minus_design_mm = 0.0;  ///< along the normal

  /// Passes within kRivalHeight_mm above; shared, for most causes do not look at them.
  std::shared_ptr<const std::vector<Rival>> rivals;

  // The view.
  bool has_station = false;
  Vec3 beam;  ///< unit, from the station to the place
  double range_mm = 0.0;
  std::array<Curvature, kCurvatureScales_mm.size()> curvature;
};

/// By how much the residual moves if each pass leaves its surface rise(state, normal of its ball at
/// the place) higher: the lowest is what remains.
template <class Rise>
[[nodiscard]] double recut_mm(const Observation& o, const Rise& rise) {
  double lowest = rise(o, o.normal);
  if (o.rivals)
    for (const Rival& r : *o.rivals)
      lowest = std::fmin(lowest, r.above_mm + rise(r.state, r.normal));
  return lowest * dot(o.along, o.normal) * o.normal.z;
}
/// The same if every tip is displaced by d(state, normal): its surface moves by normal . d.
template <class Displacement>
[[nodiscard]] double displaced_mm(const Observation& o, const Displacement& d) {
  if (!o.on_surface) return dot(o.along, d(o, o.normal));
  return recut_mm(o, [&](const CutState& s, Vec3 n) { return dot(n, d(s, n)) / n.z; });
}

/// What all observations of a case have in common.
struct Scene {
  Box3 box;  ///< of the part's surface
  bool has_path = false;
  double duration_min = 0.0;
  double ball_radius_mm = 3.0;
  std::vector<double>
      section_starts;  ///< shares of time at which sections begin, the first left out
  /// Candidates of chatter: waves over the longer side along x and y, over the cutting length.
  std::vector<double> waves_x, waves_y, waves_path;
  double cut_mm = 0.0;  ///< cutting length of the program
  /// Candidates of steps along x, y, z: shares of the program's time.
  std::array<std::vector<double>, 3> steps;
  std::vector<bool> has_station;  ///< by set-up
  std::vector<Vec3> stations;
  [[nodiscard]] Vec3 centre() const { return 0.5 * (box.min + box.max); }
  /// Half the longer side in plan.
  [[nodiscard]] double half_mm() const {
    return 0.5 * std::fmax(box.max.x - box.min.x, box.max.y - box.min.y);
  }
};

}  // namespace maquette::diagnosis

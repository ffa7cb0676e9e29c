// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file side_cuts.hpp
/// Where parallel rows leave more than the scallop stated for the slope although the ball could
/// take it away: in pits and beside creases of the cutter location that lie between two rows. And
/// what takes it away: short cuts across, from a row to such a place and back, and places of a row
/// that are written closer to the exact cutter location.
///
/// Method. On each facet of the design points are taken at most kContactsApart_mm apart. The ball
/// that touches one along the facet's normal has its place between two rows; of what these leave
/// there, as they are written, the lower counts, of places along them up to kLookAlong_mm either
/// way. Where that is more than the stated scallop (scallop.hpp) and the limit, and the exact
/// cutter location says that the ball need not rise by more than kReachTolerance_mm to touch, there
/// or somewhere up to half the points' distance away, the point is open. Where it cannot touch (it
/// rests on the rims of a pit, on both sides of a crease), at every second point, what counts is
/// the height above the closing of the design by the ball: where the ball leaves least over the
/// point is looked for on a lattice of 0.01 mm. Open points that the exact rows would clear make
/// the row be written closer there, by as much as they need; of the others the highest gets a cut
/// across from the nearer row, of those that end where the ball goes for points nearby the one that
/// clears most. A row that is written closer or left for a cut is written otherwise to both sides
/// of that, so all is looked at again three times, and at last written no higher than it was when
/// it was last looked at (raster_plan.hpp).
///
/// A cut across is one straight move there and one back where that cuts nothing too deep, else it
/// follows the cutter location.
///
/// Accuracy. Of the points looked at, the nodes of a grid of 0.1 mm among them, none stays open in
/// the program (but by rounding, kept back from the limit; and but points that the ball cannot
/// touch and whose best place lies more than 0.25 mm beyond the row next to where it would);
/// between them the surface bends by what a ball of radius R may: with points d apart, less than
/// d sqrt(L / R) for material L above the facet.
/// Cost. 0.1 us a point; some 2 us where rows leave too much.

#include <cstdint>
#include <memory>
#include <vector>

#include <oneapi/tbb/enumerable_thread_specific.h>

#include "cnc/arc_geometry.hpp"
#include "cnc/cutter_location.hpp"
#include "cnc/raster.hpp"
#include "cnc/tool.hpp"
#include "heightmap/height_field.hpp"

namespace maquette::cnc {

inline constexpr double kContactsApart_mm = 0.05;
inline constexpr double kLookAlong_mm = 0.4;

/// Heights of a row every kStep places, from its first on: as written, and exact.
struct RowHeights {
  static constexpr std::int64_t kStep = 50;
  std::int64_t across = 0, first = 0, last = 0;
  std::vector<float> written_mm, exact_mm;
  [[nodiscard]] std::size_t index(std::int64_t place) const {
    return static_cast<std::size_t>((place - first) / kStep);
  }
};

/// From the row at `place` straight to row `across` of the lattice.
struct SideCut {
  std::int64_t place = 0, across = 0;
  bool operator==(const SideCut&) const = default;
};
/// Places of a row, ends included, where it must not be written higher above the exact cutter
/// location than this.
struct RowStretch {
  std::int64_t from = 0, to = 0;
  double excess_mm = 0.0;
  bool operator==(const RowStretch&) const = default;
};
/// Points that rows were found to leave too much at: where the ball goes for them, and what may
/// stay. Rows that are written otherwise are asked about much the same ones again.
struct KnownPoint {
  std::uint64_t key = 0;
  float u = 0.0F, v = 0.0F;
  double allowed = 0.0;  // INFINITY: nothing to be done
  double pu = 0.0, pv = 0.0, pz = 0.0;
};

/// What a row needs besides, in order of place; stretches apart.
struct RowCare {
  std::vector<SideCut> cuts;
  std::vector<RowStretch> closer;
  bool operator==(const RowCare&) const = default;
};

class SideCutFinder {
 public:
  /// How far what is written may stand above the exact cutter location: a row where it is written
  /// closer, and a cut across; at its end that is rounded only.
  struct Excess {
    double closer_mm = 0.0, across_mm = 0.0;
  };
  /// @param stated_stepover_mm  of the passes whose scallop is stated; rows may lie closer
  /// The design outlives this. @pre frame.along_an_axis()
  SideCutFinder(const heightmap::ModelField& design, BallNose tool, const RasterFrame& frame,
                double stated_stepover_mm, double limit_mm, Excess written);
  ~SideCutFinder();

  /// Adds what two neighbouring rows need for what lies between them, beside what they have
  /// already. `known` is empty, or from a call before for the same two. Thread-safe.
  void find(const RowHeights& a, const RowHeights& b, std::vector<KnownPoint>& known,
            RowCare& for_a, RowCare& for_b);

 private:
  struct Open;
  struct Gap;
  struct Facet;
  class CachedDrops;
  [[nodiscard]] Open touch(const Facet& facet, double s, double t) const;
  [[nodiscard]] double rise(const Open& p, const Facet& facet, DropCutter& cutter) const;
  [[nodiscard]] bool reached(const Facet& facet, double s, double t, DropCutter& cutter,
                             Open& p) const;
  double rest(Open& p, PlanePoint& near, CachedDrops& drops) const;
  void open_points(const Gap& gap, CachedDrops& drops, std::vector<KnownPoint>& known,
                   std::vector<Open>& open) const;
  [[nodiscard]] SideCut cut_to(const Gap& gap, const Open& p) const;
  [[nodiscard]] static bool from_a(const Gap& gap, const SideCut& cut);
  void clears(const Gap& gap, const SideCut& cut, const std::vector<Open>& open,
              const std::vector<bool>& done, DropCutter& cutter,
              std::vector<std::size_t>& cleared) const;
  [[nodiscard]] double steepest(std::ptrdiff_t row, std::ptrdiff_t col) const;
  [[nodiscard]] bool blocked(std::ptrdiff_t row, std::ptrdiff_t col, double x, double y,
                             double tip) const;

  const heightmap::ModelField& design_;
  double R_;
  RasterFrame frame_;
  double step_mm_, stated_stepover_mm_, limit_mm_;
  Excess written_;
  double ex_, ey_, x0_, y0_;  // along the rows, and where they begin
  int per_spacing_;
  oneapi::tbb::enumerable_thread_specific<std::unique_ptr<CachedDrops>> drops_;
  DropCutter cutter_;
};

/// Puts cuts in order and joins stretches that overlap.
void arrange(RowCare& care);

}  // namespace maquette::cnc

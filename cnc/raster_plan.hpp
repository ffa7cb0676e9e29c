// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file raster_plan.hpp
/// What a raster cuts, before it is put in order: the moves of each row and, between two rows,
/// the ridge that they leave and the passes that hold it down.
///
/// Takes   design, options of mill.hpp
/// Gives   rows and gaps, each by itself: any number of threads may plan at a time

#include <cstdint>
#include <optional>
#include <vector>

#include <oneapi/tbb/enumerable_thread_specific.h>

#include "cnc/cutter_location.hpp"
#include "cnc/fit_moves.hpp"
#include "cnc/mill.hpp"
#include "cnc/raster.hpp"
#include "cnc/side_cuts.hpp"
#include "cnc/steepness.hpp"

namespace maquette::cnc {

/// A line with its moves, in the order of cutting.
struct PlannedCut {
  LineSegment cut;
  std::int64_t across = 0;  ///< its row
  std::vector<FittedMove> moves;
  FitBounds bounds;
  std::uint64_t sampled = 0;

  /// Where it starts or, `last`, ends.
  [[nodiscard]] ToolPosition end_at(bool last) const {
    const FittedMove& m = last ? moves.back() : moves.front();
    return {cut.line.x + m.place * cut.line.dx, cut.line.y + m.place * cut.line.dy, m.z};
  }
  void turn_round();
};

/// A row and its heights every grain() places: index g is place g * grain().
struct PlannedRow {
  RasterRow row;
  PlannedCut cut;
  std::int64_t first_index = 0;
  std::vector<float> tips;
  // With an excess limit:
  RowHeights heights;                 ///< as it was written last
  RowCare care;                       ///< with which it was written last
  std::vector<PlannedCut> with_care;  ///< ways that follow each other; none: `cut`
};

/// Between two rows.
struct PlannedGap {
  std::vector<double> ridges;  ///< from `first_index` on, halfway between the rows
  std::int64_t first_index = 0;
  std::vector<PlannedCut> added;  ///< by row, then along it
  RowCare for_a, for_b;           ///< with an excess limit
  std::vector<KnownPoint> known;
};

class RasterPlanner {
 public:
  /// Added passes less than `air_worth_mm` apart are one. The design and the options outlive this.
  /// @pre check_mill
  RasterPlanner(const heightmap::ModelField& design, const MillOptions& options,
                double air_worth_mm);

  [[nodiscard]] const RasterArea& area() const { return area_; }
  [[nodiscard]] const RasterFrame& frame() const { return frame_; }
  [[nodiscard]] std::int64_t grain() const { return grain_; }

  [[nodiscard]] PlannedCut plan(const LineSegment& cut, std::int64_t across);
  [[nodiscard]] PlannedRow plan_row(const RasterRow& row);
  /// Of two neighbouring rows.
  [[nodiscard]] PlannedGap plan_gap(const PlannedRow& a, const PlannedRow& b);
  /// The row once more, written closer and left for cuts across where it must be; `finally` nowhere
  /// higher than its heights say.
  void write_with_care(PlannedRow& row, RowCare care, bool finally);
  /// What must be cut besides, by the heights that both rows have now: a row that is written closer
  /// or left for a cut is written otherwise to both sides of that.
  void look_again(const PlannedRow& a, const PlannedRow& b, PlannedGap& gap);
  /// The four sides, counter-clockwise; nothing if the area has no width.
  [[nodiscard]] std::vector<PlannedCut> outline();

 private:
  enum class Written : std::uint8_t { normally, across };
  PlannedCut plan(const LineSegment& cut, std::int64_t across, std::vector<PathSample>& samples,
                  Written written = Written::normally);
  [[nodiscard]] std::vector<PlannedCut> plan_with_care(const RasterRow& row, const RowCare& care,
                                                       const RowHeights* known);
  PlannedCut plan_closer(const LineSegment& cut, std::int64_t across, const RowCare& care,
                         std::vector<PathSample>& samples);
  std::vector<PlannedCut> with_cuts(PlannedCut row, const std::vector<SideCut>& cuts);
  void take_chord(PlannedCut& cut, std::int64_t from_z,
                  const std::vector<PathSample>& samples) const;
  void add_passes(const PlannedRow& a, const PlannedRow& b, const std::vector<int>& halved,
                  PlannedGap& gap);

  const heightmap::ModelField& design_;
  const MillOptions& options_;
  BallNose tool_;
  RasterArea area_;
  RasterFrame frame_;
  SteepnessTiles tiles_;
  oneapi::tbb::enumerable_thread_specific<DropCutter> cutters_;
  ToleranceShares shares_;
  std::int64_t grain_;
  double allowed_mm_, air_worth_mm_;
  std::optional<SideCutFinder> finder_;
};

}  // namespace maquette::cnc

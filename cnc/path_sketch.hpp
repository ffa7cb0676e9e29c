// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file path_sketch.hpp
/// A program thinned to polylines that a page or a drawing can carry: of passes that lie close
/// together the first, and of that no more points than a stated deviation needs.
///
/// Takes   motions in program order, with the volume each removed where that is known
/// Gives   polylines of places on the path, each segment with the mean feed and engagement of the
///         path it stands for
///
/// Method. Space is divided into boxes of cell x cell x cell/2. Path is kept where no earlier path
/// came through the box, the one above or the one below; path counts as earlier when it is more
/// than four cells behind along the program. So parallel passes thin out to about a cell, levels
/// of roughing too, and a single cut stays wherever it is. What is kept is simplified (Douglas,
/// Peucker, doi:10.3138/FM57-6770-U75U-7727) as little as the number of points allows.
/// Accuracy. All of the path has kept path within 1.74 cells. Vertices lie on the path (arcs:
/// within deviation); between two the path that they stand for is nowhere farther than
/// `deviation_mm` from the segment. Cost    about 100 ns a motion. Memory goes with the boxes that
/// the path passes through, not with
///         its length.

#include <cstdint>
#include <unordered_map>
#include <vector>

#include "cnc/gcode_reader.hpp"

namespace maquette::cnc {

struct SketchPoint {
  Vec3 at_mm{};
  /// Means of the path from the point before to this one; 0 at the first of a run.
  double feed_mm_min = 0.0, engagement_mm2 = 0.0;
};

struct SketchRun {
  bool rapid = false;
  std::vector<SketchPoint> points{};  ///< two at least
};

struct Sketch {
  std::vector<SketchRun> runs;  ///< in program order
  double deviation_mm = 0.0;
  double cell_mm = 0.0;
  std::uint64_t points = 0;
  /// Short runs that were one too many, mm of path; 0 unless the program is very ragged.
  double left_out_mm = 0.0;
};

struct SketchOptions {
  double cell_mm = 1.0;             ///< > 0
  std::size_t most_points = 20000;  ///< >= 2
  /// No segment of a cut is longer, so that colours change along straight passes.
  double longest_mm = INFINITY;
};

class PathSketch {
 public:
  explicit PathSketch(const SketchOptions& options);

  void add(const Motion& motion, double removed_mm3 = 0.0);
  /// Call once, after the last add.
  [[nodiscard]] Sketch finish();

 private:
  struct Raw {
    Vec3 at_mm{};
    double length = 0.0, feed_length = 0.0, volume = 0.0;  // along the run so far
  };
  using Run = std::vector<Raw>;
  struct Kept {
    bool rapid = false;
    Run points;
  };
  [[nodiscard]] bool is_new(Vec3 at, bool rapid);
  void close();

  SketchOptions o_;
  double fine_mm_;  // first simplification
  double travelled_ = 0.0;
  std::unordered_map<std::uint64_t, double> first_cut_, first_rapid_;  // box: way travelled then
  std::uint64_t last_box_ = ~std::uint64_t{0};
  bool last_new_ = false, last_rapid_ = false;
  double last_first_ = 0.0;
  Kept open_;
  std::vector<Kept> kept_;
};

}  // namespace maquette::cnc

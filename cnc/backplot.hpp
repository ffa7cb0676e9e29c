// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file backplot.hpp
/// A program seen from above, coloured by feed or by engagement; and a thinned set of its paths for
/// drawings and for a view in three dimensions.
///
/// Takes   motions in program order with the volume that each removed (VerifyOptions::visit)
/// Gives   picture (RGB, row 0 is the upper row), SVG with frame and scale, polylines
///
/// Method. Each motion is walked in steps of half a pixel; a pixel adds up length, length times
/// feed and removed volume, so its colour is the mean over all of its path: millions of moves
/// are one picture. The polylines keep of the path what comes through cells nothing came
/// through before: neighbouring passes thin out to the cell, single cuts stay.
/// Cost    about 30 ns a step; memory goes with the pixels and cells, not with the program.

#include <array>
#include <cstdint>
#include <string>
#include <vector>

#include "cnc/gcode_reader.hpp"
#include "core/grid.hpp"

namespace maquette::cnc {

enum class BackplotColour : std::uint8_t { feed, engagement };

struct BackplotOptions {
  double x_min_mm = 0.0, x_max_mm = 1.0, y_min_mm = 0.0, y_max_mm = 1.0;  ///< what is shown
  int longest_px = 1600;
  int longest_cells = 400;  ///< of the thinning
};

/// Part of the path; rapids and cuts apart.
struct BackplotRun {
  bool rapid = false;
  double feed_mm_min = 0.0;     ///< mean
  double engagement_mm2 = 0.0;  ///< mean
  std::vector<Vec3> points_mm{};
};

class Backplot {
 public:
  /// @pre max > min, sizes >= 1
  explicit Backplot(const BackplotOptions& options);

  void add(const Motion& motion, double removed_mm3);

  /// Scale of the colours over the cuts so far: the 2nd and 98th percentile of the pixels. Feed
  /// is linear, engagement logarithmic.
  struct Scale {
    double low = 0.0, high = 1.0;
  };
  [[nodiscard]] Scale scale(BackplotColour colour) const;
  /// White where nothing goes, grey where only rapids do.
  [[nodiscard]] Grid<std::array<std::uint8_t, 3>> picture(BackplotColour colour) const;
  /// Frame in millimetres, the thinned paths, rapids dashed, a bar with the scale.
  [[nodiscard]] std::string svg(BackplotColour colour, const std::string& title) const;
  [[nodiscard]] const std::vector<BackplotRun>& runs() const { return runs_; }

 private:
  struct Pixel {
    float length = 0.0F, feed_length = 0.0F, volume = 0.0F;
    bool rapid = false;
  };
  void thin(const Motion& motion, Vec3 at, double engagement);
  [[nodiscard]] double value(const Pixel& pixel, BackplotColour colour) const;
  [[nodiscard]] std::array<std::uint8_t, 3> shade(double value, BackplotColour colour,
                                                  const Scale& scale) const;

  BackplotOptions o_;
  double px_mm_, cell_mm_;
  Grid<Pixel> pixels_;  // row 0: north
  Grid<std::uint8_t> cut_cells_, rapid_cells_;
  std::vector<BackplotRun> runs_;
  bool open_ = false;  // the last run goes on
};

}  // namespace maquette::cnc

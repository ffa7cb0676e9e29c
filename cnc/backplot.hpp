// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file backplot.hpp
/// A program seen from above, as a picture: what it feeds, how much it takes off, how high it goes.
///
/// Takes   motions in program order, with the volume each removed where that is known
///         (VerifyOptions::visit)
/// Gives   colours (row 0 is the upper row), their scale, where cuts begin
///
/// Method. Each motion is walked in steps of half a pixel, arcs as chords that stay within a
/// thousandth of one; a pixel adds up length, and length times feed, height and removed volume, so
/// its colour is the mean over all path in it: millions of moves are one picture.
/// Cost    about 30 ns a step; 20 bytes a pixel, whatever the length of the program.
/// What the path is like between pixels, and where the rapids are: path_sketch.hpp.

#include <array>
#include <cstdint>
#include <vector>

#include "cnc/gcode_reader.hpp"
#include "core/grid.hpp"

namespace maquette::cnc {

/// Engagement is removed volume per length of path, mm^3/mm = mm^2.
enum class BackplotColour : std::uint8_t { feed, engagement, height };
using Rgb = std::array<std::uint8_t, 3>;

/// From dark blue (0) over green to red (1); lightness rises but for the last fifth.
[[nodiscard]] Rgb backplot_colour(double share);
inline constexpr Rgb kRapidColour{236, 200, 228}, kPaperColour{255, 255, 255};
/// Cuts that remove less are drawn as if they removed this.
inline constexpr double kLeastEngagement_mm2 = 1e-4;

/// Values that the two ends of the colours stand for. Feed and height are linear between them,
/// engagement logarithmic.
struct BackplotScale {
  double low = 0.0, high = 1.0;
  bool logarithmic = false;
  bool constant = false;  ///< there is but one value: `high`
  bool all = false;       ///< the ends are the extremes: nearly all pixels have one value

  /// 0 at low, 1 at high, not clamped.
  [[nodiscard]] double share(double value) const;
};

struct BackplotOptions {
  double x_min_mm = 0.0, x_max_mm = 1.0, y_min_mm = 0.0, y_max_mm = 1.0;  ///< what is shown
  int longest_px = 1400;
};

class Backplot {
 public:
  /// @pre max > min, longest_px >= 1
  explicit Backplot(const BackplotOptions& options);

  void add(const Motion& motion, double removed_mm3 = 0.0);

  /// The 2nd and 98th percentile of the pixels so far; the extremes where these are the same.
  [[nodiscard]] BackplotScale scale(BackplotColour colour) const;
  /// White where nothing goes, pink where only rapids do. Where cuts fill less than half of it,
  /// they are drawn three pixels wide.
  [[nodiscard]] Grid<Rgb> picture(BackplotColour colour, const BackplotScale& scale) const;
  /// First and last place of the cutting.
  [[nodiscard]] Vec3 begins_mm() const { return begins_; }
  [[nodiscard]] Vec3 ends_mm() const { return ends_; }
  /// Where cuts follow rapids, one in each square of 8 x 8 pixels.
  [[nodiscard]] const std::vector<Vec3>& entries_mm() const { return entries_; }
  [[nodiscard]] double pixel_mm() const { return px_mm_; }
  [[nodiscard]] const BackplotOptions& options() const { return o_; }
  [[nodiscard]] bool empty() const { return !any_cut_; }

 private:
  struct Pixel {
    float length = 0.0F, feed_length = 0.0F, height_length = 0.0F, volume = 0.0F;
    bool rapid = false;
  };
  [[nodiscard]] static double value(const Pixel& pixel, BackplotColour colour);
  void enter(Vec3 at);

  BackplotOptions o_;
  double px_mm_;
  Grid<Pixel> pixels_;  // row 0: north
  Grid<std::uint8_t> entered_;
  std::vector<Vec3> entries_;
  Vec3 begins_{}, ends_{};
  bool any_cut_ = false, cutting_ = false;
};

}  // namespace maquette::cnc

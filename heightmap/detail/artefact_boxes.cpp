// SPDX-License-Identifier: GPL-3.0-or-later

// A box has four corners, each with steps of the right sign along both of its sides. Corners are
// marked first, by means over the first pixels of their sides; boxes are sought among marked ones
// only, and judged by all four sides.

#include <algorithm>
#include <array>
#include <cmath>
#include <utility>
#include <vector>

#include <oneapi/tbb/parallel_for.h>

#include "heightmap/detail/artefact_finders.hpp"

#include "core/median.hpp"

namespace maquette::heightmap::detail {
namespace {

constexpr std::ptrdiff_t kShortest = 4, kLongest = 64;  // sides, pixels
constexpr double kLowest_m = 0.45;  // boxes of half a metre, some 10 % of them too low by noise
constexpr double kMiss = 3.3;       // deviations: a corner is missed once in two thousand
constexpr double kClear = 7.5;      // deviations of the mean over all sides
constexpr double kUneven = 0.5;     // of the box's height: the least that a side may have
/// Where steps are alike along sides (Steps::alike), they are the ground's: walls of craters a few
/// pixels wide stand on all four sides of a square too, up to 4.6 deviations high in LDEM. From
/// here on boxes are asked for more, in the end for so much more.
constexpr double kGroundFrom = 1.25, kGroundAt = 1.75, kMoreOverGround = 2.2;

/// Sums of steps along columns and rows.
class SideSums {
 public:
  explicit SideSums(const Steps& s)
      : down_(s.across_columns.rows() + 1, s.across_columns.cols(), 0.0),
        along_(s.across_rows.rows(), s.across_rows.cols() + 1, 0.0) {
    for (std::ptrdiff_t r = 0; r < s.across_columns.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < s.across_columns.cols(); ++c) {
        down_(r + 1, c) = down_(r, c) + static_cast<double>(s.across_columns(r, c));
        along_(r, c + 1) = along_(r, c) + static_cast<double>(s.across_rows(r, c));
      }
  }
  /// Mean step into column c from the left, rows [r0, r1).
  [[nodiscard]] double upright(std::ptrdiff_t c, std::ptrdiff_t r0, std::ptrdiff_t r1) const {
    return (down_(r1, c) - down_(r0, c)) / static_cast<double>(r1 - r0);
  }
  /// Mean step into row r from the row before, columns [c0, c1).
  [[nodiscard]] double level(std::ptrdiff_t r, std::ptrdiff_t c0, std::ptrdiff_t c1) const {
    return (along_(r, c1) - along_(r, c0)) / static_cast<double>(c1 - c0);
  }

 private:
  Grid<double> down_, along_;
};

enum Corner : std::uint8_t { kTopLeft = 1, kTopRight = 2, kBottomLeft = 4, kBottomRight = 8 };

struct Candidate {
  BoxArtefact box;
  double score = 0.0;  ///< mean step in deviations
};

class BoxSearch {
 public:
  explicit BoxSearch(const Steps& steps)
      : steps_(steps),
        sums_(steps),
        rows_(steps.across_rows.rows()),
        cols_(steps.across_rows.cols()),
        more_(std::lerp(
            1.0, kMoreOverGround,
            std::clamp((steps.alike - kGroundFrom) / (kGroundAt - kGroundFrom), 0.0, 1.0))) {}

  [[nodiscard]] double deviation(std::ptrdiff_t r, std::ptrdiff_t c) const {
    return steps_.alike * steps_.scale_at(std::min(r, rows_ - 1), std::min(c, cols_ - 1));
  }
  /// Lowest box that is sought there.
  [[nodiscard]] double lowest(std::ptrdiff_t r, std::ptrdiff_t c) const {
    return std::max(kLowest_m, 1.5 * kMiss * more_ * deviation(r, c) / std::sqrt(kShortest));
  }
  /// What the mean over a side's `length` pixels has at least.
  [[nodiscard]] double least(std::ptrdiff_t r, std::ptrdiff_t c, std::ptrdiff_t length) const {
    return lowest(r, c) - kMiss * deviation(r, c) / std::sqrt(static_cast<double>(length));
  }

  /// Corners of boxes that are higher (sign 1) or lower (-1) than what is around.
  void mark(double sign) {
    sign_ = sign;
    corners_ = Grid<std::uint8_t>(rows_ + 1, cols_ + 1, 0);
    oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows_, [&](std::ptrdiff_t r) {
      for (std::ptrdiff_t c = 0; c < cols_; ++c) {
        const double enough = least(r, c, kShortest);
        const bool below = r + kShortest <= rows_, above = r >= kShortest;
        const bool right = c + kShortest <= cols_, left = c >= kShortest;
        const auto in = [&](double v) { return sign * v > enough; };
        const auto out = [&](double v) { return sign * v < -enough; };
        std::uint8_t& corner = corners_(r, c);
        if (below && right && in(sums_.upright(c, r, r + kShortest)) &&
            in(sums_.level(r, c, c + kShortest)))
          corner |= kTopLeft;
        if (below && left && out(sums_.upright(c, r, r + kShortest)) &&
            in(sums_.level(r, c - kShortest, c)))
          corner |= kTopRight;
        if (above && right && in(sums_.upright(c, r - kShortest, r)) &&
            out(sums_.level(r, c, c + kShortest)))
          corner |= kBottomLeft;
        if (above && left && out(sums_.upright(c, r - kShortest, r)) &&
            out(sums_.level(r, c - kShortest, c)))
          corner |= kBottomRight;
      }
    });
  }

  [[nodiscard]] std::vector<Candidate> search() const {
    std::vector<std::vector<Candidate>> of_row(static_cast<std::size_t>(rows_));
    oneapi::tbb::parallel_for(std::ptrdiff_t{0}, rows_, [&](std::ptrdiff_t r) {
      for (std::ptrdiff_t c = 0; c < cols_; ++c)
        if ((corners_(r, c) & kTopLeft) != 0) from(r, c, of_row[static_cast<std::size_t>(r)]);
    });
    std::vector<Candidate> all;
    for (const auto& row : of_row) all.insert(all.end(), row.begin(), row.end());
    return all;
  }

 private:
  /// Boxes with their upper left corner here.
  void from(std::ptrdiff_t r, std::ptrdiff_t c, std::vector<Candidate>& found) const {
    for (std::ptrdiff_t w = kShortest; w <= kLongest && c + w < cols_; ++w) {
      if ((corners_(r, c + w) & kTopRight) == 0) continue;
      const double top = sign_ * sums_.level(r, c, c + w);
      if (top < least(r, c, w)) continue;
      for (std::ptrdiff_t h = kShortest; h <= kLongest && r + h < rows_; ++h) {
        if ((corners_(r + h, c) & kBottomLeft) == 0 || (corners_(r + h, c + w) & kBottomRight) == 0)
          continue;
        const std::array<double, 4> side{top, -sign_ * sums_.level(r + h, c, c + w),
                                         sign_ * sums_.upright(c, r, r + h),
                                         -sign_ * sums_.upright(c + w, r, r + h)};
        const auto length = static_cast<double>(2 * (w + h));
        const double mean = (static_cast<double>(w) * (side[0] + side[1]) +
                             static_cast<double>(h) * (side[2] + side[3])) /
                            length;
        const double score = mean * std::sqrt(length) / deviation(r + h / 2, c + w / 2);
        const double weakest = *std::min_element(side.begin(), side.end());
        if (score < kClear || weakest < kUneven * mean || mean < kLowest_m) continue;
        if (more_ > 1.0 && mean < least(r + h / 2, c + w / 2, 2 * (w + h))) continue;
        found.push_back({{r, c, h, w, sign_ * mean}, score});
      }
    }
  }

  const Steps& steps_;
  SideSums sums_;
  std::ptrdiff_t rows_, cols_;
  double more_;  ///< than white noise asks for
  double sign_ = 1.0;
  Grid<std::uint8_t> corners_;
};

bool touch(const BoxArtefact& a, const BoxArtefact& b) {
  return a.row < b.row + b.rows && b.row < a.row + a.rows && a.col < b.col + b.cols &&
         b.col < a.col + a.cols;
}

/// Median step over a box's sides, whatever its height.
double height_of(const Grid<float>& h, const BoxArtefact& box) {
  std::vector<double> steps;
  const auto add = [&](std::ptrdiff_t r, std::ptrdiff_t c, std::ptrdiff_t dr, std::ptrdiff_t dc) {
    const auto at = [&](std::ptrdiff_t k) {
      return h.contains(r + k * dr, c + k * dc) ? static_cast<double>(h(r + k * dr, c + k * dc))
                                                : std::nan("");
    };
    // From inside (0) outwards.
    const double v = 1.5 * (at(0) - at(1)) - 0.5 * (at(-1) - at(2));
    if (!std::isnan(v)) steps.push_back(v);
  };
  for (std::ptrdiff_t r = box.row; r < box.row + box.rows; ++r) {
    add(r, box.col, 0, -1);
    add(r, box.col + box.cols - 1, 0, 1);
  }
  for (std::ptrdiff_t c = box.col; c < box.col + box.cols; ++c) {
    add(box.row, c, -1, 0);
    add(box.row + box.rows - 1, c, 1, 0);
  }
  return steps.empty() ? box.offset_m : median_of(steps);
}

}  // namespace

std::vector<BoxArtefact> find_boxes(const Grid<float>& h, const Steps& steps, double& limit_m) {
  BoxSearch search(steps);
  std::vector<Candidate> all;
  for (const double sign : {1.0, -1.0}) {
    search.mark(sign);
    const auto found = search.search();
    all.insert(all.end(), found.begin(), found.end());
  }
  std::stable_sort(all.begin(), all.end(),
                   [](const Candidate& a, const Candidate& b) { return a.score > b.score; });
  std::vector<BoxArtefact> boxes;
  for (const Candidate& c : all)
    if (std::none_of(boxes.begin(), boxes.end(),
                     [&](const BoxArtefact& b) { return touch(b, c.box); }))
      boxes.push_back(c.box);
  for (BoxArtefact& b : boxes) b.offset_m = height_of(h, b);
  std::vector<double> lowest;
  for (std::ptrdiff_t r = 0; r < h.rows(); r += Steps::kTile)
    for (std::ptrdiff_t c = 0; c < h.cols(); c += Steps::kTile)
      lowest.push_back(search.lowest(r, c));
  std::sort(lowest.begin(), lowest.end());
  limit_m = lowest.empty() ? 0.0 : 1.1 * lowest[lowest.size() / 2];
  return boxes;
}

}  // namespace maquette::heightmap::detail

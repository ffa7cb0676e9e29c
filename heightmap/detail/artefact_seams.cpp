// SPDX-License-Identifier: GPL-3.0-or-later

// Steps are averaged along straight lines, by every slant of a whole pixel over the window's
// length: a sheared projection. Relief has steps of either sign along a line; a seam has one.

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <oneapi/tbb/parallel_for.h>

#include "heightmap/detail/artefact_finders.hpp"

namespace maquette::heightmap::detail {
namespace {

constexpr double kSteepest = 0.268;  // tangent of 15 degrees
constexpr std::ptrdiff_t kShortest = 64, kMostRows = 600, kQuarters = 4;
constexpr double kClear = 7.0, kKnown = 4.0;  // deviations
constexpr double kUneven = 0.4;
constexpr float kNormal = 1.4826F;

struct Line {
  std::ptrdiff_t slant = 0, at = 0;  ///< columns over the whole length; column in the middle
  double mean = 0.0, clear = 0.0;    ///< in local deviations; in deviations of such means
  std::array<double, kQuarters> quarter{};
};

/// Steps into columns (or, turned, into rows) in local deviations.
Grid<float> in_deviations(const Steps& s, bool level) {
  const Grid<float>& g = level ? s.across_rows : s.across_columns;
  Grid<float> out(level ? g.cols() : g.rows(), level ? g.rows() : g.cols());
  for (std::ptrdiff_t r = 0; r < g.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < g.cols(); ++c)
      (level ? out(c, r) : out(r, c)) = g(r, c) / static_cast<float>(s.scale_at(r, c));
  return out;
}

std::ptrdiff_t column_of(const Line& line, std::ptrdiff_t r, std::ptrdiff_t rows) {
  const double from_middle = static_cast<double>(r) - 0.5 * static_cast<double>(rows - 1);
  return line.at + std::lround(static_cast<double>(line.slant) * from_middle /
                               static_cast<double>(rows - 1));
}

/// Means along all lines of one slant, by column in the middle; quarters apart.
std::vector<Line> lines_of(const Grid<float>& steps, std::ptrdiff_t slant) {
  const std::ptrdiff_t rows = steps.rows(), cols = steps.cols();
  const std::ptrdiff_t every = (rows + kMostRows - 1) / kMostRows;
  std::array<std::vector<float>, kQuarters> sum, count;
  for (auto* sums : {&sum, &count})
    for (auto& v : *sums) v.assign(static_cast<std::size_t>(cols), 0.0F);
  for (std::ptrdiff_t r = 0; r < rows; r += every) {
    const auto q = static_cast<std::size_t>(kQuarters * r / rows);
    const std::ptrdiff_t shift = column_of({slant, 0}, r, rows);
    const auto from = steps.row(r);
    for (std::ptrdiff_t c = std::max<std::ptrdiff_t>(0, -shift);
         c < std::min(cols, cols - shift); ++c) {
      const float v = from[static_cast<std::size_t>(c + shift)];
      sum[q][static_cast<std::size_t>(c)] += v;
      count[q][static_cast<std::size_t>(c)] += v == 0.0F ? 0.0F : 1.0F;
    }
  }
  std::vector<Line> out;
  const double enough = 0.1 * static_cast<double>(rows / every);  // of a quarter's pixels
  for (std::ptrdiff_t c = 0; c < cols; ++c) {
    Line line{slant, c};
    const auto i = static_cast<std::size_t>(c);
    double all = 0.0, pixels = 0.0;
    bool whole = true;
    for (std::size_t q = 0; q < kQuarters; ++q) {
      const auto n = static_cast<double>(count[q][i]);
      whole = whole && n >= enough;
      all += static_cast<double>(sum[q][i]);
      pixels += n;
      line.quarter[q] = n > 0.0 ? static_cast<double>(sum[q][i]) / n : 0.0;
    }
    if (!whole) continue;
    line.mean = all / pixels;
    out.push_back(line);
  }
  return out;
}

double deviation_of_means(const Grid<float>& steps) {
  std::vector<float> size;
  for (const std::ptrdiff_t slant : {-7, -2, 0, 3, 8})
    for (const Line& l : lines_of(steps, slant)) size.push_back(std::abs(static_cast<float>(l.mean)));
  if (size.size() < 100) return INFINITY;
  const auto middle = size.begin() + static_cast<std::ptrdiff_t>(size.size() / 2);
  std::nth_element(size.begin(), middle, size.end());
  return std::max(1e-6, static_cast<double>(kNormal * *middle));
}

/// Steps within two pixels: those into the columns beside are as large together, the other way. A
/// scarp is wider.
bool sharp(const std::vector<Line>& lines, std::size_t i) {
  double beside = 0.0;
  for (const std::size_t k : {i - 2, i - 1, i + 1, i + 2})
    if (k < lines.size()) beside += lines[k].mean;
  return beside * lines[i].mean < -0.5 * lines[i].mean * lines[i].mean;
}

bool one_sign(const Line& l) {
  return std::all_of(l.quarter.begin(), l.quarter.end(),
                     [&](double q) { return q * l.mean > 0.0; });
}

/// The step of a seam from pixels at least one off it on both sides, slopes taken away; the median
/// along it, whatever stands on it.
SeamArtefact measured(const Grid<float>& h, const Steps& s, const Grid<float>& steps,
                      const Line& line, bool level, double deviation) {
  std::vector<double> height;
  for (std::ptrdiff_t r = 0; r < steps.rows(); ++r) {
    const std::ptrdiff_t c = column_of(line, r, steps.rows());
    if (c < 3 || c + 2 >= steps.cols()) continue;
    const auto at = [&](std::ptrdiff_t k) {
      return static_cast<double>(level ? h(c + k, r) : h(r, c + k));
    };
    const double v = 2.5 * (at(1) - at(-2)) - 1.5 * (at(2) - at(-3));
    if (!std::isnan(v)) height.push_back(v);
  }
  SeamArtefact seam;
  seam.level = level;
  seam.at = static_cast<double>(line.at);
  seam.slant = static_cast<double>(line.slant) / static_cast<double>(steps.rows() - 1);
  if (height.empty()) return seam;
  const auto middle = height.begin() + static_cast<std::ptrdiff_t>(height.size() / 2);
  std::nth_element(height.begin(), middle, height.end());
  seam.step_m = *middle;
  for (double& v : height) v = std::abs(v - seam.step_m);
  std::nth_element(height.begin(), middle, height.end());
  // Of a median of normal values, which are alike along the seam.
  seam.sigma_m = 1.2533 * static_cast<double>(kNormal) * *middle * s.alike /
                 std::sqrt(static_cast<double>(height.size()));
  const double doubt = 4.0 * deviation * std::sqrt(static_cast<double>(kQuarters));
  seam.separable =
      std::abs(seam.step_m) > kKnown * seam.sigma_m && seam.step_m * line.mean > 0.0 &&
      std::all_of(line.quarter.begin(), line.quarter.end(), [&](double q) {
        return std::abs(q - line.mean) < std::max(doubt, kUneven * std::abs(line.mean));
      });
  return seam;
}

std::vector<SeamArtefact> seams_along(const Grid<float>& h, const Steps& s, bool level) {
  const Grid<float> steps = in_deviations(s, level);
  if (steps.rows() < kShortest || steps.cols() < kShortest) return {};
  const double deviation = deviation_of_means(steps);
  const auto most = static_cast<std::ptrdiff_t>(kSteepest * static_cast<double>(steps.rows()));
  std::vector<std::vector<Line>> clear(static_cast<std::size_t>(2 * most + 1));
  oneapi::tbb::parallel_for(-most, most + 1, [&](std::ptrdiff_t slant) {
    std::vector<Line> lines = lines_of(steps, slant);
    for (std::size_t i = 0; i < lines.size(); ++i) {
      lines[i].clear = std::abs(lines[i].mean) / deviation;
      if (lines[i].clear > kClear && one_sign(lines[i]) && sharp(lines, i))
        clear[static_cast<std::size_t>(slant + most)].push_back(lines[i]);
    }
  });
  std::vector<Line> all, chosen;
  for (const auto& of_slant : clear) all.insert(all.end(), of_slant.begin(), of_slant.end());
  std::stable_sort(all.begin(), all.end(),
                   [](const Line& a, const Line& b) { return a.clear > b.clear; });
  // Lines that cross a seam, or run beside it, have a part of it.
  for (const Line& l : all)
    if (std::none_of(chosen.begin(), chosen.end(), [&](const Line& o) {
          return std::abs(l.at - o.at) <= std::abs(l.slant - o.slant) / 2 + 4;
        }))
      chosen.push_back(l);
  std::vector<SeamArtefact> out;
  for (const Line& l : chosen) out.push_back(measured(h, s, steps, l, level, deviation));
  return out;
}

}  // namespace

std::vector<SeamArtefact> find_seams(const Grid<float>& h, const Steps& steps) {
  std::vector<SeamArtefact> out = seams_along(h, steps, false);
  const std::vector<SeamArtefact> level = seams_along(h, steps, true);
  out.insert(out.end(), level.begin(), level.end());
  return out;
}

}  // namespace maquette::heightmap::detail

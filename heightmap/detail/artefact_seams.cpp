// SPDX-License-Identifier: GPL-3.0-or-later

// Steps are averaged along straight lines, by every slant of a whole pixel over the window's
// length: a sheared projection. Relief has steps of either sign along a line; a seam has one, or
// shows in one part of it only, as where tiles of a mosaic meet.

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

#include <oneapi/tbb/parallel_for.h>

#include "heightmap/detail/artefact_finders.hpp"

namespace maquette::heightmap::detail {
namespace {

constexpr double kSteepest = 0.268;  // tangent of 15 degrees
constexpr std::ptrdiff_t kShortest = 64, kMostRows = 600;
constexpr std::size_t kParts = 8;                               // of a line
constexpr double kClear = 7.0, kClearPart = 8.0, kKnown = 4.0;  // deviations
constexpr double kUneven = 0.4;
// Means of |step| over half a hundred pixels vary by a fifth where they are alike.
constexpr double kRough = 1.8, kRoughPart = 1.7;  // times what is usual
constexpr std::size_t kRoughParts = 3;
constexpr std::ptrdiff_t kShortestRough = 128;  // else a crater on it makes a line rough

struct Line {
  std::ptrdiff_t slant = 0, at = 0;  ///< columns over the whole length; column in the middle
  double mean = 0.0, clear = 0.0;    ///< in local deviations; in deviations of such means
  std::array<double, kParts> part{};
  std::size_t first = 0, last = kParts;  ///< parts that the seam goes through
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
  return line.at +
         std::lround(static_cast<double>(line.slant) * from_middle / static_cast<double>(rows - 1));
}

/// Means along all lines of one slant, by column in the middle; parts apart.
std::vector<Line> lines_of(const Grid<float>& steps, std::ptrdiff_t slant) {
  const std::ptrdiff_t rows = steps.rows(), cols = steps.cols();
  const std::ptrdiff_t every = (rows + kMostRows - 1) / kMostRows;
  std::array<std::vector<float>, kParts> sum, count;
  for (auto* sums : {&sum, &count})
    for (auto& v : *sums) v.assign(static_cast<std::size_t>(cols), 0.0F);
  for (std::ptrdiff_t r = 0; r < rows; r += every) {
    const auto q = kParts * static_cast<std::size_t>(r) / static_cast<std::size_t>(rows);
    const std::ptrdiff_t shift = column_of({slant, 0}, r, rows);
    const auto from = steps.row(r);
    for (std::ptrdiff_t c = std::max<std::ptrdiff_t>(0, -shift); c < std::min(cols, cols - shift);
         ++c) {
      const float v = from[static_cast<std::size_t>(c + shift)];
      sum[q][static_cast<std::size_t>(c)] += v;
      count[q][static_cast<std::size_t>(c)] += v == 0.0F ? 0.0F : 1.0F;
    }
  }
  std::vector<Line> out;
  const double enough = 0.4 / kParts * static_cast<double>(rows / every);  // pixels of a part
  for (std::ptrdiff_t c = 0; c < cols; ++c) {
    Line line{slant, c};
    const auto i = static_cast<std::size_t>(c);
    double all = 0.0, pixels = 0.0;
    bool whole = true;
    for (std::size_t q = 0; q < kParts; ++q) {
      const auto n = static_cast<double>(count[q][i]);
      whole = whole && n >= enough;
      all += static_cast<double>(sum[q][i]);
      pixels += n;
      line.part[q] = n > 0.0 ? static_cast<double>(sum[q][i]) / n : 0.0;
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
    for (const Line& l : lines_of(steps, slant))
      size.push_back(std::abs(static_cast<float>(l.mean)));
  if (size.size() < 100) return INFINITY;
  return std::max(1e-6, static_cast<double>(kNormal * median_of(size)));
}

/// Steps within two pixels: those into the columns beside are as large together, the other way. A
/// scarp is wider.
bool sharp(const std::vector<Line>& lines, std::size_t i) {
  double beside = 0.0;
  const Line& l = lines[i];
  for (const std::size_t k : {i - 2, i - 1, i + 1, i + 2})
    if (k < lines.size())
      for (std::size_t p = l.first; p < l.last; ++p)
        beside += lines[k].part[p] / static_cast<double>(l.last - l.first);
  return beside * lines[i].mean < -0.5 * lines[i].mean * lines[i].mean;
}

/// The run of parts with one sign that is clearest; all of them, if they are clear together.
void find_run(Line& l, double deviation) {
  const double whole = l.mean;
  const bool one_sign =
      std::all_of(l.part.begin(), l.part.end(), [&](double q) { return q * whole > 0.0; });
  if (one_sign && std::abs(whole) > kClear * deviation) {
    l.clear = std::abs(whole) / deviation;
    return;
  }
  for (std::size_t a = 0; a < kParts; ++a) {
    double sum = 0.0;
    for (std::size_t b = a; b < kParts && l.part[b] * l.part[a] > 0.0; ++b) {
      sum += l.part[b];
      const auto n = static_cast<double>(b - a + 1);
      const double clear = std::abs(sum / n) / (deviation * std::sqrt(kParts / n));
      if (b == a || clear < std::max(kClearPart, l.clear)) continue;
      l.clear = clear;
      l.mean = sum / n;
      l.first = a;
      l.last = b + 1;
    }
  }
}

/// The step of a seam from pixels at least one off it on both sides, slopes taken away; the median
/// along it, whatever stands on it.
SeamArtefact measured(const Grid<float>& h, const Steps& s, const Grid<float>& steps,
                      const Line& line, bool level, double deviation) {
  std::vector<double> height;
  const auto row_of = [&](std::size_t part) {
    return static_cast<std::ptrdiff_t>(part) * steps.rows() / static_cast<std::ptrdiff_t>(kParts);
  };
  for (std::ptrdiff_t r = row_of(line.first); r < row_of(line.last); ++r) {
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
  seam.from = static_cast<double>(line.first) / kParts;
  seam.to = static_cast<double>(line.last) / kParts;
  if (height.empty()) return seam;
  seam.step_m = median_of(height);
  for (double& v : height) v = std::abs(v - seam.step_m);
  // Of a median of normal values, which are alike along the seam.
  seam.sigma_m = 1.2533 * static_cast<double>(kNormal) * median_of(height) * s.alike /
                 std::sqrt(static_cast<double>(height.size()));
  const double doubt = 4.0 * deviation * std::sqrt(static_cast<double>(kParts));
  seam.separable =
      line.first == 0 && line.last == kParts && seam.step_m * line.mean > 0.0 &&
      std::all_of(line.part.begin(), line.part.end(), [&](double q) {
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
      find_run(lines[i], deviation);
      if (lines[i].clear > 0.0 && sharp(lines, i))
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
  for (const Line& l : chosen)
    if (const SeamArtefact seam = measured(h, s, steps, l, level, deviation);
        std::abs(seam.step_m) > kKnown * seam.sigma_m)
      out.push_back(seam);
  return out;
}

/// Where tiles of a mosaic meet, heights step up here and down there: rows or columns whose steps
/// are large in themselves, next to ones whose are not.
class RoughLines {
 public:
  RoughLines(const Grid<float>& h, const Steps& s, bool level)
      : h_(h),
        level_(level),
        steps_(in_deviations(s, level)),
        size_(static_cast<std::size_t>(steps_.cols())) {
    for (std::ptrdiff_t c = 0; c < steps_.cols(); ++c) {
      Parts& of = size_[static_cast<std::size_t>(c)];
      Parts count{};
      for (std::ptrdiff_t r = 0; r < steps_.rows(); ++r) {
        const auto p =
            kParts * static_cast<std::size_t>(r) / static_cast<std::size_t>(steps_.rows());
        of[p] += std::abs(static_cast<double>(steps_(r, c)));
        count[p] += steps_(r, c) == 0.0F ? 0.0 : 1.0;
      }
      for (std::size_t p = 0; p < kParts; ++p) of[p] = count[p] > 7.0 ? of[p] / count[p] : 0.0;
    }
  }

  [[nodiscard]] std::vector<SeamArtefact> find() const {
    std::vector<SeamArtefact> out;
    std::ptrdiff_t before = -100;
    for (std::ptrdiff_t c = 2; c + 1 < steps_.cols(); ++c) {
      const double here = above(c);
      if (here == 0.0 || c - before < 5 || here < std::max(above(c - 1), above(c + 1))) continue;
      before = c;
      out.push_back(seam_at(c));
    }
    return out;
  }

 private:
  using Parts = std::array<double, kParts>;

  /// Median of a part over lines 5 to 20 away.
  [[nodiscard]] double usual(std::ptrdiff_t c, std::size_t part) const {
    std::vector<double> around;
    for (std::ptrdiff_t k = 5; k <= 20; ++k)
      for (const std::ptrdiff_t i : {c - k, c + k})
        if (i >= 2 && i + 1 < steps_.cols() && size_[static_cast<std::size_t>(i)][part] > 0.0)
          around.push_back(size_[static_cast<std::size_t>(i)][part]);
    if (around.size() < 10) return INFINITY;
    return median_of(around);
  }

  /// Mean over the parts of a line's steps over those usual there; 0 if it does not stand out.
  [[nodiscard]] double above(std::ptrdiff_t c) const {
    double sum = 0.0;
    std::size_t rough = 0;
    for (std::size_t p = 0; p < kParts; ++p) {
      const double ratio = size_[static_cast<std::size_t>(c)][p] / usual(c, p);
      sum += ratio / kParts;
      if (ratio > kRoughPart) ++rough;
    }
    return sum > kRough && rough >= kRoughParts ? sum : 0.0;
  }

  [[nodiscard]] SeamArtefact seam_at(std::ptrdiff_t c) const {
    SeamArtefact seam;
    seam.level = level_;
    seam.at = static_cast<double>(c);
    double square = 0.0, n = 0.0;
    for (std::ptrdiff_t r = 0; r < steps_.rows(); ++r) {
      const auto at = [&](std::ptrdiff_t k) {
        return static_cast<double>(level_ ? h_(c + k, r) : h_(r, c + k));
      };
      const double v = 1.5 * (at(0) - at(-1)) + 0.5 * (at(-2) - at(1));
      if (std::isnan(v)) continue;
      square += v * v;
      n += 1.0;
    }
    seam.step_m = n > 0.0 ? std::sqrt(square / n) : 0.0;
    seam.sigma_m = seam.step_m;  // of either sign
    return seam;
  }

  const Grid<float>& h_;
  bool level_;
  Grid<float> steps_;
  std::vector<Parts> size_;
};

}  // namespace

std::vector<SeamArtefact> find_seams(const Grid<float>& h, const Steps& steps) {
  std::vector<SeamArtefact> out;
  if (std::min(h.rows(), h.cols()) < kShortest) return out;
  for (const bool level : {false, true}) {
    const std::vector<SeamArtefact> straight = seams_along(h, steps, level);
    out.insert(out.end(), straight.begin(), straight.end());
    if (std::min(h.rows(), h.cols()) < kShortestRough) continue;
    for (const SeamArtefact& rough : RoughLines(h, steps, level).find())
      if (std::none_of(out.begin(), out.end(), [&](const SeamArtefact& s) {
            return s.level == level && std::abs(s.at - rough.at) < 4.0;
          }))
        out.push_back(rough);
  }
  return out;
}

}  // namespace maquette::heightmap::detail

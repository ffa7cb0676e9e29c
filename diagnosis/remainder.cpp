// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/remainder.hpp"

#include <algorithm>
#include <cmath>

#include "core/median.hpp"
#include "diagnosis/detail/periodogram.hpp"

namespace maquette::diagnosis::detail {
namespace {

constexpr double kLonely = 7.0;  // robust standard deviations
/// The same of places that are further off than five times what a surface without a cause is uneven
/// by. The highest place of a smooth random field of 6 to 30 mm on 150 mm is above 4.8 in 1 % of
/// fields (plane removed, robust spread; drawn 3000 times each); a bulge of 0.2 mm over a fifth of
/// the part has 6.5, and is not to pass for smooth noise.
constexpr double kLonelyFar = 5.0, kFar_mm = 0.1;
/// A process longer than this many cells is the block's own unevenness, which is rarely more than
/// 0.02 mm (fit.cpp): found beside right answers 0.036 at most, 0.053 for a scanner that drifts by
/// 0.08.
constexpr double kMostUneven_mm = 0.045, kUnevenCells = 2.0;
/// Scans of one part differ by noise and poses alone: by 0.004 mm of anything smooth at most, on
/// 12 cases, by 0.072 for a range that is off by 0.07 in turn.
constexpr double kApart_mm = 0.012;
constexpr double kEdge = 7.5;
/// Of a straight line of cells that differ from those across it. Where nothing is left the clearest
/// has 3.5 to 5.2; a patch of 0.054 mm under noise and roughness of 0.07 has 6.0. Of one that runs
/// between rows and columns of cells, of which there are three times as many.
constexpr double kLongEdge = 5.6, kLongObliqueEdge = 6.0;
constexpr double kLine = 22.0;  // over the mean of its ring; exponential: e^-22 each
constexpr double kRing = 7.0;   // standard deviations of a ring's mean
/// rms of a wave, or of rings, over all of the part. Where a scanner's columns beat with the
/// passes' ridges, of 0.0031 mm, or with the places that a measured surface was resampled at, lines
/// of up to 0.001 were 67 times their ring's level, and a ring of them held 0.0008. On steep ground
/// ridges are higher, and one line held a sixth of them. And a share of the variance of all that
/// neighbouring cells have in common: where a coat was the sum of 260 plane waves, two of them side
/// by side held 1.5 %.
constexpr double kLeastWave_mm = 0.002, kLineOfRidges = 0.2, kLeastShare = 0.05;

struct Means {
  double side;
  Grid<double> value, count;
  Grid<double> but_one;  ///< without the point that is furthest off; of a single point that itself
};

Means means_of(const std::vector<Observation>& all, const std::vector<double>& r, const Layout& l,
               double side) {
  const auto cols =
      static_cast<std::ptrdiff_t>(std::ceil(static_cast<double>(l.cols) * l.cell_mm / side - 1e-9));
  const auto rows =
      static_cast<std::ptrdiff_t>(std::ceil(static_cast<double>(l.rows) * l.cell_mm / side - 1e-9));
  Means m{side, Grid<double>(rows, cols, 0.0), Grid<double>(rows, cols, 0.0), {}};
  Grid<double> furthest(rows, cols, 0.0);
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (!all[i].on_surface) continue;
    const auto c = static_cast<std::ptrdiff_t>((all[i].place.x - l.x0) / side),
               row = static_cast<std::ptrdiff_t>((all[i].place.y - l.y0) / side);
    if (!m.value.contains(row, c)) continue;
    m.value(row, c) += r[i];
    m.count(row, c) += 1.0;
    if (std::abs(r[i]) > std::abs(furthest(row, c))) furthest(row, c) = r[i];
  }
  m.but_one = m.value;
  for (std::size_t i = 0; i < m.value.cells().size(); ++i) {
    const double count = m.count.cells()[i];
    if (count > 1.0)
      m.but_one.cells()[i] = (m.value.cells()[i] - furthest.cells()[i]) / (count - 1.0);
    if (count > 0.0) m.value.cells()[i] /= count;
  }
  return m;
}

/// Values over their robust spread, each scaled by the number of its points.
struct Scores {
  std::vector<double> score;
  std::vector<std::size_t> cell;
  double spread = 0.0, typical = 1.0;

  /// Of another value, of so many points.
  [[nodiscard]] double of(double value, double information) const {
    return std::abs(value) /
           std::fmax(1e-12, spread * std::sqrt(std::fmax(1.0, typical / information)));
  }
};

Scores scored(const std::vector<double>& value, const std::vector<double>& information,
              const std::vector<std::size_t>& cell) {
  // Variance = a + b / n by medians in halves of n would be finer; the larger of both is enough:
  // squares with few points are compared with the spread that few points have.
  Scores s{{}, cell, 0.0, median(information)};
  std::vector<double> absolute;
  for (std::size_t i = 0; i < value.size(); ++i) absolute.push_back(std::abs(value[i]));
  s.spread = kMadToSigma * median(std::move(absolute));
  for (std::size_t i = 0; i < value.size(); ++i) s.score.push_back(s.of(value[i], information[i]));
  return s;
}

/// The clearest straight edge: sums of steps across lines of cells, over their own robust spread
/// (cells that agree with their neighbours make sums wider than steps say). A patch whose border is
/// no wider than the noise at any single place shows so, and a crack that runs where it likes.
/// @param row_step, col_step  from one cell of a line to the next
double clearest_edge(const Means& m, double enough, std::ptrdiff_t row_step,
                     std::ptrdiff_t col_step) {
  constexpr std::ptrdiff_t kCells[] = {5, 7, 8, 10, 12, 24};
  constexpr double kMost = 4.0;        // no single step speaks louder, spreads
  constexpr std::size_t kLines = 200;  // fewer have no spread
  // Wherever in the cell between two the border lies.
  const std::ptrdiff_t apart = row_step == 0 || col_step == 0 ? 2 : 1;
  const std::ptrdiff_t dr = -apart * col_step, dc = apart * row_step;
  const std::ptrdiff_t rows = m.value.rows(), cols = m.value.cols();
  Grid<double> steps(rows, cols, NAN);
  std::vector<double> sizes;
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      if (!m.value.contains(r + dr, c + dc) || m.count(r, c) < enough ||
          m.count(r + dr, c + dc) < enough)
        continue;
      steps(r, c) = m.value(r + dr, c + dc) - m.value(r, c);
      sizes.push_back(std::abs(steps(r, c)));
    }
  if (sizes.size() < kLines) return 0.0;
  const double spread = std::fmax(1e-12, kMadToSigma * median(std::move(sizes)));
  double clearest = 0.0;
  for (const std::ptrdiff_t length : kCells) {
    std::vector<double> sums;
    for (std::ptrdiff_t r = 0; r < rows; ++r)
      for (std::ptrdiff_t c = 0; c < cols; ++c) {
        if (!steps.contains(r + (length - 1) * row_step, c + (length - 1) * col_step)) continue;
        double sum = 0.0, count = 0.0;
        for (std::ptrdiff_t k = 0; k < length; ++k)
          if (const double s = steps(r + k * row_step, c + k * col_step) / spread;
              std::isfinite(s)) {
            sum += std::clamp(s, -kMost, kMost);
            count += 1.0;
          }
        if (count >= 0.8 * static_cast<double>(length))
          sums.push_back(std::abs(sum) / std::sqrt(count));
      }
    if (sums.size() < kLines) continue;
    const double largest = *std::max_element(sums.begin(), sums.end());
    clearest = std::fmax(clearest, largest / std::fmax(1.0, kMadToSigma * median(std::move(sums))));
  }
  return clearest;
}

/// Along a row, a column, and between them.
bool has_a_long_edge(const Means& m, double enough) {
  for (const auto& [row, col] : {std::pair<std::ptrdiff_t, std::ptrdiff_t>{0, 1}, {1, 0}})
    if (clearest_edge(m, enough, row, col) > kLongEdge) return true;
  for (const auto& [row, col] :
       {std::pair<std::ptrdiff_t, std::ptrdiff_t>{1, 1}, {-1, 1}, {1, 2}, {-1, 2}, {2, 1}, {-2, 1}})
    if (clearest_edge(m, enough, row, col) > kLongObliqueEdge) return true;
  return false;
}

/// Ridges between passes as most places have them, mm rms: what is levelled over the shortest
/// length.
double usual_ridges_mm(const std::vector<Observation>& all) {
  std::vector<double> heights;
  for (const Observation& o : all)
    if (o.on_surface) heights.push_back(std::abs(o.normal.z * static_cast<double>(o.levelled[0])));
  return kMadToSigma * median(std::move(heights), 0.0);
}

}  // namespace

Remainder judge(const std::vector<Observation>& all, const std::vector<double>& residual,
                const Layout& l, const Bank& bank, const Fit& f, Squares& odd) {
  Remainder rest;
  const Theta& theta = bank.theta[static_cast<std::size_t>(f.theta[0])];
  rest.smooth_mm = std::sqrt(theta.smooth_ratio() * f.top_variance[0]);
  rest.smooth_length_mm = theta.length_mm;
  const auto note = [&](const char* kind) {
    if (std::find(rest.kinds.begin(), rest.kinds.end(), kind) == rest.kinds.end())
      rest.kinds.emplace_back(kind);
    rest.found = true;
  };
  if (rest.smooth_mm > kMostUneven_mm && rest.smooth_length_mm > kUnevenCells * l.cell_mm)
    note("more unevenness than blocks have");
  const Theta& apart = bank.theta[static_cast<std::size_t>(f.theta[1])];
  if (std::sqrt(apart.smooth_ratio() * f.top_variance[1]) > kApart_mm) note("scans that differ");
  odd = {l.x0, l.y0, 0.5 * l.cell_mm, {}};
  double structured = 0.0;
  for (const double share : {0.25, 0.5, 1.0}) {
    const Means m = means_of(all, residual, l, share * l.cell_mm);
    const std::ptrdiff_t rows = m.value.rows(), cols = m.value.cols();
    if (share == 0.5) odd.in = Grid<std::uint8_t>(rows, cols, 0);
    std::vector<double> counts;
    for (const double c : m.count.cells())
      if (c > 0.0) counts.push_back(c);
    const double enough = std::fmax(3.0, 0.25 * median(counts));
    std::vector<double> value, information;
    std::vector<std::size_t> cell;
    for (std::size_t i = 0; i < m.value.cells().size(); ++i)
      if (m.count.cells()[i] >= enough) {
        value.push_back(m.value.cells()[i]);
        information.push_back(m.count.cells()[i]);
        cell.push_back(i);
      }
    if (value.size() < 50) continue;
    const Scores lonely = scored(value, information, cell);
    const auto is_lonely = [](double score, double mm) {
      return score > kLonely || (score > kLonelyFar && std::abs(mm) > kFar_mm);
    };
    for (std::size_t i = 0; i < lonely.score.size(); ++i)
      if (const double but_one = m.but_one.cells()[cell[i]];
          is_lonely(lonely.score[i], value[i]) &&
          is_lonely(lonely.of(but_one, information[i] - 1.0), but_one))
        note("lonely places");
    if (share == 0.5)
      for (std::size_t i = 0; i < lonely.score.size(); ++i)
        if (lonely.score[i] > 4.5) {
          const auto r = static_cast<std::ptrdiff_t>(lonely.cell[i]) / cols,
                     c = static_cast<std::ptrdiff_t>(lonely.cell[i]) % cols;
          for (std::ptrdiff_t dr = -1; dr <= 1; ++dr)
            for (std::ptrdiff_t dc = -1; dc <= 1; ++dc)
              if (odd.in.contains(r + dr, c + dc)) odd.in(r + dr, c + dc) = 1;
        }
    // Structure: variance of the means beyond what their points' scatter gives, from neighbours.
    std::vector<double> step, step_but_one, step_information;
    std::vector<std::size_t> step_cell;
    double products = 0.0, pairs = 0.0, squares = 0.0;
    for (std::ptrdiff_t r = 0; r < rows; ++r)
      for (std::ptrdiff_t c = 0; c < cols; ++c)
        for (const auto& [dr, dc] : {std::pair<std::ptrdiff_t, std::ptrdiff_t>{0, 1}, {1, 0}}) {
          if (!m.value.contains(r + dr, c + dc) || m.count(r, c) < enough ||
              m.count(r + dr, c + dc) < enough)
            continue;
          const double a = m.value(r, c), b = m.value(r + dr, c + dc);
          step.push_back(a - b);
          step_but_one.push_back(m.but_one(r, c) - m.but_one(r + dr, c + dc));
          step_information.push_back(1.0 / (1.0 / m.count(r, c) + 1.0 / m.count(r + dr, c + dc)));
          step_cell.push_back(static_cast<std::size_t>(r * cols + c));
          products += a * b;
          squares += 0.5 * (a * a + b * b);
          pairs += 1.0;
        }
    const Scores edges = scored(step, step_information, step_cell);
    std::size_t sharp = 0;
    for (std::size_t i = 0; i < edges.score.size(); ++i)
      sharp += edges.score[i] > kEdge && edges.of(step_but_one[i], step_information[i]) > kEdge;
    if (sharp >= 2 || (share == 0.5 && has_a_long_edge(m, enough))) note("edges");
    if (pairs > 0.0) structured = std::fmax(structured, products / pairs);
    if (share == 0.25 && squares > 0.0) {
      rest.morans_i = products / squares;
      rest.p_white = std::erfc(std::fmax(0.0, rest.morans_i) * std::sqrt(0.5 * pairs));
    }
    if (share != 0.25) continue;
    const std::ptrdiff_t n = std::max(rows, cols), half = n / 2;
    Grid<double> map = m.value;
    for (std::size_t i = 0; i < map.cells().size(); ++i)
      if (m.count.cells()[i] < enough) map.cells()[i] = NAN;
    const Grid<double> power = periodogram(map, n, n);
    const auto signed_wave = [&](std::ptrdiff_t k) { return k > half ? k - n : k; };
    std::vector<std::vector<double>> rings(static_cast<std::size_t>(half + 1));
    for (std::ptrdiff_t q = 0; q < n; ++q)
      for (std::ptrdiff_t k = 0; k < n; ++k) {
        const double radius =
            std::hypot(static_cast<double>(signed_wave(q)), static_cast<double>(signed_wave(k)));
        const auto ring = static_cast<std::size_t>(std::lround(radius));
        if (ring < rings.size()) rings[ring].push_back(power(q, k));
      }
    std::vector<double> level(rings.size(), 0.0), mean(rings.size(), 0.0);
    for (std::size_t i = 0; i < rings.size(); ++i) {
      if (rings[i].empty()) continue;
      level[i] = median(rings[i]) / 0.693;
      // What stands out of its ring is a wave, and no ring.
      for (const double p : rings[i])
        mean[i] += std::fmin(p, kLine * level[i]) / static_cast<double>(rings[i].size());
    }
    const double least_mm = std::max({kLeastWave_mm, kLineOfRidges * usual_ridges_mm(all),
                                      std::sqrt(kLeastShare * std::fmax(0.0, structured))});
    // rms over all of the part of what has so much power beyond its surroundings.
    const auto rms_mm = [&](double more) {
      return std::sqrt(std::fmax(0.0, more)) / static_cast<double>(value.size());
    };
    // Short waves of few points a ring are compared with both neighbours' level as well.
    for (std::size_t i = 4; i + 2 < rings.size(); ++i) {
      const double about = std::max({level[i], 0.5 * (level[i - 1] + level[i - 2]), 1e-300});
      for (const double p : rings[i])
        if (p > kLine * about && rms_mm(2.0 * p) > least_mm) note("a wave");
      const double sides = std::fmax(mean[i - 2], mean[i + 2]);
      const double n_ring = 0.5 * static_cast<double>(rings[i].size());  // half are mirror images
      if (mean[i] > 1.5 * sides && (mean[i] / sides - 1.0) * std::sqrt(n_ring) > kRing * 1.4 &&
          rms_mm(2.0 * n_ring * (mean[i] - sides)) > least_mm)
        note("rings");
    }
  }
  rest.structured_rms = std::sqrt(std::fmax(0.0, structured));
  return rest;
}

}  // namespace maquette::diagnosis::detail

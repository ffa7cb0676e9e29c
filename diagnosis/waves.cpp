// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/waves.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <complex>
#include <map>
#include <numbers>
#include <optional>

#include <oneapi/tbb/parallel_for.h>
#include <Eigen/Dense>

#include "core/median.hpp"

namespace maquette::diagnosis::detail {

namespace {

/// Numbers of waves over `span` (mm) of x or y, at most 4, none that is no stronger than noise
/// makes once in a thousand cases; from 6 waves a span up to wavelengths of 0.8 mm. Choosing blocks
/// only.
std::vector<double> strongest_waves(const std::vector<Observation>& all,
                                    const std::vector<double>& residual, const Layout& layout,
                                    int axis, double span) {
  constexpr double kStep = 0.5, kFirst = 6.0;
  const auto count =
      static_cast<std::size_t>(std::clamp((span / 0.8 - kFirst) / kStep, 1.0, 1200.0));
  // Sorted into bins finer than the shortest wave: a sum for each bin stands for its points.
  const double bin = span / 2048.0;
  std::vector<double> sum(2048, 0.0);
  double squares = 0.0, n = 0.0;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Observation& o = all[i];
    if (layout.set_of(o.place.x, o.place.y) != kChoose) continue;
    const double at = (axis == 0 ? o.tip.x - layout.x0 : o.tip.y - layout.y0) / bin;
    if (!(at >= 0.0 && at < 2048.0)) continue;
    sum[static_cast<std::size_t>(at)] += residual[i];
    squares += residual[i] * residual[i];
    n += 1.0;
  }
  std::vector<double> power(count, 0.0);
  oneapi::tbb::parallel_for(std::size_t{0}, count, [&](std::size_t k) {
    const double waves = kFirst + kStep * static_cast<double>(k);
    std::complex<double> total = 0.0,
                         turn = std::polar(1.0, 2.0 * std::numbers::pi * waves / 2048.0), now = 1.0;
    for (std::size_t b = 0; b < sum.size(); ++b) {
      total += sum[b] * now;
      now *= turn;
    }
    power[k] = std::norm(total) / std::fmax(1e-300, squares);
  });
  // Against the line's surroundings: correlated noise has no even spectrum.
  std::vector<std::pair<double, double>> found;
  for (std::size_t k = 0; k < count; ++k) {
    std::vector<double> near;
    for (std::size_t j = k > 30 ? k - 30 : 0; j < std::min(count, k + 31); ++j)
      if (j + 4 < k || j > k + 4) near.push_back(power[j]);
    if (near.empty()) continue;
    std::nth_element(near.begin(), near.begin() + static_cast<std::ptrdiff_t>(near.size() / 2),
                     near.end());
    const double level = near[near.size() / 2] / 0.693;
    const bool peak =
        (k == 0 || power[k] >= power[k - 1]) && (k + 1 == count || power[k] >= power[k + 1]);
    if (peak && power[k] > 14.0 * level)
      found.emplace_back(power[k], kFirst + kStep * static_cast<double>(k));
  }
  std::sort(found.rbegin(), found.rend());
  std::vector<double> waves;
  for (const auto& [p, w] : found)
    if (waves.size() < 4) waves.push_back(w);
  return waves;
}

/// In place, length a power of two (Cooley and Tukey 1965).
void transform(std::vector<std::complex<double>>& v) {
  const std::size_t n = v.size();
  for (std::size_t i = 1, j = 0; i < n; ++i) {
    std::size_t bit = n >> 1;
    for (; j & bit; bit >>= 1) j ^= bit;
    j |= bit;
    if (i < j) std::swap(v[i], v[j]);
  }
  for (std::size_t half = 1; half < n; half *= 2) {
    std::vector<std::complex<double>> turn(half);
    for (std::size_t k = 0; k < half; ++k)
      turn[k] =
          std::polar(1.0, -std::numbers::pi * static_cast<double>(k) / static_cast<double>(half));
    for (std::size_t i = 0; i < n; i += 2 * half)
      for (std::size_t k = 0; k < half; ++k) {
        const auto a = v[i + k], b = v[i + k + half] * turn[k];
        v[i + k] = a + b;
        v[i + k + half] = a - b;
      }
  }
}

/// The same along the cutting length (mm), for waves that are steady in time: waves over the whole
/// length, which is many, so that their number is known to a half. Wavelengths of 0.8 mm to 40 mm.
std::vector<double> strongest_path_waves(const std::vector<Observation>& all,
                                         const std::vector<double>& residual, const Layout& layout,
                                         double cut) {
  if (!(cut > 100.0)) return {};
  std::size_t bins = 1024;
  while (bins < (1U << 22) && cut / static_cast<double>(bins) > 0.3) bins *= 2;
  std::vector<std::complex<double>> v(2 * bins, 0.0);  // padded: half waves count too
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Observation& o = all[i];
    if (!(o.path_mm >= 0.0 && o.path_mm < cut) || layout.set_of(o.place.x, o.place.y) != kChoose)
      continue;
    v[static_cast<std::size_t>(o.path_mm / cut * static_cast<double>(bins))] += residual[i];
  }
  transform(v);
  const auto first = static_cast<std::size_t>(2.0 * cut / 40.0),
             end = std::min(bins, static_cast<std::size_t>(2.0 * cut / 0.8));
  // Against the level of the surrounding 201 lines; noise gives e^-x for a line x times the level.
  const double least = std::log(static_cast<double>(bins)) + 7.0;
  std::vector<std::pair<double, double>> found;
  for (std::size_t from = first; from + 201 < end; from += 101) {
    std::vector<double> near;
    for (std::size_t k = from; k < from + 201; ++k) near.push_back(std::norm(v[k]));
    std::nth_element(near.begin(), near.begin() + 100, near.end());
    const double level = near[100] / 0.693;
    for (std::size_t k = from + 50; k < from + 151; ++k) {
      const double power = std::norm(v[k]);
      if (power > least * level && power >= std::norm(v[k - 1]) && power >= std::norm(v[k + 1]))
        found.emplace_back(power, 0.5 * static_cast<double>(k));
    }
  }
  // Passes that follow each other at even distances repeat a line on both sides: the strongest.
  std::sort(found.rbegin(), found.rend());
  std::vector<double> waves;
  for (const auto& [power, w] : found)
    if (waves.size() < 4) waves.push_back(w);
  return waves;
}

/// What lies between two stops: sums of residuals by their place along the path.
struct Stretch {
  double stops = 0.0, rapid_mm = 0.0;
  std::vector<std::pair<double, double>> at;  // mm, sum; in order
  /// Sum of the residuals against a wave of k radians a mm.
  [[nodiscard]] std::complex<double> amplitude(double k) const {
    std::complex<double> sum = 0.0;
    for (const auto& [mm, value] : at) sum += value * std::polar(1.0, -k * mm);
    return sum;
  }
};

/// Waves that are steady in time where the program lifts or turns round after each pass: rapids
/// and stops take time, too, and how much nobody knows. Their wavelength is that of the powers of
/// all passes together; then what of the rapids' way counts, and what each stop does, by which the
/// passes' phases fall in line.
class StoppedWaves {
 public:
  StoppedWaves(const std::vector<Observation>& all, const std::vector<double>& residual,
               const Layout& layout) {
    std::map<std::uint32_t, std::map<std::int64_t, double>> bins;
    std::map<std::uint32_t, double> rapids;
    for (std::size_t i = 0; i < all.size(); ++i) {
      const Observation& o = all[i];
      if (!(o.path_mm >= 0.0) || layout.set_of(o.place.x, o.place.y) != kChoose) continue;
      bins[o.stops][static_cast<std::int64_t>(o.path_mm / kBin_mm)] += residual[i];
      rapids[o.stops] = static_cast<double>(o.rapid_mm);
    }
    for (const auto& [stops, sums] : bins) {
      Stretch s{static_cast<double>(stops), rapids[stops], {}};
      for (const auto& [bin, sum] : sums)
        s.at.emplace_back((static_cast<double>(bin) + 0.5) * kBin_mm, sum);
      longest_mm_ = std::fmax(longest_mm_, s.at.back().first - s.at.front().first);
      stretches_.push_back(std::move(s));
    }
  }

  /// The strongest. @param cut_mm  cutting length of the program
  [[nodiscard]] std::optional<PathWave> find(double cut_mm) const {
    constexpr std::size_t kLeastStretches = 30;
    if (stretches_.size() < kLeastStretches || !(longest_mm_ > 20.0 * kBin_mm)) return {};
    std::optional<PathWave> found;
    double best = 0.0;
    for (const double k : wave_numbers()) {
      const InLine in_line = lined_up(k);
      if (!(in_line.excess > best)) continue;
      best = in_line.excess;
      found = refined(in_line, cut_mm);
    }
    return found;
  }

  /// Of the residuals that swing so. @param cut_mm  as above
  [[nodiscard]] double power(const PathWave& wave, double cut_mm) const {
    return power(InLine{kTurn * wave.waves / cut_mm, wave.rapid_share, wave.at_stops});
  }

 private:
  static constexpr double kBin_mm = 0.3, kTurn = 2.0 * std::numbers::pi;
  struct InLine {
    double k = 0.0, rapid_share = 0.0, at_stops = 0.0;
    double excess = 0.0;  // of the power, beyond what noise reaches
  };

  [[nodiscard]] double power(const InLine& x) const {
    std::complex<double> sum = 0.0;
    for (const Stretch& s : stretches_)
      sum += s.amplitude(x.k) *
             std::polar(1.0, -x.k * x.rapid_share * s.rapid_mm - kTurn * x.at_stops * s.stops);
    return std::norm(sum);
  }

  /// Wave numbers at which the passes' powers together stand out, radians a mm; at most 3.
  [[nodiscard]] std::vector<double> wave_numbers() const {
    std::size_t length = 64;
    while (static_cast<double>(length) * kBin_mm < 2.0 * longest_mm_) length *= 2;
    std::vector<double> power(length / 2, 0.0);
    std::vector<std::complex<double>> v;
    for (const Stretch& s : stretches_) {
      v.assign(length, 0.0);
      for (const auto& [mm, value] : s.at)
        v[static_cast<std::size_t>((mm - s.at.front().first) / kBin_mm + 0.5)] += value;
      transform(v);
      for (std::size_t i = 0; i < power.size(); ++i) power[i] += std::norm(v[i]);
    }
    // Waves of 0.8 to 15 mm (longer ones, with a phase for each stop, are bows across the passes)
    // against their surroundings; powers of noise scatter by one over the root of the passes.
    constexpr std::size_t kAround = 30, kBeside = 5, kMost = 3;
    const double span = static_cast<double>(length) * kBin_mm;
    const double least = 1.0 + 4.0 / std::sqrt(static_cast<double>(stretches_.size()));
    const auto end = std::min(power.size() - 1, static_cast<std::size_t>(span / 0.8));
    std::vector<std::pair<double, double>> peaks;
    for (auto i = std::max<std::size_t>(1, static_cast<std::size_t>(span / 15.0)); i < end; ++i) {
      if (power[i] < power[i - 1] || power[i] < power[i + 1]) continue;
      std::vector<double> near;
      for (std::size_t j = i > kAround ? i - kAround : 1; j < std::min(end, i + kAround); ++j)
        if (j + kBeside < i || j > i + kBeside) near.push_back(power[j]);
      if (near.empty()) continue;
      const double ratio = power[i] / median(std::move(near));
      if (ratio > least) peaks.emplace_back(ratio, kTurn * static_cast<double>(i) / span);
    }
    std::sort(peaks.rbegin(), peaks.rend());
    std::vector<double> strongest;
    for (std::size_t i = 0; i < std::min(kMost, peaks.size()); ++i) {
      // Between lines of the transform, by all passes' powers.
      const double half = 0.5 * kTurn / span;
      double best = 0.0, at = peaks[i].second;
      for (int step = -8; step <= 8; ++step) {
        const double k = peaks[i].second + step / 8.0 * half;
        double sum = 0.0;
        for (const Stretch& s : stretches_) sum += std::norm(s.amplitude(k));
        if (sum <= best) continue;
        best = sum;
        at = k;
      }
      strongest.push_back(at);
    }
    return strongest;
  }

  /// Rapids of one length do what stops do; so far as they differ they say how much they count.
  [[nodiscard]] double uneven_rapids_mm() const {
    const Stretch &a = stretches_.front(), &b = stretches_.back();
    const double mean = (b.rapid_mm - a.rapid_mm) / (b.stops - a.stops);
    double most = 0.0;
    for (const Stretch& s : stretches_)
      most = std::fmax(most, std::abs(s.rapid_mm - a.rapid_mm - mean * (s.stops - a.stops)));
    return most;
  }

  /// The share of the rapids' way and the phase of a stop that bring the passes' waves in line.
  [[nodiscard]] InLine lined_up(double k) const {
    const auto first = static_cast<std::size_t>(stretches_.front().stops);
    const auto stops = static_cast<std::size_t>(stretches_.back().stops) - first + 1;
    std::size_t length = 64;
    while (length < 2 * stops) length *= 2;
    std::vector<std::complex<double>> of_stretch;
    double squares = 0.0;
    for (const Stretch& s : stretches_) {
      of_stretch.push_back(s.amplitude(k));
      squares += std::norm(of_stretch.back());
    }
    constexpr double kMostShare = 1.25, kPhase = 0.5;
    constexpr int kMostShares = 4000;
    const int shares = static_cast<int>(
        std::fmin(kMostShares, std::floor(kMostShare * k * uneven_rapids_mm() / kPhase)));
    std::vector<InLine> best(static_cast<std::size_t>(shares) + 1);
    oneapi::tbb::parallel_for(0, shares + 1, [&](int i) {
      const double share = shares == 0 ? 0.0 : kMostShare * i / shares;
      std::vector<std::complex<double>> v(length, 0.0);
      for (std::size_t n = 0; n < stretches_.size(); ++n)
        v[static_cast<std::size_t>(stretches_[n].stops) - first] +=
            of_stretch[n] * std::polar(1.0, -k * share * stretches_[n].rapid_mm);
      transform(v);
      const auto peak = std::max_element(v.begin(), v.end(), [](const auto& a, const auto& b) {
        return std::norm(a) < std::norm(b);
      });
      best[static_cast<std::size_t>(i)] = {
          k, share, static_cast<double>(peak - v.begin()) / static_cast<double>(length),
          std::norm(*peak) / squares};
    });
    InLine most = *std::max_element(best.begin(), best.end(), [](const InLine& a, const InLine& b) {
      return a.excess < b.excess;
    });
    // Noise gives e^-x for a sum x times that of the squares; so many are looked at.
    most.excess -= std::log(static_cast<double>(length) * (shares + 1.0)) + 7.0;
    return most;
  }

  /// Where the sum of all waves in line is largest. Wave number and share are changed about the
  /// middle of the program, with the phase of a stop: all three would turn the passes alike.
  [[nodiscard]] PathWave refined(InLine w, double cut_mm) const {
    const Stretch &a = stretches_.front(), &b = stretches_.back();
    const double stops = b.stops - a.stops,
                 advance_mm = (b.at.front().first - a.at.front().first) / stops,
                 rapid_mm = (b.rapid_mm - a.rapid_mm) / stops;
    double best = power(w);
    // A quarter of a radian each; rapids all alike leave nothing to find.
    const double uneven_mm = uneven_rapids_mm();
    std::array<double, 3> step{
        0.5 / longest_mm_, w.k * uneven_mm > 0.5 ? 0.25 / (w.k * uneven_mm) : 0.0, 0.25 / stops};
    constexpr int kHalvings = 7;
    for (int halving = 0; halving < kHalvings; ++halving) {
      for (bool moved = true; moved;) {
        moved = false;
        for (std::size_t j = 0; j < 3; ++j)
          for (const double way : {step[j], -step[j]}) {
            if (way == 0.0) continue;
            InLine x = w;
            if (j == 0) {
              x.k += way;
              x.at_stops -= way * (advance_mm + x.rapid_share * rapid_mm) / kTurn;
            } else if (j == 1) {
              x.rapid_share += way;
              x.at_stops -= way * x.k * rapid_mm / kTurn;
            } else {
              x.at_stops += way;
            }
            const double now = power(x);
            if (!(now > best)) continue;
            best = now;
            w = x;
            moved = true;
          }
      }
      for (double& s : step) s *= 0.5;
    }
    return {w.k * cut_mm / kTurn, w.rapid_share, w.at_stops - std::round(w.at_stops)};
  }

  std::vector<Stretch> stretches_;
  double longest_mm_ = 0.0;
};

/// Least squares of a quadric of plan.
class Quadric {
 public:
  using Terms = Eigen::Matrix<double, 6, 1>;
  [[nodiscard]] static Terms terms(double u, double v) { return {1.0, u, v, u * u, u * v, v * v}; }
  void add(const Terms& t, double value) {
    gram_ += t * t.transpose();
    sum_ += value * t;
  }
  [[nodiscard]] Terms fitted() const { return gram_.ldlt().solve(sum_); }

 private:
  Eigen::Matrix<double, 6, 6> gram_ = 1e-9 * Eigen::Matrix<double, 6, 6>::Identity();
  Terms sum_ = Terms::Zero();
};

/// Residuals less a quadric of plan in each block.
std::vector<double> unbowed(const std::vector<Observation>& all, std::vector<double> residual,
                            const Layout& l) {
  const double side = l.cell_mm * static_cast<double>(l.block);
  const auto terms = [&](Vec3 p) {
    const double u = (p.x - l.x0) / side, v = (p.y - l.y0) / side;
    return Quadric::terms(u - std::floor(u) - 0.5, v - std::floor(v) - 0.5);
  };
  std::vector<Quadric> blocks(l.set_of_block.size());
  for (std::size_t i = 0; i < all.size(); ++i)
    if (const int at = l.block_of(all[i].place.x, all[i].place.y); at >= 0)
      blocks[static_cast<std::size_t>(at)].add(terms(all[i].place), residual[i]);
  std::vector<Quadric::Terms> bows;
  for (const Quadric& b : blocks) bows.push_back(b.fitted());
  for (std::size_t i = 0; i < all.size(); ++i)
    if (const int at = l.block_of(all[i].place.x, all[i].place.y); at >= 0)
      residual[i] -= bows[static_cast<std::size_t>(at)].dot(terms(all[i].place));
  return residual;
}

/// Residuals of the choosing blocks less one quadric of plan, which they say; NaN: of the others.
std::vector<double> without_a_bow(const std::vector<Observation>& all, std::vector<double> residual,
                                  const Layout& layout, double span) {
  const auto terms = [&](Vec3 p) {
    return Quadric::terms(2.0 * (p.x - layout.x0) / span - 1.0,
                          2.0 * (p.y - layout.y0) / span - 1.0);
  };
  Quadric quadric;
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Vec3 p = all[i].place;
    if (layout.set_of(p.x, p.y) == kChoose)
      quadric.add(terms(p), residual[i]);
    else
      residual[i] = NAN;
  }
  const Quadric::Terms bow = quadric.fitted();
  for (std::size_t i = 0; i < all.size(); ++i)
    if (!std::isnan(residual[i])) residual[i] -= bow.dot(terms(all[i].place));
  return residual;
}

/// Slow waves along x or y alone, the two that leave least of the profile across the other axis:
/// numbers of waves over `span` (mm), 2 to 8. That they are there is for others to say.
/// @param residual  less a bow; NaN: not looked at
std::vector<double> slow_waves(const std::vector<Observation>& all,
                               const std::vector<double>& residual, const Layout& layout, int axis,
                               double span) {
  constexpr std::size_t kBins = 256, kMost = 2;
  constexpr double kFirst = 2.0, kLast = 8.0, kStep = 0.25;
  std::array<double, kBins> total{}, count{};
  for (std::size_t i = 0; i < all.size(); ++i) {
    const Vec3 tip = all[i].tip;
    const double at = (axis == 0 ? tip.x - layout.x0 : tip.y - layout.y0) / span * kBins;
    if (std::isnan(residual[i]) || !(at >= 0.0 && at < kBins)) continue;
    total[static_cast<std::size_t>(at)] += residual[i];
    count[static_cast<std::size_t>(at)] += 1.0;
  }
  std::vector<double> taken;  // of the sum of squares, by number of waves
  for (double waves = kFirst; waves <= kLast; waves += kStep) {
    using Profile = Eigen::Matrix<double, 5, 1>;
    Eigen::Matrix<double, 5, 5> a = 1e-9 * Eigen::Matrix<double, 5, 5>::Identity();
    Profile b = Profile::Zero();
    for (std::size_t k = 0; k < kBins; ++k) {
      const double u = (static_cast<double>(k) + 0.5) / kBins,
                   phase = 2.0 * std::numbers::pi * waves * u;
      const Profile p{1.0, u, u * u, std::sin(phase), std::cos(phase)};
      a += count[k] * p * p.transpose();
      b += total[k] * p;
    }
    taken.push_back(b.dot(a.ldlt().solve(b)));
  }
  std::vector<std::pair<double, double>> peaks;
  for (std::size_t k = 0; k < taken.size(); ++k)
    if ((k == 0 || taken[k] >= taken[k - 1]) && (k + 1 == taken.size() || taken[k] >= taken[k + 1]))
      peaks.emplace_back(taken[k], kFirst + kStep * static_cast<double>(k));
  std::sort(peaks.rbegin(), peaks.rend());
  std::vector<double> waves;
  for (std::size_t k = 0; k < std::min(kMost, peaks.size()); ++k) waves.push_back(peaks[k].second);
  return waves;
}

/// Those of `more` that none of `waves` stands for.
void append(std::vector<double>& waves, const std::vector<double>& more) {
  constexpr double kApart = 0.75;  // of a wave over the span
  for (const double w : more)
    if (std::none_of(waves.begin(), waves.end(),
                     [w](double other) { return std::abs(w - other) < kApart; }))
      waves.push_back(w);
}

}  // namespace

void find_waves(const std::vector<Observation>& all, const std::vector<double>& residual,
                const Layout& layout, Scene& scene) {
  const std::vector<double> flat = unbowed(all, residual, layout);
  const double span = 2.0 * scene.half_mm();
  const std::vector<double> level = without_a_bow(all, residual, layout, span);
  scene.slow_waves_x = slow_waves(all, level, layout, 0, span);
  scene.slow_waves_y = slow_waves(all, level, layout, 1, span);
  std::vector<double> along_path;
  for (const auto* r : {&residual, &flat}) {
    append(scene.waves_x, strongest_waves(all, *r, layout, 0, span));
    append(scene.waves_y, strongest_waves(all, *r, layout, 1, span));
    append(along_path, strongest_path_waves(all, *r, layout, scene.cut_mm));
  }
  for (const double waves : along_path) scene.waves_path.push_back({waves});
  // One that goes by the path alone is that with stops that add nothing, and simpler.
  constexpr double kClearly = 1.03;
  const StoppedWaves stopped(all, flat, layout);
  if (const auto wave = stopped.find(scene.cut_mm)) {
    double plain = 0.0;
    for (const double waves : along_path)
      for (int part = -4; part <= 4; ++part)  // they are known to a quarter
        plain = std::fmax(plain, stopped.power({waves + part / 16.0}, scene.cut_mm));
    if (stopped.power(*wave, scene.cut_mm) > kClearly * plain) scene.waves_path.push_back(*wave);
  }
}

}  // namespace maquette::diagnosis::detail

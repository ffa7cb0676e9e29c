// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/photon_transfer.hpp"

#include <algorithm>
#include <cmath>
#include <set>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <Eigen/Dense>

namespace maquette::camera {
namespace {

constexpr double kRounding = 1.0 / 12.0;  ///< DN^2 of a uniform distribution over one number
constexpr double kLeastVariance = 0.24;  ///< DN^2: below, rounding hides the noise (EMVA 1288, 7.2)
constexpr double kLinearShare = 0.7;     ///< of saturation: EMVA's range of the gain
constexpr double kClippedShare = 1e-3;   ///< of values at the converter's end
constexpr double kSameTime = 1e-3;       ///< relative: exposure times that are one

bool same_time(double a, double b) {
  return std::abs(a - b) <= kSameTime * std::max(std::abs(a), std::abs(b));
}

/// Index of the dark series of an exposure time; the one with the most frames.
std::optional<std::size_t> dark_of(const std::vector<LevelStatistics>& dark, double exposure_s) {
  std::optional<std::size_t> best;
  for (std::size_t i = 0; i < dark.size(); ++i)
    if (same_time(dark[i].exposure_s, exposure_s) && (!best || dark[i].frames > dark[*best].frames))
      best = i;
  return best;
}

Result<void> check_dark(const std::vector<LevelStatistics>& dark) {
  if (dark.empty())
    return fail(kCalibrationFrames,
                "no dark frames: at least two of each exposure time are needed, taken with the "
                "lens covered");
  for (const LevelStatistics& d : dark) {
    // A tenth of a normal distribution lies below 0 where its mean is 1.3 standard deviations
    // above.
    constexpr double kCutShare = 0.01;
    if (d.share_at_zero > kCutShare)
      return fail(kCalibrationFrames,
                  fmt::format("dark frames of {} s: {:.1f} % of their values are 0; what is cut at "
                              "black shows neither black level nor noise. Take frames before the "
                              "black level is taken off, or raise it",
                              d.exposure_s, 100.0 * d.share_at_zero));
    if (d.share_at_most > 0.5)
      return fail(kCalibrationFrames,
                  fmt::format("dark frames of {} s are at the converter's end: are they dark?",
                              d.exposure_s));
  }
  return {};
}

/// Straight line a + b x through values with uncertainties.
struct Line {
  Measured at_zero, slope;
};
Line line_through(const std::vector<double>& x, const std::vector<Measured>& y) {
  const auto n = static_cast<Eigen::Index>(x.size());
  Eigen::MatrixXd a(n, 2);
  Eigen::VectorXd b(n);
  for (Eigen::Index i = 0; i < n; ++i) {
    const auto& [value, u] = y[static_cast<std::size_t>(i)];
    const double w = 1.0 / std::max(u, 1e-12);
    a(i, 0) = w, a(i, 1) = w * x[static_cast<std::size_t>(i)], b(i) = w * value;
  }
  const Eigen::Matrix2d covariance = (a.transpose() * a).inverse();
  const Eigen::Vector2d p = covariance * (a.transpose() * b);
  const double chi2 = (a * p - b).squaredNorm();
  const double wider = n > 2 ? std::max(1.0, chi2 / static_cast<double>(n - 2)) : 1.0;
  return {{p(0), std::sqrt(wider * covariance(0, 0))}, {p(1), std::sqrt(wider * covariance(1, 1))}};
}

/// Root of a variance in DN^2 as electrons.
Measured electrons_of(const Measured& variance_dn2, const Measured& gain) {
  const double root = std::sqrt(std::max(0.0, variance_dn2.value));
  const double u_root = root > 0.0 ? 0.5 * variance_dn2.u / root : std::sqrt(variance_dn2.u);
  return {gain.value * root, std::hypot(gain.value * u_root, root * gain.u)};
}

/// Mean of variances (or means) of levels that measure the same, weighted by their degrees of
/// freedom: a variance that came out small has a small uncertainty, too, and would draw a mean that
/// is weighted by it.
Measured mean_of(const std::vector<Measured>& values, const std::vector<double>& weights) {
  double sum = 0.0, square = 0.0, weight = 0.0;
  for (std::size_t i = 0; i < values.size(); ++i) {
    sum += weights[i] * values[i].value;
    square += weights[i] * weights[i] * values[i].u * values[i].u;
    weight += weights[i];
  }
  return {sum / weight, std::sqrt(square) / weight};
}

/// Where noise is largest, and which levels lie beyond.
void find_saturation(SensorCalibration& c, const std::vector<LevelStatistics>& bright,
                     const std::vector<LevelStatistics>& dark, double largest_dn) {
  std::size_t peak = 0;
  for (std::size_t i = 0; i < bright.size(); ++i)
    if (bright[i].variance_dn2.value > bright[peak].variance_dn2.value) peak = i;
  const double at_peak = bright[peak].mean_dn.value;
  double above = INFINITY;
  for (const LevelStatistics& b : bright)
    // A variance that falls by more than its noise: the wells or the converter are full.
    if (b.mean_dn.value > at_peak &&
        b.variance_dn2.value + 5.0 * b.variance_dn2.u <
            bright[peak].variance_dn2.value - 5.0 * bright[peak].variance_dn2.u)
      above = std::min(above, b.mean_dn.value);
  if (std::isfinite(above)) {
    // The truth lies between the highest level below and the first beyond.
    c.saturation_dn = {at_peak, (above - at_peak) / std::sqrt(12.0)};
  } else {
    c.notes.push_back(fmt::format(
        "no level saturates (highest mean {:.1f} of {:.0f} DN): saturation and full well are "
        "unknown",
        at_peak, largest_dn));
  }
  const double limit =
      c.saturation_dn.known() ? at_peak : std::max(at_peak, kLinearShare * largest_dn);
  for (std::size_t i = 0; i < bright.size(); ++i) {
    TransferPoint& p = c.points[i];
    const double black = dark[*dark_of(dark, bright[i].exposure_s)].mean_dn.value;
    const double share = c.saturation_dn.known() ? kLinearShare : 1.0;
    p.saturated = bright[i].mean_dn.value > limit || bright[i].share_at_most > kClippedShare;
    p.used = !p.saturated && p.signal_dn > 0.0 && p.signal_dn <= share * (limit - black) + 1e-9;
  }
}

/// K and the dark variances together. @return K
Measured fit_gain(SensorCalibration& c, const std::vector<LevelStatistics>& bright,
                  const std::vector<LevelStatistics>& dark) {
  std::vector<std::size_t> used_bright;
  std::set<std::size_t> used_dark;
  for (std::size_t i = 0; i < bright.size(); ++i)
    if (c.points[i].used) {
      used_bright.push_back(i);
      used_dark.insert(*dark_of(dark, bright[i].exposure_s));
    }
  const std::vector<std::size_t> darks(used_dark.begin(), used_dark.end());
  const auto n = static_cast<Eigen::Index>(used_bright.size() + darks.size());
  const auto unknown = static_cast<Eigen::Index>(1 + darks.size());
  double k = 0.0;
  Eigen::MatrixXd covariance;
  double chi2 = 0.0;
  for (int round = 0; round < 3; ++round) {  // the signal's own noise counts K^2 times
    Eigen::MatrixXd a = Eigen::MatrixXd::Zero(n, unknown);
    Eigen::VectorXd b = Eigen::VectorXd::Zero(n);
    Eigen::Index row = 0;
    for (const std::size_t i : used_bright) {
      const LevelStatistics& l = bright[i];
      const std::size_t d = *dark_of(dark, l.exposure_s);
      const auto column = 1 + (std::find(darks.begin(), darks.end(), d) - darks.begin());
      const double u_signal = std::hypot(l.mean_dn.u, dark[d].mean_dn.u);
      const double w = 1.0 / std::hypot(l.variance_dn2.u, k * u_signal);
      a(row, 0) = w * c.points[i].signal_dn, a(row, column) = w, b(row) = w * l.variance_dn2.value;
      ++row;
    }
    for (std::size_t j = 0; j < darks.size(); ++j, ++row) {
      const Measured& v = dark[darks[j]].variance_dn2;
      a(row, static_cast<Eigen::Index>(1 + j)) = 1.0 / v.u, b(row) = v.value / v.u;
    }
    covariance = (a.transpose() * a).inverse();
    const Eigen::VectorXd p = covariance * (a.transpose() * b);
    chi2 = (a * p - b).squaredNorm();
    k = p(0);
  }
  const double dof = static_cast<double>(n - unknown);
  c.chi2_per_dof = dof > 0.0 ? chi2 / dof : 0.0;
  return {k, std::sqrt(std::max(1.0, c.chi2_per_dof) * covariance(0, 0))};
}

/// Black level, dark current and read noise: what dark frames show.
void fit_dark(SensorCalibration& c, const std::vector<LevelStatistics>& dark) {
  const Measured gain = c.gain_e_per_dn;
  std::vector<double> times;
  std::vector<double> freedom;
  std::vector<Measured> means;
  std::set<double> distinct;
  double shortest = INFINITY;
  for (const LevelStatistics& d : dark) {
    times.push_back(d.exposure_s), means.push_back(d.mean_dn);
    freedom.push_back(d.frames - 1.0);
    if (std::none_of(distinct.begin(), distinct.end(),
                     [&](double t) { return same_time(t, d.exposure_s); }))
      distinct.insert(d.exposure_s);
    shortest = std::min(shortest, d.exposure_s);
  }
  Measured slope{0.0, 0.0};
  if (distinct.size() >= 2) {
    const Line line = line_through(times, means);
    c.black_level_dn = line.at_zero, slope = line.slope;
    c.dark_current_e_s = {gain.value * slope.value,
                          std::hypot(gain.value * slope.u, slope.value * gain.u)};
    if (distinct.size() == 2)
      c.notes.emplace_back(
          "dark current from two exposure times: nothing shows whether it is steady");
  } else {
    c.black_level_dn = mean_of(means, freedom);
    c.notes.emplace_back(
        "dark frames have one exposure time: dark current is unknown, and part of the black level");
  }
  std::vector<Measured> pixel, rows, total;
  std::vector<double> freedom_of_total;
  for (const LevelStatistics& d : dark) {
    // Dark charge of slope t DN has the variance of a Poisson process: K times that.
    const double charge = std::max(0.0, slope.value) * d.exposure_s / gain.value;
    const double u_charge = slope.u * d.exposure_s / gain.value;
    pixel.push_back({d.variance_dn2.value - d.row_variance_dn2.value - kRounding - charge,
                     std::hypot(d.variance_dn2.u, u_charge)});
    rows.push_back(d.row_variance_dn2);
    if (!same_time(d.exposure_s, shortest)) continue;
    total.push_back({d.variance_dn2.value - kRounding, d.variance_dn2.u});
    freedom_of_total.push_back(d.frames - 1.0);
  }
  const Measured whole = mean_of(total, freedom_of_total);
  c.temporal_dark_noise_e = electrons_of(whole, gain);
  c.read_noise_e = electrons_of(mean_of(pixel, freedom), gain);
  c.row_noise_e = electrons_of(mean_of(rows, freedom), gain);
  if (whole.value + kRounding < kLeastVariance)
    c.notes.push_back(fmt::format(
        "the dark frames' variance is {:.3f} DN^2: rounding hides their noise, which is below "
        "{:.3g} e",
        whole.value + kRounding, 0.4 * gain.value));
}

void fit_well(SensorCalibration& c, const std::vector<LevelStatistics>& bright, double largest_dn) {
  if (!c.saturation_dn.known()) return;
  const auto electrons = [&](const Measured& level) {
    const double signal = level.value - c.black_level_dn.value;
    const double u = std::hypot(level.u, c.black_level_dn.u);
    return Measured{c.gain_e_per_dn.value * signal,
                    std::hypot(c.gain_e_per_dn.value * u, signal * c.gain_e_per_dn.u)};
  };
  c.saturation_e = electrons(c.saturation_dn);
  const LevelStatistics& top = *std::max_element(
      bright.begin(), bright.end(),
      [](const auto& a, const auto& b) { return a.mean_dn.value < b.mean_dn.value; });
  const double light = (top.mean_dn.value - c.black_level_dn.value) / c.gain_e_per_dn.value;
  constexpr double kFew = 0.5;
  if (top.share_at_most > kFew) {
    c.notes.push_back(
        fmt::format("the converter ends before the well is full: the well holds at least {:.0f} e",
                    electrons({largest_dn, 0.0}).value));
  } else if (top.variance_dn2.value < 0.1 * light) {
    // Noise of light is gone: every pixel is full.
    c.full_well_e = electrons(top.mean_dn);
  } else {
    c.notes.emplace_back(
        "no level is bright enough to fill all wells: the full well is unknown; EMVA's saturation "
        "capacity lies below it");
  }
}

}  // namespace

Result<SensorCalibration> photon_transfer(const std::vector<LevelStatistics>& bright,
                                          const std::vector<LevelStatistics>& dark,
                                          double largest_dn) {
  MAQUETTE_TRY_VOID(check_dark(dark));
  if (bright.empty())
    return fail(kCalibrationFrames,
                "no bright frames: at least two of each of three levels of light are needed");
  SensorCalibration c;
  for (const LevelStatistics& b : bright) {
    const auto d = dark_of(dark, b.exposure_s);
    if (!d) {
      std::vector<double> times;
      for (const LevelStatistics& l : dark) times.push_back(l.exposure_s);
      return fail(kCalibrationFrames,
                  fmt::format("bright frames of {} s: there are no dark frames of that exposure "
                              "time, only of {} s; take two with the lens covered",
                              b.exposure_s, fmt::join(times, ", ")));
    }
    TransferPoint& p = c.points.emplace_back();
    p.exposure_s = b.exposure_s, p.plane = b.plane;
    p.signal_dn = b.mean_dn.value - dark[*d].mean_dn.value;
    p.variance_dn2 = {b.variance_dn2.value - dark[*d].variance_dn2.value,
                      std::hypot(b.variance_dn2.u, dark[*d].variance_dn2.u)};
  }
  find_saturation(c, bright, dark, largest_dn);
  std::vector<double> levels;
  for (const TransferPoint& p : c.points)
    if (p.used) levels.push_back(p.signal_dn);
  constexpr std::size_t kFewest = 3;
  if (levels.size() < kFewest)
    return fail(kCalibrationFrames,
                fmt::format("{} of {} bright levels lie between the dark and 70 % of saturation; "
                            "at least {} are needed: take frames with less light",
                            levels.size(), bright.size(), kFewest));
  const Measured k = fit_gain(c, bright, dark);
  if (!(k.value > 3.0 * k.u))
    return fail(kCalibrationFrames,
                fmt::format("the frames' variance does not rise with light ({:.3g} +- {:.2g} DN^2 "
                            "a DN): are these raw frames in numbers of the converter, of an even "
                            "and steady light?",
                            k.value, k.u));
  c.gain_e_per_dn = {1.0 / k.value, k.u / (k.value * k.value)};
  constexpr double kPoorLine = 10.0;
  if (c.chi2_per_dof > kPoorLine)
    c.notes.push_back(fmt::format(
        "variance against signal is no straight line (chi^2 {:.1f} a degree of freedom): "
        "uncertainties are widened; look for flicker, stray light or a response that is not linear",
        c.chi2_per_dof));
  fit_dark(c, dark);
  fit_well(c, bright, largest_dn);
  return c;
}

}  // namespace maquette::camera

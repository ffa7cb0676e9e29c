// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/poses.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <Eigen/Dense>
#include <boost/math/distributions/fisher_f.hpp>
#include <boost/math/distributions/students_t.hpp>

#include "core/chi_squared.hpp"
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {
namespace {

constexpr double kLeastPattern_mm = 0.03;  // what careful registration leaves is below this
constexpr double kLeastPose_mm = 0.002;    // no pose is believed to be better
constexpr double kNoPose_mm = 1e3;         // nothing is known of it
/// Components that the data say less well (the height of marks probed in plan) are no evidence:
/// neither of a pattern, nor of how well the others were registered.
constexpr double kKnown_mm = kLeastPattern_mm;
// A turn that all set-ups share, in standard errors of what the fit knows and of what they differ
// by: one of two independent ones is so by chance in 3 % of all cases.
constexpr double kSharedOfKnown = 5.0, kSharedOfSpread = 40.0;

/// Two-sided tail of Student's t.
double student_tail(double t, double freedom) {
  return 2.0 * boost::math::cdf(boost::math::complement(boost::math::students_t(freedom), t));
}

struct Pattern {
  std::string effect, parameter;
  Eigen::VectorXd along;  // six components a set-up
};

/// Size of a pattern in the poses by generalised least squares, beside shifts that are free.
struct Size {
  double value = 0.0, sigma = INFINITY, misfit = INFINITY;
};
Size size_of(const Eigen::VectorXd& pose, const Eigen::MatrixXd& weight,
             const Eigen::MatrixXd& free, const Eigen::VectorXd& along) {
  Eigen::MatrixXd x(pose.size(), free.cols() + 1);
  x << free, along;
  const Eigen::MatrixXd a = x.transpose() * weight * x;
  const Eigen::FullPivLU<Eigen::MatrixXd> lu(a);
  if (!lu.isInvertible()) return {};
  const Eigen::VectorXd b = lu.solve(x.transpose() * weight * pose);
  const Eigen::VectorXd rest = pose - x * b;
  const Eigen::Index last = free.cols();
  return {b(last), std::sqrt(std::fmax(0.0, lu.inverse()(last, last))), rest.dot(weight * rest)};
}

/// @param known  covariance of the poses' components, mm^2
bool is_known(const Eigen::MatrixXd& known, Eigen::Index component) {
  return known(component, component) < kKnown_mm * kKnown_mm;
}

/// Do all set-ups lean the same way? Registrations do not agree in that: the part leans.
/// @param pose  six components a set-up @param known  their covariance
bool share_a_turn(const Eigen::VectorXd& pose, const Eigen::MatrixXd& known) {
  for (const Eigen::Index k : {3, 4}) {  // about x and y
    std::vector<Eigen::Index> at;
    for (Eigen::Index i = k; i < pose.size(); i += 6)
      if (is_known(known, i)) at.push_back(i);
    if (at.size() < 2) continue;
    double mean = 0.0, variance = 0.0, spread = 0.0;
    const auto count = static_cast<double>(at.size());
    for (const Eigen::Index i : at) {
      mean += pose(i) / count;
      for (const Eigen::Index j : at) variance += known(i, j) / count / count;
    }
    for (const Eigen::Index i : at) spread += std::pow(pose(i) - mean, 2);
    const double error = std::sqrt(spread / (count * (count - 1.0)));
    if (std::abs(mean) > kSharedOfKnown * std::sqrt(std::fmax(0.0, variance)) &&
        std::abs(mean) > kSharedOfSpread * error)
      return true;
  }
  return false;
}

/// A pattern in the poses of some set-ups.
struct Found {
  std::size_t pattern = 0;
  Size size;
  double p = 1.0, shift_error_mm = 0.0;
  Eigen::MatrixXd weight;
};

/// Components of the poses that are looked at together, and what of them is known.
struct Part {
  std::vector<Eigen::Index> kept;
  std::size_t set_ups = 0;
  Eigen::VectorXd pose, is_turn;
  Eigen::MatrixXd known, free;
  std::vector<Pattern> patterns;

  [[nodiscard]] Eigen::MatrixXd with_errors(double shift_mm, double turn_mm) const {
    Eigen::MatrixXd c = known;
    c.diagonal() +=
        (is_turn * turn_mm * turn_mm + (1.0 - is_turn.array()).matrix() * shift_mm * shift_mm);
    return c;
  }
};

/// The error, mm, that makes misfit(error) what is expected.
template <class Misfit>
double least_error(double expected, const Misfit& misfit) {
  double low = kLeastPose_mm, high = 100.0;
  for (int i = 0; i < 25; ++i) {  // to 3e-7
    const double middle = std::sqrt(low * high);
    (misfit(middle) > expected ? low : high) = middle;
  }
  return high;
}

/// Of set-ups whose height is known, for both patterns are mostly that. Others (marks probed in
/// plan) say nothing of them, and were put where they are in another way.
/// @param wanted  the set-ups to look at
template <class Wanted>
Part part_of(const Eigen::VectorXd& pose, const Eigen::MatrixXd& known, const Eigen::MatrixXd& free,
             std::vector<Pattern> patterns, const Wanted& wanted) {
  Part part;
  for (Eigen::Index s = 0; s < pose.size(); s += 6) {
    if (!wanted(static_cast<std::size_t>(s / 6)) || !is_known(known, s + 2)) continue;
    ++part.set_ups;
    for (Eigen::Index i = s; i < s + 6; ++i)
      if (is_known(known, i)) part.kept.push_back(i);
  }
  part.pose = pose(part.kept);
  part.known = known(part.kept, part.kept);
  part.free = free(part.kept, Eigen::all);
  part.is_turn.resize(part.pose.size());
  for (std::size_t i = 0; i < part.kept.size(); ++i)
    part.is_turn(static_cast<Eigen::Index>(i)) = part.kept[i] % 6 < 3 ? 0.0 : 1.0;
  for (Pattern& p : patterns) p.along = Eigen::VectorXd(p.along(part.kept));
  part.patterns = std::move(patterns);
  return part;
}

/// The poses' own error is what makes the rest as large as it is: that of turns what the turns are,
/// for no pattern turns a scan, that of shifts what they are beside the pattern. Surest first.
std::vector<Found> patterns_in(const Part& part) {
  const double turns = part.is_turn.sum(), freedom = static_cast<double>(part.pose.size()) - turns -
                                                     1.0 - static_cast<double>(part.free.cols());
  const auto misfit_of_turns = [&](double error) {
    // Of turns alone: the inverse of a block is that of all where nothing else is known.
    const Eigen::MatrixXd w = part.with_errors(kNoPose_mm, error).inverse();
    return part.pose.cwiseProduct(part.is_turn).dot(w * part.pose.cwiseProduct(part.is_turn));
  };
  const double turn_error = turns > 0.0 ? least_error(turns, misfit_of_turns) : kLeastPose_mm;
  std::vector<Found> found;
  for (std::size_t k = 0; k < part.patterns.size() && freedom > 0.0; ++k) {
    const auto at = [&](double error) {
      return Eigen::MatrixXd(part.with_errors(error, turn_error).inverse());
    };
    const double error = least_error(freedom + turns, [&](double e) {
      return size_of(part.pose, at(e), part.free, part.patterns[k].along).misfit;
    });
    const Eigen::MatrixXd weight = at(error);
    const Size s = size_of(part.pose, weight, part.free, part.patterns[k].along);
    if (std::isfinite(s.sigma))
      found.push_back({k, s, student_tail(std::abs(s.value) / s.sigma, freedom), error, weight});
  }
  std::sort(found.begin(), found.end(), [](const Found& a, const Found& b) { return a.p < b.p; });
  return found;
}

}  // namespace

bool shift_unknown(const std::vector<Cause>& causes, char axis) {
  const auto shifts = [&](const std::string& effect) {
    return find_effect(effect)->unknown_shift.find(axis) != std::string::npos;
  };
  return std::any_of(causes.begin(), causes.end(), [&](const Cause& c) {
    return shifts(c.effect) || std::any_of(c.equivalent.begin(), c.equivalent.end(), shifts);
  });
}

Vec3 pose_error(Vec3 p, const PoseEstimate& pose, const SetUp& set_up) {
  const RigidTransform& start = set_up.model_from_file;
  const Vec3 c = set_up.centre_mm;
  const Vec3 shift = pose.shift_mm + (c - start.inverse().point(c));
  const Vec3 turn =
      1e-6 * pose.turn_urad + 2.0 * Vec3{start.rotation.x, start.rotation.y, start.rotation.z};
  return shift + cross(turn, p - c);
}

void add_pose_causes(const Measurements& m, const Bank& bank, const std::vector<Member>& members,
                     const std::vector<Candidate>& candidates, const Fit& fit, Diagnosis& d) {
  const std::size_t n = d.poses.size();
  const double half = m.scene.half_mm();
  const auto size = static_cast<Eigen::Index>(6 * n);
  Eigen::VectorXd pose(size);
  for (std::size_t s = 0; s < n; ++s) {
    const PoseEstimate& p = d.poses[s];
    pose.segment(static_cast<Eigen::Index>(6 * s), 6) << p.shift_mm.x, p.shift_mm.y, p.shift_mm.z,
        1e-6 * half * p.turn_urad.x, 1e-6 * half * p.turn_urad.y, 1e-6 * half * p.turn_urad.z;
  }
  const auto shift = [&](const auto& of_set_up) {
    Eigen::VectorXd v = Eigen::VectorXd::Zero(size);
    for (std::size_t s = 0; s < n; ++s) {
      const Vec3 u = of_set_up(s);
      v.segment(static_cast<Eigen::Index>(6 * s), 3) << u.x, u.y, u.z;
    }
    return v;
  };
  const Vec3 axes[3] = {{1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  Eigen::MatrixXd free(size, 0);
  for (int axis = 0; axis < 3; ++axis)
    if (shift_unknown(d.causes, kAxisName[axis][0])) {
      free.conservativeResize(Eigen::NoChange, free.cols() + 1);
      free.rightCols(1) = shift([&](std::size_t) { return axes[axis]; });
    }
  const bool stations =
      std::all_of(m.scene.has_station.begin(), m.scene.has_station.end(), [](bool b) { return b; });
  const auto along_beams = [&] {
    return shift(
        [&](std::size_t s) { return normalized(m.set_ups[s].centre_mm - m.scene.stations[s]); });
  };
  std::vector<Pattern> patterns{
      {"tool.length_offset", "offset_mm", shift([&](std::size_t) { return axes[2]; })}};
  if (stations && shift_unknown(d.causes, 'r')) {
    free.conservativeResize(Eigen::NoChange, free.cols() + 1);
    free.rightCols(1) = along_beams();
  } else if (stations) {
    patterns.push_back({"scanner.range_bias", "bias_mm", along_beams()});
  }
  const Eigen::MatrixXd all_known = fit.covariance.topLeftCorner(size, size);
  // All together; and points that were probed by themselves, which are put in place in another way
  // than scans are, and better.
  Part part = part_of(pose, all_known, free, patterns, [](std::size_t) { return true; });
  auto found = patterns_in(part);
  const auto scans =
      std::count_if(m.set_ups.begin(), m.set_ups.end(), [](const SetUp& s) { return s.scan; });
  if (scans > 0 && scans < static_cast<std::ptrdiff_t>(n)) {
    const auto probed = [&](std::size_t s) { return !m.set_ups[s].scan; };
    Part alone = part_of(pose, all_known, free, patterns, probed);
    auto in_it = patterns_in(alone);
    if (!in_it.empty() &&
        (found.empty() || in_it[0].p < std::fmax(found[0].p, 0.5 * kClaimLevel))) {
      part = std::move(alone);
      found = std::move(in_it);
    }
    for (Found& f : found) f.p *= 2.0;
  }
  const auto named = [&](const std::string& effect) {
    const Effect* e = find_effect(effect);
    Cause c;
    c.effect = effect;
    c.law = kPoseLaw;
    c.separate_by = e->separate_by;
    return c;
  };
  if (!found.empty() && std::abs(found[0].size.value) > kLeastPattern_mm &&
      found[0].p < kClaimLevel) {
    Found& best = found[0];
    // What makes the part lean has to make the pattern, too: turns are no longer thought wrong.
    const bool leans = share_a_turn(pose, all_known);
    if (leans) {
      best.weight = part.with_errors(best.shift_error_mm, kLeastPose_mm).inverse();
      best.size = size_of(part.pose, best.weight, part.free, part.patterns[best.pattern].along);
    }
    Cause c = named(patterns[best.pattern].effect);
    c.parameters = {{patterns[best.pattern].parameter, best.size.value, best.size.sigma}};
    c.p_value = best.p;
    for (std::size_t k = 1; k < found.size(); ++k)
      if (size_of(part.pose, best.weight, part.free, part.patterns[found[k].pattern].along).misfit <
          best.size.misfit + kEquivalent)
        c.equivalent.push_back(patterns[found[k].pattern].effect);
    // What registration takes of causes, and what the residuals say of them: poses and residuals
    // together, by the best of a candidate's forms.
    const auto model = columns_of(bank, members);
    const auto together = [&](const Candidate& candidate, Estimate& estimate) {
      double misfit = INFINITY;
      for (const Form& form : candidate.forms) {
        if (form.columns.size() != 1) continue;
        const Beside b = beside(bank, model, fit, bank.index.at(form.columns[0].key));
        // Both together: (pose - c absorbed)' W (pose - c absorbed) + information (c - estimate)^2.
        const Eigen::VectorXd along = b.absorbed(part.kept);
        const double curvature = along.dot(best.weight * along) + b.information;
        const double value =
            (along.dot(best.weight * part.pose) + b.information * b.estimate) / curvature;
        if (form.sign != 0 && value * form.sign < 0.0) continue;
        const Eigen::VectorXd rest = part.pose - value * along;
        const double of_poses = rest.dot(best.weight * rest);
        // Residuals may ask for something else, of which poses know nothing: no answer to these.
        if (of_poses > best.size.misfit + kEquivalent) continue;
        const double here =
            of_poses +
            b.information * ((value - b.estimate) * (value - b.estimate) - b.estimate * b.estimate);
        if (here >= misfit) continue;
        misfit = here;
        const Parameter& p = form.columns[0].parameter;
        estimate = {p.name, value * p.per_column, std::abs(p.per_column) / std::sqrt(curvature)};
      }
      return misfit;
    };
    // Poses do not take all of a range bias: others compete with what residuals show of it, too.
    double own = best.size.misfit;
    for (const Candidate& candidate : candidates)
      if (Estimate estimate; candidate.effect->name == c.effect)
        own = std::fmin(own, together(candidate, estimate));
    double least = own - kEquivalent;
    std::string instead;
    for (const Candidate& candidate : candidates) {
      if (candidate.effect->name == c.effect || candidate.effect->name == "scanner.range_bias" ||
          has(members, candidate.effect))
        continue;
      Estimate estimate;
      const double misfit = together(candidate, estimate);
      if (misfit < own + kEquivalent) c.equivalent.push_back(candidate.effect->name);
      if (misfit < least) {
        least = misfit;
        instead = candidate.effect->name;
        c.parameters = {estimate};
      }
    }
    if (!instead.empty()) {
      const Cause other = named(instead);
      std::erase(c.equivalent, instead);
      c.effect = instead;
      c.separate_by = other.separate_by;
      if (own - least < 4.0 * kEquivalent) c.equivalent.push_back(patterns[best.pattern].effect);
    }
    if (part.set_ups == 1) c.equivalent.push_back("scanner.registration");
    if (leans && instead.empty()) {  // a height says nothing of why the part leans
      d.notes.push_back(
          fmt::format("all measurements stand off alike by {:.3f} mm ({}) and lean the same way: "
                      "what does both is not known (wear or growth along the program would)",
                      c.parameters.empty() ? best.size.value : c.parameters[0].value, c.effect));
      return;
    }
    d.causes.push_back(std::move(c));
    return;
  }
  // One pose that stands apart from all others of its kind: F of mean squares, of shifts, of turns,
  // and of both (Fisher 1932: twice the logarithms add up to chi-squared), for the worst of n.
  if (n < 2) return;
  std::size_t worst = 0;
  double p_value = 1.0, size_mm = 0.0;
  for (std::size_t s = 0; s < n; ++s) {
    double largest_mm = 0.0, logarithms = 0.0, least = 1.0;
    for (const Eigen::Index first : {0, 3}) {
      double own = 0.0, others = 0.0;
      int of_own = 0, of_others = 0;
      for (Eigen::Index i = 0; i < size; ++i) {
        if (i % 6 / 3 != first / 3 || !is_known(all_known, i)) continue;
        if (m.set_ups[static_cast<std::size_t>(i / 6)].scan != m.set_ups[s].scan) continue;
        const bool its = i / 6 == static_cast<Eigen::Index>(s);
        (its ? own : others) += pose(i) * pose(i);
        ++(its ? of_own : of_others);
      }
      if (of_own == 0 || of_others == 0) continue;
      own /= of_own;
      others = std::fmax(kLeastPose_mm * kLeastPose_mm, others / of_others);
      const boost::math::fisher_f law(of_own, of_others);
      const double p = boost::math::cdf(boost::math::complement(law, own / others));
      least = std::fmin(least, p);
      logarithms -= 2.0 * std::log(std::fmax(1e-300, p));
      largest_mm = std::fmax(largest_mm, std::sqrt(own));
    }
    const double p =
        3.0 * static_cast<double>(n) * std::fmin(least, chi_squared_tail(logarithms, 4));
    if (p < p_value) {
      p_value = p;
      worst = s;
      size_mm = largest_mm;
    }
  }
  if (p_value < kClaimLevel && size_mm > 2.0 * kLeastPattern_mm) {
    Cause c = named("scanner.registration");
    const PoseEstimate& p = d.poses[worst];
    c.parameters = {{"shift_x_mm", p.shift_mm.x, p.shift_sigma_mm.x},
                    {"shift_y_mm", p.shift_mm.y, p.shift_sigma_mm.y},
                    {"shift_z_mm", p.shift_mm.z, p.shift_sigma_mm.z},
                    {"turn_x_urad", p.turn_urad.x, p.turn_sigma_urad.x},
                    {"turn_y_urad", p.turn_urad.y, p.turn_sigma_urad.y},
                    {"turn_z_urad", p.turn_urad.z, p.turn_sigma_urad.z}};
    c.fixed = {{"scan", static_cast<double>(worst + 1)}};
    c.p_value = p_value;
    d.causes.push_back(std::move(c));
  }
}

}  // namespace maquette::diagnosis::detail

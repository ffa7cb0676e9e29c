// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/diagnose.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <memory>
#include <utility>

#include <fmt/format.h>

#include "diagnosis/detail/choosing.hpp"
#include "diagnosis/detail/forms.hpp"
#include "diagnosis/detail/poses.hpp"
#include "diagnosis/detail/show.hpp"
#include "diagnosis/detail/sizes.hpp"
#include "diagnosis/detail/squares.hpp"
#include "diagnosis/detail/standing.hpp"
#include "diagnosis/detail/steps.hpp"
#include "diagnosis/detail/stones.hpp"
#include "diagnosis/detail/thinned.hpp"
#include "diagnosis/detail/waves.hpp"
#include "diagnosis/detail/with_slope.hpp"

namespace maquette::diagnosis {
namespace {

using detail::Bank;
using detail::Fit;
using detail::kAll;
using detail::kChoose;
using detail::kConfirm;
using detail::kReport;
using detail::Layout;
using detail::Members;

/// Of a group of details that there are enough of to tell.
std::optional<double> variance_of(const Bank& bank, const Fit& f, std::size_t group) {
  constexpr double kEnough = 10.0;
  double count = 0.0;
  for (const auto& s : bank.sets) count += s.count[group];
  return count > kEnough ? std::optional(f.variance[group]) : std::nullopt;
}

/// Within the smallest squares; where no two points share one, of the finest details that there
/// are: a group without details has no variance, and its 1 mm2 is not the scanner's.
double point_variance(const Bank& bank, const Fit& f) {
  for (std::size_t group = detail::kPointGroup + 1; group-- > 0;)
    if (const auto v = variance_of(bank, f, group)) return *v;
  return f.variance[detail::kPointGroup];
}

FittedNoise noise_of(const Bank& bank, const Fit& f, const Layout& layout) {
  FittedNoise n;
  n.cell_mm = layout.cell_mm;
  n.point_mm2 = point_variance(bank, f);
  bool several = false;
  for (const auto& s : bank.sets) several |= !s.top[1].weight.empty();
  // Where points are few there are no details of the finest squares: as those of points.
  const auto variance = [&](std::size_t group, double otherwise) {
    return variance_of(bank, f, group).value_or(otherwise);
  };
  double common = n.point_mm2, own = n.point_mm2;
  for (std::size_t k = n.common_mm2.size(); k-- > 0;) {
    n.common_mm2[k] = common = variance(k, common);
    n.own_mm2[k] = own = several ? variance(detail::kScales + k, own) : n.point_mm2;
  }
  n.own.white_mm2 = n.point_mm2;
  for (std::size_t u = 0; u < (several ? detail::kTops : 1U); ++u) {
    double points = 0.0, means = 0.0;
    for (const auto& s : bank.sets) {
      points += s.top[u].points();
      means += static_cast<double>(s.top[u].weight.size());
    }
    const detail::Theta& theta = bank.theta[static_cast<std::size_t>(f.theta[u])];
    // What a coat adds to the means of cells is hardly the same in the next.
    const double coat = theta.rough * theta.ratio;
    (u == 0 ? n.common : n.own) = {
        f.top_variance[u] * points / std::fmax(1.0, means) * (1.0 + coat),
        f.top_variance[u] * theta.smooth_ratio(), std::fmax(1e-3, theta.length_mm), theta.gauss};
  }
  return n;
}

/// Waves and steps along the program are looked for in what the nuisances leave; the scene's forms
/// are made of them.
void look_along_the_program(const std::vector<Observation>& observations, const Bank& plain,
                            const Layout& layout, Scene& scene) {
  const Fit f = detail::fit(plain, detail::columns_of(plain, {}), {kChoose});
  const auto r = detail::residuals_of(observations, {}, plain, f);
  detail::find_waves(observations, r, layout, scene);
  for (int axis = 0; axis < 3; ++axis)
    scene.steps[static_cast<std::size_t>(axis)] =
        detail::sharpest_steps(observations, r, layout, axis);
}

/// Before any cause: rms on the report blocks, the nuisances fitted to them.
void report_before(const Bank& bank, Diagnosis& d) {
  const auto empty = detail::columns_of(bank, {});
  const Fit f = detail::fit(bank, empty, {kReport});
  double n = 0.0;
  const double squares = detail::squares(bank, empty, f.coefficients, {kReport}, &n);
  d.rms_before = std::sqrt(squares / std::fmax(1.0, n));
  d.n_report = static_cast<std::size_t>(n);
}

/// Gain on blocks that had no part in choosing or confirming; causes held as fitted elsewhere.
void report_after(const Bank& bank, const Members& members, Diagnosis& d) {
  const auto model = detail::columns_of(bank, members);
  const Fit trained = detail::fit(bank, model, {kChoose, kConfirm});
  d.rms_after = std::sqrt(detail::squares(bank, model, trained.coefficients, {kReport}, nullptr) /
                          std::fmax(1.0, static_cast<double>(d.n_report)));
  const Fit free_fit = detail::fit(bank, model, {kReport});
  d.rms_noise = std::sqrt(point_variance(bank, free_fit));
}

/// What is known of the poses, with what unevenness of the part makes of all of them alike.
Fit with_uneven_part(const Measurements& m, const Bank& bank, Fit f, double cell_mm) {
  const Eigen::Matrix3d plane = detail::plane_covariance(bank, f, cell_mm);
  const double half = m.scene.half_mm();
  // A part that rises along y is one turned about x.
  const std::array<std::pair<Eigen::Index, double>, 3> to{{{2, 1.0}, {4, -half}, {3, half}}};
  const auto n = static_cast<Eigen::Index>(m.set_ups.size());
  for (Eigen::Index s = 0; s < n; ++s)
    for (Eigen::Index t = 0; t < n; ++t)
      for (Eigen::Index i = 0; i < 3; ++i)
        for (Eigen::Index j = 0; j < 3; ++j) {
          const auto& [row, by] = to[static_cast<std::size_t>(i)];
          const auto& [col, with] = to[static_cast<std::size_t>(j)];
          f.covariance(6 * s + row, 6 * t + col) += by * with * plane(i, j);
        }
  return f;
}

std::vector<PoseEstimate> poses_of(const Measurements& m, const Fit& f) {
  std::vector<PoseEstimate> poses;
  for (std::size_t s = 0; s < m.set_ups.size(); ++s) {
    PoseEstimate p;
    p.set_up = m.set_ups[s].name;
    const auto at = static_cast<Eigen::Index>(6 * s);
    const double turn = 1e6 / m.scene.half_mm();
    // The file's points are off by what the model adds to them.
    const RigidTransform& start = m.set_ups[s].model_from_file;
    const Vec3 c = m.set_ups[s].centre_mm;
    const Vec3 moved = c - start.inverse().point(c);
    p.shift_mm =
        -1.0 * moved + Vec3{f.coefficients(at), f.coefficients(at + 1), f.coefficients(at + 2)};
    p.turn_urad = {2e6 * -start.rotation.x + turn * f.coefficients(at + 3),
                   2e6 * -start.rotation.y + turn * f.coefficients(at + 4),
                   2e6 * -start.rotation.z + turn * f.coefficients(at + 5)};
    const auto sigma = [&](int k) {
      return std::sqrt(std::fmax(0.0, f.covariance(at + k, at + k)));
    };
    p.shift_sigma_mm = {sigma(0), sigma(1), sigma(2)};
    p.turn_sigma_urad = {turn * sigma(3), turn * sigma(4), turn * sigma(5)};
    poses.push_back(std::move(p));
  }
  return poses;
}

/// The same causes at the moments that do best on these sets, cut anew; `bank` gets their columns.
/// Among sums of these causes alone: each moment that is tried is multiplied with all columns.
Members at_moments_of(const std::vector<int>& sets, const Members& members,
                      const detail::Search& search, Bank& bank, detail::Linearised& residuals,
                      const RunContext& run) {
  residuals.about(members);
  const Fit f = residuals.fit_of(members);
  residuals.about({});
  detail::Search own{search.observations, search.nuisances, search.layout, {}};
  for (const auto& c : search.candidates)
    if (detail::has(members, c.effect)) own.candidates.push_back(c);
  Bank sums = detail::bank_beside(own, bank, f, members, detail::all_columns(own.candidates), kAll);
  detail::Linearised left = residuals.in_other_sums(sums);
  Members moved = detail::polished(own, sums, members, left.settle(), sets);
  const auto score = [&](const Members& with) {
    left.about_alone(with);
    return detail::fit(sums, detail::columns_of(sums, with), sets).objective;
  };
  for (std::size_t k = 0; k < moved.size(); ++k) {
    if (!moved[k].form.move_moment) continue;
    left.about_alone(moved);
    const Fit now = left.fit_of(moved);
    if (detail::is_large_step(sums, moved, k, now))
      moved = detail::at_best_moments(moved, k, {}, own, sums, left, run, score);
  }
  left.about_alone({});  // the observations are those of `residuals`
  for (const detail::Member& m : moved)
    detail::add_columns(bank, search.observations, m.form.columns);
  return moved;
}

/// Moments that the choosing blocks do not tell apart (no block of theirs sees the rest of the
/// pass) are told by those that confirm: a row of points on the wrong side of a step outweighs the
/// step.
/// @return how many forms were looked at, for as many tests
double take_moments_of(detail::Search& search, Bank& bank, detail::Linearised& residuals,
                       Members& members, const std::vector<int>& sets, const RunContext& run) {
  constexpr double kNotTold = 2.0;    // in -2 log likelihood
  constexpr double kMoments = 200.0;  // 19 and twice 13 neighbours of a few, and up to 48 cut anew
  if (std::none_of(members.begin(), members.end(), detail::has_a_moment)) return 1.0;
  const double chosen = residuals.score(members);
  const Members both = at_moments_of(sets, members, search, bank, residuals, run);
  double looks = 1.0;
  for (std::size_t k = 0; k < members.size(); ++k) {
    if (!detail::has_a_moment(members[k]) || both[k].form.law == members[k].form.law) continue;
    Members instead = members;
    instead[k] = both[k];
    if (sets.size() < kAll.size() && !(residuals.score(instead) < chosen + kNotTold)) continue;
    members = std::move(instead);
    looks = kMoments;
  }
  residuals.about(members);
  return looks;
}

/// Causes that are chosen and hold on other blocks. Where none of the chosen holds, the choice was
/// of what took the place of a cause: the next best is looked for without them.
std::vector<detail::Confirmed> choose_and_confirm(detail::Search& search, Bank& bank,
                                                  detail::Linearised& residuals, Diagnosis& d,
                                                  const RunContext& run) {
  constexpr int kLooks = 3;
  // Up to five causes in up to five rounds are 15 tests a look: at kConfirmLevel they take three
  // quarters of a tenth of the family's level, and the 30 of two more looks share the rest.
  constexpr double kLaterLevel = detail::kConfirmLevel / 6.0;
  const auto all = search.candidates;
  std::vector<detail::Confirmed> confirmed;
  for (int look = 0; look < kLooks && confirmed.empty() && !run.stopped(); ++look) {
    std::vector<Ranked> ranking;
    residuals.about({});
    auto members = detail::choose_and_recut(search, bank, residuals, ranking, run);
    if (look == 0) d.ranking = std::move(ranking);
    if (members.empty() || run.stopped()) break;
    Members moved = members, sharp = members;
    const double looks = take_moments_of(search, bank, residuals, moved, {kChoose, kConfirm}, run);
    take_moments_of(search, bank, residuals, sharp, kAll, run);
    const double level = look == 0 ? detail::kConfirmLevel : kLaterLevel;
    const auto confirm_as = [&](const Members& with, double at) {
      std::pair<std::vector<detail::Confirmed>, std::vector<Rejected>> found;
      found.first = detail::confirm(bank, with, sharp, at, found.second, residuals.settle_alone());
      return found;
    };
    // At the moments that were chosen, or those of both sets at the price of all that were tried.
    auto found = confirm_as(members, looks == 1.0 ? level : 0.5 * level);
    if (looks > 1.0)
      if (auto as_moved = confirm_as(moved, 0.5 * level / looks);
          as_moved.first.size() >= found.first.size())
        found = std::move(as_moved);
    confirmed = std::move(found.first);
    d.rejected.insert(d.rejected.end(), found.second.begin(), found.second.end());
    std::erase_if(search.candidates,
                  [&](const detail::Candidate& c) { return detail::has(members, c.effect); });
  }
  search.candidates = all;
  return confirmed;
}

/// What remains unexplained, and beside it what stands, is said of all blocks: a step whose moment
/// lies in a pass that no block to choose or confirm by sees leaves the rest of that pass.
void take_moments_of_all(detail::Search& search, Bank& bank, detail::Linearised& residuals,
                         std::vector<detail::Confirmed>& confirmed, const RunContext& run) {
  Members members = detail::members_of(confirmed);
  take_moments_of(search, bank, residuals, members, kAll, run);
  for (std::size_t k = 0; k < members.size(); ++k) {
    if (members[k].form.law == confirmed[k].member.form.law) continue;
    confirmed[k].chosen = std::exchange(confirmed[k].member.form, members[k].form);
  }
}

/// Which causes there are is settled; when and at what length each acted is said by all blocks. On
/// those for choosing alone the moment of a step may be off by half a pass, and its size with it.
/// What is made of its own size is made anew of the one beside those causes.
/// @return whether a step is another now
bool sharpen(detail::Search& search, Bank& bank, detail::Linearised& residuals,
             std::vector<detail::Confirmed>& confirmed) {
  if (confirmed.empty()) return false;
  const bool of_a_size =
      std::any_of(confirmed.begin(), confirmed.end(), [](const detail::Confirmed& c) {
        const Form& form = c.member.form;
        return !form.move_moment && (form.of_size || form.at_size || form.columns[0].follows);
      });
  Members sharp = detail::members_of(confirmed);
  if (!of_a_size) {
    sharp = detail::polished(search, bank, std::move(sharp), residuals.settle(), kAll);
    // A border more was neither chosen nor confirmed.
    for (std::size_t k = 0; k < sharp.size(); ++k)
      if (confirmed[k].by_squares ||
          sharp[k].form.columns.size() > confirmed[k].member.form.columns.size())
        sharp[k] = confirmed[k].member;
  }
  sharp = detail::at_own_size(std::move(sharp), search, bank, residuals);
  bool another = false;
  for (std::size_t k = 0; k < sharp.size(); ++k) {
    const detail::Member was = std::exchange(confirmed[k].member, sharp[k]);
    another |= detail::has_a_moment(was) && was.form.columns[0].key != sharp[k].form.columns[0].key;
  }
  return another;
}

/// Steps in height of which one is where a tool, a program or a band begins are the bands', and so
/// are more than a drive has; drives lose steps anywhere.
void prefer_borders_of_the_program(const Scene& scene, std::vector<detail::Confirmed>& confirmed) {
  constexpr double kNear = 0.01;  // of the program's time
  const Effect* const lost = find_effect("machine.step_loss_z");
  const Effect* const bands = find_effect("process.band_step");
  for (detail::Confirmed& c : confirmed) {
    if ((c.member.effect != lost && c.member.effect != bands) || !detail::has_a_moment(c.member) ||
        c.member.form.law == detail::kBandsOfTheProgram)
      continue;
    const auto is_border = [&](const auto& moment) {
      const double at = moment.second / scene.duration_min;
      return std::any_of(scene.section_starts.begin(), scene.section_starts.end(),
                         [at](double start) { return std::abs(at - start) < kNear; });
    };
    const auto& moments = c.member.form.fixed;
    c.member.effect = moments.size() > detail::kMostLosses ||
                              std::any_of(moments.begin(), moments.end(), is_border)
                          ? bands
                          : lost;
  }
}

/// The named causes in the forms that were chosen without the report blocks.
Members before_sharpening(const std::vector<detail::Confirmed>& as_chosen, const Members& named) {
  Members members;
  for (const detail::Confirmed& c : as_chosen)
    if (detail::has(named, c.member.effect)) {
      members.push_back(c.member);
      // Of two moments one may have turned out to be none.
      if (c.chosen && c.chosen->columns.size() == c.member.form.columns.size())
        members.back().form = *c.chosen;
    }
  return members;
}

std::string verdict_of(const Diagnosis& d) {
  const bool more = d.remainder.found || (d.stones && !d.stones->unexplained.empty());
  if (d.causes.empty()) return more ? "unexplained" : "consistent";
  return more ? "partly_explained" : "explained";
}

/// Whether the best cause alone, to first order, gains so much on the choosing blocks that these
/// points tell.
bool is_told_by(Bank& bank, const std::vector<detail::Candidate>& candidates,
                const Layout& layout) {
  constexpr double kTold = 250.0;  // in -2 log likelihood
  const std::size_t all = std::exchange(bank.tried, detail::plain_thetas(layout.cell_mm).size());
  const auto model = detail::columns_of(bank, {});
  const detail::Weights as_given = std::exchange(
      bank.weight, detail::effective_weights(bank, model, detail::fit(bank, model, kAll)));
  const double without = detail::fit(bank, model, {kChoose}).objective;
  const detail::Screen beside = detail::screen(bank, {}, {kChoose});
  const bool told = std::ranges::any_of(candidates, [&](const detail::Candidate& c) {
    return without - detail::best_form(bank, {}, c, {kChoose}, true, beside).objective > kTold;
  });
  bank.tried = all;
  bank.weight = as_given;
  return told;
}

/// All that is needed to choose causes.
struct Prepared {
  Measurements m;
  Scene scene;
  Layout layout;
  std::vector<Column> nuisances;
  std::vector<std::string> untestable;
  std::vector<detail::Candidate> candidates;
  std::vector<Observation> few;  ///< of dense points that tell much, those that choose; else none
  Bank bank;                     ///< of the points that choose

  Prepared(Measurements measured, std::uint64_t seed)
      : m(std::move(measured)),
        scene(m.scene),
        layout(detail::lay_out(scene.box, seed, !scene.section_starts.empty())),
        nuisances(detail::nuisances_of(m)) {
    Bank plain = detail::sum_up(m.observations, nuisances, {}, layout);
    layout.smooth = detail::smooth_law(plain, layout);
    plain.tried = detail::plain_thetas(layout.cell_mm).size();
    if (scene.has_path) look_along_the_program(m.observations, plain, layout, scene);
    candidates = detail::candidates_of(scene, untestable);
    const auto columns = detail::all_columns(candidates);
    few = detail::thinned(m.observations, layout);
    if (!few.empty()) bank = detail::sum_up(few, nuisances, columns, layout);
    if (!few.empty() && is_told_by(bank, candidates, layout)) return;
    few.clear();
    bank = detail::sum_up(m.observations, nuisances, columns, layout);
  }
  Prepared(const Prepared&) = delete;
  Prepared& operator=(const Prepared&) = delete;

  /// Those that choose.
  [[nodiscard]] std::vector<Observation>& points() { return few.empty() ? m.observations : few; }
  [[nodiscard]] const std::vector<Observation>& points() const {
    return few.empty() ? m.observations : few;
  }
};

/// The best alone, to first order, of the causes that hang on places alone; none: none is worth its
/// price.
Members best_of_places(const Prepared& p) {
  const detail::Screen beside = detail::screen(p.bank, {}, {kChoose});
  double least = detail::fit(p.bank, detail::columns_of(p.bank, {}), {kChoose}).objective;
  Members best;
  for (const auto& c : p.candidates) {
    if (c.effect->needs == Needs::path) continue;
    const auto found = detail::best_form(p.bank, {}, c, {kChoose}, true, beside);
    if (!(found.objective < least)) continue;
    least = found.objective;
    best = {{c.effect, c.forms[found.form]}};
  }
  return best;
}

/// What the best of the causes that hang on the program gains beside others on the choosing blocks,
/// to first order, in -2 log likelihood.
double best_of_the_program(const Bank& bank, const std::vector<detail::Candidate>& candidates,
                           const Members& others) {
  const detail::Screen beside = detail::screen(bank, others, {kChoose});
  const double without = detail::fit(bank, detail::columns_of(bank, others), {kChoose}).objective;
  double most = 0.0;
  for (const auto& c : candidates)
    if (c.effect->needs == Needs::path && detail::may_join(others, c.effect))
      most = std::fmax(
          most, without - detail::best_form(bank, others, c, {kChoose}, true, beside).objective);
  return most;
}

/// Where the best of the causes that hang on places alone is the scanner's, scans may lie a
/// millimetre aside, as far as beams that read long have pushed them.
Result<void> settle_anew(std::unique_ptr<Prepared>& prepared, std::uint64_t seed,
                         const RunContext& run) {
  if (!prepared->m.settled_anew) return {};
  const Members best = best_of_places(*prepared);
  if (best.empty() || best[0].effect->needs != Needs::station) return {};
  RunContext quiet;  // progress is the whole diagnosis'
  quiet.stop = run.stop;
  MAQUETTE_TRY(Measurements anew, prepared->m.settled_anew(quiet));
  if (anew.beside_long_beams) prepared = std::make_unique<Prepared>(std::move(anew), seed);
  return {};
}

/// Whether causes that hang on the program fit far better were each place what the pass above it
/// made: alone, and beside the best of those that hang on places. A large cause of the latter is
/// imitated by the former at either contact, by one of them better, which says nothing of it.
bool is_cut_by_tips(const Prepared& ball) {
  // Where neither fits, or a drift that is alike for neighbouring passes, gains hardly differ.
  constexpr double kClearly = 30.0, kRatio = 1.35;
  const Members of_places = best_of_places(ball);

  Measurements m;
  m.scene = ball.m.scene;
  m.set_ups = ball.m.set_ups;
  const auto& points = ball.points();
  const auto chosen = detail::those_in(ball.bank, kChoose, points.size());
  for (std::size_t i = 0; i < chosen.size(); ++i)
    if (chosen[i] != 0) m.observations.push_back(points[i]);
  cut_by_tips(m);
  Scene scene = m.scene;
  Bank plain = detail::sum_up(m.observations, ball.nuisances, {}, ball.layout);
  plain.tried = ball.bank.tried;
  look_along_the_program(m.observations, plain, ball.layout, scene);
  std::vector<std::string> untestable;
  auto candidates = detail::candidates_of(scene, untestable);
  std::erase_if(candidates,
                [](const detail::Candidate& c) { return c.effect->needs != Needs::path; });
  auto columns = detail::all_columns(candidates);
  for (const detail::Member& member : of_places)
    columns.insert(columns.end(), member.form.columns.begin(), member.form.columns.end());
  const Bank tips = detail::sum_up(m.observations, ball.nuisances, columns, ball.layout);

  const auto is_far_better = [&](const Members& others) {
    return best_of_the_program(tips, candidates, others) >
           kClearly + kRatio * best_of_the_program(ball.bank, ball.candidates, others);
  };
  return is_far_better({}) && (of_places.empty() || is_far_better(of_places));
}

/// Sums of all points for causes whose names are settled, beside one form of every candidate, by
/// which it is told what details are worth.
Bank of_all_points(const Prepared& p, const std::vector<Members>& models) {
  std::vector<Column> columns;
  const auto add = [&](const Form& form) {
    columns.insert(columns.end(), form.columns.begin(), form.columns.end());
  };
  for (const Members& model : models)
    for (const detail::Member& m : model) add(m.form);
  for (const detail::Candidate& c : p.candidates)
    if (!c.forms.empty()) add(c.forms[0]);
  return detail::sum_up(p.m.observations, p.nuisances, columns, p.layout);
}

/// What few points were enough to choose and to name is sized and judged again by all, in which a
/// few odd places show that few of those that choose have seen.
/// @pre diagnosis.causes are the confirmed ones, in their order
void judge_by_all(const detail::Search& search, Bank& bank, detail::Linearised& residuals,
                  std::vector<detail::Confirmed>& confirmed, Members& doubtful, Diagnosis& d) {
  const double null_squares = residuals.left_by({});
  Members named = detail::members_of(confirmed);
  residuals.about(named);
  bank.weight =
      detail::effective_weights(bank, detail::columns_of(bank, named), residuals.fit_of(named));
  named = detail::at_own_size(std::move(named), search, bank, residuals);
  for (std::size_t k = 0; k < named.size(); ++k) {
    if (named[k].form.law != confirmed[k].member.form.law) {
      d.causes[k].law = named[k].form.law;
      d.causes[k].fixed = named[k].form.fixed;
    }
    confirmed[k].member = named[k];
  }
  const Members also =
      detail::keep_what_stands(search, bank, residuals, null_squares, confirmed, d);
  doubtful.insert(doubtful.end(), also.begin(), also.end());
  const Members left = detail::members_of(confirmed);
  std::erase_if(d.causes,
                [&](const Cause& c) { return !detail::has(left, find_effect(c.effect)); });
  const Fit f = residuals.fit_of(left);
  for (std::size_t k = 0; k < left.size(); ++k)
    d.causes[k].parameters = detail::sizes_of(search, bank, left, f, k);
}

/// Sizes of the named causes, their gain, poses, noise and pictures.
/// @param trained  the causes as they were before the report blocks had a say
void say_by_all(const Prepared& p, const detail::Search& search, Bank& bank,
                detail::Linearised& residuals, const Members& named, const Members& trained,
                const Members& doubtful, Diagnosis& d) {
  const auto& all = search.observations;
  residuals.about({});
  report_before(bank, d);
  const auto r_before = detail::residuals_of(all, {}, bank, residuals.fit_of({}));
  detail::settle_sizes(bank, residuals, named, doubtful, d);
  const Fit f = residuals.fit_of(named);
  const auto r_after = detail::residuals_of(all, named, bank, f);
  report_after(bank, trained, d);
  d.poses = poses_of(p.m, with_uneven_part(p.m, bank, f, p.layout.cell_mm));
  d.noise = noise_of(bank, f, p.layout);
  d.map = detail::draw(all, r_before, r_after, p.scene.box);
  d.dependences = detail::dependences(all, r_before, r_after);
}

Result<Diagnosis> diagnose(Prepared& prepared, const RunContext& run) {
  const Measurements& m = prepared.m;
  const Scene& scene = prepared.scene;
  const Layout& layout = prepared.layout;
  const std::vector<Column>& nuisances = prepared.nuisances;
  const std::vector<detail::Candidate>& candidates = prepared.candidates;
  Bank& bank = prepared.bank;
  Diagnosis d;
  d.notes = m.notes;
  d.contact = m.contact == MadeBy::tip ? MadeBy::tip : MadeBy::ball;
  d.beside_long_beams = m.beside_long_beams;
  d.untestable = prepared.untestable;

  detail::Search search{prepared.points(), nuisances, layout, candidates};
  detail::Linearised residuals(scene, prepared.points(), bank);
  const double null_squares = residuals.left_by({});

  auto confirmed = choose_and_confirm(search, bank, residuals, d, run);
  if (run.stopped()) return fail(kCancelled, "the diagnosis was cancelled");
  run.progress(0.7);
  take_moments_of_all(search, bank, residuals, confirmed, run);
  Members doubtful = detail::keep_what_stands(search, bank, residuals, null_squares, confirmed, d);
  run.progress(0.8);
  detail::make_plain(search, bank, residuals, confirmed);
  detail::prefer_few_parameters(search, bank, residuals, confirmed);
  detail::join_slopes(search, bank, residuals, confirmed, d.rejected);
  detail::prefer_poses_as_given(
      search, bank, residuals,
      [&](const Fit& f) {
        double sum = 0.0;
        const auto poses = poses_of(m, f);
        for (const PoseEstimate& p : poses) sum += norm(p.shift_mm);
        return sum / static_cast<double>(poses.size());
      },
      confirmed);
  prefer_borders_of_the_program(scene, confirmed);
  const auto as_chosen = confirmed;
  if (sharpen(search, bank, residuals, confirmed)) {
    const Members also =
        detail::keep_what_stands(search, bank, residuals, null_squares, confirmed, d);
    doubtful.insert(doubtful.end(), also.begin(), also.end());
  }
  const double unnamed =
      detail::name_causes(search, bank, residuals, null_squares, confirmed, doubtful, d);
  run.progress(0.9);

  // Sizes, poses and what remains are said of all points.
  Members named = detail::members_of(confirmed);
  const Members trained = before_sharpening(as_chosen, named);
  if (prepared.few.empty()) {
    say_by_all(prepared, search, bank, residuals, named, trained, doubtful, d);
  } else {
    Bank sums = of_all_points(prepared, {named, trained, doubtful});
    detail::Linearised left(scene, prepared.m.observations, sums);
    if (left.lag_first() != residuals.lag_first()) left.take_order(residuals.lag_first());
    const detail::Search of_all{m.observations, nuisances, layout, candidates};
    judge_by_all(of_all, sums, left, confirmed, doubtful, d);
    const Members as_sized = detail::members_of(confirmed);
    say_by_all(prepared, of_all, sums, left, as_sized, before_sharpening(as_chosen, as_sized),
               doubtful, d);
    std::erase_if(named, [&](const detail::Member& k) { return !detail::has(as_sized, k.effect); });
  }
  // What is a hundredth of the excess is told of by the causes' own errors.
  constexpr double kWorthSaying = 0.01;
  if (unnamed > kWorthSaying) {
    d.remainder.found = true;
    d.remainder.kinds.emplace_back("what several causes look like");
    d.remainder.share = std::fmax(d.remainder.share, unnamed);
  }
  // Poses of a model that does not hold are those of the misfit.
  if (!d.remainder.found) {
    residuals.about(named);
    const Fit f = with_uneven_part(m, bank, residuals.fit_of(named), layout.cell_mm);
    detail::add_pose_causes(m, bank, named, candidates, f, d);
  }
  MAQUETTE_TRY_VOID(detail::add_stone_causes(m, d, run));
  if (m.strays_gather) {
    d.remainder.found = true;
    d.remainder.kinds.emplace_back("stray points in one place");
  }
  d.verdict = verdict_of(d);
  run.progress(1.0);
  return d;
}

}  // namespace

Result<Diagnosis> diagnose(Measurements m, std::uint64_t seed, const RunContext& run) {
  const bool unknown = m.contact == MadeBy::unknown && m.scene.above;
  auto prepared = std::make_unique<Prepared>(std::move(m), seed);
  if (run.stopped()) return fail(kCancelled, "the diagnosis was cancelled");
  MAQUETTE_TRY_VOID(settle_anew(prepared, seed, run));
  run.progress(0.25);
  if (unknown && is_cut_by_tips(*prepared)) {
    Measurements by_tips = std::move(prepared->m);
    cut_by_tips(by_tips);
    by_tips.notes.push_back(
        fmt::format("the part follows the passes just above each place, not those whose ball of {} "
                    "mm touches it: was a finer cutter used? Causes are those of such passes",
                    2.0 * by_tips.scene.ball_radius_mm));
    prepared = std::make_unique<Prepared>(std::move(by_tips), seed);
  }
  if (run.stopped()) return fail(kCancelled, "the diagnosis was cancelled");
  run.progress(0.3);
  return diagnose(*prepared, run);
}

}  // namespace maquette::diagnosis

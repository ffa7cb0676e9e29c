// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/diagnose.hpp"

#include <algorithm>
#include <cmath>
#include <map>
#include <tuple>

#include <fmt/format.h>

#include "core/chi_squared.hpp"
#include "diagnosis/detail/forms.hpp"
#include "diagnosis/detail/model_search.hpp"
#include "diagnosis/detail/poses.hpp"
#include "diagnosis/detail/remainder.hpp"
#include "diagnosis/detail/residuals.hpp"
#include "diagnosis/detail/show.hpp"
#include "diagnosis/detail/squares.hpp"
#include "diagnosis/detail/steps.hpp"
#include "diagnosis/detail/waves.hpp"

namespace maquette::diagnosis {
namespace {

using detail::Bank;
using detail::Candidate;
using detail::Confirmed;
using detail::Fit;
using detail::kAll;
using detail::kChoose;
using detail::kConfirm;
using detail::kReport;
using detail::Layout;
using detail::Member;
using detail::without;

using detail::kEquivalent;
/// Or a hundredth of the gain: no data tell such causes apart honestly.
constexpr double kEquivalentShare = 0.01;
/// What the simulated surface is not believed below, mm rms: ridges between passes, resampling.
constexpr double kSimulationFloor_mm = 0.0025;
/// A cause that explains this share of all that is explained is no error of the others' signatures.
constexpr double kMuch = 0.1;
/// Two causes whose fits differ by less are not told apart: the simulation of what they differ in
/// (ridges, creases, the steepest slopes) is not better than that, mm rms.
constexpr double kTellApart_mm = 0.0015;
/// In -2 log likelihood: what is missed by more to first order is missed cut anew, too.
constexpr double kClose = 500.0;
/// Causes that are tried in the place of a chosen one, the closest to first order.
constexpr std::size_t kRivals = 3;
/// Of a lag and lost motion made one after the other of the sizes that were fitted last, until they
/// change by no more than a fiftieth; sizes below the last are none.
constexpr int kSizeRounds = 6;
constexpr double kSameSize = 0.02, kLeastSize_mm = 0.01;
/// Of choosing, cutting anew and pruning.
constexpr int kRounds = 4;
/// A cause that explains less of the excess than this, and in whose place two others would do, is
/// not named: what several causes look like is also what the error of a large one looks like.
constexpr double kVagueShare = 0.25;
constexpr std::size_t kVagueRivals = 2;
/// As many in its place make any cause nameless.
constexpr std::size_t kNameless = 8;
/// Squares that a cause which is not the largest must explain, over those that nothing explains.
constexpr double kBesideUnknown = 3.0;
/// What signatures may be wrong by, as a share of what all causes together move.
constexpr double kSignatureError = 0.08;

FittedNoise noise_of(const Bank& bank, const Fit& f, const Layout& layout) {
  FittedNoise n;
  n.cell_mm = layout.cell_mm;
  n.point_mm2 = f.variance[detail::kPointGroup];
  bool several = false;
  for (const auto& s : bank.sets) several |= !s.top[1].weight.empty();
  // Where points are few there are no details of the finest squares: as those of points.
  const auto variance = [&](std::size_t group, double otherwise) {
    double count = 0.0;
    for (const auto& s : bank.sets) count += s.count[group];
    return count > 10.0 ? f.variance[group] : otherwise;
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
    (u == 0 ? n.common : n.own) = {f.top_variance[u] * points / std::fmax(1.0, means),
                                   f.top_variance[u] * theta.ratio,
                                   std::fmax(1e-3, theta.length_mm), theta.gauss};
  }
  return n;
}

std::vector<Member> members_of(const std::vector<Confirmed>& confirmed) {
  std::vector<Member> all;
  for (const Confirmed& c : confirmed) all.push_back(c.member);
  return all;
}

/// The same causes.
bool alike(const std::vector<Member>& a, const std::vector<Member>& b) {
  return a.size() == b.size() &&
         std::all_of(a.begin(), a.end(), [&](const Member& x) { return detail::has(b, x.effect); });
}

/// Is a lag (or lost motion) among them?
bool follows_any(const std::vector<Member>& members, bool lag) {
  return std::any_of(members.begin(), members.end(), [&](const Member& k) {
    const auto& what = k.form.columns[0].follows;
    return what && what->lag == lag;
  });
}

/// What is in no point of the observations that lie in `odd` squares.
std::vector<Observation> outside(const std::vector<Observation>& all, const detail::Squares& odd) {
  std::vector<Observation> kept;
  for (const Observation& o : all)
    if (!odd.holds(o.place.x, o.place.y)) kept.push_back(o);
  return kept;
}

}  // namespace

Result<Diagnosis> diagnose(Measurements m, std::uint64_t seed, const RunContext& run) {
  Diagnosis d;
  d.notes = m.notes;
  Scene scene = m.scene;
  Layout layout = detail::lay_out(scene.box, seed);
  const auto nuisances = detail::nuisances_of(m);
  const Bank plain = detail::sum_up(m.observations, nuisances, {}, layout);
  // Waves along the passes are looked for in what the nuisances leave.
  if (scene.has_path) {
    const Fit f = detail::fit(plain, detail::columns_of(plain, {}), {kChoose});
    const auto r = detail::residuals_of(m.observations, {}, plain, f);
    detail::find_waves(m.observations, r, layout, scene);
    for (int axis = 0; axis < 3; ++axis)
      scene.steps[static_cast<std::size_t>(axis)] =
          detail::sharpest_steps(m.observations, r, layout, axis);
  }
  layout.smooth = detail::smooth_law(plain, layout);
  detail::Search search{m.observations, nuisances, layout,
                        detail::candidates_of(scene, d.untestable)};
  Bank bank =
      detail::sum_up(m.observations, nuisances, detail::all_columns(search.candidates), layout);
  if (run.stopped()) return fail(kCancelled, "the diagnosis was cancelled");
  run.progress(0.3);

  const auto empty = detail::columns_of(bank, {});
  const Fit null_fit = detail::fit(bank, empty, kAll);
  const auto r_before = detail::residuals_of(m.observations, {}, bank, null_fit);
  const double null_squares = detail::squares(bank, empty, null_fit.coefficients, kAll, nullptr);
  {
    const Fit report_null = detail::fit(bank, empty, {kReport});
    double n = 0.0;
    d.rms_before_mm = std::sqrt(
        detail::squares(bank, empty, report_null.coefficients, {kReport}, &n) / std::fmax(1.0, n));
    d.n_report = static_cast<std::size_t>(n);
  }
  std::vector<double> given(m.observations.size());
  for (std::size_t i = 0; i < given.size(); ++i) given[i] = m.observations[i].residual_mm;
  // Residuals less what the members' cut moves beyond their signatures; kept while they are the
  // same. Members that were straightened before begin where they came to rest.
  using Keys = std::vector<std::string>;
  Keys straight_for;
  bool rows_moved = false;
  std::map<Keys, Eigen::VectorXd> rested;
  detail::Signatures signatures;
  detail::LagAndSlack lag_and_slack(scene);
  const auto straighten = [&](const std::vector<Member>& with) {
    Keys keys, cut;
    for (const Member& k : with)
      for (const Column& c : k.form.columns) {
        keys.push_back(c.key);
        if (c.cut || c.moves_whole) cut.push_back(c.key);
      }
    // Where poses moved rows, too, all that poses answer to counts.
    if (rows_moved && !with.empty()) cut = keys;
    if (cut.empty() && straight_for.empty()) return;
    if (cut == straight_for && !cut.empty()) return;
    straight_for = std::move(cut);
    const auto model = detail::columns_of(bank, with);
    Eigen::VectorXd last;
    for (int round = 0; round < (straight_for.empty() ? 1 : 4); ++round) {
      Fit f;
      if (const auto before = rested.find(keys); round == 0 && before != rested.end())
        f.coefficients = before->second;
      else
        f = detail::fit(bank, model, kAll);
      const Eigen::VectorXd& now = f.coefficients;
      // At rest to a fiftieth: second order of a fiftieth of a size is a hundredth of second order.
      bool at_rest = round > 0;
      for (Eigen::Index k = bank.nuisances; at_rest && k < last.size(); ++k)
        at_rest = std::abs(now(k) - last(k)) <
                  0.02 * std::abs(last(k)) + 0.2 * std::sqrt(std::fmax(0.0, f.covariance(k, k)));
      if (at_rest) break;
      last = now;
      auto straight =
          detail::beyond_linear(m.observations, with, bank, now, scene.ball_radius_mm, signatures,
                                lag_and_slack, scene.has_path && !scene.causes_taken_off);
      rows_moved = straight.rows_moved;
      for (std::size_t i = 0; i < given.size(); ++i)
        m.observations[i].residual_mm = straight.mm[i] = given[i] - straight.mm[i];
      detail::exchange_residuals(bank, straight.mm);
    }
    rested[keys] = last;
  };
  // With residuals as they are, and cut anew.
  const auto linear_score = [&](const std::vector<Member>& of) {
    return detail::fit(bank, detail::columns_of(bank, of), {kChoose}).objective +
           detail::price(bank, of);
  };
  const auto score = [&](const std::vector<Member>& of) {
    straighten(of);
    return linear_score(of);
  };
  // A member in whose place another cause, cut anew, does better was only found first.
  const auto exchanged = [&](std::vector<Member> with) {
    for (int round = 0; round < kRounds; ++round) {
      double best = score(with) - detail::kPricePerCause;
      std::vector<Member> better;
      for (std::size_t k = 0; k < with.size(); ++k) {
        const auto others = without(with, k);
        straighten(others);
        const double now = linear_score(with);
        const detail::Screen beside = detail::screen(bank, others, {kChoose});
        std::vector<std::pair<double, Member>> rivals;
        for (const Candidate& other : search.candidates) {
          if (detail::has(with, other.effect)) continue;
          const auto found = detail::best_form(bank, others, other, {kChoose}, true, beside);
          if (found.objective < now + kClose)
            rivals.emplace_back(found.objective, Member{other.effect, other.forms[found.form]});
        }
        std::sort(rivals.begin(), rivals.end(),
                  [](const auto& a, const auto& b) { return a.first < b.first; });
        for (std::size_t r = 0; r < std::min(rivals.size(), kRivals); ++r) {
          auto instead = with;
          instead[k] = rivals[r].second;
          if (const double s = score(instead); s < best) {
            best = s;
            better = std::move(instead);
          }
        }
      }
      if (better.empty()) break;
      with = detail::polished(search, bank, std::move(better), straighten);
    }
    straighten(with);
    return with;
  };
  /// Squares that a model leaves, all points alike.
  const auto left_by = [&](const std::vector<Member>& of) {
    const auto model = detail::columns_of(bank, of);
    return detail::squares(bank, model, detail::fit(bank, model, kAll).coefficients, kAll, nullptr);
  };
  // Members without which the rest, cut anew, does as well: straightened residuals favour what they
  // were straightened for.
  const auto pruned = [&](std::vector<Member> with) {
    const double null = score({}), null_left = left_by({});
    while (!with.empty()) {
      const double all = score(with), left = left_by(with);
      const double price = detail::kPriceOfGain * std::fmax(0.0, null - all);
      double least = 0.0;
      std::size_t drop = with.size();
      // Without one, to first order: only those that are missed little are cut anew.
      std::vector<double> linear;
      for (std::size_t k = 0; k < with.size(); ++k)
        linear.push_back(linear_score(without(with, k)));
      for (std::size_t k = 0; k < with.size(); ++k) {
        if (linear[k] - all > kClose + 0.25 * std::fmax(0.0, null - all)) continue;
        const auto others = without(with, k);
        double worth = score(others) - all - price;
        if (!(worth < least)) continue;
        // What moves much is not what another's signature is wrong by, however well that one shows
        // (a warp beside chatter): it need not earn the share of the gain.
        if (left_by(others) - left > kMuch * (null_left - left)) worth += price;
        if (!(worth < least)) continue;
        least = worth;
        drop = k;
      }
      if (drop == with.size()) break;
      with = without(with, drop);
    }
    straighten(with);
    return with;
  };

  // Of a lag and lost motion in one machine sizes are what their forms are made of: what the two do
  // together hangs on both, and on which is nearer to the tool.
  const auto in_one_machine = [&](const std::vector<Member>& start) {
    if (!follows_any(start, true) || !follows_any(start, false)) return start;
    const auto take_order = [&](bool lag_first) {
      lag_and_slack.lag_first = lag_first;
      straight_for.clear();
      rested.clear();
    };
    auto best = start;
    double least = INFINITY;
    bool order = lag_and_slack.lag_first;
    for (const bool lag_first : {true, false}) {
      take_order(lag_first);
      auto now = start;
      for (int round = 0; round < kSizeRounds; ++round) {
        if (const double s = score(now); s < least) {
          least = s;
          best = now;
          order = lag_first;
        }
        const auto model = detail::columns_of(bank, now);
        const Fit f = detail::fit(bank, model, kAll);
        bool moved = false;
        for (Member& k : now) {
          const auto what = k.form.columns[0].follows;
          if (!what) continue;
          const auto at =
              std::find(model.begin(), model.end(), bank.index.at(k.form.columns[0].key)) -
              model.begin();
          const double size = detail::size_mm({*what, f.coefficients(at)});
          if (!(size > kLeastSize_mm) || std::abs(std::log(size / what->size_mm)) < kSameSize)
            continue;
          moved = true;
          k.form = k.form.of_size(size);
          detail::add_columns(bank, m.observations, k.form.columns);
        }
        if (!moved) break;
      }
    }
    take_order(order);
    straighten(best);
    return best;
  };

  // What details are worth, from what the nuisances leave and again from what the chosen leave.
  const auto weigh = [&](const std::vector<Member>& with) {
    const auto model = detail::columns_of(bank, with);
    bank.weight = detail::effective_weights(bank, model, detail::fit(bank, model, kAll));
  };
  weigh({});
  std::vector<Member> members;
  for (int round = 0; round < kRounds; ++round) {
    std::vector<Ranked> alone;
    auto chosen = detail::choose(search, bank, alone, run);
    d.ranking = std::move(alone);
    if (chosen.empty() && members.empty()) break;
    straighten(chosen);
    chosen = detail::polished(search, bank, std::move(chosen), straighten);
    chosen = pruned(round == 0 ? in_one_machine(chosen) : std::move(chosen));
    if (auto other = exchanged(chosen); !alike(other, chosen)) chosen = pruned(std::move(other));
    weigh(chosen);
    const bool settled = round > 0 && alike(chosen, members);
    members = std::move(chosen);
    if (settled || run.stopped()) break;
  }
  if (run.stopped()) return fail(kCancelled, "the diagnosis was cancelled");
  members = in_one_machine(members);
  run.progress(0.7);
  auto confirmed = detail::confirm(bank, members, kClaimLevel, d.rejected, straighten);

  // What remains, and whether the causes stand without the odd places.
  detail::Squares odd;
  while (true) {
    members = members_of(confirmed);
    straighten(members);
    const auto model = detail::columns_of(bank, members);
    const Fit f = detail::fit(bank, model, kAll);
    const auto r = detail::residuals_of(m.observations, members, bank, f);
    d.remainder = detail::judge(m.observations, r, layout, bank, f, odd);
    double points = 0.0;
    const double left_squares = detail::squares(bank, model, f.coefficients, kAll, &points);
    const double moved = std::sqrt(std::fmax(0.0, null_squares - left_squares) / points);
    if (d.remainder.structured_rms_mm < std::fmax(kSimulationFloor_mm, kSignatureError * moved))
      d.remainder.found = false;
    const double structured =
        d.remainder.found ? points * d.remainder.structured_rms_mm * d.remainder.structured_rms_mm
                          : 0.0;
    const double excess = std::fmax(1e-300, null_squares - left_squares + structured);
    d.remainder.share = structured / excess;
    std::size_t drop = members.size();
    std::string why;
    const double floor = std::fmax(kSimulationFloor_mm, kSignatureError * moved);
    std::vector<double> explained;
    for (std::size_t k = 0; k < members.size(); ++k) {
      const auto fewer = without(members, k);
      const auto small = detail::columns_of(bank, fewer);
      const auto missed = [&] {
        const Fit g = detail::fit(bank, small, kAll);
        return detail::squares(bank, small, g.coefficients, kAll, nullptr) - left_squares;
      };
      straighten(members);
      explained.push_back(missed());
      if (explained[k] > 10.0 * std::fmax(points * floor * floor, structured)) continue;
      straighten(fewer);
      explained[k] = missed();
    }
    for (std::size_t k = 0; k < members.size(); ++k) {
      // Beside something unknown only the largest is taken for what it looks like.
      const bool largest = explained[k] >= *std::max_element(explained.begin(), explained.end());
      if (drop < members.size() && explained[k] >= explained[drop]) continue;
      if (!(explained[k] > points * floor * floor))
        why = fmt::format("smaller than what the simulation itself may be wrong by ({:.4f} mm rms)",
                          floor);
      else if (d.remainder.found && explained[k] < (largest ? 1.0 : kBesideUnknown) * structured)
        why = "explains less than what remains unexplained beside it";
      else
        continue;
      drop = k;
    }
    straighten(members);
    if (drop == members.size() && d.remainder.found && odd.count() > 0 && !members.empty()) {
      const auto kept = outside(m.observations, odd);
      std::vector<Column> columns;
      for (const Member& c : members)
        columns.insert(columns.end(), c.form.columns.begin(), c.form.columns.end());
      const Bank masked = detail::sum_up(kept, nuisances, columns, layout);
      const auto at = detail::columns_of(masked, members);
      const double full = detail::fit(masked, at, kAll).objective;
      for (std::size_t k = 0; k < members.size(); ++k) {
        const auto small = detail::columns_of(masked, without(members, k));
        const double gain = detail::fit(masked, small, kAll).objective - full;
        if (chi_squared_tail(gain, std::max(1, static_cast<int>(at.size() - small.size()))) >
            1e-6) {
          drop = k;
          why = "hangs on a few odd places";
        }
      }
    }
    if (drop == members.size()) break;
    d.rejected.push_back({members[drop].effect->name, why});
    confirmed.erase(confirmed.begin() + static_cast<std::ptrdiff_t>(drop));
  }
  run.progress(0.8);

  // Names, and what would do as well in their place.
  double vague = 0.0;
  while (true) {
    const auto model = detail::columns_of(bank, members);
    const Fit f = detail::fit(bank, model, kAll);
    double points = 0.0;
    const double left_squares = detail::squares(bank, model, f.coefficients, kAll, &points);
    const double structured =
        d.remainder.found ? points * d.remainder.structured_rms_mm * d.remainder.structured_rms_mm
                          : 0.0;
    const double excess = std::fmax(1e-300, null_squares - left_squares + structured);
    // Names hang on differences between fits: those must stand out of what nothing explains.
    const double tell_apart = std::max(
        {kTellApart_mm, d.remainder.found ? d.remainder.structured_rms_mm : 0.0,
         kSignatureError * std::sqrt(std::fmax(0.0, null_squares - left_squares) / points)});
    std::vector<Cause> causes;
    std::vector<Rejected> ruled_out;
    std::vector<double> wider;  // standard errors
    for (std::size_t k = 0; k < members.size(); ++k)
      wider.push_back(std::sqrt(
          detail::overstated(bank, model, detail::columns_of(bank, without(members, k)), f)));
    for (std::size_t k = 0; k < members.size(); ++k) {
      const Member& member = members[k];
      const auto others = without(members, k);
      straighten(others);
      const auto small = detail::columns_of(bank, others);
      const Fit g = detail::fit(bank, small, kAll);
      Cause c;
      c.effect = member.effect->name;
      c.law = member.form.law;
      c.fixed = member.form.fixed;
      if (const auto& what = member.form.columns[0].follows;
          what && !what->lag && follows_any(members, true))
        c.fixed.emplace_back(detail::kSlackBehindLag, lag_and_slack.lag_first ? 1.0 : 0.0);
      c.separate_by = member.effect->separate_by;
      c.p_value = std::fmax(confirmed[k].p_value, 1e-300);
      c.share = std::clamp(
          (detail::squares(bank, small, g.coefficients, kAll, nullptr) - left_squares) / excess,
          0.0, 1.0);
      for (const Column& column : member.form.columns) {
        const auto at =
            std::find(model.begin(), model.end(), bank.index.at(column.key)) - model.begin();
        c.parameters.push_back({column.parameter.name,
                                f.coefficients(at) * column.parameter.per_column,
                                wider[k] * std::sqrt(std::fmax(0.0, f.covariance(at, at))) *
                                    std::abs(column.parameter.per_column)});
      }
      const double gain = g.objective - f.objective;
      const auto rival_fit = [&](const std::vector<Member>& with) {
        const auto columns = detail::columns_of(bank, with);
        const Fit h = detail::fit(bank, columns, kAll);
        return std::pair{h.objective,
                         detail::squares(bank, columns, h.coefficients, kAll, nullptr)};
      };
      // Rivals are compared with the member as it is without its own second order, and where they
      // come close with that of each.
      const auto [linear, linear_squares] = rival_fit(members);
      const double far = std::fmax(kEquivalent, kEquivalentShare * gain),
                   far_squares = points * tell_apart * tell_apart;
      const detail::Screen beside = detail::screen(bank, others, kAll);
      for (const Candidate& other : search.candidates) {
        if (detail::has(members, other.effect)) continue;
        const auto found = detail::best_form(bank, others, other, kAll, false, beside);
        if (!std::isfinite(found.objective)) continue;
        auto instead = others;
        instead.push_back({other.effect, other.forms[found.form]});
        auto [objective, with_squares] = rival_fit(instead);
        double worse = objective - linear, apart = with_squares - linear_squares;
        if (worse < 10.0 * far || apart < 4.0 * far_squares) {
          straighten(instead);
          std::tie(objective, with_squares) = rival_fit(instead);
          worse = objective - f.objective;
          apart = with_squares - left_squares;
          straighten(others);
        }
        if (worse < far || apart < far_squares)
          c.equivalent.push_back(other.effect->name);
        else if (g.objective - found.objective > 20.0)
          ruled_out.push_back(
              {other.effect->name,
               fmt::format("in the place of {} it makes the data 10^{:.1f} times less likely",
                           c.effect, worse / 4.605)});
      }
      causes.push_back(std::move(c));
    }
    straighten(members);
    std::size_t drop = members.size();
    double least = INFINITY;
    for (std::size_t k = 0; k < members.size(); ++k) {
      const Cause& c = causes[k];
      const bool small =
          members.size() > 1 && c.share < kVagueShare &&
          (c.equivalent.size() >= kVagueRivals || c.share < kSignatureError * kSignatureError);
      if ((small || c.equivalent.size() >= kNameless) && c.share < least) {
        least = c.share;
        drop = k;
      }
    }
    if (drop == members.size()) {
      d.causes = std::move(causes);
      d.rejected.insert(d.rejected.end(), ruled_out.begin(), ruled_out.end());
      break;
    }
    if (causes[drop].equivalent.size() >= kVagueRivals) vague += least;
    d.rejected.push_back(
        {members[drop].effect->name,
         causes[drop].equivalent.size() < kVagueRivals
             ? std::string("smaller than what the signatures of the others may be wrong by")
             : fmt::format("small beside the others, and {} other causes would do in its place",
                           causes[drop].equivalent.size())});
    confirmed.erase(confirmed.begin() + static_cast<std::ptrdiff_t>(drop));
    members = members_of(confirmed);
    straighten(members);
  }
  const auto model = detail::columns_of(bank, members);
  const Fit f = detail::fit(bank, model, kAll);
  const auto r_after = detail::residuals_of(m.observations, members, bank, f);
  if (vague > 0.0) {
    d.remainder.found = true;
    d.remainder.kinds.emplace_back("what several causes look like");
    d.remainder.share = std::fmax(d.remainder.share, vague);
  }
  std::sort(d.causes.begin(), d.causes.end(),
            [](const Cause& a, const Cause& b) { return a.share > b.share; });

  // Gain on blocks that had no part in choosing or confirming; causes held as fitted elsewhere.
  {
    const Fit trained = detail::fit(bank, model, {kChoose, kConfirm});
    d.rms_after_mm =
        std::sqrt(detail::squares(bank, model, trained.coefficients, {kReport}, nullptr) /
                  std::fmax(1.0, static_cast<double>(d.n_report)));
    const Fit free_fit = detail::fit(bank, model, {kReport});
    d.rms_noise_mm = std::sqrt(free_fit.variance[detail::kPointGroup]);
  }
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
    d.poses.push_back(std::move(p));
  }
  d.noise = noise_of(bank, f, layout);
  // Poses of a model that does not hold are those of the misfit.
  if (!d.remainder.found) detail::add_pose_causes(m, bank, members, search.candidates, f, d);
  d.map = detail::draw(m.observations, r_before, r_after, scene.box);
  d.dependences = detail::dependences(m.observations, r_before, r_after);
  d.verdict = d.causes.empty() ? (d.remainder.found ? "unexplained" : "consistent")
                               : (d.remainder.found ? "partly_explained" : "explained");
  run.progress(1.0);
  return d;
}

}  // namespace maquette::diagnosis

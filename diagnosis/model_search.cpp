// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/model_search.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <map>
#include <mutex>
#include <numeric>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/chi_squared.hpp"
#include "diagnosis/detail/forms.hpp"
#include "diagnosis/detail/ridge.hpp"

namespace maquette::diagnosis::detail {
namespace {

constexpr std::size_t kBeam = 4;
constexpr std::size_t kMostCauses = 5;
constexpr double kFar = 2000.0;     // in -2 log likelihood
constexpr std::size_t kFitted = 4;  // of the forms of a candidate, at either noise
/// A fit, whose noise is its own, is taken to gain no more than this many times what the screen
/// says at either noise, which is nothing where both want the other sign.
constexpr double kOwnNoise = 4.0;

/// Of the signs that the laws allow, and of believable sizes.
bool physical(const Bank& bank, const std::vector<int>& model, const std::vector<Member>& members,
              const Fit& f) {
  for (const Member& m : members) {
    if (!believable(bank, model, m, f)) return false;
    for (std::size_t k = 0; k < std::min(m.form.columns.size(), m.form.signed_columns); ++k) {
      const double size = f.coefficients(place_of(bank, model, m.form.columns[k]));
      if (size * m.form.sign < 0.0) return false;
    }
  }
  return true;
}

/// In -2 log likelihood: scores that differ by less are the same.
constexpr double kSame = 1e-3;

struct State {
  std::vector<Member> members;
  double score = INFINITY;
};

/// The causes of a model, whatever their order.
std::vector<const Effect*> causes_of(const State& s) {
  std::vector<const Effect*> all;
  for (const Member& m : s.members) all.push_back(m.effect);
  std::sort(all.begin(), all.end());
  return all;
}

/// What the best of a candidate's forms gains at either noise.
double most_gain(const Bank& bank, const Candidate& candidate, const Screen& screen) {
  double most = 0.0;
  for (const Form& f : candidate.forms)
    for (const double gain : screen.gain(bank, f)) most = std::fmax(most, gain);
  return most;
}

/// Models of one cause more than each of a beam's that do better than it, those left out that
/// cannot be among the best.
/// @param ranking  gets what each cause gains alone, from a beam of no causes, which leaves out
/// none
std::vector<State> with_one_more(const Search& search, const Bank& bank,
                                 const std::vector<State>& beam, std::vector<Ranked>* ranking) {
  std::vector<State> next;
  std::map<std::vector<const Effect*>, double> best;  // score by causes
  const auto last_of_the_best = [&] {
    if (best.size() < kBeam) return std::numeric_limits<double>::infinity();
    std::vector<double> scores;
    for (const auto& [causes, score] : best) scores.push_back(score);
    std::nth_element(scores.begin(), scores.begin() + (kBeam - 1), scores.end());
    return scores[kBeam - 1];
  };
  for (const State& from : beam) {
    const Screen beside = screen(bank, from.members, {kChoose});
    std::vector<std::pair<double, const Candidate*>> by_gain;
    for (const Candidate& c : search.candidates)
      if (may_join(from.members, c.effect)) by_gain.emplace_back(most_gain(bank, c, beside), &c);
    std::ranges::sort(by_gain, [](const auto& a, const auto& b) { return a.first > b.first; });
    for (const auto& [gain, c] : by_gain) {
      const double needed =
          kPricePerCause + kPricePerColumn + std::fmax(0.0, from.score - last_of_the_best());
      if (ranking == nullptr && kOwnNoise * gain < needed) break;
      const BestForm found = best_form(bank, from.members, *c, {kChoose}, true, beside);
      if (ranking != nullptr && std::isfinite(found.objective))
        ranking->push_back(
            {c->effect->name, c->forms[found.form].law, from.score - found.objective});
      if (!(found.objective < from.score)) continue;
      State s = from;
      s.members.push_back({c->effect, c->forms[found.form]});
      s.score = found.objective;
      double& score = best.try_emplace(causes_of(s), INFINITY).first->second;
      score = std::fmin(score, s.score);
      next.push_back(std::move(s));
    }
  }
  return next;
}

double score_of(const Bank& bank, const std::vector<Member>& members, const std::vector<int>& sets,
                bool priced) {
  const auto model = columns_of(bank, members);
  const Fit f = fit(bank, model, sets);
  if (!physical(bank, model, members, f)) return INFINITY;
  return f.objective + (priced ? price(bank, members) : 0.0);
}

/// Replaces the form of the last member by the best of its neighbours, as often as there are any.
/// Of neighbours that do as well (a moment at which no block of these sets was cut) it is the
/// middle.
void refine(const Search& search, const Bank& bank, State& state, const std::vector<int>& sets) {
  const Fit now = fit(bank, columns_of(bank, state.members), sets);
  for (int round = 0; round < 4; ++round) {
    Member& last = state.members.back();
    if (!last.form.finer) return;
    const auto near = last.form.finer();
    if (near.empty()) return;
    std::vector<Column> columns;
    for (const Form& f : near) columns.insert(columns.end(), f.columns.begin(), f.columns.end());
    const Bank small = bank_beside(search, bank, now, state.members, columns, sets);
    std::vector<double> scores(near.size());
    oneapi::tbb::parallel_for(std::size_t{0}, near.size(), [&](std::size_t k) {
      auto members = state.members;
      members.back().form = near[k];
      scores[k] = score_of(small, members, sets, true);
    });
    auto best =
        static_cast<std::size_t>(std::min_element(scores.begin(), scores.end()) - scores.begin());
    if (!std::isfinite(scores[best])) return;
    std::size_t last_as_good = best;
    while (last_as_good + 1 < scores.size() && scores[last_as_good + 1] < scores[best] + kSame)
      ++last_as_good;
    best = (best + last_as_good) / 2;
    last.form = near[best];  // neighbours include the form itself
    state.score = scores[best];
  }
}

/// A refined form becomes a candidate for all that follow. Other causes that have columns of its
/// kind (a step is one whoever made it) have it too, or they would seem worse by not being refined.
void offer(Search& search, const Member& member) {
  const auto kind = [](const Form& f) {
    return f.columns.size() == 1
               ? f.columns[0].key.substr(0, f.columns[0].key.find_first_of("0123456789"))
               : std::string();
  };
  const std::string its = kind(member.form);
  for (Candidate& c : search.candidates)
    if (c.effect == member.effect ||
        (!its.empty() && std::any_of(c.forms.begin(), c.forms.end(),
                                     [&](const Form& f) { return kind(f) == its; })))
      c.forms.push_back(member.form);
}

}  // namespace

std::vector<Candidate>::const_iterator candidate_of(const Search& search, const Effect* effect) {
  return std::find_if(search.candidates.begin(), search.candidates.end(),
                      [&](const Candidate& c) { return c.effect == effect; });
}

bool believable(const Bank& bank, const std::vector<int>& model, const Member& member, const Fit& f,
                double sigmas) {
  for (std::size_t k = 0; k < member.form.columns.size(); ++k) {
    const Column& c = member.form.columns[k];
    const auto at = place_of(bank, model, c);
    const double value = f.coefficients(at);
    const double unsure =
        sigmas > 0.0 ? sigmas * std::sqrt(std::fmax(0.0, f.covariance(at, at))) : 0.0;
    if ((std::abs(value) - unsure) * std::abs(c.parameter.per_column) > c.parameter.plausible)
      return false;
    if (value * c.parameter.per_column + unsure * std::abs(c.parameter.per_column) <
        c.parameter.least)
      return false;
  }
  return true;
}

bool believable(const Bank& bank, const std::vector<Member>& members, const Fit& f) {
  const auto model = columns_of(bank, members);
  return std::all_of(members.begin(), members.end(),
                     [&](const Member& m) { return believable(bank, model, m, f); });
}

bool has(const std::vector<Member>& members, const Effect* effect) {
  return std::any_of(members.begin(), members.end(),
                     [&](const Member& m) { return m.effect == effect; });
}

bool may_join(const std::vector<Member>& members, const Effect* effect) {
  return std::none_of(members.begin(), members.end(), [&](const Member& m) {
    return m.effect == effect || m.effect->never_beside == effect->name;
  });
}

std::vector<Member> without(std::vector<Member> members, std::size_t k) {
  members.erase(members.begin() + static_cast<std::ptrdiff_t>(k));
  return members;
}

Bank bank_beside(const Search& search, const Bank& bank, const Fit& f,
                 const std::vector<Member>& members, const std::vector<Column>& more,
                 const std::vector<int>& sets) {
  const std::vector<Theta> theta{Theta{}, bank.theta[static_cast<std::size_t>(f.theta[0])],
                                 bank.theta[static_cast<std::size_t>(f.theta[1])]};
  std::vector<Column> columns;
  for (const Member& m : members)
    columns.insert(columns.end(), m.form.columns.begin(), m.form.columns.end());
  columns.insert(columns.end(), more.begin(), more.end());
  Bank small = sum_up(search.observations, search.nuisances, columns, search.layout, &theta,
                      sets.size() == 1 ? sets[0] : -1);
  small.weight = bank.weight;
  return small;
}

std::vector<Member> polished(Search& search, Bank& bank, std::vector<Member> members,
                             const Settle& settle, const std::vector<int>& sets) {
  const auto levels = [](const Member& m) { return m.form.columns[0].levels.has_value(); };
  for (std::size_t k = 0; k < members.size(); ++k) {
    // To first order others may do better, a pass beside the border.
    if (members[k].form.law == kBandsOfTheProgram) continue;
    const auto same = candidate_of(search, members[k].effect);
    if (levels(members[k]) && members.size() > 1) {
      // Beside others the length that a film levels over shows once what it makes of them is known.
      settle(members);
      const double now = score_of(bank, members, sets, true);
      const auto others = without(members, k);
      const BestForm found = best_form(bank, others, *same, sets, true, screen(bank, others, sets));
      if (found.objective < now) {
        const Member before = members[k];
        members[k].form = same->forms[found.form];
        settle(members);
        if (std::isfinite(now) && !(score_of(bank, members, sets, true) < now)) members[k] = before;
      }
      continue;
    }
    Candidate coarse{same->effect, {}};
    for (const Form& f : same->forms)
      if (f.finer) coarse.forms.push_back(f);
    if (coarse.forms.empty()) continue;
    const auto others = without(members, k);
    // Of steps, which passes beside the border answer to by more than first order, as cut anew.
    const bool steps = static_cast<bool>(members[k].form.move_moment);
    const auto cut_anew = [&](const Form& form) {
      auto with = members;
      with[k].form = form;
      add_columns(bank, search.observations, form.columns);
      settle(with);
      return score_of(bank, with, sets, true);
    };
    settle(others);  // residuals straightened for a form favour it
    const double now = score_of(bank, members, sets, true);
    State s{others, now};
    s.members.push_back(members[k]);
    const BestForm found = best_form(bank, others, coarse, sets, true, screen(bank, others, sets));
    if (!std::isfinite(found.objective)) continue;
    s.members.back().form = coarse.forms[found.form];
    refine(search, bank, s, sets);
    if (!(s.score < now)) continue;
    if (steps) {
      const double moved = cut_anew(s.members.back().form);
      if (!(moved < cut_anew(members[k].form))) continue;  // residuals are about those as they were
    }
    members[k].form = s.members.back().form;
    add_columns(bank, search.observations, members[k].form.columns);
    offer(search, members[k]);
  }
  return members;
}

double price(const Bank& bank, const std::vector<Member>& members) {
  return kPricePerColumn * static_cast<double>(columns_of(bank, members).size() -
                                               static_cast<std::size_t>(bank.nuisances)) +
         kPricePerCause * static_cast<double>(members.size());
}

std::vector<int> columns_of(const Bank& bank, const std::vector<Member>& members) {
  std::vector<int> model;
  for (int i = 0; i < bank.nuisances; ++i) model.push_back(i);
  for (const Member& m : members)
    for (const Column& c : m.form.columns) {
      const int i = bank.index.at(c.key);
      if (std::find(model.begin(), model.end(), i) == model.end()) model.push_back(i);
    }
  return model;
}

Eigen::Index place_of(const Bank& bank, const std::vector<int>& model, const Column& column) {
  return std::find(model.begin(), model.end(), bank.index.at(column.key)) - model.begin();
}

std::array<double, 2> Screen::gain(const Bank& bank, const Form& form) const {
  const Eigen::Index y = bank.y();
  std::vector<int> at;
  for (const Column& c : form.columns) at.push_back(bank.index.at(c.key));
  std::array<double, 2> gains{};
  for (std::size_t noise = 0; noise < 2; ++noise) {
    const Eigen::MatrixXd& m = rest[noise];
    Eigen::MatrixXd a = m(at, at);
    const Eigen::VectorXd b = m(at, y);
    // What the model has already is worth nothing.
    for (std::size_t k = 0; k < at.size(); ++k)
      a(static_cast<Eigen::Index>(k), static_cast<Eigen::Index>(k)) += 1e-9;
    const Eigen::VectorXd x = a.ldlt().solve(b);
    bool allowed = true;
    for (std::size_t k = 0; k < std::min(at.size(), form.signed_columns); ++k)
      allowed &= form.sign == 0 || x(static_cast<Eigen::Index>(k)) * form.sign >= 0.0;
    if (allowed) gains[noise] = x.dot(b);
  }
  return gains;
}

Screen screen(const Bank& bank, const std::vector<Member>& members, const std::vector<int>& sets) {
  const auto model = columns_of(bank, members);
  const Fit f = fit(bank, model, sets);
  const Eigen::Index n = bank.y() + 1;
  Eigen::MatrixXd details = Eigen::MatrixXd::Zero(n, n);
  std::array<Eigen::MatrixXd, 2> sum;
  for (const int set : sets)
    for (std::size_t g = 0; g < kGroups; ++g)
      details += bank.weight[g] / f.variance[g] *
                 bank.sets[static_cast<std::size_t>(set)].gram[g].topLeftCorner(n, n);
  for (int white = 0; white < 2; ++white) {
    Eigen::MatrixXd& all = sum[static_cast<std::size_t>(white)] = details;
    for (std::size_t u = 0; u < kTops; ++u) {
      const Theta& theta = bank.theta[static_cast<std::size_t>(f.theta[u])];
      for (const TopSums* top : tops_of(bank, sets, u))
        all += (white == 1
                    ? top->gram[0].topLeftCorner(n, n) / (f.top_variance[u] * (1.0 + theta.ratio))
                    : top->gram[static_cast<std::size_t>(f.theta[u])].topLeftCorner(n, n) /
                          f.top_variance[u]);
    }
  }
  Screen s;
  for (std::size_t k = 0; k < 2; ++k) {
    const Eigen::MatrixXd across = sum[k](model, Eigen::all);
    s.rest[k] = sum[k] - across.transpose() * ridge_solve(sum[k](model, model), across, 1e-10);
  }
  return s;
}

BestForm best_form(const Bank& bank, const std::vector<Member>& others, const Candidate& candidate,
                   const std::vector<int>& sets, bool priced, const Screen& screen) {
  std::vector<std::size_t> order(candidate.forms.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  if (order.size() > 2 * kFitted) {
    std::vector<std::array<double, 2>> gain;
    for (const Form& f : candidate.forms) gain.push_back(screen.gain(bank, f));
    const auto worth = [&](std::size_t k, std::size_t noise) {
      const double columns = static_cast<double>(candidate.forms[k].columns.size());
      return gain[k][noise] - (priced ? kPricePerColumn * columns : 0.0);
    };
    std::vector<std::size_t> kept;
    for (std::size_t noise = 0; noise < 2; ++noise) {
      const auto middle = order.begin() + static_cast<std::ptrdiff_t>(kFitted);
      std::partial_sort(order.begin(), middle, order.end(), [&](std::size_t x, std::size_t y) {
        return worth(x, noise) > worth(y, noise);
      });
      for (std::size_t k = 0; k < kFitted; ++k)
        if (std::find(kept.begin(), kept.end(), order[k]) == kept.end()) kept.push_back(order[k]);
    }
    order = std::move(kept);
  }
  std::vector<double> scores(order.size(), INFINITY);
  oneapi::tbb::parallel_for(std::size_t{0}, order.size(), [&](std::size_t k) {
    auto members = others;
    members.push_back({candidate.effect, candidate.forms[order[k]]});
    scores[k] = score_of(bank, members, sets, priced);
  });
  BestForm best;
  for (std::size_t k = 0; k < scores.size(); ++k)
    if (scores[k] < best.objective) best = {scores[k], order[k]};
  return best;
}

std::vector<Member> choose(Search& search, Bank& bank, std::vector<Ranked>& ranking,
                           const RunContext& run) {
  State best{{}, score_of(bank, {}, {kChoose}, true)};
  std::vector<State> beam{best};
  for (std::size_t step = 0; step < kMostCauses; ++step) {
    auto next = with_one_more(search, bank, beam, step == 0 ? &ranking : nullptr);
    if (run.stopped() || next.empty()) break;
    std::sort(next.begin(), next.end(),
              [](const State& a, const State& b) { return a.score < b.score; });
    // The same causes in another order are the same model.
    std::vector<State> kept;
    if (step == 0)
      std::sort(ranking.begin(), ranking.end(),
                [](const Ranked& a, const Ranked& b) { return a.gain > b.gain; });
    for (State& s : next) {
      if (kept.size() == kBeam) break;
      if (std::none_of(kept.begin(), kept.end(),
                       [&](const State& k) { return causes_of(k) == causes_of(s); }))
        kept.push_back(std::move(s));
    }
    // Refined forms become columns of the bank, and candidates for all that follow.
    std::vector<Column> added;
    const std::vector<State> unrefined = kept;
    for (std::size_t k = 0; k < kept.size(); ++k) {
      State& s = kept[k];
      const auto& before = unrefined[k].members.back().form.columns;
      if (s.score < unrefined.front().score + 1000.0) refine(search, bank, s, {kChoose});
      const auto& now = s.members.back().form.columns;
      // Of several borders the first may stay where it is.
      if (std::equal(now.begin(), now.end(), before.begin(), before.end(),
                     [](const Column& x, const Column& y) { return x.key == y.key; }))
        continue;
      added.insert(added.end(), now.begin(), now.end());
      offer(search, s.members.back());
    }
    add_columns(bank, search.observations, added);
    for (std::size_t k = 0; k < kept.size(); ++k) {
      kept[k].score = score_of(bank, kept[k].members, {kChoose}, true);
      // What is better at the noise of the form before may not be at its own.
      if (unrefined[k].score < kept[k].score) kept[k] = unrefined[k];
    }
    // Backward: what the newest has made superfluous goes.
    for (State& s : kept)
      for (std::size_t k = 0; k + 1 < s.members.size();) {
        auto fewer = without(s.members, k);
        const double score = score_of(bank, fewer, {kChoose}, true);
        if (score < s.score) {
          s.members = std::move(fewer);
          s.score = score;
        } else {
          ++k;
        }
      }
    std::sort(kept.begin(), kept.end(),
              [](const State& a, const State& b) { return a.score < b.score; });
    // The best again with other forms of its causes, now that it has them all.
    for (std::size_t k = 0; k < kept.front().members.size() && kept.front().members.size() > 1;
         ++k) {
      State& s = kept.front();
      const auto others = without(s.members, k);
      const auto same = candidate_of(search, s.members[k].effect);
      const BestForm found =
          best_form(bank, others, *same, {kChoose}, true, screen(bank, others, {kChoose}));
      if (!(found.objective < s.score)) continue;
      s.members[k].form = same->forms[found.form];
      s.score = found.objective;
    }
    const bool better = kept.front().score < best.score;
    if (better) best = kept.front();
    beam = std::move(kept);
    if (!better) break;
  }
  return best.members;
}

std::vector<Confirmed> confirm(const Bank& bank, std::vector<Member> members,
                               std::vector<Member> sharp, double level,
                               std::vector<Rejected>& rejected, const Settle& settle) {
  std::vector<Confirmed> good;
  while (!members.empty()) {
    good.clear();
    settle(sharp);
    const auto sharp_model = columns_of(bank, sharp);
    const Fit sharp_fit = fit(bank, sharp_model, kAll);
    std::vector<double> over;
    for (std::size_t k = 0; k < members.size(); ++k)
      over.push_back(overstated(bank, sharp_model, columns_of(bank, without(sharp, k)), sharp_fit));
    settle(members);
    const auto model = columns_of(bank, members);
    const double full = fit(bank, model, {kConfirm}).objective;
    const Fit chosen = fit(bank, model, {kChoose});
    const double predicted =
        objective_held(bank, model, chosen.coefficients, bank.nuisances, {kConfirm});
    const double both = fit(bank, model, {kChoose, kConfirm}).objective;
    const Fit whole = fit(bank, model, kAll);
    std::size_t worst = 0;
    double worst_p = 0.0, least = INFINITY;
    std::string why;
    for (std::size_t k = 0; k < members.size(); ++k) {
      const auto fewer = without(members, k);
      const auto small = columns_of(bank, fewer);
      settle(members);
      double gain = fit(bank, small, {kConfirm}).objective - full;
      // What is missed by far to first order need not be cut anew.
      if (gain < kFar) {
        settle(fewer);
        gain = fit(bank, small, {kConfirm}).objective - full;
      }
      const int degrees = static_cast<int>(model.size() - small.size());
      double p = chi_squared_tail(gain / over[k], std::max(1, degrees));
      // Smooth noise that is the same in neighbouring blocks of two sets confirms nothing: what is
      // no evidence with its correlations over all sets is none.
      const double in_all = fit(bank, small, kAll).objective - whole.objective;
      p = std::fmax(p, chi_squared_tail(std::fmax(0.0, in_all) / over[k], std::max(1, degrees)));
      // The first third's coefficients, without this one's own refit, must predict the second.
      const Fit chosen_fewer = fit(bank, small, {kChoose});
      const double unaided =
          objective_held(bank, small, chosen_fewer.coefficients, bank.nuisances, {kConfirm});
      if (!(unaided - predicted > 0.5 * gain) || !(unaided - predicted > 0.0)) p = std::max(p, 0.5);
      good.push_back({members[k], p});
      worst_p = std::fmax(worst_p, p);
      // Of those that fail the one goes that is missed least: of two that stand for one cause, the
      // worse.
      const double missed =
          p < level ? INFINITY : fit(bank, small, {kChoose, kConfirm}).objective - both;
      if (missed < least) {
        least = missed;
        worst = k;
        why = fmt::format(
            "chosen on one third of the blocks; on the next it gains {:.1f} with {} parameters "
            "refitted, {:.1f} as it was fitted on the first; {:.1f} over all; {:.1f} times less "
            "for neighbouring cells that agree by themselves",
            gain, degrees, unaided - predicted, in_all, over[k]);
      }
    }
    if (worst_p < level) break;
    rejected.push_back({members[worst].effect->name, why});
    members = without(std::move(members), worst);
    sharp = without(std::move(sharp), worst);
    good.clear();
  }
  return good;
}

}  // namespace maquette::diagnosis::detail

// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_search.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "diagnosis/detail/model_search.hpp"
#include "diagnosis/detail/photo_standing.hpp"

namespace maquette::diagnosis::detail {
namespace {

constexpr std::size_t kMostCauses = 4, kRounds = 7;
/// Steps of Gauss and Newton in a trial.
constexpr int kTrialSteps = 3;
/// Candidates that are rendered: the best to first order.
constexpr std::size_t kRendered = 4;
/// And no farther from the best than that.
constexpr double kNear = 0.5;
/// Models whose scores differ by less than that of what the best one gains are close.
constexpr double kCloseScore = 0.05;

double price_of(const PhotoForm& form) {
  return kPricePerCause + kPricePerColumn * static_cast<double>(form.parameters.size());
}
double price_of(const PhotoMembers& members) {
  double sum = 0.0;
  for (const PhotoMember& m : members) sum += price_of(m.form);
  return sum;
}
/// Has a form all parameters of another?
bool has_all(const PhotoForm& form, const PhotoForm& other) {
  return std::all_of(other.parameters.begin(), other.parameters.end(), [&](const auto& p) {
    return std::any_of(form.parameters.begin(), form.parameters.end(),
                       [&](const PhotoParameter& q) { return q.key == p.key; });
  });
}

}  // namespace

PhotoSearch::PhotoSearch(PhotoFit& fit, const std::vector<PhotoCandidate>& candidates, double light)
    : fit_(fit), candidates_(candidates), light_(light) {
  for (const PhotoCandidate& c : candidates_)
    for (const PhotoForm& f : c.forms)
      for (const PhotoParameter& p : f.parameters) parameters_.push_back(&p);
}

std::vector<PhotoSearch::Trial> PhotoSearch::trials(const PhotoLinear& linear,
                                                    const PhotoMembers& members,
                                                    const std::vector<int>& sets) const {
  const Eigen::MatrixXd g = linear.sum(sets);
  const auto model = columns_of(linear, members);
  const double unit = fit_.noise.factor * fit_.noise.over;
  std::vector<Trial> all;
  for (std::size_t c = 0; c < candidates_.size(); ++c) {
    const auto mine = std::find_if(members.begin(), members.end(), [&](const PhotoMember& m) {
      return m.effect == candidates_[c].effect;
    });
    std::vector<Trial> best;
    for (std::size_t f = 0; f < candidates_[c].forms.size(); ++f) {
      const PhotoForm& form = candidates_[c].forms[f];
      std::vector<int> at = linear.of(form);
      double less = 0.0;
      if (mine != members.end()) {
        if (form.parameters.size() <= mine->form.parameters.size()) continue;
        const auto has = linear.of(mine->form);
        if (!std::all_of(has.begin(), has.end(),
                         [&](int k) { return std::find(at.begin(), at.end(), k) != at.end(); }))
          continue;
        std::erase_if(
            at, [&](int k) { return std::find(model.begin(), model.end(), k) != model.end(); });
        less = price_of(mine->form);
      }
      Eigen::VectorXd values;
      const double gain = gain_of(g, model, at, form.sign, &values) / unit;
      if (mine == members.end() && form.all_of_sign && (form.sign * values.array() < 0.0).any())
        continue;
      Trial t{c, f, gain - price_of(form) + less, gain, {}};
      if (mine == members.end()) t.values.assign(values.data(), values.data() + values.size());
      best.push_back(std::move(t));
    }
    std::sort(best.begin(), best.end(),
              [](const Trial& a, const Trial& b) { return a.score > b.score; });
    // The two best; of forms one of which has all that another has, one: else the same would be
    // rendered twice, and another law not at all.
    std::vector<Trial> kept;
    for (Trial& t : best) {
      if (kept.size() == 2) break;
      const PhotoForm& form = candidates_[c].forms[t.form];
      if (std::none_of(kept.begin(), kept.end(), [&](const Trial& k) {
            const PhotoForm& other = candidates_[c].forms[k.form];
            return has_all(form, other) || has_all(other, form);
          }))
        kept.push_back(std::move(t));
    }
    all.insert(all.end(), kept.begin(), kept.end());
  }
  std::sort(all.begin(), all.end(),
            [](const Trial& a, const Trial& b) { return a.score > b.score; });
  return all;
}

PhotoMembers PhotoSearch::with(const PhotoMembers& members, const Trial& t) {
  PhotoMembers model = members;
  const PhotoCandidate& c = candidates_[t.candidate];
  const PhotoForm& form = c.forms[t.form];
  PhotoMember added{c.effect, form, std::vector<double>(form.parameters.size(), 0.0)};
  const auto mine = std::find_if(model.begin(), model.end(),
                                 [&](const PhotoMember& m) { return m.effect == c.effect; });
  if (mine != model.end()) {
    for (std::size_t k = 0; k < form.parameters.size(); ++k)
      for (std::size_t i = 0; i < mine->form.parameters.size(); ++i)
        if (mine->form.parameters[i].key == form.parameters[k].key)
          added.values[k] = mine->values[i];
    *mine = std::move(added);
  } else {
    model.push_back(std::move(added));
  }
  return fit_.fitted(std::move(model), kTrialSteps);
}

double PhotoSearch::score(const PhotoMembers& members) {
  return fit_.objective(members, {kChoose}) + price_of(members);
}

double PhotoSearch::whole_score(const PhotoMembers& members) {
  return fit_.objective(fit_.about(members, parameters_of(members)), {kChoose}) + price_of(members);
}

bool PhotoSearch::too_small(const PhotoLinear& linear, PhotoMembers members,
                            PhotoMember added) const {
  if (!is_large_enough(fit_, added, 0.5)) return true;
  members.push_back(std::move(added));
  const std::size_t k = members.size() - 1;
  return moved_by(linear, members[k]) * own_share(linear, members, k) <
         0.5 * std::fmax(kPhotoFloor * light_, others_wrong(fit_, linear, members, k));
}

PhotoMembers PhotoSearch::best_of(const std::vector<Trial>& all, const PhotoLinear& linear,
                                  const PhotoMembers& members, double now) {
  std::vector<std::pair<double, PhotoMembers>> better;
  double least = now;
  std::size_t rendered = 0;
  for (const Trial& t : all) {
    if (rendered == kRendered || !(t.score > 0.0) || t.score < kNear * all.front().score) break;
    const PhotoCandidate& c = candidates_[t.candidate];
    if (!t.values.empty() && too_small(linear, members, {c.effect, c.forms[t.form], t.values}))
      continue;
    const bool grows = std::any_of(members.begin(), members.end(),
                                   [&](const PhotoMember& m) { return m.effect == c.effect; });
    if (members.size() == kMostCauses && !grows) continue;
    ++rendered;
    PhotoMembers model = with(members, t);
    const double s = score(model);
    least = std::fmin(least, s);
    if (s < now) better.emplace_back(s, std::move(model));
  }
  // Edges, and what they may be off by, were where the last model has them: close ones are
  // compared with their own.
  std::erase_if(better,
                [&](const auto& b) { return b.first > least + kCloseScore * (now - least); });
  if (better.size() > 1)
    for (auto& [s, model] : better) s = whole_score(model);
  if (better.empty()) return {};
  const auto best = std::min_element(
      better.begin(), better.end(), [](const auto& a, const auto& b) { return a.first < b.first; });
  return fit_.fitted(std::move(best->second));
}

PhotoMembers PhotoSearch::pruned(PhotoMembers members) {
  while (members.size() > 1) {
    const PhotoLinear linear = fit_.about(members, parameters_of(members));
    const Eigen::MatrixXd g = linear.sum({kChoose});
    std::size_t drop = members.size();
    double least = 0.0;
    for (std::size_t k = 0; k < members.size(); ++k) {
      const double worth = worth_of(fit_, g, linear, members, k) - price_of(members[k].form);
      if (worth < least) {
        least = worth;
        drop = k;
      }
    }
    if (drop == members.size()) break;
    members = fit_.fitted(without(std::move(members), drop));
  }
  return members;
}

PhotoMembers PhotoSearch::exchanged(PhotoMembers members, const RunContext& run) {
  double now = score(members);
  for (std::size_t k = 0; k < members.size() && !run.stopped(); ++k) {
    const PhotoMembers others = fit_.fitted(without(members, k));
    const auto all = trials(fit_.about(others, parameters_), others, {kChoose});
    std::size_t rendered = 0;
    for (const Trial& t : all) {
      if (rendered == 2 || t.score < kNear * all.front().score) break;
      const PhotoCandidate& c = candidates_[t.candidate];
      // Another law of the same cause may be the one, now that the others are known.
      if (std::any_of(others.begin(), others.end(),
                      [&](const PhotoMember& m) { return m.effect == c.effect; }) ||
          (members[k].effect == c.effect && members[k].form.law == c.forms[t.form].law))
        continue;
      ++rendered;
      PhotoMembers model = with(others, t);
      if (const double s = score(model); s < now - kPricePerCause) {
        now = s;
        members = std::move(model);
        break;
      }
    }
  }
  return members;
}

PhotoMembers PhotoSearch::blurred(const PhotoMembers& members, double now, const RunContext& run) {
  constexpr double kMuch = 0.1;  // of what is left: less is what slopes of another kind change
  const PhotoState unknown = fit_.state_of({});
  const auto defocus = std::ranges::find_if(
      candidates_, [](const PhotoCandidate& c) { return c.effect->name == "photo.defocus"; });
  if (defocus == candidates_.end() || members.empty() || members.size() == kMostCauses ||
      !same_sharpness(fit_.state_of(members), unknown))
    return {};
  // Its first form, the same blur everywhere, from none.
  const Trial none{static_cast<std::size_t>(defocus - candidates_.begin()), 0, 0.0, 0.0, {}};
  PhotoMembers best;
  Normals kind = fit_.normals;
  double least = (1.0 - kMuch) * now;
  for (const Normals each :
       {Normals::smooth, Normals::smoother, Normals::patches, Normals::facets}) {
    if (run.stopped()) break;
    fit_.normals = each;
    PhotoMembers model = with(members, none);
    if (const double s = score(model); s < least && model.back().values.front() > 0.0) {
      least = s;
      kind = each;
      best = std::move(model);
    }
  }
  fit_.normals = kind;
  return best.empty() ? best : fit_.fitted(std::move(best));
}

PhotoMembers PhotoSearch::choose(std::vector<Ranked>& ranking, const RunContext& run) {
  PhotoMembers members;
  bool in_part = true;
  fit_.look_at({kChoose});
  for (std::size_t round = 0; round < kRounds && !run.stopped(); ++round) {
    const PhotoLinear linear = fit_.about(members, parameters_);
    fit_.noise = fit_.noise_of(linear);
    const double now = fit_.objective(linear, {kChoose}) + price_of(members);
    const auto all = trials(linear, members, {kChoose});
    if (members.empty())
      for (const Trial& t : all)
        ranking.push_back({candidates_[t.candidate].effect->name,
                           candidates_[t.candidate].forms[t.form].law, t.score});
    PhotoMembers best = best_of(all, linear, members, now);
    if (best.empty()) best = blurred(members, now, run);
    if (best.empty()) break;
    // Between the choosing blocks nothing tells of a map's waves.
    if (in_part && std::any_of(best.begin(), best.end(),
                               [](const PhotoMember& m) { return is_map(m.form); })) {
      in_part = false;
      fit_.look_at({});
      for (PhotoMember& m : best)
        if (is_map(m.form)) std::fill(m.values.begin(), m.values.end(), 0.0);
      best = fit_.fitted(std::move(best));
    }
    best = pruned(std::move(best));
    // A displaced picture says little of what lies between nodes, a blurred one takes it for blur.
    const PhotoState unknown = fit_.state_of({});
    const auto displaces = [&](const PhotoMember& m) {
      const PhotoState state = fit_.state_of({m});
      return !same_places(state, unknown) || state.gamma != unknown.gamma;
    };
    const auto displacing = [&](const PhotoMembers& of) {
      return std::count_if(of.begin(), of.end(), displaces);
    };
    if (members.empty() || !same_sharpness(fit_.state_of(best), fit_.state_of(members)) ||
        displacing(best) > displacing(members)) {
      const Normals was = fit_.normals;
      PhotoMembers settled =
          fit_.settle_normals(best, !same_sharpness(fit_.state_of(best), unknown));
      if (fit_.normals != was) best = fit_.fitted(std::move(settled));
    }
    if (best.size() > 1) best = exchanged(std::move(best), run);
    // What comes in and drives out another must leave less than before, or it would go on so.
    const bool better = members.empty() || score(best) < now - 1.0;
    if (!better) break;
    members = std::move(best);
  }
  if (in_part) fit_.look_at({});
  fit_.noise = fit_.noise_of(fit_.about(members, parameters_));
  // Sizes with shadows and edges where this model has them.
  return fit_.fitted(std::move(members));
}

std::vector<std::string> PhotoSearch::equivalents(const PhotoMembers& members, std::size_t k,
                                                  double& gain, std::vector<Rejected>& ruled_out) {
  const double full = fit_.objective(members, kAll);
  const PhotoMembers others = fit_.fitted(without(members, k));
  const PhotoLinear linear = fit_.about(others, parameters_);
  const double missed = fit_.objective(linear, kAll);
  gain = missed - full;
  const double far = std::fmax(kEquivalent, 0.01 * gain);
  std::vector<std::string> names;
  std::vector<std::size_t> done;
  std::size_t rendered = 0;
  double own = 0.0;  // to first order
  const auto all = trials(linear, others, kAll);
  for (const Trial& t : all)
    if (candidates_[t.candidate].effect == members[k].effect) own = std::fmax(own, t.gain);
  for (const Trial& t : all) {
    const Effect* effect = candidates_[t.candidate].effect;
    if (effect == members[k].effect ||
        std::any_of(others.begin(), others.end(),
                    [&](const PhotoMember& m) { return m.effect == effect; }) ||
        std::find(done.begin(), done.end(), t.candidate) != done.end())
      continue;
    done.push_back(t.candidate);
    double worse = own - t.gain;
    if (t.gain > kNear * own && rendered < kRendered) {
      ++rendered;
      worse = fit_.objective(with(others, t), kAll) - full;
    }
    if (worse < far)
      names.push_back(effect->name);
    else if (t.gain > 20.0)
      ruled_out.push_back(
          {effect->name, fmt::format("in the place of {} it makes the data 10^{:.1f} times less "
                                     "likely",
                                     members[k].effect->name, worse / 4.605)});
  }
  return names;
}

}  // namespace maquette::diagnosis::detail

// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/choosing.hpp"
#include "diagnosis/detail/a_while.hpp"
#include "diagnosis/detail/drawn_behind.hpp"
#include "diagnosis/detail/forms.hpp"
#include "diagnosis/detail/steps.hpp"
#include "diagnosis/detail/wrong_signatures.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <string>
#include <utility>

namespace maquette::diagnosis::detail {
namespace {

/// A cause that explains this share of all that is explained is no error of the others' signatures.
constexpr double kMuch = 0.1;
/// In -2 log likelihood: what is missed by more to first order is missed cut anew, too.
constexpr double kClose = 500.0;
/// The same as a share of what a cause explains, or all causes; a rival within so much is near
/// whatever that is.
constexpr double kMissed = 0.7, kNear = 100.0;
/// Of what another cause explains beside a bending cutter the share that one which is drawn behind
/// may miss in its place: how its force goes with the chip is nobody's law.
constexpr double kOfAnother = 0.2;
/// Causes that are tried in the place of a chosen one, the closest to first order.
constexpr std::size_t kRivals = 3;
/// Of a lag and lost motion, or lost motion alone, made one after the other of the sizes that were
/// fitted last, until they change by no more than a fiftieth; sizes below the last are none.
constexpr int kSizeRounds = 6, kSizeRoundsToChoose = 3;
/// Ratios of sizes that are taken for one: while causes are still chosen, and for what is reported.
constexpr double kSameSize = 0.02, kSameAtLast = 0.005, kLeastSize_mm = 0.01;
/// Of choosing, cutting anew and pruning.
constexpr int kRounds = 4;
/// In -2 log likelihood, prices paid: what gains no more has sizes of a few standard errors, of
/// which second order is nothing. Most of it is noise, which nothing has to be cut anew for.
constexpr double kLittle = 25.0;

/// What a law may be wrong by, as a share of what it gains.
double law_error(const Member& member) {
  return std::pow(member.effect->signature_error, 2);
}

/// The same causes.
bool alike(const Members& a, const Members& b) {
  return a.size() == b.size() &&
         std::all_of(a.begin(), a.end(), [&](const Member& x) { return has(b, x.effect); });
}

/// For steps elsewhere, bands that begin where the program says: what the data show to first order
/// may be a pass beside a border.
std::optional<Candidate> bands_of_the_program(const Search& search, const Member& step) {
  if (!has_a_moment(step) || step.form.law == kBandsOfTheProgram) return std::nullopt;
  for (const Candidate& c : search.candidates) {
    Candidate bands{c.effect, {}};
    for (const Form& f : c.forms)
      if (f.law == kBandsOfTheProgram) bands.forms.push_back(f);
    if (!bands.forms.empty()) return bands;
  }
  return std::nullopt;
}

/// The causes closest to the k-th to first order, in its place.
Members rivals_of(const Members& with, std::size_t k, const Search& search, const Bank& bank,
                  Linearised& residuals) {
  const auto others = without(with, k);
  residuals.about(others);
  const double now = residuals.score_as_is(with), missed = residuals.score_as_is(others) - now,
               far = std::fmin(kClose, std::fmax(kNear, kMissed * missed));
  const Screen beside = screen(bank, others, {kChoose});
  std::vector<std::pair<double, Member>> rivals;
  const auto look_at = [&](const Candidate& other) {
    if (has(others, other.effect) || !may_join(others, other.effect)) return;
    const auto found = best_form(bank, others, other, {kChoose}, true, beside);
    if (found.objective < now + far)
      rivals.emplace_back(found.objective, Member{other.effect, other.forms[found.form]});
  };
  for (const Candidate& other : search.candidates)
    if (other.effect != with[k].effect) look_at(other);
  std::sort(rivals.begin(), rivals.end(),
            [](const auto& a, const auto& b) { return a.first < b.first; });
  rivals.resize(std::min(rivals.size(), kRivals));
  if (const auto bands = bands_of_the_program(search, with[k])) look_at(*bands);
  Members closest;
  for (auto& [score, member] : rivals) closest.push_back(std::move(member));
  return closest;
}

/// Steps so large that what passes do beside the border is not of first order, at the moments that
/// do best cut anew.
/// @param before  the last round's model, whose moments may do better
Members at_their_moments(Members with, const Members& before, const Search& search, Bank& bank,
                         Linearised& residuals, const RunContext& run) {
  for (std::size_t k = 0; k < with.size() && !run.stopped(); ++k) {
    if (!with[k].form.move_moment) continue;
    residuals.about_alone(with);
    const Fit f = residuals.fit_of(with);
    if (!is_large_step(bank, with, k, f)) continue;
    std::vector<Form> also;
    for (const Member& m : before)
      if (m.effect == with[k].effect && m.form.move_moment) also.push_back(m.form);
    // Among sums of these causes alone: in those of all candidates each moment that is tried would
    // be multiplied with a thousand columns.
    residuals.about_alone({});
    Bank sums = bank_beside(search, bank, f, with, {}, {kChoose});
    Linearised left = residuals.in_other_sums(sums);
    left.begin_at(with, f.coefficients);
    with = at_best_moments(std::move(with), k, also, search, sums, left, run,
                           [&](const Members& moved) { return left.score(moved); });
    left.about_alone({});  // the observations are those of `residuals`
    add_columns(bank, search.observations, with[k].form.columns);
  }
  residuals.about(with);
  return with;
}

/// Moments of steps along an axis, as shares of the program; none: it is something else.
std::vector<double> moments_along(int axis, const Form& form, const Scene& scene) {
  std::vector<double> moments;
  if (form.move_moment && form.columns[0].key.starts_with(fmt::format("step_{}", kAxisName[axis])))
    for (const auto& [name, minutes] : form.fixed) moments.push_back(minutes / scene.duration_min);
  return moments;
}

/// A step that lifts passes clear of what their neighbours leave (every other pass was cut before
/// it) leaves nothing of them: to first order another step, and a wave across passes. So each of
/// two moments is tried alone, cut anew, in place of all and beside the others.
Members of_one_step(const Members& with, const Search& search, Bank& bank, Linearised& residuals) {
  std::vector<Members> trials;
  for (std::size_t k = 0; k < with.size(); ++k)
    for (int axis = 0; axis < 3; ++axis) {
      const auto moments = moments_along(axis, with[k].form, residuals.scene());
      if (moments.size() != 2) continue;
      const auto& forms = candidate_of(search, with[k].effect)->forms;
      for (const int sign : {-1, 0, 1}) {
        const auto single = std::find_if(forms.begin(), forms.end(), [&](const Form& f) {
          return f.at_moment && f.sign == sign &&
                 moments_along(axis, f, residuals.scene()).size() == 1;
        });
        if (single == forms.end()) continue;
        for (const double moment : moments) {
          const Member alone{with[k].effect, single->at_moment(moment)};
          add_columns(bank, search.observations, alone.form.columns);
          trials.push_back({alone});
          if (with.size() == 1) continue;
          trials.push_back(with);
          trials.back()[k] = alone;
        }
      }
    }
  if (trials.empty()) return with;
  Members best = with;
  double least = residuals.score(with);
  for (Members& trial : trials)
    if (const double score = residuals.score(trial); score < least) {
      least = score;
      best = std::move(trial);
    }
  residuals.about(best);
  return best;
}

/// A spot that blurs leaves so much at every slope that no step stands out before it is taken off,
/// and what was chosen in place of the step hides it; and of two steps the larger hides the other.
/// So steps are looked for again in what the model leaves, and leaves without each of its members;
/// the sharpest that is new along each axis becomes a form of all causes that may be steps, alone
/// and beside the one that the model has along that axis.
void look_for_steps_beside(const Members& chosen, Search& search, Bank& bank,
                           Linearised& residuals) {
  constexpr double kSameMoment = 1.0 / 256;  // of the program; closer ones are found by refining
  const Scene& scene = residuals.scene();
  std::vector<Column> added;
  const auto add = [&](Candidate& c, Form form) {
    added.insert(added.end(), form.columns.begin(), form.columns.end());
    c.forms.push_back(std::move(form));
  };
  // Of a cause's steps along an axis to one side: a new one unless it has one there.
  const auto offer = [&](Candidate& c, int axis, int sign, double share) {
    std::optional<Form> fresh;
    for (const Form& f : c.forms) {
      const auto moments = moments_along(axis, f, scene);
      if (moments.size() != 1 || !f.at_moment || f.sign != sign) continue;
      if (f.finer && std::abs(moments[0] - share) < kSameMoment) return;
      if (!fresh) fresh = f.at_moment(share);
    }
    if (fresh) add(c, std::move(*fresh));
  };
  const auto offer_beside = [&](int axis, double one, double other) {
    for (Candidate& c : search.candidates)
      if (std::any_of(c.forms.begin(), c.forms.end(),
                      [&](const Form& f) { return moments_along(axis, f, scene).size() == 1; }))
        for (Form& f : refined_steps(axis, scene, {one, other})) add(c, std::move(f));
  };
  for (std::size_t k = 0; k <= chosen.size(); ++k) {
    const auto others = k < chosen.size() ? without(chosen, k) : chosen;
    residuals.about_alone(others);
    const auto left = residuals_of(search.observations, others, bank, residuals.fit_of(others));
    for (int axis = 0; axis < 3; ++axis) {
      const auto found = sharpest_steps(search.observations, left, search.layout, axis);
      if (found.empty()) continue;
      for (Candidate& c : search.candidates)
        for (const int sign : {-1, 0, 1}) offer(c, axis, sign, found[0]);
      for (const Member& m : others)
        if (const auto its = moments_along(axis, m.form, scene); its.size() == 1)
          offer_beside(axis, its[0], found[0]);
    }
  }
  add_columns(bank, search.observations, added);
  residuals.about(chosen);
}

/// Models of one member less, another of whose has another law: a wear whose tip was held beside a
/// step between two bands is one that is worn all round. No member alone leads there.
std::vector<Members> by_another_law(const Members& with, const Search& search, const Bank& bank,
                                    Linearised& residuals, double most) {
  std::vector<Members> models;
  for (std::size_t k = 0; k < with.size(); ++k)
    for (std::size_t j = k + 1; j < with.size(); ++j) {
      const Members others = without(without(with, j), k);
      residuals.about(others);
      const Screen beside = screen(bank, others, {kChoose});
      for (const std::size_t stays : {k, j}) {
        const auto same = candidate_of(search, with[stays].effect);
        const auto found = best_form(bank, others, *same, {kChoose}, true, beside);
        if (!(found.objective < most) || same->forms[found.form].law == with[stays].form.law)
          continue;
        models.push_back(others);
        models.back().push_back({same->effect, same->forms[found.form]});
      }
    }
  return models;
}

/// Is the force of a cutter that is drawn behind the feed one away from the wall wherever it goes,
/// and not too little of that? Else it stands for what lost motion does to ridges that a coat has
/// taken off.
bool pushes_away(const Bank& bank, const Members& with, const Fit& f) {
  constexpr double kOfBehind = 0.2;  // forces across a cutter's way are a third of that along it
  const auto model = columns_of(bank, with);
  for (const Member& m : with) {
    if (!is_drawn_behind(m.form)) continue;
    const auto size = [&](std::size_t k) {
      return f.coefficients(place_of(bank, model, m.form.columns[k]));
    };
    const double away = size(0), by_ramp = size(1), by_side = size(2), behind = size(3);
    return behind > 0.0 && away > kOfBehind * behind && std::hypot(by_ramp, by_side) < away;
  }
  return true;
}

/// A cutter that bends as one that is drawn behind the feed, too, and so without each of the
/// others: lost motion, or a spray from the side, may have stood for what that does.
std::vector<Members> as_drawn_behind(const Members& with, const Search& search, Bank& bank,
                                     Linearised& residuals) {
  const auto bends = std::ranges::find_if(
      with, [](const Member& m) { return m.effect->name == "tool.deflection"; });
  if (bends == with.end() || is_drawn_behind(bends->form)) return {};
  Members best;
  double least = INFINITY;
  for (const Form& form : drawn_behind(residuals.scene())) {
    add_columns(bank, search.observations, form.columns);
    Members instead = with;
    instead[static_cast<std::size_t>(bends - with.begin())].form = form;
    if (const double score = residuals.score(instead); score < least) {
      least = score;
      best = std::move(instead);
    }
  }
  if (best.empty()) return {};
  std::vector<Members> models{best};
  for (std::size_t k = 0; k < best.size(); ++k)
    if (!is_drawn_behind(best[k].form)) models.push_back(without(best, k));
  return models;
}

/// A lag and lost motion in plan together as a lag alone whose heights have another.
std::vector<Members> as_heights_ahead(const Members& with, const Search& search, Bank& bank,
                                      Linearised& residuals) {
  if (!follows_any(with, true) || !follows_any(with, false)) return {};
  residuals.about(with);
  std::vector<Members> models;
  const auto model = columns_of(bank, with);
  const Fit f = residuals.fit_of(with);
  const auto size = [&](const Member& m) {
    return size_mm(
        {*m.form.columns[0].follows, f.coefficients(place_of(bank, model, m.form.columns[0]))});
  };
  for (std::size_t k = 0; k < with.size(); ++k)
    for (std::size_t j = 0; j < with.size(); ++j) {
      const auto &lag = with[k].form.columns[0].follows, &slack = with[j].form.columns[0].follows;
      if (!lag || !lag->lag || !slack || slack->lag || slack->axis == 2) continue;
      const double lag_mm = size(with[k]), width_mm = size(with[j]);
      if (!(lag_mm > 0.0) || !(width_mm > 0.0)) continue;
      for (const double sign : {1.0, -1.0}) {
        Members alone = with;
        alone[k].form = heights_ahead(residuals.scene(), lag_mm, sign * 0.5 * width_mm);
        add_columns(bank, search.observations, alone[k].form.columns);
        models.push_back(without(alone, j));
      }
    }
  return models;
}

/// A member in whose place another cause, cut anew, does better, alone or without a third that only
/// made up for the member, was only found first.
Members exchanged(Members with, Search& search, Bank& bank, Linearised& residuals,
                  const RunContext& run) {
  const double null = residuals.score({});
  for (int round = 0; round < kRounds && !run.stopped(); ++round) {
    double best = residuals.score(with);
    Members better;
    const auto try_it = [&](Members instead, double price) {
      if (const double s = residuals.score(instead) + price; s < best) {
        best = s;
        better = std::move(instead);
      }
    };
    for (std::size_t k = 0; k < with.size() && !run.stopped(); ++k)
      for (const Member& rival : rivals_of(with, k, search, bank, residuals)) {
        // That steps are where the program says needs no evidence.
        const double price =
            has_a_moment(with[k]) && rival.form.law == kBandsOfTheProgram ? 0.0 : kPricePerCause;
        auto instead = with;
        instead[k] = rival;
        try_it(instead, price);
        for (std::size_t j = 0; j < with.size(); ++j) {
          if (j == k) continue;
          residuals.about(instead);
          auto fewer = without(instead, j);
          if (residuals.score_as_is(fewer) + price < best + kClose) try_it(std::move(fewer), price);
        }
      }
    // Of one cause less much may be missed to first order: a warm-up in two bands, of which the
    // first is cold, had an edge of 0.1 mm where the ball of one reaches over to the other.
    const double missed = std::fmax(kClose, kMissed * (null - best));
    for (Members& fewer : by_another_law(with, search, bank, residuals, best + missed)) {
      const double now = residuals.score(fewer), most = law_error(fewer.back()) * (null - now);
      const double owed = now - most < best ? owed_to_its_law(fewer, residuals) : 0.0;
      try_it(std::move(fewer), -owed);
    }
    for (Members& instead : as_drawn_behind(with, search, bank, residuals)) {
      residuals.about_alone(instead);
      if (!pushes_away(bank, instead, residuals.fit_of(instead))) continue;
      double owed = 0.0;
      for (std::size_t k = 0; k < with.size(); ++k)
        if (!has(instead, with[k].effect))
          owed = kOfAnother *
                 std::fmax(0.0, residuals.score(without(with, k)) - residuals.score(with));
      try_it(std::move(instead), -owed);
    }
    for (Members& alone : as_heights_ahead(with, search, bank, residuals))
      try_it(std::move(alone), -kPricePerCause);
    if (better.empty()) break;
    with = polished(search, bank, std::move(better), residuals.settle());
  }
  residuals.about(with);
  return with;
}

/// Members without which the rest, cut anew, does as well: straightened residuals favour what they
/// were straightened for.
Members pruned(Members with, const Search& search, Bank& bank, Linearised& residuals,
               const RunContext& run) {
  const double null = residuals.score({}), null_left = residuals.left_by({});
  while (!with.empty() && !run.stopped()) {
    const double all = residuals.score(with), left = residuals.left_by(with);
    if (!std::isfinite(all)) {
      // Cut anew two that fit against each other grow beyond belief: without the one that is missed
      // least.
      std::size_t least_missed = with.size() - 1;
      double best = INFINITY;
      for (std::size_t k = 0; k < with.size(); ++k)
        if (const double s = residuals.score(without(with, k)); s < best) {
          best = s;
          least_missed = k;
        }
      with = without(with, least_missed);
      continue;
    }
    double least = 0.0;
    std::size_t drop = with.size();
    // Without one, to first order: only those that are missed little are cut anew.
    std::vector<double> missed;
    for (std::size_t k = 0; k < with.size(); ++k)
      missed.push_back(residuals.score_as_is(without(with, k)) - all);
    for (std::size_t k = 0; k < with.size(); ++k) {
      if (missed[k] > kClose + 0.25 * std::fmax(0.0, null - all)) continue;
      const auto others = without(with, k);
      const double gain = residuals.score(others) - all, of_all = std::fmax(0.0, null - all);
      double price = wrong_share(with, missed, k) * of_all;
      if (!(gain - price < least)) continue;
      // What moves much is not what another's signature is wrong by, however well that one shows
      // (a warp beside chatter): it need not earn the share of the gain.
      if (residuals.left_by(others) - left > kMuch * (null_left - left))
        price = 0.0;
      else if (gain > 0.0)
        price = wrong_share_like(k, with, missed, search, bank, residuals, {kChoose}) * of_all;
      if (!(gain - price < least)) continue;
      least = gain - price;
      drop = k;
    }
    if (drop == with.size()) break;
    with = without(with, drop);
  }
  residuals.about(with);
  return with;
}

/// Forms that are made of a size made anew of the one that fits.
/// @param make  Form::of_size or at_size
/// @param same  logarithm of a ratio below which the form stays
/// @return whether any has changed
bool resize(Members& now, const Search& search, Bank& bank, const Linearised& residuals,
            std::function<Form(double)> Form::*make, double same) {
  const auto model = columns_of(bank, now);
  const Fit f = residuals.fit_of(now);
  bool moved = false;
  for (Member& k : now) {
    const auto what = k.form.columns[0].follows;
    const double made_of_mm = what ? what->size_mm : k.form.made_of_mm;
    if (made_of_mm == 0.0 || !(k.form.*make)) continue;
    const auto at = place_of(bank, model, k.form.columns[0]);
    const double size = what ? size_mm({*what, f.coefficients(at)}) : f.coefficients(at);
    const double ratio = size / made_of_mm;
    if (!(ratio > 0.0) || !(std::abs(size) > kLeastSize_mm) || std::abs(std::log(ratio)) < same)
      continue;
    moved = true;
    k.form = (k.form.*make)(size);
    k.form.before = {made_of_mm, f.coefficients(at)};
    add_columns(bank, search.observations, k.form.columns);
  }
  return moved;
}

/// Of a lag and lost motion in one machine sizes are what their forms are made of: what the two do
/// together hangs on both, and on which is nearer to the tool.
Members in_one_machine(const Members& start, const Search& search, Bank& bank,
                       Linearised& residuals, const RunContext& run) {
  if (!follows_any(start, true) || !follows_any(start, false)) return start;
  Members best = start;
  double least = INFINITY;
  bool order = residuals.lag_first();
  for (const bool lag_first : {true, false}) {
    residuals.take_order(lag_first);
    Members now = start;
    for (int round = 0; round < kSizeRounds && !run.stopped(); ++round) {
      if (const double s = residuals.score(now); s < least) {
        least = s;
        best = now;
        order = lag_first;
      }
      if (!resize(now, search, bank, residuals, &Form::of_size, kSameSize)) break;
    }
  }
  residuals.take_order(order);
  residuals.about(best);
  return best;
}

/// Forms of the sizes that fit, as long as these are believable: of two that fit against each other
/// sizes grow without end.
/// @param rounds  at most
/// @param same  as resize()
Members sized(Members now, const Search& search, Bank& bank, Linearised& residuals, int rounds,
              double same) {
  residuals.about(now);
  for (int round = 0; round < rounds; ++round) {
    Members next = now;
    if (!resize(next, search, bank, residuals, &Form::at_size, same)) break;
    if (!std::isfinite(residuals.score(next))) break;
    residuals.about(next);
    now = std::move(next);
  }
  residuals.about(now);
  return now;
}

}  // namespace

bool is_large_step(const Bank& bank, const Members& with, std::size_t k, const Fit& f) {
  constexpr double kLarge_mm = 0.12;
  const auto model = columns_of(bank, with);
  return std::ranges::any_of(with[k].form.columns, [&](const Column& c) {
    return std::abs(f.coefficients(place_of(bank, model, c))) > kLarge_mm;
  });
}

Members at_best_moments(Members with, std::size_t k, const std::vector<Form>& also,
                        const Search& search, Bank& bank, Linearised& residuals,
                        const RunContext& run, const std::function<double(const Members&)>& score) {
  constexpr double kFarthest = 1.0 / 128, kNearest = 1.0 / 4096;
  constexpr int kMoves = 4;  // at one distance
  double now = score(with);
  Eigen::VectorXd sizes = residuals.fit_of(with).coefficients;
  const auto better_as = [&](const std::optional<Form>& form) {
    if (!form || run.stopped()) return false;
    Members moved = with;
    moved[k].form = *form;
    add_columns(bank, search.observations, form->columns);
    // At another moment sizes are much the same: they are cut anew from there.
    if (moved[k].form.columns.size() == with[k].form.columns.size())
      residuals.begin_at(moved, sizes);
    const double s = score(moved);
    if (!(s < now)) return false;
    now = s;
    sizes = residuals.fit_of(moved).coefficients;
    with = std::move(moved);
    return true;
  };
  for (const Form& form : also) better_as(form);
  if (std::ranges::any_of(also, [&](const Form& f) { return f.law == with[k].form.law; }))
    return with;
  for (double d = kFarthest; d >= kNearest; d *= 0.5)
    for (std::size_t c = 0; c < with[k].form.columns.size(); ++c)
      for (const double later : {d, -d})
        for (int i = 0; i < kMoves && better_as(with[k].form.move_moment(c, later)); ++i) {
        }
  return with;
}

Members at_own_size(Members now, const Search& search, Bank& bank, Linearised& residuals) {
  return follows_any(now, true) && follows_any(now, false)
             ? now  // in_one_machine() has them
             : sized(std::move(now), search, bank, residuals, kSizeRounds, kSameAtLast);
}

double owed_to_its_law(const Members& with, Linearised& residuals) {
  const double now = residuals.score(with);
  return law_error(with.back()) *
         std::fmax(0.0, residuals.score(without(with, with.size() - 1)) - now);
}

bool has_a_moment(const Member& member) {
  return !member.form.fixed.empty() && member.form.fixed[0].first.starts_with("moment");
}

bool follows_any(const Members& members, bool lag) {
  return std::any_of(members.begin(), members.end(), [&](const Member& k) {
    const auto& what = k.form.columns[0].follows;
    return what && what->lag == lag;
  });
}

namespace {

/// What details are worth, from what a model leaves.
void weigh(Bank& bank, const Linearised& residuals, const Members& with) {
  bank.weight = effective_weights(bank, columns_of(bank, with), residuals.fit_of(with));
}

Members chosen_to_first_order(Search& search, Bank& bank, std::vector<Ranked>& ranking,
                              const RunContext& run) {
  ranking.clear();
  bank.tried = plain_thetas(search.layout.cell_mm).size();
  Members chosen = choose(search, bank, ranking, run);
  bank.tried = bank.theta.size();
  return chosen;
}

/// Cut anew, refined, dropped where not missed, changed for rivals that do better; again from
/// nothing with the residuals which that leaves, until the causes stay.
Members recut_until_they_stay(Members chosen, Search& search, Bank& bank, Linearised& residuals,
                              std::vector<Ranked>& ranking, const RunContext& run) {
  Members members, before;  // of the last round, and of the one before that
  std::vector<std::pair<Members, Members>> exchanges;  // what was exchanged, and what for
  for (int round = 0; round < kRounds; ++round) {
    if (round > 0) chosen = chosen_to_first_order(search, bank, ranking, run);
    if (chosen.empty() && members.empty()) break;
    residuals.look_at({kChoose});
    residuals.about(chosen);
    chosen = polished(search, bank, std::move(chosen), residuals.settle());
    if (round == 0 && residuals.scene().has_path) {
      residuals.look_at(kAll);
      look_for_steps_beside(chosen, search, bank, residuals);
      residuals.look_at({kChoose});
    }
    chosen = at_their_moments(std::move(chosen), members, search, bank, residuals, run);
    chosen = of_one_step(chosen, search, bank, residuals);
    chosen = lasting_a_while(std::move(chosen), search, bank, residuals, run);
    if (!follows_any(chosen, true))
      chosen = sized(std::move(chosen), search, bank, residuals, kSizeRoundsToChoose, kSameSize);
    if (round == 0) chosen = in_one_machine(chosen, search, bank, residuals, run);
    chosen = pruned(std::move(chosen), search, bank, residuals, run);
    const auto known =
        std::ranges::find_if(exchanges, [&](const auto& e) { return alike(e.first, chosen); });
    if (known != exchanges.end() && residuals.score(known->second) < residuals.score(chosen)) {
      chosen = known->second;
    } else if (round == 0 || !alike(chosen, members)) {
      // What is chosen again was exchanged in the last round.
      auto other = exchanged(chosen, search, bank, residuals, run);
      if (!alike(other, chosen)) other = pruned(std::move(other), search, bank, residuals, run);
      exchanges.emplace_back(std::move(chosen), other);
      chosen = std::move(other);
    }
    residuals.look_at(kAll);
    residuals.about(chosen);
    weigh(bank, residuals, chosen);
    const bool settled = round > 0 && alike(chosen, members);
    if (!settled && round > 1 && alike(chosen, before)) {
      // To and fro: with what was straightened for the one the other is chosen.
      if (residuals.score(chosen) < residuals.score(members)) members = std::move(chosen);
      break;
    }
    before = std::exchange(members, std::move(chosen));
    if (settled || run.stopped()) break;
  }
  members = in_one_machine(members, search, bank, residuals, run);
  return at_own_size(std::move(members), search, bank, residuals);
}

}  // namespace

Members choose_and_recut(Search& search, Bank& bank, Linearised& residuals,
                         std::vector<Ranked>& ranking, const RunContext& run) {
  weigh(bank, residuals, {});
  Members chosen = chosen_to_first_order(search, bank, ranking, run);
  if (chosen.empty()) return chosen;
  // Sizes that nobody would believe are no little gain: those are pruned below.
  const double gain = residuals.score_as_is({}) - residuals.score_as_is(chosen);
  if (std::isfinite(gain) && gain < kLittle) {
    residuals.about(chosen);
    return chosen;
  }
  return recut_until_they_stay(std::move(chosen), search, bank, residuals, ranking, run);
}

}  // namespace maquette::diagnosis::detail

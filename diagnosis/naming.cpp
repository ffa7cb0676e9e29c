// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <optional>

#include <fmt/format.h>
#include <fmt/ranges.h>
#include <oneapi/tbb/parallel_for.h>

#include "diagnosis/detail/choosing.hpp"
#include "diagnosis/detail/forms.hpp"
#include "diagnosis/detail/sizes.hpp"
#include "diagnosis/detail/standing.hpp"
#include "diagnosis/detail/wrong_signatures.hpp"

namespace maquette::diagnosis::detail {
namespace {

/// Or a hundredth of the gain: no data tell such causes apart honestly.
constexpr double kEquivalentShare = 0.01;
/// Two causes whose fits differ by less are not told apart: the simulation of what they differ in
/// (ridges, creases, the steepest slopes) is not better than that, mm rms.
constexpr double kTellApart_mm = 0.0015;
/// By how many standard errors more a rival has to leave.
constexpr double kErrors = 3.0;
/// A rival within this many times what is told apart to first order is cut anew.
constexpr double kCloseGain = 10.0, kCloseSquares = 4.0;
/// A cause that it looks like and that misses a smaller share of what it explains is refined.
constexpr double kCloseShare = 0.5;
/// A rival that gains less in an empty place is not worth a line.
constexpr double kWorthALine = 20.0;
/// A cause that explains less of the excess than this, and in whose place two others would do, is
/// not named: what several causes look like is also what the error of a large one looks like. (In
/// amplitude a quarter: signatures are better than that, see Effect::signature_error.)
constexpr double kVagueShare = 0.075;
constexpr std::size_t kVagueRivals = 2;
/// In -2 log likelihood: a rival closer than this is the same shape by another name (a part that
/// has grown, a range that is too long), no second shape.
constexpr double kSameShape = 0.5;
/// Standard errors from which on a size is not none.
constexpr double kSure = 4.0;
/// As many in its place make any cause nameless.
constexpr std::size_t kNameless = 8;

/// The model whose causes get names.
struct Model {
  const Members& members;
  Fit fit;
  std::vector<int> columns;
  Left left;
  double tell_apart_mm;
};

struct Scored {
  double objective, squares;
};
Scored scored(const Linearised& residuals, const Members& with) {
  return {residuals.fit_of(with).objective, residuals.left_by(with)};
}

struct Equivalents {
  std::vector<std::string> names;
  std::size_t shapes = 0;  ///< other than the member's own
};

/// An even film is part of one that is sprayed beside an even film. Cut anew: what the larger form
/// has beyond it takes what others are wrong by while they are linearised about another size.
bool is_part_of(const Form& part, const Form& whole) {
  return std::all_of(part.columns.begin(), part.columns.end(), [&](const Column& c) {
    return std::any_of(whole.columns.begin(), whole.columns.end(),
                       [&](const Column& w) { return w.key == c.key; });
  });
}

/// Of a member's columns those that may as well be none: a block bent along x, and along y by
/// nothing known, may be a guide of the x axis that is bent, beside what y has.
std::optional<Member> what_may_be_none(const Member& member, const std::vector<Estimate>& sizes) {
  Member may{member.effect, {member.form.law, {}}};
  for (std::size_t c = 0; c < sizes.size(); ++c)
    if (std::abs(sizes[c].value) < kSure * sizes[c].sigma)
      may.form.columns.push_back(member.form.columns[c]);
  if (may.form.columns.empty() || may.form.columns.size() == sizes.size()) return std::nullopt;
  return may;
}

/// A step is one whoever made it, a drive or a band that the program does not show.
bool says_the_same(const Member& member, const Effect* other) {
  return (member.effect->never_beside == other->name ||
          other->never_beside == member.effect->name) &&
         has_a_moment(member) && member.form.law != kBandsOfTheProgram &&
         member.form.columns.size() <= kMostLosses;
}

bool look_alike(const Effect* a, const Effect* b) {
  const auto lists = [](const Effect* of, const Effect* other) {
    return std::ranges::find(of->looks_like, other->name) != of->looks_like.end();
  };
  return lists(a, b) || lists(b, a);
}

/// The cause in the k-th place in that of its forms, refined, which leaves the least squares to
/// first order about the residuals as they are: where noise may be smooth, likelihoods hardly tell
/// laws of a drift from each other.
/// @param most  columns
std::optional<Member> by_squares(const Candidate& cause, Members with, std::size_t k,
                                 std::size_t most, const Search& search, Bank& bank,
                                 const Linearised& residuals) {
  double left = INFINITY;
  std::optional<Form> best;
  // The one that was best comes back among its finer neighbours, with a smaller step.
  const auto as_good = [&](const std::vector<Form>& forms) {
    bool any = false;
    for (const Form& f : forms) {
      if (f.columns.size() > most) continue;
      add_columns(bank, search.observations, f.columns);
      with[k] = {cause.effect, f};
      answer(bank, columns_of(bank, with));
      const double now = residuals.left_by(with);
      if (!(now <= left)) continue;
      left = now;
      best = f;
      any = true;
    }
    return any;
  };
  for (bool more = as_good(cause.forms); more;) more = best->finer && as_good(best->finer());
  return best ? std::optional(Member{cause.effect, *best}) : std::nullopt;
}

/// Its forms that are made of that size, of either sign. A film that lies in hollows as a smaller
/// ball would have cut them is not told from that ball by what it does to first order where a film
/// lies on slopes alone.
std::vector<Form> made_of(const Candidate& cause, double size_mm) {
  const auto form = std::ranges::find_if(
      cause.forms, [](const Form& f) { return f.made_of_mm != 0.0 && f.of_size; });
  if (size_mm == 0.0 || form == cause.forms.end()) return {};
  return {form->of_size(size_mm), form->of_size(-size_mm)};
}

/// What would do as well in the place of the k-th; what would not goes to `ruled_out`.
/// @param sizes  of the k-th
Equivalents equivalents_of(const Model& model, std::size_t k, const std::vector<Estimate>& sizes,
                           const Search& search, Bank& bank, Linearised& residuals,
                           std::vector<Rejected>& ruled_out) {
  const auto others = without(model.members, k);
  auto beside_it = others;
  if (const auto may = what_may_be_none(model.members[k], sizes)) beside_it.push_back(*may);
  residuals.about(others);
  const auto [missed, missed_squares] = scored(residuals, others);
  // Rivals are compared with the member as it is without its own second order, and where they come
  // close with that of each.
  const Scored linear = scored(residuals, model.members);
  const double far = std::fmax(kEquivalent, kEquivalentShare * (missed - model.fit.objective));
  const double far_squares = [&] {
    const double told = model.left.points * model.tell_apart_mm * model.tell_apart_mm;
    // What two models differ in by that leaves more squares by that and by noise.
    return told + kErrors * 2.0 * std::sqrt(told * model.left.squares / model.left.points);
  }();
  struct Worse {
    double objective, squares;
  };
  const auto worse_by = [&](const Members& with, const Member& other) {
    auto instead = with;
    instead.push_back(other);
    const Scored first = scored(residuals, instead);
    Worse worse{first.objective - linear.objective, first.squares - linear.squares};
    if (worse.objective < kCloseGain * far || worse.squares < kCloseSquares * far_squares ||
        is_part_of(other.form, model.members[k].form)) {
      residuals.about_alone(instead);
      const Scored anew = scored(residuals, instead);
      worse = {anew.objective - model.fit.objective, anew.squares - model.left.squares};
      residuals.about(others);
    }
    return worse;
  };
  const auto does_as_well = [&](const Worse& w) {
    return w.objective < far || w.squares < far_squares;
  };
  const Screen beside = screen(bank, others, kAll), beside_all = screen(bank, beside_it, kAll);
  const double made_of_mm = model.members[k].form.made_of_mm != 0.0 ? sizes[0].value : 0.0;
  Equivalents equivalent;
  const auto judge = [&](const Effect* other, const Worse& worse, double objective) {
    if (does_as_well(worse)) {
      equivalent.names.push_back(other->name);
      equivalent.shapes += std::abs(worse.objective) >= kSameShape;
    } else if (missed - objective > kWorthALine) {
      ruled_out.push_back(
          {other->name,
           fmt::format("in the place of {} it makes the data 10^{:.1f} times less likely",
                       model.members[k].effect->name, worse.objective / 4.605)});
    }
  };
  struct Coarse {
    const Candidate& rival;
    Worse worse;
    double objective;
  };
  std::vector<Coarse> coarse;
  for (const Candidate& other : search.candidates) {
    if (has(model.members, other.effect) || !may_join(others, other.effect)) continue;
    if (says_the_same(model.members[k], other.effect)) {
      equivalent.names.push_back(other.effect->name);
      continue;
    }
    const auto found = best_form(bank, others, other, kAll, false, beside);
    if (!std::isfinite(found.objective)) continue;
    Worse worse = worse_by(others, {other.effect, other.forms[found.form]});
    if (!does_as_well(worse) && beside_it.size() > others.size()) {
      const auto with = best_form(bank, beside_it, other, kAll, false, beside_all);
      if (std::isfinite(with.objective))
        worse = worse_by(beside_it, {other.effect, other.forms[with.form]});
    }
    if (!does_as_well(worse) && look_alike(other.effect, model.members[k].effect))
      for (const Form& form : made_of(other, made_of_mm)) {
        add_columns(bank, search.observations, form.columns);
        auto instead = others;
        instead.push_back({other.effect, form});
        answer(bank, columns_of(bank, instead));
        const Worse its = worse_by(others, instead.back());
        if (!does_as_well(its)) continue;
        worse = its;
        break;
      }
    const bool may_be_finer =
        std::ranges::any_of(other.forms, [](const Form& f) { return static_cast<bool>(f.finer); });
    if (!does_as_well(worse) && may_be_finer && look_alike(other.effect, model.members[k].effect) &&
        worse.squares < kCloseShare * (missed_squares - model.left.squares))
      coarse.push_back({other, worse, found.objective});
    else
      judge(other.effect, worse, found.objective);
  }
  for (const Coarse& c : coarse) {
    residuals.about(others);
    Members with = others;
    with.push_back({c.rival.effect, c.rival.forms[0]});
    const auto law = by_squares(c.rival, with, others.size(), SIZE_MAX, search, bank, residuals);
    const Worse worse = law ? worse_by(others, *law) : c.worse;
    judge(c.rival.effect, does_as_well(worse) ? worse : c.worse, c.objective);
  }
  return equivalent;
}

/// Of what is explained or structured, what each member explains.
std::vector<double> shares_of(const Model& model, Linearised& residuals) {
  std::vector<double> shares;
  for (std::size_t k = 0; k < model.members.size(); ++k) {
    const auto others = without(model.members, k);
    residuals.about(others);
    shares.push_back(
        std::clamp((residuals.left_by(others) - model.left.squares) / model.left.excess, 0.0, 1.0));
  }
  residuals.about(model.members);
  return shares;
}

/// @param shapes  of its equivalents, how many are other than its own
Cause cause_of(const Model& model, std::size_t k, std::vector<Estimate> sizes, double p_value,
               const Search& search, Bank& bank, Linearised& residuals,
               std::vector<Rejected>& ruled_out, std::size_t& shapes) {
  const Member& member = model.members[k];
  Cause c;
  c.effect = member.effect->name;
  c.law = member.form.law;
  c.fixed = member.form.fixed;
  if (const auto& what = member.form.columns[0].follows;
      what && !what->lag && follows_any(model.members, true))
    c.fixed.emplace_back(kSlackBehindLag, residuals.lag_first() ? 1.0 : 0.0);
  c.separate_by = member.effect->separate_by;
  c.p_value = std::fmax(p_value, 1e-300);
  auto equivalent = equivalents_of(model, k, sizes, search, bank, residuals, ruled_out);
  c.parameters = std::move(sizes);
  c.equivalent = std::move(equivalent.names);
  shapes = equivalent.shapes;
  return c;
}

/// A signature that was made of a size of one sign and fits with the other: that size came to rest
/// nowhere.
bool has_turned(const Bank& bank, const Model& model, const Member& m) {
  const Column& c = m.form.columns[0];
  return m.form.made_of_mm != 0.0 &&
         model.fit.coefficients(place_of(bank, model.columns, c)) * m.form.made_of_mm < 0.0;
}

/// Of causes that would do in the place of one that breaks its law the one that fits all blocks
/// best, better than that and as well those that confirm, and keeps to its own: where half of the
/// part is hidden, a sheared block of steep dunes looks like a scale on the blocks that choose.
/// @param explained  squares that are missed without the k-th
std::optional<Member> that_keeps_its_law(std::size_t k, const Members& members,
                                         const std::vector<std::string>& equivalent,
                                         double explained, const Search& search, Bank& bank,
                                         Linearised& residuals) {
  const auto others = without(members, k);
  residuals.about(members);
  double least = residuals.fit_of(members).objective;
  const double most = fit(bank, columns_of(bank, members), {kConfirm}).objective + kEquivalent;
  residuals.about(others);
  const Screen beside = screen(bank, others, kAll);
  std::optional<Member> best;
  for (const std::string& name : equivalent) {
    const auto other = candidate_of(search, find_effect(name));
    if (other == search.candidates.end() || !has_exact_law(*other->effect)) continue;
    residuals.about(others);
    const auto found = best_form(bank, others, *other, kAll, false, beside);
    if (!std::isfinite(found.objective)) continue;
    Members instead = members;
    instead[k] = {other->effect, other->forms[found.form]};
    residuals.about(instead);
    const Fit f = residuals.fit_of(instead);
    if (!(f.objective < least) || !believable(bank, instead, f) ||
        !(fit(bank, columns_of(bank, instead), {kConfirm}).objective < most) ||
        breaks_its_law(k, instead, explained, search, bank, residuals))
      continue;
    least = f.objective;
    best = instead[k];
  }
  residuals.about(members);
  return best;
}

/// The smallest of those that no name is certain enough for; causes.size(): none.
/// @param wrong  share of the k-th that may be what the others' signatures are wrong by
template <class Wrong>
std::size_t nameless(const std::vector<Cause>& causes, const std::vector<std::size_t>& shapes,
                     const Wrong& wrong) {
  std::size_t drop = causes.size();
  double least = INFINITY;
  for (std::size_t k = 0; k < causes.size(); ++k) {
    const Cause& c = causes[k];
    const bool small = causes.size() > 1 && c.share < kVagueShare &&
                       (shapes[k] >= kVagueRivals || c.share < wrong(k));
    if ((small || c.equivalent.size() >= kNameless) && c.share < least) {
      least = c.share;
      drop = k;
    }
  }
  return drop;
}

}  // namespace

void make_plain(const Search& search, const Bank& bank, Linearised& residuals,
                std::vector<Confirmed>& confirmed) {
  for (std::size_t k = 0; k < confirmed.size(); ++k) {
    const Members members = members_of(confirmed);
    const Form& form = members[k].form;
    if (form.columns.size() < 2) continue;
    residuals.about(members);
    const auto sizes = sizes_of(search, bank, members, residuals.fit_of(members), k);
    std::vector<std::size_t> sure;
    for (std::size_t c = 0; c < sizes.size(); ++c)
      if (!(std::abs(sizes[c].value) < kSure * sizes[c].sigma)) sure.push_back(c);
    const auto is_plainer = [&](const Form& f) {
      return f.columns.size() < form.columns.size() && is_part_of(f, form) &&
             std::all_of(sure.begin(), sure.end(), [&](std::size_t c) {
               return std::any_of(f.columns.begin(), f.columns.end(),
                                  [&](const Column& of) { return of.key == form.columns[c].key; });
             });
    };
    // The same law of that size without what it may as well not have.
    if (const auto& what = form.columns[0].follows) {
      const auto own = candidate_of(search, members[k].effect);
      const auto simple = std::ranges::find_if(own->forms, [&](const Form& f) {
        return f.of_size && is_plainer(f.of_size(what->size_mm));
      });
      if (simple != own->forms.end()) {
        confirmed[k].member.form = simple->of_size(what->size_mm);
        continue;
      }
    }
    for (const Candidate& other : search.candidates) {
      if (has(members, other.effect)) continue;
      std::optional<Form> plain;
      for (const Form& f : other.forms) {
        if (plain) break;
        if (is_plainer(f)) plain = f;
        // A border that was refined beside another is a step that nobody has looked at alone.
        if (!plain && sure.size() == 1 && f.at_moment && has_a_moment(members[k]))
          if (Form step = f.at_moment(form.fixed[sure[0]].second / residuals.scene().duration_min);
              is_plainer(step))
            plain = std::move(step);
      }
      if (!plain) continue;
      confirmed[k].member = {other.effect, *plain};
      // The others' forms were found beside what is none.
      for (std::size_t j = 0; j < confirmed.size(); ++j) {
        if (j == k) continue;
        const Members now = members_of(confirmed), others = without(now, j);
        const auto same = candidate_of(search, now[j].effect);
        residuals.about(now);
        const BestForm found =
            best_form(bank, others, *same, {kChoose}, true, screen(bank, others, {kChoose}));
        if (!std::isfinite(found.objective)) continue;
        Members instead = now;
        instead[j].form = same->forms[found.form];
        if (residuals.score(instead) < residuals.score(now))
          confirmed[j].member.form = instead[j].form;
      }
      break;
    }
  }
  residuals.about(members_of(confirmed));
}

void prefer_few_parameters(const Search& search, Bank& bank, Linearised& residuals,
                           std::vector<Confirmed>& confirmed) {
  constexpr std::size_t kFewer = 3;  // times
  for (std::size_t k = 0; k < confirmed.size(); ++k) {
    const Members members = members_of(confirmed), others = without(members, k);
    if (members[k].form.columns.size() < kFewer) continue;
    residuals.about(members);
    double points = 0.0;
    const double squares = residuals.left_by(members, &points);
    residuals.about(others);
    const double explained = residuals.left_by(others) - squares;
    double least = points * kTellApart_mm * kTellApart_mm;
    for (const Candidate& other : search.candidates) {
      if (has(members, other.effect) || !may_join(others, other.effect) ||
          !look_alike(other.effect, members[k].effect))
        continue;
      residuals.about(others);
      const auto law = by_squares(other, members, k, members[k].form.columns.size() / kFewer,
                                  search, bank, residuals);
      if (!law) continue;
      Members instead = members;
      instead[k] = *law;
      residuals.about(instead);
      const double more = residuals.left_by(instead) - squares,
                   error = other.effect->signature_error;
      if (!(more < least) || !(more < error * error * explained) ||
          !believable(bank, instead, residuals.fit_of(instead)))
        continue;
      least = more;
      confirmed[k].member = instead[k];
      confirmed[k].by_squares = true;
    }
  }
  residuals.about(members_of(confirmed));
}

void prefer_poses_as_given(const Search& search, const Bank& bank, Linearised& residuals,
                           const std::function<double(const Fit&)>& shift_mm,
                           std::vector<Confirmed>& confirmed) {
  constexpr double kShift_mm = 0.03;  // registration is rarely better
  constexpr double kLess = 1.0 / 3.0, kLessToFirstOrder = 2.0 / 3.0;
  // What a shift costs in -2 log likelihood: Student's t of that scale, three degrees of freedom,
  // for a scan may have been moved for once.
  const auto unlikely = [](double mm) {
    return 4.0 * std::log1p(mm * mm / (3.0 * kShift_mm * kShift_mm));
  };
  // The report blocks say nothing about names.
  const std::vector<int> sets{kChoose, kConfirm};
  for (std::size_t k = 0; k < confirmed.size(); ++k) {
    const Members members = members_of(confirmed);
    residuals.about(members);
    const auto objective = [&](const Members& with) {
      return fit(bank, columns_of(bank, with), sets).objective + price(bank, with);
    };
    const double moved = shift_mm(residuals.fit_of(members));
    if (!(moved > kShift_mm)) break;  // of all members together
    double best = objective(members) + kEquivalent + unlikely(moved);
    const auto others = without(members, k);
    residuals.about(others);
    const double linear = objective(members);
    const Screen beside = screen(bank, others, sets);
    const auto try_it = [&](const Member& other) {
      auto instead = others;
      instead.insert(instead.begin() + static_cast<std::ptrdiff_t>(k), other);
      if (!(shift_mm(residuals.fit_of(instead)) < kLessToFirstOrder * moved)) return;
      residuals.about_alone(instead);
      const double its_shift = shift_mm(residuals.fit_of(instead));
      if (const double its = objective(instead) + unlikely(its_shift);
          its < best && its_shift < kLess * moved) {
        best = its;
        confirmed[k].member = other;
      }
      residuals.about(others);
    };
    const double at_most = linear + kCloseGain * kEquivalent + unlikely(moved);
    for (const Candidate& other : search.candidates) {
      if (has(others, other.effect) || !may_join(others, other.effect)) continue;
      if (other.effect != members[k].effect) {
        const auto found = best_form(bank, others, other, sets, true, beside);
        if (found.objective < at_most) try_it({other.effect, other.forms[found.form]});
        continue;
      }
      // A circle read wrong twice a turn is over a tenth of a turn as one read wrong once, but for
      // where it puts the scan.
      for (const Form& form : other.forms) {
        auto instead = others;
        instead.push_back({other.effect, form});
        if (form.law != members[k].form.law && objective(instead) < at_most) try_it(instead.back());
      }
    }
  }
  residuals.about(members_of(confirmed));
}

double name_causes(const Search& search, Bank& bank, Linearised& residuals, double null_squares,
                   std::vector<Confirmed>& confirmed, Members& doubtful, Diagnosis& d) {
  std::size_t stood = confirmed.size();
  double vague = 0.0;
  // What is there under no name: others' rivals are not those that would be this.
  Members unnamed;
  // Sizes that forms are made of were found beside it.
  const auto take_out = [&](std::size_t k) {
    confirmed.erase(confirmed.begin() + static_cast<std::ptrdiff_t>(k));
    const Members rest = at_own_size(members_of(confirmed), search, bank, residuals);
    for (std::size_t j = 0; j < rest.size(); ++j) confirmed[j].member = rest[j];
  };
  while (true) {
    const Members members = members_of(confirmed);
    residuals.about(members);
    Model model{members, residuals.fit_of(members), columns_of(bank, members),
                left_of(residuals, members, null_squares, d.remainder), 0.0};
    // Names hang on differences between fits: those must stand out of what nothing explains.
    const auto shares = shares_of(model, residuals);
    model.tell_apart_mm =
        std::max({kTellApart_mm, d.remainder.found ? d.remainder.structured_rms : 0.0,
                  std::sqrt(wrong_share(members, shares, members.size())) * model.left.moved_mm});
    Members all = members;
    for (const Member& m : unnamed)
      if (may_join(all, m.effect)) all.push_back(m);
    residuals.about(all);
    const Model whole{all, residuals.fit_of(all), columns_of(bank, all),
                      left_of(residuals, all, null_squares, d.remainder), model.tell_apart_mm};
    residuals.about(members);
    std::vector<Cause> causes;
    std::vector<std::size_t> shapes(members.size());
    std::vector<Rejected> ruled_out;
    std::vector<std::vector<Estimate>> sizes;
    for (std::size_t k = 0; k < members.size(); ++k)
      sizes.push_back(sizes_of(search, bank, members, model.fit, k));
    for (std::size_t k = 0; k < members.size(); ++k) {
      causes.push_back(cause_of(whole, k, std::move(sizes[k]), confirmed[k].p_value, search, bank,
                                residuals, ruled_out, shapes[k]));
      causes.back().share = shares[k];
    }
    residuals.about(members);
    constexpr double kBeyond = 3.0;  // standard errors
    const auto beyond_belief = static_cast<std::size_t>(
        std::find_if(members.begin(), members.end(),
                     [&](const Member& m) {
                       return !believable(bank, model.columns, m, model.fit, kBeyond) ||
                              has_turned(bank, model, m);
                     }) -
        members.begin());
    if (beyond_belief < members.size()) {
      const Cause& c = causes[beyond_belief];
      vague += c.share;
      d.rejected.push_back({c.effect, fmt::format("its size is not to be believed: {} = {:.4g}",
                                                  c.parameters[0].name, c.parameters[0].value)});
      confirmed.erase(confirmed.begin() + static_cast<std::ptrdiff_t>(beyond_belief));
      continue;
    }
    // One that is named is there, and a cause that has a law keeps to it.
    std::size_t none = members.size();
    std::string why;
    double least_sure = kSure;
    for (std::size_t k = 0; k < members.size(); ++k) {
      const Estimate& size = causes[k].parameters[0];
      if (causes[k].parameters.size() != 1) continue;
      if (const double sure = sureness(bank, members, model.fit, k); sure < least_sure) {
        least_sure = sure;
        none = k;
        why = fmt::format("beside the others it may as well be none: {} = {:.3g}, known to {:.2g}",
                          size.name, size.value, size.sigma);
      }
    }
    if (none < members.size()) {
      doubtful.push_back(members[none]);
    } else {
      for (std::size_t k = 0; k < members.size() && none == members.size(); ++k)
        if (breaks_its_law(k, members, shares[k] * model.left.excess, search, bank, residuals))
          none = k;
      if (none < members.size()) {
        why = "what looks like it changes over the part or with height, as it does not";
        if (const auto other =
                that_keeps_its_law(none, members, causes[none].equivalent,
                                   shares[none] * model.left.excess, search, bank, residuals)) {
          d.rejected.push_back({causes[none].effect, std::move(why)});
          confirmed[none].member = *other;
          continue;
        }
        vague += causes[none].share;
        unnamed.push_back(members[none]);
      }
    }
    if (none < members.size()) {
      d.rejected.push_back({causes[none].effect, std::move(why)});
      take_out(none);
      continue;
    }
    const auto wrong = [&](std::size_t k) {
      const double most = wrong_share(members, shares, k);
      return shares[k] < most ? wrong_share_like(k, members, shares, search, bank, residuals, kAll)
                              : most;
    };
    const std::size_t drop = nameless(causes, shapes, wrong);
    if (drop == members.size()) {
      if (members.size() < stood) {
        // What those without a name explained is explained by nothing now, and others stand beside
        // it or do not.
        const bool found = d.remainder.found;
        const Members also = keep_what_stands(search, bank, residuals, null_squares, confirmed, d);
        doubtful.insert(doubtful.end(), also.begin(), also.end());
        stood = confirmed.size();
        if (stood < members.size() || d.remainder.found != found) continue;
      }
      d.causes = std::move(causes);
      d.rejected.insert(d.rejected.end(), ruled_out.begin(), ruled_out.end());
      break;
    }
    const Cause& c = causes[drop];
    doubtful.push_back(members[drop]);
    const bool several = shapes[drop] >= kVagueRivals;
    if (several) {
      vague += c.share;
      unnamed.push_back(members[drop]);
    }
    d.rejected.push_back(
        {c.effect,
         several ? fmt::format("small beside the others ({:.1f} % of the excess), and other causes "
                               "would do in its place: {}",
                               100.0 * c.share, fmt::join(c.equivalent, ", "))
                 : "smaller than what the signatures of the others may be wrong by"});
    take_out(drop);
  }
  return vague;
}

}  // namespace maquette::diagnosis::detail

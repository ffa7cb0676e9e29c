// SPDX-License-Identifier: GPL-3.0-or-later

// What extended.toml has added to the model, as functions of an observation; taken off residuals.

#include <algorithm>
#include <cmath>
#include <optional>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include "diagnosis/case_input.hpp"
#include "diagnosis/detail/a_while.hpp"
#include "diagnosis/detail/drawn_behind.hpp"
#include "diagnosis/detail/lag_and_slack.hpp"
#include "diagnosis/detail/levelled_changes.hpp"
#include "diagnosis/detail/with_slope.hpp"
#include "diagnosis/diagnose.hpp"
#include "diagnosis/effect.hpp"
#include "diagnosis/extended_model.hpp"

namespace maquette::diagnosis {
namespace {

double distance(const Form& f, const KnownCause& k) {
  double sum = 0.0;
  for (const auto& [name, value] : f.fixed)
    for (const auto& [other, wanted] : k.fixed)
      if (name == other) sum += std::abs(value - wanted);
  return sum;
}

/// The form of that law; a refined one is reached through its neighbours, closest first; where no
/// law is named so (a cause that only poses show), the first with these parameters.
std::optional<Form> closest(const Effect& effect, const Scene& scene, const KnownCause& k) {
  if (!effect.forms) return std::nullopt;
  auto forms = effect.forms(scene);
  if (effect.name == "tool.deflection")
    for (Form& f : detail::drawn_behind(scene)) forms.push_back(std::move(f));
  const auto fits = [&](const Form& f) {
    if (f.columns.size() != k.parameters.size()) return false;
    for (std::size_t c = 0; c < f.columns.size(); ++c)
      if (f.columns[c].parameter.name != k.parameters[c].first) return false;
    // What a law has beside its parameters tells it from others, unless the file has none of it.
    return k.fixed.empty() || std::ranges::all_of(f.fixed, [&](const auto& its) {
             return std::ranges::any_of(
                 k.fixed, [&](const auto& known) { return known.first == its.first; });
           });
  };
  const auto ends = detail::ends_of(k.fixed, scene.duration_min);
  const auto as_long = [&](const Form& f) {
    return ends && f.during ? f.during((*ends)[0], (*ends)[1]) : f;
  };
  const auto has_its_law = [&](const Form& f) {
    return f.law == k.law || (ends && f.during && k.law.starts_with(f.law + ", from "));
  };
  for (int depth = 0; depth < 8 && !forms.empty(); ++depth) {
    const Form* best = nullptr;
    for (const Form& f : forms) {
      if (has_its_law(f)) return as_long(f);
      if (!fits(f) || (!k.fixed.empty() && f.fixed.empty())) continue;
      if (best == nullptr || distance(f, k) < distance(*best, k)) best = &f;
    }
    if (best == nullptr) return std::nullopt;
    // Causes whose signature hangs on their size are made of any.
    for (const auto& [name, size_mm] : k.fixed)
      if (best->of_size && !best->fixed.empty() && name == best->fixed[0].first &&
          size_mm * (best->sign < 0 ? -1.0 : 1.0) > 0.0)
        return best->of_size(size_mm);
    if (!best->finer || k.fixed.empty() || (ends && best->during)) return as_long(*best);
    forms = best->finer();
  }
  return std::nullopt;
}

}  // namespace

KnownCause as_known(const Cause& cause) {
  KnownCause known{cause.effect, cause.law, {}, cause.fixed};
  for (const Estimate& e : cause.parameters) known.parameters.emplace_back(e.name, e.value);
  return known;
}

std::vector<Vec3> centres_of(const Measurements& m) {
  std::vector<Vec3> centres;
  for (const SetUp& s : m.set_ups) centres.push_back(s.centre_mm);
  return centres;
}

Result<std::vector<KnownTerm>> restore(const std::vector<KnownCause>& causes, const Scene& of,
                                       const std::vector<Vec3>& centres) {
  std::vector<KnownTerm> terms;
  std::vector<detail::FollowedTerm> followed;
  detail::LagAndSlack both(of);
  for (const KnownCause& k : causes) {
    const Effect* effect = find_effect(k.effect);
    if (effect == nullptr)
      return fail(kUnknownCause, fmt::format("[[cause]] effect = \"{}\": the library has no such "
                                             "cause; names are those of diagnosis.json",
                                             k.effect));
    // No point of the ground moves by them.
    if (effect->needs == Needs::photograph || effect->needs == Needs::stones) continue;
    const auto value = [&](const std::string& name) {
      for (const auto& [n, v] : k.parameters)
        if (n == name) return v;
      return 0.0;
    };
    if (k.effect == "tool.length_offset") {
      terms.push_back(
          {value("offset_mm"), [](const Observation& o) { return o.along.z; }, false, {}});
      continue;
    }
    if (k.effect == "scanner.registration") {
      const auto scan = static_cast<std::uint32_t>(k.fixed.empty() ? 0.0 : k.fixed[0].second - 1.0);
      if (scan >= centres.size())
        return fail(kUnknownCause, "[[cause]] scanner.registration names a scan that is not there");
      const Vec3 shift{value("shift_x_mm"), value("shift_y_mm"), value("shift_z_mm")};
      const Vec3 turn{value("turn_x_urad"), value("turn_y_urad"), value("turn_z_urad")};
      terms.push_back({1.0,
                       [=, centre = centres[scan]](const Observation& o) {
                         return o.set_up != scan
                                    ? 0.0
                                    : dot(level_along(o),
                                          shift + cross(1e-6 * turn, o.place - centre));
                       },
                       true,
                       {}});
      continue;
    }
    Scene scene = of;
    for (const auto& [name, v] : k.fixed)
      if (name.starts_with("moment_") && scene.duration_min > 0.0) {
        for (auto& steps : scene.steps) steps.push_back(v / scene.duration_min);
      } else if (name == "wavelength_mm" && v > 0.0) {
        // Waves are candidates where the data show them; here the file does.
        scene.waves_x.push_back(2.0 * scene.half_mm() / v);
        scene.waves_y.push_back(2.0 * scene.half_mm() / v);
        PathWave wave{scene.cut_mm / v};
        for (const auto& [other, number] : k.fixed) {
          if (other == "rapid_share") wave.rapid_share = number;
          if (other == "waves_a_stop") wave.at_stops = number;
        }
        scene.waves_path.push_back(wave);
        scene.slow_waves_x.push_back(2.0 * scene.half_mm() / v);
        scene.slow_waves_y.push_back(2.0 * scene.half_mm() / v);
      }
    KnownCause curve = k;
    const bool slopes = k.law.ends_with(detail::kWithSlope) && !k.parameters.empty();
    if (slopes) {
      curve.law.resize(k.law.size() - std::string_view(detail::kWithSlope).size());
      curve.parameters.pop_back();
    }
    auto form = closest(*effect, scene, curve);
    if (form && slopes) form = detail::with_slope(*form, scene);
    if (!form)
      return fail(kUnknownCause, fmt::format("[[cause]] {}: no law \"{}\" with {} parameters{}",
                                             k.effect, k.law, k.parameters.size(),
                                             effect->needs == Needs::path && !scene.has_path
                                                 ? "; it needs the program (gcode)"
                                                 : ""));
    for (const auto& [name, v] : k.fixed)
      if (name == detail::kSlackBehindLag) both.lag_first = v != 0.0;
    for (std::size_t c = 0; c < std::min(form->columns.size(), k.parameters.size()); ++c) {
      const double coefficient = k.parameters[c].second / form->columns[c].parameter.per_column;
      if (const auto& what = form->columns[c].follows) followed.push_back({*what, coefficient});
      terms.push_back({coefficient, form->columns[c].value, effect->acts_on == "scanner",
                       form->columns[c].cut, form->columns[c].levels});
    }
  }
  for (auto& change : both.changes(followed))
    terms.push_back({1.0, [](const Observation&) { return 0.0; }, false,
                     [change = std::move(change)](const Observation&, const CutState& s, Vec3) {
                       return change(s);
                     }});
  return terms;
}

double moved_mm(const Observation& o, const std::vector<KnownTerm>& terms, double ball_radius_mm) {
  double sum = 0.0;
  bool cut = false;
  for (const KnownTerm& t : terms) {
    cut |= static_cast<bool>(t.cut);
    if (!t.cut) sum += t.coefficient * t.value(o);
  }
  if (!cut) return sum;
  return sum + recut_mm(o, ball_radius_mm, [&](const CutState& s, Vec3 n) {
           CutChange together;
           for (const KnownTerm& t : terms)
             if (t.cut) together += t.coefficient * t.cut(o, s, n);
           return together;
         });
}

std::vector<double> moved_mm(const std::vector<Observation>& all,
                             const std::vector<KnownTerm>& terms, double ball_radius_mm) {
  std::vector<double> moved(all.size());
  oneapi::tbb::parallel_for(std::size_t{0}, all.size(), [&](std::size_t i) {
    moved[i] = moved_mm(all[i], terms, ball_radius_mm);
  });
  std::vector<detail::LevellingTerm> means;
  for (const KnownTerm& t : terms)
    if (t.levels)
      means.push_back({*t.levels, t.coefficient,
                       [&](std::size_t i) { return t.coefficient * t.value(all[i]); }});
  if (means.empty() || means.size() == terms.size()) return moved;
  std::vector<double> change = moved;
  for (std::size_t i = 0; i < all.size(); ++i)
    for (const auto& mean : means) change[i] -= mean.moved_mm(i);
  detail::add_levelled(all, std::move(change), means, moved);
  return moved;
}

Result<void> take_off(const std::vector<KnownCause>& known, Measurements& m) {
  MAQUETTE_TRY(const auto terms, restore(known, m.scene, centres_of(m)));
  const auto moved = moved_mm(m.observations, terms, m.scene.ball_radius_mm);
  for (std::size_t i = 0; i < moved.size(); ++i) m.observations[i].residual_mm -= moved[i];
  return {};
}

}  // namespace maquette::diagnosis

// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detectability.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/chi_squared.hpp"
#include "diagnosis/detail/forms.hpp"
#include "diagnosis/detail/model_search.hpp"
#include "diagnosis/detail/squares.hpp"
#include "diagnosis/detail/standing.hpp"
#include "diagnosis/diagnose.hpp"

namespace maquette::diagnosis {
namespace {

using detail::Bank;
using detail::Candidate;
using detail::Fit;

constexpr double kNinety = 1.28;       // standard deviations that 90 % exceed, one-sided
constexpr std::size_t kSome = 40'000;  // points that further stations are tried with

/// Information on a column in one set, per unit of its coefficient.
double information(const Bank& bank, const Form& form, std::size_t k, const Fit& fit, int set) {
  auto model = detail::columns_of(bank, {});
  for (std::size_t i = 0; i < form.columns.size(); ++i)
    if (i != k) model.push_back(bank.index.at(form.columns[i].key));
  return detail::beside(bank, model, fit, bank.index.at(form.columns[k].key), {set}).information;
}

/// Smallest coefficient of a column that is chosen and confirmed with 90 %.
double smallest(const Bank& bank, const Form& form, std::size_t k, const Fit& fit) {
  const double price =
      detail::kPricePerCause + detail::kPricePerColumn * static_cast<double>(form.columns.size());
  // Two-sided tail of a normal deviate at the level of one claim.
  double confirm = 0.0;
  while (chi_squared_tail(confirm * confirm, static_cast<int>(form.columns.size())) >
         detail::kConfirmLevel)
    confirm += 0.01;
  return std::fmax(
      (std::sqrt(price) + kNinety) / std::sqrt(information(bank, form, k, fit, detail::kChoose)),
      (confirm + kNinety) / std::sqrt(information(bank, form, k, fit, detail::kConfirm)));
}

/// Of all forms and columns of a cause the one that is found smallest, in mm of signature.
Detectable best_of(const Bank& bank, const Candidate& candidate, const Fit& fit) {
  Detectable best{candidate.effect->name, "", "", INFINITY, INFINITY};
  for (const Form& form : candidate.forms)
    for (std::size_t k = 0; k < form.columns.size(); ++k) {
      const double c = smallest(bank, form, k, fit);
      const double rms = c * detail::rms_beside_nuisances(bank, bank.index.at(form.columns[k].key));
      const Parameter& p = form.columns[k].parameter;
      if (!(rms < best.rms_mm) || c * std::abs(p.per_column) > p.plausible) continue;
      best = {candidate.effect->name, form.law, p.name, c * std::abs(p.per_column), rms};
    }
  return best;
}

Vec3 turned(Vec3 about, Vec3 station, double degrees) {
  const double a = degrees * 3.14159265358979323846 / 180.0, c = std::cos(a), s = std::sin(a);
  const Vec3 v = station - about;
  return about + Vec3{c * v.x - s * v.y, s * v.x + c * v.y, v.z};
}

}  // namespace

Result<Detectability> detectability(const Measurements& m, std::uint64_t seed,
                                    const RunContext& run) {
  Detectability d;
  auto layout = detail::lay_out(m.scene.box, seed, !m.scene.section_starts.empty());
  const auto candidates = detail::candidates_of(m.scene, d.untestable);
  const auto columns = detail::all_columns(candidates);
  const auto nuisances = detail::nuisances_of(m);
  layout.smooth = detail::smooth_law(detail::sum_up(m.observations, nuisances, {}, layout), layout);
  Bank bank = detail::sum_up(m.observations, nuisances, columns, layout);
  const auto model = detail::columns_of(bank, {});
  bank.weight = detail::effective_weights(bank, model, detail::fit(bank, model, detail::kAll));
  const Fit fit = detail::fit(bank, model, detail::kAll);
  if (run.stopped()) return fail(kCancelled, "detectability was cancelled");
  run.progress(0.5);
  // What has no plausible size that would be found (or no wave to look for) cannot be tested.
  for (const Candidate& c : candidates) {
    Detectable e = best_of(bank, c, fit);
    if (std::isfinite(e.rms_mm))
      d.effects.push_back(std::move(e));
    else
      d.untestable.push_back(e.effect);
  }

  // Further stations: fewer points, the same noise.
  const auto first = std::find(m.scene.has_station.begin(), m.scene.has_station.end(), true);
  if (first == m.scene.has_station.end()) return d;
  const Vec3 station =
      m.scene.stations[static_cast<std::size_t>(first - m.scene.has_station.begin())];
  const std::size_t every = std::max<std::size_t>(1, m.observations.size() / kSome);
  Measurements few = m;
  few.observations.clear();
  for (std::size_t i = 0; i < m.observations.size(); i += every)
    few.observations.push_back(m.observations[i]);
  std::vector<detail::Theta> theta{detail::Theta{}};
  Fit noise = fit;
  for (std::size_t u = 0; u < detail::kTops; ++u) {
    detail::Theta t = bank.theta[static_cast<std::size_t>(fit.theta[u])];
    t.ratio /= static_cast<double>(every);
    theta.push_back(t);
    noise.theta[u] = static_cast<int>(u) + 1;
    noise.top_variance[u] *= static_cast<double>(every);
  }
  const auto sizes = [&](const Measurements& with) {
    Bank small =
        detail::sum_up(with.observations, detail::nuisances_of(with), columns, layout, &theta);
    small.weight = bank.weight;
    std::vector<double> rms;
    for (const Candidate& c : candidates) rms.push_back(best_of(small, c, noise).rms_mm);
    return rms;
  };
  const auto now = sizes(few);
  for (const double degrees : {0.0, 90.0, 180.0, 270.0}) {
    if (run.stopped()) return fail(kCancelled, "detectability was cancelled");
    Measurements more = few;
    ExtraStation extra;
    extra.station_mm = turned(m.scene.centre(), station, degrees);
    extra.where = degrees == 0.0 ? "the first station again"
                                 : fmt::format("{:.0f} degrees on from the first", degrees);
    const auto index = static_cast<std::uint32_t>(m.set_ups.size());
    more.set_ups.push_back(m.set_ups[0]);
    more.scene.stations.push_back(extra.station_mm);
    more.scene.has_station.push_back(true);
    const std::size_t own = few.observations.size() / m.set_ups.size();
    for (std::size_t i = 0, n = 0; i < few.observations.size() && n < own; ++i) {
      Observation o = few.observations[i * 7919 % few.observations.size()];
      if (!o.on_surface) continue;
      const Vec3 v = o.place - extra.station_mm;
      o.range_mm = norm(v);
      o.beam = (1.0 / o.range_mm) * v;
      if (!(-dot(o.beam, o.normal) > 0.15)) continue;
      o.has_station = true;
      o.set_up = index;
      more.observations.push_back(std::move(o));
      ++n;
    }
    const auto then = sizes(more);
    double sum = 0.0, count = 0.0;
    for (std::size_t k = 0; k < then.size(); ++k) {
      if (!std::isfinite(now[k]) || !std::isfinite(then[k])) continue;
      const double factor = now[k] / then[k];
      sum += std::log(factor);
      count += 1.0;
      if (factor >= 1.2) extra.better.emplace_back(candidates[k].effect->name, factor);
    }
    extra.mean_factor = count > 0.0 ? std::exp(sum / count) : 1.0;
    std::sort(extra.better.begin(), extra.better.end(),
              [](const auto& a, const auto& b) { return a.second > b.second; });
    d.stations.push_back(std::move(extra));
  }
  std::sort(d.stations.begin(), d.stations.end(), [](const ExtraStation& a, const ExtraStation& b) {
    return a.mean_factor > b.mean_factor;
  });
  run.progress(1.0);
  return d;
}

std::string to_json(const Detectability& d) {
  using nlohmann::ordered_json;
  ordered_json j;
  j["schema"] = "maquette.detectability/1";
  j["found_with"] = 0.9;
  j["effects"] = ordered_json::array();
  for (const Detectable& e : d.effects)
    j["effects"].push_back({{"effect", e.effect},
                            {"law", e.law},
                            {"parameter", e.parameter},
                            {"smallest", e.smallest},
                            {"rms_mm", e.rms_mm}});
  j["another_station"] = ordered_json::array();
  for (const ExtraStation& s : d.stations) {
    ordered_json better = ordered_json::object();
    for (const auto& [effect, factor] : s.better) better[effect] = factor;
    j["another_station"].push_back(
        {{"where", s.where},
         {"scanner_position_mm", {s.station_mm.x, s.station_mm.y, s.station_mm.z}},
         {"mean_factor", s.mean_factor},
         {"better_by", better}});
  }
  j["cannot_be_tested"] = d.untestable;
  return j.dump(1);
}

}  // namespace maquette::diagnosis

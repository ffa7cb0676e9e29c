// SPDX-License-Identifier: GPL-3.0-or-later
#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "diagnosis/diagnose.hpp"

namespace maquette::diagnosis {

std::string to_json(const Diagnosis& d) {
  using nlohmann::ordered_json;
  const auto vector = [](Vec3 v) { return ordered_json::array({v.x, v.y, v.z}); };
  ordered_json j;
  j["schema"] = "maquette.diagnosis/1";
  j["verdict"] = d.verdict;
  j["causes"] = ordered_json::array();
  for (const Cause& c : d.causes) {
    ordered_json parameters = ordered_json::object();
    for (const Estimate& p : c.parameters)
      parameters[p.name] = {{"value", p.value}, {"sigma", p.sigma}};
    ordered_json fixed = ordered_json::object();
    for (const auto& [name, value] : c.fixed) fixed[name] = value;
    j["causes"].push_back({{"effect", c.effect},
                           {"law", c.law},
                           {"parameters", parameters},
                           {"fixed_by_law", fixed},
                           {"share_of_excess_variance", c.share},
                           {"p_value", c.p_value},
                           {"equivalent", c.equivalent},
                           {"separate_by", c.separate_by}});
  }
  j["gain"] = {{"rms_before", d.rms_before},
               {"rms_after", d.rms_after},
               {"rms_expected_from_noise", d.rms_noise},
               {"n_confirm", d.n_report},
               {"data", "blocks never used for the choice"}};
  for (const Diagnosis::HeldOut& h : d.held_out)
    j["held_out"].push_back({{"image", h.image},
                             {"mean_absolute_difference_before_255", h.before},
                             {"mean_absolute_difference_after_255", h.after},
                             {"from_noise_255", h.noise}});
  j["residual_after"] = {{"morans_i", d.remainder.morans_i},
                         {"p_white", d.remainder.p_white},
                         {"unexplained_share", d.remainder.found ? d.remainder.share : 0.0},
                         {"unexplained_kinds", d.remainder.kinds},
                         {d.unit == "mm" ? "unexplained_rms_mm" : "unexplained_rms",
                          d.remainder.found ? d.remainder.structured_rms : 0.0}};
  if (d.unit == "mm") {
    j["residual_after"]["smooth_noise_mm"] = d.remainder.smooth_mm;
    j["residual_after"]["smooth_noise_length_mm"] = d.remainder.smooth_length_mm;
  }
  j["unit"] = d.unit;
  j["contact"] = d.contact == MadeBy::tip ? "tip" : "ball";
  j["extended_model"] = "extended.toml";
  j["poses"] = ordered_json::array();
  for (const PoseEstimate& p : d.poses)
    j["poses"].push_back({{"points", p.set_up},
                          {"shift_mm", vector(p.shift_mm)},
                          {"shift_sigma_mm", vector(p.shift_sigma_mm)},
                          {"turn_urad", vector(p.turn_urad)},
                          {"turn_sigma_urad", vector(p.turn_sigma_urad)}});
  j["ruled_out"] = ordered_json::array();
  for (const Rejected& r : d.rejected)
    j["ruled_out"].push_back({{"effect", r.effect}, {"why", r.why}});
  j["ranking"] = ordered_json::array();
  for (const Ranked& r : d.ranking)
    j["ranking"].push_back({{"effect", r.effect}, {"law", r.law}, {"gain", r.gain}});
  j["cannot_be_tested"] = d.untestable;
  if (d.controls) {
    const Controls& c = *d.controls;
    ordered_json back = ordered_json::array();
    for (const Controls::Recovery& r : c.recoveries) {
      ordered_json sizes = ordered_json::object();
      for (const auto& s : r.sizes)
        sizes[s.parameter] = {{"injected", s.injected}, {"found", s.found}, {"sigma", s.sigma}};
      back.push_back({{"effect", r.effect}, {"named_as", r.named_as}, {"parameters", sizes}});
    }
    j["controls"] = {{"passed", c.passed()},
                     {"points", c.points},
                     {"null", {{"verdict", c.null_verdict}, {"claims", c.null_claims}}},
                     {"recovery", back},
                     {"false_claims", c.false_claims}};
  }
  if (d.stones) {
    const StoneReport& s = *d.stones;
    ordered_json states = ordered_json::array();
    for (const auto& [number, state] : s.states)
      states.push_back({{"stone", number}, {"state", state}});
    j["stones"] = {{"states", states}, {"unexplained", s.unexplained}};
    if (s.points > 0)
      j["stones"]["gain"] = {{"rms_before_mm", s.rms_before},
                             {"rms_after_mm", s.rms_after},
                             {"rms_expected_from_noise_mm", s.rms_noise},
                             {"points", s.points},
                             {"data", "every second patch of a millimetre, not fitted to"}};
  }
  j["notes"] = d.notes;
  return j.dump(1);
}

std::string extension_toml(const Diagnosis& d) {
  std::string text = "\n# What the diagnosis has added to the model.\n";
  for (const Cause& c : d.causes) {
    text += fmt::format("\n[[cause]]\neffect = \"{}\"\nlaw = \"{}\"\n", c.effect, c.law);
    if (d.contact == MadeBy::tip) text += "contact = \"tip\"\n";
    std::vector<std::pair<std::string, double>> values = c.raw;
    if (values.empty())
      for (const Estimate& p : c.parameters) values.emplace_back(p.name, p.value);
    for (std::size_t k = 0; k < values.size(); ++k)
      text += fmt::format("{}{}{}", k == 0 ? "names = [\"" : ", \"", values[k].first,
                          k + 1 == values.size() ? "\"]\n" : "\"");
    for (std::size_t k = 0; k < values.size(); ++k)
      text += fmt::format("{}{}{}", k == 0 ? "values = [" : ", ", values[k].second,
                          k + 1 == values.size() ? "]\n" : "");
    for (std::size_t k = 0; k < c.fixed.size(); ++k)
      text += fmt::format("{}{}{}", k == 0 ? "fixed_names = [\"" : ", \"", c.fixed[k].first,
                          k + 1 == c.fixed.size() ? "\"]\n" : "\"");
    for (std::size_t k = 0; k < c.fixed.size(); ++k)
      text += fmt::format("{}{}{}", k == 0 ? "fixed_values = [" : ", ", c.fixed[k].second,
                          k + 1 == c.fixed.size() ? "]\n" : "");
  }
  return text;
}

}  // namespace maquette::diagnosis

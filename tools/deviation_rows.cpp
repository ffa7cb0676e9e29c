// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/deviation_rows.hpp"

#include <numbers>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

namespace maquette::tools {
using nlohmann::json;
namespace {

constexpr double kDegrees = 180.0 / std::numbers::pi;

/// Why nothing more is said of a stone; empty where a pose is stated.
std::string reason_of(const scan::StoneFinding& f, double beam_mm) {
  using scan::StoneState;
  const std::string beam =
      beam_mm > 0.5 * f.width_mm
          ? fmt::format("; the beam of {:.2g} mm blurs a stone of {:.2g} mm", beam_mm, f.width_mm)
          : "";
  switch (f.state) {
    case StoneState::unseen:
      return fmt::format("{} points over its middle, at least {} are needed", f.over,
                         scan::kLeastOverStone) +
             beam;
    case StoneState::present:
    case StoneState::unclear:
      if (f.points < scan::kLeastOnStone)
        return fmt::format("{} points stand above the ground, a pose needs at least {}", f.points,
                           scan::kLeastOnStone) +
               beam;
      return fmt::format("no pose of a planned stone fits: residuals of {:.2g} mm", f.noise_mm) +
             beam;
    default:
      return {};
  }
}

}  // namespace

json registration_row(const scan::Registration& r, const std::string& name) {
  return {{"points", name},
          {"iterations", r.iterations},
          {"rms_before_mm", r.rms_before_mm},
          {"rms_after_mm", r.rms_after_mm},
          {"noise_mm", r.noise_mm},
          {"overlap", r.overlap},
          {"likeness", r.likeness},
          {"found_anywhere", r.found_anywhere},
          {"effective_points", r.effective_points},
          {"scale", r.scale},
          {"sigma_scale", r.sigma_scale},
          {"sigma_translation_mm", r.sigma_translation_mm},
          {"sigma_rotation_rad", r.sigma_rotation_rad},
          {"free_directions", r.free_directions}};
}

json datum_row(const scan::DatumRegistration& on, const scan::Absorbed& a,
               const std::string& name) {
  json fits = json::array();
  for (const scan::DatumFit& f : on.datums)
    fits.push_back(
        {{"name", f.name}, {"points", f.points}, {"mean_mm", f.mean_mm}, {"noise_mm", f.noise_mm}});
  return {{"points", name},
          {"absorbed_mean_mm", a.mean_mm},
          {"absorbed_sigma_mm", a.sigma_mm},
          {"absorbed_rms_mm", a.rms_mm},
          {"absorbed_min_mm", a.min_mm},
          {"absorbed_max_mm", a.max_mm},
          {"sigma_translation_mm", on.registration.sigma_translation_mm},
          {"sigma_rotation_rad", on.registration.sigma_rotation_rad},
          {"free_directions", on.registration.free_directions},
          {"fits", fits}};
}

json sphere_row(const scan::SphereMatch& m, std::size_t found, const std::string& name) {
  json residuals = json::array();
  for (std::size_t k = 0; k < m.matched.size(); ++k)
    residuals.push_back({{"name", m.matched[k]}, {"off_mm", m.residual_mm[k]}});
  return {{"points", name},
          {"found", found},
          {"matched", m.matched},
          {"missing", m.missing},
          {"rms_mm", m.registration.rms_after_mm},
          {"sigma_translation_mm", m.registration.sigma_translation_mm},
          {"sigma_rotation_rad", m.registration.sigma_rotation_rad},
          {"residuals", residuals}};
}

json findings_json(const scan::Significance& s) {
  json rows = json::array();
  for (const scan::Finding& f : s.findings) {
    if (rows.size() == 500) break;
    rows.push_back({{"x_mm", f.centre_mm.x},
                    {"y_mm", f.centre_mm.y},
                    {"height_mm", f.height_mm},
                    {"sigma_height_mm", f.sigma_height_mm},
                    {"along_z_mm", f.along_z_mm},
                    {"whole_part", f.whole_part},
                    {"diameter_mm", f.diameter_mm},
                    {"sigma_diameter_mm", f.sigma_diameter_mm},
                    {"length_mm", f.length_mm},
                    {"width_mm", f.width_mm},
                    {"area_mm2", f.area_mm2},
                    {"volume_mm3", f.volume_mm3},
                    {"sigma_volume_mm3", f.sigma_volume_mm3},
                    {"certainty", f.certainty},
                    {"cell_mm", f.cell_mm}});
  }
  return rows;
}

json limits_json(const scan::Significance& s) {
  json rows = json::array();
  for (const scan::DetectionLimit& l : s.limits)
    rows.push_back({{"width_mm", l.width_mm}, {"height_mm", l.height_mm}, {"points", l.points}});
  return rows;
}

json stones_json(const std::vector<scan::StoneFinding>& stones, double beam_mm) {
  json rows = json::array();
  for (const scan::StoneFinding& f : stones) {
    json row = {{"number", f.number},     {"state", scan::name_of(f.state)},
                {"points", f.points},     {"points_over_middle", f.over},
                {"width_mm", f.width_mm}, {"height_share", f.height_share}};
    if (const std::string reason = reason_of(f, beam_mm); !reason.empty()) row["reason"] = reason;
    if (f.state == scan::StoneState::swapped) row["carries"] = f.carries;
    if (f.state == scan::StoneState::as_planned || f.state == scan::StoneState::moved) {
      row["shift_mm"] = {f.shift_mm.x, f.shift_mm.y, f.shift_mm.z};
      row["sigma_shift_mm"] = {f.sigma_shift_mm.x, f.sigma_shift_mm.y, f.sigma_shift_mm.z};
      row["turn_deg"] = kDegrees * f.turn_rad;
      row["sigma_turn_deg"] = kDegrees * f.sigma_turn_rad;
      row["tilt_deg"] = kDegrees * f.tilt_rad;
      row["sigma_tilt_deg"] = kDegrees * f.sigma_tilt_rad;
      row["chance"] = f.chance;
    }
    rows.push_back(row);
  }
  return rows;
}

json objects_json(const std::vector<scan::ExtraObject>& objects) {
  json rows = json::array();
  for (const scan::ExtraObject& o : objects) {
    json row = {{"x_mm", o.centre_mm.x},
                {"y_mm", o.centre_mm.y},
                {"z_mm", o.centre_mm.z},
                {"height_mm", o.height_mm},
                {"sigma_height_mm", o.sigma_height_mm},
                {"length_mm", o.length_mm},
                {"width_mm", o.width_mm},
                {"volume_mm3", o.volume_mm3},
                {"points", o.points}};
    if (o.resembles != 0) row["resembles"] = o.resembles;
    rows.push_back(row);
  }
  return rows;
}

json regions_json(const std::vector<scan::RegionResult>& regions) {
  json rows = json::array();
  for (const scan::RegionResult& r : regions)
    rows.push_back({{"name", r.name},
                    {"points", r.statistics.points},
                    {"mean_mm", r.statistics.mean_mm},
                    {"sigma_mean_mm", r.sigma_mean_mm},
                    {"rms_mm", r.statistics.rms_mm},
                    {"median_mm", r.statistics.median_mm},
                    {"nmad_mm", r.statistics.nmad_mm},
                    {"p05_mm", r.statistics.p05_mm},
                    {"p95_mm", r.statistics.p95_mm},
                    {"within", r.within},
                    {"verdict", scan::name_of(r.verdict)},
                    {"worst_mm", r.worst_mm},
                    {"worst_at_mm", {r.worst_at_mm.x, r.worst_at_mm.y}}});
  return rows;
}

json worst_places_json(const std::vector<scan::WorstPlace>& places) {
  json rows = json::array();
  for (const scan::WorstPlace& p : places)
    rows.push_back({{"x_mm", p.at_mm.x},
                    {"y_mm", p.at_mm.y},
                    {"mean_mm", p.mean_mm},
                    {"detection_limit_mm", p.lod_mm},
                    {"significant", p.significant}});
  return rows;
}

json profile_json(const scan::Profile& p) {
  json rows = json::array();
  for (std::size_t k = 0; k < p.along_mm.size(); ++k)
    rows.push_back({{"along_mm", p.along_mm[k]},
                    {"x_mm", p.at_mm[k].x},
                    {"y_mm", p.at_mm[k].y},
                    {"design_z_mm", p.at_mm[k].z},
                    {"mean_mm", p.mean_mm[k]},
                    {"sigma_mm", p.sigma_mm[k]},
                    {"points", p.points[k]}});
  return {{"name", p.name}, {"step_mm", p.step_mm}, {"values", rows}};
}

json dependence_json(const scan::Dependence& d) {
  json bins = json::array();
  for (std::size_t k = 0; k < d.points.size(); ++k)
    bins.push_back({{"from", d.from[k]},
                    {"to", d.to[k]},
                    {"mean_mm", d.mean_mm[k]},
                    {"nmad_mm", d.nmad_mm[k]},
                    {"points", d.points[k]}});
  return {{"on", d.on}, {"bins", bins}};
}

json budget_json(const scan::Budget& budget) {
  json rows = json::array();
  for (const scan::Contribution& c : budget.contributions)
    rows.push_back({{"source", c.source}, {"u_mm", c.u_mm}, {"evaluation", c.evaluation}});
  return {{"contributions", rows},
          {"combined_mm", budget.combined_mm},
          {"expanded_mm", budget.expanded_mm}};
}

json texture_json(const scan::Texture& t) {
  return {{"sa_mm", t.sa_mm}, {"sq_mm", t.sq_mm}, {"sz_mm", t.sz_mm},    {"ssk", t.ssk},
          {"sku", t.sku},     {"sdr", t.sdr},     {"form_mm", t.form_mm}};
}

json corrections_json(const Corrections& c) {
  const RigidTransform& t = c.actual_from_planned;
  json axes = json::array();
  for (const AxisCorrection& a : c.axes)
    axes.push_back({{"name", a.name},
                    {"origin_mm", {a.fit.origin_mm.x, a.fit.origin_mm.y, a.fit.origin_mm.z}},
                    {"direction", {a.fit.direction.x, a.fit.direction.y, a.fit.direction.z}},
                    {"scale", a.fit.scale},
                    {"sigma_scale", a.fit.sigma_scale},
                    {"sigma_direction_deg", kDegrees * a.fit.sigma_direction_rad},
                    {"straightness_mm", a.fit.straightness_mm}});
  return {{"translation_mm", {t.translation_mm.x, t.translation_mm.y, t.translation_mm.z}},
          {"rotation_deg",
           {2.0 * kDegrees * t.rotation.x, 2.0 * kDegrees * t.rotation.y,
            2.0 * kDegrees * t.rotation.z}},
          {"sigma_translation_mm", c.sigma_translation_mm},
          {"sigma_rotation_deg", kDegrees * c.sigma_rotation_rad},
          {"axes", axes}};
}

}  // namespace maquette::tools

// SPDX-License-Identifier: GPL-3.0-or-later
#include <cmath>

#include <nlohmann/json.hpp>

#include "cnc/verify.hpp"

namespace maquette::cnc {
namespace {

using Json = nlohmann::ordered_json;
constexpr std::size_t kGougesListed = 200;

Json to_array(Vec3 v) {
  return Json::array({v.x, v.y, v.z});
}
Json finite(double v) {
  return std::isfinite(v) ? Json(v) : Json(nullptr);
}

Json places(const std::vector<MotionPlace>& list) {
  Json json = Json::array();
  for (const MotionPlace& p : list)
    json.push_back({{"program", p.program}, {"line", p.line}, {"ends_at_mm", to_array(p.at_mm)}});
  return json;
}

Json path_json(const PathCertificate& path) {
  Json gouges = Json::array();
  for (std::size_t i = 0; i < std::min(kGougesListed, path.places.size()); ++i) {
    const PathGouge& g = path.places[i];
    gouges.push_back({{"x_mm", g.x_mm},
                      {"y_mm", g.y_mm},
                      {"depth_mm", g.depth_mm},
                      {"program", g.program},
                      {"line", g.line}});
  }
  return {{"max_gouge_mm", path.max_gouge_mm},
          {"proven_mm", path.proven_mm},
          {"gouging_moves", path.gouging_motions},
          {"undecided", path.undecided},
          {"gouges", gouges}};
}

Json engagement_json(const EngagementFigures& e) {
  Json classes = Json::array();
  for (std::size_t i = 0; i < EngagementFigures::kFrom_mm2.size(); ++i)
    classes.push_back(
        {{"from_mm2", EngagementFigures::kFrom_mm2[i]}, {"length_mm", e.length_by_class_mm[i]}});
  return {{"air_share", e.cutting_length_mm > 0.0 ? e.air_length_mm / e.cutting_length_mm : 0.0},
          {"air_length_mm", e.air_length_mm},
          {"removed_mm3", e.removed_mm3},
          {"largest_mm2", e.largest_mm2},
          {"largest_rate_mm3_min", e.largest_rate_mm3_min},
          {"length_by_engagement", classes}};
}

}  // namespace

std::string to_json(const Certificate& c) {
  Json worst = Json::array();
  for (const Place& place : c.worst_gouges)
    worst.push_back({{"x_mm", place.x_mm}, {"y_mm", place.y_mm}, {"depth_mm", place.depth_mm}});
  Json travel = nullptr;
  if (!c.travel.empty())
    travel = {{"min_mm", to_array(c.travel.min)}, {"max_mm", to_array(c.travel.max)}};
  Json scallops = Json::array();
  for (const ScallopClass& s : c.scallops)
    scallops.push_back({{"from_deg", s.from_deg},
                        {"to_deg", s.to_deg},
                        {"area_mm2", s.area_mm2},
                        {"median_mm", s.median_mm},
                        {"p95_mm", s.p95_mm},
                        {"p99_mm", s.p99_mm},
                        {"stated_mm", finite(s.stated_mm)}});
  Json times = Json::array();
  for (const ToolUse& use : c.tools)
    times.push_back({{"program", use.program},
                     {"tool", use.number},
                     {"cutting_min", use.time.cutting_s / 60.0},
                     {"rapid_min", use.time.rapid_s / 60.0},
                     {"waiting_min", use.time.waiting_s / 60.0},
                     {"total_min", use.time.total_s() / 60.0},
                     {"length_m", use.time.cutting_mm / 1000.0},
                     {"highest_blocks_per_s", use.time.highest_blocks_per_s}});
  const Json json = {{"schema", "maquette.certificate/1"},
                     {"max_gouge_mm", c.max_gouge_mm},
                     {"max_excess_mm", c.max_excess_mm},
                     {"max_excess_anywhere_mm", c.max_excess_anywhere_mm},
                     {"bound_mm", c.bound_mm},
                     {"cell_gouge_mm", c.cell_gouge_mm},
                     {"cell_bound_mm", finite(c.cell_bound_mm)},
                     {"blending_mm", c.blending_mm ? finite(*c.blending_mm) : Json(nullptr)},
                     {"path", c.path ? path_json(*c.path) : Json(nullptr)},
                     {"max_excess_includes_border", true},
                     {"max_excess_inside_mm", c.max_excess_inside_mm},
                     {"max_excess_border_mm", c.max_excess_border_mm},
                     {"excess_bound_mm", finite(c.excess_bound_mm)},
                     {"stepover_mm", finite(c.stepover_mm)},
                     {"max_excess_over_scallop_mm", finite(c.max_excess_over_scallop_mm)},
                     {"max_tight_over_scallop_mm", finite(c.max_tight_over_scallop_mm)},
                     {"tight_area_mm2", c.tight_area_mm2},
                     {"unreached_area_mm2", c.unreached_area_mm2},
                     {"max_over_closing_mm", finite(c.max_over_closing_mm)},
                     {"over_closing_area_mm2", c.over_closing_area_mm2},
                     {"mean_excess_mm", c.mean_excess_mm},
                     {"rms_excess_mm", c.rms_excess_mm},
                     {"scallops", scallops},
                     {"gouged_area_mm2", c.gouged_area_mm2},
                     {"worst_gouges", worst},
                     {"rapid_collisions", c.rapid_collisions},
                     {"first_rapid_collisions", places(c.first_rapid_collisions)},
                     {"holder_collisions", c.holder_collisions},
                     {"first_holder_collisions", places(c.first_holder_collisions)},
                     {"stone_collisions", c.stone_collisions},
                     {"first_stone_collisions", places(c.first_stone_collisions)},
                     {"stone_holder_collisions", c.stone_holder_collisions},
                     {"first_stone_holder_collisions", places(c.first_stone_holder_collisions)},
                     {"engagement", engagement_json(c.engagement)},
                     {"blocks", c.blocks},
                     {"moves", c.moves},
                     {"cutting_length_mm", c.cutting_length_mm},
                     {"rapid_length_mm", c.rapid_length_mm},
                     {"time_min", c.time_min},
                     {"machining_time", times},
                     {"travel", travel},
                     {"beyond_travel", c.beyond_travel},
                     {"ball_diameter_mm", c.ball_diameter_mm},
                     {"cell_mm", c.cell_mm},
                     {"program_sha256", c.program_sha256}};
  return json.dump(2) + "\n";
}

}  // namespace maquette::cnc

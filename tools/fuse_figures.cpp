// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/fuse_figures.hpp"

#include <cmath>
#include <string>
#include <vector>

#include <nlohmann/json.hpp>

namespace maquette::tools {
using nlohmann::json;

namespace {

json figures_of(const heightmap::ArtefactReport& a) {
  json boxes = json::array(), seams = json::array(), waves = json::array();
  for (const auto& b : a.boxes)
    boxes.push_back({{"row", b.row},
                     {"col", b.col},
                     {"rows", b.rows},
                     {"cols", b.cols},
                     {"offset_m", b.offset_m}});
  for (const auto& s : a.seams)
    seams.push_back({{"between", s.level ? "rows" : "columns"},
                     {"at", s.at},
                     {"slant", s.slant},
                     {"from", s.from},
                     {"to", s.to},
                     {"step_m", s.step_m},
                     {"sigma_m", s.sigma_m},
                     {"separable", s.separable}});
  for (const auto& w : a.waves)
    waves.push_back({{"towards_deg", w.towards_deg},
                     {"shortest_pixels", w.shortest_pixels},
                     {"longest_pixels", w.longest_pixels},
                     {"rms_m", w.rms_m},
                     {"alike", w.alike},
                     {"separable", w.separable}});
  return {{"spikes", a.spikes}, {"boxes", boxes}, {"box_limit_m", a.box_limit_m},
          {"seams", seams},     {"waves", waves}, {"masked_share", a.masked_share}};
}

}  // namespace

json figures_of(const heightmap::SourceReport& s) {
  return {{"name", s.name},
          {"pixel_m", s.pixel_m},
          {"coverage", s.coverage},
          {"hurst", s.hurst},
          {"relief_coefficient", s.coefficient},
          {"white_noise_m", s.noise_m},
          {"filled_share", s.filled_share},
          {"artefacts", figures_of(s.artefacts)},
          {"shift_east_m", s.shift_east_m},
          {"shift_north_m", s.shift_north_m},
          {"shift_up_m", s.shift_up_m},
          {"tilt_east", s.tilt_east},
          {"tilt_north", s.tilt_north},
          {"turn_rad", s.turn_rad},
          {"scale", s.scale},
          {"joint", s.joint},
          {"bow_per_m", s.bow_per_m},
          {"steps_m", s.steps_m},
          {"sigma_east_m", std::sqrt(s.covariance[0][0])},
          {"sigma_north_m", std::sqrt(s.covariance[1][1])},
          {"sigma_up_m", std::sqrt(s.covariance[2][2])},
          {"covariance", s.covariance},
          {"overlap", s.overlap},
          {"height_only", s.height_only},
          {"median_before_m", s.median_before_m},
          {"median_after_m", s.median_after_m},
          {"nmad_before_m", s.nmad_before_m},
          {"nmad_after_m", s.nmad_after_m}};
}

heightmap::SourceReport source_report(const json& f) {
  heightmap::SourceReport s;
  s.name = f.at("name").get<std::string>();
  s.pixel_m = f.at("pixel_m");
  s.hurst = f.at("hurst");
  s.coefficient = f.at("relief_coefficient");
  s.noise_m = f.at("white_noise_m");
  s.shift_east_m = f.at("shift_east_m");
  s.shift_north_m = f.at("shift_north_m");
  s.shift_up_m = f.at("shift_up_m");
  s.tilt_east = f.at("tilt_east");
  s.tilt_north = f.at("tilt_north");
  s.turn_rad = f.at("turn_rad");
  s.scale = f.at("scale");
  s.joint = f.at("joint");
  s.bow_per_m = f.at("bow_per_m").get<decltype(s.bow_per_m)>();
  s.steps_m = f.at("steps_m").get<std::vector<double>>();
  s.covariance = f.at("covariance").get<decltype(s.covariance)>();
  s.overlap = f.at("overlap");
  s.height_only = f.at("height_only").get<std::string>();
  s.median_before_m = f.at("median_before_m");
  s.median_after_m = f.at("median_after_m");
  s.nmad_before_m = f.at("nmad_before_m");
  s.nmad_after_m = f.at("nmad_after_m");
  return s;
}

json figures_of(const heightmap::ImageReport& i) {
  return {{"name", i.name},
          {"pixel_m", i.pixel_m},
          {"coverage", i.coverage},
          {"added_rms_m", i.added_rms_m},
          {"variance_lowered_m2", i.variance_lowered_m2},
          {"steps", i.steps}};
}

json figures_of(const heightmap::CompositeMatch& m) {
  return {{"crossover_m", m.crossover_m},   {"gain", m.gain},
          {"gain_sigma", m.gain_sigma},     {"gain_longer", m.gain_longer},
          {"relief_slope", m.relief_slope}, {"detail_slope", m.detail_slope}};
}

heightmap::CompositeMatch composite_match(const json& f) {
  heightmap::CompositeMatch m;
  m.crossover_m = f.at("crossover_m");
  m.gain = f.at("gain");
  m.gain_sigma = f.at("gain_sigma");
  m.gain_longer = f.at("gain_longer");
  m.relief_slope = f.at("relief_slope");
  m.detail_slope = f.at("detail_slope");
  return m;
}

}  // namespace maquette::tools

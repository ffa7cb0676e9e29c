// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "assets/synthetic_products.hpp"
#include "camera/image_io.hpp"
#include "core/files.hpp"
#include "core/median.hpp"
#include "heightmap/body.hpp"
#include "heightmap/field_io.hpp"
#include "heightmap/fuse.hpp"
#include "meshing/stones.hpp"
#include "tools/jobs.hpp"
#include "tools/pictures.hpp"

namespace maquette::tools {
using nlohmann::json;

Result<JobResult> products_job(const Site& site, const fs::path& folder, const RunContext& run) {
  assets::SyntheticSite synthetic;
  synthetic.body = *heightmap::body_by_name(site.body);
  synthetic.centre_latitude_deg = site.centre_latitude_deg;
  synthetic.centre_longitude_deg = site.centre_longitude_deg;
  // The fine product reaches beyond the site on every side, and is large enough to be
  // shifted onto the coarse one however small the site is.
  constexpr double kMargin = 1.1, kLeastHalfWidth_m = 60.0;
  synthetic.half_width =
      Metres{std::max(kLeastHalfWidth_m, kMargin * half_width_m(site, site.scales.front()))};
  synthetic.seed = static_cast<std::uint64_t>(site.synthetic_seed);
  std::error_code ec;
  fs::create_directories(folder, ec);
  if (ec) return tl::unexpected(write_error(folder, ec.value()));
  MAQUETTE_TRY(const auto files, assets::write_synthetic_products(synthetic, folder, run));
  JobResult result;
  result.outputs = {files.fine_img, files.coarse_lbl, files.coarse_img, files.truth_json};
  result.figures_json = json{{"half_width_m", synthetic.half_width.value()},
                             {"fine_pixel_m", synthetic.fine_pixel.value()},
                             {"coarse_pixel_m", synthetic.coarse_pixel.value()}}
                            .dump();
  result.note = fmt::format("{:.0f} m square, {:.0f} m and {:.0f} m pixels",
                            2.0 * synthetic.half_width.value(), synthetic.fine_pixel.value(),
                            synthetic.coarse_pixel.value());
  return result;
}

std::vector<SiteSource> embedded_sources(const Site& site, const fs::path& products) {
  const std::string stem = "synthetic_" + site.body;
  const assets::SyntheticSite synthetic;
  return {{"ldem", products / (stem + "_ldem.lbl"), "auto", synthetic.coarse_noise_m},
          {"dtm", products / (stem + "_dtm.img"), "auto", synthetic.fine_noise_m}};
}

namespace {

/// Of source.tif: index of the most exact source, + 100 where synthetic detail is more than what
/// was uncertain before; 255 filled.
int source_value(const heightmap::FusedSurface& fused, std::size_t i) {
  const int source = fused.source.cells()[i];
  return source == 255 || fused.synthetic.cells()[i] == 0 ? source : source + 100;
}

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

heightmap::SourceReport report_of(const json& f) {
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

/// The wider surface in metres, as fuse_job left it.
Result<heightmap::Enlarged> read_wider(const Site& site, const WiderSurface& wider,
                                       std::size_t sources) {
  const auto files = wider.files();
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(files[0]));
  MAQUETTE_TRY(const auto text, read_file(files[1]));
  const ModelScale scale(wider.scale, site.exaggeration);
  heightmap::Enlarged out;
  try {
    const json figures = json::parse(text);
    for (const json& f : figures.at("sources")) out.sources.push_back(report_of(f));
    const double lowest_m = figures.at("lowest_m");
    out.field.z_m = Grid<float>(design.z_mm.rows(), design.z_mm.cols());
    for (std::size_t i = 0; i < design.z_mm.cells().size(); ++i) {
      const Millimetres above{static_cast<double>(design.z_mm.cells()[i]) - site.lowest_mm};
      out.field.z_m.cells()[i] =
          static_cast<float>(lowest_m + scale.unscale_vertical(above).value());
    }
  } catch (const json::exception& e) {
    return fail(kInputMissing, fmt::format("{}: not what this version of `maquette fuse` writes "
                                           "({}); fuse 1:{:g} again",
                                           files[1].string(), e.what(), wider.scale));
  }
  if (out.sources.size() != sources)
    return fail(kInputMissing,
                fmt::format("{}: made of {} sources, the site has {}; fuse 1:{:g} again",
                            files[1].string(), out.sources.size(), sources, wider.scale));
  const double west_m = -half_width_m(site, wider.scale);
  out.field.x0 = out.field.y0 = Metres{west_m};
  out.field.spacing = scale.unscale_horizontal(Millimetres{site.spacing_mm});
  return out;
}

}  // namespace

Result<JobResult> fuse_job(const Site& site, std::span<const SiteSource> sources, double scale,
                           const std::optional<WiderSurface>& wider, const fs::path& folder,
                           const RunContext& run) {
  heightmap::FuseRequest request;
  request.body = *heightmap::body_by_name(site.body);
  request.centre_latitude_deg = site.centre_latitude_deg;
  request.centre_longitude_deg = site.centre_longitude_deg;
  request.half_width = Metres{half_width_m(site, scale)};
  request.spacing = ModelScale(scale).unscale_horizontal(Millimetres{site.spacing_mm});
  request.synthetic_detail = site.synthetic_detail;
  request.crater_age_gyr = site.crater_age_gyr;
  request.restore = site.restore;
  request.joint = site.joint;
  request.seed = static_cast<std::uint64_t>(site.seed);
  for (const SiteSource& s : sources) {
    using Align = heightmap::Source::Align;
    const Align align = s.align == "required" ? Align::required
                        : s.align == "height" ? Align::height
                        : s.align == "none"   ? Align::none
                                              : Align::automatic;
    const heightmap::Clean clean = s.clean == "off"      ? heightmap::Clean::off
                                   : s.clean == "remove" ? heightmap::Clean::remove
                                                         : heightmap::Clean::detect;
    request.sources.push_back(
        {s.name, s.path, s.unit, s.sigma_m, align, s.similarity, clean, s.bow, s.seams_m});
  }
  for (const SiteImage& i : site.images)
    request.images.push_back({i.name, i.path, i.sun_azimuth_deg, i.sun_elevation_deg,
                              i.lunar_lambert, i.noise, i.albedo_contrast, i.albedo_length_m});
  if (wider) {
    MAQUETTE_TRY(request.enlarges, read_wider(site, *wider, sources.size()));
  }
  MAQUETTE_TRY(const auto fused, heightmap::fuse(request, run));

  const ModelScale model_scale(scale, site.exaggeration);
  const heightmap::ModelField design =
      heightmap::to_model(fused.field, model_scale, Millimetres{site.lowest_mm});
  const auto range_m = heightmap::height_range(fused.field.z_m);
  const auto range_mm = heightmap::height_range(design.z_mm);

  std::error_code ec;
  fs::create_directories(folder, ec);
  if (ec) return tl::unexpected(write_error(folder, ec.value()));
  JobResult result;
  result.outputs = {folder / "design.tif",    folder / "sigma.tif", folder / "source.tif",
                    folder / "hillshade.png", folder / "fuse.json", folder / "artefacts.tif",
                    folder / "artefacts.png", folder / "sigma.png", folder / "source.png"};
  MAQUETTE_TRY_VOID(heightmap::write_model_field(design, result.outputs[0]));
  Grid<float> values(design.z_mm.rows(), design.z_mm.cols());
  for (std::size_t i = 0; i < values.cells().size(); ++i)
    values.cells()[i] = static_cast<float>(
        model_scale.vertical(Metres{static_cast<double>(fused.sigma_m.cells()[i])}).value());
  MAQUETTE_TRY_VOID(heightmap::write_model_grid(values, design, "mm", result.outputs[1]));
  // Where it is larger and smaller than usual: its size alone is one colour on most sites.
  std::vector<float> sigmas(values.cells().begin(), values.cells().end());
  const double sigma_median_mm = static_cast<double>(median_of(sigmas));
  for (float& v : values.cells())
    v = sigma_median_mm > 0.0 ? static_cast<float>(std::log2(v / sigma_median_mm)) : 0.0F;
  const double sigma_colour_octaves = colour_limit(values, 0.5);
  MAQUETTE_TRY_VOID(
      camera::write_png(signed_picture(values, sigma_colour_octaves, &design), result.outputs[7]));
  for (std::size_t i = 0; i < values.cells().size(); ++i)
    values.cells()[i] = static_cast<float>(source_value(fused, i));
  MAQUETTE_TRY_VOID(heightmap::write_model_grid(values, design, "index", result.outputs[2]));
  MAQUETTE_TRY_VOID(camera::write_png(source_picture(fused.source, design), result.outputs[8]));
  MAQUETTE_TRY_VOID(camera::write_png(hillshade_picture(design), result.outputs[3]));
  for (std::size_t i = 0; i < values.cells().size(); ++i)
    values.cells()[i] = static_cast<float>(fused.artefacts.cells()[i]);
  MAQUETTE_TRY_VOID(heightmap::write_model_grid(values, design, "bits", result.outputs[5]));
  MAQUETTE_TRY_VOID(
      camera::write_png(artefact_picture(fused.artefacts, design), result.outputs[6]));

  json figures{
      {"scale", scale},
      {"nodes", {design.z_mm.cols(), design.z_mm.rows()}},
      {"spacing_mm", site.spacing_mm},
      {"sigma_median_mm", sigma_median_mm},
      {"sigma_colour_octaves", sigma_colour_octaves},
      {"synthetic_craters", fused.craters},
      {"lowest_m", range_m.min},
      {"highest_m", range_m.max},
      {"relief_mm", static_cast<double>(range_mm.max) - static_cast<double>(range_mm.min)}};
  if (fused.loop_before_px > 0.0) {
    figures["loop_before_px"] = fused.loop_before_px;
    figures["loop_after_px"] = fused.loop_after_px;
  }
  for (const auto& s : fused.sources) figures["sources"].push_back(figures_of(s));
  for (const auto& i : fused.images)
    figures["images"].push_back({{"name", i.name},
                                 {"pixel_m", i.pixel_m},
                                 {"coverage", i.coverage},
                                 {"added_rms_m", i.added_rms_m},
                                 {"variance_lowered_m2", i.variance_lowered_m2},
                                 {"steps", i.steps}});
  if (wider) {
    const auto um = [&](double height_m) {
      return 1000.0 * model_scale.vertical(Metres{height_m}).value();
    };
    figures["enlarges_scale"] = wider->scale;
    figures["low_pass_before_um"] = um(fused.mean_off_before_m);
    figures["low_pass_um"] = um(fused.mean_off_m);
  }
  MAQUETTE_TRY_VOID(write_file(result.outputs[4], figures.dump(1)));
  result.figures_json = figures.dump();
  result.note = fmt::format("{} x {} nodes, relief {:.1f} mm", design.z_mm.cols(),
                            design.z_mm.rows(), figures["relief_mm"].get<double>());
  return result;
}

Result<JobResult> stones_job(const Site& site, double scale, const fs::path& design_path,
                             const fs::path& folder, const RunContext&) {
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(design_path));
  meshing::SitePlanRequest request;
  request.count = static_cast<int>(site.stone_count);
  request.inner_share = site.scales.size() > 1 ? site.stone_inner_share : 0.0;
  request.half_width = Metres{half_width_m(site, site.scales.front())};
  request.inner_half_width =
      Metres{site.scales.size() > 1 ? half_width_m(site, site.scales[1]) : 0.0};
  request.min_diameter = Metres{site.stone_min_diameter_m};
  request.max_diameter = Metres{site.stone_max_diameter_m};
  request.k = site.stone_k;
  request.seed = static_cast<std::uint64_t>(site.seed);
  MAQUETTE_TRY(auto plan, meshing::plan_stones(request));
  for (auto& stone : plan) stone.shape.angularity = site.stone_angularity;

  const double west_m = -half_width_m(site, scale);
  const auto placed = meshing::lay_stones(plan, design, ModelScale(scale, site.exaggeration),
                                          west_m, west_m, site.stone_embedded_share);
  std::error_code ec;
  fs::create_directories(folder, ec);
  if (ec) return tl::unexpected(write_error(folder, ec.value()));
  JobResult result;
  result.outputs = {folder / "stones.json", folder / "stones.csv", folder / "surface.tif"};
  MAQUETTE_TRY_VOID(meshing::write_stone_plan(placed, result.outputs[0]));
  MAQUETTE_TRY_VOID(meshing::write_stone_table(placed, result.outputs[1]));
  MAQUETTE_TRY_VOID(
      heightmap::write_model_field(meshing::with_stones(design, placed), result.outputs[2]));
  double largest = 0.0;
  for (const auto& s : placed) largest = std::max(largest, s.scale_mm);
  result.figures_json =
      json{{"planned", plan.size()}, {"on_surface", placed.size()}, {"largest_mm", largest}}.dump();
  result.note =
      fmt::format("{} of {} stones, largest {:.1f} mm", placed.size(), plan.size(), largest);
  return result;
}

}  // namespace maquette::tools

// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <iterator>
#include <numbers>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "camera/image_io.hpp"
#include "core/files.hpp"
#include "core/median.hpp"
#include "heightmap/body.hpp"
#include "heightmap/composite.hpp"
#include "heightmap/field_io.hpp"
#include "tools/fuse_figures.hpp"
#include "tools/jobs.hpp"
#include "tools/pictures.hpp"

namespace maquette::tools {
namespace {

using nlohmann::json;

constexpr int kSmallestPicture_px = 500;

/// Of source.tif: index of the most exact source, + 100 where synthetic detail was added; 255
/// filled. There are at most 100 sources.
int source_value(const Grid<std::uint8_t>& sources, const heightmap::FusedSurface& fused,
                 std::size_t i) {
  const int source = sources.cells()[i];
  return source == 255 || fused.synthetic.cells()[i] == 0 ? source : source + 100;
}

/// The wider surface in metres, as fuse_job left it.
struct Wider {
  heightmap::PlanetField field;
  std::vector<heightmap::SourceReport> sources;
  std::optional<heightmap::CompositeMatch> match;
  Grid<float> sigma_m;
  Grid<std::uint8_t> artefacts;
};
Result<Wider> read_wider(const Site& site, const WiderSurface& wider, std::size_t sources) {
  const auto files = wider.files();
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(files[0]));
  MAQUETTE_TRY(const auto sigma, heightmap::read_model_field(files[2]));
  MAQUETTE_TRY(const auto artefacts, heightmap::read_model_grid(files[3]));
  const auto same_nodes = [&](const Grid<float>& g) {
    return g.rows() == design.z_mm.rows() && g.cols() == design.z_mm.cols();
  };
  if (!same_nodes(sigma.z_mm) || !same_nodes(artefacts.z_mm))
    return fail(kInputMissing,
                fmt::format("{}: not of the same nodes as sigma.tif and artefacts.tif beside it; "
                            "fuse 1:{:g} again",
                            files[0].string(), wider.scale));
  MAQUETTE_TRY(const auto text, read_file(files[1]));
  const ModelScale scale(wider.scale, site.exaggeration);
  Wider out;
  try {
    const json figures = json::parse(text);
    for (const json& f : figures.at("sources")) out.sources.push_back(source_report(f));
    if (figures.contains("composite")) out.match = composite_match(figures.at("composite"));
    const double lowest_m = figures.at("lowest_m");
    out.field.z_m = Grid<float>(design.z_mm.rows(), design.z_mm.cols());
    out.sigma_m = out.field.z_m;
    out.artefacts = Grid<std::uint8_t>(design.z_mm.rows(), design.z_mm.cols());
    for (std::size_t i = 0; i < design.z_mm.cells().size(); ++i) {
      out.artefacts.cells()[i] = static_cast<std::uint8_t>(artefacts.z_mm.cells()[i]);
      out.sigma_m.cells()[i] = static_cast<float>(
          scale.unscale_vertical(Millimetres{static_cast<double>(sigma.z_mm.cells()[i])}).value());
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

bool of_site(const Site& site, const SiteSource& source) {
  return source.body == "site" || source.body == site.body;
}

/// All that a request has beside its sources.
heightmap::FuseRequest request_of(const Site& site, double scale) {
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
  for (const SiteImage& i : site.images)
    request.images.push_back({i.name, i.path, i.sun_azimuth_deg, i.sun_elevation_deg,
                              i.lunar_lambert, i.noise, i.albedo_contrast, i.albedo_length_m});
  return request;
}

heightmap::Source source_of(const SiteSource& s) {
  using Align = heightmap::Source::Align;
  const Align align = s.align == "required" ? Align::required
                      : s.align == "height" ? Align::height
                      : s.align == "none"   ? Align::none
                                            : Align::automatic;
  const heightmap::Clean clean = s.clean == "off"      ? heightmap::Clean::off
                                 : s.clean == "remove" ? heightmap::Clean::remove
                                                       : heightmap::Clean::detect;
  return {s.name, s.path, s.unit, s.sigma_m, align, s.similarity, clean, s.bow, s.seams_m};
}

Result<heightmap::CompositeSurface> fuse_same_body(const Site& site,
                                                   std::span<const SiteSource> sources,
                                                   double scale, std::optional<Wider>& wider,
                                                   const RunContext& run) {
  heightmap::FuseRequest request = request_of(site, scale);
  for (const SiteSource& s : sources) request.sources.push_back(source_of(s));
  if (wider)
    request.enlarges.emplace(std::move(wider->field), std::move(wider->sources),
                             std::move(wider->sigma_m), std::move(wider->artefacts));
  heightmap::CompositeSurface out;
  MAQUETTE_TRY(out.surface, heightmap::fuse(request, run));
  return out;
}

Result<heightmap::CompositeSurface> fuse_composite(const Site& site,
                                                   std::span<const SiteSource> sources,
                                                   double scale, std::optional<Wider>& wider,
                                                   const RunContext& run) {
  heightmap::CompositeRequest request;
  request.relief = request.detail = request_of(site, scale);
  request.relief.synthetic_detail = 0.0;
  request.detail.images.clear();
  request.detail.centre_latitude_deg = site.detail_latitude_deg;
  request.detail.centre_longitude_deg = site.detail_longitude_deg;
  request.crossover_m = site.crossover_m;
  for (const SiteSource& s : sources) {
    if (!of_site(site, s)) request.detail.body = *heightmap::body_by_name(s.body);
    (of_site(site, s) ? request.relief : request.detail).sources.push_back(source_of(s));
  }
  if (wider) {
    const auto first_detail =
        wider->sources.begin() + static_cast<std::ptrdiff_t>(request.relief.sources.size());
    request.relief.enlarges.emplace().sources.assign(wider->sources.begin(), first_detail);
    request.detail.enlarges.emplace().sources.assign(first_detail, wider->sources.end());
    request.as_before = wider->match;
    request.wider = {
        std::move(wider->field), {}, std::move(wider->sigma_m), std::move(wider->artefacts)};
  }
  return heightmap::composite(request, run);
}

/// Which source is in which waves; wavelengths in metres on the ground.
json bands_of(const Site& site, std::span<const SiteSource> sources,
              const heightmap::CompositeMatch& match) {
  json relief = json::array(), detail = json::array();
  for (const SiteSource& s : sources) (of_site(site, s) ? relief : detail).push_back(s.name);
  json bands = json::array();
  if (match.crossover_m <= 0.0) {
    bands.push_back({{"sources", relief}, {"body", site.body}, {"gain", 1.0}});
    return bands;
  }
  // Half of the power of both at the crossover, nothing of the other half an octave beside it.
  const auto other = std::find_if(sources.begin(), sources.end(),
                                  [&](const SiteSource& s) { return !of_site(site, s); });
  bands.push_back({{"sources", relief},
                   {"body", site.body},
                   {"gain", 1.0},
                   {"longer_than_m", match.crossover_m},
                   {"alone_beyond_m", match.crossover_m * std::numbers::sqrt2}});
  bands.push_back({{"sources", detail},
                   {"body", other->body},
                   {"gain", match.gain},
                   {"shorter_than_m", match.crossover_m},
                   {"alone_beyond_m", match.crossover_m / std::numbers::sqrt2}});
  return bands;
}

/// A file and its picture for each source beside the base; their names go into the source's
/// figures.
Result<void> write_residuals(const heightmap::FusedSurface& fused, const ModelScale& scale,
                             const fs::path& folder, JobResult& result, json& figures) {
  for (const heightmap::ResidualMap& map : fused.residuals) {
    if (std::none_of(map.residual_m.cells().begin(), map.residual_m.cells().end(),
                     [](float v) { return !std::isnan(v); }))
      continue;
    heightmap::ModelField frame;
    frame.spacing = scale.horizontal(map.spacing);
    frame.x0 = scale.horizontal(Metres{map.x0.value() - fused.field.x0.value()});
    frame.y0 = scale.horizontal(Metres{map.y0.value() - fused.field.y0.value()});
    frame.z_mm = map.residual_m;
    const std::string stem = fmt::format("residual_{}", map.source);
    result.outputs.push_back(folder / (stem + ".tif"));
    MAQUETTE_TRY_VOID(
        heightmap::write_model_grid(map.residual_m, frame, "m", result.outputs.back()));
    // Cells as squares that can be seen.
    const auto times = std::max<std::ptrdiff_t>(
        1, kSmallestPicture_px / std::max(map.residual_m.rows(), map.residual_m.cols()));
    Grid<float> larger(map.residual_m.rows() * times, map.residual_m.cols() * times);
    for (std::ptrdiff_t r = 0; r < larger.rows(); ++r)
      for (std::ptrdiff_t c = 0; c < larger.cols(); ++c)
        larger(r, c) = map.residual_m(r / times, c / times);
    const double limit_m = colour_limit(map.residual_m, 1e-6);
    result.outputs.push_back(folder / (stem + ".png"));
    MAQUETTE_TRY_VOID(camera::write_png(signed_picture(larger, limit_m), result.outputs.back()));
    json& of = figures["sources"][map.source];
    of["residual"] = stem + ".tif";
    of["residual_cell_m"] = map.spacing.value();
    of["residual_median_m"] = map.median_m;
    of["residual_nmad_m"] = map.nmad_m;
    of["residual_colour_m"] = limit_m;
  }
  return {};
}

/// The maps beside the design, and their pictures.
Result<void> write_masks(const heightmap::CompositeSurface& made,
                         const heightmap::ModelField& design, const ModelScale& scale,
                         const fs::path& folder, JobResult& result, json& figures) {
  const heightmap::FusedSurface& fused = made.surface;
  Grid<float> values(design.z_mm.rows(), design.z_mm.cols());
  const auto grid = [&](const char* name, const char* unit) {
    result.outputs.push_back(folder / name);
    return heightmap::write_model_grid(values, design, unit, result.outputs.back());
  };
  const auto picture = [&](const char* name, const auto& pixels) {
    result.outputs.push_back(folder / name);
    return camera::write_png(pixels, result.outputs.back());
  };
  for (std::size_t i = 0; i < values.cells().size(); ++i)
    values.cells()[i] = static_cast<float>(
        scale.vertical(Metres{static_cast<double>(fused.sigma_m.cells()[i])}).value());
  MAQUETTE_TRY_VOID(grid("sigma.tif", "mm"));
  // Where it is larger and smaller than usual: its size alone is one colour on most sites.
  std::vector<float> sigmas(values.cells().begin(), values.cells().end());
  const double sigma_median_mm = static_cast<double>(median_of(sigmas));
  for (float& v : values.cells())
    v = sigma_median_mm > 0.0 ? static_cast<float>(std::log2(v / sigma_median_mm)) : 0.0F;
  const double sigma_colour_octaves = colour_limit(values, 0.5);
  MAQUETTE_TRY_VOID(picture("sigma.png", signed_picture(values, sigma_colour_octaves, &design)));
  figures["sigma_median_mm"] = sigma_median_mm;
  figures["sigma_colour_octaves"] = sigma_colour_octaves;

  const bool composite = !made.detail_source.empty();
  for (std::size_t i = 0; i < values.cells().size(); ++i)
    values.cells()[i] = static_cast<float>(composite ? fused.source.cells()[i]
                                                     : source_value(fused.source, fused, i));
  MAQUETTE_TRY_VOID(grid("source.tif", "index"));
  MAQUETTE_TRY_VOID(picture("source.png", source_picture(fused.source, design)));
  if (composite) {
    for (std::size_t i = 0; i < values.cells().size(); ++i)
      values.cells()[i] = static_cast<float>(source_value(made.detail_source, fused, i));
    MAQUETTE_TRY_VOID(grid("detail_source.tif", "index"));
    MAQUETTE_TRY_VOID(picture("detail_source.png", source_picture(made.detail_source, design)));
  }
  MAQUETTE_TRY_VOID(picture("hillshade.png", hillshade_picture(design)));
  for (std::size_t i = 0; i < values.cells().size(); ++i)
    values.cells()[i] = static_cast<float>(fused.artefacts.cells()[i]);
  MAQUETTE_TRY_VOID(grid("artefacts.tif", "bits"));
  return picture("artefacts.png", artefact_picture(fused.artefacts, design));
}

}  // namespace

Result<JobResult> fuse_job(const Site& site, std::span<const SiteSource> sources, double scale,
                           const std::optional<WiderSurface>& wider, const fs::path& folder,
                           const RunContext& run) {
  std::optional<Wider> before;
  if (wider) {
    MAQUETTE_TRY(before, read_wider(site, *wider, sources.size()));
  }
  MAQUETTE_TRY(const auto made, site.combine == "composite"
                                    ? fuse_composite(site, sources, scale, before, run)
                                    : fuse_same_body(site, sources, scale, before, run));
  const heightmap::FusedSurface& fused = made.surface;
  const ModelScale model_scale(scale, site.exaggeration);
  const heightmap::ModelField design =
      heightmap::to_model(fused.field, model_scale, Millimetres{site.lowest_mm});
  const auto range_m = heightmap::height_range(fused.field.z_m);
  const auto range_mm = heightmap::height_range(design.z_mm);

  std::error_code ec;
  fs::create_directories(folder, ec);
  if (ec) return tl::unexpected(write_error(folder, ec.value()));
  JobResult result;
  result.outputs = {folder / "design.tif"};
  MAQUETTE_TRY_VOID(heightmap::write_model_field(design, result.outputs[0]));
  json figures{{"scale", scale},
               {"combine", site.combine},
               {"nodes", {design.z_mm.cols(), design.z_mm.rows()}},
               {"spacing_mm", site.spacing_mm},
               {"synthetic_craters", fused.craters},
               {"synthetic_mm", model_scale.vertical(Metres{fused.synthetic_m}).value()},
               {"lowest_m", range_m.min},
               {"highest_m", range_m.max},
               {"relief_mm", static_cast<double>(range_mm.max) - static_cast<double>(range_mm.min)},
               {"bands", bands_of(site, sources, made.match)}};
  if (fused.loop_before_px > 0.0) {
    figures["loop_before_px"] = fused.loop_before_px;
    figures["loop_after_px"] = fused.loop_after_px;
    figures["loop_sigma_px"] = fused.loop_sigma_px;
  }
  for (const auto& s : fused.sources) figures["sources"].push_back(figures_of(s));
  for (const auto& i : fused.images) figures["images"].push_back(figures_of(i));
  if (made.match.crossover_m > 0.0) figures["composite"] = figures_of(made.match);
  if (wider) {
    const auto um = [&](double height_m) {
      return 1000.0 * model_scale.vertical(Metres{height_m}).value();
    };
    figures["enlarges_scale"] = wider->scale;
    figures["low_pass_before_um"] = um(fused.mean_off_before_m);
    figures["low_pass_um"] = um(fused.mean_off_m);
  }
  MAQUETTE_TRY_VOID(write_masks(made, design, model_scale, folder, result, figures));
  MAQUETTE_TRY_VOID(write_residuals(fused, model_scale, folder, result, figures));
  result.outputs.push_back(folder / "fuse.json");
  MAQUETTE_TRY_VOID(write_file(result.outputs.back(), figures.dump(1)));
  result.figures_json = figures.dump();
  result.note = fmt::format("{} x {} nodes, relief {:.1f} mm", design.z_mm.cols(),
                            design.z_mm.rows(), figures["relief_mm"].get<double>());
  return result;
}

}  // namespace maquette::tools

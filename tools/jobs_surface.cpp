// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <array>
#include <numbers>
#include <set>
#include <utility>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "assets/synthetic_products.hpp"
#include "core/files.hpp"
#include "heightmap/body.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/stones.hpp"
#include "tools/jobs.hpp"

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

/// Nothing: as the file's format says.
std::optional<double> millimetres_per(const std::string& unit) {
  constexpr std::array<std::pair<std::string_view, double>, 4> kUnits{
      {{"mm", 1.0}, {"cm", 10.0}, {"m", 1000.0}, {"inch", 25.4}}};
  for (const auto& [name, mm] : kUnits)
    if (name == unit) return mm;
  return std::nullopt;
}

Result<std::vector<meshing::OwnStones>> own_stones(const Site& site, const RunContext& run) {
  constexpr double kMillimetresPerMetre = 1000.0;
  std::vector<meshing::OwnStones> all;
  std::set<std::string> names;
  for (const SiteStones& own : site.own_stones) {
    MAQUETTE_TRY(auto body, meshing::read_stone_body(own.file, millimetres_per(own.unit), run));
    const std::string stem = body.name;
    for (int n = 2; !names.insert(body.name).second; ++n) body.name = fmt::format("{}_{}", stem, n);
    meshing::OwnStones stones;
    const double scale = own.scale > 0.0 ? own.scale : site.scales.front();
    stones.diameter = Metres{
        own.diameter_m > 0.0 ? own.diameter_m : body.diameter_mm * scale / kMillimetresPerMetre};
    stones.count = static_cast<int>(own.count);
    for (std::size_t i = 0; i + 1 < own.places_m.size(); i += 2)
      stones.places.push_back({own.places_m[i], own.places_m[i + 1]});
    stones.heading_rad = own.heading_deg * std::numbers::pi / 180.0;
    stones.body = std::make_shared<const meshing::StoneBody>(std::move(body));
    all.push_back(std::move(stones));
  }
  return all;
}

}  // namespace

Result<JobResult> stones_job(const Site& site, double scale, const fs::path& design_path,
                             const fs::path& folder, const RunContext& run) {
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
  request.shapes = static_cast<int>(site.stone_shapes);
  request.sizes = static_cast<int>(site.stone_sizes);
  request.seed = static_cast<std::uint64_t>(site.seed);
  MAQUETTE_TRY(request.own, own_stones(site, run));
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
  for (fs::path& file : meshing::stone_body_files(placed, result.outputs[0]))
    result.outputs.push_back(std::move(file));
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

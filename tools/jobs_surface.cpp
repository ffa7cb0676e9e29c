// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <optional>
#include <set>
#include <utility>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "assets/rocks.hpp"
#include "assets/synthetic_products.hpp"
#include "core/files.hpp"
#include "heightmap/body.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/bring_stones.hpp"
#include "meshing/crater_density.hpp"
#include "meshing/settle_stones.hpp"
#include "meshing/stones.hpp"
#include "tools/jobs.hpp"
#include "tools/pipeline.hpp"

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

/// A surface with what says where it lies.
struct Ground {
  heightmap::ModelField field;
  double scale = 0.0, height_of_z0_m = 0.0;

  [[nodiscard]] meshing::StoneGround stone_ground(const Site& site) const {
    const double west_m = -half_width_m(site, scale);
    return {field, ModelScale(scale, site.exaggeration), west_m, west_m, height_of_z0_m};
  }
};

/// @param with_height  what lies on it lies on others, too: its height is needed
Result<Ground> read_ground(const Site& site, double scale, const fs::path& design,
                           bool with_height) {
  Ground ground;
  ground.scale = scale;
  MAQUETTE_TRY(ground.field, heightmap::read_model_field(design));
  if (!with_height) return ground;
  const fs::path fuse = design.parent_path() / "fuse.json";
  MAQUETTE_TRY(const auto text, read_file(fuse));
  const json figures = json::parse(text, nullptr, false);
  if (!figures.is_object() || !figures.contains("lowest_m") || !figures["lowest_m"].is_number())
    return fail(
        kInputMissing,
        fmt::format("{}: 'lowest_m', the height of the lowest point, is missing; fuse 1:{:g} "
                    "again",
                    fuse.string(), scale));
  ground.height_of_z0_m =
      figures["lowest_m"].get<double>() -
      ModelScale(scale, site.exaggeration).unscale_vertical(Millimetres{site.lowest_mm}).value();
  return ground;
}

std::size_t index_of(const Site& site, double scale) {
  return static_cast<std::size_t>(std::find(site.scales.begin(), site.scales.end(), scale) -
                                  site.scales.begin());
}

/// As many stones as the site says, or as the law of its k has.
Result<int> stone_count(const Site& site, const RunContext& run) {
  constexpr double kMost = 100000.0;
  if (site.stone_count >= 0) return static_cast<int>(site.stone_count);
  const double side_m = 2.0 * half_width_m(site, site.scales.front());
  const double by_law =
      side_m * side_m *
      assets::rocks_per_square_metre(site.stone_k, Metres{site.stone_min_diameter_m},
                                     Metres{site.stone_max_diameter_m});
  if (by_law > kMost)
    return fail(meshing::kStonesDoNotFit,
                fmt::format("by stones.area_fraction_k {} the site of {:g} m x {:g} m has {:.3g} "
                            "stones from {} to {} m, more than {:g}; raise stones.min_diameter_m "
                            "or give stones.count",
                            site.stone_k, side_m, side_m, by_law, site.stone_min_diameter_m,
                            site.stone_max_diameter_m, kMost));
  if (by_law < 0.5)
    run.warn(
        fmt::format("by stones.area_fraction_k {} the site has {:.2g} stones from {} m on: "
                    "none is drawn; give stones.count for more",
                    site.stone_k, by_law, site.stone_min_diameter_m));
  return static_cast<int>(std::lround(by_law));
}

Result<meshing::SitePlanRequest> plan_request(const Site& site, const StoneSurfaces& surfaces,
                                              const RunContext& run) {
  meshing::SitePlanRequest request;
  MAQUETTE_TRY(request.count, stone_count(site, run));
  request.inner_share = site.scales.size() > 1 ? site.stone_inner_share : 0.0;
  request.half_width = Metres{half_width_m(site, site.scales.front())};
  request.inner_half_width =
      Metres{site.scales.size() > 1 ? half_width_m(site, site.scales[1]) : 0.0};
  request.min_diameter = Metres{site.stone_min_diameter_m};
  request.max_diameter = Metres{site.stone_max_diameter_m};
  request.k = site.stone_k;
  request.shapes = static_cast<int>(site.stone_shapes);
  request.sizes = static_cast<int>(site.stone_sizes);
  request.angularity = site.stone_angularity;
  request.seed = static_cast<std::uint64_t>(site.seed);
  MAQUETTE_TRY(request.own, own_stones(site, run));
  if (site.stone_density != "craters") return request;
  if (surfaces.designs.front().empty())
    return fail(
        kInputMissing,
        fmt::format("stones.density craters: the design of 1:{:g} is needed, over which the "
                    "distance from craters is travelled (--other)",
                    site.scales.front()));
  MAQUETTE_TRY(const auto ground,
               read_ground(site, site.scales.front(), surfaces.designs.front(), false));
  std::vector<meshing::Crater> craters;
  for (const SiteCrater& c : site.craters)
    craters.push_back({c.east_m, c.north_m, Metres{c.diameter_m}});
  const auto on = ground.stone_ground(site);
  MAQUETTE_TRY(auto travel, meshing::travel_from_rims(craters, on, site.stone_slope_slowness, run));
  request.density = meshing::density_around(std::move(travel), on, Metres{site.stone_decay_m},
                                            site.stone_far_share);
  return request;
}

/// Lays what is left of the plan on one surface.
Result<std::vector<meshing::PlacedStone>> lay_on(const Site& site,
                                                 const std::vector<meshing::SiteStone>& stones,
                                                 const meshing::SitePlanRequest& request,
                                                 const meshing::StoneGround& ground,
                                                 std::span<const meshing::StoneDisc> taken,
                                                 const RunContext& run) {
  if (site.stone_rest == "settled")
    return meshing::settle_stones(stones, request, ground,
                                  {.embedded_share = site.stone_embedded_share,
                                   .repose = degrees(site.stone_repose_deg),
                                   .seed = static_cast<std::uint64_t>(site.seed),
                                   .taken = taken},
                                  run);
  return meshing::lay_stones(stones, ground.surface, ground.scale, ground.east_of_x0_m,
                             ground.north_of_y0_m, site.stone_embedded_share);
}

/// A stone's pose is that on the surface of the largest scale where it lies, brought to this one.
Result<std::vector<meshing::PlacedStone>> lay_at_scale(
    const Site& site, const std::vector<meshing::SiteStone>& plan,
    const meshing::SitePlanRequest& request, const StoneSurfaces& surfaces, std::size_t index,
    heightmap::ModelField& design, const RunContext& run) {
  std::vector<std::size_t> there;  // largest scale first, this one last
  for (std::size_t k = site.scales.size(); k-- > index;)
    if (!surfaces.designs[k].empty()) there.push_back(k);
  std::optional<Ground> before;
  std::vector<meshing::PlacedStone> placed;
  for (const std::size_t k : there) {
    MAQUETTE_TRY(auto ground,
                 read_ground(site, site.scales[k], surfaces.designs[k], there.size() > 1));
    const auto on = ground.stone_ground(site);
    std::set<int> lie_already;
    for (const auto& s : placed) lie_already.insert(s.number);
    std::vector<meshing::SiteStone> rest;
    for (const auto& s : plan)
      if (!lie_already.contains(s.number)) rest.push_back(s);
    if (before) placed = meshing::bring_stones(placed, before->stone_ground(site), on);
    MAQUETTE_TRY(auto laid, lay_on(site, rest, request, on, meshing::discs_of(placed, on), run));
    for (auto& s : laid) placed.push_back(std::move(s));
    std::sort(placed.begin(), placed.end(),
              [](const auto& a, const auto& b) { return a.number < b.number; });
    before = std::move(ground);
  }
  design = std::move(before->field);
  return placed;
}

}  // namespace

std::vector<fs::path> StoneSurfaces::files(const Site& site, double scale) const {
  const std::size_t index = index_of(site, scale);
  std::vector<fs::path> all;
  std::size_t used = 0;
  for (std::size_t k = index; k < designs.size(); ++k)
    if (!designs[k].empty()) all.push_back(designs[k]), ++used;
  if (used > 1)
    for (std::size_t k = 0; k < used; ++k) all.push_back(all[k].parent_path() / "fuse.json");
  if (index > 0 && site.stone_density == "craters" && !designs.front().empty())
    all.push_back(designs.front());
  return all;
}

Result<JobResult> stones_job(const Site& site, double scale, const StoneSurfaces& surfaces,
                             const fs::path& folder, const RunContext& run) {
  const std::size_t index = index_of(site, scale);
  if (index + 1 < site.scales.size() && surfaces.designs[index + 1].empty())
    run.warn(
        fmt::format("the stones of the section 1:{:g} lie on this surface here, and on their "
                    "own there; --other DESIGN gives them one pose",
                    site.scales[index + 1]));
  MAQUETTE_TRY(const auto request, plan_request(site, surfaces, run));
  MAQUETTE_TRY(const auto plan, meshing::plan_stones(request));
  heightmap::ModelField design;
  MAQUETTE_TRY(const auto placed, lay_at_scale(site, plan, request, surfaces, index, design, run));
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

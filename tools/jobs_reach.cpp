// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <vector>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "camera/image_io.hpp"
#include "cnc/cutter_reach.hpp"
#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "tools/jobs.hpp"
#include "tools/pictures.hpp"

namespace maquette::tools {
using nlohmann::json;
namespace {

constexpr int kPicture_px = 1000;

/// Every limit of the site that the design does not keep, with what to do.
std::vector<std::string> unkept(const Site& site, const cnc::CutterReach& r, double stock_mm) {
  std::vector<std::string> found;
  if (100.0 * r.unreached_share > site.max_unreached_percent)
    found.push_back(
        fmt::format("a ball of {:g} mm leaves more than {:g} mm on {:.3g} % of the surface, reach."
                    "max_unreached_percent is {:g}; most, {:.3f} mm, at x {:.1f} y {:.1f}: take a "
                    "smaller ball, "
                    "add a rest operation or raise the limit",
                    site.ball_diameter_mm, site.unreached_mm, 100.0 * r.unreached_share,
                    site.max_unreached_percent, r.rest.highest_mm, r.deepest_x_mm, r.deepest_y_mm));
  if (r.slope.highest_deg > site.max_slope_deg && r.slope.share_above > 0.0)
    found.push_back(
        fmt::format("{:.3g} % of the surface is steeper than reach.max_slope_deg {:g}, up to "
                    "{:.1f} at x {:.1f} "
                    "y {:.1f}: lower the exaggeration or raise the limit",
                    100.0 * r.slope.share_above, site.max_slope_deg, r.slope.highest_deg,
                    r.slope.highest_x_mm, r.slope.highest_y_mm));
  if (site.cutter_length_mm > 0.0 && r.relief_mm > site.cutter_length_mm)
    found.push_back(fmt::format(
        "the relief of {:.2f} mm is deeper than the cutter is long below its holder, reach."
        "cutter_length_mm {:g}: clamp it longer, or lower the exaggeration",
        r.relief_mm, site.cutter_length_mm));
  if (site.stock_height_mm > 0.0 && stock_mm > site.stock_height_mm)
    found.push_back(fmt::format(
        "base, relief and margin need a block of {:.2f} mm, reach.stock_height_mm is {:g}: take a "
        "higher block, a thinner stock.base_thickness_mm, or lower the exaggeration",
        stock_mm, site.stock_height_mm));
  return found;
}

/// Full colour: what a fiftieth of the places that count exceeds.
double reach_limit(const cnc::RestMap& rest) {
  std::vector<float> above;
  for (const float z : rest.remaining.z_mm.cells())
    if (static_cast<double>(z) > rest.threshold_mm) above.push_back(z);
  if (above.empty()) return 2.0 * rest.threshold_mm;
  const auto at = above.begin() + static_cast<std::ptrdiff_t>(above.size() - 1 - above.size() / 50);
  std::nth_element(above.begin(), at, above.end());
  return std::max(2.0 * rest.threshold_mm, static_cast<double>(*at));
}

/// What counts, each place as large as a pixel of the picture: a mean over it would hide pits.
Grid<float> places_of(const cnc::RestMap& rest, int longest_px) {
  const Grid<float>& left = rest.remaining.z_mm;
  Grid<float> places(left.rows(), left.cols(), 0.0F);
  const std::ptrdiff_t longest = std::max(left.rows(), left.cols());
  const std::ptrdiff_t step = std::max<std::ptrdiff_t>(1, (longest + longest_px - 1) / longest_px);
  for (std::ptrdiff_t r = 0; r < left.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < left.cols(); ++c)
      if (static_cast<double>(left(r, c)) > rest.threshold_mm) {
        float& first = places(r / step * step, c / step * step);
        first = std::max(first, left(r, c));
      }
  for (std::ptrdiff_t r = 0; r < left.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < left.cols(); ++c)
      places(r, c) = places(r / step * step, c / step * step);
  return places;
}

}  // namespace

Result<JobResult> reach_job(const Site& site, const fs::path& design_path, const fs::path& folder,
                            const RunContext& run) {
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(design_path));
  MAQUETTE_TRY(const auto reach,
               cnc::map_cutter_reach(design, {0.5 * site.ball_diameter_mm},
                                     Millimetres{site.unreached_mm}, site.max_slope_deg, run));
  JobResult result;
  result.outputs = {folder / "reach.tif", folder / "slope.tif", folder / "reach.png",
                    folder / "slope.png", folder / "reach.json"};
  const double colour_mm = reach_limit(reach.rest);
  const double colour_deg = site.max_slope_deg < 90.0
                                ? site.max_slope_deg
                                : std::max(10.0, 10.0 * std::ceil(reach.slope.highest_deg / 10.0));
  MAQUETTE_TRY_VOID(
      heightmap::write_model_grid(reach.rest.remaining.z_mm, design, "mm", result.outputs[0]));
  MAQUETTE_TRY_VOID(
      heightmap::write_model_grid(reach.slope.steepest_deg, design, "degree", result.outputs[1]));
  MAQUETTE_TRY_VOID(camera::write_png(
      signed_picture(places_of(reach.rest, kPicture_px), colour_mm, &design, kPicture_px),
      result.outputs[2]));
  MAQUETTE_TRY_VOID(camera::write_png(signed_picture(reach.slope.steepest_deg, colour_deg, &design),
                                      result.outputs[3]));
  const double stock_mm = site.base_thickness_mm + reach.relief_mm + site.stock_margin_mm;
  result.figures_json = json{
      {"ball_diameter_mm", site.ball_diameter_mm},
      {"threshold_mm", reach.rest.threshold_mm},
      {"unreached_percent", 100.0 * reach.unreached_share},
      {"unreached_area_mm2", reach.rest.area_mm2},
      {"unreached_volume_mm3", reach.rest.volume_mm3},
      {"most_left_mm", reach.rest.highest_mm},
      {"most_left_at_mm", {reach.deepest_x_mm, reach.deepest_y_mm}},
      {"steepest_deg", reach.slope.highest_deg},
      {"steepest_at_mm", {reach.slope.highest_x_mm, reach.slope.highest_y_mm}},
      {"slope_limit_deg", site.max_slope_deg},
      {"above_slope_limit_percent", 100.0 * reach.slope.share_above},
      {"relief_mm", reach.relief_mm},
      {"cutter_length_mm", site.cutter_length_mm},
      {"stock_needed_mm", stock_mm},
      {"stock_height_mm", site.stock_height_mm},
      {"reach_colour_mm", colour_mm},
      {"slope_colour_deg",
       colour_deg}}.dump(1);
  MAQUETTE_TRY_VOID(write_file(result.outputs[4], result.figures_json + "\n"));
  result.note =
      fmt::format("{:.3g} % beyond a ball of {:g} mm, up to {:.0f} degrees steep",
                  100.0 * reach.unreached_share, site.ball_diameter_mm, reach.slope.highest_deg);
  result.unmet = fmt::format("{}", fmt::join(unkept(site, reach, stock_mm), "; "));
  return result;
}

}  // namespace maquette::tools

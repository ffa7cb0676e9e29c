// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/jobs_stone_views.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "core/run_part.hpp"
#include "heightmap/field_io.hpp"
#include "meshing/stones.hpp"
#include "tools/jobs.hpp"

namespace maquette::tools {
namespace {

constexpr std::array<int, 2> kSize_px{1200, 750};
constexpr double kPitch_um = 12.0, kFocal_mm = 25.0;

/// What a picture is of.
struct View {
  std::string name;  ///< of its files
  Vec3 middle;
  double width_mm = 0.0;        ///< that the picture shows there
  double elevation_deg = 30.0;  ///< of the eye, which stands in the south
};

/// Unit vector to a place at `azimuth` (clockwise from north) and `elevation`.
Vec3 direction_to(double azimuth_deg, double elevation_deg) {
  const double a = degrees(azimuth_deg).value(), e = degrees(elevation_deg).value();
  return {std::sin(a) * std::cos(e), std::cos(a) * std::cos(e), std::sin(e)};
}

double area(const meshing::PlacedStone& stone) {
  return stone.scale_mm * stone.scale_mm;
}

View close_view(const std::vector<meshing::PlacedStone>& stones) {
  double largest = 0.0;
  for (const auto& s : stones) largest = std::fmax(largest, s.scale_mm);
  const double reach = 2.0 * largest;
  const meshing::PlacedStone* densest = nullptr;
  double most = -1.0;
  for (const auto& s : stones) {
    const Vec3 at = s.model_from_stone.translation_mm;
    double sum = 0.0;
    for (const auto& o : stones) {
      const Vec3 d = o.model_from_stone.translation_mm - at;
      if (std::hypot(d.x, d.y) <= reach) sum += area(o);
    }
    if (sum > most) most = sum, densest = &s;
  }
  // Its neighbourhood is seen, not that one in the middle.
  Vec3 middle;
  double sum = 0.0;
  for (const auto& o : stones) {
    const Vec3 at = o.model_from_stone.translation_mm;
    const Vec3 d = at - densest->model_from_stone.translation_mm;
    if (std::hypot(d.x, d.y) > reach) continue;
    middle = middle + area(o) * at;
    sum += area(o);
  }
  return {"stones_close", (1.0 / sum) * middle, 3.2 * reach, 26.0};
}

std::string list(Vec3 v) {
  return fmt::format("[{}, {}, {}]", v.x, v.y, v.z);
}

Result<void> write_scene(const Site& site, const View& view, const fs::path& design,
                         const fs::path& stones, const fs::path& scene) {
  const double sensor_mm = kSize_px[0] * kPitch_um / 1000.0;
  const double distance = view.width_mm * kFocal_mm / sensor_mm;
  const Vec3 eye = view.middle + distance * direction_to(180.0, view.elevation_deg);
  const double lamp_distance = std::max(site.lamp_distance_mm, 2.0 * site.size_mm);
  const Vec3 lamp =
      view.middle + lamp_distance * direction_to(site.lamp_azimuth_deg, site.lamp_elevation_deg);
  const auto relative = [&](const fs::path& path) {
    return path.lexically_relative(scene.parent_path()).generic_string();
  };
  // Low light that falls on the ground obliquely: this exposure makes level ground a middle grey.
  constexpr double kLevelGround = 0.28;
  const double exposure =
      kLevelGround /
      (site.albedo * std::fmax(0.1, std::sin(degrees(site.lamp_elevation_deg).value())));
  return write_file(
      scene,
      fmt::format("schema = \"maquette.scene/1\"\nsurface = \"{}\"\nstones = \"{}\"\n"
                  "resolution_px = [{}, {}]\npixel_pitch_um = {}\nfocal_length_mm = {}\n"
                  "camera_position_mm = {}\ncamera_target_mm = {}\n"
                  "lamp_position_mm = {}\nlamp_target_mm = {}\nlamp_preset = \"{}\"\n"
                  "exposure_scale = {}\nalbedo = {}\nreflectance = \"{}\"\nambient = [0.02]\n"
                  "gather_samples = 1\nsamples_per_pixel = {}\nlamp_samples = 1\nseed = {}\n",
                  relative(design), relative(stones), kSize_px[0], kSize_px[1], kPitch_um,
                  kFocal_mm, list(eye), list(view.middle), list(lamp), list(view.middle), site.lamp,
                  exposure, site.albedo, site.reflectance, site.samples_per_pixel, site.seed));
}

}  // namespace

Result<JobResult> stone_views_job(const Site& site, const fs::path& design_path,
                                  const fs::path& stones_path, const fs::path& folder,
                                  const RunContext& run) {
  MAQUETTE_TRY(const auto stones, meshing::read_stone_plan(stones_path));
  JobResult result;
  if (stones.empty()) {
    result.note = "no stones";
    return result;
  }
  MAQUETTE_TRY(const auto design, heightmap::read_model_field(design_path));
  const double x = 0.5 * (design.x_mm(0) + design.x_mm(design.z_mm.cols() - 1));
  const double y = 0.5 * (design.y_mm(0) + design.y_mm(design.z_mm.rows() - 1));
  // Its nearer side is seen wider than its middle, so a place before that is the picture's.
  const double before = y - 0.07 * site.size_mm;
  const View far{
      "stones_far", {x, before, heightmap::height_at(design, x, before)}, 1.3 * site.size_mm, 38.0};
  double share = 0.0;
  nlohmann::json figures{{"stones", stones.size()}};
  for (const View& view : {far, close_view(stones)}) {
    const fs::path scene = folder / (view.name + ".toml"), png = folder / (view.name + ".png");
    MAQUETTE_TRY_VOID(write_scene(site, view, design_path, stones_path, scene));
    MAQUETTE_TRY(const auto made, render_job(scene, png, part(run, share, share + 0.5)));
    share += 0.5;
    result.outputs.push_back(png);
    result.outputs.push_back(scene);
    figures[view.name] = {{"middle_mm", {view.middle.x, view.middle.y, view.middle.z}},
                          {"width_mm", view.width_mm}};
  }
  result.figures_json = figures.dump();
  result.note = fmt::format("{} stones from afar and close up", stones.size());
  return result;
}

}  // namespace maquette::tools

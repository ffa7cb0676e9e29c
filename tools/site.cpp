// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/site.hpp"

#include <algorithm>
#include <array>
#include <cmath>

#include <fmt/format.h>

#include "assets/devices.hpp"
#include "cnc/feeds.hpp"
#include "cnc/machine.hpp"
#include "core/check.hpp"
#include "meshing/mesh_io.hpp"
#include "tools/scanner_file.hpp"
#include "tools/shape_of_site.hpp"
#include "tools/sphere_file.hpp"

namespace maquette::tools {
namespace {

constexpr std::size_t kMostSources = 100;  // source.tif adds 100 where detail is synthetic
constexpr std::array<std::int64_t, 9> kWorkOffsets{54, 55, 56, 57, 58, 59, 591, 592, 593};

template <class Preset>
std::vector<std::string> preset_names(const std::vector<Preset>& presets) {
  std::vector<std::string> names;
  for (const Preset& p : presets) names.push_back(p.name);
  return names;
}

bool has_strategy(const Site& s, std::string_view strategy) {
  return std::any_of(s.operations.begin(), s.operations.end(),
                     [&](const Operation& o) { return o.strategy == strategy; });
}

/// Which bodies the sources show, and whether they can be combined as asked.
void check_bodies(const Site& s, std::vector<std::string>& found) {
  if (s.sources.size() > kMostSources)
    found.push_back(fmt::format("{} sources; source.tif can tell {} from each other",
                                s.sources.size(), kMostSources));
  const auto foreign = [&](const SiteSource& source) {
    return source.body != "site" && source.body != s.body;
  };
  const auto other = std::find_if(s.sources.begin(), s.sources.end(), foreign);
  if (s.combine == "same_body") {
    if (other != s.sources.end())
      found.push_back(fmt::format(
          "source '{}' is of {}, the site of {}: different bodies are not aligned; fusion.combine "
          "= \"composite\" puts its short waves on the site's relief",
          other->name, other->body, s.body));
    return;
  }
  if (other == s.sources.end())
    found.push_back(
        fmt::format("fusion.combine composite: all sources are of {}; name those of "
                    "another body (body = ...), or take same_body, which aligns them",
                    s.body));
  else if (other == s.sources.begin())
    found.push_back(
        fmt::format("fusion.combine composite: source '{}' of {} stands first; first "
                    "come those of {}, whose relief the site has",
                    other->name, other->body, s.body));
  for (auto i = other; i != s.sources.end(); ++i)
    if (i->body != other->body)
      found.push_back(
          fmt::format("fusion.combine composite: source '{}' of {} stands after those "
                      "of {}; the site's come first, all others are of one body",
                      i->name, foreign(*i) ? i->body : s.body, other->body));
  if (s.crater_age_gyr > 0.0)
    found.emplace_back(
        "fusion.crater_age_gyr: the detail of a composite has its own craters; set it to 0");
}

/// Whether each crater has a rim on the site.
void check_craters(const Site& s, std::vector<std::string>& found) {
  if (s.stone_density == "craters" && s.craters.empty())
    found.emplace_back(
        "stones.density craters: which ones? Name them in [[crater]] tables (east_m, north_m, "
        "diameter_m), or take even");
  const double half_m = half_width_m(s, s.scales.front());
  for (const SiteCrater& c : s.craters) {
    const double dx = std::abs(c.east_m), dy = std::abs(c.north_m), radius = 0.5 * c.diameter_m;
    const double nearest = std::hypot(std::fmax(0.0, dx - half_m), std::fmax(0.0, dy - half_m));
    const double farthest = std::hypot(dx + half_m, dy + half_m);
    if (radius < nearest || radius > farthest)
      found.push_back(fmt::format(
          "crater at east_m {:g} north_m {:g}: its rim of diameter_m {:g} does not cross "
          "the site of {:g} m x {:g} m",
          c.east_m, c.north_m, c.diameter_m, 2 * half_m, 2 * half_m));
  }
}

/// What no single key can say about itself. One message a finding.
std::vector<std::string> contradictions(const Site& s) {
  std::vector<std::string> found;
  const double cells = s.size_mm / s.spacing_mm;
  if (std::fabs(cells - std::round(cells)) > 1e-9 * cells || cells < 4)
    found.push_back(fmt::format("size_mm {} is not a whole number (>= 4) of spacing_mm {}",
                                s.size_mm, s.spacing_mm));
  for (std::size_t i = 1; i < s.scales.size(); ++i)
    if (!(s.scales[i] < s.scales[i - 1]))
      found.emplace_back(
          "scales must descend: the whole site first (1000), then sections of it (200)");
  check_bodies(s, found);
  for (const SiteSource& source : s.sources)
    if (source.seams_m.size() % 4 != 0)
      found.push_back(fmt::format(
          "source '{}': seams_m has {} numbers; four a seam expected: x and y of begin and end",
          source.name, source.seams_m.size()));
  if (s.stone_min_diameter_m >= s.stone_max_diameter_m)
    found.push_back(fmt::format("stones.min_diameter_m {} must be below stones.max_diameter_m {}",
                                s.stone_min_diameter_m, s.stone_max_diameter_m));
  const double site_m = 2.0 * half_width_m(s, s.scales.front());
  if (s.stone_count < 0 && s.stone_min_diameter_m >= site_m)
    found.push_back(
        fmt::format("stones.min_diameter_m {}: no such stone fits the site of {:g} m x {:g} m",
                    s.stone_min_diameter_m, site_m, site_m));
  for (const SiteStones& own : s.own_stones) {
    if (own.places_m.size() % 2 != 0)
      found.push_back(
          fmt::format("stone '{}': places_m has {} numbers; two a stone expected: east "
                      "and north of the site's centre",
                      own.file.filename().string(), own.places_m.size()));
    if (own.diameter_m > 0.0 && own.scale > 0.0)
      found.push_back(
          fmt::format("stone '{}': diameter_m and scale both say how large it is; give "
                      "one of them",
                      own.file.filename().string()));
  }
  check_craters(s, found);
  if (s.build_mm.size() != 3)
    found.push_back(fmt::format("stone_parts.build_mm has {} numbers; three expected: x, y, z",
                                s.build_mm.size()));
  if (const Shape shape = shape_of(s, s.scales.front()); !shape.label.empty())
    if (const auto mark = meshing::text_mark(shape.label, shape.engraving); !mark)
      found.push_back("solid.label: " + mark.error().message);
  if (s.stepover_mm >= s.ball_diameter_mm)
    found.push_back(fmt::format("mill.stepover_mm {} must be below cutter.ball_diameter_mm {}",
                                s.stepover_mm, s.ball_diameter_mm));
  if (s.stated_stepover_mm > 0.0 && s.excess_limit_mm == 0.0)
    found.push_back(
        "mill.stated_stepover_mm is what mill.excess_limit_mm counts from; give both or neither");
  if (s.stated_stepover_mm > 0.0 &&
      (s.stated_stepover_mm < s.stepover_mm || s.stated_stepover_mm >= s.ball_diameter_mm))
    found.push_back(
        fmt::format("mill.stated_stepover_mm {} must be from mill.stepover_mm {} to below "
                    "cutter.ball_diameter_mm {}",
                    s.stated_stepover_mm, s.stepover_mm, s.ball_diameter_mm));
  const bool adjusted = !s.compensate.empty() || !s.corrections.empty();
  if (adjusted && s.relative)
    found.emplace_back(
        "mill.relative: programs that mill.compensate or mill.corrections rewrite are of absolute "
        "moves (G90); set it to false");
  if (adjusted && s.post == "heidenhain")
    found.emplace_back(
        "machine.post heidenhain: its programs are not rewritten; leave mill.compensate and "
        "mill.corrections out and enter the errors in the control's own tables");
  if (adjusted && !s.extended.empty())
    found.emplace_back(
        "verify.extended: its causes are those that mill.compensate makes good already, and would "
        "be counted twice; `maquette compensate --extended` says what is gained");
  const auto first = std::find(kWorkOffsets.begin(), kWorkOffsets.end(), s.work_offset);
  const double bands = s.work_offset_per_band ? std::ceil(s.size_mm / s.band_max_width_mm) : 1.0;
  if (first == kWorkOffsets.end())
    found.push_back(fmt::format("mill.work_offset {} must be one of {}", s.work_offset,
                                fmt::join(kWorkOffsets, ", ")));
  else if (bands > static_cast<double>(kWorkOffsets.end() - first))
    found.push_back(
        fmt::format("mill.work_offset_per_band: {} bands need as many work offsets from G{} on; "
                    "take wider bands (bands.max_width_mm) or one offset for all",
                    bands, s.work_offset));
  if (s.spacing_mm > s.ball_diameter_mm)
    found.push_back(fmt::format("spacing_mm {} must not exceed cutter.ball_diameter_mm {}",
                                s.spacing_mm, s.ball_diameter_mm));
  if (s.rough_corner_radius_mm > 0.5 * s.rough_diameter_mm)
    found.push_back(
        fmt::format("rough.corner_radius_mm {} must be at most half of "
                    "rough.diameter_mm {}",
                    s.rough_corner_radius_mm, s.rough_diameter_mm));
  if (s.rough_stepover_mm > 0.9 * s.rough_diameter_mm)
    found.push_back(fmt::format("rough.stepover_mm {} must be at most 0.9 of rough.diameter_mm {}",
                                s.rough_stepover_mm, s.rough_diameter_mm));
  if (s.rough_cell_mm > 0.125 * s.rough_diameter_mm)
    found.push_back(
        fmt::format("rough.cell_mm {} must be at most an eighth of rough.diameter_mm {}",
                    s.rough_cell_mm, s.rough_diameter_mm));
  if (s.spheres.empty() && has_strategy(s, "sphere-seats"))
    found.emplace_back("operation sphere-seats needs spheres.file: which spheres, and where");
  if (s.samples_per_pixel !=
      std::llround(std::pow(std::round(std::sqrt(static_cast<double>(s.samples_per_pixel))), 2)))
    found.push_back(
        fmt::format("camera.samples_per_pixel {} must be a square number", s.samples_per_pixel));
  return found;
}

}  // namespace

Schema image_schema(SiteImage& image) {
  Schema e;
  e.add({"name", &image.name, "for messages", -INFINITY, INFINITY, {}, true});
  e.add({"path",
         &image.path,
         "what GDAL opens; brightness in any unit, 0 is no image",
         -INFINITY,
         INFINITY,
         {},
         true});
  e.add(
      {"sun_azimuth_deg", &image.sun_azimuth_deg, "at the site, clockwise from north", -360, 360});
  e.add({"sun_elevation_deg", &image.sun_elevation_deg, "above the horizon", 1, 89});
  e.add({"lunar_lambert", &image.lunar_lambert,
         "weight of Lommel-Seeliger in the reflectance, the rest is Lambert's (McEwen's L)", 0, 1});
  e.add({"noise", &image.noise, "of a pixel, relative to its brightness", 1e-5, 1});
  e.add({"albedo_contrast", &image.albedo_contrast, "relative standard deviation of the albedo", 0,
         2});
  e.add({"albedo_length_m", &image.albedo_length_m, "over which the albedo is alike", 1e-3, 1e6});
  return e;
}

Schema own_stones_schema(SiteStones& stones) {
  Schema e;
  e.add({"file",
         &stones.file,
         "closed mesh: STL, PLY, OBJ or glTF, z up (of a glTF y)",
         -INFINITY,
         INFINITY,
         {},
         true});
  e.add({"unit",
         &stones.unit,
         "of its coordinates; file: mm, of a glTF m",
         -INFINITY,
         INFINITY,
         {"file", "mm", "cm", "m", "inch"}});
  e.add({"scale", &stones.scale,
         "1:N of what it shows: 1 the stone on the planet; 0: a model of it at the first scale", 0,
         1e7});
  e.add({"diameter_m", &stones.diameter_m, "on the planet; 0: as the file says", 0, 1e4});
  e.add({"count", &stones.count, "that lie where there is room", 0, 100000});
  e.add({"places_m", &stones.places_m,
         "of further ones: east and north of the site's centre, two numbers a stone", -1e7, 1e7});
  e.add({"heading_deg", &stones.heading_deg,
         "of x of the file, from east towards north; drawn unless given", -360, 360});
  return e;
}

Schema crater_schema(SiteCrater& crater) {
  Schema e;
  e.add({"east_m", &crater.east_m, "of its middle, from the site's centre", -1e7, 1e7, {}, true});
  e.add({"north_m", &crater.north_m, "the same", -1e7, 1e7, {}, true});
  e.add({"diameter_m", &crater.diameter_m, "of its rim, on the planet", 1e-3, 1e7, {}, true});
  return e;
}

SiteFile empty_site_file() {
  SiteFile file;
  Site& s = *file.site;
  Schema& t = file.schema;
  constexpr double kInf = INFINITY;
  t.section("", "A mock-up for maquette. Every key has its unit in its name; all have defaults.");
  t.add(
      {"schema", &s.schema_name, "version of this file's keys", -kInf, kInf, {"maquette.site/1"}});
  t.add({"name", &s.name, "for file headers and the report"});
  t.add({"body", &s.body, "whose surface it is", -kInf, kInf, {"moon", "mars"}});
  t.add({"centre_latitude_deg", &s.centre_latitude_deg, "planetocentric, north positive", -90, 90});
  t.add({"centre_longitude_deg", &s.centre_longitude_deg, "east positive", -180, 360});
  t.add({"size_mm", &s.size_mm, "edge of each square model surface", 1, 20000});
  t.add({"spacing_mm", &s.spacing_mm, "distance of the surface's nodes", 0.01, 10});
  t.add({"scales", &s.scales, "1:N of each surface; the first is the whole site", 1, 1e7});
  t.add({"exaggeration", &s.exaggeration, "vertical factor; 1 is true to scale", 0.01, 100});
  t.add({"seed", &s.seed, "of everything drawn at random", 0, 1e15});

  t.section("fusion", "How the sources become one surface.");
  t.add({"fusion.synthetic_detail", &s.synthetic_detail,
         "strength of relief below the finest source's pixel, marked as synthetic; 0: none", 0, 5});
  t.add({"fusion.crater_age_gyr", &s.crater_age_gyr,
         "age of the ground: synthetic detail has Neukum's craters of that age, up to equilibrium "
         "(3.5 lunar mare, 3.9 highlands); 0: none",
         0, 4.5});
  t.add({"fusion.restore", &s.restore,
         "waves as strong as relief is: noise is lowered, what wide pixels weaken is raised"});
  t.add({"fusion.joint", &s.joint,
         "three and more sources are aligned at once; false: each onto those before it"});
  t.add({"fusion.combine",
         &s.combine,
         "same_body: all sources show one ground and are aligned; composite: long waves of the "
         "site's sources, short ones of those of another body (docs/sources.md)",
         -kInf,
         kInf,
         {"same_body", "composite"}});
  t.add({"fusion.crossover_m", &s.crossover_m,
         "of a composite: wavelength at which detail takes over; 0: four pixels of the relief", 0,
         1e6});
  t.add({"fusion.detail_latitude_deg", &s.detail_latitude_deg,
         "of a composite: centre of the detail on its body, planetocentric", -90, 90});
  t.add({"fusion.detail_longitude_deg", &s.detail_longitude_deg,
         "of a composite: the same, east positive", -180, 360});
  t.add({"fusion.synthetic_seed", &s.synthetic_seed,
         "of the embedded site, used when no [[source]] is given", 0, 1e15});

  t.section("stones", "Rocks that are made apart and glued on.");
  t.add({"stones.count", &s.stone_count,
         "on the first surface; -1: as many as the law of area_fraction_k has from min_diameter_m "
         "to max_diameter_m on its area",
         -1, 100000});
  t.add({"stones.inner_share", &s.stone_inner_share,
         "share of them that lies on the second surface too", 0, 1});
  t.add({"stones.min_diameter_m", &s.stone_min_diameter_m, "smallest, on the planet", 1e-3, 1e4});
  t.add({"stones.max_diameter_m", &s.stone_max_diameter_m, "largest, on the planet", 1e-3, 1e4});
  t.add({"stones.area_fraction_k", &s.stone_k,
         "Golombek-Rapp's k, the share of the ground under rocks of all sizes: says how sizes are "
         "distributed and, with count -1, how many there are",
         0.005, 0.5});
  t.add({"stones.shapes", &s.stone_shapes,
         "distinct ones, so that a workshop can make a catalogue of them; 0: each stone its own", 0,
         1000});
  t.add({"stones.sizes", &s.stone_sizes,
         "distinct ones, at equal ratios from the smallest to the largest; 0: each stone its own",
         0, 1000});
  t.add({"stones.angularity", &s.stone_angularity, "0 rounded to 1 angular", 0, 1});
  t.add({"stones.embedded_share", &s.stone_embedded_share, "of a stone's height in the ground", 0,
         0.9});
  t.add({"stones.rest",
         &s.stone_rest,
         "fitted: base along the ground; settled: on three contacts that hold the centre of mass, "
         "nowhere steeper than repose_deg (docs/stones.md)",
         -kInf,
         kInf,
         {"fitted", "settled"}});
  t.add({"stones.repose_deg", &s.stone_repose_deg,
         "friction angle of settled stones: on steeper ground they slide", 1, 89});
  t.add({"stones.density",
         &s.stone_density,
         "even, or craters: denser around the rims of [[crater]], by travel distance along the "
         "surface",
         -kInf,
         kInf,
         {"even", "craters"}});
  t.add({"stones.decay_m", &s.stone_decay_m,
         "craters: travel distance from a rim over which the density falls to 1/e", 1e-3, 1e6});
  t.add({"stones.far_share", &s.stone_far_share,
         "craters: density far from all rims, as a share of that at them", 0, 1});
  t.add({"stones.slope_slowness", &s.stone_slope_slowness,
         "craters: a metre on a slope of angle a counts as 1 + this * tan(a)", 0, 1000});

  t.section(
      "stone_parts",
      "Files for the workshop that makes the stones (docs/stones.md): a part of each distinct "
      "stone, packed build volumes, the placing plan.");
  t.add({"stone_parts.make", &s.stone_parts, "where the site has stones"});
  t.add({"stone_parts.clearance_mm", &s.part_clearance_mm,
         "parts are smaller by that on every side", 0, 100});
  t.add({"stone_parts.wall_mm", &s.part_wall_mm,
         "least wall of the sintering process; what lacks it is warned of", 1e-3, 100});
  t.add({"stone_parts.build_mm", &s.build_mm, "the machine's build volume: x, y, z", 1, 1e5});
  t.add({"stone_parts.spacing_mm", &s.part_spacing_mm, "between parts in it", 0, 1000});
  t.add({"stone_parts.paper", &s.placing_paper, "of placing.pdf", -kInf, kInf, {"a4", "a3"}});

  t.section("stock", "The block.");
  t.add({"stock.base_thickness_mm", &s.base_thickness_mm, "under the lowest point of the relief", 1,
         1000});
  t.add({"stock.lowest_mm", &s.lowest_mm, "model height of the lowest point of the relief", -1000,
         1000});

  t.add({"stock.margin_mm", &s.stock_margin_mm, "of the block above the highest point", 0, 1000});

  t.add({"stock.material", &s.material,
         "feeds and spindle follow from it: a name that `maquette mill --help` lists, or a .toml "
         "file"});

  t.section("bands", "Strips that are milled one at a time.");
  t.add({"bands.max_width_mm", &s.band_max_width_mm, "in y", 1, 20000});
  t.add({"bands.avoid_stones", &s.avoid_stones,
         "joints keep off the stones, with more bands where these need it; false: bands as even as "
         "whole cells allow"});
  t.add({"bands.stone_clearance_mm", &s.joint_clearance_mm, "from a joint to the nearest stone", 0,
         1000});
  t.add({"bands.dowel_mm", &s.dowel_mm,
         "diameter of dowels that hold the strips together (docs/bands.md), in their solids only; "
         "0: none",
         0, 1000});
  t.add({"bands.dowel_depth_mm", &s.dowel_depth_mm, "of their holes, in each strip", 0.1, 1000});
  t.add({"bands.dowel_play_mm", &s.dowel_play_mm, "that holes are wider", 0, 10});
  t.add({"bands.dowel_wall_mm", &s.dowel_wall_mm, "least material around holes", 0.1, 1000});
  t.add({"bands.dowel_spacing_mm", &s.dowel_spacing_mm, "along a joint, at most", 1, 10000});
  t.add({"bands.magnet_mm", &s.magnet_mm,
         "diameter of round magnets, between the dowels if there are some; 0: none", 0, 1000});
  t.add({"bands.magnet_depth_mm", &s.magnet_depth_mm, "of their holes, in each strip", 0.1, 1000});
  t.add({"bands.magnet_play_mm", &s.magnet_play_mm, "that holes are wider", 0, 10});
  t.add({"bands.magnet_wall_mm", &s.magnet_wall_mm, "least material around holes", 0.1, 1000});
  t.add({"bands.magnet_spacing_mm", &s.magnet_spacing_mm,
         "along a joint, at most, where there are no dowels", 1, 10000});

  t.section("solid",
            "What is not plain of the solids, surface.ply and the bands' (docs/solids.md): their "
            "underside and a wall; programs mill the top only.");
  t.add({"solid.hollow_mm", &s.hollow_mm,
         "opens the underside, leaves walls at least that thick; 0: solid", 0, 1000});
  t.add({"solid.rib_mm", &s.rib_mm, "thickness of ribs between pockets", 0.1, 1000});
  t.add({"solid.pocket_mm", &s.pocket_mm, "widest pocket between ribs", 1, 10000});
  t.add({"solid.ceiling_step_mm", &s.ceiling_step_mm,
         "widest triangles of the pockets' ceilings; 0: four spacings", 0, 1000});
  t.add({"solid.label", &s.label,
         "text in a wall, {scale} in it becomes 1:1000; bands add their number; empty: none"});
  t.add({"solid.scale_bar", &s.scale_bar, "in the same wall"});
  t.add({"solid.label_side",
         &s.label_side,
         "which wall",
         -kInf,
         kInf,
         {"south", "east", "north", "west"}});
  t.add({"solid.letter_mm", &s.letter_mm, "height of engraved capitals", 0.1, 1000});
  t.add({"solid.engrave_depth_mm", &s.engrave_depth_mm, "of engraved strokes", 0.02, 1000});
  t.add({"solid.stroke_mm", &s.stroke_mm,
         "width of engraved strokes; 0: an eighth of the letters' height", 0, 1000});

  t.section("spheres", "Reference spheres that tie a scan to the machine.");
  t.add({"spheres.file", &s.spheres,
         "of docs/spheres.md: their bores are milled last, unless an operation sphere-seats says "
         "when, and touch.ngc probes them (LinuxCNC)"});

  t.section("cutter", "");
  t.add({"cutter.ball_diameter_mm", &s.ball_diameter_mm, "of the ball nose", 0.1, 100});

  t.section(
      "reach",
      "What the design asks of cutter and block. A limit that it does not keep ends with exit "
      "code 1.");
  t.add({"reach.unreached_mm", &s.unreached_mm,
         "more than this left by the ball where it does not fit counts as not reached", 1e-3, 10});
  t.add({"reach.max_unreached_percent", &s.max_unreached_percent, "of the surface; 100: no limit",
         0, 100});
  t.add({"reach.max_slope_deg", &s.max_slope_deg, "from level; 90: no limit", 0, 90});
  t.add({"reach.cutter_length_mm", &s.cutter_length_mm,
         "of the finishing cutter below its holder, for the whole relief; 0: no limit", 0, 1000});
  t.add({"reach.stock_height_mm", &s.stock_height_mm,
         "of the block, for base, relief and margin; 0: no limit", 0, 10000});

  t.section("mill", "The finishing pass.");
  t.add({"mill.stepover_mm", &s.stepover_mm, "distance of neighbouring passes", 0.01, 50});
  t.add(
      {"mill.tolerance_mm", &s.tolerance_mm, "of the written path, all causes together", 1e-4, 1});
  t.add({"mill.direction_deg", &s.direction_deg, "of the passes, counter-clockwise from +x", -180,
         180});
  t.add({"mill.zigzag", &s.zigzag, "false: all passes in one direction"});
  t.add({"mill.climb", &s.climb, "one way: climb milling, else conventional"});
  t.add({"mill.arcs", &s.arcs, "G2 and G3 where passes run along an axis"});
  t.add({"mill.constant_scallop", &s.constant_scallop,
         "more passes where it is steep, so that ridges stay below the limit"});
  t.add({"mill.scallop_limit_mm", &s.scallop_limit_mm, "height of ridges, normal to the surface",
         1e-4, 10});
  t.add({"mill.excess_limit_mm", &s.excess_limit_mm,
         "what passes may leave above the scallop of the slope; cuts across to pits, each a stop; "
         "0: none",
         0, 1});
  t.add({"mill.stated_stepover_mm", &s.stated_stepover_mm,
         "passes whose scallop the excess limit counts from, if mill.stepover_mm is closer than "
         "that: fewer cuts across; 0: mill.stepover_mm",
         0, 50});
  t.add({"mill.feed_mm_per_min", &s.feed_mm_per_min,
         "along the path; 0: from stock.material and machine.name, which it must not exceed", 0,
         100000});
  t.add({"mill.plunge_feed_mm_per_min", &s.plunge_feed_mm_per_min, "downwards; 0: the same", 0,
         100000});
  t.add({"mill.spindle_rpm", &s.spindle_rpm, "0: the same", 0, 200000});
  t.add(
      {"mill.clearance_mm", &s.clearance_mm, "of rapid moves above the highest point", 0.1, 1000});
  t.add({"mill.relative", &s.relative,
         "cuts by how far they go (G91), for controls that add exactly: LinuxCNC, Fanuc, Haas"});
  t.add({"mill.compensate", &s.compensate,
         "compensation.toml of diagnose: programs are called so that a machine with these errors "
         "cuts what they mean (docs/compensation.md)"});
  t.add({"mill.corrections", &s.corrections,
         "corrections.toml of deviate: where the part and the machine's axes x, y, z really are"});
  t.add({"mill.corrections_for",
         &s.corrections_for,
         "this: the part lies there still; next: the machine will displace the next one as this",
         -kInf,
         kInf,
         {"this", "next"}});
  t.add({"mill.work_offset", &s.work_offset,
         "54 to 59; 591 to 593 for G59.1 to G59.3; all programs are in the model's frame", 54,
         593});
  t.add({"mill.work_offset_per_band", &s.work_offset_per_band,
         "each band its own, counted on from mill.work_offset"});

  t.section("rough", "Roughing, level by level, before the finishing pass.");
  t.add({"rough.enabled", &s.roughing, "false: the block is roughed otherwise"});
  t.add({"rough.diameter_mm", &s.rough_diameter_mm, "of the cutter, tool 2", 0.5, 200});
  t.add({"rough.corner_radius_mm", &s.rough_corner_radius_mm, "0: flat end", 0, 100});
  t.add({"rough.stepover_mm", &s.rough_stepover_mm, "at most 0.9 of the diameter", 0.05, 180});
  t.add({"rough.step_down_mm", &s.rough_step_down_mm, "between levels", 0.1, 200});
  t.add({"rough.allowance_mm", &s.rough_allowance_mm, "left for the finishing pass", 0, 50});
  t.add({"rough.ramp_deg", &s.rough_ramp_deg, "steepest way down in material", 0.5, 45});
  t.add({"rough.cell_mm", &s.rough_cell_mm,
         "grid it is planned on, at most an eighth of the diameter", 0.05, 20});

  t.section("machine", "");
  t.add({"machine.name", &s.machine, "preset with travel and limits", -kInf, kInf,
         cnc::machine_names()});
  t.add({"machine.post",
         &s.post,
         "dialect of the controller",
         -kInf,
         kInf,
         {"linuxcnc", "grbl", "fanuc", "haas", "heidenhain"}});
  t.add({"machine.max_lines", &s.max_lines, "of one program file, longer ones are split; 0: any", 0,
         1e12});
  t.add({"machine.max_bytes", &s.max_bytes, "the same in bytes", 0, 1e15});

  t.section("verify", "The program is read back and cut in simulation.");
  t.add({"verify.extended", &s.extended,
         "extended.toml of diagnose: its causes make as_built.tif of the cut, which is scanned"});
  t.add({"verify.cell_mm", &s.verify_cell_mm, "grid of the simulated stock", 0.01, 5});
  t.add({"verify.max_gouge_mm", &s.max_gouge_mm, "deeper, bound included, ends with exit code 1", 0,
         10});

  t.section("export", "");
  t.add({"export.formats",
         &s.export_formats,
         "files of the solid",
         -kInf,
         kInf,
         {"stl", "ply", "obj", "3mf", "step", "dxf", "glb", "usda"}});
  t.add({"export.lod_triangles", &s.lod_triangles, "of the decimated level", 100, 1e8});
  t.add({"export.position_bits", &s.position_bits, "Draco quantisation", 8, 24});
  t.add({"export.contour_interval_mm", &s.contour_interval_mm, "of the DXF", 0.01, 1000});
  t.add({"export.step_tolerance_mm", &s.step_tolerance_mm,
         "of the STEP's patches from the surface's nodes", 1e-4, 10});
  t.add({"export.step_schema",
         &s.step_schema,
         "application protocol of the STEP",
         -kInf,
         kInf,
         {"ap214", "ap242"}});

  t.section("camera", "");
  t.add({"camera.name", &s.camera, "preset", -kInf, kInf, preset_names(assets::camera_presets())});
  t.add({"camera.azimuth_deg", &s.camera_azimuth_deg,
         "of the camera seen from the part's middle, "
         "clockwise from north",
         -360, 360});
  t.add({"camera.elevation_deg", &s.camera_elevation_deg, "above the horizon", 1, 90});
  t.add({"camera.distance_mm", &s.camera_distance_mm, "to the middle; 0: the part fills the frame",
         0, 1e6});
  t.add({"camera.samples_per_pixel", &s.samples_per_pixel, "a square number", 1, 1024});

  t.section("lamp", "");
  t.add({"lamp.name", &s.lamp, "preset", -kInf, kInf, preset_names(assets::lamp_presets())});
  t.add({"lamp.azimuth_deg", &s.lamp_azimuth_deg, "clockwise from north", -360, 360});
  t.add({"lamp.elevation_deg", &s.lamp_elevation_deg, "above the horizon", 1, 90});
  t.add({"lamp.distance_mm", &s.lamp_distance_mm, "to the part's middle; at least its diagonal", 1,
         1e9});
  t.add({"lamp.samples", &s.lamp_samples, "points on the lens per camera sample", 1, 1024});

  t.section("surface", "How it reflects.");
  t.add({"surface.reflectance",
         &s.reflectance,
         "model",
         -kInf,
         kInf,
         {"lambert", "lommel_seeliger", "lunar_lambert"}});
  t.add({"surface.albedo", &s.albedo, "", 0.001, 1});

  t.section("scanner", "");
  t.add({"scanner.name", &s.scanner, "preset", -kInf, kInf, scanner_names()});
  t.add({"scanner.stations", &s.stations, "evenly round the part", 1, 36});
  t.add({"scanner.elevation_deg", &s.scanner_elevation_deg, "of the stations", 5, 90});
  t.add({"scanner.distance_mm", &s.scanner_distance_mm, "from the part's border", 10, 1e6});
  t.add({"scanner.max_points", &s.max_points, "per station", 1000, 2e8});
  t.add({"scanner.footprint_rays", &s.footprint_rays,
         "1: rays, as a fine scanner; 7: the preset's beam with its blur and mixed pixels (not of "
         "structured light)",
         1, 10000});

  t.section("deviation", "");
  t.add({"deviation.reach_mm", &s.reach_mm, "farther points are off the part", 0.01, 1000});

  t.array(
      "operation",
      "What is milled, one after the other; none: rough (if enabled) and raster, as the sections "
      "above say. Remove the # to have others (docs/operations.md); keys that are not given are "
      "as those sections and the strategy have them.",
      [&s] { return operation_schema(s.operations.emplace_back(), cutting_strategies()); });
  t.array("stone",
          "Stones of your own, beside those that [stones] draws. Remove the # to use them "
          "(docs/stones.md).",
          [&s] { return own_stones_schema(s.own_stones.emplace_back()); });
  t.array(
      "crater",
      "Craters of the site that stones lie around, if stones.density = \"craters\". Remove the # "
      "to use them.",
      [&s] { return crater_schema(s.craters.emplace_back()); });
  t.array(
      "source",
      "Elevation products, coarse to fine; none: the embedded site is generated. Remove the # "
      "to use your own; ${NAME} takes a path from the environment.",
      [&s] {
        SiteSource& source = s.sources.emplace_back();
        Schema e;
        e.add({"name",
               &source.name,
               "for messages and the source mask",
               -INFINITY,
               INFINITY,
               {},
               true});
        e.add({"path",
               &source.path,
               "what GDAL opens: image, label or VRT",
               -INFINITY,
               INFINITY,
               {},
               true});
        e.add({"body",
               &source.body,
               "whose ground it shows: the site's, or another's in a composite",
               -INFINITY,
               INFINITY,
               {"site", "moon", "mars"}});
        e.add({"unit", &source.unit, "of the heights", -INFINITY, INFINITY, {"auto", "m", "km"}});
        e.add({"sigma_m", &source.sigma_m, "standard uncertainty of one pixel", 1e-6, 1e6});
        e.add({"align",
               &source.align,
               "onto the sources before it: shift, height and tilt (auto: height alone where "
               "relief tells no more; required: an error there), height, or none",
               -INFINITY,
               INFINITY,
               {"auto", "required", "height", "none"}});
        e.add({"similarity", &source.similarity, "align turn and scale too"});
        e.add({"clean",
               &source.clean,
               "spikes, stereo boxes, camera seams, ripples, track stripes: not looked for (off), "
               "shown with a higher uncertainty (detect), or taken away where separable (remove)",
               -INFINITY,
               INFINITY,
               {"off", "detect", "remove"}});
        e.add({"bow", &source.bow,
               "align a bow too (waves longer than the site), together with all others"});
        e.add({"seams_m", &source.seams_m,
               "align the step at each CCD seam too: x and y of its begin and end in the site "
               "frame, four numbers a seam",
               -1e7, 1e7});
        return e;
      });
  t.array("image",
          "Images with known sun, map-projected: their shading adds detail that the elevation "
          "products do not show. Remove the # to use your own.",
          [&s] { return image_schema(s.images.emplace_back()); });
  return file;
}

Result<SiteFile> read_site(const std::filesystem::path& path,
                           const std::vector<std::string>& overrides) {
  SiteFile file = empty_site_file();
  MAQUETTE_TRY_VOID(file.schema.read(path, overrides));
  if (const auto material = cnc::find_material(file.site->material); !material)
    return fail(kConfigInvalid, fmt::format("{}: key 'stock.material': {}", path.string(),
                                            material.error().message));
  if (!file.site->spheres.empty())
    if (auto spheres = read_spheres(file.site->spheres); !spheres)
      return tl::unexpected(
          std::move(spheres.error()).within(path.string() + ": key 'spheres.file'"));
  for (const SiteStones& own : file.site->own_stones)
    if (auto there = meshing::is_gltf(own.file); !there)
      return tl::unexpected(std::move(there.error()).within(path.string() + ": [[stone]]"));
  if (const auto found = contradictions(*file.site); !found.empty())
    return fail(kConfigInvalid,
                fmt::format("{}: {}", path.string(),
                            fmt::join(found, fmt::format("\n{}: ", path.string()))));
  return file;
}

std::vector<Operation> operations_of(const Site& site) {
  std::vector<Operation> operations(site.operations.begin(), site.operations.end());
  if (operations.empty()) {
    if (site.roughing) operations.emplace_back().strategy = "rough";
    operations.emplace_back().strategy = "raster";
  }
  if (!site.spheres.empty() && !has_strategy(site, "sphere-seats"))
    operations.emplace_back().strategy = "sphere-seats";
  return operations;
}

bool has_stones(const Site& site) {
  return site.stone_count != 0 || !site.own_stones.empty();
}

std::size_t work_offsets_left(const Site& site) {
  return static_cast<std::size_t>(
      kWorkOffsets.end() - std::find(kWorkOffsets.begin(), kWorkOffsets.end(), site.work_offset));
}

int work_offset_of(const Site& site, std::size_t band) {
  const auto first = std::find(kWorkOffsets.begin(), kWorkOffsets.end(), site.work_offset);
  const auto index = static_cast<std::size_t>(first - kWorkOffsets.begin()) +
                     (site.work_offset_per_band ? band : 0);
  MAQUETTE_CHECK(index < kWorkOffsets.size(), "work offset {} of band {}", site.work_offset, band);
  return static_cast<int>(kWorkOffsets[index]);
}

double half_width_m(const Site& site, double scale) {
  return 0.5 * site.size_mm * scale / 1000.0;
}

}  // namespace maquette::tools

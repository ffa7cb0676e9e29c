// SPDX-License-Identifier: GPL-3.0-or-later

// init, fuse, stones, mesh, bands

#include <fmt/format.h>
#include <CLI/CLI.hpp>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "tools/commands/commands.hpp"
#include "tools/commands/shape_options.hpp"
#include "tools/fuse_page.hpp"
#include "tools/jobs.hpp"
#include "tools/jobs_bands.hpp"
#include "tools/jobs_offset.hpp"
#include "tools/jobs_shaped.hpp"
#include "tools/jobs_simplify.hpp"
#include "tools/jobs_stone_parts.hpp"
#include "tools/jobs_tiles.hpp"
#include "tools/jobs_undercoat.hpp"
#include "tools/machining_time.hpp"
#include "tools/report.hpp"

namespace maquette::tools {

Result<int> finish(Console& console, const std::string& what,
                   const std::function<Result<JobResult>(const RunContext&)>& job) {
  const RunContext run = console.begin(what);
  const auto result = job(run);
  if (!result) {
    console.end("failed");
    return tl::unexpected(result.error());
  }
  console.end(result->note);
  for (const fs::path& f : result->outputs) console.result(f.string());
  const std::string times = machining_time_table(nlohmann::json::parse(result->figures_json));
  if (!times.empty()) console.result(times);
  console.json_result(result->figures_json);
  if (result->unmet.empty()) return 0;
  console.error(result->unmet);
  return 1;
}

Command add_init(CLI::App& root, const CommonOptions&) {
  auto out = std::make_shared<fs::path>("site.toml");
  auto* app = root.add_subcommand("init",
                                  "Writes a commented site file with all keys and defaults.\n"
                                  "Example: maquette init --out crater.toml");
  app->add_option("--out", *out, "file to write; must not exist")->capture_default_str();
  return {app, [out](Console& console) -> Result<int> {
            if (fs::exists(*out))
              return fail(kExists, fmt::format("{}: exists already and is left as it is; choose "
                                               "another --out or remove it",
                                               out->string()));
            MAQUETTE_TRY_VOID(write_file(*out, empty_site_file().schema.template_text()));
            console.result(out->string());
            console.json_result(fmt::format("{{\"site\": \"{}\"}}", out->string()));
            return 0;
          }};
}

namespace {

struct SiteVerb {
  fs::path site, out = "out", design;
  std::vector<std::string> set;
  double scale = 0.0;
};

void site_options(CLI::App* app, SiteVerb& o) {
  app->add_option("site", o.site, "site file")->required();
  app->add_option("--out", o.out, "folder for the results")->capture_default_str();
  app->add_option("--set", o.set, "key=value, overrides the site file (repeatable)")
      ->allow_extra_args(false);
}

std::vector<std::string> with_seed(std::vector<std::string> set, const CommonOptions& common) {
  if (common.seed >= 0) set.push_back(fmt::format("seed={}", common.seed));
  return set;
}

}  // namespace

Command add_fuse(CLI::App& root, const CommonOptions& common) {
  auto o = std::make_shared<SiteVerb>();
  auto* app = root.add_subcommand(
      "fuse",
      "Elevation products to one surface per scale: DIR/s1000/design.tif ...; DIR/fuse.html shows\n"
      "them with uncertainty, sources and what alignment left between them.\n"
      "Example: maquette fuse site.toml --out out");
  site_options(app, *o);
  return {app, [o, &common](Console& console) -> Result<int> {
            MAQUETTE_TRY(const auto file, read_site(o->site, with_seed(o->set, common)));
            const Site& site = *file.site;
            std::vector<SiteSource> sources(site.sources.begin(), site.sources.end());
            if (sources.empty()) {
              const fs::path products = o->out / "products";
              MAQUETTE_TRY_VOID(finish(console, "products", [&](const RunContext& run) {
                return products_job(site, products, run);
              }));
              sources = embedded_sources(site, products);
            }
            int code = 0;
            std::optional<WiderSurface> wider;
            for (const double scale : site.scales) {
              const std::string name = scale_folder(scale);
              const fs::path here = o->out / name;
              MAQUETTE_TRY_VOID(finish(console, name + ".fuse", [&](const RunContext& run) {
                return fuse_job(site, sources, scale, wider, here, run);
              }));
              wider = WiderSurface{here, scale};
              MAQUETTE_TRY(const int kept,
                           finish(console, name + ".reach", [&](const RunContext& run) {
                             return reach_job(site, here / "design.tif", here, run);
                           }));
              code = std::max(code, kept);
            }
            MAQUETTE_TRY_VOID(write_fuse_page(site, o->out));
            return code;
          }};
}

Command add_stones(CLI::App& root, const CommonOptions& common) {
  auto o = std::make_shared<SiteVerb>();
  auto* app = root.add_subcommand(
      "stones",
      "Lays the site's stones on a designed surface: stones.json, stones.csv, surface.tif.\n"
      "Example: maquette stones site.toml --design out/s1000/design.tif --scale 1000 "
      "--other out/s200/design.tif --out out/s1000");
  site_options(app, *o);
  app->add_option("--design", o->design, "model field (.tif)")->required();
  app->add_option("--scale", o->scale, "N of its scale 1:N")->required();
  auto others = std::make_shared<std::vector<fs::path>>();
  app->add_option("--other", *others,
                  "designs of the site's other scales, in their order, with fuse.json beside: "
                  "stones have the same poses on all of them");
  return {app, [o, others, &common](Console& console) -> Result<int> {
            MAQUETTE_TRY(const auto file, read_site(o->site, with_seed(o->set, common)));
            if (std::find(file.site->scales.begin(), file.site->scales.end(), o->scale) ==
                file.site->scales.end())
              return fail(kUsage, fmt::format("--scale {:g}: the site file has {:g}", o->scale,
                                              fmt::join(file.site->scales, ", ")));
            const std::size_t scales = file.site->scales.size();
            if (!others->empty() && others->size() + 1 != scales)
              return fail(kUsage,
                          fmt::format("--other: {} designs, but the site has {} other scales",
                                      others->size(), scales - 1));
            StoneSurfaces surfaces;
            auto other = others->begin();
            for (const double scale : file.site->scales)
              surfaces.designs.push_back(scale == o->scale ? o->design
                                         : others->empty() ? fs::path()
                                                           : *other++);
            return finish(console, "stones", [&](const RunContext& run) {
              return stones_job(*file.site, o->scale, surfaces, o->out, run);
            });
          }};
}

Command add_stone_parts(CLI::App& root, const CommonOptions&) {
  auto o = std::make_shared<StonePartsJob>();
  auto out = std::make_shared<fs::path>("stone_parts");
  auto clearance_mm = std::make_shared<double>(o->clearance.value());
  auto wall_mm = std::make_shared<double>(o->wall.value());
  auto joint_width_mm = std::make_shared<double>(0.0);
  auto bands = std::make_shared<fs::path>();
  auto build_mm = std::make_shared<std::vector<double>>(std::vector<double>{200, 200, 200});
  auto* app = root.add_subcommand(
      "stone-parts",
      "The stones for the workshop: per distinct stone 3MF and STL, smaller by a clearance and\n"
      "checked for a least wall; packed build volumes; where each goes as CSV, DXF and PDF at "
      "1:1.\n"
      "Example: maquette stone-parts out/s1000/stones.json --design out/s1000/design.tif --paper "
      "a3 "
      "--out stones");
  app->add_option("stones", o->stones, "stones.json of `maquette stones`")->required();
  app->add_option("--design", o->design, "model field (.tif) that they lie on")->required();
  app->add_option("--out", *out, "folder")->capture_default_str();
  app->add_option("--clearance-mm", *clearance_mm, "parts are smaller by that on every side")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 100.0));
  app->add_option("--wall-mm", *wall_mm, "least wall of the sintering process")
      ->capture_default_str()
      ->check(CLI::Range(1e-3, 100.0));
  app->add_option("--build-mm", *build_mm, "the machine's build volume: x y z")
      ->expected(3)
      ->capture_default_str()
      ->check(CLI::Range(1.0, 1e5));
  app->add_option("--spacing-mm", o->volume.spacing_mm, "between parts in it")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 1000.0));
  app->add_option("--paper", o->paper, "of placing.pdf")
      ->capture_default_str()
      ->check(CLI::IsMember({"a4", "a3"}));
  auto* even = app->add_option("--joints-mm", *joint_width_mm,
                               "draws where even bands not wider than that meet (0: none)")
                   ->capture_default_str()
                   ->check(CLI::Range(0.0, 1e5));
  app->add_option("--bands", *bands, "bands.json of `maquette bands`: draws these joints")
      ->excludes(even);
  app->add_option("--name", o->name, "on every sheet of placing.pdf")->capture_default_str();
  return {app, [=](Console& console) -> Result<int> {
            o->clearance = Millimetres{*clearance_mm};
            o->wall = Millimetres{*wall_mm};
            o->volume.size_mm = {(*build_mm)[0], (*build_mm)[1], (*build_mm)[2]};
            if (*joint_width_mm > 0.0)
              o->bands = meshing::BandSplit{.max_width = Millimetres{*joint_width_mm}};
            if (!bands->empty()) {
              MAQUETTE_TRY(o->bands, read_band_layout(*bands));
            }
            return finish(console, "stone-parts",
                          [&](const RunContext& run) { return stone_parts_job(*o, *out, run); });
          }};
}

Command add_mesh(CLI::App& root, const CommonOptions&) {
  struct Options {
    fs::path design, out = "surface.ply", stones;
    double base_thickness_mm = 10.0, coating_mm = 0.0, offset_mm = 0.0, fillet_mm = 0.0;
    ShapeOptions shape;
  };
  auto o = std::make_shared<Options>();
  auto* app = root.add_subcommand(
      "mesh",
      "A designed surface (and stones) to a checked closed solid, with certificate; with\n"
      "--coating-mm one that meets the design once it is coated (surface.undercoat.tif is for "
      "mill);\n"
      "with --fillet-mm or --offset-mm of a changed one (surface.fillet.tif, surface.offset.tif);\n"
      "all three take stones as relief, as a cutter on three axes makes them "
      "(surface.relief.tif);\n"
      "with --hollow-mm opened from below into pockets between ribs; with --label, --scale-bar\n"
      "engraved at a side (docs/solids.md).\n"
      "Example: maquette mesh design.tif --stones stones.json --out surface.ply\n"
      "         maquette mesh design.tif --hollow-mm 3 --label \"Apollo 15, 1:1000\" --scale-bar "
      "1000 "
      "--out part.ply");
  app->add_option("design", o->design, "model field (.tif, mm)")->required();
  app->add_option("--out", o->out, "PLY file")->capture_default_str();
  app->add_option("--stones", o->stones,
                  "stones.json of `maquette stones`: united with the terrain; with --fillet-mm, "
                  "--offset-mm or --coating-mm as one relief with it, seen from above");
  app->add_option("--coating-mm", o->coating_mm,
                  "thickness of the coat that terrain and stones get, along the normal")
      ->check(CLI::PositiveNumber);
  app->add_option("--fillet-mm", o->fillet_mm,
                  "rounds concave edges to that radius, the cutter's, also where stones meet the "
                  "terrain")
      ->check(CLI::Range(0.05, 100.0));
  app->add_option("--offset-mm", o->offset_mm,
                  "moves terrain and stones along the normal, outwards or (negative) inwards")
      ->check(CLI::Range(-1000.0, 1000.0));
  app->add_option("--base-thickness-mm", o->base_thickness_mm, "under the lowest point")
      ->capture_default_str()
      ->check(CLI::Range(1.0, 1000.0));
  add_shape_options(*app, o->shape, "text, engraved in a wall");
  return {app, [o](Console& console) -> Result<int> {
            ShapedJob job{.design = o->design,
                          .stones = o->stones.empty() ? std::nullopt : std::optional(o->stones),
                          .base_thickness = Millimetres{o->base_thickness_mm}};
            MAQUETTE_TRY_VOID(take_shape_options(o->shape, job.shape));
            fs::path surface = o->design;
            // What is milled on three axes is what is seen from above.
            const bool changes = o->fillet_mm != 0.0 || o->offset_mm != 0.0 || o->coating_mm != 0.0;
            if (job.stones && changes) {
              surface = fs::path(o->out).replace_extension(".relief.tif");
              MAQUETTE_TRY_VOID(finish(console, "relief", [&](const RunContext& run) {
                return relief_job(o->design, o->stones, surface, run);
              }));
              job.stones.reset();
            }
            // Each change takes what the one before left.
            const auto change = [&](const std::string& what, double by_mm,
                                    auto&& make) -> Result<void> {
              if (by_mm == 0.0) return {};
              const fs::path changed = fs::path(o->out).replace_extension("." + what + ".tif");
              MAQUETTE_TRY_VOID(finish(console, what, [&](const RunContext& run) {
                return make(surface, Millimetres{by_mm}, changed, run);
              }));
              surface = changed;
              return {};
            };
            MAQUETTE_TRY_VOID(change("fillet", o->fillet_mm, fillet_job));
            MAQUETTE_TRY_VOID(change("offset", o->offset_mm, offset_job));
            MAQUETTE_TRY_VOID(change("undercoat", o->coating_mm, undercoat_job));
            job.design = surface;
            if (!job.plain())
              return finish(console, "mesh",
                            [&](const RunContext& run) { return shaped_job(job, o->out, run); });
            return finish(console, "mesh", [&](const RunContext& run) {
              return mesh_job(surface, job.stones, job.base_thickness, o->out, run);
            });
          }};
}

Command add_simplify(CLI::App& root, const CommonOptions&) {
  struct Options {
    fs::path mesh, out = "simplified.ply";
    std::uint64_t triangles = 0;
    double max_deviation_mm = 0.0;
  };
  auto o = std::make_shared<Options>();
  auto* app = root.add_subcommand(
      "simplify",
      "A stone, spacecraft or other body with fewer triangles (quadrics), with its certificate "
      "and\n"
      "how far the two are apart. A designed surface: export --lod-triangles, lod.\n"
      "Example: maquette simplify rock.stl --triangles 5000 --out rock_small.ply\n"
      "         maquette simplify lander.glb --max-deviation-mm 0.05 --out lander_small.ply");
  app->add_option("mesh", o->mesh, "PLY, STL, OBJ (mm) or glTF")->required();
  app->add_option("--out", o->out, "PLY file")->capture_default_str();
  auto* count = app->add_option("--triangles", o->triangles, "at most so many")
                    ->check(CLI::Range(std::uint64_t{4}, std::uint64_t{1'000'000'000}));
  app->add_option("--max-deviation-mm", o->max_deviation_mm,
                  "as few triangles as keep that, both ways")
      ->check(CLI::Range(1e-6, 1e6))
      ->excludes(count);
  return {app, [o](Console& console) -> Result<int> {
            SimplifyJob job{.mesh = o->mesh};
            if (o->triangles > 0) job.triangles = o->triangles;
            if (o->max_deviation_mm > 0.0) job.max_deviation = Millimetres{o->max_deviation_mm};
            if (!job.triangles && !job.max_deviation)
              return fail(kUsage, "--triangles or --max-deviation-mm expected");
            std::error_code ec;
            if (fs::equivalent(o->mesh, o->out, ec))
              return fail(kConfigInvalid, fmt::format("{}: would be overwritten; choose another "
                                                      "--out",
                                                      o->mesh.string()));
            return finish(console, "simplify",
                          [&](const RunContext& run) { return simplify_job(job, o->out, run); });
          }};
}

Command add_bands(CLI::App& root, const CommonOptions&) {
  struct Options {
    fs::path design, out = "bands";
    double max_width_mm = 500.0, base_thickness_mm = 10.0;
    int count = 0;  // 0: by the width
    std::string axis = "y";
    double max_length_mm = INFINITY, clearance_mm = 1.0;
    fs::path stones;
    bool own_frame = false, with_stones = false;
    meshing::DowelOptions dowels{.diameter_mm = 0.0};  // 0: none
    meshing::DowelOptions magnets{.diameter_mm = 0.0, .depth_mm = 3.2};
    std::string shard;
    ShapeOptions shape{.side = "west"};
  };
  auto o = std::make_shared<Options>();
  auto* app = root.add_subcommand(
      "bands",
      "Splits a designed surface into bands, each a closed solid with certificate (band_01.ply\n"
      "..., bands.json); with --max-length-mm, --own-frame, --dowel-mm or --magnet-mm into tiles\n"
      "(tile_01.ply ..., tiles.json, tiles.svg). With --stones joints keep off the stones: of "
      "tiles\n"
      "always, of bands as far as they can, and what a joint meets is said. Pictures of both "
      "moved\n"
      "apart: exploded.svg, exploded.png (docs/bands.md). Bands and tiles may be hollow and\n"
      "engraved as of `mesh` (docs/solids.md).\n"
      "Example: maquette bands design.tif --max-width-mm 500 --stones stones.json --out bands\n"
      "         maquette bands design.tif --count 4 --axis x --out bands\n"
      "         maquette bands design.tif --max-width-mm 500 --max-length-mm 700 --stones "
      "stones.json --dowel-mm 4 --magnet-mm 6 --hollow-mm 3 --label N --out tiles");
  app->add_option("design", o->design, "model field (.tif, mm)")->required();
  app->add_option("--out", o->out, "folder")->capture_default_str();
  auto* width = app->add_option("--max-width-mm", o->max_width_mm, "of a band, in y or --axis")
                    ->capture_default_str();
  auto* count = app->add_option("--count", o->count, "of bands, instead of a width")
                    ->check(CLI::Range(1, 100000))
                    ->excludes(width);
  auto* axis = app->add_option("--axis", o->axis, "that bands lie side by side in")
                   ->capture_default_str()
                   ->check(CLI::IsMember({"x", "y"}));
  app->add_option("--base-thickness-mm", o->base_thickness_mm, "under the lowest point")
      ->capture_default_str()
      ->check(CLI::Range(1.0, 1000.0));
  auto* length = app->add_option("--max-length-mm", o->max_length_mm, "of a tile, in x");
  auto* stones = app->add_option("--stones", o->stones, "stones.json of `maquette stones`");
  app->add_option("--clearance-mm", o->clearance_mm, "from joints to stones")
      ->capture_default_str()
      ->check(CLI::Range(0.0, 1000.0))
      ->needs(stones);
  app->add_flag("--with-stones", o->with_stones,
                "bands or tiles and the stones on them as one solid each")
      ->needs(stones);
  auto* own = app->add_flag("--own-frame", o->own_frame,
                            "tiles with their south-western corner and base at the origin");
  auto* dowel = app->add_option("--dowel-mm", o->dowels.diameter_mm,
                                "diameter of dowels that hold tiles together, in the base")
                    ->check(CLI::Range(0.1, 1000.0));
  app->add_option("--dowel-depth-mm", o->dowels.depth_mm, "of their holes, in each tile")
      ->capture_default_str()
      ->needs(dowel);
  app->add_option("--dowel-play-mm", o->dowels.play_mm, "that holes are wider")
      ->capture_default_str()
      ->needs(dowel);
  app->add_option("--dowel-wall-mm", o->dowels.wall_mm, "least material around holes")
      ->capture_default_str()
      ->needs(dowel);
  app->add_option("--dowel-spacing-mm", o->dowels.spacing_mm, "along a joint, at most")
      ->capture_default_str()
      ->needs(dowel);
  auto* magnet = app->add_option("--magnet-mm", o->magnets.diameter_mm,
                                 "diameter of round magnets that hold tiles together, between the "
                                 "dowels if there are some")
                     ->check(CLI::Range(0.1, 1000.0));
  const auto magnet_only = [&](const char* name, double& value, const char* help) {
    app->add_option(name, value, help)->capture_default_str()->needs(magnet);
  };
  magnet_only("--magnet-depth-mm", o->magnets.depth_mm, "of their holes, in each tile");
  magnet_only("--magnet-play-mm", o->magnets.play_mm, "that holes are wider");
  magnet_only("--magnet-wall-mm", o->magnets.wall_mm, "least material around holes");
  magnet_only("--magnet-spacing-mm", o->magnets.spacing_mm,
              "along a joint, at most, where there are no dowels");
  auto* shards =
      app->add_option("--shard", o->shard, "i/n: only every n-th band, starting at the i-th");
  add_shape_options(*app, o->shape, "text, engraved in each band or tile with its number");
  for (auto* tiles_only : {static_cast<CLI::Option*>(length), own, dowel, magnet})
    for (auto* bands_only : {static_cast<CLI::Option*>(shards), count, axis})
      bands_only->excludes(tiles_only);
  return {app, [o, app](Console& console) -> Result<int> {
            // The wall that stays visible when the bands are joined.
            if (o->axis == "x" && app->get_option("--label-side")->count() == 0)
              o->shape.side = "south";
            Shape shape;
            MAQUETTE_TRY_VOID(take_shape_options(o->shape, shape));
            const auto plan = o->stones.empty() ? std::nullopt : std::optional(o->stones);
            if (std::isfinite(o->max_length_mm) || o->own_frame || o->dowels.diameter_mm > 0.0 ||
                o->magnets.diameter_mm > 0.0) {
              TilesJob job{.design = o->design,
                           .stones = plan,
                           .options = {.max_width = Millimetres{o->max_length_mm},
                                       .max_length = Millimetres{o->max_width_mm},
                                       .clearance = Millimetres{o->clearance_mm}},
                           .base_thickness = Millimetres{o->base_thickness_mm},
                           .own_frame = o->own_frame,
                           .shape = shape,
                           .with_stones = o->with_stones};
              if (o->dowels.diameter_mm > 0.0) job.in_joints.dowels = o->dowels;
              if (o->magnets.diameter_mm > 0.0) job.in_joints.magnets = o->magnets;
              return finish(console, "tiles",
                            [&](const RunContext& run) { return tiles_job(job, o->out, run); });
            }
            Shard shard;
            if (!o->shard.empty()) {
              MAQUETTE_TRY(shard, parse_shard(o->shard));
            }
            const BandLayoutJob layout{
                .design = o->design,
                .stones = plan,
                .split = {.axis = o->axis == "x" ? meshing::BandAxis::x : meshing::BandAxis::y,
                          .max_width = Millimetres{o->max_width_mm},
                          .count = o->count},
                .clearance = Millimetres{o->clearance_mm},
                .base_thickness = Millimetres{o->base_thickness_mm},
                .with_stones = o->with_stones};
            MAQUETTE_TRY_VOID(finish(console, "bands", [&](const RunContext& run) {
              return band_layout_job(layout, o->out, run);
            }));
            MAQUETTE_TRY(const auto split, read_band_layout(o->out / "bands.json"));
            const std::size_t bands = 1 + (split.joints ? split.joints->size() : 0);
            ShapedJob job{.design = o->design, .base_thickness = Millimetres{o->base_thickness_mm}};
            job.shape = shape;
            if (o->with_stones) job.stones = plan;
            for (std::size_t b = shard.index; b < bands; b += shard.count) {
              const std::string name = fmt::format("band_{:02}", b + 1);
              if (!job.plain() || job.stones) {
                job.band = BandOf{split, b};
                if (!o->shape.label.empty())
                  job.shape.label = fmt::format("{} {}", o->shape.label, b + 1);
                MAQUETTE_TRY_VOID(finish(console, name, [&](const RunContext& run) {
                  return shaped_job(job, o->out / (name + ".ply"), run);
                }));
                continue;
              }
              MAQUETTE_TRY_VOID(finish(console, name, [&](const RunContext& run) {
                return band_job(o->design, split, b, Millimetres{o->base_thickness_mm},
                                o->out / (name + ".ply"), run);
              }));
            }
            return 0;
          }};
}

}  // namespace maquette::tools

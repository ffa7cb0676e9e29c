// SPDX-License-Identifier: GPL-3.0-or-later

// lod

#include <fmt/format.h>
#include <CLI/CLI.hpp>

#include "heightmap/body.hpp"
#include "tools/commands/commands.hpp"
#include "tools/jobs_lod.hpp"

namespace maquette::tools {

Command add_lod(CLI::App& root, const CommonOptions&) {
  struct Options {
    fs::path design, stones, albedo, out = "lod";
    std::string compression = "draco", material = "paint", body;
    exporting::LodSetOptions set;
    exporting::LodPlace place;
    bool no_normals = false, heightmaps = false;
    std::ptrdiff_t heightmap_quads = 512;
    double max_error_mm = NAN;
  };
  auto o = std::make_shared<Options>();
  auto* app = root.add_subcommand(
      "lod",
      "A surface in levels of detail that engines stream: 3D Tiles 1.1 of glTF tiles that meet "
      "without cracks,\neach with its measured error (tileset.json, tileset_implicit.json, "
      "lod.json).\n"
      "Example: maquette lod out/s1000/design.tif --stones out/s1000/stones.json --out lod\n"
      "         maquette lod design.tif --compression meshopt --bits 20 --out lod");
  app->add_option("design", o->design, "model field (.tif)")->required();
  app->add_option("--out", o->out, "folder")->capture_default_str();
  auto* stones = app->add_option("--stones", o->stones,
                                 "stones.json: stones beside the terrain, in levels, too");
  app->add_flag("--merge-stones", o->set.asset.merge_stones,
                "one mesh instead of instances, for engines without EXT_mesh_gpu_instancing")
      ->needs(stones);
  app->add_option("--compression", o->compression, "draco, meshopt or plain")
      ->capture_default_str()
      ->check(CLI::IsMember({"draco", "meshopt", "plain"}));
  app->add_option("--bits", o->set.position_bits, "of a coordinate, over the whole set")
      ->capture_default_str();
  app->add_option("--max-error-mm", o->max_error_mm,
                  "that the finest level must keep; refused where --bits do not do");
  app->add_option("--normal-bits", o->set.asset.normal_bits, "of draco")->capture_default_str();
  app->add_flag("--no-normals", o->no_normals, "fewer bytes; engines shade by triangles");
  auto* textures = app->add_option(
      "--textures", o->set.texels,
      "texels along a tile's side: pictures of the full surface's normals for coarse "
      "tiles, of ambient occlusion for all; 512 shows twice the detail of 256 quads");
  app->add_option("--albedo", o->albedo,
                  "colour of the ground, a raster over the surface: from edge to edge, or in the "
                  "model's frame, or with --body in a CRS of the body")
      ->needs(textures);
  app->add_flag("--skirts", o->set.skirts,
                "walls below the sides that tiles share, for engines that move vertices; without "
                "that nothing gapes");
  app->add_option("--tile-quads", o->set.tile_quads, "edge of a tile")->capture_default_str();
  app->add_option("--material", o->material, "paint, regolith or foil")
      ->capture_default_str()
      ->check(CLI::IsMember({"paint", "regolith", "foil"}));
  app->add_option("--scale", o->set.asset.scale_denominator, "N of 1:N, recorded")
      ->capture_default_str();
  auto* heightmaps = app->add_flag("--heightmaps", o->heightmaps,
                                   "for engines, too: OUT/heightmaps with 16-bit PNG and RAW in "
                                   "levels, a Cloud-Optimized GeoTIFF "
                                   "and heights.json, which says what a number is");
  app->add_option("--heightmap-quads", o->heightmap_quads,
                  "edge of a heightmap, a power of two; it has one node more")
      ->capture_default_str()
      ->needs(heightmaps);
  auto* body = app->add_option("--body", o->body,
                               "moon or mars: the tileset is put there at full "
                               "size")
                   ->check(CLI::IsMember({"moon", "mars"}));
  app->add_option("--latitude-deg", o->place.latitude_deg, "of the middle, planetocentric")
      ->needs(body);
  app->add_option("--longitude-deg", o->place.longitude_deg, "of the middle, east positive")
      ->needs(body);
  app->add_option("--height-m", o->place.height_m, "of the model's z = 0 above the ellipsoid")
      ->needs(body);
  app->add_option("--exaggeration", o->place.exaggeration, "of the model's heights; taken back")
      ->needs(body);
  return {
      app, [o](Console& console) -> Result<int> {
        using namespace exporting;
        LodJob job;
        job.design = o->design;
        if (!o->stones.empty()) job.stones = o->stones;
        job.options = o->set;
        if (!o->albedo.empty()) job.options.albedo = o->albedo;
        job.options.asset.normals = !o->no_normals;
        for (const auto c : {LodCompression::draco, LodCompression::meshopt, LodCompression::plain})
          if (o->compression == name(c)) job.options.asset.compression = c;
        for (const auto m : {LodMaterial::paint, LodMaterial::regolith, LodMaterial::foil})
          if (o->material == name(m)) job.options.asset.material = m;
        if (o->heightmaps) job.heightmap_quads = o->heightmap_quads;
        if (!std::isnan(o->max_error_mm)) job.options.max_error = Millimetres{o->max_error_mm};
        if (!o->body.empty()) {
          job.options.place = o->place;
          job.options.place->body = *heightmap::body_by_name(o->body);
        }
        return finish(console, "lod",
                      [&](const RunContext& run) { return lod_job(job, o->out, run); });
      }};
}

}  // namespace maquette::tools

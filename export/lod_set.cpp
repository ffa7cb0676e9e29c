// SPDX-License-Identifier: GPL-3.0-or-later
#include "export/lod_set.hpp"

#include <algorithm>
#include <atomic>
#include <cmath>
#include <regex>
#include <set>

#include <fmt/format.h>
#include <tbb/parallel_for.h>
#include <nlohmann/json.hpp>

#include "export/cad.hpp"
#include "export/glb_file.hpp"
#include "export/gltf.hpp"
#include "export/lod_albedo.hpp"
#include "export/lod_skirts.hpp"
#include "export/lod_stones.hpp"
#include "export/lod_tileset.hpp"

namespace maquette::exporting {
namespace {

namespace fs = std::filesystem;
using Json = nlohmann::ordered_json;

/// A step above this share of the spacing turns slopes into stairs; as in gltf.cpp.
constexpr double kCoarsestStep = 0.25;
/// Goes up when tiles of the same heights and options get other bytes.
constexpr int kTileVersion = 4;
/// Of a coordinate: differences of whole numbers stay below the 2^24 that floats hold.
constexpr int kMostBits = 22;
/// Of a picture's side: what WebGL 2 grants is 2048, what engines do 4096.
constexpr int kMostTexels = 4096;

Result<void> check_options(const heightmap::ModelField& field, const LodSetOptions& o) {
  const auto bad = [](const std::string& what) { return fail(kOptionOutOfRange, what); };
  if (o.position_bits < 8 || o.position_bits > kMostBits)
    return bad(fmt::format("{} bits a coordinate: 8 to {} expected", o.position_bits, kMostBits));
  if (o.tile_quads < 16 || o.tile_quads > 1024)
    return bad(fmt::format("tiles of {} quads: 16 to 1024 expected", o.tile_quads));
  if (o.asset.normal_bits < 4 || o.asset.normal_bits > 16)
    return bad(fmt::format("{} bits a normal: 4 to 16 expected", o.asset.normal_bits));
  if (o.texels != 0 && (o.texels < 16 || o.texels > kMostTexels))
    return bad(
        fmt::format("pictures of {} texels a side: 16 to {} expected", o.texels, kMostTexels));
  if (o.texels != 0 && !o.asset.normals)
    return bad("pictures without normals: engines turn a picture's normals by the mesh's");
  if (o.albedo && o.texels == 0) return bad("an albedo without pictures: texels expected");
  if (o.max_error && !(o.max_error->value() > 0.0))
    return bad(fmt::format("an error of {} mm: more than 0 expected", o.max_error->value()));
  MAQUETTE_TRY_VOID(check_place(o.place, o.asset.scale_denominator));
  if (field.z_mm.rows() < 2 || field.z_mm.cols() < 2)
    return fail(kEmptyMesh, "levels need 2 x 2 nodes at least");
  return {};
}

/// @param albedo  null: none
std::string key_of(const heightmap::ModelField& field, const LodSetOptions& o,
                   const LodAlbedo* albedo) {
  const auto heights = field.z_mm.cells();
  const std::string content =
      sha256({reinterpret_cast<const char*>(heights.data()), heights.size() * sizeof(heights[0])});
  const LodContentScale scale = content_scale(o);
  std::string colours;
  if (albedo != nullptr) {
    colours = fmt::format(" {} {}", albedo->width, albedo->height);
    for (const auto& band : albedo->bands)
      colours += ' ' + sha256({reinterpret_cast<const char*>(band.data()), band.size()});
  }
  return sha256(fmt::format("{} {} {} {} {} {} {} {} {} {} {} {} {} {} {} {}", kTileVersion,
                            content, field.z_mm.rows(), field.z_mm.cols(), field.spacing.value(),
                            o.position_bits, o.tile_quads, static_cast<int>(o.filter),
                            name(o.asset.compression), name(o.asset.material), o.asset.normals,
                            o.asset.normal_bits, o.asset.scale_denominator, scale.horizontal,
                            scale.vertical, o.texels) +
                (o.skirts ? " skirts" : "") + colours);
}

Result<void> make_folder(const fs::path& folder) {
  std::error_code ec;
  fs::create_directories(folder, ec);
  if (ec) return tl::unexpected(write_error(folder, ec.value()));
  return {};
}

/// Empties what an earlier run with another key has left; keeps what this one may go on with.
Result<void> prepare_folder(const fs::path& folder, const std::string& key) {
  const fs::path key_file = folder / "tiles" / "key.txt";
  std::error_code ec;
  if (fs::exists(key_file, ec)) {
    MAQUETTE_TRY(const std::string before, read_file(key_file));
    if (before != key) {
      for (const char* own : {"tiles", "subtrees"}) {
        fs::remove_all(folder / own, ec);
        if (ec) return tl::unexpected(write_error(folder / own, ec.value()));
      }
    }
  }
  MAQUETTE_TRY_VOID(make_folder(folder / "tiles"));
  return write_file(key_file, key);
}

Result<std::uint64_t> write_glb_content(const GlbContent& content, const fs::path& path) {
  MAQUETTE_TRY(auto file, AtomicFile::create(path));
  MAQUETTE_TRY(const std::uint64_t bytes,
               write_glb_head(file, content.json, content.binary.size(), path));
  file.write(content.binary.data(), content.binary.size());
  MAQUETTE_TRY_VOID(file.commit());
  return bytes;
}

/// All anew; what an earlier run had in other cells goes.
Result<std::vector<LodStones>> write_stones(const heightmap::ModelField& field,
                                            std::span<const meshing::PlacedStone> stones,
                                            const LodLattice& lattice, int levels,
                                            const LodSetOptions& options, const fs::path& folder) {
  const Vec3 corner{field.x0.value(), field.y0.value(), 0.0};
  const double width_mm =
      field.spacing.value() * static_cast<double>(lattice.tile_quads << (levels - 1));
  auto files = divide_stones(stones, levels - 1, width_mm, corner);
  std::set<fs::path> own;
  for (const LodStones& file : files) {
    own.insert(folder / lod_stones_uri(file));
    MAQUETTE_TRY_VOID(make_folder((folder / lod_stones_uri(file)).parent_path()));
  }
  std::vector<std::optional<Error>> failed(files.size());
  tbb::parallel_for(std::size_t{0}, files.size(), [&](std::size_t i) {
    const auto bytes =
        write_glb_content(encode_stones(files[i], corner, options.asset, content_scale(options)),
                          folder / lod_stones_uri(files[i]));
    if (bytes)
      files[i].bytes = *bytes;
    else
      failed[i] = bytes.error();
  });
  for (auto& error : failed)
    if (error) return tl::unexpected(std::move(*error));
  std::error_code ec;
  std::vector<fs::path> earlier;
  const std::regex ours("stones/[0-9]+/[0-9]+/[0-9]+\\.glb");
  for (const auto& entry : fs::recursive_directory_iterator(folder / "stones", ec))
    if (std::regex_match(entry.path().lexically_relative(folder).generic_string(), ours) &&
        !own.contains(entry.path()))
      earlier.push_back(entry.path());
  for (const fs::path& file : earlier) fs::remove(file, ec);
  return files;
}

std::vector<LodTileKey> tiles_of(const heightmap::ModelField& field, const LodLattice& lattice,
                                 int levels) {
  std::vector<LodTileKey> keys;
  for (int level = levels - 1; level >= 0; --level)
    for (std::ptrdiff_t y = 0; y < lod_tiles(field.z_mm.rows(), lattice, level); ++y)
      for (std::ptrdiff_t x = 0; x < lod_tiles(field.z_mm.cols(), lattice, level); ++x)
        keys.push_back({level, x, y});
  return keys;
}

/// What a tile of a level needs beside the options.
struct Making {
  const LodPyramid& pyramid;
  const LodLattice& lattice;
  const Grid<float>* light;          ///< lod_occlusion(), for pictures; null: none
  const LodAlbedo* albedo;           ///< null: none
  std::vector<std::int32_t> skirts;  ///< depth by level, steps; empty: none
};

Result<LodTileReport> make_one(const Making& making, LodTileKey key, const LodSetOptions& options,
                               const fs::path& path) {
  const auto& [pyramid, lattice, light, albedo, skirts] = making;
  LodTileMesh tile = make_lod_tile(pyramid, lattice, key);
  LodTileReport report;
  report.key = key;
  report.error = measure_lod_tile(pyramid.field(), lattice, tile);
  if (!skirts.empty()) {
    report.skirt = skirts[static_cast<std::size_t>(key.level)];
    add_skirts(tile, pyramid.field(), report.skirt);
  }
  report.triangles = tile.triangles.size();
  report.vertices = tile.vertices.size();
  report.lowest = report.highest = tile.vertices.front().height;
  for (const LodVertex& v : tile.vertices) {
    report.lowest = std::min(report.lowest, v.height);
    report.highest = std::max(report.highest, v.height);
  }
  // Files appear whole, but may have been cut off since, as by a copy that was stopped.
  if (const auto there = whole_glb_bytes(path)) {
    report.bytes = *there;
    report.kept = true;
    return report;
  }
  LodPictures pictures;
  if (light != nullptr) {
    MAQUETTE_TRY(pictures, make_lod_pictures(pyramid, *light, tile, options.texels));
    if (albedo != nullptr) {
      MAQUETTE_TRY(pictures.colour_png,
                   albedo_picture(*albedo, pyramid.field(), tile, options.texels));
    }
  }
  MAQUETTE_TRY(const GlbContent content,
               encode_lod_tile(tile, lattice, report.error, options.asset, content_scale(options),
                               light != nullptr ? &pictures : nullptr));
  MAQUETTE_TRY(report.bytes, write_glb_content(content, path));
  return report;
}

/// By level, of the tiles' errors. What is left out after a stop is so in write_tiles, too.
std::vector<std::int32_t> skirt_depths(const LodPyramid& pyramid, const LodLattice& lattice,
                                       const std::vector<LodTileKey>& keys, const RunContext& run) {
  std::vector<LodTileError> of_tile(keys.size());
  tbb::parallel_for(
      std::size_t{0}, keys.size(),
      [&](std::size_t i) {
        if (run.stopped()) return;
        of_tile[i] =
            measure_lod_tile(pyramid.field(), lattice, make_lod_tile(pyramid, lattice, keys[i]));
      },
      tbb::simple_partitioner());
  std::vector<LodTileError> largest(static_cast<std::size_t>(pyramid.levels()));
  for (std::size_t i = 0; i < keys.size(); ++i) {
    double& most = largest[static_cast<std::size_t>(keys[i].level)].vertical_mm;
    most = std::max(most, of_tile[i].vertical_mm);
  }
  std::vector<std::int32_t> depths;
  for (std::size_t level = 0; level < largest.size(); ++level)
    depths.push_back(
        skirt_depth(largest[level], largest[std::min(level + 1, largest.size() - 1)], lattice));
  return depths;
}

Result<std::vector<LodTileReport>> write_tiles(const LodPyramid& pyramid, const LodLattice& lattice,
                                               const LodAlbedo* albedo,
                                               const LodSetOptions& options, const fs::path& folder,
                                               const RunContext& run) {
  const auto keys = tiles_of(pyramid.field(), lattice, pyramid.levels());
  std::vector<fs::path> paths;
  for (const LodTileKey& key : keys) {
    paths.push_back(folder / lod_tile_uri(pyramid.levels() - 1 - key.level, key.x, key.y));
    MAQUETTE_TRY_VOID(make_folder(paths.back().parent_path()));
  }
  std::optional<Grid<float>> light;
  if (options.texels > 0) light = lod_occlusion(pyramid);
  Making making{pyramid, lattice, light ? &*light : nullptr, albedo, {}};
  if (options.skirts) making.skirts = skirt_depths(pyramid, lattice, keys, run);
  std::vector<std::optional<Result<LodTileReport>>> made(keys.size());
  std::atomic<std::size_t> done{0};
  std::atomic<bool> failed{false};
  tbb::parallel_for(
      std::size_t{0}, keys.size(),
      [&](std::size_t i) {
        if (run.stopped() || failed) return;
        made[i] = make_one(making, keys[i], options, paths[i]);
        if (!*made[i]) failed = true;
        run.progress(0.1 + 0.9 * static_cast<double>(++done) / static_cast<double>(keys.size()));
      },
      tbb::simple_partitioner());
  for (auto& one : made)
    if (one && !*one) return tl::unexpected(std::move(one->error()));
  std::vector<LodTileReport> reports;
  for (auto& one : made) {
    if (!one)
      return fail(kCancelled, fmt::format("{}: stopped after {} of {} tiles; run again to go on",
                                          folder.string(), done.load(), keys.size()));
    reports.push_back(**std::move(one));
  }
  return reports;
}

void sum_levels(LodSetReport& report, const heightmap::ModelField& field, int levels) {
  report.levels.resize(static_cast<std::size_t>(levels));
  for (const LodTileReport& t : report.tiles) {
    LodLevelReport& level = report.levels[static_cast<std::size_t>(t.key.level)];
    ++level.tiles;
    level.triangles += t.triangles;
    level.bytes += t.bytes;
    level.skirt_mm = std::max(level.skirt_mm, report.lattice.step_mm * t.skirt);
    level.error.vertical_mm = std::max(level.error.vertical_mm, t.error.vertical_mm);
    level.error.hausdorff_mm = std::max(level.error.hausdorff_mm, t.error.hausdorff_mm);
    const std::ptrdiff_t width = report.lattice.tile_quads << t.key.level;
    const auto share =
        static_cast<double>(std::min(width, field.z_mm.cols() - 1 - t.key.x * width)) *
        static_cast<double>(std::min(width, field.z_mm.rows() - 1 - t.key.y * width)) /
        static_cast<double>((field.z_mm.rows() - 1) * (field.z_mm.cols() - 1));
    level.error.rms_mm += share * t.error.rms_mm * t.error.rms_mm;
  }
  for (LodLevelReport& level : report.levels) level.error.rms_mm = std::sqrt(level.error.rms_mm);
}

Json json_of(const LodTileError& error) {
  return {{"max_vertical_error_mm", error.vertical_mm},
          {"rms_vertical_error_mm", error.rms_mm},
          {"hausdorff_at_nodes_mm", error.hausdorff_mm}};
}

}  // namespace

Result<LodLattice> lod_lattice(const heightmap::ModelField& field, const LodSetOptions& options) {
  MAQUETTE_TRY_VOID(check_options(field, options));
  const auto range = heightmap::height_range(field.z_mm);
  const double spacing = field.spacing.value();
  const double relief =
      range.voids > 0 ? 0.0 : static_cast<double>(range.max) - static_cast<double>(range.min);
  const double longest =
      std::max(spacing * static_cast<double>(std::max(field.z_mm.rows(), field.z_mm.cols()) - 1),
               relief + spacing);  // a step of rounding at each end has room in that
  const auto steps = static_cast<double>((std::uint32_t{1} << options.position_bits) - 1);
  const double per_quad = std::floor(steps * spacing / longest);
  double most_mm = kCoarsestStep * spacing;
  if (options.max_error) most_mm = std::min(most_mm, 2.0 * options.max_error->value());
  const double step_mm = per_quad > 0.0 ? spacing / per_quad : longest / steps;
  if (step_mm > most_mm) {
    const double per_quad_asked = std::ceil(spacing / most_mm);
    const double bits = std::ceil(std::log2(per_quad_asked * longest / spacing + 1.0));
    return fail(kQuantisationTooCoarse,
                fmt::format("{} bits over {:.4g} mm make steps of {:.4g} mm; at most {:.4g} mm are "
                            "allowed ({}), {} bits would do{}",
                            options.position_bits, longest, step_mm, most_mm,
                            options.max_error ? "a quarter of the spacing, and twice the error"
                                              : "a quarter of the spacing",
                            bits,
                            bits > kMostBits ? fmt::format(", of which there are {}: ask for less "
                                                           "or for a part of the surface",
                                                           kMostBits)
                                             : ""));
  }
  return LodLattice{.step_mm = step_mm,
                    .steps_per_quad = static_cast<std::int32_t>(per_quad),
                    .tile_quads = options.tile_quads};
}

Result<LodSetReport> write_lod_set(const heightmap::ModelField& field,
                                   std::span<const meshing::PlacedStone> stones,
                                   const LodSetOptions& options, const fs::path& folder,
                                   const RunContext& run) {
  LodSetReport report;
  MAQUETTE_TRY(report.lattice, lod_lattice(field, options));
  const int levels = lod_levels(field, options.tile_quads);
  MAQUETTE_TRY(const auto pyramid, LodPyramid::create(field, levels, options.filter));
  std::optional<LodAlbedo> colours;
  if (options.albedo) {
    MAQUETTE_TRY(colours, read_lod_albedo(*options.albedo, field, options));
  }
  const LodAlbedo* albedo = colours ? &*colours : nullptr;
  run.progress(0.1);
  MAQUETTE_TRY_VOID(make_folder(folder));
  MAQUETTE_TRY_VOID(prepare_folder(folder, key_of(field, options, albedo)));
  MAQUETTE_TRY(report.tiles, write_tiles(pyramid, report.lattice, albedo, options, folder, run));
  sum_levels(report, field, levels);
  const auto put = [&](const std::string& path, const std::string& content) -> Result<void> {
    MAQUETTE_TRY_VOID(make_folder((folder / path).parent_path()));
    MAQUETTE_TRY_VOID(write_file(folder / path, content));
    report.outputs.push_back(folder / path);
    return {};
  };
  MAQUETTE_TRY(report.stones, write_stones(field, stones, report.lattice, levels, options, folder));
  for (const LodStones& file : report.stones)
    report.outputs.push_back(folder / lod_stones_uri(file));
  for (const auto& [path, content] : subtree_files(report, options, field))
    MAQUETTE_TRY_VOID(put(path, content));
  MAQUETTE_TRY_VOID(put("tileset_implicit.json", implicit_tileset(report, options, field)));
  MAQUETTE_TRY_VOID(put("tileset.json", explicit_tileset(report, options, field)));
  MAQUETTE_TRY_VOID(put("lod.json", to_json(report, options, field)));
  run.progress(1.0);
  return report;
}

Result<void> check_place(const std::optional<LodPlace>& place, double scale_denominator) {
  if (!(scale_denominator > 0.0) || !std::isfinite(scale_denominator))
    return fail(kOptionOutOfRange,
                fmt::format("scale 1:{}: more than 0 expected", scale_denominator));
  if (place && (!(std::fabs(place->latitude_deg) <= 90.0) ||
                !(std::fabs(place->longitude_deg) <= 360.0) || !std::isfinite(place->height_m) ||
                !(place->exaggeration > 0.0) || !std::isfinite(place->exaggeration)))
    return fail(
        kOptionOutOfRange,
        fmt::format("latitude {}, longitude {}, height {} m, exaggeration {}", place->latitude_deg,
                    place->longitude_deg, place->height_m, place->exaggeration));
  return {};
}

LodContentScale content_scale(const std::optional<LodPlace>& place, double scale_denominator) {
  if (!place) return {};
  return {scale_denominator, scale_denominator / place->exaggeration};
}

LodContentScale content_scale(const LodSetOptions& options) {
  return content_scale(options.place, options.asset.scale_denominator);
}

std::string to_json(const LodSetReport& report, const LodSetOptions& options,
                    const heightmap::ModelField& field) {
  const int top = static_cast<int>(report.levels.size()) - 1;
  Json json{{"schema", "maquette.lod/1"},
            {"compression", name(options.asset.compression)},
            {"position_bits", options.position_bits},
            {"normal_bits", options.asset.normals ? options.asset.normal_bits : 0},
            {"step_mm", report.lattice.step_mm},
            {"steps_per_quad", report.lattice.steps_per_quad},
            {"tile_quads", report.lattice.tile_quads},
            {"texels", options.texels},
            {"albedo", options.albedo.has_value()},
            {"nodes", {field.z_mm.cols(), field.z_mm.rows()}},
            {"spacing_mm", field.spacing.value()},
            {"x0_mm", field.x0.value()},
            {"y0_mm", field.y0.value()},
            {"scale_denominator", options.asset.scale_denominator},
            {"metres_per_model_metre",
             {content_scale(options).horizontal, content_scale(options).vertical}}};
  std::uint64_t bytes = 0, triangles = 0;
  for (std::size_t level = 0; level < report.levels.size(); ++level) {
    const LodLevelReport& l = report.levels[level];
    Json one{{"level", level},   {"depth", top - static_cast<int>(level)},
             {"tiles", l.tiles}, {"triangles", l.triangles},
             {"bytes", l.bytes}, {"skirt_mm", l.skirt_mm}};
    one.update(json_of(l.error));
    json["levels"].push_back(std::move(one));
    bytes += l.bytes;
    triangles += l.triangles;
  }
  for (const LodStones& file : report.stones)
    json["stones"].push_back({{"uri", lod_stones_uri(file)},
                              {"stones", file.stones.size()},
                              {"triangles", file.triangles},
                              {"bytes", file.bytes},
                              {"hausdorff_bound_mm", file.error_mm}});
  json["triangles"] = triangles;  // of the ground
  json["bytes"] = bytes;
  json["bytes_per_triangle"] = static_cast<double>(bytes) / static_cast<double>(triangles);
  json["tiles"] = Json::array();
  for (const LodTileReport& t : report.tiles) {
    Json one{{"uri", lod_tile_uri(top - t.key.level, t.key.x, t.key.y)},
             {"triangles", t.triangles},
             {"vertices", t.vertices},
             {"bytes", t.bytes}};
    one.update(json_of(t.error));
    json["tiles"].push_back(std::move(one));
  }
  return json.dump(1);
}

}  // namespace maquette::exporting

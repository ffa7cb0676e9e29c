// SPDX-License-Identifier: GPL-3.0-or-later
#include "tools/view/view_export.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <set>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "tools/console.hpp"
#include "tools/pictures.hpp"
#include "tools/version.hpp"
#include "tools/view/packed_grid.hpp"
#include "tools/view/single_page.hpp"
#include "tools/view/view_contents.hpp"
#include "tools/view/view_fields.hpp"
#include "tools/view/view_picture.hpp"

namespace maquette::tools {
namespace fs = std::filesystem;
using nlohmann::json;
namespace {

// Of what the page may weigh.
constexpr double kPictureShare = 0.2, kPathShare = 0.35, kTileShare = 0.5;
constexpr double kSmallestStep = 1e-5;  // of what is no height: four decimals are shown
constexpr int kPicturePixels = 1024;    // a side
constexpr std::size_t kIndexBytes = 4096;

double in_base64(std::size_t bytes) {
  return 4.0 / 3.0 * static_cast<double>(bytes);
}

/// In JSON this is the same letter; in a page it ends nothing.
std::string for_script(std::string text) {
  for (std::size_t at = 0; (at = text.find('<', at)) != std::string::npos; at += 6)
    text.replace(at, 1, "\\u003c");
  return text;
}

std::string dump(const json& j) {
  return j.dump(-1, ' ', false, json::error_handler_t::replace);
}

/// All entries behind each other, and where each is.
class Pack {
 public:
  void add(const std::string& name, const char* coding, std::string_view bytes,
           json grid = nullptr) {
    json entry{{"at", bytes_.size()}, {"size", bytes.size()}, {"coding", coding}};
    if (!grid.is_null()) entry["grid"] = std::move(grid);
    entries_[name] = std::move(entry);
    bytes_ += bytes;
  }
  [[nodiscard]] double weight() const {  // in the page
    return in_base64(bytes_.size()) + 120.0 * static_cast<double>(entries_.size());
  }
  [[nodiscard]] const std::string& bytes() const { return bytes_; }
  [[nodiscard]] const json& entries() const { return entries_; }

 private:
  std::string bytes_;
  json entries_ = json::object();
};

/// Depth of a tile by its name, of stones that of the ground they go with; -1 of what is neither.
int depth_of(const std::string& uri) {
  for (const std::string_view of : {"tiles/", "stones/"})
    if (uri.starts_with(of)) return std::atoi(uri.c_str() + of.size());
  return -1;
}

/// Takes what is deeper out of a tileset and names what is left.
void prune(json& tile, int deepest, std::vector<std::string>& uris) {
  if (tile.contains("content")) uris.push_back(tile["content"].value("uri", ""));
  if (!tile.contains("children")) return;
  json kept = json::array();
  for (json& child : tile["children"]) {
    const std::string uri =
        child.contains("content") ? child["content"].value("uri", "") : std::string();
    if (depth_of(uri) > deepest) continue;
    prune(child, deepest, uris);
    kept.push_back(std::move(child));
  }
  if (kept.empty())
    tile.erase("children");
  else
    tile["children"] = std::move(kept);
}

/// Names an implicit quadtree's tiles one by one, from (x, y) at a depth on: boxes are halved
/// across, errors as well (3D Tiles 1.1, implicit tiling).
void name_tiles(json& tile, const std::set<std::string>& uris, int depth, int x, int y) {
  const auto uri_of = [](int d, int i, int j) {
    return fmt::format("tiles/{}/{}/{}.glb", d, i, j);
  };
  tile["content"] = {{"uri", uri_of(depth, x, y)}};
  const auto box = tile.at("boundingVolume").at("box").get<std::array<double, 12>>();
  for (const int j : {0, 1})
    for (const int i : {0, 1}) {
      if (!uris.contains(uri_of(depth + 1, 2 * x + i, 2 * y + j))) continue;
      auto quarter = box;
      quarter[0] += (i == 0 ? -0.5 : 0.5) * box[3];
      quarter[1] += (j == 0 ? -0.5 : 0.5) * box[7];
      quarter[3] *= 0.5;
      quarter[7] *= 0.5;
      json child{{"boundingVolume", {{"box", quarter}}},
                 {"geometricError", 0.5 * tile.at("geometricError").get<double>()},
                 {"refine", "REPLACE"}};
      name_tiles(child, uris, depth + 1, 2 * x + i, 2 * y + j);
      tile["children"].push_back(std::move(child));
    }
}

void name_implicit_tiles(json& tree, const json& lod) {
  for (json& tile : tree.at("root").at("children")) {
    if (tile.erase("implicitTiling") == 0) continue;
    std::set<std::string> uris;
    for (const json& t : lod.at("tiles")) uris.insert(t.at("uri").get<std::string>());
    name_tiles(tile, uris, 0, 0, 0);
  }
}

struct Tileset {
  json entry, tree, lod;       // of the contents, tileset.json and lod.json
  fs::path folder;             // relative
  std::vector<double> weight;  // of the whole tileset down to each depth
};

std::optional<Tileset> read_tileset(const fs::path& root, const json& entry) {
  if (entry["lod"].is_null()) return std::nullopt;
  const auto tree = read_file(root / entry["path"].get<std::string>());
  const auto lod = read_file(root / entry["lod"].get<std::string>());
  if (!tree || !lod) return std::nullopt;
  Tileset t;
  t.entry = entry;
  t.folder = fs::path(entry["path"].get<std::string>()).parent_path();
  t.tree = json::parse(*tree, nullptr, false);
  const json whole = json::parse(*lod, nullptr, false);
  try {
    name_implicit_tiles(t.tree, whole);
    // What the page reads; the list of all tiles is longer than the coarse ones.
    for (const char* key :
         {"nodes", "spacing_mm", "x0_mm", "y0_mm", "tile_quads", "scale_denominator", "levels"})
      t.lod[key] = whole.at(key);
    if (whole.contains("metres_per_model_metre"))  // sets of earlier versions: 1
      t.lod["metres_per_model_metre"] = whole["metres_per_model_metre"];
    const std::size_t levels = t.lod["levels"].size();
    for (std::size_t depth = 0; depth < levels; ++depth) {
      json pruned = t.tree.at("root");
      std::vector<std::string> uris;
      prune(pruned, static_cast<int>(depth), uris);
      double weight = 0.2 * static_cast<double>(dump(pruned).size());
      for (const std::string& uri : uris) {
        std::error_code ec;
        const auto size = fs::file_size(root / t.folder / uri, ec);
        if (!ec) weight += in_base64(size) + 120.0;
      }
      t.weight.push_back(weight);
    }
  } catch (const json::exception&) {
    return std::nullopt;
  }
  return t.weight.empty() ? std::nullopt : std::optional(std::move(t));
}

void carry_tileset(const fs::path& root, Tileset t, int deepest, Pack& pack) {
  std::vector<std::string> uris;
  prune(t.tree["root"], deepest, uris);
  json levels = json::array();
  for (const json& level : t.lod["levels"])
    if (level["depth"].get<int>() <= deepest) levels.push_back(level);
  t.lod["levels"] = levels;
  pack.add("files/" + t.entry["path"].get<std::string>(), "deflate", deflated(dump(t.tree)));
  pack.add("files/" + t.entry["lod"].get<std::string>(), "deflate", deflated(dump(t.lod)));
  for (const std::string& uri : uris)
    // One that is not there is said by the page, as when it is served.
    if (const auto bytes = read_file(root / t.folder / uri))
      pack.add("files/" + (t.folder / uri).generic_string(), "plain", *bytes);
}

/// A raster in each size, from small to large, until it is whole.
struct Raster {
  json entry;
  std::vector<ThinnedField> shapes;  // without values
  std::vector<PackedGrid> grids;
  [[nodiscard]] std::size_t at(std::size_t side) const { return std::min(side, grids.size() - 1); }
};

Result<Raster> read_raster(const fs::path& root, const json& entry, double most_bytes) {
  const fs::path file = root / entry["path"].get<std::string>();
  MAQUETTE_TRY(const auto field, heightmap::read_model_grid(file));
  const bool height = entry["kind"] == "height";
  Raster r;
  r.entry = entry;
  for (const std::ptrdiff_t side : kExportSides) {
    ThinnedField thin = thinned(field, side, !height);
    PackedGrid grid = packed(thin, height ? kHeightStep_mm : kSmallestStep);
    if (!r.grids.empty() && in_base64(grid.bytes.size()) > most_bytes) break;
    r.grids.push_back(std::move(grid));
    thin.values.clear();
    const bool whole = thin.whole;
    r.shapes.push_back(std::move(thin));
    if (whole) break;
  }
  return r;
}

/// Of the carried grid's triangles at a place in its nodes; as grid_ground.ts.
double height_on(const ThinnedField& f, double x, double y) {
  const auto c = std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(x), 0, f.cols - 2),
             r = std::clamp<std::ptrdiff_t>(static_cast<std::ptrdiff_t>(y), 0, f.rows - 2);
  const double u = x - static_cast<double>(c), v = y - static_cast<double>(r);
  const auto at = [&](std::ptrdiff_t row, std::ptrdiff_t col) {
    return static_cast<double>(f.values[static_cast<std::size_t>(row * f.cols + col)]);
  };
  const double a = at(r, c), d = at(r + 1, c + 1);
  if (u >= v) {
    const double b = at(r, c + 1);
    return a + u * (b - a) + v * (d - b);
  }
  const double e = at(r + 1, c);
  return a + v * (e - a) + u * (d - e);
}

struct Distance {
  double most = 0.0, rms = 0.0;
};
Distance distance(const heightmap::ModelField& field, const ThinnedField& thin) {
  Distance d;
  double n = 0.0;
  const double s = field.spacing.value();
  for (std::ptrdiff_t r = 0; r < field.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < field.z_mm.cols(); ++c) {
      const double e = height_on(thin, static_cast<double>(c) * s / thin.dx_mm,
                                 static_cast<double>(r) * s / thin.dy_mm) -
                       static_cast<double>(field.z_mm(r, c));
      if (std::isnan(e)) continue;
      d.most = std::max(d.most, std::fabs(e));
      d.rms += e * e;
      n += 1.0;
    }
  d.rms = n > 0.0 ? std::sqrt(d.rms / n) : 0.0;
  return d;
}

Result<void> carry_raster(const fs::path& root, Raster r, std::size_t side, Pack& pack) {
  const std::size_t k = r.at(side);
  const std::string path = r.entry["path"];
  ThinnedField& shape = r.shapes[k];
  const PackedGrid& grid = r.grids[k];
  json about = json::parse(shape.shape_json());
  about["low"] = grid.low;
  about["step"] = grid.step;
  if (r.entry["kind"] == "height") {
    MAQUETTE_TRY(const auto field, heightmap::read_model_grid(root / path));
    shape.values =
        unpacked(grid, static_cast<std::size_t>(shape.rows), static_cast<std::size_t>(shape.cols));
    const Distance d = distance(field, shape);
    about["most_mm"] = d.most;
    about["rms_mm"] = d.rms;
  }
  pack.add("grid/" + path, "grid", grid.bytes, std::move(about));
  return {};
}

}  // namespace

Result<JobResult> view_export_job(const fs::path& folder, const fs::path& out,
                                  std::span<const PageFile> page, double most_mb,
                                  const RunContext& run) {
  MAQUETTE_TRY(const std::string text, view_contents_json(folder));
  std::error_code ec;
  const fs::path root = fs::canonical(folder, ec);
  json contents = json::parse(text);
  const double most = 1e6 * most_mb;
  const double own = static_cast<double>(single_page(page, {}).size()) + kIndexBytes;
  Pack pack;
  std::vector<std::string> left_out, damaged;
  const auto read = [&](const std::string& path) { return read_file(root / path); };

  json plans = contents["plans"];
  for (const json& t : contents["tilesets"])
    if (!t["stones"].is_null()) plans.push_back(t["stones"]);
  for (const json& plan : plans)
    if (const auto bytes = read(plan))
      pack.add("files/" + plan.get<std::string>(), "deflate", deflated(*bytes));
  std::set<std::string> pictures;
  double picture_weight = 0.0;
  for (json& frame : contents["frames"]) {
    if (frame["picture"].is_null()) continue;
    const std::string picture = frame["picture"];
    if (pictures.contains(picture)) continue;
    const auto bytes = picture_png(root / picture, frame["linear"], kPicturePixels);
    const double with = picture_weight + (bytes ? in_base64(bytes->size()) : 0.0);
    if (bytes && with < kPictureShare * most) {
      picture_weight = with;
      pack.add("files/" + picture, "plain", *bytes);
      pictures.insert(picture);
    } else {
      (bytes ? left_out : damaged).push_back(picture);
      frame["picture"] = nullptr;
    }
  }
  json paths = json::array();
  double path_weight = 0.0;
  for (const json& path : contents["paths"]) {
    const auto bytes = read(path);
    const std::string packed_path = bytes ? deflated(*bytes) : std::string();
    if (bytes && path_weight + in_base64(packed_path.size()) < kPathShare * most) {
      path_weight += in_base64(packed_path.size());
      pack.add("files/" + path.get<std::string>(), "deflate", packed_path);
      paths.push_back(path);
    } else {
      left_out.push_back(path);
    }
  }
  contents["paths"] = paths;
  run.progress(0.1);

  // Tiles: as deep as fits.
  json tilesets = json::array();
  std::vector<std::pair<std::string, std::string>> decoder;
  double decoder_weight = 0.0, coarsest_tiles = 0.0;
  for (const auto& [name, ending] :
       {std::pair{"draco_wasm_wrapper", ".js"}, std::pair{"draco_decoder", ".wasm"}})
    for (const PageFile& f : page)
      if (!contents["tilesets"].empty() && f.name.starts_with(fmt::format("assets/{}", name)) &&
          f.name.ends_with(ending)) {
        decoder.emplace_back(fmt::format("page/{}{}", name, ending), deflated(f.bytes));
        decoder_weight += in_base64(decoder.back().second.size());
      }
  const double for_tiles =
      (contents["fields"].empty() ? 1.0 : kTileShare) *
      (most - own - pack.weight() - decoder_weight) /
      static_cast<double>(std::max<std::size_t>(1, contents["tilesets"].size()));
  for (const json& entry : contents["tilesets"]) {
    auto t = read_tileset(root, entry);
    int deepest = -1;
    for (std::size_t depth = 0; t && depth < t->weight.size(); ++depth)
      if (t->weight[depth] <= for_tiles) deepest = static_cast<int>(depth);
    if (t) coarsest_tiles += t->weight.front();
    if (deepest < 0) {
      left_out.push_back(entry["path"]);
      continue;
    }
    carry_tileset(root, std::move(*t), deepest, pack);
    tilesets.push_back(entry);
  }
  contents["tilesets"] = tilesets;
  if (!tilesets.empty())
    for (const auto& [name, bytes] : decoder) pack.add(name, "deflate", bytes);
  run.progress(0.2);

  // Rasters: all alike, as fine as fits.
  const double for_rasters =
      most - own - pack.weight() - 60.0 * static_cast<double>(left_out.size());
  std::vector<Raster> rasters;
  json fields = json::array();
  double done = 0.0;
  for (const json& entry : contents["fields"]) {
    if (run.stopped()) return fail(kCancelled, "stopped");
    if (auto raster = read_raster(root, entry, for_rasters)) {
      rasters.push_back(std::move(*raster));
      fields.push_back(entry);
    } else {
      damaged.push_back(entry["path"]);
    }
    done += 1.0;
    run.progress(0.2 + 0.6 * done / static_cast<double>(contents["fields"].size()));
  }
  contents["fields"] = fields;
  std::optional<std::size_t> side;
  double smallest = 0.0;
  for (std::size_t k = 0; k < kExportSides.size(); ++k) {
    double weight = 0.0;
    bool there = true;
    for (const Raster& r : rasters) {
      // One that stopped before it was whole would not fit by itself.
      there = there && (k < r.grids.size() || r.shapes.back().whole);
      weight += in_base64(r.grids[r.at(k)].bytes.size()) + 400.0;
    }
    if (k == 0) smallest = weight;
    if (there && weight <= for_rasters) side = k;
  }
  if ((!rasters.empty() && !side) || (rasters.empty() && tilesets.empty())) {
    const double needed =
        most - for_rasters + smallest + (rasters.empty() ? coarsest_tiles + decoder_weight : 0.0);
    return fail(
        kViewExportSmall,
        fmt::format("{}: what {} holds does not fit into {:.3g} MB; --export-mb {:.0f} "
                    "would do at its coarsest",
                    out.string(), folder.string(), most_mb, std::ceil(1e-6 * needed + 0.2)));
  }
  std::ptrdiff_t nodes = 0;
  done = 0.0;
  for (Raster& r : rasters) {
    const ThinnedField& shape = r.shapes[r.at(*side)];
    nodes = std::max({nodes, shape.rows, shape.cols});
    MAQUETTE_TRY_VOID(carry_raster(root, std::move(r), *side, pack));
    done += 1.0;
    run.progress(0.8 + 0.2 * done / static_cast<double>(rasters.size()));
  }

  contents["reports"] = json::array();  // they lie elsewhere
  contents["manifest"] = nullptr;
  pack.add("maquette.json", "deflate", deflated(dump(contents)));
  const json index{{"made_by", fmt::format("maquette {}", kVersion)},
                   {"left_out", left_out},
                   {"damaged", damaged},
                   {"entries", pack.entries()}};
  const std::string html = single_page(
      page, fmt::format("<script id=\"carried-index\" type=\"application/json\">{}</script>\n"
                        "<script id=\"carried\" type=\"text/plain\">{}</script>\n",
                        for_script(dump(index)), base64(pack.bytes())));
  MAQUETTE_TRY_VOID(write_file(out, html));
  JobResult result;
  result.outputs = {out};
  result.figures_json = dump({{"bytes", html.size()},
                              {"nodes_a_side", nodes},
                              {"tilesets", tilesets.size()},
                              {"rasters", rasters.size()},
                              {"left_out", left_out},
                              {"damaged", damaged}});
  result.note = human_bytes(static_cast<double>(html.size()));
  if (nodes > 0) result.note += fmt::format(", rasters of at most {0} x {0} nodes", nodes);
  for (const std::string& name : damaged)
    run.warn(fmt::format("{} cannot be read and is left out", name));
  for (const std::string& name : left_out)
    run.warn(fmt::format("{} does not fit into {:.3g} MB and is left out; give more by --export-mb",
                         name, most_mb));
  return result;
}

}  // namespace maquette::tools

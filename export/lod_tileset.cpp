// SPDX-License-Identifier: GPL-3.0-or-later
#include "export/lod_tileset.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <numbers>

#include <fmt/format.h>
#include <nlohmann/json.hpp>

#include "export/glb_file.hpp"

namespace maquette::exporting {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kSubtreeLevels = 6;  ///< 1365 tiles a subtree file

/// Middle and half axes, as 3D Tiles has it.
std::array<double, 12> box_numbers(const Box3& box) {
  const Vec3 middle = 0.5 * (box.min + box.max), half = 0.5 * (box.max - box.min);
  return {middle.x, middle.y, middle.z, half.x, 0.0, 0.0, 0.0, half.y, 0.0, 0.0, 0.0, half.z};
}
Json json_box(const Box3& box) {
  return {{"box", box_numbers(box)}};
}

void add(Box3& box, const Box3& other) {
  box.add(other.min);
  box.add(other.max);
}

/// Boxes and errors with what is below; by depth, x, y.
class Tree {
 public:
  struct Node {
    Box3 box;  ///< metres, tileset's frame
    double error_m = 0.0;
  };

  Tree(const LodSetReport& report, const heightmap::ModelField& field, LodContentScale content)
      : rows_(field.z_mm.rows()), cols_(field.z_mm.cols()), lattice_(report.lattice) {
    const double step = content.horizontal * kMetresPerMillimetre * lattice_.step_mm;
    const double high = content.vertical * kMetresPerMillimetre * lattice_.step_mm;
    const double quad = step * lattice_.steps_per_quad;
    width_ = quad * static_cast<double>(lattice_.tile_quads << (report.levels.size() - 1));
    top_ = static_cast<int>(report.levels.size()) - 1;
    for (const LodTileReport& t : report.tiles) {
      const std::ptrdiff_t width = lattice_.tile_quads << t.key.level;
      Node node;
      node.error_m = content.vertical * kMetresPerMillimetre * t.error.vertical_mm;
      node.box.add({quad * static_cast<double>(t.key.x * width) - step,
                    quad * static_cast<double>(t.key.y * width) - step, high * (t.lowest - 1)});
      node.box.add({quad * static_cast<double>(std::min((t.key.x + 1) * width, cols_ - 1)) + step,
                    quad * static_cast<double>(std::min((t.key.y + 1) * width, rows_ - 1)) + step,
                    high * (t.highest + 1)});
      nodes_[{t.key.level, t.key.x, t.key.y}] = node;
    }
    for (int level = 1; level <= top_; ++level)  // finest are complete; then those above them
      for (auto& [key, node] : nodes_) {
        if (std::get<0>(key) != level) continue;
        const auto [l, x, y] = key;
        for (const std::ptrdiff_t i : {0, 1})
          for (const std::ptrdiff_t j : {0, 1}) {
            const auto child = nodes_.find({l - 1, 2 * x + i, 2 * y + j});
            if (child == nodes_.end()) continue;
            add(node.box, child->second.box);
            node.error_m = std::max(node.error_m, child->second.error_m);
          }
      }
  }

  [[nodiscard]] int top() const { return top_; }
  [[nodiscard]] const Node& root() const { return at(0, 0, 0); }
  [[nodiscard]] const Node& at(int depth, std::ptrdiff_t x, std::ptrdiff_t y) const {
    return nodes_.at({top_ - depth, x, y});
  }
  [[nodiscard]] bool has(int depth, std::ptrdiff_t x, std::ptrdiff_t y) const {
    return nodes_.contains({top_ - depth, x, y});
  }
  [[nodiscard]] Json json(int level, std::ptrdiff_t x, std::ptrdiff_t y) const {
    const Node& node = nodes_.at({level, x, y});
    Json tile{{"boundingVolume", json_box(node.box)},
              {"geometricError", node.error_m},
              {"refine", "REPLACE"},
              {"content", {{"uri", lod_tile_uri(top_ - level, x, y)}}}};
    if (level == 0) return tile;
    tile["children"] = Json::array();
    for (const std::ptrdiff_t j : {0, 1})
      for (const std::ptrdiff_t i : {0, 1})
        if (nodes_.contains({level - 1, 2 * x + i, 2 * y + j}))
          tile["children"].push_back(json(level - 1, 2 * x + i, 2 * y + j));
    return tile;
  }
  /// The whole square of the quadtree, so that halving it gives boxes that contain each tile.
  [[nodiscard]] Box3 square() const {
    Box3 box = root().box;
    // Not a step larger: halving would take that from the children's inner sides.
    box.min.x = box.min.y = 0.0;
    box.max.x = box.max.y = width_;
    return box;
  }
  /// Halved at each level it stays above every tile's error.
  [[nodiscard]] double halving_error_m() const {
    double error = 0.0;
    for (const auto& [key, node] : nodes_)
      error = std::max(error, std::ldexp(node.error_m, top_ - std::get<0>(key)));
    return error;
  }

 private:
  std::ptrdiff_t rows_, cols_;
  LodLattice lattice_;
  int top_ = 0;
  double width_ = 0.0;  ///< of the quadtree's square, metres
  std::map<std::tuple<int, std::ptrdiff_t, std::ptrdiff_t>, Node> nodes_;
};

/// A file of stones and under it the finer ones of its cell, from the level behind its own on.
struct StoneTile {
  Json json;
  Box3 box;
  double error_m = 0.0;
};
StoneTile stone_tile(std::span<const LodStones> files, std::size_t i, double metres_per_mm) {
  const LodStones& file = files[i];
  StoneTile tile{{}, file.box, metres_per_mm * file.error_mm};
  Json children = Json::array();
  std::size_t next = i;
  while (next < files.size() && files[next].depth == file.depth) ++next;
  for (std::size_t k = next; k < files.size() && files[k].depth == files[next].depth; ++k) {
    const int down = files[k].cells - file.cells;
    if (files[k].x >> down != file.x || files[k].y >> down != file.y) continue;
    StoneTile child = stone_tile(files, k, metres_per_mm);
    add(tile.box, child.box);
    tile.error_m = std::max(tile.error_m, child.error_m);
    children.push_back(std::move(child.json));
  }
  tile.json = {{"boundingVolume", json_box(tile.box)},
               {"geometricError", tile.error_m},
               {"refine", "REPLACE"},
               {"content", {{"uri", lod_stones_uri(file)}}}};
  if (!children.empty()) tile.json["children"] = std::move(children);
  return tile;
}

/// Terrain and stones under one root without content.
Json tileset(const Tree& tree, Json terrain, double terrain_error_m, const Box3& terrain_box,
             const LodSetReport& report, const LodSetOptions& options,
             const heightmap::ModelField& field) {
  const LodContentScale content = content_scale(options);
  std::vector<StoneTile> stones;
  for (std::size_t i = 0;
       i < report.stones.size() && report.stones[i].depth == report.stones[0].depth; ++i)
    stones.push_back(stone_tile(
        report.stones, i, kMetresPerMillimetre * std::max(content.horizontal, content.vertical)));
  Box3 box = terrain_box;
  for (const StoneTile& tile : stones) add(box, tile.box);
  // What is missing where nothing is drawn: all of it.
  const double error = std::max(terrain_error_m, norm(tree.root().box.max - tree.root().box.min));
  Json root{{"boundingVolume", json_box(box)}, {"geometricError", error}, {"refine", "ADD"}};
  Json json;
  json["asset"] = {{"version", "1.1"},
                   {"generator", "maquette"},
                   {"extras",
                    {{"unit", "m"},
                     {"frame",
                      "x east, y north, z up; origin at the field's south-western node, "
                      "model z = 0"},
                     {"size", options.place ? "full" : "model"},
                     {"scale_denominator", options.asset.scale_denominator}}}};
  if (options.place) {
    root["transform"] = fixed_from_tileset(*options.place, field, options.asset.scale_denominator);
    const heightmap::Body& body = options.place->body;
    std::string name = body.name;
    name[0] = static_cast<char>(std::toupper(static_cast<unsigned char>(name[0])));
    json["extensionsUsed"] = {"3DTILES_ellipsoid"};
    json["extensions"]["3DTILES_ellipsoid"] = {
        {"body", name},
        {"radii", {body.equatorial_radius_m, body.equatorial_radius_m, body.polar_radius_m}}};
  }
  root["children"] = {std::move(terrain)};
  for (StoneTile& tile : stones) root["children"].push_back(std::move(tile.json));
  json["geometricError"] = error;
  json["root"] = std::move(root);
  return json;
}

std::pair<std::ptrdiff_t, std::ptrdiff_t> from_morton(std::size_t code) {
  std::size_t x = 0, y = 0;
  for (std::size_t bit = 0; bit < 16; ++bit) {
    x |= (code >> (2 * bit) & 1) << bit;
    y |= (code >> (2 * bit + 1) & 1) << bit;
  }
  return {static_cast<std::ptrdiff_t>(x), static_cast<std::ptrdiff_t>(y)};
}

struct Bits {
  std::vector<bool> set;
  [[nodiscard]] std::size_t count() const {
    return static_cast<std::size_t>(std::count(set.begin(), set.end(), true));
  }
};

/// Availability as a constant where it is one, else as bits, each stream from a multiple of eight.
Json json_availability(const Bits& bits, std::string& binary, Json& views) {
  const std::size_t count = bits.count();
  if (count == 0) return {{"constant", 0}};
  if (count == bits.set.size()) return {{"constant", 1}};
  const std::size_t bytes = (bits.set.size() + 7) / 8, at = binary.size();
  binary.resize(at + (bytes + 7) / 8 * 8, '\0');
  for (std::size_t i = 0; i < bits.set.size(); ++i)
    if (bits.set[i])
      binary[at + i / 8] =
          static_cast<char>(static_cast<unsigned char>(binary[at + i / 8]) | (1U << (i % 8)));
  views.push_back({{"buffer", 0}, {"byteOffset", at}, {"byteLength", bytes}});
  return {{"bitstream", views.size() - 1}, {"availableCount", count}};
}

/// What a subtree's table of tiles says of each: what halving the root's box and error would only
/// bound (3D Metadata Specification, semantics of tiles).
Json tile_schema() {
  const auto property = [](const char* semantic) {
    return Json{{"type", "SCALAR"},
                {"componentType", "FLOAT64"},
                {"required", true},
                {"semantic", semantic}};
  };
  Json box = property("TILE_BOUNDING_BOX");
  box["array"] = true;
  box["count"] = 12;
  return {{"id", "maquette_tiles"},
          {"classes",
           {{"tile",
             {{"properties",
               {{"box", std::move(box)}, {"error", property("TILE_GEOMETRIC_ERROR")}}}}}}}};
}

/// @return  number of the view
std::size_t add_doubles(const std::vector<double>& values, std::string& binary, Json& views) {
  const std::size_t at = binary.size(), bytes = values.size() * sizeof(double);
  binary.resize(at + bytes);
  std::memcpy(binary.data() + at, values.data(), bytes);
  views.push_back({{"buffer", 0}, {"byteOffset", at}, {"byteLength", bytes}});
  return views.size() - 1;
}

std::string subtree(const Tree& tree, int depth, std::ptrdiff_t x, std::ptrdiff_t y) {
  Bits tiles, children;
  std::vector<double> boxes, errors;  // of tiles that are there, in the order of their bits
  const auto fill = [&](Bits& bits, int level) {
    const std::size_t side = std::size_t{1} << level, first = bits.set.size();
    bits.set.resize(first + side * side);
    for (std::size_t code = 0; code < side * side; ++code) {
      const auto [i, j] = from_morton(code);
      bits.set[first + code] = tree.has(depth + level, (x << level) + i, (y << level) + j);
      if (!bits.set[first + code] || level == kSubtreeLevels) continue;
      const Tree::Node& node = tree.at(depth + level, (x << level) + i, (y << level) + j);
      const auto box = box_numbers(node.box);
      boxes.insert(boxes.end(), box.begin(), box.end());
      errors.push_back(node.error_m);
    }
  };
  for (int level = 0; level < kSubtreeLevels; ++level) fill(tiles, level);
  fill(children, kSubtreeLevels);
  std::string binary;
  Json views = Json::array();
  Json json;
  json["tileAvailability"] = json_availability(tiles, binary, views);
  json["contentAvailability"] = {json["tileAvailability"]};
  json["childSubtreeAvailability"] = json_availability(children, binary, views);
  json["propertyTables"] = {{{"class", "tile"},
                             {"count", errors.size()},
                             {"properties",
                              {{"box", {{"values", add_doubles(boxes, binary, views)}}},
                               {"error", {{"values", add_doubles(errors, binary, views)}}}}}}};
  json["tileMetadata"] = 0;
  json["buffers"] = {{{"byteLength", binary.size()}}};
  json["bufferViews"] = std::move(views);
  std::string text = json.dump();
  text.resize((text.size() + 7) / 8 * 8, ' ');
  std::string file = "subt";
  const auto put = [&file](std::uint64_t value, std::size_t bytes) {
    for (std::size_t i = 0; i < bytes; ++i) file.push_back(static_cast<char>(value >> (8 * i)));
  };
  put(1, 4);
  put(text.size(), 8);
  put(binary.size(), 8);
  return file + text + binary;
}

}  // namespace

std::string lod_tile_uri(int depth, std::ptrdiff_t x, std::ptrdiff_t y) {
  return fmt::format("tiles/{}/{}/{}.glb", depth, x, y);
}

std::array<double, 16> fixed_from_tileset(const LodPlace& place, const heightmap::ModelField& field,
                                          double scale_denominator) {
  const double a = place.body.equatorial_radius_m, b = place.body.polar_radius_m;
  const double degree = std::numbers::pi / 180.0;
  const double centric = place.latitude_deg * degree, lon = place.longitude_deg * degree;
  // The ellipsoid's point at that planetocentric latitude, and its normal there (geodetic).
  const double radius = a * b / std::hypot(b * std::cos(centric), a * std::sin(centric));
  const double lat = std::atan2(a * a * std::sin(centric), b * b * std::cos(centric));
  const Vec3 east{-std::sin(lon), std::cos(lon), 0.0};
  const Vec3 up{std::cos(lat) * std::cos(lon), std::cos(lat) * std::sin(lon), std::sin(lat)};
  const Vec3 north = cross(up, east);
  const Vec3 foot = radius * Vec3{std::cos(centric) * std::cos(lon),
                                  std::cos(centric) * std::sin(lon), std::sin(centric)};
  const double half = 0.5 * scale_denominator * kMetresPerMillimetre * field.spacing.value();
  const double x = half * static_cast<double>(field.z_mm.cols() - 1);
  const double y = half * static_cast<double>(field.z_mm.rows() - 1);
  const Vec3 origin = foot + place.height_m * up - x * east - y * north;
  return {east.x, east.y, east.z, 0.0, north.x,  north.y,  north.z,  0.0,
          up.x,   up.y,   up.z,   0.0, origin.x, origin.y, origin.z, 1.0};
}

std::string explicit_tileset(const LodSetReport& report, const LodSetOptions& options,
                             const heightmap::ModelField& field) {
  const Tree tree(report, field, content_scale(options));
  return tileset(tree, tree.json(tree.top(), 0, 0), tree.root().error_m, tree.root().box, report,
                 options, field)
      .dump();
}

std::string implicit_tileset(const LodSetReport& report, const LodSetOptions& options,
                             const heightmap::ModelField& field) {
  const Tree tree(report, field, content_scale(options));
  const double error = tree.halving_error_m();
  Json terrain{{"boundingVolume", json_box(tree.square())},
               {"geometricError", error},
               {"refine", "REPLACE"},
               {"content", {{"uri", "tiles/{level}/{x}/{y}.glb"}}},
               {"implicitTiling",
                {{"subdivisionScheme", "QUADTREE"},
                 {"subtreeLevels", kSubtreeLevels},
                 {"availableLevels", report.levels.size()},
                 {"subtrees", {{"uri", "subtrees/{level}/{x}/{y}.subtree"}}}}}};
  Json json = tileset(tree, std::move(terrain), error, tree.square(), report, options, field);
  json["schema"] = tile_schema();
  return json.dump();
}

std::map<std::string, std::string> subtree_files(const LodSetReport& report,
                                                 const LodSetOptions& options,
                                                 const heightmap::ModelField& field) {
  const Tree tree(report, field, content_scale(options));
  std::map<std::string, std::string> files;
  for (int depth = 0; depth <= tree.top(); depth += kSubtreeLevels)
    for (std::ptrdiff_t y = 0; y < std::ptrdiff_t{1} << depth; ++y)
      for (std::ptrdiff_t x = 0; x < std::ptrdiff_t{1} << depth; ++x)
        if (tree.has(depth, x, y))
          files[fmt::format("subtrees/{}/{}/{}.subtree", depth, x, y)] = subtree(tree, depth, x, y);
  return files;
}

}  // namespace maquette::exporting

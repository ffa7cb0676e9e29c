// SPDX-License-Identifier: GPL-3.0-or-later
#include "export/lod_stones.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include <nlohmann/json.hpp>

#include "core/check.hpp"
#include "export/detail/gltf_asset.hpp"
#include "export/glb_file.hpp"

namespace maquette::exporting {
namespace {

using Json = nlohmann::ordered_json;
using meshing::PlacedStone;

constexpr int kUnsignedInt = 5125, kFloat = 5126;
constexpr int kArrayBuffer = 34962, kElementArrayBuffer = 34963;

/// Accessors one after the other, each with a view of its own.
class Buffer {
 public:
  Json views = Json::array(), accessors = Json::array();
  std::vector<char> bytes;

  /// @param target  0: none
  template <class T>
  std::size_t add(const std::vector<T>& values, int type, std::uint64_t count, const char* shape,
                  int target) {
    const std::size_t size = values.size() * sizeof(T), at = bytes.size();
    Json view{{"buffer", 0}, {"byteOffset", at}, {"byteLength", size}};
    if (target != 0) view["target"] = target;
    views.push_back(std::move(view));
    accessors.push_back({{"bufferView", views.size() - 1},
                         {"componentType", type},
                         {"count", count},
                         {"type", shape}});
    bytes.resize(at + glb_padded(size));
    std::memcpy(bytes.data() + at, values.data(), size);
    return accessors.size() - 1;
  }
};

Float3 to_float(Vec3 v) {
  return {static_cast<float>(v.x), static_cast<float>(v.y), static_cast<float>(v.z)};
}

/// A rock as it was before it was last subdivided so many times, in its own frame.
struct CoarseRock {
  TriMesh mesh;
  double off = 0.0;  ///< at most, of a rock of diameter 1
};

/// The corners of the triangle that was made four: (a, ab, ca), (b, bc, ab), (c, ca, bc), (ab, bc,
/// ca).
using Triangles = std::vector<std::array<std::uint32_t, 3>>;
Triangles parents_of(const Triangles& finer) {
  Triangles coarse;
  coarse.reserve(finer.size() / 4);
  for (std::size_t i = 0; i + 3 < finer.size(); i += 4) {
    MAQUETTE_CHECK(finer[i][1] == finer[i + 1][2] && finer[i + 1][1] == finer[i + 2][2] &&
                       finer[i + 2][1] == finer[i][2],
                   "triangles {} to {} are not one that was made four", i, i + 3);
    coarse.push_back({finer[i][0], finer[i + 1][0], finer[i + 2][0]});
  }
  return coarse;
}

CoarseRock coarse_rock(const PlacedStone& stone, int times) {
  CoarseRock rock{meshing::unit_stone(stone.shape, stone.body)};
  if (stone.body != nullptr) return rock;
  std::vector<Triangles> levels{std::move(rock.mesh.triangles)};  // finest first
  for (int k = std::min(times, stone.shape.subdivisions); k > 0; --k)
    levels.push_back(parents_of(levels.back()));
  // Where the fine vertices lie on the coarse triangles: halves of halves.
  const std::vector<Vec3>& fine = rock.mesh.vertices_mm;
  std::vector<Vec3> on_coarse = fine;
  for (std::size_t level = levels.size() - 1; level > 0; --level)
    for (std::size_t i = 0; i < levels[level].size(); ++i)
      for (std::size_t k = 0; k < 3; ++k) {
        const std::uint32_t middle = levels[level - 1][4 * i + k][1];
        on_coarse[middle] =
            0.5 * (on_coarse[levels[level][i][k]] + on_coarse[levels[level][i][(k + 1) % 3]]);
        rock.off = std::fmax(rock.off, norm(on_coarse[middle] - fine[middle]));
      }
  rock.mesh.triangles = std::move(levels.back());
  std::uint32_t last = 0;  // corners of coarse triangles are the first vertices
  for (const auto& t : rock.mesh.triangles) last = std::max({last, t[0], t[1], t[2]});
  rock.mesh.vertices_mm.resize(last + 1);
  return rock;
}

struct Pose {
  Float3 translation_m{};
  std::array<float, 4> rotation{};  ///< x, y, z, w
  float scale = 1.0F;               ///< a rock of diameter 1, to metres
};

Pose pose_of(const PlacedStone& stone, Vec3 corner_mm) {
  const RigidTransform& t = stone.model_from_stone;
  const Vec3 axis = gltf_axes({t.rotation.x, t.rotation.y, t.rotation.z});
  return {to_float(gltf_axes(kMetresPerMillimetre * (t.translation_mm - corner_mm))),
          {static_cast<float>(axis.x), static_cast<float>(axis.y), static_cast<float>(axis.z),
           static_cast<float>(t.rotation.w)},
          static_cast<float>(kMetresPerMillimetre * stone.scale_mm)};
}

/// A mesh in glTF's axes; @return its number
std::size_t add_mesh(Json& json, Buffer& buffer, const TriMesh& mesh) {
  std::vector<Float3> positions;
  Float3 lo, hi;
  lo.fill(INFINITY);
  hi.fill(-INFINITY);
  for (const Vec3& v : mesh.vertices_mm) {
    positions.push_back(to_float(gltf_axes(v)));
    for (std::size_t k = 0; k < 3; ++k) {
      lo[k] = std::min(lo[k], positions.back()[k]);
      hi[k] = std::max(hi[k], positions.back()[k]);
    }
  }
  const std::size_t position =
      buffer.add(positions, kFloat, positions.size(), "VEC3", kArrayBuffer);
  buffer.accessors[position]["min"] = lo;
  buffer.accessors[position]["max"] = hi;
  const std::size_t normal =
      buffer.add(gltf_normals(mesh), kFloat, positions.size(), "VEC3", kArrayBuffer);
  const std::size_t index = buffer.add(mesh.triangles, kUnsignedInt, 3 * mesh.triangles.size(),
                                       "SCALAR", kElementArrayBuffer);
  json["meshes"].push_back({{"primitives",
                             {{{"attributes", {{"POSITION", position}, {"NORMAL", normal}}},
                               {"indices", index},
                               {"material", 0}}}}});
  return json["meshes"].size() - 1;
}

/// Takes a stone of the file into its box, error and count.
void count_in(LodStones& file, const PlacedStone& stone, const CoarseRock& rock, Vec3 corner_mm,
              LodContentScale content) {
  for (const Vec3& v : rock.mesh.vertices_mm) {
    const Vec3 m =
        kMetresPerMillimetre * (stone.model_from_stone.point(stone.scale_mm * v) - corner_mm);
    file.box.add({content.horizontal * m.x, content.horizontal * m.y, content.vertical * m.z});
  }
  file.error_mm = std::fmax(file.error_mm, stone.scale_mm * rock.off);
  file.triangles += rock.mesh.triangles.size();
}

/// A node for each shape.
void add_instances(Json& json, Buffer& buffer, LodStones& file, Vec3 corner_mm,
                   LodContentScale content) {
  const std::vector<PlacedStone>& stones = file.stones;
  std::vector<bool> done(stones.size(), false);
  for (std::size_t i = 0; i < stones.size(); ++i) {
    if (done[i]) continue;
    const CoarseRock rock = coarse_rock(stones[i], file.coarser);
    const std::size_t mesh = add_mesh(json, buffer, rock.mesh);
    std::vector<Float3> translations, scales;
    std::vector<std::array<float, 4>> rotations;
    Json numbers = Json::array();
    for (std::size_t j = i; j < stones.size(); ++j) {
      if (done[j] || !meshing::same_shape(stones[j], stones[i])) continue;
      done[j] = true;
      count_in(file, stones[j], rock, corner_mm, content);
      const Pose pose = pose_of(stones[j], corner_mm);
      translations.push_back(pose.translation_m);
      rotations.push_back(pose.rotation);
      scales.push_back({pose.scale, pose.scale, pose.scale});
      numbers.push_back(stones[j].number);
    }
    Json node{{"mesh", mesh}, {"extras", {{"stones", numbers}}}};
    if (translations.size() == 1) {
      node["name"] = fmt::format("stone {}", stones[i].number);
      node["translation"] = translations[0];
      node["rotation"] = rotations[0];
      node["scale"] = scales[0];
    } else {
      json["extensionsUsed"] = json["extensionsRequired"] = {"EXT_mesh_gpu_instancing"};
      node["name"] = fmt::format("stones like {}", stones[i].number);
      const std::size_t count = translations.size();
      node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"] = {
          {"TRANSLATION", buffer.add(translations, kFloat, count, "VEC3", 0)},
          {"ROTATION", buffer.add(rotations, kFloat, count, "VEC4", 0)},
          {"SCALE", buffer.add(scales, kFloat, count, "VEC3", 0)}};
    }
    json["nodes"].push_back(std::move(node));
  }
}

/// One node, one mesh.
void add_merged(Json& json, Buffer& buffer, LodStones& file, Vec3 corner_mm,
                LodContentScale content) {
  TriMesh all;  // metres from the corner
  std::vector<float> feature;
  Json numbers = Json::array();
  for (const PlacedStone& stone : file.stones) {
    const CoarseRock rock = coarse_rock(stone, file.coarser);
    count_in(file, stone, rock, corner_mm, content);
    const auto first = static_cast<std::uint32_t>(all.vertices_mm.size());
    for (const Vec3& v : rock.mesh.vertices_mm)
      all.vertices_mm.push_back(kMetresPerMillimetre *
                                (stone.model_from_stone.point(stone.scale_mm * v) - corner_mm));
    for (const auto& t : rock.mesh.triangles)
      all.triangles.push_back({first + t[0], first + t[1], first + t[2]});
    feature.resize(all.vertices_mm.size(), static_cast<float>(numbers.size()));
    numbers.push_back(stone.number);
  }
  const std::size_t mesh = add_mesh(json, buffer, all);
  Json& primitive = json["meshes"][mesh]["primitives"][0];
  primitive["attributes"]["_FEATURE_ID_0"] =
      buffer.add(feature, kFloat, feature.size(), "SCALAR", kArrayBuffer);
  primitive["extensions"]["EXT_mesh_features"]["featureIds"] = {
      {{"featureCount", file.stones.size()}, {"attribute", 0}}};
  json["extensionsUsed"] = {"EXT_mesh_features"};
  json["nodes"].push_back(
      {{"name", "stones"}, {"mesh", mesh}, {"extras", {{"stones", std::move(numbers)}}}});
}

/// Shapes of stones, each cell's counted for itself.
std::size_t distinct_shapes(const std::vector<std::vector<PlacedStone>>& cells) {
  std::size_t count = 0;
  for (const auto& stones : cells)
    for (std::size_t i = 0; i < stones.size(); ++i)
      if (std::none_of(stones.begin(), stones.begin() + static_cast<std::ptrdiff_t>(i),
                       [&](const PlacedStone& s) { return same_shape(s, stones[i]); }))
        ++count;
  return count;
}

}  // namespace

std::string lod_stones_uri(const LodStones& stones) {
  return fmt::format("stones/{}/{}/{}.glb", stones.depth, stones.x, stones.y);
}

std::vector<LodStones> divide_stones(std::span<const PlacedStone> stones, int deepest,
                                     double width_mm, Vec3 corner_mm) {
  constexpr double kLeastStones = 8.0, kMostCopies = 1.5;
  const auto cells_of = [&](int depth) {
    const std::ptrdiff_t side = std::ptrdiff_t{1} << depth;
    std::vector<std::vector<PlacedStone>> cells(static_cast<std::size_t>(side * side));
    const auto cell = [&](double from_corner_mm) {
      return std::clamp(
          static_cast<std::ptrdiff_t>(from_corner_mm / width_mm * static_cast<double>(side)),
          std::ptrdiff_t{0}, side - 1);
    };
    for (const PlacedStone& s : stones) {
      const Vec3 from = s.model_from_stone.translation_mm - corner_mm;
      cells[static_cast<std::size_t>(cell(from.y) * side + cell(from.x))].push_back(s);
    }
    return cells;
  };
  int finest = 0;
  const auto shapes = static_cast<double>(distinct_shapes(cells_of(0)));
  while (finest < deepest &&
         static_cast<double>(stones.size()) >= kLeastStones * std::ldexp(1.0, 2 * (finest + 1)) &&
         static_cast<double>(distinct_shapes(cells_of(finest + 1))) <= kMostCopies * shapes)
    ++finest;
  int subdivided = 0;
  for (const PlacedStone& s : stones)
    if (s.body == nullptr) subdivided = std::max(subdivided, s.shape.subdivisions);
  // A sixteenth of the triangles where the ground has that, twice.
  constexpr int kStep = 2, kMostCoarser = 4;
  std::vector<std::pair<int, int>> levels{{deepest, 0}};  // depth, coarser
  while (levels.back().first > 0 && levels.back().second < kMostCoarser &&
         levels.back().second + kStep <= subdivided)
    levels.emplace_back(std::max(0, levels.back().first - kStep), levels.back().second + kStep);
  // The coarsest are there with whatever ground there is.
  if (levels.size() > 1) levels.back().first = 0;
  std::vector<LodStones> files;
  for (auto level = levels.rbegin(); level != levels.rend(); ++level) {
    const int depth = std::min(finest, level->first);
    const std::ptrdiff_t side = std::ptrdiff_t{1} << depth;
    auto cells = cells_of(depth);
    for (std::size_t i = 0; i < cells.size(); ++i) {
      if (cells[i].empty()) continue;
      LodStones file;
      file.depth = level->first;
      file.cells = depth;
      file.x = static_cast<std::ptrdiff_t>(i) % side;
      file.y = static_cast<std::ptrdiff_t>(i) / side;
      file.coarser = level->second;
      file.stones = std::move(cells[i]);
      files.push_back(std::move(file));
    }
  }
  return files;
}

GlbContent encode_stones(LodStones& stones, Vec3 corner_mm, const LodAssetOptions& options,
                         LodContentScale content) {
  stones.box = {};
  stones.error_mm = 0.0;
  stones.triangles = 0;
  Json json;
  json["asset"] = gltf_asset({{"scale_denominator", options.scale_denominator},
                              {"metres_per_model_metre", {content.horizontal, content.vertical}}});
  json["scene"] = 0;
  json["nodes"] = Json::array();
  json["meshes"] = Json::array();
  json["materials"] = {Json::parse(material_json(options.material))};
  Buffer buffer;
  if (options.merge_stones)
    add_merged(json, buffer, stones, corner_mm, content);
  else
    add_instances(json, buffer, stones, corner_mm, content);
  // Poses are stored as floats.
  const double slack = 1e-6 * std::max(content.horizontal, norm(stones.box.max - stones.box.min));
  stones.box.min += Vec3{-slack, -slack, -slack};
  stones.box.max += Vec3{slack, slack, slack};
  Json top = Json::array();
  for (std::size_t i = 0; i < json["nodes"].size(); ++i) top.push_back(i);
  if (content.horizontal != 1.0 || content.vertical != 1.0) {
    Json all{{"name", "stones"},
             {"scale", {content.horizontal, content.vertical, content.horizontal}},
             {"children", std::move(top)}};
    top = {json["nodes"].size()};
    json["nodes"].push_back(std::move(all));
  }
  json["scenes"] = {{{"nodes", std::move(top)}}};
  json["bufferViews"] = std::move(buffer.views);
  json["accessors"] = std::move(buffer.accessors);
  json["buffers"] = {{{"byteLength", buffer.bytes.size()}}};
  return {json.dump(), std::move(buffer.bytes)};
}

}  // namespace maquette::exporting

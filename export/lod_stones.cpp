// SPDX-License-Identifier: GPL-3.0-or-later
#include "export/lod_stones.hpp"

#include <algorithm>
#include <cstring>

#include <nlohmann/json.hpp>

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

/// A node for each shape.
void add_instances(Json& json, Buffer& buffer, std::span<const PlacedStone> stones,
                   Vec3 corner_mm) {
  std::vector<bool> done(stones.size(), false);
  for (std::size_t i = 0; i < stones.size(); ++i) {
    if (done[i]) continue;
    const std::size_t mesh =
        add_mesh(json, buffer, meshing::unit_stone(stones[i].shape, stones[i].body));
    std::vector<Float3> translations, scales;
    std::vector<std::array<float, 4>> rotations;
    Json numbers = Json::array();
    for (std::size_t j = i; j < stones.size(); ++j) {
      if (done[j] || !meshing::same_shape(stones[j], stones[i])) continue;
      done[j] = true;
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
void add_merged(Json& json, Buffer& buffer, std::span<const PlacedStone> stones, Vec3 corner_mm) {
  TriMesh all;  // metres from the corner
  std::vector<float> feature;
  Json numbers = Json::array();
  for (const PlacedStone& stone : stones) {
    const TriMesh one = meshing::stone_mesh(stone);
    const auto first = static_cast<std::uint32_t>(all.vertices_mm.size());
    for (const Vec3& v : one.vertices_mm)
      all.vertices_mm.push_back(kMetresPerMillimetre * (v - corner_mm));
    for (const auto& t : one.triangles)
      all.triangles.push_back({first + t[0], first + t[1], first + t[2]});
    feature.resize(all.vertices_mm.size(), static_cast<float>(numbers.size()));
    numbers.push_back(stone.number);
  }
  const std::size_t mesh = add_mesh(json, buffer, all);
  Json& primitive = json["meshes"][mesh]["primitives"][0];
  primitive["attributes"]["_FEATURE_ID_0"] =
      buffer.add(feature, kFloat, feature.size(), "SCALAR", kArrayBuffer);
  primitive["extensions"]["EXT_mesh_features"]["featureIds"] = {
      {{"featureCount", stones.size()}, {"attribute", 0}}};
  json["extensionsUsed"] = {"EXT_mesh_features"};
  json["nodes"].push_back(
      {{"name", "stones"}, {"mesh", mesh}, {"extras", {{"stones", std::move(numbers)}}}});
}

}  // namespace

GlbContent encode_stones(std::span<const PlacedStone> stones, Vec3 corner_mm,
                         const LodAssetOptions& options, LodContentScale content) {
  Json json;
  json["asset"] = gltf_asset({{"scale_denominator", options.scale_denominator},
                              {"metres_per_model_metre", {content.horizontal, content.vertical}}});
  json["scene"] = 0;
  json["nodes"] = Json::array();
  json["meshes"] = Json::array();
  json["materials"] = {Json::parse(material_json(options.material))};
  Buffer buffer;
  if (options.merge_stones)
    add_merged(json, buffer, stones, corner_mm);
  else
    add_instances(json, buffer, stones, corner_mm);
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

Box3 stones_box(std::span<const PlacedStone> stones, Vec3 corner_mm, LodContentScale content) {
  const auto placed = [&](Vec3 model_mm) {
    const Vec3 m = kMetresPerMillimetre * (model_mm - corner_mm);
    return Vec3{content.horizontal * m.x, content.horizontal * m.y, content.vertical * m.z};
  };
  Box3 box;
  for (const PlacedStone& stone : stones) {
    const Box3 one = meshing::stone_mesh(stone).bounds();
    box.add(placed(one.min));
    box.add(placed(one.max));
  }
  // Poses are stored as floats.
  const double slack = 1e-6 * std::max(content.horizontal, norm(box.max - box.min));
  box.min += Vec3{-slack, -slack, -slack};
  box.max += Vec3{slack, slack, slack};
  return box;
}

}  // namespace maquette::exporting

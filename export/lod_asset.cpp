// SPDX-License-Identifier: GPL-3.0-or-later
#include "export/lod_asset.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <limits>

#include <meshoptimizer.h>
#include <nlohmann/json.hpp>

#include "export/cad.hpp"
#include "export/detail/gltf_asset.hpp"
#include "export/draco_normals.hpp"
#include "export/draco_piece.hpp"
#include "export/glb_file.hpp"

namespace maquette::exporting {
namespace {

using Json = nlohmann::ordered_json;

constexpr int kByte = 5120, kUnsignedShort = 5123, kUnsignedInt = 5125, kFloat = 5126;
constexpr int kArrayBuffer = 34962, kElementArrayBuffer = 34963;
constexpr int kDracoSpeed = 3;  ///< see DracoSettings

/// A tile in glTF's axes, in steps from its own origin.
struct Local {
  std::vector<Float3> positions, normals;
  std::vector<Float2> texture;
  std::array<float, 4> tangent{1.0F, 0.0F, 0.0F, 1.0F};  ///< where normals are alike
  std::int32_t side = 1;                                 ///< of the pictures, nodes of the field
  std::array<std::int64_t, 3> origin{};                  ///< steps in the set's frame
  Float3 min{}, max{};
  const LodPictures* pictures = nullptr;
  /// All upright.
  [[nodiscard]] bool normals_alike() const { return pictures && !pictures->normal_png.empty(); }
};

Local to_local(const LodTileMesh& tile, const LodLattice& lattice, bool with_normals,
               const LodPictures* pictures) {
  Local local;
  local.pictures = pictures;
  local.side = static_cast<std::int32_t>(
      std::max(tile.cols.back() - tile.cols.front(), tile.rows.back() - tile.rows.front()));
  std::int32_t lowest = std::numeric_limits<std::int32_t>::max();
  for (const LodVertex& v : tile.vertices) lowest = std::min(lowest, v.height);
  const std::int64_t k = lattice.steps_per_quad;
  local.origin = {tile.cols.front() * k, lowest, -tile.rows.back() * k};
  local.min.fill(std::numeric_limits<float>::infinity());
  local.max.fill(-std::numeric_limits<float>::infinity());
  for (const LodVertex& v : tile.vertices) {
    const Float3 p{static_cast<float>((v.col - tile.cols.front()) * k),
                   static_cast<float>(v.height - lowest),
                   static_cast<float>((tile.rows.back() - v.row) * k)};
    for (std::size_t i = 0; i < 3; ++i) {
      local.min[i] = std::min(local.min[i], p[i]);
      local.max[i] = std::max(local.max[i], p[i]);
    }
    local.positions.push_back(p);
    if (pictures)
      local.texture.push_back(
          {static_cast<float>(v.col - tile.cols.front()) / static_cast<float>(local.side),
           static_cast<float>(tile.rows.back() - v.row) / static_cast<float>(local.side)});
    if (!with_normals) continue;
    if (local.normals_alike()) {
      local.normals.push_back({0.0F, 1.0F, 0.0F});
      continue;
    }
    const Vec3 n = gltf_axes(
        normalized(Vec3{-static_cast<double>(v.slope[0]), -static_cast<double>(v.slope[1]), 1.0}));
    local.normals.push_back(
        {static_cast<float>(n.x), static_cast<float>(n.y), static_cast<float>(n.z)});
  }
  return local;
}

Json frame_of(const LodTileMesh& tile, const LodLattice& lattice, const LodTileError& error,
              const LodAssetOptions& options, LodContentScale content, const Local& local) {
  const double wide_m = content.horizontal * kMetresPerMillimetre * lattice.step_mm;
  const double high_m = content.vertical * kMetresPerMillimetre * lattice.step_mm;
  const Vec3 step_m{wide_m, high_m, wide_m};
  Json json;
  json["asset"] = gltf_asset(
      {{"origin", "the field's south-western node, at model z = 0"},
       {"scale_denominator", options.scale_denominator},
       {"metres_per_model_metre", {content.horizontal, content.vertical}},
       {"level", tile.key.level},
       {"max_vertical_error_m", content.vertical * kMetresPerMillimetre * error.vertical_mm}});
  json["scene"] = 0;
  json["scenes"] = {{{"nodes", {0}}}};
  const auto [x, y, z] = local.origin;
  json["nodes"] = {
      {{"name", fmt::format("level {} tile {} {}", tile.key.level, tile.key.x, tile.key.y)},
       {"mesh", 0},
       {"translation",
        {step_m.x * static_cast<double>(x), step_m.y * static_cast<double>(y),
         step_m.z * static_cast<double>(z)}},
       {"scale", {step_m.x, step_m.y, step_m.z}}}};
  json["materials"] = {Json::parse(material_json(options.material))};
  json["meshes"] = {
      {{"primitives", {{{"attributes", {{"POSITION", 0}}}, {"indices", 1}, {"material", 0}}}}}};
  if (!local.normals.empty()) json["meshes"][0]["primitives"][0]["attributes"]["NORMAL"] = 2;
  if (!local.texture.empty()) json["meshes"][0]["primitives"][0]["attributes"]["TEXCOORD_0"] = 3;
  if (local.normals_alike()) json["meshes"][0]["primitives"][0]["attributes"]["TANGENT"] = 4;
  return json;
}

Json accessor(int type, std::uint64_t count, const char* shape) {
  return {{"componentType", type}, {"count", count}, {"type", shape}};
}

struct Types {
  int position, index, normal, texture, tangent;
};
/// Positions are accessor 0, triangles 1, normals 2, texture coordinates 3 and tangents 4 if there
/// are any.
void add_accessors(Json& json, const Local& local, std::uint64_t vertices, std::uint64_t triangles,
                   const Types& types) {
  json["accessors"] = {accessor(types.position, vertices, "VEC3"),
                       accessor(types.index, 3 * triangles, "SCALAR")};
  for (const char* bound : {"min", "max"}) {
    const Float3& values = bound[1] == 'i' ? local.min : local.max;
    for (const float x : values)
      json["accessors"][0][bound].push_back(static_cast<std::int64_t>(x));
  }
  if (local.normals.empty()) return;
  json["accessors"].push_back(accessor(types.normal, vertices, "VEC3"));
  if (types.normal != kFloat) json["accessors"][2]["normalized"] = true;
  if (local.texture.empty()) return;
  json["accessors"].push_back(accessor(types.texture, vertices, "VEC2"));
  if (types.texture != kFloat) json["accessors"][3]["normalized"] = true;
  if (!local.normals_alike()) return;
  json["accessors"].push_back(accessor(types.tangent, vertices, "VEC4"));
  if (types.tangent != kFloat) json["accessors"][4]["normalized"] = true;
}

template <class T>
void append(std::vector<char>& binary, const std::vector<T>& values) {
  const std::size_t at = binary.size();
  binary.resize(at + glb_padded(values.size() * sizeof(T)));
  std::memcpy(binary.data() + at, values.data(), values.size() * sizeof(T));
}

/// Behind all other views, into buffer 0.
void add_pictures(Json& json, std::vector<char>& binary, const Local& local) {
  if (!local.pictures) return;
  // Beyond the picture nothing is asked for; its border is its own, not the other side's.
  constexpr int kLinear = 9729, kLinearMipmapLinear = 9987, kClampToEdge = 33071;
  json["samplers"] = {{{"magFilter", kLinear},
                       {"minFilter", kLinearMipmapLinear},
                       {"wrapS", kClampToEdge},
                       {"wrapT", kClampToEdge}}};
  const auto add = [&](Json& of, const char* use, const std::vector<char>& png) {
    if (png.empty()) return;
    json["images"].push_back(
        {{"bufferView", json["bufferViews"].size()}, {"mimeType", "image/png"}});
    json["bufferViews"].push_back(
        {{"buffer", 0}, {"byteOffset", binary.size()}, {"byteLength", png.size()}});
    json["textures"].push_back({{"sampler", 0}, {"source", json["images"].size() - 1}});
    of[use] = {{"index", json["textures"].size() - 1}};
    append(binary, png);
  };
  Json& material = json["materials"][0];
  add(material, "normalTexture", local.pictures->normal_png);
  add(material, "occlusionTexture", local.pictures->occlusion_png);
  if (local.pictures->colour_png.empty()) return;
  Json& surface = material["pbrMetallicRoughness"];
  surface["baseColorFactor"] = {1.0, 1.0, 1.0, 1.0};  // the picture is multiplied by it
  add(surface, "baseColorTexture", local.pictures->colour_png);
}

/// glTF's axes turned so that up is x (draco_normals.hpp), and the quaternion that turns them back:
/// all its products are halves, so that no engine rounds.
Local with_up_as_x(Local local) {
  const auto turn = [](Float3& v) { v = {v[1], v[2], v[0]}; };
  for (Float3& p : local.positions) turn(p);
  for (Float3& n : local.normals) turn(n);
  turn(local.min);
  turn(local.max);
  const auto [x, y, z, w] = local.tangent;
  local.tangent = {y, z, x, w};
  return local;
}
const Json kUpFromX{0.5, 0.5, 0.5, 0.5};

/// Draco walks over the triangles outwards from the first and stores vertices in the opposite
/// order. Begun in the middle it ends at a corner: the first vertex, which has no prediction, is
/// then close to the ends of the coordinates' range, which wraps. From elsewhere it can be more
/// than 2^18 away from them, where Draco leaves entropy coding: twice the bytes.
std::vector<std::array<std::uint32_t, 3>> from_the_middle(const LodTileMesh& tile) {
  const std::size_t across = tile.cols.size() - 1, up = tile.rows.size() - 1;
  auto triangles = tile.triangles;
  std::rotate(triangles.begin(),
              triangles.begin() + tile.first_of_cell[up / 2 * across + across / 2],
              triangles.end());
  return triangles;
}

/// Vertices on the tile's outline, which neighbours have, too.
std::vector<bool> outline(const LodTileMesh& tile) {
  std::vector<bool> on;
  for (const LodVertex& v : tile.vertices)
    on.push_back(v.col == tile.cols.front() || v.col == tile.cols.back() ||
                 v.row == tile.rows.front() || v.row == tile.rows.back());
  return on;
}

Result<GlbContent> encode_draco(const LodTileMesh& tile, const Local& in_gltf_axes,
                                const LodAssetOptions& options, Json json) {
  const Local local = with_up_as_x(in_gltf_axes);
  Json& node = json["nodes"][0];
  node["rotation"] = kUpFromX;
  node["scale"] = {node["scale"][1], node["scale"][2], node["scale"][0]};  // before it turns
  PositionGrid grid;                                                       // a step of 1 from 0
  grid.bits = 1;
  const float widest = *std::max_element(local.max.begin(), local.max.end());
  while (static_cast<float>((std::uint32_t{1} << grid.bits) - 1) < widest) ++grid.bits;
  grid.range = static_cast<float>((std::uint32_t{1} << grid.bits) - 1);
  const auto triangles = from_the_middle(tile);
  DracoNormals normals;
  if (local.normals_alike())
    normals = {.values = local.normals, .bits = options.normal_bits};
  else if (!local.normals.empty())
    normals = draco_normals(local.positions, local.normals, triangles, outline(tile),
                            options.normal_bits);
  DracoTexture texture;  // nodes of the field, exactly
  texture.values = local.texture;
  texture.bits = 1;
  while ((1 << texture.bits) - 1 < local.side) ++texture.bits;
  texture.range = static_cast<float>((1 << texture.bits) - 1) / static_cast<float>(local.side);
  if (local.normals_alike()) texture.tangent = local.tangent;
  MAQUETTE_TRY(const DracoPiece piece, draco_piece(local.positions, normals.values, triangles, grid,
                                                   {.speed = kDracoSpeed,
                                                    .normal_bits = normals.bits,
                                                    .normals_alike = local.normals_alike()},
                                                   texture));
  add_accessors(json, local, piece.points, piece.faces,
                {kFloat, kUnsignedInt, kFloat, kFloat, kFloat});
  json["extensionsUsed"] = {"KHR_draco_mesh_compression"};
  json["extensionsRequired"] = {"KHR_draco_mesh_compression"};
  Json attributes{{"POSITION", piece.position_id}};
  if (!local.normals.empty()) attributes["NORMAL"] = piece.normal_id;
  if (!local.texture.empty()) attributes["TEXCOORD_0"] = piece.texture_id;
  if (local.normals_alike()) attributes["TANGENT"] = piece.tangent_id;
  json["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"] = {
      {"bufferView", 0}, {"attributes", std::move(attributes)}};
  json["bufferViews"] = {{{"buffer", 0}, {"byteOffset", 0}, {"byteLength", piece.bytes.size()}}};
  GlbContent content;
  append(content.binary, piece.bytes);
  add_pictures(json, content.binary, local);
  json["buffers"] = {{{"byteLength", content.binary.size()}}};
  content.json = json.dump();
  return content;
}

GlbContent encode_plain(const LodTileMesh& tile, const Local& local, Json json) {
  add_accessors(json, local, local.positions.size(), tile.triangles.size(),
                {kFloat, kUnsignedInt, kFloat, kFloat, kFloat});
  GlbContent content;
  const auto add = [&](const auto& values, int target) {
    json["accessors"][json["bufferViews"].size()]["bufferView"] = json["bufferViews"].size();
    json["bufferViews"].push_back({{"buffer", 0},
                                   {"byteOffset", content.binary.size()},
                                   {"byteLength", values.size() * sizeof(values[0])},
                                   {"target", target}});
    append(content.binary, values);
  };
  json["bufferViews"] = Json::array();
  add(local.positions, kArrayBuffer);
  add(tile.triangles, kElementArrayBuffer);
  if (!local.normals.empty()) add(local.normals, kArrayBuffer);
  if (!local.texture.empty()) add(local.texture, kArrayBuffer);
  if (local.normals_alike()) add(std::vector(local.positions.size(), local.tangent), kArrayBuffer);
  add_pictures(json, content.binary, local);
  json["buffers"] = {{{"byteLength", content.binary.size()}}};
  content.json = json.dump();
  return content;
}

/// Buffer 0 has what is stored, buffer 1 would have what it unpacks to: no file holds it.
class MeshoptViews {
 public:
  void add(Json& json, std::vector<unsigned char> packed, std::size_t count, std::size_t stride,
           const char* mode, const char* filter, int target) {
    Json extension{{"buffer", 0},
                   {"byteOffset", content.binary.size()},
                   {"byteLength", packed.size()},
                   {"byteStride", stride},
                   {"mode", mode},
                   {"count", count}};
    if (filter) extension["filter"] = filter;
    Json view{{"buffer", 1}, {"byteOffset", unpacked_}, {"byteLength", count * stride}};
    if (target == kArrayBuffer) view["byteStride"] = stride;
    view["target"] = target;
    view["extensions"]["EXT_meshopt_compression"] = std::move(extension);
    json["accessors"][json["bufferViews"].size()]["bufferView"] = json["bufferViews"].size();
    json["bufferViews"].push_back(std::move(view));
    append(content.binary, packed);
    unpacked_ = glb_padded(unpacked_ + count * stride);
  }
  GlbContent finish(Json json, const Local& local) {
    add_pictures(json, content.binary, local);
    json["buffers"] = {{{"byteLength", content.binary.size()}},
                       {{"byteLength", unpacked_},
                        {"extensions", {{"EXT_meshopt_compression", {{"fallback", true}}}}}}};
    content.json = json.dump();
    return std::move(content);
  }

 private:
  GlbContent content;
  std::size_t unpacked_ = 0;
};

std::vector<unsigned char> pack_vertices(const void* data, std::size_t count, std::size_t stride) {
  std::vector<unsigned char> packed(meshopt_encodeVertexBufferBound(count, stride));
  packed.resize(meshopt_encodeVertexBuffer(packed.data(), packed.size(), data, count, stride));
  return packed;
}

GlbContent encode_meshopt(const LodTileMesh& tile, const Local& local, Json json) {
  const std::size_t count = local.positions.size(), corners = 3 * tile.triangles.size();
  std::vector<std::uint32_t> indices(corners);
  meshopt_optimizeVertexCacheStrip(indices.data(), tile.triangles.front().data(), corners, count);
  std::vector<std::uint32_t> order(count);
  meshopt_optimizeVertexFetchRemap(order.data(), indices.data(), corners, count);
  meshopt_remapIndexBuffer(indices.data(), indices.data(), corners, order.data());

  constexpr float kWidest16 = 65535.0F;
  const bool wide = *std::max_element(local.max.begin(), local.max.end()) > kWidest16;
  const bool short_indices = count <= 65535;  // 65535 itself is the value that restarts strips
  add_accessors(json, local, count, tile.triangles.size(),
                {wide ? kFloat : kUnsignedShort, short_indices ? kUnsignedShort : kUnsignedInt,
                 kByte, kUnsignedShort, kByte});
  json["extensionsUsed"] = {"EXT_meshopt_compression", "KHR_mesh_quantization"};
  json["extensionsRequired"] = {"EXT_meshopt_compression", "KHR_mesh_quantization"};
  json["bufferViews"] = Json::array();
  MeshoptViews views;
  if (wide) {
    std::vector<Float3> positions(count);
    for (std::size_t i = 0; i < count; ++i) positions[order[i]] = local.positions[i];
    views.add(json, pack_vertices(positions.data(), count, sizeof(Float3)), count, sizeof(Float3),
              "ATTRIBUTES", nullptr, kArrayBuffer);
  } else {
    std::vector<std::array<std::uint16_t, 4>> positions(count);
    for (std::size_t i = 0; i < count; ++i)
      for (std::size_t k = 0; k < 3; ++k)
        positions[order[i]][k] = static_cast<std::uint16_t>(local.positions[i][k]);
    views.add(json, pack_vertices(positions.data(), count, 8), count, 8, "ATTRIBUTES", nullptr,
              kArrayBuffer);
  }
  std::vector<unsigned char> packed(meshopt_encodeIndexBufferBound(corners, count));
  packed.resize(meshopt_encodeIndexBuffer(packed.data(), packed.size(), indices.data(), corners));
  views.add(json, std::move(packed), corners, short_indices ? 2 : 4, "TRIANGLES", nullptr,
            kElementArrayBuffer);
  if (!local.normals.empty()) {
    std::vector<std::array<float, 4>> normals(count);
    for (std::size_t i = 0; i < count; ++i)
      normals[order[i]] = {local.normals[i][0], local.normals[i][1], local.normals[i][2], 0.0F};
    std::vector<std::array<std::int8_t, 4>> octahedral(count);
    meshopt_encodeFilterOct(octahedral.data(), count, 4, 8, normals.front().data());
    views.add(json, pack_vertices(octahedral.data(), count, 4), count, 4, "ATTRIBUTES",
              "OCTAHEDRAL", kArrayBuffer);
  }
  if (!local.texture.empty()) {
    std::vector<std::array<std::uint16_t, 2>> texture(count);
    for (std::size_t i = 0; i < count; ++i)
      for (std::size_t k = 0; k < 2; ++k)
        texture[order[i]][k] =
            static_cast<std::uint16_t>(std::lround(kWidest16 * local.texture[i][k]));
    views.add(json, pack_vertices(texture.data(), count, 4), count, 4, "ATTRIBUTES", nullptr,
              kArrayBuffer);
  }
  if (local.normals_alike()) {
    const std::vector<std::array<std::int8_t, 4>> tangents(count, {127, 0, 0, 127});
    views.add(json, pack_vertices(tangents.data(), count, 4), count, 4, "ATTRIBUTES", nullptr,
              kArrayBuffer);
  }
  return views.finish(std::move(json), local);
}

}  // namespace

std::string_view name(LodCompression compression) {
  constexpr std::array<std::string_view, 3> kNames{"draco", "meshopt", "plain"};
  return kNames[static_cast<std::size_t>(compression)];
}

std::string_view name(LodMaterial material) {
  constexpr std::array<std::string_view, 3> kNames{"paint", "regolith", "foil"};
  return kNames[static_cast<std::size_t>(material)];
}

std::string material_json(LodMaterial material) {
  const auto json = [&](std::array<double, 4> colour, double metallic, double roughness) {
    return Json{{"name", name(material)},
                {"pbrMetallicRoughness",
                 {{"baseColorFactor", colour},
                  {"metallicFactor", metallic},
                  {"roughnessFactor", roughness}}}}
        .dump();
  };
  switch (material) {
    case LodMaterial::regolith:  // normal albedo of lunar mare, about a tenth
      return json({0.11, 0.105, 0.095, 1.0}, 0.0, 1.0);
    case LodMaterial::foil:  // aluminised polyimide
      return json({0.9, 0.62, 0.25, 1.0}, 1.0, 0.35);
    case LodMaterial::paint:
      break;
  }
  return json({0.36, 0.35, 0.33, 1.0}, 0.0, 1.0);  // matt grey
}

Result<GlbContent> encode_lod_tile(const LodTileMesh& tile, const LodLattice& lattice,
                                   const LodTileError& error, const LodAssetOptions& options,
                                   LodContentScale content, const LodPictures* pictures) {
  const Local local = to_local(tile, lattice, options.normals, pictures);
  Json json = frame_of(tile, lattice, error, options, content, local);
  switch (options.compression) {
    case LodCompression::draco:
      return encode_draco(tile, local, options, std::move(json));
    case LodCompression::meshopt:
      return encode_meshopt(tile, local, std::move(json));
    case LodCompression::plain:
      break;
  }
  return encode_plain(tile, local, std::move(json));
}

}  // namespace maquette::exporting

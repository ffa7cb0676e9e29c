// SPDX-License-Identifier: GPL-3.0-or-later

// export/gltf.hpp:
//   a valid glTF 2.0 binary .......... read by hand: header, chunks, alignment, views,
//                                      accessors; unit, frame and scale in extras
//   the same solid comes out ......... Draco's own decoder: every vertex within the
//                                      stated error, faces, volume
//   min and max as decoded ........... to the bit
//   no crack between pieces .......... 1.3 M triangles, welded by equal bits: closed
//   frame ............................ a box of known place and size
//   normals .......................... of a sphere, within 10 octahedral bits
//   plain buffers .................... the floats themselves
//   meshing's reader gets it back .... plain and Draco: closed, volume, place, within the error
//   same bytes for any thread count .. hashes
//   each error code

#include <cstring>
#include <map>
#include <set>

#include <draco/compression/decode.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <nlohmann/json.hpp>

#include "export/cad.hpp"
#include "export/draco_piece.hpp"
#include "export/gltf.hpp"
#include "export/limits.hpp"
#include "meshing/mesh_io.hpp"
#include "support/matchers.hpp"
#include "support/mesh_properties.hpp"
#include "support/simple_solids.hpp"

namespace maquette::exporting {
namespace {

using testing_support::box_solid;
using testing_support::FailsWith;
using testing_support::Hills;
using testing_support::ScratchFolder;
using testing_support::sphere_solid;
using testing_support::Succeeds;
using testing_support::terrain_solid;
using testing_support::volume_mm3;

struct Primitive {
  std::vector<Float3> positions, normals;
  std::vector<std::array<std::uint32_t, 3>> triangles;
};
struct Asset {
  nlohmann::json json;
  std::vector<Primitive> primitives;
};

template <class T>
T value_at(const std::string& bytes, std::size_t at) {
  T value{};
  EXPECT_LE(at + sizeof value, bytes.size());
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

std::vector<Float3> decoded(const draco::Mesh& mesh, const nlohmann::json& id) {
  const auto* attribute = mesh.GetAttributeByUniqueId(id.get<std::uint32_t>());
  std::vector<Float3> values(mesh.num_points());
  for (std::uint32_t i = 0; i < mesh.num_points(); ++i)
    attribute->GetMappedValue(draco::PointIndex(i), values[i].data());
  return values;
}

Primitive read_draco(const nlohmann::json& json, const nlohmann::json& primitive,
                     const std::string& binary) {
  const auto& extension = primitive["extensions"]["KHR_draco_mesh_compression"];
  const auto& view = json["bufferViews"][extension["bufferView"].get<std::size_t>()];
  const auto offset = view["byteOffset"].get<std::size_t>();
  EXPECT_EQ(offset % 4, 0U);
  draco::DecoderBuffer buffer;
  buffer.Init(binary.data() + offset, view["byteLength"].get<std::size_t>());
  draco::Decoder decoder;
  auto result = decoder.DecodeMeshFromBuffer(&buffer);
  EXPECT_TRUE(result.ok()) << result.status().error_msg_string();
  const auto mesh = std::move(result).value();
  Primitive p;
  p.positions = decoded(*mesh, extension["attributes"]["POSITION"]);
  p.normals = decoded(*mesh, extension["attributes"]["NORMAL"]);
  for (std::uint32_t f = 0; f < mesh->num_faces(); ++f) {
    const auto& face = mesh->face(draco::FaceIndex(f));
    p.triangles.push_back({face[0].value(), face[1].value(), face[2].value()});
  }
  return p;
}

template <class T>
std::vector<T> read_view(const nlohmann::json& json, const nlohmann::json& accessor,
                         const std::string& binary, std::size_t count) {
  const auto& view = json["bufferViews"][accessor["bufferView"].get<std::size_t>()];
  std::vector<T> values(count);
  EXPECT_EQ(view["byteLength"].get<std::size_t>(), count * sizeof(T));
  EXPECT_EQ(view["byteOffset"].get<std::size_t>() % 4, 0U);
  std::memcpy(values.data(), binary.data() + view["byteOffset"].get<std::size_t>(),
              count * sizeof(T));
  return values;
}

/// Reads a .glb and checks on the way what the specification asks for.
Asset read_glb(const std::filesystem::path& path) {
  const std::string bytes = read_file(path).value();
  EXPECT_EQ(bytes.substr(0, 4), "glTF");
  EXPECT_EQ(value_at<std::uint32_t>(bytes, 4), 2U);
  EXPECT_EQ(value_at<std::uint32_t>(bytes, 8), bytes.size());
  const auto text_size = value_at<std::uint32_t>(bytes, 12);
  EXPECT_EQ(bytes.substr(16, 4), "JSON");
  EXPECT_EQ(text_size % 4, 0U);
  const std::size_t binary_at = 20 + text_size;
  const auto binary_size = value_at<std::uint32_t>(bytes, binary_at);
  EXPECT_EQ(bytes.substr(binary_at + 4, 4), std::string("BIN\0", 4));
  EXPECT_EQ(binary_size % 4, 0U);
  EXPECT_EQ(binary_at + 8 + binary_size, bytes.size());
  const std::string binary = bytes.substr(binary_at + 8);

  Asset asset;
  asset.json = nlohmann::json::parse(bytes.substr(20, text_size));
  const auto& json = asset.json;
  EXPECT_EQ(json["asset"]["version"], "2.0");
  EXPECT_EQ(json["buffers"].size(), 1U);
  EXPECT_EQ(json["buffers"][0]["byteLength"], binary_size);
  EXPECT_EQ(json["scenes"][0]["nodes"][0], 0);
  EXPECT_EQ(json["nodes"][0]["mesh"], 0);
  for (const auto& view : json["bufferViews"])
    EXPECT_LE(view["byteOffset"].get<std::size_t>() + view["byteLength"].get<std::size_t>(),
              binary.size());
  for (const auto& primitive : json["meshes"][0]["primitives"]) {
    const auto& position =
        json["accessors"][primitive["attributes"]["POSITION"].get<std::size_t>()];
    const auto& normal = json["accessors"][primitive["attributes"]["NORMAL"].get<std::size_t>()];
    const auto& index = json["accessors"][primitive["indices"].get<std::size_t>()];
    EXPECT_EQ(position["componentType"], 5126);
    EXPECT_EQ(position["type"], "VEC3");
    EXPECT_EQ(normal["count"], position["count"]);
    EXPECT_EQ(index["componentType"], 5125);
    const auto points = position["count"].get<std::size_t>();
    const auto corners = index["count"].get<std::size_t>();
    Primitive p;
    if (primitive.contains("extensions")) {
      p = read_draco(json, primitive, binary);
    } else {
      p.positions = read_view<Float3>(json, position, binary, points);
      p.normals = read_view<Float3>(json, normal, binary, points);
      p.triangles = read_view<std::array<std::uint32_t, 3>>(json, index, binary, corners / 3);
    }
    EXPECT_EQ(p.positions.size(), points);
    EXPECT_EQ(3 * p.triangles.size(), corners);
    Float3 lo = p.positions.at(0), hi = lo;
    for (const Float3& v : p.positions)
      for (std::size_t k = 0; k < 3; ++k)
        lo[k] = std::min(lo[k], v[k]), hi[k] = std::max(hi[k], v[k]);
    EXPECT_EQ(position["min"].get<Float3>(), lo);
    EXPECT_EQ(position["max"].get<Float3>(), hi);
    for (const Float3& n : p.normals) EXPECT_NEAR(std::hypot(n[0], n[1], n[2]), 1.0, 1e-5);
    asset.primitives.push_back(std::move(p));
  }
  return asset;
}

/// Back to the model frame by the words of the header.
Vec3 model_point(const Float3& p, Vec3 corner) {
  return {1000.0 * static_cast<double>(p[0]) + corner.x,
          -1000.0 * static_cast<double>(p[2]) + corner.y, 1000.0 * static_cast<double>(p[1])};
}

/// All primitives in one mesh, vertices with equal bits made one.
TriMesh welded(const Asset& asset, Vec3 corner) {
  TriMesh m;
  std::map<Float3, std::uint32_t> number;
  for (const Primitive& p : asset.primitives) {
    std::vector<std::uint32_t> here;
    for (const Float3& v : p.positions) {
      const auto [at, fresh] =
          number.try_emplace(v, static_cast<std::uint32_t>(m.vertices_mm.size()));
      if (fresh) m.vertices_mm.push_back(model_point(v, corner));
      here.push_back(at->second);
    }
    for (const auto& t : p.triangles) m.triangles.push_back({here[t[0]], here[t[1]], here[t[2]]});
  }
  return m;
}

/// Directed edges without their opposite: 0 for a closed surface.
std::size_t open_edges(const TriMesh& m) {
  std::vector<std::pair<std::uint32_t, std::uint32_t>> forth, back;
  for (const auto& t : m.triangles)
    for (std::size_t k = 0; k < 3; ++k) {
      forth.emplace_back(t[k], t[(k + 1) % 3]);
      back.emplace_back(t[(k + 1) % 3], t[k]);
    }
  std::sort(forth.begin(), forth.end());
  std::sort(back.begin(), back.end());
  std::vector<std::pair<std::uint32_t, std::uint32_t>> alone;
  std::set_difference(forth.begin(), forth.end(), back.begin(), back.end(),
                      std::back_inserter(alone));
  return alone.size();
}

struct Case {
  std::uint64_t seed;
  int bits;
};
class WriteGlb : public testing::TestWithParam<Case> {};

TEST_P(WriteGlb, GivesBackTheSolidWithinTheStatedError) {
  const ScratchFolder folder;
  const Vec3 corner{130.5, -70.25, 0};
  TriMesh ground = terrain_solid(90, 2.0, -20, Hills(GetParam().seed, 180, 9));
  for (Vec3& v : ground.vertices_mm) v += corner;
  GltfOptions options;
  options.position_bits = GetParam().bits;
  options.scale_denominator = 2500;
  const auto report = write_glb(ground, options, folder / "a.glb");
  ASSERT_THAT(report, Succeeds());
  EXPECT_EQ(report->bytes, std::filesystem::file_size(folder / "a.glb"));
  const double size = 178;
  // Besides: the grid starts and ends at whole micrometres, floats at 0.2 m.
  EXPECT_NEAR(report->max_quantisation_error_mm,
              std::sqrt(3.0) / 2 * size / (std::pow(2, GetParam().bits) - 1), 4e-4);

  const Asset asset = read_glb(folder / "a.glb");
  EXPECT_THAT(asset.json["extensionsRequired"], testing::ElementsAre("KHR_draco_mesh_compression"));
  EXPECT_EQ(asset.json["asset"]["extras"]["scale_denominator"], 2500);
  EXPECT_EQ(asset.json["asset"]["extras"]["unit"], "m");
  const TriMesh back = welded(asset, corner);
  ASSERT_EQ(back.triangles.size(), ground.triangles.size());
  ASSERT_EQ(back.vertices_mm.size(), ground.vertices_mm.size());
  EXPECT_EQ(open_edges(back), 0U);
  // Draco reorders vertices; those of a grid are found again by their place (top and
  // base of a border node by height as well).
  std::map<std::array<long, 3>, std::size_t> by_place;
  const auto place = [&](Vec3 v) {
    return std::array<long, 3>{std::lround(v.x - corner.x), std::lround(v.y - corner.y),
                               v.z < -19.9 ? 0L : 1L};
  };
  for (std::size_t i = 0; i < ground.vertices_mm.size(); ++i)
    by_place[place(ground.vertices_mm[i])] = i;
  std::set<std::size_t> found;
  for (const Vec3& v : back.vertices_mm) {
    const auto at = by_place.find(place(v));
    ASSERT_NE(at, by_place.end());
    found.insert(at->second);
    EXPECT_LE(norm(v - ground.vertices_mm[at->second]), report->max_quantisation_error_mm);
  }
  EXPECT_EQ(found.size(), ground.vertices_mm.size());
  const double area = 2 * 178.0 * 178.0 + 4 * 178 * 20;
  EXPECT_NEAR(volume_mm3(back), volume_mm3(ground), area * report->max_quantisation_error_mm);
}
INSTANTIATE_TEST_SUITE_P(SeedsAndBits, WriteGlb,
                         testing::Values(Case{1, 10}, Case{2, 14}, Case{3, 16}, Case{4, 24}));

TEST(WriteGlbPieces, HaveNoCrackBetweenThem) {
  const ScratchFolder folder;
  const TriMesh ground = terrain_solid(811, 0.25, -20, Hills(5, 200, 9));
  ASSERT_GT(ground.triangles.size(), 1'300'000U);
  ASSERT_THAT(write_glb(ground, {}, folder / "a.glb"), Succeeds());
  const Asset asset = read_glb(folder / "a.glb");
  EXPECT_EQ(asset.primitives.size(), 2U);
  const TriMesh back = welded(asset, {});
  EXPECT_EQ(back.triangles.size(), ground.triangles.size());
  EXPECT_EQ(back.vertices_mm.size(), ground.vertices_mm.size());
  EXPECT_EQ(open_edges(back), 0U);
}

TEST(WriteGlb, PutsTheModelFrameIntoItsOwn) {
  const ScratchFolder folder;
  for (const bool draco : {true, false}) {
    GltfOptions options;
    options.draco = draco;
    options.name = "box \xff";  // not UTF-8: must not break the JSON
    ASSERT_THAT(write_glb(box_solid({10, 20, 3}, {40, 60, 8}), options, folder / "a.glb"),
                Succeeds());
    const Asset asset = read_glb(folder / "a.glb");
    EXPECT_EQ(asset.json.contains("extensionsUsed"), draco);
    const auto& position = asset.json["accessors"][0];
    const std::array<double, 3> lo{0, 0.003, -0.04}, hi{0.03, 0.008, 0};
    for (std::size_t k = 0; k < 3; ++k) {
      // 40 mm in 2^16 steps; 1e-6 m is a step and a half
      EXPECT_NEAR(position["min"][k].get<double>(), lo[k], 1e-6);
      EXPECT_NEAR(position["max"][k].get<double>(), hi[k], 1e-6);
    }
    EXPECT_EQ(asset.json["asset"]["extras"]["origin_in_model_mm"],
              nlohmann::json({10.0, 20.0, 0.0}));
    EXPECT_GT(volume_mm3(welded(asset, {10, 20, 0})), 0) << "turned inside out";
  }
}

TEST(WriteGlb, HasTheNormalsOfASphere) {
  const ScratchFolder folder;
  ASSERT_THAT(write_glb(sphere_solid({50, 50, 50}, 50, 64), {}, folder / "a.glb"), Succeeds());
  const Asset asset = read_glb(folder / "a.glb");
  ASSERT_EQ(asset.primitives.size(), 1U);
  const Primitive& p = asset.primitives[0];
  for (std::size_t i = 0; i < p.positions.size(); ++i) {
    const Vec3 out = normalized(model_point(p.positions[i], {}) - Vec3{50, 50, 50});
    const Vec3 n{static_cast<double>(p.normals[i][0]), -static_cast<double>(p.normals[i][2]),
                 static_cast<double>(p.normals[i][1])};
    // 10 bits octahedral: up to 0.2 degrees; the mean of unlike facets: some 0.3
    EXPECT_GT(dot(n, out), std::cos(0.6 * std::numbers::pi / 180)) << i;
  }
}

TEST(WriteGlb, WritesPlainBuffersAsTheyAre) {
  const ScratchFolder folder;
  const TriMesh ground = terrain_solid(40, 1.0, -5, Hills(8, 40, 3));
  GltfOptions options;
  options.draco = false;
  const auto report = write_glb(ground, options, folder / "a.glb");
  ASSERT_THAT(report, Succeeds());
  EXPECT_LT(report->max_quantisation_error_mm, 1e-4);
  const Asset asset = read_glb(folder / "a.glb");
  ASSERT_EQ(asset.primitives.size(), 1U);
  const Primitive& p = asset.primitives[0];
  EXPECT_EQ(p.triangles, ground.triangles);
  ASSERT_EQ(p.positions.size(), ground.vertices_mm.size());
  for (std::size_t i = 0; i < p.positions.size(); ++i)
    EXPECT_LE(norm(model_point(p.positions[i], {}) - ground.vertices_mm[i]),
              report->max_quantisation_error_mm);
}

TEST(WriteGlb, IsReadBackByTheMeshReader) {
  const TriMesh ground = terrain_solid(40, 1.0, -20, Hills(3, 40, 5));  // from x = y = 0 on
  for (const bool draco : {true, false}) {
    const ScratchFolder folder;
    GltfOptions options;
    options.draco = draco;
    const auto report = write_glb(ground, options, folder / "a.glb");
    ASSERT_THAT(report, Succeeds());
    const auto back = meshing::read_mesh(folder / "a.glb");
    ASSERT_THAT(back, Succeeds());
    EXPECT_EQ(back->vertices_mm.size(), ground.vertices_mm.size());
    EXPECT_THAT(*back, testing_support::IsClosedAndOriented());
    const Box3 box = ground.bounds(), found = back->bounds();
    // Half a step of the grid, which begins and ends at whole micrometres.
    const double error_mm = report->max_quantisation_error_mm + 1e-3;
    EXPECT_LT(norm(found.min - box.min), error_mm);
    EXPECT_LT(norm(found.max - box.max), error_mm);
    // No point of the surface moves by more than the error.
    EXPECT_NEAR(volume_mm3(*back), volume_mm3(ground), error_mm * 2 * (40 * 40 + 2 * 40 * 25));
  }
}

TEST(WriteGlb, GivesTheSameBytesForAnyNumberOfThreads) {
  const ScratchFolder folder;
  const TriMesh ground = terrain_solid(811, 0.25, -20, Hills(6, 200, 9));
  std::vector<std::string> hashes;
  for (const std::size_t threads : {1U, 2U, 4U}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    ASSERT_THAT(write_glb(ground, {}, folder / "a.glb"), Succeeds());
    hashes.push_back(sha256_file(folder / "a.glb").value());
  }
  EXPECT_THAT(hashes, testing::Each(hashes.front()));
}

TEST(WriteGlb, SaysWhyItCannot) {
  const ScratchFolder folder;
  const TriMesh ground = terrain_solid(401, 0.5, -5, Hills(8, 200, 3));
  const auto path = folder / "a.glb";
  const auto with = [](auto&& change) {
    GltfOptions options;
    change(options);
    return options;
  };
  // 200 mm in 255 steps of 0.8 mm for edges of 0.5 to 0.7: 11 bits would do
  const auto coarse = write_glb(ground, with([](auto& o) { o.position_bits = 8; }), path);
  ASSERT_THAT(coarse, FailsWith(kQuantisationTooCoarse));
  EXPECT_THAT(coarse.error().message, testing::HasSubstr("11 bits would do"));
  EXPECT_THAT(write_glb(ground, with([](auto& o) { o.position_bits = 11; }), path), Succeeds());
  std::filesystem::remove(path);
  for (const auto& options :
       {with([](auto& o) { o.position_bits = 7; }), with([](auto& o) { o.position_bits = 25; }),
        with([](auto& o) { o.scale_denominator = 0; }),
        with([](auto& o) { o.base_colour[1] = 1.5F; })})
    EXPECT_THAT(write_glb(ground, options, path), FailsWith(kOptionOutOfRange));
  EXPECT_THAT(write_glb({}, {}, path), FailsWith(kEmptyMesh));
  EXPECT_THAT(write_glb(ground, {}, folder / "no/a.glb"), FailsWith(kFileNotWritable));
  EXPECT_THAT(within_limit(4294967296ULL, kGlbByteLimit, "bytes", "glb", path),
              FailsWith(kTooManyTriangles));
  std::stop_source stop;
  RunContext run;
  run.stop = stop.get_token();
  run.progress = [&](double) { stop.request_stop(); };
  for (const bool draco : {true, false})
    EXPECT_THAT(write_glb(ground, with([&](auto& o) { o.draco = draco; }), path, run),
                FailsWith(kCancelled));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

}  // namespace
}  // namespace maquette::exporting

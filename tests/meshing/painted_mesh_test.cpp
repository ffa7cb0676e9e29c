// SPDX-License-Identifier: GPL-3.0-or-later

// meshing/painted_mesh.hpp, on a few triangles whose looks are written down by hand:
//   OBJ with a .mtl ......... colours, pictures, places from the upper left corner, names with
//                             spaces, polygons fanned, coordinates by negative numbers
//   without its .mtl ........ names alone; faces before any name
//   glTF .................... plain and turned by hand (KHR_texture_transform), a mirrored node, a
//                             picture in a file, in text and in the binary part, edges
//   the mesh ................ bit for bit read_mesh's
//   bad input ............... one error that says where and what

#include "meshing/painted_mesh.hpp"

#include <cmath>
#include <fstream>

#include <fmt/format.h>
#include <gtest/gtest.h>

#include "meshing/mesh_io.hpp"
#include "support/gltf_text.hpp"
#include "support/matchers.hpp"
#include "support/mutations.hpp"

namespace maquette::meshing {
namespace {

using testing_support::base64_text;
using testing_support::FailsSaying;
using testing_support::Succeeds;

class PaintedMeshFile : public testing::Test {
 protected:
  testing_support::ScratchFolder folder;

  [[nodiscard]] std::filesystem::path put(const std::string& name, const std::string& text) const {
    std::ofstream(folder / name, std::ios::binary) << text;
    return folder / name;
  }
  static void same_mesh(const PaintedMesh& painted, const std::filesystem::path& path) {
    const auto plain = read_mesh(path);
    ASSERT_THAT(plain, Succeeds());
    EXPECT_EQ(painted.mesh.vertices_mm, plain->vertices_mm);
    EXPECT_EQ(painted.mesh.triangles, plain->triangles);
    EXPECT_EQ(painted.paint_of.size(), plain->triangles.size());
    EXPECT_EQ(painted.at_corner.size(), plain->triangles.size());
  }
};

using Places = std::array<std::array<float, 2>, 3>;

TEST_F(PaintedMeshFile, ObjHasTheLooksOfItsMtl) {
  const auto mtl = put("a part.mtl",
                       "# by hand\nnewmtl gold foil\nNs 10\nKd 0.9 0.6 0.2\nPm 1\nPr 0.3\n"
                       "newmtl mark\nKd 1 1 1\nmap_Kd -clamp on -bm 1 pictures\\the mark.png\n");
  const auto path = put("square.obj",
                        "mtllib a part.mtl\nv 0 0 0\nv 2 0 0\nv 2 1 0\nv 0 1 0\n"
                        "vt 0 0\nvt 1 0\nvt 1 1\nvt 0 1\n"
                        "usemtl mark\nf 1/1 2/2 3/3 4/4\nusemtl gold foil\nf 4//1 3//1 2//1\n"
                        "usemtl mark\nf -4/-4/1 -3/-3/1 -2/-2/1\n");
  const auto read = read_painted_mesh(path);
  ASSERT_THAT(read, Succeeds());
  same_mesh(*read, path);
  ASSERT_EQ(read->paints.size(), 2U);
  const Paint &gold = read->paints[0], &mark = read->paints[1];
  EXPECT_EQ(gold.name, "gold foil");
  EXPECT_EQ(gold.colour, (std::array<double, 3>{0.9, 0.6, 0.2}));
  EXPECT_EQ(gold.metallic, 1.0);
  EXPECT_EQ(gold.roughness, 0.3);
  EXPECT_FALSE(gold.has_picture());
  EXPECT_EQ(mark.picture_file, folder / "pictures/the mark.png");
  EXPECT_EQ(mark.beyond, (std::array{Beyond::edge, Beyond::edge}));
  EXPECT_EQ(read->paint_of, (std::vector<std::uint32_t>{1, 1, 0, 1}));
  // v is upward in an OBJ, downward here.
  EXPECT_EQ(read->at_corner[0], (Places{{{0, 1}, {1, 1}, {1, 0}}}));
  EXPECT_EQ(read->at_corner[1], (Places{{{0, 1}, {1, 0}, {0, 0}}}));
  EXPECT_TRUE(std::isnan(read->at_corner[2][0][0]));
  EXPECT_EQ(read->at_corner[3], (Places{{{0, 1}, {1, 1}, {1, 0}}}));
  EXPECT_EQ(read->files,
            (std::vector<std::filesystem::path>{mtl, folder / "pictures/the mark.png"}));
}

TEST_F(PaintedMeshFile, ObjWithoutItsMtlHasNamesAlone) {
  const auto path = put("names.obj",
                        "mtllib lost.mtl\nv 0 0 0\nv 2 0 0\nv 2 1 0\nf 1 2 3\n"
                        "usemtl body\nf 3 2 1\n");
  const auto read = read_painted_mesh(path);
  ASSERT_THAT(read, Succeeds());
  same_mesh(*read, path);
  ASSERT_EQ(read->paints.size(), 2U);
  EXPECT_EQ(read->paints[0].name, "");
  EXPECT_EQ(read->paints[1].name, "body");
  EXPECT_FALSE(read->paints[0].described);
  EXPECT_FALSE(read->paints[1].described);
  EXPECT_TRUE(read->files.empty());
}

// Half a square as glTF has it (y up), and what hangs on it.
struct Square {
  std::string primitive = R"("attributes":{"POSITION":0,"TEXCOORD_0":1},"material":0)";
  std::string node, image = R"({"uri":"mark.png"})", texture, sampler;
  std::string material =
      R"({"name":"mark","pbrMetallicRoughness":{"baseColorFactor":[0.5,0.25,0.125,1],)"
      R"("metallicFactor":0,"roughnessFactor":0.5,"baseColorTexture":{"index":0TEXTURE}}})";

  [[nodiscard]] std::string text() const {
    std::string bytes;
    const auto add = [&](float x) { bytes.append(reinterpret_cast<const char*>(&x), sizeof x); };
    for (const auto& p : {std::array{0.0F, 0.0F, 0.0F}, {2.0F, 0.0F, 0.0F}, {2.0F, 0.0F, -1.0F}})
      for (const float x : p) add(x);
    for (const auto& p : {std::array{0.0F, 1.0F}, {1.0F, 1.0F}, {1.0F, 0.0F}})
      for (const float x : p) add(x);
    bytes += "\x89PNG";
    std::string of = material;
    of.replace(of.find("TEXTURE"), 7, texture);
    return fmt::format(
        R"({{"asset":{{"version":"2.0"}},"scenes":[{{"nodes":[0]}}],"nodes":[{{"mesh":0{}}}],)"
        R"("meshes":[{{"primitives":[{{{}}}]}}],"materials":[{}],"textures":[{{"source":0{}}}],)"
        R"("samplers":[{{"wrapS":33071,"wrapT":33648}}],"images":[{}],)"
        R"("buffers":[{{"byteLength":{},"uri":"data:;base64,{}"}}],"bufferViews":[)"
        R"({{"buffer":0,"byteLength":36}},{{"buffer":0,"byteOffset":36,"byteLength":24}},)"
        R"({{"buffer":0,"byteOffset":60,"byteLength":4}}],"accessors":[)"
        R"({{"bufferView":0,"componentType":5126,"count":3,"type":"VEC3"}},)"
        R"({{"bufferView":1,"componentType":5126,"count":3,"type":"VEC2"}}]}})",
        node, primitive, of, sampler, image, bytes.size(), base64_text(bytes));
  }
};

TEST_F(PaintedMeshFile, GltfHasItsBaseColourAndPicture) {
  const auto path = put("a.gltf", Square{}.text());
  const auto read = read_painted_mesh(path);
  ASSERT_THAT(read, Succeeds());
  same_mesh(*read, path);
  ASSERT_EQ(read->paints.size(), 1U);
  const Paint& paint = read->paints[0];
  EXPECT_EQ(paint.name, "mark");
  EXPECT_EQ(paint.colour, (std::array<double, 3>{0.5, 0.25, 0.125}));
  EXPECT_EQ(paint.metallic, 0.0);
  EXPECT_EQ(paint.roughness, 0.5);
  EXPECT_EQ(paint.picture_file, folder / "mark.png");
  EXPECT_EQ(paint.beyond, (std::array{Beyond::repeats, Beyond::repeats}));
  EXPECT_EQ(read->at_corner[0], (Places{{{0, 1}, {1, 1}, {1, 0}}}));
  EXPECT_EQ(read->files, (std::vector<std::filesystem::path>{folder / "mark.png"}));
}

TEST_F(PaintedMeshFile, GltfPicturesMayBeInsideItAndEndAtTheirEdges) {
  for (const std::string image : {R"({"bufferView":2,"mimeType":"image/png"})",
                                  R"({"uri":"data:image/png;base64,iVBORw=="})"}) {
    Square square;
    square.image = image;
    square.sampler = R"(,"sampler":0)";
    const auto read = read_painted_mesh(put("a.gltf", square.text()));
    ASSERT_THAT(read, Succeeds());
    EXPECT_EQ(read->paints[0].picture, "\x89PNG");
    EXPECT_TRUE(read->paints[0].picture_file.empty());
    EXPECT_EQ(read->paints[0].beyond, (std::array{Beyond::edge, Beyond::mirrored}));
    EXPECT_TRUE(read->files.empty());
  }
}

// The picture is turned by 90 degrees clockwise: what lay to its right lies upward.
TEST_F(PaintedMeshFile, GltfCoordinatesAreScaledTurnedAndShifted) {
  Square square;
  square.texture = R"(,"extensions":{"KHR_texture_transform":{"offset":[0.25,0.5],)"
                   R"("rotation":1.5707963267948966,"scale":[2,3]}})";
  const auto read = read_painted_mesh(put("a.gltf", square.text()));
  ASSERT_THAT(read, Succeeds());
  // (u, v) -> (3 v, -2 u) + offset
  const Places expected{{{3.25F, 0.5F}, {3.25F, -1.5F}, {0.25F, -1.5F}}};
  for (std::size_t i = 0; i < 3; ++i)
    for (std::size_t k = 0; k < 2; ++k)
      EXPECT_NEAR(read->at_corner[0][i][k], expected[i][k], 1e-6F) << i << ' ' << k;
}

TEST_F(PaintedMeshFile, CornersKeepTheirPlacesWhereANodeMirrors) {
  Square square;
  square.node = R"(,"scale":[-1,1,1])";
  const auto path = put("a.gltf", square.text());
  const auto read = read_painted_mesh(path);
  ASSERT_THAT(read, Succeeds());
  same_mesh(*read, path);
  for (std::size_t i = 0; i < 3; ++i) {
    // In the file u is x / 2 and v is 1 + z; x is mirrored, and -z lies northward, in mm.
    const Vec3 p = read->mesh.vertices_mm[read->mesh.triangles[0][i]];
    EXPECT_EQ(static_cast<double>(read->at_corner[0][i][0]), -p.x / 2000.0) << i;
    EXPECT_EQ(static_cast<double>(read->at_corner[0][i][1]), 1.0 - p.y / 1000.0) << i;
  }
}

TEST_F(PaintedMeshFile, PrimitivesWithoutAMaterialHaveTheFormatsOwn) {
  Square square;
  square.primitive = R"("attributes":{"POSITION":0})";
  const auto read = read_painted_mesh(put("a.gltf", square.text()));
  ASSERT_THAT(read, Succeeds());
  ASSERT_EQ(read->paints.size(), 2U);
  EXPECT_EQ(read->paint_of[0], 1U);
  EXPECT_EQ(read->paints[1].metallic, 1.0);
  EXPECT_EQ(read->paints[1].colour, (std::array<double, 3>{1, 1, 1}));
}

TEST_F(PaintedMeshFile, SaysWhatIsWrong) {
  const auto obj = [&](const std::string& mtl, const std::string& faces) {
    std::ofstream(folder / "m.mtl") << mtl;
    return read_painted_mesh(
        put("m.obj", "mtllib m.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nusemtl a\n" + faces));
  };
  EXPECT_THAT(read_painted_mesh(put("m.stl",
                                    "solid s\nfacet normal 0 0 1\nouter loop\n"
                                    "vertex 0 0 0\nvertex 1 0 0\nvertex 0 1 0\nendloop\n"
                                    "endfacet\nendsolid\n")),
              FailsSaying(kNoPaint, "m.stl: has no materials of its own"));
  EXPECT_THAT(obj("newmtl a\nmap_Kd p.png\n", "f 1 2 3\n"),
              FailsSaying(kNoPaint,
                          "triangle 1 of material 'a': each corner needs one of "
                          "the 1 texture coordinates"));
  EXPECT_THAT(obj("newmtl a\n", "f 1/1 2/2 3/1\n"), FailsSaying(kNoPaint, "texture coordinates"));
  EXPECT_THAT(
      obj("newmtl a\nKd 0.5 1.5 0\n", "f 1/1 2/1 3/1\n"),
      FailsSaying(kMeshFormat, "m.mtl: line 2: Kd with numbers from 0 to 1 expected, found '1.5'"));
  EXPECT_THAT(obj("newmtl a\nmap_Kd -s 2 2 2 p.png\n", "f 1/1 2/1 3/1\n"),
              FailsSaying(kMeshFormat, "m.mtl: line 2: map_Kd -s: pictures that are"));
  EXPECT_THAT(obj("newmtl a\nmap_Kd\n", "f 1/1 2/1 3/1\n"),
              FailsSaying(kMeshFormat, "m.mtl: line 2: map_Kd without a file's name"));
  const auto gltf = [&](const Square& square) {
    return read_painted_mesh(put("m.gltf", square.text()));
  };
  Square square;
  square.primitive = R"("attributes":{"POSITION":0},"material":0)";
  EXPECT_THAT(gltf(square), FailsSaying(kNoPaint,
                                        "material 'mark' has a picture, but the triangles do "
                                        "not say where they lie in it (TEXCOORD_0)"));
  square = {};
  square.primitive = R"("attributes":{"POSITION":0,"TEXCOORD_0":1},"material":1)";
  EXPECT_THAT(
      gltf(square),
      FailsSaying(kMeshFormat, "/meshes/0/primitives/0/material: a material that is there"));
  square = {};
  square.texture = R"(,"texCoord":"a")";
  EXPECT_THAT(gltf(square), FailsSaying(kMeshFormat, "baseColorTexture/texCoord"));
  square = {};
  square.material.replace(square.material.find("0.25"), 4, "1.25");
  EXPECT_THAT(gltf(square),
              FailsSaying(kMeshFormat, "baseColorFactor: numbers from 0 to 1 expected"));
  square = {};
  square.image = R"({"bufferView":7})";
  EXPECT_THAT(gltf(square), FailsSaying(kMeshFormat, "/images/0/bufferView"));
}

// What is read has a paint, in range, of every triangle, and places where it has a picture.
TEST_F(PaintedMeshFile, DamagedAnywhereItHasPaintsInRangeOrSaysWhatIsWrong) {
  const std::string mtl = "newmtl a\nKd 0.9 0.6 0.2\nPm 1\nnewmtl b c\nmap_Kd -clamp on p.png\n",
                    obj =
                        "mtllib m.mtl\nv 0 0 0\nv 2 0 0\nv 2 1 0\nvt 0 0\nvt 1 0\nvt 1 1\n"
                        "usemtl b c\nf 1/1 2/2 3/-1\nusemtl a\nf 1/1 2/2 3/3\n";
  Square square;
  square.texture = R"(,"extensions":{"KHR_texture_transform":{"scale":[2,3]}})";
  square.sampler = R"(,"sampler":0)";
  const std::string gltf = square.text();
  constexpr std::uint64_t kSeed = 5;
  RecordProperty("seed", static_cast<int>(kSeed));
  testing_support::Mutator damaged(kSeed);
  int refused = 0, painted = 0;
  for (int i = 0; i < 4500; ++i) {
    SCOPED_TRACE(i);
    std::ofstream(folder / "m.mtl") << (i % 3 == 0 ? damaged(mtl) : mtl);
    const auto read = read_painted_mesh(put("m", i % 3 == 0   ? obj
                                                 : i % 3 == 1 ? damaged(obj)
                                                              : damaged(gltf)));
    if (!read) {
      ++refused;
      const ErrorCode code = read.error().code;
      ASSERT_TRUE(code == kMeshFormat || code == kMeshEmpty || code == kNoPaint ||
                  code == kFileNotFound || code == kFileNotReadable)
          << code.name;
      continue;
    }
    ASSERT_EQ(read->paint_of.size(), read->mesh.triangles.size());
    ASSERT_EQ(read->at_corner.size(), read->mesh.triangles.size());
    for (std::size_t t = 0; t < read->paint_of.size(); ++t) {
      ASSERT_LT(read->paint_of[t], read->paints.size());
      if (!read->paints[read->paint_of[t]].has_picture()) continue;
      ++painted;
      for (const auto& at : read->at_corner[t]) ASSERT_FALSE(std::isnan(at[0]));
    }
  }
  EXPECT_GT(refused, 450);
  EXPECT_GT(painted, 150);
}

}  // namespace
}  // namespace maquette::meshing

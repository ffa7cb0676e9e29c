// SPDX-License-Identifier: GPL-3.0-or-later

// meshing/mesh_io.hpp:
//   written and read: the same bits ........... awkward doubles; bytes of the file in full
//   same mesh, same bytes ..................... hash
//   PLY ascii, both binary kinds, every scalar
//   type, other elements and properties ....... the same mesh written in each way
//   polygons fanned ........................... closed cases in PLY and OBJ
//   STL welded, +0 = -0, order of appearance .. closed case, binary and ascii
//   binary STL that begins with "solid" ....... chosen by length
//   OBJ index forms ........................... each form of the same tetrahedron
//   glTF binary, as text with its bytes in
//   it or beside it; poses of nodes, mirrors,
//   strips, shares of 16 bits, corners welded . the same tetrahedron each time, by closed form
//   format chosen by content .................. file names say nothing
//   every error, with line or byte ............ table of broken files; huge counts; cut at
//                                               every byte
//   whatever the bytes, a mesh or an error .... random changes of valid files
//   files of others ........................... real OBJ and STL, counts known, if present
//   cancelled: no file left; progress ......... stop token

#include "meshing/mesh_io.hpp"

#include <array>
#include <bit>
#include <cmath>
#include <cstdlib>
#include <cstring>
#include <fstream>
#include <limits>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/files.hpp"
#include "core/random.hpp"
#include "support/folders.hpp"
#include "support/gltf_text.hpp"
#include "support/matchers.hpp"
#include "support/mesh_properties.hpp"

namespace maquette::meshing {
namespace {

namespace fs = std::filesystem;
using ::testing::AllOf;
using ::testing::HasSubstr;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

TriMesh tetrahedron() {
  return {.vertices_mm = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}},
          .triangles = {{0, 2, 1}, {0, 1, 3}, {0, 3, 2}, {1, 2, 3}}};
}

/// Without AtomicFile: thousands of files need no fsync.
fs::path put(const ScratchFolder& folder, std::string_view content) {
  const fs::path path = folder / "mesh";
  std::ofstream(path, std::ios::binary) << content;
  return path;
}

Result<TriMesh> read(std::string_view content, const RunContext& run = {}) {
  const ScratchFolder folder;
  return read_mesh(put(folder, content), run);
}

/// Appends numbers in either byte order.
struct Bytes {
  std::string text;
  bool big = false;
  template <class T>
  Bytes& operator<<(T value) {
    auto raw = std::bit_cast<std::array<char, sizeof(T)>>(value);
    if (big) std::reverse(raw.begin(), raw.end());
    text.append(raw.data(), raw.size());
    return *this;
  }
};

std::string binary_stl(const TriMesh& m, std::string header = "binary") {
  header.resize(80, ' ');
  Bytes out{.text = header};
  out << static_cast<std::uint32_t>(m.triangles.size());
  for (const auto& t : m.triangles) {
    out << 0.0f << 0.0f << 0.0f;
    for (const auto i : t) {
      const Vec3 v = m.vertices_mm[i];
      out << static_cast<float>(v.x) << static_cast<float>(v.y) << static_cast<float>(v.z);
    }
    out << std::uint16_t{0};
  }
  return out.text;
}

std::string ascii_stl(const TriMesh& m) {
  std::string out = "solid any name facet\n";
  for (const auto& t : m.triangles) {
    out += " facet normal 0 0 0\n  outer loop\n";
    for (const auto i : t)
      out += fmt::format("   vertex {} {} {:e}\n", m.vertices_mm[i].x, m.vertices_mm[i].y,
                         m.vertices_mm[i].z);
    out += "  endloop\n endfacet\n";
  }
  return out + "endsolid any name\n";
}

std::string ascii_ply(const TriMesh& m) {
  std::string out = fmt::format(
      "ply\nformat ascii 1.0\ncomment any\nelement vertex {}\nproperty float x\nproperty float y\n"
      "property float z\nelement face {}\nproperty list uchar int vertex_index\nend_header\n",
      m.vertices_mm.size(), m.triangles.size());
  for (const Vec3& v : m.vertices_mm) out += fmt::format("{} {} {}\n", v.x, v.y, v.z);
  for (const auto& t : m.triangles) out += fmt::format("3 {} {} {}\n", t[0], t[1], t[2]);
  return out;
}

std::string obj(const TriMesh& m) {
  std::string out = "# any\nmtllib any.mtl\no any\n";
  for (const Vec3& v : m.vertices_mm) out += fmt::format("v {} {} {}\n", v.x, v.y, v.z);
  for (const auto& t : m.triangles)
    out += fmt::format("f {} {} {}\n", t[0] + 1, t[1] + 1, t[2] + 1);
  return out;
}

void expect_mesh(const Result<TriMesh>& got, const TriMesh& wanted) {
  ASSERT_THAT(got, Succeeds());
  EXPECT_EQ(got->vertices_mm, wanted.vertices_mm);
  EXPECT_EQ(got->triangles, wanted.triangles);
}

// ---- writing -----------------------------------------------------------------------------

TEST(WritePly, RoundTripIsExactToTheBit) {
  const ScratchFolder folder;
  TriMesh m;
  for (std::uint64_t i = 0; m.vertices_mm.size() < 300'000; i += 3) {  // several buffers
    const auto any = [&](std::uint64_t k) {
      const auto x = std::bit_cast<double>(random_bits(1, i + k));
      return std::isfinite(x) ? x : -0.0;
    };
    m.vertices_mm.push_back({any(0), any(1), any(2)});
  }
  for (std::uint64_t i = 0; i < 400'000; ++i) {
    const auto any = [&](std::uint64_t k) {
      return static_cast<std::uint32_t>(random_bits(2, 3 * i + k) % m.vertices_mm.size());
    };
    m.triangles.push_back({any(0), any(1), any(2)});
  }
  ASSERT_THAT(write_ply(m, folder / "a.ply"), Succeeds());
  const auto back = read_mesh(folder / "a.ply");
  ASSERT_THAT(back, Succeeds());
  EXPECT_EQ(back->triangles, m.triangles);
  ASSERT_EQ(back->vertices_mm.size(), m.vertices_mm.size());
  EXPECT_EQ(std::memcmp(back->vertices_mm.data(), m.vertices_mm.data(), 24 * m.vertices_mm.size()),
            0);
  ASSERT_THAT(write_ply(m, folder / "b.ply"), Succeeds());
  EXPECT_EQ(sha256_file(folder / "a.ply").value(), sha256_file(folder / "b.ply").value());
}

TEST(WritePly, IsTheFormatInFull) {
  const ScratchFolder folder;
  const TriMesh m{.vertices_mm = {{1, 2, 3}}, .triangles = {{0, 0, 0}}};
  ASSERT_THAT(write_ply(m, folder / "a.ply"), Succeeds());
  Bytes expected{.text =
                     "ply\nformat binary_little_endian 1.0\n"
                     "comment frame: model, right-handed, x east, y north, z up\n"
                     "comment unit: mm\nelement vertex 1\nproperty double x\nproperty double y\n"
                     "property double z\nelement face 1\n"
                     "property list uchar uint vertex_indices\nend_header\n"};
  expected << 1.0 << 2.0 << 3.0 << std::uint8_t{3} << 0u << 0u << 0u;
  EXPECT_EQ(read_file(folder / "a.ply").value(), expected.text);
}

TEST(WritePly, StopsWithoutLeavingAFile) {
  const ScratchFolder folder;
  std::stop_source source;
  source.request_stop();
  RunContext run;
  run.stop = source.get_token();
  EXPECT_THAT(write_ply(tetrahedron(), folder / "a.ply", run), FailsWith(kCancelled));
  EXPECT_TRUE(fs::is_empty(folder.path()));
  for (const std::string& file : {ascii_ply(tetrahedron()), ascii_stl(tetrahedron()),
                                  binary_stl(tetrahedron()), obj(tetrahedron())})
    EXPECT_THAT(read(file, run), FailsWith(kCancelled));
}

TEST(WritePly, ReportsProgressUpToOne) {
  const ScratchFolder folder;
  double last = 0.0;
  RunContext run;
  run.progress = [&](double share) {
    EXPECT_GE(share, last);
    last = share;
  };
  ASSERT_THAT(write_ply(tetrahedron(), folder / "a.ply", run), Succeeds());
  EXPECT_EQ(last, 1.0);
}

TEST(WritePly, NamesAFolderThatIsNotThere) {
  const ScratchFolder folder;
  EXPECT_THAT(write_ply(tetrahedron(), folder / "none" / "a.ply"), FailsWith(kFileNotWritable));
}

// ---- PLY -----------------------------------------------------------------------------------

TEST(ReadPly, Ascii) {
  expect_mesh(read(ascii_ply(tetrahedron())), tetrahedron());
}

TEST(ReadPly, AsciiOfWindowsWithPlusSignsAndOddLines) {
  std::string text = ascii_ply(tetrahedron());
  for (std::size_t at = 0; (at = text.find('\n', at)) != std::string::npos; at += 2)
    text.replace(at, 1, "\r\n");
  expect_mesh(read(text), tetrahedron());
  std::string plus = ascii_ply(tetrahedron());
  plus.replace(plus.find("1 0 0\n"), 6, "+1.0e+0\n 1e-999 -1e-400\n\n");
  const auto mesh = read(plus);
  ASSERT_THAT(mesh, Succeeds());
  EXPECT_EQ(mesh->vertices_mm[1], (Vec3{1, 0, 0}));  // too small for double is 0
}

/// The tetrahedron with every scalar type, extra elements and properties, in one byte order.
template <class Coordinate, class Count, class Index>
std::string rich_ply(bool big, std::string_view coordinate, std::string_view count,
                     std::string_view index) {
  const TriMesh m = tetrahedron();
  Bytes out{.text = fmt::format(
                "ply\nformat binary_{}_endian 1.0\nobj_info any\n"
                "element material 2\nproperty list ushort double shades\nproperty char kind\n"
                "element vertex 4\nproperty short a\nproperty {} y\nproperty {} x\n"
                "property list int8 uint16 neighbours\nproperty {} z\nproperty uint8 red\n"
                "element face 4\nproperty float quality\nproperty list {} {} vertex_indices\n"
                "property int32 group\nend_header\n",
                big ? "big" : "little", coordinate, coordinate, coordinate, count, index),
            .big = big};
  out << std::uint16_t{2} << 1.5 << 2.5 << std::int8_t{-1};
  out << std::uint16_t{0} << std::int8_t{-2};
  for (const Vec3& v : m.vertices_mm) {
    out << std::int16_t{-300} << static_cast<Coordinate>(v.y) << static_cast<Coordinate>(v.x);
    out << std::int8_t{1} << std::uint16_t{65535} << static_cast<Coordinate>(v.z);
    out << std::uint8_t{200};
  }
  for (const auto& t : m.triangles) {
    out << 0.5f << static_cast<Count>(3);
    for (const auto i : t) out << static_cast<Index>(i);
    out << std::int32_t{7};
  }
  return out.text;
}

TEST(ReadPly, EveryScalarTypeInBothByteOrders) {
  for (const bool big : {false, true}) {
    SCOPED_TRACE(big ? "big endian" : "little endian");
    expect_mesh(read(rich_ply<float, std::uint8_t, std::int32_t>(big, "float", "uchar", "int")),
                tetrahedron());
    expect_mesh(
        read(rich_ply<double, std::int32_t, std::uint32_t>(big, "float64", "int32", "uint32")),
        tetrahedron());
    expect_mesh(
        read(rich_ply<std::int16_t, std::uint16_t, std::int16_t>(big, "short", "ushort", "int16")),
        tetrahedron());
    expect_mesh(
        read(rich_ply<std::int8_t, std::int8_t, std::uint16_t>(big, "char", "int8", "ushort")),
        tetrahedron());
    expect_mesh(
        read(rich_ply<std::uint32_t, std::uint32_t, std::uint8_t>(big, "uint", "uint", "uint8")),
        tetrahedron());
  }
}

TEST(ReadPly, FansPolygonsAndReadsFacesBeforeVertices) {
  const std::string text =
      "ply\nformat ascii 1.0\nelement face 2\nproperty list uchar int vertex_indices\n"
      "element vertex 5\nproperty double x\nproperty double y\nproperty double z\nend_header\n"
      "5 4 3 2 1 0\n3 0 1 2\n0 0 0\n1 0 0\n2 1 0\n1 2 0\n0 1 0\n";
  const auto mesh = read(text);
  ASSERT_THAT(mesh, Succeeds());
  EXPECT_THAT(mesh->triangles,
              ::testing::ElementsAre(std::array{4u, 3u, 2u}, std::array{4u, 2u, 1u},
                                     std::array{4u, 1u, 0u}, std::array{0u, 1u, 2u}));
}

TEST(ReadPly, WarnsOfBytesAfterTheEnd) {
  std::string warning;
  RunContext run;
  run.warn = [&](const std::string& text) { warning = text; };
  const std::string file =
      rich_ply<float, std::uint8_t, std::int32_t>(false, "float", "uchar", "int");
  ASSERT_THAT(read(file, run), Succeeds());
  EXPECT_EQ(warning, "");
  ASSERT_THAT(read(file + "xyz", run), Succeeds());
  EXPECT_THAT(warning, HasSubstr("3 bytes"));
}

// ---- STL -----------------------------------------------------------------------------------

TEST(ReadStl, WeldsEqualCornersInOrderOfAppearance) {
  // The tetrahedron's corners in the order in which its triangles name them.
  const TriMesh welded{.vertices_mm = {{0, 0, 0}, {0, 1, 0}, {1, 0, 0}, {0, 0, 1}},
                       .triangles = {{0, 1, 2}, {0, 2, 3}, {0, 3, 1}, {2, 1, 3}}};
  TriMesh m = tetrahedron();
  expect_mesh(read(binary_stl(m)), welded);
  expect_mesh(read(binary_stl(m, "solid but binary")), welded);
  expect_mesh(read(ascii_stl(m)), welded);
  // A corner that is -0 in one triangle and +0 in another is one corner.
  m.vertices_mm.push_back({-0.0, 1.0, -0.0});
  m.triangles[3][1] = 4;
  expect_mesh(read(binary_stl(m)), welded);
  expect_mesh(read(ascii_stl(m)), welded);
}

TEST(ReadStl, WeldsManyCornersAndKeepsAllTriangles) {
  // A grid of 100 x 100 cells with coordinates that are not dyadic.
  TriMesh m;
  for (std::uint32_t r = 0; r <= 100; ++r)
    for (std::uint32_t c = 0; c <= 100; ++c)
      m.vertices_mm.push_back({0.1f * static_cast<float>(c), 0.3f * static_cast<float>(r), 7.7f});
  for (std::uint32_t r = 0; r < 100; ++r)
    for (std::uint32_t c = 0; c < 100; ++c) {
      const std::uint32_t i = 101 * r + c;
      m.triangles.push_back({i, i + 1, i + 102});
      m.triangles.push_back({i, i + 102, i + 101});
    }
  const auto back = read(binary_stl(m));
  ASSERT_THAT(back, Succeeds());
  ASSERT_EQ(back->vertices_mm.size(), m.vertices_mm.size());
  for (std::size_t i = 0; i < m.triangles.size(); ++i)
    for (std::size_t k = 0; k < 3; ++k)
      ASSERT_EQ(back->vertices_mm[back->triangles[i][k]], m.vertices_mm[m.triangles[i][k]]);
}

TEST(ReadStl, ReadsSeveralSolidsAndCapitalsAsOneMesh) {
  const std::string one = ascii_stl(tetrahedron());
  std::string capitals = one;
  for (char& c : capitals) c = static_cast<char>(std::toupper(c));
  const auto two = read(one + "\n" + capitals);
  ASSERT_THAT(two, Succeeds());
  EXPECT_EQ(two->triangles.size(), 8u);
  EXPECT_EQ(two->vertices_mm.size(), 4u);
}

// ---- OBJ -----------------------------------------------------------------------------------

TEST(ReadObj, EveryFormOfIndices) {
  const std::string v = "v 0 0 0\nv 1 0 0 0.5 0.5 0.5\nv 0 1 0\nvt 0 0\nvn 0 0 1\nv 0 0 1\n";
  for (const char* faces :
       {"f 1 3 2\nf 1 2 4\nf 1 4 3\nf 2 3 4\n",
        "f 1/1 3/1 2/1\nf 1//1 2//1 4//1\nf 1/1/1 4/1/1 3/1/1\nf 2 3 4",
        "f -4 -2 -3\nf -4/-1 -3/-1 -1/-1\r\nf -4//-1 -1//-1 -2//-1\nf 2 3 4#x",
        "usemtl a\ns off\n g b\n\n#\n f 1 \\\n 3 2\nf 1 2 4 # x\nf 1 4 3\nl 1 2\n"
        "f 2 3 4"}) {
    SCOPED_TRACE(faces);
    expect_mesh(read(v + std::string(faces).substr(0, std::string(faces).find("#x"))),
                tetrahedron());
  }
}

TEST(ReadObj, FansPolygonsAndLetsFacesComeFirst) {
  const auto mesh = read("f 1 2 3 4\nv 0 0 0\nv 1 0 0\nv 1 1 0\nv 0 1 0\n");
  ASSERT_THAT(mesh, Succeeds());
  EXPECT_THAT(mesh->triangles,
              ::testing::ElementsAre(std::array{0u, 1u, 2u}, std::array{0u, 2u, 3u}));
}

// ---- errors --------------------------------------------------------------------------------

struct Broken {
  const char* name;
  std::string content;
  std::string message;
  ErrorCode code = kMeshFormat;
};
void PrintTo(const Broken& b, std::ostream* out) {
  *out << b.name;
}

std::string changed(std::string text, std::string_view from, std::string_view to) {
  return text.replace(text.find(from), from.size(), to);
}

std::vector<Broken> broken_files() {
  const TriMesh m = tetrahedron();
  const std::string ply = ascii_ply(m), stl = ascii_stl(m), text = obj(m);
  const std::string little =
      rich_ply<float, std::uint8_t, std::int32_t>(false, "float", "uchar", "int");
  TriMesh not_finite = m;
  not_finite.vertices_mm[3].z = NAN;
  return {
      {"nothing", "", "neither PLY, STL, OBJ nor glTF"},
      {"spaces", "  \n ", "neither PLY, STL, OBJ nor glTF"},
      {"zeros", std::string(50, '\0'), "neither PLY, STL, OBJ nor glTF"},
      {"prose", "Dear reader,\n", "line 1: 'Dear' is no keyword"},
      {"no_triangle", "v 0 0 0\n", "no triangle", kMeshEmpty},
      {"no_triangle_stl", binary_stl({}), "no triangle", kMeshEmpty},
      {"no_triangle_ascii_stl", "solid a\nendsolid a\n", "no triangle", kMeshEmpty},
      {"points_only", changed(ply, "element face 4", "element face 0"), "no triangle", kMeshEmpty},
      {"ply_format", changed(ply, "ascii", "asci"), "line 2: ascii, binary_little_endian"},
      {"ply_no_format", changed(ply, "format ascii 1.0\n", ""), "a format line"},
      {"ply_no_end", "ply\nformat ascii 1.0\n", "line 3: end_header expected"},
      {"ply_keyword", changed(ply, "comment", "komment"), "line 3: format, comment"},
      {"ply_type", changed(ply, "float x", "real x"), "line 5: type (char .. double)"},
      {"ply_list_type", changed(ply, "uchar int", "float int"), "line 9: integer type"},
      {"ply_index_type", changed(ply, "uchar int", "uchar float"), "integer type of vertex"},
      {"ply_twice", changed(ply, "float y", "float x"), "one property of each name"},
      {"ply_element_twice", changed(ply, "element face", "element vertex"), "one element of each"},
      {"ply_no_z", changed(ply, "float z", "float w"), "no properties x, y, z"},
      {"ply_no_corners", changed(ply, "vertex_index", "corners"), "no list vertex_indices"},
      {"ply_orphan", "ply\nproperty float x\n", "line 2: element before"},
      {"ply_negative", changed(ply, "vertex 4", "vertex -4"), "line 4: number of elements"},
      {"ply_huge", changed(ply, "vertex 4", "vertex 4000000000000"), "need more than the"},
      {"ply_beyond", changed(ply, "face 4", "face 99999999999999999999"), "number of elements"},
      {"ply_huge_faces", changed(little, "face 4", "face 4000000000"), "need more than the"},
      {"ply_huge_empty", "ply\nformat ascii 1.0\nelement a 9000000000\nend_header\n", "need more"},
      {"ply_more", changed(ply, "face 4", "face 5"), "face 4 of 5"},
      {"ply_index", changed(ply, "3 1 2 3", "3 1 2 4"),
       "line 18: face names vertex 4, but there are only 4"},
      {"ply_index_negative", changed(ply, "3 1 2 3", "3 1 -2 3"), "line 18: face 3 of 4"},
      {"ply_two_corners", changed(ply, "3 1 2 3", "2 1 2"), "at least 3 corners"},
      {"ply_nan", changed(ply, "1 0 0", "nan 0 0"), "line 12: vertex 1 of 4"},
      {"ply_infinite", changed(ply, "1 0 0", "1 0 1e999"), "line 12: vertex 1 of 4"},
      {"ply_word", changed(ply, "1 0 0", "1 O 0"), "line 12: vertex 1 of 4"},
      {"ply_cut", little.substr(0, little.size() - 1), "byte"},
      {"stl_cut", binary_stl(m).substr(0, 200),
       "announces 4 triangles, that is 284 bytes, but "
       "the file has 200"},
      {"stl_long", binary_stl(m) + "x", "announces 4 triangles"},
      {"stl_nan", binary_stl(not_finite), "byte 170: corner 3 of triangle 2 is not finite"},
      {"stl_word", changed(stl, "outer", "inner"), "line 3: outer loop expected, found 'inner'"},
      {"stl_loop", changed(stl, "loop", "hoop"), "line 3: loop expected"},
      {"stl_vertex", changed(stl, "vertex", "vortex"), "line 4: vertex expected"},
      {"stl_short_vertex", changed(stl, "vertex 0 0 0.000000e+00", "vertex 0 0"),
       "line 4: finite number expected"},
      {"stl_endloop", changed(stl, "endloop", "vertex 1 2 3"), "line 7: endloop expected"},
      {"stl_endfacet", changed(stl, "endfacet", "end"), "line 8: endfacet expected"},
      {"stl_facet", changed(stl, "\n facet", "\n face"), "line 2: facet or endsolid expected"},
      {"stl_after", stl + "facet", "solid or the end of the file expected"},
      {"stl_ascii_cut", stl.substr(0, stl.size() - 18), "found the end of the line or file"},
      {"stl_infinite", changed(stl, "vertex 0", "vertex inf"), "line 4: finite number"},
      {"obj_keyword", changed(text, "f 1 2 4", "q 1 2 4"), "line 9: 'q' is no keyword"},
      {"obj_short", changed(text, "v 1 0 0", "v 1 0"), "line 5: finite coordinate"},
      {"obj_nan", changed(text, "v 1 0 0", "v 1 nan 0"), "line 5: finite coordinate"},
      {"obj_zero", changed(text, "f 1 2 4", "f 0 2 4"), "line 9: face names vertex 0"},
      {"obj_beyond", changed(text, "f 1 2 4", "f 1 2 5"),
       "line 9: face names vertex 5, but there are 4"},
      {"obj_before", changed(text, "f 1 2 4", "f 1 2 -5"), "line 9: face names vertex -5"},
      {"obj_huge", changed(text, "f 1 2 4", "f 1 2 9223372036854775807"), "line 9: face names"},
      {"obj_overflow", changed(text, "f 1 2 4", "f 1 2 -9223372036854775809"), "line 9: v, v/t"},
      {"obj_slashes", changed(text, "f 1 2 4", "f 1 2/1/1/1 4"), "line 9: v, v/t"},
      {"obj_letters", changed(text, "f 1 2 4", "f 1 2/a 4"), "line 9: v, v/t"},
      {"obj_two_corners", changed(text, "f 1 2 4", "f 1 2"), "at least 3 corners, found 2"},
  };
}

class BrokenFile : public ::testing::TestWithParam<Broken> {};
INSTANTIATE_TEST_SUITE_P(Kinds, BrokenFile, ::testing::ValuesIn(broken_files()),
                         [](const auto& kind) { return std::string(kind.param.name); });

TEST_P(BrokenFile, IsRefusedWithItsPlace) {
  const auto mesh = read(GetParam().content);
  ASSERT_THAT(mesh, FailsWith(GetParam().code));
  EXPECT_THAT(mesh.error().message, AllOf(HasSubstr("/mesh: "), HasSubstr(GetParam().message)));
}

TEST(ReadMesh, NamesFilesThatAreNotThereOrNoFiles) {
  const ScratchFolder folder;
  EXPECT_THAT(read_mesh(folder / "none.ply"), FailsWith(kFileNotFound));
  EXPECT_THAT(read_mesh(folder.path()), FailsWith(kFileNotReadable));
}

// ---- glTF ------------------------------------------------------------------------------------

using testing_support::base64_text;
using testing_support::glb_file;
using testing_support::gltf_buffer;
using testing_support::gltf_json;

/// A point of the file, in metres with y up, in the model frame.
Vec3 from_gltf(Vec3 p) {
  return {1000.0 * p.x, -1000.0 * p.z, 1000.0 * p.y};
}

/// The tetrahedron whose vertices went through `pose`, to float's rounding of 1000 mm.
template <class Pose>
void expect_tetrahedron(const Result<TriMesh>& mesh, Pose&& pose) {
  ASSERT_THAT(mesh, Succeeds());
  const TriMesh m = tetrahedron();
  ASSERT_EQ(mesh->vertices_mm.size(), 4U);
  for (std::size_t i = 0; i < 4; ++i)
    EXPECT_LT(norm(mesh->vertices_mm[i] - from_gltf(pose(m.vertices_mm[i]))), 1e-3) << i;
  EXPECT_THAT(*mesh, testing_support::IsClosedAndOriented());
  EXPECT_GT(testing_support::signed_volume_mm3(*mesh), 0.0);
}
const auto kAsItIs = [](Vec3 p) { return p; };

TEST(ReadGltf, BinaryAndTextGiveTheSame) {
  const TriMesh m = tetrahedron();
  const std::string binary = gltf_buffer(m);
  expect_tetrahedron(read(glb_file(gltf_json(m), binary)), kAsItIs);
  const std::string inside = gltf_json(
      m, "", R"(,"uri":"data:application/octet-stream;base64,)" + base64_text(binary) + '"');
  expect_tetrahedron(read(inside), kAsItIs);
  const ScratchFolder folder;
  const fs::path path = put(folder, gltf_json(m, "", R"(,"uri":"its%20bytes.bin")"));
  EXPECT_THAT(read_mesh(path), FailsWith(kFileNotFound));
  std::ofstream(folder / "its bytes.bin", std::ios::binary) << binary;
  expect_tetrahedron(read_mesh(path), kAsItIs);
  EXPECT_TRUE(is_gltf(path).value());
  EXPECT_FALSE(is_gltf(put(folder, "v 0 0 0\n")).value());
}

TEST(ReadGltf, NodesHavePoses) {
  const TriMesh m = tetrahedron();
  const auto posed = [&](std::string_view node) {
    return read(glb_file(gltf_json(m, node), gltf_buffer(m)));
  };
  // A quarter turn about y takes z to x.
  expect_tetrahedron(
      posed(
          R"(,"translation":[1,2,3],"rotation":[0,0.70710678118,0,0.70710678118],"scale":[2,3,4])"),
      [](Vec3 p) {
        return Vec3{4 * p.z + 1, 3 * p.y + 2, -2 * p.x + 3};
      });
  expect_tetrahedron(posed(R"(,"matrix":[0,0,-1,0, 0,2,0,0, 1,0,0,0, 5,6,7,1])"), [](Vec3 p) {
    return Vec3{p.z + 5, 2 * p.y + 6, -p.x + 7};
  });
  // A mirror would turn it inside out.
  expect_tetrahedron(posed(R"(,"scale":[-1,1,1])"), [](Vec3 p) { return Vec3{-p.x, p.y, p.z}; });
  // A child goes with its parent.
  std::string family = gltf_json(m, R"(,"translation":[1,0,0])");
  family = changed(family, R"("nodes":[0])", R"("nodes":[1])");
  family = changed(family, R"(],"meshes")", R"(,{"children":[0],"scale":[2,2,2]}],"meshes")");
  expect_tetrahedron(read(glb_file(family, gltf_buffer(m))), [](Vec3 p) {
    return 2.0 * (p + Vec3{1, 0, 0});
  });
}

TEST(ReadGltf, CornersThatLieOnEachOtherAreOne) {
  // Each triangle with vertices of its own, as exporters write edges with two normals, and no
  // indices at all.
  TriMesh apart;
  const TriMesh m = tetrahedron();
  for (const auto& t : m.triangles)
    for (const std::uint32_t i : t) apart.vertices_mm.push_back(m.vertices_mm[i]);
  std::string json = gltf_json(apart);
  json = changed(json, R"(,"indices":1)", "");
  const auto mesh = read(glb_file(json, gltf_buffer(apart)));
  ASSERT_THAT(mesh, Succeeds());
  EXPECT_EQ(mesh->vertices_mm.size(), 4U);
  EXPECT_THAT(*mesh, testing_support::IsClosedAndOriented());
}

TEST(ReadGltf, StripsAndFans) {
  // A strip of a square turns every other triangle; a fan does not.
  TriMesh strip{.vertices_mm = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {1, 1, 0}}, .triangles = {}};
  TriMesh fan{.vertices_mm = {{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}, .triangles = {}};
  for (const auto& [shape, mode] : {std::pair(strip, 5), std::pair(fan, 6)}) {
    const std::string json =
        changed(gltf_json(shape), R"("indices":1)", fmt::format(R"("mode":{})", mode));
    const auto mesh = read(glb_file(json, gltf_buffer(shape)));
    ASSERT_THAT(mesh, Succeeds());
    ASSERT_EQ(mesh->triangles.size(), 2U);
    for (const auto& [a, b, c] : mesh->triangles) {
      const auto& v = mesh->vertices_mm;
      const Vec3 n = cross(v[b] - v[a], v[c] - v[a]);
      EXPECT_NEAR(n.y, -1e6, 1e-3) << mode;  // z of the file is -y of the model; mm^2
    }
  }
}

TEST(ReadGltf, SharesOfSixteenBits) {
  std::string binary;
  for (const std::uint16_t x : std::array<std::uint16_t, 9>{0, 0, 0, 65535, 0, 0, 0, 65535, 0})
    binary.append(reinterpret_cast<const char*>(&x), 2);
  const std::string json =
      R"({"asset":{"version":"2.0"},"scenes":[{"nodes":[0]}],"nodes":[{"mesh":0}],)"
      R"("meshes":[{"primitives":[{"attributes":{"POSITION":0}}]}],)"
      R"("extensionsRequired":["KHR_mesh_quantization"],)"
      R"("accessors":[{"bufferView":0,"componentType":5123,"normalized":true,"count":3,)"
      R"("type":"VEC3"}],"bufferViews":[{"buffer":0,"byteLength":18}],"buffers":[{"byteLength":18}]})";
  const auto mesh = read(glb_file(json, binary));
  ASSERT_THAT(mesh, Succeeds());
  EXPECT_EQ(mesh->vertices_mm, (std::vector<Vec3>{{0, 0, 0}, {1000, 0, 0}, {0, 0, 1000}}));
}

TEST(ReadGltf, RefusesWithThePlace) {
  const TriMesh m = tetrahedron();
  const std::string json = gltf_json(m), binary = gltf_buffer(m);
  const auto refused = [&](const std::string& text, std::string_view why) {
    const auto mesh = read(glb_file(text, binary));
    ASSERT_THAT(mesh, FailsWith(kMeshFormat)) << why;
    EXPECT_THAT(mesh.error().message, AllOf(HasSubstr("/mesh: "), HasSubstr(std::string(why))));
  };
  refused(changed(json, "\"2.0\"", "\"1.0\""), "/asset/version: \"2.0\" expected");
  refused(changed(json, R"("mesh":0)", R"("mesh":1)"),
          "/nodes/0/mesh: names /meshes 1, but there are 1");
  refused(changed(json, R"("POSITION":0)", R"("POSITION":1)"),
          "/accessors/1/type: \"VEC3\" expected");
  refused(changed(json, R"("count":4)", R"("count":5)"), "/accessors/0: 5 elements of 12 bytes");
  refused(changed(json, R"("count":12)", R"("count":11)"), "11 corners are no whole triangles");
  refused(changed(json, R"("byteOffset":48)", R"("byteOffset":44)"), "names vertex");
  refused(changed(json, R"("byteOffset":48)", R"("byteOffset":480)"),
          "/bufferViews/1: bytes 480 to");
  refused(changed(json, R"("nodes":[0])", R"("nodes":[0,0])"), "/scenes/0/nodes/0: a node");
  refused(changed(json, R"("scene":0)", R"("extensionsRequired":["EXT_meshopt_compression"])"),
          "without the extension 'EXT_meshopt_compression'");
  refused(changed(json, "{", "["), "no JSON of a glTF");
  const auto cut = read(glb_file(json, binary).substr(0, 100));
  ASSERT_THAT(cut, FailsWith(kMeshFormat));
  EXPECT_THAT(cut.error().message, HasSubstr("byte 12: a JSON chunk"));
}

// ---- hostile bytes ---------------------------------------------------------------------------

std::vector<std::string> valid_files() {
  const TriMesh m = tetrahedron();
  return {ascii_ply(m),
          rich_ply<float, std::uint8_t, std::int32_t>(false, "float", "uchar", "int"),
          rich_ply<double, std::int32_t, std::uint32_t>(true, "float64", "int32", "uint32"),
          binary_stl(m),
          ascii_stl(m),
          obj(m),
          glb_file(gltf_json(m), gltf_buffer(m)),
          gltf_json(m, R"(,"translation":[1,2,3])",
                    R"(,"uri":"data:;base64,)" + base64_text(gltf_buffer(m)) + '"')};
}

/// A mesh that keeps what the header promises, or one of the documented errors; a damaged glTF may
/// name a file that is not there.
void expect_mesh_or_error(const Result<TriMesh>& mesh) {
  if (!mesh) {
    ASSERT_TRUE(mesh.error().code == kMeshFormat || mesh.error().code == kMeshEmpty ||
                mesh.error().code == kFileNotFound || mesh.error().code == kFileNotReadable)
        << mesh.error().code.name;
    return;
  }
  ASSERT_FALSE(mesh->triangles.empty());
  for (const Vec3& v : mesh->vertices_mm)
    ASSERT_TRUE(std::isfinite(v.x) && std::isfinite(v.y) && std::isfinite(v.z));
  for (const auto& t : mesh->triangles)
    for (const auto i : t) ASSERT_LT(i, mesh->vertices_mm.size());
}

class HostileBytes : public ::testing::TestWithParam<std::size_t> {};
INSTANTIATE_TEST_SUITE_P(Files, HostileBytes, ::testing::Range<std::size_t>(0, 8));

TEST_P(HostileBytes, CutAnywhereGiveAMeshOrAnError) {
  const ScratchFolder folder;
  const std::string valid = valid_files()[GetParam()];
  ASSERT_THAT(read_mesh(put(folder, valid)), Succeeds());
  for (std::size_t length = 0; length < valid.size(); ++length) {
    SCOPED_TRACE(length);
    expect_mesh_or_error(read_mesh(put(folder, valid.substr(0, length))));
  }
}

TEST_P(HostileBytes, ChangedAnywhereGiveAMeshOrAnError) {
  const ScratchFolder folder;
  const std::string valid = valid_files()[GetParam()];
  int refused = 0;
  for (std::uint64_t i = 0; i < 1500; ++i) {
    SCOPED_TRACE(i);
    const std::uint64_t seed = 100 + GetParam();
    std::string text = valid;
    for (std::uint64_t k = 0; k <= random_bits(seed, 16 * i) % 4; ++k) {
      const std::uint64_t bits = random_bits(seed, 16 * i + 3 * k + 1);
      const std::size_t at = random_bits(seed, 16 * i + 3 * k + 2) % text.size();
      switch (random_bits(seed, 16 * i + 3 * k + 3) % 5) {
        case 0:
          text[at] = static_cast<char>(bits & 0xff);
          break;
        case 1:
          text[at] = static_cast<char>(text[at] ^ (1 << (bits % 8)));
          break;
        case 2:
          text[at] = "0123456789-+./ \nef"[bits % 18];
          break;
        case 3:
          text.insert(at, text.substr(bits % text.size(), 20));
          break;
        default:
          text.erase(at, 1 + bits % 8);
          break;
      }
      if (text.empty()) text = "p";
    }
    const auto mesh = read_mesh(put(folder, text));
    expect_mesh_or_error(mesh);
    if (!mesh) ++refused;
  }
  EXPECT_GT(refused, 150);  // the changes do reach the checks
}

// ---- files of others ---------------------------------------------------------------------------

struct RealFile {
  const char* name;
  std::size_t triangles;
};
void PrintTo(const RealFile& f, std::ostream* out) {
  *out << f.name;
}

class RealMesh : public ::testing::TestWithParam<RealFile> {};
INSTANTIATE_TEST_SUITE_P(Files, RealMesh,
                         ::testing::Values(RealFile{"HST.obj", 7670},
                                           RealFile{"Cubesat_3U.obj", 296},
                                           RealFile{"ISS_MainBody.obj", 6920},
                                           RealFile{"rock_SubTool12.stl", 24494},
                                           RealFile{"rock_SubTool3.stl", 23071}));

TEST_P(RealMesh, IsReadInFull) {
  const fs::path path = testing_support::data_folder() / "meshes" / GetParam().name;
  if (!fs::exists(path)) GTEST_SKIP() << path << " is not there; set MAQUETTE_DATA";
  const auto mesh = read_mesh(path);
  ASSERT_THAT(mesh, Succeeds());
  EXPECT_EQ(mesh->triangles.size(), GetParam().triangles);
  expect_mesh_or_error(mesh);
  // The welded rocks have about half as many vertices as triangles, as closed surfaces do.
  if (path.extension() == ".stl") {
    EXPECT_NEAR(static_cast<double>(mesh->vertices_mm.size()),
                0.5 * static_cast<double>(mesh->triangles.size()),
                0.05 * static_cast<double>(mesh->triangles.size()));
  }
  const ScratchFolder folder;
  ASSERT_THAT(write_ply(*mesh, folder / "again.ply"), Succeeds());
  expect_mesh(read_mesh(folder / "again.ply"), *mesh);
}

}  // namespace
}  // namespace maquette::meshing

// SPDX-License-Identifier: GPL-3.0-or-later

// export/cad.hpp, write_stl and write_obj:
//   the bytes of STL ................. counted and read by hand: size, normals, volume
//   others read the same solid ....... OpenMesh: closed, same vertices, same volume
//   OBJ keeps 1e-6 mm ................ coordinates that float would not hold
//   pieces are joined in order ...... every record of a file of two batches
//   numbers are written right ........ against the general formatter, halves, signs
//   same bytes for any thread count .. hashes of files of several pieces
//   each error code .................. empty, too many, folder missing, stopped

#include <cstring>
#include <fstream>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>
#include <OpenMesh/Core/IO/MeshIO.hh>
#include <OpenMesh/Core/Mesh/TriMesh_ArrayKernelT.hh>

#include "export/cad.hpp"
#include "export/limits.hpp"
#include "export/text_lines.hpp"
#include "support/matchers.hpp"
#include "support/simple_solids.hpp"

namespace maquette::exporting {
namespace {

using testing_support::box_solid;
using testing_support::FailsWith;
using testing_support::Hills;
using testing_support::ScratchFolder;
using testing_support::Succeeds;
using testing_support::terrain_solid;
using testing_support::volume_mm3;

struct DoubleTraits : OpenMesh::DefaultTraits {
  using Point = OpenMesh::Vec3d;
};
using OtherMesh = OpenMesh::TriMesh_ArrayKernelT<DoubleTraits>;

TriMesh from_other(const OtherMesh& other) {
  TriMesh m;
  for (const auto v : other.vertices()) {
    const auto p = other.point(v);
    m.vertices_mm.push_back({p[0], p[1], p[2]});
  }
  for (const auto f : other.faces()) {
    std::array<std::uint32_t, 3> t{};
    std::size_t k = 0;
    for (const auto v : other.fv_range(f)) t.at(k++) = static_cast<std::uint32_t>(v.idx());
    m.triangles.push_back(t);
  }
  return m;
}

bool closed(const OtherMesh& other) {
  for (const auto e : other.edges())
    if (other.is_boundary(e)) return false;
  return true;
}

float float_at(const std::string& bytes, std::size_t at) {
  float value = 0;
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

TEST(WriteStl, HasTheBytesOfTheFormat) {
  const ScratchFolder folder;
  const TriMesh box = box_solid({1, 2, 3}, {11, 22, 33});
  ASSERT_THAT(write_stl(box, folder / "a.stl"), Succeeds());
  const std::string bytes = read_file(folder / "a.stl").value();
  ASSERT_EQ(bytes.size(), 84U + 50U * 12U);
  EXPECT_NE(bytes.substr(0, 5), "solid");
  EXPECT_THAT(bytes.substr(0, 80), testing::HasSubstr("mm"));
  std::uint32_t count = 0;
  std::memcpy(&count, bytes.data() + 80, 4);
  ASSERT_EQ(count, 12U);
  for (std::size_t i = 0; i < 12; ++i) {
    const auto vec = [&](std::size_t which) {
      const std::size_t at = 84 + 50 * i + 12 * which;
      return Vec3{float_at(bytes, at), float_at(bytes, at + 4), float_at(bytes, at + 8)};
    };
    for (std::size_t k = 0; k < 3; ++k) EXPECT_EQ(vec(k + 1), box.vertices_mm[box.triangles[i][k]]);
    const Vec3 normal = vec(0), centre{6, 12, 18};
    EXPECT_DOUBLE_EQ(norm(normal), 1.0);
    EXPECT_GT(dot(normal, vec(1) - centre), 0) << "triangle " << i << " faces inward";
    EXPECT_NEAR(dot(normal, vec(2) - vec(1)), 0, 1e-6);
    EXPECT_EQ(bytes[84 + 50 * i + 48], 0);
    EXPECT_EQ(bytes[84 + 50 * i + 49], 0);
  }
}

TEST(WriteStl, GivesATriangleWithoutAreaAZeroNormal) {
  const ScratchFolder folder;
  TriMesh box = box_solid({0, 0, 0}, {1, 1, 1});
  box.triangles[0] = {0, 0, 1};
  ASSERT_THAT(write_stl(box, folder / "a.stl"), Succeeds());
  const std::string bytes = read_file(folder / "a.stl").value();
  for (std::size_t k = 0; k < 3; ++k) EXPECT_EQ(float_at(bytes, 84 + 4 * k), 0.0F);
}

class WriteHills : public testing::TestWithParam<std::uint64_t> {
 protected:
  const TriMesh ground = terrain_solid(120, 0.37, -12.25, Hills(GetParam(), 44, 3));
};

TEST_P(WriteHills, StlIsTheSameSolidForOpenMesh) {
  const ScratchFolder folder;
  ASSERT_THAT(write_stl(ground, folder / "a.stl"), Succeeds());
  OtherMesh other;
  ASSERT_TRUE(OpenMesh::IO::read_mesh(other, (folder / "a.stl").string()));
  EXPECT_EQ(other.n_faces(), ground.triangles.size());
  EXPECT_EQ(other.n_vertices(), ground.vertices_mm.size());
  EXPECT_TRUE(closed(other));
  // float: 2e-6 mm at 44 mm over 2000 mm2 of surface, mostly cancelling
  EXPECT_NEAR(volume_mm3(from_other(other)), volume_mm3(ground), 4e-3);
}

TEST_P(WriteHills, ObjIsTheSameSolidForOpenMesh) {
  const ScratchFolder folder;
  ASSERT_THAT(write_obj(ground, folder / "a.obj"), Succeeds());
  OtherMesh other;
  ASSERT_TRUE(OpenMesh::IO::read_mesh(other, (folder / "a.obj").string()));
  const TriMesh back = from_other(other);
  ASSERT_EQ(back.vertices_mm.size(), ground.vertices_mm.size());
  EXPECT_EQ(back.triangles.size(), ground.triangles.size());
  EXPECT_TRUE(closed(other));
  for (std::size_t i = 0; i < back.vertices_mm.size(); ++i)
    // OpenMesh reads OBJ through float: half a step at 64 mm; see below for 1e-6
    ASSERT_LT(norm(back.vertices_mm[i] - ground.vertices_mm[i]), 1e-5);
  EXPECT_GT(volume_mm3(back), 0);
  EXPECT_NEAR(volume_mm3(back) / volume_mm3(ground), 1.0, 1e-6);
}
INSTANTIATE_TEST_SUITE_P(Seeds, WriteHills, testing::Values(1, 2, 3));

TEST(WriteObj, KeepsAMillionthOfAMillimetre) {
  const ScratchFolder folder;
  TriMesh box = box_solid({-1234.567891, 0.0000014, 2000.1234567}, {4001.5, 7, 2001});
  ASSERT_THAT(write_obj(box, folder / "a.obj"), Succeeds());
  std::ifstream in(folder / "a.obj");
  std::string line;
  std::size_t vertex = 0, face = 0;
  bool unit = false;
  while (std::getline(in, line)) {
    unit |= line == "# unit: mm";
    std::istringstream words(line);
    std::string kind;
    words >> kind;
    if (kind == "v") {
      Vec3 v;
      words >> v.x >> v.y >> v.z;
      const Vec3 d = v - box.vertices_mm[vertex++];
      // half a millionth, and what adding it to 4001.5 in double costs
      EXPECT_LE(std::max({std::abs(d.x), std::abs(d.y), std::abs(d.z)}), 0.5e-6 + 1e-12);
    } else if (kind == "f") {
      std::array<std::uint32_t, 3> t{};
      words >> t[0] >> t[1] >> t[2];
      for (auto& corner : t) --corner;
      EXPECT_EQ(t, box.triangles[face++]);
    }
  }
  EXPECT_EQ(vertex, 8U);
  EXPECT_EQ(face, 12U);
  EXPECT_TRUE(unit);
}

std::string micro(double value) {
  fmt::memory_buffer out;
  append_micro(out, value);
  return fmt::to_string(out);
}

TEST(AppendMicro, WritesWhatTheGeneralFormatterWrites) {
  for (std::uint64_t i = 0; i < 100'000; ++i) {
    const double size = std::pow(10.0, 12 * random_uniform(1, 2 * i) - 6);
    const double value = size * (2 * random_uniform(1, 2 * i + 1) - 1);
    const std::string general = fmt::format("{:.6f}", value), fast = micro(value);
    if (general == "-0.000000") {
      EXPECT_EQ(fast, "0.000000");
    } else if (fast != general) {
      // The product value * 1e6 rounds first; a last digit may differ for large values.
      EXPECT_NEAR(std::stod(fast), value, 0.5000001e-6 + 1e-15 * std::abs(value)) << general;
    }
  }
  EXPECT_EQ(micro(0.0), "0.000000");
  EXPECT_EQ(micro(-0.0000004), "0.000000");
  EXPECT_EQ(micro(-0.25), "-0.250000");
  EXPECT_EQ(micro(1234.000001), "1234.000001");
  EXPECT_EQ(micro(1e15), "1000000000000000.000000");
}

TEST(Writers, GiveTheSameBytesForAnyNumberOfThreads) {
  const ScratchFolder folder;
  const TriMesh ground = terrain_solid(400, 0.1, -5, Hills(4, 40, 3));  // 20 pieces
  std::vector<std::string> stl, obj;
  for (const std::size_t threads : {1U, 2U, 5U}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    ASSERT_THAT(write_stl(ground, folder / "a.stl"), Succeeds());
    ASSERT_THAT(write_obj(ground, folder / "a.obj"), Succeeds());
    stl.push_back(sha256_file(folder / "a.stl").value());
    obj.push_back(sha256_file(folder / "a.obj").value());
  }
  EXPECT_THAT(stl, testing::Each(stl.front()));
  EXPECT_THAT(obj, testing::Each(obj.front()));
}

TEST(Writers, JoinTheirPiecesInOrder) {
  // 720 000 triangles: 44 pieces in two batches.
  const ScratchFolder folder;
  const TriMesh ground = terrain_solid(601, 0.25, -5, Hills(4, 150, 3));
  ASSERT_THAT(write_stl(ground, folder / "a.stl"), Succeeds());
  const std::string stl = read_file(folder / "a.stl").value();
  ASSERT_EQ(stl.size(), 84 + 50 * ground.triangles.size());
  for (std::size_t i = 0; i < ground.triangles.size(); ++i)
    for (std::size_t k = 0; k < 3; ++k) {
      const Vec3 v = ground.vertices_mm[ground.triangles[i][k]];
      const std::size_t at = 84 + 50 * i + 12 * (k + 1);
      ASSERT_EQ(float_at(stl, at), static_cast<float>(v.x)) << i;
      ASSERT_EQ(float_at(stl, at + 8), static_cast<float>(v.z)) << i;
    }
  ASSERT_THAT(write_obj(ground, folder / "a.obj"), Succeeds());
  std::ifstream in(folder / "a.obj");
  std::string line;
  std::size_t vertices = 0, faces = 0;
  while (std::getline(in, line)) {
    if (line[0] == 'v') ++vertices;
    if (line[0] != 'f') continue;
    const auto& t = ground.triangles.at(faces++);
    ASSERT_EQ(line, fmt::format("f {} {} {}", t[0] + 1, t[1] + 1, t[2] + 1));
  }
  EXPECT_EQ(vertices, ground.vertices_mm.size());
  EXPECT_EQ(faces, ground.triangles.size());
}

TEST(Writers, RefuseWhatTheyCannotWriteAndLeaveNothing) {
  const ScratchFolder folder;
  const TriMesh nothing, box = box_solid({0, 0, 0}, {1, 1, 1});
  EXPECT_THAT(write_stl(nothing, folder / "a.stl"), FailsWith(kEmptyMesh));
  EXPECT_THAT(write_obj(nothing, folder / "a.obj"), FailsWith(kEmptyMesh));
  EXPECT_THAT(write_stl(box, folder / "no/a.stl"), FailsWith(kFileNotWritable));
  EXPECT_THAT(write_obj(box, folder / "no/a.obj"), FailsWith(kFileNotWritable));
  std::stop_source stop;
  stop.request_stop();
  RunContext run;
  run.stop = stop.get_token();
  EXPECT_THAT(write_stl(box, folder / "a.stl", run), FailsWith(kCancelled));
  EXPECT_THAT(write_obj(box, folder / "a.obj", run), FailsWith(kCancelled));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
  TriMesh broken = box;
  broken.triangles[3][1] = 8;
  EXPECT_THROW((void)write_stl(broken, folder / "a.stl"), CheckFailed);
}

TEST(Writers, StopBetweenPieces) {
  const ScratchFolder folder;
  const TriMesh ground = terrain_solid(801, 0.1, -5, Hills(4, 80, 3));  // three batches
  for (const bool stl : {true, false}) {
    std::stop_source stop;
    RunContext run;
    run.stop = stop.get_token();
    run.progress = [&](double) { stop.request_stop(); };
    const auto result =
        stl ? write_stl(ground, folder / "a.stl", run) : write_obj(ground, folder / "a.obj", run);
    EXPECT_THAT(result, FailsWith(kCancelled));
  }
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

TEST(WithinLimit, CountsToTheLastTriangle) {
  // 2^32 triangles would take 50 GB; the check itself is what can be tested.
  EXPECT_THAT(within_limit(4294967295ULL, kStlTriangleLimit, "triangles", "binary STL", "a.stl"),
              Succeeds());
  const auto result =
      within_limit(4294967296ULL, kStlTriangleLimit, "triangles", "binary STL", "a.stl");
  ASSERT_THAT(result, FailsWith(kTooManyTriangles));
  EXPECT_THAT(result.error().message, testing::HasSubstr("4294967296"));
}

}  // namespace
}  // namespace maquette::exporting

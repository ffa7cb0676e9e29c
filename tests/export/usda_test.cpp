// SPDX-License-Identifier: GPL-3.0-or-later

// export/cad.hpp, write_usda (three.js reads such a file in tests/web/engine.mjs):
//   arrays ........................... read by hand: counts, corners, and each coordinate the float
//                                      of the mesh's
//   stage ............................ unit, up axis, default prim, extent, no subdivision
//   names ............................ what is no identifier becomes one
//   same bytes for any thread count; nothing is left of what was stopped or cannot be written

#include <charconv>

#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <tbb/global_control.h>

#include "core/files.hpp"
#include "export/cad.hpp"
#include "support/matchers.hpp"
#include "support/simple_solids.hpp"

namespace maquette::exporting {
namespace {

using testing::HasSubstr;
using testing_support::box_solid;
using testing_support::FailsWith;
using testing_support::Hills;
using testing_support::ScratchFolder;
using testing_support::Succeeds;
using testing_support::terrain_solid;

/// Numbers between the brackets behind `name = [`.
template <class T>
std::vector<T> numbers_of(const std::string& text, const std::string& name) {
  std::vector<T> numbers;
  std::size_t at = text.find(" " + name + " = [");
  if (at == std::string::npos) return numbers;
  at += name.size() + 5;
  const std::size_t end = text.find(']', at);
  while (at < end) {
    T value{};
    const auto [next, error] = std::from_chars(text.data() + at, text.data() + end, value);
    if (error == std::errc{}) {
      numbers.push_back(value);
      at = static_cast<std::size_t>(next - text.data());
    } else {
      EXPECT_THAT(std::string("(), "), HasSubstr(text.substr(at, 1)));
      ++at;
    }
  }
  return numbers;
}

TEST(WriteUsda, HasTheMesh) {
  const ScratchFolder folder;
  // 33 800 triangles: some pieces.
  const TriMesh ground = terrain_solid(131, 0.37, -12.25, Hills(3, 44, 3));
  ASSERT_THAT(write_usda(ground, "part", folder / "a.usda"), Succeeds());
  const std::string text = read_file(folder / "a.usda").value();
  EXPECT_EQ(text.substr(0, 10), "#usda 1.0\n");
  for (const char* line :
       {"metersPerUnit = 0.001\n", "upAxis = \"Z\"\n", "defaultPrim = \"part\"\n",
        "uniform token subdivisionScheme = \"none\"\n", "rel material:binding = </part/paint>\n"})
    EXPECT_THAT(text, HasSubstr(line));
  EXPECT_EQ(numbers_of<int>(text, "int[] faceVertexCounts"),
            std::vector<int>(ground.triangles.size(), 3));
  const auto corners = numbers_of<std::uint32_t>(text, "int[] faceVertexIndices");
  ASSERT_EQ(corners.size(), 3 * ground.triangles.size());
  for (std::size_t i = 0; i < corners.size(); ++i)
    ASSERT_EQ(corners[i], ground.triangles[i / 3][i % 3]) << i;
  const auto points = numbers_of<float>(text, "point3f[] points");
  ASSERT_EQ(points.size(), 3 * ground.vertices_mm.size());
  for (std::size_t i = 0; i < ground.vertices_mm.size(); ++i) {
    const Vec3 v = ground.vertices_mm[i];
    ASSERT_EQ(points[3 * i], static_cast<float>(v.x));
    ASSERT_EQ(points[3 * i + 1], static_cast<float>(v.y));
    ASSERT_EQ(points[3 * i + 2], static_cast<float>(v.z));
  }
  const Box3 box = ground.bounds();
  const auto f = [](double x) { return static_cast<float>(x); };
  EXPECT_EQ(numbers_of<float>(text, "float3[] extent"),
            (std::vector<float>{f(box.min.x), f(box.min.y), f(box.min.z), f(box.max.x),
                                f(box.max.y), f(box.max.z)}));
  // As many ends as beginnings.
  EXPECT_EQ(std::count(text.begin(), text.end(), '{'), std::count(text.begin(), text.end(), '}'));
}

TEST(WriteUsda, NamesPrimsByIdentifiers) {
  const ScratchFolder folder;
  const TriMesh box = box_solid({0, 0, 0}, {1, 2, 3});
  for (const auto& [name, id] :
       {std::pair{"band 02.a", "band_02_a"}, {"1000", "_1000"}, {"", "_"}}) {
    ASSERT_THAT(write_usda(box, name, folder / "a.usda"), Succeeds());
    EXPECT_THAT(read_file(folder / "a.usda").value(),
                HasSubstr(std::string("def Xform \"") + id + "\" ("));
  }
}

TEST(WriteUsda, GivesTheSameBytesForAnyNumberOfThreads) {
  const ScratchFolder folder;
  const TriMesh ground = terrain_solid(400, 0.1, -5, Hills(4, 40, 3));
  std::vector<std::string> hashes;
  for (const std::size_t threads : {1U, 2U, 5U}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    ASSERT_THAT(write_usda(ground, "a", folder / "a.usda"), Succeeds());
    hashes.push_back(sha256_file(folder / "a.usda").value());
  }
  EXPECT_THAT(hashes, testing::Each(hashes.front()));
}

TEST(WriteUsda, LeavesNothingOfWhatItCannotWrite) {
  const ScratchFolder folder;
  const TriMesh nothing, box = box_solid({0, 0, 0}, {1, 1, 1});
  EXPECT_THAT(write_usda(nothing, "a", folder / "a.usda"), FailsWith(kEmptyMesh));
  EXPECT_THAT(write_usda(box, "a", folder / "no/a.usda"), FailsWith(kFileNotWritable));
  std::stop_source stop;
  stop.request_stop();
  RunContext run;
  run.stop = stop.get_token();
  EXPECT_THAT(write_usda(box, "a", folder / "a.usda", run), FailsWith(kCancelled));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

}  // namespace
}  // namespace maquette::exporting

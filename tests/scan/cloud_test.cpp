// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in scan/cloud.hpp, and how each claim is attacked:
//
//   what is written is read .......... round trip to the bit, every combination of parts
//   PLY kinds and types .............. hand-made files: ascii, both byte orders, integers,
//                                      floats, lists, elements before and after
//   XYZ and CSV ...................... columns by count and by name, separators, comments
//   every code, with its place ....... one case each; messages name line, byte or index
//   hostile headers .................. counts beyond the file fail at once, not after
//                                      taking memory
//   any bytes at all ................. thousands of mutations of good files: a cloud or one
//                                      of our errors, all points finite

#include "scan/cloud.hpp"

#include <bit>
#include <cmath>
#include <cstring>
#include <fstream>
#include <stop_token>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/files.hpp"
#include "core/random.hpp"
#include "scan/detail/cloud_parts.hpp"
#include "support/matchers.hpp"

namespace maquette::scan {
namespace {

using testing::HasSubstr;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

/// Without the flush to disk of write_file, which would be most of the time here.
void put_file(const std::filesystem::path& path, std::string_view content) {
  std::ofstream(path, std::ios::binary) << content;
}

Result<Cloud> read_text(const char* name, std::string_view content) {
  const ScratchFolder folder;
  put_file(folder / name, content);
  return read_cloud(folder / name);
}

Result<Cloud> read_bytes(const std::string& name, std::string_view bytes) {
  MAQUETTE_TRY(const auto reader, detail::open_source(detail::ByteSource(bytes, name), {}));
  return detail::read_all(*reader, name, {});
}

template <class T>
void put(std::string& bytes, T value, bool big) {
  std::array<char, sizeof(T)> raw;
  std::memcpy(raw.data(), &value, sizeof value);
  if (big) std::reverse(raw.begin(), raw.end());
  bytes.append(raw.data(), raw.size());
}

Cloud sample_cloud(std::size_t n) {
  Cloud cloud;
  for (std::uint64_t i = 0; i < n; ++i) {
    cloud.points_mm.push_back({random_normal(1, 3 * i) * 1e3, random_normal(1, 3 * i + 1) * 1e-7,
                               random_normal(1, 3 * i + 2)});
    cloud.intensity.push_back(static_cast<float>(random_uniform(2, i)));
    cloud.normals.push_back(normalized(
        Vec3{random_normal(3, 3 * i), random_normal(3, 3 * i + 1), random_normal(3, 3 * i + 2)}));
  }
  cloud.station_mm = Vec3{0.1, -1500.0 / 7.0, 1e-300};
  return cloud;
}

TEST(Cloud, ReadsWhatWasWrittenToTheBit) {
  const ScratchFolder folder;
  for (int parts = 0; parts < 8; ++parts) {
    Cloud cloud = sample_cloud(100);
    if ((parts & 1) == 0) cloud.intensity.clear();
    if ((parts & 2) == 0) cloud.normals.clear();
    if ((parts & 4) == 0) cloud.station_mm.reset();
    ASSERT_THAT(write_cloud(cloud, folder / "cloud.ply"), Succeeds());
    const auto back = read_cloud(folder / "cloud.ply");
    ASSERT_THAT(back, Succeeds());
    EXPECT_EQ(back->points_mm, cloud.points_mm);
    EXPECT_EQ(back->intensity, cloud.intensity);
    EXPECT_EQ(back->station_mm, cloud.station_mm);
    ASSERT_EQ(back->normals.size(), cloud.normals.size());
    // Bringing a unit vector to unit length again costs an ulp or two.
    for (std::size_t i = 0; i < cloud.normals.size(); ++i)
      EXPECT_NEAR(norm(back->normals[i] - cloud.normals[i]), 0.0, 4e-16);
  }
}

TEST(Cloud, WritesTheSameBytes) {
  const ScratchFolder folder;
  ASSERT_THAT(write_cloud(sample_cloud(50), folder / "a.ply"), Succeeds());
  ASSERT_THAT(write_cloud(sample_cloud(50), folder / "b.ply"), Succeeds());
  EXPECT_EQ(*sha256_file(folder / "a.ply"), *sha256_file(folder / "b.ply"));
}

TEST(Cloud, SaysWhenItCannotWrite) {
  EXPECT_THAT(write_cloud(sample_cloud(5), "/nonexistent-folder/cloud.ply"),
              FailsWith(kFileNotWritable));
}

// ---- PLY -------------------------------------------------------------------

TEST(CloudPly, ReadsAsciiWithPropertiesInAnyOrder) {
  const auto cloud =
      read_text("a.ply",
                "ply\r\nformat ascii 1.0\r\ncomment scanner_position_mm 80 -900.5 9e2\r\n"
                "obj_info made by hand\r\nelement camera 1\r\nproperty list uchar int ids\r\n"
                "element vertex 2\r\nproperty float z\r\nproperty uchar red\r\n"
                "property double x\r\nproperty float scalar_Intensity\r\n"
                "property short y\r\nelement face 7\r\n"
                "property list uchar int vertex_indices\r\nend_header\r\n"
                "3 1 2 3\r\n0.5 255 +1.25 0.75 -3\r\n-1e-3 0 2 1 4\r\nno faces\r\n");
  ASSERT_THAT(cloud, Succeeds());
  EXPECT_THAT(cloud->points_mm, testing::ElementsAre(Vec3{1.25, -3.0, 0.5}, Vec3{2.0, 4.0, -1e-3}));
  EXPECT_THAT(cloud->intensity, testing::ElementsAre(0.75F, 1.0F));
  EXPECT_EQ(cloud->station_mm, (Vec3{80.0, -900.5, 900.0}));
  EXPECT_TRUE(cloud->normals.empty());
}

TEST(CloudPly, ReadsBothByteOrdersAndAllTypes) {
  for (const bool big : {false, true}) {
    std::string bytes = std::string("ply\nformat ") +
                        (big ? "binary_big_endian" : "binary_little_endian") +
                        " 1.0\nelement junk 2\nproperty list ushort double values\n"
                        "element vertex 2\nproperty double x\nproperty int y\nproperty float z\n"
                        "property list uchar short tags\nproperty char a\nproperty uint b\n"
                        "property ushort intensity\nproperty float nx\nproperty float ny\n"
                        "property float nz\nend_header\n";
    put<std::uint16_t>(bytes, 0, big);
    put<std::uint16_t>(bytes, 2, big);
    put<double>(bytes, 1.0, big);
    put<double>(bytes, 2.0, big);
    for (int i = 0; i < 2; ++i) {
      put<double>(bytes, 0.1 + i, big);
      put<std::int32_t>(bytes, -70000 * (i + 1), big);
      put<float>(bytes, 0.25F, big);
      put<std::uint8_t>(bytes, static_cast<std::uint8_t>(i), big);
      for (int k = 0; k < i; ++k) put<std::int16_t>(bytes, 9, big);
      put<std::int8_t>(bytes, -1, big);
      put<std::uint32_t>(bytes, 4'000'000'000U, big);
      put<std::uint16_t>(bytes, 300, big);
      for (const float n : {0.0F, 3.0F, 4.0F}) put<float>(bytes, i == 0 ? n : 0.0F, big);
    }
    const auto cloud = read_text("a.PLY", bytes);
    ASSERT_THAT(cloud, Succeeds());
    EXPECT_THAT(cloud->points_mm,
                testing::ElementsAre(Vec3{0.1, -70000.0, 0.25}, Vec3{1.1, -140000.0, 0.25}));
    EXPECT_THAT(cloud->intensity, testing::Each(300.0F));
    ASSERT_EQ(cloud->normals.size(), 2U);
    EXPECT_NEAR(norm(cloud->normals[0] - Vec3{0.0, 0.6, 0.8}), 0.0, 1e-15) << "to unit length";
    EXPECT_EQ(cloud->normals[1], Vec3{}) << "unknown stays unknown";
  }
}

struct BadFile {
  const char* name;
  std::string content;
  ErrorCode code;
  const char* says;
};

const std::string kXyz = "property double x\nproperty double y\nproperty double z\n";
const std::string kAscii = "ply\nformat ascii 1.0\n";

class CloudRefuses : public testing::TestWithParam<BadFile> {};

TEST_P(CloudRefuses, AndSaysWhereAndWhat) {
  const BadFile& bad = GetParam();
  const auto cloud = read_text(bad.name, bad.content);
  ASSERT_THAT(cloud, FailsWith(bad.code));
  EXPECT_THAT(cloud.error().message, HasSubstr(bad.says));
  EXPECT_THAT(cloud.error().message, HasSubstr(bad.name));
}

INSTANTIATE_TEST_SUITE_P(
    Files, CloudRefuses,
    testing::Values(
        BadFile{"a.ply", "", kCloudFormat, "line 1: expected 'ply'"},
        BadFile{"b.ply", "plyx\n", kCloudFormat, "line 1"},
        BadFile{"c.ply", "ply\nformat ascii 1.0\n", kCloudFormat, "no end_header"},
        BadFile{"d.ply", "ply\nelement vertex 1\n" + kXyz + "end_header\n0 0 0\n", kCloudFormat,
                "no format"},
        BadFile{"e.ply", "ply\nformat utf8 1.0\nend_header\n", kCloudFormat,
                "line 2: unknown format 'utf8'"},
        BadFile{"f.ply", kAscii + "element vertex -1\n" + kXyz + "end_header\n", kCloudFormat,
                "line 3: expected 'element NAME COUNT'"},
        BadFile{"g.ply", kAscii + "element vertex 1\nproperty quad x\nend_header\n", kCloudFormat,
                "line 4: unknown property type 'quad'"},
        BadFile{"h.ply",
                kAscii + "element vertex 1\nproperty float x\nproperty float y\nend_header\n1 2\n",
                kCloudFormat, "x, y and z"},
        BadFile{"i.ply", kAscii + "element face 0\nproperty float x\nend_header\n", kCloudFormat,
                "no element vertex"},
        BadFile{"j.ply", kAscii + "property float x\nend_header\n", kCloudFormat,
                "before any element"},
        BadFile{"k.ply", kAscii + "element vertex 2\n" + kXyz + "end_header\n0 0 0\n", kCloudFormat,
                "promises 2"},
        BadFile{"l.ply", kAscii + "element vertex 2\n" + kXyz + "end_header\n0 0 000000\n",
                kCloudFormat, "line 9: the file ends before vertex 1 of 2"},
        BadFile{"m.ply", kAscii + "element vertex 2\n" + kXyz + "end_header\n0 0 0\n1 2\n0 0 0\n",
                kCloudFormat, "line 9: expected 3 values"},
        BadFile{"n.ply", kAscii + "element vertex 1\n" + kXyz + "end_header\n0 0 0 0\n",
                kCloudFormat, "line 8: '0' after the last property"},
        BadFile{"o.ply", kAscii + "element vertex 1\n" + kXyz + "end_header\n0 zero 0\n",
                kCloudFormat, "'zero'"},
        BadFile{"p.ply", kAscii + "element vertex 1\n" + kXyz + kXyz + "end_header\n0 0 0 0 0 0\n",
                kCloudFormat, "declared twice"},
        BadFile{"q.ply", kAscii + "element vertex 1\nelement vertex 1\nend_header\n", kCloudFormat,
                "declared twice"},
        BadFile{"r.ply", kAscii + "comment scanner_position_mm 1 2\nend_header\n", kCloudFormat,
                "line 3: scanner_position_mm needs three"},
        BadFile{"s.ply", kAscii + "element vertex 1\nproperty list float int x\nend_header\n",
                kCloudFormat, "integer type for a list"},
        BadFile{"t.ply", kAscii + "element vertex 0\n" + kXyz + "end_header\n", kCloudEmpty,
                "no points"},
        BadFile{"u.ply", kAscii + "element vertex 2\n" + kXyz + "end_header\n0 0 0\n0 nan 0\n",
                kCloudNotFinite, "point 1 "},
        BadFile{"v.ply", kAscii + "element vertex 2\n" + kXyz + "end_header\n-inf 0 0\n0 0 0\n",
                kCloudNotFinite, "point 0 "},
        BadFile{"w.ply", kAscii + "element vertex 1\n" + kXyz + "end_header\n1e200 0 0\n",
                kCloudNotFinite, "1e+200"},
        BadFile{"x.ply", kAscii + "element a 5\nelement vertex 1\n" + kXyz + "end_header\n1 0 0\n",
                kCloudFormat, "no properties"},
        BadFile{"y.ply", kAscii + "surprise\nend_header\n", kCloudFormat,
                "line 3: unexpected 'surprise'"},
        BadFile{"a.xyz", "", kCloudEmpty, "no points"},
        BadFile{"b.xyz", "# only\n\n// comments\n", kCloudEmpty, "no points"},
        BadFile{"c.xyz", "1 2\n", kCloudFormat, "line 1: 2 columns"},
        BadFile{"d.xyz", "1 2 3\n\n4 5\n", kCloudFormat, "line 3: expected 3 columns, got 2"},
        BadFile{"e.xyz", "1 2 3\n4 5 six\n", kCloudFormat, "line 2: column 3: 'six'"},
        BadFile{"f.xyz", "1 2 3\nnan 5 6\n", kCloudNotFinite, "point 1 "},
        BadFile{"a.csv", "a,b,c\n1,2,3\n", kCloudFormat, "line of names"},
        BadFile{"b.csv", "x,y,z,x\n1,2,3,4\n", kCloudFormat, "stands twice"},
        BadFile{"c.csv", "x,y,z\n1,,3\n", kCloudFormat, "line 2: column 2: '' is no number"},
        BadFile{"d.csv", "x;y;z\n1,5;2;3\n", kCloudFormat, "'1,5' is no number"},
        BadFile{"e.csv", "x,y,z\n1,2,1e999\n", kCloudFormat, "no number"},
        BadFile{"a.dat", "whatever", kCloudFormat, "convert the file"}),
    [](const auto& bad) {
      std::string name = bad.param.name;
      name[1] = '_';
      return name;
    });

TEST(CloudPly, RefusesCountsBeyondTheFileBeforeTakingMemory) {
  for (const char* count : {"1000000000000", "18446744073709551615", "4294967296", "3"}) {
    for (const char* kind : {"ascii", "binary_little_endian", "binary_big_endian"}) {
      const auto cloud =
          read_text("a.ply", std::string("ply\nformat ") + kind + " 1.0\nelement vertex " + count +
                                 "\n" + kXyz + "end_header\n0 0 0\n0 0 0");
      ASSERT_THAT(cloud, FailsWith(kCloudFormat));
      EXPECT_THAT(cloud.error().message, HasSubstr("promises"));
    }
  }
  // A list that claims 4 G entries.
  std::string bytes =
      "ply\nformat binary_little_endian 1.0\nelement vertex 1\nproperty list uint double l\n" +
      kXyz + "end_header\n";
  put<std::uint32_t>(bytes, 0xFFFFFFFFU, false);
  bytes.append(100, '\0');
  EXPECT_THAT(read_text("a.ply", bytes), FailsWith(kCloudFormat));
}

TEST(Cloud, SaysThatThereIsNoFile) {
  EXPECT_THAT(read_cloud("/nonexistent/cloud.ply"), FailsWith(kFileNotFound));
}

TEST(Cloud, StopsWhenAsked) {
  const ScratchFolder folder;
  ASSERT_THAT(write_cloud(sample_cloud(50), folder / "a.ply"), Succeeds());
  ASSERT_THAT(write_file(folder / "a.xyz", "1 2 3\n"), Succeeds());
  std::stop_source stop;
  stop.request_stop();
  RunContext run;
  run.stop = stop.get_token();
  EXPECT_THAT(read_cloud(folder / "a.ply", run), FailsWith(kCancelled));
  EXPECT_THAT(read_cloud(folder / "a.xyz", run), FailsWith(kCancelled));
}

// ---- text ------------------------------------------------------------------

TEST(CloudText, ReadsColumnsByCount) {
  const auto three =
      read_text("a.xyz", "\xEF\xBB\xBF# scanner_position_mm 1 2 3\n 1 2\t3 \r\n\n4,5,6\n");
  ASSERT_THAT(three, Succeeds());
  EXPECT_THAT(three->points_mm, testing::ElementsAre(Vec3{1, 2, 3}, Vec3{4, 5, 6}));
  EXPECT_EQ(three->station_mm, (Vec3{1, 2, 3}));
  const auto seven = read_text("a.txt", "1 2 3 0.5 0 0 2");
  ASSERT_THAT(seven, Succeeds());
  EXPECT_THAT(seven->intensity, testing::ElementsAre(0.5F));
  EXPECT_THAT(seven->normals, testing::ElementsAre(Vec3{0, 0, 1}));
  const auto six = read_text("a.asc", "1 2 3 0 2 0\n");
  ASSERT_THAT(six, Succeeds());
  EXPECT_THAT(six->normals, testing::ElementsAre(Vec3{0, 1, 0}));
}

TEST(CloudText, ReadsColumnsByName) {
  const auto csv =
      read_text("a.csv", "name,\"Z_mm\", x_mm ,Intensity,Y_mm\nfirst,3,1,0.25,2\n,6, 4 ,1,5\n");
  ASSERT_THAT(csv, Succeeds());
  EXPECT_THAT(csv->points_mm, testing::ElementsAre(Vec3{1, 2, 3}, Vec3{4, 5, 6}));
  EXPECT_THAT(csv->intensity, testing::ElementsAre(0.25F, 1.0F));
  const auto semicolon = read_text("a.csv", "x;y;z\n1;2;3\n");
  ASSERT_THAT(semicolon, Succeeds());
  EXPECT_THAT(semicolon->points_mm, testing::ElementsAre(Vec3{1, 2, 3}));
  const auto bare = read_text("a.csv", "1,2,3\n4,5,6\n");
  ASSERT_THAT(bare, Succeeds());
  EXPECT_EQ(bare->points_mm.size(), 2U);
}

// ---- any bytes -------------------------------------------------------------

class CloudMutated : public testing::TestWithParam<int> {};
INSTANTIATE_TEST_SUITE_P(Seed, CloudMutated, testing::Range(1, 13));

TEST_P(CloudMutated, IsACloudOrAnErrorOfOurs) {
  const ScratchFolder folder;
  const auto seed = static_cast<std::uint64_t>(GetParam());
  ASSERT_THAT(write_cloud(sample_cloud(20), folder / "good.ply"), Succeeds());
  const std::vector<std::pair<std::string, std::string>> good = {
      {"m.ply", *read_file(folder / "good.ply")},
      {"m.ply", kAscii +
                    "comment scanner_position_mm 1 2 3\nelement junk 2\nproperty list uchar int a\n"
                    "element vertex 3\n" +
                    kXyz +
                    "property float intensity\nend_header\n"
                    "2 1 1\n0\n1 2 3 4\n5.5 6 7 1e2\n-1 -2 -3 0\n"},
      {"m.xyz", "# scanner_position_mm 1 2 3\n1 2 3 0.5\n4 5 6 0.25\n7 8 9 1\n"},
      {"m.csv", "x,y,z,intensity\n1,2,3,0.5\n4,5,6,0.25\n"}};
  std::uint64_t draw = 0;
  const auto index = [&](std::size_t n) {
    return static_cast<std::size_t>(random_bits(seed, draw++) % std::max<std::size_t>(1, n));
  };
  int clouds = 0, errors = 0;
  const std::string_view spice = "0123456789-+.eE \n\r\t,;#nainf\xFF";
  for (int i = 0; i < 4000; ++i) {
    auto [name, bytes] = good[index(good.size())];
    const auto splice = [&text = bytes](std::size_t at, std::string_view piece) {
      std::string longer(text, 0, at);
      longer += piece;
      longer += std::string_view(text).substr(at);
      text = std::move(longer);
    };
    for (std::size_t k = 1 + index(4); k > 0; --k) {
      const std::size_t at = index(bytes.size());
      switch (index(6)) {
        case 0:
          bytes[at] = static_cast<char>(random_bits(seed, draw++));
          break;
        case 1:
          splice(at, spice.substr(index(spice.size()), 1));
          break;
        case 2:
          bytes.erase(at, 1 + index(20));
          break;
        case 3:
          bytes.erase(at);
          break;
        case 4:
          splice(at, std::string(bytes.substr(index(bytes.size()), index(60))));
          break;
        default:
          bytes[at] = static_cast<char>(bytes[at] ^ (1 << index(8)));
      }
      if (bytes.empty()) break;
    }
    // From memory: thousands of small files would be all that this test waits for.
    const auto cloud = read_bytes(name, bytes);
    if (!cloud) {
      const ErrorCode code = cloud.error().code;
      ASSERT_TRUE(code == kCloudFormat || code == kCloudEmpty || code == kCloudNotFinite)
          << code.name;
      ++errors;
      continue;
    }
    ++clouds;
    ASSERT_FALSE(cloud->points_mm.empty());
    ASSERT_TRUE(cloud->intensity.empty() || cloud->intensity.size() == cloud->points_mm.size());
    ASSERT_TRUE(cloud->normals.empty() || cloud->normals.size() == cloud->points_mm.size());
    for (const Vec3& p : cloud->points_mm)
      ASSERT_TRUE(std::abs(p.x) <= kLargestCoordinateMm && std::abs(p.y) <= kLargestCoordinateMm &&
                  std::abs(p.z) <= kLargestCoordinateMm);
  }
  EXPECT_GT(clouds, 100) << "mutations that never survive test little";
  EXPECT_GT(errors, 100);
}

}  // namespace
}  // namespace maquette::scan

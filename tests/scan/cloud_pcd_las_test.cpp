// SPDX-License-Identifier: GPL-3.0-or-later

// PCD and LAS, as scan/cloud_stream.hpp claims them:
//
//   files made by hand ............... all point formats of LAS 1.2 to 1.4 with extra bytes and
//                                      records before the points; PCD as text, records and packed,
//                                      with grids, rgb as float and as integer, fields of others
//   what is written is read .......... all fields the formats hold, all encodings and versions
//   LZF .............................. round trips, a stream made by hand, damaged streams
//   every error, with its place ...... one case each; counts beyond the file at once
//   any bytes at all ................. mutations: a cloud or one of our errors

#include <bit>
#include <cmath>
#include <cstring>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/files.hpp"
#include "scan/cloud_stream.hpp"
#include "scan/detail/lzf.hpp"
#include "support/matchers.hpp"
#include "support/mutations.hpp"
#include "support/streamed_cloud.hpp"

namespace maquette::scan {
namespace {

using namespace testing_support;
using testing::Each;
using testing::ElementsAre;
using testing::HasSubstr;

template <class T>
void put(std::string& bytes, T value) {
  std::array<char, sizeof(T)> raw;
  std::memcpy(raw.data(), &value, sizeof value);
  bytes.append(raw.data(), raw.size());
}

template <class T>
void set(std::string& bytes, std::size_t at, T value) {
  std::memcpy(bytes.data() + at, &value, sizeof value);
}

// ---- LZF -------------------------------------------------------------------

TEST(Lzf, ReadsAStreamMadeByHand) {
  // "abc" as literals; a copy of 6 from 3 back; "x"; a copy of 2 + 7 + 4 = 13 from 1 back.
  const std::string packed("\2abc\x80\2\0x\xE0\4\0", 11);
  const std::string text = "abcabcabcx" + std::string(13, 'x');
  EXPECT_EQ(detail::lzf_decompress(packed, text.size()), text);
  EXPECT_FALSE(detail::lzf_decompress(packed, text.size() + 1));
  EXPECT_FALSE(detail::lzf_decompress(packed, text.size() - 1));
  EXPECT_FALSE(detail::lzf_decompress(packed.substr(0, 10), text.size()));
  EXPECT_FALSE(detail::lzf_decompress(packed.substr(0, 3), 3));
  EXPECT_FALSE(detail::lzf_decompress(std::string("\0a\x20\1", 4), 4)) << "before the beginning";
  EXPECT_FALSE(detail::lzf_decompress("", std::size_t{1} << 60)) << "not after taking memory";
}

TEST(Lzf, GivesBackWhatItPacked) {
  for (std::uint64_t seed = 1; seed <= 40; ++seed) {
    std::string bytes;
    const std::size_t size = random_bits(seed, 0) % 30'000;
    const std::uint64_t letters = 1 + random_bits(seed, 1) % 250;
    for (std::size_t i = 0; bytes.size() < size; ++i) {
      bytes += static_cast<char>(random_bits(seed, 2 * i + 2) % letters);
      if (random_bits(seed, 2 * i + 3) % 50 == 0)
        bytes += bytes.substr(random_bits(seed, i) % bytes.size(), 400);
    }
    const std::string packed = detail::lzf_compress(bytes);
    EXPECT_EQ(detail::lzf_decompress(packed, bytes.size()), bytes) << seed;
    EXPECT_LE(packed.size(), bytes.size() + bytes.size() / 32 + 1);
  }
  EXPECT_LT(detail::lzf_compress(std::string(100'000, 'a')).size(), 1300U);
}

// ---- PCD -------------------------------------------------------------------

const std::string kHead = "# .PCD v0.7 - Point Cloud Data file format\nVERSION 0.7\n";

TEST(Pcd, ReadsTextMadeByHand) {
  const float packed_red = std::bit_cast<float>(0x00FF8001U);
  const auto cloud = stream_bytes(
      "a.pcd", kHead +
                   "FIELDS x y z rgb intensity vfh normal_x normal_y normal_z\n"
                   "SIZE 4 4 4 4 4 4 4 4 4\nTYPE F F F F F F F F F\nCOUNT 1 1 1 1 1 2 1 1 1\n"
                   "WIDTH 2\nHEIGHT 1\nVIEWPOINT 1 2 3 1 0 0 0\nPOINTS 2\nDATA ascii\n"
                   "1 2 3 " +
                   std::to_string(packed_red) + " 0.5 9 9 0 0 2\n4 5 6 0 1 9 9 0 3 4\n");
  ASSERT_THAT(cloud, Succeeds());
  EXPECT_EQ(cloud->format, "PCD");
  EXPECT_THAT(cloud->points[0].points_mm, ElementsAre(Vec3{1, 2, 3}, Vec3{4, 5, 6}));
  EXPECT_EQ(cloud->stations[0].position_mm, (Vec3{1, 2, 3}));
  EXPECT_THAT(cloud->points[0].intensity, ElementsAre(0.5F, 1.0F));
  EXPECT_EQ(cloud->points[0].normals[0], (Vec3{0, 0, 1}));
  EXPECT_NEAR(norm(cloud->points[0].normals[1] - Vec3{0, 0.6, 0.8}), 0.0, 1e-15);
  EXPECT_EQ(cloud->points[0].colours.size(), 2U);
}

TEST(Pcd, ReadsColoursAsFloatsAndAsIntegers) {
  const auto colour = [](const char* type, const std::string& value) {
    const auto cloud = stream_bytes(
        "a.pcd", kHead + "FIELDS x y z rgba\nSIZE 4 4 4 4\nTYPE F F F " + type +
                     "\nWIDTH 1\nHEIGHT 1\nPOINTS 1\nDATA ascii\n1 2 3 " + value + "\n");
    return cloud ? cloud->points[0].colours.at(0) : Colour{};
  };
  const Colour wanted{0x12 * 257, 0x34 * 257, 0x56 * 257};
  EXPECT_EQ(colour("U", std::to_string(0x123456)), wanted);
  EXPECT_EQ(colour("U", std::to_string(0xFF123456U)), wanted) << "alpha is ignored";
  std::array<char, 40> text{};
  std::snprintf(text.data(), text.size(), "%.9g",
                static_cast<double>(std::bit_cast<float>(0x00123456U)));
  EXPECT_EQ(colour("F", text.data()), wanted);
}

TEST(Pcd, ReadsRecordsAndPackedFieldsOfAGrid) {
  // 2 rows of 3: label (2 bytes, not ours), x as float, y as double, z as int16, rgb.
  const std::string head =
      kHead +
      "FIELDS label x y z rgb\nSIZE 2 4 8 2 4\nTYPE U F F I F\n"
      "COUNT 1 1 1 1 1\nWIDTH 3\nHEIGHT 2\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 6\n";
  std::array<std::string, 5> columns;
  std::string records;
  for (int i = 0; i < 6; ++i) {
    std::array<std::string, 5> f;
    put(f[0], static_cast<std::uint16_t>(7));
    put(f[1], i == 4 ? NAN : 0.5F * static_cast<float>(i));
    put(f[2], 0.1 * i);
    put(f[3], static_cast<std::int16_t>(-i));
    put(f[4], 0x010203U * static_cast<unsigned>(i));
    for (std::size_t k = 0; k < 5; ++k) {
      records += f[k];
      columns[k] += f[k];
    }
  }
  std::string all;
  for (const auto& c : columns) all += c;
  std::string packed;
  const std::string lzf = detail::lzf_compress(all);
  put(packed, static_cast<std::uint32_t>(lzf.size()));
  put(packed, static_cast<std::uint32_t>(all.size()));
  packed += lzf;
  for (const auto& text :
       {head + "DATA binary\n" + records, head + "DATA binary_compressed\n" + packed})
    for (const std::size_t batch : {1U, 4U, 100U}) {
      const auto cloud = stream_bytes("a.pcd", text, {.unit_mm = 10.0, .batch_points = batch});
      ASSERT_THAT(cloud, Succeeds());
      EXPECT_EQ(cloud->stations[0].rows, 2U);
      EXPECT_EQ(cloud->stations[0].columns, 3U);
      EXPECT_FALSE(cloud->stations[0].position_mm);
      const PointBatch& p = cloud->points[0];
      ASSERT_EQ(p.size(), 6U);
      EXPECT_EQ(p.points_mm[5], (Vec3{25.0, 10.0 * (0.1 * 5), -50.0}));
      EXPECT_EQ(p.grid[5], (GridIndex{1, 2}));
      EXPECT_EQ(p.grid[2], (GridIndex{0, 2}));
      EXPECT_EQ(p.colours[3], (Colour{3 * 257, 6 * 257, 9 * 257}));
      EXPECT_THAT(p.flags, ElementsAre(0, 0, 0, 0, kNoPosition, 0));
      EXPECT_EQ(p.points_mm[4], Vec3{});
    }
}

TEST(Pcd, HoldsItsFieldsInEveryEncoding) {
  const ScratchFolder folder;
  CloudFields f = all_fields();
  f.scan_angle = false;
  for (const auto encoding : {CloudWriteOptions::Pcd::binary, CloudWriteOptions::Pcd::ascii,
                              CloudWriteOptions::Pcd::binary_compressed}) {
    StreamedCloud cloud;
    cloud.stations = {sample_station(f, 20, 30, 1)};
    cloud.stations[0].model_from_station = {};
    cloud.points = {sample_points(f, 20, 30, 1)};
    CloudWriteOptions options;
    options.pcd = encoding;
    ASSERT_THAT(stream_out(cloud, folder / "a.pcd", options), Succeeds());
    const auto back = stream_in(folder / "a.pcd");
    ASSERT_THAT(back, Succeeds());
    EXPECT_EQ(back->stations[0].fields, f);
    EXPECT_EQ(back->stations[0].position_mm, cloud.stations[0].position_mm);
    const PointBatch &p = cloud.points[0], &q = back->points[0];
    EXPECT_EQ(q.points_mm, p.points_mm);
    EXPECT_EQ(q.intensity, p.intensity);
    EXPECT_EQ(q.colours, p.colours);
    EXPECT_EQ(q.grid, p.grid);
    EXPECT_EQ(q.time_s, p.time_s);
    EXPECT_EQ(q.return_index, p.return_index);
    EXPECT_EQ(q.return_count, p.return_count);
    for (std::size_t i = 0; i < p.size(); ++i)
      ASSERT_NEAR(norm(q.normals[i] - p.normals[i]), 0.0, 1.5e-7);
    cloud.stations.push_back(cloud.stations[0]);
    cloud.points.push_back(cloud.points[0]);
    ASSERT_THAT(stream_out(cloud, folder / "b.pcd", options), Succeeds());
    const auto two = stream_in(folder / "b.pcd");
    ASSERT_THAT(two, Succeeds());
    EXPECT_EQ(two->points[0].size(), 1200U);
    EXPECT_FALSE(two->stations[0].position_mm);
  }
}

// ---- LAS -------------------------------------------------------------------

constexpr std::array<std::size_t, 11> kLasBytes{20, 28, 26, 34, 57, 63, 30, 36, 38, 59, 67};

/// `points` points of one format in a file of version 1.minor, with a 60-byte record before
/// them and 3 extra bytes in each.
std::string make_las(int minor, std::size_t format, std::uint32_t points) {
  const std::size_t header = minor == 4 ? 375 : minor == 3 ? 235 : 227;
  std::string las(header + 60, '\0');
  las.replace(0, 4, "LASF");
  las[24] = 1;
  las[25] = static_cast<char>(minor);
  set(las, 94, static_cast<std::uint16_t>(header));
  set(las, 96, static_cast<std::uint32_t>(header + 60));
  set(las, 100, std::uint32_t{1});
  las[104] = static_cast<char>(format);
  set(las, 105, static_cast<std::uint16_t>(kLasBytes[format] + 3));
  if (minor == 4)
    set(las, 247, std::uint64_t{points});
  else
    set(las, 107, points);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    set(las, 131 + 8 * axis, 0.001 * static_cast<double>(axis + 1));
    set(las, 155 + 8 * axis, static_cast<double>(axis));
  }
  for (std::uint32_t i = 0; i < points; ++i) {
    std::string p;
    put(p, static_cast<std::int32_t>(1000 * i));
    put(p, static_cast<std::int32_t>(-1000));
    put(p, static_cast<std::int32_t>(7 * i));
    put(p, static_cast<std::uint16_t>(60'000 + i));
    if (format < 6) {
      put(p, static_cast<std::uint8_t>(2 | 3 << 3 | 1 << 6));  // return 2 of 3, a scan flag
      put(p, std::uint8_t{5});
      put(p, std::int8_t{-30});
      put(p, std::uint8_t{9});
      put(p, std::uint16_t{77});
      if (format == 1 || format >= 3) put(p, 1e5 + i);
      if (format == 2 || format == 3 || format == 5)
        for (std::uint16_t c = 0; c < 3; ++c) put(p, static_cast<std::uint16_t>(100 * i + c));
    } else {
      put(p, static_cast<std::uint8_t>(9 | 12 << 4));  // return 9 of 12
      put(p, std::uint8_t{64});
      put(p, std::uint8_t{5});
      put(p, std::uint8_t{9});
      put(p, std::int16_t{-5000});
      put(p, std::uint16_t{77});
      put(p, 1e5 + i);
      if (format != 6 && format != 9)
        for (std::uint16_t c = 0; c < 3; ++c) put(p, static_cast<std::uint16_t>(100 * i + c));
    }
    p.resize(kLasBytes[format] + 3, '\x55');
    las += p;
  }
  return las;
}

TEST(Las, ReadsEveryPointFormatMadeByHand) {
  for (const int minor : {2, 3, 4})
    for (std::size_t format = 0; format <= (minor == 4 ? 10U : minor == 3 ? 5U : 3U); ++format) {
      SCOPED_TRACE(testing::Message() << "1." << minor << ", format " << format);
      const auto cloud =
          stream_bytes("a.las", make_las(minor, format, 3), {.unit_mm = {}, .batch_points = 2});
      ASSERT_THAT(cloud, Succeeds());
      EXPECT_EQ(cloud->format, "LAS");
      const PointBatch& p = cloud->points[0];
      ASSERT_EQ(p.size(), 3U);
      EXPECT_NEAR(norm(p.points_mm[2] - Vec3{2000.0, -1000.0, 2042.0}), 0.0, 1e-9);
      EXPECT_THAT(p.intensity, ElementsAre(60000.0F, 60001.0F, 60002.0F));
      EXPECT_THAT(p.return_index, Each(format < 6 ? 1 : 8));
      EXPECT_THAT(p.return_count, Each(format < 6 ? 3 : 12));
      EXPECT_NEAR(p.scan_angle_rad[0], -30.0 * std::numbers::pi / 180.0, 1e-6);
      const bool time = format == 1 || format >= 3;
      EXPECT_EQ(cloud->stations[0].fields.time, time);
      if (time) {
        EXPECT_THAT(p.time_s, ElementsAre(1e5, 1e5 + 1, 1e5 + 2));
      }
      const bool colour =
          format == 2 || format == 3 || format == 5 || format == 7 || format == 8 || format == 10;
      EXPECT_EQ(cloud->stations[0].fields.colour, colour);
      if (colour) {
        EXPECT_EQ(p.colours[2], (Colour{200, 201, 202}));
      }
      EXPECT_EQ(cloud->stations[0].intensity_limits, (std::array<double, 2>{0.0, 65535.0}));
    }
}

TEST(Las, HoldsItsFieldsInEveryVersion) {
  const ScratchFolder folder;
  for (const int minor : {2, 3, 4})
    for (int parts = 0; parts < 32; ++parts) {
      CloudFields f;
      f.intensity = (parts & 1) != 0;
      f.colour = (parts & 2) != 0;
      f.time = (parts & 4) != 0;
      f.returns = (parts & 8) != 0;
      f.scan_angle = (parts & 16) != 0;
      if (parts != 31 && parts % 7 != minor % 7) continue;  // a sample of the combinations
      StreamedCloud cloud;
      cloud.stations = {sample_station(f, 20, 30, 1)};
      cloud.stations[0].intensity_limits = {0.0, 2.0};
      cloud.points = {sample_points(f, 20, 30, 1, 16)};
      CloudWriteOptions options;
      options.las_minor = minor;
      options.las_step_mm = 0.01;
      ASSERT_THAT(stream_out(cloud, folder / "a.las", options), Succeeds());
      const auto back = stream_in(folder / "a.las");
      ASSERT_THAT(back, Succeeds());
      const PointBatch &p = cloud.points[0], &q = back->points[0];
      ASSERT_EQ(q.size(), 600U);
      EXPECT_EQ(back->stations[0].fields.time, f.time || minor == 4);
      EXPECT_EQ(back->stations[0].fields.colour, f.colour);
      EXPECT_EQ(q.colours, p.colours);
      for (std::size_t i = 0; i < 600; ++i) {
        const Vec3 at = cloud.stations[0].model_from_station.point(p.points_mm[i]);
        ASSERT_LE(std::abs(q.points_mm[i].x - at.x), 0.005 + 1e-9) << "half a step";
        ASSERT_LE(std::abs(q.points_mm[i].y - at.y), 0.005 + 1e-9);
        ASSERT_LE(std::abs(q.points_mm[i].z - at.z), 0.005 + 1e-9);
        ASSERT_NEAR(q.intensity[i], f.intensity ? p.intensity[i] / 2.0F * 65535.0F : 0.0F, 0.51F);
        ASSERT_EQ(q.return_index[i], f.returns ? p.return_index[i] : 0);
        ASSERT_EQ(q.return_count[i], f.returns ? p.return_count[i] : 1);
        if (f.time) {
          ASSERT_EQ(q.time_s[i], p.time_s[i]);
        }
        const double angle = f.scan_angle ? static_cast<double>(p.scan_angle_rad[i]) : 0.0;
        ASSERT_NEAR(static_cast<double>(q.scan_angle_rad[i]), angle, minor == 4 ? 6e-5 : 9e-3);
      }
      // What others look at in the header.
      const std::string bytes = *read_file(folder / "a.las");
      Box3 box;
      for (const Vec3& v : q.points_mm) box.add(v);
      double max_x = 0.0, min_z = 0.0;
      std::memcpy(&max_x, bytes.data() + 179, 8);
      std::memcpy(&min_z, bytes.data() + 219, 8);
      EXPECT_NEAR(1000.0 * max_x, box.max.x, 1e-9);
      EXPECT_NEAR(1000.0 * min_z, box.min.z, 1e-9);
      std::uint64_t counted = 0;
      for (std::size_t k = 0; k < (minor == 4 ? 15U : 5U); ++k) {
        std::uint64_t n = 0;
        std::memcpy(&n, bytes.data() + (minor == 4 ? 255 + 8 * k : 111 + 4 * k),
                    minor == 4 ? 8 : 4);
        counted += n;
      }
      EXPECT_EQ(counted, 600U) << "points by return";
    }
}

TEST(Las, RefusesWhatItCannotHold) {
  const ScratchFolder folder;
  Cloud cloud;
  cloud.points_mm = {{1.0, 2.0, 3.0}, {3e6, 0.0, 0.0}};
  const auto far = write_cloud(cloud, folder / "a.las");
  ASSERT_THAT(far, FailsWith(kCloudCannotHold));
  EXPECT_THAT(far.error().message, HasSubstr("point 1 is at 3000000"));
  CloudFields f;
  f.returns = true;
  StreamedCloud many;
  many.stations = {sample_station(f, 1, 1, 1)};
  many.points = {sample_points(f, 1, 1, 1)};
  many.points[0].return_index[0] = 8;
  many.points[0].return_count[0] = 9;
  const auto returns = stream_out(many, folder / "a.las");
  ASSERT_THAT(returns, FailsWith(kCloudCannotHold));
  EXPECT_THAT(returns.error().message, HasSubstr("return 9 of 9"));
  CloudWriteOptions options;
  options.las_minor = 4;
  EXPECT_THAT(stream_out(many, folder / "a.las", options), Succeeds());
  options.las_minor = 5;
  EXPECT_THAT(create_cloud(folder / "b.las", options), FailsWith(kCloudFormat));
  options = {};
  options.las_step_mm = 0.0;
  EXPECT_THAT(create_cloud(folder / "b.las", options), FailsWith(kCloudFormat));
}

// ---- bad files -------------------------------------------------------------

struct BadFile {
  const char* name;
  std::string content;
  ErrorCode code;
  const char* says;
};

class PcdLasRefuse : public testing::TestWithParam<BadFile> {};

TEST_P(PcdLasRefuse, AndSayWhereAndWhat) {
  const BadFile& bad = GetParam();
  const auto cloud = stream_bytes(bad.name, bad.content);
  ASSERT_THAT(cloud, FailsWith(bad.code));
  EXPECT_THAT(cloud.error().message, HasSubstr(bad.says));
  EXPECT_THAT(cloud.error().message, HasSubstr(bad.name));
}

std::string pcd(const char* middle, const char* data = "DATA ascii\n1 2 3\n") {
  return kHead + "FIELDS x y z\nSIZE 4 4 4\nTYPE F F F\nCOUNT 1 1 1\n" + middle + data;
}

template <class T>
std::string las_with(std::size_t at, T value) {
  std::string las = make_las(4, 7, 2);
  set(las, at, value);
  return las;
}

INSTANTIATE_TEST_SUITE_P(
    Files, PcdLasRefuse,
    testing::Values(
        BadFile{"a.pcd", "", kCloudFormat, "no DATA line"},
        BadFile{"b.pcd", "LASF\n", kCloudFormat, "line 1: unexpected 'LASF'"},
        BadFile{"c.pcd", pcd("WIDTH 2\nHEIGHT 1\nPOINTS 2\n"), kCloudFormat, "promises 2 points"},
        BadFile{"d.pcd", pcd("WIDTH 2\nHEIGHT 1\nPOINTS 3\n"), kCloudFormat, "POINTS is 3"},
        BadFile{"e.pcd", pcd("WIDTH 18446744073709551615\nHEIGHT 5\n"), kCloudFormat, "a grid of"},
        BadFile{"f.pcd", pcd("WIDTH 5000000000\nHEIGHT 2\n", "DATA binary\n"), kCloudFormat,
                "a grid of"},
        BadFile{"g.pcd", pcd("WIDTH 99999999999\n", "DATA binary\n1234"), kCloudFormat, "promises"},
        BadFile{"h.pcd", pcd("WIDTH 1\n", "DATA zip\n"), kCloudFormat, "DATA 'zip'"},
        BadFile{"i.pcd", pcd("WIDTH -1\n"), kCloudFormat, "WIDTH needs whole numbers"},
        BadFile{"j.pcd", pcd("WIDTH 1 2\n"), kCloudFormat, "WIDTH needs one"},
        BadFile{"k.pcd", pcd("VIEWPOINT 1 2 3\n"), kCloudFormat, "seven numbers"},
        BadFile{"l.pcd", pcd("WIDTH 1\n", "DATA ascii\n1 2\n \n"), kCloudFormat,
                "line 9: expected a number"},
        BadFile{"m.pcd", pcd("WIDTH 1\n", "DATA ascii\n1 2 3 4\n"), kCloudFormat,
                "line 9: '4' after"},
        BadFile{"n.pcd", pcd("WIDTH 1\n", "DATA ascii\n1 nan 3\n"), kCloudNotFinite, "point 0 "},
        BadFile{"o.pcd", pcd("WIDTH 2\n", "DATA ascii\n1 2 300000\n"), kCloudFormat,
                "before point 1 of 2"},
        BadFile{"p.pcd", kHead + "FIELDS x y z\nSIZE 4 4\nTYPE F F F\nDATA ascii\n", kCloudFormat,
                "same number of entries"},
        BadFile{"q.pcd", kHead + "FIELDS x y z\nSIZE 4 4 3\nTYPE F F F\nDATA ascii\n", kCloudFormat,
                "SIZE 3"},
        BadFile{"r.pcd", kHead + "FIELDS x y z\nSIZE 4 4 2\nTYPE F F F\nDATA ascii\n", kCloudFormat,
                "TYPE F, SIZE 2"},
        BadFile{"s.pcd",
                kHead + "FIELDS x y z a\nSIZE 4 4 4 4\nTYPE F F F F\nCOUNT 1 1 1 "
                        "1000000000000\nDATA ascii\n",
                kCloudFormat, "COUNT 1000000000000"},
        BadFile{"t.pcd", kHead + "FIELDS x y x\nSIZE 4 4 4\nTYPE F F F\nDATA ascii\n", kCloudFormat,
                "stands twice"},
        BadFile{"u.pcd", kHead + "FIELDS x y w\nSIZE 4 4 4\nTYPE F F F\nDATA ascii\n", kCloudFormat,
                "no x, y and z"},
        BadFile{"v.pcd", pcd("WIDTH 1\n", "DATA binary_compressed\n123"), kCloudFormat,
                "before the sizes"},
        BadFile{"w.pcd",
                pcd("WIDTH 1\n", "DATA binary_compressed\n\xFF\xFF\xFF\xFF\xFF\xFF\xFF\xFF"),
                kCloudFormat, "bytes of packed points"},
        BadFile{"x.pcd", pcd("WIDTH 1\n").substr(0, 90) + "", kCloudFormat, "no DATA line"},
        BadFile{"y.pcd",
                pcd("WIDTH 300000000\n", "DATA binary_compressed\n") +
                    std::string("\1\0\0\0\0\xA4\x93\xD6\0", 9),
                kCloudFormat, "damaged"},
        BadFile{
            "z.pcd",
            pcd("WIDTH 2\n", "DATA binary_compressed\n") + std::string("\1\0\0\0\14\0\0\0\0", 9),
            kCloudFormat, "become 12 bytes"},
        BadFile{"a.las", "", kCloudFormat, "expected 'LASF'"},
        BadFile{"b.las", "LASF", kCloudFormat, "ends inside the header"},
        BadFile{"c.las", make_las(4, 7, 2).substr(0, 300), kCloudFormat, "do not fit"},
        BadFile{"d.las", las_with(25, std::uint8_t{5}), kCloudFormat, "LAS 1.5"},
        BadFile{"e.las", las_with(24, std::uint8_t{2}), kCloudFormat, "LAS 2.4"},
        BadFile{"f.las", las_with(94, std::uint16_t{100}), kCloudFormat, "header of 100"},
        BadFile{"g.las", las_with(96, 0xFFFFFFFFU), kCloudFormat, "points from byte 4294967295"},
        BadFile{"h.las", las_with(104, std::uint8_t{128 + 7}), kCloudFormat, "compressed (LAZ)"},
        BadFile{"i.las", las_with(104, std::uint8_t{11}), kCloudFormat, "point format 11"},
        BadFile{"j.las", las_with(105, std::uint16_t{35}), kCloudFormat, "records of 35 bytes"},
        BadFile{"k.las", las_with(247, ~std::uint64_t{0}), kCloudFormat,
                "promises 18446744073709551615"},
        BadFile{"l.las", las_with(247, std::uint64_t{3}), kCloudFormat, "room for at most 2"},
        BadFile{"m.las", las_with(139, 0.0), kCloudFormat, "byte 139: scale 0"},
        BadFile{"n.las", las_with(155, static_cast<double>(NAN)), kCloudFormat, "byte 131"},
        BadFile{"o.las", las_with(131, 1e200), kCloudNotFinite, "point 1 "}),
    [](const auto& bad) {
      std::string name = bad.param.name;
      name[1] = '_';
      return name;
    });

TEST(PcdLas, WithoutPointsAreEmpty) {
  const ScratchFolder folder;
  for (const char* name : {"a.pcd", "a.las"}) {
    ASSERT_THAT(write_cloud({}, folder / name), Succeeds());
    const auto none = stream_in(folder / name);
    ASSERT_THAT(none, Succeeds());
    EXPECT_EQ(none->points[0].size(), 0U);
    EXPECT_THAT(read_cloud(folder / name), FailsWith(kCloudEmpty));
  }
}

class PcdLasMutated : public testing::TestWithParam<std::uint64_t> {};
INSTANTIATE_TEST_SUITE_P(Seed, PcdLasMutated, testing::Range<std::uint64_t>(1, 9));

TEST_P(PcdLasMutated, AreCloudsOrErrorsOfOurs) {
  const ScratchFolder folder;
  std::vector<std::pair<std::string, std::string>> good = {{"m.las", make_las(2, 3, 4)},
                                                           {"m.las", make_las(4, 7, 4)}};
  CloudFields f = all_fields();
  f.scan_angle = false;
  StreamedCloud cloud;
  cloud.stations = {sample_station(f, 2, 3, 1)};
  cloud.points = {sample_points(f, 2, 3, 1)};
  for (const auto encoding : {CloudWriteOptions::Pcd::binary, CloudWriteOptions::Pcd::ascii,
                              CloudWriteOptions::Pcd::binary_compressed}) {
    CloudWriteOptions options;
    options.pcd = encoding;
    ASSERT_THAT(stream_out(cloud, folder / "a.pcd", options), Succeeds());
    good.emplace_back("m.pcd", *read_file(folder / "a.pcd"));
  }
  Mutator mutated(GetParam());
  int clouds = 0, errors = 0;
  for (int i = 0; i < 4000; ++i) {
    const auto& [name, bytes] = good[mutated.index(good.size())];
    const auto back = stream_bytes(name, mutated(bytes));
    if (!back) {
      const ErrorCode code = back.error().code;
      ASSERT_TRUE(code == kCloudFormat || code == kCloudNotFinite) << back.error().message;
      ++errors;
      continue;
    }
    ++clouds;
    for (const Vec3& p : back->points[0].points_mm)
      ASSERT_TRUE(std::abs(p.x) <= kLargestCoordinateMm && std::abs(p.y) <= kLargestCoordinateMm &&
                  std::abs(p.z) <= kLargestCoordinateMm);
  }
  EXPECT_GT(clouds, 100) << "mutations that never survive test little";
  EXPECT_GT(errors, 100);
}

}  // namespace
}  // namespace maquette::scan

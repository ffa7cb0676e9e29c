// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed of E57, and how each claim is attacked:
//
//   files of others are read ......... two reference files (30571 points, values known), when
//                                      the data folder is there
//   the layout is the standard's ..... a file built here by hand, byte by byte, with its own
//                                      CRC (bit by bit): two stations, spherical and cartesian,
//                                      streams that drift apart, index and empty packets, bit
//                                      packs of odd widths, strings, invalid states, images
//   what is written is read .......... every field, several stations with poses, packed steps
//   checksums ........................ any damaged byte of any page that is read is noticed
//   hostile headers .................. each count, offset and type that lies, one error
//   any bytes at all ................. mutations with repaired checksums, and without
//   the same job, the same bytes ..... hashes

#include <cmath>
#include <cstdlib>
#include <fstream>
#include <functional>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/files.hpp"
#include "scan/cloud_stream.hpp"
#include "scan/detail/bit_pack.hpp"
#include "scan/detail/crc32c.hpp"
#include "support/folders.hpp"
#include "support/matchers.hpp"
#include "support/streamed_cloud.hpp"

namespace maquette::scan {
namespace {

using namespace testing_support;
using testing::HasSubstr;

// ---- parts -----------------------------------------------------------------

/// The definition, a bit at a time.
std::uint32_t slow_crc(std::string_view bytes) {
  std::uint32_t crc = 0xFFFFFFFFU;
  for (const char c : bytes) {
    crc ^= static_cast<unsigned char>(c);
    for (int bit = 0; bit < 8; ++bit) crc = (crc & 1U) != 0 ? (crc >> 1) ^ 0x82F63B78U : crc >> 1;
  }
  return ~crc;
}

TEST(Crc32c, IsThePublishedOne) {
  EXPECT_EQ(detail::crc32c("123456789"), 0xE3069283U);
  EXPECT_EQ(detail::crc32c(std::string(32, '\0')), 0x8A9136AAU);  // RFC 3720, B.4
  EXPECT_EQ(detail::crc32c(std::string(32, '\xFF')), 0x62A8AB43U);
  std::string bytes;
  for (std::uint64_t n = 0; n < 100; ++n) {
    EXPECT_EQ(detail::crc32c(bytes), slow_crc(bytes)) << n;
    EXPECT_EQ(detail::crc32c_by_table(bytes), slow_crc(bytes)) << n;
    bytes += static_cast<char>(random_bits(1, n));
  }
}

TEST(BitPack, EqualsABitByBitOracleAtEveryWidth) {
  for (unsigned width = 0; width <= 64; ++width) {
    std::vector<std::uint64_t> values;
    detail::BitPacker packer;
    std::string oracle;
    std::size_t bit = 0;
    for (std::uint64_t i = 0; i < 77; ++i) {
      const std::uint64_t mask = width == 64 ? ~0ULL : (1ULL << width) - 1;
      const std::uint64_t v = random_bits(width, i) & mask;
      values.push_back(v);
      packer.put(v, width);
      for (unsigned b = 0; b < width; ++b, ++bit) {
        if (bit % 8 == 0) oracle += '\0';
        const int one = ((v >> b) & 1U) != 0 ? 1 << (bit % 8) : 0;
        oracle.back() = static_cast<char>(oracle.back() | one);
      }
    }
    std::string packed = packer.take();
    EXPECT_EQ(packed, oracle) << width;
    packed.resize(packed.size() + detail::kUnpackSlack);
    std::vector<std::uint64_t> back(70);
    detail::unpack(packed.data(), std::uint64_t{7} * width, width, 70, back.data());
    EXPECT_EQ(back, std::vector<std::uint64_t>(values.begin() + 7, values.end())) << width;
  }
  EXPECT_EQ(detail::bits_for(5, 5), 0U);
  EXPECT_EQ(detail::bits_for(-1, 0), 1U);
  EXPECT_EQ(detail::bits_for(0, 255), 8U);
  EXPECT_EQ(detail::bits_for(0, 256), 9U);
  EXPECT_EQ(detail::bits_for(INT64_MIN, INT64_MAX), 64U);
}

// ---- a file made by hand ---------------------------------------------------

template <class T>
void put(std::string& bytes, T value) {
  std::array<char, sizeof(T)> raw;
  std::memcpy(raw.data(), &value, sizeof value);
  bytes.append(raw.data(), raw.size());
}

std::uint64_t to_physical(std::uint64_t logical) {
  return logical / 1020 * 1024 + logical % 1020;
}

/// Cuts a logical file into pages and sets their checksums.
std::string paged(std::string logical) {
  logical.resize((logical.size() + 1019) / 1020 * 1020);
  std::string file;
  for (std::size_t at = 0; at < logical.size(); at += 1020) {
    const std::string content = logical.substr(at, 1020);
    file += content;
    const std::uint32_t crc = slow_crc(content);
    for (int shift = 24; shift >= 0; shift -= 8) file += static_cast<char>(crc >> shift);
  }
  return file;
}

/// The other way, for mutations that keep the checksums right.
std::string unpaged(const std::string& file) {
  std::string logical;
  for (std::size_t at = 0; at + 1024 <= file.size(); at += 1024) logical += file.substr(at, 1020);
  return logical;
}

std::string data_packet(const std::vector<std::string>& streams) {
  std::string packet("\1\0\0\0", 4);
  put(packet, static_cast<std::uint16_t>(streams.size()));
  for (const auto& s : streams) put(packet, static_cast<std::uint16_t>(s.size()));
  for (const auto& s : streams) packet += s;
  packet.resize((packet.size() + 3) / 4 * 4);
  const auto length = static_cast<std::uint16_t>(packet.size() - 1);
  std::memcpy(packet.data() + 2, &length, 2);
  return packet;
}

std::string doubles(std::initializer_list<double> values) {
  std::string bytes;
  for (const double v : values) put(bytes, v);
  return bytes;
}

/// What the tests change to make a file lie.
struct Made {
  std::string prototype0 =
      R"(<sphericalRange type="Float"/><sphericalAzimuth type="Float" precision="double"/>
<sphericalElevation type="Float" minimum="-2" maximum="2"/>
<sphericalInvalidState type="Integer" minimum="0" maximum="2"/>
<note type="String"/>
<intensity type="Integer" minimum="100" maximum="611"/>
<rowIndex type="Integer" minimum="0" maximum="6"/><columnIndex type="Integer" minimum="4" maximum="4"/>)";
  std::string station_extra, points_attributes = R"(recordCount="4")";
  std::string codecs;
  std::string root = "e57Root";
  std::uint32_t version = 1;
  std::uint64_t page_bytes = 1024, extra_length = 0, xml_offset_error = 0, xml_length_error = 0;
  std::uint64_t section_error = 0, data_error = 0;
  std::uint64_t section_length = 0;  ///< if not zero
  char section_id = 1, packet_type = 1;
  int stream_count_error = 0;
  std::string range0 = doubles({2.0, 4.0, 0.0, 8.0});
};

/// Two stations. The first: spherical, a string per point, nine-bit intensities, streams that
/// drift apart over three packets with an index and an empty packet between. The second:
/// scaled integers of 20 bits, eight-bit colours with limits 0 to 100, a pose.
std::string make_e57(const Made& m) {
  std::string logical(48, '\0');
  const auto section = [&](const std::string& packets) {
    while (logical.size() % 4 != 0) logical += '\0';
    const std::uint64_t at = logical.size();
    std::string head(8, '\0');
    head[0] = m.section_id;
    put(head, m.section_length != 0 ? m.section_length : 32 + packets.size());
    put(head, to_physical(at + 32) + m.data_error);
    put(head, std::uint64_t{0});
    logical += head + packets;
    return to_physical(at) + m.section_error;
  };
  // States 0 0 2 1: 00 00 10 01 from the lowest bit: 0b01100000. Strings "", "ab", 130 x "c" with
  // the long prefix, "d". Intensities 100 + {0, 1, 510, 511}, nine bits each.
  const std::string states("\x60", 1);
  std::string notes("\0\4ab", 4);
  put(notes, std::uint64_t{130 * 2 + 1});
  notes += std::string(130, 'c') + "\2d";
  detail::BitPacker nine;  // checked above
  for (const std::uint64_t v : {0U, 1U, 510U, 511U}) nine.put(v, 9);
  const std::string intensities = nine.take();
  // Rows 6 5 4 3, three bits each: 110 101 100 011 -> 0b00101110 0b00000111.
  const std::string rows("\x2E\x07", 2);
  std::string packets;
  const std::string azimuth = doubles({0.0, std::numbers::pi / 2.0, 1.0, std::numbers::pi}),
                    elevation =
                        doubles({0.0, std::numbers::pi / 6.0, 0.5, -std::numbers::pi / 6.0});
  // Cut in the middle of values; the last stream (no bits at all) stays empty.
  packets += data_packet({m.range0.substr(0, 3), azimuth, "", "", notes.substr(0, 7),
                          intensities.substr(0, 1), "", ""});
  packets +=
      std::string("\0\0\x1F\0\1\0\0\0\0\0\0\0\0\0\0\0", 16) + std::string(16, '\0');  // index
  packets += data_packet(
      {m.range0.substr(3), "", elevation.substr(0, 25), states, notes.substr(7), "", rows, ""});
  packets += std::string("\2\0\7\0\0\0\0\0", 8);  // empty
  packets += data_packet({"", "", elevation.substr(25), "", "", intensities.substr(1), "", ""});
  packets[0] = m.packet_type;
  packets[4] = static_cast<char>(packets[4] + m.stream_count_error);
  const std::uint64_t section0 = section(packets);

  std::array<detail::BitPacker, 3> xyz;
  for (std::uint64_t i = 0; i < 3; ++i)
    for (std::size_t axis = 0; axis < 3; ++axis) xyz[axis].put(1000 * i + axis, 20);
  const std::uint64_t section1 = section(
      data_packet({xyz[0].take(), xyz[1].take(), xyz[2].take(), "\1\2\x64",
                   std::string("\0\x32\x19", 3), std::string("\0\0\0", 3), std::string("\2", 1)}));

  std::string xml = R"(<?xml version="1.0" encoding="UTF-8"?>
<)" + m.root + R"( type="Structure" xmlns="http://www.astm.org/COMMIT/E57/2010-e57-v1.0">
<formatName type="String"><![CDATA[ASTM E57 3D Imaging Data File]]></formatName>
<data3D type="Vector" allowHeterogeneousChildren="1">
<vectorChild type="Structure"><guid type="String"><![CDATA[{one}]]></guid>
<name type="String"><![CDATA[a < b & c]]></name>
<sensorModel type="String">5006h</sensorModel><temperature type="Float"/>
<acquisitionStart type="Structure"><dateTimeValue type="Float">1.25e+009</dateTimeValue></acquisitionStart>
<indexBounds type="Structure"><rowMinimum type="Integer">3</rowMinimum><rowMaximum type="Integer">6</rowMaximum>
<columnMinimum type="Integer">4</columnMinimum><columnMaximum type="Integer">4</columnMaximum></indexBounds>
)" + m.station_extra +
                    R"(<points type="CompressedVector" fileOffset=")" + std::to_string(section0) +
                    "\" " + m.points_attributes + "><prototype type=\"Structure\">" + m.prototype0 +
                    R"(</prototype>
<codecs type="Vector" allowHeterogeneousChildren="1">)" +
                    m.codecs + R"(</codecs></points></vectorChild>
<vectorChild type="Structure"><guid type="String">two</guid>
<pose type="Structure"><rotation type="Structure"><w type="Float">0</w><x type="Float">0</x><y type="Float"/><z type="Float">1</z></rotation>
<translation type="Structure"><x type="Float">1</x><y type="Float">2e0</y><z type="Float">-3</z></translation></pose>
<colorLimits type="Structure"><colorRedMinimum type="Integer"/><colorRedMaximum type="Integer">100</colorRedMaximum></colorLimits>
<points type="CompressedVector" fileOffset=")" +
                    std::to_string(section1) + R"(" recordCount="3"><prototype type="Structure">
<cartesianX type="ScaledInteger" minimum="0" maximum="1048575" scale="0.001" offset="1.5"/>
<cartesianY type="ScaledInteger" minimum="0" maximum="1048575" scale="0.001"/>
<cartesianZ type="ScaledInteger" minimum="0" maximum="1048575" scale="0.001"/>
<colorRed type="Integer" minimum="0" maximum="255"/><colorGreen type="Integer" minimum="0" maximum="255"/>
<colorBlue type="Integer" minimum="0" maximum="255"/><isColorInvalid type="Integer" minimum="0" maximum="1"/>
</prototype><codecs type="Vector"/></points></vectorChild></data3D>
<images2D type="Vector"><vectorChild type="Structure"><name type="String">overview</name>
<associatedData3DGuid type="String">two</associatedData3DGuid>
<pinholeRepresentation type="Structure"><jpegImage type="Blob" fileOffset="48" length="1234"/></pinholeRepresentation>
</vectorChild></images2D></)" +
                    m.root + ">\n";
  const std::uint64_t xml_at = logical.size();
  logical += xml;
  const std::uint64_t length = (logical.size() + 1019) / 1020 * 1024;
  std::string head = "ASTM-E57";
  put(head, m.version);
  put(head, std::uint32_t{0});
  put(head, length + m.extra_length);
  put(head, to_physical(xml_at) + m.xml_offset_error);
  put(head, xml.size() + m.xml_length_error);
  put(head, m.page_bytes);
  logical.replace(0, 48, head);
  return paged(logical);
}

TEST(E57, ReadsAFileMadeByHand) {
  for (const std::size_t batch : {1U, 3U, 1000U}) {
    const auto cloud = stream_bytes("a.e57", make_e57({}), {.unit_mm = {}, .batch_points = batch});
    ASSERT_THAT(cloud, Succeeds());
    EXPECT_EQ(cloud->format, "E57");
    ASSERT_EQ(cloud->stations.size(), 2U);
    const ScanStation& a = cloud->stations[0];
    EXPECT_EQ(a.name, "a < b & c");
    EXPECT_EQ(a.guid, "{one}");
    EXPECT_EQ(a.sensor_model, "5006h");
    EXPECT_EQ(a.start_gps_s, 1.25e9);
    EXPECT_EQ(a.rows, 4U);
    EXPECT_EQ(a.columns, 1U);
    EXPECT_EQ(a.points, 4U);
    EXPECT_EQ(a.model_from_station, RigidTransform{});
    EXPECT_FALSE(a.position_mm) << "no pose, no position";
    EXPECT_EQ(a.intensity_limits, (std::array<double, 2>{100.0, 611.0}));
    CloudFields f;
    f.intensity = f.grid = f.flags = true;
    EXPECT_EQ(a.fields, f);
    const PointBatch& p = cloud->points[0];
    ASSERT_EQ(p.size(), 4U);
    EXPECT_NEAR(norm(p.points_mm[0] - Vec3{2000, 0, 0}), 0.0, 1e-9);
    EXPECT_NEAR(norm(p.points_mm[1] - Vec3{0, 4000 * std::sqrt(0.75), 2000}), 0.0, 1e-9);
    EXPECT_EQ(p.points_mm[2], Vec3{});
    EXPECT_NEAR(norm(p.points_mm[3] - Vec3{-std::sqrt(0.75), 0, -0.5}), 0.0, 1e-15);
    EXPECT_THAT(p.flags, testing::ElementsAre(0, 0, kNoPosition, kDirectionOnly));
    EXPECT_THAT(p.intensity, testing::ElementsAre(100.0F, 101.0F, 610.0F, 611.0F));
    EXPECT_THAT(p.grid, testing::ElementsAre(GridIndex{3, 0}, GridIndex{2, 0}, GridIndex{1, 0},
                                             GridIndex{0, 0}));
    const ScanStation& b = cloud->stations[1];
    EXPECT_EQ(b.model_from_station,
              (RigidTransform{{0.0, 0.0, 0.0, 1.0}, {1000.0, 2000.0, -3000.0}}));
    EXPECT_EQ(b.position_mm, (Vec3{1000.0, 2000.0, -3000.0}));
    EXPECT_EQ(b.colour_bits, 8);
    const PointBatch& q = cloud->points[1];
    ASSERT_EQ(q.size(), 3U);
    EXPECT_NEAR(norm(q.points_mm[2] - Vec3{3500.0, 2001.0, 2002.0}), 0.0, 1e-9);
    EXPECT_EQ(q.colours[0], (Colour{655, 0, 0}));  // 1 of 100
    EXPECT_EQ(q.colours[1], (Colour{1311, 32768, 0}));
    EXPECT_EQ(q.colours[2], (Colour{65535, 16384, 0}));
    EXPECT_THAT(q.flags, testing::ElementsAre(0, kNoColour, 0));
    ASSERT_EQ(cloud->images.size(), 1U);
    EXPECT_EQ(cloud->images[0].name, "overview");
    EXPECT_EQ(cloud->images[0].kind, "pinhole");
    EXPECT_EQ(cloud->images[0].station_guid, "two");
    EXPECT_EQ(cloud->images[0].bytes, 1234U);
  }
}

TEST(E57, BringsAllStationsIntoOneFrame) {
  const ScratchFolder folder;
  std::ofstream(folder / "a.e57", std::ios::binary) << make_e57({});
  const auto cloud = read_cloud(folder / "a.e57");
  ASSERT_THAT(cloud, Succeeds());
  ASSERT_EQ(cloud->points_mm.size(), 5U) << "two have no position";
  EXPECT_NEAR(norm(cloud->points_mm[2] - Vec3{1000.0 - 1500.0, 2000.0 - 1.0, -3000.0 + 2.0}), 0.0,
              1e-9);
  EXPECT_TRUE(cloud->intensity.empty()) << "the second station has none";
  EXPECT_TRUE(cloud->colours.empty());
  EXPECT_EQ(cloud->stations[0].points, 2U);
  EXPECT_EQ(cloud->stations[1].points, 3U);
  EXPECT_FALSE(cloud->station_mm);
  const auto info = inspect_cloud(folder / "a.e57");
  ASSERT_THAT(info, Succeeds());
  EXPECT_EQ(info->points, 5U);
  EXPECT_EQ(info->without_position, 2U);
  const auto feet = stream_in(folder / "a.e57", {.unit_mm = 304.8});
  ASSERT_THAT(feet, Succeeds());
  EXPECT_NEAR(feet->points[0].points_mm[0].x, 2.0 * 304.8, 1e-9);
}

// ---- files of others -------------------------------------------------------

std::filesystem::path shared_file(const char* name) {
  return testing_support::data_folder() / "scans" / name;
}

TEST(E57Reference, TheBunnyIsReadAsDoublesAndAsIntegers) {
  const auto real = shared_file("reference_bunnyDouble.e57"),
             whole = shared_file("reference_bunnyInt32.e57");
  if (!std::filesystem::exists(real) || !std::filesystem::exists(whole))
    GTEST_SKIP() << real << " is not there; set MAQUETTE_DATA";
  const auto a = inspect_cloud(real), b = inspect_cloud(whole);
  ASSERT_THAT(a, Succeeds());
  ASSERT_THAT(b, Succeeds());
  for (const auto& info : {*a, *b}) {
    EXPECT_EQ(info.points, 30571U);
    EXPECT_EQ(info.without_position, 0U);
    ASSERT_EQ(info.stations.size(), 1U);
    EXPECT_EQ(info.stations[0].name, "bunny");
    // As its own XML states them (metres).
    EXPECT_NEAR(norm(info.bounds_mm.min - Vec3{-94.689, 40.011, -61.873}), 0.0, 1e-9);
    EXPECT_NEAR(norm(info.bounds_mm.max - Vec3{61.009, 187.321, 58.799}), 0.0, 1e-9);
  }
  const auto x = read_cloud(real), y = read_cloud(whole);
  ASSERT_THAT(x, Succeeds());
  ASSERT_THAT(y, Succeeds());
  double furthest = 0.0;
  for (std::size_t i = 0; i < 30571; ++i)
    furthest = std::max(furthest, norm(x->points_mm[i] - y->points_mm[i]));
  EXPECT_LT(furthest, 1e-9) << "the model's coordinates are whole micrometres";
}

TEST(E57Reference, TheBrokenChecksumIsRefused) {
  const auto path = shared_file("self_bad-crc.e57");
  if (!std::filesystem::exists(path)) GTEST_SKIP() << path << " is not there; set MAQUETTE_DATA";
  const auto cloud = read_cloud(path);
  ASSERT_THAT(cloud, FailsWith(kCloudChecksum));
  EXPECT_THAT(cloud.error().message, HasSubstr("page 0 (byte 0)"));
}

// ---- round trips -----------------------------------------------------------

StreamedCloud three_stations(const CloudFields& fields, int colour_bits) {
  StreamedCloud cloud;
  for (std::uint64_t s = 0; s < 3; ++s) {
    const std::uint32_t rows = s == 2 ? 90 : 3, columns = s == 2 ? 100 : 5;
    cloud.stations.push_back(sample_station(fields, rows, columns, s));
    cloud.stations.back().colour_bits = colour_bits;
    cloud.stations.back().intensity_limits = {-0.5, 1.5};
    cloud.stations.back().start_gps_s = 1.3e9 + static_cast<double>(s);
    cloud.stations.back().description = "<made> & \x01 up";
    Quaternion& q = cloud.stations.back().model_from_station.rotation;
    if (s == 1) q = {-q.w, -q.x, -q.y, -q.z};  // the same rotation
    cloud.points.push_back(sample_points(fields, rows, columns, s, colour_bits));
  }
  return cloud;
}

void expect_same(const StreamedCloud& in, const StreamedCloud& out, double tolerance_mm) {
  ASSERT_EQ(out.stations.size(), in.stations.size());
  for (std::size_t s = 0; s < in.stations.size(); ++s) {
    const ScanStation &a = in.stations[s], &b = out.stations[s];
    EXPECT_EQ(b.name, a.name);
    EXPECT_EQ(b.points, in.points[s].size());
    EXPECT_EQ(b.start_gps_s, a.start_gps_s);
    if (a.fields.grid) {
      EXPECT_EQ(b.rows, a.rows);
    }
    if (a.fields.grid) {
      EXPECT_EQ(b.columns, a.columns);
    }
    if (a.fields.intensity) {
      EXPECT_EQ(b.intensity_limits, a.intensity_limits);
    }
    const PointBatch &p = in.points[s], &q = out.points[s];
    ASSERT_EQ(q.size(), p.size());
    for (const Vec3 v : {Vec3{0, 0, 0}, Vec3{1000, 2000, -3000}})  // q and -q are one rotation
      EXPECT_NEAR(norm(b.model_from_station.point(v) - a.model_from_station.point(v)), 0.0, 1e-11);
    for (std::size_t i = 0; i < p.size(); ++i) {
      const Vec3 d = q.points_mm[i] - p.points_mm[i];
      // Directions are brought to unit length again.
      const double ulps = p.has_position(i) ? 2.0 * 2.3e-16 : 1e-15;
      ASSERT_LE(std::abs(d.x), tolerance_mm + ulps * std::abs(p.points_mm[i].x));
      ASSERT_LE(std::abs(d.y), tolerance_mm + ulps * std::abs(p.points_mm[i].y));
      ASSERT_LE(std::abs(d.z), tolerance_mm + ulps * std::abs(p.points_mm[i].z));
    }
    EXPECT_EQ(q.intensity, p.intensity);
    EXPECT_EQ(q.colours, p.colours);
    EXPECT_EQ(q.grid, p.grid);
    EXPECT_EQ(q.time_s, p.time_s);
    EXPECT_EQ(q.return_index, p.return_index);
    EXPECT_EQ(q.return_count, p.return_count);
    EXPECT_EQ(q.flags, p.flags);
    ASSERT_EQ(q.normals.size(), p.normals.size());
    for (std::size_t i = 0; i < p.normals.size(); ++i)
      ASSERT_NEAR(norm(q.normals[i] - p.normals[i]), 0.0, 1.5e-7) << "float";
  }
}

TEST(E57, HoldsEveryFieldOfEveryStation) {
  const ScratchFolder folder;
  std::vector<int> choices = {0, 63};
  for (int bit = 1; bit < 64; bit *= 2) choices.insert(choices.end(), {bit, 63 - bit});
  for (const int parts : choices) {
    CloudFields f;
    f.intensity = (parts & 1) != 0;
    f.colour = (parts & 2) != 0;
    f.normals = (parts & 4) != 0;
    f.grid = (parts & 8) != 0;
    f.time = (parts & 16) != 0;
    f.returns = (parts & 32) != 0;
    const StreamedCloud cloud = three_stations(f, parts % 2 == 0 ? 8 : 16);
    ASSERT_THAT(stream_out(cloud, folder / "a.e57"), Succeeds());
    const auto back = stream_in(folder / "a.e57", {.unit_mm = {}, .batch_points = 1234});
    ASSERT_THAT(back, Succeeds());
    expect_same(cloud, *back, 0.0);
    EXPECT_EQ(back->stations[1].fields, f);
    EXPECT_NE(back->stations[0].guid, back->stations[1].guid);
  }
}

TEST(E57, HoldsWhatPointsLack) {
  const ScratchFolder folder;
  CloudFields f;
  f.intensity = f.colour = f.time = f.flags = true;
  StreamedCloud cloud = three_stations(f, 8);
  for (std::size_t s = 0; s < 3; ++s) {
    PointBatch& p = cloud.points[s];
    for (std::size_t i = 0; i < p.size(); ++i) {
      std::uint8_t flags = random_bits(s, i) & 28U;
      if (i % 5 == 1) {
        flags |= kDirectionOnly;
        p.points_mm[i] = normalized(p.points_mm[i]);
      } else if (i % 5 == 2) {
        flags |= kNoPosition;
        p.points_mm[i] = {};
      }
      p.flags.push_back(flags);
    }
  }
  ASSERT_THAT(stream_out(cloud, folder / "a.e57"), Succeeds());
  const auto back = stream_in(folder / "a.e57");
  ASSERT_THAT(back, Succeeds());
  expect_same(cloud, *back, 0.0);
  // What stands where nothing came back does not matter.
  cloud.points[0].points_mm[2] = {1e300, NAN, 0.0};
  CloudWriteOptions steps;
  steps.e57_step_mm = 0.001;
  ASSERT_THAT(stream_out(cloud, folder / "a.e57", steps), Succeeds());
  EXPECT_EQ(stream_in(folder / "a.e57")->points[0].points_mm[2], Vec3{});
}

TEST(E57, PacksCoordinatesIntoSteps) {
  const ScratchFolder folder;
  CloudFields f;
  f.grid = true;
  StreamedCloud cloud = three_stations(f, 8);
  CloudWriteOptions options;
  options.e57_step_mm = 0.01;
  ASSERT_THAT(stream_out(cloud, folder / "a.e57", options), Succeeds());
  const auto back = stream_in(folder / "a.e57");
  ASSERT_THAT(back, Succeeds());
  expect_same(cloud, *back, 0.005 * (1 + 1e-9));
  ASSERT_THAT(stream_out(cloud, folder / "b.e57"), Succeeds());
  EXPECT_LT(std::filesystem::file_size(folder / "a.e57"),
            std::filesystem::file_size(folder / "b.e57") * 2 / 3);
  options.e57_step_mm = 1e-7;  // 2^31 steps are 215 mm
  const auto far = stream_out(cloud, folder / "c.e57", options);
  ASSERT_THAT(far, FailsWith(kCloudCannotHold));
  EXPECT_THAT(far.error().message, HasSubstr("take a larger step"));
  EXPECT_FALSE(std::filesystem::exists(folder / "c.e57"));
  options.e57_step_mm = -1.0;
  EXPECT_THAT(create_cloud(folder / "c.e57", options), FailsWith(kCloudFormat));
  options = {};
  options.unit_mm = 1.0;
  EXPECT_THAT(create_cloud(folder / "c.e57", options), FailsWith(kCloudCannotHold));
  cloud.points[0].grid[7].row = 3;
  const auto outside = stream_out(cloud, folder / "c.e57");
  ASSERT_THAT(outside, FailsWith(kCloudCannotHold));
  EXPECT_THAT(outside.error().message, HasSubstr("point 7 lies in row 3"));
}

TEST(E57, PutsThePoseAtTheScanner) {
  // A cloud in the model frame with a scanner position: the file's pose is there, and the cloud
  // comes back in the model frame.
  const ScratchFolder folder;
  Cloud cloud;
  cloud.points_mm = {{1.0, 2.0, 3.0}, {400.5, -7.25, 1e-3}};
  cloud.normals = {{0.0, 0.0, 1.0}, {0.6, 0.0, 0.8}};
  cloud.station_mm = Vec3{80.0, -900.0, 950.0};
  ASSERT_THAT(write_cloud(cloud, folder / "a.e57"), Succeeds());
  const auto raw = stream_in(folder / "a.e57");
  ASSERT_THAT(raw, Succeeds());
  EXPECT_NEAR(norm(raw->points[0].points_mm[0] - Vec3{-79.0, 902.0, -947.0}), 0.0, 1e-12);
  const auto back = read_cloud(folder / "a.e57");
  ASSERT_THAT(back, Succeeds());
  EXPECT_EQ(back->station_mm, cloud.station_mm);
  for (std::size_t i = 0; i < 2; ++i) {
    EXPECT_NEAR(norm(back->points_mm[i] - cloud.points_mm[i]), 0.0, 1e-12);
    EXPECT_NEAR(norm(back->normals[i] - cloud.normals[i]), 0.0, 1.5e-7);
  }
  // The same from a file that knows the position but has no poses.
  ASSERT_THAT(write_cloud(cloud, folder / "a.ply"), Succeeds());
  const auto flat = stream_in(folder / "a.ply");
  ASSERT_THAT(flat, Succeeds());
  ASSERT_THAT(stream_out(*flat, folder / "b.e57"), Succeeds());
  const auto moved = stream_in(folder / "b.e57");
  ASSERT_THAT(moved, Succeeds());
  EXPECT_NEAR(norm(moved->points[0].points_mm[0] - Vec3{-79.0, 902.0, -947.0}), 0.0, 1e-12);
}

TEST(E57, HoldsStationsWithoutPointsAndNone) {
  const ScratchFolder folder;
  StreamedCloud cloud;
  ASSERT_THAT(stream_out(cloud, folder / "none.e57"), Succeeds());
  EXPECT_EQ(stream_in(folder / "none.e57")->stations.size(), 0U);
  EXPECT_THAT(read_cloud(folder / "none.e57"), FailsWith(kCloudEmpty));
  cloud.stations = {sample_station({}, 0, 0, 1), sample_station({}, 1, 2, 2)};
  cloud.points = {{}, sample_points({}, 1, 2, 2)};
  ASSERT_THAT(stream_out(cloud, folder / "a.e57"), Succeeds());
  const auto back = stream_in(folder / "a.e57");
  ASSERT_THAT(back, Succeeds());
  expect_same(cloud, *back, 0.0);
}

TEST(E57, WritesTheSameBytes) {
  const ScratchFolder folder;
  ASSERT_THAT(stream_out(three_stations(all_fields(), 8), folder / "a.e57"), Succeeds());
  ASSERT_THAT(stream_out(three_stations(all_fields(), 8), folder / "b.e57"), Succeeds());
  EXPECT_EQ(*sha256_file(folder / "a.e57"), *sha256_file(folder / "b.e57"));
}

// ---- bad files -------------------------------------------------------------

TEST(E57, NoticesAnyDamage) {
  // Every page that is read: the damage comes out whichever byte it hits, also in the checksum.
  const std::string good = make_e57({});
  ASSERT_THAT(stream_bytes("a.e57", good), Succeeds());
  for (std::size_t at = 8; at < good.size(); ++at) {
    std::string bad = good;
    bad[at] = static_cast<char>(bad[at] ^ (1 << at % 8));
    const auto cloud = stream_bytes("a.e57", bad);
    ASSERT_THAT(cloud, FailsWith(kCloudChecksum)) << at;
    ASSERT_THAT(cloud.error().message, HasSubstr("page " + std::to_string(at / 1024) + " (byte " +
                                                 std::to_string(at / 1024 * 1024) + ")"));
  }
}

struct Lie {
  const char* name;
  std::function<void(Made&)> tell;
  ErrorCode code;
  const char* says;
};

class E57Lies : public testing::TestWithParam<Lie> {};

TEST_P(E57Lies, AreRefusedWithTheirPlace) {
  Made made;
  GetParam().tell(made);
  const auto cloud = stream_bytes("lie.e57", make_e57(made));
  ASSERT_THAT(cloud, FailsWith(GetParam().code));
  EXPECT_THAT(cloud.error().message, HasSubstr(GetParam().says));
  EXPECT_THAT(cloud.error().message, HasSubstr("lie.e57"));
}

std::string fields(const char* more) {
  std::string all;
  for (const char axis : {'X', 'Y', 'Z'}) {
    all += "<cartesian";
    all += axis;
    all += R"( type="Float"/>)";
  }
  return all += more;
}

INSTANTIATE_TEST_SUITE_P(
    Of, E57Lies,
    testing::Values(
        Lie{"version", [](Made& m) { m.version = 2; }, kCloudFormat, "version 2.0"},
        Lie{"page_size", [](Made& m) { m.page_bytes = 4096; }, kCloudFormat, "pages of 4096"},
        Lie{"length", [](Made& m) { m.extra_length = 1024; }, kCloudFormat, "promises"},
        Lie{"xml_offset", [](Made& m) { m.xml_offset_error = 1ULL << 60; }, kCloudFormat,
            "beyond the file"},
        Lie{"xml_length", [](Made& m) { m.xml_length_error = 1ULL << 50; }, kCloudFormat,
            "bytes of XML"},
        Lie{"xml", [](Made& m) { m.station_extra = "</never>"; }, kCloudFormat,
            "of the XML section"},
        Lie{"root", [](Made& m) { m.root = "svg"; }, kCloudFormat, "root"},
        Lie{"count", [](Made& m) { m.points_attributes = R"(recordCount="18446744073709551615")"; },
            kCloudFormat, "are promised"},
        Lie{"count_text", [](Made& m) { m.points_attributes = R"(recordCount="-4")"; },
            kCloudFormat, "recordCount '-4'"},
        Lie{"count_small", [](Made& m) { m.points_attributes = R"(recordCount="5")"; },
            kCloudFormat, "after 4 of 5 points"},
        Lie{"section_offset", [](Made& m) { m.section_error = 1ULL << 40; }, kCloudFormat,
            "a section of points is said to be at byte"},
        Lie{"section_in_checksum", [](Made& m) { m.section_error = 1020 - 48; }, kCloudFormat,
            "in a checksum"},
        Lie{"section_kind", [](Made& m) { m.section_id = 0; }, kCloudFormat, "section of kind 0"},
        Lie{"section_length", [](Made& m) { m.section_length = 40; }, kCloudFormat,
            "do not fit into its section"},
        Lie{"data_offset", [](Made& m) { m.data_error = 1ULL << 40; }, kCloudFormat,
            "first data packet is said"},
        Lie{"packet_kind", [](Made& m) { m.packet_type = 9; }, kCloudFormat, "kind 9"},
        Lie{"stream_count", [](Made& m) { m.stream_count_error = 1; }, kCloudFormat,
            "expected 8 bytestreams"},
        Lie{"no_coordinates", [](Made& m) { m.prototype0 = R"(<cartesianX type="Float"/>)"; },
            kCloudFormat, "neither cartesianX"},
        Lie{"constant",
            [](Made& m) {
              m.prototype0 = R"(<cartesianX type="Integer" minimum="1" maximum="1"/>
<cartesianY type="Integer" minimum="1" maximum="1"/><cartesianZ type="Integer" minimum="1" maximum="1"/>)";
              m.points_attributes = R"(recordCount="1000000000000000")";
            },
            kCloudFormat, "0 bits are promised"},
        Lie{"blob", [](Made& m) { m.prototype0 = fields(R"(<a type="Blob"/>)"); }, kCloudFormat,
            "type 'Blob'"},
        Lie{"text_coordinate",
            [](Made& m) { m.prototype0 = fields(R"(<intensity type="String"/>)"); }, kCloudFormat,
            "is a string"},
        Lie{"twice",
            [](Made& m) { m.prototype0 = fields(R"(<a type="Float"/><a type="Float"/>)"); },
            kCloudFormat, "two fields a"},
        Lie{"minimum",
            [](Made& m) {
              m.prototype0 = fields(R"(<a type="Integer" minimum="3" maximum="2"/>)");
            },
            kCloudFormat, "minimum 3 above"},
        Lie{"scale",
            [](Made& m) { m.prototype0 = fields(R"(<a type="ScaledInteger" scale="nan"/>)"); },
            kCloudFormat, "not finite"},
        Lie{"nested",
            [](Made& m) {
              std::string deep;
              for (int i = 0; i < 20; ++i) deep += R"(<s type="Structure">)";
              for (int i = 0; i < 20; ++i) deep += "</s>";
              m.prototype0 = fields(deep.c_str());
            },
            kCloudFormat, "nested too deeply"},
        Lie{"codec",
            [](Made& m) { m.codecs = "<vectorChild type=\"Structure\"><zip/></vectorChild>"; },
            kCloudFormat, "codec other than"},
        Lie{"pose",
            [](Made& m) {
              m.station_extra = R"(<pose type="Structure"><rotation type="Structure">
<w type="Float">0.5</w></rotation></pose>)";
            },
            kCloudFormat, "unit quaternion"},
        Lie{"position",
            [](Made& m) {
              m.station_extra = R"(<pose type="Structure"><translation type="Structure">
<x type="Float">1e300</x></translation></pose>)";
            },
            kCloudFormat, "translation"},
        Lie{"number",
            [](Made& m) {
              m.station_extra = R"(<intensityLimits type="Structure">
<intensityMinimum type="Float">none</intensityMinimum></intensityLimits>)";
            },
            kCloudFormat, "is 'none'"},
        Lie{"not_finite",
            [](Made& m) {
              m.range0 = doubles({1.0, NAN, 0.0, 1.0});
            },
            kCloudNotFinite, "point 1 "},
        Lie{"outside_grid",
            [](Made& m) {
              const auto at = m.prototype0.find(R"(minimum="0" maximum="6")");
              m.prototype0.replace(at, 23, R"(minimum="9" maximum="15")");
            },
            kCloudFormat, "its grid has 4 rows"}),
    [](const auto& lie) { return lie.param.name; });

TEST(E57, RefusesWhatIsNoneOrIsCut) {
  const std::string good = make_e57({});
  EXPECT_THAT(stream_bytes("a.e57", ""), FailsWith(kCloudFormat));
  EXPECT_THAT(stream_bytes("a.e57", "ply\n"), FailsWith(kCloudFormat));
  EXPECT_THAT(stream_bytes("a.e57", good.substr(0, 500)), FailsWith(kCloudFormat));
  EXPECT_THAT(stream_bytes("a.e57", good.substr(0, 1024)), FailsWith(kCloudFormat));
  EXPECT_THAT(stream_bytes("a.e57", good + std::string(1024, '\0')), FailsWith(kCloudFormat));
}

class E57Mutated : public testing::TestWithParam<std::uint64_t> {};
INSTANTIATE_TEST_SUITE_P(Seed, E57Mutated, testing::Range<std::uint64_t>(1, 9));

TEST_P(E57Mutated, IsACloudOrAnErrorOfOurs) {
  const ScratchFolder folder;
  StreamedCloud small;
  small.stations = {sample_station(all_fields(), 3, 4, 1)};
  small.stations[0].fields.flags = true;
  small.points = {sample_points(all_fields(), 3, 4, 1)};
  ASSERT_THAT(stream_out(small, folder / "a.e57"), Succeeds());
  const std::array<std::string, 2> good = {unpaged(make_e57({})),
                                           unpaged(*read_file(folder / "a.e57"))};
  std::uint64_t draw = 0;
  const auto index = [&](std::size_t n) {
    return static_cast<std::size_t>(random_bits(GetParam(), draw++) % n);
  };
  int clouds = 0, errors = 0;
  for (int i = 0; i < 1500; ++i) {
    std::string logical = good[index(2)];
    for (std::size_t k = 1 + index(3); k > 0; --k) {
      const std::size_t at = index(4) == 0 ? index(300) : index(logical.size());
      switch (index(4)) {
        case 0:
          logical[at] = static_cast<char>(random_bits(GetParam(), draw++));
          break;
        case 1:
          logical[at] = static_cast<char>(logical[at] ^ (1 << index(8)));
          break;
        case 2:
          for (std::size_t b = at; b < std::min(at + 8, logical.size()); ++b) logical[b] = '\xFF';
          break;
        default:
          logical[at] = "0123456789-.<>\"/"[index(16)];
      }
    }
    const auto cloud = stream_bytes("a.e57", paged(logical));
    if (!cloud) {
      const ErrorCode code = cloud.error().code;
      ASSERT_TRUE(code == kCloudFormat || code == kCloudNotFinite) << cloud.error().message;
      ++errors;
      continue;
    }
    ++clouds;
    for (std::size_t s = 0; s < cloud->stations.size(); ++s) {
      const PointBatch& p = cloud->points[s];
      ASSERT_EQ(p.size(), cloud->stations[s].points);
      ASSERT_TRUE(p.flags.empty() || p.flags.size() == p.size());
      for (const Vec3& v : p.points_mm)
        ASSERT_TRUE(std::abs(v.x) <= kLargestCoordinateMm &&
                    std::abs(v.y) <= kLargestCoordinateMm && std::abs(v.z) <= kLargestCoordinateMm);
      if (cloud->stations[s].rows == 0) continue;
      for (const GridIndex& g : p.grid) ASSERT_LT(g.row, cloud->stations[s].rows);
    }
  }
  EXPECT_GT(clouds, 50) << "mutations that never survive test little";
  EXPECT_GT(errors, 50);
}

}  // namespace
}  // namespace maquette::scan

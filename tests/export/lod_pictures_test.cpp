// SPDX-License-Identifier: GPL-3.0-or-later

// export/sky_view.hpp:
//   a plane ................... sees all, however it is tilted
//   a valley .................. of two planes, against the closed form of a gutter without end
//   random ground ............. against rays sent out by the cosine, marched over the facets
// export/lod_pictures.hpp, in files that GDAL and the decoders read:
//   normals ................... of a wave in closed form, where a texel stands, rows from the
//   north;
//                               none at full resolution, where the vertices have them
//   occlusion ................. sky_view at the place of a texel
//   texture coordinates ....... name the vertex's own place, for each compression
//   a tile of level 0 ......... keeps its own normals, one with a picture has them upright
//   what it costs ............. texture coordinates and upright normals less than normals did
// the same bytes for any number of threads; options that cannot be

#include <cstring>
#include <numbers>

#include <cpl_vsi.h>
#include <draco/compression/decode.h>
#include <gdal.h>
#include <gtest/gtest.h>
#include <meshoptimizer.h>
#include <tbb/global_control.h>
#include <nlohmann/json.hpp>

#include "core/random.hpp"
#include "export/cad.hpp"
#include "export/lod_set.hpp"
#include "export/lod_tileset.hpp"
#include "export/sky_view.hpp"
#include "support/matchers.hpp"
#include "support/terrain.hpp"

namespace maquette::exporting {
namespace {

namespace fs = std::filesystem;
using heightmap::ModelField;
using nlohmann::json;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

template <class Height>
ModelField field_of(std::ptrdiff_t rows, std::ptrdiff_t cols, double spacing_mm,
                    const Height& height) {
  ModelField f{Grid<float>(rows, cols), Millimetres{spacing_mm}, {}, {}};
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c)
      f.z_mm(r, c) = static_cast<float>(height(f.x_mm(c), f.y_mm(r)));
  return f;
}

Grid<float> sky_of(const ModelField& f) {
  const auto pyramid = LodPyramid::create(f, 1).value();
  return sky_view(f.z_mm, f.spacing.value(),
                  [&](std::ptrdiff_t r, std::ptrdiff_t c) { return pyramid.slope(0, r, c); });
}

TEST(SkyView, OfAPlaneIsAll) {
  for (const auto& [dx, dy] : {std::pair{0.0, 0.0}, {0.5, 0.0}, {0.3, -0.7}, {-1.5, 1.5}}) {
    const Grid<float> v =
        sky_of(field_of(40, 50, 0.5, [&](double x, double y) { return dx * x + dy * y; }));
    for (const float share : v.cells()) EXPECT_NEAR(share, 1.0F, 1e-5F);  // rounding of heights
  }
}

TEST(SkyView, OfAValleyIsThatOfAGutter) {
  // Two planes of 20 mm that rise from the middle, 400 mm long: the ends add less than 0.3 %.
  constexpr double kHalf = 20.0;
  for (const double slope : {0.3, 0.7, 1.5}) {
    const ModelField f =
        field_of(801, 81, 0.5, [&](double x, double) { return slope * std::fabs(x - kHalf); });
    const Grid<float> v = sky_of(f);
    for (const std::ptrdiff_t c : {44, 50, 60, 70}) {
      const double s = f.x_mm(c) - kHalf;
      // Crossed strings: from the own plane's edge to the far rim. 16 azimuths are 1 % off at most.
      const double rim = std::atan2(slope * (kHalf - s), kHalf + s);
      const double expected = 0.5 * (1.0 + std::cos(rim + std::atan(slope)));
      EXPECT_NEAR(static_cast<double>(v(400, c)), expected, 0.012) << slope << " at " << s;
    }
  }
}

TEST(SkyView, IsWhatRaysFind) {
  const ModelField f = field_of(61, 61, 0.5, [](double x, double y) {
    return 3.0 * std::sin(0.45 * x + 1.0) * std::cos(0.38 * y) + 1.2 * std::sin(1.1 * x - 0.9 * y);
  });
  const Grid<float> v = sky_of(f);
  const auto pyramid = LodPyramid::create(f, 1).value();
  constexpr std::uint64_t kRays = 4000;
  double squares = 0.0;
  int places = 0;
  for (std::ptrdiff_t r = 12; r < 50; r += 6)
    for (std::ptrdiff_t c = 12; c < 50; c += 6) {
      const auto [dx, dy] = pyramid.slope(0, r, c);
      const Vec3 n = normalized(Vec3{-static_cast<double>(dx), -static_cast<double>(dy), 1.0});
      const Vec3 e1 = normalized(cross(n, Vec3{0.3, 0.5, 0.1})), e2 = cross(n, e1);
      std::uint64_t free = 0;
      for (std::uint64_t k = 0; k < kRays; ++k) {
        const auto at = static_cast<std::uint64_t>(61 * r + c) * kRays + k;
        const double u = (static_cast<double>(k) + random_uniform(1, at)) / kRays,
                     turn = 2.0 * std::numbers::pi * random_uniform(2, at);
        const Vec3 way =
            std::sqrt(u) * (std::cos(turn) * e1 + std::sin(turn) * e2) + std::sqrt(1.0 - u) * n;
        Vec3 p{f.x_mm(c), f.y_mm(r), static_cast<double>(f.z_mm(r, c)) + 1e-3};
        bool met = false;
        for (int i = 0; i < 600 && !met; ++i) {
          p = p + 0.1 * way;
          const double ground = heightmap::height_at(f, p.x, p.y);
          if (std::isnan(ground)) break;
          met = p.z < ground;
        }
        free += met ? 0U : 1U;
      }
      const double off = static_cast<double>(v(r, c)) - static_cast<double>(free) / kRays;
      EXPECT_NEAR(off, 0.0, 0.05) << r << " " << c;  // a peak between two azimuths
      squares += off * off;
      ++places;
    }
  EXPECT_LT(std::sqrt(squares / places), 0.015);
}

// -- files --

/// Half a millimetre of amplitude over 24 mm: no texel is wider than a degree of turn.
double wave(double x, double y) {
  return 2.0 * std::sin(2.0 * std::numbers::pi * x / 24.0) +
         1.5 * std::cos(2.0 * std::numbers::pi * y / 30.0) + 0.1 * x;
}
Vec3 normal_of_wave(double x, double y) {
  const double kx = 2.0 * std::numbers::pi / 24.0, ky = 2.0 * std::numbers::pi / 30.0;
  return normalized(Vec3{-2.0 * kx * std::cos(kx * x) - 0.1, 1.5 * ky * std::sin(ky * y), 1.0});
}

LodSetOptions with_pictures(LodCompression compression, int texels = 64) {
  LodSetOptions options;
  options.tile_quads = 32;
  options.texels = texels;
  options.asset.compression = compression;
  return options;
}

struct Asset {
  json head;
  std::string binary;
};
Asset read_glb(const fs::path& path) {
  const std::string bytes = read_file(path).value();
  std::uint32_t size = 0;
  if (bytes.size() > 28) std::memcpy(&size, bytes.data() + 12, sizeof size);
  return {json::parse(bytes.substr(20, size)), bytes.substr(28 + size)};
}

struct Picture {
  int width = 0, height = 0;
  std::vector<std::vector<std::uint8_t>> bands;
};
/// What the material uses as `use`, read by GDAL.
Picture picture_of(const Asset& asset, const char* use) {
  const json& texture =
      asset.head["textures"][asset.head["materials"][0][use]["index"].get<std::size_t>()];
  const json& image = asset.head["images"][texture["source"].get<std::size_t>()];
  EXPECT_EQ(image["mimeType"], "image/png");
  const json& view = asset.head["bufferViews"][image["bufferView"].get<std::size_t>()];
  std::string png = asset.binary.substr(view["byteOffset"], view["byteLength"]);
  GDALAllRegister();
  VSIFCloseL(VSIFileFromMemBuffer("/vsimem/got.png", reinterpret_cast<GByte*>(png.data()),
                                  png.size(), FALSE));
  GDALDatasetH dataset = GDALOpen("/vsimem/got.png", GA_ReadOnly);
  EXPECT_NE(dataset, nullptr);
  Picture p{GDALGetRasterXSize(dataset), GDALGetRasterYSize(dataset), {}};
  for (int b = 1; b <= GDALGetRasterCount(dataset); ++b) {
    p.bands.emplace_back(static_cast<std::size_t>(p.width * p.height));
    EXPECT_EQ(GDALRasterIO(GDALGetRasterBand(dataset, b), GF_Read, 0, 0, p.width, p.height,
                           p.bands.back().data(), p.width, p.height, GDT_Byte, 0, 0),
              CE_None);
  }
  GDALClose(dataset);
  VSIUnlink("/vsimem/got.png");
  return p;
}

TEST(LodPictures, ShowTheFullSurfaceWhereTexelsStand) {
  const ModelField f = field_of(131, 150, 0.5, wave);
  const ScratchFolder scratch;
  const auto report = write_lod_set(f, {}, with_pictures(LodCompression::plain), scratch.path());
  ASSERT_THAT(report, Succeeds());
  const auto pyramid = LodPyramid::create(f, lod_levels(f, 32)).value();
  const Grid<float> light = lod_occlusion(pyramid);
  const int top = pyramid.levels() - 1;
  ASSERT_GE(top, 2);
  for (const LodTileReport& t : report->tiles) {
    const Asset asset =
        read_glb(scratch.path() / lod_tile_uri(top - t.key.level, t.key.x, t.key.y));
    const LodTileMesh tile = make_lod_tile(pyramid, report->lattice, t.key);
    const double side = static_cast<double>(
        std::max(tile.cols.back() - tile.cols.front(), tile.rows.back() - tile.rows.front()));
    const auto x_of = [&](int i, int texels) {
      return 0.5 * std::min(static_cast<double>(tile.cols.front()) + (i + 0.5) * side / texels,
                            static_cast<double>(tile.cols.back()));
    };
    const auto y_of = [&](int i, int texels) {
      return 0.5 * std::max(static_cast<double>(tile.rows.back()) - (i + 0.5) * side / texels,
                            static_cast<double>(tile.rows.front()));
    };
    EXPECT_EQ(asset.head["materials"][0].contains("normalTexture"), t.key.level > 0);
    if (t.key.level > 0) {
      const Picture normals = picture_of(asset, "normalTexture");
      ASSERT_EQ(normals.bands.size(), 3U);
      ASSERT_EQ(normals.width, 64);
      ASSERT_EQ(normals.height, 64);
      for (int row = 0; row < 64; ++row)
        for (int col = 0; col < 64; ++col) {
          const auto i = static_cast<std::size_t>(64 * row + col);
          const double x = x_of(col, 64), y = y_of(row, 64), edge = side / 64;
          const Vec3 n = normal_of_wave(x, y);
          // Half a number of 255, and the mean over a texel and its neighbours of slopes that bend
          // by (2 pi / 24)^2 a mm^2; at the outline slopes are one-sided, half a texel off.
          const bool inside = x > edge && y > edge && x < 74.5 - edge && y < 65.0 - edge;
          const double within = inside ? 0.5 / 127.5 + 0.02 : 0.12;
          EXPECT_NEAR(normals.bands[0][i] / 127.5 - 1.0, n.x, within) << x << " " << y;
          EXPECT_NEAR(normals.bands[1][i] / 127.5 - 1.0, n.y, within) << x << " " << y;
          EXPECT_NEAR(normals.bands[2][i] / 127.5 - 1.0, n.z, within) << x << " " << y;
        }
    }
    // Light stands on every second node: no picture has more texels than that.
    const Picture sky = picture_of(asset, "occlusionTexture");
    const int texels = std::clamp(static_cast<int>(side / 2.0), 1, 64);
    ASSERT_EQ(sky.bands.size(), 1U);
    ASSERT_EQ(sky.width, texels);
    ASSERT_EQ(sky.height, texels);
    for (int row = 0; row < texels; ++row)
      for (int col = 0; col < texels; ++col) {
        const double x = x_of(col, texels), y = y_of(row, texels);
        const auto r = std::clamp<std::ptrdiff_t>(std::lround(y), 0, light.rows() - 1),
                   c = std::clamp<std::ptrdiff_t>(std::lround(x), 0, light.cols() - 1);
        // The nearest node of the light, which stands every mm: it changes by less than that.
        EXPECT_NEAR(sky.bands[0][static_cast<std::size_t>(texels * row + col)] / 255.0,
                    static_cast<double>(light(r, c)), 0.06)
            << x << " " << y;
      }
  }
}

/// Position (east, south, whole steps) and texture coordinate of each vertex, as decoded.
struct Vertex {
  double east, south, u, v;
  Vec3 normal;
};
std::vector<Vertex> vertices_of(const Asset& asset, LodCompression compression) {
  std::vector<Vertex> all;
  const json& head = asset.head;
  if (compression == LodCompression::draco) {
    draco::DecoderBuffer buffer;
    buffer.Init(asset.binary.data(), head["bufferViews"][0]["byteLength"].get<std::size_t>());
    draco::Decoder decoder;
    const auto mesh = decoder.DecodeMeshFromBuffer(&buffer).value();
    const json& ids = head["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"]
                          ["attributes"];
    const auto at = [&](const char* name, draco::PointIndex i, float* to) {
      mesh->GetAttributeByUniqueId(ids[name].get<std::uint32_t>())->GetMappedValue(i, to);
    };
    for (std::uint32_t i = 0; i < mesh->num_points(); ++i) {
      std::array<float, 3> p{}, n{};
      std::array<float, 2> t{};
      at("POSITION", draco::PointIndex(i), p.data());
      at("NORMAL", draco::PointIndex(i), n.data());
      at("TEXCOORD_0", draco::PointIndex(i), t.data());
      // Up is x inside, the node turns it: (up, south, east).
      all.push_back(
          {p[2],
           p[1],
           t[0],
           t[1],
           {static_cast<double>(n[2]), static_cast<double>(n[0]), static_cast<double>(n[1])}});
    }
    return all;
  }
  std::vector<std::vector<unsigned char>> views;
  for (const std::size_t k : {0U, 2U, 3U}) {
    const json& view = head["bufferViews"][k];
    if (compression == LodCompression::plain) {
      const std::string bytes = asset.binary.substr(view["byteOffset"], view["byteLength"]);
      views.emplace_back(bytes.begin(), bytes.end());
      continue;
    }
    const json& e = view["extensions"]["EXT_meshopt_compression"];
    const auto count = e["count"].get<std::size_t>(), stride = e["byteStride"].get<std::size_t>();
    std::vector<unsigned char> out(count * stride);
    EXPECT_EQ(
        meshopt_decodeVertexBuffer(out.data(), count, stride,
                                   reinterpret_cast<const unsigned char*>(asset.binary.data()) +
                                       e["byteOffset"].get<std::size_t>(),
                                   e["byteLength"].get<std::size_t>()),
        0);
    if (e.contains("filter")) meshopt_decodeFilterOct(out.data(), count, stride);
    views.push_back(std::move(out));
  }
  const auto count = head["accessors"][0]["count"].get<std::size_t>();
  const bool plain = compression == LodCompression::plain;
  const auto number = [&](std::size_t view, std::size_t i, std::size_t k) {
    const unsigned char* bytes = views[view].data();
    if (plain) {
      const std::size_t size = view == 2 ? 2 : 3;
      return static_cast<double>(reinterpret_cast<const float*>(bytes)[size * i + k]);
    }
    if (view == 0) return double(reinterpret_cast<const std::uint16_t*>(bytes)[4 * i + k]);
    if (view == 1) return reinterpret_cast<const std::int8_t*>(bytes)[4 * i + k] / 127.0;
    return reinterpret_cast<const std::uint16_t*>(bytes)[2 * i + k] / 65535.0;
  };
  for (std::size_t i = 0; i < count; ++i)
    all.push_back({number(0, i, 0),
                   number(0, i, 2),
                   number(2, i, 0),
                   number(2, i, 1),
                   {number(1, i, 0), number(1, i, 1), number(1, i, 2)}});
  return all;
}

TEST(LodPictures, TextureCoordinatesNameTheirPlace) {
  const ModelField f = field_of(131, 150, 0.5, wave);
  for (const auto compression :
       {LodCompression::draco, LodCompression::meshopt, LodCompression::plain}) {
    const ScratchFolder scratch;
    const auto report = write_lod_set(f, {}, with_pictures(compression), scratch.path());
    ASSERT_THAT(report, Succeeds());
    const auto pyramid = LodPyramid::create(f, lod_levels(f, 32)).value();
    const int top = pyramid.levels() - 1;
    for (const LodTileReport& t : report->tiles) {
      const Asset asset =
          read_glb(scratch.path() / lod_tile_uri(top - t.key.level, t.key.x, t.key.y));
      const LodTileMesh tile = make_lod_tile(pyramid, report->lattice, t.key);
      const double side = report->lattice.steps_per_quad *
                          static_cast<double>(std::max(tile.cols.back() - tile.cols.front(),
                                                       tile.rows.back() - tile.rows.front()));
      // Sixteen bits for meshopt, floats of up to 2 rounded three times for the others.
      const double within = compression == LodCompression::meshopt ? 0.51 / 65535.0 : 6e-7;
      bool upright = true;
      for (const Vertex& v : vertices_of(asset, compression)) {
        EXPECT_NEAR(v.u, v.east / side, within);
        EXPECT_NEAR(v.v, v.south / side, within);
        upright &= v.normal.y > 1.0 - 1e-6;
      }
      EXPECT_EQ(upright, t.key.level > 0);
    }
  }
}

TEST(LodPictures, CostLessInTheMeshThanNormals) {
  const ModelField f = field_of(257, 257, 0.5, [](double x, double y) {
    return wave(x, y) + 0.1 * random_uniform(3, static_cast<std::uint64_t>(1e3 * x + 7e5 * y));
  });
  const auto mesh_bytes = [&](int texels) {
    const ScratchFolder scratch;
    LodSetOptions options = with_pictures(LodCompression::draco, texels);
    options.tile_quads = 128;
    EXPECT_THAT(write_lod_set(f, {}, options, scratch.path()), Succeeds());
    return read_glb(scratch.path() / lod_tile_uri(0, 0, 0))
        .head["bufferViews"][0]["byteLength"]
        .get<std::size_t>();
  };
  EXPECT_LT(mesh_bytes(64), mesh_bytes(0));
}

TEST(LodPictures, AreTheSameForAnyThreads) {
  const ModelField f = field_of(131, 150, 0.5, wave);
  std::vector<std::string> bytes;
  for (const std::size_t threads : {1U, 3U}) {
    const tbb::global_control limit(tbb::global_control::max_allowed_parallelism, threads);
    const ScratchFolder scratch;
    ASSERT_THAT(write_lod_set(f, {}, with_pictures(LodCompression::draco), scratch.path()),
                Succeeds());
    bytes.push_back(read_file(scratch.path() / lod_tile_uri(0, 0, 0)).value());
  }
  EXPECT_EQ(bytes[0], bytes[1]);
}

TEST(LodPictures, RefusesWhatCannotBe) {
  const ModelField f = field_of(40, 40, 0.5, wave);
  const ScratchFolder scratch;
  for (const int texels : {-1, 8, 8192})
    EXPECT_THAT(write_lod_set(f, {}, with_pictures(LodCompression::draco, texels), scratch.path()),
                FailsWith(kOptionOutOfRange));
  LodSetOptions flat = with_pictures(LodCompression::draco);
  flat.asset.normals = false;
  EXPECT_THAT(write_lod_set(f, {}, flat, scratch.path()), FailsWith(kOptionOutOfRange));
}

}  // namespace
}  // namespace maquette::exporting

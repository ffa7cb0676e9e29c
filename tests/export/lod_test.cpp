// SPDX-License-Identifier: GPL-3.0-or-later

// export/lod_pyramid.hpp, lod_tile.hpp:
//   levels keep a plane ............... heights and slopes of a tilted one, any size of grid
//   smooth errs less than sample ...... rms on fractal ground, both measured here by hand
//   tiles fill their rectangle ........ areas add up exactly, all counter-clockwise
//   no crack, T-junction or overlap ... random cuts through the quadtree, neighbours of levels that
//                                       differ by up to four: welded by their whole numbers, every
//                                       edge has two triangles but on the outline
//   vertical error .................... against dense sampling by height_at: never above; level 1
//                                       exactly, where samples hit all crossings; of a plane half a
//                                       step
//   Hausdorff at nodes ................ by trying all triangles, both ways
// export/lod_set.hpp:
//   what a decoder gets ............... Draco's and meshoptimizer's own: the tile's whole numbers
//   normals of draco .................. octahedral coordinates within what their bits say, the same
//                                       bits on a side that two tiles of a level share; cost less
//                                       than rounding that does not look at the prediction
//   a wide tile ....................... more than 2^18 steps: no leap in bytes
//   step * numbers is the model ....... each vertex of the finest level within half a step
//   tilesets .......................... boxes contain content and children, errors do not rise
//                                       downwards and hold each tile's; subtrees name the same
//                                       tiles, boxes and errors
//   place on a body ................... against GeographicLib-free closed forms on a sphere, and
//                                       the normal of the ellipsoid; the transform is rigid, boxes
//                                       and errors are metres at full size, and an engine of floats
//                                       keeps 1 um of the model
//   stones ............................ instances decode to stone_mesh, floats apart; merged they
//                                       are its triangles, each vertex with its stone; coarse ones
//                                       are as far off as is said, by trying all triangles
//   same bytes for any thread count; a second run keeps every tile that is whole, other options
//   none each error code

#include <cstring>
#include <map>
#include <numbers>
#include <set>

#include <draco/compression/decode.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <meshoptimizer.h>
#include <tbb/global_control.h>
#include <nlohmann/json.hpp>

#include "core/random.hpp"
#include "core/triangle_distance.hpp"
#include "export/cad.hpp"
#include "export/gltf.hpp"
#include "export/lod_set.hpp"
#include "export/lod_tileset.hpp"
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

/// Octaves of waves, each half as long and 0.55 as high.
ModelField relief(std::ptrdiff_t rows, std::ptrdiff_t cols, double spacing_mm = 0.5) {
  ModelField f{Grid<float>(rows, cols), Millimetres{spacing_mm}, Millimetres{-7.0},
               Millimetres{3.0}};
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c) {
      double z = 0.0, high = 6.0, length = 90.0;
      for (std::uint64_t k = 0; k < 6; ++k, high *= 0.55, length *= 0.5) {
        const double turn = 6.3 * random_uniform(5, k);
        z += high * std::sin(6.3 / length *
                                 (static_cast<double>(c) * std::cos(turn) +
                                  static_cast<double>(r) * std::sin(turn)) +
                             static_cast<double>(k));
      }
      z += 0.1 * random_uniform(9, static_cast<std::uint64_t>(r * cols + c));
      f.z_mm(r, c) = static_cast<float>(z);
    }
  return f;
}

ModelField plane(std::ptrdiff_t rows, std::ptrdiff_t cols) {
  ModelField f{Grid<float>(rows, cols), Millimetres{0.5}, {}, {}};
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c)
      f.z_mm(r, c) =
          static_cast<float>(0.25 * static_cast<double>(c) - 0.125 * static_cast<double>(r));
  return f;
}

LodSetOptions small_tiles(std::ptrdiff_t quads = 16) {
  LodSetOptions options;
  options.tile_quads = quads;
  return options;
}

/// Sizes that leave parts of tiles, single quads and levels without a regular last node.
const std::vector<std::pair<std::ptrdiff_t, std::ptrdiff_t>> kSizes{
    {129, 129}, {130, 131}, {114, 67}, {200, 33}, {18, 18}, {17, 100}, {16, 5}, {2, 2}};

TEST(LodPyramid, KeepsAPlane) {
  for (const auto& [rows, cols] : kSizes) {
    const ModelField f = plane(rows, cols);
    const auto pyramid = LodPyramid::create(f, 5);
    ASSERT_THAT(pyramid, Succeeds());
    for (int level = 0; level < 5; ++level) {
      const Grid<float>& z = pyramid->heights_mm(level);
      ASSERT_EQ(z.rows(), lod_nodes(rows, level));
      for (std::ptrdiff_t r = 0; r < z.rows(); ++r)
        for (std::ptrdiff_t c = 0; c < z.cols(); ++c) {
          // Dyadic numbers: exact.
          EXPECT_EQ(z(r, c), f.z_mm(lod_node(rows, level, r), lod_node(cols, level, c)));
          EXPECT_EQ(pyramid->slope(level, r, c), (LodPyramid::Slope{0.5F, -0.25F}));
        }
    }
  }
}

TEST(LodPyramid, SmoothErrsLessThanSample) {
  const ModelField f = relief(257, 257);
  std::array<double, 2> rms{};
  for (const auto filter : {LodFilter::smooth, LodFilter::sample}) {
    const auto pyramid = LodPyramid::create(f, 3, filter);
    ASSERT_THAT(pyramid, Succeeds());
    ModelField coarse{pyramid->heights_mm(2), Millimetres{2.0}, f.x0, f.y0};
    double squares = 0.0;
    for (std::ptrdiff_t r = 0; r < 257; ++r)
      for (std::ptrdiff_t c = 0; c < 257; ++c)
        squares += std::pow(
            heightmap::height_at(coarse, f.x_mm(c), f.y_mm(r)) - static_cast<double>(f.z_mm(r, c)),
            2);
    rms[filter == LodFilter::smooth ? 0 : 1] = std::sqrt(squares / (257.0 * 257.0));
  }
  EXPECT_LT(rms[0], 0.9 * rms[1]);
}

std::int64_t twice_area(const LodTileMesh& tile, const std::array<std::uint32_t, 3>& t) {
  const LodVertex &a = tile.vertices[t[0]], &b = tile.vertices[t[1]], &c = tile.vertices[t[2]];
  return std::int64_t{b.col - a.col} * (c.row - a.row) -
         std::int64_t{b.row - a.row} * (c.col - a.col);
}

TEST(LodTile, FillsItsRectangle) {
  for (const auto& [rows, cols] : kSizes) {
    const ModelField f = relief(rows, cols);
    const auto lattice = lod_lattice(f, small_tiles());
    ASSERT_THAT(lattice, Succeeds());
    const int levels = lod_levels(f, 16);
    const auto pyramid = LodPyramid::create(f, levels);
    for (int level = 0; level < levels; ++level) {
      std::int64_t whole = 0;
      for (std::ptrdiff_t y = 0; y < lod_tiles(rows, *lattice, level); ++y)
        for (std::ptrdiff_t x = 0; x < lod_tiles(cols, *lattice, level); ++x) {
          const LodTileMesh tile = make_lod_tile(*pyramid, *lattice, {level, x, y});
          for (const auto& t : tile.triangles) {
            EXPECT_GT(twice_area(tile, t), 0);
            whole += twice_area(tile, t);
          }
        }
      EXPECT_EQ(whole, 2 * (rows - 1) * (cols - 1)) << rows << " " << cols << " level " << level;
    }
  }
}

/// A cut through the quadtree: each tile itself or its children, by a throw of dice.
void choose(const ModelField& f, const LodLattice& lattice, LodTileKey key, std::uint64_t seed,
            std::vector<LodTileKey>& chosen) {
  if (key.x >= lod_tiles(f.z_mm.cols(), lattice, key.level) ||
      key.y >= lod_tiles(f.z_mm.rows(), lattice, key.level))
    return;
  const auto draw = static_cast<std::uint64_t>(key.level * 1000003 + key.x * 1009 + key.y);
  if (key.level == 0 || random_uniform(seed, draw) < 0.35) {
    chosen.push_back(key);
    return;
  }
  for (const std::ptrdiff_t i : {0, 1})
    for (const std::ptrdiff_t j : {0, 1})
      choose(f, lattice, {key.level - 1, 2 * key.x + i, 2 * key.y + j}, seed, chosen);
}

TEST(LodTile, NeighboursOfAnyLevelsMeet) {
  int differ_most = 0;
  for (const auto& [rows, cols] :
       std::vector<std::pair<std::ptrdiff_t, std::ptrdiff_t>>{{257, 257}, {250, 263}, {300, 81}}) {
    const ModelField f = relief(rows, cols);
    const auto lattice = lod_lattice(f, small_tiles());
    const int levels = lod_levels(f, 16);
    const auto pyramid = LodPyramid::create(f, levels);
    std::map<LodTileKey, LodTileMesh, decltype([](const LodTileKey& a, const LodTileKey& b) {
               return std::tuple(a.level, a.x, a.y) < std::tuple(b.level, b.x, b.y);
             })>
        tiles;
    for (std::uint64_t seed = 0; seed < 40; ++seed) {
      std::vector<LodTileKey> chosen;
      choose(f, *lattice, {levels - 1, 0, 0}, seed, chosen);
      using Corner = std::array<std::int64_t, 3>;
      std::map<std::pair<Corner, Corner>, std::vector<int>>
          edges;  // directed; levels of its owners
      for (const LodTileKey& key : chosen) {
        if (!tiles.contains(key)) tiles[key] = make_lod_tile(*pyramid, *lattice, key);
        const LodTileMesh& tile = tiles.at(key);
        const auto corner = [&](std::uint32_t v) {
          const LodVertex& p = tile.vertices[v];
          return Corner{p.col, p.row, p.height};
        };
        for (const auto& t : tile.triangles)
          for (std::size_t k = 0; k < 3; ++k)
            edges[{corner(t[k]), corner(t[(k + 1) % 3])}].push_back(key.level);
      }
      std::size_t open = 0;
      for (const auto& [edge, owners] : edges) {
        ASSERT_EQ(owners.size(), 1U) << "overlap";
        const auto other = edges.find({edge.second, edge.first});
        if (other != edges.end()) {
          differ_most = std::max(differ_most, std::abs(owners[0] - other->second[0]));
          continue;
        }
        ++open;
        const auto on = [&](std::size_t axis, std::int64_t value) {
          return edge.first[axis] == value && edge.second[axis] == value;
        };
        ASSERT_TRUE(on(0, 0) || on(0, cols - 1) || on(1, 0) || on(1, rows - 1))
            << "seed " << seed << ": crack at column " << edge.first[0] << " row " << edge.first[1];
      }
      EXPECT_GT(open, 0U);
    }
  }
  EXPECT_EQ(differ_most, 4);
}

TEST(LodTile, NeighboursOfALevelShadeAlike) {
  const ModelField f = relief(250, 263);
  const auto lattice = lod_lattice(f, small_tiles());
  const auto pyramid = LodPyramid::create(f, lod_levels(f, 16));
  for (int level = 0; level < pyramid->levels(); ++level) {
    std::map<std::pair<int, int>, std::array<float, 2>> slope_at;
    std::size_t shared = 0;
    for (std::ptrdiff_t y = 0; y < lod_tiles(250, *lattice, level); ++y)
      for (std::ptrdiff_t x = 0; x < lod_tiles(263, *lattice, level); ++x)
        for (const LodVertex& v : make_lod_tile(*pyramid, *lattice, {level, x, y}).vertices) {
          const auto [at, fresh] = slope_at.insert({{v.col, v.row}, v.slope});
          if (fresh) continue;
          ++shared;
          EXPECT_EQ(at->second, v.slope);
        }
    EXPECT_EQ(shared > 0, level + 1 < pyramid->levels());
  }
}

/// Height of the tile's triangles at a place, millimetres.
double tile_height(const LodTileMesh& tile, const LodLattice& lattice, double col, double row) {
  for (const auto& t : tile.triangles) {
    const LodVertex &a = tile.vertices[t[0]], &b = tile.vertices[t[1]], &c = tile.vertices[t[2]];
    const auto area = static_cast<double>(twice_area(tile, t));
    const double s = ((col - a.col) * (c.row - a.row) - (row - a.row) * (c.col - a.col)) / area;
    const double u = ((b.col - a.col) * (row - a.row) - (b.row - a.row) * (col - a.col)) / area;
    if (s < -1e-9 || u < -1e-9 || s + u > 1.0 + 1e-9) continue;
    return lattice.step_mm * (a.height + s * (b.height - a.height) + u * (c.height - a.height));
  }
  ADD_FAILURE() << "no triangle over " << col << " " << row;
  return 0.0;
}

TEST(LodError, IsTheLargestThatDenseSamplingFinds) {
  for (const auto& [rows, cols] : kSizes) {
    if (rows < 17) continue;
    const ModelField f = relief(rows, cols);
    const auto lattice = lod_lattice(f, small_tiles());
    const int levels = lod_levels(f, 16);
    const auto pyramid = LodPyramid::create(f, levels);
    for (int level = 0; level < std::min(levels, 4); ++level) {
      const LodTileKey key{level, lod_tiles(cols, *lattice, level) - 1, 0};
      const LodTileMesh tile = make_lod_tile(*pyramid, *lattice, key);
      const LodTileError error = measure_lod_tile(f, *lattice, tile);
      double largest = 0.0, squares = 0.0;
      std::size_t nodes = 0;
      // Samples a quad. Edges of level 1 cross those of the field at halves and thirds: all hit.
      const int dense = level == 1 ? 12 : 4;
      for (std::ptrdiff_t i = dense * tile.rows.front(); i <= dense * tile.rows.back(); ++i)
        for (std::ptrdiff_t j = dense * tile.cols.front(); j <= dense * tile.cols.back(); ++j) {
          const double col = static_cast<double>(j) / dense, row = static_cast<double>(i) / dense;
          const double off = tile_height(tile, *lattice, col, row) -
                             heightmap::height_at(f, f.x0.value() + f.spacing.value() * col,
                                                  f.y0.value() + f.spacing.value() * row);
          largest = std::max(largest, std::fabs(off));
          if (i % dense != 0 || j % dense != 0) continue;
          squares += off * off;
          ++nodes;
        }
      // height_at interpolates between floats in another order: rounding.
      EXPECT_LE(largest, error.vertical_mm + 1e-9) << rows << " " << cols << " level " << level;
      EXPECT_GE(largest, level <= 1 ? error.vertical_mm - 1e-9 : 0.9 * error.vertical_mm)
          << rows << " " << cols << " level " << level;
      EXPECT_NEAR(std::sqrt(squares / static_cast<double>(nodes)), error.rms_mm,
                  1e-9 + 1e-9 * error.rms_mm);
    }
  }
}

TEST(LodError, HausdorffIsThatOfAllTriangles) {
  const ModelField f = relief(66, 70, 0.25);
  const auto lattice = lod_lattice(f, small_tiles(32));
  const auto pyramid = LodPyramid::create(f, lod_levels(f, 32));
  const LodTileMesh tile = make_lod_tile(*pyramid, *lattice, {1, 1, 0});
  const LodTileError error = measure_lod_tile(f, *lattice, tile);
  const auto model = [&](double col, double row, double z) {
    return Vec3{0.25 * col, 0.25 * row, z};
  };
  std::vector<std::array<Vec3, 3>> coarse, fine;
  for (const auto& t : tile.triangles) {
    coarse.emplace_back();
    for (std::size_t k = 0; k < 3; ++k) {
      const LodVertex& v = tile.vertices[t[k]];
      coarse.back()[k] = model(v.col, v.row, lattice->step_mm * v.height);
    }
  }
  const auto node = [&](std::ptrdiff_t r, std::ptrdiff_t c) {
    return model(static_cast<double>(c), static_cast<double>(r), static_cast<double>(f.z_mm(r, c)));
  };
  for (std::ptrdiff_t r = tile.rows.front(); r < tile.rows.back(); ++r)
    for (std::ptrdiff_t c = tile.cols.front(); c < tile.cols.back(); ++c) {
      fine.push_back({node(r, c), node(r, c + 1), node(r + 1, c + 1)});
      fine.push_back({node(r, c), node(r + 1, c + 1), node(r + 1, c)});
    }
  const auto distance = [](Vec3 p, const std::vector<std::array<Vec3, 3>>& triangles) {
    double best2 = INFINITY;
    for (const auto& t : triangles)
      best2 = std::min(best2, triangle_distance2(p, t[0], t[1], t[2]));
    return std::sqrt(best2);
  };
  double farthest = 0.0;
  for (std::ptrdiff_t r = tile.rows.front(); r <= tile.rows.back(); ++r)
    for (std::ptrdiff_t c = tile.cols.front(); c <= tile.cols.back(); ++c) {
      const double z = tile_height(tile, *lattice, static_cast<double>(c), static_cast<double>(r));
      farthest =
          std::max({farthest, distance(node(r, c), coarse),
                    distance(model(static_cast<double>(c), static_cast<double>(r), z), fine)});
    }
  EXPECT_NEAR(error.hausdorff_mm, farthest, 1e-9);
  EXPECT_LE(error.hausdorff_mm, error.vertical_mm);
}

TEST(LodError, OfAPlaneIsHalfAStepAtMost) {
  const ModelField f = plane(130, 131);
  const auto lattice = lod_lattice(f, small_tiles());
  const int levels = lod_levels(f, 16);
  const auto pyramid = LodPyramid::create(f, levels);
  for (int level = 0; level < levels; ++level)
    EXPECT_LE(
        measure_lod_tile(f, *lattice, make_lod_tile(*pyramid, *lattice, {level, 0, 0})).vertical_mm,
        0.5 * lattice->step_mm * (1.0 + 1e-9));
}

// -- files --

template <class T>
T value_at(const std::string& bytes, std::size_t at) {
  T value{};
  EXPECT_LE(at + sizeof value, bytes.size());
  std::memcpy(&value, bytes.data() + at, sizeof value);
  return value;
}

struct Asset {
  json head;
  std::string binary;
};
Asset read_glb(const fs::path& path) {
  const std::string bytes = read_file(path).value();
  const auto size = value_at<std::uint32_t>(bytes, 12);
  EXPECT_EQ(value_at<std::uint32_t>(bytes, 8), bytes.size());
  return {json::parse(bytes.substr(20, size)), bytes.substr(28 + size)};
}

/// By a node's rotation, if it has one.
Vec3 turned(const json& node, Vec3 v) {
  if (!node.contains("rotation")) return v;
  const auto q = node["rotation"].get<std::array<double, 4>>();
  return rotate(Quaternion{q[3], q[0], q[1], q[2]}, v);
}

using Whole = std::array<std::int64_t, 3>;
struct Decoded {
  std::set<Whole> positions;
  std::multiset<std::array<Whole, 3>> triangles;  ///< each from its smallest corner on
};

void add_triangle(Decoded& decoded, std::array<Whole, 3> t) {
  std::rotate(t.begin(), std::min_element(t.begin(), t.end()), t.end());
  decoded.triangles.insert(t);
}

Decoded expected_of(const LodTileMesh& tile, const LodLattice& lattice) {
  std::int32_t lowest = tile.vertices.front().height;
  for (const LodVertex& v : tile.vertices) lowest = std::min(lowest, v.height);
  const auto whole = [&](std::uint32_t i) {
    const LodVertex& v = tile.vertices[i];
    return Whole{(v.col - tile.cols.front()) * lattice.steps_per_quad, v.height - lowest,
                 (tile.rows.back() - v.row) * lattice.steps_per_quad};
  };
  Decoded d;
  for (std::uint32_t i = 0; i < tile.vertices.size(); ++i) d.positions.insert(whole(i));
  for (const auto& t : tile.triangles) add_triangle(d, {whole(t[0]), whole(t[1]), whole(t[2])});
  return d;
}

std::unique_ptr<draco::Mesh> draco_mesh(const Asset& asset) {
  draco::DecoderBuffer buffer;
  buffer.Init(asset.binary.data(), asset.head["bufferViews"][0]["byteLength"].get<std::size_t>());
  draco::Decoder decoder;
  auto result = decoder.DecodeMeshFromBuffer(&buffer);
  EXPECT_TRUE(result.ok()) << result.status().error_msg_string();
  return std::move(result).value();
}

/// Of an attribute that the glTF names, as the decoder has it, turned by the node.
Vec3 draco_value(const Asset& asset, const draco::Mesh& mesh, const char* attribute,
                 draco::PointIndex i) {
  const json& e =
      asset.head["meshes"][0]["primitives"][0]["extensions"]["KHR_draco_mesh_compression"];
  std::array<float, 3> v{};
  mesh.GetAttributeByUniqueId(e["attributes"][attribute].get<std::uint32_t>())
      ->GetMappedValue(i, v.data());
  return turned(asset.head["nodes"][0],
                {static_cast<double>(v[0]), static_cast<double>(v[1]), static_cast<double>(v[2])});
}

Decoded decode_draco(const Asset& asset) {
  const auto mesh = draco_mesh(asset);
  const auto whole = [&](draco::PointIndex i) {
    const Vec3 p = draco_value(asset, *mesh, "POSITION", i);
    const Whole w{std::llround(p.x), std::llround(p.y), std::llround(p.z)};
    EXPECT_EQ(
        p, (Vec3{static_cast<double>(w[0]), static_cast<double>(w[1]), static_cast<double>(w[2])}));
    return w;
  };
  Decoded d;
  for (std::uint32_t i = 0; i < mesh->num_points(); ++i)
    d.positions.insert(whole(draco::PointIndex(i)));
  for (std::uint32_t i = 0; i < mesh->num_faces(); ++i) {
    const auto& f = mesh->face(draco::FaceIndex(i));
    add_triangle(d, {whole(f[0]), whole(f[1]), whole(f[2])});
  }
  EXPECT_EQ(asset.head["accessors"][0]["count"], mesh->num_points());
  EXPECT_EQ(asset.head["accessors"][1]["count"], 3 * mesh->num_faces());
  return d;
}

Decoded decode_meshopt(const Asset& asset) {
  std::vector<std::vector<unsigned char>> views;
  for (const json& view : asset.head["bufferViews"]) {
    const json& e = view["extensions"]["EXT_meshopt_compression"];
    const auto count = e["count"].get<std::size_t>(), stride = e["byteStride"].get<std::size_t>();
    const auto* bytes = reinterpret_cast<const unsigned char*>(asset.binary.data()) +
                        e["byteOffset"].get<std::size_t>();
    const auto size = e["byteLength"].get<std::size_t>();
    std::vector<unsigned char> out(count * stride);
    EXPECT_EQ(e["mode"] == "TRIANGLES"
                  ? meshopt_decodeIndexBuffer(out.data(), count, stride, bytes, size)
                  : meshopt_decodeVertexBuffer(out.data(), count, stride, bytes, size),
              0);
    views.push_back(std::move(out));
  }
  const bool wide = asset.head["accessors"][0]["componentType"] == 5126;
  const bool short_indices = asset.head["accessors"][1]["componentType"] == 5123;
  const auto whole = [&](std::size_t corner) {
    const std::size_t i = short_indices
                              ? reinterpret_cast<const std::uint16_t*>(views[1].data())[corner]
                              : reinterpret_cast<const std::uint32_t*>(views[1].data())[corner];
    Whole w{};
    for (std::size_t k = 0; k < 3; ++k)
      w[k] = wide ? std::llround(reinterpret_cast<const float*>(views[0].data())[3 * i + k])
                  : reinterpret_cast<const std::uint16_t*>(views[0].data())[4 * i + k];
    return w;
  };
  Decoded d;
  const auto corners = asset.head["accessors"][1]["count"].get<std::size_t>();
  for (std::size_t i = 0; i < corners; i += 3) {
    const std::array<Whole, 3> t{whole(i), whole(i + 1), whole(i + 2)};
    d.positions.insert(t.begin(), t.end());
    add_triangle(d, t);
  }
  return d;
}

Decoded decode_plain(const Asset& asset) {
  const auto* positions = reinterpret_cast<const float*>(asset.binary.data());
  const auto* indices = reinterpret_cast<const std::uint32_t*>(
      asset.binary.data() + asset.head["bufferViews"][1]["byteOffset"].get<std::size_t>());
  Decoded d;
  for (std::size_t i = 0; i < asset.head["accessors"][1]["count"].get<std::size_t>(); i += 3) {
    std::array<Whole, 3> t{};
    for (std::size_t k = 0; k < 3; ++k)
      for (std::size_t axis = 0; axis < 3; ++axis)
        t[k][axis] = std::llround(positions[3 * indices[i + k] + axis]);
    d.positions.insert(t.begin(), t.end());
    add_triangle(d, t);
  }
  return d;
}

TEST(LodSet, DecodersGetTheLattice) {
  const ModelField f = relief(131, 150);
  for (const int bits : {12, 16, 20})
    for (const auto compression :
         {LodCompression::draco, LodCompression::meshopt, LodCompression::plain}) {
      const ScratchFolder scratch;
      LodSetOptions options = small_tiles(32);
      options.position_bits = bits;
      options.asset.compression = compression;
      const auto report = write_lod_set(f, {}, options, scratch.path());
      ASSERT_THAT(report, Succeeds());
      const auto pyramid = LodPyramid::create(f, lod_levels(f, 32));
      const int top = pyramid->levels() - 1;
      for (const LodTileReport& t : report->tiles) {
        const Asset asset =
            read_glb(scratch.path() / lod_tile_uri(top - t.key.level, t.key.x, t.key.y));
        const LodTileMesh tile = make_lod_tile(*pyramid, report->lattice, t.key);
        const Decoded expected = expected_of(tile, report->lattice);
        const Decoded got = compression == LodCompression::draco     ? decode_draco(asset)
                            : compression == LodCompression::meshopt ? decode_meshopt(asset)
                                                                     : decode_plain(asset);
        EXPECT_EQ(got.positions, expected.positions);
        EXPECT_EQ(got.triangles, expected.triangles);
        // The node puts the tile where it belongs, to a double's rounding.
        const double step = 1e-3 * report->lattice.step_mm;
        const json& node = asset.head["nodes"][0];
        EXPECT_EQ(node["scale"], json({step, step, step}));
        EXPECT_NEAR(node["translation"][0].get<double>(),
                    0.5e-3 * static_cast<double>(tile.cols.front()), 1e-15);
        EXPECT_NEAR(node["translation"][2].get<double>(),
                    -0.5e-3 * static_cast<double>(tile.rows.back()), 1e-15);
        EXPECT_NEAR(node["translation"][1].get<double>(), step * t.lowest, 1e-15);
        const auto bound = [&](const char* which) {
          const auto v = asset.head["accessors"][0][which].get<std::array<double, 3>>();
          return turned(node, {v[0], v[1], v[2]});
        };
        Vec3 most;
        for (const Whole& w : expected.positions)
          most = {std::max(most.x, static_cast<double>(w[0])),
                  std::max(most.y, static_cast<double>(w[1])),
                  std::max(most.z, static_cast<double>(w[2]))};
        EXPECT_EQ(bound("min"), Vec3{});
        EXPECT_EQ(bound("max"), most);
      }
      EXPECT_LE(report->levels[0].error.vertical_mm, 0.5 * report->lattice.step_mm * (1 + 1e-6));
    }
}

/// x and z of a direction on the octahedron |x| + |y| + |z| = 1, y up.
std::array<double, 2> octahedral(Vec3 v) {
  const double sum = std::fabs(v.x) + std::fabs(v.y) + std::fabs(v.z);
  return {v.x / sum, v.z / sum};
}

TEST(LodSet, NormalsOfDracoKeepTheirBits) {
  const ModelField f = relief(131, 150);
  for (const int position_bits : {12, 20})
    for (const int normal_bits : {5, 7, 10}) {
      const ScratchFolder scratch;
      LodSetOptions options = small_tiles(32);
      options.position_bits = position_bits;
      options.asset.normal_bits = normal_bits;
      const auto report = write_lod_set(f, {}, options, scratch.path());
      ASSERT_THAT(report, Succeeds());
      const auto pyramid = LodPyramid::create(f, lod_levels(f, 32));
      const int top = pyramid->levels() - 1;
      // 0.6 of a step, and the rounding of floats.
      const double most = 1.2 / (std::exp2(normal_bits) - 2.0) + 2e-7;
      double worst = 0.0;
      std::map<std::array<std::int64_t, 3>, Vec3> of_level;  // level, column, row
      std::size_t shared = 0;
      for (const LodTileReport& t : report->tiles) {
        const Asset asset =
            read_glb(scratch.path() / lod_tile_uri(top - t.key.level, t.key.x, t.key.y));
        const LodTileMesh tile = make_lod_tile(*pyramid, report->lattice, t.key);
        std::map<std::array<std::int64_t, 2>, const LodVertex*> at;
        for (const LodVertex& v : tile.vertices) at[{v.col, v.row}] = &v;
        const auto mesh = draco_mesh(asset);
        for (std::uint32_t i = 0; i < mesh->num_points(); ++i) {
          const Vec3 p = draco_value(asset, *mesh, "POSITION", draco::PointIndex(i));
          const Vec3 n = draco_value(asset, *mesh, "NORMAL", draco::PointIndex(i));
          const std::int64_t k = report->lattice.steps_per_quad;
          const std::int64_t col = tile.cols.front() + std::llround(p.x) / k,
                             row = tile.rows.back() - std::llround(p.z) / k;
          const auto& slope = at.at({col, row})->slope;
          const auto own =
              octahedral({-static_cast<double>(slope[0]), 1.0, static_cast<double>(slope[1])});
          const auto got = octahedral(n);
          worst = std::max({worst, std::fabs(got[0] - own[0]), std::fabs(got[1] - own[1])});
          EXPECT_GT(n.y, 0.0);
          const auto [known, fresh] = of_level.insert({{t.key.level, col, row}, n});
          if (fresh) continue;
          ++shared;
          EXPECT_EQ(known->second, n) << "level " << t.key.level << ", " << col << " " << row;
        }
      }
      EXPECT_LE(worst, most) << normal_bits << " bits";
      EXPECT_GT(worst, 0.8 * most) << "the bound is not what binds";
      EXPECT_GT(shared, 100U);
    }
}

/// Bytes a triangle of the finest level.
double finest_bytes(const ModelField& f, const LodSetOptions& options) {
  const ScratchFolder scratch;
  const auto report = write_lod_set(f, {}, options, scratch.path());
  EXPECT_THAT(report, Succeeds());
  return static_cast<double>(report->levels[0].bytes) /
         static_cast<double>(report->levels[0].triangles);
}

TEST(LodSet, NormalsOfDracoCostLittle) {
  // As fine against its spacing as 16 bits over 4001 nodes are.
  const ModelField f = testing_support::fractal(257);
  LodSetOptions options;
  options.position_bits = 12;
  const double with = finest_bytes(f, options);
  options.asset.normals = false;
  const double without = finest_bytes(f, options);
  // Rounded to seven bits without regard to the prediction they took 0.27.
  EXPECT_LT(with - without, 0.19);
  // The lattice takes 1.8 bits a vertex for what cannot be predicted of heights, 2.8 as Draco packs
  // three coordinates into one alphabet; two triangles a vertex.
  EXPECT_LT(without, 0.23);
}

TEST(LodSet, WideTilesTakeNoLeap) {
  const ModelField f = testing_support::fractal(513);
  LodSetOptions options;
  options.asset.normals = false;
  std::vector<double> bytes;
  for (const int bits : {18, 20}) {  // 2^17 and 2^19 steps a tile
    options.position_bits = bits;
    bytes.push_back(finest_bytes(f, options));
  }
  // Two bits a height are 0.125; Draco without entropy coding takes 0.8 more.
  EXPECT_LT(bytes[1], bytes[0] + 0.2);
}

Box3 box_of(const json& volume) {
  const auto b = volume["box"].get<std::vector<double>>();
  EXPECT_EQ(b.size(), 12U);
  Box3 box;
  box.add({b[0] - b[3], b[1] - b[7], b[2] - b[11]});
  box.add({b[0] + b[3], b[1] + b[7], b[2] + b[11]});
  return box;
}
/// Rounding of a middle and a half to doubles.
bool contains(const Box3& outer, const Box3& inner) {
  constexpr double kRounding = 1e-12;
  return outer.min.x <= inner.min.x + kRounding && outer.min.y <= inner.min.y + kRounding &&
         outer.min.z <= inner.min.z + kRounding && outer.max.x >= inner.max.x - kRounding &&
         outer.max.y >= inner.max.y - kRounding && outer.max.z >= inner.max.z - kRounding;
}
Box3 content_box(const fs::path& path) {
  const json head = read_glb(path).head;
  const json &node = head["nodes"][0], &a = head["accessors"][0];
  Box3 box;
  const auto at = node["translation"].get<std::array<double, 3>>();
  for (const char* bound : {"min", "max"}) {
    const auto v = a[bound].get<std::array<double, 3>>();
    const auto s = node["scale"].get<std::array<double, 3>>();
    const Vec3 p =
        Vec3{at[0], at[1], at[2]} + turned(node, {s[0] * v[0], s[1] * v[1], s[2] * v[2]});
    box.add({p.x, -p.z, p.y});
  }
  return box;
}

struct TileSays {
  std::vector<double> box;
  double error_m = 0.0;
  bool operator==(const TileSays&) const = default;
};
struct Walked {
  std::set<std::string> uris;
  std::map<std::string, double> measured_m;
  std::map<std::string, TileSays> said;
};
void walk(const json& tile, const fs::path& folder, Walked& walked) {
  const Box3 box = box_of(tile["boundingVolume"]);
  const double error = tile["geometricError"];
  if (tile.contains("content")) {
    const std::string uri = tile["content"]["uri"];
    EXPECT_TRUE(walked.uris.insert(uri).second);
    walked.said[uri] = {tile["boundingVolume"]["box"], error};
    if (!uri.starts_with("stones/")) {
      EXPECT_TRUE(contains(box, content_box(folder / uri))) << uri;
      EXPECT_GE(error, walked.measured_m.at(uri)) << uri;
    }
  }
  if (!tile.contains("children")) return;
  for (const json& child : tile["children"]) {
    EXPECT_TRUE(contains(box, box_of(child["boundingVolume"])));
    EXPECT_LE(child["geometricError"].get<double>(), error);
    walk(child, folder, walked);
  }
}

/// Which tiles of a subtree file are available, by level and Morton index, and what its table says
/// of them.
std::map<std::string, TileSays> subtree_tiles(const std::string& bytes, int depth0,
                                              std::ptrdiff_t x0, std::ptrdiff_t y0, int levels) {
  EXPECT_EQ(bytes.substr(0, 4), "subt");
  const auto json_size = value_at<std::uint64_t>(bytes, 8),
             binary_size = value_at<std::uint64_t>(bytes, 16);
  EXPECT_EQ(json_size % 8, 0U);
  EXPECT_EQ(24 + json_size + binary_size, bytes.size());
  const json head = json::parse(bytes.substr(24, json_size));
  const auto available = [&](std::size_t i) {
    const json& a = head["tileAvailability"];
    if (a.contains("constant")) return a["constant"] == 1;
    const json& view = head["bufferViews"][a["bitstream"].get<std::size_t>()];
    const auto byte = static_cast<unsigned char>(
        bytes[24 + json_size + view["byteOffset"].get<std::size_t>() + i / 8]);
    return ((byte >> (i % 8)) & 1) != 0;
  };
  EXPECT_EQ(head["tileMetadata"], 0);
  const json& table = head["propertyTables"][0];
  const auto number = [&](const char* property, std::size_t i) {
    const json& view =
        head["bufferViews"][table["properties"][property]["values"].get<std::size_t>()];
    EXPECT_EQ(view["byteOffset"].get<std::size_t>() % 8, 0U);
    EXPECT_LE(8 * (i + 1), view["byteLength"].get<std::size_t>());
    return value_at<double>(bytes, 24 + json_size + view["byteOffset"].get<std::size_t>() + 8 * i);
  };
  std::map<std::string, TileSays> tiles;
  std::size_t first = 0;
  for (int level = 0; level < levels; first += std::size_t{1} << (2 * level), ++level)
    for (std::size_t code = 0; code < std::size_t{1} << (2 * level); ++code) {
      if (!available(first + code)) continue;
      std::ptrdiff_t x = 0, y = 0;
      for (int bit = 0; bit < level; ++bit) {
        x |= static_cast<std::ptrdiff_t>(code >> (2 * bit) & 1) << bit;
        y |= static_cast<std::ptrdiff_t>(code >> (2 * bit + 1) & 1) << bit;
      }
      TileSays says{{}, number("error", tiles.size())};
      for (std::size_t k = 0; k < 12; ++k) says.box.push_back(number("box", 12 * tiles.size() + k));
      tiles[lod_tile_uri(depth0 + level, (x0 << level) + x, (y0 << level) + y)] = std::move(says);
    }
  EXPECT_EQ(table["count"], tiles.size());
  return tiles;
}

TEST(LodSet, TilesetsHoldTheirTiles) {
  for (const auto& [rows, cols] : kSizes) {
    const ScratchFolder scratch;
    const ModelField f = relief(rows, cols);
    const auto report = write_lod_set(f, {}, small_tiles(), scratch.path());
    ASSERT_THAT(report, Succeeds());
    const json lod = json::parse(*read_file(scratch / "lod.json"));
    Walked walked;
    for (const json& t : lod["tiles"])
      walked.measured_m[t["uri"]] = 1e-3 * t["max_vertical_error_mm"].get<double>();
    const json tileset = json::parse(*read_file(scratch / "tileset.json"));
    EXPECT_EQ(tileset["asset"]["version"], "1.1");
    walk(tileset["root"], scratch.path(), walked);
    EXPECT_EQ(walked.uris.size(), report->tiles.size());

    const json implicit = json::parse(*read_file(scratch / "tileset_implicit.json"));
    const json& terrain = implicit["root"]["children"][0];
    EXPECT_EQ(terrain["implicitTiling"]["availableLevels"], report->levels.size());
    const int per_file = terrain["implicitTiling"]["subtreeLevels"];
    const json& properties = implicit["schema"]["classes"]["tile"]["properties"];
    EXPECT_EQ(properties["box"]["semantic"], "TILE_BOUNDING_BOX");
    EXPECT_EQ(properties["error"]["semantic"], "TILE_GEOMETRIC_ERROR");
    std::map<std::string, TileSays> said;
    for (const auto& e : fs::recursive_directory_iterator(scratch / "subtrees")) {
      if (!e.is_regular_file()) continue;
      const int depth = std::stoi(e.path().parent_path().parent_path().filename());
      said.merge(subtree_tiles(*read_file(e.path()), depth,
                               std::stol(e.path().parent_path().filename()),
                               std::stol(e.path().stem()), per_file));
    }
    EXPECT_TRUE(said == walked.said);
    const Box3 root = box_of(terrain["boundingVolume"]);
    const int top = static_cast<int>(report->levels.size()) - 1;
    for (const LodTileReport& t : report->tiles) {
      const int depth = top - t.key.level;
      const double parts = std::ldexp(1.0, depth);
      Box3 cell = root;
      cell.min.x = root.min.x + (root.max.x - root.min.x) * static_cast<double>(t.key.x) / parts;
      cell.max.x =
          root.min.x + (root.max.x - root.min.x) * static_cast<double>(t.key.x + 1) / parts;
      cell.min.y = root.min.y + (root.max.y - root.min.y) * static_cast<double>(t.key.y) / parts;
      cell.max.y =
          root.min.y + (root.max.y - root.min.y) * static_cast<double>(t.key.y + 1) / parts;
      EXPECT_TRUE(contains(cell, content_box(scratch / lod_tile_uri(depth, t.key.x, t.key.y))));
      EXPECT_GE(terrain["geometricError"].get<double>() / parts,
                1e-3 * t.error.vertical_mm * (1.0 - 1e-12));
    }
  }
}

TEST(LodSet, StandsOnItsBody) {
  const ModelField f = plane(33, 65);
  const double half_x = 16.0, half_y = 8.0;  // metres to the middle
  const auto at = [](const std::array<double, 16>& m, double x, double y, double z) {
    return Vec3{m[0] * x + m[4] * y + m[8] * z + m[12], m[1] * x + m[5] * y + m[9] * z + m[13],
                m[2] * x + m[6] * y + m[10] * z + m[14]};
  };
  // A sphere: up is away from its middle, whatever the place.
  LodPlace place{*heightmap::body_by_name("moon"), -43.3, 348.8, 120.0, 2.0};
  auto m = fixed_from_tileset(place, f, 1000.0);
  const Vec3 middle = at(m, half_x, half_y, 0.0), above = at(m, half_x, half_y, 5.0);
  EXPECT_NEAR(norm(middle), 1737400.0 + 120.0, 1e-6);
  EXPECT_NEAR(norm(above), 1737400.0 + 120.0 + 5.0, 1e-6);
  EXPECT_NEAR(std::asin(middle.z / norm(middle)) * 180.0 / std::numbers::pi, -43.3, 1e-10);
  EXPECT_NEAR(std::atan2(middle.y, middle.x) * 180.0 / std::numbers::pi, -11.2, 1e-10);
  const Vec3 east = at(m, half_x + 1.0, half_y, 0.0) - middle;
  const Vec3 north = at(m, half_x, half_y + 1.0, 0.0) - middle;
  EXPECT_NEAR(norm(east), 1.0, 1e-9);
  EXPECT_NEAR(norm(cross(east, north) - (1.0 / norm(middle)) * middle), 0.0, 1e-8);
  EXPECT_NEAR(east.z, 0.0, 1e-9);
  EXPECT_GT(north.z, 0.0);
  // Mars: on the ellipsoid, and up is its gradient there.
  place = {*heightmap::body_by_name("mars"), -5.4, 137.8, 0.0, 1.0};
  m = fixed_from_tileset(place, f, 1000.0);
  const Vec3 p = at(m, half_x, half_y, 0.0);
  const double a2 = 3396190.0 * 3396190.0, b2 = 3376200.0 * 3376200.0;
  EXPECT_NEAR((p.x * p.x + p.y * p.y) / a2 + p.z * p.z / b2, 1.0, 1e-12);
  EXPECT_NEAR(std::atan2(p.z, std::hypot(p.x, p.y)) * 180.0 / std::numbers::pi, -5.4, 1e-10);
  const Vec3 gradient = normalized(Vec3{p.x / a2, p.y / a2, p.z / b2});
  EXPECT_NEAR(norm(normalized(at(m, half_x, half_y, 1000.0) - p) - gradient), 0.0, 1e-9);
  // The tileset says so.
  const ScratchFolder scratch;
  LodSetOptions options = small_tiles();
  options.place = place;
  ASSERT_THAT(write_lod_set(f, {}, options, scratch.path()), Succeeds());
  const json tileset = json::parse(*read_file(scratch / "tileset.json"));
  EXPECT_EQ(tileset["root"]["transform"].get<std::vector<double>>(),
            std::vector<double>(m.begin(), m.end()));
  EXPECT_EQ(tileset["extensions"]["3DTILES_ellipsoid"]["radii"],
            json({3396190.0, 3396190.0, 3376200.0}));
}

TEST(LodSet, OnABodyEverythingIsAtFullSize) {
  // 1.8 m of a model 1:1000, its heights twice what they were; a spacing that floats round.
  const ModelField f = relief(20, 4001, 0.45);
  for (const auto compression :
       {LodCompression::draco, LodCompression::meshopt, LodCompression::plain}) {
    const ScratchFolder scratch;
    LodSetOptions options;
    options.asset.compression = compression;
    options.place = LodPlace{*heightmap::body_by_name("moon"), -43.3, 348.8, 120.0, 2.0};
    const auto report = write_lod_set(f, {}, options, scratch.path());
    ASSERT_THAT(report, Succeeds());
    const json lod = json::parse(*read_file(scratch / "lod.json"));
    EXPECT_EQ(lod["metres_per_model_metre"], json({1000.0, 500.0}));
    Walked walked;
    double worst_m = 0.0;
    for (const json& t : lod["tiles"]) {
      const double metres = 500.0 * 1e-3 * t["max_vertical_error_mm"].get<double>();
      walked.measured_m[t["uri"]] = metres * (1.0 - 1e-12);
      worst_m = std::max(worst_m, metres);
    }
    for (const char* name : {"tileset.json", "tileset_implicit.json"}) {
      const json tileset = json::parse(*read_file(scratch / name));
      EXPECT_EQ(tileset["asset"]["extras"]["size"], "full");
      const auto m = tileset["root"]["transform"].get<std::array<double, 16>>();
      std::array<Vec3, 3> axes{};
      for (std::size_t k = 0; k < 3; ++k) axes[k] = {m[4 * k], m[4 * k + 1], m[4 * k + 2]};
      // Rigid, to a double's rounding: nothing that a renderer may or may not scale errors by.
      for (std::size_t k = 0; k < 3; ++k) {
        EXPECT_NEAR(norm(axes[k]), 1.0, 1e-14);
        EXPECT_NEAR(dot(axes[k], axes[(k + 1) % 3]), 0.0, 1e-14);
      }
      EXPECT_NEAR(dot(cross(axes[0], axes[1]), axes[2]), 1.0, 1e-14);
      const json& terrain = tileset["root"]["children"][0];
      const bool implicit = terrain.contains("implicitTiling");
      const double error = terrain["geometricError"];
      EXPECT_GE(error, worst_m * (1.0 - 1e-12));
      if (implicit) {
        for (const LodTileReport& t : report->tiles)
          EXPECT_GE(std::ldexp(error, t.key.level + 1 - static_cast<int>(report->levels.size())),
                    500.0 * 1e-3 * t.error.vertical_mm * (1.0 - 1e-12));
        continue;
      }
      EXPECT_NEAR(error, worst_m, 1e-12 * worst_m);
      walk(tileset["root"], scratch.path(), walked);
      const Box3 box = box_of(terrain["boundingVolume"]);
      const double step = report->lattice.step_mm;  // a metre for each mm
      EXPECT_NEAR(box.max.x - box.min.x, 1800.0 + 2.0 * step, 1e-9);
    }
    EXPECT_EQ(walked.uris.size(), report->tiles.size());
    // What an engine that places nodes in floats makes of it: 1 um of the model is 1 mm.
    const auto pyramid = LodPyramid::create(f, lod_levels(f, options.tile_quads));
    const int top = pyramid->levels() - 1;
    double off_m = 0.0;
    for (const LodTileReport& t : report->tiles) {
      const LodTileMesh tile = make_lod_tile(*pyramid, report->lattice, t.key);
      const json node = read_glb(scratch.path() / lod_tile_uri(top - t.key.level, t.key.x, t.key.y))
                            .head["nodes"][0];
      const auto at = node["translation"].get<std::array<float, 3>>();
      const auto s = node["scale"].get<std::array<float, 3>>();
      const Vec3 turn = turned(
          node, {static_cast<double>(s[0]), static_cast<double>(s[1]), static_cast<double>(s[2])});
      const Float3 scale{static_cast<float>(turn.x), static_cast<float>(turn.y),
                         static_cast<float>(turn.z)};
      for (const LodVertex& v : tile.vertices) {
        const std::int64_t k = report->lattice.steps_per_quad;
        const Float3 local{static_cast<float>((v.col - tile.cols.front()) * k),
                           static_cast<float>(v.height - t.lowest),
                           static_cast<float>((tile.rows.back() - v.row) * k)};
        const std::array<double, 3> truth{0.45 * v.col, 0.5 * report->lattice.step_mm * v.height,
                                          -0.45 * v.row};
        for (std::size_t i = 0; i < 3; ++i)
          off_m = std::max(off_m,
                           std::fabs(static_cast<double>(at[i] + scale[i] * local[i]) - truth[i]));
      }
    }
    EXPECT_LT(off_m, 1e-3);
    EXPECT_GT(off_m, 0.0) << "floats of 1.8 km round";
  }
}

/// Stones in full: the last level's file, of a site with few.
std::string stones_file(const LodSetReport& report) {
  EXPECT_EQ(report.stones.back().coarser, 0);
  return lod_stones_uri(report.stones.back());
}

std::vector<meshing::PlacedStone> some_stones(const ModelField& f) {
  std::vector<meshing::PlacedStone> stones;
  for (int i = 0; i < 5; ++i) {
    meshing::PlacedStone s;
    s.number = i + 1;
    s.shape.seed = i == 3 ? 9 : 4;  // four alike
    s.shape.subdivisions = 2;
    s.scale_mm = 2.0 + i;
    s.model_from_stone.rotation = normalized(Quaternion{1.0, 0.3 * i, -0.2, 0.1 * i});
    s.model_from_stone.translation_mm = {f.x0.value() + 6.0 * i, f.y0.value() + 5.0, 3.0 + i};
    stones.push_back(s);
  }
  return stones;
}

TEST(LodSet, StonesLieInTheirPoses) {
  const ModelField f = plane(130, 130);
  const ScratchFolder scratch;
  const auto stones = some_stones(f);
  const auto report = write_lod_set(f, stones, small_tiles(), scratch.path());
  ASSERT_THAT(report, Succeeds());
  const Asset asset = read_glb(scratch / stones_file(*report));
  const auto floats = [&](std::size_t accessor, std::size_t width, std::size_t i) {
    const json& a = asset.head["accessors"][accessor];
    std::vector<double> values;
    for (std::size_t k = 0; k < width; ++k)
      values.push_back(static_cast<double>(value_at<float>(
          asset.binary, asset.head["bufferViews"][a["bufferView"].get<std::size_t>()]["byteOffset"]
                                .get<std::size_t>() +
                            4 * (width * i + k))));
    return values;
  };
  std::set<int> seen;
  for (const json& node : asset.head["nodes"]) {
    const json numbers = node["extras"]["stones"];
    const json& primitive = asset.head["meshes"][node["mesh"].get<std::size_t>()]["primitives"][0];
    for (std::size_t i = 0; i < numbers.size(); ++i) {
      std::vector<double> t, q, s;
      if (node.contains("translation")) {
        t = node["translation"].get<std::vector<double>>();
        q = node["rotation"].get<std::vector<double>>();
        s = node["scale"].get<std::vector<double>>();
      } else {
        const json& a = node["extensions"]["EXT_mesh_gpu_instancing"]["attributes"];
        t = floats(a["TRANSLATION"], 3, i);
        q = floats(a["ROTATION"], 4, i);
        s = floats(a["SCALE"], 3, i);
      }
      const int number = numbers[i];
      seen.insert(number);
      const TriMesh expected = meshing::stone_mesh(stones[static_cast<std::size_t>(number - 1)]);
      for (std::size_t v = 0; v < expected.vertices_mm.size(); v += 7) {
        const auto p = floats(primitive["attributes"]["POSITION"], 3, v);
        const Vec3 placed =
            rotate(Quaternion{q[3], q[0], q[1], q[2]}, s[0] * Vec3{p[0], p[1], p[2]}) +
            Vec3{t[0], t[1], t[2]};
        const Vec3 model =
            1e3 * Vec3{placed.x, -placed.z, placed.y} + Vec3{f.x0.value(), f.y0.value(), 0};
        EXPECT_LT(norm(model - expected.vertices_mm[v]), 1e-5);  // floats of some 50 mm
      }
    }
  }
  EXPECT_EQ(seen, (std::set<int>{1, 2, 3, 4, 5}));
  EXPECT_EQ(asset.head["nodes"].size(), 2U);
  const json tileset = json::parse(*read_file(scratch / "tileset.json"));
  EXPECT_EQ(tileset["root"]["children"][1]["content"]["uri"],
            lod_stones_uri(report->stones.front()));
}

/// Triangles of merged stones, millimetres of the model, by the stone's place in `extras`.
std::vector<std::vector<std::array<Vec3, 3>>> merged_triangles(const fs::path& path,
                                                               const ModelField& f) {
  const Asset asset = read_glb(path);
  const json& primitive = asset.head["meshes"][0]["primitives"][0];
  const auto start = [&](const json& accessor) {
    const json& a = asset.head["accessors"][accessor.get<std::size_t>()];
    return asset.head["bufferViews"][a["bufferView"].get<std::size_t>()]["byteOffset"]
        .get<std::size_t>();
  };
  const std::size_t position = start(primitive["attributes"]["POSITION"]),
                    feature = start(primitive["attributes"]["_FEATURE_ID_0"]),
                    index = start(primitive["indices"]);
  const std::size_t corners =
      asset.head["accessors"][primitive["indices"].get<std::size_t>()]["count"];
  std::vector<std::vector<std::array<Vec3, 3>>> stones(
      asset.head["nodes"][0]["extras"]["stones"].size());
  for (std::size_t i = 0; i < corners; i += 3) {
    std::array<Vec3, 3> triangle;
    std::size_t of = 0;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto v = value_at<std::uint32_t>(asset.binary, index + 4 * (i + k));
      const auto p = value_at<Float3>(asset.binary, position + 12 * v);
      of = static_cast<std::size_t>(value_at<float>(asset.binary, feature + 4 * v));
      triangle[k] = {f.x0.value() + 1e3 * static_cast<double>(p[0]),
                     f.y0.value() - 1e3 * static_cast<double>(p[2]),
                     1e3 * static_cast<double>(p[1])};
    }
    stones.at(of).push_back(triangle);
  }
  return stones;
}

TEST(LodSet, StonesMergedAreOneMesh) {
  const ModelField f = plane(130, 130);
  const ScratchFolder scratch;
  const auto stones = some_stones(f);
  LodSetOptions options = small_tiles();
  options.asset.merge_stones = true;
  const auto report = write_lod_set(f, stones, options, scratch.path());
  ASSERT_THAT(report, Succeeds());
  const fs::path file = scratch / stones_file(*report);
  const json head = read_glb(file).head;
  ASSERT_EQ(head["nodes"].size(), 1U);
  ASSERT_EQ(head["meshes"].size(), 1U);
  EXPECT_FALSE(head.contains("extensionsRequired"));
  EXPECT_EQ(head["nodes"][0]["extras"]["stones"], json({1, 2, 3, 4, 5}));
  EXPECT_EQ(head["meshes"][0]["primitives"][0]["extensions"]["EXT_mesh_features"]["featureIds"],
            json({{{"featureCount", 5}, {"attribute", 0}}}));
  const auto found = merged_triangles(file, f);
  ASSERT_EQ(found.size(), stones.size());
  for (std::size_t i = 0; i < stones.size(); ++i) {
    const TriMesh expected = meshing::stone_mesh(stones[i]);
    ASSERT_EQ(found[i].size(), expected.triangles.size());
    for (std::size_t t = 0; t < found[i].size(); ++t)
      for (std::size_t k = 0; k < 3; ++k)  // floats of some 50 mm
        EXPECT_LT(norm(found[i][t][k] - expected.vertices_mm[expected.triangles[t][k]]), 1e-5);
  }
}

Box3 merged_box(const fs::path& path, const ModelField& f) {
  Box3 box;
  for (const auto& stone : merged_triangles(path, f))
    for (const auto& triangle : stone)
      for (const Vec3& v : triangle) box.add(1e-3 * (v - Vec3{f.x0.value(), f.y0.value(), 0.0}));
  return box;
}

TEST(LodSet, CoarseStonesAreAsFarOffAsIsSaid) {
  const ModelField f = plane(513, 385);
  std::vector<meshing::PlacedStone> stones;
  for (int i = 0; i < 40; ++i) {
    meshing::PlacedStone s;
    s.number = i + 1;
    s.shape.seed = static_cast<std::uint64_t>(i);
    s.shape.angularity = 0.02 * i;
    s.shape.subdivisions = i == 7 ? 1 : 4;  // one has less to give
    s.scale_mm = 2.0 + 0.1 * i;
    s.model_from_stone.rotation = normalized(Quaternion{1.0, 0.3, -0.1 * i, 0.2});
    s.model_from_stone.translation_mm = {f.x0.value() + 6.0 * i, f.y0.value() + 4.5 * i, 3.0};
    stones.push_back(s);
  }
  const ScratchFolder scratch;
  LodSetOptions options = small_tiles();
  options.asset.merge_stones = true;
  const auto report = write_lod_set(f, stones, options, scratch.path());
  ASSERT_THAT(report, Succeeds());
  std::map<int, std::size_t> stones_at;
  std::map<int, double> worst, said;
  std::size_t triangles = 0;
  for (const LodStones& file : report->stones) {
    const auto found = merged_triangles(scratch / lod_stones_uri(file), f);
    ASSERT_EQ(found.size(), file.stones.size());
    stones_at[file.coarser] += found.size();
    said[file.coarser] = std::fmax(said[file.coarser], file.error_mm);
    for (std::size_t i = 0; i < found.size(); ++i) {
      const meshing::PlacedStone& stone = file.stones[i];
      const TriMesh full = meshing::stone_mesh(stone);
      EXPECT_EQ(found[i].size() << (2 * std::min(file.coarser, stone.shape.subdivisions)),
                full.triangles.size());
      triangles += found[i].size();
      const auto off = [](Vec3 p, const auto& others, auto corner) {
        double least = INFINITY;
        for (const auto& t : others)
          least = std::fmin(least, triangle_distance2(p, corner(t, 0), corner(t, 1), corner(t, 2)));
        return std::sqrt(least);
      };
      // Both ways, at vertices of the one and middles of the other; floats of some 250 mm.
      double far = 0.0;
      for (std::size_t v = 0; v < full.vertices_mm.size(); v += 11)
        far = std::fmax(far, off(full.vertices_mm[v], found[i],
                                 [](const auto& t, std::size_t k) { return t[k]; }));
      for (std::size_t t = 0; t < found[i].size(); t += found[i].size() / 20)
        far = std::fmax(far, off((1.0 / 3.0) * (found[i][t][0] + found[i][t][1] + found[i][t][2]),
                                 full.triangles, [&](const auto& c, std::size_t k) {
                                   return full.vertices_mm[c[k]];
                                 }));
      EXPECT_LE(far, file.error_mm + 3e-5) << "stone " << stone.number;
      worst[file.coarser] = std::fmax(worst[file.coarser], far);
    }
  }
  // All stones in each level, in smaller cells where they are finer.
  EXPECT_EQ(stones_at, (std::map<int, std::size_t>{{0, 40}, {2, 40}, {4, 40}}));
  EXPECT_EQ(report->stones.front().cells, 0);
  EXPECT_EQ(report->stones.back().cells, 1);
  EXPECT_EQ(said[0], 0.0);
  for (const int coarser : {2, 4})
    EXPECT_GT(worst[coarser], 0.3 * said[coarser]) << "the bound says something";
  // As tiles: boxes hold what is below, errors fall, all files are named once.
  const json lod = json::parse(*read_file(scratch / "lod.json"));
  EXPECT_EQ(lod["stones"].size(), report->stones.size());
  Walked walked;
  for (const json& t : lod["tiles"])
    walked.measured_m[t["uri"]] = 1e-3 * t["max_vertical_error_mm"].get<double>();
  for (const json& t : lod["stones"])
    walked.measured_m[t["uri"]] = 1e-3 * t["hausdorff_bound_mm"].get<double>();
  walk(json::parse(*read_file(scratch / "tileset.json"))["root"], scratch.path(), walked);
  for (const LodStones& file : report->stones) {
    const std::string uri = lod_stones_uri(file);
    ASSERT_TRUE(walked.said.contains(uri)) << uri;
    EXPECT_GE(walked.said[uri].error_m, walked.measured_m[uri]);
    // One mesh a file: its own box is content's.
    EXPECT_TRUE(contains(box_of({{"box", walked.said[uri].box}}), merged_box(scratch / uri, f)));
  }
  // Fewer stones in a later run: files of cells that are empty now go, and no one else's.
  ASSERT_THAT(write_file(scratch / "stones/mine.glb", "mine"), Succeeds());
  stones.resize(8);
  const auto again = write_lod_set(f, stones, options, scratch.path());
  ASSERT_THAT(again, Succeeds());
  std::size_t files = 0;
  for (const auto& e : fs::recursive_directory_iterator(scratch / "stones"))
    if (e.is_regular_file()) ++files;
  EXPECT_EQ(files, again->stones.size() + 1);
  EXPECT_LT(again->stones.size(), report->stones.size());
}

TEST(LodSet, ShapesThatLieEverywhereStayTogether) {
  const ModelField f = plane(513, 385);
  const Vec3 corner{f.x0.value(), f.y0.value(), 0.0};
  const auto divided = [&](int shapes) {
    std::vector<meshing::PlacedStone> stones(200);
    for (int i = 0; i < 200; ++i) {
      stones[static_cast<std::size_t>(i)].shape.seed = static_cast<std::uint64_t>(i % shapes);
      stones[static_cast<std::size_t>(i)].model_from_stone.translation_mm =
          corner + Vec3{1.25 * i, 0.9 * ((i * 37) % 200), 0.0};
    }
    return divide_stones(stones, 4, 256.0, corner);
  };
  // Each stone its own shape: no cell more stores a shape more. A dozen of shapes: each cell all.
  EXPECT_EQ(divided(200).back().cells, 2);
  EXPECT_EQ(divided(12).back().cells, 0);
}

TEST(LodSet, StonesOnABodyHangFromItsScale) {
  const ModelField f = plane(130, 130);
  const ScratchFolder model, body;
  const auto stones = some_stones(f);
  LodSetOptions options = small_tiles();
  const auto report = write_lod_set(f, stones, options, model.path());
  ASSERT_THAT(report, Succeeds());
  options.place = LodPlace{*heightmap::body_by_name("moon"), 10.0, 20.0, 0.0, 2.0};
  ASSERT_THAT(write_lod_set(f, stones, options, body.path()), Succeeds());
  const Asset small = read_glb(model / stones_file(*report)),
              full = read_glb(body / stones_file(*report));
  // The same bytes and nodes under one more.
  EXPECT_EQ(full.binary, small.binary);
  const json& nodes = full.head["nodes"];
  ASSERT_EQ(nodes.size(), small.head["nodes"].size() + 1);
  for (std::size_t i = 0; i + 1 < nodes.size(); ++i) EXPECT_EQ(nodes[i], small.head["nodes"][i]);
  EXPECT_EQ(full.head["scenes"][0]["nodes"], json({nodes.size() - 1}));
  EXPECT_EQ(nodes.back()["scale"], json({1000.0, 500.0, 1000.0}));
  EXPECT_EQ(nodes.back()["children"], small.head["scenes"][0]["nodes"]);
  const auto box = [](const fs::path& folder) {
    return box_of(
        json::parse(*read_file(folder / "tileset.json"))["root"]["children"][1]["boundingVolume"]);
  };
  const Box3 of_model = box(model.path()), of_body = box(body.path());
  // Each with a slack of about a millionth of its size.
  EXPECT_NEAR(of_body.max.x, 1000.0 * of_model.max.x, 2e-3);
  EXPECT_NEAR(of_body.max.z, 500.0 * of_model.max.z, 2e-3);
}

std::map<std::string, std::string> hashes(const fs::path& folder) {
  std::map<std::string, std::string> of;
  for (const auto& e : fs::recursive_directory_iterator(folder))
    if (e.is_regular_file()) of[fs::relative(e.path(), folder).string()] = *sha256_file(e.path());
  return of;
}

TEST(LodSet, IsTheSameForAnyThreadsAndGoesOn) {
  const ModelField f = relief(200, 170);
  const ScratchFolder one, many;
  for (const auto compression : {LodCompression::draco, LodCompression::meshopt}) {
    LodSetOptions options = small_tiles();
    options.asset.compression = compression;
    {
      const tbb::global_control single(tbb::global_control::max_allowed_parallelism, 1);
      ASSERT_THAT(write_lod_set(f, some_stones(f), options, one.path()), Succeeds());
    }
    ASSERT_THAT(write_lod_set(f, some_stones(f), options, many.path()), Succeeds());
    EXPECT_EQ(hashes(one.path()), hashes(many.path()));
  }
  // A run that lost two tiles makes these and keeps the others.
  LodSetOptions options = small_tiles();
  options.asset.compression = LodCompression::meshopt;
  const auto before = hashes(many.path());
  fs::remove(many / "tiles/0/0/0.glb");
  fs::remove(many / "tiles/2/1/1.glb");
  const auto again = write_lod_set(f, some_stones(f), options, many.path());
  ASSERT_THAT(again, Succeeds());
  EXPECT_EQ(std::count_if(again->tiles.begin(), again->tiles.end(),
                          [](const auto& t) { return !t.kept; }),
            2);
  EXPECT_EQ(hashes(many.path()), before);
  // One that was cut off, one that is longer than it says, one without a header: made again.
  fs::resize_file(many / "tiles/1/0/0.glb", 1000);
  fs::resize_file(many / "tiles/2/0/1.glb", fs::file_size(many / "tiles/2/0/1.glb") + 4);
  fs::resize_file(many / "tiles/3/2/2.glb", 0);
  const auto mended = write_lod_set(f, some_stones(f), options, many.path());
  ASSERT_THAT(mended, Succeeds());
  EXPECT_EQ(std::count_if(mended->tiles.begin(), mended->tiles.end(),
                          [](const auto& t) { return !t.kept; }),
            3);
  EXPECT_EQ(hashes(many.path()), before);
  options.asset.normals = false;
  const auto other = write_lod_set(f, some_stones(f), options, many.path());
  EXPECT_EQ(
      std::count_if(other->tiles.begin(), other->tiles.end(), [](const auto& t) { return t.kept; }),
      0);
}

TEST(LodSet, RefusesWhatCannotBe) {
  const ScratchFolder scratch;
  ModelField f = relief(400, 300);
  const auto with = [&](auto change) {
    LodSetOptions options = small_tiles();
    change(options);
    return write_lod_set(f, {}, options, scratch / "out");
  };
  EXPECT_THAT(with([](auto& o) { o.position_bits = 7; }), FailsWith(kOptionOutOfRange));
  EXPECT_THAT(with([](auto& o) { o.position_bits = 23; }), FailsWith(kOptionOutOfRange));
  EXPECT_THAT(with([](auto& o) { o.tile_quads = 8; }), FailsWith(kOptionOutOfRange));
  EXPECT_THAT(with([](auto& o) { o.asset.scale_denominator = 0.0; }), FailsWith(kOptionOutOfRange));
  // 399 quads by at least 4 steps: 1596, so 11 bits; an error of 1 um at 0.5 mm: 250 steps, 17
  // bits.
  auto refused = with([](auto& o) { o.position_bits = 10; });
  EXPECT_THAT(refused, FailsWith(kQuantisationTooCoarse));
  EXPECT_THAT(refused.error().message, testing::HasSubstr("11 bits would do"));
  EXPECT_THAT(with([](auto& o) { o.position_bits = 11; }), Succeeds());
  refused = with([](auto& o) { o.max_error = Millimetres{0.001}; });
  EXPECT_THAT(refused, FailsWith(kQuantisationTooCoarse));
  EXPECT_THAT(refused.error().message, testing::HasSubstr("17 bits would do"));
  const auto fine = with([](auto& o) {
    o.max_error = Millimetres{0.001};
    o.position_bits = 17;
  });
  ASSERT_THAT(fine, Succeeds());
  EXPECT_LE(fine->levels[0].error.vertical_mm, 0.001);
  f.z_mm(3, 4) = NAN;
  EXPECT_THAT(with([](auto&) {}), FailsWith(kHeightNotFinite));
  f = relief(40, 40);
  EXPECT_THAT(write_lod_set(f, {}, small_tiles(), "/proc/nowhere"), FailsWith(kFileNotWritable));
  std::stop_source stop;
  RunContext run;
  run.stop = stop.get_token();
  stop.request_stop();
  EXPECT_THAT(write_lod_set(f, {}, small_tiles(), scratch / "stopped", run), FailsWith(kCancelled));
  EXPECT_FALSE(fs::exists(scratch / "stopped/tileset.json"));
}

}  // namespace
}  // namespace maquette::exporting

// SPDX-License-Identifier: GPL-3.0-or-later
// What meshing/grid_stream.hpp claims, and how each claim is attacked:
//
//   the solid of grid_solid, to the bit ....... ==, pieces of every length, odd starts
//   certificate of what the file holds ........ CGAL's of the rounded mesh: volume, area, Euler
//   Hausdorff bound ........................... no rounded node moved farther; attained
//   vertical error counts rounding in ......... a slope of 3: 3 times the step in x
//   bad rounding is refused ................... planted: columns, rows, node on the base
//   same mesh, same PLY ....................... bytes of both writers

#include "meshing/grid_stream.hpp"

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/files.hpp"
#include "meshing/mesh_io.hpp"
#include "support/matchers.hpp"
#include "support/shapes.hpp"

namespace maquette::meshing {
namespace {

using heightmap::ModelField;
using testing_support::FailsWith;
using testing_support::random_terrain;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

constexpr std::array kRoundings{CoordinateRounding::none, CoordinateRounding::float32,
                                CoordinateRounding::micro, CoordinateRounding::lib3mf};

class GridStreamOnTerrain : public testing::TestWithParam<std::uint64_t> {
 protected:
  const std::ptrdiff_t rows = 2 + static_cast<std::ptrdiff_t>(random_bits(GetParam(), 1) % 40);
  const std::ptrdiff_t cols = 2 + static_cast<std::ptrdiff_t>(random_bits(GetParam(), 2) % 40);
  const ModelField field = random_terrain(GetParam(), rows, cols, 0.3, 0.3, 0.05);
  const SolidOptions options{.base_z = Millimetres{-20.1}};
};

TEST_P(GridStreamOnTerrain, IsTheMeshInMemoryInAnyPieces) {
  const TriMesh mesh = grid_solid(field, options).value();
  const auto stream = GridSolidStream::create(field, options);
  ASSERT_THAT(stream, Succeeds());
  ASSERT_EQ(stream->vertex_count(), mesh.vertices_mm.size());
  ASSERT_EQ(stream->triangle_count(), mesh.triangles.size());
  std::vector<Vec3> vertices(mesh.vertices_mm.size());
  std::vector<MeshStream::Triangle> triangles(mesh.triangles.size());
  std::vector<MeshStream::Corners> corners(triangles.size());
  std::uint64_t draw = 10;
  const auto pieces = [&](std::size_t count, auto&& take) {
    for (std::size_t at = 0; at < count;) {
      const std::size_t n =
          std::min<std::size_t>(1 + random_bits(GetParam(), ++draw) % 97, count - at);
      take(at, n);
      at += n;
    }
  };
  pieces(vertices.size(), [&](std::size_t at, std::size_t n) {
    stream->vertices(at, std::span(vertices).subspan(at, n));
  });
  pieces(triangles.size(), [&](std::size_t at, std::size_t n) {
    stream->triangles(at, std::span(triangles).subspan(at, n));
    stream->corners(at, std::span(corners).subspan(at, n));
  });
  EXPECT_TRUE(vertices == mesh.vertices_mm);
  EXPECT_TRUE(triangles == mesh.triangles);
  for (std::size_t t = 0; t < triangles.size(); ++t)
    for (std::size_t k = 0; k < 3; ++k) ASSERT_EQ(corners[t][k], vertices[triangles[t][k]]);
}

TEST_P(GridStreamOnTerrain, CertifiesWhatCgalFindsInTheRoundedMesh) {
  const auto stream = GridSolidStream::create(field, options);
  ASSERT_THAT(stream, Succeeds());
  for (const CoordinateRounding rounding : kRoundings) {
    const auto proven = stream->certify(rounding);
    ASSERT_THAT(proven, Succeeds());
    TriMesh mesh = grid_solid(field, options).value();
    double moved = 0.0;
    for (Vec3& v : mesh.vertices_mm) {
      const Vec3 r{rounded(v.x, rounding), rounded(v.y, rounding), rounded(v.z, rounding)};
      if (&v - mesh.vertices_mm.data() < rows * cols) moved = std::fmax(moved, norm(r - v));
      v = r;
    }
    const auto found = check_mesh(mesh, &field);
    ASSERT_THAT(found, Succeeds());
    EXPECT_TRUE(found->passed()) << to_json(*found);
    EXPECT_TRUE(proven->passed());
    EXPECT_EQ(proven->vertices, found->vertices);
    EXPECT_EQ(proven->triangles, found->triangles);
    EXPECT_EQ(proven->shells, found->shells);
    EXPECT_EQ(proven->euler_number, found->euler_number);
    // Sums of the same numbers in another order.
    EXPECT_NEAR(proven->volume_mm3, found->volume_mm3, 1e-12 * found->volume_mm3);
    EXPECT_NEAR(proven->area_mm2, found->area_mm2, 1e-12 * found->area_mm2);
    EXPECT_EQ(proven->hausdorff_bound_mm, moved);
    EXPECT_EQ(proven->rounding_mm, moved);
    // CGAL's certificate leaves out the nodes of the walls.
    EXPECT_GE(proven->max_vertical_error_mm, found->max_vertical_error_mm - 1e-13);
    EXPECT_LE(rounding_displacement_mm(*stream, rounding), moved + 1e-6);
    EXPECT_GE(rounding_displacement_mm(*stream, rounding), moved);
  }
}

INSTANTIATE_TEST_SUITE_P(Seeds, GridStreamOnTerrain, testing::Range<std::uint64_t>(1, 7));

TEST(GridStream, CountsTheRoundingOfXIntoTheHeight) {
  // Columns at 900 + 0.3 n mm, heights 3 x: floats there are 2^-14 mm apart, so that x moves by
  // up to 2^-15 and the height above it is wrong by three times that, beside z's own half step
  // (z up to 96 mm: none, they are floats).
  ModelField field{Grid<float>(3, 107), Millimetres{0.3}, Millimetres{900.0}, Millimetres{0}};
  double expected = 0.0;
  for (std::ptrdiff_t c = 0; c < 107; ++c) {
    for (std::ptrdiff_t r = 0; r < 3; ++r) field.z_mm(r, c) = 3.0F * 0.3F * static_cast<float>(c);
    if (c > 0 && c < 106)
      expected = std::fmax(
          expected,
          3.0 * std::abs(static_cast<double>(static_cast<float>(field.x_mm(c))) - field.x_mm(c)));
  }
  const auto stream = GridSolidStream::create(field, {.base_z = Millimetres{-2}});
  ASSERT_THAT(stream, Succeeds());
  const auto c = stream->certify(CoordinateRounding::float32);
  ASSERT_THAT(c, Succeeds());
  EXPECT_NEAR(c->max_vertical_error_mm, expected, 1e-5);  // slopes between float heights differ
  EXPECT_GT(c->max_vertical_error_mm, 5e-5);
  EXPECT_LE(c->rounding_mm, std::ldexp(1.0, -15) + 1e-7);  // y's rounding: below 2^-25 of 0.6 mm
  EXPECT_EQ(stream->certify(CoordinateRounding::none)->max_vertical_error_mm, 0.0);
}

TEST(GridStream, RefusesAFormatThatMakesNodesOne) {
  ModelField field = random_terrain(3, 5, 6, 0.01, 0.1);
  const SolidOptions options{.base_z = Millimetres{-2}};
  field.x0 = Millimetres{1e6};  // floats there are 1/16 mm apart
  auto stream = GridSolidStream::create(field, options);
  ASSERT_THAT(stream, Succeeds());
  auto refused = stream->certify(CoordinateRounding::float32);
  ASSERT_THAT(refused, FailsWith(kRoundingCollapses));
  EXPECT_THAT(refused.error().message,
              testing::HasSubstr("columns 0 and 1 both become x = 1000000 mm"));
  EXPECT_THAT(stream->certify(CoordinateRounding::none), Succeeds());
  std::swap(field.x0, field.y0);
  refused = stream->certify(CoordinateRounding::float32);
  ASSERT_THAT(refused, FailsWith(kRoundingCollapses));
  EXPECT_THAT(refused.error().message, testing::HasSubstr("rows 0 and 1"));
  field.y0 = Millimetres{0.0};
  for (float& z : field.z_mm.cells()) z = 3e7F;  // steps of 2 mm
  stream = GridSolidStream::create(field, {.base_z = Millimetres{3e7 - 1.0}});
  ASSERT_THAT(stream, Succeeds());
  EXPECT_THAT(stream->certify(CoordinateRounding::float32), FailsWith(kRoundingCollapses));
}

TEST(GridStream, RefusesVoidsThinBasesAndStops) {
  ModelField field = random_terrain(3, 5, 6, 0.5, 0.1);
  RunContext run;
  std::stop_source stop;
  stop.request_stop();
  run.stop = stop.get_token();
  EXPECT_THAT(GridSolidStream::create(field)->certify(CoordinateRounding::none, run),
              FailsWith(kCancelled));
  EXPECT_THAT(GridSolidStream::create(field, {.base_z = Millimetres{5}}), FailsWith(kBaseTooThin));
  field.z_mm(2, 2) = NAN;
  EXPECT_THAT(GridSolidStream::create(field), FailsWith(kSurfaceHasVoids));
}

TEST(GridStream, WritesThePlyOfTheMesh) {
  const ScratchFolder folder;
  const ModelField field = random_terrain(5, 130, 190, 0.4, 0.2, 0.02);  // several buffers
  ASSERT_THAT(write_ply(grid_solid(field).value(), folder / "mesh.ply"), Succeeds());
  ASSERT_THAT(write_ply(GridSolidStream::create(field).value(), folder / "stream.ply"), Succeeds());
  EXPECT_EQ(sha256_file(folder / "mesh.ply").value(), sha256_file(folder / "stream.ply").value());
}

}  // namespace
}  // namespace maquette::meshing

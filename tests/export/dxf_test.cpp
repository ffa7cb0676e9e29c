// SPDX-License-Identifier: GPL-3.0-or-later

// export/cad.hpp, write_dxf_contours; export/contours.hpp:
//   an inclined plane ................ straight lines at known places, border to border
//   a cone ........................... closed rings, area of the known polygon's limits
//   lines lie on the surface ......... height_at every point; every height is a level
//   nothing missing, nothing twice ... length against every triangle cut by itself
//   higher ground on the left ........ beside the middle of every segment
//   nodes exactly at the level ....... whole-number heights: the same laws
//   voids end lines .................. a hole in an inclined plane
//   another reader ................... GDAL: layers, heights, closure, outline
//   each error code .................. interval, levels, no cell, all void, folder, stopped

#include <gdal_priv.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>
#include <ogrsf_frmts.h>

#include <map>
#include <numbers>

#include "core/random.hpp"
#include "export/cad.hpp"
#include "export/contours.hpp"
#include "support/matchers.hpp"
#include "support/simple_solids.hpp"

namespace maquette::exporting {
namespace {

using heightmap::ModelField;
using testing_support::FailsWith;
using testing_support::Hills;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

template <class Height>
ModelField field(std::ptrdiff_t rows, std::ptrdiff_t cols, double spacing, Height height) {
  ModelField f{Grid<float>(rows, cols), Millimetres{spacing}, Millimetres{3.5}, Millimetres{-7.25}};
  for (std::ptrdiff_t r = 0; r < rows; ++r)
    for (std::ptrdiff_t c = 0; c < cols; ++c)
      f.z_mm(r, c) = static_cast<float>(height(f.x_mm(c), f.y_mm(r)));
  return f;
}

double length(const ContourLine& line) {
  double sum = 0;
  const auto& p = line.points_mm;
  for (std::size_t i = 0; i + 1 < p.size(); ++i)
    sum += std::hypot(p[i + 1][0] - p[i][0], p[i + 1][1] - p[i][1]);
  if (line.closed) sum += std::hypot(p.front()[0] - p.back()[0], p.front()[1] - p.back()[1]);
  return sum;
}

/// Signed; positive counter-clockwise.
double area(const ContourLine& line) {
  double twice = 0;
  const auto& p = line.points_mm;
  for (std::size_t i = 0; i < p.size(); ++i) {
    const auto &a = p[i], &b = p[(i + 1) % p.size()];
    twice += a[0] * b[1] - a[1] * b[0];
  }
  return twice / 2;
}

TEST(Contours, OfAnInclinedPlaneAreStraight) {
  const ModelField f = field(20, 30, 0.5, [](double x, double) { return 2 * x; });
  const ContourTracer tracer(f);
  const auto lines = tracer.trace(17.3);  // x = 8.65, between two columns
  ASSERT_EQ(lines.size(), 1U);
  EXPECT_FALSE(lines[0].closed);
  for (const auto& p : lines[0].points_mm) EXPECT_NEAR(p[0], 8.65, 1e-12);
  // higher ground (east) on the left: the line runs south
  EXPECT_DOUBLE_EQ(lines[0].points_mm.front()[1], f.y_mm(19));
  EXPECT_DOUBLE_EQ(lines[0].points_mm.back()[1], f.y_mm(0));
  EXPECT_TRUE(tracer.trace(1000).empty());
  EXPECT_TRUE(tracer.trace(-1000).empty());
}

TEST(Contours, OfAConeAreRings) {
  constexpr double kR = 9;
  const ModelField f = field(201, 201, 0.15, [](double x, double y) {
    return 20 - std::hypot(x - 3.5 - 15, y + 7.25 - 15);
  });
  const auto lines = ContourTracer(f).trace(20 - kR);
  ASSERT_EQ(lines.size(), 1U);
  EXPECT_TRUE(lines[0].closed);
  // Linear between nodes that lie on the cone: off by at most spacing^2 / (4 R)
  for (const auto& p : lines[0].points_mm)
    EXPECT_NEAR(std::hypot(p[0] - 18.5, p[1] - 7.75), kR, 0.15 * 0.15 / (4 * kR) + 1e-5);
  EXPECT_NEAR(area(lines[0]), std::numbers::pi * kR * kR, 2 * std::numbers::pi * kR * 2e-3);
}

double cut_length(const ModelField& f, double level) {
  double sum = 0;
  for (std::ptrdiff_t r = 0; r + 1 < f.z_mm.rows(); ++r)
    for (std::ptrdiff_t c = 0; c + 1 < f.z_mm.cols(); ++c)
      for (const bool upper : {false, true}) {
        const auto node = [&](std::ptrdiff_t dr, std::ptrdiff_t dc) {
          return Vec3{f.x_mm(c + dc), f.y_mm(r + dr), static_cast<double>(f.z_mm(r + dr, c + dc))};
        };
        const std::array<Vec3, 3> t{node(0, 0), upper ? node(1, 1) : node(0, 1),
                                    upper ? node(1, 0) : node(1, 1)};
        std::vector<Vec3> cuts;
        for (std::size_t k = 0; k < 3; ++k) {
          const Vec3 a = t[k], b = t[(k + 1) % 3];
          if ((a.z >= level) == (b.z >= level)) continue;
          cuts.push_back(a + ((level - a.z) / (b.z - a.z)) * (b - a));
        }
        if (cuts.size() == 2 && !std::isnan(t[0].z + t[1].z + t[2].z))
          sum += std::hypot(cuts[0].x - cuts[1].x, cuts[0].y - cuts[1].y);
      }
  return sum;
}

class ContoursOnTerrain : public testing::TestWithParam<std::uint64_t> {
 protected:
  void expect_laws(const ModelField& f, double level, bool higher_on_the_left) {
    double sum = 0;
    int checked = 0;
    for (const ContourLine& line : ContourTracer(f).trace(level)) {
      sum += length(line);
      const auto& p = line.points_mm;
      for (std::size_t i = 0; i < p.size(); ++i) {
        EXPECT_NEAR(heightmap::height_at(f, p[i][0], p[i][1]), level, 1e-9);
        if (i + 1 == p.size()) break;
        const double dx = p[i + 1][0] - p[i][0], dy = p[i + 1][1] - p[i][1];
        const double d = std::hypot(dx, dy);
        ASSERT_GT(d, 0);
        if (d < 0.01) continue;
        const double left = heightmap::height_at(f, (p[i][0] + p[i + 1][0]) / 2 - 1e-4 * dy / d,
                                                 (p[i][1] + p[i + 1][1]) / 2 + 1e-4 * dx / d);
        if (higher_on_the_left && !std::isnan(left)) {
          EXPECT_GE(left, level);
        }
        ++checked;
      }
      if (!line.closed) {
        for (const auto& end : {p.front(), p.back()}) {
          const bool at_border = std::abs(end[0] - f.x_mm(0)) < 1e-9 ||
                                 std::abs(end[1] - f.y_mm(0)) < 1e-9 ||
                                 std::abs(end[0] - f.x_mm(f.z_mm.cols() - 1)) < 1e-9 ||
                                 std::abs(end[1] - f.y_mm(f.z_mm.rows() - 1)) < 1e-9;
          EXPECT_TRUE(at_border) << end[0] << ' ' << end[1];
        }
      }
    }
    EXPECT_GT(checked, 20);
    EXPECT_NEAR(sum, cut_length(f, level), 1e-8);
  }
};

TEST_P(ContoursOnTerrain, LieOnTheSurfaceAndMissNothing) {
  const Hills hills(GetParam(), 50, 4);
  const ModelField f = field(151, 137, 0.35, hills);  // several blocks of 64
  for (const double level : {-2.0, 0.0, 0.7, 3.1}) expect_laws(f, level, true);
}

TEST_P(ContoursOnTerrain, HoldWhereNodesAreExactlyAtTheLevel) {
  const auto f = field(70, 80, 1.0, [&](double x, double y) {
    return std::floor(4 *
                      random_uniform(GetParam(), static_cast<std::uint64_t>(1000 * (y + 100) + x)));
  });
  // Along a ridge exactly at the level a line runs forth and back: lower on both sides.
  for (const double level : {1.0, 2.0, 3.0}) expect_laws(f, level, false);
}
INSTANTIATE_TEST_SUITE_P(Seeds, ContoursOnTerrain, testing::Values(1, 2, 3, 4));

TEST(Contours, LeaveOutASummitExactlyAtTheLevel) {
  ModelField f = field(5, 5, 1.0, [](double, double) { return 0.0; });
  f.z_mm(2, 2) = 1.0F;
  EXPECT_TRUE(ContourTracer(f).trace(1.0).empty());
  EXPECT_EQ(ContourTracer(f).trace(0.5).size(), 1U);
  // a flat field at the level has no line: all of it counts as above
  EXPECT_TRUE(ContourTracer(f).trace(0.0).empty());
}

TEST(Contours, EndAtVoids) {
  ModelField f = field(11, 11, 1.0, [](double x, double) { return x; });
  f.z_mm(5, 5) = NAN;  // x = 8.5
  const auto lines = ContourTracer(f).trace(8.25);
  ASSERT_EQ(lines.size(), 2U);
  double sum = 0;
  for (const auto& line : lines) sum += length(line);
  EXPECT_NEAR(sum, cut_length(f, 8.25), 1e-12);
  EXPECT_NEAR(sum, 10 - 1.25 - 0.0, 0.8);  // about one and a half of ten cells are gone
}

// ---- the file ----------------------------------------------------------------

struct DxfLine {
  std::vector<Vec3> points;
};

std::map<std::string, std::vector<DxfLine>> read_dxf(const std::filesystem::path& path) {
  GDALAllRegister();
  std::map<std::string, std::vector<DxfLine>> lines;
  const std::unique_ptr<GDALDataset> data(
      GDALDataset::Open(path.c_str(), GDAL_OF_VECTOR | GDAL_OF_VERBOSE_ERROR));
  EXPECT_NE(data, nullptr);
  if (!data) return lines;
  for (const auto& feature : *data->GetLayer(0)) {
    const auto* geometry = feature->GetGeometryRef();
    EXPECT_EQ(wkbFlatten(geometry->getGeometryType()), wkbLineString);
    DxfLine line;
    for (const auto& p : *geometry->toLineString())
      line.points.push_back({p.getX(), p.getY(), p.getZ()});
    lines[feature->GetFieldAsString("Layer")].push_back(std::move(line));
  }
  return lines;
}

TEST(WriteDxfContours, IsReadByGdal) {
  const ScratchFolder folder;
  const Hills hills(11, 50, 4);
  const ModelField f = field(101, 121, 0.5, hills);
  ASSERT_THAT(write_dxf_contours(f, Millimetres{0.5}, folder / "a.dxf"), Succeeds());
  auto lines = read_dxf(folder / "a.dxf");
  ASSERT_EQ(lines.size(), 2U);
  ASSERT_EQ(lines["OUTLINE"].size(), 1U);
  const auto& outline = lines["OUTLINE"][0].points;
  ASSERT_EQ(outline.size(), 5U);
  EXPECT_EQ(outline.front(), outline.back());
  EXPECT_NEAR(norm(outline[2] - Vec3{f.x_mm(120), f.y_mm(100), 0}), 0, 1e-6);

  float lo = INFINITY, hi = -INFINITY;
  for (const float z : f.z_mm.cells()) lo = std::min(lo, z), hi = std::max(hi, z);
  std::map<double, double> length_at;
  for (const DxfLine& line : lines["CONTOUR"]) {
    ASSERT_GE(line.points.size(), 2U);
    const double z = line.points.front().z;
    EXPECT_DOUBLE_EQ(std::round(z * 2) / 2, z);
    for (std::size_t i = 0; i < line.points.size(); ++i) {
      const Vec3 p = line.points[i];
      EXPECT_EQ(p.z, z);
      const double there = heightmap::height_at(f, p.x, p.y);
      // six decimals in x and y on slopes below 5; just outside the field: NaN
      if (!std::isnan(there)) {
        EXPECT_NEAR(there, z, 5e-6);
      }
      if (i > 0) length_at[z] += norm(p - line.points[i - 1]);
    }
  }
  const int levels = static_cast<int>(std::floor(hi / 0.5F) - std::floor(lo / 0.5F));
  EXPECT_EQ(static_cast<int>(length_at.size()), levels);
  // Closing segments are there too, or lengths would differ; 1e-6 per point
  for (const auto& [z, sum] : length_at) EXPECT_NEAR(sum, cut_length(f, z), 0.01) << z;
}

TEST(WriteDxfContours, GivesTheSameBytesTwice) {
  const ScratchFolder folder;
  const ModelField f = field(151, 137, 0.35, Hills(4, 50, 4));
  for (const char* name : {"a.dxf", "b.dxf"})
    ASSERT_THAT(write_dxf_contours(f, Millimetres{0.2}, folder / name), Succeeds());
  EXPECT_EQ(sha256_file(folder / "a.dxf").value(), sha256_file(folder / "b.dxf").value());
}

TEST(WriteDxfContours, SaysWhyItCannot) {
  const ScratchFolder folder;
  const ModelField f = field(10, 10, 1, [](double x, double) { return x; });
  const auto path = folder / "a.dxf";
  for (const double bad : {0.0, -1.0, static_cast<double>(NAN), static_cast<double>(INFINITY)})
    EXPECT_THAT(write_dxf_contours(f, Millimetres{bad}, path), FailsWith(kOptionOutOfRange));
  EXPECT_THAT(write_dxf_contours(f, Millimetres{1e-5}, path), FailsWith(kOptionOutOfRange));
  EXPECT_THAT(
      write_dxf_contours(field(1, 9, 1, [](double x, double) { return x; }), Millimetres{1}, path),
      FailsWith(kEmptyMesh));
  EXPECT_THAT(
      write_dxf_contours(field(9, 9, 1, [](double, double) { return NAN; }), Millimetres{1}, path),
      FailsWith(kEmptyMesh));
  EXPECT_THAT(write_dxf_contours(f, Millimetres{1}, folder / "no/a.dxf"),
              FailsWith(kFileNotWritable));
  std::stop_source stop;
  RunContext run;
  run.stop = stop.get_token();
  run.progress = [&](double) { stop.request_stop(); };
  EXPECT_THAT(write_dxf_contours(f, Millimetres{1}, path, run), FailsWith(kCancelled));
  EXPECT_TRUE(std::filesystem::is_empty(folder.path()));
}

}  // namespace
}  // namespace maquette::exporting

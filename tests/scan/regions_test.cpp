// SPDX-License-Identifier: GPL-3.0-or-later

// What is claimed in scan/regions.hpp, and how: polygons with holes by hand; verdicts on noise with
// tolerance zones that hold, that do not and that are too narrow to tell; texture of a sine in
// closed form; dependence on a value that deviations follow; the budget's sum.

#include "scan/regions.hpp"

#include <array>
#include <cmath>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/files.hpp"
#include "core/random.hpp"
#include "support/matchers.hpp"
#include "support/scan_terrain.hpp"

namespace maquette::scan {
namespace {

using testing_support::FailsWith;
using testing_support::rough_part;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

TEST(Regions, AreReadWithHolesAndTolerances) {
  const ScratchFolder folder;
  ASSERT_THAT(write_file(folder / "r.geojson", R"({"type": "FeatureCollection", "features": [
    {"type": "Feature", "properties": {"name": "rim", "lower_mm": -0.1, "upper_mm": 0.2},
     "geometry": {"type": "Polygon", "coordinates": [
       [[0,0],[10,0],[10,10],[0,10],[0,0]], [[4,4],[6,4],[6,6],[4,6],[4,4]]]}},
    {"type": "Feature", "properties": null,
     "geometry": {"type": "MultiPolygon", "coordinates": [[[[20,0],[30,0],[30,10],[20,0]]]]}}]})"),
              Succeeds());
  const auto regions = read_regions(folder / "r.geojson");
  ASSERT_THAT(regions, Succeeds());
  ASSERT_EQ(regions->size(), 2U);
  const Region& rim = (*regions)[0];
  EXPECT_EQ(rim.name, "rim");
  EXPECT_EQ(rim.lower_mm, -0.1);
  EXPECT_EQ(rim.upper_mm, 0.2);
  EXPECT_TRUE(rim.holds(1.0, 1.0));
  EXPECT_FALSE(rim.holds(5.0, 5.0)) << "a hole";
  EXPECT_FALSE(rim.holds(11.0, 5.0));
  EXPECT_EQ((*regions)[1].name, "region 2");
  EXPECT_TRUE(std::isnan((*regions)[1].lower_mm));
  EXPECT_TRUE((*regions)[1].holds(29.0, 5.0));
  EXPECT_FALSE((*regions)[1].holds(21.0, 5.0));
  for (const char* text :
       {"nonsense", "{}", R"({"features": [{}]})",
        R"({"features": [{"geometry": {"type": "Point", "coordinates": [1, 2]}}]})",
        R"({"features": [{"geometry": {"type": "Polygon", "coordinates": [[[0, 0], [1, 1]]]}}]})",
        R"({"features": [{"geometry": {"type": "Polygon", "coordinates": 3}}]})",
        R"({"features": [{"properties": {"lower_mm": 2, "upper_mm": 1}, "geometry":
            {"type": "Polygon", "coordinates": []}}]})"}) {
    ASSERT_THAT(write_file(folder / "bad.geojson", text), Succeeds());
    EXPECT_THAT(read_regions(folder / "bad.geojson"), FailsWith(kRegionFormat)) << text;
  }
}

TEST(Regions, BandsCoverThePart) {
  const auto part = rough_part(1, 101, 51, 2.0);
  const auto even = band_regions(part, {.max_width = Millimetres{90.0}});
  ASSERT_THAT(even, Succeeds());
  ASSERT_EQ(even->size(), 3U);  // 200 mm in strips of 66.7
  for (double y = 1.0; y < 200.0; y += 7.0) {
    int in = 0;
    for (const Region& b : *even) in += b.holds(50.0, y) ? 1 : 0;
    EXPECT_EQ(in, 1) << y;
  }
  // Joints that keep off stones, across x: columns 0 to 20 and 20 to 50, 2 mm apart.
  const auto uneven =
      band_regions(part, {.axis = meshing::BandAxis::x, .joints = std::vector<std::ptrdiff_t>{20}});
  ASSERT_THAT(uneven, Succeeds());
  ASSERT_EQ(uneven->size(), 2U);
  EXPECT_EQ((*uneven)[1].name, "band 2");
  EXPECT_TRUE((*uneven)[0].holds(part.x_mm(20) - 0.1, 50.0));
  EXPECT_FALSE((*uneven)[0].holds(part.x_mm(20) + 0.1, 50.0));
  EXPECT_TRUE((*uneven)[1].holds(part.x_mm(20) + 0.1, 50.0));
  EXPECT_THAT(band_regions(part, {.joints = std::vector<std::ptrdiff_t>{200}}),
              FailsWith(meshing::kBandsDegenerate));
}

TEST(Regions, VerdictsWithAGuardBand) {
  std::vector<Vec3> points;
  std::vector<float> d;
  for (std::uint64_t i = 0; i < 100'000; ++i) {
    points.push_back({200.0 * random_uniform(1, 2 * i), 200.0 * random_uniform(1, 2 * i + 1), 0.0});
    // 0.05 mm of noise; 0.3 mm too high in the right fifth.
    d.push_back(static_cast<float>(0.05 * random_normal(2, i) + (points[i].x > 160.0 ? 0.3 : 0.0)));
  }
  const Significance s = significance(points, d, {}, 4.0);
  const auto region = [](double x0, double x1, double lower, double upper) {
    Region r;
    r.name = "r";
    r.rings_mm = {{{x0, 0}, {x1, 0}, {x1, 200}, {x0, 200}, {x0, 0}}};
    r.lower_mm = lower, r.upper_mm = upper;
    return r;
  };
  const double u = static_cast<double>(s.maps[0].lod_mm(5, 5));
  const std::vector<Region> regions{
      region(5, 95, -0.1 - 4.0 * u, 0.1 + 4.0 * u), region(165, 195, -0.1, 0.29 - 4.0 * u),
      region(5, 95, -0.02, 0.02), region(5, 95, NAN, NAN), region(300, 400, -1, 1)};
  const auto r = judge_regions(points, d, regions, s, nullptr);
  EXPECT_EQ(r[0].verdict, Verdict::pass);
  EXPECT_GT(r[0].within, 0.9);
  EXPECT_EQ(r[1].verdict, Verdict::fail);
  EXPECT_NEAR(r[1].worst_mm, 0.33, 0.06);
  EXPECT_EQ(r[2].verdict, Verdict::undecided);
  EXPECT_EQ(r[3].verdict, Verdict::none);
  EXPECT_NEAR(r[3].statistics.mean_mm, 0.0, 5.0 * r[3].sigma_mean_mm);
  EXPECT_EQ(r[4].statistics.points, 0U);
}

TEST(Texture, OfASine) {
  // Amplitude 0.1 mm, wavelength 8 mm along x, on a bowl that is form.
  Grid<float> d(400, 400);
  for (std::ptrdiff_t r = 0; r < 400; ++r)
    for (std::ptrdiff_t c = 0; c < 400; ++c) {
      const double x = 0.25 * static_cast<double>(c), y = 0.25 * static_cast<double>(r);
      d(r, c) = static_cast<float>(0.1 * std::sin(2.0 * std::numbers::pi * x / 8.0) +
                                   1e-4 * (x - 50.0) * (x - 50.0) + 0.002 * y);
    }
  const Texture t = texture_of(d, 0.25);
  // 12.5 periods: the form takes a little of the odd half.
  EXPECT_NEAR(t.sa_mm, 0.2 / std::numbers::pi, 0.002);
  EXPECT_NEAR(t.sq_mm, 0.1 / std::numbers::sqrt2, 0.002);
  EXPECT_NEAR(t.sz_mm, 0.2, 0.02);
  EXPECT_NEAR(t.ssk, 0.0, 0.1);
  EXPECT_NEAR(t.sku, 1.5, 0.05);
  // Mean of sqrt(1 + s^2) - 1 with s = 0.0785 cos: about s^2 / 4.
  EXPECT_NEAR(t.sdr, 0.0785 * 0.0785 / 4.0, 1e-4);
  EXPECT_NEAR(t.form_mm, 0.25 + 0.2, 0.08);
  EXPECT_TRUE(std::isnan(texture_of(Grid<float>(5, 5, NAN), 1.0).sa_mm));
}

/// A drawing in the tagged pairs of DXF.
std::string dxf(const std::string& entities, int unit = 4) {
  return "0\nSECTION\n2\nHEADER\n9\n$ACADVER\n1\nAC1015\n9\n$INSUNITS\n70\n" +
         std::to_string(unit) + "\n0\nENDSEC\n0\nSECTION\n2\nENTITIES\n" + entities +
         "0\nENDSEC\n0\nEOF\n";
}

std::string polyline(const std::string& layer, const std::vector<std::array<double, 2>>& points,
                     bool closed) {
  std::string text = "0\nLWPOLYLINE\n8\n" + layer + "\n90\n" + std::to_string(points.size()) +
                     "\n70\n" + (closed ? "1" : "0") + "\n";
  for (const auto& p : points)
    text += "10\n" + std::to_string(p[0]) + "\n20\n" + std::to_string(p[1]) + "\n";
  return text;
}

TEST(Regions, FromADrawing) {
  const testing_support::ScratchFolder scratch;
  const auto label = [](const char* text, double x, double y) {
    return "0\nTEXT\n8\nnotes\n10\n" + std::to_string(x) + "\n20\n" + std::to_string(y) +
           "\n40\n2.5\n1\n" + text + "\n";
  };
  ASSERT_TRUE(
      write_file(scratch / "a.DXF",
                 dxf(polyline("pads", {{0, 0}, {10, 0}, {10, 10}, {0, 10}}, true) +
                     polyline("pads", {{20, 0}, {30, 0}, {30, 10}, {20, 10}}, true) +
                     polyline("hint", {{0, 50}, {90, 50}}, false) +
                     "0\nCIRCLE\n8\nholes\n10\n50\n20\n30\n40\n8\n" +
                     label("rim of the bowl -0.1 0.25", 50, 30) + label("outside", 200, 200))));
  const auto regions = read_regions(scratch / "a.DXF");
  ASSERT_THAT(regions, Succeeds());
  ASSERT_EQ(regions->size(), 3U);
  EXPECT_EQ((*regions)[0].name, "pads");
  EXPECT_EQ((*regions)[1].name, "pads (2)");
  EXPECT_TRUE((*regions)[0].holds(5, 5));
  EXPECT_FALSE((*regions)[0].holds(25, 5));
  EXPECT_TRUE(std::isnan((*regions)[0].lower_mm));
  const Region& circle = (*regions)[2];
  EXPECT_EQ(circle.name, "rim of the bowl");
  EXPECT_EQ(circle.lower_mm, -0.1);
  EXPECT_EQ(circle.upper_mm, 0.25);
  for (const double a : {0.1, 1.0, 2.0, 4.0, 6.0}) {
    EXPECT_TRUE(circle.holds(50 + 7.999 * std::cos(a), 30 + 7.999 * std::sin(a)));
    EXPECT_FALSE(circle.holds(50 + 8.001 * std::cos(a), 30 + 8.001 * std::sin(a)));
  }
  ASSERT_TRUE(
      write_file(scratch / "inch.dxf", dxf(polyline("p", {{0, 0}, {1, 0}, {1, 1}}, true), 1)));
  const auto inches = read_regions(scratch / "inch.dxf");
  ASSERT_THAT(inches, FailsWith(kRegionFormat));
  EXPECT_THAT(inches.error().message, testing::HasSubstr("inches"));
  ASSERT_TRUE(
      write_file(scratch / "open.dxf", dxf(polyline("p", {{0, 0}, {1, 0}, {1, 1}}, false))));
  EXPECT_THAT(read_regions(scratch / "open.dxf"), FailsWith(kRegionFormat));
  ASSERT_TRUE(write_file(scratch / "junk.dxf", "{}"));
  EXPECT_THAT(read_regions(scratch / "junk.dxf"), FailsWith(kRegionFormat));
}

// A value that all points share says nothing: one bin. Two values: two bins, whatever the
// deviations.
TEST(Dependence, KeepsOneValueInOneBin) {
  std::vector<float> d, one, two;
  for (int i = 0; i < 1000; ++i) {
    d.push_back(static_cast<float>((i * 37) % 101));
    one.push_back(3000.0F);
    two.push_back(i % 4 == 0 ? -180.0F : 0.0F);
  }
  EXPECT_EQ(depend_on("feed", one, d).points, (std::vector<std::size_t>{1000}));
  const Dependence on = depend_on("direction", two, d);
  EXPECT_EQ(on.points, (std::vector<std::size_t>{250, 750}));
  EXPECT_EQ(on.from, (std::vector<double>{-180.0, 0.0}));
  EXPECT_NEAR(on.mean_mm[0], on.mean_mm[1], 2.0);
}

TEST(Dependence, ShowsWhatDeviationsFollow) {
  std::vector<float> value, d;
  for (std::uint64_t i = 0; i < 8'000; ++i) {
    value.push_back(static_cast<float>(random_uniform(3, i)));
    d.push_back(0.5F * value.back() + static_cast<float>(0.01 * random_normal(4, i)));
  }
  value[5] = NAN;
  const Dependence r = depend_on("range", value, d, 8);
  ASSERT_EQ(r.mean_mm.size(), 8U);
  for (std::size_t k = 0; k < 8; ++k) {
    EXPECT_NEAR(r.mean_mm[k], 0.5 * (0.0625 + 0.125 * static_cast<double>(k)), 0.01);
    EXPECT_NEAR(static_cast<double>(r.points[k]), 1000.0, 1.0);
  }
}

TEST(Budget, AddsUp) {
  const auto part = rough_part(2, 101, 101, 1.0);
  std::vector<Vec3> points;
  std::vector<float> d;
  for (std::uint64_t i = 0; i < 60'000; ++i) {
    points.push_back({100.0 * random_uniform(1, 2 * i), 100.0 * random_uniform(1, 2 * i + 1), 0.0});
    d.push_back(static_cast<float>(0.05 * random_normal(2, i)));
  }
  Registration pose;
  pose.covariance[14] = 4e-6;  // z: 0.002 mm
  const Significance s = significance(points, d, std::array{ScanPose{pose, points.size()}}, 4.0);
  const Budget b = budget_of(s.maps[0], &pose, part);
  ASSERT_EQ(b.contributions.size(), 4U);
  EXPECT_NEAR(b.contributions[0].u_mm, 0.05 / std::sqrt(96.0), 0.0005);
  EXPECT_NEAR(b.contributions[2].u_mm, 0.002, 1e-9);
  double square = 0.0;
  for (const auto& c : b.contributions) square += c.u_mm * c.u_mm;
  EXPECT_DOUBLE_EQ(b.combined_mm, std::sqrt(square));
  EXPECT_DOUBLE_EQ(b.expanded_mm, 2.0 * b.combined_mm);
}

}  // namespace
}  // namespace maquette::scan

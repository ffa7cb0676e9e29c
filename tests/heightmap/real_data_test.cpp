// SPDX-License-Identifier: GPL-3.0-or-later

// Real products, skipped where they are not on disk (MAQUETTE_DATA names their folder)
//   Gale, HiRISE over MOLA             heights of the HiRISE file at known pixels, relief kept
//   Shoemaker, LOLA 5 m over LDEM_4    the same in a polar map over a cylindrical one
//   LDEM_4 as PDS3 and as ISIS cube    equal heights at equal places
//   LDEM_4 moved by parts of a pixel   found on the ISIS cube of another release; residuals before
//     onto the cube                      and after, and their map
//   Shoemaker, clean = "remove"        what is taken away is what was found; heights elsewhere stay
//   HiRISE cubes                       local, polar and sinusoidal spheres are Mars, lie where
//                                        their labels say, and ISIS NULL is a void (they hold
//                                        nothing else)
//   LDEM_4 cut short, cube cut short   refused; with both sizes

#include <cmath>
#include <numbers>

#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/files.hpp"
#include "heightmap/field_io.hpp"
#include "heightmap/fuse.hpp"
#include "support/folders.hpp"
#include "support/matchers.hpp"
#include "support/planet_raster.hpp"

namespace maquette::heightmap {
namespace {

using testing_support::data_folder;
using testing_support::FailsWith;
using testing_support::ScratchFolder;
using testing_support::Succeeds;

class RealData : public ::testing::Test {
 protected:
  void SetUp() override {
    if (!std::filesystem::exists(data_folder()))
      GTEST_SKIP() << "no real data in " << data_folder() << "; set MAQUETTE_DATA";
  }
  static FuseRequest site(const char* body, double lat, double lon, double half_width,
                          double spacing, std::vector<Source> sources) {
    FuseRequest request;
    request.body = *body_by_name(body);
    request.centre_latitude_deg = lat;
    request.centre_longitude_deg = lon;
    request.half_width = Metres{half_width};
    request.spacing = Metres{spacing};
    request.sources = std::move(sources);
    request.restore = false;  // heights as the files have them
    return request;
  }
  static double file_value(const std::filesystem::path& path, int col, int row) {
    GDALAllRegister();
    GDALDataset* d = GDALDataset::Open(path.c_str());
    double value = NAN;
    EXPECT_EQ(d->GetRasterBand(1)->RasterIO(GF_Read, col, row, 1, 1, &value, 1, 1, GDT_Float64, 0,
                                            0, nullptr),
              CE_None);
    GDALClose(d);
    return value;
  }
};

TEST_F(RealData, GaleHirise) {
  const auto hirise = data_folder() / "mars/gale_hirise_1m.tif";
  // The middle of pixel (174, 168): x = 8142406 + 174.5, y = -276455 - 168.5 on a sphere.
  const double per_degree = 3396190.0 * std::numbers::pi / 180.0;
  const double lat = -276623.5 / per_degree, lon = 8142580.5 / per_degree;
  const auto alone = fuse(site("mars", lat, lon, 100, 0.5, {{"hirise", hirise, "auto", 0.3}}));
  ASSERT_THAT(alone, Succeeds());
  EXPECT_NEAR(alone->field.z_m(200, 200), file_value(hirise, 174, 168), 1e-3);
  EXPECT_NEAR(alone->sources[0].pixel_m, 1.0, 0.01);
  // 60 m east: the map is true at the equator only, here one of its metres is cos(lat) metres.
  const double metres_60 = 60.0 * std::cos(lat * std::numbers::pi / 180.0);
  const auto moved = fuse(site("mars", lat, lon + 60.0 / per_degree, 10, 0.5, {{"h", hirise}}));
  ASSERT_THAT(moved, Succeeds());
  EXPECT_NEAR(moved->field.z_m(20, 20), file_value(hirise, 234, 168), 1e-3);
  const auto c = static_cast<std::ptrdiff_t>(std::lround(200 + metres_60 / 0.5));
  EXPECT_NEAR(alone->field.z_m(200, c), file_value(hirise, 234, 168), 0.3);
  EXPECT_LT(height_range(alone->field.z_m).max, -4437.0F);
  EXPECT_GT(height_range(alone->field.z_m).min, -4473.0F);

  const auto pair = fuse(site("mars", lat, lon, 100, 0.5,
                              {{"mola", data_folder() / "mars/megt90n000cb.vrt", "auto", 30.0},
                               {"hirise", hirise, "auto", 0.3}}));
  ASSERT_THAT(pair, Succeeds());
  EXPECT_EQ(pair->sources[1].shift_east_m, 0.0) << "14.8 km pixels cannot tell";
  // MOLA knows nothing of this relief: it stays, but for some of the stereo's white noise.
  double square = 0.0;
  for (std::ptrdiff_t r = 0; r < 401; ++r)
    for (std::ptrdiff_t k = 0; k < 401; ++k)
      square += std::pow(pair->field.z_m(r, k) - pair->sources[1].shift_up_m -
                             static_cast<double>(alone->field.z_m(r, k)),
                         2.0);
  EXPECT_LT(std::sqrt(square) / 401.0, 0.01);
  EXPECT_NEAR(pair->sources[0].pixel_m, 14818.0, 60.0);
  RecordProperty("gale_shift_up_m", std::to_string(pair->sources[1].shift_up_m));
}

TEST_F(RealData, ShoemakerLola) {
  const auto lola = data_folder() / "moon/shoemaker_lola_5m.tif";
  // Middle of pixel (128, 127) of the polar map: x = 75360 + 642.5, y = 39640 - 637.5.
  const double x = 76002.5, y = 39002.5;
  const double lon = std::atan2(x, y) * 180.0 / std::numbers::pi;
  const double lat =
      -90.0 + 2.0 * std::atan(std::hypot(x, y) / (2.0 * 1737400.0)) * 180.0 / std::numbers::pi;
  const auto fused = fuse(site("moon", lat, lon, 400, 1.0,
                               {{"ldem_4", data_folder() / "moon/LDEM_4.LBL", "auto", 10.0},
                                {"lola_5m", lola, "auto", 1.0}}));
  ASSERT_THAT(fused, Succeeds());
  const SourceReport& report = fused->sources[1];
  EXPECT_NEAR(fused->field.z_m(400, 400) - report.shift_up_m, file_value(lola, 128, 127), 0.01);
  EXPECT_EQ(report.coverage, 1.0);
  EXPECT_NEAR(report.pixel_m, 5.0, 0.02);
  // 45 pixels along the local meridian is 45 pixels towards the pole of the map.
  const double rho = std::hypot(x, y);
  const auto north = fuse(site("moon", lat, lon, 100, 1.0, {{"lola_5m", lola}}));
  ASSERT_THAT(north, Succeeds());
  const double px = (x + 75.0 * x / rho - 75360.0) / 5.0,
               py = (39640.0 - (y + 75.0 * y / rho)) / 5.0;
  EXPECT_NEAR(north->field.z_m(175, 100),
              file_value(lola, static_cast<int>(px), static_cast<int>(py)), 1.5)
      << "75 m north is 75 m away from the south pole";
}

TEST_F(RealData, LdemAsPds3AndAsIsisCube) {
  // Each pixel of the cube is the mean of 3 x 3 of the image, of another release that
  // differs by some 20 m; the relief over one image pixel is several hundred.
  const auto image = data_folder() / "moon/LDEM_4.LBL",
             cube = data_folder() / "moon/ldem_4_reduced.cub";
  const auto height_at_place = [&](const std::filesystem::path& file, double lat, double lon) {
    const auto fused = fuse(site("moon", lat, lon, 10, 10, {{"ldem", file}}));
    EXPECT_THAT(fused, Succeeds());
    return fused ? static_cast<double>(fused->field.z_m(1, 1)) : NAN;
  };
  std::vector<double> differences, slipped;
  for (int k = 0; k < 15; ++k) {
    const int row = 30 + 12 * k, col = (7 + 67 * k) % 480;
    const double lat = 90.0 - (row + 0.5) * 0.75, lon = (col + 0.5) * 0.75;
    const double reduced = height_at_place(cube, lat, lon);
    EXPECT_NEAR(reduced, 0.5 * file_value(cube, col, row), 0.5) << "scale, offset, radius";
    EXPECT_NEAR(height_at_place(image, lat, lon), 0.5 * file_value(image, 3 * col + 1, 3 * row + 1),
                0.5);
    double sum = 0.0, sum_slipped = 0.0;
    for (const double i : {-0.25, 0.0, 0.25})
      for (const double j : {-0.25, 0.0, 0.25}) {
        sum += height_at_place(image, lat + i, lon + j);
        sum_slipped += height_at_place(image, lat + i, lon + j + 0.375);  // half a cube pixel
      }
    differences.push_back(std::abs(sum / 9.0 - reduced));
    slipped.push_back(std::abs(sum_slipped / 9.0 - reduced));
  }
  std::sort(differences.begin(), differences.end());
  std::sort(slipped.begin(), slipped.end());
  EXPECT_LT(differences[7], 20.0);
  EXPECT_GT(slipped[7], 60.0) << "or this test could not see a slip of half a pixel";
}

/// A part of LDEM_4 around 20 N 150 E whose map is moved east and north by so many pixels.
void write_moved_ldem(const std::filesystem::path& to, double east_px, double north_px) {
  GDALAllRegister();
  GDALDataset* file = GDALDataset::Open((data_folder() / "moon/LDEM_4.LBL").c_str());
  constexpr int kFirstCol = 520, kFirstRow = 210, kCols = 160, kRows = 140;
  std::vector<double> values(static_cast<std::size_t>(kCols) * kRows);
  ASSERT_EQ(
      file->GetRasterBand(1)->RasterIO(GF_Read, kFirstCol, kFirstRow, kCols, kRows, values.data(),
                                       kCols, kRows, GDT_Float64, 0, 0, nullptr),
      CE_None);
  GDALClose(file);
  testing_support::PlanetRaster raster;
  raster.projection = "+proj=eqc +lat_ts=0 +lon_0=0 +R=1737400 +units=m +no_defs";
  raster.pixel = 1737400.0 * std::numbers::pi / 720.0;
  raster.cols = kCols;
  raster.rows = kRows;
  raster.west = (kFirstCol + east_px) * raster.pixel;
  raster.north = (360.0 - kFirstRow + north_px) * raster.pixel;
  raster.height = [&](double x, double y) {
    const auto c = static_cast<std::size_t>((x - raster.west) / raster.pixel),
               r = static_cast<std::size_t>((raster.north - y) / raster.pixel);
    return 0.5 * values[r * kCols + c];
  };
  testing_support::write_planet_raster(raster, to);
}

TEST_F(RealData, LdemIsFoundOnAnotherRelease) {
  const ScratchFolder scratch;
  write_moved_ldem(scratch / "in_place.tif", 0.0, 0.0);
  write_moved_ldem(scratch / "moved.tif", 0.8, -0.6);
  const auto fused = [&](const char* name) {
    return fuse(site("moon", 20.0, 150.0, 300e3, 4e3,
                     {{"cube", data_folder() / "moon/ldem_4_reduced.cub", "auto", 30.0},
                      {"ldem", scratch / name, "auto", 10.0}}));
  };
  const auto in_place = fused("in_place.tif"), moved = fused("moved.tif");
  ASSERT_THAT(in_place, Succeeds());
  ASSERT_THAT(moved, Succeeds());
  const SourceReport &still = in_place->sources[1], &back = moved->sources[1];
  // Nobody moved the product: within what alignment says of itself, a hundredth of 22.7 km.
  EXPECT_LT(std::abs(still.shift_east_m), 3.0 * std::sqrt(still.covariance[0][0]));
  EXPECT_LT(std::abs(still.shift_north_m), 3.0 * std::sqrt(still.covariance[1][1]));
  EXPECT_LT(std::sqrt(still.covariance[0][0]), 250.0);
  const double pixel = 1737400.0 * std::numbers::pi / 720.0;
  // The plane's metres along a parallel are cos(20) of the map's, at the centre.
  EXPECT_NEAR(back.shift_east_m - still.shift_east_m,
              -0.8 * pixel * std::cos(20.0 * std::numbers::pi / 180.0), 0.05 * pixel);
  EXPECT_NEAR(back.shift_north_m - still.shift_north_m, 0.6 * pixel, 0.05 * pixel);
  EXPECT_GT(back.nmad_before_m, 2.0 * back.nmad_after_m);
  EXPECT_LT(still.nmad_before_m, 1.1 * still.nmad_after_m) << "it was in its place";
  EXPECT_NEAR(back.nmad_after_m, still.nmad_after_m, 0.1 * still.nmad_after_m);
  ASSERT_EQ(moved->residuals.size(), 1U);
  const ResidualMap& map = moved->residuals[0];
  EXPECT_EQ(map.source, 1U);
  EXPECT_EQ(map.spacing.value(), 8000.0) << "two nodes: a third of the cube's pixel";
  EXPECT_EQ(map.residual_m.rows(), 75);
  EXPECT_EQ(map.x0.value(), -298e3);
  EXPECT_NEAR(map.nmad_m, back.nmad_after_m, 0.15 * back.nmad_after_m);
  EXPECT_NEAR(map.median_m, 0.0, 0.2 * map.nmad_m);
  for (const char* which : {"before", "after"})
    RecordProperty(std::string("nmad_") + which + "_m",
                   std::to_string(which[0] == 'b' ? back.nmad_before_m : back.nmad_after_m));
  RecordProperty("in_place_east_m", std::to_string(still.shift_east_m));
  RecordProperty("in_place_north_m", std::to_string(still.shift_north_m));
  RecordProperty("in_place_nmad_m", std::to_string(still.nmad_after_m));
}

/// Craters of four to ten pixels passed for boxes: 16 at the two places.
TEST_F(RealData, LdemHasNoStereoBoxes) {
  for (const double latitude : {20.0, -30.0}) {
    const auto fused = fuse(site("moon", latitude, 150.0, 1200e3, 8e3,
                                 {{"ldem", data_folder() / "moon/LDEM_4.LBL", "auto", 10.0}}));
    ASSERT_THAT(fused, Succeeds());
    EXPECT_TRUE(fused->sources[0].artefacts.boxes.empty()) << latitude;
  }
}

TEST_F(RealData, ShoemakerCleaned) {
  const auto lola = data_folder() / "moon/shoemaker_lola_5m.tif";
  const auto with = [&](Clean clean) {
    FuseRequest request =
        site("moon", -87.18351, 62.83502, 450, 1.0, {{"lola", lola, "auto", 0.5}});
    request.sources[0].clean = clean;
    return fuse(request);
  };
  const auto off = with(Clean::off), shown = with(Clean::detect), removed = with(Clean::remove);
  ASSERT_THAT(off, Succeeds());
  ASSERT_THAT(shown, Succeeds());
  ASSERT_THAT(removed, Succeeds());
  EXPECT_EQ(off->sources[0].artefacts.spikes, 0U);
  EXPECT_EQ(removed->sources[0].artefacts.spikes, shown->sources[0].artefacts.spikes);
  EXPECT_GT(removed->sources[0].artefacts.spikes, 0U);
  EXPECT_LT(removed->sources[0].artefacts.spikes, 10U) << "a good product";
  // Two pixels to the side cubic interpolation still shows a pixel: 15 nodes, its own included.
  constexpr std::ptrdiff_t kReach = 15;
  const Grid<float>&before = off->field.z_m, &after = removed->field.z_m;
  std::size_t gone = 0, changed = 0;
  for (std::ptrdiff_t r = 0; r < before.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < before.cols(); ++c) {
      EXPECT_EQ(before(r, c), shown->field.z_m(r, c));
      if ((removed->artefacts(r, c) & kTakenAway) != 0) {
        ++gone;
        EXPECT_EQ(removed->source(r, c), 255) << "made up";
        EXPECT_GE(removed->sigma_m(r, c), off->sigma_m(r, c));
      }
      if (std::abs(after(r, c) - before(r, c)) < 1e-3F) continue;
      ++changed;
      bool near = false;
      for (std::ptrdiff_t i = r - kReach; i <= r + kReach; ++i)
        for (std::ptrdiff_t j = c - kReach; j <= c + kReach; ++j)
          near = near || (before.contains(i, j) && (removed->artefacts(i, j) & kTakenAway) != 0);
      EXPECT_TRUE(near) << r << ' ' << c;
    }
  RecordProperty("spikes", std::to_string(removed->sources[0].artefacts.spikes));
  RecordProperty("nodes_taken", std::to_string(gone));
  RecordProperty("nodes_changed", std::to_string(changed));
  EXPECT_GT(gone, 0U);
}

TEST_F(RealData, GaleCleaned) {
  const auto hirise = data_folder() / "mars/gale_hirise_1m.tif";
  const auto with = [&](Clean clean) {
    FuseRequest request =
        site("mars", -4.66681, 137.37025, 150, 1.0, {{"hirise", hirise, "auto", 0.2}});
    request.sources[0].clean = clean;
    return fuse(request);
  };
  const auto shown = with(Clean::detect), removed = with(Clean::remove);
  ASSERT_THAT(shown, Succeeds());
  ASSERT_THAT(removed, Succeeds());
  // Its steps are between the parts of a mosaic and change along them: none is separable.
  EXPECT_FALSE(shown->sources[0].artefacts.seams.empty());
  for (const auto& seam : removed->sources[0].artefacts.seams) EXPECT_FALSE(seam.separable);
  double square = 0.0;
  for (std::size_t i = 0; i < shown->field.z_m.cells().size(); ++i)
    square += std::pow(static_cast<double>(removed->field.z_m.cells()[i]) -
                           static_cast<double>(shown->field.z_m.cells()[i]),
                       2.0);
  const double rms = std::sqrt(square / static_cast<double>(shown->field.z_m.cells().size()));
  RecordProperty("changed_rms_m", std::to_string(rms));
  EXPECT_LT(rms, 0.02 * 0.2) << "2 % of the noise: relief is not smoothed";
}

TEST_F(RealData, HiriseCubes) {
  const struct {
    const char* file;
    double lat, lon, half_width;
  } cubes[] = {
      {"Ares4_Marth_Crater_3557E_126N_ngate_03_lowres_sinusoidal.cub", 12.644, -4.256, 2000},
      {"DTM_Zumba_1m_forPDS_lowres.cub", -28.685, 226.931, 1000},
      {"Polar_Crater_1_1m_ngate_edited2_forPDS_lowres.cub", 83.477, -13.26, 800}};
  for (const auto& cube : cubes) {
    const Source source{"dtm", data_folder() / "mars/hirise_cubes" / cube.file};
    EXPECT_THAT(fuse(site("mars", cube.lat, cube.lon, cube.half_width, 100, {source})),
                FailsWith(kAllVoid))
        << cube.file;
    EXPECT_THAT(fuse(site("mars", cube.lat + 2.0, cube.lon, cube.half_width, 100, {source})),
                FailsWith(kNoOverlap))
        << cube.file;
    EXPECT_THAT(fuse(site("moon", cube.lat, cube.lon, cube.half_width, 100, {source})),
                FailsWith(kWrongBody))
        << cube.file;
  }
}

TEST_F(RealData, IsisCubeCutShort) {
  const ScratchFolder scratch;
  // 480 x 240 int16 after a label of 65536 bytes; what follows is history.
  const auto cube = *read_file(data_folder() / "moon/ldem_4_reduced.cub");
  ASSERT_THAT(write_file(scratch / "a.cub", cube.substr(0, 65536 + 230400)), Succeeds());
  EXPECT_THAT(fuse(site("moon", 60, 10, 1000, 100, {{"cube", scratch / "a.cub"}})), Succeeds());
  ASSERT_THAT(write_file(scratch / "a.cub", cube.substr(0, 65536 + 230399)), Succeeds());
  EXPECT_THAT(fuse(site("moon", 60, 10, 1000, 100, {{"cube", scratch / "a.cub"}})),
              FailsWith(kRasterNotReadable));
}

TEST_F(RealData, LdemCutShort) {
  const ScratchFolder scratch;
  std::filesystem::copy_file(data_folder() / "moon/LDEM_4.LBL", scratch / "LDEM_4.LBL");
  const auto image = *read_file(data_folder() / "moon/LDEM_4.IMG");
  ASSERT_THAT(write_file(scratch / "LDEM_4.IMG", image.substr(0, 1000000)), Succeeds());
  // The pixels around the site are in what is left: it is refused all the same.
  const auto fused = fuse(site("moon", 60, 10, 1000, 100, {{"ldem", scratch / "LDEM_4.LBL"}}));
  ASSERT_THAT(fused, FailsWith(kRasterNotReadable));
  EXPECT_THAT(fused.error().message,
              ::testing::AllOf(::testing::HasSubstr("1000000"), ::testing::HasSubstr("2073600")));
}

}  // namespace
}  // namespace maquette::heightmap

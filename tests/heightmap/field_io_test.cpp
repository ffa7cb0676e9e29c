// SPDX-License-Identifier: GPL-3.0-or-later

// Claims of heightmap/field_io.hpp and how each is attacked
//   what is written is read back bit for bit, voids too   odd spacings and origins, random heights
//   same field, same bytes                                written twice, files compared
//   the frame is millimetres, corners half a pixel out    looked at with GDAL itself
//   AREA and POINT files place nodes alike                both written by GDAL
//   a cropped file keeps its new place                    cropped by gdal_translate, which copies
//   old metadata each refusal                                          one bad file for each GDAL
//   stays silent                                     stderr captured over a broken file

#include "heightmap/field_io.hpp"

#include <bit>
#include <cmath>
#include <cstdint>
#include <fstream>
#include <string>

#include <gdal_utils.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/files.hpp"
#include "core/random.hpp"
#include "support/matchers.hpp"
#include "support/planet_raster.hpp"

namespace maquette::heightmap {
namespace {

using testing_support::FailsWith;
using testing_support::PlanetRaster;
using testing_support::ScratchFolder;
using testing_support::Succeeds;
using testing_support::write_planet_raster;

ModelField random_field(std::ptrdiff_t rows, std::ptrdiff_t cols, std::uint64_t seed) {
  ModelField f{Grid<float>(rows, cols), Millimetres{0.1 + random_uniform(seed, 1)},
               Millimetres{-7.0 + random_uniform(seed, 2)}, Millimetres{random_uniform(seed, 3)}};
  for (std::size_t i = 0; i < f.z_mm.cells().size(); ++i)
    f.z_mm.cells()[i] = random_uniform(seed, 100 + i) < 0.1
                            ? NAN
                            : static_cast<float>(50.0 * random_normal(seed, 7000 + i));
  return f;
}

bool same_bits(const Grid<float>& a, const Grid<float>& b) {
  return a.rows() == b.rows() && a.cols() == b.cols() &&
         std::equal(a.cells().begin(), a.cells().end(), b.cells().begin(), [](float x, float y) {
           return std::bit_cast<std::uint32_t>(x) == std::bit_cast<std::uint32_t>(y);
         });
}

class RoundTrip : public ::testing::TestWithParam<std::uint64_t> {};
INSTANTIATE_TEST_SUITE_P(Seeds, RoundTrip, ::testing::Values(1, 2, 3, 4, 5));

TEST_P(RoundTrip, KeepsEveryBit) {
  const ScratchFolder scratch;
  const ModelField field =
      random_field(2 + static_cast<std::ptrdiff_t>(GetParam()) * 7, 31, GetParam());
  ASSERT_THAT(write_model_field(field, scratch / "a.tif"), Succeeds());
  const auto back = read_model_field(scratch / "a.tif");
  ASSERT_THAT(back, Succeeds());
  EXPECT_TRUE(same_bits(field.z_mm, back->z_mm));
  EXPECT_EQ(field.x0, back->x0);
  EXPECT_EQ(field.y0, back->y0);
  EXPECT_EQ(field.spacing, back->spacing);
}

TEST(WriteModelField, SameFieldSameBytesAndNothingBeside) {
  const ScratchFolder scratch;
  const ModelField field = random_field(40, 50, 9);
  ASSERT_THAT(write_model_field(field, scratch / "a.tif"), Succeeds());
  ASSERT_THAT(write_model_field(field, scratch / "b.tif"), Succeeds());
  EXPECT_EQ(*read_file(scratch / "a.tif"), *read_file(scratch / "b.tif"));
  std::ptrdiff_t files = 0;
  for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(scratch.path()))
    ++files;
  EXPECT_EQ(files, 2) << "no .aux.xml, no partial file";
}

// Corners of fields whose coordinates binary numbers do not hold.
TEST(HeightAt, IsExactAtTheLastNodes) {
  for (const double spacing : {0.3, 0.55, 0.6, 0.7})
    for (int i = 0; i < 100; ++i) {
      ModelField field = random_field(37, 83, 4);
      field.spacing = Millimetres{spacing};
      field.x0 = Millimetres{0.1 * i - 5.0};
      field.y0 = Millimetres{0.1 * i - 7.3};
      field.z_mm(35, 81) = field.z_mm(35, 82) = field.z_mm(36, 81) = 0.5F;
      field.z_mm(36, 82) = 1.25F;
      // A share of a cell of 1e-14.
      EXPECT_NEAR(height_at(field, field.x_mm(82), field.y_mm(36)), 1.25, 1e-12)
          << spacing << " from " << field.x0.value();
      EXPECT_TRUE(std::isnan(height_at(field, field.x_mm(82) + 1e-9, field.y_mm(36))));
    }
}

TEST(HeightsAt, AreThoseOfTheWholeField) {
  const ScratchFolder scratch;
  const ModelField field = random_field(37, 23, 4);
  ASSERT_THAT(write_model_field(field, scratch / "a.tif"), Succeeds());
  const double wide = field.x_mm(22) - field.x_mm(0), high = field.y_mm(36) - field.y_mm(0);
  std::vector<Vec3> places;
  for (std::uint64_t i = 0; i < 3000; ++i)
    places.push_back({field.x_mm(0) + wide * (1.2 * random_uniform(8, 2 * i) - 0.1),
                      field.y_mm(0) + high * (1.2 * random_uniform(8, 2 * i + 1) - 0.1), 0.0});
  for (const std::ptrdiff_t r : {0, 1, 36}) places.push_back({field.x_mm(5), field.y_mm(r), 0.0});
  const auto found = heights_at(scratch / "a.tif", places);
  ASSERT_THAT(found, Succeeds());
  int voids = 0;
  for (std::size_t i = 0; i < places.size(); ++i) {
    const double expected = height_at(field, places[i].x, places[i].y);
    voids += std::isnan(expected);
    if (std::isnan(expected))
      EXPECT_TRUE(std::isnan((*found)[i])) << i;
    else
      // The rows' place is rounded differently: a share of a cell of 1e-14.
      EXPECT_NEAR((*found)[i], expected, 1e-9) << i;
  }
  EXPECT_GT(voids, 500);
  EXPECT_LT(voids, 2500);
}

TEST(ModelFieldWriter, RowsNorthToSouthAreTheWholeField) {
  const ScratchFolder scratch;
  const ModelField field = random_field(40, 50, 9);
  ASSERT_THAT(write_model_field(field, scratch / "whole.tif"), Succeeds());
  {
    auto writer =
        ModelFieldWriter::create(scratch / "rows.tif", {40, 50, field.spacing, field.x0, field.y0});
    ASSERT_THAT(writer, Succeeds());
    for (std::ptrdiff_t r = 39; r >= 0; --r)
      ASSERT_THAT(writer->write_row(field.z_mm.row(r)), Succeeds());
    EXPECT_FALSE(std::filesystem::exists(scratch / "rows.tif")) << "not before commit";
    ASSERT_THAT(writer->commit(), Succeeds());
  }
  EXPECT_EQ(*read_file(scratch / "whole.tif"), *read_file(scratch / "rows.tif"));
  {
    auto writer =
        ModelFieldWriter::create(scratch / "half.tif", {40, 50, field.spacing, field.x0, field.y0});
    ASSERT_THAT(writer, Succeeds());
    ASSERT_THAT(writer->write_row(field.z_mm.row(39)), Succeeds());
  }
  std::ptrdiff_t files = 0;
  for ([[maybe_unused]] const auto& entry : std::filesystem::directory_iterator(scratch.path()))
    ++files;
  EXPECT_EQ(files, 2) << "nothing is left of a field that was not finished";
  EXPECT_THAT(ModelFieldWriter::create(scratch / "large.tif",
                                       {2000000, 2000000, field.spacing, field.x0, field.y0}),
              FailsWith(kDiskFull));
}

TEST(WriteModelField, FailsWithoutFolder) {
  const ScratchFolder scratch;
  EXPECT_THAT(write_model_field(random_field(4, 4, 1), scratch / "missing/a.tif"),
              FailsWith(kFileNotWritable));
}

TEST(WriteModelField, OtherProgramsSeeMillimetresAndCorners) {
  const ScratchFolder scratch;
  ModelField field{Grid<float>(3, 4, 1.0F), Millimetres{0.5}, Millimetres{0.0}, Millimetres{0.0}};
  field.z_mm(0, 0) = 5.0F;  // south-west
  ASSERT_THAT(write_model_field(field, scratch / "a.tif"), Succeeds());
  GDALAllRegister();
  GDALDataset* dataset = GDALDataset::Open((scratch / "a.tif").c_str());
  ASSERT_NE(dataset, nullptr);
  double gt[6];
  dataset->GetGeoTransform(gt);
  EXPECT_THAT(gt, ::testing::ElementsAre(-0.25, 0.5, 0.0, 1.25, 0.0, -0.5));
  EXPECT_STREQ(dataset->GetRasterBand(1)->GetUnitType(), "mm");
  EXPECT_STREQ(dataset->GetMetadataItem("AREA_OR_POINT"), "Point");
  EXPECT_TRUE(std::isnan(dataset->GetRasterBand(1)->GetNoDataValue()));
  ASSERT_NE(dataset->GetSpatialRef(), nullptr);
  EXPECT_TRUE(dataset->GetSpatialRef()->IsLocal());
  EXPECT_NEAR(dataset->GetSpatialRef()->GetLinearUnits(), 0.001, 1e-12);
  float corner = 0.0F;
  EXPECT_EQ(dataset->GetRasterBand(1)->RasterIO(GF_Read, 0, 2, 1, 1, &corner, 1, 1, GDT_Float32, 0,
                                                0, nullptr),
            CE_None);
  EXPECT_EQ(corner, 5.0F);
  GDALClose(dataset);
}

/// A model raster as another program might write it.
PlanetRaster foreign() {
  PlanetRaster r;
  r.projection = "LOCAL_CS[\"anything\",UNIT[\"millimetre\",0.001]]";
  r.west = -0.25;
  r.north = 9.75;
  r.pixel = 0.5;
  r.cols = r.rows = 20;
  r.unit = "mm";
  r.height = [](double x, double y) { return 10.0 * x + y; };
  return r;
}

class Convention : public ::testing::TestWithParam<bool> {};
INSTANTIATE_TEST_SUITE_P(AreaAndPoint, Convention, ::testing::Bool());

TEST_P(Convention, NodesStandAtPixelCentres) {
  const ScratchFolder scratch;
  PlanetRaster r = foreign();
  r.point = GetParam();
  write_planet_raster(r, scratch / "a.tif");
  const auto field = read_model_field(scratch / "a.tif");
  ASSERT_THAT(field, Succeeds());
  EXPECT_NEAR(field->x0.value(), 0.0, 1e-12);
  EXPECT_NEAR(field->y0.value(), 0.0, 1e-12);
  EXPECT_FLOAT_EQ(field->z_mm(3, 7), 10.0F * 3.5F + 1.5F);
}

TEST(ReadModelField, ForeignNodataScaleAndTypes) {
  const ScratchFolder scratch;
  PlanetRaster r = foreign();
  r.projection.clear();
  r.unit.clear();
  r.type = GDT_Int16;
  r.scale = 0.5;
  r.offset = 2.0;
  r.has_nodata = true;
  r.nodata = -9999;
  r.height = [](double x, double) { return x < 1.0 ? 0.5 * -9999 + 2.0 : std::round(x); };
  write_planet_raster(r, scratch / "a.tif");
  const auto field = read_model_field(scratch / "a.tif");
  ASSERT_THAT(field, Succeeds());
  EXPECT_TRUE(std::isnan(field->z_mm(0, 1)));
  EXPECT_EQ(field->z_mm(0, 8), 4.0F);
}

TEST(ReadModelField, CroppedFileKeepsItsNewPlace) {
  const ScratchFolder scratch;
  const ModelField field = random_field(20, 20, 3);
  ASSERT_THAT(write_model_field(field, scratch / "a.tif"), Succeeds());
  GDALDataset* whole = GDALDataset::Open((scratch / "a.tif").c_str());
  ASSERT_NE(whole, nullptr);
  char* arguments[] = {const_cast<char*>("-srcwin"), const_cast<char*>("6"),
                       const_cast<char*>("0"),       const_cast<char*>("10"),
                       const_cast<char*>("10"),      nullptr};
  GDALTranslateOptions* options = GDALTranslateOptionsNew(arguments, nullptr);
  GDALClose(GDALTranslate((scratch / "b.tif").c_str(), whole, options, nullptr));
  GDALTranslateOptionsFree(options);
  GDALClose(whole);
  const auto part = read_model_field(scratch / "b.tif");
  ASSERT_THAT(part, Succeeds());
  const double s = field.spacing.value();
  EXPECT_NEAR(part->x0.value(), field.x0.value() + 6.0 * s, 1e-9);
  EXPECT_NEAR(part->y0.value(), field.y0.value() + 10.0 * s, 1e-9);
}

TEST(ReadModelField, RefusesMissingAndBroken) {
  const ScratchFolder scratch;
  EXPECT_THAT(read_model_field(scratch / "no.tif"), FailsWith(kFileNotFound));
  ASSERT_THAT(write_file(scratch / "text.tif", "not a raster"), Succeeds());
  EXPECT_THAT(read_model_field(scratch / "text.tif"), FailsWith(kRasterNotReadable));
  ASSERT_THAT(write_model_field(random_field(100, 100, 1), scratch / "a.tif"), Succeeds());
  const std::string whole = *read_file(scratch / "a.tif");
  for (const double share : {0.01, 0.3, 0.9, 0.999}) {
    const auto bytes = static_cast<std::size_t>(share * static_cast<double>(whole.size()));
    ASSERT_THAT(write_file(scratch / "cut.tif", whole.substr(0, bytes)), Succeeds());
    EXPECT_THAT(read_model_field(scratch / "cut.tif"), FailsWith(kRasterNotReadable)) << share;
  }
}

TEST(ReadModelField, GdalPrintsNothing) {
  const ScratchFolder scratch;
  ASSERT_THAT(write_file(scratch / "text.tif", "II*\0broken beyond repair"), Succeeds());
  ::testing::internal::CaptureStderr();
  ::testing::internal::CaptureStdout();
  EXPECT_FALSE(read_model_field(scratch / "text.tif").has_value());
  EXPECT_EQ(::testing::internal::GetCapturedStdout(), "");
  EXPECT_EQ(::testing::internal::GetCapturedStderr(), "");
}

TEST(ReadModelField, RefusesShapes) {
  const ScratchFolder scratch;
  PlanetRaster r = foreign();
  r.cols = 1;
  write_planet_raster(r, scratch / "thin.tif");
  EXPECT_THAT(read_model_field(scratch / "thin.tif"), FailsWith(kRasterShape));

  const auto with_transform = [&](std::array<double, 6> gt, int bands) {
    GDALDataset* d = GetGDALDriverManager()->GetDriverByName("GTiff")->Create(
        (scratch / "b.tif").c_str(), 5, 5, bands, GDT_Float32, nullptr);
    if (gt[1] != 0.0) d->SetGeoTransform(gt.data());
    GDALClose(d);
    return read_model_field(scratch / "b.tif");
  };
  EXPECT_THAT(with_transform({0, 1, 0, 5, 0, -1}, 1), Succeeds());
  EXPECT_THAT(with_transform({0, 1, 0, 5, 0, -1}, 2), FailsWith(kRasterShape)) << "two bands";
  EXPECT_THAT(with_transform({0, 1, 0, 5, 0, -2}, 1), FailsWith(kRasterShape)) << "not square";
  EXPECT_THAT(with_transform({0, 1, 0.1, 5, 0, -1}, 1), FailsWith(kRasterShape)) << "rotated";
  EXPECT_THAT(with_transform({0, 1, 0, 5, 0, 1}, 1), FailsWith(kRasterShape)) << "south up";
  EXPECT_THAT(with_transform({0, 0, 0, 0, 0, 0}, 1), FailsWith(kRasterShape)) << "no place";
}

TEST(ReadModelField, RefusesPlanetRastersAndOtherUnits) {
  const ScratchFolder scratch;
  PlanetRaster r;
  write_planet_raster(r, scratch / "planet.tif");
  const auto planet = read_model_field(scratch / "planet.tif");
  ASSERT_THAT(planet, FailsWith(kRasterUnit));
  EXPECT_THAT(planet.error().message, ::testing::HasSubstr("maquette fuse"));
  r.projection = "+proj=longlat +R=1737400 +no_defs";
  r.pixel = 0.01;
  write_planet_raster(r, scratch / "degrees.tif");
  EXPECT_THAT(read_model_field(scratch / "degrees.tif"), FailsWith(kRasterUnit));
  r = foreign();
  r.unit = "m";
  write_planet_raster(r, scratch / "m.tif");
  EXPECT_THAT(read_model_field(scratch / "m.tif"), FailsWith(kRasterUnit));
}

TEST(ReadModelField, RefusesNothingButVoids) {
  const ScratchFolder scratch;
  PlanetRaster r = foreign();
  r.height = [](double, double) { return NAN; };
  write_planet_raster(r, scratch / "void.tif");
  EXPECT_THAT(read_model_field(scratch / "void.tif"), FailsWith(kAllVoid));
}

TEST(WriteModelGrid, KeepsFrameAndUnit) {
  const ScratchFolder scratch;
  const ModelField like = random_field(6, 5, 2);
  ASSERT_THAT(write_model_grid(Grid<float>(6, 5, 0.25F), like, "mm", scratch / "g.tif"),
              Succeeds());
  const auto back = read_model_field(scratch / "g.tif");
  ASSERT_THAT(back, Succeeds());
  EXPECT_EQ(back->x0, like.x0);
  ASSERT_THAT(write_model_grid(Grid<float>(6, 5, 1.0F), like, "1", scratch / "mask.tif"),
              Succeeds());
  EXPECT_THAT(read_model_field(scratch / "mask.tif"), FailsWith(kRasterUnit))
      << "a mask is not a height field";
}

}  // namespace
}  // namespace maquette::heightmap

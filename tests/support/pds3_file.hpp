// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

/// @file pds3_file.hpp
/// PDS3 images with their labels, byte by byte: what GDAL cannot write.

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <cstring>
#include <filesystem>
#include <functional>
#include <string>
#include <type_traits>

#include <fmt/format.h>
#include <gmock/gmock.h>
#include <gtest/gtest.h>

#include "core/files.hpp"
#include "support/matchers.hpp"
#include "support/planet_raster.hpp"

namespace maquette::testing_support {

/// How the raster is written; the projection lines follow from the place.
struct Pds3 {
  const char* sample_type = "LSB_INTEGER";
  int bits = 16;
  double scale = 0.01, offset = 1737400.0;  // of the stored numbers
  bool attached = false;
  double origin_of_first_pixel = 0.0;  // MEGDR: 1
  std::string map = "SIMPLE CYLINDRICAL";
  double centre_latitude = 0.0, centre_longitude = 0.0;
  double a_km = 1737.4, c_km = 1737.4;
  std::string map_scale{}, map_resolution{};  // empty: exact, not stated
  std::string more{};                         // lines of the projection
  std::string image_more{};                   // lines of the image
};

template <class T>
void append(std::string& bytes, double value, bool msb) {
  const T stored =
      std::is_integral_v<T> ? static_cast<T>(std::lround(value)) : static_cast<T>(value);
  char raw[sizeof(T)];
  std::memcpy(raw, &stored, sizeof(T));
  if (msb) std::reverse(raw, raw + sizeof(T));
  bytes.append(raw, sizeof(T));
}

/// @param stored  changes a stored number (row, column, number), or leaves it
inline void write_pds3(const Pds3& w, const PlanetRaster& raster,
                       const std::filesystem::path& folder,
                       const std::function<double(int, int, double)>& stored = nullptr) {
  const std::string type = w.sample_type;
  const bool msb = type.starts_with("MSB") || type == "IEEE_REAL";
  std::string image;
  for (int r = 0; r < raster.rows; ++r)
    for (int c = 0; c < raster.cols; ++c) {
      double v = (raster.height(raster.west + (c + 0.5) * raster.pixel,
                                raster.north - (r + 0.5) * raster.pixel) +
                  (w.offset > 1e6 ? w.a_km * 1000.0 : 0.0) - w.offset) /
                 w.scale;
      if (stored) v = stored(r, c, v);
      if (type.find("REAL") != std::string::npos)
        append<float>(image, v, msb);
      else if (w.bits == 16)
        append<std::int16_t>(image, v, msb);
      else
        append<std::int32_t>(image, v, msb);
    }
  const int record = raster.cols * w.bits / 8;
  std::string label = fmt::format(
      "PDS_VERSION_ID = PDS3\r\nRECORD_TYPE = FIXED_LENGTH\r\nRECORD_BYTES = {}\r\n"
      "^IMAGE = {}\r\nOBJECT = IMAGE\r\n LINES = {}\r\n LINE_SAMPLES = {}\r\n SAMPLE_TYPE = {}\r\n"
      " SAMPLE_BITS = {}\r\n UNIT = METER\r\n SCALING_FACTOR = {}\r\n OFFSET = {:.1f}\r\n{}"
      "END_OBJECT = IMAGE\r\nOBJECT = IMAGE_MAP_PROJECTION\r\n MAP_PROJECTION_TYPE = \"{}\"\r\n"
      " A_AXIS_RADIUS = {:.6f} <KM>\r\n B_AXIS_RADIUS = {:.6f} <KM>\r\n"
      " C_AXIS_RADIUS = {:.6f} <KM>\r\n CENTER_LATITUDE = {}\r\n CENTER_LONGITUDE = {}\r\n"
      " MAP_SCALE = {}\r\n{} LINE_PROJECTION_OFFSET = {:.9f}\r\n"
      " SAMPLE_PROJECTION_OFFSET = {:.9f}\r\n{}END_OBJECT = IMAGE_MAP_PROJECTION\r\nEND\r\n",
      record, w.attached ? fmt::format("{} <BYTES>", 4001) : "\"A.IMG\"", raster.rows, raster.cols,
      type, w.bits, w.scale, w.offset, w.image_more, w.map, w.a_km, w.a_km, w.c_km,
      w.centre_latitude, w.centre_longitude,
      w.map_scale.empty() ? fmt::format("{:.12g} <METERS/PIXEL>", raster.pixel) : w.map_scale,
      w.map_resolution.empty() ? "" : fmt::format(" MAP_RESOLUTION = {}\r\n", w.map_resolution),
      raster.north / raster.pixel - 0.5 + w.origin_of_first_pixel,
      -raster.west / raster.pixel - 0.5 + w.origin_of_first_pixel, w.more);
  if (w.attached) {
    ASSERT_LE(label.size(), 4000U);
    label.resize(4000, ' ');
    image = label + image;
  } else {
    ASSERT_THAT(write_file(folder / "A.LBL", label), Succeeds());
  }
  ASSERT_THAT(write_file(folder / "A.IMG", image), Succeeds());
}

}  // namespace maquette::testing_support

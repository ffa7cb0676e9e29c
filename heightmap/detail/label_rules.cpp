// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/label_rules.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cctype>
#include <charconv>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <string>

#include <fmt/format.h>
#include <gdal_priv.h>
#include <ogr_spatialref.h>

#include "heightmap/detail/raster_label.hpp"
#include "heightmap/field_io.hpp"
#include "heightmap/fuse.hpp"

namespace maquette::heightmap::detail {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;
constexpr double kNearlySame = 1e-3;   // scale and resolution, relative: rounding, not a mistake
constexpr double kEdge_pixels = 0.05;  // how well four edges must agree about the origin

bool says(const RasterLabel& label, std::string_view key, std::string_view word) {
  std::string value = label.find(key).value_or("");
  std::transform(value.begin(), value.end(), value.begin(),
                 [](unsigned char c) { return static_cast<char>(std::toupper(c)); });
  return value.find(word) != std::string::npos;
}

/// Digits that a number is written with, without zeros at either end.
int digits(const std::string& text) {
  std::string kept;
  for (const char c : text.substr(0, text.find_first_of("<eE ")))
    if (std::isdigit(static_cast<unsigned char>(c)) != 0) kept.push_back(c);
  const bool fraction = text.find('.') != std::string::npos;
  const auto first = kept.find_first_not_of('0');
  if (first == std::string::npos) return 0;
  const auto last = fraction ? kept.find_last_not_of('0') : kept.size() - 1;
  return static_cast<int>(last - first) + 1;
}

/// A number of a label, in decimals or as 16#FF7FFFFB# (then the bits of a pixel).
bool constant(const std::string& text, GDALDataType type, double& value) {
  const auto hash = text.find('#');
  if (hash == std::string::npos) {
    const char* first = text.data() + (text.starts_with('+') ? 1 : 0);
    return std::from_chars(first, text.data() + text.size(), value).ec == std::errc{};
  }
  std::uint64_t bits = 0;
  int base = 16;
  std::from_chars(text.data(), text.data() + hash, base);
  if (std::from_chars(text.data() + hash + 1, text.data() + text.size(), bits, base).ec !=
      std::errc{})
    return false;
  switch (type) {
    case GDT_Float32:
      value = std::bit_cast<float>(static_cast<std::uint32_t>(bits));
      break;
    case GDT_Float64:
      value = std::bit_cast<double>(bits);
      break;
    case GDT_Int16:
      value = static_cast<std::int16_t>(bits);
      break;
    case GDT_Int32:
      value = static_cast<std::int32_t>(bits);
      break;
    default:
      value = static_cast<double>(bits);
  }
  return true;
}

std::vector<double> special_pixels(const RasterLabel& label, GDALDataType type) {
  static constexpr std::array kKeys{"NULL",
                                    "MISSING",
                                    "MISSING_CONSTANT",
                                    "INVALID_CONSTANT",
                                    "INVALID",
                                    "CORE_NULL",
                                    "UNKNOWN_CONSTANT",
                                    "NOT_APPLICABLE_CONSTANT",
                                    "ERROR_CONSTANT",
                                    "LOW_REPR_SATURATION",
                                    "LOW_INSTR_SATURATION",
                                    "HIGH_REPR_SATURATION",
                                    "HIGH_INSTR_SATURATION",
                                    "CORE_LOW_REPR_SATURATION",
                                    "CORE_LOW_INSTR_SATURATION",
                                    "CORE_HIGH_REPR_SATURATION",
                                    "CORE_HIGH_INSTR_SATURATION",
                                    "SATURATED_CONSTANT",
                                    "HIGH_INSTRUMENT_SATURATION",
                                    "HIGH_REPRESENTATION_SATURATION",
                                    "LOW_INSTRUMENT_SATURATION",
                                    "LOW_REPRESENTATION_SATURATION"};
  std::vector<double> out;
  for (const auto& [key, text] : label.statements) {
    const std::string_view last = std::string_view(key).substr(key.rfind('/') + 1);
    double value = 0.0;
    if (std::find(kKeys.begin(), kKeys.end(), last) != kKeys.end() && constant(text, type, value))
      out.push_back(value);
  }
  return out;
}

bool is_equirectangular(const OGRSpatialReference& srs) {
  const char* p = srs.GetAttrValue("PROJECTION");
  return srs.IsGeographic() != 0 || (p != nullptr && EQUAL(p, SRS_PT_EQUIRECTANGULAR));
}

/// The exact one of scale and resolution (pixels a degree): what pixels must be multiplied by.
double scale_correction(const RasterLabel& label, double radius_m, double pixel_m) {
  const auto scale = label.find("MAP_SCALE"), resolution = label.find("MAP_RESOLUTION");
  const auto per_degree = label.number("MAP_RESOLUTION");
  if (!scale || !resolution || !per_degree || !(*per_degree > 0.0)) return 1.0;
  const double by_resolution = radius_m * kDegree / *per_degree / std::abs(pixel_m);
  if (!(std::abs(by_resolution - 1.0) < kNearlySame) || digits(*resolution) >= digits(*scale))
    return 1.0;
  return by_resolution;
}

/// Pixels by which a map's columns and rows are off the edges that its label states.
std::array<double, 2> edge_shift(const RasterLabel& label, const GDALDataset& dataset,
                                 const double* g, double radius_m) {
  auto* data = const_cast<GDALDataset*>(&dataset);
  const auto top = label.number("MAXIMUM_LATITUDE"), bottom = label.number("MINIMUM_LATITUDE"),
             west = label.number("WESTERNMOST_LONGITUDE"),
             east = label.number("EASTERNMOST_LONGITUDE");
  const OGRSpatialReference& srs = *dataset.GetSpatialRef();
  if (!top || !bottom || !west || !east || srs.GetNormProjParm(SRS_PP_STANDARD_PARALLEL_1) != 0.0)
    return {0.0, 0.0};
  const double metre = radius_m * kDegree, lon0 = srs.GetNormProjParm(SRS_PP_CENTRAL_MERIDIAN);
  const auto to_col = [&](double lon, double wanted) {
    const double col = ((lon - lon0) * metre - g[0]) / g[1], turn = 360.0 * metre / g[1];
    return col - turn * std::round((col - wanted) / turn) - wanted;
  };
  const double left = to_col(*west, 0.0), right = to_col(*east, data->GetRasterXSize());
  const double up = (*top * metre - g[3]) / g[5];
  const double down = (*bottom * metre - g[3]) / g[5] - data->GetRasterYSize();
  // Whole or half pixels, and both edges say the same: else the edges are no pixel borders.
  const auto agreed = [](double a, double b) {
    const double s = 0.5 * std::round(2.0 * a);
    return std::abs(a - s) < kEdge_pixels && std::abs(b - s) < kEdge_pixels && std::abs(s) <= 1.0
               ? s
               : NAN;
  };
  const double u = agreed(left, right), v = agreed(up, down);
  if (std::isnan(u) || std::isnan(v)) return {0.0, 0.0};
  return {u, v};
}

Error no_projection(const std::filesystem::path& path, std::string why) {
  return {kNoProjection,
          fmt::format("{}: {}; project the product anew (GeoTIFF)", path.string(), std::move(why))};
}

}  // namespace

Result<LabelRules> label_rules(const std::filesystem::path& path, const GDALDataset& dataset,
                               double (&g)[6]) {
  LabelRules rules;
  const auto label = read_raster_label(path);
  if (!label) return rules;
  auto* data = const_cast<GDALDataset*>(&dataset);
  rules.special = special_pixels(*label, data->GetRasterBand(1)->GetRasterDataType());
  const OGRSpatialReference& srs = *dataset.GetSpatialRef();
  const bool pds3 = label->kind == RasterLabel::Kind::pds3;

  if (pds3 && label->number("IMAGE/SAMPLE_BITS") == 32.0 &&
      says(*label, "IMAGE/SAMPLE_TYPE", "INTEGER") &&
      data->GetRasterBand(1)->GetRasterDataType() == GDT_Float32)
    return fail(
        kRasterNotReadable,
        fmt::format("{}: pixels are integers of 32 bits, which GDAL takes for real numbers; "
                    "convert the product (GeoTIFF, 16 bits or float)",
                    path.string()));

  if (const double turn = label->number("MAP_PROJECTION_ROTATION").value_or(0.0); turn != 0.0)
    return tl::unexpected(no_projection(
        path, fmt::format("its map is turned by {:g} degrees (MAP_PROJECTION_ROTATION)", turn)));

  const double lon0 = srs.GetNormProjParm(SRS_PP_CENTRAL_MERIDIAN);
  if ((pds3 && says(*label, "POSITIVE_LONGITUDE_DIRECTION", "WEST")) ||
      says(*label, "MAPPING/LONGITUDEDIRECTION", "WEST"))
    rules.longitude_shift_deg = 2.0 * lon0;

  const bool graphic = (pds3 && says(*label, "COORDINATE_SYSTEM_NAME", "PLANETOGRAPHIC")) ||
                       says(*label, "MAPPING/LATITUDETYPE", "PLANETOGRAPHIC") ||
                       says(*label, "LATITUDE_TYPE", "PLANETOGRAPHIC");
  if (graphic && srs.GetSemiMinor() == srs.GetSemiMajor()) {
    const auto axis = [&](std::initializer_list<const char*> keys) {
      for (const char* key : keys)
        if (const auto value = label->number(key)) return *value;
      return 0.0;
    };
    const double a = axis({"A_AXIS_RADIUS", "EQUATORIALRADIUS"});
    const double c = axis({"C_AXIS_RADIUS", "POLARRADIUS"});
    if (a > 0.0 && c > 0.0 && a != c) {
      const char* p = srs.GetAttrValue("PROJECTION");
      if (!is_equirectangular(srs) && !(p != nullptr && EQUAL(p, SRS_PT_SINUSOIDAL)))
        return tl::unexpected(no_projection(
            path, "its latitudes are planetographic in a projection that is read as a sphere's"));
      rules.latitude_factor = (c / a) * (c / a);
    }
  }

  if (pds3 && srs.IsProjected() != 0) {
    const double radius_m = srs.GetSemiMajor();
    const double factor = scale_correction(*label, radius_m, g[1]);
    for (double& x : g) x *= factor;
    if (is_equirectangular(srs)) {
      const auto [u, v] = edge_shift(*label, dataset, g, radius_m);
      g[0] += u * g[1];
      g[3] += v * g[5];
    }
  }
  return rules;
}

}  // namespace maquette::heightmap::detail

// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/dem_reader.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <cstring>
#include <limits>
#include <mutex>
#include <numbers>
#include <optional>
#include <string_view>
#include <vector>

#include <fmt/format.h>
#include <ogr_spatialref.h>

#include "heightmap/detail/gdal_support.hpp"
#include "heightmap/detail/label_rules.hpp"
#include "heightmap/detail/raster_label.hpp"
#include "heightmap/field_io.hpp"

namespace maquette::heightmap {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;
constexpr const char* kBrightness = "brightness";  // unit of images; no site file can ask for it

struct TransformDeleter {
  void operator()(OGRCoordinateTransformation* t) const {
    OGRCoordinateTransformation::DestroyCT(t);
  }
};
using TransformPtr = std::unique_ptr<OGRCoordinateTransformation, TransformDeleter>;

struct HeightRule {
  double scale = 1.0, offset = 0.0;  // metres = scale * raw + offset
  bool has_nodata = false;
  double nodata = 0.0;
  bool single_precision = false;
  double lowest_special = -INFINITY;  // raw values up to here are special pixels
  double highest_special = INFINITY;  // raw values from here on too
  std::vector<double> special;        // more raw values that are none
  double reference_radius_m = 0.0;
  bool brightness = false;

  [[nodiscard]] bool is_void(double raw) const {
    if (!(std::abs(raw) < 1e30)) return true;  // NaN, infinities, ISIS real special pixels
    if (raw <= lowest_special || raw >= highest_special) return true;
    for (const double value : special)
      if (raw == value) return true;
    if (!has_nodata) return false;
    return single_precision ? static_cast<float>(raw) == static_cast<float>(nodata) : raw == nodata;
  }
};

/// Lowest and highest that the body's surface can be, with a margin for datums that differ.
std::pair<double, double> relief_limits_m(const Body& body) {
  if (body.name == "moon") return {-11000.0, 13000.0};
  if (body.name == "mars") return {-10500.0, 24000.0};
  return {-0.01 * body.equatorial_radius_m, 0.01 * body.equatorial_radius_m};
}

const char* body_with_radius(double radius_m) {
  struct Entry {
    const char* name;
    double radius_m;
  };
  static constexpr Entry bodies[] = {{"the moon", 1737.4e3}, {"mars", 3390e3},    {"earth", 6375e3},
                                     {"mercury", 2439.7e3},  {"venus", 6051.8e3}, {"ceres", 470e3},
                                     {"vesta", 265e3},       {"titan", 2575e3}};
  for (const Entry& b : bodies)
    if (std::abs(radius_m / b.radius_m - 1.0) < 0.02) return b.name;
  return "an unknown body";
}

std::optional<double> metres_per(std::string_view unit) {
  std::string lower(unit);
  std::transform(lower.begin(), lower.end(), lower.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  for (const char* m : {"m", "metre", "meter", "metres", "meters"})
    if (lower == m) return 1.0;
  for (const char* km : {"km", "kilometre", "kilometer", "kilometres", "kilometers"})
    if (lower == km) return 1000.0;
  return std::nullopt;
}

/// Metres per unit of the values after scale and offset.
Result<double> unit_of(const Source& source, GDALRasterBand& band, double offset,
                       const Body& body) {
  if (source.unit == kBrightness) return 1.0;
  const std::string file = source.path.string();
  std::string declared = band.GetUnitType();
  if (declared.empty())
    if (const auto label = detail::read_raster_label(detail::openable_path(source.path)))
      declared = label->find("IMAGE/UNIT").value_or(label->find("ELEMENT_ARRAY/UNIT").value_or(""));
  if (declared == "N/A" || declared == "NULL") declared.clear();
  const auto from_file = metres_per(declared);
  if (!declared.empty() && !from_file)
    return fail(kSourceUnit, fmt::format("{}: heights are in '{}'; metres or kilometres expected",
                                         file, declared));
  if (source.unit == "auto" || source.unit.empty()) {
    if (from_file) return *from_file;
    // Nothing declared: an offset that is the body's radius in kilometres settles it.
    return std::abs(1000.0 * offset / body.equatorial_radius_m - 1.0) < 0.02 ? 1000.0 : 1.0;
  }
  const auto asked =
      source.unit == "m" || source.unit == "km" ? metres_per(source.unit) : std::optional<double>{};
  if (!asked)
    return fail(kSourceUnit, fmt::format("source '{}': unit = \"{}\"; auto, m or km expected",
                                         source.name, source.unit));
  if (from_file && *from_file != *asked)
    return fail(kSourceUnit,
                fmt::format("{}: the file says its heights are in '{}', the site file says '{}'; "
                            "remove `unit` or correct it",
                            file, declared, source.unit));
  return *asked;
}

Result<HeightRule> height_rule(const Source& source, GDALDataset& dataset, const Body& body) {
  GDALRasterBand& band = *dataset.GetRasterBand(1);
  HeightRule rule;
  int has = 0;
  const double scale = band.GetScale(&has);
  const double raw_scale = has != 0 ? scale : 1.0;
  const double offset = band.GetOffset(&has);
  const double raw_offset = has != 0 ? offset : 0.0;
  MAQUETTE_TRY(const double unit, unit_of(source, band, raw_offset, body));
  rule.scale = raw_scale * unit;
  rule.offset = raw_offset * unit;
  rule.nodata = band.GetNoDataValue(&has);
  rule.has_nodata = has != 0 && !std::isnan(rule.nodata);
  const GDALDataType type = band.GetRasterDataType();
  rule.single_precision = type == GDT_Float32;
  const bool isis = std::string_view(dataset.GetDriverName()) == "ISIS3";
  // ISIS: NULL, LRS, LIS, HIS, HRS take the ends of the integer ranges.
  if (isis && type == GDT_Int16) rule.lowest_special = -32753.0;  // valid from -32752 on
  if (isis && type == GDT_UInt16) {
    rule.lowest_special = 2.0;
    rule.highest_special = 65523.0;
  }
  if (isis && type == GDT_Byte) {
    rule.lowest_special = 0.0;
    rule.highest_special = 255.0;
  }
  rule.reference_radius_m = body.equatorial_radius_m;
  rule.brightness = source.unit == kBrightness;
  return rule;
}

Result<void> check_body(const Source& source, const OGRSpatialReference& srs, const Body& body) {
  const double a = srs.GetSemiMajor();
  // HiRISE maps stand on spheres of local radius between polar and equatorial radius.
  if (a >= 0.995 * body.polar_radius_m && a <= 1.005 * body.equatorial_radius_m) return {};
  return fail(kWrongBody,
              fmt::format("{}: its ellipsoid has a radius of {:.1f} m, which is {}; the site is on "
                          "{} ({:.1f} m)",
                          source.path.string(), a, body_with_radius(a), body.name,
                          body.equatorial_radius_m));
}

double squared_axis_ratio(const OGRSpatialReference& srs) {
  const double ratio = srs.GetSemiMinor() / srs.GetSemiMajor();
  return ratio * ratio;
}

}  // namespace

struct DemReader::State {
  std::string name;
  Body body;
  detail::DatasetPtr dataset;
  HeightRule rule;
  double pixel_from_map[6] = {};
  double map_from_pixel[6] = {};
  bool geographic = false;
  double latitude_factor = 1.0;      // (b/a)^2 of the file's own ellipsoid
  double longitude_shift_deg = 0.0;  // of maps whose longitudes count westwards
  TransformPtr map_from_geo, geo_from_map;
  mutable std::mutex clone_lock;
  double period = 0.0;  // of map x, 0: not a cylindrical map
  double centre_x = 0.0;
  bool has_centre = false;
  bool wraps = false;
  long period_cols = 0;
  bool pole_above = false, pole_below = false;  // rows beyond the edge continue past the pole

  void to_map(OGRCoordinateTransformation* transform, std::span<const double> lat,
              std::span<const double> lon, std::span<double> x, std::span<double> y) const;
  void unwrap(std::span<double> x) const;
  void find_period();
  void find_poles();
};

void DemReader::State::to_map(OGRCoordinateTransformation* transform, std::span<const double> lat,
                              std::span<const double> lon, std::span<double> x,
                              std::span<double> y) const {
  for (std::size_t i = 0; i < lat.size(); ++i) {
    x[i] = lon[i] + longitude_shift_deg;
    const double phi = lat[i] * kDegree;
    y[i] = latitude_factor == 1.0
               ? lat[i]
               : std::atan2(std::sin(phi), latitude_factor * std::cos(phi)) / kDegree;
  }
  if (transform == nullptr) return;
  std::vector<int> good(lat.size(), 0);
  transform->Transform(static_cast<int>(lat.size()), x.data(), y.data(), nullptr, good.data());
  for (std::size_t i = 0; i < lat.size(); ++i)
    if (good[i] == 0 || !std::isfinite(x[i]) || !std::isfinite(y[i])) x[i] = y[i] = NAN;
}

void DemReader::State::unwrap(std::span<double> x) const {
  if (period <= 0.0 || !has_centre) return;
  for (double& value : x) value -= period * std::round((value - centre_x) / period);
}

void DemReader::State::find_period() {
  if (geographic) {
    period = 360.0;
  } else {
    const OGRSpatialReference& srs = *dataset->GetSpatialRef();
    const char* projection = srs.GetAttrValue("PROJECTION");
    bool cylindrical = false;
    for (const char* p : {SRS_PT_EQUIRECTANGULAR, SRS_PT_MERCATOR_1SP, SRS_PT_MERCATOR_2SP,
                          SRS_PT_CYLINDRICAL_EQUAL_AREA, SRS_PT_MILLER_CYLINDRICAL, "Plate_Carree"})
      cylindrical = cylindrical || (projection != nullptr && EQUAL(projection, p));
    if (!cylindrical) return;
    const double lon0 = srs.GetNormProjParm(SRS_PP_CENTRAL_MERIDIAN, 0.0);
    const double east = lon0 - longitude_shift_deg;
    const double lat[2] = {0.0, 0.0}, lon[2] = {east, east + 90.0};
    double x[2], y[2];
    to_map(map_from_geo.get(), lat, lon, x, y);
    period = 4.0 * std::abs(x[1] - x[0]);
    if (!std::isfinite(period)) period = 0.0;
  }
  const double step = std::abs(map_from_pixel[1]);
  if (period <= 0.0 || map_from_pixel[2] != 0.0 || map_from_pixel[4] != 0.0) return;
  period_cols = std::lround(period / step);
  wraps = period_cols <= dataset->GetRasterXSize() && period_cols >= 4 &&
          std::abs(period / step - static_cast<double>(period_cols)) < 0.05;
}

void DemReader::State::find_poles() {
  if (!wraps || period_cols % 2 != 0) return;
  const double lat[2] = {90.0, -90.0}, lon[2] = {0.0, 0.0};
  double x[2], y[2];
  to_map(map_from_geo.get(), lat, lon, x, y);
  for (const double pole_y : y) {
    if (!std::isfinite(pole_y)) continue;
    const double v = pixel_from_map[3] + pixel_from_map[5] * pole_y;
    pole_above = pole_above || std::abs(v) < 0.05;
    pole_below = pole_below || std::abs(v - dataset->GetRasterYSize()) < 0.05;
  }
}

Result<DemReader> DemReader::open(const Source& source, const Body& body) {
  auto state = std::make_unique<State>();
  state->name = source.path.string();
  state->body = body;
  MAQUETTE_TRY(state->dataset, detail::open_raster(source.path));
  const detail::ErrorCapture capture;
  GDALDataset& dataset = *state->dataset;
  const OGRSpatialReference* srs = dataset.GetSpatialRef();
  const bool mapped = srs != nullptr && (srs->IsProjected() || srs->IsGeographic());
  if (!mapped || dataset.GetGeoTransform(state->map_from_pixel) != CE_None)
    return fail(kNoProjection,
                fmt::format("{}: has no map projection{}", state->name,
                            srs != nullptr && srs->IsLocal()
                                ? " but a local frame, like a model field; `fuse` takes planet "
                                  "rasters"
                                : ", so nobody knows where on the body it lies; take the product "
                                  "with its label or add a VRT that states the projection"));
  MAQUETTE_TRY(auto rules, detail::label_rules(detail::openable_path(source.path), dataset,
                                               state->map_from_pixel));
  if (!GDALInvGeoTransform(state->map_from_pixel, state->pixel_from_map))
    return fail(kNoProjection, fmt::format("{}: its geotransform is singular", state->name));
  MAQUETTE_TRY_VOID(check_body(source, *srs, body));
  MAQUETTE_TRY(state->rule, height_rule(source, dataset, body));
  state->rule.special = std::move(rules.special);
  if (state->rule.single_precision)
    for (double& value : state->rule.special) value = static_cast<float>(value);
  state->latitude_factor = squared_axis_ratio(*srs) * rules.latitude_factor;
  state->longitude_shift_deg = rules.longitude_shift_deg;
  state->geographic = srs->IsGeographic() != 0;
  if (!state->geographic) {
    // From the file's own geographic frame: no datum shift can creep in.
    const std::unique_ptr<OGRSpatialReference> geo(srs->CloneGeogCS());
    geo->SetAxisMappingStrategy(OAMS_TRADITIONAL_GIS_ORDER);
    state->map_from_geo.reset(OGRCreateCoordinateTransformation(geo.get(), srs));
    state->geo_from_map.reset(OGRCreateCoordinateTransformation(srs, geo.get()));
    if (!state->map_from_geo || !state->geo_from_map)
      return fail(kNoProjection, fmt::format("{}: its map projection is not understood: {}",
                                             state->name, capture.text()));
  }
  state->find_period();
  state->find_poles();
  return DemReader(std::move(state));
}

Result<DemReader> DemReader::open_image(const std::filesystem::path& path, const std::string& name,
                                        const Body& body) {
  Source source{name, path};
  source.unit = kBrightness;
  return open(source, body);
}

DemReader::DemReader(std::unique_ptr<State> state) : state_(std::move(state)) {}
DemReader::DemReader(DemReader&&) noexcept = default;
DemReader::~DemReader() = default;

long DemReader::cols() const {
  return state_->dataset->GetRasterXSize();
}
long DemReader::rows() const {
  return state_->dataset->GetRasterYSize();
}
bool DemReader::wraps() const {
  return state_->wraps;
}
const std::string& DemReader::name() const {
  return state_->name;
}

void DemReader::centre_on(double latitude_deg, double longitude_deg) {
  State& s = *state_;
  if (s.period <= 0.0) return;
  const detail::ErrorCapture capture;
  double x = 0.0, y = 0.0;
  s.to_map(s.map_from_geo.get(), {&latitude_deg, 1}, {&longitude_deg, 1}, {&x, 1}, {&y, 1});
  const double* g = s.map_from_pixel;
  const double raster_centre =
      g[0] + 0.5 * (g[1] * static_cast<double>(cols()) + g[2] * static_cast<double>(rows()));
  s.centre_x = x - s.period * std::round((x - raster_centre) / s.period);
  s.has_centre = std::isfinite(s.centre_x);
}

void DemReader::to_pixels(std::span<const double> lat, std::span<const double> lon,
                          std::span<double> u, std::span<double> v) const {
  const State& s = *state_;
  const detail::ErrorCapture capture;
  TransformPtr mine;  // a transformation serves one thread at a time
  if (s.map_from_geo) {
    const std::lock_guard lock(s.clone_lock);
    mine.reset(s.map_from_geo->Clone());
  }
  s.to_map(mine.get(), lat, lon, u, v);
  s.unwrap(u);
  const double* p = s.pixel_from_map;
  for (std::size_t i = 0; i < u.size(); ++i) {
    const double x = u[i], y = v[i];
    u[i] = p[0] + p[1] * x + p[2] * y;
    v[i] = p[3] + p[4] * x + p[5] * y;
  }
}

GeoBox DemReader::extent() const {
  const State& s = *state_;
  const detail::ErrorCapture capture;
  GeoBox box{90.0, -90.0, INFINITY, -INFINITY};
  constexpr int kSteps = 8;
  for (int i = 0; i <= kSteps; ++i)
    for (int j = 0; j <= kSteps; ++j) {
      const double u = static_cast<double>(cols()) * i / kSteps;
      const double v = static_cast<double>(rows()) * j / kSteps;
      const double* g = s.map_from_pixel;
      double lon = g[0] + g[1] * u + g[2] * v;
      double lat = g[3] + g[4] * u + g[5] * v;
      if (s.geo_from_map && s.geo_from_map->Transform(1, &lon, &lat) == 0) continue;
      if (!std::isfinite(lon) || !std::isfinite(lat)) continue;
      lon -= s.longitude_shift_deg;
      const double phi = lat * kDegree;
      lat = std::atan2(s.latitude_factor * std::sin(phi), std::cos(phi)) / kDegree;
      box = {std::min(box.south, lat), std::max(box.north, lat), std::min(box.west, lon),
             std::max(box.east, lon)};
    }
  return box;
}

Result<PixelWindow> DemReader::read(const PixelRectangle& want, int step_u, int step_v,
                                    const RunContext& run) const {
  const State& s = *state_;
  const std::ptrdiff_t out_cols = (want.u_end - want.u_begin) / step_u;
  const std::ptrdiff_t out_rows = (want.v_end - want.v_begin) / step_v;
  MAQUETTE_CHECK(out_cols > 0 && out_rows > 0, "window of {} x {} cells", out_cols, out_rows);
  PixelWindow window{Grid<float>(out_rows, out_cols, NAN),
                     static_cast<double>(want.u_begin),
                     static_cast<double>(want.v_begin),
                     step_u,
                     step_v,
                     false};

  const long last_row = rows() - 1, last_col = cols() - 1, period = s.period_cols;
  // Where each wanted column is in the file.
  const auto column = [&](long u, long turned) {
    if (!s.wraps) return std::clamp(u, 0L, last_col);
    return ((u + turned) % period + period) % period;
  };
  // Only the span of columns that is needed; all of them when it wraps or turns at a pole.
  long first = 0, past = cols();
  if (!s.wraps ||
      (want.u_begin >= 0 && want.u_end <= period && want.v_begin >= 0 && want.v_end <= rows())) {
    first = column(want.u_begin, 0);
    past = column(want.u_end - 1, 0) + 1;
  }
  const int n = static_cast<int>(past - first);
  std::vector<double> line(static_cast<std::size_t>(n));
  std::vector<double> sum(static_cast<std::size_t>(out_cols));
  std::vector<int> count(static_cast<std::size_t>(out_cols));

  double low = INFINITY, high = -INFINITY;
  long radii = 0, heights = 0;
  bool out_of_relief = false;
  const auto [lowest, highest] = relief_limits_m(s.body);
  const double flattening_m = s.body.equatorial_radius_m - s.body.polar_radius_m;
  for (std::ptrdiff_t r = 0; r < out_rows; ++r) {
    if (run.stopped()) return fail(kCancelled, fmt::format("{}: reading was stopped", s.name));
    std::fill(sum.begin(), sum.end(), 0.0);
    std::fill(count.begin(), count.end(), 0);
    for (int k = 0; k < step_v; ++k) {
      long v = want.v_begin + r * step_v + k;
      long turned = 0;
      if ((v < 0 && s.pole_above) || (v > last_row && s.pole_below)) {
        v = v < 0 ? -1 - v : 2 * last_row + 1 - v;
        turned = period / 2;
      }
      v = std::clamp(v, 0L, last_row);
      {
        const detail::ErrorCapture capture;
        if (s.dataset->GetRasterBand(1)->RasterIO(GF_Read, static_cast<int>(first),
                                                  static_cast<int>(v), n, 1, line.data(), n, 1,
                                                  GDT_Float64, 0, 0, nullptr) != CE_None ||
            capture.failed())
          return fail(kRasterNotReadable, fmt::format("{}: cannot read line {} of {}: {}", s.name,
                                                      v, rows(), capture.text()));
      }
      for (std::ptrdiff_t c = 0; c < out_cols; ++c)
        for (int i = 0; i < step_u; ++i) {
          const long u = column(want.u_begin + c * step_u + i, turned) - first;
          const double raw = line[static_cast<std::size_t>(u)];
          if (s.rule.is_void(raw)) continue;
          double value = s.rule.scale * raw + s.rule.offset;
          low = std::min(low, value);
          high = std::max(high, value);
          // Radii and heights are two orders of magnitude apart on any body with a name.
          if (s.rule.brightness) {
            ++heights;
          } else if (std::abs(value - s.rule.reference_radius_m) <
                     0.03 * s.rule.reference_radius_m) {
            value -= s.rule.reference_radius_m;
            ++radii;
            out_of_relief = out_of_relief || value < lowest - flattening_m || value > highest;
          } else {
            ++heights;
            out_of_relief = out_of_relief || value < lowest || value > highest;
          }
          sum[static_cast<std::size_t>(c)] += value;
          ++count[static_cast<std::size_t>(c)];
        }
    }
    for (std::ptrdiff_t c = 0; c < out_cols; ++c) {
      const int valid = count[static_cast<std::size_t>(c)];
      if (2 * valid >= step_u * step_v && valid > 0)
        window.height_m(r, c) = static_cast<float>(sum[static_cast<std::size_t>(c)] / valid);
    }
  }
  if (out_of_relief || (radii > 0 && heights > 0))
    return fail(
        kImplausibleHeight,
        fmt::format("{}: heights near the site run from {:g} to {:g} m; the relief of {} "
                    "runs from {:g} to {:g} m (or that plus its radius, {:g} m). Check "
                    "unit, scale, offset and byte order",
                    s.name, low, high, s.body.name, lowest, highest, s.body.equatorial_radius_m));
  window.radii = radii > 0;
  return window;
}

}  // namespace maquette::heightmap

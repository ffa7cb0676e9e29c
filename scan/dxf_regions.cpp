// SPDX-License-Identifier: GPL-3.0-or-later

// Regions drawn in a CAD program. GDAL reads the DXF (its entities as features with Layer and
// Text).

#include <algorithm>
#include <cmath>
#include <map>
#include <memory>

#include <cpl_conv.h>
#include <fmt/format.h>
#include <gdal.h>
#include <ogr_api.h>

#include "core/files.hpp"
#include "scan/detail/dxf_regions.hpp"

namespace maquette::scan::detail {
namespace {

constexpr double kClosedMm = 1e-6;

struct CloseSet {
  void operator()(GDALDatasetH set) const { GDALClose(set); }
};
struct DropFeature {
  void operator()(OGRFeatureH feature) const { OGR_F_Destroy(feature); }
};
struct DropGeometry {
  void operator()(OGRGeometryH geometry) const { OGR_G_DestroyGeometry(geometry); }
};

struct Label {
  std::string text;
  double x, y;
};

/// A drawing may say its unit: 4 is mm, 0 none.
Result<void> check_unit(const std::string& text, const std::string& file) {
  const std::size_t at = text.find("$INSUNITS");
  if (at == std::string::npos) return {};
  const std::size_t group = text.find("70", at);
  if (group == std::string::npos) return {};
  const int unit = std::atoi(text.c_str() + group + 2);
  if (unit == 0 || unit == 4) return {};
  static const std::map<int, const char*> names{
      {1, "inches"}, {2, "feet"}, {5, "centimetres"}, {6, "metres"}};
  const auto name = names.find(unit);
  return fail(kRegionFormat,
              fmt::format("{}: the drawing's unit ($INSUNITS {}) is {}; regions must be drawn in "
                          "millimetres of the model",
                          file, unit, name == names.end() ? "not mm" : name->second));
}

void add_ring(OGRGeometryH ring, std::vector<std::vector<std::array<double, 2>>>& rings) {
  std::vector<std::array<double, 2>> points;
  for (int i = 0; i < OGR_G_GetPointCount(ring); ++i)
    points.push_back({OGR_G_GetX(ring, i), OGR_G_GetY(ring, i)});
  if (points.size() >= 4) rings.push_back(std::move(points));
}

bool closed(OGRGeometryH line) {
  const int n = OGR_G_GetPointCount(line);
  return n >= 4 && std::hypot(OGR_G_GetX(line, 0) - OGR_G_GetX(line, n - 1),
                              OGR_G_GetY(line, 0) - OGR_G_GetY(line, n - 1)) < kClosedMm;
}

struct Drawing {
  std::vector<Region> regions;
  std::vector<Label> labels;
  std::size_t open = 0;  ///< curves that are not closed
};

void add_geometry(OGRGeometryH geometry, const std::string& layer, const std::string& text,
                  Drawing& drawing) {
  switch (wkbFlatten(OGR_G_GetGeometryType(geometry))) {
    case wkbPoint:
      if (!text.empty())
        drawing.labels.push_back({text, OGR_G_GetX(geometry, 0), OGR_G_GetY(geometry, 0)});
      break;
    case wkbLineString: {
      Region region;
      region.name = layer;
      if (closed(geometry)) add_ring(geometry, region.rings_mm);
      if (region.rings_mm.empty())
        ++drawing.open;
      else
        drawing.regions.push_back(std::move(region));
      break;
    }
    case wkbPolygon: {
      Region region;
      region.name = layer;
      for (int i = 0; i < OGR_G_GetGeometryCount(geometry); ++i)
        add_ring(OGR_G_GetGeometryRef(geometry, i), region.rings_mm);
      if (!region.rings_mm.empty()) drawing.regions.push_back(std::move(region));
      break;
    }
    case wkbMultiPolygon:
    case wkbMultiLineString:
    case wkbGeometryCollection:
      for (int i = 0; i < OGR_G_GetGeometryCount(geometry); ++i)
        add_geometry(OGR_G_GetGeometryRef(geometry, i), layer, text, drawing);
      break;
    default:
      break;  // surfaces and solids bound no region
  }
}

/// "rim -0.1 0.2": name and tolerance; without two numbers at the end all of it is the name.
void name_by(const std::string& text, Region& region) {
  std::vector<std::string> words;
  for (std::size_t i = 0; i < text.size();) {
    const std::size_t first = text.find_first_not_of(" \t\r\n", i);
    if (first == std::string::npos) break;
    const std::size_t end = std::min(text.find_first_of(" \t\r\n", first), text.size());
    words.push_back(text.substr(first, end - first));
    i = end;
  }
  const auto number = [](const std::string& word, double& value) {
    char* end = nullptr;
    value = std::strtod(word.c_str(), &end);
    return end != word.c_str() && *end == '\0' && std::isfinite(value);
  };
  double lower = NAN, upper = NAN;
  if (words.size() >= 3 && number(words[words.size() - 2], lower) && number(words.back(), upper)) {
    region.lower_mm = lower;
    region.upper_mm = upper;
    words.resize(words.size() - 2);
  }
  region.name.clear();
  for (const std::string& word : words) region.name += (region.name.empty() ? "" : " ") + word;
}

/// Each text belongs to the smallest curve round it.
double extent_of(const Region& region) {
  double low = INFINITY, high = -INFINITY, left = INFINITY, right = -INFINITY;
  for (const auto& p : region.rings_mm.front()) {
    low = std::fmin(low, p[1]), high = std::fmax(high, p[1]);
    left = std::fmin(left, p[0]), right = std::fmax(right, p[0]);
  }
  return (high - low) * (right - left);
}

}  // namespace

Result<std::vector<Region>> read_dxf_regions(const std::filesystem::path& path) {
  const std::string file = path.string();
  MAQUETTE_TRY(const std::string text, read_file(path));
  MAQUETTE_TRY_VOID(check_unit(text, file));
  GDALAllRegister();
  // Circles and arcs as chords of a degree: 4e-5 of the radius inside.
  CPLSetThreadLocalConfigOption("OGR_ARC_STEPSIZE", "1");
  const char* drivers[] = {"DXF", nullptr};
  CPLPushErrorHandler(CPLQuietErrorHandler);
  const std::unique_ptr<void, CloseSet> set(
      GDALOpenEx(file.c_str(), GDAL_OF_VECTOR | GDAL_OF_READONLY, drivers, nullptr, nullptr));
  CPLPopErrorHandler();
  if (!set) return fail(kRegionFormat, fmt::format("{}: not a DXF drawing", file));
  Drawing drawing;
  for (int i = 0; i < GDALDatasetGetLayerCount(set.get()); ++i) {
    OGRLayerH layer = GDALDatasetGetLayer(set.get(), i);
    OGR_L_ResetReading(layer);
    while (true) {
      CPLPushErrorHandler(CPLQuietErrorHandler);
      const std::unique_ptr<void, DropFeature> feature(OGR_L_GetNextFeature(layer));
      CPLPopErrorHandler();
      if (!feature) break;
      OGRGeometryH geometry = OGR_F_GetGeometryRef(feature.get());
      if (geometry == nullptr) continue;
      const auto field = [&](const char* name) -> std::string {
        const int k = OGR_F_GetFieldIndex(feature.get(), name);
        return k < 0 || !OGR_F_IsFieldSetAndNotNull(feature.get(), k)
                   ? ""
                   : OGR_F_GetFieldAsString(feature.get(), k);
      };
      const std::unique_ptr<void, DropGeometry> lines(
          OGR_G_GetLinearGeometry(geometry, 1.0, nullptr));
      add_geometry(lines ? lines.get() : geometry, field("Layer"), field("Text"), drawing);
    }
  }
  if (drawing.regions.empty())
    return fail(kRegionFormat,
                fmt::format("{}: no closed curve ({} open ones); join lines to closed polylines",
                            file, drawing.open));
  for (const Label& label : drawing.labels) {
    Region* best = nullptr;
    for (Region& r : drawing.regions)
      if (r.holds(label.x, label.y) && (best == nullptr || extent_of(r) < extent_of(*best)))
        best = &r;
    if (best != nullptr) name_by(label.text, *best);
  }
  std::map<std::string, int> used;
  for (Region& r : drawing.regions) {
    if (r.lower_mm > r.upper_mm)
      return fail(kRegionFormat, fmt::format("{}: region {}: the lower limit {} is above the upper "
                                             "one {}",
                                             file, r.name, r.lower_mm, r.upper_mm));
    if (const int n = ++used[r.name]; n > 1) r.name += fmt::format(" ({})", n);
  }
  return std::move(drawing.regions);
}

}  // namespace maquette::scan::detail

// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/regions.hpp"

#include <algorithm>
#include <cctype>
#include <cmath>
#include <numeric>

#include <fmt/format.h>
#include <Eigen/Dense>
#include <nlohmann/json.hpp>

#include "core/files.hpp"
#include "core/median.hpp"
#include "scan/detail/dxf_regions.hpp"
#include "scan/statistics.hpp"

namespace maquette::scan {
namespace {

using heightmap::ModelField;
using nlohmann::json;

tl::unexpected<Error> bad(const std::string& where, const std::string& what) {
  return fail(kRegionFormat, fmt::format("{}: {}", where, what));
}

Result<void> add_polygon(Region& region, const json& rings, const std::string& where) {
  if (!rings.is_array()) return bad(where, "coordinates must be a list of rings");
  for (const json& ring : rings) {
    auto& to = region.rings_mm.emplace_back();
    if (!ring.is_array() || ring.size() < 4)
      return bad(where, "a ring needs at least four points, the last equal to the first");
    for (const json& p : ring) {
      if (!p.is_array() || p.size() < 2 || !p[0].is_number() || !p[1].is_number())
        return bad(where, "a point must be [x, y] in mm");
      to.push_back({p[0].get<double>(), p[1].get<double>()});
    }
  }
  return {};
}

}  // namespace

bool Region::holds(double x, double y) const {
  bool inside = false;
  for (const auto& ring : rings_mm)
    for (std::size_t i = 0, j = ring.size() - 1; i < ring.size(); j = i++)
      if ((ring[i][1] > y) != (ring[j][1] > y) &&
          x < (ring[j][0] - ring[i][0]) * (y - ring[i][1]) / (ring[j][1] - ring[i][1]) + ring[i][0])
        inside = !inside;
  return inside;
}

Result<std::vector<Region>> read_regions(const std::filesystem::path& path) {
  std::string ending = path.extension().string();
  std::transform(ending.begin(), ending.end(), ending.begin(),
                 [](unsigned char c) { return static_cast<char>(std::tolower(c)); });
  if (ending == ".dxf") return detail::read_dxf_regions(path);
  MAQUETTE_TRY(const std::string text, read_file(path));
  const json root = json::parse(text, nullptr, false);
  const std::string file = path.string();
  if (root.is_discarded()) return bad(file, "not JSON");
  if (!root.is_object() || !root.contains("features") || !root["features"].is_array())
    return bad(file, "must be a FeatureCollection with a list `features`");
  std::vector<Region> regions;
  for (std::size_t i = 0; i < root["features"].size(); ++i) {
    const json& feature = root["features"][i];
    const std::string where = fmt::format("{}: /features/{}", file, i);
    if (!feature.is_object() || !feature.contains("geometry") || !feature["geometry"].is_object())
      return bad(where, "has no geometry");
    const json& geometry = feature["geometry"];
    const json properties = feature.contains("properties") && feature["properties"].is_object()
                                ? feature["properties"]
                                : json::object();
    Region region;
    region.name = fmt::format("region {}", i + 1);
    if (properties.contains("name") && properties["name"].is_string())
      region.name = properties["name"].get<std::string>();
    for (const auto& [key, to] :
         {std::pair{"lower_mm", &region.lower_mm}, {"upper_mm", &region.upper_mm}})
      if (properties.contains(key)) {
        if (!properties[key].is_number())
          return bad(where + "/properties/" + key, "must be a number");
        *to = properties[key].get<double>();
      }
    if (region.lower_mm > region.upper_mm)
      return bad(where + "/properties", "lower_mm is above upper_mm");
    if (!geometry.contains("coordinates")) return bad(where, "geometry has no coordinates");
    const json kind = geometry.value("type", json());
    if (kind == "Polygon") {
      MAQUETTE_TRY_VOID(add_polygon(region, geometry["coordinates"], where));
    } else if (kind == "MultiPolygon" && geometry["coordinates"].is_array()) {
      for (const json& polygon : geometry["coordinates"])
        MAQUETTE_TRY_VOID(add_polygon(region, polygon, where));
    } else {
      return bad(where + "/geometry/type", "must be Polygon or MultiPolygon");
    }
    regions.push_back(std::move(region));
  }
  return regions;
}

Result<std::vector<Region>> band_regions(const ModelField& design,
                                         const meshing::BandSplit& split) {
  MAQUETTE_TRY(const auto bands, meshing::split_into_bands(design, split));
  std::vector<Region> regions;
  for (const meshing::Band& band : bands) {
    const auto window = meshing::band_window(design, band);
    const double x0 = design.x_mm(window.col0), x1 = design.x_mm(window.col1),
                 y0 = design.y_mm(window.row0), y1 = design.y_mm(window.row1);
    Region region;
    region.name = fmt::format("band {}", band.number);
    region.rings_mm = {{{x0, y0}, {x1, y0}, {x1, y1}, {x0, y1}, {x0, y0}}};
    regions.push_back(std::move(region));
  }
  return regions;
}

std::string_view name_of(Verdict verdict) {
  switch (verdict) {
    case Verdict::pass:
      return "pass";
    case Verdict::fail:
      return "fail";
    case Verdict::undecided:
      return "undecided";
    default:
      return "no tolerance";
  }
}

std::vector<RegionResult> judge_regions(std::span<const Vec3> points,
                                        std::span<const float> deviation,
                                        std::span<const Region> regions, const Significance& s,
                                        const Registration* registration) {
  std::vector<RegionResult> results;
  for (const Region& region : regions) {
    RegionResult r;
    r.name = region.name;
    std::vector<float> values;
    Vec3 middle;
    for (std::size_t i = 0; i < points.size(); ++i)
      if (!std::isnan(deviation[i]) && region.holds(points[i].x, points[i].y)) {
        values.push_back(deviation[i]);
        middle += points[i];
      }
    r.statistics = summarize(values);
    r.statistics.coverage = NAN;
    if (values.empty()) {
      results.push_back(r);
      continue;
    }
    const auto n = static_cast<double>(values.size());
    const double inflation = s.maps.empty() ? 1.0 : s.maps.back().inflation;
    const double pose =
        registration != nullptr ? pose_sigma_mm(*registration, (1.0 / n) * middle, {0, 0, 1}) : 0.0;
    r.sigma_mean_mm = std::hypot(inflation * r.statistics.nmad_mm / std::sqrt(n), pose);
    if (!s.maps.empty() && !(std::isnan(region.lower_mm) && std::isnan(region.upper_mm))) {
      const double lower = std::isnan(region.lower_mm) ? -INFINITY : region.lower_mm;
      const double upper = std::isnan(region.upper_mm) ? INFINITY : region.upper_mm;
      const CellMap& map = s.maps.front();
      std::size_t within = 0;
      for (const float v : values)
        within += static_cast<double>(v) >= lower && static_cast<double>(v) <= upper ? 1U : 0U;
      r.within = static_cast<double>(within) / n;
      // A mean of many cells goes beyond two standard deviations by chance: the guard band is
      // widened to what the largest of them reaches (Bonferroni, 5 %).
      std::size_t cells = 0;
      for (std::ptrdiff_t i = 0; i < map.mean_mm.rows(); ++i)
        for (std::ptrdiff_t j = 0; j < map.mean_mm.cols(); ++j)
          cells += !std::isnan(map.mean_mm(i, j)) &&
                           region.holds(map.x0_mm + map.cell_mm * (static_cast<double>(j) + 0.5),
                                        map.y0_mm + map.cell_mm * (static_cast<double>(i) + 0.5))
                       ? 1U
                       : 0U;
      const double guard = std::fmax(
          2.0, std::sqrt(2.0 * std::log(std::fmax(1.0, static_cast<double>(cells)) / 0.05)));
      bool all_in = cells > 0, some_out = false;
      double farthest = -INFINITY;
      for (std::ptrdiff_t i = 0; i < map.mean_mm.rows(); ++i)
        for (std::ptrdiff_t j = 0; j < map.mean_mm.cols(); ++j) {
          const Vec3 at{map.x0_mm + map.cell_mm * (static_cast<double>(j) + 0.5),
                        map.y0_mm + map.cell_mm * (static_cast<double>(i) + 0.5), 0.0};
          if (std::isnan(map.mean_mm(i, j)) || !region.holds(at.x, at.y)) continue;
          const auto mean = static_cast<double>(map.mean_mm(i, j));
          const double u = guard * static_cast<double>(map.lod_mm(i, j)) / 1.96;
          const double out = std::fmax(lower - mean, mean - upper);
          all_in = all_in && out < -u;
          some_out = some_out || out > u;
          if (out > farthest) farthest = out, r.worst_mm = mean, r.worst_at_mm = at;
        }
      r.verdict = some_out ? Verdict::fail : all_in ? Verdict::pass : Verdict::undecided;
    }
    results.push_back(r);
  }
  return results;
}

Texture texture_of(const Grid<float>& d, double spacing_mm) {
  Texture t;
  using Row = Eigen::Matrix<double, 6, 1>;
  const auto row_at = [&](std::ptrdiff_t r, std::ptrdiff_t c) {
    const double x = 2.0 * static_cast<double>(c) / static_cast<double>(d.cols()) - 1.0;
    const double y = 2.0 * static_cast<double>(r) / static_cast<double>(d.rows()) - 1.0;
    return (Row() << 1.0, x, y, x * x, x * y, y * y).finished();
  };
  Eigen::Matrix<double, 6, 6> normal = Eigen::Matrix<double, 6, 6>::Zero();
  Row right = Row::Zero();
  double n = 0.0;
  for (std::ptrdiff_t r = 0; r < d.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < d.cols(); ++c)
      if (!std::isnan(d(r, c))) {
        const Row row = row_at(r, c);
        normal += row * row.transpose();
        right += static_cast<double>(d(r, c)) * row;
        n += 1.0;
      }
  if (n < 50.0) return t;
  const Row form = normal.ldlt().solve(right);
  const auto rest = [&](std::ptrdiff_t r, std::ptrdiff_t c) {
    return static_cast<double>(d(r, c)) - form.dot(row_at(r, c));
  };
  double a = 0.0, q = 0.0, cube = 0.0, fourth = 0.0, low = INFINITY, high = -INFINITY;
  double form_low = INFINITY, form_high = -INFINITY, developed = 0.0, quads = 0.0;
  for (std::ptrdiff_t r = 0; r < d.rows(); ++r)
    for (std::ptrdiff_t c = 0; c < d.cols(); ++c) {
      if (std::isnan(d(r, c))) continue;
      const double z = rest(r, c), f = static_cast<double>(d(r, c)) - z;
      a += std::abs(z), q += z * z, cube += z * z * z, fourth += z * z * z * z;
      low = std::fmin(low, z), high = std::fmax(high, z);
      form_low = std::fmin(form_low, f), form_high = std::fmax(form_high, f);
      if (!d.contains(r + 1, c + 1)) continue;
      const double z01 = rest(r, c + 1), z10 = rest(r + 1, c), z11 = rest(r + 1, c + 1);
      if (std::isnan(z01) || std::isnan(z10) || std::isnan(z11)) continue;
      // Two triangles.
      const auto area = [&](double dx, double dy) {
        return 0.5 * std::sqrt(1.0 + (dx * dx + dy * dy) / (spacing_mm * spacing_mm));
      };
      developed += area(z01 - z, z11 - z01) + area(z11 - z10, z10 - z);
      quads += 1.0;
    }
  t.sa_mm = a / n;
  t.sq_mm = std::sqrt(q / n);
  t.sz_mm = high - low;
  t.ssk = cube / n / std::pow(t.sq_mm, 3.0);
  t.sku = fourth / n / std::pow(t.sq_mm, 4.0);
  t.sdr = quads > 0.0 ? developed / quads - 1.0 : NAN;
  t.form_mm = form_high - form_low;
  return t;
}

Dependence depend_on(std::string name, std::span<const float> values,
                     std::span<const float> deviation, std::size_t bins) {
  Dependence result;
  result.on = std::move(name);
  std::vector<std::pair<float, float>> pairs;
  for (std::size_t i = 0; i < values.size(); ++i)
    if (!std::isnan(values[i]) && !std::isnan(deviation[i]))
      pairs.emplace_back(values[i], deviation[i]);
  // By value alone: sorted by deviation too, bins of one value would differ by it.
  const auto by_value = [](const auto& a, const auto& b) { return a.first < b.first; };
  std::stable_sort(pairs.begin(), pairs.end(), by_value);
  for (std::size_t k = 0, first = 0; k < bins && first < pairs.size(); ++k) {
    std::size_t end = std::max(first + 1, (k + 1) * pairs.size() / bins);
    // What has one value is in one bin.
    end =
        static_cast<std::size_t>(std::upper_bound(pairs.begin() + static_cast<std::ptrdiff_t>(end),
                                                  pairs.end(), pairs[end - 1], by_value) -
                                 pairs.begin());
    if ((k + 1) * pairs.size() / bins <= first) continue;
    std::vector<float> d;
    for (std::size_t i = first; i < end; ++i) d.push_back(pairs[i].second);
    const DeviationStatistics s = summarize(d);
    result.from.push_back(static_cast<double>(pairs[first].first));
    result.to.push_back(static_cast<double>(pairs[end - 1].first));
    result.mean_mm.push_back(s.mean_mm);
    result.nmad_mm.push_back(s.nmad_mm);
    result.points.push_back(end - first);
    first = end;
  }
  return result;
}

Budget budget_of(const CellMap& cells, const Registration* registration, const ModelField& design) {
  Budget b;
  std::vector<double> sigma;
  for (const float v : cells.sigma_mm.cells())
    if (!std::isnan(v)) sigma.push_back(static_cast<double>(v));
  const double of_cell = sigma.empty() ? 0.0 : median(sigma);
  const double independent = of_cell / cells.inflation;
  b.contributions.push_back(
      {"noise, roughness and density of the points", independent,
       fmt::format("A: scatter in cells of {:.3g} mm over the root of the points", cells.cell_mm)});
  b.contributions.push_back(
      {"correlation between points",
       std::sqrt(std::fmax(0.0, of_cell * of_cell - independent * independent)),
       fmt::format("A: spread of cell means is {:.2f} times that of independent points",
                   cells.inflation)});
  if (registration != nullptr) {
    double square = 0.0, n = 0.0;
    for (const double u : {0.1, 0.3, 0.5, 0.7, 0.9})
      for (const double v : {0.1, 0.3, 0.5, 0.7, 0.9}) {
        const auto c = static_cast<std::ptrdiff_t>(u * static_cast<double>(design.z_mm.cols() - 1));
        const auto r = static_cast<std::ptrdiff_t>(v * static_cast<double>(design.z_mm.rows() - 1));
        if (std::isnan(design.z_mm(r, c))) continue;
        const double s = pose_sigma_mm(
            *registration, {design.x_mm(c), design.y_mm(r), static_cast<double>(design.z_mm(r, c))},
            {0, 0, 1});
        square += s * s, n += 1.0;
      }
    b.contributions.push_back({"registration", n > 0.0 ? std::sqrt(square / n) : 0.0,
                               "A: covariance of the pose, mean over the part"});
  }
  // The chord of a curved surface lies below it by second difference / 8; rectangular.
  std::vector<double> sagitta;
  const std::ptrdiff_t step = std::max<std::ptrdiff_t>(1, design.z_mm.rows() / 200);
  for (std::ptrdiff_t r = 0; r < design.z_mm.rows(); r += step)
    for (std::ptrdiff_t c = 1; c + 1 < design.z_mm.cols(); c += step) {
      const double second = static_cast<double>(design.z_mm(r, c - 1)) -
                            2.0 * static_cast<double>(design.z_mm(r, c)) +
                            static_cast<double>(design.z_mm(r, c + 1));
      if (!std::isnan(second)) sagitta.push_back(std::abs(second) / 8.0);
    }
  b.contributions.push_back({"design as triangles",
                             sagitta.empty() ? 0.0 : median(sagitta) / std::sqrt(3.0),
                             "B: chord of the grid, rectangular"});
  double square = 0.0;
  for (const Contribution& c : b.contributions) square += c.u_mm * c.u_mm;
  b.combined_mm = std::sqrt(square);
  b.expanded_mm = 2.0 * b.combined_mm;
  return b;
}

}  // namespace maquette::scan

// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/layer.hpp"

#include <algorithm>
#include <cmath>
#include <string>
#include <utility>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include "heightmap/field_io.hpp"

namespace maquette::heightmap::detail {
namespace {

constexpr double kVoidPixels = 2.0;  // of what lies below: it shows nothing of narrower voids

Error no_overlap(const FuseRequest& request, const DemReader& dem, const SiteFrame& site) {
  const double w = request.half_width.value();
  GeoBox box{90.0, -90.0, INFINITY, -INFINITY};
  for (const double x : {-w, 0.0, w})
    for (const double y : {-w, 0.0, w}) {
      const BodyPoint p = site.below(x, y);
      box = {std::min(box.south, p.latitude_deg), std::max(box.north, p.latitude_deg),
             std::min(box.west, p.longitude_deg), std::max(box.east, p.longitude_deg)};
    }
  const GeoBox have = dem.extent();
  return {kNoOverlap,
          fmt::format("{}: does not touch the site. The site spans latitudes {:.4f} to {:.4f} and "
                      "longitudes {:.4f} to {:.4f} E, the raster {:.4f} to {:.4f} and {:.4f} to "
                      "{:.4f} E (planetocentric degrees)",
                      dem.name(), box.south, box.north, box.west, box.east, have.south, have.north,
                      have.west, have.east)};
}

Result<PixelWindow> read_window(const DemReader& dem, const NodeMap& map, const PixelSize& pixel,
                                const RunContext& run) {
  // Pixels much finer than the nodes are averaged, or their detail would alias.
  const auto step = [&](double pixel_m) {
    return std::max(1, static_cast<int>(std::floor(map.nodes().spacing_m / pixel_m + 1e-9)));
  };
  const int step_u = step(pixel.along_u_m), step_v = step(pixel.along_v_m);
  return dem.read(map.needed(step_u, step_v), step_u, step_v, run);
}

/// Reads a layer's window, cleans it and lays it on the nodes; gives what was found.
Result<CleanedLayer> lay(Layer& layer, const DemReader& dem, const NodeMap& map,
                         const RunContext& run) {
  MAQUETTE_TRY(layer.window, read_window(dem, map, layer.pixel, run));
  MAQUETTE_TRY(auto cleaned,
               clean_layer(layer.window, layer.pixel, map, layer.clean, layer.widest_void_m, run));
  layer.marks = std::move(cleaned.marks);
  MAQUETTE_TRY(layer.z_m, map.sample(layer.window, run));
  return cleaned;
}

}  // namespace

double pixels_across(const PixelWindow& window) {
  return std::sqrt(static_cast<double>(window.step_u) * window.step_v);
}

Result<Layer> read_layer(const FuseRequest& request, const Source& source, double pixel_below_m,
                         const DemReader& dem, const SiteFrame& site, const NodeGrid& nodes,
                         SourceReport& report, const RunContext& run) {
  MAQUETTE_TRY(const auto map, NodeMap::build(dem, site, nodes, run));
  if (!map.touches()) return tl::unexpected<Error>(no_overlap(request, dem, site));
  Layer layer;
  layer.pixel = pixel_size(dem, site, 0.5 * request.half_width.value());
  layer.clean = source.clean;
  layer.widest_void_m = kVoidPixels * pixel_below_m;
  MAQUETTE_TRY(const auto cleaned, lay(layer, dem, map, run));
  report.artefacts = cleaned.report;
  report.filled_share = cleaned.filled_share;
  if (const std::string found = in_words(cleaned.report, layer.pixel.longer_m()); !found.empty())
    run.warn(
        fmt::format("{}: {}; {} (artefacts.tif shows where)", dem.name(), found,
                    source.clean == Clean::remove
                        ? "what is separable was taken away"
                        : "left as they are, clean = \"remove\" takes away what is separable"));
  layer.covered =
      static_cast<std::ptrdiff_t>(layer.z_m.cells().size()) - height_range(layer.z_m).voids;
  if (layer.covered == 0)
    return fail(kAllVoid, fmt::format("{}: has only voids inside the site", dem.name()));
  return layer;
}

Result<void> move(Layer& layer, const DemReader& dem, const SiteFrame& site, const NodeGrid& nodes,
                  const std::optional<Origin>& origin, const RunContext& run,
                  const std::function<double(double, double)>& raised_m) {
  if (origin) {
    MAQUETTE_TRY(const auto map, NodeMap::build(dem, site, nodes, run, *origin));
    MAQUETTE_TRY_VOID(lay(layer, dem, map, run));
  }
  oneapi::tbb::parallel_for(std::ptrdiff_t{0}, nodes.rows, [&](std::ptrdiff_t r) {
    const double y = nodes.y0_m + nodes.spacing_m * static_cast<double>(r);
    for (std::ptrdiff_t c = 0; c < nodes.cols; ++c) {
      const double x = nodes.x0_m + nodes.spacing_m * static_cast<double>(c);
      float& h = layer.z_m(r, c);
      h = static_cast<float>(static_cast<double>(h) + raised_m(x, y));
    }
  });
  return {};
}

Layer nothing_of(const DemReader& dem, const SiteFrame& site, const NodeGrid& nodes) {
  Layer layer;
  layer.pixel = pixel_size(dem, site, nodes.spacing_m);
  layer.z_m = Grid<float>(nodes.rows, nodes.cols, NAN);
  return layer;
}

}  // namespace maquette::heightmap::detail

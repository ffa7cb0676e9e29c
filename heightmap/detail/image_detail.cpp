// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/image_detail.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>
#include <utility>

#include <fmt/format.h>

#include "heightmap/dem_reader.hpp"
#include "heightmap/detail/site_frame.hpp"
#include "heightmap/photoclinometry.hpp"

namespace maquette::heightmap::detail {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;
constexpr double kLeastShare = 0.05;  // of the variance of a node's error, that stays whatever said

/// @param noise_share  noise of a node, by its spectrum below the image's resolution, over a
/// pixel's
Shading shading_of(const ImageSource& image, double noise_share) {
  Shading s;
  s.sun_azimuth_rad = image.sun_azimuth_deg * kDegree;
  s.sun_elevation_rad = image.sun_elevation_deg * kDegree;
  s.lunar_lambert = image.lunar_lambert;
  s.noise = image.noise * noise_share;
  s.albedo_contrast = image.albedo_contrast;
  s.albedo_length_m = image.albedo_length_m;
  return s;
}

}  // namespace

Result<ImageReport> add_image_detail(FusedSurface& surface, const ImageSource& image,
                                     const Body& body, double latitude_deg, double longitude_deg,
                                     const NodeGrid& nodes, double dem_pixel_m,
                                     const Roughness& relief, const RunContext& run) {
  MAQUETTE_TRY(DemReader raster, DemReader::open_image(image.path, image.name, body));
  raster.centre_on(latitude_deg, longitude_deg);
  const SiteFrame site(body, latitude_deg, longitude_deg);
  MAQUETTE_TRY(const auto map, NodeMap::build(raster, site, nodes, run));
  ImageReport report;
  report.name = image.name;
  const PixelSize pixel =
      pixel_size(raster, site, 0.25 * nodes.spacing_m * static_cast<double>(nodes.cols));
  report.pixel_m = pixel.longer_m();
  if (!map.touches())
    return fail(kNoOverlap, fmt::format("{}: the image does not touch the site", raster.name()));
  const double seen_m = std::max(report.pixel_m, nodes.spacing_m);
  if (!(seen_m < dem_pixel_m))
    return fail(kImageNotFiner,
                fmt::format("{}: shows {:.3g} m on the site's nodes, the elevation products {:.3g} "
                            "m; an image adds detail only where it is finer",
                            raster.name(), seen_m, dem_pixel_m));
  const auto step = [&](double along_m) {
    return std::max(1, static_cast<int>(std::floor(nodes.spacing_m / along_m + 1e-9)));
  };
  const int step_u = step(pixel.along_u_m), step_v = step(pixel.along_v_m);
  MAQUETTE_TRY(const auto window, raster.read(map.needed(step_u, step_v), step_u, step_v, run));
  MAQUETTE_TRY(const Grid<float> brightness, map.sample(window, run));
  std::size_t shown = 0;
  for (const float b : brightness.cells()) shown += b > 0.0F ? 1 : 0;
  report.coverage = static_cast<double>(shown) / static_cast<double>(brightness.cells().size());

  // Averaged to nodes, or interpolated: then its spectrum is that of noise in fewer pixels.
  const double averaged = std::sqrt(static_cast<double>(step_u) * step_v);
  const double noise_share = std::max(1.0, report.pixel_m / nodes.spacing_m) / averaged;
  MAQUETTE_TRY(auto detail,
               photoclinometry(surface.field.z_m, brightness, nodes.spacing_m, dem_pixel_m, seen_m,
                               relief, shading_of(image, noise_share), run));
  report.steps = detail.steps;
  double square = 0.0;
  for (std::size_t i = 0; i < brightness.cells().size(); ++i) {
    surface.field.z_m.cells()[i] += detail.added_m.cells()[i];
    square += std::pow(static_cast<double>(detail.added_m.cells()[i]), 2.0);
    if (!(brightness.cells()[i] > 0.0F)) continue;
    const double before = std::pow(static_cast<double>(surface.sigma_m.cells()[i]), 2.0);
    surface.sigma_m.cells()[i] =
        static_cast<float>(std::sqrt(std::max(kLeastShare * before, before - detail.gain_m2)));
  }
  report.added_rms_m = std::sqrt(square / static_cast<double>(brightness.cells().size()));
  report.variance_lowered_m2 = detail.gain_m2;
  return report;
}

}  // namespace maquette::heightmap::detail

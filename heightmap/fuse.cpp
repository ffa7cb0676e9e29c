// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/fuse.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include "heightmap/dem_reader.hpp"
#include "heightmap/detail/blend.hpp"
#include "heightmap/detail/clean_layer.hpp"
#include "heightmap/detail/coregister.hpp"
#include "heightmap/detail/datum_check.hpp"
#include "heightmap/detail/enlargement.hpp"
#include "heightmap/detail/image_detail.hpp"
#include "heightmap/detail/joint_adjustment.hpp"
#include "heightmap/detail/knowledge.hpp"
#include "heightmap/detail/node_map.hpp"
#include "heightmap/detail/roughness.hpp"
#include "heightmap/detail/site_frame.hpp"
#include "heightmap/detail/synthetic.hpp"
#include "heightmap/detail/void_fill.hpp"
#include "heightmap/field_io.hpp"

namespace maquette::heightmap {
namespace {

constexpr double kUncoveredAllowed = 0.01;
constexpr double kVoidPixels = 2.0;  // of what lies below: it shows nothing of narrower voids
/// Where no source has pixels enough to show the relief's law: lunar highlands, 7.5 degrees over 17
/// m (Rosenburg et al. 2011, doi:10.1029/2010JE003716).
const detail::Roughness kUnseenRelief{0.95, 0.022, 0.0};
constexpr std::ptrdiff_t kFewestNodes = 8;  // along a side of the coarsest level

detail::NodeGrid nodes_of(const FuseRequest& request) {
  const double cells = 2.0 * request.half_width.value() / request.spacing.value();
  MAQUETTE_CHECK(request.spacing.value() > 0.0 && cells >= 1.0 &&
                     std::abs(cells - std::round(cells)) < 1e-6 * cells,
                 "site of +-{} m with nodes every {} m: not a whole number of cells",
                 request.half_width.value(), request.spacing.value());
  MAQUETTE_CHECK(std::abs(request.centre_latitude_deg) <= 90.0, "latitude {}",
                 request.centre_latitude_deg);
  MAQUETTE_CHECK(!request.sources.empty() && request.sources.size() < detail::Blend::kFilled,
                 "{} sources", request.sources.size());
  const auto n = static_cast<std::ptrdiff_t>(std::lround(cells)) + 1;
  return {-request.half_width.value(), -request.half_width.value(), request.spacing.value(), n, n};
}

/// One source on the site's nodes.
struct Layer {
  Grid<float> z_m;
  PixelWindow window;
  detail::PixelSize pixel;
  std::ptrdiff_t covered = 0;
  Clean clean = Clean::off;
  double widest_void_m = 0.0;  ///< of those that are filled from its own relief
  detail::LayerMarks marks;
  bool adjusted = false;  ///< in its place by the joint adjustment
};

Error no_overlap(const FuseRequest& request, const DemReader& dem, const detail::SiteFrame& site) {
  const double w = request.half_width.value();
  GeoBox box{90.0, -90.0, INFINITY, -INFINITY};
  for (const double x : {-w, 0.0, w})
    for (const double y : {-w, 0.0, w}) {
      const detail::BodyPoint p = site.below(x, y);
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

Result<PixelWindow> read_window(const DemReader& dem, const detail::NodeMap& map,
                                const detail::PixelSize& pixel, const RunContext& run) {
  // Pixels much finer than the nodes are averaged, or their detail would alias.
  const auto step = [&](double pixel_m) {
    return std::max(1, static_cast<int>(std::floor(map.nodes().spacing_m / pixel_m + 1e-9)));
  };
  const int step_u = step(pixel.along_u_m), step_v = step(pixel.along_v_m);
  return dem.read(map.needed(step_u, step_v), step_u, step_v, run);
}

/// Reads a layer's window, cleans it and lays it on the nodes; gives what was found.
Result<detail::CleanedLayer> lay(Layer& layer, const DemReader& dem, const detail::NodeMap& map,
                                 const RunContext& run) {
  MAQUETTE_TRY(layer.window, read_window(dem, map, layer.pixel, run));
  MAQUETTE_TRY(auto cleaned, detail::clean_layer(layer.window, layer.pixel, map, layer.clean,
                                                 layer.widest_void_m, run));
  layer.marks = std::move(cleaned.marks);
  MAQUETTE_TRY(layer.z_m, map.sample(layer.window, run));
  return cleaned;
}

/// @param pixel_below_m  narrowest of the sources before it; 0: there are none
Result<Layer> read_layer(const FuseRequest& request, const Source& source, double pixel_below_m,
                         const DemReader& dem, const detail::SiteFrame& site,
                         const detail::NodeGrid& nodes, SourceReport& report,
                         const RunContext& run) {
  MAQUETTE_TRY(const auto map, detail::NodeMap::build(dem, site, nodes, run));
  if (!map.touches()) return tl::unexpected<Error>(no_overlap(request, dem, site));
  Layer layer;
  layer.pixel = detail::pixel_size(dem, site, 0.5 * request.half_width.value());
  layer.clean = source.clean;
  layer.widest_void_m = kVoidPixels * pixel_below_m;
  MAQUETTE_TRY(const auto cleaned, lay(layer, dem, map, run));
  report.artefacts = cleaned.report;
  report.filled_share = cleaned.filled_share;
  if (const std::string found = detail::in_words(cleaned.report, layer.pixel.longer_m());
      !found.empty())
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

/// Takes a layer's heights from elsewhere (nothing: from where they are) and raises them; what it
/// covers may change a little.
template <class Raised>
Result<void> move(Layer& layer, const DemReader& dem, const detail::SiteFrame& site,
                  const detail::NodeGrid& nodes, const std::optional<detail::Origin>& origin,
                  const RunContext& run, const Raised& raised_m) {
  if (origin) {
    MAQUETTE_TRY(const auto map, detail::NodeMap::build(dem, site, nodes, run, *origin));
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

/// Where a layer's heights are taken from that is moved like this; nothing: from where they are.
std::optional<detail::Origin> origin_of(const detail::Coregistration& by) {
  if (!by.horizontal) return std::nullopt;
  const auto [x, y] = by.origin_of(0.0, 0.0);
  const auto [ex, ey] = by.origin_of(1.0, 0.0);
  const auto [nx, ny] = by.origin_of(0.0, 1.0);
  return detail::Origin{ex - x, nx - x, ey - y, ny - y, x, y};
}

/// Moves a layer onto the surface below it.
Result<void> move(Layer& layer, const DemReader& dem, const detail::SiteFrame& site,
                  const detail::NodeGrid& nodes, const detail::Coregistration& by,
                  const RunContext& run) {
  return move(layer, dem, site, nodes, origin_of(by), run,
              [&by](double x, double y) { return by.up_m + by.tilt_east * x + by.tilt_north * y; });
}

/// A source that lies outside the enlargement of a surface that it was part of.
Layer nothing_of(const DemReader& dem, const detail::SiteFrame& site,
                 const detail::NodeGrid& nodes) {
  Layer layer;
  layer.pixel = detail::pixel_size(dem, site, nodes.spacing_m);
  layer.z_m = Grid<float>(nodes.rows, nodes.cols, NAN);
  return layer;
}

std::vector<detail::Seam> seams_of(const Source& source) {
  std::vector<detail::Seam> seams;
  for (std::size_t i = 0; i + 3 < source.seams_m.size(); i += 4)
    seams.push_back(
        {source.seams_m[i], source.seams_m[i + 1], source.seams_m[i + 2], source.seams_m[i + 3]});
  return seams;
}

/// Moves a layer as it lay in the surface that is enlarged.
Result<void> move_as_reported(Layer& layer, const DemReader& dem, const detail::SiteFrame& site,
                              const detail::NodeGrid& nodes, const SourceReport& report,
                              const Source& source, const RunContext& run) {
  detail::Coregistration by;
  by.east_m = report.shift_east_m;
  by.north_m = report.shift_north_m;
  by.rotation_rad = report.turn_rad;
  by.scale = report.scale;
  by.horizontal =
      by.east_m != 0.0 || by.north_m != 0.0 || by.rotation_rad != 0.0 || by.scale != 1.0;
  detail::JointPose pose;
  pose.east_m = report.shift_east_m;
  pose.north_m = report.shift_north_m;
  pose.up_m = report.shift_up_m;
  pose.tilt_east = report.tilt_east;
  pose.tilt_north = report.tilt_north;
  pose.bow_m = report.bow_per_m;  // its half width is 1 m
  pose.steps_m = report.steps_m;
  std::vector<detail::Seam> seams = seams_of(source);
  seams.resize(std::max(seams.size(), pose.steps_m.size()));
  return move(layer, dem, site, nodes, origin_of(by), run,
              [&](double x, double y) { return pose.raised_m(x, y, seams); });
}

/// Brings a layer onto the surface below it and reports how.
Result<void> align(Layer& layer, SourceReport& report, const Source& source, const DemReader& dem,
                   const detail::SiteFrame& site, const detail::NodeGrid& nodes,
                   const Grid<float>& below, double lower_pixel_m, const RunContext& run) {
  // What is finer than nodes was averaged to them.
  const double lower_m = std::max(lower_pixel_m, nodes.spacing_m);
  const double upper_m = std::max(report.pixel_m, nodes.spacing_m);
  detail::CoregisterOptions options;
  options.height_only = source.align == Source::Align::height;
  options.rotation = options.scale = source.similarity;
  const auto found =
      detail::coregister(below, layer.z_m, nodes.spacing_m, lower_m, upper_m, options);
  if (source.align == Source::Align::required && (!found || !found->horizontal))
    return fail(kNotAligned,
                fmt::format("{}: cannot be aligned with the sources before it: {}; `align = "
                            "\"auto\"` would move its height alone",
                            dem.name(), found ? found->refusal : "they have no height in common"));
  if (!found) return {};
  const double coarse_m = std::max(lower_m, upper_m);
  if (coarse_m > nodes.spacing_m * static_cast<double>(nodes.cols - 1))
    run.warn(
        fmt::format("{}: the surface below it has pixels of {:.0f} m, more than the "
                    "site; its height was moved by {:.1f} m on that authority",
                    dem.name(), coarse_m, found->up_m));
  MAQUETTE_TRY_VOID(move(layer, dem, site, nodes, *found, run));
  report.shift_east_m = found->east_m;
  report.shift_north_m = found->north_m;
  report.shift_up_m = found->up_m;
  report.tilt_east = found->tilt_east;
  report.tilt_north = found->tilt_north;
  report.turn_rad = found->rotation_rad;
  report.scale = found->scale;
  report.covariance = found->covariance;
  report.overlap = found->overlap;
  report.height_only = found->refusal;
  report.median_before_m = found->median_before_m;
  report.median_after_m = found->median_after_m;
  report.nmad_before_m = found->nmad_before_m;
  report.nmad_after_m = found->nmad_after_m;
  return {};
}

bool wants_joint(const FuseRequest& request) {
  bool asked = request.sources.size() > 2;
  for (const Source& s : request.sources) asked = asked || s.bow || !s.seams_m.empty();
  return request.joint && asked;
}

void report_pose(SourceReport& report, const detail::JointPose& pose) {
  report.joint = true;
  report.shift_east_m = pose.east_m;
  report.shift_north_m = pose.north_m;
  report.shift_up_m = pose.up_m;
  report.tilt_east = pose.tilt_east;
  report.tilt_north = pose.tilt_north;
  for (std::size_t i = 0; i < 3; ++i)
    report.bow_per_m[i] = pose.bow_m[i] / (pose.half_width_m * pose.half_width_m);
  report.steps_m = pose.steps_m;
  const auto side =
      static_cast<std::size_t>(std::lround(std::sqrt(static_cast<double>(pose.covariance.size()))));
  for (std::size_t i = 0; i < 5 && side >= 5; ++i)
    for (std::size_t j = 0; j < 5; ++j) report.covariance[i][j] = pose.covariance[i * side + j];
}

/// Levels of bands: down to waves of two of the coarsest pixels, as far as the site has them.
std::size_t levels_of(double coarsest_pixel_m, const detail::NodeGrid& nodes) {
  std::size_t levels = 1;
  while (std::exp2(static_cast<double>(levels) - 1.0) * nodes.spacing_m < coarsest_pixel_m)
    ++levels;
  while (levels > 0 && (std::min(nodes.rows, nodes.cols) >> levels) < kFewestNodes) --levels;
  return levels;
}

/// Pixels of the file along the side of a cell of the window: white noise is as much lower.
double pixels_across(const PixelWindow& window) {
  return std::sqrt(static_cast<double>(window.step_u) * window.step_v);
}

/// Noise of a layer as it says, white as far as its pixels show white noise.
detail::Knowledge knowledge_of(const Layer& layer, const Source& source,
                               const detail::Roughness& own, const detail::WaveTable& waves) {
  const double averaged = pixels_across(layer.window);
  double white_m = source.sigma_m / averaged;
  if (own.coefficient > 0.0) white_m = std::min(white_m, own.noise_m);
  const double correlated_m = std::sqrt(
      std::max(0.0, source.sigma_m * source.sigma_m - white_m * white_m * averaged * averaged));
  return detail::knowledge_of(waves, layer.pixel.longer_m() / waves.spacing_m, white_m,
                              correlated_m);
}

/// What was made up in the base counts as filled.
void doubt_made(Grid<float>& sigma_m, const detail::LayerMarks& marks) {
  if (marks.made.empty()) return;
  if (sigma_m.empty()) sigma_m = Grid<float>(marks.made.rows(), marks.made.cols(), NAN);
  for (std::size_t i = 0; i < sigma_m.cells().size(); ++i)
    if (marks.made.cells()[i] != 0) sigma_m.cells()[i] = marks.doubt_m.cells()[i];
}

/// Artefacts of all sources, and what those of the most exact one do to the uncertainty.
void mark(FusedSurface& surface, const std::vector<detail::LayerMarks>& marks) {
  surface.artefacts = Grid<std::uint8_t>(surface.source.rows(), surface.source.cols(), 0);
  const Grid<std::uint8_t> most_exact = surface.source;
  for (std::size_t i = 0; i < marks.size(); ++i) {
    const detail::LayerMarks& of = marks[i];
    for (std::size_t k = 0; k < most_exact.cells().size(); ++k) {
      if (!of.artefacts.empty())
        surface.artefacts.cells()[k] =
            static_cast<std::uint8_t>(surface.artefacts.cells()[k] | of.artefacts.cells()[k]);
      if (most_exact.cells()[k] != i) continue;
      if (!of.made.empty() && of.made.cells()[k] != 0)
        surface.source.cells()[k] = detail::Blend::kFilled;
      if (!of.doubt_m.empty())
        surface.sigma_m.cells()[k] = std::hypot(surface.sigma_m.cells()[k], of.doubt_m.cells()[k]);
    }
  }
}

/// Pixel of the source that most of what lies below a layer comes from.
double pixel_below(const Grid<std::uint8_t>& source, const Grid<float>& layer,
                   const std::vector<SourceReport>& reports) {
  std::vector<std::size_t> nodes(reports.size(), 0);
  for (std::size_t i = 0; i < layer.cells().size(); ++i)
    if (!std::isnan(layer.cells()[i]) && source.cells()[i] < nodes.size())
      ++nodes[source.cells()[i]];
  return reports[static_cast<std::size_t>(std::max_element(nodes.begin(), nodes.end()) -
                                          nodes.begin())]
      .pixel_m;
}

struct Read {
  DemReader dem;
  Layer layer;
  detail::Roughness roughness;
};

/// Says which sources count their heights from elsewhere than the base. A base whose pixels are
/// wider than the site cannot tell.
Result<void> check_datums(const FuseRequest& request, const std::vector<Read>& read,
                          const FusedSurface& surface, const detail::NodeGrid& nodes,
                          const RunContext& run) {
  const double width_m = nodes.spacing_m * static_cast<double>(nodes.cols - 1);
  for (std::size_t i = 1; i < read.size(); ++i) {
    if (std::max(surface.sources[0].pixel_m, surface.sources[i].pixel_m) > width_m) continue;
    const Source& source = request.sources[i];
    const auto doubt =
        detail::datum_doubt(read[0].layer.z_m, read[i].layer.z_m,
                            std::hypot(request.sources[0].sigma_m, source.sigma_m), request.body);
    if (!doubt) continue;
    if (source.align == Source::Align::none)
      return fail(kDatumDiffers, fmt::format("{}: {}; correct the product, or let `align` move its "
                                             "height",
                                             read[i].dem.name(), *doubt));
    run.warn(fmt::format("{}: {}; it is moved onto them", read[i].dem.name(), *doubt));
  }
  return {};
}

/// Brings all layers that pairs tie to the base onto each other and reports how.
Result<void> align_jointly(const FuseRequest& request, std::vector<Read>& read,
                           const detail::SiteFrame& site, const detail::NodeGrid& nodes,
                           FusedSurface& surface, const RunContext& run) {
  std::vector<detail::JointSurface> surfaces;
  for (std::size_t i = 0; i < read.size(); ++i) {
    const Source& s = request.sources[i];
    const bool aligned = s.align == Source::Align::automatic || s.align == Source::Align::required;
    surfaces.push_back({&read[i].layer.z_m, std::max(surface.sources[i].pixel_m, nodes.spacing_m),
                        i == 0 || (aligned && !s.similarity), s.bow, seams_of(s)});
  }
  const auto joint = detail::joint_adjustment(surfaces, nodes.spacing_m);
  if (!joint) return {};
  surface.loop_before_px = joint->loop_before_px;
  surface.loop_after_px = joint->loop_after_px;
  for (std::size_t i = 0; i < read.size(); ++i) {
    const detail::JointPose& pose = joint->poses[i];
    if (!pose.found || (i == 0 && pose.steps_m.empty())) continue;
    std::optional<detail::Origin> origin;
    if (i > 0) origin = detail::Origin{1.0, 0.0, 0.0, 1.0, -pose.east_m, -pose.north_m};
    MAQUETTE_TRY_VOID(
        move(read[i].layer, read[i].dem, site, nodes, origin, run,
             [&](double x, double y) { return pose.raised_m(x, y, surfaces[i].seams); }));
    read[i].layer.adjusted = i > 0;
    report_pose(surface.sources[i], pose);
    // Against the one that it has most in common with.
    double most = 0.0;
    for (const detail::JointPair& p : joint->pairs) {
      if (p.upper != i || p.overlap <= most) continue;
      most = p.overlap;
      surface.sources[i].overlap = p.overlap;
      surface.sources[i].median_before_m = p.median_before_m;
      surface.sources[i].nmad_before_m = p.nmad_before_m;
      surface.sources[i].median_after_m = p.median_after_m;
      surface.sources[i].nmad_after_m = p.nmad_after_m;
    }
  }
  return {};
}

}  // namespace

Result<FusedSurface> fuse(const FuseRequest& request, const RunContext& run) {
  const detail::NodeGrid nodes = nodes_of(request);
  const detail::SiteFrame site(request.body, request.centre_latitude_deg,
                               request.centre_longitude_deg);
  MAQUETTE_CHECK(!request.enlarges || request.enlarges->sources.size() == request.sources.size(),
                 "{} sources enlarge a surface of {}", request.sources.size(),
                 request.enlarges ? request.enlarges->sources.size() : 0);
  const auto all_nodes = static_cast<double>(nodes.rows * nodes.cols);
  FusedSurface surface;
  surface.field.spacing = Metres{nodes.spacing_m};
  surface.field.x0 = Metres{nodes.x0_m};
  surface.field.y0 = Metres{nodes.y0_m};

  std::vector<Read> read;
  detail::Roughness roughness;  // of the finest source
  double finest_pixel_m = INFINITY, coarsest_pixel_m = 0.0;
  for (const Source& source : request.sources) {
    MAQUETTE_TRY(DemReader dem, DemReader::open(source, request.body));
    dem.centre_on(request.centre_latitude_deg, request.centre_longitude_deg);
    const SourceReport* before =
        request.enlarges ? &request.enlarges->sources[read.size()] : nullptr;
    SourceReport report;
    if (before != nullptr) report = *before;
    auto read_now = read_layer(request, source, read.empty() ? 0.0 : finest_pixel_m, dem, site,
                               nodes, report, run);
    const bool outside = !read_now && before != nullptr && !read.empty() &&
                         (read_now.error().code == kNoOverlap || read_now.error().code == kAllVoid);
    if (outside) read_now = nothing_of(dem, site, nodes);
    MAQUETTE_TRY(Layer layer, std::move(read_now));
    report.name = source.name;
    report.pixel_m = layer.pixel.longer_m();
    report.coverage = static_cast<double>(layer.covered) / all_nodes;
    const double averaged = pixels_across(layer.window);
    const detail::Roughness own =
        before != nullptr
            ? detail::Roughness{before->hurst, before->coefficient, before->noise_m / averaged}
            : detail::measure_roughness(layer.window, layer.pixel);
    report.hurst = own.hurst;
    report.coefficient = own.coefficient;
    report.noise_m = own.noise_m * averaged;
    if (report.pixel_m < finest_pixel_m) roughness = own;
    finest_pixel_m = std::min(finest_pixel_m, report.pixel_m);
    coarsest_pixel_m = std::max(coarsest_pixel_m, report.pixel_m);
    if (read.empty() && report.coverage < 1.0 - kUncoveredAllowed)
      return fail(kNotCovered, fmt::format("{}: the base covers {:.2f} % of the site, 99 % are "
                                           "needed; choose a wider product or a smaller site",
                                           dem.name(), 100.0 * report.coverage));
    surface.sources.push_back(std::move(report));
    read.push_back({std::move(dem), std::move(layer), own});
    run.progress(0.5 * static_cast<double>(read.size()) /
                 static_cast<double>(request.sources.size()));
    if (run.stopped()) return fail(kCancelled, "fusing was stopped");
  }

  if (!request.enlarges) MAQUETTE_TRY_VOID(check_datums(request, read, surface, nodes, run));
  if (request.enlarges) {
    for (std::size_t i = 0; i < read.size(); ++i)
      if (read[i].layer.covered > 0 && (i > 0 || !surface.sources[i].steps_m.empty()))
        MAQUETTE_TRY_VOID(move_as_reported(read[i].layer, read[i].dem, site, nodes,
                                           surface.sources[i], request.sources[i], run));
  } else if (wants_joint(request))
    MAQUETTE_TRY_VOID(align_jointly(request, read, site, nodes, surface, run));

  const detail::WaveTable waves = detail::wave_table(
      roughness.coefficient > 0.0 ? roughness : kUnseenRelief, nodes.spacing_m,
      nodes.spacing_m * static_cast<double>(nodes.cols), levels_of(coarsest_pixel_m, nodes));
  std::optional<detail::Blend> blend;
  std::vector<detail::LayerMarks> marks;
  Grid<float> as_seen;  // most exact source at each node as its pixels have it: to align with
  for (std::size_t i = 0; i < read.size(); ++i) {
    Layer& layer = read[i].layer;
    const Source& source = request.sources[i];
    const detail::Knowledge known = knowledge_of(layer, source, read[i].roughness, waves);
    if (!blend) {
      detail::VoidFill fill = detail::fill_voids(layer.z_m);
      doubt_made(fill.sigma, layer.marks);
      if (read.size() > 1) as_seen = layer.z_m;
      blend.emplace(waves, std::move(layer.z_m), known, fill.sigma, request.restore);
    } else {
      if (!request.enlarges && source.align != Source::Align::none && !layer.adjusted)
        MAQUETTE_TRY_VOID(align(layer, surface.sources[i], source, read[i].dem, site, nodes,
                                as_seen, pixel_below(blend->source(), layer.z_m, surface.sources),
                                run));
      blend->add(layer.z_m, known);
      const Grid<std::uint8_t> most_exact = blend->source();
      for (std::size_t k = 0; k < as_seen.cells().size(); ++k)
        if (most_exact.cells()[k] == i && !std::isnan(layer.z_m.cells()[k]))
          as_seen.cells()[k] = layer.z_m.cells()[k];
    }
    marks.push_back(std::move(layer.marks));
    layer = {};
    run.progress(0.5 + 0.4 * static_cast<double>(i + 1) / static_cast<double>(read.size()));
    if (run.stopped()) return fail(kCancelled, "fusing was stopped");
  }
  surface.sigma_m = blend->sigma_m();
  surface.source = blend->source();
  surface.field.z_m = blend->take_heights_m();
  blend.reset();
  mark(surface, marks);

  double shown_pixel_m = finest_pixel_m;  // by elevation products and images that show it all
  for (const ImageSource& image : request.images) {
    MAQUETTE_TRY(
        ImageReport report,
        detail::add_image_detail(surface, image, request.body, request.centre_latitude_deg,
                                 request.centre_longitude_deg, nodes, shown_pixel_m,
                                 roughness.coefficient > 0.0 ? roughness : kUnseenRelief, run));
    if (report.coverage > 1.0 - kUncoveredAllowed)
      shown_pixel_m = std::max(report.pixel_m, nodes.spacing_m);
    surface.images.push_back(std::move(report));
  }

  MAQUETTE_TRY_VOID(detail::add_synthetic(surface, request, nodes, roughness, shown_pixel_m, run));
  if (request.enlarges) {
    const PlanetField& wide = request.enlarges->field;
    const detail::NodeGrid wide_nodes{wide.x0.value(), wide.y0.value(), wide.spacing.value(),
                                      wide.z_m.rows(), wide.z_m.cols()};
    surface.mean_off_before_m =
        detail::farthest_mean(surface.field.z_m, nodes, wide.z_m, wide_nodes);
    detail::match_means(surface.field.z_m, nodes, wide.z_m, wide_nodes);
    surface.mean_off_m = detail::farthest_mean(surface.field.z_m, nodes, wide.z_m, wide_nodes);
  }
  run.progress(1.0);
  return surface;
}

}  // namespace maquette::heightmap

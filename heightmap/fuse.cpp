// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/fuse.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include <fmt/format.h>

#include "heightmap/detail/alignment.hpp"
#include "heightmap/detail/blend.hpp"
#include "heightmap/detail/enlargement.hpp"
#include "heightmap/detail/image_detail.hpp"
#include "heightmap/detail/knowledge.hpp"
#include "heightmap/detail/layer.hpp"
#include "heightmap/detail/residual_map.hpp"
#include "heightmap/detail/synthetic.hpp"
#include "heightmap/detail/void_fill.hpp"
#include "heightmap/field_io.hpp"

namespace maquette::heightmap {
namespace {

constexpr double kUncoveredAllowed = 0.01;
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

/// Levels of bands: down to waves of two of the coarsest pixels, as far as the site has them.
std::size_t levels_of(double coarsest_pixel_m, const detail::NodeGrid& nodes) {
  std::size_t levels = 1;
  while (std::exp2(static_cast<double>(levels) - 1.0) * nodes.spacing_m < coarsest_pixel_m)
    ++levels;
  while (levels > 0 && (std::min(nodes.rows, nodes.cols) >> levels) < kFewestNodes) --levels;
  return levels;
}

/// Noise of a layer as it says, white as far as its pixels show white noise.
detail::Knowledge knowledge_of(const detail::Layer& layer, const Source& source,
                               const detail::Roughness& own, const detail::WaveTable& waves) {
  const double averaged = detail::pixels_across(layer.window);
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

/// All sources on the nodes, and what the finest and the coarsest of them show.
struct Sources {
  std::vector<detail::ReadSource> read;
  detail::Roughness roughness;  ///< of the finest
  double finest_pixel_m = INFINITY, coarsest_pixel_m = 0.0;
  [[nodiscard]] const detail::Roughness& law() const {
    return roughness.coefficient > 0.0 ? roughness : kUnseenRelief;
  }
};

/// Reads one source more.
Result<void> read_source(Sources& sources, const Source& source, const FuseRequest& request,
                         const detail::SiteFrame& site, const detail::NodeGrid& nodes,
                         FusedSurface& surface, const RunContext& run) {
  MAQUETTE_TRY(DemReader dem, DemReader::open(source, request.body));
  dem.centre_on(request.centre_latitude_deg, request.centre_longitude_deg);
  const bool base = sources.read.empty();
  const SourceReport* before =
      request.enlarges ? &request.enlarges->sources[sources.read.size()] : nullptr;
  SourceReport report;
  if (before != nullptr) report = *before;
  auto read_now = detail::read_layer(request, source, base ? 0.0 : sources.finest_pixel_m, dem,
                                     site, nodes, report, run);
  const bool outside = !read_now && before != nullptr && !base &&
                       (read_now.error().code == kNoOverlap || read_now.error().code == kAllVoid);
  if (outside) read_now = detail::nothing_of(dem, site, nodes);
  MAQUETTE_TRY(detail::Layer layer, std::move(read_now));
  report.name = source.name;
  report.pixel_m = layer.pixel.longer_m();
  report.coverage =
      static_cast<double>(layer.covered) / static_cast<double>(nodes.rows * nodes.cols);
  const double averaged = detail::pixels_across(layer.window);
  const detail::Roughness own =
      before != nullptr
          ? detail::Roughness{before->hurst, before->coefficient, before->noise_m / averaged}
          : detail::measure_roughness(layer.window, layer.pixel);
  report.hurst = own.hurst;
  report.coefficient = own.coefficient;
  report.noise_m = own.noise_m * averaged;
  if (report.pixel_m < sources.finest_pixel_m) sources.roughness = own;
  sources.finest_pixel_m = std::min(sources.finest_pixel_m, report.pixel_m);
  sources.coarsest_pixel_m = std::max(sources.coarsest_pixel_m, report.pixel_m);
  if (base && report.coverage < 1.0 - kUncoveredAllowed)
    return fail(kNotCovered, fmt::format("{}: the base covers {:.2f} % of the site, 99 % are "
                                         "needed; choose a wider product or a smaller site",
                                         dem.name(), 100.0 * report.coverage));
  surface.sources.push_back(std::move(report));
  sources.read.push_back({std::move(dem), std::move(layer), own});
  return {};
}

/// What can be brought into its place before any source is laid over another.
Result<void> align_first(Sources& sources, const FuseRequest& request,
                         const detail::SiteFrame& site, const detail::NodeGrid& nodes,
                         FusedSurface& surface, const RunContext& run) {
  if (!request.enlarges) {
    MAQUETTE_TRY_VOID(detail::check_datums(request, sources.read, surface, nodes, run));
    if (!detail::wants_joint(request)) return {};
    return detail::align_jointly(request, sources.read, site, nodes, surface, run);
  }
  for (std::size_t i = 0; i < sources.read.size(); ++i) {
    auto& [dem, layer, roughness] = sources.read[i];
    if (layer.covered > 0 && (i > 0 || !surface.sources[i].steps_m.empty()))
      MAQUETTE_TRY_VOID(detail::move_as_reported(layer, dem, site, nodes, surface.sources[i],
                                                 request.sources[i], run));
  }
  return {};
}

/// Lays the sources over each other; those that are not in their places yet are brought there.
Result<void> blend_sources(Sources& sources, const FuseRequest& request,
                           const detail::SiteFrame& site, const detail::NodeGrid& nodes,
                           FusedSurface& surface, const RunContext& run) {
  const detail::WaveTable waves = detail::wave_table(
      sources.law(), nodes.spacing_m, nodes.spacing_m * static_cast<double>(nodes.cols),
      levels_of(sources.coarsest_pixel_m, nodes));
  std::optional<detail::Blend> blend;
  std::vector<detail::LayerMarks> marks;
  Grid<float> as_seen;  // most exact source at each node as its pixels have it: to align with
  for (std::size_t i = 0; i < sources.read.size(); ++i) {
    detail::Layer& layer = sources.read[i].layer;
    const Source& source = request.sources[i];
    const detail::Knowledge known = knowledge_of(layer, source, sources.read[i].roughness, waves);
    if (!blend) {
      detail::VoidFill fill = detail::fill_voids(layer.z_m);
      doubt_made(fill.sigma, layer.marks);
      if (sources.read.size() > 1) as_seen = layer.z_m;
      blend.emplace(waves, std::move(layer.z_m), known, fill.sigma, request.restore);
    } else {
      const double lower_pixel_m = detail::pixel_below(blend->source(), layer.z_m, surface.sources);
      if (!request.enlarges && source.align != Source::Align::none && !layer.adjusted)
        MAQUETTE_TRY_VOID(detail::align(layer, surface.sources[i], source, sources.read[i].dem,
                                        site, nodes, as_seen, lower_pixel_m, run));
      if (!request.enlarges)
        surface.residuals.push_back(detail::residual_map(as_seen, layer.z_m, nodes, lower_pixel_m,
                                                         surface.sources[i].pixel_m, i));
      blend->add(layer.z_m, known);
      const Grid<std::uint8_t> most_exact = blend->source();
      for (std::size_t k = 0; k < as_seen.cells().size(); ++k)
        if (most_exact.cells()[k] == i && !std::isnan(layer.z_m.cells()[k]))
          as_seen.cells()[k] = layer.z_m.cells()[k];
    }
    marks.push_back(std::move(layer.marks));
    layer = {};
    run.progress(0.5 + 0.4 * static_cast<double>(i + 1) / static_cast<double>(sources.read.size()));
    if (run.stopped()) return fail(kCancelled, "fusing was stopped");
  }
  surface.sigma_m = blend->sigma_m();
  surface.source = blend->source();
  surface.field.z_m = blend->take_heights_m();
  mark(surface, marks);
  return {};
}

/// Gives the narrowest pixel that shows the whole site, of elevation products and images.
Result<double> add_images(const Sources& sources, const FuseRequest& request,
                          const detail::NodeGrid& nodes, FusedSurface& surface,
                          const RunContext& run) {
  double shown_pixel_m = sources.finest_pixel_m;
  for (const ImageSource& image : request.images) {
    MAQUETTE_TRY(ImageReport report,
                 detail::add_image_detail(surface, image, request.body, request.centre_latitude_deg,
                                          request.centre_longitude_deg, nodes, shown_pixel_m,
                                          sources.law(), run));
    if (report.coverage > 1.0 - kUncoveredAllowed)
      shown_pixel_m = std::max(report.pixel_m, nodes.spacing_m);
    surface.images.push_back(std::move(report));
  }
  return shown_pixel_m;
}

}  // namespace

void enlarge(FusedSurface& surface, const Enlarged& from) {
  const PlanetField& wide = from.field;
  const auto grid_of = [](const PlanetField& f) {
    return detail::NodeGrid{f.x0.value(), f.y0.value(), f.spacing.value(), f.z_m.rows(),
                            f.z_m.cols()};
  };
  const detail::NodeGrid nodes = grid_of(surface.field), wide_nodes = grid_of(wide);
  surface.mean_off_before_m = detail::farthest_mean(surface.field.z_m, nodes, wide.z_m, wide_nodes);
  detail::match_means(surface.field.z_m, nodes, wide.z_m, wide_nodes);
  surface.mean_off_m = detail::farthest_mean(surface.field.z_m, nodes, wide.z_m, wide_nodes);
  // By the wide node in whose cell a node lies.
  const auto cell = [&](double at, double first) {
    return static_cast<std::ptrdiff_t>(std::lround((at - first) / wide_nodes.spacing_m));
  };
  for (std::ptrdiff_t r = 0; r < nodes.rows; ++r)
    for (std::ptrdiff_t c = 0; c < nodes.cols; ++c) {
      const std::ptrdiff_t row =
          cell(nodes.y0_m + nodes.spacing_m * static_cast<double>(r), wide_nodes.y0_m);
      const std::ptrdiff_t col =
          cell(nodes.x0_m + nodes.spacing_m * static_cast<double>(c), wide_nodes.x0_m);
      if (from.artefacts.contains(row, col))
        surface.artefacts(r, c) =
            static_cast<std::uint8_t>(surface.artefacts(r, c) | from.artefacts(row, col));
      if (from.sigma_m.contains(row, col))
        surface.sigma_m(r, c) = std::max(surface.sigma_m(r, c), from.sigma_m(row, col));
    }
}

Result<FusedSurface> fuse(const FuseRequest& request, const RunContext& run) {
  const detail::NodeGrid nodes = nodes_of(request);
  const detail::SiteFrame site(request.body, request.centre_latitude_deg,
                               request.centre_longitude_deg);
  MAQUETTE_CHECK(!request.enlarges || request.enlarges->sources.size() == request.sources.size(),
                 "{} sources enlarge a surface of {}", request.sources.size(),
                 request.enlarges ? request.enlarges->sources.size() : 0);
  FusedSurface surface;
  surface.field.spacing = Metres{nodes.spacing_m};
  surface.field.x0 = Metres{nodes.x0_m};
  surface.field.y0 = Metres{nodes.y0_m};

  Sources sources;
  for (const Source& source : request.sources) {
    MAQUETTE_TRY_VOID(read_source(sources, source, request, site, nodes, surface, run));
    run.progress(0.5 * static_cast<double>(sources.read.size()) /
                 static_cast<double>(request.sources.size()));
    if (run.stopped()) return fail(kCancelled, "fusing was stopped");
  }
  MAQUETTE_TRY_VOID(align_first(sources, request, site, nodes, surface, run));
  MAQUETTE_TRY_VOID(blend_sources(sources, request, site, nodes, surface, run));
  MAQUETTE_TRY(const double shown_pixel_m, add_images(sources, request, nodes, surface, run));
  MAQUETTE_TRY_VOID(
      detail::add_synthetic(surface, request, nodes, sources.roughness, shown_pixel_m, run));
  if (request.enlarges && !request.enlarges->field.z_m.empty()) enlarge(surface, *request.enlarges);
  run.progress(1.0);
  return surface;
}

}  // namespace maquette::heightmap

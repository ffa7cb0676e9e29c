// SPDX-License-Identifier: GPL-3.0-or-later
#include "heightmap/detail/alignment.hpp"

#include <algorithm>
#include <cmath>
#include <optional>
#include <utility>

#include <fmt/format.h>

#include "heightmap/detail/coregister.hpp"
#include "heightmap/detail/datum_check.hpp"
#include "heightmap/detail/joint_adjustment.hpp"

namespace maquette::heightmap::detail {
namespace {

/// Where a layer's heights are taken from that is moved like this; nothing: from where they are.
std::optional<Origin> origin_of(const Coregistration& by) {
  if (!by.horizontal) return std::nullopt;
  const auto [x, y] = by.origin_of(0.0, 0.0);
  const auto [ex, ey] = by.origin_of(1.0, 0.0);
  const auto [nx, ny] = by.origin_of(0.0, 1.0);
  return Origin{ex - x, nx - x, ey - y, ny - y, x, y};
}

/// Moves a layer onto the surface below it.
Result<void> move(Layer& layer, const DemReader& dem, const SiteFrame& site, const NodeGrid& nodes,
                  const Coregistration& by, const RunContext& run) {
  return move(layer, dem, site, nodes, origin_of(by), run,
              [&by](double x, double y) { return by.up_m + by.tilt_east * x + by.tilt_north * y; });
}

std::vector<Seam> seams_of(const Source& source) {
  std::vector<Seam> seams;
  for (std::size_t i = 0; i + 3 < source.seams_m.size(); i += 4)
    seams.push_back(
        {source.seams_m[i], source.seams_m[i + 1], source.seams_m[i + 2], source.seams_m[i + 3]});
  return seams;
}

void report_pose(SourceReport& report, const JointPose& pose) {
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

}  // namespace

Result<void> move_as_reported(Layer& layer, const DemReader& dem, const SiteFrame& site,
                              const NodeGrid& nodes, const SourceReport& report,
                              const Source& source, const RunContext& run) {
  Coregistration by;
  by.east_m = report.shift_east_m;
  by.north_m = report.shift_north_m;
  by.rotation_rad = report.turn_rad;
  by.scale = report.scale;
  by.horizontal =
      by.east_m != 0.0 || by.north_m != 0.0 || by.rotation_rad != 0.0 || by.scale != 1.0;
  JointPose pose;
  pose.east_m = report.shift_east_m;
  pose.north_m = report.shift_north_m;
  pose.up_m = report.shift_up_m;
  pose.tilt_east = report.tilt_east;
  pose.tilt_north = report.tilt_north;
  pose.bow_m = report.bow_per_m;  // its half width is 1 m
  pose.steps_m = report.steps_m;
  std::vector<Seam> seams = seams_of(source);
  seams.resize(std::max(seams.size(), pose.steps_m.size()));
  return move(layer, dem, site, nodes, origin_of(by), run,
              [&](double x, double y) { return pose.raised_m(x, y, seams); });
}

Result<void> align(Layer& layer, SourceReport& report, const Source& source, const DemReader& dem,
                   const SiteFrame& site, const NodeGrid& nodes, const Grid<float>& below,
                   double lower_pixel_m, const RunContext& run) {
  // What is finer than nodes was averaged to them.
  const double lower_m = std::max(lower_pixel_m, nodes.spacing_m);
  const double upper_m = std::max(report.pixel_m, nodes.spacing_m);
  CoregisterOptions options;
  options.height_only = source.align == Source::Align::height;
  options.rotation = options.scale = source.similarity;
  const auto found = coregister(below, layer.z_m, nodes.spacing_m, lower_m, upper_m, options);
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

Result<void> check_datums(const FuseRequest& request, const std::vector<ReadSource>& read,
                          const FusedSurface& surface, const NodeGrid& nodes,
                          const RunContext& run) {
  const double width_m = nodes.spacing_m * static_cast<double>(nodes.cols - 1);
  for (std::size_t i = 1; i < read.size(); ++i) {
    if (std::max(surface.sources[0].pixel_m, surface.sources[i].pixel_m) > width_m) continue;
    const Source& source = request.sources[i];
    const auto doubt =
        datum_doubt(read[0].layer.z_m, read[i].layer.z_m,
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

Result<void> align_jointly(const FuseRequest& request, std::vector<ReadSource>& read,
                           const SiteFrame& site, const NodeGrid& nodes, FusedSurface& surface,
                           const RunContext& run) {
  std::vector<JointSurface> surfaces;
  for (std::size_t i = 0; i < read.size(); ++i) {
    const Source& s = request.sources[i];
    const bool aligned = s.align == Source::Align::automatic || s.align == Source::Align::required;
    surfaces.push_back({&read[i].layer.z_m, std::max(surface.sources[i].pixel_m, nodes.spacing_m),
                        i == 0 || (aligned && !s.similarity), s.bow, seams_of(s)});
  }
  const auto joint = joint_adjustment(surfaces, nodes.spacing_m);
  if (!joint) return {};
  surface.loop_before_px = joint->loop_before_px;
  surface.loop_after_px = joint->loop_after_px;
  surface.loop_sigma_px = joint->loop_sigma_px;
  for (std::size_t i = 0; i < read.size(); ++i) {
    const JointPose& pose = joint->poses[i];
    if (!pose.found || (i == 0 && pose.steps_m.empty())) continue;
    std::optional<Origin> origin;
    if (i > 0) origin = Origin{1.0, 0.0, 0.0, 1.0, -pose.east_m, -pose.north_m};
    MAQUETTE_TRY_VOID(
        move(read[i].layer, read[i].dem, site, nodes, origin, run,
             [&](double x, double y) { return pose.raised_m(x, y, surfaces[i].seams); }));
    read[i].layer.adjusted = i > 0;
    report_pose(surface.sources[i], pose);
    // Against the one that it has most in common with.
    double most = 0.0;
    for (const JointPair& p : joint->pairs) {
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

}  // namespace maquette::heightmap::detail

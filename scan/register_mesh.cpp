// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/register_mesh.hpp"

#include <algorithm>
#include <cmath>

#include <fmt/format.h>

#include "scan/detail/mesh_surface.hpp"
#include "scan/detail/registration_steps.hpp"

namespace maquette::scan {
namespace {

constexpr std::size_t kFine = 300'000;
constexpr std::size_t kSample = 30'000;
constexpr double kMostNoise = 1.0 / 200.0;  // of the diagonal
constexpr double kFromAbove = 0.9;

/// Of the points that lie on the part, do all but a few lie on what is seen from above? Then the
/// search from above has judged them, and nothing can be won on the mesh: low relief of another
/// part lies off by less than kMostNoise.
bool lies_on_top(const std::vector<Vec3>& points, const detail::Pose& pose, double noise_mm,
                 const heightmap::ModelField& top) {
  std::size_t over = 0, above = 0;
  for (const Vec3& p : points) {
    const Vec3 q = pose.point(p);
    const double height = heightmap::height_at(top, q.x, q.y);
    if (std::isnan(height)) continue;
    ++over;
    // Steep ground is missed by its slope times half a node.
    above += q.z > height - 5.0 * noise_mm - top.spacing.value() ? 1U : 0U;
  }
  return static_cast<double>(above) >= kFromAbove * static_cast<double>(over);
}

}  // namespace

Result<Registration> register_mesh(const Cloud& cloud, const MeshDistance& mesh,
                                   const heightmap::ModelField& top, const RegisterOptions& options,
                                   const RunContext& run) {
  const Box3 box = mesh.mesh().bounds();
  const double diagonal = norm(box.max - box.min);
  auto seen_from_above = register_scan(cloud, top, options, run);
  // A cloud a thousand times too small lies on any triangle.
  if (!seen_from_above &&
      (seen_from_above.error().code == kCancelled || seen_from_above.error().code == kUnitSlip))
    return tl::unexpected(seen_from_above.error());
  Registration result;
  detail::Pose start{options.model_from_scan, 1.0};
  double reach = 0.05 * diagonal;
  if (seen_from_above) {
    result = *seen_from_above;
    start = {result.model_from_scan, result.scale};
    reach = std::fmin(reach, std::fmax(20.0 * result.noise_mm, 2.0 * top.spacing.value()));
  }
  const std::vector<Vec3> any_order = detail::sample(cloud.points_mm, kFine);
  std::vector<Vec3> points;  // neighbours look at the same triangles
  for (const std::uint32_t i : near_each_other(any_order)) points.push_back(any_order[i]);
  const std::vector<Vec3> some = detail::sample(cloud.points_mm, kSample);
  const detail::MeshSurface surface(mesh, reach);
  const detail::SmoothMeshSurface smooth(mesh, reach);
  // Below what smooth normals of facets are worth there is no shape.
  const double flat = std::clamp(std::pow(smooth.facet_angle_rad(), 4), 1e-8, 1e-4);
  const detail::Level level{&surface, top.spacing.value(), static_cast<double>(points.size()),
                            flat};
  const detail::Pose settled =
      seen_from_above ? start : detail::settle(some, start, {&surface, reach, 1e9, 1e-8});
  const detail::Met at_start = detail::meet(some, settled, surface);
  const detail::Spread spread = detail::spread_of(at_start);
  if (!seen_from_above && !(detail::robust_scale(at_start) <= kMostNoise * diagonal))
    return tl::unexpected(seen_from_above.error());  // it will not become another part
  if (spread.count < detail::kLeastPoints)
    return seen_from_above ? detail::too_few(spread.count)
                           : tl::unexpected(seen_from_above.error());
  const auto rest =
      detail::come_to_rest(points, some, settled, level, smooth, spread.frame, options, run);
  // On the mesh itself nothing was found either: what the search from above said is clearer.
  if (!rest) return tl::unexpected(seen_from_above ? rest.error() : seen_from_above.error());
  const detail::Met met = detail::meet(some, rest->pose, surface);
  const double noise = std::fmax(detail::kLeastScaleMm, detail::robust_scale(met));
  const auto within = static_cast<double>(
      std::count_if(met.feet.begin(), met.feet.end(),
                    [&](const detail::Foot& f) { return std::abs(f.e_mm) <= 5.0 * noise; }));
  const double overlap = within / static_cast<double>(some.size());
  if (!seen_from_above && lies_on_top(some, rest->pose, noise, top))
    return tl::unexpected(seen_from_above.error());
  if (overlap < options.least_overlap || noise > kMostNoise * diagonal) {
    if (!seen_from_above) return tl::unexpected(seen_from_above.error());
    return fail(kPoorFit,
                fmt::format("at rest on the mesh, but {:.0f} % of the points lie within five times "
                            "a noise of {:.3g} mm: a scan of another part?",
                            100.0 * overlap, noise));
  }
  detail::state(result, points, some, *rest, surface, spread.frame);
  result.noise_mm = noise;
  result.overlap = overlap;
  if (!seen_from_above) result.likeness = 1.0;
  return result;
}

}  // namespace maquette::scan

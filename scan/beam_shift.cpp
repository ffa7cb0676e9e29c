// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/beam_shift.hpp"

#include <algorithm>
#include <array>
#include <atomic>
#include <cmath>
#include <optional>

#include <oneapi/tbb/parallel_for.h>

#include "scan/detail/scan_scene.hpp"
#include "scan/detail/sight.hpp"

namespace maquette::scan {
namespace {

constexpr std::size_t kChunk = 1024;
constexpr std::size_t kMostRays = 64;
constexpr double kSide = 3.0;
// More of the noise than that, beyond a plane, is an edge: few rays err by a fifteenth of it. A
// quarter is in most beams on milled ground, and nothing in ranges tells it from none.
constexpr double kEdgeOfNoise = 1.0;

/// Mean range of the rays minus that of the middle, and the depth in the beam beyond a plane's.
struct Blur {
  double shift_mm = 0.0, depth_mm = 0.0;
};

std::optional<Blur> blur_at(const detail::Sight& sight, const Viewpoint& view,
                            std::span<const detail::BeamSample> samples, std::size_t point,
                            const detail::ScanScene& scene) {
  // The middle goes with the others.
  std::array<detail::Ray, kMostRays> rays;
  std::array<std::optional<heightmap::FieldHit>, kMostRays> ground;
  std::array<std::optional<detail::Echo>, kMostRays> hits;
  const std::size_t n = samples.size();
  detail::spread(sight, view, samples, point, rays);
  rays[n] = {sight.from_mm, sight.direction};
  scene.look(std::span(rays).first(n + 1), std::span(ground).first(n + 1),
             std::span(hits).first(n + 1));
  if (!hits[n]) {
    // Over a crest and beside the part: what came back is the crest's, not what the middle looks
    // at.
    const auto end = hits.begin() + static_cast<std::ptrdiff_t>(n);
    if (std::none_of(hits.begin(), end, [](const auto& hit) { return hit.has_value(); }))
      return std::nullopt;
    return Blur{NAN, 0.0};
  }
  const double middle = hits[n]->range_mm;
  double energy = 0.0, length = 0.0;
  detail::BeamDepth depth;
  for (std::size_t i = 0; i < n; ++i) {
    if (!hits[i]) continue;
    const double t = hits[i]->range_mm - middle;
    const double nearness = middle / hits[i]->range_mm;
    const double answer = samples[i].weight * hits[i]->cos_incidence * nearness * nearness;
    energy += answer;
    length += answer * t;
    depth.add(t, samples[i].x, samples[i].y);
  }
  if (!(energy > 0.0)) return std::nullopt;
  return Blur{length / energy, depth.beyond_plane_mm()};
}

}  // namespace

Result<std::vector<float>> beam_shifts_mm(std::span<const Vec3> points,
                                          std::span<const Viewpoint> views,
                                          const heightmap::ModelField& surface,
                                          std::span<const TriMesh> stones, double noise_mm,
                                          const RunContext& run) {
  std::vector<float> shifts(points.size(), 0.0F);
  MAQUETTE_TRY(const detail::ScanScene scene, detail::ScanScene::build(surface, stones));
  std::atomic<std::size_t> done = 0;
  std::size_t first = 0;
  for (const Viewpoint& view : views) {
    const std::size_t end = std::min(points.size(), first + view.points);
    if (view.beam_diameter_mm > 0.0) {
      const auto samples = detail::rays_of(view), finer = detail::edge_rays_of(view);
      oneapi::tbb::parallel_for(
          std::size_t{0}, (end - first + kChunk - 1) / kChunk, [&](std::size_t k) {
            if (run.stopped()) return;
            const std::size_t from = first + k * kChunk;
            for (std::size_t i = from; i < std::min(end, from + kChunk); ++i) {
              const detail::Sight sight = detail::sight_of(view, points[i]);
              auto blur = blur_at(sight, view, samples, i, scene);
              if (blur && blur->depth_mm > kEdgeOfNoise * noise_mm)
                blur = blur_at(sight, view, finer, i, scene);
              if (!blur) continue;
              // Where the middle itself goes by a steep side, all hangs on where that side stands.
              const double doubt = std::hypot(blur->depth_mm, kSide * blur->shift_mm);
              shifts[i] =
                  detail::kBeamShape * doubt > noise_mm ? NAN : static_cast<float>(blur->shift_mm);
            }
            const std::size_t so_far = done += std::min(end, from + kChunk) - from;
            run.progress(static_cast<double>(so_far) / static_cast<double>(points.size()));
          });
    }
    first = end;
  }
  if (run.stopped()) return fail(kCancelled, "the beam's share of the ranges was not computed");
  return shifts;
}

}  // namespace maquette::scan

// SPDX-License-Identifier: GPL-3.0-or-later
#include "scan/detail/sight.hpp"

#include <cmath>
#include <numbers>

#include "core/random.hpp"

namespace maquette::scan::detail {
namespace {

// Where a point is seen from when nobody says: above every relief.
constexpr double kAboveMm = 1e4;
constexpr std::uint64_t kTurnSeed = 0x5169687;

}  // namespace

Sight sight_of(const Viewpoint& view, Vec3 p) {
  if (!view.station_mm) return {p + Vec3{0.0, 0.0, kAboveMm}, {0.0, 0.0, -1.0}, kAboveMm};
  const Vec3 way = p - *view.station_mm;
  const double range = norm(way);
  return {*view.station_mm, (1.0 / range) * way, range};
}

std::vector<BeamSample> rays_of(const Viewpoint& view) {
  if (!(view.beam_diameter_mm > 0.0)) return beam_samples(1);
  // Gauss-Laguerre in u = 2 (r / w)^2, three rings (Abramowitz and Stegun 1964, table 25.9), each
  // of evenly spaced rays: exact to degree 5, and the hundredth of the energy that is far out is
  // there. It matters beside an edge: a hundredth of 10 mm is what noise is.
  struct Ring {
    double u, energy;
    int rays;
  };
  std::vector<BeamSample> samples;
  for (const Ring& ring :
       {Ring{0.415774556783, 0.711093009929, 6}, Ring{2.294280360279, 0.278517733569, 7},
        Ring{6.289945082937, 0.0103892565016, 6}})
    for (int k = 0; k < ring.rays; ++k) {
      const double angle = 2.0 * std::numbers::pi * k / ring.rays, r = std::sqrt(0.5 * ring.u);
      samples.push_back({r * std::cos(angle), r * std::sin(angle), ring.energy / ring.rays});
    }
  return samples;
}

std::vector<BeamSample> edge_rays_of(const Viewpoint& view) {
  constexpr int kRays = 48;
  return view.beam_diameter_mm > 0.0 ? beam_samples(kRays) : std::vector<BeamSample>{};
}

void BeamDepth::add(double depth_mm, double x, double y) {
  met_ += 1.0;
  sum_ += depth_mm;
  square_ += depth_mm * depth_mm;
  along_x_ += depth_mm * x;
  along_y_ += depth_mm * y;
  x_ += x;
  y_ += y;
  xx_ += x * x;
  xy_ += x * y;
  yy_ += y * y;
}

double BeamDepth::whole_mm() const {
  return met_ > 0.0 ? std::sqrt(std::fmax(0.0, (square_ - sum_ * sum_ / met_) / met_)) : 0.0;
}

double BeamDepth::beyond_plane_mm() const {
  if (!(met_ > 0.0)) return 0.0;
  // Least squares about the mean of those that met something: no pattern is quite even, and a
  // steep plane is many times as deep as what is looked for.
  const double xx = xx_ - x_ * x_ / met_, xy = xy_ - x_ * y_ / met_, yy = yy_ - y_ * y_ / met_;
  const double tx = along_x_ - x_ * sum_ / met_, ty = along_y_ - y_ * sum_ / met_;
  const double det = xx * yy - xy * xy;
  if (!(det > 1e-9 * (xx + yy) * (xx + yy))) return 0.0;
  const double tilt = (yy * tx * tx - 2.0 * xy * tx * ty + xx * ty * ty) / det;
  return std::sqrt(std::fmax(0.0, (square_ - sum_ * sum_ / met_ - tilt) / met_));
}

void spread(const Sight& sight, const Viewpoint& view, std::span<const BeamSample> samples,
            std::uint64_t point, std::span<Ray> rays) {
  const double turn =
      samples.size() > 1 ? 2.0 * std::numbers::pi * random_uniform(kTurnSeed, point) : 0.0;
  for (std::size_t i = 0; i < samples.size(); ++i)
    rays[i] = skew_ray(sight.from_mm, sight.direction, 0.5 * view.beam_diameter_mm, 0.0, samples[i],
                       std::cos(turn), std::sin(turn));
}

}  // namespace maquette::scan::detail

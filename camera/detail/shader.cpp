// SPDX-License-Identifier: GPL-3.0-or-later
#include "camera/detail/shader.hpp"

#include <array>
#include <cmath>

#include "core/check.hpp"
#include "core/random.hpp"

namespace maquette::camera::detail {
namespace {

void add(Bands& sum, const Bands& x, double k) {
  for (std::size_t b = 0; b < 3; ++b) sum[b] += k * x[b];
}

}  // namespace

// Duff et al. 2017, JCGT 6(1), "Building an orthonormal basis, revisited".
std::array<Vec3, 2> across(Vec3 n) {
  const double sign = std::copysign(1.0, n.z);
  const double a = -1.0 / (sign + n.z), b = n.x * n.y * a;
  return {Vec3{1.0 + sign * n.x * n.x * a, sign * b, -sign * n.x},
          Vec3{b, sign + n.y * n.y * a, -n.y}};
}

Shader::Shader(const RayScene& scene, const std::vector<SceneObject>& objects,
               const Lighting& lighting, const RenderOptions& options)
    : scene_(scene),
      objects_(objects),
      lighting_(lighting),
      options_(options),
      lights_(lighting.lamps.begin(), lighting.lamps.end()),
      gathers_(options.gather_samples > 0 && (options.bounce || lighting.surroundings())) {
  const Box3 box = scene.bounds();
  far_mm_ = 2.0 * norm(box.max - box.min) + 1.0;
}

const Material& Shader::material_at(const RayHit& hit) const {
  const SceneObject& object = objects_[hit.object];
  return object.cover == nullptr ? object.material
                                 : object.cover->materials[object.cover->material_of[hit.triangle]];
}

Bands Shader::reflected(const RayHit& hit, const Angles& angles) const {
  const SceneObject& object = objects_[hit.object];
  const Material& material = material_at(hit);
  Bands factor = radiance_factor(material.law, angles);
  const auto paint = [&factor](const Bands& painted) {
    for (std::size_t b = 0; b < 3; ++b) factor[b] *= painted[b];
  };
  if (material.map) paint(material.map->at(hit.point_mm.x, hit.point_mm.y));
  if (object.cover == nullptr) return factor;
  const MeshCover& cover = *object.cover;
  if (const auto& picture = cover.pictures[cover.material_of[hit.triangle]]) {
    const Vec3 at = (1.0 / object.scale) * object.model_from_mesh.inverse().point(hit.point_mm);
    const auto [u, v] = place_in_picture(cover, *object.mesh, hit.triangle, at);
    paint(picture->at(u, v));
  }
  return factor;
}

bool Shader::faces(const Seen& seen, const Light::Arrival& arrival) {
  return dot(arrival.direction, seen.hit->normal) > 0.0 && arrival.strength > 0.0;
}

RayScene::ShadowRay Shader::shadow_ray(const RayHit& hit, const Light::Arrival& arrival) const {
  const double reach = std::isinf(arrival.distance_mm) ? far_mm_ : arrival.distance_mm;
  return {hit.point_mm, hit.normal, hit.point_mm + reach * arrival.direction};
}

Lit Shader::unshadowed(const Seen& seen, const Light& light, const Light::Arrival& arrival) const {
  const RayHit& hit = *seen.hit;
  const double mu = -dot(seen.view, hit.normal), mu0 = dot(arrival.direction, hit.normal);
  Lit lit{{}, true};
  if (!hit.front || mu <= 0.0) return lit;
  lit.radiance = reflected(hit, {mu0, mu, -dot(seen.view, arrival.direction)});
  for (std::size_t b = 0; b < 3; ++b) lit.radiance[b] *= arrival.strength * light.colour()[b];
  return lit;
}

Lit Shader::direct(const Seen& seen, const Light& light) const {
  const Light::Arrival arrival = light.arrive(seen.hit->point_mm, seen.lens);
  if (!faces(seen, arrival) || scene_.blocked(shadow_ray(*seen.hit, arrival))) return {};
  return unshadowed(seen, light, arrival);
}

void Shader::direct(std::span<const Seen> seen, const Light& light, std::span<Lit> lit) const {
  constexpr std::size_t kMost = 16;
  MAQUETTE_CHECK(seen.size() <= kMost && lit.size() == seen.size(), "{} places, {} answers",
                 seen.size(), lit.size());
  std::array<Vec3, kMost> places;
  std::array<DiscPoint, kMost> lens;
  std::array<Light::Arrival, kMost> arrivals;
  std::array<RayScene::ShadowRay, kMost> rays;
  std::array<std::size_t, kMost> of;
  std::array<bool, kMost> blocked;
  std::size_t n = 0;
  for (std::size_t i = 0; i < seen.size(); ++i)
    places[i] = seen[i].hit->point_mm, lens[i] = seen[i].lens;
  light.arrive({places.data(), seen.size()}, {lens.data(), seen.size()},
               {arrivals.data(), seen.size()});
  for (std::size_t i = 0; i < seen.size(); ++i) {
    lit[i] = {};
    if (!faces(seen[i], arrivals[i])) continue;
    of[n] = i;
    rays[n++] = shadow_ray(*seen[i].hit, arrivals[i]);
  }
  scene_.blocked({rays.data(), n}, {blocked.data(), n});
  for (std::size_t k = 0; k < n; ++k)
    if (!blocked[k]) lit[of[k]] = unshadowed(seen[of[k]], light, arrivals[of[k]]);
}

Bands Shader::background(Vec3 origin_mm, Vec3 direction) const {
  Bands radiance = lighting_.ambient;
  double nearest = std::numeric_limits<double>::infinity();
  for (const Panel& panel : lighting_.panels) {
    const Vec3 n = cross(panel.side_a_mm, panel.side_b_mm);
    const double along = dot(direction, n);
    if (along == 0.0) continue;
    const double t = dot(panel.corner_mm - origin_mm, n) / along;
    if (t <= 0.0 || t >= nearest) continue;
    const Vec3 at = origin_mm + t * direction - panel.corner_mm;
    const double area = dot(n, n);
    const double a = dot(cross(at, panel.side_b_mm), n) / area;
    const double b = dot(cross(panel.side_a_mm, at), n) / area;
    if (a < 0.0 || a > 1.0 || b < 0.0 || b > 1.0) continue;
    nearest = t;
    radiance = panel.radiance;
  }
  return radiance;
}

/// What arrives along a ray that leaves a surface.
Bands Shader::incoming(const RayHit& from, Vec3 direction, std::uint64_t stream) const {
  const Vec3 start = from.point_mm + scene_.offset_mm() * from.normal;
  const auto hit = scene_.first_hit(start, direction);
  if (!hit) return background(start, direction);
  Bands sum{};
  if (!options_.bounce || !hit->front) return sum;
  for (std::size_t i = 0; i < lights_.size(); ++i) {
    const DiscPoint p = lights_[i].extended() ? concentric_disc(random_uniform(stream, 2 * i),
                                                                random_uniform(stream, 2 * i + 1))
                                              : DiscPoint{};
    add(sum, direct({&*hit, direction, p}, lights_[i]).radiance, 1.0);
  }
  return sum;
}

Bands Shader::gathered(const RayHit& hit, Vec3 view, const std::vector<DiscPoint>& directions,
                       std::uint64_t stream) const {
  const double mu = -dot(view, hit.normal);
  if (!hit.front || mu <= 0.0) return {};
  const auto side = across(hit.normal);
  const auto* foil = std::get_if<Ggx>(&material_at(hit).law);
  const bool facets = foil != nullptr && foil->alpha < 0.4;
  Bands sum{};
  for (std::size_t i = 0; i < directions.size(); ++i) {
    const DiscPoint p = directions[i];
    const double square = p.x * p.x + p.y * p.y;
    Vec3 way;
    double weight = 0.0;
    if (facets) {
      // A facet drawn with its area: tan^2 = alpha^2 u / (1 - u) with u = r^2 (Walter et al. 2007,
      // equation 35), and the light that it sends to the camera.
      const double tan2 = foil->alpha * foil->alpha * square / std::max(1.0 - square, 1e-12);
      const double cosine = 1.0 / std::sqrt(1.0 + tan2);
      const double sine = std::sqrt(std::max(0.0, 1.0 - cosine * cosine));
      const double r = square > 0.0 ? sine / std::sqrt(square) : 0.0;
      const Vec3 facet = r * p.x * side[0] + r * p.y * side[1] + cosine * hit.normal;
      const double half = -dot(view, facet);
      if (half <= 0.0) continue;
      way = view + 2.0 * half * facet;
      const double a2 = foil->alpha * foil->alpha, q = cosine * cosine * (a2 - 1.0) + 1.0;
      // Density over directions: D cos / (4 half); radiance = f mu0 L = RADF L / pi.
      weight = 4.0 * half * q * q / (a2 * cosine);
    } else {
      way = p.x * side[0] + p.y * side[1] + std::sqrt(std::max(0.0, 1.0 - square)) * hit.normal;
    }
    const double mu0 = dot(way, hit.normal);
    if (mu0 <= 1e-6) continue;
    if (!facets) weight = 1.0 / mu0;  // density mu0 / pi
    const Bands arriving = incoming(hit, way, random_bits(stream, i));
    if (arriving == Bands{}) continue;
    const Bands factor = reflected(hit, {mu0, mu, -dot(view, way)});
    for (std::size_t b = 0; b < 3; ++b) sum[b] += weight * factor[b] * arriving[b];
  }
  for (double& s : sum) s /= static_cast<double>(directions.size());
  return sum;
}

}  // namespace maquette::camera::detail

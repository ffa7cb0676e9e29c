// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <optional>
#include <string>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/check.hpp"
#include "core/random.hpp"
#include "meshing/stones.hpp"

namespace maquette::meshing {
namespace {

enum Stream : std::uint64_t { kSizes = 1, kShapes = 2, kInner = 3, kPositions = 4, kCatalogue = 5 };
constexpr std::uint64_t kTriesPerStone = 20000;

/// Distance of the farthest vertex from the origin, for diameter 1.
double circumscribed_radius(const assets::RockShape& shape) {
  double reach = 0.0;
  for (const Vec3& v : assets::make_rock(shape).vertices_mm) reach = std::fmax(reach, norm(v));
  return reach;
}

assets::RockShape draw_shape(std::uint64_t seed, std::uint64_t i) {
  const std::uint64_t stream = random_bits(seed, kShapes);
  const auto between = [&](std::uint64_t draw, double low, double high) {
    return low + (high - low) * random_uniform(stream, 8 * i + draw);
  };
  return {.angularity = between(0, 0.35, 0.9),
          .flatness = between(1, 0.55, 0.9),
          .elongation = between(2, 0.65, 0.95),
          .roughness = between(3, 0.015, 0.05),
          .seed = random_bits(stream, 8 * i + 4)};
}

/// The nearest, by ratio, of `steps` sizes from min to max; of one step, the one between them.
double catalogue_size(double diameter_m, const SitePlanRequest& request) {
  const double low = std::log(request.min_diameter.value());
  const double range = std::log(request.max_diameter.value()) - low;
  if (request.sizes == 1) return std::exp(low + 0.5 * range);
  const double step = range / (request.sizes - 1);
  return std::exp(low + step * std::round((std::log(diameter_m) - low) / step));
}

/// Which of the stones lie inside: those with the smallest random keys.
std::vector<bool> choose_inner(std::size_t count, std::size_t inner, std::uint64_t seed) {
  const std::uint64_t stream = random_bits(seed, kInner);
  std::vector<std::size_t> order(count);
  for (std::size_t i = 0; i < count; ++i) order[i] = i;
  std::sort(order.begin(), order.end(), [&](std::size_t a, std::size_t b) {
    return random_bits(stream, a) < random_bits(stream, b);
  });
  std::vector<bool> is_inner(count, false);
  for (std::size_t i = 0; i < inner; ++i) is_inner[order[i]] = true;
  return is_inner;
}

/// A square around the site's centre, with or without a square hole.
struct Region {
  double outer_m = 0.0;
  double hole_m = 0.0;  ///< 0: none
};

struct Disc {
  double east_m, north_m, radius_m;
};

std::optional<Disc> find_place(const Region& region, double radius_m,
                               const std::vector<Disc>& taken, std::uint64_t stream) {
  for (std::uint64_t i = 0; i < kTriesPerStone; ++i) {
    const Disc d{region.outer_m * (2.0 * random_uniform(stream, 2 * i) - 1.0),
                 region.outer_m * (2.0 * random_uniform(stream, 2 * i + 1) - 1.0), radius_m};
    if (std::fmax(std::abs(d.east_m), std::abs(d.north_m)) < region.hole_m) continue;
    const bool overlaps = std::any_of(taken.begin(), taken.end(), [&](const Disc& t) {
      return std::hypot(t.east_m - d.east_m, t.north_m - d.north_m) <= t.radius_m + d.radius_m;
    });
    if (!overlaps) return d;
  }
  return std::nullopt;
}

}  // namespace

Result<std::vector<SiteStone>> plan_stones(const SitePlanRequest& request) {
  MAQUETTE_CHECK(request.count >= 0, "{}", request.count);
  MAQUETTE_CHECK(request.inner_share >= 0.0 && request.inner_share <= 1.0, "{}",
                 request.inner_share);
  const double half_m = request.half_width.value();
  const double inner_half_m = request.inner_half_width.value();
  MAQUETTE_CHECK(half_m >= 0.0 && inner_half_m >= 0.0, "{}, {}", half_m, inner_half_m);

  MAQUETTE_CHECK(request.shapes >= 0 && request.sizes >= 0, "{}, {}", request.shapes,
                 request.sizes);
  auto diameters =
      assets::draw_rock_diameters(request.count, request.k, request.min_diameter,
                                  request.max_diameter, random_bits(request.seed, kSizes));
  if (request.sizes > 0)
    for (Metres& d : diameters) d = Metres{catalogue_size(d.value(), request)};
  const std::uint64_t catalogue = random_bits(request.seed, kCatalogue);
  const auto shape_of = [&](std::size_t i) -> std::uint64_t {
    return request.shapes > 0
               ? random_bits(catalogue, i) % static_cast<std::uint64_t>(request.shapes)
               : i;
  };
  const std::size_t count = diameters.size();
  // 0.1 of 30 is a hair above 3 in double and must not become 4.
  const double share = std::ceil(request.inner_share * request.count - 1e-9);
  const auto inner = inner_half_m > 0.0 ? static_cast<std::size_t>(std::fmax(share, 0.0)) : 0u;
  const std::vector<bool> is_inner = choose_inner(count, inner, request.seed);

  std::vector<SiteStone> stones(count);
  std::vector<double> radius_m(count);
  tbb::parallel_for(std::size_t{0}, count, [&](std::size_t i) {
    stones[i] = {.number = static_cast<int>(i + 1),
                 .shape = draw_shape(request.seed, shape_of(i)),
                 .diameter = diameters[i],
                 .heading = Radians{2.0 * std::numbers::pi *
                                    random_uniform(random_bits(request.seed, kShapes), 8 * i + 5)}};
    radius_m[i] = diameters[i].value() * circumscribed_radius(stones[i].shape);
  });

  std::vector<Disc> taken;
  for (std::size_t i = 0; i < count; ++i) {
    const double d = diameters[i].value();
    const double square_m = is_inner[i] ? std::fmin(inner_half_m, half_m) : half_m;
    if (!(square_m - d > 0.0))
      return fail(kStoneLargerThanSite,
                  fmt::format("stone {} has a diameter of {:.3f} m and must keep it from the "
                              "border of the {} of half width {} m; choose smaller stones",
                              i + 1, d, is_inner[i] ? "inner square" : "site", square_m));
    const Region region{.outer_m = square_m - d,
                        .hole_m = is_inner[i] || inner_half_m <= 0.0 ? 0.0 : inner_half_m + d};
    const std::uint64_t stream = random_bits(random_bits(request.seed, kPositions), i);
    const auto place = find_place(region, radius_m[i], taken, stream);
    if (!place)
      return fail(kStonesDoNotFit,
                  fmt::format("{} of {} stones fit without overlap; choose fewer or smaller ones",
                              i, count));
    taken.push_back(*place);
    stones[i].east_m = place->east_m;
    stones[i].north_m = place->north_m;
  }
  return stones;
}

}  // namespace maquette::meshing

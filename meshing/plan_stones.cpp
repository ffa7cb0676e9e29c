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

enum Stream : std::uint64_t {
  kSizes = 1,
  kShapes = 2,
  kInner = 3,
  kPositions = 4,
  kCatalogue = 5,
  kOwn = 6
};
constexpr std::uint64_t kTriesPerStone = 20000;

/// Distance of the farthest vertex from the origin, for diameter 1.
double circumscribed_radius(const SiteStone& stone) {
  double reach = 0.0;
  for (const Vec3& v : unit_stone(stone.shape, stone.body).vertices_mm)
    reach = std::fmax(reach, norm(v));
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

/// 0.1 of 30 is a hair above 3 in double and must not become 4.
std::size_t inner_count(const SitePlanRequest& request, std::size_t count) {
  if (request.inner_half_width.value() <= 0.0) return 0;
  const double share = std::ceil(request.inner_share * static_cast<double>(count) - 1e-9);
  return static_cast<std::size_t>(std::fmax(share, 0.0));
}

/// Numbers, shapes, sizes and headings; no places yet.
std::vector<SiteStone> draw_stones(const SitePlanRequest& request) {
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
  std::vector<SiteStone> stones;
  for (std::size_t i = 0; i < diameters.size(); ++i) {
    SiteStone stone;
    stone.number = static_cast<int>(i + 1);
    stone.shape = draw_shape(request.seed, shape_of(i));
    stone.diameter = diameters[i];
    stone.heading = Radians{2.0 * std::numbers::pi *
                            random_uniform(random_bits(request.seed, kShapes), 8 * i + 5)};
    stones.push_back(std::move(stone));
  }
  return stones;
}

/// Appends the stones of files; `is_placed` says of each stone whether it has a place already.
void add_own_stones(const SitePlanRequest& request, std::vector<SiteStone>& stones,
                    std::vector<bool>& is_placed) {
  const std::uint64_t stream = random_bits(request.seed, kOwn);
  std::uint64_t draw = 0;
  for (const OwnStones& own : request.own) {
    MAQUETTE_CHECK(own.body != nullptr && own.diameter.value() > 0.0 && own.count >= 0, "{}, {}",
                   own.diameter.value(), own.count);
    const std::size_t all = own.places.size() + static_cast<std::size_t>(own.count);
    for (std::size_t i = 0; i < all; ++i, ++draw) {
      SiteStone stone;
      stone.number = static_cast<int>(stones.size() + 1);
      stone.body = own.body;
      stone.diameter = own.diameter;
      stone.heading = Radians{std::isnan(own.heading_rad)
                                  ? 2.0 * std::numbers::pi * random_uniform(stream, draw)
                                  : own.heading_rad};
      const bool told = i < own.places.size();
      if (told) stone.east_m = own.places[i].east_m, stone.north_m = own.places[i].north_m;
      stones.push_back(std::move(stone));
      is_placed.push_back(told);
    }
  }
}

std::string name_of(const SiteStone& stone) {
  return stone.body == nullptr ? fmt::format("stone {}", stone.number)
                               : fmt::format("stone {} ({})", stone.number, stone.body->source);
}

/// Stones that lie where the user says: on the site, and apart.
Result<void> check_told_places(const std::vector<SiteStone>& stones,
                               const std::vector<bool>& is_placed,
                               const std::vector<double>& radius_m, double half_m,
                               std::vector<Disc>& taken) {
  std::vector<const SiteStone*> before;
  for (std::size_t i = 0; i < stones.size(); ++i) {
    if (!is_placed[i]) continue;
    const SiteStone& s = stones[i];
    const Disc d{s.east_m, s.north_m, radius_m[i]};
    if (!(std::fmax(std::abs(d.east_m), std::abs(d.north_m)) + d.radius_m <= half_m))
      return fail(kStoneLargerThanSite,
                  fmt::format("{} with a radius of {:.3f} m at east {} m north {} m reaches beyond "
                              "the site of half width {} m; choose a smaller one or another place",
                              name_of(s), d.radius_m, d.east_m, d.north_m, half_m));
    for (std::size_t k = 0; k < taken.size(); ++k)
      if (std::hypot(taken[k].east_m - d.east_m, taken[k].north_m - d.north_m) <=
          taken[k].radius_m + d.radius_m)
        return fail(kStonesDoNotFit,
                    fmt::format("{} at east {} m north {} m and {} at east {} m north {} m overlap "
                                "(radii {:.3f} and {:.3f} m); move one of them",
                                name_of(*before[k]), taken[k].east_m, taken[k].north_m, name_of(s),
                                d.east_m, d.north_m, taken[k].radius_m, d.radius_m));
    taken.push_back(d);
    before.push_back(&s);
  }
  return {};
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

  std::vector<SiteStone> stones = draw_stones(request);
  const std::size_t drawn = stones.size();
  std::vector<bool> is_inner = choose_inner(drawn, inner_count(request, drawn), request.seed);
  std::vector<bool> is_placed(drawn, false);
  add_own_stones(request, stones, is_placed);
  const std::size_t own_free = static_cast<std::size_t>(
      std::count(is_placed.begin() + static_cast<std::ptrdiff_t>(drawn), is_placed.end(), false));
  const std::vector<bool> own_inner =
      choose_inner(own_free, inner_count(request, own_free), random_bits(request.seed, kOwn));
  for (std::size_t i = drawn, k = 0; i < stones.size(); ++i)
    is_inner.push_back(!is_placed[i] && own_inner[k++]);

  std::vector<double> radius_m(stones.size());
  tbb::parallel_for(std::size_t{0}, stones.size(), [&](std::size_t i) {
    radius_m[i] = stones[i].diameter.value() * circumscribed_radius(stones[i]);
  });

  std::vector<Disc> taken;
  MAQUETTE_TRY_VOID(check_told_places(stones, is_placed, radius_m, half_m, taken));
  for (std::size_t i = 0; i < stones.size(); ++i) {
    if (is_placed[i]) continue;
    const double d = stones[i].diameter.value();
    const double square_m = is_inner[i] ? std::fmin(inner_half_m, half_m) : half_m;
    if (!(square_m - d > 0.0))
      return fail(
          kStoneLargerThanSite,
          fmt::format("{} has a diameter of {:.3f} m and must keep it from the "
                      "border of the {} of half width {} m; choose smaller stones",
                      name_of(stones[i]), d, is_inner[i] ? "inner square" : "site", square_m));
    const Region region{.outer_m = square_m - d,
                        .hole_m = is_inner[i] || inner_half_m <= 0.0 ? 0.0 : inner_half_m + d};
    const std::uint64_t stream = random_bits(random_bits(request.seed, kPositions), i);
    const auto place = find_place(region, radius_m[i], taken, stream);
    if (!place)
      return fail(kStonesDoNotFit,
                  fmt::format("{} of {} stones fit without overlap; choose fewer or smaller ones",
                              taken.size(), stones.size()));
    taken.push_back(*place);
    stones[i].east_m = place->east_m;
    stones[i].north_m = place->north_m;
  }
  return stones;
}

}  // namespace maquette::meshing

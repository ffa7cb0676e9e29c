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
  kOwn = 6,
  kOtherPlaces = 7,
  kThinning = 8
};
constexpr std::uint64_t kTriesPerStone = 20000;

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

/// A square around the site's centre, with or without a square hole, and how dense stones lie in
/// it.
struct Region {
  double outer_m = 0.0;
  double hole_m = 0.0;                                             ///< 0: none
  const std::function<double(double, double)>* density = nullptr;  ///< none: 1
};

/// Where the centre of a drawn stone may lie.
Region region_of(const SitePlanRequest& request, const SiteStone& stone) {
  const double half_m = request.half_width.value();
  const double inner_half_m = request.inner_half_width.value();
  const double d = stone.diameter.value();
  return {.outer_m = (stone.is_inner ? std::fmin(inner_half_m, half_m) : half_m) - d,
          .hole_m = stone.is_inner || inner_half_m <= 0.0 ? 0.0 : inner_half_m + d,
          .density = request.density ? &request.density : nullptr};
}

bool contains(const Region& region, double east_m, double north_m) {
  const double from_centre = std::fmax(std::abs(east_m), std::abs(north_m));
  return from_centre <= region.outer_m && from_centre >= region.hole_m;
}

/// One try; nothing if the place is not within the region, or is thinned out.
std::optional<StonePlace> draw_place(const Region& region, std::uint64_t stream, std::uint64_t i) {
  const StonePlace p{region.outer_m * (2.0 * random_uniform(stream, 2 * i) - 1.0),
                     region.outer_m * (2.0 * random_uniform(stream, 2 * i + 1) - 1.0)};
  if (!contains(region, p.east_m, p.north_m)) return std::nullopt;
  if (region.density != nullptr &&
      random_uniform(random_bits(stream, kThinning), i) >= (*region.density)(p.east_m, p.north_m))
    return std::nullopt;
  return p;
}

std::optional<StoneDisc> find_place(const Region& region, double radius_m,
                                    const std::vector<StoneDisc>& taken, std::uint64_t stream) {
  for (std::uint64_t i = 0; i < kTriesPerStone; ++i) {
    const auto place = draw_place(region, stream, i);
    if (!place) continue;
    const StoneDisc d{place->east_m, place->north_m, radius_m};
    if (std::none_of(taken.begin(), taken.end(), [&](const StoneDisc& t) { return overlap(t, d); }))
      return d;
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
    if (request.angularity) stone.shape.angularity = *request.angularity;
    stone.diameter = diameters[i];
    stone.heading = Radians{2.0 * std::numbers::pi *
                            random_uniform(random_bits(request.seed, kShapes), 8 * i + 5)};
    stones.push_back(std::move(stone));
  }
  return stones;
}

/// Appends the stones of files.
void add_own_stones(const SitePlanRequest& request, std::vector<SiteStone>& stones) {
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
      stone.has_place = i < own.places.size();
      if (stone.has_place)
        stone.east_m = own.places[i].east_m, stone.north_m = own.places[i].north_m;
      stones.push_back(std::move(stone));
    }
  }
}

std::string name_of(const SiteStone& stone) {
  return stone.body == nullptr ? fmt::format("stone {}", stone.number)
                               : fmt::format("stone {} ({})", stone.number, stone.body->source);
}

/// Stones that lie where the user says: on the site, and apart.
Result<void> check_told_places(const std::vector<SiteStone>& stones,
                               const std::vector<double>& radius_m, double half_m,
                               std::vector<StoneDisc>& taken) {
  std::vector<const SiteStone*> before;
  for (std::size_t i = 0; i < stones.size(); ++i) {
    const SiteStone& s = stones[i];
    if (!s.has_place) continue;
    const StoneDisc d{s.east_m, s.north_m, radius_m[i]};
    if (!(std::fmax(std::abs(d.east_m), std::abs(d.north_m)) + d.radius_m <= half_m))
      return fail(kStoneLargerThanSite,
                  fmt::format("{} with a radius of {:.3f} m at east {} m north {} m reaches beyond "
                              "the site of half width {} m; choose a smaller one or another place",
                              name_of(s), d.radius_m, d.east_m, d.north_m, half_m));
    for (std::size_t k = 0; k < taken.size(); ++k)
      if (overlap(taken[k], d))
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

double circumscribed_radius(const SiteStone& stone) {
  double reach = 0.0;
  for (const Vec3& v : unit_stone(stone.shape, stone.body).vertices_mm)
    reach = std::fmax(reach, norm(v));
  return reach;
}

bool keeps_to_its_square(const SitePlanRequest& request, const SiteStone& stone, double east_m,
                         double north_m) {
  if (!stone.has_place) return contains(region_of(request, stone), east_m, north_m);
  return contains({.outer_m = request.half_width.value(), .hole_m = 0.0}, east_m, north_m);
}

std::optional<StonePlace> draw_other_place(const SitePlanRequest& request, const SiteStone& stone,
                                           std::uint64_t attempt) {
  const std::uint64_t stream = random_bits(random_bits(request.seed, kOtherPlaces),
                                           static_cast<std::uint64_t>(stone.number));
  return draw_place(region_of(request, stone), stream, attempt);
}

Result<std::vector<SiteStone>> plan_stones(const SitePlanRequest& request) {
  MAQUETTE_CHECK(request.count >= 0, "{}", request.count);
  MAQUETTE_CHECK(request.inner_share >= 0.0 && request.inner_share <= 1.0, "{}",
                 request.inner_share);
  const double half_m = request.half_width.value();
  MAQUETTE_CHECK(half_m >= 0.0 && request.inner_half_width.value() >= 0.0, "{}, {}", half_m,
                 request.inner_half_width.value());
  MAQUETTE_CHECK(request.shapes >= 0 && request.sizes >= 0, "{}, {}", request.shapes,
                 request.sizes);

  std::vector<SiteStone> stones = draw_stones(request);
  const std::size_t drawn = stones.size();
  const std::vector<bool> drawn_inner =
      choose_inner(drawn, inner_count(request, drawn), request.seed);
  for (std::size_t i = 0; i < drawn; ++i) stones[i].is_inner = drawn_inner[i];
  add_own_stones(request, stones);
  const auto own_free = static_cast<std::size_t>(
      std::count_if(stones.begin() + static_cast<std::ptrdiff_t>(drawn), stones.end(),
                    [](const SiteStone& s) { return !s.has_place; }));
  const std::vector<bool> own_inner =
      choose_inner(own_free, inner_count(request, own_free), random_bits(request.seed, kOwn));
  for (std::size_t i = drawn, k = 0; i < stones.size(); ++i)
    if (!stones[i].has_place) stones[i].is_inner = own_inner[k++];

  std::vector<double> radius_m(stones.size());
  tbb::parallel_for(std::size_t{0}, stones.size(), [&](std::size_t i) {
    radius_m[i] = stones[i].diameter.value() * circumscribed_radius(stones[i]);
  });

  std::vector<StoneDisc> taken;
  MAQUETTE_TRY_VOID(check_told_places(stones, radius_m, half_m, taken));
  for (std::size_t i = 0; i < stones.size(); ++i) {
    if (stones[i].has_place) continue;
    const double d = stones[i].diameter.value();
    const Region region = region_of(request, stones[i]);
    if (!(region.outer_m > 0.0))
      return fail(kStoneLargerThanSite,
                  fmt::format("{} has a diameter of {:.3f} m and must keep it from the "
                              "border of the {} of half width {} m; choose smaller stones",
                              name_of(stones[i]), d, stones[i].is_inner ? "inner square" : "site",
                              region.outer_m + d));
    const std::uint64_t stream = random_bits(random_bits(request.seed, kPositions), i);
    const auto place = find_place(region, radius_m[i], taken, stream);
    if (!place)
      return fail(
          kStonesDoNotFit,
          fmt::format(
              "{} of {} stones fit without overlap; choose fewer or smaller ones{}", taken.size(),
              stones.size(),
              request.density ? ", or a density that is not so small in their square" : ""));
    taken.push_back(*place);
    stones[i].east_m = place->east_m;
    stones[i].north_m = place->north_m;
  }
  return stones;
}

}  // namespace maquette::meshing

// SPDX-License-Identifier: GPL-3.0-or-later
#include "meshing/settle_stones.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <memory>
#include <numbers>
#include <optional>
#include <string>
#include <utility>

#include <fmt/format.h>
#include <oneapi/tbb/parallel_for.h>

#include "core/check.hpp"
#include "core/random.hpp"
#include "meshing/detail/roll_stone.hpp"

namespace maquette::meshing {
namespace {

using detail::RollEnd;

/// Tries of draw_other_place until one is within the stone's square.
constexpr std::uint64_t kTriesPerPlace = 20000;
constexpr double kSlideStep = 0.25;  // diameters

double in_degrees(double rad) {
  return rad * 180.0 / std::numbers::pi;
}

/// Where a stone came to lie, or why it did not.
struct Rest {
  RollEnd end = RollEnd::leaves;
  PlacedStone stone;  ///< not sunk yet
  double east_m = 0.0, north_m = 0.0;
  double slope_rad = 0.0;
  double downhill_east = 0.0, downhill_north = 0.0;  ///< unit
};

/// All that is the same for every place of one stone.
class Settler {
 public:
  Settler(const SiteStone& stone, const SitePlanRequest& request, const StoneGround& ground,
          const SettleOptions& options)
      : stone_(stone), request_(request), ground_(ground), options_(options) {
    made_ = stone.body;
    if (made_ == nullptr) {
      StoneBody drawn;
      drawn.mesh = unit_stone(stone.shape, nullptr);
      made_ = std::make_shared<const StoneBody>(std::move(drawn));
    }
    body_ = made_->mesh;
    for (const Vec3& v : body_.vertices_mm) radius_m_ = std::fmax(radius_m_, norm(v));
    radius_m_ *= stone.diameter.value();
    const double scale_mm = ground.scale.horizontal(stone.diameter).value();
    for (Vec3& v : body_.vertices_mm) v = scale_mm * v;
  }

  [[nodiscard]] bool is_planned_here() const {
    const ModelScale& scale = ground_.scale;
    return !std::isnan(heightmap::height_at(
        ground_.surface, scale.horizontal(Metres{stone_.east_m - ground_.east_of_x0_m}).value(),
        scale.horizontal(Metres{stone_.north_m - ground_.north_of_y0_m}).value()));
  }

  [[nodiscard]] Rest drop_at(double east_m, double north_m) const {
    Rest rest;
    const auto laid = lay_at(east_m, north_m);
    if (!laid) return rest;
    rest.stone = *laid;
    const double farthest_mm = options_.farthest * laid->scale_mm;
    rest.end = detail::roll_stone(body_, ground_.surface, farthest_mm, random_bits_of_number(),
                                  rest.stone.model_from_stone);
    const Vec3 at = rest.stone.model_from_stone.translation_mm;
    rest.east_m =
        ground_.east_of_x0_m + ground_.scale.unscale_horizontal(Millimetres{at.x}).value();
    rest.north_m =
        ground_.north_of_y0_m + ground_.scale.unscale_horizontal(Millimetres{at.y}).value();
    if (rest.end != RollEnd::rests) return rest;
    const auto under = lay_at(rest.east_m, rest.north_m);
    if (!under) {
      rest.end = RollEnd::leaves;
      return rest;
    }
    const Vec3 normal = under->model_from_stone.direction({0, 0, 1});
    const double across = std::hypot(normal.x, normal.y);
    rest.slope_rad = std::atan2(across, normal.z);
    if (across > 0.0)
      rest.downhill_east = normal.x / across, rest.downhill_north = normal.y / across;
    return rest;
  }

  [[nodiscard]] bool slides(const Rest& rest) const {
    return rest.end == RollEnd::rests && rest.slope_rad > options_.repose.value();
  }
  [[nodiscard]] StoneDisc disc(const Rest& rest) const {
    return {rest.east_m, rest.north_m, radius_m_};
  }
  [[nodiscard]] bool does(const Rest& rest, const std::vector<StoneDisc>& taken) const {
    return rest.end == RollEnd::rests && !slides(rest) &&
           keeps_to_its_square(request_, stone_, rest.east_m, rest.north_m) &&
           std::none_of(taken.begin(), taken.end(),
                        [&](const StoneDisc& t) { return overlap(t, disc(rest)); });
  }

  /// Down the slope until it lies; the last rest if it does not.
  [[nodiscard]] Rest slide(Rest rest, const std::vector<StoneDisc>& taken) const {
    const double step_m = kSlideStep * stone_.diameter.value();
    while (slides(rest) && distance_m(rest) < options_.farthest * stone_.diameter.value()) {
      const Rest next = drop_at(rest.east_m + step_m * rest.downhill_east,
                                rest.north_m + step_m * rest.downhill_north);
      if (next.end != RollEnd::rests) break;
      rest = next;
      if (does(rest, taken)) break;
    }
    return rest;
  }
  [[nodiscard]] double distance_m(const Rest& rest) const {
    return std::hypot(rest.east_m - stone_.east_m, rest.north_m - stone_.north_m);
  }

  [[nodiscard]] PlacedStone sunk(PlacedStone placed) const {
    double low = INFINITY, high = -INFINITY;
    Vec3 lowest;
    for (const Vec3& v : body_.vertices_mm) {
      const Vec3 p = placed.model_from_stone.point(v);
      if (p.z < low) low = p.z, lowest = p;
      high = std::fmax(high, p.z);
    }
    const double depth = options_.embedded_share * (high - low);
    placed.model_from_stone.translation_mm.z -= depth;
    placed.embedded_depth_mm =
        heightmap::height_at(ground_.surface, lowest.x, lowest.y) - (lowest.z - depth);
    return placed;
  }

  /// @param first  of the place that the plan has
  [[nodiscard]] Result<std::optional<Rest>> find_rest(const Rest& first,
                                                      const std::vector<StoneDisc>& taken,
                                                      const RunContext& run) const {
    if (stone_.has_place) return rest_of_told(first, taken);
    if (does(first, taken)) return first;
    if (slides(first))
      if (Rest slid = slide(first, taken); does(slid, taken)) return slid;
    int tried = 0, too_steep = slides(first) ? 1 : 0;
    std::uint64_t attempt = 0;
    for (; tried < options_.other_places; ++tried) {
      if (run.stopped()) return fail(kCancelled, "cancelled");
      std::optional<StonePlace> place;
      for (const std::uint64_t end = attempt + kTriesPerPlace; !place && attempt < end; ++attempt)
        place = draw_other_place(request_, stone_, attempt);
      if (!place) break;
      const Rest rest = drop_at(place->east_m, place->north_m);
      if (does(rest, taken)) return rest;
      if (slides(rest)) ++too_steep;
    }
    const bool steep = 2 * too_steep > tried;
    return fail(
        steep ? kStoneSlides : kStoneDoesNotRest,
        fmt::format("{} lies in none of {} places: {}, and {} of them are steeper than the "
                    "angle of repose of {:g} degrees; fewer or smaller stones, or a larger "
                    "stones.repose_deg, may help, stones.rest = \"fitted\" always does",
                    name(), tried + 1, why(first), too_steep, in_degrees(options_.repose.value())));
  }

 private:
  [[nodiscard]] std::uint64_t random_bits_of_number() const {
    return random_bits(options_.seed, static_cast<std::uint64_t>(stone_.number));
  }

  [[nodiscard]] std::optional<PlacedStone> lay_at(double east_m, double north_m) const {
    SiteStone there = stone_;
    there.body = made_;
    there.east_m = east_m;
    there.north_m = north_m;
    auto laid = lay_stones({&there, 1}, ground_.surface, ground_.scale, ground_.east_of_x0_m,
                           ground_.north_of_y0_m, 0.0);
    if (laid.empty()) return std::nullopt;
    laid[0].body = stone_.body;
    return std::move(laid[0]);
  }

  /// Where the user wants a stone, or not at all.
  [[nodiscard]] Result<std::optional<Rest>> rest_of_told(
      const Rest& rest, const std::vector<StoneDisc>& taken) const {
    if (rest.end == RollEnd::leaves) return std::optional<Rest>{};
    if (does(rest, taken) && distance_m(rest) <= stone_.diameter.value()) return rest;
    return fail(
        slides(rest) ? kStoneSlides : kStoneDoesNotRest,
        fmt::format("{} does not stay at east {:g} m north {:g} m, where it is told to lie: "
                    "{}; choose another place or heading",
                    name(), stone_.east_m, stone_.north_m, why(rest)));
  }

  [[nodiscard]] std::string name() const {
    return stone_.body == nullptr
               ? fmt::format("stone {}", stone_.number)
               : fmt::format("stone {} ({})", stone_.number, stone_.body->source);
  }
  [[nodiscard]] std::string why(const Rest& rest) const {
    const std::string where =
        fmt::format("at east {:.3f} m north {:.3f} m", rest.east_m, rest.north_m);
    if (rest.end == RollEnd::leaves)
      return fmt::format(
          "from east {:.3f} m north {:.3f} m it rolls off the surface or onto a void",
          stone_.east_m, stone_.north_m);
    if (rest.end == RollEnd::rolls_on) return "it rolls on and on, now " + where;
    if (rest.end == RollEnd::wedged)
      return "it is wedged between less than three contacts " + where;
    if (slides(rest))
      return fmt::format("the ground {} has a slope of {:.1f} degrees (stones.repose_deg is {:g})",
                         where, in_degrees(rest.slope_rad), in_degrees(options_.repose.value()));
    if (!keeps_to_its_square(request_, stone_, rest.east_m, rest.north_m))
      return "it comes to rest too near to the border " + where;
    if (stone_.has_place && distance_m(rest) > stone_.diameter.value())
      return "it rolls, and comes to rest " + where;
    return "it comes to rest where another stone lies " + where;
  }

  const SiteStone& stone_;
  const SitePlanRequest& request_;
  const StoneGround& ground_;
  const SettleOptions& options_;
  StoneBodyPtr made_;  ///< the stone of diameter 1, also of a drawn one: made once
  TriMesh body_;       ///< in model millimetres
  double radius_m_ = 0.0;
};

}  // namespace

Result<std::vector<PlacedStone>> settle_stones(std::span<const SiteStone> stones,
                                               const SitePlanRequest& request,
                                               const StoneGround& ground,
                                               const SettleOptions& options,
                                               const RunContext& run) {
  MAQUETTE_CHECK(options.repose.value() > 0.0, "{}", options.repose.value());
  MAQUETTE_CHECK(options.embedded_share >= 0.0 && options.embedded_share <= 1.0, "{}",
                 options.embedded_share);
  // The plan's places at once, for any stone may have its own; others only in order, for who comes
  // later has to make room.
  std::vector<std::optional<Rest>> first(stones.size());
  tbb::parallel_for(std::size_t{0}, stones.size(), [&](std::size_t i) {
    const Settler settler(stones[i], request, ground, options);
    if (!run.stopped() && settler.is_planned_here())
      first[i] = settler.drop_at(stones[i].east_m, stones[i].north_m);
  });
  if (run.stopped()) return fail(kCancelled, "cancelled");

  std::vector<StoneDisc> taken(options.taken.begin(), options.taken.end());
  std::vector<std::optional<PlacedStone>> placed(stones.size());
  for (const bool told : {true, false})
    for (std::size_t i = 0; i < stones.size(); ++i) {
      if (stones[i].has_place != told || !first[i]) continue;
      const Settler settler(stones[i], request, ground, options);
      MAQUETTE_TRY(const auto rest, settler.find_rest(*first[i], taken, run));
      if (!rest) continue;
      taken.push_back(settler.disc(*rest));
      placed[i] = settler.sunk(rest->stone);
    }
  std::vector<PlacedStone> all;
  for (auto& stone : placed)
    if (stone) all.push_back(std::move(*stone));
  return all;
}

}  // namespace maquette::meshing

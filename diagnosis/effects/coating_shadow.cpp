// SPDX-License-Identifier: GPL-3.0-or-later

// Sprayed from one direction s, the film is t max(0, n . s): thin where the surface turns away.
// What is not clipped is a shift and an even film, less than declared; only faces in shadow tell
// the direction. Where crests are in the way the spray does not come at all, but for what bounces:
// low over rough ground that is most of what is seen.
#include <cmath>
#include <functional>
#include <memory>
#include <numbers>
#include <optional>

#include <fmt/format.h>

#include "diagnosis/cast_shadow.hpp"
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

namespace {

constexpr double kAzimuths_deg = 45.0, kElevations_deg = 20.0;  // from one of the grid to the next
constexpr double kFinest = 1.0 / 16.0;                          // of that
/// Crests that keep the spray from less of the part than that are not looked at.
constexpr double kWorthCasting = 0.01;

/// Form of a direction, and its neighbours.
struct Sprayed {
  std::optional<Column> even;                                     ///< beside it
  std::function<std::shared_ptr<const CastShadow>(Vec3)> shadow;  ///< empty: none is cast

  [[nodiscard]] static Vec3 towards(double azimuth_deg, double elevation_deg) {
    constexpr double kRadians = std::numbers::pi / 180.0;
    const double a = kRadians * azimuth_deg, h = kRadians * elevation_deg;
    return {std::cos(h) * std::cos(a), std::cos(h) * std::sin(a), std::sin(h)};
  }

  /// @param share  of the grid's steps between neighbours
  Form operator()(double azimuth_deg, double elevation_deg, double share) const {
    const Vec3 s = towards(azimuth_deg, elevation_deg);
    const auto cast = shadow ? shadow(s) : nullptr;
    // Names of their own: a file's law is found again by its parameters.
    Form f{
        fmt::format("sprayed from azimuth {:.4g} at {:.4g} degrees{}{}", azimuth_deg, elevation_deg,
                    cast ? ", crests in the way" : "", even ? ", beside an even film" : ""),
        {column(fmt::format("shadow{}{}_{}", cast ? "_cast" : "", azimuth_deg, elevation_deg),
                {cast ? "film_facing_in_sight_mm" : "film_facing_mm", 1.0, 1.0},
                [s, cast](const Observation& o) {
                  const double facing = film(o) * std::fmax(0.0, dot(o.slope_normal, s));
                  return cast && facing > 0.0 ? facing * cast->at(o.place.x, o.place.y) : facing;
                })}};
    f.fixed = {{"azimuth_deg", azimuth_deg}, {"elevation_deg", elevation_deg}};
    f.sign = 1;
    if (even) f.columns.push_back(*even);
    if (share < kFinest) return f;
    f.finer = [make = *this, azimuth_deg, elevation_deg, share] {
      std::vector<Form> near;
      for (const double x : {-share, 0.0, share})
        for (const double y : {-share, 0.0, share})
          near.push_back(make(azimuth_deg + x * kAzimuths_deg, elevation_deg + y * kElevations_deg,
                              0.5 * share));
      return near;
    };
    return f;
  }
};

}  // namespace

void add_coating_shadow(std::vector<Effect>& all) {
  Effect e;
  e.name = "coating.shadow";
  e.says = "the coat was sprayed from one side";
  e.source = "cosine law of a distant spray; what is behind a crest gets none";
  e.acts_on = "coat";
  e.depends_on = "direction of the slope against the spray";
  e.looks_like = {"coating.thickness", "scanner.incidence_bias"};
  e.never_beside = "coating.thickness";  // the even film beside it
  e.separate_by = "weighed strips on slopes of four directions";
  e.correction = "spray from two sides";
  e.forms = [](const Scene& scene) {
    std::vector<Form> forms;
    if (scene.coat_mm > 0.0) {
      Form f{"sprayed from above, no face in shadow",
             {column("film", {"film_even_mm", 1.0, scene.coat_mm}, film)}};
      f.sign = -1;
      forms.push_back(std::move(f));
    }
    const auto even = even_film(scene, "film_even_mm");
    const Sprayed open[] = {{{}, {}}, {even, {}}};
    const Sprayed behind_crests[] = {{{}, scene.shadow}, {even, scene.shadow}};
    for (const double elevation : {20.0, 40.0, 60.0})
      for (int k = 0; k < 8; ++k) {
        const double azimuth = kAzimuths_deg * k;
        for (const Sprayed& make : open) forms.push_back(make(azimuth, elevation, 0.5));
        if (!scene.shadow ||
            scene.shadow(Sprayed::towards(azimuth, elevation))->share < kWorthCasting)
          continue;
        for (const Sprayed& make : behind_crests) forms.push_back(make(azimuth, elevation, 0.5));
      }
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

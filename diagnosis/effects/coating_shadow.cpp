// SPDX-License-Identifier: GPL-3.0-or-later

// Sprayed from one direction s, the film is t max(0, n . s): thin where the surface turns away.
// What is not clipped is a shift and an even film, less than declared; only faces in shadow tell
// the direction.
#include <cmath>
#include <numbers>
#include <optional>

#include <fmt/format.h>

#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

namespace {

constexpr double kAzimuths_deg = 45.0, kElevations_deg = 20.0;  // from one of the grid to the next
constexpr double kFinest = 1.0 / 16.0;                          // of that

/// Form of a direction, and its neighbours.
struct Sprayed {
  std::optional<Column> even;  ///< beside it

  /// @param share  of the grid's steps between neighbours
  Form operator()(double azimuth_deg, double elevation_deg, double share) const {
    constexpr double kRadians = std::numbers::pi / 180.0;
    const double a = kRadians * azimuth_deg, h = kRadians * elevation_deg;
    const Vec3 s{std::cos(h) * std::cos(a), std::cos(h) * std::sin(a), std::sin(h)};
    Form f{fmt::format("sprayed from azimuth {:.4g} at {:.4g} degrees{}", azimuth_deg,
                       elevation_deg, even ? ", beside an even film" : ""),
           {column(fmt::format("shadow{}_{}", azimuth_deg, elevation_deg),
                   {"film_facing_mm", 1.0, 1.0}, [s](const Observation& o) {
                     return film(o) * std::fmax(0.0, dot(o.slope_normal, s));
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
  e.source = "cosine law of a distant spray";
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
    for (const double elevation : {20.0, 40.0, 60.0})
      for (int k = 0; k < 8; ++k) {
        const Sprayed alone{{}}, beside_even{even_film(scene, "film_even_mm")};
        forms.push_back(alone(kAzimuths_deg * k, elevation, 0.5));
        forms.push_back(beside_even(kAzimuths_deg * k, elevation, 0.5));
      }
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

// SPDX-License-Identifier: GPL-3.0-or-later

// Sprayed from one direction s, the film is t max(0, n . s): thin where the surface turns away.
// What is not clipped is a shift and an even film, less than declared; only faces in shadow tell
// the direction.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

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
        const double azimuth = 45.0 * k, a = azimuth * 3.14159265358979323846 / 180.0;
        const double h = elevation * 3.14159265358979323846 / 180.0;
        const Vec3 s{std::cos(h) * std::cos(a), std::cos(h) * std::sin(a), std::sin(h)};
        const auto wet = [s](const Observation& o) {
          return film(o) * std::fmax(0.0, dot(o.slope_normal, s));
        };
        Form f{fmt::format("sprayed from azimuth {} at {} degrees", azimuth, elevation),
               {column(fmt::format("shadow{}_{}", azimuth, elevation), {"film_facing_mm", 1.0, 1.0},
                       wet)}};
        f.fixed = {{"azimuth_deg", azimuth}, {"elevation_deg", elevation}};
        f.sign = 1;
        forms.push_back(f);
        f.law += ", beside an even film";
        f.columns.push_back(even_film(scene, "film_even_mm"));
        forms.push_back(std::move(f));
      }
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

void add_surface_roughness(std::vector<Effect>& all) {
  Effect e;
  e.name = "surface.roughness";
  e.says = "the surface is rough below a pixel";
  e.source = "facets with Lambert's law: Oren and Nayar, SIGGRAPH 1994, doi:10.1145/192161.192213";
  e.acts_on = "surface";
  e.depends_on = "incidence, emission and azimuth between them";
  e.looks_like = {"surface.opposition", "lamp.falloff"};
  e.separate_by = "pictures from several directions under one lamp";
  e.correction = "take the roughness into the reflectance law";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene&) -> std::vector<PhotoForm> {
    std::vector<PhotoForm> forms;
    for (const auto& [member, name] : {std::pair{&PhotoState::roughness_rad2, "full fit"},
                                       std::pair{&PhotoState::roughness_short_rad2, "short form"}})
      for (const double deg : {10.0, 20.0, 35.0}) {
        const double variance = std::pow(deg * std::numbers::pi / 180.0, 2);
        const auto of = member;
        forms.push_back(
            {fmt::format("facets, {}, signature at {:.0f} degrees", name, deg),
             {{fmt::format("roughness {} {:.0f}", name, deg), "sigma_deg",
               [variance, of](const PhotoState& s, const PhotoScene&) {
                 const double now = s.*of;
                 return now > 1e-4 ? std::pair{-0.2 * now, 0.2 * now} : std::pair{-now, variance};
               },
               [of](PhotoState& state, double v) { state.*of = std::fmax(0.0, state.*of + v); },
               [](double v) { return 180.0 / std::numbers::pi * root(v); }}},
             {},
             1});
      }
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

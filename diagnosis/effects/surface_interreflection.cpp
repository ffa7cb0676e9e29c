// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

void add_surface_interreflection(std::vector<Effect>& all) {
  Effect e;
  e.name = "surface.interreflection";
  e.says = "lit slopes light what lies opposite";
  e.source = "diffuse bounces of the lamp's light, one or all; 1: those of the stated albedo";
  e.acts_on = "surface";
  e.depends_on = "concave places, with the light on what they see";
  e.looks_like = {"lamp.ambient"};
  e.separate_by = "the part painted darker; the lamp swept";
  e.correction = "render with the bounce";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene&) -> std::vector<PhotoForm> {
    return {{"one bounce", {number("bounce", "of_one_bounce", 0.05, &PhotoState::bounce)}, {}, 1},
            {"every bounce",
             {number("bounce_all", "of_all_bounces", 0.05, &PhotoState::bounce_all)},
             {},
             1}};
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

void add_lamp_falloff(std::vector<Effect>& all) {
  Effect e;
  e.name = "lamp.falloff";
  e.says = "light falls off with distance or to the side otherwise than stated";
  e.source = "irradiance with distance^-(2 + excess); beams as a power of the cosine off the axis";
  e.acts_on = "lamp";
  e.depends_on = "distance from the lamp and angle off its axis";
  e.looks_like = {"photo.vignetting", "lamp.position"};
  e.separate_by = "the part turned under the lamp";
  e.correction = "measure the irradiance over the place of the part";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene&) -> std::vector<PhotoForm> {
    return {
        {"with distance", {number("falloff", "exponent_less_2", 0.02, &PhotoState::falloff)}},
        {"off the axis", {number("beam_power", "power_of_cosine", 0.02, &PhotoState::beam_power)}}};
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

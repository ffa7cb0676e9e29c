// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

void add_lamp_ambient(std::vector<Effect>& all) {
  Effect e;
  e.name = "lamp.ambient";
  e.says = "light comes from all around, too";
  e.source = "an even sky, seen as far as relief does not hide it";
  e.acts_on = "lamp";
  e.depends_on = "shadows; how open a place is";
  e.looks_like = {"photo.black_level", "photo.veiling_glare", "surface.interreflection"};
  e.separate_by = "a picture with the lamp off";
  e.correction = "darken the room; subtract the picture with the lamp off";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene&) -> std::vector<PhotoForm> {
    return {{"as far as the sky is seen",
             {number("ambient_sky", "of_lamp", 0.002, &PhotoState::ambient_sky)},
             {},
             1},
            {"the same everywhere",
             {number("ambient_even", "of_lamp", 0.002, &PhotoState::ambient_even)},
             {},
             1}};
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

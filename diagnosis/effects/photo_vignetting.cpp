// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

void add_photo_vignetting(std::vector<Effect>& all) {
  Effect e;
  e.name = "photo.vignetting";
  e.says = "the picture darkens (or brightens) towards its corners";
  e.source = "natural and mechanical vignetting: Aggarwal, Hua, Ahuja, ICCV 2001";
  e.acts_on = "lens";
  e.depends_on = "image radius";
  e.looks_like = {"lamp.falloff", "photo.veiling_glare"};
  e.separate_by = "a picture of an evenly lit wall, or the camera moved";
  e.correction = "divide by the flat field";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene&) -> std::vector<PhotoForm> {
    return {{"square of the radius",
             {number("vignette_2", "at_corner", 0.01, &PhotoState::vignette_2)}},
            {"square and fourth power of the radius",
             {number("vignette_2", "at_corner", 0.01, &PhotoState::vignette_2),
              number("vignette_4", "fourth_power_at_corner", 0.01, &PhotoState::vignette_4)}}};
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

void add_photo_chromatic_aberration(std::vector<Effect>& all) {
  Effect e;
  e.name = "photo.chromatic_aberration";
  e.says = "the colours have different scales";
  e.source = "lateral chromatic aberration: scale of red and blue against green";
  e.acts_on = "lens";
  e.depends_on = "image radius and band";
  e.looks_like = {};
  e.separate_by = "a picture of a grid, band by band";
  e.correction = "scale the bands";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene& scene) -> std::vector<PhotoForm> {
    if (!scene.colour) return {};
    return {{"scale of red and blue",
             {number("red_scale", "red_relative", 2e-4, &PhotoState::red_scale),
              number("blue_scale", "blue_relative", 2e-4, &PhotoState::blue_scale)}}};
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

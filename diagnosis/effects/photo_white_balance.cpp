// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

void add_photo_white_balance(std::vector<Effect>& all) {
  Effect e;
  e.name = "photo.white_balance";
  e.says = "the bands are weighted otherwise than stated";
  e.source = "factors on red and blue against green";
  e.acts_on = "sensor";
  e.depends_on = "band";
  e.looks_like = {"surface.albedo"};
  e.separate_by = "a grey card in the picture, under the same lamp";
  e.correction = "set the white balance on a grey card";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene& scene) -> std::vector<PhotoForm> {
    if (!scene.colour) return {};
    return {{"red and blue against green",
             {number("red", "red_relative", 0.01, &PhotoState::red),
              number("blue", "blue_relative", 0.01, &PhotoState::blue)}}};
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

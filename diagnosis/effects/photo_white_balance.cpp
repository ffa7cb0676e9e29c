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
    std::vector<PhotoForm> forms;
    for (const Scope& scope : scopes_of(scene))
      forms.push_back({"red and blue against green" + scope.says,
                       {number_in(scope, "red", "red_relative", 0.01, &PictureState::red),
                        number_in(scope, "blue", "blue_relative", 0.01, &PictureState::blue)}});
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

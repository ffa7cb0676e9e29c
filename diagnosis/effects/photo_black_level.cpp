// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

void add_photo_black_level(std::vector<Effect>& all) {
  Effect e;
  e.name = "photo.black_level";
  e.says = "a constant is added to every value";
  e.source = "offset of the analogue to digital conversion: EMVA Standard 1288 R4.0, section 2";
  e.acts_on = "sensor";
  e.depends_on = "level: largest share in shadows";
  e.looks_like = {"photo.veiling_glare", "lamp.ambient"};
  e.separate_by = "a picture with the cap on the lens";
  e.correction = "subtract the dark picture";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene& scene) -> std::vector<PhotoForm> {
    std::vector<PhotoForm> forms;
    for (const Scope& scope : scopes_of(scene))
      forms.push_back({"added" + scope.says,
                       {number_in(scope, "black", "of_full_scale", 0.002, &PictureState::black)}});
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

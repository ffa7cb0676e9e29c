// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

void add_photo_exposure(std::vector<Effect>& all) {
  Effect e;
  e.name = "photo.exposure";
  e.says =
      "the picture is brighter or darker than stated, everywhere alike (shutter, gain, or the "
      "lamp's power)";
  e.source = "a factor on the signal: EMVA Standard 1288 R4.0, section 2";
  e.acts_on = "sensor";
  e.depends_on = "nothing";
  e.looks_like = {"surface.albedo", "photo.gamma"};
  e.separate_by = "a grey card in the picture";
  e.correction = "set the exposure so that the card has its value";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene& scene) -> std::vector<PhotoForm> {
    std::vector<PhotoForm> forms;
    PhotoForm each{"factor, of each picture its own", {}};
    for (const Scope& scope : scopes_of(scene)) {
      forms.push_back({"factor" + scope.says,
                       {number_in(scope, "exposure", "relative", 0.01, &PictureState::exposure)}});
      forms.back().least = kLeastBrightness;
      if (!forms.back().parameters[0].photo || scene.photos.size() < 2) continue;
      each.parameters.push_back(forms.back().parameters[0]);
      each.parameters.back().name += scope.key;
    }
    if (!each.parameters.empty()) forms.push_back(std::move(each));
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

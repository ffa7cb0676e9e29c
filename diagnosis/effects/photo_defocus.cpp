// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

void add_photo_defocus(std::vector<Effect>& all) {
  Effect e;
  e.name = "photo.defocus";
  e.says = "the picture is blurred alike in all directions";
  e.source = "variance of the point spread function";
  e.acts_on = "lens";
  e.depends_on = "edges";
  e.looks_like = {"lamp.size", "photo.motion_blur"};
  e.separate_by = "pictures at several focus settings";
  e.correction = "focus; stop down";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene& scene) -> std::vector<PhotoForm> {
    std::vector<PhotoForm> forms;
    for (const Scope& scope : scopes_of(scene)) {
      PhotoParameter p = number_in(scope, "blur", "sigma_px", 0.05, &PictureState::blur_px2);
      p.shown = root;
      forms.push_back({"the same everywhere" + scope.says, {std::move(p)}, {}, 1, kLeastBlur_px2});
    }
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

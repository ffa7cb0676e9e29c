// SPDX-License-Identifier: GPL-3.0-or-later
#include <tuple>

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
    // One lens, focused once before or behind the part: near places are spread otherwise than far
    // ones. Or focused anew for each picture, beside its middle by the same share of its distance.
    for (const auto& [key, law, member] :
         {std::tuple{"focus", "by distance, of a lens focused elsewhere", &PhotoState::focus_px2},
          {"focus_anew", "by distance, of a lens focused anew for each picture",
           &PhotoState::focus_anew_px2}}) {
      PhotoForm focus{law, {}, {}, 1, kLeastBlur_px2};
      for (const auto& [at, name] :
           {std::pair{0U, "sigma_px"}, {1U, "by_nearness_px2"}, {2U, "by_nearness_squared_px2"}})
        // Nearnesses are a tenth or two: the same blur by steps that are as much larger.
        focus.parameters.push_back(
            {fmt::format("{}{}", key, at), name,
             [step = 0.05 * std::pow(8.0, at)](const PhotoState&, const PhotoScene&) {
               return std::pair{0.0, step};
             },
             [at, member](PhotoState& s, double v) { (s.*member)[at] += v; }});
      focus.parameters[0].shown = root;
      forms.push_back(std::move(focus));
    }
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

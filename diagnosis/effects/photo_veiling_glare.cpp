// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

void add_photo_veiling_glare(std::vector<Effect>& all) {
  Effect e;
  e.name = "photo.veiling_glare";
  e.says = "light scattered in the lens lies over the picture";
  e.source = "a share of the mean of the picture: ISO 9358";
  e.acts_on = "lens";
  e.depends_on = "mean of the picture";
  e.looks_like = {"photo.black_level", "lamp.ambient"};
  e.separate_by = "a picture of a black trap in bright surroundings";
  e.correction = "shade the lens; clean it";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene&) -> std::vector<PhotoForm> {
    return {
        {"a share of the mean, added", {number("veil", "share", 0.002, &PhotoState::veil)}, {}, 1},
        {"a share of the light, spread over the picture",
         {number("veil_scattered", "share", 0.002, &PhotoState::veil_scattered)},
         {},
         1}};
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

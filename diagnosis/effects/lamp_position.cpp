// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

void add_lamp_position(std::vector<Effect>& all) {
  Effect e;
  e.name = "lamp.position";
  e.says = "the lamp was elsewhere than stated";
  e.source =
      "irradiance by the inverse square of the distance and the cosine of incidence; shadows";
  e.acts_on = "lamp";
  e.depends_on = "distance and direction of the lamp; shadows";
  e.looks_like = {"lamp.falloff"};
  e.separate_by =
      "a picture with the lamp turned or moved by a known way; a sphere or a rod whose shadow is "
      "measured";
  e.correction = "measure the lamp by the shadow of a rod";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene& scene) -> std::vector<PhotoForm> {
    std::vector<PhotoForm> forms;
    const auto add = [&](std::vector<std::size_t> lamps, bool refocused, std::string law) {
      PhotoForm form{std::move(law) + (refocused ? ", exposed anew" : ", as bright"), {}, {}, 0};
      const auto member = refocused ? &PhotoState::lamp_refocused_mm : &PhotoState::lamp_mm;
      std::string which;
      for (const std::size_t lamp : lamps) which += fmt::format("_{}", lamp);
      for (int axis = 0; axis < 3; ++axis)
        form.parameters.push_back(
            {fmt::format("lamp{}{}{}", axis, which, refocused ? "r" : ""),
             fmt::format("shift_{}_mm", std::string_view("xyz")[static_cast<std::size_t>(axis)]),
             [](const PhotoState&, const PhotoScene&) {
               return std::pair{-2.0, 2.0};
             },
             [=](PhotoState& state, double v) {
               for (const std::size_t lamp : lamps) (state.*member)[lamp] += along_axis(axis, v);
             }});
      forms.push_back(std::move(form));
    };
    std::vector<std::size_t> every(scene.lamps);
    for (std::size_t k = 0; k < scene.lamps; ++k) every[k] = k;
    for (const bool refocused : {false, true}) {
      add(every, refocused, scene.lamps > 1 ? "every lamp alike" : "the lamp");
      if (scene.lamps < 2) continue;
      // Each lamp stands where it was put: nothing moves two of them alike.
      PhotoForm each{refocused ? "each lamp, exposed anew" : "each lamp, as bright", {}, {}, 0};
      for (std::size_t k = 0; k < scene.lamps; ++k) {
        add({k}, refocused, fmt::format("lamp {} alone", k + 1));
        for (PhotoParameter p : forms.back().parameters) {
          p.name = fmt::format("lamp_{}_{}", k + 1, p.name);
          each.parameters.push_back(std::move(p));
        }
      }
      forms.push_back(std::move(each));
    }
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

void add_lamp_size(std::vector<Effect>& all) {
  Effect e;
  e.name = "lamp.size";
  e.says = "shadows have softer (or harder) edges the farther what casts them";
  e.source = "penumbra of a round lamp: width = diameter * way of the shadow / distance";
  e.acts_on = "lamp";
  e.depends_on = "edges of shadows, with the height of what casts them";
  e.looks_like = {"photo.defocus"};
  e.separate_by = "the width of a rod's shadow at two heights";
  e.correction = "state the diameter of the lens of the lamp";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene& scene) -> std::vector<PhotoForm> {
    std::vector<PhotoForm> forms;
    for (std::size_t k = 0; k < kLampSizes; ++k)
      forms.push_back(
          {fmt::format("signature at step {}", k + 1),
           {{fmt::format("lamp_size{}", k), "diameter_mm",
             [k](const PhotoState& s, const PhotoScene& at) {
               return std::pair{0.0, at.lamp_sizes_mm[k] - s.lamp_diameter_mm};
             },
             [](PhotoState& state, double v) { state.lamp_diameter_mm += v; },
             [declared = scene.photos[0].lamp_diameter_mm](double v) { return declared + v; }}},
           {},
           scene.photos[0].lamp_diameter_mm > 0.0 ? 0 : 1});
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

void add_surface_albedo(std::vector<Effect>& all) {
  Effect e;
  e.name = "surface.albedo";
  e.says = "the surface is lighter or darker than stated, evenly or in places";
  e.source = "reflectance of paint: a factor that goes with the place, not with the light";
  e.acts_on = "surface";
  e.depends_on = "place on the part, whatever the light";
  e.looks_like = {"photo.exposure"};
  e.separate_by = "the same place under two lamps; a grey card";
  e.correction = "measure the paint; paint again";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene&) -> std::vector<PhotoForm> {
    std::vector<PhotoForm> forms{
        {"even", {number("albedo", "relative", 0.01, &PhotoState::albedo)}}};
    forms.back().least = kLeastBrightness;
    for (const int waves : {1, 2, 3, 5, 7, 9, kAlbedoWaves}) {
      PhotoForm form{fmt::format("a map of {} waves a side", waves), {}, {}, 0};
      for (int j = 0; j <= waves; ++j)
        for (int i = 0; i <= waves; ++i) {
          if (i + j == 0) continue;
          const auto at = static_cast<std::size_t>(j * (kAlbedoWaves + 1) + i);
          form.parameters.push_back(
              {fmt::format("albedo_{}_{}", i, j),
               fmt::format("wave_{}_{}", i, j),
               [](const PhotoState&, const PhotoScene&) {
                 return std::pair{-0.01, 0.01};
               },
               [at](PhotoState& state, double v) { state.albedo_map[at] += v; },
               {},
               [at](Vec3 place, const PhotoScene& of) { return albedo_wave(at, place, of); }});
        }
      forms.push_back(std::move(form));
    }
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

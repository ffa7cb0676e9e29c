// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>
#include <cmath>

#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

void add_lamp_ambient(std::vector<Effect>& all) {
  Effect e;
  e.name = "lamp.ambient";
  e.says = "light comes from all around, too";
  e.source =
      "a sky that is even, or whose radiance grows one way; seen as far as relief does not hide it";
  e.acts_on = "lamp";
  e.depends_on = "shadows; how open a place is";
  e.looks_like = {"photo.black_level", "photo.veiling_glare", "surface.interreflection"};
  e.separate_by = "a picture with the lamp off";
  e.correction = "darken the room; subtract the picture with the lamp off";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene& scene) -> std::vector<PhotoForm> {
    const PhotoParameter sky = number("ambient_sky", "of_lamp", 0.002, &PhotoState::ambient_sky);
    std::vector<PhotoForm> forms{
        {"as far as the sky is seen", {sky}, {}, 1},
        {"the same everywhere",
         {number("ambient_even", "of_lamp", 0.002, &PhotoState::ambient_even)},
         {},
         1}};
    // Of light that the lamp brings itself there is the less the further it stands.
    constexpr double kAsFar = 0.02;  // of a sky of 5 %, a thousandth of the lamp
    if (std::any_of(scene.photos.begin(), scene.photos.end(), [&](const PhotoInput& p) {
          return std::abs(lamp_further(p, scene) - 1.0) > kAsFar;
        }))
      forms.push_back(
          {"as far as the sky is seen, the same wherever the lamp stands",
           {number("ambient_steady", "of_first_lamp", 0.002, &PhotoState::ambient_steady)},
           {},
           1});
    // Windows and white ceilings: brighter there, and of another colour than the lamp.
    std::vector<PhotoParameter> side, colour;
    for (int axis = 0; axis < 3; ++axis)
      side.push_back(
          {fmt::format("ambient_side{}", axis),
           fmt::format("towards_{}", std::string_view("xyz")[static_cast<std::size_t>(axis)]),
           [](const PhotoState&, const PhotoScene&) {
             return std::pair{-0.002, 0.002};
           },
           [axis](PhotoState& s, double v) { s.ambient_side += along_axis(axis, v); }});
    if (scene.colour)
      colour = {number("ambient_red", "red_more", 0.002, &PhotoState::ambient_red),
                number("ambient_blue", "blue_more", 0.002, &PhotoState::ambient_blue)};
    const auto add = [&](const char* law, const std::vector<PhotoParameter>& more,
                         const std::vector<PhotoParameter>& besides) {
      PhotoForm form{law, {sky}, {}, 1};
      form.parameters.insert(form.parameters.end(), more.begin(), more.end());
      form.parameters.insert(form.parameters.end(), besides.begin(), besides.end());
      forms.push_back(std::move(form));
    };
    add("as far as the sky is seen, brighter on one side", side, {});
    if (scene.colour) {
      add("as far as the sky is seen, of another colour", {}, colour);
      add("as far as the sky is seen, brighter on one side, of another colour", side, colour);
    }
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

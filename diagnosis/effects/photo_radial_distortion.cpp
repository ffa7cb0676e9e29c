// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

void add_photo_radial_distortion(std::vector<Effect>& all) {
  Effect e;
  e.name = "photo.radial_distortion";
  e.says = "straight lines bend";
  e.source =
      "Brown, Photogrammetric Engineering 37 (1971) 855; coefficients of u over the focal length";
  e.acts_on = "lens";
  e.depends_on = "image radius: displacement with its third power";
  e.looks_like = {"photo.focal_length", "photo.pose"};
  e.separate_by = "a picture of a grid";
  e.correction = "calibrate the distortion";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene&) -> std::vector<PhotoForm> {
    return {{"third power of the radius", {number("radial_1", "k1", 0.002, &PhotoState::radial_1)}},
            {"third and fifth power of the radius",
             {number("radial_1", "k1", 0.002, &PhotoState::radial_1),
              number("radial_2", "k2", 0.02, &PhotoState::radial_2)}}};
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

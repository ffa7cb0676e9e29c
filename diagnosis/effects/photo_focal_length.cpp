// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

void add_photo_focal_length(std::vector<Effect>& all) {
  Effect e;
  e.name = "photo.focal_length";
  e.says = "the picture is larger or smaller than stated";
  e.source = "pinhole projection";
  e.acts_on = "lens";
  e.depends_on = "image radius: displacement in proportion";
  e.looks_like = {"photo.pose", "photo.radial_distortion"};
  e.separate_by = "a target of known size at known distance";
  e.correction = "calibrate the focal length";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene&) -> std::vector<PhotoForm> {
    return {{"scale", {number("focal", "relative", 2e-4, &PhotoState::focal)}}};
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

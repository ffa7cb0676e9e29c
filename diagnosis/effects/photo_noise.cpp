// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

/// Found in the scatter of neighbouring pixels, not by a signature (photo_noise.cpp).
void add_photo_noise(std::vector<Effect>& all) {
  Effect e;
  e.name = "photo.noise";
  e.says = "pixels scatter otherwise than full well and read noise say";
  e.source = "shot and read noise: EMVA Standard 1288 R4.0, section 2";
  e.acts_on = "sensor";
  e.depends_on = "level";
  e.separate_by = "two pictures of the same scene";
  e.correction = "state the gain and read noise that two equal pictures show";
  e.needs = Needs::photograph;
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

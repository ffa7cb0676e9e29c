// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

void add_photo_pose(std::vector<Effect>& all) {
  Effect e;
  e.name = "photo.pose";
  e.says = "the camera was elsewhere than stated";
  e.source = "pinhole projection, six directions a picture";
  e.acts_on = "lens";
  e.depends_on = "place in the picture and depth";
  e.looks_like = {"photo.focal_length"};
  e.separate_by = "targets on the part whose places are known";
  e.correction = "take the pose from the pictures (compare, or targets)";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene& scene) -> std::vector<PhotoForm> {
    std::vector<PhotoForm> forms;
    PhotoForm together{"of every picture", {}, {}, 0};
    for (std::size_t k = 0; k < scene.photos.size(); ++k) {
      if (scene.photos[k].held_out) continue;
      PhotoForm one{"of " + scene.photos[k].image.filename().string(), {}, {}, 0};
      // A step that moves the picture by a fifth of a pixel.
      const PhotoInput& photo = scene.photos[k];
      const double pixel_rad = photo.pixel_pitch_um / (1000.0 * photo.focal_length_mm);
      const double pixel_mm = pixel_rad * norm(photo.camera_position_mm - scene.middle());
      for (int axis = 0; axis < 3; ++axis)
        for (const bool turn : {false, true}) {
          const double step = 0.2 * (turn ? pixel_rad : pixel_mm);
          const char* name = "xyz";
          one.parameters.push_back(
              {fmt::format("{}{}_{}", turn ? "turn" : "shift", axis, k),
               fmt::format("{}_{}_{}", turn ? "turn" : "shift", name[axis], turn ? "rad" : "mm"),
               [step](const PhotoState&, const PhotoScene&) {
                 return std::pair{-step, step};
               },
               [=](PhotoState& state, double v) {
                 PictureState& own = state.picture[k];
                 (turn ? own.camera_rad : own.camera_mm) += along_axis(axis, v);
               }});
          one.parameters.back().photo = k;
        }
      together.parameters.insert(together.parameters.end(), one.parameters.begin(),
                                 one.parameters.end());
      forms.push_back(std::move(one));
    }
    if (forms.size() > 1) {
      for (PhotoParameter& p : together.parameters) p.name += p.key.substr(p.key.find('_'));
      forms.push_back(std::move(together));
    }
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

void add_photo_motion_blur(std::vector<Effect>& all) {
  Effect e;
  e.name = "photo.motion_blur";
  e.says = "the picture is smeared along a line";
  e.source = "the camera or the part moved evenly while it was exposed: variance length^2 / 12";
  e.acts_on = "lens";
  e.depends_on = "edges across the motion";
  e.looks_like = {"photo.defocus"};
  e.separate_by = "a shorter exposure";
  e.correction = "expose for a shorter time; mount the camera on something firm";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene& scene) -> std::vector<PhotoForm> {
    std::vector<PhotoForm> forms;
    constexpr int kDirections = 24;
    for (const Scope& scope : scopes_of(scene))
      for (int k = 0; k < kDirections; ++k) {
        const double angle = std::numbers::pi * k / kDirections;
        const double c = std::cos(angle), s = std::sin(angle);
        PhotoParameter p{fmt::format("smear{}{}", k, scope.key), "length_px",
                         [](const PhotoState&, const PhotoScene&) {
                           return std::pair{0.0, 0.05};
                         },
                         [=, photos = scope.photos](PhotoState& state, double v) {
                           for (const std::size_t photo : photos) {
                             auto& smear = state.picture[photo].smear_px2;
                             smear[0] += v * c * c;
                             smear[1] += v * c * s;
                             smear[2] += v * s * s;
                           }
                         },
                         [](double v) { return std::sqrt(12.0 * std::fmax(0.0, v)); }};
        if (scope.photos.size() == 1) p.photo = scope.photos.front();
        forms.push_back({fmt::format("along {:.1f} degrees, clockwise from the right{}",
                                     180.0 / std::numbers::pi * angle, scope.says),
                         {std::move(p)},
                         {{"direction_deg", 180.0 / std::numbers::pi * angle}},
                         1,
                         kLeastBlur_px2});
      }
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

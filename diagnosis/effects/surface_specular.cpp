// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

void add_surface_specular(std::vector<Effect>& all) {
  Effect e;
  e.name = "surface.specular";
  e.says = "the surface shines in the mirror direction";
  e.source = "a lobe about the half vector: Blinn, SIGGRAPH 1977, doi:10.1145/563858.563893";
  e.acts_on = "surface";
  e.depends_on = "angle between the normal and the half vector";
  e.looks_like = {"surface.opposition"};
  e.separate_by = "two pictures with crossed and parallel polarisers";
  e.correction = "matt the paint; crossed polarisers";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene&) -> std::vector<PhotoForm> {
    std::vector<PhotoForm> forms;
    for (std::size_t k = 0; k < kLobeExponents.size(); ++k)
      forms.push_back({fmt::format("exponent {:.0f}", kLobeExponents[k]),
                       {{fmt::format("lobe{}", k), "radiance_factor",
                         [](const PhotoState&, const PhotoScene&) {
                           return std::pair{0.0, 0.01};
                         },
                         [k](PhotoState& state, double v) { state.specular[k] += v; }}},
                       {{"exponent", kLobeExponents[k]}},
                       1});
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

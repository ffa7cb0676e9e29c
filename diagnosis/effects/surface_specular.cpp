// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

void add_surface_specular(std::vector<Effect>& all) {
  Effect e;
  e.name = "surface.specular";
  e.says = "the surface shines in the mirror direction";
  e.source =
      "a lobe about the half vector: Blinn, SIGGRAPH 1977, doi:10.1145/563858.563893; facets: "
      "Torrance & Sparrow, J. Opt. Soc. Am. 57 (1967) 1105, doi:10.1364/JOSA.57.001105";
  e.acts_on = "surface";
  e.depends_on = "angle between the normal and the half vector";
  e.looks_like = {"surface.opposition"};
  e.separate_by = "two pictures with crossed and parallel polarisers";
  e.correction = "matt the paint; crossed polarisers";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene&) -> std::vector<PhotoForm> {
    std::vector<PhotoForm> forms;
    const auto add = [&](const char* key, const char* law,
                         std::array<double, kLobeExponents.size()> PhotoState::*lobes) {
      for (std::size_t k = 0; k < kLobeExponents.size(); ++k)
        forms.push_back({fmt::format("exponent {:.0f}{}", kLobeExponents[k], law),
                         {{fmt::format("{}{}", key, k), "radiance_factor",
                           [](const PhotoState&, const PhotoScene&) {
                             return std::pair{0.0, 0.01};
                           },
                           [k, lobes](PhotoState& state, double v) { (state.*lobes)[k] += v; }}},
                         {{"exponent", kLobeExponents[k]}},
                         1});
    };
    add("lobe", "", &PhotoState::specular);
    add("facets", ", of facets", &PhotoState::facets);
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

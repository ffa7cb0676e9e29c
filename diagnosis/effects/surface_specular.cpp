// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

void add_surface_specular(std::vector<Effect>& all) {
  Effect e;
  e.name = "surface.specular";
  e.says = "the surface shines in the mirror direction";
  e.source =
      "a lobe about the half vector: Blinn, SIGGRAPH 1977, doi:10.1145/563858.563893; facets: "
      "Torrance & Sparrow, J. Opt. Soc. Am. 57 (1967) 1105, doi:10.1364/JOSA.57.001105; with a "
      "long tail: Walter et al., Eurographics Symposium on Rendering 2007, equations 33 and 34";
  e.acts_on = "surface";
  e.depends_on = "angle between the normal and the half vector";
  e.looks_like = {"surface.opposition"};
  e.separate_by = "two pictures with crossed and parallel polarisers";
  e.correction = "matt the paint; crossed polarisers";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene&) -> std::vector<PhotoForm> {
    std::vector<PhotoForm> forms;
    const auto add = [&](const auto& widths, const char* key, const char* name, const char* law,
                         auto lobes) {
      const auto factor = [=](std::size_t k, const char* of) {
        return PhotoParameter{fmt::format("{}{}", key, k), of,
                              [](const PhotoState&, const PhotoScene&) {
                                return std::pair{0.0, 0.01};
                              },
                              [k, lobes](PhotoState& state, double v) { (state.*lobes)[k] += v; }};
      };
      for (std::size_t k = 0; k < widths.size(); ++k) {
        forms.push_back({fmt::format("{} {}{}", name, widths[k], law),
                         {factor(k, "radiance_factor")},
                         {{name, widths[k]}},
                         1});
        if (k == 0) continue;
        const std::string first = fmt::format("{}_first", name),
                          second = fmt::format("{}_second", name);
        forms.push_back(between(fmt::format("{} {} to {}{}", name, widths[k - 1], widths[k], law),
                                factor(k - 1, "radiance_factor_first"),
                                factor(k, "radiance_factor_second"),
                                {{first, widths[k - 1]}, {second, widths[k]}}));
      }
    };
    add(kLobeExponents, "lobe", "exponent", "", &PhotoState::specular);
    add(kLobeExponents, "facets", "exponent", ", of facets", &PhotoState::facets);
    add(kFacetSlopes, "ggx", "alpha", ", of facets with a long tail", &PhotoState::ggx);
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

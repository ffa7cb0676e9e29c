// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

void add_surface_opposition(std::vector<Effect>& all) {
  Effect e;
  e.name = "surface.opposition";
  e.says = "the surface is brighter where the light is behind the camera";
  e.source = "opposition surge 1 + B0 / (1 + tan(g / 2) / h): Hapke, Icarus 67 (1986) 264";
  e.acts_on = "surface";
  e.depends_on = "phase angle";
  e.looks_like = {"surface.specular", "surface.roughness"};
  e.separate_by = "pictures at several phase angles";
  e.correction = "take the surge into the reflectance law";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene&) -> std::vector<PhotoForm> {
    std::vector<PhotoForm> forms;
    const auto surge = [](std::size_t k, const char* name) {
      return PhotoParameter{fmt::format("surge{}", k), name,
                            [](const PhotoState&, const PhotoScene&) {
                              return std::pair{0.0, 0.05};
                            },
                            [k](PhotoState& state, double v) { state.surge[k] += v; }};
    };
    for (std::size_t k = 0; k < kSurgeWidths.size(); ++k) {
      forms.push_back(
          {fmt::format("h = {}", kSurgeWidths[k]), {surge(k, "b0")}, {{"h", kSurgeWidths[k]}}, 1});
      if (k == 0) continue;
      forms.push_back(between(fmt::format("h = {} to {}", kSurgeWidths[k - 1], kSurgeWidths[k]),
                              surge(k - 1, "b0_narrow"), surge(k, "b0_wide"),
                              {{"h_narrow", kSurgeWidths[k - 1]}, {"h_wide", kSurgeWidths[k]}}));
    }
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

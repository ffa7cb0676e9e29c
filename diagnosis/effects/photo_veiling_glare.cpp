// SPDX-License-Identifier: GPL-3.0-or-later
#include <algorithm>

#include <fmt/format.h>

#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

void add_photo_veiling_glare(std::vector<Effect>& all) {
  Effect e;
  e.name = "photo.veiling_glare";
  e.says = "light scattered in the lens lies over the picture";
  e.source = "a share of the mean of the picture: ISO 9358; wide halos: a sum of Gaussians";
  e.acts_on = "lens";
  e.depends_on = "mean of the picture";
  e.looks_like = {"photo.black_level", "lamp.ambient"};
  e.separate_by = "a picture of a black trap in bright surroundings";
  e.correction = "shade the lens; clean it";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene&) -> std::vector<PhotoForm> {
    const PhotoParameter everywhere =
        number("veil_scattered", "share", 0.002, &PhotoState::veil_scattered);
    std::vector<PhotoForm> forms{
        {"a share of the mean, added", {number("veil", "share", 0.002, &PhotoState::veil)}, {}, 1},
        {"a share of the light, spread over the picture", {everywhere}, {}, 1}};
    // Those of the halo's Gaussians that carry any light, one or neighbours, the widest with what
    // spreads over all of the picture. What exposures were stated with may have had the halo's
    // light in it or not: it is taken from the place, or added.
    constexpr std::size_t kWidths = kHaloWidths.size();
    const auto halo = [](const char* law, const char* key, std::size_t first, std::size_t last,
                         auto spread) {
      PhotoForm form{law, {}, {}, 1};
      for (std::size_t k = first; k <= last; ++k) {
        form.parameters.push_back({fmt::format("{}{}", key, k), fmt::format("share_{}", k),
                                   [](const PhotoState&, const PhotoScene&) {
                                     return std::pair{-0.002, 0.002};
                                   },
                                   [k, spread](PhotoState& s, double v) { spread(s, k, v); }});
        form.law += fmt::format("{} {} % wide", k > first ? "," : "", 100.0 * kHaloWidths[k]);
      }
      form.all_of_sign = true;
      return form;
    };
    for (std::size_t first = 0; first < kWidths; ++first)
      for (std::size_t last = first; last < kWidths; ++last) {
        const auto taken = halo("a share of the light, in a halo", "halo", first, last,
                                [](PhotoState& s, std::size_t k, double v) { s.halo[k] += v; });
        forms.push_back(taken);
        if (last + 1 == kWidths) {
          forms.push_back(taken);
          forms.back().parameters.push_back(everywhere);
          forms.back().law += ", and over the picture";
        }
        forms.push_back(halo("light added in a halo", "halo_added", first, last, add_to_halo));
      }
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

// SPDX-License-Identifier: GPL-3.0-or-later
#pragma once

// What the files of diagnosis/effects that act on photographs share.

#include <cmath>
#include <numbers>

#include <fmt/format.h>

#include "diagnosis/detail/forms.hpp"
#include "diagnosis/photo_chain.hpp"

namespace maquette::diagnosis::detail {

/// What two renderings of one lamp may differ by all over (a disc that is brought to the stated
/// irradiance, or not), relative.
inline constexpr double kLeastBrightness = 0.003;

/// A plain number of the state, its derivative between -step and step.
[[nodiscard]] inline PhotoParameter number(std::string key, std::string name, double step,
                                           double PhotoState::*member) {
  return {std::move(key), std::move(name),
          [step](const PhotoState&, const PhotoScene&) {
            return std::pair{-step, step};
          },
          [member](PhotoState& s, double v) { s.*member += v; }};
}
/// A law whose width is between two that are tried: some of both.
[[nodiscard]] inline PhotoForm between(std::string law, PhotoParameter narrow, PhotoParameter wide,
                                       std::vector<std::pair<std::string, double>> fixed) {
  PhotoForm form{std::move(law), {}, std::move(fixed), 1};
  form.parameters = {std::move(narrow), std::move(wide)};
  form.all_of_sign = true;
  return form;
}
/// Photographs that a cause of lens or sensor acts on.
struct Scope {
  std::string says;  ///< beside the law
  std::string key;
  std::vector<std::size_t> photos;
};
/// All; each alone; those under each lamp, where lamps are several and light more than one.
[[nodiscard]] inline std::vector<Scope> scopes_of(const PhotoScene& scene) {
  const std::size_t n = scene.photos.size();
  Scope all{"", "", {}};
  std::vector<Scope> scopes;
  for (std::size_t k = 0; k < n; ++k) {
    all.photos.push_back(k);
    if (n > 1 && !scene.photos[k].held_out)
      scopes.push_back(
          {", of " + scene.photos[k].image.filename().string(), fmt::format("_{}", k), {k}});
  }
  scopes.insert(scopes.begin(), std::move(all));
  for (std::size_t lamp = 0; scene.lamps > 1 && lamp < scene.lamps; ++lamp) {
    Scope under{"", fmt::format("_lamp{}", lamp), {}};
    std::size_t seen = 0;
    for (std::size_t k = 0; k < n; ++k)
      if (scene.lamp_of[k] == lamp) {
        under.says += (under.photos.empty() ? ", under the lamp of " : ", ") +
                      scene.photos[k].image.filename().string();
        under.photos.push_back(k);
        seen += scene.photos[k].held_out ? 0U : 1U;
      }
    if (seen > 1) scopes.push_back(std::move(under));
  }
  return scopes;
}
/// A plain number of those pictures' states.
[[nodiscard]] inline PhotoParameter number_in(const Scope& scope, const std::string& key,
                                              std::string name, double step,
                                              double PictureState::*member) {
  PhotoParameter p{key + scope.key, std::move(name),
                   [step](const PhotoState&, const PhotoScene&) {
                     return std::pair{-step, step};
                   },
                   [member, photos = scope.photos](PhotoState& s, double v) {
                     for (const std::size_t k : photos) s.picture[k].*member += v;
                   }};
  if (scope.photos.size() == 1) p.photo = scope.photos.front();
  return p;
}
/// Variance of the spread that a lens in focus has, too, and a pixel's few rays may be wrong by.
inline constexpr double kLeastBlur_px2 = 0.4;
[[nodiscard]] inline double root(double variance) {
  return std::sqrt(std::fmax(0.0, variance));
}

}  // namespace maquette::diagnosis::detail

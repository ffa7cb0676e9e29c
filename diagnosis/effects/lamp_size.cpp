// SPDX-License-Identifier: GPL-3.0-or-later
#include "diagnosis/detail/photo_forms.hpp"

namespace maquette::diagnosis::detail {

namespace {

/// From the rendered lamp to the k-th of those that pixels know of; about a lamp with a size, the
/// nearest of them on both sides: seen through the same points, their difference has less noise.
std::pair<double, double> span(std::size_t k, const PhotoState& s, const PhotoScene& scene) {
  const double now = scene.photos[0].lamp_diameter_mm + s.lamp_diameter_mm;
  double below = -INFINITY, above = INFINITY;
  for (const double size : scene.lamp_sizes_mm) {
    const double change = size - s.lamp_diameter_mm;
    if (change < -0.1 * now) below = std::fmax(below, change);
    if (change > 0.1 * now) above = std::fmin(above, change);
  }
  if (now > 0.0 && std::isfinite(below) && std::isfinite(above)) return {below, above};
  return {0.0, scene.lamp_sizes_mm[k] - s.lamp_diameter_mm};
}

}  // namespace

void add_lamp_size(std::vector<Effect>& all) {
  Effect e;
  e.name = "lamp.size";
  e.says = "shadows have softer (or harder) edges the farther what casts them";
  e.source = "penumbra of a round lamp: width = diameter * way of the shadow / distance";
  e.acts_on = "lamp";
  e.depends_on = "edges of shadows, with the height of what casts them";
  e.looks_like = {"photo.defocus"};
  e.separate_by = "the width of a rod's shadow at two heights";
  e.correction = "state the diameter of the lens of the lamp";
  e.needs = Needs::photograph;
  e.photo_forms = [](const PhotoScene& scene) -> std::vector<PhotoForm> {
    std::vector<PhotoForm> forms;
    for (std::size_t k = 0; k < kLampSizes; ++k)
      forms.push_back(
          {fmt::format("signature at step {}", k + 1),
           {{fmt::format("lamp_size{}", k), "diameter_mm",
             [k](const PhotoState& s, const PhotoScene& at) { return span(k, s, at); },
             [](PhotoState& state, double v) { state.lamp_diameter_mm += v; },
             [declared = scene.photos[0].lamp_diameter_mm](double v) { return declared + v; }}},
           {},
           scene.photos[0].lamp_diameter_mm > 0.0 ? 0 : 1});
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

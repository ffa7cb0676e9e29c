// SPDX-License-Identifier: GPL-3.0-or-later

// A film thicker or thinner than declared by t: t along the normal of the surface without its
// ridges, over which it levels. 25 to 200 um.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {
namespace {

/// A film of one thickness in hollows, too: the surface that a ball smaller by that would have
/// left, its centre where it was.
BallForm film_on_balls(const Scene& scene) {
  return {"even film, in hollows too, ",
          "",
          "film_on_balls",
          film_parameter(scene, "excess_mm"),
          scene.ball_radius_mm,
          {{0.0, 0.0, 1.0}, -1.0}};
}

}  // namespace

void add_coating_thickness(std::vector<Effect>& all) {
  Effect e;
  e.name = "coating.thickness";
  e.says = "the coat is thicker or thinner than declared";
  e.source = "25 to 38 um a decorative coat, primers up to 200 um";
  e.acts_on = "coat";
  e.depends_on = "nothing: a constant along the normal";
  e.looks_like = {"tool.radius_error", "tool.length_offset", "scanner.range_bias"};
  e.never_beside = "coating.shadow";  // which may have an even film beside it
  e.separate_by = "a pad left uncoated, or a film gauge";
  e.correction = "declare the measured thickness, mill deeper by it";
  e.forms = [](const Scene& scene) {
    std::vector<Form> forms{{"even film", {even_film(scene, "excess_mm")}}};
    if (scene.has_path)
      for (const double size : kBallSizes_mm) forms.push_back(film_on_balls(scene)(size));
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

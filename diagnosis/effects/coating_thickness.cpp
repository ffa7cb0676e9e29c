// SPDX-License-Identifier: GPL-3.0-or-later

// A film thicker or thinner than declared by t: t along the normal of the surface without its
// ridges, over which it levels. 25 to 200 um.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {

void add_coating_thickness(std::vector<Effect>& all) {
  Effect e;
  e.name = "coating.thickness";
  e.says = "the coat is thicker or thinner than declared";
  e.source = "25 to 38 um a decorative coat, primers up to 200 um";
  e.acts_on = "coat";
  e.depends_on = "nothing: a constant along the normal";
  e.looks_like = {"tool.radius_error", "tool.length_offset", "scanner.range_bias"};
  e.separate_by = "a pad left uncoated, or a film gauge";
  e.correction = "declare the measured thickness, mill deeper by it";
  e.forms = [](const Scene&) {
    return std::vector<Form>{{"even film", {column("film", {"excess_mm", 1.0, 1.0}, film)}}};
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail

// SPDX-License-Identifier: GPL-3.0-or-later

// Bands, tools or programs that do not meet in height: a constant for each. The bands are those
// of the program, or those that the data show.
#include "diagnosis/detail/forms.hpp"

namespace maquette::diagnosis::detail {
namespace {
constexpr std::size_t kMostBorders = 4;  // that the data show
}

void add_process_band_step(std::vector<Effect>& all) {
  Effect e;
  e.name = "process.band_step";
  e.says = "parts of the surface cut at different times do not meet in height";
  e.source = "tool change, new touch-off; 10 to 50 um";
  e.acts_on = "machine";
  e.depends_on = "band, tool or program";
  e.unknown_shift = std::string("z");
  e.never_beside = "machine.step_loss_z";  // a single border
  e.looks_like = {"machine.step_loss_z", "machine.thermal_growth_z"};
  e.separate_by = "touch-off log of each band";
  e.signature_error = 0.03;
  e.correction = "touch off each band on the same datum";
  e.needs = Needs::path;
  e.forms = [](const Scene& scene) {
    std::vector<Form> forms = steps_of_sections(scene);
    for (Form& f : step_forms(2, scene, kMostBorders)) forms.push_back(std::move(f));
    return forms;
  };
  all.push_back(std::move(e));
}

}  // namespace maquette::diagnosis::detail
